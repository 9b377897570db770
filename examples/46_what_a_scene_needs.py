"""What a scene needs, and what each option costs: the same motion without it and with it.

Each row is a scene and the option that it needs: the figure that the option changes, without it and with it, and the
median time of a tick of both, which take turns. The arm moves as commanded, except where it presses: there MuJoCo
moves it and the table. The second table is of what a program loads: modules of this library and the time from the
start of Python to the first answer.

    python examples/46_what_a_scene_needs.py            prints both tables
    python examples/46_what_a_scene_needs.py --write    writes examples/comparison/needs.json, for the guide
"""

import json
import subprocess
import sys
from pathlib import Path
from time import perf_counter, thread_time_ns

import numpy as np
from shared.cells import DELAY, Cell, table
from shared.cells import DT as CELL_DT

import invariantqp as iq
from invariantqp.errors import written

DT = 0.002  # [s]
STARTS = {
    "panda": [0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8],
    "ur5e": [0.0, -1.2, 1.6, -0.6, -1.2, 0.3],
    "so101": [0.0, -0.6, 0.8, 0.6, 0.2],
}
OUT = Path(__file__).parent / "comparison" / "needs.json"


def loop(name, **options):
    """An arm and a `Controller` of it."""
    robot = iq.load_robot(name)
    return robot, iq.Controller(robot, dt=DT, **options)


def take_turns(steps, q0, ticks, late=0):
    """The joint positions (ticks + 1, m) of each of two loops, and the median times of their ticks [us].

    `steps` are functions of (q, tick number) that return joint velocities; commands act `late` ticks later.
    """
    positions, times = [[np.array(q0)] for _ in steps], [[] for _ in steps]
    commands = [[np.zeros(len(q0))] * late for _ in steps]
    for k in range(ticks):
        for i, step in enumerate(steps):
            q = positions[i][-1]
            start = thread_time_ns()
            velocity = step(q, k)
            times[i].append(1e-3 * (thread_time_ns() - start))
            commands[i].append(velocity)
            positions[i].append(q + DT * commands[i][k])
    return [np.array(each) for each in positions], [float(np.median(each)) for each in times]


def tip(robot, positions, at=(0.0, 0.0, 0.0)):
    """The places (n, 3) of a point of the tool [m]."""
    return np.array([robot.pose(q)[:3] @ [*at, 1.0] for q in positions])


def circle(start, k, radius=0.05, seconds=2.0):
    """A pose on a circle after k ticks, and its twist, of the point of the tool."""
    turn = 2.0 * np.pi / seconds
    angle, pose, twist = turn * DT * k, start.copy(), np.zeros(6)
    pose[:2, 3] += radius * np.array([np.cos(angle) - 1.0, np.sin(angle)])
    twist[3:5] = radius * turn * np.array([-np.sin(angle), np.cos(angle)])
    return pose, twist


def moving_target():
    robot, without = loop("ur5e")
    controller, q0 = loop("ur5e")[1], STARTS["ur5e"]
    start = robot.pose(q0)
    steps = (
        lambda q, k: without.step(q, circle(start, k)[0]).velocity,
        lambda q, k: controller.step(q, *circle(start, k)).velocity,
    )
    positions, us = take_turns(steps, q0, 2000)
    desired = np.array([circle(start, k)[0][:3, 3] for k in range(2001)])
    off = [1e3 * np.linalg.norm(tip(robot, each) - desired, axis=1).max() for each in positions]
    return "a target that moves at 160 mm/s, UR5e", "feedforward=", "largest error, mm", off, us


def five_joints():
    robot, without = loop("so101")
    controller, q0 = loop("so101", exact="position")[1], STARTS["so101"]
    start = robot.pose(q0)
    steps = [lambda q, k, c=c: c.step(q, *circle(start, k, 0.03, 4.0)).velocity for c in (without, controller)]
    positions, us = take_turns(steps, q0, 4000)
    desired = np.array([circle(start, k, 0.03, 4.0)[0][:3, 3] for k in range(4001)])
    off = [1e3 * np.linalg.norm(tip(robot, each) - desired, axis=1).max() for each in positions]
    return "a tip on a circle, five joints, SO-101", 'exact="position"', "largest error, mm", off, us


def tip_of_a_pencil():
    at, robot = (0.0, 0.0, 0.1), iq.load_robot("so101")
    exact = "position", iq.control.ExactPoint(at)
    loops, q0 = [loop("so101", exact=which)[1] for which in exact], STARTS["so101"]
    start = robot.pose(q0)
    steps = [lambda q, k, c=c: c.step(q, circle(start, k, 0.03, 4.0)[0]).velocity for c in loops]
    positions, us = take_turns(steps, q0, 4000)
    desired = np.array([circle(start, k, 0.03, 4.0)[0][:3] @ [*at, 1.0] for k in range(4001)])
    off = [1e3 * np.linalg.norm(tip(robot, each, at) - desired, axis=1).max() for each in positions]
    return "a pencil 100 mm long on a circle, SO-101", "exact=ExactPoint(...)", "largest error of its tip, mm", off, us


def position_alone():
    robot, controller = loop("ur5e")
    other, q0 = loop("ur5e")[1], STARTS["ur5e"]
    end = robot.pose(q0)
    end[:3, 3] += [0.1, 0.3, -0.1]
    end[:3, :3] = end[:3, :3] @ iq.exp([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])[:3, :3]
    steps = (lambda q, _: controller.step(q, end).velocity, lambda q, _: other.step(q, end[:3, 3]).velocity)
    positions, us = take_turns(steps, q0, 2000)
    travel = [float(np.abs(np.diff(each, axis=0)).sum()) for each in positions]
    return "only the position matters, UR5e", "a (3,) target", "joint travel, rad", travel, us


def jump(options, figure, title, option, unit, by):
    robot, without = loop("panda")
    controller, q0 = loop("panda", **options)[1], STARTS["panda"]
    end = robot.pose(q0)
    end[:3, 3] += by
    steps = [lambda q, _, c=c: c.step(q, end).velocity for c in (without, controller)]
    positions, us = take_turns(steps, q0, 1500)
    return title, option, unit, [figure(robot, each) for each in positions], us


def accelerations(_, positions):
    velocities = np.diff(positions, axis=0, prepend=positions[:1]) / DT
    return float(np.abs(np.diff(velocities, axis=0)).max() / DT)


def tool_speed(robot, positions):
    return float(np.linalg.norm(np.diff(tip(robot, positions), axis=0), axis=1).max() / DT)


def over_a_table():
    robot, q0 = iq.load_robot("panda"), STARTS["panda"]
    height = robot.pose(q0)[2, 3] - 0.15
    sphere = {"tool": [iq.limits.Sphere([0.0, 0.0, 0.0], 0.05, name="hand")]}
    clearance = iq.limits.Clearance(
        robot, sphere, [iq.limits.HalfSpace([0.0, 0.0, height], [0.0, 0.0, 1.0], name="table")]
    )
    loops = iq.Controller(robot, dt=DT), iq.Controller(robot, dt=DT, limits=[clearance])
    end = robot.pose(q0)
    end[2, 3] -= 0.2
    steps = [lambda q, _, c=c: c.step(q, end).velocity for c in loops]
    positions, us = take_turns(steps, q0, 1500)
    least = [1e3 * float((tip(robot, each)[:, 2] - 0.05 - height).min()) for each in positions]
    return "a table under the hand, Panda", "limits=[Clearance(...)]", "least distance, mm", least, us


def posture():
    robot, without = loop("panda", posture=False)
    controller, q0 = loop("panda", posture=STARTS["panda"])[1], STARTS["panda"]
    start = robot.pose(q0)
    steps = [lambda q, k, c=c: c.step(q, *circle(start, k, 0.15, 2.0)).velocity for c in (without, controller)]
    positions, us = take_turns(steps, q0, 20_000)
    drift = [float(np.abs(each[-1] - each[0]).max()) for each in positions]
    return "the same circle twenty times, seven joints, Panda", "posture=", "joints off at its end, rad", drift, us


def late_commands():
    robot, without = loop("ur5e", gain=30.0)
    controller, q0 = loop("ur5e", gain=30.0, delay=0.05)[1], STARTS["ur5e"]
    end = robot.pose(q0)
    end[:3, 3] += [0.05, 0.05, -0.05]
    steps = [lambda q, _, c=c: c.step(q, end).velocity for c in (without, controller)]
    positions, us = take_turns(steps, q0, 1500, late=26)
    swing = [1e3 * float(np.ptp(tip(robot, each)[-500:], axis=0).max()) for each in positions]
    return "commands act 50 ms late, gain 30/s, UR5e", "delay=", "swing after 2 s, mm", swing, us


def stream():
    robot, controller = loop("ur5e", acceleration_limit=15.0)
    follower, q0 = iq.Follower(loop("ur5e", acceleration_limit=15.0)[1]), STARTS["ur5e"]
    start = robot.pose(q0)

    def streamed(q, k):
        if k % 50 == 0:
            follower.add(circle(start, k, 0.08)[0])
        return follower.step(q).velocity

    steps = (lambda q, k: controller.step(q, circle(start, k - k % 50, 0.08)[0]).velocity, streamed)
    positions, us = take_turns(steps, q0, 3000)
    jerk = [float(np.sqrt(np.mean((np.diff(each[500:], 3, axis=0) / DT**3) ** 2))) for each in positions]
    return "a stream of poses at 10 Hz, UR5e, 15 rad/s^2", "Follower", "rms joint jerk, rad/s^3", jerk, us


def form():
    robot, without = loop("ur5e")
    controller, q0 = loop("ur5e", form=0.3)[1], STARTS["ur5e"]
    start = robot.pose(q0)
    steps = [lambda q, k, c=c: c.step(q, *circle(start, k)).velocity for c in (without, controller)]
    positions, us = take_turns(steps, q0, 1000)
    change = float(np.abs(positions[1] - positions[0]).max())
    return "six joints, no limit or singularity near", "form=", "change of the joints, rad", [0.0, change], us


def press():
    """A pen is to press with 5 N on a table that lies 2 mm lower than was told."""
    forces, us = [], []
    for is_hybrid in (False, True):
        cell = Cell("panda", table("panda", below=0.004))
        reading, times = [], []
        target = cell.home.copy()
        target[2, 3] -= 0.002 + 5.0 / 2e4
        task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], [0.0, 0.0, 1.0]), [5.0])
        hybrid = iq.HybridController(cell.robot, task, dt=CELL_DT, sensor=cell.sensor, delay=DELAY)
        plain = iq.Controller(cell.robot, dt=CELL_DT, delay=DELAY)
        for _ in range(1000):
            q, wrench = cell.read()
            start = thread_time_ns()
            answer = hybrid.step(q, cell.home, wrench) if is_hybrid else plain.step(q, target)
            times.append(1e-3 * (thread_time_ns() - start))
            cell.drive(answer.velocity)
            reading.append(cell.pressed()[2])
        forces.append(float(np.sqrt(np.mean((np.array(reading[-250:]) - 5.0) ** 2))))
        us.append(float(np.median(times)))
    return "5 N on a table 2 mm lower than was told, Panda", "HybridController", "rms force error, N", forces, us


def scenes():
    yield moving_target()
    yield five_joints()
    yield tip_of_a_pencil()
    yield position_alone()
    title, unit = "a target that jumps by 100 mm, Panda", "largest acceleration, rad/s^2"
    yield jump({"acceleration_limit": 10.0}, accelerations, title, "acceleration_limit=", unit, [0.08, 0.0, 0.06])
    title, unit = "people beside it: a target 300 mm away, Panda", "fastest tool, m/s"
    yield jump({"tool_speed": 0.25}, tool_speed, title, "tool_speed=", unit, [0.2, 0.2, 0.1])
    yield over_a_table()
    yield posture()
    yield late_commands()
    yield stream()
    yield press()
    yield form()


# Programs on an arm of six screws: reading a file would be most of the time.
PROGRAM = """
import sys
import numpy as np
import invariantqp as iq
axes = np.eye(3)[[2, 1, 1, 0, 1, 0]]
points = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.3], [0.4, 0.0, 0.3], [0.5, 0.0, 0.3], [0.7, 0.0, 0.3], [0.8, 0.0, 0.3]]
hinges = np.column_stack([iq.revolute(axis, point) for axis, point in zip(axes, points)])
robot = iq.robots.Chain(hinges, iq.transform(translation=[0.9, 0.0, 0.3]), velocity_limit=2.0)
q = np.full(6, 0.3)
pose = robot.pose(q)
CALL
loaded = [name.split(".") for name in sys.modules if name.startswith("invariantqp.")]
print(len(loaded), *sorted({name[1] for name in loaded if len(name) > 2}))
"""
CALLS = {
    "solve_velocity": "iq.solve_velocity(robot.jacobian(q), np.ones(6))",
    "Controller": "iq.Controller(robot, dt=0.002).step(q, pose)",
    "solve_pose": "iq.solve_pose(robot, pose, q0=q)",
    "Controller, Clearance": """
hand = {"tool": [iq.limits.Sphere([0.0, 0.0, 0.0], 0.05)]}
table = iq.limits.HalfSpace([0.0, 0.0, -1.0], [0.0, 0.0, 1.0])
iq.Controller(robot, dt=0.002, limits=[iq.limits.Clearance(robot, hand, [table])]).step(q, pose)
""",
    "Follower": """
follower = iq.Follower(iq.Controller(robot, dt=0.002, acceleration_limit=8.0))
follower.add(pose)
follower.step(q)
""",
    "HybridController": """
task = iq.HybridTask(iq.point_contact(pose[:3, 3], [0.0, 0.0, 1.0]), [5.0])
sensor = iq.WrenchSensor(np.eye(4), order="force first", reads="reaction", cutoff=50.0)
iq.HybridController(robot, task, dt=0.002, sensor=sensor).step(q, pose, np.zeros(6))
""",
    "run_task": "iq.run_task(iq.load_task('scara'))",
}


def programs():
    """What a program loads: its call, rooms of the library, modules, and the seconds from the start of Python."""
    for name, call in CALLS.items():
        found = []
        for _ in range(3):
            start, words = perf_counter(), [sys.executable, "-c", PROGRAM.replace("CALL", call)]
            done = subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True)  # noqa: S603
            found.append((perf_counter() - start, done.stdout.split()))
        seconds, (modules, *rooms) = min(found)
        yield name, ", ".join(rooms), modules, seconds


def rows():
    """Both tables, as text."""
    options = [
        (title, option, unit, *(written(x, 3) for x in figures), *(written(t, 3) for t in us))
        for title, option, unit, figures, us in scenes()
    ]
    loads = [(name, rooms, modules, f"{seconds:.2f}") for name, rooms, modules, seconds in programs()]
    return {"options": options, "programs": loads}


def write():
    """Measure both tables and keep them for the guide."""
    OUT.write_text(json.dumps(rows(), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:] == ["--write"]:
        write()
    else:
        for table_of in rows().values():
            for row in table_of:
                print(" | ".join(row))
