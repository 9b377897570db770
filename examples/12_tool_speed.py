"""A speed limit of the tool beside a person, 250 mm/s: tangent planes inside the QP against the cone itself by CVXPY.

Run: python examples/12_tool_speed.py      needs the extra `cvxpy`
"""

import time

import numpy as np

import invariantqp as iq

LIMIT = 0.25  # [m/s]
robot = iq.load_robot("ur5")
rng = np.random.default_rng(0)
limits = {
    "planes": iq.limits.ToolSpeed(LIMIT, point=[0, 0, 0]),
    "cone": iq.limits.ToolSpeed(LIMIT, point=[0, 0, 0], exact=True),
}
bounds = iq.Bounds(-robot.velocity_limit, robot.velocity_limit)
spent = {name: [] for name in limits}
apart, fastest = 0.0, 0.0

for _ in range(60):
    q = rng.uniform(-2.0, 2.0, 6)
    # Twists taken at the tool, so that the limited point is the origin and each limit keeps its compiled program.
    J = iq.adjoint(iq.transform(translation=-robot.pose(q)[:3, 3])) @ robot.jacobian(q)
    twist = rng.standard_normal(6)  # more than a metre a second: far too fast
    answers = {}
    for name, limit in limits.items():
        before = time.perf_counter()
        solution = iq.solve_velocity(J, twist, bounds=bounds, tool_speed=limit, guard=False)
        spent[name].append(1e3 * (time.perf_counter() - before))
        answers[name] = solution.velocity
        fastest = max(fastest, float(np.linalg.norm((J @ solution.velocity)[3:])))
    apart = max(apart, float(np.linalg.norm(answers["planes"] - answers["cone"]) / np.linalg.norm(answers["cone"])))

for name, times in spent.items():
    print(f"{name:7s} median {np.median(times):6.2f} ms   p99 {np.percentile(times, 99):6.2f} ms")
print(f"answers differ by {apart:.1e} at most; fastest tool {1e3 * fastest:.6f} mm/s")
