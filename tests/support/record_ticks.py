"""Record ticks of closed loops of every kind, and single calls, with the answers of the definition.

`PYTHONPATH=tests python -m support.record_ticks [FILE]` writes `tests/velocity/ticks.npz` anew, in some minutes. Do so
when the law changes, and say in the change which kinds changed. Seeds are fixed.
"""

from __future__ import annotations

import sys
import time
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import invariantqp as iq
from invariantqp.control import callbacks
from invariantqp.errors import NoPseudoinverse
from invariantqp.geometry.arrays import Array
from invariantqp.limits import Box, Capsule, Clearance, HalfSpace, LimitRows, Sphere, ToolSpeed
from invariantqp.robots import Chain
from invariantqp.velocity.backends import Backend
from invariantqp.velocity.definition import Answer, Tick, velocity
from invariantqp.velocity.solution import VelocitySolution
from support import random_ticks
from support.arms import READY
from support.recorded_ticks import FILE, Recorded, UserForm, record, solve, write

# Joint positions in the middle of the work space; other arms start in the middle of their ranges.
STARTS = READY | {
    "ur5e": (0.0, -1.2, 1.6, -0.6, -1.2, 0.3),
    "fr3": READY["panda"],
    "iiwa14": (0.0, 0.5, 0.0, -1.4, 0.0, 1.2, 0.0),
    "lite6": (0.0, 0.3, 1.2, 0.0, 0.9, 0.0),
    "gen3": (0.0, 0.5, 0.0, 1.4, 0.0, 1.0, 0.0),
    "scara": (-0.5, 1.2, -0.05, 0.3),
    "planar_3r": (0.4, 1.0, 0.6),
    "arm_3r": (0.0, 0.5, 0.8),
    "snake": (0.3, 0.4, -0.3, 0.5, 0.2, -0.4, 0.3),
    "ur5e on rail": (0.1, 0.0, -1.2, 1.6, -0.6, -1.2, 0.3),
    "panda on wheels": (0.0, 0.0, 0.0, *READY["panda"]),
    "two arms": (-0.4, 0.4, 1.2, -1.6, 1.2, 0.0, 0.0, -1.2, 1.6, -0.6, -1.2, 0.3),
    "four hinges": (0.3, -0.5, 0.6, 0.4),
    "hinge": (0.2,),
    "slide": (0.1,),
    "wrist": (0.2, 0.5, 0.3),
}
SIX_OR_SEVEN = ("panda", "ur5e", "xarm7", "iiwa14")
FEW = ("so101", "scara", "planar_3r", "arm_3r", "four hinges", "wrist")
Command = Callable[[iq.Controller, Array, int], VelocitySolution]


@cache
def robot(name: str) -> Chain:
    """The robot of a name in STARTS, or of any that the library knows."""
    x, z = np.eye(3)[[0, 2]]
    if name in {"scara", "planar_3r", "arm_3r"}:
        return iq.load_task(name).load_robot()
    if name == "snake":
        hinges = np.column_stack([iq.revolute(z, [0.15 * k, 0.0, 0.0]) for k in range(7)])
        return Chain(hinges, iq.transform(translation=[1.05, 0.0, 0.0]), (), -2.0, 2.0, 1.5)
    if name == "ur5e on rail":
        return iq.robots.stand_on(iq.robots.rail([0.0, 1.0, 0.0], -1.0, 1.0, 0.5), robot("ur5e"))
    if name == "panda on wheels":
        return iq.robots.stand_on(iq.robots.mobile_base(0.5, 1.0), robot("panda"))
    if name == "two arms":
        beside = iq.robots.stand_on(iq.transform(translation=[0.0, 0.9, 0.0]), robot("lite6"))
        return iq.robots.relative(robot("ur5e"), beside)
    if name == "four hinges":
        from invariantqp.workbench.compare.arms import random_arm

        return random_arm(4, 0)
    if name == "hinge":
        return Chain(
            iq.revolute(z, [0.1, 0.2, 0.0])[:, None], iq.transform(translation=[0.4, 0.2, 0.1]), (), -1, 1, 1.5
        )
    if name == "slide":
        return Chain(iq.se3.prismatic(x)[:, None], iq.transform(translation=[0.4, 0.2, 0.1]), (), -0.5, 0.5, 0.3)
    if name == "wrist":
        axes = np.column_stack([iq.revolute(u, [0.0, 0.0, 0.3]) for u in (z, x, z + x)])
        return Chain(axes, iq.transform(translation=[0.0, 0.0, 0.4]), (), -2.0, 2.0, 3.0)
    return iq.load_robot(name)


def start(name: str) -> Array:
    """(m,) joint positions from which an arm sets out."""
    if name in STARTS:
        return np.array(STARTS[name])
    chain = robot(name)
    return 0.5 * (np.maximum(chain.position_lower, -2.0) + np.minimum(chain.position_upper, 2.0)) + 0.2


def closed_loop(
    name: str, command: Command, ticks: int, keep: int, *, q: Array | None = None, noise: float = 0.0, **options: Any
) -> list[Tick]:
    """`keep` ticks out of those of a closed loop in which the joints do exactly what is commanded.

    Measured positions may have noise [rad, length], from the same seed in each loop.
    """
    loop = iq.Controller(robot(name), backend="daqp", **({"dt": 0.004} | options))
    rng, q = np.random.default_rng(0), start(name) if q is None else q
    given: list[Tick] = []

    def keeping(tick: Tick, backend: Backend | None = None) -> Answer:
        given.append(tick)
        return velocity(tick, backend)

    with patch.object(callbacks, "velocity", keeping), suppress(NoPseudoinverse):
        for k in range(ticks):
            q = q + loop.dt * command(loop, q + noise * rng.normal(size=len(q)), k).velocity
    return [given[i] for i in np.unique(np.linspace(0, len(given) - 1, keep).round().astype(int))] if given else []


def to(target: Array, **more: Any) -> Command:
    """Go to a pose."""
    return lambda loop, q, k: loop.step(q, target, **more)


def along(path: Callable[[float], Array]) -> Command:
    """Follow a moving pose, with its motion as feedforward."""

    def command(loop: iq.Controller, q: Array, k: int) -> VelocitySolution:
        t, h = k * loop.dt, 1e-4
        ahead = iq.log(path(t + h) @ iq.se3.inverse(path(t - h))) / (2.0 * h)
        return loop.step(q, path(t), ahead)

    return command


def twisting(twist: Array, **more: Any) -> Command:
    """Follow a twist that swings."""
    return lambda loop, q, k: loop.follow(q, np.sin(12.0 * k * loop.dt + 0.3) * twist, **more)


def reached(name: str, rng: np.random.Generator, size: float = 0.5) -> Array:
    """A pose that the arm can reach, with joints about this far from its start [rad]."""
    return robot(name).pose(start(name) + size * rng.normal(size=len(start(name))))


def moved(name: str, x: float = 0.0, y: float = 0.0, z: float = 0.0, turn: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    """The pose at the start, moved and turned in place."""
    T = robot(name).pose(start(name)).copy()
    T[:3, :3] = iq.exp([*turn, 0.0, 0.0, 0.0])[:3, :3] @ T[:3, :3]
    T[:3, 3] += (x, y, z)
    return T


def circle(name: str, radius: float, frequency: float) -> Callable[[float], Array]:
    """A circle in the vertical plane through the tool, with a turn."""

    def path(t: float) -> Array:
        angle = 2.0 * np.pi * frequency * t
        y, z = radius * np.sin(angle), radius * (np.cos(angle) - 1.0)
        return moved(name, y=y, z=z, turn=(0.2 * np.sin(angle), 0.0, 0.1 * np.sin(angle)))

    return path


def every_arm(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """One goal for each arm."""
    for name in (*STARTS, "ur3e", "ur10e", "ur16e", "iiwa7", "kinova", "z1", "talos", "tiago", "so100", "ur3", "ur10"):
        yield closed_loop(name, to(reached(name, rng)), 60, 6)


def free_motion(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Near goals, no limit active."""
    for name in (*SIX_OR_SEVEN, "so101", "planar_3r", "scara"):
        yield closed_loop(name, to(reached(name, rng, 0.05)), 100, 18, gain=2.0)


def velocity_limits(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Far goals with a high gain; one loop with an operator's slider, one with lower limits."""
    for name in (*SIX_OR_SEVEN, "so101", "gen3"):
        yield closed_loop(name, to(reached(name, rng, 0.8)), 60, 15, gain=40.0)
        yield closed_loop(name, to(reached(name, rng), speed=0.4, velocity_limit=0.3), 40, 6)


def braking(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Acceleration limits, at the start and on the way to rest."""
    for name in (*SIX_OR_SEVEN, "so101", "scara"):
        for acceleration, gain in ((10.0, 20.0), (2.0, 5.0)):
            yield closed_loop(name, to(reached(name, rng)), 150, 12, gain=gain, acceleration_limit=acceleration)


def position_limits(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Goals beyond joint ranges."""
    for name in ("panda", "fr3", "iiwa14", "so101", "lite6", "scara"):
        chain, q = robot(name), start(name)
        for side in (chain.position_lower, chain.position_upper):
            beyond = np.where(np.isfinite(side) & (rng.random(len(q)) < 0.5), side + 0.1 * np.sign(side - q), q)
            yield closed_loop(name, to(chain.pose(beyond)), 120, 12, gain=10.0, position_margin=0.01)


def stretched_elbow(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Straight through a stretched or folded elbow."""
    del rng
    for name, elbow, dt in (("ur5e", 2, 0.004), ("ur5", 2, 0.01), ("panda", 3, 0.004), ("xarm7", 3, 0.002)):
        q = start(name)
        q[elbow] = 0.35 * np.sign(q[elbow] or 1.0)
        T = robot(name).pose(q)
        for way in (0.25, -0.1):
            goal = T.copy()
            goal[:3, 3] += way * T[:3, 3] / np.linalg.norm(T[:3, 3])
            yield closed_loop(name, to(goal), 150, 20, q=q, dt=dt, gain=8.0)


def wrist(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Through a singular wrist, exactly and past it."""
    for name, at in (("ur5e", 4), ("ur5", 4), ("lite6", 4), ("iiwa14", 5)):
        for past in (0.0, 1e-6, 0.02):
            q = start(name)
            q[at] = past
            target = robot(name).pose(q + 0.3 * rng.normal(size=len(q)))
            yield closed_loop(name, to(target), 80, 12, q=q, gain=8.0)


def out_of_reach(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Led out of reach, to rest there, and home again."""
    del rng
    at_position = {"exact": "position"}
    for name, options in (
        ("ur5e", {}),
        ("panda", {}),
        ("so101", at_position),
        ("ur5e", at_position),
        ("planar_3r", {}),
    ):
        T = robot(name).pose(start(name))
        away = T[:3, 3] / np.linalg.norm(T[:3, 3])

        def path(t: float, T: Array = T, away: Array = away) -> Array:
            share = np.clip(0.8 * t, 0.0, 1.0) - np.clip(0.8 * (t - 3.0), 0.0, 1.0)
            return iq.transform(translation=0.8 * share * away) @ T

        def command(loop: iq.Controller, q: Array, k: int, path: Callable[[float], Array] = path) -> Any:
            return loop.step(q, path(k * loop.dt))

        yield closed_loop(name, command, 550, 36, dt=0.01, **options)


def exact_position(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """The tool's origin is met exactly, alone or with its axis, with and without limits that slow it down."""
    axis = iq.control.ExactAxis([0.0, 0.0, 1.0])
    for name in ("panda", "ur5e", "so101", "xarm7", "arm_3r"):
        for exact, gain in (("position", 3.0), ("position", 60.0), (["position", axis], 20.0)):
            yield closed_loop(name, to(reached(name, rng)), 80, 10, exact=exact, gain=gain)


def exact_rows(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """One row or a few: a plane, an axis, joints; some contradict the limits, some depend on each other."""
    for name in ("panda", "ur5e", "so101", "scara"):
        m = len(start(name))
        plane = iq.control.ExactPlane([0.0, 0.3, 1.0], [0.0, 0.0, 0.1])
        fast = iq.ExactRows(np.eye(m)[:1], [5.0])
        pair = iq.ExactRows(np.vstack([np.eye(m)[0] - np.eye(m)[1], np.eye(m)[1] - np.eye(m)[2]]), [0.1, 0.0])
        twice = iq.ExactRows(np.vstack([np.eye(m)[:2], np.eye(m)[:2]]), [0.1, -0.1, 0.1, -0.1])
        for exact in (plane, iq.control.ExactAxis([0.2, 0.0, 1.0]), fast, pair, twice):
            yield closed_loop(name, to(reached(name, rng)), 60, 8, exact=exact, gain=15.0)
        outside = robot(name).position_upper + 0.05
        q = np.where(np.arange(m) == 1, np.where(np.isfinite(outside), outside, start(name)), start(name))
        still = iq.ExactRows(np.eye(m)[1:2], [0.2])
        yield closed_loop(name, to(reached(name, rng)), 40, 8, q=q, exact=still, far_outside="return")


def limit_rows(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Rows on the joint velocity, fixed and as a function of the joint positions."""
    for name in ("panda", "ur5e", "so101", "scara"):
        m = len(start(name))
        C = rng.normal(size=(3, m))
        fixed = LimitRows(C, -0.2 * np.ones(3), [0.1, np.inf, 0.3], ["first", "second", "third"])

        def wall(q: Array, name: str = name) -> LimitRows:
            z = robot(name).pose(q)[2, 3] - robot(name).pose(start(name))[2, 3] + 0.03
            p = robot(name).pose(q)[:3, 3]
            J = robot(name).jacobian(q)
            return LimitRows((J[3:] + np.cross(J[:3].T, p).T)[2:], [-10.0 * z], [np.inf], "wall")

        for limits in ([fixed], [wall], [fixed, wall]):
            yield closed_loop(name, to(reached(name, rng)), 80, 10, limits=limits, gain=15.0)
        yield closed_loop(name, to(reached(name, rng)), 80, 10, limits=[fixed, wall], acceleration_limit=8.0)


def contradicting_rows(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Rows beyond each other or beyond the joints' limits, with and without a tool speed beside them."""
    for name in ("panda", "ur5e", "so101", "scara"):
        m = len(start(name))
        row = rng.normal(size=m)
        apart = LimitRows([row, row], [0.1, -np.inf], [np.inf, -0.1])
        beyond = LimitRows(np.eye(m)[:1], [2.0 * robot(name).velocity_limit[0]], [np.inf], "joint")
        both = LimitRows(np.eye(m)[:2], 1.2 * robot(name).velocity_limit[:2], [np.inf, np.inf])
        for limits in ([apart], [beyond], [both, apart], [apart, ToolSpeed(0.02)], [beyond, ToolSpeed(0.05)]):
            yield closed_loop(name, to(reached(name, rng)), 24, 8, limits=limits)


def tool_speed(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """The speed limit of a point of the tool, also beside rows and exact rows."""
    for name in ("panda", "ur5e", "xarm7", "so101"):
        C = rng.normal(size=(2, len(start(name))))
        for options in (
            {"tool_speed": 0.1},
            {"tool_speed": ToolSpeed(0.05, [0.0, 0.1, 0.2]), "rows": LimitRows(C, [-0.1, -0.2], [0.1, 0.2])},
            {"tool_speed": 0.08, "exact": "position"},
        ):
            yield closed_loop(name, to(reached(name, rng)), 50, 12, gain=10.0, **options)


def clearance(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Beside a table, a box and a ball, with and without braking and a delay."""
    x, y, z = np.eye(3)
    for name in ("panda", "ur5e", "so101"):
        tool = robot(name).pose(start(name))
        place = tool[:3, 3]
        around = [
            HalfSpace([0.0, 0.0, place[2] - 0.1], [0.0, 0.0, 1.0], name="table"),
            Box(iq.transform(translation=place + 0.2 * x), [0.1, 0.1, 0.1], name="box"),
            Sphere(place + 0.2 * y + 0.1 * z, 0.08, name="ball"),
        ]
        finger = Capsule([0.0, 0.0, 0.0], [0.0, 0.0, 0.1], 0.03, name="finger")
        for options in ({}, {"delay": 0.008}, {"delay": 0.008, "acceleration_limit": 10.0}):
            limit = Clearance(robot(name), {"tool": [finger]}, around, distance=0.02)
            goal = tool @ iq.transform(translation=0.3 * rng.normal(size=3))
            yield closed_loop(name, to(goal), 60, 14, gain=8.0, limits=[limit], **options)


def delay(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Dead time of one tick and of several."""
    for name in (*SIX_OR_SEVEN, "so101"):
        for late, options in ((0.004, {}), (0.03, {}), (0.02, {"acceleration_limit": 8.0})):
            yield closed_loop(name, to(reached(name, rng)), 80, 8, delay=late, **options)


def forms(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Pitches with and without damping and guard, complements, definite forms."""
    for name in (*FEW, "panda", "ur5e"):
        m = len(start(name))
        rank = np.linalg.matrix_rank(robot(name).jacobian(start(name)))
        M = rng.normal(size=(6, 6))
        choices: list[dict[str, Any]] = [
            {"form": 0.3},
            {"form": -0.1, "guard": False},
            {"form": 0.05, "damping": 0.1, "acceleration_limit": 10.0},
            {"form": 0.5, "damping": 0.02, "guard": iq.velocity.Guard(0.9)},
            {"form": -0.3, "damping": 0.005, "guard": iq.velocity.Guard(0.97)},
            {"form": UserForm(M @ M.T + 0.1 * np.eye(6))},
        ]
        if rank < 6:
            choices += [{"form": iq.Complement(rng.normal(size=(6, 6 - rank)))}] * 2
            choices[-1] |= {"guard": False}
        for options in choices:
            yield closed_loop(name, to(reached(name, rng, 0.4 if m < 6 else 0.2)), 40, 4, **options)


def carried_metric(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """A metric that the tool carries, or a body at a fixed pose."""
    for name in ("panda", "ur5e", "so101", "arm_3r"):
        M = rng.normal(size=(6, 6))
        W = M @ M.T + 0.3 * np.eye(6)
        for form in (iq.CarriedMetric(W), iq.CarriedMetric([0.1, 0.2, 0.1, 1.0, 2.0, 1.0], iq.exp(rng.normal(size=6)))):
            yield closed_loop(name, to(reached(name, rng)), 60, 12, form=form, gain=15.0)


def joint_metric(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """A joint metric, diagonal and full, with limits, rows, exact rows and a tool speed."""
    for name in ("panda", "ur5e", "so101", "scara"):
        m = len(start(name))
        M = rng.normal(size=(m, m))
        row = LimitRows(rng.normal(size=(2, m)), [-0.2, -0.1], [0.1, 0.3])
        full = M @ M.T + 0.5 * np.eye(m)
        for options in (
            {"joint_metric": np.diag(10.0 ** rng.uniform(-1.0, 1.0, m))},
            {"joint_metric": full, "limits": [row]},
            {"joint_metric": full, "exact": iq.control.ExactPlane([0.0, 0.0, 1.0]), "tool_speed": 0.15},
        ):
            yield closed_loop(name, to(reached(name, rng)), 60, 12, gain=15.0, **options)


def posture(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """With and without a posture, and with one that changes from tick to tick."""
    for name in ("panda", "xarm7", "iiwa14", "gen3", "ur5e on rail", "snake"):
        q = start(name)
        for options in ({"posture": False}, {"posture": q + 0.4 * rng.normal(size=len(q)), "posture_gain": 5.0}):
            yield closed_loop(name, to(reached(name, rng, 0.2)), 60, 8, **options)
        wanted = 0.5 * rng.normal(size=len(q))
        yield closed_loop(name, twisting(0.2 * rng.normal(size=6), posture=wanted), 50, 8)


def feedforward(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Moving targets with their twist, slow ones and ones that outrun the limits."""
    del rng
    for name in (*SIX_OR_SEVEN, "so101"):
        for radius, frequency, options in (
            (0.05, 0.5, {}),
            (0.15, 1.5, {"acceleration_limit": 20.0}),
            (0.2, 2.0, {"gain": 20.0}),
        ):
            yield closed_loop(name, along(circle(name, radius, frequency)), 150, 10, **options)


def twists(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """A twist by itself, slow and fast, with acceleration limits and with exact rows."""
    for name in (*SIX_OR_SEVEN, "so101", "planar_3r"):
        for size, options in ((0.1, {}), (2.0, {}), (1.0, {"acceleration_limit": 5.0}), (1.0, {"exact": "position"})):
            yield closed_loop(name, twisting(size * rng.normal(size=6)), 60, 7, **options)


def noise(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Noise of encoders."""
    for name in ("panda", "ur5e", "xarm7", "so101"):
        for size in (2e-5, 3e-4):
            goal = reached(name, rng, 0.2)
            yield closed_loop(name, to(goal), 80, 12, noise=size, gain=10.0)
            yield closed_loop(name, to(goal), 80, 6, noise=size, acceleration_limit=10.0)


def rates(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """From 1000 Hz to 50 Hz."""
    for dt in (0.001, 0.002, 0.008, 0.01, 0.02):
        for name in ("panda", "ur5e", "so101"):
            yield closed_loop(name, to(reached(name, rng)), 60, 8, dt=dt)


def outside_limits(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Starts outside the position limits, near and far."""
    for name in ("panda", "iiwa14", "so101", "scara", "lite6"):
        chain, q = robot(name), start(name)
        for far in (0.01, 0.3):
            beyond = chain.position_upper + far
            out = np.where(np.isfinite(beyond) & (rng.random(len(q)) < 0.5), beyond, q)
            options = {} if far < 0.1 else {"acceleration_limit": 8.0, "exact": "position" if len(q) > 4 else None}
            yield closed_loop(name, to(reached(name, rng)), 100, 14, q=out, far_outside="return", **options)


def several_bodies(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Two or three bodies at once, with limits, rows and memory."""
    for k in range(120):
        J = random_ticks.random_jacobian(
            rng, int(rng.integers(3, 13)), 2 + k % 2, ("random", "arm", "dependent")[k % 3]
        )
        tick = random_ticks.unlimited(rng, J, random_ticks.random_twist(rng, J, 0.5))
        tick = random_ticks.with_limits(rng, tick, 0.5, ("none", "wide", "tight", "mixed")[k % 4])
        tick = random_ticks.with_rows(rng, tick, 2) if k % 5 == 0 else tick
        tick = random_ticks.with_exact_rows(rng, tick) if k % 7 == 0 else tick
        tick = random_ticks.with_posture(rng, tick, velocity_limit=k % 8 == 0) if k % 4 == 0 else tick
        tick = replace(tick, metric=random_ticks.random_metric(rng, J.shape[1])) if k % 6 == 0 else tick
        yield [random_ticks.with_memory(rng, tick) if k % 2 else tick]


def priorities(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """The second of two levels: the twist that the first achieves is exact."""
    for k in range(100):
        J = random_ticks.random_jacobian(rng, int(rng.integers(4, 13)), 2, ("random", "arm")[k % 2])
        first = random_ticks.unlimited(rng, J[:6], random_ticks.random_twist(rng, J[:6], 0.5))
        first = random_ticks.with_limits(rng, first, 0.5, ("none", "wide", "tight")[k % 3])
        first = random_ticks.with_memory(rng, first) if k % 4 < 2 else first
        answer = solve(first)
        if not isinstance(answer, str):
            s = random_ticks.random_twist(rng, J[6:], 0.5)
            exact = J[:6], J[:6].dot(answer.velocity), np.zeros(6)
            yield [replace(first, J=J[6:], feedforward=0.0 * s, error=s, exact=exact)]


def single_calls(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Calls without memory, with and without damping, on any Jacobian."""
    for k in range(200):
        kind = random_ticks.JACOBIANS[k % 5]
        J = random_ticks.random_jacobian(rng, int(rng.integers(1, 10)), 1, kind)
        tick = random_ticks.unlimited(rng, J, random_ticks.random_twist(rng, J, 0.5))
        tick = random_ticks.with_limits(rng, tick, 0.5, ("none", "tight")[k % 2])
        yield [replace(tick, damping=float(10.0 ** rng.uniform(-4.0, -0.5)) if k % 3 else 0.0)]


def scales(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Joint twists and velocities a thousand times as large or as small."""
    for k in range(160):
        J = rng.choice(random_ticks.SCALES) * random_ticks.random_jacobian(
            rng, int(rng.integers(2, 9)), 1, random_ticks.JACOBIANS[k % 5]
        )
        speed = float(rng.choice((1e-3, 1.0, 1e3)))
        tick = random_ticks.unlimited(rng, J, random_ticks.random_twist(rng, J, speed))
        tick = random_ticks.with_limits(rng, tick, speed, ("none", "wide", "tight", "mixed")[k % 4])
        tick = random_ticks.with_rows(rng, tick, 3) if k % 3 == 0 else tick
        tick = random_ticks.with_exact_rows(rng, tick) if k % 5 == 0 else tick
        yield [random_ticks.with_memory(rng, tick) if k % 2 else tick]


def big(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """30 and 64 joints, up to 200 rows; the numbers of rows are short, so that the file is small."""
    for k in range(8):
        m = (30, 64)[k % 2]
        J = random_ticks.random_jacobian(rng, m, 1, "random")
        tick = random_ticks.unlimited(rng, J, random_ticks.random_twist(rng, J, 0.5))
        tick = random_ticks.with_limits(rng, tick, 0.5, "tight")
        if k >= 4:
            tick = random_ticks.with_rows(rng, tick, (50, 200)[k % 4 // 2])
            tick = replace(tick, rows=tick.rows._replace(C=np.round(8.0 * tick.rows.C) / 8.0))
        tick = random_ticks.with_exact_rows(rng, tick) if k == 3 else tick
        yield [random_ticks.with_memory(rng, tick)]


def no_width(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Joints and rows without room: some joints are held, or move at a given speed."""
    for k in range(120):
        J = random_ticks.random_jacobian(rng, int(rng.integers(2, 9)), 1, random_ticks.JACOBIANS[k % 2])
        tick = random_ticks.unlimited(rng, J, random_ticks.random_twist(rng, J, 0.5))
        tick = random_ticks.with_limits(rng, tick, 0.5, "tight")
        held = rng.random(J.shape[1]) < (0.3, 0.3, 1.0)[k % 3]
        value = (0.0, 0.3)[k % 2] * tick.upper
        tick = replace(tick, lower=np.where(held, value, tick.lower), upper=np.where(held, value, tick.upper))
        if k % 4 == 0:
            tick = random_ticks.with_rows(rng, tick, 2)
            tick = replace(tick, rows=tick.rows._replace(lower=np.zeros(2), upper=np.zeros(2)))
        tick = random_ticks.with_exact_rows(rng, tick) if k % 5 == 0 else tick
        yield [random_ticks.with_memory(rng, tick) if k % 2 else tick]


def one_joint(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Arms of one joint, in loops of every kind."""
    for name in ("hinge", "slide"):
        row = LimitRows([[1.0]], [-0.1], [0.05])
        for options in (
            {},
            {"gain": 50.0},
            {"limits": [row]},
            {"tool_speed": 0.05},
            {"exact": iq.control.ExactPlane([1.0, 0.3, 0.0])},
            {"acceleration_limit": 2.0},
            {"form": 0.2},
            {"delay": 0.01},
        ):
            yield closed_loop(name, to(reached(name, rng, 0.6)), 60, 6, **options)
        yield closed_loop(name, twisting(rng.normal(size=6)), 60, 10)


def random_kind(rng: np.random.Generator) -> Iterator[list[Tick]]:
    """Any tick of `random_tick`; of at most 12 joints and 8 rows, so that the file is small."""
    left = 400
    while left:
        tick = random_ticks.random_tick(rng)
        if tick.J.shape[1] <= 12 and (tick.rows is None or len(tick.rows.C) <= 8):
            left -= 1
            yield [tick]


KINDS: tuple[Callable[[np.random.Generator], Iterable[list[Tick]]], ...] = (
    every_arm, free_motion, velocity_limits, braking, position_limits, stretched_elbow, wrist, out_of_reach,
    exact_position, exact_rows, limit_rows, contradicting_rows, tool_speed, clearance, delay, forms, carried_metric,
    joint_metric, posture, feedforward, twists, noise, rates, outside_limits, several_bodies, priorities, single_calls,
    scales, big, no_width, one_joint, random_kind,
)  # fmt: skip


def recorded(make: Callable[[np.random.Generator], Iterable[list[Tick]]]) -> list[Recorded]:
    """The ticks of a kind with their answers."""
    kind = make.__name__.replace("_", " ")
    rng = np.random.default_rng(zlib.crc32(kind.encode()))
    return [record(kind, tick) for ticks in make(rng) for tick in ticks]


def main() -> None:
    """Record all kinds, and say how many ticks each has."""
    warnings.simplefilter("ignore")  # of gains and limits that are chosen to be odd
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else FILE
    all_of_them: list[Recorded] = []
    for make in KINDS:
        begun = time.perf_counter()
        found = recorded(make)
        all_of_them += found
        failures = Counter(one.answer for one in found if isinstance(one.answer, str))
        loose = sum(one.sensitivity > 1e-9 for one in found)
        seconds = time.perf_counter() - begun
        print(
            f"{found[0].kind:20} {len(found):5} ticks {seconds:6.1f} s, {loose:3} sensitive", dict(failures), flush=True
        )
    write(path, all_of_them)
    print(f"{len(all_of_them)} ticks, {path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
