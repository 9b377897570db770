"""The robot and its surroundings in three dimensions, in a viser server: made once, then moved.

Everything is drawn in units of its own size about its own centre, so that arms of any size look alike.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from invariantqp.geometry.arrays import Array
from invariantqp.view.arm import ArmShape, motions
from invariantqp.view.film import Film, colours
from invariantqp.view.look import Part

if TYPE_CHECKING:
    import viser

WANTED, DRAWN, LINK, DARK = (230, 159, 0), (0, 114, 178), (174, 186, 198), (74, 87, 100)
TOUCHED, FORCE, TRAVEL = (205, 187, 159), (190, 60, 0), (0, 158, 115)
# A face of four corners as two triangles.
HALVES = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
# Lengths of the arrow of a strong force or a high velocity, and of any that is drawn.
LONGEST, SHORTEST = 0.35, 0.035
# Where the camera is, from the centre.
EYE = np.array([1.45, -1.65, 1.0])
# What is in the middle of a narrow screen, whose lower half the panel covers.
BELOW = np.array([0.0, 0.0, -1.3])


class Stage:
    """Robot, tool frame, paths and what the tool touches, in units of their size."""

    def __init__(self, server: viser.ViserServer, film: Film) -> None:
        self._draw = server.scene
        self._size = film.size or 1.0
        self._centre = film.centre
        server.initial_camera.position = EYE
        server.initial_camera.look_at = np.zeros(3)
        server.initial_camera.fov = 0.9
        server.on_client_connect(_step_back)
        floor = (film.floor - float(self._centre[2])) / self._size - 0.01
        self._draw.add_grid("/floor", infinite_grid=True, cell_size=0.2, fade_distance=12.0, position=(0.0, 0.0, floor))
        self._draw.add_line_segments("/wanted", _segments(self._at(film.wanted[:, :3, 3])), WANTED, thickness=0.008)
        self._trail = self._draw.add_line_segments("/drawn", np.zeros((1, 2, 3)), DRAWN, thickness=0.012, visible=False)
        self._tool = self._draw.add_frame("/tool", axes_length=0.13, axes_radius=0.007, origin_radius=0.012)
        self._goal = self._draw.add_frame("/goal", axes_length=0.1, axes_radius=0.003, origin_radius=0.006)
        axis = film.surroundings.axis
        self._axis = None if axis is None else self._at(axis)
        self._add_surroundings(film)
        self._force = _Arrow(self._draw, "/force", FORCE, film.force_scale)
        self._travel = _Arrow(self._draw, "/velocity", TRAVEL, film.travel_scale)
        self._screws = film.screws
        self._parts = [(part.joint, self._add_part(i, part)) for i, part in enumerate(film.look.parts)]
        self._links: list[Any] = []
        self._joints: list[tuple[Any, ...]] = []
        self._add_joints(film)

    def _add_part(self, i: int, part: Part) -> Any:
        vertices = (part.vertices / self._size).astype(np.float32)
        return self._draw.add_mesh_simple(f"/parts/{i}", vertices, part.faces.astype(np.uint32), color=part.colour)

    def _add_joints(self, film: Film) -> None:
        """Rods along the axes of an arm with a look, and drums and links of one without."""
        m, bare = len(film.joints), not film.look.parts
        if bare:
            self._draw.add_cylinder("/base", 0.09, 0.016, DARK, position=self._at(film.points[0, 0]))
            self._links = [
                self._draw.add_cylinder(f"/links/{i}", 0.028 - 0.012 * i / (m + 1), 1.0, LINK) for i in range(m + 1)
            ]
        for i, (name, hue, slide) in enumerate(zip(film.joints, colours(m), film.slides, strict=True)):
            colour = np.array(list(bytes.fromhex(hue[1:])))
            node = f"/joints/{i} {name.replace('/', '_')}"
            if not bare:
                self._joints.append((self._draw.add_cylinder(node, 0.006, 0.26, colour),))
                continue
            outer, inner = (colour, np.array(DARK)) if slide else (np.array(DARK), colour)
            half, radius = (0.15, 0.036) if slide else (0.1, 0.045)
            body = self._draw.add_cylinder(node, radius, half, outer)
            caps = self._draw.add_cylinder(f"{node} axis", 0.8 * radius, 1.12 * half, inner)
            self._joints.append((body, caps))

    def arm(self, shape: ArmShape, q: Array) -> None:
        """Move the robot to joint positions q (m,), where it has this shape."""
        moved = motions(self._screws, q) if self._parts else []
        for joint, part in self._parts:
            self._frame(part, moved[joint])
        points = self._at(shape.points)
        for link, a, b in zip(self._links, points[:-1], points[1:], strict=False):  # with a look there are none
            along = b - a
            length = float(np.linalg.norm(along))
            link.visible = length > 0.0
            if link.visible:
                link.position, link.wxyz, link.scale = 0.5 * (a + b), _upright(along / length), (1.0, 1.0, length)
        for parts, p, axis in zip(self._joints, points[1:-1], shape.axes, strict=True):
            for part in parts:
                part.position, part.wxyz = p, _upright(axis)
        self._frame(self._tool, shape.tool)
        if self._axis is not None:
            a, b = self._axis
            out = points[-1] - a
            arm = out - (b - a) * out.dot(b - a) / (b - a).dot(b - a)
            self._door.vertices = np.array([a, b, b + arm, a + arm], dtype=np.float32)

    def goal(self, wanted: Array, drawn: Array) -> None:
        """Move the frame where the tool should be, (4, 4), and draw the points (n, 3) where it has been."""
        self._frame(self._goal, wanted)
        self._trail.visible = len(drawn) > 1
        if self._trail.visible:
            self._trail.points = _segments(self._at(drawn)).astype(np.float32)

    def push(self, tool: Array, force: Array) -> None:
        """Draw the force (3,) that a tool at pose (4, 4) exerts [N]."""
        self._force.draw(self._at(tool[:3, 3]), force, f"{np.linalg.norm(force):.1f} N")

    def travel(self, tool: Array, velocity: Array) -> None:
        """Draw the velocity (3,) of the origin of a tool at pose (4, 4) [m/s]."""
        self._travel.draw(self._at(tool[:3, 3]), velocity, f"{1e3 * np.linalg.norm(velocity):.3g} mm/s")

    def _add_surroundings(self, film: Film) -> None:
        """Add what the tool touches."""
        around = film.surroundings
        if len(around.faces):
            corners = self._at(around.faces).reshape(-1, 3).astype(np.float32)
            halves = np.vstack([HALVES + 4 * i for i in range(len(around.faces))])
            self._draw.add_mesh_simple(
                "/touched", corners, halves, color=TOUCHED, opacity=0.6, side="double", cast_shadow=False
            )
        if self._axis is not None:
            self._draw.add_line_segments("/axis", self._axis[None], DARK, thickness=0.03)
            anywhere = np.zeros((4, 3), np.float32)
            self._door = self._draw.add_mesh_simple(
                "/door", anywhere, HALVES, color=TOUCHED, opacity=0.6, side="double", cast_shadow=False
            )

    def _at(self, points: Array) -> Array:
        """Points in the units of the drawing."""
        scaled: Array = (points - self._centre) / self._size
        return scaled

    def _frame(self, handle: Any, T: Array) -> None:
        handle.position = self._at(T[:3, 3])
        handle.wxyz = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)


class _Arrow:
    """An arrow with its size beside it, by the scale (least, most) that is known at first; the largest is `LONGEST`."""

    def __init__(
        self, draw: viser.SceneApi, name: str, colour: tuple[int, int, int], scale: tuple[float, float]
    ) -> None:
        self._least, self._most = scale
        nowhere = np.zeros((1, 2, 3))
        self._arrow = draw.add_arrows(
            name, nowhere, colour, shaft_radius=0.012, head_radius=0.03, head_length=0.06, visible=False
        )
        self._label = draw.add_label(f"{name} in words", "", visible=False)

    def draw(self, at: Array, vector: Array, words: str) -> None:
        """Draw a vector (3,) at a place (3,); none where it is short."""
        size = float(np.linalg.norm(vector))
        self._most = max(self._most, size)
        seen = size > self._least
        self._arrow.visible = self._label.visible = seen
        if seen:
            tip = at + max(LONGEST / self._most, SHORTEST / size) * vector
            self._arrow.points = np.array([[at, tip]], dtype=np.float32)
            self._label.position, self._label.text = tip, words


def _step_back(client: viser.ClientHandle) -> None:
    """Show all of the scene on a screen that is higher than wide, above the panel."""
    if client.camera.aspect < 1.0:
        client.camera.position = EYE / client.camera.aspect + BELOW
        client.camera.look_at = BELOW  # moving a camera moves where it looks


def _segments(points: Array) -> Array:
    return np.stack((points[:-1], points[1:]), axis=1)


def _upright(axis: Array) -> Array:
    """The quaternion (w, x, y, z) that turns the z axis, along which cylinders stand, to a unit direction."""
    w = 1.0 + axis[2]
    if w < 1e-12:  # straight down: half a turn about x
        return np.array([0.0, 1.0, 0.0, 0.0])
    q = np.array([w, -axis[1], axis[0], 0.0])
    unit: Array = q / np.linalg.norm(q)
    return unit
