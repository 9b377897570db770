"""An SO-101 follows a hand at 30 frames a second, by LeRobot's calls: joint steps and tool errors, placo's beside them.

Five streams of targets and measured joints, ten seconds each, with noise (1 mm, 0.5 deg; joints 0.1 deg):

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
from invariantqp.lerobot import RobotKinematics
from invariantqp.robots.load import urdf_of

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


def main():
    path, frame = sys.argv[1] if len(sys.argv) > 1 else urdf_of("so101"), "gripper_frame_link"
    kinematics = RobotKinematics(path, frame, JOINTS)
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
