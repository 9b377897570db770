"""Clearance: the links of an arm keep a distance from each other and from what is around them.

    C x >= -alpha (d - d_min) - n'v_obstacle        C = w'J on the joints between two bodies,  w = (p x n; n)

for each place where a pair is near (`geometry/distance.py`): n from one body to the other, p a point of that line. The
approach to d_min is exponential at the rate alpha = min(0.1 / dt, 1 / (e (D + dt/2))): a tick covers at most a tenth of
the room, and what is decided on positions D seconds old does not overshoot.

Joints with acceleration limits a do not stop at once. A velocity is then one that can still be braked from:

    q_n(x) = q + dt (x + x' + x'' + ...)      n ticks of braking x at 0.7 a, each joint by itself, inside its range
    d(q_n(x), n dt) - d_min >= (1 - alpha dt) (d(q_n(y), n dt) - d_min),    y the last velocity braked for a tick

to first order in x - y, for n = 0 and the ticks that it takes to stop, 0.7, 0.49, ... of them. In the next tick
braking on goes through the same states: where all of them kept the distance, x = y keeps every row, every acceleration
and every joint limit. So rows contradict nothing, but where a start did or something moves otherwise than it was told.

A row that no velocity can reach is left out, so there is no distance of influence; of the others the 16 most urgent are
kept, each pair's nearest place before all others. Inside d_min all places of a pair ask for the way out of the nearest
one, slowly. Rows give way where they contradict joint limits, never the other way round.

What it does not do: find a way around. An arm that is led straight into an obstacle stops before it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import e, inf
from os import PathLike
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.clearance_pairs import Pairs, Part, chain_of, frame_of, shapes_of
from invariantqp.control.clearance_rows import USUAL_SPEED, Found, Rate, placed_at, rows_of
from invariantqp.control.limits import Limit, Loop, boxes
from invariantqp.engine import core
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import Placed, places
from invariantqp.geometry.shapes import Shape
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot
from invariantqp.velocity.limits import LimitRows, accelerations
from invariantqp.velocity.qp import ACTIVE_TOLERANCE

# A tick covers this share of the room that is left.
SHARE_OF_ROOM = 0.1
# Of the accelerations, rows take this share to brake by; the rest is for how their directions turn within a tick, and
# between the states that are looked at.
BRAKING = 0.7
# Inside the distance, bodies are led apart at the first share of the joints' velocity limits, and no joint is faster
# than the second: an arm that begins inside comes out in a second or three, without a kick. That holds from a depth on
# of the third, of the distance; less is what curvature takes of it in a tick.
ESCAPE, CALM, DEEP = 0.06, 0.09, 0.05
# Two arms that do not know each other's velocity may each take half of the room between them.
HALF = 0.5
# Where a joint moves nothing in this very state, a state is looked at that is so many seconds at full speed away [s]:
# what is moved there is, by 1e-14 of its size, as far as it is here.
ASIDE = 1e-7


class Near(NamedTuple):
    """Two bodies and how far they are apart."""

    first: str
    second: str
    distance: float  # [length], negative inside; infinite where there is no pair

    def __str__(self) -> str:
        return f"{self.first} and {self.second}, {1e3 * self.distance:.1f} mm"


class OtherArm:
    """Another arm as an obstacle: its links move when they are told to. Each of two arms has the other as one.

    Attributes:
        robot: that arm; both have the same base frame: put it where it stands with `load_robot(base=)`.
        bodies: the shapes of its links.
        name: what its links' names begin with.
    """

    def __init__(
        self,
        robot: Robot,
        bodies: Mapping[str, Sequence[Shape]] | None = None,
        *,
        name: str = "other",
        acceleration_limit: ArrayLike | None = None,
    ) -> None:
        """Another arm.

        Args:
            robot: that arm, its base frame the same as this one's.
            bodies: as in `Clearance`.
            name: what its links' names begin with.
            acceleration_limit: (m,) or one for all [rad/s^2, length/s^2], of an arm that has a clearance from this one
                in its own loop: it brakes for it as this one does, and each takes half of the room. None is an arm that
                goes where its velocity says, whatever is in its way.

        Raises:
            BadInput: as `Clearance`; accelerations that are not above zero.
        """
        self.robot: Chain = chain_of(robot)
        self.bodies = shapes_of(self.robot, bodies)
        self.name = name if isinstance(name, str) else arrays.strings([name], "name")[0]
        self._at = {link: frame_of(self.robot, link) for link in self.bodies}
        self.parts: dict[str, list[Shape]] = {
            link: [_copied(shape, f"{self.name}/{link}") for shape in shapes] for link, shapes in self.bodies.items()
        }
        m = len(self.robot.names)
        self._brakes = None if acceleration_limit is None else accelerations(acceleration_limit, m)
        self.knows_velocity, self.stops = False, inf

    @property
    def yields(self) -> bool:
        """Whether it makes way too, and each takes half of the room: it is said to, or its velocity is not known."""
        return self._brakes is not None or not self.knows_velocity

    def move(self, q: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Say where its joints are from now on, between ticks.

        Args:
            q: (m,) its joint positions.
            velocity: (m,) its joint velocity; None is not known: each arm may then take half of the room between them,
                which keeps apart two arms that stop at once.

        Raises:
            BadInput: NaN or wrong lengths.
        """
        positions = arrays.vector(q, len(self.robot.names), "q")
        x = None if velocity is None else arrays.vector(velocity, len(self.robot.names), "velocity")
        motions = self.robot.motions(positions)
        J = None if x is None else self.robot.jacobian(positions) * x
        for link, shapes in self.parts.items():
            body, frame = self._at[link]
            twist = None if J is None else J[:, :body].sum(axis=1)
            for shape in shapes:
                shape.move(motions[body].dot(frame), twist)
        self.knows_velocity = x is not None
        if x is not None and self._brakes is not None:
            self.stops = float((np.abs(x) / (BRAKING * self._brakes)).max())


class Clearance(Limit):
    """A limit: no two of an arm's links, and no link and obstacle, come nearer than a distance.

    Attributes:
        robot: the arm.
        bodies: the shapes of its links, by link, each in its link's frame.
        obstacles: what is around it.
        distance: d_min [length].
        pairs: the names of the bodies that are kept apart.
        dropped: the pairs that are not, each with its reason.
        nearest: which two bodies were the nearest in the last tick that asked for rows, and their `distance`.
    """

    def __init__(
        self,
        robot: Robot,
        bodies: Mapping[str, Sequence[Shape]] | None = None,
        obstacles: Sequence[Shape | OtherArm] = (),
        distance: float = 0.02,
        *,
        pairs: Iterable[tuple[str, str]] | None = None,
        exclude: Iterable[tuple[str, str]] | str | PathLike[str] = (),
        rate: float | None = None,
    ) -> None:
        """A clearance for `limits=[...]` of a controller.

        Args:
            robot: from `load_robot`.
            bodies: the shapes of its links, each in its link's frame, by the name of the link; "tool" is the tool
                frame, "base" the base frame; by the name of a joint, the body that it moves, in the base frame at
                q = 0. None is the collision geometry of the robot's description.
            obstacles: shapes in the base frame, moved by `shape.move(pose, twist)`; OtherArm for another arm.
            distance: what is kept [length].
            pairs: names of two bodies each that are kept apart; None is all that can touch.
            exclude: pairs that may touch, such as ("panda_hand", "table") where the hand works on it, or the path of an
                SRDF that lists them. What the robot's own SRDF or MJCF excludes is excluded too.
            rate: alpha [1/s]; None is the largest that the controller's tick, delay and accelerations allow.

        Raises:
            BadInput: something that is no shape, a distance below zero, a robot without collision geometry and bodies.
            UnknownName: a link, or a body in a pair, that is not there.
            RobotModelError: geometry or an SRDF that cannot be read.
            MissingExtra: a description with meshes, without coal (extra `pin`).
        """
        self.robot: Chain = chain_of(robot)
        self.distance: float = arrays.not_negative(distance, "distance", "a distance in lengths")
        self.bodies = shapes_of(self.robot, bodies)
        if not isinstance(obstacles, (list, tuple)):
            raise BadInput("obstacles", excerpt(obstacles), "a list of shapes and OtherArm")
        self.obstacles: tuple[Shape | OtherArm, ...] = tuple(obstacles)
        self._rate = None if rate is None else arrays.number(rate, "rate", "a rate in 1/s", positive=True)
        found = Pairs(self.robot, self._listed(), self.distance, pairs, exclude)
        self._parts, self._numbers, self._levers, self._solids = found.parts, found.numbers, found.levers, found.solids
        self._twists = np.zeros((len(self._parts), 7))
        self._twists[:, 6] = inf
        self._moving = [i for i, part in enumerate(self._parts) if part.frame is None]
        self._seen: list[Array] = [part.shape.pose for part in self._parts]
        self._of_pair, self.dropped = found.of_shapes, found.dropped
        self._pairs = np.array([(i, j, 1.0) for i, j in self._of_pair], dtype=np.float64).reshape(-1, 3)
        self._of_arms = [
            (
                arm,
                [
                    k
                    for k, (i, j) in enumerate(self._of_pair)
                    if id(arm) in (self._parts[i].owner, self._parts[j].owner)
                ],
            )
            for arm in self.obstacles
            if isinstance(arm, OtherArm)
        ]
        names = {(self._parts[i].name, self._parts[j].name): None for i, j in self._of_pair}
        self.pairs: tuple[tuple[str, str], ...] = tuple(names)
        self.nearest = Near("", "", inf)
        self._still = self._at_rate(0.0, 0.0)  # all distances, and no rows that matter

    def __repr__(self) -> str:
        return f"<Clearance of {self.distance:g}, {len(self.pairs)} pairs of bodies, {len(self.dropped)} dropped>"

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        """The rows at joint positions q (m,), at the rate given; a controller asks `for_loop` instead.

        Raises:
            BadInput: no rate.
        """
        del velocity
        if self._rate is None:
            raise BadInput("rate", "None", "a rate in 1/s, or a controller that has this clearance in limits=[...]")
        return self.rows_at(q, self._at_rate(self._rate, 0.0))

    def __call__(self, q: Array) -> LimitRows | None:
        """The rows at joint positions q (m,), at the rate given.

        Raises:
            BadInput: no rate.
        """
        return self.rows(q, np.zeros(len(q)))

    def for_loop(self, loop: Loop) -> Limit:
        """The clearance at the rate of a loop.

        Raises:
            BadInput: a loop of another robot.
        """
        if loop.robot.names != self.robot.names:
            raise BadInput("limits", f"{self!r} of another robot", "one made with this controller's robot")
        return _InLoop(self, self.in_loop(loop))

    def in_loop(self, loop: Loop) -> Rate:
        """The rate in a loop, and what its joints brake by."""
        alpha = min(SHARE_OF_ROOM / loop.dt, 1.0 / (e * (loop.delay + 0.5 * loop.dt)))
        rate = self._at_rate(alpha if self._rate is None else min(alpha, self._rate), loop.delay, loop.dt)
        box = boxes(loop, loop.velocity_limit)[0]
        limits = box.velocity_limit, loop.acceleration, box.position_lower, box.position_upper
        return rate._replace(limits=np.array(limits))

    def rows_at(self, q: Array, rate: Rate, before: Array | None = None) -> LimitRows | None:
        """The rows at joint positions q (m,) after a velocity `before` (m,), None where nothing is near enough."""
        C, lower, of_pair, distances = self._asked(arrays.vector(q, len(self.robot.names), "q"), rate, before)
        self.nearest = self._nearest(distances)
        inside = self._is_inside(self.nearest)
        if not (len(lower) or inside):
            return None
        upper = np.full(len(lower), inf)
        called = {i: self._called(int(i), distances[int(i)]) for i in set(of_pair.tolist())}
        names = [called[i] for i in of_pair.tolist()]
        if inside and not self._twists[:, :6].any():
            speed = self._calm(rate, before)
            limited = np.isfinite(speed)
            C = np.vstack((C, np.eye(len(speed))[limited]))
            lower, upper = np.append(lower, -speed[limited]), np.append(upper, speed[limited])
            names += ["clearance: slowly out"] * int(limited.sum())
        return LimitRows.trusted(C, lower, upper, tuple(names)) if len(lower) else None

    def _called(self, i: int, distance: float) -> str:
        """What reasons call the rows of a pair."""
        one, other = self._of_pair[i]
        near = Near(self._parts[one].name, self._parts[other].name, distance)
        return f"clearance: {near}" + (f" (nearer than {1e3 * self.distance:.1f})" if self._is_inside(near) else "")

    def _calm(self, rate: Rate, before: Array | None) -> Array:
        """(m,) how fast joints may be, the nearest bodies being nearer than the distance, and no brakes too weak."""
        deep = _depth(self.distance - self.nearest.distance, self.distance)
        speed: Array = max(CALM, 1.0 - deep) * self.robot.velocity_limit
        return speed if before is None else np.maximum(speed, rate.braked(before, deep))

    def at(self, q: ArrayLike) -> Near:
        """The least distance at joint positions q (m,).

        Raises:
            BadInput: NaN or a wrong length.
        """
        return self._nearest(self._distances(q))

    def blocked(self, q: ArrayLike) -> str:
        """Which bodies are nearer than the distance at joint positions q (m,), "" where none are.

        Obstacles that move do not count: they may be gone by then.

        Raises:
            BadInput: NaN or a wrong length.
        """
        found = self._distances(q)
        moved = [part.frame is None and (part.owner != 0 or bool(part.shape.twist.any())) for part in self._parts]
        still = [not (moved[i] or moved[j]) for i, j in self._of_pair]
        near = self._nearest(np.where(still, found, inf))
        return (
            f"{near.first} and {near.second} are nearer than {1e3 * self.distance:.1f} mm"
            if self._is_inside(near)
            else ""
        )

    def _is_inside(self, near: Near) -> bool:
        """Whether two bodies are nearer than the distance, but for rounding."""
        return near.distance < self.distance - ACTIVE_TOLERANCE * max(self.distance, 1.0)

    def distances(self, q: ArrayLike) -> dict[tuple[str, str], float]:
        """The distance of each pair of bodies at joint positions q (m,) [length]; negative inside.

        Parts of a body that no joint moves towards the other do not count: they are infinitely far.

        Raises:
            BadInput: NaN or a wrong length.
        """
        found = dict.fromkeys(self.pairs, inf)
        for (i, j), d in zip(self._of_pair, self._distances(q).tolist(), strict=True):
            name = self._parts[i].name, self._parts[j].name
            found[name] = min(found[name], d)
        return found

    def shapes(self, q: ArrayLike) -> list[tuple[str, int | None, Placed]]:
        """All shapes where they are at joint positions q (m,), to draw them.

        Each with the name of its body and how many joints move it, None for an obstacle.

        Raises:
            BadInput: NaN or a wrong length.
        """
        positions = arrays.vector(q, len(self.robot.names), "q")
        self._refresh(0.0)
        placed = placed_at(self._numbers, self.robot.motions(positions), (), self._solids)
        moved = [None if part.frame is None else part.body for part in self._parts]
        return [(part.name, body, at) for part, body, at in zip(self._parts, moved, placed, strict=True)]

    def _at_rate(self, alpha: float, delay: float, dt: float = 0.0) -> Rate:
        """A rate for joints that stop at once."""
        robot = self.robot
        free = np.full(len(robot.names), inf)
        limits = np.array((robot.velocity_limit, free, robot.position_lower, robot.position_upper))
        return Rate(limits, np.array((self.distance, alpha, ESCAPE, dt, BRAKING, 0.0)), delay)

    def _nearest(self, distances: Array) -> Near:
        if not len(distances):
            return Near("", "", inf)
        i = int(distances.argmin())
        one, other = self._of_pair[i]
        return Near(self._parts[one].name, self._parts[other].name, float(distances[i]))

    def _distances(self, q: ArrayLike) -> Array:
        """(k,) distances of the pairs, of what some joint moves.

        In a singular state a joint may move nothing for an instant: what it does move is told apart a hair beside it.
        """
        positions = arrays.vector(q, len(self.robot.names), "q")
        here = self._asked(positions, self._still).distances
        speed = self.robot.velocity_limit
        step = ASIDE * np.where(np.isfinite(speed), speed, USUAL_SPEED) / np.sqrt(np.arange(1.0, len(speed) + 1.0))
        aside = self._asked(positions + step, self._still).distances
        moved = self._levers.dot(step)[self._pairs[:, :2].astype(int)].max(axis=1, initial=0.0)
        return np.asarray(np.where(np.isinf(here) | (aside < here - moved), aside, here))

    def _asked(self, q: Array, rate: Rate, before: Array | None = None) -> Found:
        """Rows, their lower limits, the pair of each, and the distance of each pair."""
        self._refresh(rate.delay)
        velocity = np.zeros(len(q)) if before is None else before
        given, told = (np.ascontiguousarray(q), velocity, self._numbers, self._twists), rate.for_others(self._stops())
        of_mesh = self._places if self._solids else None
        shapes = *given, self._pairs
        found = None if core is None else core.clearance(self.robot.screws, *shapes, self._levers, *told, of_mesh)
        return rows_of(self.robot, *shapes, *told, self._solids) if found is None else Found(*found)

    def _places(self, i: int, j: int, one: Array, other: Array) -> Array:
        """(k, 7) distance, normal and point of each place of two shapes, one a mesh, at (4, 4) poses of their cores."""
        shapes = self._parts[i].shape, self._parts[j].shape
        placed = [Placed(s.core, s.radius, s.half, T, s.solid) for s, T in zip(shapes, (one, other), strict=True)]
        return np.array([(place.distance, *place.normal, *place.point) for place in places(*placed)])

    def _stops(self) -> float:
        """After how long the last of the other arms that brake has stopped [s]."""
        return max((arm.stops for arm, _ in self._of_arms if arm.stops < inf), default=0.0)

    def _refresh(self, delay: float) -> None:
        """Where obstacles are, when a command of now acts."""
        for i in self._moving:
            shape = self._parts[i].shape
            if shape.pose is self._seen[i] and not delay:
                continue
            self._seen[i] = shape.pose
            pose = se3.exp(delay * shape.twist, check=False).dot(shape.pose) if delay else shape.pose
            place = pose.dot(shape.place)
            self._numbers[i, 6:15], self._numbers[i, 15:] = place[:3, :3].ravel(), place[:3, 3]
            self._twists[i, :6] = shape.twist
        for arm, pairs in self._of_arms:
            self._pairs[pairs, 2] = HALF if arm.yields else 1.0
            self._twists[[part.owner == id(arm) for part in self._parts], 6] = arm.stops

    def _listed(self) -> list[Part]:
        """All shapes, each with what moves it."""
        parts = []
        for link, shapes in self.bodies.items():
            body, frame = frame_of(self.robot, link)
            parts += [Part(link, shape, body, frame) for shape in shapes]
        names: list[str] = list(self.bodies)
        for obstacle in self.obstacles:
            if isinstance(obstacle, OtherArm):
                for shapes in obstacle.parts.values():
                    parts += [Part(shape.name, shape, 0, None, id(obstacle)) for shape in shapes]
                continue
            if not isinstance(obstacle, Shape):
                raise BadInput("obstacles", excerpt(obstacle), "a Sphere, Capsule, Box, HalfSpace, Mesh or OtherArm")
            name = obstacle.called
            if not obstacle.name:
                name = next(
                    n for i in range(len(names) + 1) if (n := name if i == 0 else f"{name} {i + 1}") not in names
                )
            names.append(name)
            parts.append(Part(name, obstacle, 0, None))
        return parts


class _InLoop(Limit):
    """A clearance at the rate of a loop."""

    name = "clearance"

    def __init__(self, clearance: Clearance, rate: Rate) -> None:
        self._clearance, self._rate = clearance, rate

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        return self._clearance.rows_at(q, self._rate, velocity)

    def blocked(self, q: Array) -> str:
        return self._clearance.blocked(q)


def _depth(depth: float, distance: float) -> float:
    """How far inside a distance bodies are, 1 where all of what leads them out applies."""
    return min(1.0, depth / (DEEP * distance)) if distance > 0.0 else 1.0


def _copied(shape: Shape, name: str) -> Shape:
    """The same shape under another name, to be moved by itself."""
    made = Shape.__new__(Shape)
    Shape.__init__(made, shape.core, shape.radius, shape.half, shape.place, name)
    return made
