"""A run in a browser, while it is running and after, served to this machine only. The one file that imports viser."""

from __future__ import annotations

import io
import webbrowser
from contextlib import redirect_stdout
from dataclasses import replace
from time import monotonic, sleep
from typing import Any

import numpy as np

from invariantqp.extras import optional
from invariantqp.geometry.arrays import Array
from invariantqp.runs.plants.plant import PlantState
from invariantqp.runs.taskfile import Task
from invariantqp.runs.trace import Trace
from invariantqp.velocity.solution import VelocitySolution
from invariantqp.view.arm import ArmShape, arm_shape, tool_velocity
from invariantqp.view.display import tunnel
from invariantqp.view.film import (
    FORCE,
    CurveChart,
    Film,
    extremes,
    film_before,
    film_of,
    limit_charts,
)
from invariantqp.view.stage import Stage
from invariantqp.view.widgets import joint_bars, paragraph, span, with_cursor

# The port to serve at, or the next one that is free.
PORT = 8080
# How often the robot is drawn, and the curves, which cost more [1/s].
PICTURES = 30
PLOTS = 8
# Points of a curve while the run is running.
COARSE = 200
SLOWEST, FASTEST = 0.05, 4.0
CURSOR = "#808080"


class Viewer:
    """A page with robot, path, playback and curves, for one run.

    Attributes:
        url: what to open in a browser on this machine.
        tunnel: the command that makes the same address work on another machine, over SSH.
    """

    def __init__(self, task: Task, port: int = PORT) -> None:
        """Serve what is known before the run: the arm at its start, and its path.

        Raises:
            MissingExtra: viser is not installed.
            RobotModelError, UnknownName: the robot cannot be loaded.
        """
        with optional("view", "viser"):
            import viser
        self._robot = task.load_robot()
        self._dt = task.law.dt
        self._film = film_before(task)
        with redirect_stdout(io.StringIO()):  # viser prints when it starts and stops
            self._server = viser.ViserServer(host="127.0.0.1", port=port, label=task.name, verbose=False)
        at = self._server.get_port()
        self.url: str = f"http://localhost:{at}"
        self.tunnel: str = tunnel(at)
        self._open = True
        self._t, self._shown, self._playing = 0.0, -1.0, False
        self._seen: list[tuple[Array, Array, Array, Array]] = []
        self._next_picture = self._next_plots = 0.0
        self._plots: dict[str, tuple[Any, dict[str, Any]]] = {}
        self._stage = Stage(self._server, self._film)
        self._stage.arm(arm_shape(self._robot, task.start()), np.array(task.start()))
        self._stage.goal(self._film.wanted[0], np.empty((0, 3)))
        self._add_panel()

    def close(self) -> None:
        """Stop serving."""
        if self._open:
            self._open = False
            with redirect_stdout(io.StringIO()):
                self._server.stop()

    def watch(self, tick: int, state: PlantState, solution: VelocitySolution) -> None:
        """An observer for `run_task`; draws no more often than an eye can follow."""
        self._seen.append((state.q, solution.velocity, state.wrench[3:], state.pose[:3, 3]))
        now = monotonic()
        if now < self._next_picture or not tick:
            return
        self._next_picture = now + 1.0 / PICTURES
        with self._server.atomic():
            self._stage.arm(arm_shape(self._robot, state.q), state.q)
            self._stage.travel(state.pose, tool_velocity(self._robot, state.q, solution.velocity))
            self._stage.push(state.pose, -state.wrench[3:])
            drawn = np.array([point for *_, point in self._seen[:: 1 + tick // COARSE]])
            self._stage.goal(self._film.wanted[self._film.frame(self._dt * tick)], drawn)
            self._told.content = paragraph(f"running: {tick * self._dt:.2f} s, {solution.status}")
            if now >= self._next_plots:
                self._next_plots = now + 1.0 / PLOTS
                so_far = self._so_far()
                self._draw_plots(so_far, so_far.time[-1])
                self._joints.content = joint_bars(so_far, -1)

    def _so_far(self) -> Film:
        """The run as far as it has come."""
        q, speed, force, _ = (np.array(part) for part in zip(*self._seen, strict=True))
        ends = np.unique(np.linspace(0, len(q) - 1, COARSE).astype(int))
        seen = replace(self._film, time=self._dt * ends, q=q[ends], speed=extremes(speed, ends))
        size = extremes(np.linalg.norm(force, axis=1)[:, None], ends).T
        felt = [CurveChart("contact force [N]", ("size",), size, (FORCE,))] if force.any() else []
        return replace(seen, charts=(*felt, *limit_charts(seen)))

    def show(self, film: Film) -> None:
        """Play a run that is done."""
        self._film = film
        with self._server.atomic():
            for plot, _ in self._plots.values():  # a plot that is removed could still be sent changes
                plot.visible = False
            self._plots = {}
            self._about.content = paragraph(film.about)
            self._time.max = float(film.time[-1])
            for control in (self._play, self._time, self._rate):
                control.disabled = False
        self._t = 0.0
        self._set_playing(True)

    def open_browser(self) -> None:
        """Show the page on this machine's display."""
        webbrowser.open(self.url)

    def play(self, trace: Trace) -> None:
        """Show a run that is done, until interrupted or closed."""
        self.show(film_of(trace))
        self.serve()

    def serve(self) -> None:
        """Play, pause and seek as the page asks, until interrupted or closed."""
        before = monotonic()
        while self._open:
            sleep(1.0 / PICTURES)
            now = monotonic()
            if self._playing and self._server.get_clients():  # time stands still while nobody looks
                self._t = min(float(self._film.time[-1]), self._t + self._rate.value * (now - before))
                self._set_playing(self._t < self._film.time[-1])
            before = now
            if self._open and self._t != self._shown:
                self._draw(self._t)

    def _add_panel(self) -> None:
        """Fill the panel: playback, joints, curves."""
        gui = self._server.gui
        gui.configure_theme(control_width="large", show_share_button=False)
        gui.main_panel.dock_right()
        gui.set_panel_label(f"invariantqp: {self._film.title}")
        self._about = gui.add_html(paragraph(self._film.about))
        self._told = gui.add_html(paragraph("waiting for the run"))
        self._play = gui.add_button("Pause", disabled=True)
        last = float(self._film.time[-1])
        self._time: Any = gui.add_slider("time [s]", 0.0, last, last / 1000.0, 0.0, disabled=True)
        self._rate = gui.add_slider("speed", SLOWEST, FASTEST, SLOWEST, 1.0, disabled=True)
        self._joints = gui.add_html(joint_bars(self._film, 0))

        @self._play.on_click
        def _(_: Any) -> None:
            if self._t >= self._film.time[-1]:
                self._t = 0.0
            self._set_playing(not self._playing)

        @self._time.on_update
        def _(event: Any) -> None:
            if event.client is not None:  # moved by a person, not by `_draw`
                self._set_playing(False)
                self._t = float(self._time.value)

    def _set_playing(self, on: bool) -> None:
        if on != self._playing:
            self._playing = on
            self._play.label = "Pause" if on else "Play"
            self._next_plots = 0.0

    def _draw(self, t: float) -> None:
        """Draw everything at a time t [s]."""
        film, now = self._film, monotonic()
        i = film.frame(t)
        with self._server.atomic():
            self._stage.arm(ArmShape(film.points[i], film.axes[i], film.tool[i]), film.q[i])
            self._stage.travel(film.tool[i], film.travel[i])
            self._stage.goal(film.wanted[i], film.tool[: i + 1, :3, 3])
            if film.force is not None:
                self._stage.push(film.tool[i], film.force[i])
            self._time.value = t
            mm, deg = film.charts[0].values[:, i]
            limit = ", limit active" if film.limit_active[i] else ""
            words = f"{t:.2f} s: error {mm:.2g} mm, {deg:.2g} deg, {film.status[i]}{limit}"
            self._told.content = paragraph(words)
            if now >= self._next_plots or not self._playing:
                self._next_plots = now + 1.0 / PLOTS
                self._joints.content = joint_bars(film, i)
                self._draw_plots(film, t)
        self._shown = t

    def _draw_plots(self, film: Film, t: float) -> None:
        """Draw a film's curves with a cursor at t."""
        for chart in film.charts:
            data = with_cursor(film.time, chart, t)
            scales = {
                "x": {"time": False, "range": (0.0, float(self._film.time[-1]))},
                "y": {"range": span(chart)},
            }
            if chart.title not in self._plots:
                self._plots[chart.title] = self._add_plot(chart, data, scales), scales
                continue
            plot, before = self._plots[chart.title]
            plot.data = data
            if scales != before:
                plot.scales = scales
                self._plots[chart.title] = plot, scales

    def _add_plot(self, chart: CurveChart, data: tuple[Array, ...], scales: dict[str, Any]) -> Any:
        lines: list[Any] = [
            {"label": name, "stroke": colour, "width": 1.5}
            for name, colour in zip(chart.names, chart.colours, strict=True)
        ]
        return self._server.gui.add_uplot(
            data,
            ({"label": "time [s]"}, *lines, {"label": "now", "stroke": CURSOR, "width": 1.0}),
            title=f"{chart.title}, powers of ten" if chart.log else chart.title,
            scales=scales,
            legend={"show": len(chart.names) < 4, "live": False},
            height=150,
        )
