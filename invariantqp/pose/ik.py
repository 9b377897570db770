"""Joint positions for a pose, inside the joint limits: damped Newton from several starts, by the engine.

    q = argmin f(q),   q_min <= q <= q_max,   f = 1/2 |(omega; p_d - p)|_W^2       zero where the pose can be reached

Depending on the arm, one try in two to six ends in a local minimum; a try that stalls is given up, and the next one
starts elsewhere. Where no try reaches the target the answer is the closest pose found, and its reason says so. Every
step reads only joint limits and quantities that no choice of tool frame changes, so the answer does not depend on it.

This file checks arguments and makes sentences; `core/pose.cpp` searches.
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
from invariantqp.control.limits import no_degrees, not_believed, refuse
from invariantqp.control.target import TARGETS, Target
from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt, written
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.robots.chain import Chain, drives_several
from invariantqp.robots.kinematics import (
    Robot,
    cached_for,
    joint_ranges,
    middle,
    plausible_distance,
    require_plausible_distance,
    whole_turns,
)
from invariantqp.systems.points import centre
from invariantqp.velocity.forms import CarriedMetric, Form, PitchForm, form_of

if TYPE_CHECKING:
    from invariantqp.control.clearance import Clearance

# Tries after the first, by default: of 20 000 random targets on each of eight arms, half of them with two joints at
# their limits, at most 5 were not reached with as many.
RESTARTS = 300
# How a search ended, as the engine numbers it (`PoseOutcome`).
REACHED, CLOSEST, LATE, OUT_OF_REACH = range(4)
# Arguments of searches that are kept once they are checked; and searches without more, kept with a robot.
KEPT, SEARCHES = 256, 16
# What a robot has to have.
NEEDED = ("names", "position_lower", "position_upper", "pose", "jacobian")


@frozen(eq=False, repr=False, slots=False)
class PoseSolution(Compared):
    """What `solve_pose` found.

    Attributes:
        q: (m,) joint positions, never outside their limits; those of the closest pose found if the target is not met.
        success: whether position and orientation are within the tolerance; with exact demands, whether these are within
            it and no step was found that brings the rest nearer.
        position_error: distance of the tool frame's origin, or of the point of a `Target`, from where it should be
            [length]; 0 where that is free.
        orientation_error: angle from the target, of a `Target` between its axis and its direction [rad]; 0 where the
            orientation is free.
        error: |(omega; p_d - p)|_W, the measure of what is closest [length].
        iterations: Newton steps, of all tries.
        restarts: tries after the first.
        active: joints at a position limit.
        displacement: max |q_i - q0_i|, how far the farthest joint is from `q0` put inside its limits, or without one
            from the middle of the range [rad, length].
        other_branch: True where the joints do not get to `q` on the descent from `q0`: a restart found it, or limits
            made a joint that can turn over turn the other way round, by more than half a turn. A target nearby may
            then be far in the joints. Without `q0` it is the descent from the middle of the range.
        reason: "" where the target is met; otherwise what is missing, and why.
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
    """`solve_pose` for one arm, its options checked once."""

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
        self._arm = cached_for(robot, "pose search", pose_arm)
        if clearance is not None:
            if not hasattr(clearance, "require"):
                raise BadInput("clearance", excerpt(clearance), "a limits.Clearance of this robot, or None")
            clearance.require(robot, "clearance")
        self._clearance = clearance
        self._form = None if form is None else _measure_of(form)
        # a whole twist leads to the whole pose, which is what is looked for without a demand
        self._exact = tuple(one for one in demands_of(exact) if not isinstance(one, ExactTwist))
        try:
            self._limits = _limits(tolerance, time_limit, restarts, seed, len(robot.names))
        except TypeError:  # no numbers that can be kept
            self._limits = _limits.__wrapped__(tolerance, time_limit, restarts, seed, len(robot.names))

    def __getstate__(self) -> dict[str, Any]:
        """All but the engine's arm, for copies."""
        return {name: value for name, value in vars(self).items() if name != "_arm"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._arm = cached_for(self._robot, "pose search", pose_arm)

    def start(self, q0: ArrayLike) -> Array:
        """Joint positions (m,) to begin from, checked."""
        q = arrays.joints(q0, self._robot.names, "q0")
        refuse(not_believed(self._robot, q, no_degrees(self._robot, self._robot.jacobian(middle(self._robot)))), "q0")
        return q

    def target(self, target: Any, argument: str = "target") -> Array | Target:
        """A target, checked: a pose (4, 4), the place (3,) of the tool, or a `Target`."""
        found = target if isinstance(target, Target) else arrays.array(arrays.matrix_of(target), argument, TARGETS)
        if isinstance(found, Target) or found.shape == (3,):
            if self._exact or self._form is not None:
                expected = "a (4, 4) pose beside a form or exact demands"
                raise BadInput(argument, excerpt(target), expected, "All that this target asks for is met as it is.")
            place = found.point if isinstance(found, Target) else arrays.vector(found, 3, argument)
        else:
            found = arrays.pose(found, argument)
            place = found[:3, 3]
        if place is not None:
            mid = middle(self._robot)
            J, tip = self._robot.jacobian(mid), self._robot.pose(mid)[:3, 3]
            require_plausible_distance(place, tip, plausible_distance(self._robot, J, tip), argument)
        return found

    def solve(self, target: Any, q0: ArrayLike | None = None) -> PoseSolution:
        """Joint positions for one target, from q0 first."""
        try:
            found = self._arm.solve(target, q0, *self._options(target))
        except (ValueError, TypeError):  # BadInput as well: it is said again by the name of the argument
            target, q0 = self.target(target), None if q0 is None else self.start(q0)
            found = self._arm.solve(target, q0, *self._options(target))
        return self._solution(found)

    def solve_many(
        self, targets: Sequence[Array | Target], q0: Array | None, *, along: bool, threads: int
    ) -> list[PoseSolution]:
        """Joint positions for n targets, from q0 (m,) or (n, m), all checked."""
        poses = np.array([T for T in targets if not isinstance(T, Target) and T.shape == (4, 4)]).reshape(-1, 4, 4)
        if isinstance(self._form, CarriedMetric) or len(poses) < len(targets):
            found: list[PoseSolution] = []
            for i, target in enumerate(targets):
                near = found[-1].q if along and found else q0 if q0 is None or q0.ndim == 1 else q0[i]
                found.append(self.solve(target, near))
            return found
        options = self._options(poses)
        return [self._solution(one) for one in self._arm.solve_many(poses, q0, along, threads, *options)]

    def met(self, target: Array, q0: Array) -> Array | None:
        """Joint positions (m,) on a pose (4, 4), both checked, by one descent from q0, or None.

        With exact demands these are met, and the rest as well as it is downhill from q0.
        """
        found = self.along(target[None], q0, np.full(len(q0), inf), np.ones(1))
        return found[0] if len(found) else None

    def along(self, targets: Array, q0: Array, fastest: Array, steps: Array) -> Array:
        """Joint positions (k, m) on the first k of poses (n, 4, 4), checked, by one descent each from the last.

        As far as they are met as in `met`, and joints no faster than their limits (m,) reach each in its step (n,) [s]
        from the one before.
        """
        found: Array = self._arm.descents(targets, q0, fastest, steps, *self._options(targets))
        return found

    def _options(self, target: Any) -> tuple[Any, ...]:
        """The other arguments of the engine's searches."""
        form = self._form
        if isinstance(form, CarriedMetric):  # fixed to the body at the target; its pose is in the base frame
            T = arrays.pose(target, "target")
            pose, inverse = T if form.follows_tool else np.asarray(form.pose), T[:3, :3].T
            root = np.linalg.cholesky(np.asarray(form.matrix)).T.dot(np.kron(np.eye(2), pose[:3, :3].T))
            measure: Any = root, inverse.dot(pose[:3, 3] - T[:3, 3])
        else:
            measure = form
        exact = tuple([self._demand(one, target) for one in self._exact]) if self._exact else ()
        tolerance, time_limit, restarts, origin = self._limits
        return measure, exact, tolerance, restarts, origin, time_limit, None if self._clearance is None else self._room

    def _demand(self, demand: Exact, target: Any) -> Any:
        """A demand as the engine takes it: kind, point, direction; or rows as a function of q (m,)."""
        if type(demand) is ExactPoint:
            return 0, demand.point, None
        if type(demand) is ExactAxis:
            return 1, None, demand.axis
        if type(demand) is ExactPlane:
            return 2, demand.point, demand.normal
        if isinstance(demand, ExactJoints):
            remedy = "Joint velocities are the controller's business."
            raise BadInput("exact", "ExactJoints", "demands on the pose", remedy)
        robot, wanted = self._robot, self._robot.target(target)

        def rows(q: Array) -> tuple[Array, Array]:
            found = demand.rows(View(robot, robot.state(q, wanted), wanted, 1.0, np.zeros(6)))
            return np.asarray(found.A), np.asarray(found.b)

        return rows

    def _room(self, q: Array) -> float:
        """How much room the clearance leaves at q, inf where it is kept."""
        clearance = self._clearance
        return inf if clearance is None or not clearance.blocked(q) else float(clearance.at(q).distance)

    def _solution(self, found: tuple[Any, ...]) -> PoseSolution:
        """The solution for what the engine found."""
        q, outcome, position, orientation, error, iterations, tries, active, other_branch, displacement = found
        success, reason = outcome in (REACHED, CLOSEST), ""
        if outcome != REACHED or self._clearance is not None:
            blocked = "" if self._clearance is None else self._clearance.blocked(q)
            reason, success = _reason(outcome, position, orientation, tries, blocked), success and not blocked
        solution = object.__new__(PoseSolution)
        fields = {
            "q": q,
            "success": success,
            "position_error": position,
            "orientation_error": orientation,
            "error": error,
            "iterations": iterations,
            "restarts": tries - 1,
            "active": active,
            "displacement": displacement,
            "other_branch": other_branch,
            "reason": reason,
        }
        object.__setattr__(solution, "__dict__", fields)  # a third of the time of attrs' own
        return solution


def _reason(outcome: int, position: float, orientation: float, tries: int, blocked: str) -> str:
    """What is missing, in words."""
    found = f"{written(position)} in length and {written(orientation)} rad off"
    among = "" if tries == 1 else f", the closest of {tries} tries"
    reason = {
        REACHED: "",
        CLOSEST: f"the exact demands are met; the rest is {found}{among}",
        LATE: f"time over: {found}{among}",
        OUT_OF_REACH: f"out of reach: {found}{among}",
    }[outcome]
    return "; ".join(filter(None, (f"{blocked}{'' if reason else among}" if blocked else "", reason)))


def pose_arm(robot: Robot) -> Any:
    """The arm as the engine searches with it: what depends on the robot alone."""
    if isinstance(robot, type) or not all(hasattr(robot, name) for name in NEEDED):
        raise BadInput("robot", excerpt(robot), "a robot, such as load_robot returns")
    m = len(robot.names)
    if m > law.MOST_JOINTS:
        raise BadInput("robot", f"{m} joints", f"at most {law.MOST_JOINTS}")
    mid = middle(robot)
    J, here, (low, high) = robot.jacobian(mid), robot.pose(mid), joint_ranges(robot)
    place, length = centre(J)
    believed = no_degrees(robot, J)
    if type(robot) is Chain:  # a class of the user's may be no such chain
        kinematics: dict[str, Any] = {"chain": robot.in_engine}
    else:
        kinematics = {"state": lambda q: (robot.pose(q), robot.jacobian(q))}
    phi = max(np.roots([1.0, *[0.0] * (m - 1), -1.0, -1.0]).real)  # the sequence of workbench/analysis/survey.py
    return law.PoseArm(
        **kinematics,
        lower=robot.position_lower,
        upper=robot.position_upper,
        low=low,
        high=high,
        middle=mid,
        stride=phi ** -np.arange(1.0, m + 1.0),
        turn=np.where(drives_several(robot), 0.0, whole_turns(J)),
        point=here[:3, :3].T.dot(place - here[:3, 3]),
        length=length if 0.0 < length < inf else 1.0,
        tip=here[:3, 3],
        far=plausible_distance(robot, J, here[:3, 3]),
        believed_lower=believed[0],
        believed_upper=believed[1],
    )


def _measure_of(form: Form | float) -> CarriedMetric | float:
    """A carried metric, or the length that a radian counts as."""
    chosen = form_of(form)
    if isinstance(chosen, CarriedMetric):
        return chosen
    if not isinstance(chosen, PitchForm) or chosen.h == 0.0:
        found = "h = 0" if isinstance(chosen, PitchForm) else "a complement"
        raise BadInput("form", f"{found}, which measures no distance", "a pitch other than 0, or CarriedMetric")
    return abs(chosen.h)


@lru_cache(maxsize=KEPT, typed=True)
def _limits(tolerance: float, time_limit: float, restarts: int, seed: int, m: int) -> tuple[float, float, int, Array]:
    """Options, checked, and where the sequence of starts begins, in shares of the range (m,)."""
    return (
        arrays.number(tolerance, "tolerance", "a tolerance in radians and in lengths", positive=True),
        arrays.number(time_limit, "time_limit", "seconds or inf", positive=True, infinite=True),
        arrays.count(restarts, "restarts", arrays.MANY),
        np.random.default_rng(arrays.count(seed, "seed")).random(m),
    )


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
    """Joint positions that put the tool at a pose, inside the joint limits.

    The answer is the same in every run with the same arguments, as long as the time does not end it; `time_limit=inf`
    makes that certain.

    Args:
        robot: from `load_robot`, or anything with names, position_lower and position_upper (m,), pose(q) and
            jacobian(q) as a `Robot` has them; at most 64 joints.
        target: tool pose, (4, 4) in the base frame or a `pinocchio.SE3`; or what leaves the rest of the pose free: a
            point (3,) in the base frame for the tool frame's origin, or a `Target` with a point, an axis, or both.
        q0: (m,) where to begin [rad, length], put inside the limits first; where it is outside them and two turns
            from zero, as in degrees, it is refused. None is the middle of the joint range. Restarts for a target nearby
            are around q0 first. Along a path, the answer before: hinges that can turn over end as near it as whole
            turns bring them, and where a target is out of reach the answer is the closest pose downhill from there, not
            the closest of all.
        form: the measure of how close a pose is. None is diag(L^2 I, I) at the arm's own point, fixed to its last link,
            with the arm's own length L, both taken in the middle of its range; a pitch h counts a radian as |h|
            instead; a CarriedMetric (`tool_metric(robot)`, for instance) is fixed to the body at the target. Where the
            target can be reached, the measure changes only the way there.
        exact: demands met before all else, as in `Controller`: "position" for the tool frame's origin, ExactPoint,
            ExactAxis, ExactPlane or several; "twist" is the whole pose, as None is. For arms with fewer than six
            joints: position first, then orientation as well as the arm can. With q0 the first try that meets them ends
            the search; without, the best in the rest of three that do. On arms with more than six joints rounding
            chooses among the postures left, so a displaced tool frame may change the answer (0.002 rad in one target of
            ten of a Panda), and `success` may be True where another posture is nearer in the rest.
        tolerance: of success, in lengths and in radians.
        time_limit: [s]; inf is none.
        restarts: tries after the first, at most; 0 is Newton from q0 alone.
        seed: where the sequence of starts begins.
        clearance: a `limits.Clearance` of this robot: a pose at which it is not kept is no success, and other postures
            are tried. None is no clearance.

    Returns:
        PoseSolution: q is inside the limits in any case; `reason` says what is missing.

    Raises:
        BadInput: NaN, wrong shapes, a start in degrees, or a target thirty times as far away as the arm is long, as one
            in millimetres is.
    """
    if form is None and exact is None and clearance is None:
        return _plain(robot, tolerance, time_limit, restarts, seed).solve(target, q0)
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


def _plain(robot: Robot, tolerance: float, time_limit: float, restarts: int, seed: int) -> PoseSearch:
    """A search for the whole pose; with a robot of this library it is kept."""
    kept: dict[Any, PoseSearch] = cached_for(robot, "searches", lambda _: {})
    try:
        found = kept.get((tolerance, time_limit, restarts, seed))
    except TypeError:  # no numbers
        found, kept = None, {}
    if found is None:
        found = PoseSearch(robot, tolerance=tolerance, time_limit=time_limit, restarts=restarts, seed=seed)
        if len(kept) == SEARCHES:
            kept.clear()
        kept[tolerance, time_limit, restarts, seed] = found
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
    """`solve_pose` for many targets: one PoseSolution each, in order.

    All arguments are checked before anything is solved.

    Args:
        robot: the arm.
        targets: as `solve_pose` takes them; where one of them leaves something free, all are solved on one thread.
        q0: (m,) where to begin, or (n, m), one for each target; None is the middle of the joint range.
        along: whether the targets are a path, each begun where the one before ended; on one thread.
        jobs: threads; -1 is one a core. An arm, a demand or a clearance in Python is asked on one.
        options: of `solve_pose`: form, exact, tolerance, time_limit, restarts, seed.
    """
    search = PoseSearch(robot, **options)
    listed = arrays.listed(targets, "targets", "a list of poses")
    wanted = [search.target(target, f"targets[{i}]") for i, target in enumerate(listed)]
    path, n, m = arrays.flag(along, "along"), len(listed), len(robot.names)
    begin = None
    if q0 is not None:
        begin = arrays.array(q0, "q0", f"{m} joint positions, or as many for each target")
        if begin.ndim == 2 and not path:
            begin = np.array([search.start(q) for q in arrays.matrix(begin, (n, m), "q0")])
        else:
            begin = search.start(begin)
    threads = -1 if type(jobs) is int and jobs == -1 else arrays.count(jobs, "jobs", arrays.MANY)
    if threads == 0:
        raise BadInput("jobs", "0", "a number of threads, or -1 for all cores")
    if path and threads != 1:
        raise BadInput("jobs", f"{jobs} for a path", "1", "Each pose of a path begins where the one before ended.")
    most = os.cpu_count() or 1
    return search.solve_many(wanted, begin, along=path, threads=most if threads == -1 else min(threads, most))
