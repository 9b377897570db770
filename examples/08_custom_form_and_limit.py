"""Your own measure of a twist, your own limit, your own solver settings: three small classes and no subclass.

Run: python examples/08_custom_form_and_limit.py      needs the extras `robots` and `solvers`
"""

from dataclasses import dataclass

import numpy as np
import osqp
from scipy import sparse

import invariantqp as iq

DT = 0.005  # [s]

robot = iq.load_robot("so101")
q = np.array([0.0, -0.4, 0.5, 0.6, 0.0])  # [rad]
target = robot.pose(q) @ iq.exp([0.3, 0.2, 0.4, 0.02, 0.05, -0.03])

# A form: the inertia of what the gripper holds, a bar of 0.4 kg and 30 cm along x, in the tool's frame. What is missed
# of a motion then has the least kinetic energy of the bar, in whatever frame anybody counts.
mass, length = 0.4, 0.3
inertia = np.diag([1e-4, mass * length**2 / 12, mass * length**2 / 12, mass, mass, mass])  # (omega; v)
bar = iq.CarriedMetric(inertia, "tool")


def missed(x, q):
    """Kinetic energy [mJ] of the part of the wanted motion that the arm does not do."""
    s = 2.0 * iq.log(target @ iq.inverse(robot.pose(q))) - robot.jacobian(q) @ x
    at_tool = iq.adjoint(iq.inverse(robot.pose(q))) @ s
    return 500.0 * at_tool @ inertia @ at_tool


print("The part of a wanted motion that five joints cannot do, as the energy of a bar in the gripper:")
for name, form in {"least squares": None, "inertia of the bar": bar}.items():
    solution = iq.Controller(robot, dt=DT, gain=2.0, form=form, guard=False).step(q, target)
    print(f"  {name:19s} {missed(solution.velocity, q):.3f} mJ")


# A limit: the tool keeps 2 cm from a wall. A row on the joint velocity, made in every tick: speed towards the wall at
# most a share of the room left.
@dataclass(frozen=True)
class Wall:
    normal: np.ndarray
    distance: float  # [m], of the plane from the base
    rate: float = 10.0  # [1/s]

    def __call__(self, q):
        tool = robot.pose(q)[:3, 3]
        J = robot.jacobian(q)
        row = self.normal @ (J[3:] + np.cross(J[:3], tool, axis=0))
        return iq.limits.LimitRows([row], [-np.inf], [self.rate * (self.distance - self.normal @ tool)])


# A solver: anything with a name and solve(qp); what it leaves undone is checked, and DAQP takes over if it fails.
@dataclass
class MyOsqp:
    name: str
    eps: float

    def solve(self, qp):
        C = sparse.csc_matrix(np.eye(len(qp.c)) if qp.C is None else qp.C)
        problem, tolerances = osqp.OSQP(), {"eps_abs": self.eps, "eps_rel": self.eps}
        problem.setup(sparse.csc_matrix(np.triu(qp.H)), -qp.c, C, qp.lower, qp.upper, verbose=False, **tolerances)
        return problem.solve(raise_error=False).x


beyond = robot.pose(q) @ iq.exp([0, 0, 0, 0.0, 0.0, 0.08])
along = (beyond - robot.pose(q))[:3, 3] / 0.08
wall = Wall(along, along @ robot.pose(q)[:3, 3] + 0.02)
print("\nA target 80 mm ahead, a wall 20 mm ahead:")
for name, solver in {"daqp": "daqp", "my own osqp": MyOsqp("my own osqp", 1e-7)}.items():
    controller = iq.Controller(robot, dt=DT, gain=20.0, exact="position", limits=[wall], backend=solver)
    here = q
    for _ in range(220):
        solution = controller.step(here, beyond)
        here = here + DT * solution.velocity
    went = 1e3 * along @ (robot.pose(here) - robot.pose(q))[:3, 3]
    print(f"  {name:12s} went {went:.3f} mm; {solution.status}: {solution.reason.split(';')[0]}")
