"""The minimum that the law publishes, modelled once more in CVXPY from its formulas, and solved by Clarabel."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.optimize import linprog
from support.repeats import repeats
from support.velocity_reference import CALM, DEVIATION, LIMITED, QUIET, adaptive

import invariantqp as iq
from invariantqp.engine import core
from invariantqp.legacy.law import Chase, Demand, VelocityLaw
from invariantqp.legacy.solve import solve

# Tighter than it gets in every case, and then it says so; the comparison decides.
pytestmark = pytest.mark.filterwarnings("ignore:Solution may be inaccurate")

POSTURE_PACE, PROGRESS, LEAST_WORTH, EASY, SLOWEST = 0.01, 2e-4, 2e-5, 3.0, 1e-6


cp = None


@pytest.fixture(autouse=True, scope="module")
def cvxpy():
    """Loaded where it is used: it takes a second, and every process collects every test."""
    globals()["cp"] = pytest.importorskip("cvxpy")


def random_case(rng):
    """Any of: few or many joints, a singularity nearby, exact rows, rows, a tool speed, a chase, a posture, calm.

    Of few joints some are asked for what they hardly do at all.
    """
    m, reach = int(rng.integers(3, 9)), 0.6
    J = rng.normal(size=(6, m))
    if rng.random() < 0.3:
        J[:, -1] = J[:, 0] + 10.0 ** rng.uniform(-3.0, -1.5) * J[:, -1]
    root = iq.adjoint(iq.transform(translation=rng.normal(size=3))) * np.repeat([reach, 1.0], 3)[:, None]
    s = rng.normal(size=6)
    fast = float(np.abs(np.linalg.lstsq(J, s, rcond=None)[0]).max())
    side = fast * rng.uniform(0.2, 1.0, (2, m)) * rng.choice((0.5, 1.0, 4.0))
    chase, rows, exact, cone, dt = None, None, None, None, 0.0
    k = int(rng.integers(1, min(m - 1, 3) + 1)) if rng.random() < 0.4 else 0
    if k:
        D = np.eye(6)[6 - k :]
        exact = iq.ExactRows.of(J, D, D @ s)
    elif rng.random() < 0.5:
        dt = 0.01
    if rng.random() < 0.7:
        part, wide = rng.uniform(0.0, 0.9), rng.uniform(0.5, 3.0, (2, m))
        slack = 3e-3 * np.linalg.norm(root @ s)
        chase = Chase(part * s, part * exact.b if k else None, -wide[0] * side[0], wide[1] * side[1], slack, apart=True)
        chase = chase._replace(lower=np.minimum(chase.lower, -side[0]), upper=np.maximum(chase.upper, side[1]))
    if rng.random() < 0.4:
        C = rng.normal(size=(2, m))
        wide = fast * rng.uniform(0.3, 1.5, 2)
        rows = iq.limits.LimitRows(C, -wide, 0.7 * wide)
    if not k and rng.random() < 0.2:
        cone = iq.limits.ToolSpeed(rng.uniform(0.1, 0.8) * np.linalg.norm(s[3:]), np.zeros(3)).cone(J, np.zeros(3))
    posture = fast * rng.normal(size=m) if rng.random() < 0.6 else None
    fastest = np.full(m, fast) if rng.random() < 0.7 else None
    if m < 6 and chase is not None and not k and rng.random() < 0.5:
        A, b = root @ J, root @ s
        here = (1.0 - 10.0 ** rng.uniform(-5.0, -2.0)) * A @ np.linalg.lstsq(A, b, rcond=None)[0]
        s = np.linalg.solve(root, b - here)
        chase = chase._replace(ahead=part * s)
    demand = Demand(J, s, root, -side[0], side[1], exact, posture, rows, cone, None, chase, fastest)
    if fastest is not None and rng.random() < 0.5:
        demand = demand._replace(before=fast * rng.normal(size=m), change=fast * 10.0 ** rng.uniform(-2.0, 0.5, m))
    return VelocityLaw(dt=dt), demand


def clarabel(problem):
    """As tight as it gets: it may fail at tolerances that only some problems allow."""
    for tight in (1e-13, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8):
        try:
            problem.solve(solver="CLARABEL", tol_feas=tight, tol_gap_abs=tight, tol_gap_rel=tight, max_iter=200)
        except cp.SolverError:
            continue
        if problem.status == "optimal":
            return
    raise cp.SolverError("no answer at any tolerance")


class Published:
    """The law of one demand at a share of the exact rows' speed, in z: x = share x0 + B z."""

    def __init__(self, demand, share):
        self.demand, m = demand, demand.J.shape[1]
        self.A, self.b = demand.root @ demand.J, demand.root @ demand.s
        rows = demand.exact
        self.C, self.e = (np.zeros((0, m)), np.zeros(0)) if rows is None else (rows.A, rows.b)
        self.share, self.B = share, np.eye(m) if rows is None else null_space(self.C)
        self.AB = self.A @ self.B
        largest = np.linalg.svd(self.A, compute_uv=False)[0]
        U, sigma, Vt = np.linalg.svd(self.AB)
        sigma = np.append(sigma, np.zeros(len(Vt) - len(sigma)))
        self.spectrum = U, sigma, Vt, largest
        self.damps(np.array([adaptive(value, largest, *LIMITED) for value in sigma]))

    def damps(self, squares):
        self.squares = squares
        self.damping = np.sqrt(squares)[:, None] * self.spectrum[2]
        self.root = np.vstack((self.AB, self.damping))

    def eased(self, posture):
        """A chase is damped as far as what it needs of weak directions exceeds EASY times what others could do."""
        U, sigma, Vt, largest = self.spectrum
        k = min(6, len(sigma))
        x0 = self.share * np.linalg.pinv(self.C) @ self.e
        still = np.zeros(len(Vt)) if posture is None else self.B.T @ (posture - x0)
        moving = np.clip(sigma[:k] / (1e-12 * largest) - 1.0, 0.0, 1.0)
        needed = moving * (U.T[:k] @ (self.share * self.b - self.A @ x0) - sigma[:k] * (Vt[:k] @ still))
        weak = np.sqrt(self.squares[:k]) / (LIMITED[1] * largest)
        size = np.sum(weak * needed**2) + (SLOWEST * largest) ** 2
        self.damps(self.squares * size / (size + (EASY * sigma / largest) ** 2 * np.sum(needed**2)))

    def centre(self, twist, demands, share=1.0, posture=None):
        """What is minimised, |root z - target|, and where without limits."""
        x0 = np.linalg.pinv(self.C) @ demands
        wanted = np.zeros(len(x0)) if posture is None else posture - share * x0
        target = np.append(share * (self.demand.root @ twist - self.A @ x0), self.damping @ self.B.T @ wanted)
        return share * x0, target, np.linalg.lstsq(self.root, target, rcond=None)[0]

    def posture(self):
        demand, chase = self.demand, self.demand.chase
        if demand.posture is None:
            return None
        if demand.fastest is None:
            return self.share * demand.posture
        s, e = demand.s, self.e
        if chase is not None:
            size = np.linalg.norm(demand.root @ (s - chase.ahead))
            steady = max(0.0, 1.0 - (chase.slack / size) ** 2) if size > 0.0 else 0.0
            s = chase.ahead + steady * (s - chase.ahead)
            e = e if chase.rows_ahead is None else chase.rows_ahead + steady * (e - chase.rows_ahead)
        x0, _, z = self.centre(s, e)
        t = (np.abs(x0 + self.B @ z) / demand.fastest).max()
        posture = t**2 / (t**2 + POSTURE_PACE**2) * demand.posture
        if demand.before is not None:  # what is followed of it changes joint velocities by at most `change`
            _, sigma, Vt, _ = self.spectrum
            V, way = self.B @ Vt.T, posture - demand.before
            d = V @ (self.squares / (sigma**2 + self.squares) * (V.T @ way))
            posture = demand.before + way / max(1.0, (np.abs(d) / demand.change).max())
        return self.share * posture

    def limits(self, z, origin, lower, upper, everything):
        """Constraints on z; its velocities are origin + B z."""
        x, demand = origin + self.B @ z, self.demand
        found = [x >= lower, x <= upper]
        if demand.rows is not None:
            found += [demand.rows.C @ x >= demand.rows.lower, demand.rows.C @ x <= demand.rows.upper]
        if demand.cone is not None and everything:
            found += [cp.norm(demand.cone.J @ x, 2) <= demand.cone.limit]
        return found

    def velocity(self, dt):
        demand, chase = self.demand, self.demand.chase
        posture = self.wanted = self.posture()
        if chase is not None:
            self.eased(posture)
        origin, target, free = self.centre(demand.s, self.e, self.share, posture)
        if demand.allows(origin + self.B @ free):
            z, slowed, pace = free, 0.0, 1.0
        else:
            z, slowed, pace = (
                self.slowed(origin, target, free, dt) if chase else (self.nearest(origin, target), 0.0, 1.0)
            )
        mu = self.calm(origin + self.B @ (z + slowed), z, dt)
        if mu > 0.0:
            z = self.nearest(origin, self.paced(target, pace), mu=mu)
        return origin + self.B @ z

    def missed(self, x):
        origin, target, _ = self.centre(self.demand.s, self.e, self.share, self.wanted)
        return np.sum((self.root @ (self.B.T @ (x - origin)) - target) ** 2)

    def paced(self, target, pace):
        if self.demand.chase is None:
            return target
        ahead = self.demand.root @ self.demand.chase.ahead
        return np.append(target[:6] - self.share * (1.0 - pace) * (self.b - ahead), target[6:])

    def slowed(self, origin, target, free, dt):
        demand, chase = self.demand, self.demand.chase
        box = chase.lower, chase.upper
        mu = self.calm(origin + self.B @ free, np.zeros(len(free)), dt)
        z1 = self.nearest(origin, target, box, mu)
        x1 = origin + self.B @ z1
        size = 1e-9 * np.abs(x1).max()
        slow = demand.cone is None or np.linalg.norm(demand.cone.J @ x1) <= demand.cone.limit * (1.0 + 1e-9)
        if ((x1 >= demand.lower - size) & (x1 <= demand.upper + size)).all() and slow:
            return z1 if mu == 0.0 else self.nearest(origin, target), 0.0, 1.0
        z0 = self.nearest(origin, self.paced(target, 0.0), box, mu)
        still = np.sqrt(mu) * np.eye(len(z1)) if mu > 0.0 else np.zeros((0, len(z1)))  # rows of zeros cost digits
        K, way = np.vstack((self.root, still)), z1 - z0
        length = np.linalg.norm(K @ way)
        if length <= 1e-12 * np.linalg.norm(K @ z1):  # nothing of the chase is left to be slowed
            return self.nearest(origin, target), 0.0, 1.0
        z, p, pace = cp.Variable(len(z1)), cp.Variable(), 1.0
        missed = cp.sum_squares((K @ (z - z0) - p * (K @ way)) / length) / 2.0
        limits = self.limits(z, origin, demand.lower, demand.upper, everything=True)
        for _ in range(2):  # what may be missed of a slowed chase is its share of the slack
            delta = pace * chase.slack + self.share * np.linalg.norm(demand.root @ chase.ahead)
            clarabel(cp.Problem(cp.Minimize(missed + delta / length * (1.0 - p)), [*limits, p >= 0.0, p <= 1.0]))
            pace = float(np.clip(p.value, 0.0, 1.0))
        far = [np.linalg.lstsq(self.root, self.paced(target, q), rcond=None)[0] for q in (1.0, pace)]
        return self.nearest(origin, self.paced(target, pace)), far[0] - far[1], pace

    def nearest(self, origin, target, box=None, mu=0.0):
        demand = self.demand
        lower, upper = (demand.lower, demand.upper) if box is None else box
        z = cp.Variable(self.B.shape[1])
        root, wanted = (
            np.vstack((self.root, np.sqrt(mu) * np.eye(len(self.B.T)))),
            np.append(target, np.zeros(len(self.B.T))),
        )
        size = np.linalg.norm(wanted)
        limits = self.limits(z, origin, lower, upper, everything=box is None)
        clarabel(cp.Problem(cp.Minimize(cp.sum_squares((root @ z - wanted) / size)), limits))
        return z.value

    def calm(self, x, z, dt):
        if dt == 0.0:
            return 0.0
        size = np.linalg.norm(self.A)
        moving = np.linalg.svd(self.AB)[2][: min(6, len(z))] @ z
        excess = max(0.0, DEVIATION * dt * size * (moving @ moving) - np.linalg.norm(self.b))
        error = np.linalg.norm(self.b - self.A @ x) + excess
        return max(0.0, 0.5 * CALM * dt * error * size / self.worth() - QUIET * size**2)

    def worth(self):
        demand, chase = self.demand, self.demand.chase
        if chase is None or demand.fastest is None:
            return 1.0
        A, b, v = demand.root @ demand.J, self.b, demand.fastest
        box = np.column_stack((np.maximum(chase.lower, -v), np.minimum(chase.upper, v)))
        nearer = -linprog(-(b @ A), bounds=box).fun
        kappa = nearer / (np.linalg.norm(b) * np.linalg.norm(A, axis=0) @ v)
        return max(1.0 - (PROGRESS / kappa) ** 2, LEAST_WORTH) if kappa > PROGRESS else LEAST_WORTH


def test_the_answer_is_the_published_minimum():
    engines = ["python", "compiled"] if core else ["python"]
    apart, seen, unsolved = {engine: [] for engine in engines}, [], 0
    for seed in range(repeats(1000, 60)):
        law, demand = random_case(np.random.default_rng(seed))
        solutions = {engine: solve(replace(law, engine=engine), demand) for engine in engines}
        solution = solutions["python"]
        try:
            published = Published(demand, solution.scale)
            expected = published.velocity(law.dt)
        except cp.SolverError:  # a chase, or rows at the largest share, that limits leave hardly any room
            unsolved += 1
            continue
        for engine, found in solutions.items():
            assert found.scale == pytest.approx(solution.scale, rel=1e-8)
            apart[engine].append(np.abs(found.velocity - expected).max() / np.abs(expected).max())
            if law.dt == 0.0 and demand.chase is None:  # one problem: ours is inside, and misses no more
                ours, theirs = published.missed(found.velocity), published.missed(expected)
                assert ours <= theirs + 1e-9 * np.linalg.norm(published.b) ** 2
                assert demand.cone is None or demand.cone.speed(found.velocity) <= demand.cone.limit * (1.0 + 1e-12)
        slowed = ["slowed"] if "the approach's speed" in solution.reason else []
        seen += [solution.method, str(solution.status), *slowed]
        if demand.exact is not None:
            assert solution.scale == pytest.approx(largest_share(demand), rel=2e-6)
    for (
        each
    ) in apart.values():  # Clarabel's accuracy: the root of its gap by the smallest curvature, most at a tool speed
        assert np.max(each) < 1e-5
        assert np.median(each) < 1e-10
    assert unsolved < 0.03 * len(apart["python"])
    for what in ("qp", "closed-form", "scaled", "limited", "ok", "slowed"):
        assert seen.count(what) > 3, what


@pytest.mark.parametrize("engine", ["python", "compiled"] if core else ["python"])
def test_the_published_pace_of_what_is_calmed(engine):
    """Joints along three axes, one of them stretched, and a turn that none can do: each joint by itself."""
    law, dt, slack, whole = VelocityLaw(dt=0.01, engine=engine), 0.01, 1e-3, 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        sigma = np.array([1.0, 0.7, 10.0 ** rng.uniform(-1.9, -1.0)])
        b = np.append(rng.uniform(0.5, 3.0, 3), rng.uniform(-1.0, 1.0, 3))
        J, limit = np.vstack((np.zeros((3, 3)), np.diag(sigma))), rng.uniform(0.2, 2.0, 3)
        chase = Chase(np.zeros(6), None, np.full(3, -1e3), np.full(3, 1e3), slack, apart=True)
        found = solve(law, Demand(J, b, np.eye(6), -limit, limit, None, None, None, None, None, chase, None))

        def mu(z, slowed, b=b, J=J):
            size, wanted = np.linalg.norm(J), np.linalg.norm(b)
            excess = max(0.0, DEVIATION * dt * size * (z @ z) - wanted)
            error = np.linalg.norm(b - J @ (z + slowed)) + excess
            return max(0.0, 0.5 * CALM * dt * error * size - QUIET * size**2)

        z = b[3:] / sigma
        K = np.sqrt(sigma**2 + mu(0.0 * z, z))
        way = sigma**2 / K**2 * z
        high = 1.0
        for _ in range(2 if (np.abs(way) > limit).any() else 0):
            low, high, may = 0.0, 1.0, high * slack
            for _ in range(60):  # where the cost of a faster pace is that of a slower one
                pace = 0.5 * (low + high)
                steep = (K * way) @ (K * (pace * way - np.clip(pace * way, -limit, limit)))
                low, high = (low, pace) if steep > may * np.linalg.norm(K * way) else (pace, high)
        pace = high
        x = np.clip(pace * z, -limit, limit)
        expected = np.clip(sigma**2 * pace * z / (sigma**2 + mu(x, (1.0 - pace) * z)), -limit, limit)
        assert found.velocity == pytest.approx(expected, rel=1e-8, abs=1e-11)
        whole += pace == 1.0
    assert 4 < whole < 36


def largest_share(demand):
    """The largest a in [0, 1] with C x = a e inside the limits, by linear programming."""
    rows, m = demand.exact, demand.J.shape[1]
    C, sides = np.empty((0, m)), np.empty(0)
    if demand.rows is not None:
        C, sides = np.vstack((demand.rows.C, -demand.rows.C)), np.append(demand.rows.upper, -demand.rows.lower)
    found = linprog(
        np.append(np.zeros(m), -1.0),
        A_ub=np.column_stack((C, np.zeros(len(C)))) if len(C) else None,
        b_ub=sides if len(C) else None,
        A_eq=np.column_stack((rows.A, -rows.b)),
        b_eq=np.zeros(len(rows.b)),
        bounds=[*zip(demand.lower, demand.upper, strict=True), (0.0, 1.0)],
    )
    return -found.fun
