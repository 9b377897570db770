"""Inverse kinematics with position limits: damped Newton from several starts.

    q = argmin f(q),   q_min <= q <= q_max,   f = 1/2 |(omega; p_d - p)|_W^2       zero if the pose can be reached

A try that stalls in a local minimum is given up, and the next one starts elsewhere. If no try reaches the target, the
solution is the closest pose found, and its reason says so. The choice of the tool frame does not change the solution.

This file checks arguments and writes reasons; `core/pose.cpp` searches.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import lru_cache
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike

from invariantqp.control.demands import (
    Exact,
    ExactAxis,
    ExactJoints,
    ExactPlane,
    ExactPoint,
    ExactTwist,
    Named,
    View,
    demands_of,
)
from invariantqp.control.plausibility import bounds_against_degrees, require_plausible
from invariantqp.control.target import TARGETS, Target
from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt, written
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.robots.chain import Chain, drives_several
from invariantqp.robots.kinematics import (
    POSED_ROBOT,
    Robot,
    cached_for,
    joint_ranges,
    middle,
    plausible_distance,
    require_plausible_distance,
    require_robot,
    whole_turns,
)
from invariantqp.systems.points import centre
from invariantqp.velocity.forms import CarriedMetric, Form, PitchForm, form_of

if TYPE_CHECKING:
    from invariantqp.control.clearance import Clearance

# Default number of restarts: of 20 000 random targets on each of eight arms it misses at most 5.
RESTARTS = 300
# `PoseOutcome` of the engine.
REACHED, EXACT_REACHED, TIMED_OUT, OUT_OF_REACH = range(4)
# Number of searches that are cached with a robot.
SEARCH_CACHE_SIZE = 16


@frozen(eq=False, repr=False, slots=False)
class PoseSolution(Compared):
    """The solution of `solve_pose`.

    Attributes:
        q: (m,) joint positions inside their limits; those of the closest pose found if the target is not met.
        success: True if position and orientation are within the tolerance; with exact demands, if these are within it
            and the rest has converged to a minimum.
        position_error: distance of the tool frame's origin, or of the point of a `Target`, from the target [length]; 0
            if the position is free.
        orientation_error: angle from the target, of a `Target` between its axis and its direction [rad]; 0 if the
            orientation is free.
        error: |(omega; p_d - p)|_W, the minimised metric [length].
        iterations: Newton steps of all tries.
        restarts: tries after the first.
        active: joints at a position limit.
        displacement: max |q_i - q0_i| [rad, length], with `q0` clipped to the limits, or the middle of the range.
        other_branch: True if the descent from `q0`, or from the middle of the range, does not lead to `q`: a restart
            found it, or a limit made a joint turn the other way round, by more than half a turn.
        reason: "" if the target is met; otherwise the remaining errors, and why.
    """

    q: Array
    success: bool
    position_error: float
    orientation_error: float
    error: float
    iterations: int
    restarts: int
    active: tuple[int, ...]
    displacement: float
    other_branch: bool
    reason: str


class PoseSearch:
    """`solve_pose` for one arm, with its options checked once."""

    def __init__(
        self,
        robot: Robot,
        *,
        form: Form | float | None = None,
        exact: Exact | Sequence[Exact | Named] | Named | None = None,
        tolerance: float = 1e-6,
        time_limit: float = 0.05,
        restarts: int = RESTARTS,
        seed: int = 0,
        clearance: Clearance | None = None,
    ) -> None:
        """As `solve_pose`."""
        self._robot = robot
        self._arm = cached_for(robot, "pose search", engine_arm)
        if clearance is not None:
            if not hasattr(clearance, "require"):
                raise BadInput("clearance", excerpt(clearance), "a limits.Clearance of this robot, or None")
            clearance.require(robot, "clearance")
        self._clearance = clearance
        self._form = None if form is None else _metric_of(form)
        # ExactTwist demands the whole pose, which is the target without a demand
        self._exact = tuple(one for one in demands_of(exact) if not isinstance(one, ExactTwist))
        self._options = (
            arrays.number(tolerance, "tolerance", "a tolerance in radians and in lengths", positive=True),
            arrays.number(time_limit, "time_limit", "seconds or inf", positive=True, infinite=True),
            arrays.count(restarts, "restarts", arrays.LARGEST_COUNT),
            _start_origin(arrays.count(seed, "seed"), len(robot.names)),
        )

    def __getstate__(self) -> dict[str, Any]:
        """All attributes but the engine's arm, which cannot be pickled."""
        return {name: value for name, value in vars(self).items() if name != "_arm"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._arm = cached_for(self._robot, "pose search", engine_arm)

    def checked_start(self, q0: ArrayLike) -> Array:
        """(m,) joint positions to start from, checked."""
        q = arrays.joint_vector(q0, self._robot.names, "q0")
        bounds = bounds_against_degrees(self._robot, self._robot.jacobian(middle(self._robot)))
        require_plausible(self._robot, q, bounds, "q0")
        return q

    def checked_target(self, target: Any, argument: str = "target") -> Array | Target:
        """A target, checked: a pose (4, 4), a position (3,), or a `Target`."""
        given = target if isinstance(target, Target) else arrays.array(arrays.pose_matrix(target), argument, TARGETS)
        if isinstance(given, Target) or given.shape == (3,):
            if self._exact or self._form is not None:
                expected = "a (4, 4) pose with a form or exact demands"
                raise BadInput(argument, excerpt(target), expected, "A partial target is met exactly without them.")
            position = given.point if isinstance(given, Target) else arrays.vector(given, 3, argument)
        else:
            given = arrays.pose(given, argument)
            position = given[:3, 3]
        if position is not None:
            mid = middle(self._robot)
            J, tip = self._robot.jacobian(mid), self._robot.pose(mid)[:3, 3]
            require_plausible_distance(position, tip, plausible_distance(self._robot, J, tip), argument)
        return given

    def solve(self, target: Any, q0: ArrayLike | None = None) -> PoseSolution:
        """Joint positions for one target, from q0 first."""
        try:
            found = self._arm.solve(target, q0, self._engine_options(target))
        except (ValueError, TypeError):  # check in Python, whose errors name the argument; or another array type
            target, q0 = self.checked_target(target), None if q0 is None else self.checked_start(q0)
            found = self._arm.solve(target, q0, self._engine_options(target))
        return self._solution(found)

    def solve_many(
        self, targets: Sequence[Array | Target], q0: Array | None, *, along: bool, threads: int
    ) -> list[PoseSolution]:
        """Joint positions for n checked targets, from q0 (m,) or (n, m)."""
        poses = np.array([T for T in targets if not isinstance(T, Target) and T.shape == (4, 4)]).reshape(-1, 4, 4)
        if isinstance(self._form, CarriedMetric) or len(poses) < len(targets):
            found: list[PoseSolution] = []
            for i, target in enumerate(targets):
                near = found[-1].q if along and found else q0 if q0 is None or q0.ndim == 1 else q0[i]
                found.append(self.solve(target, near))
            return found
        options = self._engine_options(poses)
        return [self._solution(one) for one in self._arm.solve_many(poses, q0, along, threads, options)]

    def descend(self, target: Array, q0: Array) -> Array | None:
        """Joint positions (m,) for a checked pose (4, 4) by one descent from q0, or None if it is not met.

        With exact demands these must be met, and the rest is a local minimum.
        """
        found = self.descend_along(target[None], q0, np.full(len(q0), inf), np.ones(1))
        return found[0] if len(found) else None

    def descend_along(self, targets: Array, q0: Array, velocity_limit: Array, steps: Array) -> Array:
        """Joint positions (k, m) for the first k of checked poses (n, 4, 4), by one descent each from the one before.

        It ends at a pose that `descend` does not meet, or that joints within their velocity limits (m,) do not reach in
        its step (n,) [s].
        """
        found: Array = self._arm.descents(targets, q0, velocity_limit, steps, self._engine_options(targets))
        return found

    def _engine_options(self, target: Any) -> tuple[Any, ...]:
        """The options of the engine's searches."""
        form = self._form
        if isinstance(form, CarriedMetric):  # fixed to the body at the target; its pose is in the base frame
            T = arrays.pose(target, "target")
            pose, inverse = T if form.follows_tool else np.asarray(form.pose), T[:3, :3].T
            root = np.linalg.cholesky(np.asarray(form.matrix)).T.dot(np.kron(np.eye(2), pose[:3, :3].T))
            metric: Any = root, inverse.dot(pose[:3, 3] - T[:3, 3])
        else:
            metric = form
        exact = tuple([self._demand(one, target) for one in self._exact]) if self._exact else ()
        tolerance, time_limit, restarts, origin = self._options
        clearance = None if self._clearance is None else self._clearance_distance
        return metric, exact, tolerance, restarts, origin, time_limit, clearance

    def _demand(self, demand: Exact, target: Any) -> Any:
        """A demand of the engine: kind, point, direction; or rows as a function of q (m,)."""
        if type(demand) is ExactPoint:
            return 0, demand.point, None
        if type(demand) is ExactAxis:
            return 1, None, demand.axis
        if type(demand) is ExactPlane:
            return 2, demand.point, demand.normal
        if isinstance(demand, ExactJoints):
            remedy = "A Controller takes demands on joint velocities."
            raise BadInput("exact", "ExactJoints", "demands on the pose", remedy)
        robot, goal = self._robot, self._robot.target(target)

        def rows(q: Array) -> tuple[Array, Array]:
            found = demand.rows(View(robot, robot.state(q, goal), goal, 1.0, np.zeros(6)))
            return np.asarray(found.A), np.asarray(found.b)

        return rows

    def _clearance_distance(self, q: Array) -> float:
        """The smallest distance at q, inf if the clearance is kept."""
        clearance = self._clearance
        return inf if clearance is None or not clearance.blocked(q) else float(clearance.at(q).distance)

    def _solution(self, result: tuple[Any, ...]) -> PoseSolution:
        """The solution of a result of the engine."""
        q, outcome, position, orientation, error, iterations, tries, active, other_branch, displacement = result
        success, reason = outcome in (REACHED, EXACT_REACHED), ""
        if outcome != REACHED or self._clearance is not None:
            blocked = "" if self._clearance is None else self._clearance.blocked(q)
            reason, success = _reason(outcome, position, orientation, tries, blocked), success and not blocked
        rest = iterations, tries - 1, active, displacement, other_branch, reason
        return PoseSolution(q, success, position, orientation, error, *rest)


def _reason(outcome: int, position: float, orientation: float, tries: int, blocked: str) -> str:
    """The reason of a solution, with its errors."""
    errors = f"{written(position)} in length and {written(orientation)} rad off"
    among = "" if tries == 1 else f", the closest of {tries} tries"
    reason = {
        REACHED: "",
        EXACT_REACHED: f"the exact demands are met; the rest is {errors}{among}",
        TIMED_OUT: f"time limit reached: {errors}{among}",
        OUT_OF_REACH: f"out of reach: {errors}{among}",
    }[outcome]
    return "; ".join(filter(None, (f"{blocked}{'' if reason else among}" if blocked else "", reason)))


def engine_arm(robot: Robot) -> Any:
    """The engine's `PoseArm` of a robot."""
    require_robot(robot, POSED_ROBOT)
    m = len(robot.names)
    if m > law.MOST_JOINTS:
        raise BadInput("robot", f"{m} joints", f"at most {law.MOST_JOINTS}")
    mid = middle(robot)
    J, here, (start_lower, start_upper) = robot.jacobian(mid), robot.pose(mid), joint_ranges(robot)
    own_point, length = centre(J)
    plausible_lower, plausible_upper = bounds_against_degrees(robot, J)
    # a subclass of Chain may have other kinematics
    kinematics = robot.in_engine if type(robot) is Chain else lambda q: (robot.pose(q), robot.jacobian(q))
    phi = max(np.roots([1.0, *[0.0] * (m - 1), -1.0, -1.0]).real)  # golden ratio in m dimensions: the R-sequence
    return law.PoseArm(
        kinematics=kinematics,
        lower=robot.position_lower,
        upper=robot.position_upper,
        start_lower=start_lower,
        start_upper=start_upper,
        middle=mid,
        start_stride=phi ** -np.arange(1.0, m + 1.0),
        full_turn=np.where(drives_several(robot), 0.0, whole_turns(J)),
        point=here[:3, :3].T.dot(own_point - here[:3, 3]),
        length=length if 0.0 < length < inf else 1.0,
        tip=here[:3, 3],
        far=plausible_distance(robot, J, here[:3, 3]),
        plausible_lower=plausible_lower,
        plausible_upper=plausible_upper,
    )


def _metric_of(form: Form | float) -> CarriedMetric | float:
    """A carried metric, or the length that scales a radian."""
    metric = form_of(form)
    if isinstance(metric, CarriedMetric):
        return metric
    if not isinstance(metric, PitchForm) or metric.h == 0.0:
        found = "h = 0" if isinstance(metric, PitchForm) else "a complement"
        raise BadInput("form", f"{found}, which measures no distance", "a pitch other than 0, or CarriedMetric")
    return abs(metric.h)


@lru_cache
def _start_origin(seed: int, m: int) -> Array:
    """(m,) origin of the sequence of starts, in shares of the joint range."""
    return np.random.default_rng(seed).random(m)


def solve_pose(
    robot: Robot,
    target: Any,
    *,
    q0: ArrayLike | None = None,
    form: Form | float | None = None,
    exact: Exact | Sequence[Exact | Named] | Named | None = None,
    tolerance: float = 1e-6,
    time_limit: float = 0.05,
    restarts: int = RESTARTS,
    seed: int = 0,
    clearance: Clearance | None = None,
) -> PoseSolution:
    """Joint positions for a pose of the tool, inside the joint limits.

    The solution is the same in every run with the same arguments, unless the time limit ends the search.

    Args:
        robot: from `load_robot`, or anything with names, position_lower and position_upper (m,), pose(q) and
            jacobian(q) as a `Robot` has them; at most 64 joints.
        target: tool pose, (4, 4) in the base frame or a `pinocchio.SE3`; or a partial target: a position (3,) of
            the tool frame's origin in the base frame, or a `Target` with a point, an axis, or both.
        q0: (m,) start [rad, length], clipped to the limits; None is the middle of the joint range. A start outside the
            limits and two turns from zero, as in degrees, is refused. For a target nearby the first restarts are around
            q0. Hinges that can turn over end as near to q0 as whole turns bring them. Out of reach, the
            solution is the closest pose downhill from q0.
        form: metric of the error. None is diag(L^2 I, I) at the arm's own point, fixed to its last link, with its own
            length L, both in the middle of its range; a pitch h replaces L by |h|; a CarriedMetric, such as
            `tool_metric(robot)`, is fixed to the body at the target. It does not change a pose that is reached.
        exact: demands with priority, as in `Controller`: "position" for the tool frame's origin, ExactPoint, ExactAxis,
            ExactPlane or several; "twist" is the whole pose, as None is. The rest of the pose is met as well as the arm
            can. With q0 the search ends at the first try that meets them; without, at the best of three. For redundant
            arms the solution may then depend on the tool frame, by 0.002 rad in a tenth of the targets of a Panda.
        tolerance: of success [length, rad].
        time_limit: [s]; inf is none.
        restarts: most tries after the first; 0 is Newton from q0 alone.
        seed: of the sequence of starts.
        clearance: a `limits.Clearance` of this robot; poses that do not keep it are no success. None is no clearance.

    Returns:
        PoseSolution: q is always inside the limits; `reason` says why the target is not met.

    Raises:
        BadInput: NaN, wrong shapes, a start in degrees, or a target as far away as thirty lengths of the arm, as in
            millimetres.
    """
    if form is None and exact is None and clearance is None:
        return _cached_search(robot, tolerance, time_limit, restarts, seed).solve(target, q0)
    search = PoseSearch(
        robot,
        form=form,
        exact=exact,
        tolerance=tolerance,
        time_limit=time_limit,
        restarts=restarts,
        seed=seed,
        clearance=clearance,
    )
    return search.solve(target, q0)


def _cached_search(robot: Robot, tolerance: float, time_limit: float, restarts: int, seed: int) -> PoseSearch:
    """A search for the whole pose, cached with the robot."""
    cache: dict[Any, PoseSearch] = cached_for(robot, "searches", lambda _: {})
    try:
        found = cache.get((tolerance, time_limit, restarts, seed))
    except TypeError:  # not hashable
        found, cache = None, {}
    if found is None:
        found = PoseSearch(robot, tolerance=tolerance, time_limit=time_limit, restarts=restarts, seed=seed)
        if len(cache) == SEARCH_CACHE_SIZE:
            cache.clear()
        cache[tolerance, time_limit, restarts, seed] = found
    return found


def solve_poses(
    robot: Robot,
    targets: Sequence[Any],
    *,
    q0: ArrayLike | None = None,
    along: bool = False,
    jobs: int = 1,
    **options: Any,
) -> list[PoseSolution]:
    """One PoseSolution of `solve_pose` for each of many targets, in order; arguments are checked before the first.

    Args:
        robot: the arm.
        targets: as `solve_pose` takes them; with a partial one all are solved on one thread.
        q0: (m,) start, or (n, m), one for each target; None is the middle of the joint range.
        along: True for a path, where each target starts from the solution before; on one thread.
        jobs: threads; -1 is one a core. An arm, a demand or a clearance in Python runs on one.
        options: of `solve_pose`: form, exact, tolerance, time_limit, restarts, seed.
    """
    search = PoseSearch(robot, **options)
    listed = arrays.sequence(targets, "targets", "a list of poses")
    checked = [search.checked_target(target, f"targets[{i}]") for i, target in enumerate(listed)]
    path, n, m = arrays.flag(along, "along"), len(listed), len(robot.names)
    starts = None
    if q0 is not None:
        starts = arrays.array(q0, "q0", f"{m} joint positions, or as many for each target")
        if starts.ndim == 2 and not path:
            starts = np.array([search.checked_start(q) for q in arrays.matrix(starts, (n, m), "q0")])
        else:
            starts = search.checked_start(starts)
    threads = -1 if type(jobs) is int and jobs == -1 else arrays.count(jobs, "jobs", arrays.LARGEST_COUNT)
    if threads == 0:
        raise BadInput("jobs", "0", "a number of threads, or -1 for all cores")
    if path and threads != 1:
        raise BadInput("jobs", f"{jobs} for a path", "1", "Each pose of a path starts from the solution before.")
    most = os.cpu_count() or 1
    return search.solve_many(checked, starts, along=path, threads=most if threads == -1 else min(threads, most))
