"""One line of a Pink program changed: a frame task whose joint velocities do not depend on where the frame was put.

The same 200 targets are asked of two frames on one link, 25 cm apart and turned, with Pink's default limits on. The
second frame's task is told the same physical point, the first one's origin.

Run: python examples/06_inside_pink.py      needs the extras `robots` and `pink`
"""

import numpy as np

import invariantqp as iq
from invariantqp.pink import InvariantFrameTask

# isort: split
import pink  # after ours, which says which extra is missing
import pinocchio as pin

DT = 0.01  # [s]
STATES = 200


def with_second_frame(robot, rng):
    """The robot's model with one more frame on the link of its tool, and where that is."""
    model = robot.model.copy()
    index = model.getFrameId(robot.tool)
    tool = model.frames[index]
    away = rng.normal(size=3)
    offset = pin.SE3(pin.exp3(2.0 * rng.normal(size=3)), 0.25 * away / np.linalg.norm(away))
    model.addFrame(pin.Frame("moved", tool.parentJoint, index, tool.placement * offset, pin.FrameType.OP_FRAME))
    return model, offset


def change(tasks, here, target, offset):
    """Relative change of the joint velocities from one frame's task to the other's."""
    velocities = []
    for task, goal in zip(tasks, (target, target * offset), strict=True):
        task.set_target(goal)
        # Pink's default damping of 1e-12 leaves DAQP without an answer in many seven-joint states.
        velocities.append(pink.solve_ik(here, [task], DT, solver="daqp", damping=1e-9))
    return np.linalg.norm(velocities[1] - velocities[0]) / np.linalg.norm(velocities[0])


print(f"{STATES} states, Pink's limits on; relative change of the joint velocities, median and worst:")
for name in ("panda", "ur5", "so101"):
    rng = np.random.default_rng(0)
    robot = iq.load_robot(name)
    model, offset = with_second_frame(robot, rng)
    frames, origin = (robot.tool, "moved"), offset.inverse().translation
    laws = {
        "pink.FrameTask": [pink.FrameTask(frame, position_cost=1.0, orientation_cost=1.0) for frame in frames],
        "InvariantFrameTask": [  # the one line
            InvariantFrameTask(frame, point=point) for frame, point in zip(frames, (None, origin), strict=True)
        ],
    }
    changes = {law: [] for law in laws}
    low, high = np.maximum(robot.position_lower, -np.pi), np.minimum(robot.position_upper, np.pi)
    for _ in range(STATES):
        here = pink.Configuration(model, model.createData(), rng.uniform(low, high))
        target = pin.exp6(0.05 * rng.normal(size=6)) * here.get_transform_frame_to_world(robot.tool)
        for law, tasks in laws.items():
            changes[law].append(change(tasks, here, target, offset))
    for law, values in changes.items():
        print(f"  {name:6s} {law:19s} {np.median(values):8.1e} {max(values):8.1e}")
    print(f"         {laws['InvariantFrameTask'][0]!r}")

print("\nAnd back: Pink's limits and barriers under our controller. A floor under a Panda's tool, 5 cm below it:")
robot = iq.load_robot("panda")
q = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])
start = robot.pose(q)
floor = pink.barriers.PositionBarrier(robot.tool, indices=[2], p_min=start[2:3, 3] - 0.05, gain=20.0)
margin = pink.limits.ConfigurationLimit(robot.model, 0.1)
controller = iq.Controller(robot, dt=DT, gain=5.0, limits=[floor, margin])
for _ in range(300):
    solution = controller.step(q, iq.transform(translation=[0, 0, -0.3]) @ start)
    q = q + DT * solution.velocity
print(
    f"  asked for 300 mm down, the tool is {1e3 * (start[2, 3] - robot.pose(q)[2, 3]):.2f} mm down: {solution.status}"
)
