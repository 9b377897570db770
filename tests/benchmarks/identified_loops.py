"""Loops with identified contacts, compared with loops that have the true contact and a guess, on two arms.

A pen and an edge on a plane guessed 5 degrees off, a hinge and a screw 10 mm off, a peg 2 degrees. Demonstrations are
of a person's motion at the arm's start, with noise; the world is springs without mass and friction 0.3 on surfaces.

Run: python tests/benchmarks/identified_loops.py [panda] [xarm7] [--seconds 5] [--seeds 3]
"""

import sys
from argparse import ArgumentParser
from collections import Counter
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "examples")]

from shared.contact_scenes import along, grip, hole  # noqa: E402
from support.arms import READY  # noqa: E402
from support.recordings import frames, inverted, noisy, turned, wander  # noqa: E402

import invariantqp as iq  # noqa: E402

DT, STIFF, PRESS, FRICTION = 0.002, 1e4, 5.0, 0.3
ARMS = {name: READY[name] for name in ("panda", "xarm7")}
TIP = np.array([0.02, -0.01, 0.06])


def held(poses, wrenches):
    """Wrenches (m; f) about the base's origin, in the tool frames."""
    R, p = poses[:, :3, :3], poses[:, :3, 3]
    f = wrenches[:, 3:]
    m = wrenches[:, :3] - np.cross(p, f)
    return np.concatenate([np.einsum("nji,nj->ni", R, a) for a in (m, f)], axis=1)


class Plane:
    """A pen, or an edge along x of the tool with two ends 30 mm apart, on a plane 5 degrees off the nominal one."""

    def __init__(self, start, edge):
        self.start, self.x, down = start, start[:3, 0], -start[:3, 2]
        self.edge, self.guess = edge, down
        self.normal = turned(np.deg2rad(5.0) * self.x) @ down
        self.ends = [TIP + s * np.array([0.015, 0, 0]) for s in ((-1, 1) if edge else (0,))]
        self.foot = start[:3, :3] @ TIP + start[:3, 3] - 0.002 * self.normal

    def contact(self, normal, tip, edge=None):
        if not self.edge:
            return lambda tool: iq.point_contact(tool[:3, :3] @ tip + tool[:3, 3], normal)
        return lambda tool: iq.contacts.line_contact(tool[:3, :3] @ tip + tool[:3, 3], tool[:3, 0], normal)

    def world(self, tool, twist):
        w = np.zeros(6)
        for end in self.ends:
            p = tool[:3, :3] @ end + tool[:3, 3]
            depth = max(0.0, -(p - self.foot) @ self.normal)
            v = twist[3:] + np.cross(twist[:3], p)
            v = v - self.normal * (v @ self.normal)
            f = STIFF / len(self.ends) * depth * (self.normal - FRICTION * v / max(np.linalg.norm(v), 1e-3))
            w += np.concatenate((np.cross(p, f), f))
        return w

    def demonstration(self, rng, t):
        n = len(t)
        x = np.cross(self.start[:3, 1], self.normal)
        x /= np.linalg.norm(x)
        C = np.column_stack((x, np.cross(self.normal, x), self.normal))  # the plane's own frame
        spin = turned(np.stack((np.zeros(n), np.zeros(n), wander(rng, t, 0.2)), 1))
        if self.edge:
            lay = C @ spin @ turned(np.stack((wander(rng, t, 0.2), np.zeros(n), np.zeros(n)), 1))
        else:
            lay = C @ spin @ turned(np.stack((wander(rng, t, 0.15), wander(rng, t, 0.15), np.zeros(n)), 1))
        flip = np.diag([1.0, -1.0, -1.0])
        R = lay @ flip
        press = 8.0 * (1.0 + 0.25 * np.clip(wander(rng, t, 1.0), -2, 2))
        p = self.foot + np.outer(wander(rng, t, 0.04), C[:, 0]) + np.outer(wander(rng, t, 0.03), C[:, 1])
        p = p - np.outer(press / STIFF, self.normal)
        X = frames(R, p - R @ TIP)
        shares = np.exp(np.stack([wander(rng, t, 0.6) for _ in self.ends], 1))
        shares = shares / shares.sum(1)[:, None]
        w = np.zeros((n, 6))
        for end, share in zip(self.ends, shares.T, strict=True):
            q = R @ end + X[:, :3, 3]
            v = np.gradient(q, t[1] - t[0], axis=0)
            v = v - np.outer(v @ self.normal, self.normal)
            speed = np.sqrt((v**2).sum(1) + 1e-6)[:, None]
            f = (share * press)[:, None] * (FRICTION * v / speed - self.normal)  # exerted by the tool
            w += np.concatenate((np.cross(q, f), f), 1)
        return X, held(X, w)

    def path(self, t):
        a, target, ahead = 2.0 * np.pi * t / 4.0, self.start.copy(), np.zeros(6)
        u = np.cross(self.normal, self.start[:3, 1])
        u /= np.linalg.norm(u)
        v = np.cross(self.normal, u)
        target[:3, 3] += 0.03 * (u * (np.cos(a) - 1.0) + v * np.sin(a))
        ahead[3:] = 2.0 * np.pi / 4.0 * 0.03 * (-u * np.sin(a) + v * np.cos(a))
        return target, ahead

    def missing(self, _, wrench):
        return self.normal @ wrench[3:] - PRESS

    wanted = PRESS


class Joint:
    """A handle that moves along one screw, held by 1e4 N/m: 10 mm off, true, or identified."""

    wanted = 0.0

    def __init__(self, start, name):
        y, z = start[:3, 1], -start[:3, 2]
        self.start, self.z = start, z
        self.post = start[:3, 3] + (0.3 * y if name == "hinge" else 0.0)
        self.pitch = 0.0 if name == "hinge" else 0.01
        self.screw = iq.se3.helical(z, self.post, self.pitch)
        self.scene = grip(start, self.screw, None, along(start, (0.3 if name == "hinge" else 1.5) * self.screw))
        self.guess = self.post + 0.01 * start[:3, 0]
        self.world, self.path, self.missing = self.scene.world, self.scene.path, self.scene.missing

    def contact(self, point):
        fixed = iq.contacts.hinge(point, self.z, self.pitch)
        return lambda _: fixed

    def demonstration(self, rng, t):
        n, size = len(t), 0.25 if self.pitch == 0.0 else 1.0
        a = size * (1.0 - np.cos(2.0 * np.pi * t / t[-1])) + wander(rng, t, 0.05)
        K = STIFF * np.array([5e-3] * 3 + [1.0] * 3)
        F = np.stack([wander(rng, t, 4.0) + 2.0 * rng.normal() for _ in range(3)], 1)
        M = np.stack([wander(rng, t, 0.05) for _ in range(3)], 1)
        X, w = np.empty((n, 4, 4)), np.empty((n, 6))
        for i in range(n):
            on = iq.exp(a[i] * self.screw) @ self.start
            local = iq.adjoint(iq.transform(translation=-on[:3, 3])) @ self.screw
            load = np.concatenate((M[i], F[i]))
            load -= local * (local @ load) / (local @ local)
            give = load / K
            give -= local * (local @ (K * give)) / (local @ (K * local))
            X[i] = iq.transform(translation=on[:3, 3]) @ iq.exp(give) @ iq.transform(translation=-on[:3, 3]) @ on
            w[i] = np.concatenate((load[:3] + np.cross(X[i][:3, 3], load[3:]), load[3:]))
        return X, held(X, w)


class Peg:
    """A peg in its hole with 0.1 mm of clearance across, tilted by 2 degrees, true, or identified."""

    wanted = 0.0

    def __init__(self, start):
        x, z = start[:3, 0], -start[:3, 2]
        self.start, self.guess = start, -z
        self.axis = turned(np.deg2rad(2.0) * x) @ -z
        self.mouth = start[:3, 3] + 0.005 * z
        self.scene = hole(self.mouth, self.axis, None, along(start, 0.02 * iq.se3.prismatic(-z)))
        self.world, self.path, self.missing = self.scene.world, self.scene.path, self.scene.missing

    def contact(self, axis):
        return lambda tool: iq.contacts.peg_in_hole(tool[:3, 3], axis)

    def demonstration(self, rng, t):
        """A hand of 2000 N/m and 2 N m/rad leads the peg, which settles where the walls of its hole, of steel, hold it.

        Led by hand an arm does not give way; one that moves by itself does, by 1e4 N/m.
        """
        steel = hole(self.mouth, self.axis, None, None, stiffness=1e5).world
        n = len(t)
        z = self.axis
        deep = 0.03 + wander(rng, t, 0.006)
        spin = wander(rng, t, 0.3)
        aside = np.stack((wander(rng, t, 3e-3), wander(rng, t, 3e-3)), 1)
        lean = np.stack((wander(rng, t, 0.06), wander(rng, t, 0.06)), 1)
        x = np.cross(self.start[:3, 1], z)
        x /= np.linalg.norm(x)
        hole_frame = frames(np.column_stack((x, np.cross(z, x), z)), self.mouth)
        K = np.array([2.0] * 3 + [2000.0] * 3)
        X, w = np.empty((n, 4, 4)), np.empty((n, 6))
        T = hole_frame.copy()
        for i in range(n):
            goal = hole_frame @ frames(
                turned(np.array([0.0, 0.0, spin[i]])) @ turned(np.array([*lean[i], 0.0])),
                np.array([*aside[i], deep[i]]),
            )
            for _ in range(60):  # relaxed: the hand pulls, the walls push back
                error = iq.log(goal @ inverted(T))
                at = iq.adjoint(iq.transform(translation=-T[:3, 3]))
                pull = K * (at @ error)
                wall = iq.coadjoint(iq.transform(translation=-T[:3, 3])) @ steel(T, None)
                step = np.linalg.solve(np.diag(K + np.array([100.0] * 3 + [2e5] * 3)), pull + wall)
                T = iq.exp(iq.adjoint(iq.transform(translation=T[:3, 3])) @ step) @ T
            X[i] = T
            w[i] = -steel(T, None)
        return X, held(X, w)


def run(robot, q, world, task, seconds, seed):
    """Root mean square of the force error after half a second of the path, and its largest; the same of the
    tool's place beside its path, across what is pressed on [mm]; statuses.
    """
    rng = np.random.default_rng(seed)
    sensor = iq.WrenchSensor(np.eye(4), order="moment first", reads="reaction", cutoff=50.0, noise=0.3)
    loop = iq.HybridController(robot, task, dt=DT, sensor=sensor)
    q, twist, off, beside, statuses, touched = np.array(q), np.zeros(6), [], [], Counter(), None
    across = getattr(world, "normal", np.zeros(3))
    for k in range(int(seconds / DT)):
        tool = robot.pose(q)
        w = world.world(tool, twist)
        touched = k if touched is None and np.linalg.norm(w[3:]) > 1.0 else touched
        t = max(0.0, (k - (touched or 10**9)) * DT - 1.0) if world.wanted else max(0.0, k * DT - 1.0)
        target, ahead = world.path(t)
        reading = iq.coadjoint(iq.inverse(tool)) @ w + rng.normal(size=6) * np.repeat([0.02, 0.3], 3)
        solution = loop.step(q, target, reading, ahead if t > 0 else 0.0 * ahead)
        statuses[str(solution.status)] += 1
        if t > 0.5:
            off.append(world.missing(tool, w))
            miss = tool[:3, 3] - target[:3, 3]
            beside.append(1e3 * np.linalg.norm(miss - across * (across @ miss)))
        twist = robot.jacobian(q) @ solution.velocity
        q = q + DT * solution.velocity
    if not off:
        return *[np.nan] * 4, statuses
    (rms, most), (path, farthest) = ((np.sqrt(np.mean(np.square(a))), np.abs(a).max()) for a in (off, beside))
    return rms, most, path, farthest, statuses


def main():
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("arms", nargs="*", default=list(ARMS))
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--jobs", nargs="*", default=["pen", "edge", "hinge", "screw", "peg"])
    options = parser.parse_args()
    for name in options.arms:
        robot = iq.load_robot(name)
        start = robot.pose(ARMS[name])
        for job in options.jobs:
            world = (
                Plane(start, job == "edge")
                if job in ("pen", "edge")
                else Peg(start)
                if job == "peg"
                else Joint(start, job)
            )
            if job in ("pen", "edge"):
                wrong, right = (world.contact(n, TIP) for n in (world.guess, world.normal))
            elif job == "peg":
                wrong, right = world.contact(world.guess), world.contact(world.axis)
            else:
                wrong, right = world.contact(world.guess), world.contact(world.post)
            press = [PRESS] if job == "pen" else [PRESS, 0.0] if job == "edge" else [0.0] * (4 if job == "peg" else 5)
            cases = {"guess": iq.HybridTask(wrong, press), "truth": iq.HybridTask(right, press)}
            for seed in range(options.seeds):
                rng = np.random.default_rng([seed, 17])
                X, w = noisy(rng, *world.demonstration(rng, np.arange(600) / 100.0))
                try:
                    found = iq.contacts.identify(X, w, accuracy=(3e-3, 1e-3))  # joints give way by half a millimetre
                    cases[f"found {seed}: {found.kind}, {[c.kind for c in found.candidates]}"] = found.task(
                        world.wanted
                    )
                except iq.InvariantQPError as error:
                    print(f"{name} {job} seed {seed}: {str(error)[:300]}")
            for case, task in cases.items():
                rms, most, path, farthest, statuses = run(robot, ARMS[name], world, task, options.seconds, 1)
                print(
                    f"{name:6} {job:6} {case:60} force off by {rms:.4f} N rms, {most:.3f} most; "
                    f"path by {path:.2f} mm rms, {farthest:.2f} most; {dict(statuses)}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
