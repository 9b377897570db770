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
from itertools import combinations
from math import e, floor, inf
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.limits import Limit, Loop, boxes
from invariantqp.engine import core
from invariantqp.errors import BadInput, UnknownName, excerpt
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import Place, Placed, places
from invariantqp.geometry.shapes import Core, Shape
from invariantqp.robots.bodies import bodies_of
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.srdf import Exclusions, excluded
from invariantqp.velocity.limits import LimitRows, braking_speed
from invariantqp.velocity.qp import ACTIVE_TOLERANCE

# Rows of a tick, at most: more than an arm has joints several times over.
MOST_ROWS = 16
# Rows that differ by less than this share of their length are one row.
EQUAL = 1e-9
# A joint whose axis moves a place along its normal by less than this share of what it could does not move it.
UNMOVED = 1e-12
# A tick covers this share of the room that is left.
SHARE_OF_ROOM = 0.1
# Of the accelerations, rows take this share to brake by; the rest is for how their directions turn within a tick, and
# between the states that are looked at.
BRAKING = 0.7
# Of the ticks until one state those until the next nearer one: with a half, an arm that passes a corner at full speed
# sees it late in one of 2000 ticks.
NEARER = 0.7
# States that are ticks away keep this times the distance: what is linear in x - y is off by less.
AHEAD = 1.01
# Inside the distance, bodies are led apart at the first share of the joints' velocity limits, and no joint is faster
# than the second: an arm that begins inside comes out in a second or three, without a kick. That holds from a depth on
# of the third, of the distance; less is what curvature takes of it in a tick.
ESCAPE, CALM, DEEP = 0.06, 0.09, 0.05
# Joints without a velocity limit count as this fast where pairs are ranked and led apart [rad/s, length/s].
USUAL_SPEED = 1.0
# Whether a pair is always near is looked at in so many states, at most; one that is not shown to be is kept.
STATES = 400
# Two arms that do not know each other's velocity may each take half of the room between them.
HALF = 0.5
# Numbers of a shape for the compiled core: body, core, radius, half sizes, rotation, place.
OF_SHAPE = 18


class Near(NamedTuple):
    """Two bodies and how far they are apart."""

    first: str
    second: str
    distance: float  # [length], negative inside; infinite where there is no pair

    def __str__(self) -> str:
        return f"{self.first} and {self.second}, {1e3 * self.distance:.1f} mm"


class Dropped(NamedTuple):
    """A pair that is not kept apart, and why."""

    first: str
    second: str
    reason: str


class Rate(NamedTuple):
    """What decides how fast bodies may come nearer."""

    limits: Array  # (4, m) of speed, acceleration (inf where joints stop at once) and position, the lower and the upper
    settings: Array  # d_min [length], alpha [1/s], ESCAPE, a tick [s], BRAKING
    delay: float  # of the robot [s]

    def braked(self, before: Array, share: float) -> Array:
        """(m,) how fast joints still are after a tick of braking a velocity (m,), at a share of what rows brake by."""
        b = self.settings[4] * self.limits[1]
        slower = np.abs(before) - self.settings[3] * np.where(np.isfinite(b), share * b, b)
        return np.asarray(np.maximum(slower, 0.0))


class States(NamedTuple):
    """The states in which distances are looked at: the arm's own first, and those that it passes as it brakes."""

    positions: Array  # (s, m) of the joints
    weights: Array  # (s, m) how they change with the velocity, in ticks
    times: Array  # (s,) from now [s]
    y: Array  # (m,) the velocity braked for a tick
    reach: Array  # (m,) how far another one can be from it
    sure: Array  # (m,) and certainly

    @classmethod
    def ahead(cls, q: Array, before: Array, limits: Array, settings: Array) -> States:
        """From joint positions q (m,), after a velocity `before` (m,); limits and settings are as in `Rate`."""
        m = len(q)
        speed, a, low, high = limits
        if np.isinf(a).all():
            return cls(q[None], np.ones((1, m)), np.zeros(1), np.zeros(m), speed, np.full(m, inf))
        dt, share = settings[3:].tolist()
        b = share * a
        y = np.sign(before) * np.maximum(np.abs(before) - b * dt, 0.0)
        y = np.clip(y, -braking_speed(q - low, a, dt), braking_speed(high - q, a, dt))
        ticks = np.floor(np.abs(y) / (b * dt))  # that y takes to stop, but for a rest
        n = [0.0, *moments(float(ticks.max()))]
        own = np.minimum(np.array(n)[:, None], ticks)
        with np.errstate(invalid="ignore"):  # infinitely strong brakes stop in no tick
            lost = np.where(own > 0.0, 0.5 * b * dt * own * (own + 1.0), 0.0)
        free = q + dt * ((own + 1.0) * y - np.sign(y) * lost)
        states = np.clip(free, np.minimum(low, q), np.maximum(high, q))
        weights = np.where(states == free, own + 1.0, 1.0)
        reach, sure = np.minimum(2.0 * a * dt, speed + np.abs(y)), (1.0 - share) * a * dt
        times = dt * np.array([0.0, *n])
        return cls(np.vstack((q, states)), np.vstack((np.ones(m), weights)), times, y, reach, sure)


def moments(ticks: float) -> list[float]:
    """A number of ticks, NEARER of it, of that, ... down to one, whole ones."""
    found = []
    while ticks > 0.0:
        found.append(ticks)
        ticks = floor(NEARER * ticks) if ticks > 1.0 else 0.0
    return found


class _Part(NamedTuple):
    """A shape as one of the bodies."""

    name: str
    shape: Shape
    body: int  # moved by the first so many joints
    frame: Array | None  # (4, 4) of its link at q = 0; None for an obstacle, which is where it was moved to
    owner: int = 0  # the arm that it is a link of, where that is another one


class OtherArm:
    """Another arm as an obstacle: its links move when they are told to. Each of two arms has the other as one.

    Attributes:
        robot: that arm; both have the same base frame: put it where it stands with `load_robot(base=)`.
        bodies: the shapes of its links.
        name: what its links' names begin with.
    """

    def __init__(
        self, robot: Robot, bodies: Mapping[str, Sequence[Shape]] | None = None, *, name: str = "other"
    ) -> None:
        """Another arm.

        Args:
            robot: that arm, its base frame the same as this one's.
            bodies: as in `Clearance`.
            name: what its links' names begin with.

        Raises:
            BadInput: as `Clearance`.
        """
        self.robot: Chain = _chain(robot)
        self.bodies = _bodies(self.robot, bodies)
        self.name = name if isinstance(name, str) else arrays.strings([name], "name")[0]
        self._at = {link: frame_of(self.robot, link) for link in self.bodies}
        self.parts: dict[str, list[Shape]] = {
            link: [_copied(shape, f"{self.name}/{link}") for shape in shapes] for link, shapes in self.bodies.items()
        }
        self.knows_velocity = False

    def move(self, q: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Say where its joints are from now on, between ticks.

        Args:
            q: (m,) its joint positions.
            velocity: (m,) its joint velocity; None is not known: each arm may then take half of the room between them.

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


class Clearance(Limit):
    """A limit: no two of an arm's links, and no link and obstacle, come nearer than a distance.

    Attributes:
        robot: the arm.
        bodies: the shapes of its links, by link, each in its link's frame.
        obstacles: what is around it.
        distance: d_min [length].
        pairs: the names of the bodies that are kept apart.
        dropped: the pairs that are not, each with its reason.
        nearest: the least distance in the last tick that asked for rows.
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
            MissingExtra: meshes without coal (extra `pin`).
        """
        self.robot: Chain = _chain(robot)
        self.distance: float = arrays.not_negative(distance, "distance", "a distance in lengths")
        self.bodies = _bodies(self.robot, bodies)
        if not isinstance(obstacles, (list, tuple)):
            raise BadInput("obstacles", excerpt(obstacles), "a list of shapes and OtherArm")
        self.obstacles: tuple[Shape | OtherArm, ...] = tuple(obstacles)
        self._rate = None if rate is None else arrays.number(rate, "rate", "a rate in 1/s", positive=True)
        self._parts = self._listed()
        self._numbers = np.array([_numbers(part) for part in self._parts]).reshape(-1, OF_SHAPE)
        self._levers = _levers(self.robot, self._numbers)
        self._twists = np.zeros((len(self._parts), 6))
        self._moving = [i for i, part in enumerate(self._parts) if part.frame is None]
        self._seen: list[Array] = [part.shape.pose for part in self._parts]
        self._of_pair, self.dropped = self._chosen(pairs, exclude)
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
        if inside and not self._twists.any():
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
        placed = _placed(self._numbers, self.robot.motions(positions))
        moved = [None if part.frame is None else part.body for part in self._parts]
        return [(part.name, body, at) for part, body, at in zip(self._parts, moved, placed, strict=True)]

    def _at_rate(self, alpha: float, delay: float, dt: float = 0.0) -> Rate:
        """A rate for joints that stop at once."""
        robot = self.robot
        free = np.full(len(robot.names), inf)
        limits = np.array((robot.velocity_limit, free, robot.position_lower, robot.position_upper))
        return Rate(limits, np.array((self.distance, alpha, ESCAPE, dt, BRAKING)), delay)

    def _nearest(self, distances: Array) -> Near:
        if not len(distances):
            return Near("", "", inf)
        i = int(distances.argmin())
        one, other = self._of_pair[i]
        return Near(self._parts[one].name, self._parts[other].name, float(distances[i]))

    def _distances(self, q: ArrayLike) -> Array:
        return self._asked(arrays.vector(q, len(self.robot.names), "q"), self._still)[3]

    def _asked(self, q: Array, rate: Rate, before: Array | None = None) -> tuple[Array, Array, Array, Array]:
        """Rows, their lower limits, the pair of each, and the distance of each pair."""
        self._refresh(rate.delay)
        velocity = np.zeros(len(q)) if before is None else before
        given = np.ascontiguousarray(q), velocity, self._numbers, self._twists, self._pairs
        told = rate.limits, rate.settings
        found: tuple[Array, Array, Array, Array] | None
        found = None if core is None else core.clearance(self.robot.screws, *given, self._levers, *told)
        return rows_of(self.robot, *given, *told) if found is None else found

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
            self._twists[i] = shape.twist
        for arm, pairs in self._of_arms:
            self._pairs[pairs, 2] = 1.0 if arm.knows_velocity else HALF

    def _listed(self) -> list[_Part]:
        """All shapes, each with what moves it."""
        parts = []
        for link, shapes in self.bodies.items():
            body, frame = frame_of(self.robot, link)
            parts += [_Part(link, shape, body, frame) for shape in shapes]
        names: list[str] = list(self.bodies)
        for obstacle in self.obstacles:
            if isinstance(obstacle, OtherArm):
                for shapes in obstacle.parts.values():
                    parts += [_Part(shape.name, shape, 0, None, id(obstacle)) for shape in shapes]
                continue
            if not isinstance(obstacle, Shape):
                raise BadInput("obstacles", excerpt(obstacle), "a Sphere, Capsule, Box, HalfSpace or OtherArm")
            name = obstacle.called
            if not obstacle.name:
                name = next(
                    n for i in range(len(names) + 1) if (n := name if i == 0 else f"{name} {i + 1}") not in names
                )
            names.append(name)
            parts.append(_Part(name, obstacle, 0, None))
        return parts

    def _chosen(
        self, pairs: Iterable[tuple[str, str]] | None, exclude: Iterable[tuple[str, str]] | str | PathLike[str]
    ) -> tuple[list[tuple[int, int]], tuple[Dropped, ...]]:
        """The pairs of shapes that are kept apart, and those of bodies that are not."""
        wanted = None if pairs is None else {frozenset(pair) for pair in self._named(pairs, "pairs")}
        apart: Exclusions = excluded(self.robot, exclude if isinstance(exclude, (str, PathLike)) else None)
        if not isinstance(exclude, (str, PathLike)):
            apart = {**apart, **{frozenset(pair): "excluded" for pair in self._named(exclude, "exclude")}}
        dropped: dict[tuple[str, str], str] = {}
        kept = []
        for i, j in combinations(range(len(self._parts)), 2):
            a, b = self._parts[i], self._parts[j]
            if a.frame is None and b.frame is None:
                continue
            names = frozenset((a.name, b.name))
            if len(names) == 1:
                continue
            reason = "not among the pairs given" if wanted is not None and names not in wanted else apart.get(names, "")
            if not reason and not (wanted is not None and names in wanted):
                reason = self._needless(a, b)
            if reason:
                dropped[a.name, b.name] = reason
            else:
                kept.append((i, j))
        if wanted is None:
            kept, always = self._without_always_near(kept)
            dropped.update(always)
        return kept, tuple(Dropped(*names, reason) for names, reason in dropped.items())

    def _needless(self, a: _Part, b: _Part) -> str:
        """Why two bodies need not be kept apart, "" where they must be."""
        if a.body == b.body:
            return "no joint moves it" if b.frame is None else "fixed to one another"
        floor = Core.HALF_SPACE in (a.shape.core, b.shape.core)  # nobody's neighbour
        if b.frame is None or floor or abs(a.body - b.body) > 1:
            return ""
        return f"neighbours at {self.robot.names[max(a.body, b.body) - 1]}"

    def _without_always_near(
        self, kept: list[tuple[int, int]]
    ) -> tuple[list[tuple[int, int]], dict[tuple[str, str], str]]:
        """Pairs of shapes less those of links that are nearer than the distance wherever the joints are.

        Two links with one or two joints between them: their distance d(q) changes by at most |d q_i| times how far the
        farther one reaches from axis i, so that a few states show that it is nowhere larger.
        """
        always: dict[tuple[str, str], str] = {}
        by_name: dict[tuple[str, str], list[tuple[int, int]]] = {}
        for i, j in kept:
            by_name.setdefault((self._parts[i].name, self._parts[j].name), []).append((i, j))
        for names, shapes in by_name.items():
            if any(self._is_always_near(i, j) for i, j in shapes):
                always[names] = f"always nearer than {1e3 * self.distance:.1f} mm"
        return [(i, j) for i, j in kept if (self._parts[i].name, self._parts[j].name) not in always], always

    def _is_always_near(self, i: int, j: int) -> bool:
        a, b = sorted((self._parts[i], self._parts[j]), key=lambda part: part.body)
        if a.frame is None or b.frame is None or b.body - a.body > 2:
            return False
        between = np.arange(a.body, b.body)
        if not self.robot.screws[:3, between].any(axis=0).all():
            return False  # a slide goes as far as it goes
        lever = self._levers[i if self._parts[i] is b else j][between]
        limits = np.maximum(self.robot.position_lower, -np.pi), np.minimum(self.robot.position_upper, np.pi)
        cells = [(limits[0][between], limits[1][between])]
        q = np.zeros(len(self.robot.names))
        for _ in range(STATES):
            if not cells:
                return True
            low, high = cells.pop()
            q[between] = 0.5 * (low + high)
            motions = self.robot.motions(q)
            one, other = _placed(self._numbers[[i, j]], motions)
            d = places(one, other)[0].distance
            if d > self.distance:
                return False
            if d + float(np.dot(lever, 0.5 * (high - low))) > self.distance:
                axis = int(np.argmax(lever * (high - low)))
                middle = 0.5 * (low + high)
                upper, lower = high.copy(), low.copy()
                upper[axis] = lower[axis] = middle[axis]
                cells += [(low, upper), (lower, high)]
        return False

    def _named(self, pairs: Iterable[tuple[str, str]], argument: str) -> list[tuple[str, str]]:
        """Pairs of names, each of a body that is there.

        Raises:
            BadInput: no pairs of names.
            UnknownName: no such body.
        """
        known = list(dict.fromkeys(part.name for part in self._parts))
        found = []
        for pair in arrays.listed(pairs, argument, "pairs of names, [(link, link), (link, obstacle), ...]"):
            if isinstance(pair, str) or not isinstance(pair, (list, tuple)) or len(pair) != 2:
                raise BadInput(argument, excerpt(pair), "the names of two bodies")
            for name in pair:
                if name not in known:
                    raise UnknownName("body", str(name), [], known)
            found.append((pair[0], pair[1]))
        return found


class _InLoop(Limit):
    """A clearance at the rate of a loop."""

    name = "clearance"

    def __init__(self, clearance: Clearance, rate: Rate) -> None:
        self._clearance, self._rate = clearance, rate

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        return self._clearance.rows_at(q, self._rate, velocity)

    def blocked(self, q: Array) -> str:
        return self._clearance.blocked(q)


def frame_of(robot: Chain, name: str) -> tuple[int, Array]:
    """How many joints move a link, and its (4, 4) frame at q = 0; as `Clearance` takes the names of bodies.

    Raises:
        UnknownName: no such link or joint.
    """
    for link in robot.links:
        if link.name == name:
            return link.body, link.frame
    if name in (robot.tool, "tool"):
        return len(robot.names), np.asarray(robot.home)
    if name in robot.names:
        return robot.names.index(name) + 1, np.eye(4)
    if name == "base":
        return 0, np.eye(4)
    raise UnknownName("link", str(name), [], [*(link.name for link in robot.links), "tool", "base", *robot.names])


def rows_of(
    robot: Chain, q: Array, before: Array, shapes: Array, twists: Array, pairs: Array, limits: Array, settings: Array
) -> tuple[Array, Array, Array, Array]:
    """The rows of a tick: what `core.clearance` computes, in NumPy.

    Args:
        robot: whose joints move the bodies.
        q: (m,) joint positions.
        before: (m,) joint velocity.
        shapes: (n, 18) body, core, radius, half sizes (3), rotation (9) and place (3) at q = 0, in the base frame.
        twists: (n, 6) of shapes by themselves.
        pairs: (k, 3) two shapes, and the share of the room that this arm may take.
        limits: as in `Rate`.
        settings: as in `Rate`.

    Returns:
        (r, m) C, (r,) lower limits, (r,) the pair of each row, (k,) distances of the pairs at q. The core leaves those
        infinite that are neither the least nor near enough for a row, unless alpha is 0.
    """
    states = States.ahead(q, before, limits, settings)
    kept: list[tuple[float, float, int, Array]] = []  # urgency, lower limit, pair, row
    distances = np.full(len(pairs), inf)
    for s, (at, weight, time) in enumerate(zip(*states[:2], states.times.tolist(), strict=True)):
        J, motions, leaving = robot.jacobian(at), robot.motions(at), s == 0 and len(states.times) > 1
        placed = _placed(shapes, motions, [se3.exp(time * twist, check=False) for twist in twists])
        for k, (i, j, share) in enumerate(pairs.tolist()):
            one, other = int(i), int(j)
            bodies = int(shapes[one, 0]), int(shapes[other, 0])
            between = slice(min(bodies), max(bodies))
            sides = twists[other] - twists[one], weight[between] * (1.0 if bodies[0] < bodies[1] else -1.0)
            wanted = min(settings[0] * (AHEAD if s > 1 else 1.0), distances[k] if s > 0 else inf)
            found = places(placed[one], placed[other])
            moved = [(place, C) for place in found if (C := _row(place, J, between, sides[1])).any()]
            if s == 0:
                distances[k] = min((place.distance for place, _ in moved), default=inf)
            for place, C in moved:
                drift = float(_wrench(place).dot(sides[0]))
                out = float(place.normal.dot(moved[0][0].normal))
                room = place.distance - wanted
                approach = min(room, share * room), out, drift
                lower, urgency = _asked_of(C, approach, states, limits[0], settings, leaving=leaving)
                if lower > -inf:
                    _keep(kept, (urgency - (place is not found[0]), lower, k, C))
    C_kept = np.array([row[3] for row in kept]).reshape(-1, len(q))
    return C_kept, np.array([row[1] for row in kept]), np.array([float(row[2]) for row in kept]), distances


def _wrench(place: Place) -> Array:
    return np.concatenate((se3.cross(place.point, place.normal), place.normal))


def _row(place: Place, J: Array, between: slice, weights: Array) -> Array:
    """(m,) how fast a distance grows with joint velocities, weighed; zero where it is rounding."""
    parts = _wrench(place)[:, None] * J[:, between]
    total, C = parts.sum(axis=0), np.zeros(J.shape[1])
    C[between] = weights * np.where(np.abs(total) > UNMOVED * np.abs(parts).sum(axis=0), total, 0.0)
    return C


def _asked_of(
    C: Array, approach: tuple[float, float, float], states: States, speed: Array, settings: Array, *, leaving: bool
) -> tuple[float, float]:
    """The lower limit of a row, -inf where every velocity keeps it, and how urgent it is.

    `approach` has the room that the arm may take, the part of the way out that the row's direction is, and how fast
    the distance grows by itself. In the state that an arm with brakes is `leaving`, rows lead out of what is too near.
    """
    (room, out, drift), (_, alpha, escape, _, _) = approach, settings.tolist()
    scaled = np.abs(C) * np.where(np.isfinite(speed), speed, USUAL_SPEED)
    moved = C != 0.0
    braked = float(C[moved].dot(states.y[moved]))
    if leaving and room >= 0.0:
        return -inf, 0.0
    if room >= 0.0:
        wish = -alpha * room
    else:
        wish = max(0.0, out) * min(-alpha * room, escape * float(scaled.dot(scaled)) / float(scaled.max()))
    lower = braked + wish - drift
    if leaving:
        sure = float(np.abs(C[moved]).dot(states.sure[moved]))
        lower = min(wish - drift, braked + sure)
    if not lower > braked - float(np.abs(C[moved]).dot(states.reach[moved])):
        return -inf, 0.0
    return lower, (lower - braked) / float(scaled.sum())


def _depth(depth: float, distance: float) -> float:
    """How far inside a distance bodies are, 1 where all of what leads them out applies."""
    return min(1.0, depth / (DEEP * distance)) if distance > 0.0 else 1.0


def _keep(kept: list[tuple[float, float, int, Array]], row: tuple[float, float, int, Array]) -> None:
    """Keep a row among the most urgent; of equal ones the one that asks for more."""
    size = se3.norm(row[3])
    same = next((i for i, old in enumerate(kept) if np.abs(old[3] - row[3]).max() <= EQUAL * size), None)
    if same is not None:
        if kept[same][1] < row[1]:
            kept[same] = row
    elif len(kept) < MOST_ROWS:
        kept.append(row)
    else:
        last = min(range(len(kept)), key=lambda i: kept[i][0])
        if kept[last][0] < row[0]:
            kept[last] = row


def _placed(shapes: Array, motions: Sequence[Array], own: Sequence[Array] = ()) -> list[Placed]:
    """Shapes (n, 18) in the base frame, by the motions of the bodies and those of their own."""
    made = []
    for i, numbers in enumerate(shapes):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = numbers[6:15].reshape(3, 3), numbers[15:]
        T = motions[int(numbers[0])].dot(T)
        core, half = Core(int(numbers[1])), numbers[3:6]
        made.append(Placed(core, float(numbers[2]), half, own[i].dot(T) if own else T))
    return made


def _numbers(part: _Part) -> Array:
    shape = part.shape
    T = (shape.pose if part.frame is None else part.frame).dot(shape.place)
    return np.concatenate(((part.body, shape.core, shape.radius), shape.half, T[:3, :3].ravel(), T[:3, 3]))


def _copied(shape: Shape, name: str) -> Shape:
    """The same shape under another name, to be moved by itself."""
    made = Shape.__new__(Shape)
    Shape.__init__(made, shape.core, shape.radius, shape.half, shape.place, name)
    return made


def _levers(robot: Chain, shapes: Array) -> Array:
    """(n, m) how far any point of a shape (n, 18) ever moves, at most, for a radian or length of each joint before it.

    From the middle of a shape to a point of the axis before it, from there to one of the next, and so on: turning about
    these axes changes none of these distances, and sliding changes them by how far a joint slides.
    """
    levers = np.full((len(shapes), len(robot.names)), inf)
    for lever, numbers in zip(levers, shapes, strict=True):
        if int(numbers[1]) == Core.HALF_SPACE:
            continue
        x, reach = numbers[15:], se3.norm(numbers[3:6]) + float(numbers[2])
        for k in reversed(range(int(numbers[0]))):
            turn, slide = robot.screws[:3, k], robot.screws[3:, k]
            rate = se3.norm(turn)
            if rate > 0.0:
                axis, on_axis = turn / rate, se3.cross(turn, slide) / rate**2
                foot = on_axis + axis * float(axis.dot(x - on_axis))
                reach += se3.norm(x - foot)
                x, slide = foot, axis * float(axis.dot(slide))
            along = se3.norm(slide)
            lever[k] = rate * reach + along
            if along > UNMOVED * lever[k]:
                low, high = float(robot.position_lower[k]), float(robot.position_upper[k])
                reach += along * (high - low + max(abs(low), abs(high)))
    return levers


def _chain(robot: Any) -> Chain:
    if not isinstance(robot, Chain):
        raise BadInput("robot", excerpt(robot), "a robot that load_robot returned")
    return robot


def _bodies(robot: Chain, bodies: Mapping[str, Sequence[Shape]] | None) -> dict[str, list[Shape]]:
    """The shapes of each link; those behind joints that this arm does not have are left out."""
    if bodies is None:
        unknown = {link.name for link in robot.links if link.unknown}
        return {name: shapes for name, shapes in bodies_of(robot).items() if name not in unknown}
    expected = "{link: [shapes in its frame]}"
    if not isinstance(bodies, Mapping):
        raise BadInput("bodies", excerpt(bodies), expected)
    made: dict[str, list[Shape]] = {}
    for link, shapes in bodies.items():
        if not isinstance(link, str):
            raise BadInput("bodies", excerpt(link), f"{expected}, links by name")
        given: list[Shape] = [shapes] if isinstance(shapes, Shape) else list(arrays.listed(shapes, "bodies", expected))
        wrong = next((shape for shape in given if not isinstance(shape, Shape)), None)
        if wrong is not None:
            raise BadInput("bodies", f"{excerpt(wrong)} of {link!r}", "shapes: Sphere, Capsule, Box, HalfSpace")
        frame_of(robot, link)
        made[link] = given
    return made
