"""The same tick by the compiled core and by Python, and how far rounding may part the two.

`PYTHONPATH=tests python -m support.two_laws 1000000` compares them on that many random ticks, and says which differ.
"""

import sys
from dataclasses import replace

import numpy as np

import invariantqp as iq
from invariantqp.velocity.compiled import compiled
from invariantqp.velocity.damping import CALM
from invariantqp.velocity.law import Chase, Demand, VelocityLaw
from invariantqp.velocity.reasons import Code
from invariantqp.velocity.solve import solve
from invariantqp.velocity.tick import posed

# The answers agree to this, relative, wherever they are well determined.
AGREE = 1e-10
# An optimum inside limits is determined to rounding times the condition of the Hessian, relative to its distance from
# z*; near a singularity every direction that is damped is, relative to the velocity.
ROUNDING = 64 * np.finfo(float).eps
# Likewise the share of exact rows, alone and beside a speed limit.
SHARE, LOOSE = 1e-8, 1e-6
# A share of exact rows that is rounding of none.
NOTHING_LEFT = 1e-9
SIZES = (1e-60, 1e-6, 1e-3, 1.0, 1.0, 1.0, 1e3, 1e60)
DAMPINGS = (
    iq.velocity.Adaptive(),
    iq.velocity.Adaptive(1e-2, 1e-2),
    iq.velocity.Fixed(0.0),
    iq.velocity.Fixed(1e-3),
    iq.velocity.Selective(),
)


def random_tick(rng):
    """A law and a demand of any kind that the core has, hostile ones among them."""
    m = int(rng.integers(1, 13))
    size = SIZES[rng.integers(len(SIZES))] if rng.random() < 0.3 else 1.0
    J = rng.normal(size=(6, m)) if rng.random() < 0.7 else rng.integers(-2, 3, size=(6, m)).astype(float)
    for _ in range(int(rng.integers(3)) if rng.random() < 0.4 else 0):
        i, j = rng.integers(m, size=2)
        J[:, i] = (J[:, j], -J[:, j], 0.0 * J[:, j], 1e-6 * J[:, i], J[:, j] + 1e-7 * J[:, i])[rng.integers(5)]
    if not J.any():
        J[:, 0] = 1.0
    s = rng.normal(size=6) * 10.0 ** rng.uniform(-4, 2)
    s = (s, s, s, s, J @ rng.normal(size=m), 0.0 * s)[rng.integers(6)]
    speed = 10.0 ** rng.uniform(-3, 2)
    lower, upper = -speed * rng.uniform(0, 1, m), speed * rng.uniform(0, 1, m)
    for i in range(m) if rng.random() < 0.4 else ():
        kind = rng.integers(8)
        if kind == 0:
            lower[i] = upper[i] = (0.0, speed, -speed)[rng.integers(3)]
        elif kind == 1:
            lower[i], upper[i] = 0.5 * upper[i], upper[i]
        elif kind == 2:
            lower[i] = -np.inf
        elif kind == 3:
            upper[i] = np.inf
        elif kind == 4:
            lower[i], upper[i] = -np.inf, np.inf
    posture = rng.normal(size=m) * 10.0 ** rng.uniform(-2, 1) if rng.random() < 0.5 else None
    root = np.eye(6)
    root[3:, :3] = np.cross(np.eye(3), rng.normal(size=3))
    law = random_law(rng, m)
    exact = random_rows(rng, size * J, size * s) if m > 1 and rng.random() < 0.35 else None
    point = rng.normal(size=3)
    slow = iq.limits.ToolSpeed(size * (np.abs(s).max() or 1.0) * 10.0 ** rng.uniform(-1.5, 1.0), point)
    cone = slow.cone(size * J, point) if rng.random() < 0.3 else None
    rows = random_limits(rng, lower, upper) if rng.random() < 0.3 else None
    demand = Demand(size * J, size * s, root, lower, upper, exact, posture, rows, cone)
    return law, chasing(rng, demand) if rng.random() < 0.6 else demand


def chasing(rng, demand):
    """The demand as of a loop: part of the twist closes an error, and the posture rests while the task rests."""
    m, exact = len(demand.lower), demand.exact
    part = (0.0, 0.0, 1.0, rng.uniform(0.0, 1.0), rng.normal(size=6))[rng.integers(5)]
    rows_ahead = None
    if exact is not None:
        rows_ahead = exact.b * (part if np.ndim(part) == 0 else rng.normal(size=len(exact.b)))
    room = demand.upper - demand.lower
    wider = np.where(np.isfinite(room), room, 0.0) * rng.uniform(0.0, 3.0, (2, m)) * (rng.random((2, m)) < 0.8)
    placed = demand.lower - wider[0], demand.upper + wider[1]
    slack = np.linalg.norm(demand.root @ demand.s) * (1e-4, 1e-3, 0.1)[rng.integers(3)]
    chase = Chase(part * demand.s, rows_ahead, *placed, slack, bool(rng.random() < 0.8))
    fastest = 10.0 ** rng.uniform(-2, 1, m) if rng.random() < 0.7 else None
    return demand._replace(chase=chase, fastest=fastest)


def random_law(rng, m):
    """Any damping and tick, with or without a form and a joint metric."""
    law = VelocityLaw(damping=DAMPINGS[rng.integers(len(DAMPINGS))], dt=(0.0, 0.002, 0.1)[rng.integers(3)])
    if rng.random() < 0.3:
        law = replace(law, metric=random_metric(rng, m))
    if rng.random() < 0.4:
        guard = None if rng.random() < 0.2 else iq.velocity.Guard((0.0, 0.5, 0.9, 1.0)[rng.integers(4)])
        law = replace(law, form=random_form(rng), guard=guard)
    return law


class Brought:
    """A form of the user's, by its (6, 6) matrix on twists."""

    def __init__(self, Q):
        self.Q = Q

    def matrix(self, inverse_root):
        return inverse_root.T @ self.Q @ inverse_root

    def describe(self):
        return "a form of the user's"


def random_form(rng):
    """Any pitch, a projection along a few twists, some of them along axes, or a form that is brought."""
    if rng.random() < 0.2:
        root = rng.normal(size=(6, 6))
        return Brought((root * rng.choice([-1.0, 1.0, 1.0], 6)) @ root.T)
    if rng.random() < 0.6:
        return iq.PitchForm(rng.normal() * 10.0 ** rng.uniform(-3, 2))
    count = int(rng.integers(1, 6))
    return iq.Complement(
        rng.normal(size=(6, count)) if rng.random() < 0.6 else np.eye(6)[:, rng.permutation(6)[:count]]
    )


def random_metric(rng, m):
    """Definite, diagonal or not, with axes of sizes up to ten apart."""
    sizes = 10.0 ** rng.uniform(-1.0, 1.0, m)
    Q = np.linalg.qr(rng.normal(size=(m, m)))[0] if rng.random() < 0.5 else np.eye(m)
    return (Q * sizes).dot(Q.T)


def random_limits(rng, lower, upper):
    """Rows of any size, on one side or both, some along a joint or each other, some that standing still violates."""
    m, k = len(lower), int(rng.integers(1, 5))
    C = rng.normal(size=(k, m)) * 10.0 ** rng.uniform(-2, 2)
    kind = rng.integers(6)
    if kind == 0:
        C[0] = np.eye(m)[rng.integers(m)]
    elif kind == 1:
        C[-1] = -C[0]
    elif kind == 2:
        C[0] = 0.0
    width = np.abs(C).dot(np.minimum(upper - lower, 1e3)) * 10.0 ** rng.uniform(-2, 0.5)
    low, high = -width * rng.uniform(0, 1, k), width * rng.uniform(0, 1, k)
    side = rng.integers(8, size=k)
    low, high = np.where(side == 0, -np.inf, low), np.where(side == 1, np.inf, high)
    low = np.where(side == 2, 0.5 * np.minimum(high, width), low)
    return iq.limits.LimitRows(C, low, high)


def random_rows(rng, J, s):
    """Parts of the twist, joints, or both, as demanded or otherwise; some depend on each other, some are too many."""
    m = J.shape[1]
    k = int(rng.integers(1, min(m, 5) + 1))
    b = (1.0, 0.0, rng.normal(size=k))[rng.integers(3)]
    joints = iq.ExactRows(
        np.eye(m)[rng.permutation(m)[:k]], np.abs(s).max() / max(np.abs(J).max(), 1e-300) * b * np.ones(k)
    )
    D = (rng.normal(size=(k, 6)), np.eye(6)[rng.permutation(6)[:k]], np.eye(6)[6 - k :])[rng.integers(3)]
    if rng.random() < 0.05:
        D[0] = D[-1]
    parts = iq.ExactRows.of(J, D, D @ s * b)
    return (parts, parts, parts, joints, joints.with_rows(parts))[rng.integers(5)]


def python_answer(law, demand):
    return solve(replace(law, engine="python"), demand)


def native_answer(law, demand):
    """None where it is handed back."""
    return compiled(law, demand)


def disagreements(law, demand, native, answer):
    """What differs beyond rounding, in words."""
    problem = posed(law, demand, law.damping)
    spread, gradient = spreads(law, problem, demand, native, answer)
    # Far from singular the core does not look whether a closed form touches a bound, nor what exact rows leave free.
    regular = (native.method, native.status, native.reasons) == ("closed-form", "ok", ())
    least = 1e-12
    share, reasons, velocities = SHARE, [native.reasons, answer.reasons], [native.velocity, answer.velocity]
    still = np.clip(np.zeros(len(demand.lower)), demand.lower, demand.upper)
    if answer.scale < 1.0 and (still.any() or answer.status == "degraded"):
        # Counted from the velocity that moves the rows least, which weights 1e-9 apart tell.
        reasons = [[loosely(reason) for reason in found] for found in reasons]
        share, least = LOOSE, LOOSE
        reach = problem.reduction.full + problem.reduction.basis.dot(problem.objective(1.0).centre())
        spread += LOOSE * float(np.abs(reach).max())
    if answer.scale < NOTHING_LEFT:  # more limits meet there than it takes to hold the rows
        reasons = [[without_holders(reason) for reason in found] for found in reasons]
    if demand.cone is not None and answer.scale < 1.0:
        # Weights 1e-9 apart, twice: which limits hold the rows, and how the arm moves within itself, is loosely told.
        share, reasons = LOOSE, [[without_holders(reason) for reason in found] for found in reasons]
        A = demand.root @ demand.J
        velocities, spread = [A @ x for x in velocities], 100.0 * LOOSE * np.linalg.norm(problem.wanted)
        pulls = [y for y in (answer.multipliers, answer.row_multipliers) if y is not None]
        gradient += 1e3 * LOOSE * max((float(np.abs(y).max()) for y in pulls), default=0.0)
    return [
        *([] if near(*velocities, spread) else [f"velocity {native.velocity} {answer.velocity}"]),
        *([] if np.isclose(native.scale, answer.scale, rtol=share, atol=least) else [f"{native.scale} {answer.scale}"]),
        *([] if regular or np.isclose(native.damping, answer.damping, rtol=1e-6, atol=0.0) else ["damping"]),
        *([] if same_pull(law, problem, demand, native, answer, gradient) else ["multipliers"]),
        *([] if native.status == answer.status else ["status"]),
        *([] if same_method(native, answer, gradient) else ["method"]),
        *([] if regular or native.active == answer.active else ["active"]),
        *([] if regular or same_reasons(*reasons) else [f"reason {native.reason!r} {answer.reason!r}"]),
    ]


def same_pull(law, problem, demand, native, answer, gradient):
    """Whether limits pull alike on what exact rows leave free; where more of them meet than there are directions there,
    how it is shared is open.
    """
    if near(native.multipliers, answer.multipliers, gradient) and near(
        native.row_multipliers, answer.row_multipliers, gradient
    ):
        return True
    T = np.eye(len(demand.lower)) if law.to_joint is None else law.to_joint
    pulls = []
    for found in (native, answer):  # without a limit that is met, there are none
        rows = 0.0 if demand.rows is None or found.multipliers is None else demand.rows.C.T @ found.row_multipliers
        pull = T.T @ ((np.zeros(len(T)) if found.multipliers is None else found.multipliers) + rows)
        pulls.append(problem.reduction.basis.T @ pull)
    return near(*pulls, gradient * (1.0 + (0.0 if demand.rows is None else np.abs(demand.rows.C).sum(axis=0).max())))


def same_method(native, answer, gradient):
    """Of a limit that is touched without a pull, rounding tells whether it is met."""
    if {native.method, answer.method} == {"closed-form", "damped"}:
        return native.method == "closed-form" and native.status == "ok"
    pull = max((np.abs(x.multipliers).max() for x in (native, answer) if x.multipliers is not None), default=np.inf)
    return native.method == answer.method or pull <= gradient


def near(one, other, spread):
    return one is other or (one is not None and other is not None and np.abs(one - other).max() <= spread)


def same_reasons(one, other):
    """The same codes, joints and rows, in whichever order rows that pull alike are told; numbers to two digits."""
    data, numbers = (
        [[(r.code, r.joints, sorted(r.rows), r.words) for r in found] for found in (one, other)],
        [[n for r in found for n in sorted(r.numbers)] for found in (one, other)],
    )
    return data[0] == data[1] and np.allclose(*numbers, rtol=0.06, atol=1e-9)


def without_holders(reason):
    """A reason without the limits that hold exact rows."""
    return reason._replace(joints=(), rows=()) if reason.code is Code.ROWS_SLOWED else reason


def loosely(reason):
    """A reason whose share of the exact rows' speed is rounded: it is told to that."""
    return (
        reason._replace(numbers=tuple(round(n, 5) for n in reason.numbers))
        if reason.code is Code.ROWS_SLOWED
        else reason
    )


def spreads(law, problem, demand, native, answer):
    """How far rounding may part two velocities, and two sets of multipliers."""
    objective = problem.objective(answer.scale)
    largest = max(objective.weights.max(initial=0.0), problem.spectrum.largest**2)
    sizes = [native.velocity, answer.velocity, np.zeros(1) if demand.posture is None else demand.posture]
    size = max(float(np.abs(x).max()) for x in sizes)
    T = np.eye(len(demand.lower)) if law.to_joint is None else law.to_joint
    reduction = problem.reduction
    centre = reduction.origin(answer.scale) + reduction.basis.dot(objective.centre())
    far = np.linalg.norm(answer.velocity - T.dot(centre))
    condition = 1.0 if answer.method == "closed-form" else largest / objective.weights.min(initial=largest)
    if demand.exact is not None:
        size += problem.reduction.bend * float(np.abs(problem.reduction.full).max())
    condition *= np.linalg.cond(T) ** 2
    spread = AGREE * size + ROUNDING * condition * (far + size)
    if answer.method == "closed-form" and far > AGREE * size:  # calmed by a residual that is known to rounding
        A = np.linalg.norm(problem.A)
        residual = ROUNDING * (
            np.linalg.norm(problem.wanted) + A * np.linalg.norm(problem.objective(answer.scale).centre())
        )
        bend = problem.reduction.bend
        spread += (
            0.5
            * CALM
            * bend
            * law.dt
            * A
            * residual
            / objective.weights.min(initial=largest)
            * float(np.abs(answer.velocity).max())
        )
    if law.form is not None:  # what it attempts is known to rounding of the twist
        spread += ROUNDING * np.linalg.norm(problem.wanted) / np.sqrt(objective.weights.min(initial=largest))
    gradient = AGREE * largest * far + largest * spread
    if demand.cone is not None and answer.multipliers is not None:  # beside a root that is known to rounding
        gradient += 1e-8 * np.abs(answer.multipliers).max()
    if demand.exact is not None and answer.multipliers is not None:  # of rows that may nearly depend on each other
        gradient += 1e-6 * np.abs(answer.multipliers).max()
    return spread, gradient


def main():
    """Compare many ticks; every one that the core answers has to be inside the box, too."""
    differ = answered = 0
    for seed in range(int(sys.argv[1])):
        law, demand = random_tick(np.random.default_rng(seed))
        native = native_answer(law, demand)
        if native is None:
            continue
        answered += 1
        found = disagreements(law, demand, native, python_answer(law, demand))
        if not ((native.velocity >= demand.lower) & (native.velocity <= demand.upper)).all():
            found.append("outside the box")
        if found:
            differ += 1
            print(seed, *found, flush=True)
    print(f"{answered} answered, {differ} differ")


if __name__ == "__main__":
    main()
