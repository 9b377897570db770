"""Joint positions for a pose, inside the joint limits: damped Newton from starts spread over the joint range.

    q = argmin f(q),   q_min <= q <= q_max,   f = 1/2 |(omega; p_d - p)|_W^2       zero where the pose can be reached

Depending on the arm, one try in two to six ends in a local minimum; a try that stalls is given up, and the next one
starts elsewhere. Where no try reaches the target the answer is the closest pose found, and its reason says so. Every
step reads only joint limits and quantities that no choice of tool frame changes, so the answer does not depend on it.

Many poses are solved each on its own, in several processes, or along a path, each from the one before.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike

from invariantqp.analysis.survey import spread
from invariantqp.control.demands import Exact, demands_of
from invariantqp.control.limits import no_degrees, not_believed, refuse
from invariantqp.engine import core
from invariantqp.errors import BadInput, excerpt, written
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.pose.error import PoseError, pose_arm, pose_error
from invariantqp.pose.newton import Try, descend
from invariantqp.robots.kinematics import Robot, far_away, refuse_far, require_robot
from invariantqp.velocity.forms import Form

if TYPE_CHECKING:
    from invariantqp.control.clearance import Clearance
    from invariantqp.engine import Arm

# Newton goes on to this share of the tolerance, so that a tool frame far from the last link meets it too, and the tool
# frame does not decide which step is the last.
GOAL_SHARE = 1e-3
# Share of the time that is spent on tries, without and with exact demands; the rest is for the last digits of the
# closest few, which take longer with exact demands.
SEARCH_SHARE, EXACT_SHARE, CLOSEST = 0.8, 0.6, 4
# The last digits are begun again at most so often, while that brings the merit below this share of itself.
AGAIN, GAIN = 8, 0.999
# Tries after the first, by default: of 4 000 random targets on each of five arms, half of them with two
# joints at their limits, 4 were not reached with as many.
RESTARTS = 100


@frozen(eq=False, repr=False, slots=False)
class PoseSolution(Compared):
    """What `solve_pose` found.

    Attributes:
        q: (m,) joint positions, never outside their limits; those of the closest pose found if the target is not met.
        success: whether position and orientation are within the tolerance; with exact demands, whether these are within
            it and no step was found that brings the rest nearer.
        position_error: distance of the tool frame's origin from its target [length].
        orientation_error: angle from the target [rad].
        error: |(omega; p_d - p)|_W, the measure of what is closest [length].
        iterations: Newton steps, of all tries.
        restarts: tries after the first.
        active: joints at a position limit.
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
    reason: str


class PoseSearch:
    """`solve_pose` for one arm, its options checked once."""

    def __init__(
        self,
        robot: Robot,
        *,
        form: Form | float | None = None,
        exact: Exact | Sequence[Exact | Literal["position"]] | Literal["position"] | None = None,
        tolerance: float = 1e-6,
        time_limit: float = 0.05,
        restarts: int = RESTARTS,
        seed: int = 0,
        clearance: Clearance | None = None,
    ) -> None:
        """As `solve_pose`."""
        self._robot = require_robot(robot)
        if clearance is not None:
            if not hasattr(clearance, "require"):
                raise BadInput("clearance", excerpt(clearance), "a limits.Clearance of this robot, or None")
            clearance.require(self._robot, "clearance")
        self._clearance = clearance
        self._arm = pose_arm(robot)
        self._space = self._arm.space
        J, tip = robot.jacobian(self._space.middle), robot.pose(self._space.middle)[:3, 3]
        self._believed, self._tip, self._far = no_degrees(robot, J), tip, far_away(robot, J, tip)
        self._form = form
        self._exact = demands_of(exact)
        self._tolerance = arrays.number(tolerance, "tolerance", "a tolerance in radians and in lengths", positive=True)
        self._time_limit = arrays.number(time_limit, "time_limit", "seconds or inf", positive=True, infinite=True)
        self._restarts = arrays.count(restarts, "restarts", arrays.MANY)
        self._seed = arrays.count(seed, "seed")

    def start(self, q0: ArrayLike) -> Array:
        """Joint positions (m,) to begin from."""
        q = arrays.vector(q0, len(self._robot.names), "q0")
        refuse(not_believed(self._robot, q, self._believed), "q0")
        return q

    def refuse_far(self, pose: Array, argument: str) -> None:
        """Refuse a pose (4, 4) as far away as one in millimetres."""
        refuse_far(pose[:3, 3], self._tip, self._far, argument)

    def solve(self, target: Any, q0: ArrayLike | None = None) -> PoseSolution:
        """Joint positions for one target, from q0 first."""
        space = self._space
        error = pose_error(self._arm, target, self._form, self._exact)
        self.refuse_far(error.matrix, "target")
        start = space.middle if q0 is None else space.inside(self.start(q0))
        error.misses(start)  # anything that loads at its first use loads now, not in this target's time
        begun = perf_counter()
        goal = GOAL_SHARE * self._tolerance * error.least
        last = begun + self._time_limit
        deadline = begun + (EXACT_SHARE if self._exact else SEARCH_SHARE) * self._time_limit
        # An arm with joints to spare can follow a path past a limit without turning a joint by 2 pi: try that first.
        spare = len(start) > 6 or bool(self._exact)
        first = descend(error, space, start, goal, deadline, turning=q0 is None or not spare)
        refined: list[Try] = []
        downhill = q0 is not None and bool(self._exact) and not first.met
        if downhill:
            refined = [self._refined(error, first.q, goal, last)]
            if refined[0].unmet <= self._tolerance and refined[0].at_rest:
                return self._answer(error, refined[0], start, first.steps + refined[0].steps, 1, late=False)
        tried = self._tries(error, first, goal, deadline)
        late = perf_counter() > deadline
        if not any(one.met for one in tried):
            # From a given start, the closest pose is the one downhill from there.
            alone = q0 is not None and not downhill
            nearest = tried[:1] if alone else sorted(tried, key=self._rank)[:CLOSEST]
            refined += [self._refined(error, one.q, goal, last) for one in nearest]
        best = self._best(tried, refined, downhill)
        return self._answer(error, best, start, sum(one.steps for one in (*tried, *refined)), len(tried), late=late)

    def _best(self, tried: list[Try], refined: list[Try], downhill: bool) -> Try:
        """The one that met the target with most room; or of those `refined`, whose first may be downhill from q0."""
        met = [one for one in tried if one.met]
        if met:
            clearance = self._clearance
            if clearance is None or self._is_good(met[-1]):
                return met[-1]
            return max(met, key=lambda one: clearance.at(one.q).distance)
        # From q0, and not to what is exact: only a try that met that is nearer.
        some = [one for i, one in enumerate(refined) if not (downhill and i) or one.unmet <= self._tolerance]
        least = min(map(self._rank, some))
        # The first that is as near as the nearest: rounding does not choose between mirror images.
        return next(one for one in some if self._rank(one) <= (least[0], (1.0 + arrays.NEGLIGIBLE) * least[1]))

    def met(self, target: Array, q0: Array) -> Array | None:
        """Joint positions (m,) on a pose (4, 4), both checked, by one try of the core from q0; None for none.

        With exact demands these are met, and the rest as well as it is downhill from q0.
        """
        arm, goal, turning = self._of_core(target)
        if core is None or arm is None:
            return None
        found = core.descend(arm, target, q0, goal, turning, False, None)
        if found is None or not (found[5] or (self._exact and found[7] is None and found[2] <= goal)):
            return None
        return self._space.near(found[0], q0)

    def along(self, targets: Array, q0: Array, fastest: Array, steps: Array) -> Array:
        """Joint positions (k, m) on the first k of poses (n, 4, 4), checked, by one try of the core each from the last.

        As far as they are met as in `met`, and joints no faster than their limits (m,) reach each in its step (n,) [s]
        from the one before; with whole turns they are not.
        """
        arm, goal, turning = self._of_core(targets[0]) if len(targets) else (None, 0.0, False)
        if core is None or arm is None:
            return np.zeros((0, len(q0)))
        all_of_them, met = core.descents(arm, targets, q0, goal, turning, fastest, steps)
        return np.asarray(all_of_them[:met])

    def _of_core(self, target: Array) -> tuple[Arm | None, float, bool]:
        """What the core needs besides targets: the arm as measured, |r| that meets one, whether joints turn over."""
        error = pose_error(self._arm, target, self._form, self._exact)
        goal = GOAL_SHARE * self._tolerance * error.least
        return error.compiled, goal, len(self._robot.names) <= 6 and not self._exact

    def _tries(self, error: PoseError, first: Try, goal: float, deadline: float) -> list[Try]:
        """The first try, and others from states spread over the joint range until one is good or the time is over."""
        tried = [first]
        if not self._is_good(first):
            origin = np.random.default_rng(self._seed).random(len(self._robot.names))
            for state in spread(self._robot, self._restarts, origin):
                if self._is_good(tried[-1]) or perf_counter() > deadline:
                    break
                tried.append(descend(error, self._space, state, goal, deadline))
        return tried

    def _is_good(self, one: Try) -> bool:
        """Whether a try ended on the target, where nothing is too near."""
        return one.met and not self._blocked(one.q)

    def _blocked(self, q: Array) -> str:
        return "" if self._clearance is None else self._clearance.blocked(q)

    def _refined(self, error: PoseError, q: Array, goal: float, last: float) -> Try:
        """The last digits from q (m,); with exact demands several times: a penalty from far away is in their way."""
        one = descend(error, self._space, q, goal, last, patient=True)
        for _ in range(AGAIN if self._exact and not one.met else 0):
            again = descend(error, self._space, one.q, goal, last, patient=True)
            gained = self._rank(again) < (one.unmet > self._tolerance, GAIN * one.merit)
            one = (again if gained else one)._replace(steps=one.steps + again.steps)
            if one.met or not gained:
                break
        return one

    def _rank(self, one: Try) -> tuple[bool, float]:
        """What is least for the best try: exact demands come before all else, and a penalty is that of its own try."""
        return one.unmet > self._tolerance, one.merit

    def _answer(self, error: PoseError, best: Try, start: Array, steps: int, tries: int, *, late: bool) -> PoseSolution:
        """The solution for the best try."""
        q = self._space.near(best.q, start)
        position, orientation = error.misses(q)
        reached = position <= self._tolerance and orientation <= self._tolerance
        exactly = bool(self._exact) and best.unmet <= self._tolerance
        closest = exactly and best.at_rest
        found = f"{written(position)} in length and {written(orientation)} rad off"
        among = "" if tries == 1 else f", the closest of {tries} tries"
        if reached and (exactly or not self._exact):
            reason = ""
        elif closest:
            reason = f"the exact demands are met; the rest is {found}{among}"
        elif late or exactly:
            reason = f"time over: {found}{among}"
        else:
            reason = f"out of reach: {found}{among}"
        blocked = self._blocked(q)
        if blocked:
            reason = "; ".join(filter(None, (f"{blocked}{'' if reason else among}", reason)))
        return PoseSolution(
            q=q,
            success=(not reason or closest) and not blocked,
            position_error=position,
            orientation_error=orientation,
            error=sqrt(2.0 * best.f),
            iterations=steps,
            restarts=tries - 1,
            active=self._space.at_limits(q),
            reason=reason,
        )


def solve_pose(
    robot: Robot,
    target: Any,
    *,
    q0: ArrayLike | None = None,
    form: Form | float | None = None,
    exact: Exact | Sequence[Exact | Literal["position"]] | Literal["position"] | None = None,
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
        robot: from `load_robot`, or anything that meets `Robot`.
        target: tool pose, (4, 4) in the base frame or a `pinocchio.SE3`.
        q0: (m,) where to begin [rad, length], put inside the limits first; where it is outside them and two turns
            from zero, as in degrees, it is refused. None is the middle of the joint range. Along
            a path, the answer before: hinges that can turn over end as near it as whole turns bring them, and where a
            target is out of reach the answer is the closest pose downhill from there, not the closest of all.
        form: the measure of how close a pose is. None is diag(L^2 I, I) at the arm's own point, fixed to its last link,
            with the arm's own length L, both taken in the middle of its range; a pitch h counts a radian as |h|
            instead; a CarriedMetric (`tool_metric(robot)`, for instance) is fixed to the body at the target. Where the
            target can be reached, the measure changes only the way there.
        exact: demands met before all else, as in `Controller`: "position" for the tool frame's origin, ExactPoint,
            ExactAxis, ExactPlane or several. For arms with fewer than six joints: position first, then orientation as
            well as the arm can. All tries are then made unless one reaches the whole pose. On arms with more than six
            joints rounding chooses among the postures left, so a displaced tool frame may change the answer (0.002 rad
            in one target of ten of a Panda), and `success` may be True where another posture is nearer in the rest.
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
        targets: tool poses, as `solve_pose` takes them.
        q0: (m,) where to begin, or (n, m), one for each target; None is the middle of the joint range.
        along: whether the targets are a path, each begun where the one before ended; on one process.
        jobs: processes; -1 is one a core.
        options: of `solve_pose`: form, exact, tolerance, time_limit, restarts, seed.
    """
    search = PoseSearch(robot, **options)
    listed = arrays.listed(targets, "targets", "a list of poses")
    wanted = [arrays.pose(target, f"targets[{i}]") for i, target in enumerate(listed)]
    for i, pose in enumerate(wanted):
        search.refuse_far(pose, f"targets[{i}]")
    path, n, m = arrays.flag(along, "along"), len(wanted), len(robot.names)
    starts: list[Array | None] = [None] * n
    if q0 is not None:
        begin = arrays.array(q0, "q0", f"{m} joint positions, or as many for each target")
        each = begin.ndim == 2 and not path
        starts = [search.start(q) for q in arrays.matrix(begin, (n, m), "q0")] if each else [search.start(begin)] * n
    processes = -1 if type(jobs) is int and jobs == -1 else arrays.count(jobs, "jobs", arrays.MANY)
    if processes == 0:
        raise BadInput("jobs", "0", "a number of processes, or -1 for all cores")
    if path and processes != 1:
        raise BadInput("jobs", f"{jobs} for a path", "1", "Each pose of a path begins where the one before ended.")
    if processes != 1:
        from joblib import Parallel, delayed

        return list(Parallel(n_jobs=processes)(map(delayed(search.solve), wanted, starts)))
    found: list[PoseSolution] = []
    for target, start in zip(wanted, starts, strict=True):
        found.append(search.solve(target, found[-1].q if path and found else start))
    return found
