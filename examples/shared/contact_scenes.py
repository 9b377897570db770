"""Scenes of contact for an arm's pose: what the world pushes back with, what the controller is told, where to go.

surface   the tip is pushed out along the normal in proportion to how deep it is; friction where it is said
hole      a peg touches its hole with its tip and at the mouth, past a clearance
grip      the tool holds something that moves along one screw, and is pulled back to it in proportion

Each also as what MuJoCo is to simulate: a pen's tip of 2 mm, a hole of eight flat walls, a handle tied at four points.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np

import invariantqp as iq
from invariantqp.geometry.se3 import cross, displacement, pose_along_z
from invariantqp.workbench.runs.mujoco import Solid, Solids, ball_at
from invariantqp.workbench.runs.plant import HingeSprings, Plane, SurfaceSprings

TURN, RIGHT, CREEP = 4.0, np.array([0.05**2] * 3 + [1.0] * 3), 1e-3  # [s] a turn; what a twist weighs; [m/s]


@dataclass(frozen=True)
class Scene:
    """One scene; poses, twists and wrenches in the base frame.

    Attributes:
        told: the contact for a tool pose, as the controller is told it.
        wanted: what to exert, in the told contact's constraints.
        world: wrench on the tool (m; f) for its pose and twist.
        path: target and its twist at a time [s].
        off: how far along the path a pose is from another [m].
        missing: how far a wrench is from the wanted force at a pose [N]; None where nothing can be pressed.
        options: of the task, such as a stiffness.
        touch: the same world for MuJoCo; None where it has no shape for it.
    """

    told: Callable
    wanted: list
    world: Callable
    path: Callable
    off: Callable
    missing: Callable
    options: dict
    touch: SurfaceSprings | HingeSprings | Solids | None


def gradient(height, p):
    return np.array([height(p + 1e-6 * e) - height(p - 1e-6 * e) for e in np.eye(3)]) / 2e-6


def at(point, force):
    return np.concatenate((cross(point, force), force))


def surface(heights, told, path, touch, wanted=(5.0,), k=1e4, friction=0.0, over=None, **options):
    """Surfaces by functions that are zero on them, grow outwards and are nothing where `over` is negative."""

    def world(tool, twist):
        p, force = tool[:3, 3], np.zeros(3)
        slide = twist[3:] + cross(twist[:3], p)
        for height in heights:
            depth = max(0.0, -height(p)) if over is None or over(p) > 0.0 else 0.0
            n = gradient(height, p)
            across = slide - n * (n @ slide)
            force += k * depth * (n - friction * across / max(np.linalg.norm(across), CREEP))
        return at(p, force)

    def off(tool, target):
        miss = target[:3, 3] - tool[:3, 3]
        for height in heights:
            n = gradient(height, tool[:3, 3])
            miss = miss - n * (n @ miss)
        return np.linalg.norm(miss)

    def missing(tool, wrench):
        if over is not None and over(tool[:3, 3]) < 0.0:
            return None
        presses = [gradient(height, tool[:3, 3]) @ wrench[3:] for height in heights]
        return max((p - w for p, w in zip(presses, wanted, strict=True)), key=abs)

    return Scene(told, list(wanted), world, path, off, missing, options, touch)


def hole(mouth, axis, told, path, clearance=5e-5, stiffness=1e4, radius=0.01):
    """A peg along the tool's z in a hole: pushed back at the tip and where it passes the mouth."""
    pose, wide, long = pose_along_z(axis, mouth), (radius + clearance) * np.tan(pi / 8.0), 0.03
    turns = [iq.exp([0.0, 0.0, i * pi / 4.0, 0.0, 0.0, 0.0]) for i in range(8)]
    wall = iq.transform(translation=[radius + clearance + wide, 0.0, long])
    walls = [Solid("box", (wide, wide, long), pose @ turn @ wall) for turn in turns]
    peg = Solid("capsule", (radius, long), iq.transform(translation=[0.0, 0.0, -long]))

    def world(tool, _):
        tip, along = tool[:3, 3], tool[:3, 2]
        depth, wrench = axis @ (tip - mouth), np.zeros(6)
        for p in (tip, tip - along * depth / (axis @ along)) if depth > 0.0 else ():
            aside = p - mouth - axis * (axis @ (p - mouth))
            far = np.linalg.norm(aside)
            wrench += at(p, -stiffness * max(0.0, far - clearance) * aside / max(far, 1e-12))
        return wrench

    def off(tool, target):
        return abs(axis @ (target[:3, 3] - tool[:3, 3]))

    def missing(_, wrench):
        return np.linalg.norm(wrench[3:] - axis * (axis @ wrench[3:]))

    return Scene(told, [0.0] * 4, world, path, off, missing, {}, Solids(tuple(walls), (peg,), stiffness))


def grip(start, screw, told, path, stiffness=1e4, **options):
    """Something held that moves along a screw from a pose: 1e4 N/m and 50 Nm/rad at the tool pull it back."""
    K = stiffness * np.array([5e-3] * 3 + [1.0] * 3)
    handle = np.sqrt(5e-3) * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])

    def nearest(tool):
        """How far along the screw, and how far off it: a twist at the tool [m], by three steps of Newton's method."""
        a, to_tool = 0.0, iq.adjoint(iq.transform(translation=-tool[:3, 3]))
        local = to_tool @ screw
        for _ in range(3):
            miss = to_tool @ displacement(iq.exp(a * screw) @ start, tool)
            a += (local @ (K * miss)) / (local @ (K * local))
        return a, to_tool @ displacement(iq.exp(a * screw) @ start, tool)

    def world(tool, _):
        return iq.coadjoint(iq.transform(translation=tool[:3, 3])) @ (-K * nearest(tool)[1])

    def off(tool, target):
        a = nearest(tool)[0] - nearest(target)[0]
        there = iq.adjoint(iq.transform(translation=-tool[:3, 3])) @ screw
        return abs(a) * np.sqrt(there @ (RIGHT * there))

    def missing(tool, wrench):
        """Without friction and inertia along the way that is free."""
        local = iq.adjoint(iq.transform(translation=-tool[:3, 3])) @ screw
        there = local[3:] / np.linalg.norm(local[3:])
        return np.linalg.norm(wrench[3:] - there * (there @ wrench[3:]))

    touch = HingeSprings(handle, start, screw, stiffness)
    return Scene(told, [0.0] * 5, world, path, off, missing, options, touch)


def circle(start, radius):
    def path(t):
        a, target, ahead = 2.0 * pi * t / TURN, start.copy(), np.zeros(6)
        target[:3, 3] += radius * start[:3, :3] @ [cos(a) - 1.0, sin(a), 0.0]
        ahead[3:] = 2.0 * pi / TURN * radius * start[:3, :3] @ [-sin(a), cos(a), 0.0]
        return target, ahead

    return path


def along(start, twist):
    """There and back along a twist, in a turn."""

    def path(t):
        a = 2.0 * pi * t / TURN
        return iq.exp((1.0 - cos(a)) / 2.0 * twist) @ start, pi / TURN * sin(a) * twist

    return path


def scenes(start, radius):
    """Scenes by name for a tool pose at the start and the radius of the circle [m]."""
    x, y, z = start[:3, 0], start[:3, 1], -start[:3, 2]  # z outwards, against the tool
    tip, foot = start[:3, 3], start[:3, 3] - 0.002 * z
    round_ = circle(start, radius)

    def pen(shape, k=1e4):
        return SurfaceSprings(np.zeros((1, 3)), shape, k)

    def flat(n, told=None, k=1e4, **options):
        told, touch = n if told is None else told, pen(Plane(foot, n), k)
        return surface(
            [lambda p: n @ (p - foot)], lambda tool: iq.point_contact(tool[:3, 3], told), round_, touch, k=k, **options
        )

    def curved(height, touch):
        return surface([height], lambda tool: iq.contacts.surface_contact(tool[:3, 3], implicit=height), round_, touch)

    def solids(*world):
        return Solids(world, (ball_at(np.zeros(3), start[:3, :3].T @ z),), 1e4)

    def turned(degrees, about=x):
        return iq.exp([*np.deg2rad(degrees) * about, 0, 0, 0])[:3, :3]

    def floor(p):
        return z @ (p - foot)

    def to_edge(p):
        return 1.5 * radius - x @ (p - tip)

    wall = foot - 0.002 * x  # two millimetres beside the pen
    corner = iq.contacts.two_contacts(iq.point_contact(tip, z), iq.point_contact(tip, x))
    slide = iq.se3.prismatic
    post = tip + 0.3 * y
    hinge, bolt = iq.revolute(z, post), iq.se3.helical(z, tip, 0.01)
    lean = turned(2.0) @ -z
    return {
        "plane": flat(z),
        "plane, tilted 30 deg": flat(turned(30.0) @ z),
        "normal told 5 deg wrong": flat(turned(5.0) @ z, told=z),
        "the same, found": flat(turned(5.0) @ z, told=z, normal_within=0.2),
        "5 deg wrong, friction 0.3": flat(turned(5.0) @ z, told=z, friction=0.3),
        "the same, found by motion": flat(turned(5.0) @ z, told=z, friction=0.3, normal_within=0.2),
        "friction 0.3": flat(z, friction=0.3),
        "soft, 1e3 N/m": flat(z, k=1e3),
        "hard, 1e5 N/m": flat(z, k=1e5),
        "1e6 N/m": flat(z, k=1e6),
        "1e6 N/m, told": flat(z, k=1e6, stiffness=1e6),
        "ball of 150 mm": curved(
            lambda p: np.linalg.norm(p - foot + 0.15 * z) - 0.15,
            solids(Solid("sphere", (0.15,), iq.transform(translation=foot - 0.15 * z))),
        ),
        "bar of 100 mm": curved(
            lambda p: np.linalg.norm(np.cross(x, p - foot + 0.1 * z)) - 0.1,
            solids(Solid("cylinder", (0.1, 1.0), pose_along_z(x, foot - 0.1 * z))),
        ),
        "waves, by a function": curved(lambda p: floor(p) + 0.01 * sin(40.0 * x @ (p - foot)), None),
        "over an edge and back": surface(
            [floor],
            lambda tool: iq.contacts.surface_contact(tool[:3, 3], implicit=floor, extent=to_edge),
            along(start, 2.0 * radius * slide(x)),
            pen(Plane(foot, z, (1.5 * radius * x,))),
            over=to_edge,
            edge_margin=0.005,
        ),
        "corner, two contacts": surface(
            [floor, lambda p: x @ (p - wall)],
            lambda tool: corner.moved(iq.transform(translation=tool[:3, 3] - tip)),
            along(start, 2.0 * radius * slide(y)),
            solids(*(Solid("plane", (), pose_along_z(n, p)) for n, p in ((z, foot), (x, wall - 0.002 * x)))),
            wanted=(5.0, 3.0),
        ),
        "peg, hole tilted 2 deg": hole(
            tip + 0.005 * z,
            lean,
            lambda tool: iq.contacts.peg_in_hole(tool[:3, 3], -z),
            along(start, 0.02 * slide(-z)),
        ),
        "door, hinge 10 mm off": grip(
            start,
            hinge,
            lambda _: iq.contacts.hinge(post + 0.01 * x, z),
            along(start, 0.3 * hinge),
        ),
        "screw, 63 mm a turn": grip(
            start,
            bolt,
            lambda _: iq.contacts.hinge(tip, z, 0.01),
            along(start, 1.5 * bolt),
        ),
    }
