"""Clearance in long runs: targets that jump, distances seen by coal, Pink and mink told the same.

    PYTHONPATH=tests python tests/benchmarks/clearance.py run panda --ticks 100000 [--dt 0.001] [--delay 0.02] [--acceleration 10]
    PYTHONPATH=tests python tests/benchmarks/clearance.py peers          ours, Pink and mink: runs, starts inside, faces
    PYTHONPATH=tests python tests/benchmarks/clearance.py reach ur5      around a box: how many arrive
    PYTHONPATH=tests python tests/benchmarks/clearance.py time           a tick with and without, and of the rows alone

Scenes: "panda" over a table, "ur5" beside a box, "two" UR5s, of which one sweeps, "so101" over a desk. Every figure of a
distance is coal's, of the same shapes in a Pinocchio model; none is the library's own.
"""

from __future__ import annotations

import argparse
from time import perf_counter_ns
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

import invariantqp as iq
from invariantqp.geometry.shapes import Core
from invariantqp.limits import Box, Capsule, Clearance, HalfSpace, OtherArm

HOLD = 0.4  # how long a target stays [s]


class Scene(NamedTuple):
    robot: iq.robots.Chain
    bodies: dict
    obstacles: list
    start: np.ndarray
    exclude: list = []  # noqa: RUF012
    distance: float = 0.02

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
                 np.array([0.0, -0.6, 0.6, 0.6, 0.0]), [("base_link", "desk")], distance=0.01)  # fmt: skip


SCENES = {"panda": panda, "ur5": ur5, "two": two, "so101": so101}


def model_of(scene, clearance):
    """The same pairs in a Pinocchio model, for coal."""
    model = scene.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, np.zeros(model.nq))
    geometry = pin.GeometryModel()
    made = {}
    for k, part in enumerate(clearance._parts):
        body = part.body
        T = (part.shape.pose if part.frame is None else part.frame) @ part.shape.place
        if part.shape.core is Core.SEGMENT:
            shape = coal.Capsule(part.shape.radius, 2.0 * float(part.shape.half[2]))
        elif part.shape.core is Core.BOX:
            shape = coal.Box(*(2.0 * part.shape.half))
        else:  # Pinocchio's pairs of coal take a half-space; MuJoCo has planes
            shape = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
        at = data.oMi[body].inverse() * pin.SE3(T[:3, :3], T[:3, 3])
        made[k] = geometry.addGeometryObject(pin.GeometryObject(f"{part.name} {k}", body, at, shape))
    for i, j in clearance._of_pair:
        geometry.addCollisionPair(pin.CollisionPair(made[i], made[j]))
    return model, geometry


class Judge:
    """The least distance in a state, by coal."""

    def __init__(self, scene, clearance):
        self.clearance = clearance
        self.model, self.geometry = model_of(scene, clearance)
        self.data, self.seen = self.model.createData(), pin.GeometryData(self.geometry)
        self.moving = [k for k, part in enumerate(clearance._parts) if part.frame is None]
        self.skipped = [k for k, d in enumerate(clearance._distances(scene.start)) if not np.isfinite(d)]
        for k in self.skipped:
            self.seen.deactivateCollisionPair(k)
        self.used = [k for k in range(len(self.geometry.collisionPairs)) if k not in self.skipped]

    def __call__(self, q):
        for k in self.moving:
            T = self.clearance._parts[k].shape.pose @ self.clearance._parts[k].shape.place
            self.geometry.geometryObjects[k].placement = pin.SE3(T[:3, :3], T[:3, 3])
        pin.updateGeometryPlacements(self.model, self.data, self.geometry, self.seen, q)
        pin.computeDistances(self.geometry, self.seen)
        return min(self.seen.distanceResults[k].min_distance for k in self.used)


def targets(robot, rng):
    low, high = np.maximum(robot.position_lower, -np.pi), np.minimum(robot.position_upper, np.pi)
    while True:
        yield robot.pose(rng.uniform(low, high))


def sweep(other, t, dt):
    """Where the second of two arms is at t [s], and how fast."""
    centre, wide = np.array([0.0, -1.2, 1.4, -1.7, -1.57, 0.0]), np.array([1.2, 0.3, 0.4, 0.3, 0.2, 0.0])
    rate = np.array([0.9, 1.3, 1.1, 0.7, 1.9, 1.0])
    other.move(centre + wide * np.sin(rate * t), wide * rate * np.cos(rate * t))


def run(name, ticks, dt, delay, acceleration, seed=0, clear=True, known=True):
    scene = SCENES[name]()
    clearance = scene.clearance()
    judge, robot = Judge(scene, clearance), scene.robot
    rng = np.random.default_rng(seed)
    wanted = targets(robot, rng)
    loop = iq.Controller(robot, dt=dt, delay=delay, acceleration_limit=acceleration,
                         limits=[clearance] if clear else [])  # fmt: skip
    q, d, x_before = scene.start.copy(), [], np.zeros(len(scene.start))
    queue = [np.zeros(len(q))] * round(delay / dt)
    statuses, reasons, times, change, worst, outside = {}, {}, [], [], (9.0, 0), 0.0
    for i in range(ticks):
        if i % round(HOLD / dt) == 0:
            target = robot.target(next(wanted))
        if name == "two":
            sweep(scene.obstacles[0], i * dt, dt)
            if not known:
                scene.obstacles[0].move(scene.obstacles[0].q)
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
          f"inside 0: {int((d < 0).sum())} ticks, below by over 1 um: {np.mean(d < scene.distance - 1e-6) * 100:.2f} %; "
          f"start {d[0] * 1e3:.1f} mm; "
          f"change of velocity p50 {np.median(change):.4f} p99 {np.percentile(change, 99):.3f}; tick p50 "
          f"{np.median(micro):.0f} p99.9 {np.percentile(micro, 99.9):.0f} us; outside limits {max(outside, 0.0):.1e}; {statuses}")  # fmt: skip
    for reason, count in sorted(reasons.items(), key=lambda item: -item[1])[:4]:
        print(f"    {count} x {reason}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["run", "peers", "reach", "time"])
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


if __name__ == "__main__":
    main()
