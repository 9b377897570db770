"""An SO-101's hand is asked for what is out of its reach, and then comes back: LeRobot's kinematics class, and ours.

Both are called as LeRobot calls its class, 30 times a second, and what comes back is where the joints are next. Left,
LeRobot's own calls of placo (a run that was recorded, where placo is not installed: 5 joints, degrees, a line a frame;
`--record` records it again). Right, `invariantqp.lerobot.RobotKinematics`.

Run: python examples/16_out_of_reach.py [film.gif [frames]]     prints how fast joints move, and draws it
     python examples/16_out_of_reach.py --picture               draws examples/pictures/out_of_reach.gif
"""

import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from invariantqp.lerobot import RobotKinematics
from invariantqp.robots import urdf_of
from invariantqp.robots.urdf import read_xml
from invariantqp.workbench.view.appearance import appearance_of

HERE = Path(__file__).parent
PICTURE, RECORDED = HERE / "pictures" / "out_of_reach.gif", HERE / "shared" / "out_of_reach_placo.csv"
JOINTS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"]
START = np.array([0.0, -20.0, 30.0, 40.0, 0.0])  # [deg]
FARTHEST = np.array([0.55, 0.05, 0.20])  # [m] from the base; the arm ends 0.1 m before it
RATE, SECONDS, HELD = 30, 5.5, (1.5, 3.5)  # [1/s]; the target stays out of reach between these [s]
VIEW = np.array([[0.88, -0.47, 0.0], [-0.1, -0.19, 0.98], [0.46, 0.86, 0.21]])  # to paper, and towards the eye
LIGHT = np.array([0.3, -0.5, 0.8])


def target(start, t):
    """The hand's pose at time t [s]."""
    share = np.interp(t, [0.0, HELD[0], HELD[1], HELD[0] + HELD[1]], [0.0, 1.0, 1.0, 0.0])
    pose = start.copy()
    pose[:3, 3] += share * share * (3.0 - 2.0 * share) * (FARTHEST - start[:3, 3])
    return pose


def followed(kinematics, start):
    """Joint positions (k, 5) [deg], a frame each."""
    q = [START]
    for i in range(round(SECONDS * RATE)):
        q.append(kinematics.inverse_kinematics(q[-1], target(start, i / RATE)))
    return np.array(q)


class Placo:
    """What LeRobot's class does: src/lerobot/model/kinematics.py."""

    def __init__(self, urdf):
        import placo

        root = read_xml(urdf)[1]
        for link in root.findall("link"):  # their meshes' addresses are not placo's
            for shape in (*link.findall("visual"), *link.findall("collision")):
                link.remove(shape)
        with tempfile.TemporaryDirectory() as folder:
            ET.ElementTree(root).write(Path(folder) / "robot.urdf")
            self.robot = placo.RobotWrapper(folder, placo.Flags.ignore_collisions)
        self.solver = placo.KinematicsSolver(self.robot)
        self.solver.mask_fbase(True)  # noqa: FBT003 (placo's call)
        self.tip = self.solver.add_frame_task("gripper_frame_link", np.eye(4))

    def inverse_kinematics(self, q, pose):
        """LeRobot's default weights."""
        for name, angle in zip(JOINTS, np.radians(q), strict=True):
            self.robot.set_joint(name, angle)
        self.robot.update_kinematics()
        self.tip.T_world_frame = pose
        self.tip.configure("gripper_frame_link", "soft", 1.0, 0.01)
        self.solver.solve(True)  # noqa: FBT003 (placo's call)
        self.robot.update_kinematics()
        return np.degrees([self.robot.get_joint(name) for name in JOINTS])


def fastest(q):
    """(k,) the fastest joint's speed in each frame [deg/s]."""
    return RATE * np.abs(np.diff(q, axis=0, prepend=q[:1])).max(axis=1)


def triangles(parts, robot, q):
    """Triangles (n, 3, 2) on paper and their colours (n, 3), the farthest first."""
    moved = robot.motions(np.radians(q))
    corners = np.vstack([(p.vertices @ moved[p.joint][:3, :3].T + moved[p.joint][:3, 3])[p.faces] for p in parts])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None] + 1e-12
    colours = np.vstack([np.tile(np.array(p.colour) / 255.0, (len(p.faces), 1)) for p in parts])
    colours *= (0.55 + 0.45 * np.clip(normals @ LIGHT, 0.0, 1.0))[:, None]
    paper = corners @ VIEW.T
    front = normals @ VIEW[2] > 0.0
    order = np.argsort(paper[front, :, 2].mean(axis=1))
    return paper[front][order][:, :, :2], colours[front][order]


def draw(found, file, frames, robot, start):
    parts = appearance_of(robot, lambda: urdf_of("so101")).parts
    figure = Figure(figsize=(8.5, 4.0), dpi=100)
    figure.subplots_adjust(left=0.0, right=1.0, top=0.91, bottom=0.0, wspace=0.0)
    panels = []
    for axes, (title, q) in zip(figure.subplots(1, 2), found.items(), strict=True):
        axes.set(xlim=(-0.17, 0.55), ylim=(-0.14, 0.47), aspect="equal", title=title)
        axes.set_axis_off()
        axes.title.set(fontsize=14, fontweight="bold")
        arm = axes.add_collection(PolyCollection([], linewidths=0.2))
        axes.axhline(VIEW[1, 2] * -0.01, color="#BBBBBB", zorder=0)
        goal = axes.plot([], [], "+", color="#D55E00", markersize=17, markeredgewidth=3, zorder=5)[0]
        axes.text(0.04, 0.88, "+ the hand's target", color="#D55E00", transform=axes.transAxes, fontsize=13)
        text = axes.text(0.04, 0.8, "", transform=axes.transAxes, fontsize=13)
        panels.append((arm, goal, text, q, fastest(q)))

    def show(k):
        i = round(k / max(frames - 1, 1) * (len(found[title]) - 1))
        wanted = target(start, i / RATE)[:3, 3]
        for arm, goal, text, q, speed in panels:
            faces, colours = triangles(parts, robot, q[i])
            arm.set_verts(faces)
            arm.set(facecolors=colours, edgecolors=colours)
            goal.set_data(*(VIEW[:2] @ wanted)[:, None])
            text.set_text(f"fastest joint {speed[i]:,.0f} deg/s")

    FuncAnimation(figure, show, frames=frames).save(file, writer=PillowWriter(fps=15))


def main(word, frames):
    ours = RobotKinematics("so101", joint_names=JOINTS)
    start = ours.forward_kinematics(START)
    if word == "--record":
        np.savetxt(RECORDED, followed(Placo(urdf_of("so101")), start), fmt="%.3f", delimiter=",")
        return
    try:
        placo, how = followed(Placo(urdf_of("so101")), start), ""
    except ImportError:
        placo, how = np.loadtxt(RECORDED, delimiter=","), " (recorded)"
    found = {"LeRobot's kinematics (placo)": placo, "the same calls, invariantqp": followed(ours, start)}
    late = round((HELD[1] - 0.5) * RATE), round(HELD[1] * RATE)
    for title, q in found.items():
        held = fastest(q)[slice(*late)].max()
        print(f"{title}{how if q is placo else ''}: a target held out of reach moves joints at {held:,.1f} deg/s;")
        print(f"  {fastest(q).max():,.0f} at most, on the way; at the end {np.abs(q[-1] - START).max():.1g} deg off")
    draw(found, PICTURE if word == "--picture" else word, frames, ours.robot, start)


if __name__ == "__main__":
    words = dict(enumerate(sys.argv))
    main(words.get(1, "out_of_reach.gif"), int(words.get(2, 83)))
