"""Clearance: the links of an arm keep a distance from each other and from obstacles.

    C x >= -alpha (d - d_min) - n'v_obstacle        C = w'J on the joints between two bodies,  w = (p x n; n)

for each place where two bodies are near (`core/distance.hpp`): n is the direction from one body to the other, p a
point of that line. Bodies approach d_min exponentially, at the rate alpha = min(0.1 / dt, 1 / (e (D + dt/2))): a tick
covers at most a tenth of the room, and a command based on positions D seconds old does not overshoot.

**Joints with acceleration limits** a do not stop at once, so a velocity is allowed only if the arm can brake from it:

    q_n(x) = q + dt (x + (1 - 1/N) x + (1 - 2/N) x + ...)     n ticks of braking from x; all joints stop in N(x) ticks,
                                                              at most at 0.7 a, except at the end of a joint's range
    d(q_n(x), n dt) - d_min >= (1 - alpha dt) (d(q_n(y), n dt) - d_min),    y the last velocity braked for one tick

to first order in x - y, N changing with x too, for n = N, 0.7 N, 0.49 N, ... and 0. If the arm keeps braking, the next
tick passes through the same states. Where all of them keep the distance, x = y satisfies every row, every acceleration
limit and every joint limit, so the rows contradict nothing unless a start did, or something moves otherwise than was
declared. Joints that brake together stay on their path, so an arm that is held against an obstacle comes to rest; and
the approach in the present state is limited by what all braking states allow, so swinging gains nothing. If a state
ahead is nearer than d_min, because a corner lies between two states, it is led back as far as the limits allow. Two
arms that do not know each other's velocity take half of the room each, or what the other one leaves. Another arm that
brakes is looked at where its own joints have braked to.

**Obstacles that move** do so by their twist, or as their last two poses say. The arm makes way: if it can be as fast
as the obstacle, it starts while its joints still have room to reach that speed. With v the speed at which the obstacle
comes and a the acceleration of the joints along n,

    C x >= v - sqrt(2 a (d - d_min)), approximately (`braking_speed`)        or as much as the joints can

While the arm moves away it need not brake, and only the present state is looked at.

**Joints that stop at once** may go anywhere in a tick, and rows that are linear about x = 0 miss how their paths
curve: by 3 mm at 3 rad/s and 10 ms. What curvature takes of d_min is led back, a tenth in a tick. A velocity x that
ends nearer than 99.5 % of d_min, and nearer than it began, is computed again, up to four times, with the additional
rows

    d(q + dt x) + dt C (x' - x) >= d_min,    C at q + dt x

A row that every velocity inside the joint limits satisfies is left out, so there is no influence distance. Of the
others the 16 most urgent are kept, the nearest place of each pair first. Rows give way where they contradict joint
limits, never the other way round.

**A pair that is nearer than d_min in the first tick of a loop** keeps the distance that it has, and each larger one
that it reaches, to 5 % of d_min, until that is d_min: an arm with a still target stays still, with noise in its
positions too. A pair that gets nearer later, because an obstacle came, is led apart slowly: all its places ask for the
way out of the nearest one; with acceleration limits, for no more than the last velocity and a tick of 0.3 a reach for
certain.

The engine computes all of this (`core/clearance.hpp`); this file has its arguments and the names of what it finds.
Clearance does not find a way around: an arm that is led straight at an obstacle stops before it.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from math import e, inf
from os import PathLike
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.clearance_bodies import Dropped, OtherArm, chain_of, engine_of, pairs_of, parts_of, shapes_of
from invariantqp.control.limits import Limit, LimitInEngine, Loop, box_of
from invariantqp.control.tracking import TRACKING_SHARE
from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import Placed
from invariantqp.geometry.shapes import Core, Shape
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import MILLIMETRES_HINT, Robot, middle, plausible_distance
from invariantqp.velocity.limits import LimitRows
from invariantqp.velocity.solution import ACTIVE_TOLERANCE


class Near(NamedTuple):
    """Two bodies and how far they are apart."""

    first: str
    second: str
    distance: float  # [length], negative inside; infinite where there is no pair

    def __str__(self) -> str:
        far = f", {1e3 * self.distance:.1f} mm" if self.distance < inf else ""
        return f"{self.first} and {self.second}{far}"


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
        self._parts = parts_of(self.robot, self.bodies, self.obstacles)
        self._of_pair, self._dropped = pairs_of(self.robot, self._parts, pairs, exclude)
        self._bodies = [(self._parts[i].name, self._parts[j].name) for i, j in self._of_pair]
        self._chosen = pairs is not None
        self._told: dict[Any, Array] = {}  # where the engine knows each shape and arm to be that `move` moves
        self._shapes = [part.shape for part in self._parts if part.around == 1]
        self._engine = self._made()
        self._engine.start()
        self._question_the_distance()
        self._question_the_obstacles()

    def _made(self) -> Any:
        """The engine's clearance, obstacles and arms where they are."""
        made = engine_of(self.robot, self.arms, self._parts, self._of_pair, self.distance, chosen=self._chosen)
        self._told.clear()
        self._tell(made)
        return made

    def _tell(self, engine: Any) -> Any:
        """The engine, which is told where obstacles and arms are that have moved."""
        told = self._told
        for k, shape in enumerate(self._shapes):
            if told.get(k) is not shape.pose:
                told[k] = shape.pose
                engine.move(k, shape.pose, shape.twist if shape.declared else None)
        for k, arm in enumerate(self.arms):
            if told.get(-1 - k) is not arm.q:
                told[-1 - k] = arm.q
                engine.move_arm(k, arm.q, arm.velocity if arm.knows_velocity else None)
        return engine

    def _question_the_obstacles(self) -> None:
        """Warn of obstacles that are so far away and so large as in millimetres; what is small is parked there."""
        mid = middle(self.robot)
        far = plausible_distance(self.robot, self.robot.jacobian(mid), self.robot.pose(mid)[:3, 3])
        near = dict[str, float]()
        for (_, name), away in self.distances(mid).items():
            near[name] = min(near.get(name, inf), away)
        around = [part for part in self._parts if part.around == 1 and far < near.get(part.name, 0.0) < inf]
        sizes = ((part.name, 2.0 * (se3.norm(part.shape.half) + part.shape.radius), part.shape.core) for part in around)
        if large := [
            f"{name} by {near[name]:.4g}" for name, size, core in sizes if size > far or core is Core.HALF_SPACE
        ]:
            warnings.warn(
                f"clearance: the arm is away from {', '.join(large)} [length]. {MILLIMETRES_HINT}",
                UserWarning,
                stacklevel=3,
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
        return {**vars(self), "_engine": self._tell(self._engine).memory(), "bodies": dict(self.bodies)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, bodies=MappingProxyType(state["bodies"]))
        memory, self._engine = self._engine, None
        self._engine = self._made()
        self._engine.remember(memory)

    @property
    def nearest(self) -> Near:
        """Which two bodies were the nearest in the last tick that asked for rows, and their `distance`."""
        return self._near(*self._engine.nearest)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """The names of the bodies that are kept apart."""
        off = set(self._tell(self._engine).always_near())
        return tuple({two: None for k, two in enumerate(self._bodies) if k not in off})

    @property
    def dropped(self) -> tuple[Dropped, ...]:
        """The pairs of bodies that are not kept apart, each with its reason; of obstacles, where these are now."""
        reason = f"always nearer than {1e3 * self.distance:.1f} mm"
        off = dict.fromkeys(self._bodies[k] for k in self._tell(self._engine).always_near())
        return (*self._dropped, *(Dropped(one, other, reason) for one, other in off))

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
        return self.rows_at(q, self._at_rate(self._rate))

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

    def engine_in_loop(self, rate: Any) -> Any:
        """The engine's clearance in a loop of some rate."""
        return law.ClearanceInLoop(self._engine, rate, self._report)

    def update(self) -> None:
        """Tell the engine where obstacles and other arms are now."""
        self._tell(self._engine)

    def _report(self, q: Array) -> None:
        """Warn of what is too near at joint positions q (m,), where a loop begins."""
        if near := {pair: d for pair, d in self.distances(q).items() if d < self._engine.enough}:
            told = "; ".join(str(Near(*pair, d)) for pair, d in near.items())
            warnings.warn(
                f"clearance: nearer than {1e3 * self.distance:.1f} mm when the loop begins: {told}. They are kept from "
                "coming nearer, and the arm does not move to part them. If they may be near each other, leave them "
                f"out: exclude={list(near)}",
                UserWarning,
                stacklevel=4,
            )

    def in_loop(self, loop: Loop) -> Any:
        """The engine's rate in a loop: how fast bodies may come nearer, and what its joints brake by."""
        alpha = min(TRACKING_SHARE / loop.dt, 1.0 / (e * (loop.delay + 0.5 * loop.dt)))
        alpha = alpha if self._rate is None else min(alpha, self._rate)
        box = box_of(loop)
        limits = box.velocity_limit, loop.acceleration, box.position_lower, box.position_upper
        return law.ClearanceRate(np.array(limits), alpha, loop.dt, box.rate, loop.delay)

    def _at_rate(self, alpha: float) -> Any:
        """A rate [1/s] for joints that stop at once."""
        robot = self.robot
        free = np.full(len(robot.names), inf)
        return law.ClearanceRate(
            np.array((robot.velocity_limit, free, robot.position_lower, robot.position_upper)), alpha
        )

    def rows_at(self, q: Array, rate: Any, before: Array | None = None) -> LimitRows | None:
        """The rows at joint positions q (m,) after a velocity `before` (m,), None where nothing is near enough."""
        positions = arrays.joints(q, self.robot.names, "q")
        return self._called(self._tell(self._engine).rows(positions, before, rate))

    def rows_after(self, q: Array, x: Array, rate: Any) -> LimitRows | None:
        """Rows about the velocity x (m,) of a tick from q (m,) on that ends too near; None where it does not."""
        return self._called(self._engine.after(q, x, rate))

    def _called(self, rows: tuple[Any, ...] | None) -> LimitRows | None:
        """Rows of the engine, by the names of what they keep apart."""
        if rows is None:
            return None
        C, lower, upper, pairs, distances = rows
        return LimitRows.trusted(C, lower, upper, list(map(self.row_name, pairs, distances)))

    def row_name(self, pair: int, distance: float) -> str:
        """What reasons call a row for a pair of bodies at some distance, -1 for a row that slows a joint."""
        return f"clearance: {self._near(pair, distance)}" if pair >= 0 else "clearance: slowly out"

    def too_near(self, pair: int, distance: float) -> str:
        """That the bodies of a pair are nearer than the distance, in words."""
        first, second, _ = self._near(pair, distance)
        return f"{first} and {second} are nearer than {1e3 * self.distance:.1f} mm"

    def broken(self) -> str:
        """Which bodies were too near in the last tick that asked for rows, "" where none were."""
        pair, distance = self._engine.nearest
        return self.too_near(pair, distance) if distance < self._engine.enough else ""

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
        pair, distance = self._least(np.where(still, self._distances(q), inf))
        rounding = ACTIVE_TOLERANCE * max(self.distance, 1.0)
        return self.too_near(pair, distance) if distance < self.distance - rounding else ""

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
        poses = self._tell(self._engine).placed(arrays.joints(q, self.robot.names, "q"))
        return [
            (part.name, None if part.frame is None or part.around < 0 else part.body, part.at(pose))
            for part, pose in zip(self._parts, poses, strict=True)
        ]

    def _near(self, k: int, d: float) -> Near:
        return Near(*self._bodies[k], d) if k >= 0 else Near("", "", inf)

    @staticmethod
    def _least(distances: Array) -> tuple[int, float]:
        """Which is the least of distances (k,), and what it is."""
        k = int(distances.argmin()) if len(distances) else -1
        return k, float(distances[k]) if k >= 0 else inf

    def _distances(self, q: ArrayLike) -> Array:
        """(k,) distances of the pairs; infinite where no joint moves them, or where a pair is always near."""
        found: Array = self._tell(self._engine).distances(arrays.joints(q, self.robot.names, "q"))
        return found


class _InLoop(LimitInEngine):
    """A clearance at the rate of a loop."""

    name = "clearance"
    clearance: Clearance

    def __init__(self, clearance: Clearance, rate: Any) -> None:
        self.clearance, self._rate = clearance, rate
        self.engine = clearance.engine_in_loop(rate)

    def __getstate__(self) -> dict[str, Any]:
        return {"clearance": self.clearance, "rate": self._rate, "last": self.engine.last}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["clearance"], state["rate"])  # type: ignore[misc]
        self.engine.last = state["last"]

    def begin(self, q: Array) -> None:
        self.clearance.update()
        self.engine.begin(q)

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        return self.clearance.rows_at(q, self._rate, velocity)

    def after(self, q: Array, velocity: Array) -> LimitRows | None:
        # Velocities of joints with brakes are so near the last one that rows about that one will do.
        return self.clearance.rows_after(q, velocity, self._rate) if self._rate.stops_at_once else None

    def broken(self) -> str:
        return self.clearance.broken()

    def blocked(self, q: Array) -> str:
        return self.clearance.blocked(q)
