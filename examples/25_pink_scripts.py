"""Pink's own example scripts with one line changed: when the tool settles, and how far off it then is.

The loops of arm_ur5, arm_ur3_velocity_smoothing, arm_panda (its sliders moved by this script), inverse_kinematics_ur10
and barriers/arm_ur5, without their viewers, on the models of example-robot-data; and targets that jump every second,
where velocity limits, and in the last rows position limits too, bind at once. Both tasks are told the same. A row with
several targets has their medians; "-" is never.

Run: python examples/25_pink_scripts.py [--short]      needs the extras `robots` and `peers`; --short is a tenth of it
"""

import sys
from math import inf

import numpy as np
import pink
import pinocchio as pin
from pink.barriers import PositionBarrier
from pink.tasks import DampingTask, FrameTask, LowAccelerationTask, PostureTask

import invariantqp as iq
from invariantqp.pink import InvariantFrameTask

SHORT = 10 if "--short" in sys.argv else 1
DT = 0.005  # [s]


def configuration(robot, q):
    return pink.Configuration(robot.model, robot.model.createData(), np.array(q, dtype=float))


def run(here, task, others, steps, target=lambda _: None, dt=DT, **options):
    """(steps, 2) errors [mm, deg] of the tool after each step."""
    errors = []
    for k in range(steps):
        goal = task.transform_target_to_world
        target(k * dt)
        x = pink.solve_ik(
            here, [task, *others], dt, safety_break=False, **{"solver": "daqp", "damping": 1e-9, **options}
        )
        here.integrate_inplace(x, dt)
        for other in others:
            if isinstance(other, LowAccelerationTask):
                other.set_last_integration(x, dt)
        tool = here.get_transform_frame_to_world(task.frame)
        turn = np.degrees(np.linalg.norm(pin.log3(tool.rotation.T @ goal.rotation)))
        errors.append((1e3 * np.linalg.norm(goal.translation - tool.translation), turn))
    return np.array(errors)


def settled(errors, dt=DT):
    """When the error stays below 1 mm and 0.5 deg [s], and the largest in the last quarter [mm]."""
    late = np.flatnonzero((errors > (1.0, 0.5)).any(axis=1))
    when = 0.0 if not len(late) else dt * (late[-1] + 1) if late[-1] + 1 < len(errors) else inf
    return when, errors[-len(errors) // 4 :, 0].max()


def tracking(make, name, *, smooth):
    """arm_ur5, and the second half of arm_ur3_velocity_smoothing."""
    robot = iq.load_robot(name, tool="ee_link")
    here = configuration(robot, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    task = make(robot.tool, position_cost=1.0, orientation_cost=1.0, lm_damping=1.0)
    other = LowAccelerationTask(cost=1e-1) if smooth else PostureTask(cost=1e-3)
    for each in (task,) if smooth else (task, other):
        each.set_target_from_configuration(here)
    if smooth:
        other.set_last_integration(np.zeros(6), DT)

    def target(t):
        task.transform_target_to_world.translation[1:] = 0.5 + 0.1 * np.sin(2.0 * t), 0.2

    yield (
        f"arm_{name}" + ", velocity smoothing" * smooth,
        settled(run(here, task, [other], 1400 // SHORT, target, solver="quadprog")),
    )


def sliders(make):
    """arm_panda: the handle is pulled and a slider moved, four times."""
    robot = iq.load_robot("panda")
    here = configuration(robot, np.radians([0.0, -45.0, 0.0, -135.0, 0.0, 90.0, 45.0]))
    task = make(robot.tool, position_cost=1.0, orientation_cost=1.0, lm_damping=1.0)
    others = [PostureTask(cost=1e-3), DampingTask(cost=1e-3)]
    for each in (task, others[0]):
        each.set_target_from_configuration(here)
    home = task.transform_target_to_world.copy()
    for said, change, move in (
        ("as it starts", lambda: None, (0.1, 0.2, -0.1, 0.0, 0.0, 0.5)),
        ("position cost 10", lambda: task.set_position_cost(10.0), (-0.1, -0.2, 0.1, 0.4, 0.0, 0.0)),
        ("orientation cost 0.5", lambda: task.set_orientation_cost(0.5), (0.1, -0.1, 0.0, 0.0, 0.5, 0.2)),
        ("damping 0.1", lambda: setattr(others[1], "cost", 0.1), (0.0, 0.3, 0.1, -0.5, 0.2, 0.2)),
    ):
        change()
        turn = pin.exp3(np.array(move[3:]))
        task.set_target(pin.SE3(home.rotation @ turn, home.translation + move[:3]))
        yield f"arm_panda, {said}", settled(run(here, task, others, 400 // SHORT))


def poses(make):
    """inverse_kinematics_ur10 for targets drawn at random, some of them behind joint limits."""
    robot = iq.load_robot("ur10")
    for seed in range(10 // SHORT):
        goal = np.random.default_rng(seed).uniform(robot.position_lower, robot.position_upper)
        task = make(robot.tool, [1.0, 1.0, 1.0], [1.0, 1.0, 1.0])
        task.set_target(pin.SE3(robot.pose(goal)))
        yield "inverse_kinematics_ur10", settled(run(configuration(robot, np.zeros(6)), task, [], 300, dt=0.01), 0.01)


def barrier(make):
    """barriers/arm_ur5: a wall in front of the target's way."""
    robot = iq.load_robot("ur5", tool="ee_link")
    here = configuration(robot, [1.27153374, -0.87988708, 1.89104795, 1.73996951, -0.24610945, -0.74979019])
    task, posture = make(robot.tool, position_cost=10.0, orientation_cost=1.0), PostureTask(cost=1e-3)
    for each in (task, posture):
        each.set_target_from_configuration(here)
    sides = {"p_min": np.array([-0.4]), "p_max": np.array([0.6])}
    wall = PositionBarrier(robot.tool, indices=[1], gain=np.array([100.0]), safe_displacement_gain=1.0, **sides)

    def target(t):
        task.transform_target_to_world.translation[1:] = 0.65 * np.sin(t / 4.0), 0.5

    yield "barriers/arm_ur5", settled(run(here, task, [posture], 1200 // SHORT, target, barriers=[wall]))


def jumps(make, name, tight):
    """Targets within joint ranges, each from where the last one left the arm."""
    robot, rng = iq.load_robot(name), np.random.default_rng(0)
    low, high = np.maximum(robot.position_lower, -np.pi), np.minimum(robot.position_upper, np.pi)
    start = low + 0.02 * (high - low) if tight else 0.5 * (low + high)
    here, task, posture = configuration(robot, start), make(robot.tool, 1.0, 1.0), PostureTask(cost=1e-3)
    posture.set_target(0.5 * (low + high))
    for i in range(6 // SHORT):
        near = np.where(rng.uniform(size=len(low)) < 0.5, low, low + 0.2 * (high - low)) if i % 2 else start
        goal = near if tight else start + rng.uniform(-0.6, 0.6, len(low))
        task.set_target(pin.SE3(robot.pose(np.clip(goal, low, high))))
        yield f"jumps, {name}" + ", at position limits" * tight, settled(run(here, task, [posture], 200))


def main():
    scripts = [
        lambda make: tracking(make, "ur5", smooth=False),
        lambda make: tracking(make, "ur3", smooth=True),
        sliders,
        poses,
        barrier,
        *(
            lambda make, n=name, t=tight: jumps(make, n, t)
            for tight in (False, True)
            for name in ("ur5", "panda", "so101")
        ),
    ]
    print(f"{'':36s}targets  settles, s         then off, mm")
    print(f"{'':36s}         Pink's    ours     Pink's     ours")
    later = farther = 0
    for script in scripts:
        table = {}
        for (name, theirs), (_, ours) in zip(script(FrameTask), script(InvariantFrameTask), strict=True):
            table.setdefault(name, []).append((theirs[0], ours[0], theirs[1], ours[1]))
            later += ours[0] > theirs[0]
            farther += ours[1] > theirs[1] + 1e-3  # a micrometre
        for name, rows in table.items():
            *times, off, ours = np.median(rows, axis=0)
            texts = "".join(f"{time:8.3f}" if np.isfinite(time) else f"{'-':>8s}" for time in times)
            print(f"{name:36s}{len(rows):7d}{texts}{off:11.4f}{ours:9.4f}")
    print(f"ours settles later in {later}, and is then farther off in {farther}")


main()
