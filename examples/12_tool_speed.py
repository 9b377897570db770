"""A speed limit of the tool beside a person, 250 mm/s: a cone inside the law, against a kept solver for cones.

Run: python examples/12_tool_speed.py      needs CVXPY for the comparison: pip install cvxpy
"""

import numpy as np

import invariantqp as iq

try:
    import cvxpy as cp
except ModuleNotFoundError:
    raise SystemExit("This compares with CVXPY: pip install cvxpy") from None

LIMIT = 0.25  # [m/s]
robot = iq.load_robot("ur5")
rng = np.random.default_rng(0)
bounds = iq.Bounds(-robot.velocity_limit, robot.velocity_limit)
L = 1.24  # [m] what a radian counts as: the arm's reach
apart, fastest = 0.0, 0.0

for _ in range(60):
    q = rng.uniform(-2.0, 2.0, 6)
    # Twists taken at the tool, so that the limited point is the origin.
    J = iq.adjoint(iq.transform(translation=-robot.pose(q)[:3, 3])) @ robot.jacobian(q)
    twist = rng.standard_normal(6)  # more than a metre a second: far too fast
    limit = iq.limits.ToolSpeed(LIMIT, point=[0, 0, 0])
    x = iq.solve_velocity(J, twist, bounds=bounds, tool_speed=limit, point=[0, 0, 0], length=L).velocity
    root, y = np.diag([L, L, L, 1, 1, 1]), cp.Variable(6)
    inside = [y >= bounds.lower, y <= bounds.upper, cp.norm(J[3:] @ y, 2) <= LIMIT]
    cp.Problem(cp.Minimize(cp.sum_squares(root @ J @ y - root @ twist)), inside).solve(solver="CLARABEL")
    missed, least = (np.linalg.norm(root @ (twist - J @ v)) for v in (x, y.value))
    apart, fastest = max(apart, float(missed / least - 1.0)), max(fastest, float(np.linalg.norm(J[3:] @ x)))

print(f"misses at most {apart:.1e} more than the solver's optimum; fastest tool {1e3 * fastest:.6f} mm/s")
