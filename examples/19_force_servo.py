"""Force and motion in a servo loop at 500 Hz, as a script for a UR or a Franka has it: a circle on a table with 10 N.

The driver's calls are all in `Arm`; here it is a simulated UR5 that misses a cycle now and then, and is stopped and
resumed once. A wrist sensor reads forces first, in the tool frame, with noise.

Run: python examples/19_force_servo.py
"""

import numpy as np

import invariantqp as iq

DT, PRESS, RADIUS, TURN = 0.002, 10.0, 0.05, 4.0  # [s], [N], [m], [s] a turn
STOP, RESUME, END = 3.0, 3.5, 8.0  # [s]
HOME = np.array([0.0, -1.2, 1.8, -2.2, -1.57, 0.0])  # [rad], tool down


class Arm:
    """What a driver offers, in one place: joint positions, a wrench, joint velocities. Replace the bodies by yours."""

    def __init__(self, robot):
        self.robot, self.q, self.speed = robot, HOME.copy(), np.zeros(6)
        self.table, self.random = robot.pose(HOME)[2, 3] - 0.005, np.random.default_rng(0)

    def read(self):
        """Joint positions and the wrench of one cycle, or None where the cycle was missed."""
        self.q = self.q + DT * self.speed  # the world goes on, read or not
        if self.random.random() < 0.02:
            return None
        tool = self.robot.pose(self.q)
        force = tool[:3, :3].T @ [0.0, 0.0, 2e4 * max(0.0, self.table - tool[2, 3])]  # what the table does to the tool
        return self.q.copy(), np.concatenate((force, np.zeros(3))) + self.random.normal(0.0, 0.2, 6) * [
            1,
            1,
            1,
            0,
            0,
            0,
        ]

    def drive(self, velocity):
        """Joint velocities, held until the next call: speedj of a UR, a velocity controller's command."""
        self.speed = velocity

    def stop(self):
        """Stand still: speedStop, a protective stop, an operator's pause."""
        self.speed = np.zeros(6)


robot = iq.load_robot("ur5")
arm = Arm(robot)
task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], normal=[0, 0, 1]), [PRESS], approach_speed=0.05)
sensor = iq.WrenchSensor(np.eye(4), order="force first", reads="reaction", cutoff=50.0, noise=0.2)
loop = iq.HybridController(robot, task, dt=DT, sensor=sensor)
start = robot.pose(HOME)


def circle(time):
    """The pose at a time, on the table's height."""
    angle = 2.0 * np.pi * time / TURN
    return iq.transform(translation=RADIUS * np.array([np.cos(angle) - 1.0, np.sin(angle), 0.0])) @ start


late = DT + 1.0 / (2.0 * np.pi * 50.0) + 0.003  # tick, low-pass, electronics
found: iq.force.Margins = iq.force.margins(k=2e4, T=late)
print(
    f"with {1e3 * late:.0f} ms late the force has a gain margin of {found.gain:.1f} and {found.phase:.0f} deg of phase"
)

follower = iq.PathFollower(loop, circle, end=END, rate=1.0)
follower.prepare(HOME)
told, missed, press, off = [], 0, [], []
for cycle in range(round(END / DT)):
    if STOP <= cycle * DT < RESUME:
        arm.stop()
        arm.read()
        continue
    if cycle * DT == RESUME:
        loop.reset()  # what the loop remembers is from before: it feels for the table again, and the path waits for it
    measured = arm.read()
    if measured is None:  # the arm goes on at its last speed for a cycle; the path waits
        missed += 1
        continue
    solution = follower.step(measured[0], arm.speed, wrench=measured[1])
    arm.drive(solution.velocity)
    told.append(solution.status)
    press.append(2e4 * max(0.0, arm.table - robot.pose(arm.q)[2, 3]))
    x, y = robot.pose(measured[0])[:2, 3] - start[:2, 3]
    off.append(abs(np.hypot(x + RADIUS, y) - RADIUS))

settled = np.array(press[-round(3.0 / DT) :])
print(f"{missed} of {cycle + 1} cycles missed; told: {', '.join(dict.fromkeys(told))}")
print(f"true press {settled.mean():.2f} N, {100 * settled.std() / PRESS:.1f} % rms, at most {max(press):.1f} N")
print(f"path within {1e3 * max(off[-len(settled) :]):.3f} mm, {solution.late:.2f} s late")
