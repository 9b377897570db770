"""The page of a `Session`, by viser: arm, ghosts, target, switches, bars of the joints, histories."""

from __future__ import annotations

import time
from contextlib import redirect_stdout
from functools import partial
from html import escape
from io import StringIO
from threading import Event, Thread
from typing import Any

import numpy as np

from invariantqp.errors import BadInput
from invariantqp.extras import optional
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.load import urdf_of
from invariantqp.workbench.drag.recording import LONGEST, Recorder
from invariantqp.workbench.drag.session import ACCELERATION, FORMS, HAND, HISTORY, Arm, Session, Settings
from invariantqp.workbench.view.appearance import appearance_of

with optional("drag", "viser"):
    import viser
    import viser.uplot as plots

# Pictures and numbers per second; the loop runs between them.
PICTURES, NUMBERS = 30.0, 5.0
# Colours of our arm and of the ghosts, of a joint at a limit, and of the table and what keeps clear of it.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#999999")
AT_LIMIT, TABLE = "#D55E00", (150, 120, 90)
GHOST_OPACITY = 0.35
# Arms whose joints moved by less are not drawn again [rad, m].
STILL = 1e-6
# A joint is drawn at a limit within this share of its range; errors below the second are drawn as that.
NEAR, LEAST = 0.005, 1e-3
LOCAL = ("127.0.0.1", "localhost", "::1")
STYLE = """<style>
.iq { font-size: 12px; padding: 4px 12px; } .iq td { text-align: right; padding-left: 8px; }
.iq td:first-child { text-align: left; padding: 0; } .iq table { margin-top: 6px; }
.iq .joint { display: flex; align-items: center; gap: 6px; }
.iq .name { width: 9em; overflow: hidden; white-space: nowrap; }
.iq .bar { flex: 1; height: 8px; background: rgba(128, 128, 128, .25); position: relative; }
.iq .mark { position: absolute; width: 4px; margin-left: -2px; height: 8px; }
.iq .q { width: 3.5em; text-align: right; }
</style>"""


class DragPage:
    """Serves the page of a session to any number of browsers, and runs its loop.

    Attributes:
        session: the arms.
        url: the address on this machine.
    """

    def __init__(self, session: Session, host: str = "127.0.0.1", port: int = 8080, *, dark: bool = False) -> None:
        """Serve a session at a port or the next free one, to this machine alone unless `host` says otherwise."""
        self.session = session
        try:
            with redirect_stdout(StringIO()):  # viser prints a box
                self._server = viser.ViserServer(host=host, port=port, label="invariantqp drag", verbose=False)
        except OSError as error:
            raise BadInput("--port", f"{port}: {error.strerror or error}", "a port that is free") from error
        self.url = f"http://{'localhost' if host in LOCAL else host}:{self._server.get_port()}"
        self._closed, self._reset = Event(), Event()
        self._recorded: Recorder | None = None
        self._theme(dark)
        self._scene()
        self._panel()
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def clients(self) -> int:
        """How many browsers are connected."""
        return len(self._server.get_clients())

    def close(self) -> None:
        """Stop the loop and the server."""
        self._closed.set()
        self._thread.join()
        with redirect_stdout(StringIO()):
            self._server.stop()

    def _theme(self, dark: bool) -> None:
        self._server.gui.configure_theme(
            control_layout="floating",
            dark_mode=dark,
            show_logo=False,
            show_share_button=False,
            brand_color=_rgb(COLOURS[0]),
        )

    def _scene(self) -> None:
        """Arms, target, table, and where the camera is at first."""
        session, scene = self.session, self._server.scene
        reach, tool = session.reach, session.target[:3, 3]
        scene.set_up_direction("+z")
        scene.add_grid("/floor", width=2.4 * reach, height=2.4 * reach, cell_size=0.1, section_size=0.5)
        appearance = appearance_of(session.robot, partial(urdf_of, session.source))
        self._parts: list[tuple[int, int, Any]] = []  # arm, number of joints that move it, handle
        self._links: list[tuple[Arm, Any]] = []  # of arms without meshes
        self._drawn = [np.full(len(arm.q), np.inf) for arm in session.arms]  # joint positions
        for i, arm in enumerate(session.arms):
            hue = _rgb(COLOURS[i % len(COLOURS)])
            for j, part in enumerate(appearance.parts):
                look = {"color": part.colour} if i == 0 else {"color": hue, "opacity": GHOST_OPACITY}
                mesh = scene.add_mesh_simple(f"/arms/{i}/{j}", part.vertices.astype(np.float32), part.faces, **look)
                self._parts.append((i, part.joint, mesh))
            if not appearance.parts:
                thickness, points = 6.0 if i == 0 else 3.0, self._segments(arm)
                links = scene.add_line_segments(
                    f"/arms/{i}", points, hue, thickness=thickness, thickness_units="screen"
                )
                self._links.append((arm, links))
        self._gizmo = scene.add_transform_controls("/target", scale=0.2 * reach, depth_test=False)
        self._gizmo.on_update(lambda _: self._dragged())
        self._place_target()
        board = (1.2 * reach, 1.2 * reach, 0.01)
        self._table = scene.add_box("/table", dimensions=board, color=TABLE, opacity=0.5, visible=False)
        self._hand = scene.add_icosphere("/hand", radius=HAND, color=TABLE, opacity=0.4, visible=False)
        look_at = 0.5 * tool + [0.0, 0.0, 0.1 * reach]
        aside = 0.75 * reach * np.array([0.9 if tool[0] >= 0.0 else -0.9, -1.0, 0.5])
        camera = self._server.initial_camera
        camera.position, camera.look_at = tuple(look_at + aside), tuple(look_at)

        @self._server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            if client.camera.aspect < 1.0:  # a phone: above its panel
                client.camera.position = look_at + 1.8 * aside
                client.camera.look_at = look_at - [0.0, 0.0, 0.5 * reach]

    def _segments(self, arm: Arm) -> Array:
        """(k, 2, 3) the links of an arm, from joint to joint."""
        robot = self.session.robot
        points = np.vstack((np.zeros(3), robot.origins(arm.q), robot.pose(arm.q)[:3, 3]))
        return np.stack((points[:-1], points[1:]), axis=1).astype(np.float32)

    def _place_target(self) -> None:
        target = self.session.target
        self._gizmo.position, self._gizmo.wxyz = target[:3, 3], _wxyz(target)

    def _dragged(self) -> None:
        self.session.target = se3.transform(_rotation(self._gizmo.wxyz), np.array(self._gizmo.position))

    def _panel(self) -> None:
        """Status, bars, charts and switches."""
        gui, arms = self._server.gui, self.session.arms
        self._status, self._bars = gui.add_html(""), gui.add_html("")
        with gui.add_folder("arm"):
            self._speed = gui.add_slider("speed limits, %", 5, 100, 5, 100)
            self._override = gui.add_slider(
                "override, %", 0, 100, 5, 100, hint="of our arm: share of the requested speed"
            )
            self._form = gui.add_dropdown("form", FORMS)
            self._pitch = gui.add_slider("pitch h, m/rad", -0.5, 0.5, 0.01, 0.1)
            self._exact = gui.add_checkbox("exact position", initial_value=False)
            self._clear = gui.add_checkbox("clear of a table", initial_value=False, hint="our arm alone")
            self._displaced = gui.add_checkbox("displaced tool frame", initial_value=False, hint="of the same tool")
            self._ghost_limit = gui.add_checkbox(
                f"ghosts keep {ACCELERATION:g} rad/s²", initial_value=True, visible=len(arms) > 1
            )
            back = gui.add_button("back to the start")
        switches: tuple[Any, ...] = (self._speed, self._form, self._pitch, self._exact, self._clear, self._displaced)
        for switch in (*switches, self._ghost_limit):
            switch.on_update(lambda _: self._request())
        self._override.on_update(lambda _: setattr(self.session, "override", self._override.value / 100.0))
        back.on_click(lambda _: self._reset.set())
        curves = [plots.Series(label=a.name, stroke=COLOURS[i % len(COLOURS)], width=2) for i, a in enumerate(arms)]
        series, nothing = (plots.Series(label="s"), *curves), tuple(np.zeros(1) for _ in range(1 + len(arms)))
        look: dict[str, Any] = {"aspect": 1.8, "scales": {"x": plots.Scale(time=False), "y": plots.Scale(distr=3)}}
        self._errors = gui.add_uplot(nothing, series, title="position error, mm", **look)
        self._accelerations = gui.add_uplot(nothing, series, title="joint acceleration, rad/s²", **look)
        with gui.add_folder("recording"):
            self._record = gui.add_button("record")
            self._replay = gui.add_button("download the page", disabled=True)
            self._task = gui.add_button("download the task file", disabled=True)
        self._record.on_click(lambda _: self._toggle())
        self._replay.on_click(lambda event: self._download(event, "dragged.html"))
        self._task.on_click(lambda event: self._download(event, "dragged.toml"))

    def _request(self) -> None:
        speed, keep = self._speed.value / 100.0, self._ghost_limit.value
        switches = self._exact.value, self._clear.value, self._displaced.value
        self.session.requested = Settings(self._form.value, self._pitch.value, *switches, speed, keep)

    def _toggle(self) -> None:
        session = self.session
        if session.recorder is None:
            session.record()
        else:
            self._recorded, session.recorder = session.recorder, None
            self._record.label = "record"
        self._replay.disabled = self._task.disabled = self._recorded is None

    def _download(self, event: Any, name: str) -> None:
        """Send the recording to the browser that asked for it."""
        recorded = self._recorded
        if event.client is not None and recorded is not None and recorded.seconds > 0.0:
            text = recorded.page() if name.endswith(".html") else recorded.task_file()
            event.client.send_file_download(name, text.encode())

    def _run(self) -> None:
        """The loop: it waits for the clock, never for a browser."""
        last = numbers = time.perf_counter()
        while not self._closed.wait(max(0.0, 1.0 / PICTURES - (time.perf_counter() - last))):
            now = time.perf_counter()
            if self._reset.is_set():
                self._reset.clear()
                self.session.reset()
                self._place_target()
            self.session.advance(now - last)
            last = now
            self._draw()
            if now - numbers >= 1.0 / NUMBERS:
                numbers = now
                self._write()

    def _draw(self) -> None:
        """The arms where they are. Of each handle a browser gets the newest place that it has time for."""
        session = self.session
        moved = [i for i, arm in enumerate(session.arms) if np.abs(arm.q - self._drawn[i]).max() > STILL]
        motions = {i: session.robot.motions(session.arms[i].q) for i in moved}
        with self._server.atomic():
            for i, joint, mesh in self._parts:
                if i in motions:
                    mesh.position, mesh.wxyz = motions[i][joint][:3, 3], _wxyz(motions[i][joint])
            for arm, links in self._links:
                links.points = self._segments(arm)
            for i in moved:
                self._drawn[i] = session.arms[i].q
            if session.settings.table:
                self._hand.position = session.robot.pose(session.ours.q)[:3, 3]

    def _write(self) -> None:
        """Numbers, bars and charts."""
        session = self.session
        self._status.content, self._bars.content = status_html(session), bars_html(session)
        self._hand.visible = self._table.visible = session.settings.table
        if session.settings.table:
            self._table.position = (0.0, 0.0, session.table_height - 0.005)
        histories = [list(arm.history) for arm in session.arms]
        n = min(map(len, histories))
        if n > 1:
            seconds = np.array([sample.time for sample in histories[0][-n:]])
            for plot, key in ((self._errors, "mm"), (self._accelerations, "acceleration")):
                rows = (np.array([getattr(sample, key) for sample in history[-n:]]) for history in histories)
                plot.data = (seconds, *(np.maximum(row, LEAST) for row in rows))
        if session.recorder is not None:
            self._record.label = f"stop ({session.recorder.seconds:.0f} of {LONGEST:.0f} s)"


def status_html(session: Session) -> str:
    """Status and reason of our arm; of each arm the largest errors and acceleration of the last HISTORY seconds."""
    ours, rows = session.ours, []
    reason = f"not taken over: {session.refused}" if session.refused else ours.reason
    for i, arm in enumerate(session.arms):
        cells = "".join(f"<td>{value if value > LEAST else 0:.3g}</td>" for value in arm.worst())
        colour, fails = COLOURS[i % len(COLOURS)], escape(arm.status) if i else ""
        rows.append(f'<tr><td style="color:{colour}">{escape(arm.name)}</td>{cells}<td>{fails}</td></tr>')
    head = f"<tr><td>largest in {HISTORY:g} s</td><td>mm</td><td>deg</td><td>rad/s²</td></tr>"
    said = f'<b id="status">{escape(ours.status)}</b> <span id="reason">{escape(reason)}</span>'
    return f'{STYLE}<div class="iq">{said}<table>{head}{"".join(rows)}</table></div>'


def bars_html(session: Session) -> str:
    """A bar for each joint: where it is between its limits, in another colour at one of them."""
    robot, rows = session.robot, []
    for name, q, low, high in zip(robot.names, session.ours.q, robot.position_lower, robot.position_upper, strict=True):
        bounded = np.isfinite(low) and np.isfinite(high)
        share = (q - low) / (high - low) if bounded else 0.5 + np.arctan(q) / np.pi
        colour = COLOURS[0] if not bounded or NEAR < share < 1.0 - NEAR else AT_LIMIT
        mark = f'<div class="mark" style="left:{100 * min(max(share, 0.0), 1.0):.1f}%;background:{colour}"></div>'
        bar = f'<span class="name">{escape(name)}</span><div class="bar">{mark}</div><span class="q">{q:.2f}</span>'
        rows.append(f'<div class="joint">{bar}</div>')
    return f'<div class="iq">{"".join(rows)}</div>'


def _rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def _wxyz(T: Array) -> Array:
    """The quaternion of a pose, w first."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(T[:3, :3]).as_quat()[[3, 0, 1, 2]])


def _rotation(wxyz: Any) -> Array:
    """The rotation matrix of a quaternion, w first."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(np.asarray(wxyz)[[1, 2, 3, 0]]).as_matrix())
