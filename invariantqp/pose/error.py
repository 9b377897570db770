"""An arm in a pose search, how far its tool is from a target, in one definite measure, and how joints change that.

    r = F (omega; p_d - p),    f(q) = 1/2 |r|^2,    F'F = W,    grad f = -A'r

omega is the rotation vector from the tool to its target, p and p_d are the positions of a point c of the last link, now
and at the target. By default W = diag(L^2 I, I) with the arm's own length L, and c is the arm's own point in the middle
of its range: neither depends on where the tool frame is, so no step and no answer does. Exact demands, C x = b, are
measured apart from it. Where the range of a hinge is a whole turn or more, every angle has an equal one inside it.
"""

from __future__ import annotations

from math import inf, sqrt, tan
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from invariantqp.control.demands import Exact, ExactJoints, ExactPoint, View, rows_of
from invariantqp.engine import core, core_for
from invariantqp.errors import BadInput
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.legacy.compiled_loop import compiled_demands
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot, middle, remembered, whole_turns
from invariantqp.systems.points import centre
from invariantqp.velocity.backends import UNBOUNDED
from invariantqp.velocity.forms import CarriedMetric, Form, PitchForm, form_of

if TYPE_CHECKING:
    from invariantqp.engine import Arm


class JointSpace:
    """The joint limits of an arm, with its turns."""

    def __init__(self, robot: Robot) -> None:
        """The joint space of a robot."""
        self.middle: Array = middle(robot)
        # (m,) limits [rad, length], the solver's infinity where there is none; a whole turn in units of q, 1 of what is
        # no hinge; and which hinges have a range that holds one.
        self.lower: Array = np.maximum(robot.position_lower, -UNBOUNDED)
        self.upper: Array = np.minimum(robot.position_upper, UNBOUNDED)
        turn = whole_turns(robot.jacobian(self.middle))
        self.turn: Array = np.where(turn > 0.0, turn, 1.0)
        self.whole: NDArray[np.bool_] = (turn > 0.0) & (self.upper - self.lower >= self.turn)

    def steps(self, q: Array, *, turning: bool) -> tuple[Array, Array]:
        """The least and the largest step (m,) from q; with `turning`, half a turn for a hinge that can turn over."""
        least, most = self.lower - q, self.upper - q
        if not turning:
            return least, most
        return np.where(self.whole, -0.5 * self.turn, least), np.where(self.whole, 0.5 * self.turn, most)

    def inside(self, q: Array) -> Array:
        """q shifted by whole turns into the limits; clipped to them where no turn helps."""
        over = np.maximum(np.ceil((q - self.upper) / self.turn), 0.0)
        under = np.maximum(np.ceil((self.lower - q) / self.turn), 0.0)
        return np.clip(q + np.where(self.whole, (under - over) * self.turn, 0.0), self.lower, self.upper)

    def near(self, q: Array, start: Array) -> Array:
        """The same pose with each joint as near its start as whole turns inside the limits bring it."""
        least, most = np.ceil((self.lower - q) / self.turn), np.floor((self.upper - q) / self.turn)
        turns = np.where(self.whole, np.clip(np.round((start - q) / self.turn), least, most), 0.0)
        return self.inside(q + turns * self.turn)

    def at_limits(self, q: Array) -> tuple[int, ...]:
        """The joints at a limit, but for the rounding of a step to it, relative to 1 + |q|."""
        room = np.minimum(q - self.lower, self.upper - q)
        return tuple(np.flatnonzero(room <= ROUNDING * (1.0 + np.abs(q))).tolist())


class PoseArm(NamedTuple):
    """An arm in a pose search."""

    robot: Robot  # the arm
    space: JointSpace  # its joint limits and whole turns
    point: Array  # (3,) in the tool frame [length], the arm's own point in the middle of its range
    length: float  # the arm's own length there [length]


def pose_arm(robot: Robot) -> PoseArm:
    """The arm, from the middle of its range."""
    return remembered(robot, "pose search", _pose_arm)


def _pose_arm(robot: Robot) -> PoseArm:
    space = JointSpace(robot)
    here = robot.pose(space.middle)
    place, length = centre(robot.jacobian(space.middle))
    point = here[:3, :3].T.dot(place - here[:3, 3])
    return PoseArm(robot, space, point, length if 0.0 < length < inf else 1.0)


def _compiled(arm: PoseArm, point: Array, length: float, exact: tuple[Exact, ...]) -> Arm | None:
    """The arm as the core takes it, with a point, the length of a radian and exact demands; None where it cannot."""
    chain, space, wanted = arm.robot, arm.space, compiled_demands(exact)
    if type(chain) is not Chain or wanted is None:  # a class of the user's may be no such chain
        return None
    core = core_for(chain.engine)
    if core is None or len(chain.names) > core.MOST_JOINTS or len(wanted) > core.MOST_ROWS:
        return None
    made: Arm = core.Arm(
        screws=chain.screws,
        home=chain.home,
        point=point,
        length=length,
        lower=space.lower,
        upper=space.upper,
        turn=space.turn,
        whole=space.whole.astype(np.float64),
        exact=wanted,
    )
    return made


# Joint displacement for differences of the gradient: they keep seven digits, and Newton needs one.
DIFFERENCE = 1e-7


class Linearization(NamedTuple):
    """The error in one state of the arm, to first order."""

    q: Array  # (m,) joint positions
    A: Array  # (6, m) a joint step x changes r to r - A x
    r: Array  # (6,) [length]
    f: float  # half of |r|^2
    C: Array | None = None  # (k, m) rows of the exact demands, or None
    b: Array | None = None  # (k,) what they miss, or None

    @property
    def descent(self) -> Array:
        """-grad f, A'r."""
        return np.asarray(self.r.dot(self.A))

    @property
    def unmet(self) -> float:
        """|b|, 0 without exact demands."""
        return 0.0 if self.b is None else sqrt(self.b.dot(self.b))

    @property
    def distance(self) -> float:
        """|r| and |b| together."""
        return sqrt(2.0 * self.f) + self.unmet


class PoseError(NamedTuple):
    """The measure for one arm and one target."""

    robot: Robot  # the arm
    target: Any  # as `robot.target` returned it
    root: Array  # (6, 6) F
    point: Array  # (3,) c, in the tool frame [length]
    # whether W weighs turns about every axis alike; the gradient of f then needs no derivative of the logarithm
    even: bool
    exact: tuple[Exact, ...] = ()  # demands to be met exactly
    compiled: Arm | None = None  # the arm as the compiled core takes it, or None where Python alone has this measure

    @property
    def matrix(self) -> Array:
        """(4, 4) the target."""
        known = getattr(self.target, "pose", None)
        return np.asarray(self.target.homogeneous if known is None else known)

    @property
    def least(self) -> float:
        """The smallest singular value of F, at most 1: |omega| is within a tolerance if |r| is in this share of it."""
        if self.even:  # a diagonal matrix
            return min(1.0, float(self.root[0, 0]))
        return min(1.0, float(np.linalg.svd(self.root, compute_uv=False)[-1]))

    def at(self, q: Array) -> Linearization:
        """The error at joint positions q (m,)."""
        sighting = self.robot.sight(q, self.target)
        omega, J = sighting.error[:3], sighting.J
        here, there = self.robot.points(sighting, self.target, self.point)
        turned = J[:3] if self.even else _log_derivative(omega).dot(J[:3])
        A = self.root.dot(np.concatenate((turned, se3.velocity_at(J, here))))
        r = self.root.dot(np.concatenate((omega, there - here)))
        state = Linearization(q, A, r, 0.5 * float(r.dot(r)))
        if not self.exact:
            return state
        rows = rows_of(self.exact, View(self.robot, sighting, self.target, 1.0, np.zeros(6)))
        return state._replace(C=np.asarray(rows.A), b=np.asarray(rows.b))

    def curvature(self, state: Linearization) -> Array:
        """The (m, m) second derivative of f by differences of grad f, with the absolute values of its eigenvalues."""
        q, m = state.q, len(state.q)
        h = np.where(q + DIFFERENCE > self.robot.position_upper, -DIFFERENCE, DIFFERENCE)
        H = np.array([(state.descent - self.at(q + h[i] * e).descent) / h[i] for i, e in enumerate(np.eye(m))])
        mu, V = np.linalg.eigh(0.5 * (H + H.T))
        return np.asarray((V * np.abs(mu)).dot(V.T))

    def misses(self, q: Array) -> tuple[float, float]:
        """Distance of the tool frame's origin [length] and angle [rad] from the target."""
        if core is not None and self.compiled is not None:
            found: tuple[float, float] | None = core.misses(self.compiled, self.matrix, q)
            if found is not None:
                return found
        sighting = self.robot.sight(q, self.target)
        here, there = self.robot.points(sighting, self.target, np.zeros(3))
        omega, d = sighting.error[:3], there - here
        return sqrt(d.dot(d)), sqrt(omega.dot(omega))


def pose_error(arm: PoseArm, target: Any, form: Form | float | None, exact: tuple[Exact, ...]) -> PoseError:
    """The measure that `form` describes; with an exact demand on a point, c is that point."""
    robot = arm.robot
    wanted = robot.target(target)
    if any(isinstance(demand, ExactJoints) for demand in exact):
        raise BadInput("exact", "ExactJoints", "demands on the pose", "Joint velocities are the controller's business.")
    L = arm.length
    if form is not None:
        chosen = form_of(form)
        if isinstance(chosen, CarriedMetric):  # fixed to the body at the target; its pose is in the base frame
            mid = arm.space.middle
            T = se3.exp(robot.sight(mid, wanted).error, check=False).dot(robot.pose(mid))  # the target as a matrix
            pose, inverse = T if chosen.follows_tool else np.asarray(chosen.pose), T[:3, :3].T
            root = np.linalg.cholesky(np.asarray(chosen.matrix)).T.dot(np.kron(np.eye(2), pose[:3, :3].T))
            return PoseError(robot, wanted, root, inverse.dot(pose[:3, 3] - T[:3, 3]), even=False, exact=exact)
        if not isinstance(chosen, PitchForm) or chosen.h == 0.0:
            found = "h = 0" if isinstance(chosen, PitchForm) else "a complement"
            raise BadInput("form", f"{found}, which measures no distance", "a pitch other than 0, or CarriedMetric")
        L = abs(chosen.h)
    point = next((np.asarray(demand.point) for demand in exact if isinstance(demand, ExactPoint)), arm.point)
    root, compiled = np.diag((L, L, L, 1.0, 1.0, 1.0)), _compiled(arm, point, L, exact)
    return PoseError(robot, wanted, root, point, even=True, exact=exact, compiled=compiled)


def _log_derivative(omega: Array) -> Array:
    """The (3, 3) matrix K of log(exp(omega) exp(-t)) = omega - K t + ..."""
    theta = sqrt(omega.dot(omega))
    W = se3.cross_matrix(omega)
    if theta < se3.SMALL_ANGLE:
        c = (1.0 + theta * theta / 60.0) / 12.0
    else:
        c = (1.0 - 0.5 * theta / tan(0.5 * theta)) / (theta * theta)
    return np.asarray(np.eye(3) + 0.5 * W + c * W.dot(W))
