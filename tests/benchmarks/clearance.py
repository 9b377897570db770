"""Clearance in long runs: targets that jump, distances seen by coal, Pink and mink told the same.

    PYTHONPATH=tests python tests/benchmarks/clearance.py run panda --ticks 100000 [--dt 0.001] [--delay 0.02] [--acceleration 10]
    PYTHONPATH=tests python tests/benchmarks/clearance.py meet           two UR5s, each led by a loop with a clearance of the other
    PYTHONPATH=tests python tests/benchmarks/clearance.py peers          ours, Pink and mink: runs, faces, told to stay inside
    PYTHONPATH=tests python tests/benchmarks/clearance.py reach ur5      around a box: how many arrive
    PYTHONPATH=tests python tests/benchmarks/clearance.py hold           led into an obstacle: whether an arm comes to rest
    PYTHONPATH=tests python tests/benchmarks/clearance.py stream         an SO-101 over a desk, led by a hand's poses
    PYTHONPATH=tests python tests/benchmarks/clearance.py time           a tick with and without, and of the rows alone

Scenes: "panda" over a table, "ur5" beside a box, "two" UR5s, of which one sweeps, "so101" over a desk, "desk": a
UR5 on one, beside a shelf, joints with narrow ranges, "crate": an xArm7 that reaches into one. Every figure of a
distance is coal's, of the same shapes in a Pinocchio model; none is the library's own.
"""

# ruff: noqa: E501, B008, C901 (figures are printed in long lines, each run is a script of its own)
from __future__ import annotations

import argparse
import sys
from functools import partial
from itertools import count as forever
from pathlib import Path
from time import perf_counter_ns, process_time_ns
from typing import NamedTuple

import numpy as np
import pinocchio as pin

sys.path.append(str(Path(__file__).parents[2] / "examples"))

from shared.clearance_peers import Peer, pinocchio_model

import invariantqp as iq
from invariantqp.control.loop_limits import loop_of
from invariantqp.limits import Box, Capsule, Clearance, HalfSpace, OtherArm

HOLD = 0.4  # how long a target stays [s]


class Scene(NamedTuple):
    robot: iq.robots.Chain
    bodies: dict
    obstacles: list
    start: np.ndarray
    exclude: list = []  # noqa: RUF012
    distance: float = 0.02
    where: tuple | None = None  # corners of what targets are in

    def clearance(self, **more):
        return Clearance(self.robot, self.bodies, self.obstacles, self.distance, exclude=self.exclude, **more)


def panda():
    robot = iq.load_robot("panda")
    c = Capsule
    bodies = {  # about what Franka's own collision model has
        "panda_link1": [c([0, 0, -0.333], [0, 0, -0.05], 0.08)],
        "panda_link2": [c([0, 0, -0.06], [0, 0, 0.06], 0.06)],
        "panda_link3": [c([0, 0, -0.22], [0, 0, -0.07], 0.06)],
        "panda_link4": [c([0, 0, -0.06], [0, 0, 0.06], 0.06)],
        "panda_link5": [c([0, 0, -0.31], [0, 0, -0.21], 0.06), c([0, 0.08, -0.19], [0, 0.08, -0.06], 0.025)],
        "panda_link6": [c([0, 0, -0.08], [0, 0, 0.01], 0.05)],
        "panda_link7": [c([0, 0, -0.06], [0, 0, 0.08], 0.04)],
        "panda_hand": [c([0, -0.06, 0.03], [0, 0.06, 0.03], 0.04), c([0, -0.04, 0.085], [0, 0.04, 0.085], 0.025)],
    }
    return Scene(robot, bodies, [HalfSpace([0, 0, 0], [0, 0, 1], name="table")], np.array([0, -0.4, 0, -2.2, 0, 1.8, 0.8]),
                 [("panda_link1", "table"), ("panda_link5", "panda_link7")])  # fmt: skip


def ur5():
    robot = iq.load_robot("ur5")
    box = Box(iq.transform(translation=[0.45, 0.0, 0.15]), [0.24, 0.4, 0.3], name="box")
    return Scene(robot, iq.robots.bodies_of(robot), [box], np.array([1.2, -1.4, 1.6, -1.8, -1.57, 0.0]))


def two():
    arm = iq.load_robot("ur5")
    other = iq.load_robot("ur5", base=iq.transform(np.diag([-1.0, -1.0, 1.0]), [0.9, 0.0, 0.0]))
    return Scene(arm, iq.robots.bodies_of(arm), [OtherArm(other, iq.robots.bodies_of(other))],
                 np.array([1.2, -1.4, 1.6, -1.8, -1.57, 0.0]))  # fmt: skip


def so101():
    robot = iq.load_robot("so101")
    return Scene(robot, iq.robots.bodies_of(robot), [HalfSpace([0, 0, -0.03], [0, 0, 1], name="desk")],
                 np.array([0.0, -0.5, 0.0, 0.4, 0.0]), [("base_link", "desk"), ("shoulder_link", "desk"), ("upper_arm_link", "base_link"),
                  ("lower_arm_link", "shoulder_link")], distance=0.01)  # fmt: skip


def desk():
    """A UR5 on a desk at z = 0, joints with narrow ranges, a shelf beside it."""
    q = np.array([1.2, -1.4, 1.6, -1.8, -1.57, 0.0])
    robot = iq.load_robot("ur5")
    ranges = np.array([2.2, 1.2, 1.3, 1.2, 1.2, 1.2])
    robot = robot.with_limits(position_lower=q - ranges, position_upper=q + ranges)
    shelf = Box(iq.transform(translation=[0.55, 0.3, 0.4]), [0.3, 0.3, 0.03], name="shelf")
    return Scene(robot, iq.robots.bodies_of(robot), [HalfSpace([0, 0, 0], [0, 0, 1], name="desk"), shelf], q)


def crate():
    """An xArm7 that reaches into an open crate, on the floor."""
    robot = iq.load_robot("xarm7")
    walls = [Box(iq.transform(translation=[0.45 + x, y, 0.1]), size, name=name)
             for name, x, y, size in (("front", -0.25, 0.0, [0.02, 0.5, 0.2]), ("back", 0.25, 0.0, [0.02, 0.5, 0.2]),
                                      ("left", 0.0, 0.25, [0.5, 0.02, 0.2]), ("right", 0.0, -0.25, [0.5, 0.02, 0.2]))]  # fmt: skip
    start = np.array([0.0, -0.3, 0.0, 1.0, 0.0, 1.3, 0.0])
    return Scene(robot, iq.robots.bodies_of(robot), [HalfSpace([0, 0, 0], [0, 0, 1], name="floor"), *walls], start,
                 [("link_base", "floor")], where=([0.2, -0.25, 0.0], [0.7, 0.25, 0.4]))  # fmt: skip


SCENES = {"panda": panda, "ur5": ur5, "two": two, "so101": so101, "desk": desk, "crate": crate}


class Judge:
    """Distances by coal, of the pairs that no motion since can have kept from being near; places are Pinocchio's."""

    def __init__(self, scene, clearance):
        self.model, self.geometry = pinocchio_model(clearance)
        self.data, self.places = self.model.createData(), pin.GeometryData(self.geometry)
        self.others = [Around(clearance, k, self.geometry.geometryObjects) for k in range(len(clearance.arms))]
        own = [(geom.joints, geom.shape, one.placement.translation)
               for geom, one in zip(clearance._geoms, self.geometry.geometryObjects, strict=True) if geom.is_own_link]  # fmt: skip
        self.reach, self.seen, self.q = reaches(self.model, own), 0, None
        self.used = np.flatnonzero(np.isfinite(clearance._distances(scene.start)))
        self.enough, self.travelled = scene.distance + 0.011, 0.0
        self.due = np.full(len(self.used), -np.inf)  # how far anything has travelled when a pair may be near

    def __call__(self, q):
        """The least distance, where anything may be nearer than 11 mm more than is kept; else infinite."""
        moved = [other.moved() for other in self.others]
        self.travelled += sum(moved) + float(self.reach @ np.abs(q - (q if self.q is None else self.q)))
        self.q = q
        looked = np.flatnonzero(self.due <= self.travelled).tolist()
        if not looked:
            return np.inf
        self.seen += 1
        for other in self.others:
            other.placed()
        pin.updateGeometryPlacements(self.model, self.data, self.geometry, self.places, q)
        least = np.inf
        for i in looked:
            d = pin.computeDistance(self.geometry, self.places, int(self.used[i])).min_distance
            self.due[i], least = self.travelled + d - self.enough, min(least, d)
        return least


class Around:
    """Another arm of a clearance, by a Pinocchio model of its own."""

    def __init__(self, clearance, k, objects):
        self.arm = clearance.arms[k]
        self.model, self.q = self.arm.robot.model, self.arm.q.copy()
        self.data = self.model.createData()
        pin.forwardKinematics(self.model, self.data, self.q)
        self.shapes = [(one, geom.joints, self.data.oMi[geom.joints].inverse() * one.placement)
                       for geom, one in zip(clearance._geoms, objects, strict=True) if geom.arm == k + 1]  # fmt: skip
        sizes = [geom.shape for geom in clearance._geoms if geom.arm == k + 1]
        own = [(body, shape, place.translation) for (_, body, place), shape in zip(self.shapes, sizes, strict=True)]
        self.reach = reaches(self.model, own)

    def moved(self):
        """How far any point of it has come since it was last asked [m]."""
        moved, self.q = float(self.reach @ np.abs(self.arm.q - self.q)), self.arm.q.copy()
        return moved

    def placed(self):
        """Its shapes where its joints are."""
        pin.forwardKinematics(self.model, self.data, self.arm.q)
        for one, body, place in self.shapes:
            one.placement = self.data.oMi[body] * place


def reaches(model, shapes):
    """(m,) how far a point of any of (joint, shape, place) is from the axis of a hinge and those behind it, at most [m]."""
    far = np.zeros(model.njoints)
    for joint, shape, place in shapes:
        far[joint] = max(far[joint], np.linalg.norm(place) + np.linalg.norm(shape.half) + shape.radius)
    for joint in reversed(range(2, model.njoints)):
        far[joint - 1] = max(far[joint - 1], far[joint] + np.linalg.norm(model.jointPlacements[joint].translation))
    return far[1:]


def targets(robot, rng, where=None):
    low, high = np.maximum(robot.position_lower, -np.pi), np.minimum(robot.position_upper, np.pi)
    while True:
        T = robot.pose(rng.uniform(low, high))
        if where is not None:
            T[:3, 3] = rng.uniform(*where)
        yield T


def sweep(other, t, dt):
    """Where the second of two arms is at t [s], and how fast."""
    centre, wide = np.array([0.0, -1.2, 1.4, -1.7, -1.57, 0.0]), np.array([1.2, 0.3, 0.4, 0.3, 0.2, 0.0])
    rate = np.array([0.9, 1.3, 1.1, 0.7, 1.9, 1.0])
    other.move(centre + wide * np.sin(rate * t), wide * rate * np.cos(rate * t))


def handed_back(loop):
    """A list that grows by one in each tick of a loop that the core hands to Python."""
    by_core, found = loop._by_core, []

    def tick(*given):
        solution = by_core(*given)
        found.extend([True] * (solution is None))
        return solution

    loop._by_core = tick
    return found


def run(name, ticks, dt, delay, acceleration, seed=0, *, clear=True):
    scene = SCENES[name]()
    clearance = scene.clearance()
    judge, robot = Judge(scene, clearance), scene.robot
    rng = np.random.default_rng(seed)
    wanted = targets(robot, rng, scene.where)
    loop = iq.Controller(robot, dt=dt, delay=delay, acceleration_limit=acceleration,
                         limits=[clearance] if clear else [])  # fmt: skip
    back = handed_back(loop)
    q, d, x_before = scene.start.copy(), [], np.zeros(len(scene.start))
    queue = [np.zeros(len(q))] * round(delay / dt)
    statuses, reasons, times, change, outside = {}, {}, [], [], 0.0
    for i in range(ticks):
        if i % round(HOLD / dt) == 0:
            target = robot.target(next(wanted))
        if name == "two":
            sweep(scene.obstacles[0], i * dt, dt)
        begun = perf_counter_ns()
        solution = loop.step(q, target)
        times.append(perf_counter_ns() - begun)
        x = solution.velocity
        statuses[str(solution.status)] = statuses.get(str(solution.status), 0) + 1
        if solution.status == "degraded":
            reasons[solution.reason[:100]] = reasons.get(solution.reason[:100], 0) + 1
        queue.append(x)
        q = q + dt * queue.pop(0)
        if name == "two":
            sweep(scene.obstacles[0], (i + 1) * dt, dt)
        outside = max(outside, float((robot.position_lower - q).max()), float((q - robot.position_upper).max()))
        d.append(judge(q))
        change.append(float(np.abs(x - x_before).max()))
        x_before = x
    d, micro = np.array(d), np.array(times) * 1e-3
    print(f"{name}: {len(clearance.pairs)} pairs of bodies, {ticks} ticks of {dt * 1e3:g} ms, delay {delay * 1e3:g} ms, "
          f"acceleration {acceleration}; least distance {d.min() * 1e3:.3f} of {scene.distance * 1e3:g} mm, "
          f"inside 0: {int((d < 0).sum())} ticks, below by over 1 um: {np.sum(d < scene.distance - 1e-6) / ticks * 100:.2f} %; "
          f"seen by coal in {judge.seen} ticks, those in which anything may be near; "
          f"change of velocity p50 {np.median(change):.4f} p99 {np.percentile(change, 99):.3f}; tick p50 "
          f"{np.median(micro):.0f} p99.9 {np.percentile(micro, 99.9):.0f} us; outside limits {max(outside, 0.0):.1e}; handed back {len(back)}; {statuses}")  # fmt: skip
    for reason, count in sorted(reasons.items(), key=lambda item: -item[1])[:4]:
        print(f"    {count} x {reason}")


def meet(ticks, dt, acceleration, seed=0, delay=0.0):
    """Two UR5s, each with the other one as an obstacle, each told the other's joints and velocity a tick late.

    With a delay, each is told the other's last command, and its joints so that they are where commands in flight lead.
    """
    places = np.eye(4), iq.transform(np.diag([-1.0, -1.0, 1.0]), [0.9, 0.0, 0.0])
    arms = [iq.load_robot("ur5", base=T) for T in places]
    brakes = {} if acceleration is None else {"acceleration_limit": acceleration}
    others = [OtherArm(arm, iq.robots.bodies_of(arm), **brakes) for arm in arms[::-1]]
    limits = [Clearance(arm, iq.robots.bodies_of(arm), [other]) for arm, other in zip(arms, others, strict=True)]
    loops = [iq.Controller(arm, dt=dt, delay=delay, acceleration_limit=acceleration, limits=[limit])
             for arm, limit in zip(arms, limits, strict=True)]  # fmt: skip
    back = [handed_back(loop) for loop in loops]
    flying = [[np.zeros(6)] * round(delay / dt) for _ in arms]
    start = np.array([1.2, -1.4, 1.6, -1.8, -1.57, 0.0])
    q, x, rng = [start.copy(), start.copy()], [np.zeros(6), np.zeros(6)], np.random.default_rng(seed)
    told = bool(brakes)  # arms that stop at once share the room without it
    others[0].move(q[1], x[1])
    judge = Judge(Scene(arms[0], {}, [], start), limits[0])
    statuses, least = {}, np.inf
    for i in range(ticks):
        if i % round(HOLD / dt) == 0:  # in front of both, where they meet
            wanted = []
            for arm in arms:
                T = arm.pose(rng.uniform(-np.pi, np.pi, 6))
                T[:3, 3] = rng.uniform([0.1, -0.35, 0.05], [0.8, 0.35, 0.75])
                wanted.append(arm.target(T))
        for k in (0, 1):
            there = q[1 - k] + dt * np.sum(flying[1 - k], axis=0)
            others[k].move(*((there - delay * x[1 - k], x[1 - k]) if told else (there, None)))
        found = [loops[k].step(q[k], wanted[k]) for k in (0, 1)]
        x = [solution.velocity for solution in found]
        for queue, command in zip(flying, x, strict=True):
            queue.append(command)
        shown = [queue.pop(0) for queue in flying]
        q = [a + dt * b for a, b in zip(q, shown, strict=True)]
        for solution in found:
            statuses[str(solution.status)] = statuses.get(str(solution.status), 0) + 1
        others[0].move(q[1], x[1])
        least = min(least, judge(q[0]))
    print(f"two UR5s that know each other: {ticks} ticks of {dt * 1e3:g} ms, delay {delay * 1e3:g} ms, acceleration {acceleration}; least distance "
          f"{least * 1e3:.3f} of 20 mm, seen by coal in {judge.seen} ticks; handed back {sum(map(len, back))}; {statuses}", flush=True)  # fmt: skip


# Each at the gain of its own examples, and Pink at a stiffer one.
LAWS = {"ours": None, "mink": ("mink", 0.85), "Pink": ("Pink", 20.0), "Pink, gain 50": ("Pink", 50.0)}


def law(name, scene, clearance, dt, q, acceleration=None):
    if LAWS.get(name) is None:
        limits = [clearance] if name in LAWS else []
        loop = iq.Controller(scene.robot, dt=dt, acceleration_limit=acceleration, limits=limits)
        return lambda q, target: loop.step(q, target).velocity
    kind, gain = LAWS[name]
    return Peer(kind, clearance, dt, q, gain)


def follow(step, q, target, dt, ticks, judge):
    """Where the arm gets to, and its distances [m] and velocities."""
    distances, velocities = [judge(q)], []
    for i in range(ticks):
        x = step(q, target(i))
        q = q + dt * x
        velocities.append(x)
        distances.append(judge(q))
    return q, np.array(distances), np.array(velocities)


def peers(ticks):
    """Ours, Pink and mink: targets that jump, hands along a face, told to stay inside a box."""
    for name, dt in (("panda", 0.001), ("ur5", 0.002)):
        for label in LAWS:
            scene = SCENES[name]()
            clearance = scene.clearance()
            rng, judge = np.random.default_rng(0), Judge(scene, clearance)
            wanted = targets(scene.robot, rng)
            poses = [next(wanted) for _ in range(ticks)]
            step = law(label, scene, clearance, dt, scene.start)
            _, d, _ = follow(step, scene.start, lambda i, n=round(HOLD / dt), p=poses: p[i // n], dt, ticks, judge)
            print(f"{name}, targets that jump, {label:14s}: least {d.min() * 1e3:7.2f} mm of 20, inside {np.mean(d < 0) * 100:.1f} %",
                  flush=True)  # fmt: skip
    dt, scene = 0.002, panda()
    box = Box(iq.transform(translation=[0.5, 0.0, 0.1]), [0.3, 0.5, 0.2], name="box")
    scene = scene._replace(obstacles=[box], exclude=[("panda_link5", "panda_link7")])
    down = iq.transform(np.diag([1.0, -1.0, -1.0]), [0.5, 0.0, 0.3])
    start = iq.solve_pose(scene.robot, down, q0=[0, -0.1, 0, -2.2, 0, 2.1, 0.785]).q

    def along(i):
        at = down.copy()
        at[:3, 3] = 0.5 + 0.08 * np.sin(2 * np.pi * i * dt / 1.5), 0.05 * np.sin(2 * np.pi * i * dt / 1.1), 0.15
        return at

    compared = [(label, None) for label in ("without", *LAWS)]
    for label, acceleration in (*compared, ("without", 10.0), ("ours", 10.0)):
        clearance = scene.clearance()
        step = law(label, scene, clearance, dt, start, acceleration)
        _, d, v = follow(step, start, along, dt, 1000, Judge(scene, clearance))
        change = np.abs(np.diff(v[400:], axis=0)).max(axis=1)
        print(f"fingers along a face, {label:14s}, {acceleration} rad/s^2: change of joint velocity a tick, median {np.median(change):.4f} rad/s, "
              f"largest {change.max():.3f}; least {d.min() * 1e3:.2f} mm", flush=True)  # fmt: skip
    scene = ur5()
    rng, starts, clearance = np.random.default_rng(3), [], scene.clearance()
    judge = Judge(scene, clearance)
    while len(starts) < 12:
        q = rng.uniform(-np.pi, np.pi, 6)
        if -0.03 < judge(q) < -0.005:
            starts.append(q)
    for label in LAWS:
        moved = fastest = 0.0
        for q in starts:
            T = scene.robot.pose(q)
            end, _, v = follow(law(label, scene, clearance, dt, q), q, lambda _, T=T: T, dt, 1500, judge)
            moved = max(moved, float(np.linalg.norm((scene.robot.pose(end) - T)[:3, 3])))
            fastest = max(fastest, float(np.abs(v).max()))
        print(
            f"told to stay inside a box, {label:14s}: moved by up to {1e3 * moved:.1f} mm in 3 s of 12 starts, "
            f"fastest joint {fastest:.2f} rad/s",
            flush=True,
        )


def reach(name, count, seed):
    """Goals that laws reach only through something without a clearance: how many with one, and at which distance.

    Ours and the peers' (Pink and mink solve one problem) each have to go through something: where one of them alone
    does, the other's own way is free, and that is no contest.
    """
    dt, scene = 0.005, SCENES[name]()
    if name == "panda":
        block = Box(iq.transform(translation=[0.5, 0.0, 0.2]), [0.16, 0.24, 0.4], name="block")
        scene = scene._replace(obstacles=[*scene.obstacles, block])
    centre = np.array([0.5 if name == "panda" else 0.45, 0.0])
    robot, clearance = scene.robot, scene.clearance()
    judge, rng = Judge(scene, clearance), np.random.default_rng(11 + seed)
    low, high = np.maximum(robot.position_lower, -np.pi), np.minimum(robot.position_upper, np.pi)

    def free():
        while True:
            q = rng.uniform(low, high)
            T = robot.pose(q)
            if judge(q) > 0.03 and np.linalg.norm(T[:2, 3] - centre) < 0.45 and T[2, 3] < 0.6:
                return q

    def go(step, q, T, ticks):
        least = judge(q)
        for _ in range(ticks):
            x = step(q, T)
            q = q + dt * x
            least = min(least, judge(q))
            error = iq.log(T @ np.linalg.inv(robot.pose(q)))
            if np.linalg.norm(robot.pose(q)[:3, 3] - T[:3, 3]) < 0.003 and np.linalg.norm(error[:3]) < 0.017:
                return True, least
        return False, least

    tasks = []
    while len(tasks) < count:
        a, T = free(), robot.pose(free())
        loop = iq.Controller(robot, dt=dt)
        free_laws = (lambda q, T, loop=loop: loop.step(q, T).velocity, Peer("mink", clearance, dt, a, 0.85, kept=False))
        if all(arrived and least < 0.0 for arrived, least in (go(step, a, T, 600) for step in free_laws)):
            tasks.append((a, T))
    for label in LAWS:
        found = [go(law(label, scene, clearance, dt, a), a, T, 1200) for a, T in tasks]
        print(f"{name}, around obstacles, {label:14s}: {''.join('x' if f[0] else '.' for f in found)} {sum(f[0] for f in found)} of {count} reached, "
              f"{sum(f[0] and f[1] > 0.0195 for f in found)} of them with the distance kept, "
              f"{sum(f[1] < 0.0 for f in found)} went through something, least {min(f[1] for f in found) * 1e3:.2f} mm", flush=True)  # fmt: skip


def hold():
    """A Panda's hand led into its table and a UR5's tool into its box: how still they are from 4 to 6 s, by the acceleration."""
    table, box = panda(), ur5()
    down = iq.transform(np.diag([1.0, -1.0, -1.0]), [0.5, 0.0, -0.05])
    into = box.robot.pose(box.start)
    into[:3, 3] = 0.45, 0.0, 0.15
    for name, scene, target in (("a Panda into its table", table, down), ("a UR5 into its box", box, into)):
        for acceleration in (None, 10.0, 3.0):
            for dt in (0.001, 0.002, 0.01):
                loop = iq.Controller(scene.robot, dt=dt, acceleration_limit=acceleration, limits=[scene.clearance()])
                step = partial(lambda loop, q, target: loop.step(q, target).velocity, loop)
                _, _, x = follow(step, scene.start, lambda _, T=target: T, dt, round(6.0 / dt), lambda _: 0.0)
                x = x[round(4.0 / dt) :]
                change = np.diff(x, axis=0)
                turns = np.mean(change[1:] * change[:-1] < 0.0, axis=0).max()
                print(f"{name}, {acceleration} rad/s^2, {dt * 1e3:g} ms: change of joint velocity a tick, median "
                      f"{np.median(np.abs(change).max(axis=1)):.5f} rad/s of {(acceleration or np.inf) * dt:g}; it turns in "
                      f"{100.0 * turns:.0f} % of ticks; fastest {np.abs(x).max():.3f} rad/s", flush=True)  # fmt: skip


def stream(seconds, seed):
    """An SO-101 led over a desk by a hand's poses, 30 a second, late and noisy, that dip below the desk again and again."""
    scene, dt = so101(), 0.005
    for kept in (False, True):
        clearance = scene.clearance()
        judge, robot, rng = Judge(scene, clearance), scene.robot, np.random.default_rng(seed)
        loop = iq.Controller(
            robot, dt=dt, exact="position", acceleration_limit=20.0, limits=[clearance] if kept else []
        )
        follower = iq.Follower(loop)
        q, d, statuses, due, waves = scene.start.copy(), [], {}, 0.0, rng.uniform(0.1, 0.5, 3)
        home, phases = robot.pose(q), rng.uniform(0.0, 6.3, 3)
        for i in range(round(seconds / dt)):
            t = i * dt
            if t >= due:
                due = t + rng.uniform(0.5, 1.5) / 30.0
                away = np.array([0.06, 0.12, 0.12]) * np.sin(2.0 * np.pi * waves * t + phases) - [0.0, 0.0, 0.06]
                hand = home.copy()
                hand[:3, 3] += (away + 1e-3 * rng.normal(size=3)) * min(1.0, t)
                follower.add(hand)
            solution = follower.step(q)
            statuses[str(solution.status)] = statuses.get(str(solution.status), 0) + 1
            q = q + dt * solution.velocity
            d.append(judge(q))
        d = np.array(d)
        print(f"SO-101 by a hand, {'with' if kept else 'without'} a clearance of {scene.distance * 1e3:g} mm: {len(d)} ticks, "
              f"least distance {d.min() * 1e3:.2f} mm, below it {np.mean(d < scene.distance - 1e-4) * 100:.1f} % of ticks; {statuses}", flush=True)  # fmt: skip


def time():
    """The rows alone and a tick, with 21 and 31 pairs of shapes; the same loop without; tick by tick in turn.

    Each is repeated from the same state and memory and its least processor time taken: what a quiet machine takes. How
    fast the machine was is told by a plain loop.
    """
    block = Box(iq.transform(translation=[0.6, 0.1, 0.25]), [0.2, 0.2, 0.2], name="block")
    scenes = [panda()._replace(obstacles=[*panda().obstacles, *more]) for more in ([], [block])]
    times = {}
    loops = [timed(scene, acceleration, times) for acceleration in (None, 10.0) for scene in scenes]
    begun = process_time_ns()
    for _ in range(4000):
        for loop in loops:
            next(loop)
        times.setdefault("a plain loop of 500 additions", []).append(least(lambda: sum(i for i in range(500)))[0])
    for name, values in times.items():
        print(f"{name}: p50 {np.median(values):.1f}, p99 {np.percentile(values, 99):.1f}, p99.9 {np.percentile(values, 99.9):.1f} us; "
              f"p50 of quarters {', '.join(f'{np.median(part):.1f}' for part in np.array_split(values, 4))}")  # fmt: skip
    print(f"{1e-9 * (process_time_ns() - begun):.0f} s of processor time")


def least(call, *state, loop=None):
    """Of nine calls [us], and what the last returned; a loop's memory is what it was before each."""
    kept, times = None if loop is None else loop.state, []
    for _ in range(9):
        if loop is not None:
            loop.state = kept
        begun = process_time_ns()
        found = call(*state)
        times.append(1e-3 * (process_time_ns() - begun))
    return min(times), found


def timed(scene, acceleration, times):
    """Ticks towards targets that jump, each timed."""
    robot, m = scene.robot, len(scene.start)
    clearance, rng = scene.clearance(), np.random.default_rng(0)
    options = {"dt": 0.002, "acceleration_limit": acceleration}
    kept, free = iq.Controller(robot, limits=[clearance], **options), iq.Controller(robot, **options)
    brakes = np.full(m, np.inf if acceleration is None else acceleration)
    rows = clearance.for_loop(loop_of(robot, 0.002, 0.0)._replace(acceleration=brakes))
    called = f"{len(clearance._shape_pairs)} pairs of shapes, acceleration {acceleration}"
    found = [times.setdefault(f"{what} ({called})", []) for what in ("rows", "tick without", "tick with")]
    q, x, wanted = scene.start.copy(), np.zeros(m), targets(robot, rng)
    for i in forever():
        if i % 200 == 0:
            target = robot.target(next(wanted))
        found[0].append(least(rows.rows, q, x, loop=kept)[0])
        found[1].append(least(free.step, q, target, None, x, loop=free)[0])
        spent, solution = least(kept.step, q, target, None, x, loop=kept)
        found[2].append(spent)
        x = solution.velocity
        q = q + 0.002 * x
        yield


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["run", "meet", "peers", "reach", "hold", "stream", "time"])
    parser.add_argument("scene", nargs="?", choices=list(SCENES), default="panda")
    parser.add_argument("--ticks", type=int, default=20_000)
    parser.add_argument("--dt", type=float, default=0.001)
    parser.add_argument("--delay", type=float, default=0.0)
    parser.add_argument("--acceleration", type=float)
    parser.add_argument("--without", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    if given.what == "run":
        run(given.scene, given.ticks, given.dt, given.delay, given.acceleration, given.seed, clear=not given.without)
    elif given.what == "meet":
        meet(given.ticks, given.dt, given.acceleration, given.seed, given.delay)
    elif given.what == "peers":
        peers(given.ticks)
    elif given.what == "reach":
        reach(given.scene, 24, given.seed)
    elif given.what == "hold":
        hold()
    elif given.what == "stream":
        stream(given.ticks * given.dt, given.seed)
    else:
        time()


if __name__ == "__main__":
    main()
