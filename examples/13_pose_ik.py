"""Joint positions for a pose, inside the joint limits, beside the Robotics Toolbox, Pink and Newton by pseudoinverse.

Random reachable targets and random starts, the same for everyone, joint limits on; met is 1e-6 in metres and radians.

Run: python examples/13_pose_ik.py [targets a robot, 5]      1000 takes minutes; the extra `peers` brings the others
"""

import sys

import numpy as np
from shared.pose_race import TIME_LIMIT, race

import invariantqp as iq
from invariantqp.workbench.cli.console import progress

# One pose of a Panda, then one that it cannot reach.
robot = iq.load_robot("panda")
target = robot.pose([0.3, -0.5, 0.2, -2.0, 0.1, 1.6, 0.8])
print("reached:", iq.solve_pose(robot, target).q.round(4))
target[0, 3] += 1.0
far = iq.solve_pose(robot, target)
print(far.reason)

# Five joints: the point of the tool exactly, its orientation as well as the arm can.
robot = iq.load_robot("so101")
target = robot.pose([0.3, -0.5, 0.2, 0.4, 0.1])
target[:3, :3] = target[:3, :3] @ iq.exp([0, 0.4, 0, 0, 0, 0])[:3, :3]
print(iq.solve_pose(robot, target, exact="position").reason)

# A path: each pose begins where the one before ended.
robot = iq.load_robot("ur5")
path = [robot.pose(q) for q in np.linspace([0, -1.2, 1.5, 0.5, 1.0, 0], [1, -0.8, 1.2, 0.2, 0.6, 2], 50)]
steps = np.diff([s.q for s in iq.solve_poses(robot, path, q0=[0, -1.2, 1.5, 0.5, 1.0, 0], along=True)], axis=0)
print(f"along a path of 50 poses no joint moves by more than {np.abs(steps).max():.3f} rad at once")

count = int(sys.argv[1]) if len(sys.argv) > 1 else 5
print(f"\n{count} targets a robot, at most {1e3 * TIME_LIMIT:.0f} ms each; outside: answers beyond joint limits")
for at_limits, where in ((0, "anywhere in the joint range"), (2, "with two joints at their limits")):
    with progress("pose IK", quiet=False) as report:
        outcomes = race(count, at_limits=at_limits, progress=report)
    print(f"\ntargets {where}")
    print(f"{'robot':8s}{'solver':30s}{'success':>9s}{'median ms':>11s}{'p99 ms':>9s}{'outside':>9s}")
    for o in outcomes:
        print(f"{o.robot:8s}{o.solver:30s}{o.success:9.1%}{o.median_ms:11.2f}{o.p99_ms:9.2f}{o.outside:9d}")
