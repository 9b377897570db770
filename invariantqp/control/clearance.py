"""Clearance: the links of an arm keep a distance from each other and from what is around them.

    C x >= -alpha (d - d_min) - n'v_obstacle        C = w'J on the joints between two bodies,  w = (p x n; n)

for each place where a pair is near (`geometry/distance.py`): n from one body to the other, p a point of that line. The
approach to d_min is exponential at the rate alpha = min(0.1 / dt, 1 / (e (D + dt/2))): a tick covers at most a tenth of
the room, and what is decided on positions D seconds old does not overshoot.

Joints with acceleration limits a do not stop at once. A velocity is then one that can still be braked from:

    q_n(x) = q + dt (x + (1 - 1/N) x + (1 - 2/N) x + ...)     n ticks of braking x, all joints together in N(x) ticks:
                                                              none harder than 0.7 a, but one whose range ends
    d(q_n(x), n dt) - d_min >= (1 - alpha dt) (d(q_n(y), n dt) - d_min),    y the last velocity braked for a tick

to first order in x - y, N changing with x too, for the ticks n that it takes to stop, 0.7, 0.49, ... of them and 0. In
the next tick braking on goes through the same states: where all of them kept the distance, x = y keeps every row, every
acceleration and every joint limit. So rows contradict nothing, but where a start did or something moves otherwise than
was declared. A way that is braked together stays along an obstacle where it was, however slow it is, so an arm that is
held comes to rest; and no velocity comes nearer now than all of these states leave room for, whatever it would win in
some of them by going on faster. So nothing is gained by swinging to and fro.
What a state ahead lacks of d_min, a corner having been passed between two of them, is led back as far as limits leave.
Two arms that do not know each other's velocity take half of the room each, or what the other one leaves as it goes.
Another arm that brakes is in each of these states where its own joints have braked to.

What comes, by its twist or as its last two poses say, is gone before: where the arm could be as fast, it begins while
there is room for its joints to become so, v being how fast it comes and a what they can along n; and while it moves
away, it is looked at where it is, for it need not brake:

    C x >= v - sqrt(2 a (d - d_min)), nearly (`braking_speed`)        or as much as joints can

Joints that stop at once may be anywhere in a tick, and rows linear about x = 0 do not see how their ways turn: at
3 rad/s and 10 ms, by 3 mm. What that takes of d_min is led back, a tenth in a tick; an answer x that ends nearer than
99.5 % of d_min, and than it began, is made once more, and so is that one, up to four times, beside rows

    d(q + dt x) + dt C (x' - x) >= d_min,    C at q + dt x

A row that no velocity can reach is left out, so there is no distance of influence; of the others the 16 most urgent are
kept, each pair's nearest place before all others. Rows give way where they contradict joint limits, never the other way
round.

A pair that is nearer than d_min in the first tick of a loop keeps the distance that it has, and each larger one that it
comes to have, to 5 % of d_min, until that is d_min: an arm that is told to stay stays, with noise in its positions too.
What gets nearer than that, because an obstacle came, is led out: all places of a pair ask for the way out of the
nearest one, slowly; with brakes, for no more than the last velocity and a tick of 0.3 a are certain to reach.

What it does not do: find a way around. An arm that is led straight into an obstacle stops before it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from math import e, inf
from os import PathLike
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.control.clearance_bodies import Dropped, OtherArm, Pairs, chain_of, parts_of, shapes_of
from invariantqp.control.clearance_rows import CURVED, DEEP, USUAL_SPEED, Found, Rate, moved_by, placed_at, rows_of
from invariantqp.control.limits import Limit, Loop, boxes
from invariantqp.control.tracking import TRACKING_SHARE
from invariantqp.engine import core
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.geometry.distance import Placed, places
from invariantqp.geometry.shapes import Core, Shape
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import MILLIMETRES, Robot, far_away, joint_displacement, middle
from invariantqp.velocity.backends import UNBOUNDED
from invariantqp.velocity.limits import LimitRows
from invariantqp.velocity.solution import ACTIVE_TOLERANCE

# Of the accelerations, rows take this share to brake by; the rest is for how their directions turn within a tick, and
# between the states that are looked at.
BRAKING = 0.7
# What came nearer than the distance is led out at the first share of the joints' velocity limits, and no joint is
# faster than the second: an arm into which an obstacle is put comes out in a second or three, without a kick.
ESCAPE, CALM = 0.06, 0.09
# Where a joint moves nothing in this very state, a state is looked at that is so many seconds at full speed away [s]:
# what is moved there is, by 1e-14 of its size, as far as it is here.
ASIDE = 1e-7


class _Called:
    """What reasons call rows of pairs at some distances, said when it is read."""

    __slots__ = ("bodies", "distances", "pairs")

    def __init__(self, bodies: Sequence[tuple[str, str]], pairs: Sequence[int], distances: Sequence[float]) -> None:
        self.bodies, self.pairs, self.distances = bodies, pairs, distances

    def __iter__(self) -> Iterator[str]:
        return (f"clearance: {Near(*self.bodies[k], d)}" for k, d in zip(self.pairs, self.distances, strict=True))


class _Now:
    """What the last tick found: when it began [s], by the ticks, all distances, and which is the least."""

    __slots__ = ("distances", "nearest", "time")

    def __init__(self) -> None:
        self.time, self.nearest, self.distances = 0.0, (-1, inf), np.zeros(0)


class Near(NamedTuple):
    """Two bodies and how far they are apart."""

    first: str
    second: str
    distance: float  # [length], negative inside; infinite where there is no pair

    def __str__(self) -> str:
        far = f", {1e3 * self.distance:.1f} mm" if self.distance < inf else ""
        return f"{self.first} and {self.second}{far}"


class Moved(NamedTuple):
    """What moves without saying how fast: as its last two places say."""

    place: Array  # the last one: (4, 4) a pose, or (m,) joint positions
    at: float  # when it was told [s], by the ticks
    between: float  # the time between it and the one before [s]
    speed: Array  # (6,) its twist, or (m,) joint velocity
    moves: bool = False  # whether that is not zero

    def now(self, place: Array, way: Callable[[Array, Array], Array], time: float, alpha: float) -> Moved:
        """Known by a place at a time; `way` leads from one place to another.

        Of a new speed it takes what rows at a rate alpha [1/s] take of the room meanwhile, so that noise in places does
        no more by it than by the room; it is held for twice the time between the places.
        """
        between = time - self.at
        if between == 0.0:
            return self._replace(place=place)
        if place is self.place:
            held = between <= (2.0 + NEGLIGIBLE) * self.between
            return self if held else self._replace(speed=np.zeros_like(self.speed), moves=False)
        new = way(self.place, place) / between
        speed = self.speed + min(1.0, alpha * between) * (new - self.speed)
        return Moved(place, time, between, speed, bool(speed.any()))


class Clearance(Limit):
    """A limit: no two of an arm's links, and no link and obstacle, come nearer than a distance.

    Bodies that are nearer when a loop begins come no nearer than they are, and move no arm. The first tick warns, and
    says which pairs to `exclude=` if they may be near each other.

    Attributes:
        robot: the arm.
        bodies: the shapes of its links, by link, each in its link's frame.
        obstacles: what is around it.
        distance: d_min [length].
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
            MissingExtra: meshes that are no binary STL, without coal (extra `pin`).

        Warns:
            UserWarning: an obstacle from which nothing is kept apart, because it is always nearer than the distance, or
                one that is both thirty times as far away and as large as the arm is long, as in millimetres.
        """
        self.robot: Chain = chain_of(robot)
        self.distance: float = arrays.not_negative(distance, "distance", "a distance in lengths")
        self.bodies: Mapping[str, Any] = MappingProxyType(shapes_of(self.robot, bodies))
        if not isinstance(obstacles, (list, tuple)):
            raise BadInput("obstacles", excerpt(obstacles), "a list of shapes and OtherArm")
        self.obstacles: tuple[Shape | OtherArm, ...] = tuple(obstacles)
        self._rate = None if rate is None else arrays.number(rate, "rate", "a rate in 1/s", positive=True)
        self.arms = [arm for arm in self.obstacles if isinstance(arm, OtherArm)]
        parts = parts_of(self.robot, self.bodies, self.obstacles)
        robots = [self.robot, *(arm.robot for arm in self.arms)]
        self._found = Pairs(robots, parts, self.distance, pairs, exclude)
        self._parts, self._numbers, self._of_pair = self._found.parts, self._found.numbers, self._found.of_shapes
        self._bodies = [(self._parts[i].name, self._parts[j].name) for i, j in self._of_pair]
        self._twists = np.zeros((len(self._parts), 6))
        self._pairs = np.array([(i, j, 1.0, self.distance) for i, j in self._of_pair], np.float64).reshape(-1, 4)
        self._begun_near = False  # whether some pair keeps less than the distance: it was nearer in the first tick
        self._began: Array | None = None  # (m,) joint positions, where the last tick was the first of a loop
        self._around = np.array([self._parts[j].around for _, j in self._of_pair], dtype=int)
        self._seen: dict[int, Any] = {}
        self._shapes = [(i, self._parts[i].shape) for i in self._found.moving]
        self._moved = {i: Moved(shape.pose, -inf, 0.0, shape.twist) for i, shape in self._shapes}
        self._moved |= {-1 - a: Moved(arm.q, -inf, 0.0, arm.velocity) for a, arm in enumerate(self.arms)}
        self._reasons: list[str] = [""] * len(self._of_pair)  # why they are not kept apart as obstacles are now
        self._unjudged = self._around != 0
        self._now = _Now()
        self._scene: Any = None  # for the core; made when it is first asked for
        self._levers = self._levers_of_pairs()
        self._enough = self.distance - max(CURVED * self.distance, ACTIVE_TOLERANCE)
        self._still = self._at_rate(0.0, 0.0)  # all distances, and no rows that matter
        self._refresh(0.0)
        self._judge(self._unjudged)
        self._question_the_distance()
        self._question_the_obstacles()

    def _question_the_obstacles(self) -> None:
        """Warn of obstacles that are so far away and so large as in millimetres; what is small is parked there."""
        mid = middle(self.robot)
        far, near = far_away(self.robot, self.robot.jacobian(mid), self.robot.pose(mid)[:3, 3]), dict[str, float]()
        for (_, name), away in self.distances(mid).items():
            near[name] = min(near.get(name, inf), away)
        around = [part for part in self._parts if part.around == 1 and far < near.get(part.name, 0.0) < inf]
        sizes = ((part.name, 2.0 * (se3.norm(part.shape.half) + part.shape.radius), part.shape.core) for part in around)
        if large := [
            f"{name} by {near[name]:.4g}" for name, size, core in sizes if size > far or core is Core.HALF_SPACE
        ]:
            warnings.warn(
                f"clearance: the arm is away from {', '.join(large)} [length]. {MILLIMETRES}", UserWarning, stacklevel=3
            )

    def _question_the_distance(self) -> None:
        """Warn where nothing is kept apart, or not from an obstacle because of a distance perhaps in millimetres."""
        kept = {name for pair in self.pairs for name in pair}
        near = {one.second: one.reason for one in self.dropped if one.reason.startswith("always")}
        around = (part.name for part in self._parts if part.around == 1)
        if lost := [name for name in around if name in near and name not in kept]:
            warnings.warn(
                f"clearance: nothing is kept {self.distance:g} apart from {', '.join(lost)}, being {near[lost[0]]}; "
                "distances are in the length unit of the robot, metres as a rule",
                UserWarning,
                stacklevel=3,
            )
        elif not kept and not any(one.reason == "excluded" for one in self.dropped):
            why = ", ".join(map(str, self.dropped)) or "there are no two bodies"
            warnings.warn(f"clearance: nothing is kept apart ({why}). Give bodies= and obstacles=", stacklevel=3)

    def __setattr__(self, name: str, value: Any) -> None:
        if name in ("robot", "bodies", "obstacles", "distance") and name in vars(self):
            raise AttributeError(
                f"{name} of a clearance does not change: shape.move moves an obstacle, and another Clearance, in "
                "step(limits=[...]), has what comes and goes"
            )
        object.__setattr__(self, name, value)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_scene": None, "bodies": dict(self.bodies)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, bodies=MappingProxyType(state["bodies"]))

    @property
    def nearest(self) -> Near:
        """Which two bodies were the nearest in the last tick that asked for rows, and their `distance`."""
        return self._near(*self._now.nearest)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """The names of the bodies that are kept apart."""
        return tuple({self._bodies[k]: None for k, off in enumerate(self._reasons) if not off})

    @property
    def dropped(self) -> tuple[Dropped, ...]:
        """The pairs of bodies that are not kept apart, each with its reason; of obstacles, where these are now."""
        off = {self._bodies[k]: Dropped(*self._bodies[k], reason) for k, reason in enumerate(self._reasons) if reason}
        return (*self._found.dropped, *off.values())

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

    def for_loop(self, loop: Loop) -> Limit:
        """The clearance at the rate of a loop.

        Raises:
            BadInput: as `require`.
        """
        self.require(loop.robot, "limits")
        return _InLoop(self, self.in_loop(loop))

    def require(self, robot: Robot, argument: str) -> None:
        """Refuse an argument that has to be a clearance of a robot.

        Raises:
            BadInput: this one is of another robot, or of one with another base or tool offset.
        """
        own, q = self.robot, np.zeros(len(self.robot.names))
        if robot.names != own.names or not (
            np.allclose(robot.pose(q), own.home) and np.allclose(robot.jacobian(q), own.screws)
        ):
            raise BadInput(
                argument, f"{self!r} of another robot", "one made with this robot, of the same base= and offset="
            )

    def watch(self, last: float | None, dt: float, alpha: float, q: Array) -> float:
        """A tick of a loop begins at joint positions q (m,) and a rate alpha.

        What does not say how fast it is moves as its last two places say. The `last` tick began at some time, None for
        the first, and took dt; the time of this one is returned, which is that of other loops whose turn it is, too.
        """
        now = self._now.time
        begins = last is None and not self._goes_on(q, dt)
        if begins:
            self._report(q)
        if begins or self._begun_near:
            self._keep(self._distances(q), -inf if begins else self._kept)
        self._began = q.copy() if last is None else None
        if last is not None and last + dt > now:
            now = self._now.time = last + dt
        for i, shape in self._shapes:
            known, pose = self._moved[i], shape.pose
            if shape.declared:
                self._moved[i] = known if known.place is pose else Moved(pose, now, 0.0, shape.twist)
            elif known.moves or known.place is not pose:
                self._moved[i] = known.now(pose, se3.displacement, now, alpha)
        for a, arm in enumerate(self.arms, 1):
            told, known, way = arm.knows_velocity, self._moved[-a], partial(joint_displacement, turns=arm.turns)
            self._moved[-a] = Moved(arm.q, now, 0.0, arm.velocity) if told else known.now(arm.q, way, now, alpha)
        return now

    @property
    def _kept(self) -> Array:
        """(k,) the distance that each pair keeps, where it can be written."""
        return self._pairs[:, 3]

    def _goes_on(self, q: Array, dt: float) -> bool:
        """Whether the arm at q (m,) goes on from a tick whose limit this was alone: each is the first of a loop."""
        fastest = np.where(np.isfinite(self.robot.velocity_limit), self.robot.velocity_limit, USUAL_SPEED)
        return self._began is not None and bool((np.abs(q - self._began) <= 2.0 * dt * fastest).all())

    def _keep(self, distances: Array, least: Array | float) -> None:
        """Pairs (k,) keep the distance, or where they are nearer what they have, less what noise may take of it."""
        own = np.maximum(distances - DEEP * self.distance, least)
        self._kept[:] = np.where(distances < self._enough, own, self.distance)
        self._begun_near = bool((self._kept < self.distance).any())

    def _report(self, q: Array) -> None:
        """Warn of what is too near at joint positions q (m,), where a loop begins."""
        if near := {pair: d for pair, d in self.distances(q).items() if d < self._enough}:
            told = "; ".join(str(Near(*pair, d)) for pair, d in near.items())
            warnings.warn(
                f"clearance: nearer than {1e3 * self.distance:.1f} mm when the loop begins: {told}. They are kept from "
                "coming nearer, and the arm does not move to part them. If they may be near each other, leave them "
                f"out: exclude={list(near)}",
                UserWarning,
                stacklevel=2,
            )

    def in_loop(self, loop: Loop) -> Rate:
        """The rate in a loop, and what its joints brake by."""
        alpha = min(TRACKING_SHARE / loop.dt, 1.0 / (e * (loop.delay + 0.5 * loop.dt)))
        rate = self._at_rate(alpha if self._rate is None else min(alpha, self._rate), loop.delay, loop.dt)
        box = boxes(loop, loop.velocity_limit)[0]
        limits = box.velocity_limit, loop.acceleration, box.position_lower, box.position_upper
        return rate._replace(limits=np.array(limits), settings=np.append(rate.settings[:5], box.rate))

    def rows_at(self, q: Array, rate: Rate, before: Array | None = None) -> LimitRows | None:
        """The rows at joint positions q (m,) after a velocity `before` (m,), None where nothing is near enough."""
        C, lower, of_pair, distances = self._asked(arrays.vector(q, len(self.robot.names), "q"), rate, before)
        self._now.nearest, self._now.distances = self._least(distances), distances
        lacks = float((self._kept - distances).max(initial=0.0))
        inside = lacks > self.distance - self._enough
        if not (len(lower) or inside):
            return None
        upper, pairs = np.full(len(lower), inf), of_pair.astype(int)
        names = [*_Called(self._bodies, pairs.tolist(), distances[pairs].tolist())]
        if inside and not (self._moves(pairs) or (self.arms and self._others(0.0)[1].any())):
            speed = self._calm(rate, before, lacks)
            limited = np.isfinite(speed)
            C = np.vstack((C, np.eye(len(speed))[limited]))
            lower, upper = np.append(lower, -speed[limited]), np.append(upper, speed[limited])
            names += ["clearance: slowly out"] * int(limited.sum())
        return LimitRows.trusted(C, lower, upper, tuple(names)) if len(lower) else None

    def broken(self) -> str:
        """Which bodies were too near in the last tick that asked for rows, "" where none were."""
        return self._too_near(self.nearest) if self._now.nearest[1] < self._enough else ""

    def rows_after(self, q: Array, x: Array, rate: Rate) -> LimitRows | None:
        """Rows about the velocity x (m,) of a tick from q (m,) on that ends too near; None where it does not."""
        dt, d, shares = float(rate.settings[3]), self._now.distances, self._pairs[:, 2]
        kept, others = np.minimum(d, self._kept) - self._kept, np.zeros(len(d))
        if self.arms:  # another one may take its share of the room
            others = (1.0 - shares) * np.where(np.isinf(d), 0.0, np.maximum(d - self.distance, 0.0))
        may = (d - self._levers.dot(dt * np.abs(x)) < self.distance + others) & (shares > 0.0)
        if not may.any():
            return None
        to_its_end = rate._replace(settings=np.array((self.distance, 1.0 / dt, inf, 0.0, BRAKING, inf)))
        C, lower, of_pair, ends = self._asked(q + dt * x, to_its_end, shares=may.astype(np.float64))
        if (ends - others >= np.minimum(d, self._enough))[may].all():
            return None
        kept += others
        of_pair = of_pair.astype(int)
        asked = lower + kept[of_pair] / dt
        lost = asked > 0.0
        if not lost.any():
            return None
        lower = asked[lost] + C[lost].dot(x)
        names = [*_Called(self._bodies, of_pair[lost].tolist(), d[of_pair[lost]].tolist())]
        return LimitRows.trusted(C[lost], lower, np.full(len(lower), inf), names)

    def given(self, rate: Rate, limits: Array) -> tuple[Any, ...] | None:
        """What a tick of the core is given, with limits of all joints; None where Python asks for the rows.

        That is for meshes, and as long as some pair is nearer than the distance since the first tick.
        """
        scene = None if self._found.solids or self._begun_near else self._scene or self.scene()
        if scene is None:
            return None
        self._refresh(rate.delay)
        return scene, limits, rate.settings, self._others(rate.delay) if self.arms else None, self._told

    def _told(self, k: int, distance: float, of_rows: tuple[Any, ...]) -> Iterable[str]:
        """What the core found in a tick: the nearest pair, and the pair and distance of each row; the rows' names."""
        self._now.nearest = (k, distance) if self._of_pair else (-1, inf)
        return _Called(self._bodies, of_rows[::2], of_rows[1::2]) if of_rows else ()

    def _moves(self, pairs: NDArray[np.int_]) -> bool:
        """Whether a shape of some pairs moves by itself."""
        return bool(self._twists[self._pairs[pairs, :2].astype(int)].any())

    def _calm(self, rate: Rate, before: Array | None, lacks: float) -> Array:
        """(m,) how fast joints may be, a pair lacking so much of the distance that it keeps, and no brakes too weak."""
        shallow = DEEP * self.distance
        deep = min(1.0, lacks / shallow) if shallow > 0.0 else 1.0
        speed: Array = max(CALM, 1.0 - deep) * self.robot.velocity_limit
        return speed if before is None else np.maximum(speed, rate.braked(before, deep))

    def at(self, q: ArrayLike) -> Near:
        """The least distance at joint positions q (m,).

        Raises:
            BadInput: NaN or a wrong length.
        """
        return self._near(*self._least(self._distances(q)))

    def blocked(self, q: ArrayLike) -> str:
        """Which bodies are nearer than the distance at joint positions q (m,), "" where none are.

        Obstacles that move do not count: they may be gone by then.

        Raises:
            BadInput: NaN or a wrong length.
        """
        still = [not (self._parts[j].around < 0 or self._parts[j].shape.twist.any()) for _, j in self._of_pair]
        near = self._near(*self._least(np.where(still, self._distances(q), inf)))
        rounding = ACTIVE_TOLERANCE * max(self.distance, 1.0)
        return self._too_near(near) if near.distance < self.distance - rounding else ""

    def distances(self, q: ArrayLike) -> dict[tuple[str, str], float]:
        """The distance of each pair of bodies at joint positions q (m,) [length]; negative inside.

        Parts of a body that no joint moves towards the other do not count: they are infinitely far.

        Raises:
            BadInput: NaN or a wrong length.
        """
        apart = self._distances(q).tolist()  # which judges pairs, too
        found = dict.fromkeys(self.pairs, inf)
        for k, d in enumerate(apart):
            if d < inf:
                found[self._bodies[k]] = min(found[self._bodies[k]], d)
        return found

    def shapes(self, q: ArrayLike) -> list[tuple[str, int | None, Placed]]:
        """All shapes where they are at joint positions q (m,), to draw them.

        Each with the name of its body and how many joints move it, None for an obstacle.

        Raises:
            BadInput: NaN or a wrong length.
        """
        positions = arrays.vector(q, len(self.robot.names), "q")
        self._refresh(0.0)
        motions = moved_by(self._found.robots, np.concatenate((positions, *(arm.q for arm in self.arms))))[1]
        placed = placed_at(self._numbers, motions, (), self._found.solids)
        return [
            (part.name, None if part.frame is None or part.around < 0 else part.body, at)
            for part, at in zip(self._parts, placed, strict=True)
        ]

    def _at_rate(self, alpha: float, delay: float, dt: float = 0.0) -> Rate:
        """A rate for joints that stop at once."""
        robot = self.robot
        free = np.full(len(robot.names), inf)
        limits = np.array((robot.velocity_limit, free, robot.position_lower, robot.position_upper))
        return Rate(limits, np.array((self.distance, alpha, ESCAPE, dt, BRAKING, inf)), delay)

    def _too_near(self, near: Near) -> str:
        return f"{near.first} and {near.second} are nearer than {1e3 * self.distance:.1f} mm"

    def _near(self, k: int, d: float) -> Near:
        return Near(*self._bodies[k], d) if k >= 0 else Near("", "", inf)

    @staticmethod
    def _least(distances: Array) -> tuple[int, float]:
        """Which is the least of distances (k,), and what it is."""
        k = int(distances.argmin()) if len(distances) else -1
        return k, float(distances[k]) if k >= 0 else inf

    def _distances(self, q: ArrayLike) -> Array:
        """(k,) distances of the pairs, of what some joint moves.

        In a singular state a joint may move nothing for an instant: what it does move is told apart a hair beside it.
        """
        positions = arrays.vector(q, len(self.robot.names), "q")
        here = self._asked(positions, self._still).distances
        speed = self.robot.velocity_limit
        step = ASIDE * np.where(np.isfinite(speed), speed, USUAL_SPEED) / np.sqrt(np.arange(1.0, len(speed) + 1.0))
        aside = self._asked(positions + step, self._still).distances
        return np.asarray(np.where(np.isinf(here) | (aside < here - self._levers.dot(step)), aside, here))

    def _levers_of_pairs(self) -> Array:
        """(k, m) how much nearer the shapes of a pair come at most for a radian or length of each own joint."""
        m, two = len(self.robot.names), self._pairs[:, :2].astype(int)
        levers = np.minimum(self._found.levers[two, :m].max(axis=1, initial=0.0), UNBOUNDED)
        inner = np.where(self._around == 0, self._numbers[two, 0].min(axis=1, initial=m), 0.0)
        return np.where(np.arange(m) < inner[:, None], 0.0, levers)

    def _asked(self, q: Array, rate: Rate, before: Array | None = None, shares: Array | None = None) -> Found:
        """Rows, their lower limits, pairs, and the distance of each pair, at shares (k,) or the usual ones."""
        self._refresh(rate.delay)
        velocity, limits = np.zeros(len(q)) if before is None else before, rate.limits
        if self.arms:
            around = self._others(rate.delay)
            q, velocity = np.concatenate((q, around[0])), np.concatenate((velocity, around[1]))
            limits = np.hstack((limits, *(arm.limits for arm in self.arms)))
        pairs, found, at = self._found, None, np.ascontiguousarray(q)
        scene = None if core is None else self.scene()
        if scene is not None and core is not None:
            told = self._places if pairs.solids else None
            found = core.clearance(scene, at, velocity, limits, rate.settings, shares, told)
        if found is None:
            table = self._pairs if shares is None else np.column_stack((self._pairs[:, :2], shares, self._kept))
            given = at, velocity, self._numbers, self._twists, table
            made = rows_of(pairs.robots, *given, limits, rate.settings, pairs.solids)
        else:
            made = Found(*found)
        near = made.distances < self.distance
        own = q[: len(self.robot.names)]
        return self._asked(own, rate, before, shares) if near.any() and self._judge(near) else made

    def _others(self, delay: float) -> Array:
        """(2, M) where the joints of other arms are when a command of now acts, and how fast."""
        speeds = [x.velocity if x.knows_velocity else self._moved[-a].speed for a, x in enumerate(self.arms, 1)]
        return np.hstack([np.array((arm.q + delay * v, v)) for arm, v in zip(self.arms, speeds, strict=True)])

    def scene(self) -> Any:
        """What of it does not change, for the core; None where that does not have it."""
        if self._scene is None and core is not None:
            of = self._found
            tables = self._numbers, self._twists, self._pairs, of.levers, self._unjudged
            self._scene = core.scene(of.screws, of.starts, *tables)
        return self._scene

    def _judge(self, near: NDArray[np.bool_]) -> bool:
        """Whether some obstacles are always near the arm where they are now; they do not count until they move."""
        found, others = False, np.concatenate([np.zeros(0), *(arm.q for arm in self.arms)])
        for k in np.flatnonzero(near & self._unjudged).tolist():
            self._unjudged[k] = False
            if reason := self._found.always_near(*self._of_pair[k], self._numbers, others):
                same = [i for i in range(len(self._of_pair)) if self._bodies[i] == self._bodies[k]]
                for i in same:
                    self._reasons[i], self._unjudged[i] = reason, False
                self._pairs[same, 2], found = 0.0, True
        return found

    def _places(self, i: int, j: int, one: Array, other: Array) -> Array:
        """(k, 7) distance, normal and point of each place of two shapes, one a mesh, at (4, 4) poses of their cores."""
        shapes = self._parts[i].shape, self._parts[j].shape
        placed = [Placed(s.core, s.radius, s.half, T, s.solid) for s, T in zip(shapes, (one, other), strict=True)]
        return np.array([(place.distance, *place.normal, *place.point) for place in places(*placed)])

    def _refresh(self, delay: float) -> None:
        """Where obstacles are, when a command of now acts; what has moved is judged anew."""
        for i, shape in self._shapes:
            seen = self._seen.get(i)
            twist = shape.twist if shape.declared else self._moved[i].speed
            if seen and seen[0] is shape.pose and seen[1] is twist and seen[2] == delay:
                continue
            self._seen[i] = shape.pose, twist, delay
            pose = se3.exp(delay * twist, check=False).dot(shape.pose) if delay and twist.any() else shape.pose
            place, self._twists[i] = pose.dot(shape.place), twist
            self._numbers[i, 6:15], self._numbers[i, 15:] = place[:3, :3].ravel(), place[:3, 3]
            self._renewed(self._pairs[:, 1] == i, 1.0)
        for a, arm in enumerate(self.arms):
            if self._seen.get(-1 - a) is not arm.q:
                self._seen[-1 - a] = arm.q
                self._renewed(self._around == -1 - a, 0.5 if arm.yields else 1.0)  # half of the room each

    def _renewed(self, pairs: Array, share: float) -> None:
        """Those pairs count again, with that share of the room, until they are judged."""
        self._pairs[pairs, 2], self._unjudged[pairs] = share, True
        if any(self._reasons):
            self._reasons = ["" if new else old for new, old in zip(pairs.tolist(), self._reasons, strict=True)]


class _InLoop(Limit):
    """A clearance at the rate of a loop."""

    name = "clearance"

    def __init__(self, clearance: Clearance, rate: Rate) -> None:
        self._clearance, self._rate = clearance, rate
        self._dt, self._alpha = float(rate.settings[3]), float(rate.settings[1])
        self._last: float | None = None  # when its last tick began [s]
        self._stops_at_once = bool(np.isinf(rate.limits[1]).all())
        self._limits = np.hstack((rate.limits, *(arm.limits for arm in clearance.arms)))

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        return self._clearance.rows_at(q, self._rate, velocity)

    def after(self, q: Array, velocity: Array) -> LimitRows | None:
        # Velocities of joints with brakes are so near the last one that rows about that one will do.
        return self._clearance.rows_after(q, velocity, self._rate) if self._stops_at_once else None

    def broken(self) -> str:
        return self._clearance.broken()

    def blocked(self, q: Array) -> str:
        return self._clearance.blocked(q)

    def begin(self, q: Array) -> None:
        self._last = self._clearance.watch(self._last, self._dt, self._alpha, q)

    def for_core(self) -> tuple[Any, ...] | None:
        """What a tick of the core is given of it; None where the core has it row by row alone."""
        return self._clearance.given(self._rate, self._limits)
