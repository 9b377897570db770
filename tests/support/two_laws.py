"""The same tick by the compiled core and by Python, and how far rounding of its data may part the two.

`PYTHONPATH=tests python -m support.two_laws 1000000 [FIRST]` compares them on that many random ticks, by seeds from
FIRST on, and says which differ.
"""

import sys
from dataclasses import replace

import numpy as np

import invariantqp as iq
from invariantqp.legacy.compiled import compiled
from invariantqp.legacy.damping import Adaptive, Fixed, Selective
from invariantqp.legacy.law import Chase, Demand, VelocityLaw
from invariantqp.legacy.solve import solve
from invariantqp.legacy.tick import posed
from invariantqp.velocity.solution import ACTIVE_TOLERANCE, SLOWEST

# Velocity, the share of exact rows and what limits pull agree to this, relative to the largest.
AGREE = 1e-8
# Joints slower than that stand still, for the law (`report.is_met`) and here [rad/s].
STILL = ACTIVE_TOLERANCE * SLOWEST
# The data of a tick are told to this, in each of so many versions, and more where these are not far enough apart.
ROUNDED, TIMES = 4 * np.finfo(float).eps, (64, 1024)
SIZES = (1e-60, 1e-6, 1e-3, 1.0, 1.0, 1.0, 1e3, 1e60)
DAMPINGS = (
    Adaptive(),
    Adaptive(1e-2, 1e-2),
    Fixed(0.0),
    Fixed(1e-3),
    Selective(),
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
    demand = demand._replace(chase=chase, fastest=fastest)
    if fastest is None or rng.random() < 0.5:
        return demand
    return demand._replace(before=rng.normal(size=m) * fastest, change=10.0 ** rng.uniform(-3, 0, m) * fastest)


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
    """What differs, in words: by more than `AGREE`, and by more than the definition's answers to data that are rounded.

    An answer that its data do not tell to `AGREE`, near a singularity or where more limits meet than it takes to hold
    the joints, has to be as near to the definition as that is to itself.
    """
    problem = posed(law, demand, law.damping)
    if not different(law, problem, demand, native, [answer]):
        return []
    rng, answers, found = np.random.default_rng(0), [answer], []
    for times in TIMES:
        answers += [python_answer(*rounded(rng, law, demand)) for _ in range(times)]
        found = different(law, problem, demand, native, answers)
        if not found:
            break
    return found


def different(law, problem, demand, native, answers):
    """What of an answer differs from the first of some, and is not as near to it as the others are."""
    first = answers[0]
    size = float(max(np.abs(native.velocity).max(), np.abs(first.velocity).max()))
    basis = (np.eye(len(first.velocity)) if law.to_joint is None else law.to_joint) @ problem.reduction.basis
    pulls = [pull(basis, demand, x) for x in (native, *answers)]
    weight = max(problem.objective(first.scale).weights.max(initial=0.0), problem.spectrum.largest**2)
    hardest = float(np.abs(pulls[:2]).max(initial=0.0)) + weight * size
    slowed = slowing(basis, demand.cone, first.velocity)
    found = [
        f"{name} {one} {others[0]}"
        for name, (one, *others), scale in (
            ("velocity", [x.velocity for x in (native, *answers)], max(size, STILL / AGREE)),
            ("scale", [x.scale for x in (native, *answers)], 1.0),
            ("pull", [p - slowed * (slowed @ (p - pulls[1])) for p in pulls], hardest),
        )
        if not apart(one, others[0]) <= max(AGREE * scale, *(apart(x, others[0]) for x in others))
    ]
    found += [
        f"{name} {getattr(native, name)} {getattr(first, name)}"
        for name in ("status", "active")
        if all(getattr(native, name) != getattr(x, name) for x in answers)
    ]
    if not any(same_reasons(native.reasons, x.reasons) for x in answers):
        found.append(f"reason {native.reason!r} {first.reason!r}")
    return found


def apart(one, other):
    """The largest difference."""
    return float(np.abs(np.subtract(one, other)).max(initial=0.0))


def pull(basis, demand, found):
    """How limits pull on what exact rows leave free; how they share it is open where more of them meet."""
    all_of_them = np.zeros(len(found.velocity)) if found.multipliers is None else found.multipliers
    if found.row_multipliers is not None:
        all_of_them = all_of_them + demand.rows.C.T @ found.row_multipliers
    return basis.T @ all_of_them


def slowing(basis, cone, velocity):
    """The direction in which the tool's speed pulls, whose share is not told; zero where it does not."""
    if cone is None or cone.speed(velocity) < cone.limit * (1.0 - ACTIVE_TOLERANCE):
        return np.zeros(basis.shape[1])
    slowed = basis.T @ cone.J.T @ cone.velocity(velocity)
    return slowed / (np.linalg.norm(slowed) or 1.0)


def rounded(rng, law, demand):
    """Law and demand with each number changed by four roundings; zeros, and what joints leave no room, stay.

    A metric that mixes joints mixes their roundings in J, too: those of a row are then relative to the row.
    """

    def change(a):
        return None if a is None else np.asarray(a) * (1.0 + ROUNDED * rng.choice((-1.0, 1.0), np.shape(a)))

    J = change(demand.J)
    if law.metric is not None and np.count_nonzero(law.metric) > len(law.metric):
        J = demand.J + ROUNDED * np.linalg.norm(demand.J, axis=1, keepdims=True) * rng.choice((-1.0, 1.0), J.shape)
    if law.metric is not None:
        metric = change(law.metric)
        law = replace(law, metric=0.5 * (metric + metric.T))
    joints, exact, rows, cone, chase = np.ones(len(demand.lower)), demand.exact, demand.rows, demand.cone, demand.chase
    joints = change(joints)
    if exact is not None:
        D = np.zeros((len(exact.b), 6)) if exact.of_twist is None else exact.of_twist
        A = np.where(D.any(axis=1, keepdims=True), D @ J, change(exact.A))
        exact = iq.ExactRows(A, change(exact.b), exact.of_twist)
    if rows is not None:
        size = change(np.ones(len(rows.C)))
        rows = iq.limits.LimitRows(change(rows.C), size * rows.lower, size * rows.upper)
    if cone is not None:
        cone = cone._replace(J=change(cone.J), limit=float(change(cone.limit)))
    if chase is not None:
        ahead, rows_ahead, slack = change(chase.ahead), change(chase.rows_ahead), float(change(chase.slack))
        chase = chase._replace(ahead=ahead, rows_ahead=rows_ahead, slack=slack)
        chase = chase._replace(lower=joints * chase.lower, upper=joints * chase.upper)
    return law, demand._replace(
        J=J, s=change(demand.s), root=change(demand.root), posture=change(demand.posture), lower=joints * demand.lower,
        upper=joints * demand.upper, exact=exact, rows=rows, cone=cone, chase=chase,
    )  # fmt: skip


def same_reasons(one, other):
    """The same codes, joints and rows, in whichever order rows that pull alike are told; numbers to two digits."""
    data, numbers = (
        [[(r.code, r.joints, sorted(r.rows), r.words) for r in found] for found in (one, other)],
        [[n for r in found for n in sorted(r.numbers)] for found in (one, other)],
    )
    return data[0] == data[1] and np.allclose(*numbers, rtol=0.06, atol=1e-9)


def main():
    """Compare many ticks; every one that the core answers has to be inside the box, too."""
    differ = answered = 0
    count, first = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    for seed in range(first, first + count):
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
