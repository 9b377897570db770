"""Methods as users write them by hand: NumPy and DAQP, with Pinocchio for the arm if it is installed.

    e = log(T^-1 T_target),  s = gain e + feedforward,   in the tool frame, linear part first
    Moore-Penrose   x = x_p + J^+ (s - J x_p)                                                         (Liegeois 1977)
    DLS             J'(J J' + lambda^2 I)^-1 in place of J^+                                           (Wampler 1986)
    LM              (J'J + (|e|^2/2 + eps) I)^-1 (J's + eps x_p)                                      (Sugihara 2011)
    task priority   position, then orientation in its null space, then x_p        (Nakamura 1987; Chiaverini 1997)
    J^{+h}          (J'Q_h J)^-1 J'Q_h s, with the pitch h of a task that has one                                ([DS])
    SNS             a joint that would exceed its limit stays at it, others compensate          (Flacco et al. 2012)
    scaling         maximise alpha with J x = alpha s inside the limits, alpha <= 1; x_p in what is left
    QP              minimise |A x - b|^2 + (eps + mu) |x|^2 - 2 eps x_p'x inside the limits
                    A = J, b = s; with length: velocities of the point, and rotations times the length L
                    mu = 0; with |e|^2: mu = |e|^2/2                                                  (Sugihara 2011)

x_p is the velocity towards the posture, zero for arms with up to six joints unless a task names one. Velocity bounds
keep position limits, with acceleration limits by a braking distance. Velocities of methods without bounds are clipped
joint by joint. eps = 1e-6, the weight of a posture task of Pink's examples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from invariantqp.extras import is_installed
from invariantqp.geometry.arrays import Array
from invariantqp.workbench.compare.method import IN_QP, OTHER_SETTINGS, SCALES, LoopSpec, Method, MethodSetting

EPS = 1e-6
# lambda of DLS: of 0.01, 0.03, 0.1, 0.2 and 0.3 the one that dominates our law in the most tasks.
LAMBDA = 0.2
# Chiaverini's damping begins where the smallest singular value falls below this, and grows to this lambda.
DAMPING_THRESHOLD, MAX_DAMPING = 0.04, 0.05
# Tolerance of singular values relative to the largest, and of limits.
ROUNDING = 1e-9


class TickProblem(NamedTuple):
    """The inputs of a tick, in the tool frame, linear part first."""

    J: Array  # (6, m) joint twists
    e: Array  # (6,) error twist
    s: Array  # (6,) desired twist
    lower: Array  # (m,) bounds of the joint velocities
    upper: Array  # (m,)
    posture_velocity: Array  # (m,) velocity towards the posture


Velocity = Callable[[TickProblem], Array]
# (q, target, feedforward) -> (J, e, feedforward), in the tool frame, linear part first.
Reader = Callable[[Array, Any, "Array | None"], tuple[Array, Array, Array]]


class ByHand:
    """The loop around the function of a tick; by Pinocchio if it is installed and the arm has a URDF."""

    def __init__(self, spec: LoopSpec, velocity: Callable[[LoopSpec], Velocity]) -> None:
        self.spec, self.velocity = spec, velocity(spec)
        by_pinocchio = spec.urdf and is_installed("pinocchio")
        self.target, self.read = _by_pinocchio(spec) if by_pinocchio else _by_robot(spec)

    def step(self, q: Array, target: Any, feedforward: Array | None, previous: Array) -> Array:
        """One tick: joint velocities (m,)."""
        spec = self.spec
        J, e, twist = self.read(q, target, feedforward)
        lower, upper = self.bounds(q, previous)
        return self.velocity(
            TickProblem(J, e, spec.gain * e + twist, lower, upper, spec.posture_gain * (spec.posture - q))
        )

    def bounds(self, q: Array, previous: Array) -> tuple[Array, Array]:
        """(m,) lower and upper velocities that keep the limits, with acceleration limits by the braking distance.

        A joint that brakes from v by a dt a tick moves at most v^2 / (2 a) + v dt / 2 + a dt^2 / 8 further.
        """
        spec, fastest = self.spec, self.spec.velocity_limit
        down, up = spec.lower - q, spec.upper - q
        lower, upper = down / spec.dt, up / spec.dt
        if spec.acceleration_limit is not None:
            a, half = spec.acceleration_limit, 0.5 * spec.acceleration_limit * spec.dt
            least = 0.25 * half * spec.dt
            lower = np.maximum(lower, half - np.sqrt(half * half + 2.0 * a * np.maximum(-down - least, 0.0)))
            upper = np.minimum(upper, np.sqrt(half * half + 2.0 * a * np.maximum(up - least, 0.0)) - half)
        lower, upper = (np.minimum(np.maximum(side, -fastest), fastest) for side in (lower, upper))
        if spec.acceleration_limit is not None:
            low, high = previous - 2.0 * half, previous + 2.0 * half
            lower, upper = (np.minimum(np.maximum(side, low), high) for side in (lower, upper))
        return lower, upper


def _by_pinocchio(spec: LoopSpec) -> tuple[Callable[[Array, Any], Any], Reader]:
    import pinocchio as pin

    model = pin.buildModelFromXML(spec.urdf)
    data, frame = model.createData(), model.getFrameId("tool")

    def read(q: Array, target: Any, feedforward: Array | None) -> tuple[Array, Array, Array]:
        pin.computeJointJacobians(model, data, q)
        tool = pin.updateFramePlacement(model, data, frame)
        J = pin.getFrameJacobian(model, data, frame, pin.LOCAL)
        twist = np.zeros(6)
        if feedforward is not None:
            twist = tool.actInv(pin.Motion(feedforward[3:], feedforward[:3])).vector
        return J, pin.log6(tool.actInv(target)).vector, twist

    return lambda pose, _: pin.SE3(pose), read


def _by_robot(spec: LoopSpec) -> tuple[Callable[[Array, Any], Any], Reader]:
    from invariantqp.geometry import se3
    from invariantqp.robots.chain import Chain

    arm = Chain(spec.screws, spec.home)

    def read(q: Array, target: Any, feedforward: Array | None) -> tuple[Array, Array, Array]:
        state = arm.state(q, target)
        to_tool = se3.adjoint(se3.inverse(state.pose, check=False), check=False)[se3.SWAPPED]
        twist = np.zeros(6) if feedforward is None else to_tool.dot(feedforward)
        return to_tool.dot(state.J), to_tool.dot(state.error), twist

    return lambda pose, _: arm.target(pose) if np.isfinite(pose).all() else pose, read


def clipped(x: Array, tick: TickProblem) -> Array:
    """Joint velocities clipped to the bounds, joint by joint."""
    return np.minimum(np.maximum(x, tick.lower), tick.upper)


def moore_penrose(_: LoopSpec) -> Velocity:
    """The pseudoinverse by numpy (Liegeois 1977)."""

    def velocity(tick: TickProblem) -> Array:
        x = tick.posture_velocity + np.linalg.pinv(tick.J).dot(tick.s - tick.J.dot(tick.posture_velocity))
        return clipped(x, tick)

    return velocity


def damped(_: LoopSpec, factor: float = LAMBDA) -> Velocity:
    """Damped least squares (Wampler 1986; Nakamura & Hanafusa 1986)."""

    def velocity(tick: TickProblem) -> Array:
        A = tick.J.dot(tick.J.T)
        A.flat[::7] += factor**2
        x = tick.posture_velocity + tick.J.T.dot(np.linalg.solve(A, tick.s - tick.J.dot(tick.posture_velocity)))
        return clipped(x, tick)

    return velocity


def levenberg_marquardt(_: LoopSpec) -> Velocity:
    """Levenberg and Marquardt, damped by the error (Sugihara 2011)."""

    def velocity(tick: TickProblem) -> Array:
        H = tick.J.T.dot(tick.J)
        H.flat[:: len(H) + 1] += 0.5 * tick.e.dot(tick.e) + EPS
        return clipped(np.linalg.solve(H, tick.J.T.dot(tick.s) + EPS * tick.posture_velocity), tick)

    return velocity


def chiaverini(J: Array) -> Array:
    """The pseudoinverse, damped along the direction of the smallest singular value where that is small."""
    U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
    divisor = sigma * sigma
    near = sigma < DAMPING_THRESHOLD
    divisor[near] += MAX_DAMPING**2 * (1.0 - (sigma[near] / DAMPING_THRESHOLD) ** 2)
    return np.asarray((Vt.T * (sigma / divisor)).dot(U.T))


def priority(spec: LoopSpec) -> Velocity:
    """Position before orientation (Nakamura 1987; Chiaverini 1997)."""
    eye = np.eye(len(spec.names))

    def velocity(tick: TickProblem) -> Array:
        x, N = np.zeros(len(eye)), eye
        for rows in (slice(3), slice(3, 6)):
            A = tick.J[rows].dot(N)
            x = x + N.dot(chiaverini(A).dot(tick.s[rows] - tick.J[rows].dot(x)))
            N = N - np.linalg.pinv(A, rcond=ROUNDING).dot(A)
        return clipped(x + N.dot(tick.posture_velocity), tick)

    return velocity


def hyperbolic(spec: LoopSpec) -> Velocity:
    """The h-pseudoinverse as [DS] defines it, where it exists."""
    Q = np.zeros((6, 6))  # linear part first
    Q[:3, 3:] = Q[3:, :3] = np.eye(3)
    Q[3:, 3:] = -2.0 * spec.law["form"] * np.eye(3)

    def velocity(tick: TickProblem) -> Array:
        rows = tick.J.T.dot(Q)
        return clipped(np.linalg.solve(rows.dot(tick.J), rows.dot(tick.s)), tick)

    return velocity


def saturation(_: LoopSpec) -> Velocity:
    """Saturation in the null space (Flacco, De Luca & Khatib 2012, Algorithm 1)."""
    return lambda tick: saturate(tick)[0]


def saturate(tick: TickProblem) -> tuple[Array, float]:
    """Joint velocities (m,) inside the bounds, and the scale alpha of s that they achieve."""
    J, s, lower, upper = tick.J, tick.s, tick.lower, tick.upper
    size, m = float(np.linalg.norm(J, 2)), J.shape[1]
    free, fixed = np.ones(m, dtype=bool), tick.posture_velocity.copy()
    best, best_scale = clipped(np.zeros(m), tick), 0.0
    full = _rank(J, size)
    while _rank(J * free, size) == full:
        inverse = np.linalg.pinv(J * free, rcond=ROUNDING)
        along = inverse.dot(s)
        offset = fixed - inverse.dot(J.dot(fixed))
        x = along + offset
        if not ((x < lower - ROUNDING) | (x > upper + ROUNDING)).any():
            return clipped(x, tick), 1.0
        scale, critical = _largest_scale(along, offset, lower, upper)
        if scale > best_scale:
            best, best_scale = clipped(scale * along + offset, tick), scale
        if not free[critical]:
            break
        free[critical] = False
        fixed[critical] = upper[critical] if x[critical] > upper[critical] else lower[critical]
    return best, best_scale


def _largest_scale(along: Array, offset: Array, lower: Array, upper: Array) -> tuple[float, int]:
    """The largest alpha in [0, 1] with lower <= alpha along + offset <= upper, and the joint that limits it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack(((lower - offset) / along, (upper - offset) / along))
    unmoved = along == 0.0
    ends[0, unmoved], ends[1, unmoved] = -np.inf, np.inf
    low, high = np.minimum(*ends), np.maximum(*ends)
    critical = int(np.argmin(high))
    largest, smallest = min(1.0, float(high[critical])), max(0.0, float(low.max()))
    return (largest if smallest <= largest else 0.0), critical


def _rank(A: Array, size: float) -> int:
    return int(np.count_nonzero(np.linalg.svd(A, compute_uv=False) > ROUNDING * size))


def _daqp(H: Array, f: Array, rows: Array, upper: Array, lower: Array, sense: Any) -> Array:
    import daqp

    x, _, flag, _ = daqp.solve(H, f, rows, upper, lower, sense)
    if flag <= 0:
        raise RuntimeError(f"DAQP: exit flag {flag}")
    return np.asarray(x)


def scaling(spec: LoopSpec) -> Velocity:
    """The largest share of the twist in its own direction, by DAQP.

    With fewer than six joints it is a share of what they can do of the twist. The share weighs a million times as much
    as the posture.
    """
    m, weight = len(spec.names), 1e-3
    k = min(m, 6)
    H, sense = np.diag(np.r_[np.full(m, weight), 1.0 / weight]), np.r_[np.zeros(m + 1), np.full(k, 5)].astype(np.int32)

    def velocity(tick: TickProblem) -> Array:
        A, b = tick.J, tick.s
        if m < 6:
            Q = np.linalg.qr(A)[0]
            A, b = Q.T.dot(A), Q.T.dot(b)
        f = -np.r_[weight * tick.posture_velocity, 1.0 / weight]
        lower, upper = np.r_[tick.lower, np.zeros(1 + k)], np.r_[tick.upper, 1.0, np.zeros(k)]
        return _daqp(H, f, np.column_stack((A, -b)), upper, lower, sense)[:m]

    return velocity


def qp(spec: LoopSpec, *, length: bool = False, by_error: bool = False) -> Velocity:
    """Pinocchio and DAQP: least squares inside the limits."""
    m = len(spec.names)
    rows, sense = np.zeros((0, m)), np.zeros(m, dtype=np.int32)
    root = np.eye(6)
    if length:
        x, y, z = spec.point
        root[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]  # the velocity of the point
        root[3:, 3:] *= spec.length

    def velocity(tick: TickProblem) -> Array:
        A, b = (root.dot(tick.J), root.dot(tick.s)) if length else (tick.J, tick.s)
        mu = 0.0
        if by_error:
            e = root.dot(tick.e) if length else tick.e
            mu = 0.5 * e.dot(e)
        H = A.T.dot(A)
        H.flat[:: m + 1] += EPS + mu
        return _daqp(H, -A.T.dot(b) - EPS * tick.posture_velocity, rows, tick.upper, tick.lower, sense)

    return velocity


def method(name: str, velocity: Callable[..., Velocity], *setting: str, family: str = "by hand", **more: Any) -> Method:
    """The method of a function of a tick; `more` are arguments of that function."""

    def loop(spec: LoopSpec) -> ByHand:
        return ByHand(spec, partial(velocity, **more))

    loop.__doc__ = velocity.__doc__
    return Method(name, family, loop, MethodSetting(*setting))


CLIPPED, BY_ERROR = "clipped to them", "|e|^2/2 + 1e-6"
GIVEN = "added", "given, with length"
METHODS = [
    method("Moore-Penrose", moore_penrose, "in the null space", CLIPPED, "none"),
    method("DLS", damped, "in the damped null space", CLIPPED, f"lambda = {LAMBDA:g}"),
    method("LM", levenberg_marquardt, "weight 1e-6", CLIPPED, BY_ERROR),
    replace(method("J^{+h}", hyperbolic, "none", CLIPPED, "none", "added", "not needed"), needs_pitch=True),
    method("SNS", saturation, "in the null space", SCALES, "none"),
    method("task priority", priority, "last priority", CLIPPED, "along small singular values, to 0.05"),
    method("scaling", scaling, "in what is left", SCALES, "none"),
    method("QP", qp, "weight 1e-6", IN_QP, "1e-6"),
    method("QP with length", qp, "weight 1e-6", IN_QP, "1e-6", *GIVEN, length=True),
    method("QP with |e|^2", qp, "weight 1e-6", IN_QP, BY_ERROR, by_error=True),
    method("QP with both", qp, "weight 1e-6", IN_QP, BY_ERROR, *GIVEN, length=True, by_error=True),
    *(
        method(f"DLS, lambda {x}", damped, "in the damped null space", CLIPPED, f"{x}", family=OTHER_SETTINGS, factor=x)
        for x in (0.01, 0.03, 0.1, 0.3)
    ),
]
