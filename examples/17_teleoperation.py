"""An SO-101 by LeRobot's calls: action chunks of a policy, and a hand at 30 frames a second, placo's answers beside.

First, chunks as `predict_action_chunk` returns them: (1, 50, 6) float32 in degrees, the gripper last; twice a second,
from an observation that is 150 to 350 ms old when they come, disagreeing with one another by a degree, one in eight
lost. By a queue that commands one action a frame, of the newest chunk, and by `ActionFollower` at 100 Hz.

Then five streams of targets and measured joints, ten seconds each, with noise (1 mm, 0.5 deg; joints 0.1 deg):

    inside    the hand turns the tool in ways that five joints cannot
    leaving   it leaves the workspace and comes back, three times
    offset    a joint is measured 3 deg outside the limits of the URDF
    missed    one frame in ten is missed, and sometimes ten in a row
    jumps     the target jumps across the workspace every second

Run: python examples/17_teleoperation.py [URDF]      needs the extra `robots` or a URDF of the arm; where placo is
installed, it runs too
"""

import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

import invariantqp as iq
from invariantqp.lerobot import ActionFollower, RobotKinematics
from invariantqp.robots import urdf_of

JOINTS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
FRAMES, RATE = 300, 30.0
LIMIT = np.degrees(10.0) / RATE  # what the URDF's velocity limit allows in a frame [deg]


class PlacoKinematics:
    """What LeRobot's own class does, on a URDF without meshes; `limited` switches on placo's velocity limits."""

    def __init__(self, urdf_path, frame, joint_names, *, limited=False):
        import placo

        tree = ET.parse(urdf_path)  # noqa: S314 (a file of this machine)
        for link in tree.iter("link"):
            for shape in (*link.findall("visual"), *link.findall("collision")):
                link.remove(shape)
        with tempfile.TemporaryDirectory() as folder:
            tree.write(Path(folder) / "robot.urdf")
            self.robot = placo.RobotWrapper(str(Path(folder) / "robot.urdf"))
        self.solver = placo.KinematicsSolver(self.robot)
        self.solver.mask_fbase(True)  # noqa: FBT003 (placo's signature)
        if limited:
            self.solver.dt = 1.0 / RATE
            self.solver.enable_velocity_limits(limited)
        self.frame, self.names = frame, joint_names
        self.tip = self.solver.add_frame_task(frame, np.eye(4))

    def inverse_kinematics(self, positions, target, position_weight=1.0, orientation_weight=0.01):
        for name, position in zip(self.names, np.radians(positions), strict=True):
            self.robot.set_joint(name, position)
        self.tip.T_world_frame = target
        self.tip.configure(self.frame, "soft", position_weight, orientation_weight)
        self.solver.solve(True)  # noqa: FBT003
        self.robot.update_kinematics()
        return np.degrees([self.robot.get_joint(name) for name in self.names])


def stream(kind, kinematics):
    """Start [deg], and for each frame: the target, what the encoders are off by [deg], whether it is in reach."""
    rng, t = np.random.default_rng(0), np.arange(FRAMES) / RATE
    waves = np.sin(np.outer(t, [0.9, 1.3, 1.1, 1.7, 0.7, 0.0])) * (50.0, 25.0, 25.0, 30.0, 60.0, 0.0)
    joints = waves + np.array([0.0, -30.0, 30.0, 35.0, 0.0, 20.0])
    if kind == "jumps":
        joints = np.repeat(joints[:: int(RATE)], int(RATE), axis=0)
    if kind == "offset":
        joints[:, 1] = -100.0 + 20.0 * np.sin(0.5 * t) ** 2  # at its lower limit now and then
    frames, wait = [], 0
    for k, q in enumerate(joints):
        target = kinematics.forward_kinematics(q)
        out = max(0.0, np.sin(2.0 * np.pi * t[k] / 3.3)) if kind == "leaving" else 0.0
        target[:3, 3] *= 1.0 + 0.8 * out
        turn = (
            0.4 * np.array([np.sin(t[k]), np.cos(0.8 * t[k]), np.sin(1.4 * t[k])]) if kind != "jumps" else np.zeros(3)
        )
        noise = iq.exp(np.concatenate((turn + np.radians(0.5) * rng.normal(size=3), np.zeros(3))))
        target[:3, :3] = noise[:3, :3] @ target[:3, :3]
        target[:3, 3] += 1e-3 * rng.normal(size=3)
        off = 0.1 * rng.normal(size=6)
        off[1] -= 3.0 * (kind == "offset")
        wait = 0 if out or (kind == "jumps" and k % int(RATE) == 0) else wait + 1
        missed = kind == "missed" and (rng.uniform() < 0.1 or k % 100 > 90)
        frames.append(None if missed else (target, off, wait > 10))
    return joints[0], frames


def follow(solver, start, frames, forward):
    """Median and largest step [limit of a frame], frames above it, frames without an answer, errors in reach [mm]."""
    q, steps, errors, refused = start.copy(), [], [], 0
    for frame in frames:
        if frame is None:
            continue
        target, off, in_reach = frame
        measured = q + off
        try:
            q = solver.inverse_kinematics(measured, target)
        except RuntimeError:  # placo has no answer: the arm stays
            refused += 1
            continue
        steps.append(np.abs(q - measured).max() / LIMIT)
        if in_reach:
            errors.append(1e3 * np.linalg.norm(forward(q)[:3, 3] - target[:3, 3]))
    steps, errors = np.array(steps), np.array(errors)
    return np.median(steps), steps.max(), int((steps > 1.0 + 1e-9).sum()), refused, np.median(errors), errors.max()


ACCELERATION, JERK, PERIOD, END = 1500.0, 60000.0, 0.01, 8.0  # [deg/s^2], [deg/s^3], [s], [s]


def wanted(t):
    """What the policy is about, at a time [deg]."""
    ease = np.minimum(t, 1.0) ** 2 * (3.0 - 2.0 * np.minimum(t, 1.0))
    ways = np.sin(np.multiply.outer(t, [0.8, 1.1, 0.9, 1.3, 0.6, 1.0])) * (40.0, 15.0, 15.0, 20.0, 50.0, 20.0)
    return np.array([0.0, -30.0, 30.0, 35.0, 0.0, 40.0]) + np.multiply.outer(ease, np.ones(6)) * ways


def chunks():
    """(arrival, observed, actions (1, 50, 6)), in order of arrival."""
    rng, sent, t = np.random.default_rng(0), [], 0.0
    while t < END:
        actions = wanted(t + np.arange(50) / RATE) + rng.normal(size=6) + 0.1 * rng.normal(size=(50, 6))
        if t == 0.0 or rng.random() > 1 / 8:
            sent.append((t + rng.uniform(0.15, 0.35), t, actions[None].astype(np.float32)))
        t += 15 / RATE
    return sent


def by_queue(kinematics):
    """Positions commanded frame by frame: the newest chunk's action of that frame, the last one where it is over."""
    del kinematics
    answers, sent = [], chunks()
    for now in np.arange(0.0, END, 1.0 / RATE):
        come = [chunk for chunk in sent if chunk[0] <= now]
        if come:
            k = min(round((now - come[-1][1]) * RATE), 49)
            answers.append(come[-1][2][0, k])
        else:
            answers.append(wanted(0.0))
    return np.array(answers), 1.0 / RATE


def by_follower(kinematics):
    """Positions commanded at 100 Hz."""
    robot = ActionFollower(kinematics, acceleration_limit=ACCELERATION, jerk=JERK, fps=RATE, period=PERIOD)
    robot.reset(wanted(0.0))
    answers, sent = [], chunks()
    for now in np.arange(0.0, END, PERIOD):
        while sent and sent[0][0] <= now:
            _, observed, actions = sent.pop(0)
            robot.follow(actions, observed)
        answers.append(robot.step(now))
    return np.array(answers), PERIOD


def policy(kinematics):
    """What joints have to do for the chunks, and how far the tool is off what the policy is about."""
    print("chunks by               speed   acceleration         jerk   tool off, rms mm")
    for name, run in (("a queue of actions", by_queue), ("ActionFollower", by_follower)):
        Q, period = run(kinematics)
        v = np.diff(Q[:, :5], axis=0) / period
        a = np.diff(v, axis=0) / period
        most = [np.abs(x).max() for x in (v, a, np.diff(a, axis=0) / period)]
        off = [
            1e3 * np.linalg.norm((kinematics.forward_kinematics(q) - kinematics.forward_kinematics(wanted(t)))[:3, 3])
            for q, t in zip(Q[1:], np.arange(1, len(Q)) * period, strict=True)
            if t > 0.6
        ]
        print(f"{name:20s}{most[0]:9.0f}{most[1]:15.0f}{most[2]:13.0f}{np.sqrt(np.mean(np.square(off))):19.1f}")
    print(f"limits              {np.degrees(10.0):9.0f}{ACCELERATION:15.0f}{JERK:13.0f}\n")


def main():
    path, frame = sys.argv[1] if len(sys.argv) > 1 else urdf_of("so101"), "gripper_frame_link"
    kinematics = RobotKinematics(path, frame, JOINTS)
    policy(kinematics)
    solvers = {"ours": lambda: RobotKinematics(path, frame, JOINTS)}
    try:
        PlacoKinematics(path, frame, JOINTS)
        solvers["placo, as in LeRobot"] = lambda: PlacoKinematics(path, frame, JOINTS)
        solvers["placo, velocity limits"] = lambda: PlacoKinematics(path, frame, JOINTS, limited=True)
    except ImportError:
        print("placo is not installed: ours alone")
    print("stream   by                       joint steps / limit   frames above  without   tool off in reach, mm")
    print("                                  median    largest    the limit    an answer   median    largest")
    above = 0
    for kind in ("inside", "leaving", "offset", "missed", "jumps"):
        for name, make in solvers.items():
            usual, most, count, none, median, worst = follow(
                make(), *stream(kind, kinematics), kinematics.forward_kinematics
            )
            print(f"{kind:8s} {name:24s}{usual:7.2f}{most:11.2f}{count:13d}{none:13d}{median:9.4f}{worst:11.4f}")
            above += count if name == "ours" else 0
    print(f"ours: {above} steps above the limit")


main()
