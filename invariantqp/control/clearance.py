"""Clearance: the links of an arm keep a distance from each other and from obstacles.

    C x >= -alpha (d - d_min) - n'v_obstacle        C = w'J on the joints between two bodies,  w = (p x n; n)

for each witness point p of a pair of bodies (`core/distance.hpp`), with the normal n from one body to the other. Bodies
approach d_min exponentially at the rate alpha = min(0.1 / dt, 1 / (e (D + dt/2))): a tick uses at most a tenth of the
margin d - d_min, and a command that acts after a delay D does not overshoot.

**Joints with acceleration limits** a do not stop at once, so a velocity is allowed only if the arm can brake from it:

    q_n(x) = q + dt (x + (1 - 1/N) x + (1 - 2/N) x + ...)     n ticks of braking from x; all joints stop in N(x) ticks,
                                                              at most at 0.7 a, except at the end of a joint's range
    d(q_n(x), n dt) - d_min >= (1 - alpha dt) (d(q_n(y), n dt) - d_min),    y the last velocity braked for one tick

to first order in x - y, for n = N, 0.7 N, 0.49 N, ... and 0. If the arm keeps braking, the next tick passes through the
same states. If all of them keep the distance, x = y satisfies every row, every acceleration limit and every joint
limit: the rows are feasible unless the start was not, or something moves otherwise than declared. Joints that
brake together stay on their path, so an arm pushed against an obstacle comes to rest. If a braking state is nearer
than d_min, because a corner lies between two states, it is led back as far as the limits allow. Two arms that
do not know each other's velocity use half of the margin each. Another arm that brakes is predicted by its own braking.

**Moving obstacles** have the twist that they are given, or that of their last two poses. The arm evades: if it
can be as fast as the obstacle, it starts while its joints can still reach that speed. With v the speed of the obstacle
towards the arm and a the acceleration of the joints along n,

    C x >= v - sqrt(2 a (d - d_min)), approximately (`braking_speed`)        or as much as the joints can

While the arm moves away it need not brake, and only the present state is checked.

**Joints that stop at once** may move anywhere in a tick, and rows that are linear about x = 0 miss the curvature of
their paths, 3 mm at 3 rad/s and 10 ms. A tenth of what curvature takes of d_min is led back in a tick. A solution x
that ends nearer than 99.5 % of d_min, and nearer than it began, is solved again, up to four times, with additional rows

    d(q + dt x) + dt C (x' - x) >= d_min,    C at q + dt x

Rows that every velocity inside the joint limits satisfies are omitted, so there is no influence distance; of the others
the 16 most urgent are used, the nearest witness of each pair first. Rows are relaxed before joint limits.

**A pair nearer than d_min in the first tick of a loop** keeps its distance, and each larger one that it reaches, to 5 %
of d_min, until that is d_min: an arm with a still target stays still, with noise too. A pair that gets nearer later,
because an obstacle came, is led apart slowly, along the normal of its nearest witness.

The engine computes all of this (`core/clearance.hpp`); this file has its arguments and names. Clearance does not plan a
way around: an arm led straight at an obstacle stops before it.
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

from invariantqp.control.clearance_bodies import Dropped, OtherArm, chain_of, engine_of, geoms_of, pairs_of, shapes_of
from invariantqp.control.limits import EngineLimit, Limit, Loop
from invariantqp.control.loop_limits import box_of
from invariantqp.control.tracking import TRACKING_SHARE
from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt, millimetres
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import CollisionObject
from invariantqp.geometry.shapes import Core, Shape
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import MILLIMETRES_HINT, Robot, middle, plausible_distance
from invariantqp.velocity.limits import LimitRows
from invariantqp.velocity.solution import ACTIVE_TOLERANCE


class Near(NamedTuple):
    """Two bodies and their distance."""

    first: str
    second: str
    distance: float  # [length], negative inside; inf without a pair

    def __str__(self) -> str:
        far = f", {millimetres(self.distance)} mm" if self.distance < inf else ""
        return f"{self.first} and {self.second}{far}"


class Clearance(Limit):
    """A limit that keeps an arm's links at a distance from each other and from obstacles.

    Bodies that are nearer when a loop begins keep their distance and move no arm. The first tick then warns, with the
    pairs to `exclude=` if they may be near each other.

    Attributes:
        robot: the arm.
        bodies: the shapes of its links, by link, each in its link's frame.
        obstacles: shapes and other arms around it.
        arms: the other arms among them.
        distance: d_min [length].
        nearest: the nearest two bodies in the last tick, and their `distance`.
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
            distance: the least distance [length].
            pairs: pairs of names of the bodies that are checked; None is all that can touch.
            exclude: pairs that may touch, such as ("panda_hand", "table") for a hand that works on it, or the path of
                an SRDF that lists them; in addition to the pairs that the robot's own SRDF or MJCF excludes.
            rate: alpha [1/s]; None is the largest that the controller's tick, delay and accelerations allow.

        Raises:
            BadInput: something that is no shape, a distance below zero, a robot without collision geometry and bodies.
            UnknownName: an unknown link, or an unknown body in a pair.
            RobotModelError: geometry or an SRDF that cannot be read.
            MissingExtra: meshes that are no binary STL, without coal (extra `pin`).

        Warns:
            UserWarning: an obstacle that is always nearer than the distance to all links, or one thirty arm lengths
                away and as large, as in millimetres.
        """
        self.robot: Chain = chain_of(robot)
        self.distance: float = arrays.not_negative(distance, "distance", "a distance in lengths")
        self.bodies: Mapping[str, Any] = MappingProxyType(shapes_of(self.robot, bodies))
        if not isinstance(obstacles, (list, tuple)):
            raise BadInput("obstacles", excerpt(obstacles), "a list of shapes and OtherArm")
        self.obstacles: tuple[Shape | OtherArm, ...] = tuple(obstacles)
        self._rate = None if rate is None else arrays.number(rate, "rate", "a rate in 1/s", positive=True)
        self.arms = [arm for arm in self.obstacles if isinstance(arm, OtherArm)]
        self._geoms = geoms_of(self.robot, self.bodies, self.obstacles)
        self._shape_pairs, self._dropped = pairs_of(self.robot, self._geoms, pairs, exclude)
        self._body_pairs = [(self._geoms[i].name, self._geoms[j].name) for i, j in self._shape_pairs]
        self._keeps_all = pairs is not None
        self._sent: dict[int, Array] = {}  # poses of obstacles and joint positions of arms that the engine has
        self._obstacle_geoms = [geom for geom in self._geoms if geom.is_obstacle]
        self._engine = self._new_engine()
        self._engine.start()
        self._warn_of_distance()
        self._warn_of_obstacles()

    def _new_engine(self) -> Any:
        """A new clearance of the engine, with obstacles and arms at their present poses."""
        engine = engine_of(
            self.robot, self.arms, self._geoms, self._shape_pairs, self.distance, keep_all=self._keeps_all
        )
        self._sent.clear()
        return self._updated(engine)

    def _updated(self, engine: Any) -> Any:
        """The engine, with the present poses of obstacles and arms that have moved."""
        for k, geom in enumerate(self._obstacle_geoms):
            shape = geom.shape
            if self._sent.get(k) is not shape.pose:
                self._sent[k] = shape.pose
                engine.move(k, shape.pose, shape.twist if shape.declared else None)
        for k, arm in enumerate(self.arms):
            if self._sent.get(-1 - k) is not arm.q:
                self._sent[-1 - k] = arm.q
                engine.move_arm(k, arm.q, arm.velocity if arm.has_velocity else None)
        return engine

    def _warn_of_obstacles(self) -> None:
        """Warn of obstacles as far away and as large as in millimetres; small ones may be parked there."""
        mid = middle(self.robot)
        far, nearest = (
            plausible_distance(self.robot, self.robot.jacobian(mid), self.robot.pose(mid)[:3, 3]),
            dict[str, float](),
        )
        for (_, name), distance in self.distances(mid).items():
            nearest[name] = min(nearest.get(name, inf), distance)
        large = []
        for name, shape, *_ in self._obstacle_geoms:
            is_large = shape.core is Core.HALF_SPACE or 2.0 * (se3.norm(shape.half) + shape.radius) > far
            if far < nearest.get(name, 0.0) < inf and is_large:
                large.append(f"{name} by {nearest[name]:.4g}")
        if large:
            warnings.warn(
                f"clearance: the arm is away from {', '.join(large)} [length]. {MILLIMETRES_HINT}",
                UserWarning,
                stacklevel=3,
            )

    def _warn_of_distance(self) -> None:
        """Warn if no pair is checked, or none with some obstacle because the distance may be in millimetres."""
        checked = {name for pair in self.pairs for name in pair}
        always_near = {one.second: one.reason for one in self.dropped if one.reason.startswith("always")}
        lost = [geom.name for geom in self._obstacle_geoms if geom.name in always_near and geom.name not in checked]
        if lost:
            warnings.warn(
                f"clearance: nothing is kept {self.distance:g} apart from {', '.join(lost)}, being "
                f"{always_near[lost[0]]}; distances are in the length unit of the robot, metres as a rule",
                UserWarning,
                stacklevel=3,
            )
        elif not checked and not any(one.reason == "excluded" for one in self.dropped):
            why = ", ".join(map(str, self.dropped)) or "there are no two bodies"
            warnings.warn(f"clearance: nothing is kept apart ({why}). Give bodies= and obstacles=", stacklevel=3)

    def __setattr__(self, name: str, value: Any) -> None:
        if name in ("robot", "bodies", "obstacles", "distance") and name in vars(self):
            raise AttributeError(
                f"{name} of a clearance does not change: move an obstacle by shape.move, and pass obstacles that come "
                "and go as another Clearance in step(limits=[...])"
            )
        object.__setattr__(self, name, value)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_engine": self._updated(self._engine).memory(), "bodies": dict(self.bodies)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, bodies=MappingProxyType(state["bodies"]))
        memory, self._engine = self._engine, None
        self._engine = self._new_engine()
        self._engine.remember(memory)

    @property
    def nearest(self) -> Near:
        """The nearest two bodies in the last tick, and their `distance`."""
        return self._near(*self._engine.nearest)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """The pairs of bodies that are checked, by name."""
        off = set(self._updated(self._engine).always_near())
        return tuple({pair: None for k, pair in enumerate(self._body_pairs) if k not in off})

    @property
    def dropped(self) -> tuple[Dropped, ...]:
        """The pairs of bodies that are not checked, each with its reason; with obstacles at their present poses."""
        reason = f"always nearer than {millimetres(self.distance)} mm"
        off = dict.fromkeys(self._body_pairs[k] for k in self._updated(self._engine).always_near())
        return (*self._dropped, *(Dropped(first, second, reason) for first, second in off))

    def __repr__(self) -> str:
        return f"<Clearance of {self.distance:g}, {len(self.pairs)} pairs of bodies, {len(self.dropped)} dropped>"

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        """The rows at joint positions q (m,), at the rate given; a controller calls `for_loop` instead.

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
        return _ClearanceInLoop(self, self.in_loop(loop))

    def require(self, robot: Robot, argument: str) -> None:
        """Check that this clearance, given as an argument, is of a robot.

        Raises:
            BadInput: it is of another robot, or of one with another base or tool offset.
        """
        own, q = self.robot, np.zeros(len(self.robot.names))
        if robot.names != own.names or not (
            np.allclose(robot.pose(q), own.home) and np.allclose(robot.jacobian(q), own.screws)
        ):
            raise BadInput(
                argument, f"{self!r} of another robot", "one made with this robot, of the same base= and offset="
            )

    def engine_in_loop(self, rate: Any) -> Any:
        """The engine's clearance in a loop of a rate."""
        return law.ClearanceInLoop(self._engine, rate, self._warn_of_start)

    def update(self) -> None:
        """Send the present poses of obstacles and other arms to the engine."""
        self._updated(self._engine)

    def _warn_of_start(self, q: Array) -> None:
        """Warn of pairs that are too near at joint positions q (m,), where a loop begins."""
        if near := {pair: d for pair, d in self.distances(q).items() if d < self._engine.threshold}:
            listed = "; ".join(str(Near(*pair, d)) for pair, d in near.items())
            warnings.warn(
                f"clearance: nearer than {millimetres(self.distance)} mm when the loop begins: {listed}. They are kept "
                "from coming nearer, and the arm does not move to part them. If they may be near each other, leave "
                f"them out: exclude={list(near)}",
                UserWarning,
                stacklevel=4,
            )

    def in_loop(self, loop: Loop) -> Any:
        """The engine's rate in a loop: alpha, the tick, the delay and the joint limits."""
        alpha = min(TRACKING_SHARE / loop.dt, 1.0 / (e * (loop.delay + 0.5 * loop.dt)))
        alpha = alpha if self._rate is None else min(alpha, self._rate)
        box = box_of(loop)
        limits = box.velocity_limit, loop.acceleration, box.position_lower, box.position_upper
        return law.ClearanceRate(np.array(limits), alpha, loop.dt, box.rate, loop.delay)

    def _at_rate(self, alpha: float) -> Any:
        """A rate [1/s] for joints that stop at once."""
        free = np.full(len(self.robot.names), inf)
        limits = self.robot.velocity_limit, free, self.robot.position_lower, self.robot.position_upper
        return law.ClearanceRate(np.array(limits), alpha)

    def rows_at(self, q: Array, rate: Any, before: Array | None = None) -> LimitRows | None:
        """The rows at joint positions q (m,) after a velocity `before` (m,), or None."""
        positions = arrays.joint_vector(q, self.robot.names, "q")
        return self._with_names(self._updated(self._engine).rows(positions, before, rate))

    def rows_after(self, q: Array, x: Array, rate: Any) -> LimitRows | None:
        """Rows about the velocity x (m,) of a tick from q (m,) if it ends too near, or None."""
        return self._with_names(self._engine.after(q, x, rate))

    def _with_names(self, rows: tuple[Any, ...] | None) -> LimitRows | None:
        """Rows of the engine, with the names of their pairs."""
        if rows is None:
            return None
        C, lower, upper, pairs, distances = rows
        return LimitRows.trusted(C, lower, upper, list(map(self.row_name, pairs, distances)))

    def row_name(self, pair: int, distance: float) -> str:
        """The name of a row of a pair at a distance, in reasons; pair -1 is a row that limits a joint's speed."""
        return f"clearance: {self._near(pair, distance)}" if pair >= 0 else "clearance: slowly out"

    def too_near(self, pair: int, distance: float) -> str:
        """The message that a pair is nearer than the distance."""
        first, second, _ = self._near(pair, distance)
        return f"{first} and {second} are nearer than {millimetres(self.distance)} mm"

    def violation(self) -> str:
        """Which bodies were too near at the last call of `rows`, "" if none."""
        pair, distance = self._engine.nearest
        return self.too_near(pair, distance) if distance < self._engine.threshold else ""

    def at(self, q: ArrayLike) -> Near:
        """The nearest two bodies and their distance at joint positions q (m,).

        Raises:
            BadInput: NaN or a wrong length.
        """
        return self._near(*self._least(self._distances(q)))

    def blocked(self, q: ArrayLike) -> str:
        """Which bodies are nearer than the distance at joint positions q (m,), "" if none.

        Moving obstacles do not count: they may be gone by then.

        Raises:
            BadInput: NaN or a wrong length.
        """
        still = [not (self._geoms[j].arm or self._geoms[j].shape.twist.any()) for _, j in self._shape_pairs]
        pair, distance = self._least(np.where(still, self._distances(q), inf))
        rounding = ACTIVE_TOLERANCE * max(self.distance, 1.0)
        return self.too_near(pair, distance) if distance < self.distance - rounding else ""

    def distances(self, q: ArrayLike) -> dict[tuple[str, str], float]:
        """The distance of each pair of bodies at joint positions q (m,) [length]; negative inside.

        Infinite for shapes that no joint moves towards each other.

        Raises:
            BadInput: NaN or a wrong length.
        """
        of_shapes = self._distances(q).tolist()  # before `pairs`, which it updates
        of_bodies = dict.fromkeys(self.pairs, inf)
        for pair, d in zip(self._body_pairs, of_shapes, strict=True):
            if d < inf:
                of_bodies[pair] = min(of_bodies[pair], d)
        return of_bodies

    def shapes(self, q: ArrayLike) -> list[tuple[str, int | None, CollisionObject]]:
        """All shapes at joint positions q (m,), to draw them.

        Each with the name of its body and the number of joints that move it, None for obstacles and other arms.

        Raises:
            BadInput: NaN or a wrong length.
        """
        poses = self._updated(self._engine).poses(arrays.joint_vector(q, self.robot.names, "q"))
        return [
            (geom.name, geom.joints if geom.is_own_link else None, geom.at(pose))
            for geom, pose in zip(self._geoms, poses, strict=True)
        ]

    def _near(self, k: int, d: float) -> Near:
        return Near(*self._body_pairs[k], d) if k >= 0 else Near("", "", inf)

    @staticmethod
    def _least(distances: Array) -> tuple[int, float]:
        """The index and the value of the least of distances (k,), -1 and inf of none."""
        k = int(distances.argmin()) if len(distances) else -1
        return k, float(distances[k]) if k >= 0 else inf

    def _distances(self, q: ArrayLike) -> Array:
        """(k,) distances of the pairs of shapes; inf if no joint moves them, or if the pair is always near."""
        distances: Array = self._updated(self._engine).distances(arrays.joint_vector(q, self.robot.names, "q"))
        return distances


class _ClearanceInLoop(EngineLimit):
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

    # The engine calls none of begin, rows, after and violation; a user's limit that contains this one does.

    def begin(self, q: Array) -> None:
        self.clearance.update()
        self.engine.begin(q)

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        return self.clearance.rows_at(q, self._rate, velocity)

    def after(self, q: Array, velocity: Array) -> LimitRows | None:
        # With acceleration limits the velocity is so near the last one that rows about the last one are enough.
        return self.clearance.rows_after(q, velocity, self._rate) if self._rate.stops_at_once else None

    def violation(self) -> str:
        return self.clearance.violation()

    def blocked(self, q: Array) -> str:
        return self.clearance.blocked(q)
