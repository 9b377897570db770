"""Speed against accuracy of one velocity solve: ours, Moore-Penrose, and the QP solvers, against 50-digit references.

Panda states on the task panda_path. Left: no limit met, every law is J^+ s (rank 6). Right: limits met, the convex QP,
whose reference is built from J and s alone, in 50 digits, and certified by its optimality conditions.

Run: python examples/10_speed_and_accuracy.py [picture.png]      needs the extra `test` (mpmath)
"""

import sys
import time

import mpmath as mp
import numpy as np
from matplotlib import pyplot as plt

import invariantqp as iq
from invariantqp.velocity.convexify import NULL_WEIGHT

mp.mp.dps = 50
FREE, LIMITED = "no limit met", "limits met"
H = 0.25  # pitch [m/rad], about a Panda's own length
COLOURS = {"ours": "#0072B2", "other": "#D55E00"}  # Okabe and Ito: told apart by colour-blind readers


def states(count, seed=0):
    """Jacobians, twists and velocity bounds near the path, some with bounds that the closed form would break."""
    rng = np.random.default_rng(seed)
    task = iq.load_task("panda_path")
    robot = task.load_robot()
    for _ in range(count):
        J = robot.jacobian(task.start() + 0.4 * rng.standard_normal(7))
        s = 0.3 * rng.standard_normal(6)
        x = np.abs(np.linalg.pinv(J) @ s)
        yield (
            J,
            s,
            iq.Bounds(-3.0 * x - 0.1, 3.0 * x + 0.1),
            iq.Bounds(-0.7 * x.max() * np.ones(7), 0.7 * x.max() * np.ones(7)),
        )


def exact_free(J, s):
    """J'(JJ')^-1 s in 50 digits."""
    J, s = mp.matrix(J.tolist()), mp.matrix(s.tolist())
    return np.array((J.T * mp.lu_solve(J * J.T, s)).T.tolist()[0], dtype=float)


def exact_limited(J, s, bounds, guess):
    """The convex QP's optimum in 50 digits: the active set of a guess, solved, and certified by its multipliers."""
    J, s, Q = mp.matrix(J.tolist()), mp.matrix(s.tolist()), mp.matrix(iq.pitch_form(H).tolist())
    mu, V = mp.eigsy(J.T * Q * J)
    size = max(abs(m) for m in mu)
    null = min(range(7), key=lambda i: abs(mu[i]))
    g = V.T * (J.T * Q * s)
    weight = [NULL_WEIGHT * size if i == null else abs(mu[i]) for i in range(7)]
    z = mp.matrix([0 if i == null else g[i] / mu[i] for i in range(7)])
    hessian = V * mp.diag(weight) * V.T
    c = hessian * (V * z)
    fixed = {i: b for i in range(7) for b in (bounds.lower[i], bounds.upper[i]) if abs(guess[i] - b) < 1e-6}
    free = [i for i in range(7) if i not in fixed]
    x = mp.matrix([fixed.get(i, 0) for i in range(7)])
    rhs = c - hessian * x
    solved = mp.lu_solve(mp.matrix([[hessian[i, j] for j in free] for i in free]), mp.matrix([rhs[i] for i in free]))
    for k, i in enumerate(free):
        x[i] = solved[k]
    push = c - hessian * x
    certified = all(push[i] * (1 if b > 0 else -1) > 0 for i, b in fixed.items())
    certified = certified and all(bounds.lower[i] <= x[i] <= bounds.upper[i] for i in free)
    return np.array([float(v) for v in x]) if certified else None


def ours(backend):
    return lambda J, s, bounds: iq.solve_velocity(J, s, form=H, bounds=bounds, backend=backend, guard=False).velocity


METHODS = {
    FREE: {
        "invariantqp, closed form": ours("daqp"),
        "numpy pinv": lambda J, s, _: np.linalg.pinv(J) @ s,
        "numpy lstsq": lambda J, s, _: np.linalg.lstsq(J, s, rcond=None)[0],
        "normal equations": lambda J, s, _: J.T @ np.linalg.solve(J @ J.T, s),
        "DLS, lambda = 0.05": lambda J, s, _: J.T @ np.linalg.solve(J @ J.T + 0.05**2 * np.eye(6), s),
    },
    LIMITED: {
        "invariantqp, DAQP": ours("daqp"),
        "invariantqp, OSQP kept": ours(iq.Osqp()),
        "invariantqp, quadprog": ours("quadprog"),
        "pinv, clipped": lambda J, s, b: np.clip(np.linalg.pinv(J) @ s, b.lower, b.upper),
        "DLS, clipped": lambda J, s, b: np.clip(
            J.T @ np.linalg.solve(J @ J.T + 0.05**2 * np.eye(6), s), b.lower, b.upper
        ),
    },
}


def measured(method, cases):
    """Median time [us] and median relative error over the cases."""
    times, errors = [], []
    for J, s, bounds, exact in cases:
        method(J, s, bounds)
        before = time.perf_counter()
        x = method(J, s, bounds)
        times.append(1e6 * (time.perf_counter() - before))
        errors.append(np.linalg.norm(x - exact) / np.linalg.norm(exact))
    return np.median(times), max(np.median(errors), 1e-17)


def main(picture):
    cases = {FREE: [], LIMITED: []}
    for J, s, wide, narrow in states(60):
        cases[FREE].append((J, s, wide, exact_free(J, s)))
        solution = iq.solve_velocity(J, s, form=H, bounds=narrow, guard=False)
        reference = exact_limited(J, s, narrow, solution.velocity) if solution.damping == 0.0 else None
        if reference is not None:
            cases[LIMITED].append((J, s, narrow, reference))
    figure, panels = plt.subplots(1, 2, figsize=(10, 4.2), sharey=True, layout="constrained")
    for axes, (title, methods) in zip(panels, METHODS.items(), strict=True):
        print(f"{title}: {len(cases[title])} certified states")
        results = sorted((measured(method, cases[title]), name) for name, method in methods.items())
        for rank, ((us, error), name) in enumerate(results):
            print(f"  {name:26s} {us:8.1f} us   relative error {error:.1e}")
            axes.loglog(us, error, "o", color=COLOURS["ours" if name.startswith("invariantqp") else "other"])
            place = (8, -18 * (rank + 1) if error > 1e-6 else 22 * (len(results) - rank))  # names clear of points
            style = {"arrowstyle": "-", "linewidth": 0.5}
            axes.annotate(name, (us, error), place, textcoords="offset points", fontsize=8, arrowprops=style)
        axes.set(title=title, xlabel="time of one solve [us], median", xlim=(5, 2000), ylim=(1e-16, 3))
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("relative error, median, against 50 digits")
    figure.savefig(picture, dpi=110)
    print("picture:", picture)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "speed_and_accuracy.png")
