"""The first minute of a default loop on ten arms at four rates, beside the bars it is held to; late arms as a matrix.

    python tests/benchmarks/everyday.py first [--rates 100 1000] [--arms ur5 panda] [--only turn]
    python tests/benchmarks/everyday.py late [--ticks 0.001 0.01] [--arms ur5]

The starts and ways are random, the same at every rate. Rivals are what a user writes in five lines, with the same gain: clipped
Moore-Penrose, and the better of damped least squares at 0.05 and 0.01.
"""

# ruff: noqa: E501 (figures are printed in long lines)
from __future__ import annotations

import argparse
import sys
from itertools import pairwise, product
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[2] / "examples"))

from shared.ten_arms import limits

import invariantqp as iq
from invariantqp.control.tracking import ticks_of_delay

ARMS = ["panda", "ur5", "ur10", "xarm7", "kinova", "z1", "so101", "talos", "iiwa14", "gen3"]
SEED = 30
RESTS = 1e-3  # rad/s


def error(robot, q, T):
    """(6,) of the tool, seen at its origin [rad; m]."""
    P = robot.pose(q)
    return np.r_[iq.log(iq.transform(T[:3, :3] @ P[:3, :3].T))[:3], T[:3, 3] - P[:3, 3]]


def off(robot, q, T):
    """mm, deg."""
    e = error(robot, q, T)
    return np.array((1e3 * np.linalg.norm(e[3:]), np.degrees(np.linalg.norm(e[:3]))))


def at_tool(robot, q):
    J, p = robot.jacobian(q), robot.pose(q)[:3, 3]
    return np.vstack((J[:3], J[3:] + np.cross(J[:3].T, p).T))


def clipped(robot, gain):
    fastest = robot.velocity_limit
    return lambda q, T, ahead: np.clip(
        np.linalg.pinv(at_tool(robot, q), rcond=1e-4) @ (gain * error(robot, q, T) + ahead), -fastest, fastest
    )


def damped(robot, gain, d):
    def law(q, T, ahead):
        A = at_tool(robot, q)
        return A.T @ np.linalg.solve(A @ A.T + d * d * np.eye(6), gain * error(robot, q, T) + ahead)

    return law


def ours(robot, dt, **options):
    loop = iq.Controller(robot, dt=dt, **options)
    return lambda q, T, ahead: loop.step(q, T).velocity


def start(robot, rng, share=0.4):
    """Joint positions in the middle of their ranges, away from singularities."""
    low, high = limits(robot)
    while True:
        q = 0.5 * (low + high) + 0.5 * share * (high - low) * rng.uniform(-1.0, 1.0, len(low))
        sigma = np.linalg.svd(at_tool(robot, q), compute_uv=False)
        if sigma[-1] > 0.05:
            return q


def led(robot, law, q, targets, dt):
    """Joint velocities and errors [mm, deg] of a law on an arm that does what it is told inside its ranges."""
    v, e = [], []
    for T in targets:
        v.append(law(q, T, np.zeros(6)))
        q = np.clip(q + dt * v[-1], robot.position_lower, robot.position_upper)
        e.append(off(robot, q, T))
    return np.array(v), np.array(e), q


def settles(e, dt, mm=1.0, deg=1.0):
    """s until the errors (n, 2) stay below; inf where they do not."""
    late = np.flatnonzero((e[:, 0] > mm) | (e[:, 1] > deg))
    return np.inf if len(late) and late[-1] == len(e) - 1 else dt * (late[-1] + 1 if len(late) else 0)


def stay(robot, dt, rng):
    """Told to stay, positions read exactly and to 2e-5 rad: how far joints move in ten seconds."""
    worst = 0.0
    for noise in (0.0, 2e-5):
        q0 = start(robot, rng)
        q, loop, T = q0.copy(), iq.Controller(robot, dt=dt), robot.pose(q0)
        for _ in range(round(10.0 / dt)):
            q = q + dt * loop.step(q + noise * rng.normal(size=len(q)), T).velocity
        worst = max(worst, float(np.degrees(np.abs(q - q0).max())))
    return {"stay: deg in 10 s": ([worst], 0.1, max)}


def line(robot, dt, rng):
    """20 mm/s out and back five times: how far joints are from one cycle to the next."""
    q = start(robot, rng)
    T0, way, loop, ends = robot.pose(q).copy(), rng.normal(size=3), iq.Controller(robot, dt=dt), [q]
    way *= 0.02 / np.linalg.norm(way)
    for _, k in product(range(5), range(round(5.0 / dt))):
        T = T0.copy()
        T[:3, 3] += min(k * dt, 5.0 - k * dt) * way
        q = q + dt * loop.step(q, T).velocity
        if k == round(5.0 / dt) - 1:
            ends.append(q)
    turned = np.degrees(np.abs(np.diff(ends, axis=0)).max(axis=1))
    return {"line: deg a cycle, from the second on": ([turned[1:].max()], 0.1, max)}


def jumps(robot, dt, rng, size, *, turned):
    """Targets that jump: the other error on the way, and the time beside clipped Moore-Penrose's, where that arrives."""
    swing, time = [], []
    for _ in range(6):
        q = start(robot, rng)
        T, way = robot.pose(q).copy(), rng.normal(size=3)
        way *= size * rng.uniform(0.4, 1.0) / np.linalg.norm(way)
        if turned:
            T[:3, :3] = T[:3, :3] @ iq.exp(np.r_[way, 0.0, 0.0, 0.0])[:3, :3]
        else:
            T[:3, 3] += way
        targets = [T] * round(3.0 / dt)
        theirs = settles(led(robot, clipped(robot, 0.1 / dt), q, targets, dt)[1], dt)
        if theirs < 2.5:
            e = led(robot, ours(robot, dt), q, targets, dt)[1]
            swing.append(e[:, 0 if turned else 1].max())
            time.append(settles(e, dt) / max(theirs, dt))
    return swing, time


def turn(robot, dt, rng):
    """Turned in place by up to 70 degrees."""
    swing, time = ([], []) if len(robot.names) < 6 else jumps(robot, dt, rng, np.radians(70.0), turned=True)
    return {
        "turn: mm, median": (swing, 8.0, np.median),
        "turn: mm, worst": (swing, 30.0, max),
        "turn: time / clipped, median": (time, 1.05, np.median),
        "turn: time / clipped, worst": (time, 1.5, max),
    }


def jump(robot, dt, rng):
    """Moved by up to 0.2 m."""
    swing, time = ([], []) if len(robot.names) < 6 else jumps(robot, dt, rng, 0.2, turned=False)
    return {
        "jump: deg, worst": (swing, 1.0, max),
        "jump: time / clipped, median": (time, 1.05, np.median),
        "jump: time / clipped, worst": (time, 1.5, max),
    }


def path(robot, way, speed, dt):
    """Joint positions along a polygon at a speed of the fastest joint, and a second at its end."""
    ways = [
        a + (b - a) * np.linspace(0.0, 1.0, max(2, round(np.abs(b - a).max() / speed / dt)), endpoint=False)[:, None]
        for a, b in pairwise(way)
    ]
    return np.vstack((*ways, np.repeat(way[-1][None], round(1.0 / dt), axis=0)))


def singular(robot, dt, rng):
    """Led through a singular state and on, out of the plane of the ways before it: beside damped least squares."""
    q = start(robot, rng, 0.3)
    through = nearest_singular(robot, q)
    way = [q, through, through + 0.5 * (through - q) + 0.2 * rng.uniform(-1.0, 1.0, len(q))]
    low, high = limits(robot)
    way = [np.clip(x, low + 0.05, high - 0.05) for x in way]
    targets = [robot.pose(x) for x in path(robot, way, 0.25, dt)[1:]]
    found = [
        led(robot, law, q, targets, dt)[:2]
        for law in (ours(robot, dt), damped(robot, 0.1 / dt, 0.05), damped(robot, 0.1 / dt, 0.01))
    ]
    a, *rivals = [(np.abs(np.diff(v, axis=0)).max() / dt, *e.max(axis=0)) for v, e in found]
    b = min(rivals)
    return {
        "singular: rad/s^2 over 5 DLS + 10": ([a[0] / (5.0 * b[0] + 10.0)], 1.0, max),
        "singular: mm over 1.1 DLS + .05": ([a[1] / (1.1 * b[1] + 0.05)], 1.0, max),
        "singular: deg over 1.1 DLS + .05": ([a[2] / (1.1 * b[2] + 0.05)], 1.0, max),
    }


def nearest_singular(robot, q):
    """A singular state within 0.7 rad of q, as near as a search finds one."""
    from scipy.optimize import minimize

    def ratio(x):
        sigma = np.linalg.svd(at_tool(robot, x), compute_uv=False)
        return float((sigma[-1] / sigma[0]) ** 2)

    low, high = limits(robot)
    box = list(zip(np.maximum(q - 0.7, low), np.minimum(q + 0.7, high), strict=True))
    return np.asarray(minimize(ratio, q, method="L-BFGS-B", bounds=box, tol=1e-14).x)


def too_fast(robot, dt, rng):
    """A path at 1.4 times the joints' speeds, told without its own velocity, beside clipped Moore-Penrose."""
    q = start(robot, rng)
    fastest = np.where(np.isfinite(robot.velocity_limit), robot.velocity_limit, 2.0)
    low, high = limits(robot)
    end = np.clip(q + rng.uniform(-1.0, 1.0, len(q)), low + 0.1, high - 0.1)
    speed = 1.4 * np.abs(end - q).max() * (fastest / np.abs(end - q)).min()
    targets = [robot.pose(x) for x in path(robot, [q, end], speed, dt)[1:]]
    a, b = (led(robot, law, q, targets, dt)[1] for law in (ours(robot, dt), clipped(robot, 0.1 / dt)))
    mean = lambda x: float(np.exp(np.mean(np.log(x))))  # noqa: E731
    x, y = np.maximum(a.max(axis=0), 0.01), np.maximum(b.max(axis=0), 0.01)
    return {
        "too fast: mm / clipped, mean": ([x[0] / y[0]], 1.05, mean),
        "too fast: deg / clipped, mean": ([x[1] / y[1]], 1.05, mean),
    }


def away(robot, dt, rng):
    """Out of reach and back, three seconds each, then nine of rest, with and without acceleration limits.

    Which end of its way an arm comes home by is no promise: joints at the ends of their ranges may lead to another.
    """
    speed, home = [], []
    for acceleration in (None, 10.0):
        q = start(robot, rng)
        T0, way = robot.pose(q).copy(), rng.normal(size=3)
        way *= 1.5 * iq.Controller(robot, dt=dt).measure.length / np.linalg.norm(way)
        options = {} if acceleration is None else {"acceleration_limit": acceleration}
        law = ours(robot, dt, **options)
        for out in (True, False):
            shares = np.minimum(np.arange(0.0, 12.0, dt) / 3.0, 1.0)
            targets = []
            for s in shares if out else 1.0 - shares:
                targets.append(T0.copy())
                targets[-1][:3, 3] += s * way
            v, e, q = led(robot, law, q, targets, dt)
            speed.append(np.abs(v[-round(0.5 / dt) :]).max())
        home.append(100.0 * (e[-1].sum() > 1.0))
    return {"away: rad/s at rest": (speed, RESTS, max), "away: not home again, %": (home, np.inf, np.mean)}


def words(robot, dt, rng):
    """What "ok" says; and degrees for radians."""
    low, high = limits(robot)
    grow, said, reached = [], [], []
    for far, scale in ((1.0, 1.2), (0.5, 1.0)):
        q, loop = start(robot, rng), iq.Controller(robot, dt=dt)
        for _ in range(6):
            T = robot.pose(
                np.clip(q + far * rng.uniform(-1.0, 1.0, len(q)), low + 0.05 * (high - low), high - 0.05 * (high - low))
            ).copy()
            T[:3, 3] *= rng.uniform(1.0, scale)
            before = off(robot, q, T)
            for _ in range(round(1.5 / dt)):
                s = loop.step(q, T)
                q = q + dt * s.velocity
                now = off(robot, q, T)
                if s.status == "ok":
                    grow.append(now[0] > before[0] + 1e-2 or (now[1] > before[1] + 1e-3 and before[1] < 160.0))
                before = now
                if far < 1.0:
                    reached.append(s.status == "ok")
        said.append(len(grow))
    turned = np.degrees(start(robot, rng))
    held = iq.Controller(robot, dt=dt).step(turned, robot.pose(np.radians(turned)))
    return {
        "ok while an error grows, %": ([100.0 * x for x in grow], 0.2, np.mean),
        "not ok where it can be reached, %": ([100.0 * (not x) for x in reached], 25.0, np.mean),
        "degrees: rad/s": ([np.abs(held.velocity).max()], 1e-9, max),
    }


FIGURES = {f.__name__: f for f in (stay, line, turn, jump, singular, too_fast, away, words)}


def first(given):
    """A row for each figure: its bar, then one value a rate, * where it misses it, with the arm that is worst."""
    rows = {}
    for rate, name, figure in product(given.rates, given.arms, FIGURES):
        if given.only and figure != given.only:
            continue
        robot = iq.load_robot(name)
        for title, (values, bar, of) in FIGURES[figure](
            robot, 1.0 / rate, np.random.default_rng([SEED, ARMS.index(name)])
        ).items():
            rows.setdefault(title, (bar, of, {}))[2].setdefault(rate, {})[name] = values
    for title, (bar, of, rates) in rows.items():
        cells = []
        for rate, arms in rates.items():
            every = [x for values in arms.values() for x in values]
            each = {name: of(values) for name, values in arms.items() if values}
            found, worst = of(every), max(each, key=each.get)
            cells.append(f"{rate:5d} Hz {found:9.4g}{'*' if found > bar else ' '} ({worst} {each[worst]:.3g})")
        print(f"{title:38s} {bar:7g} | {' | '.join(cells)}", flush=True)


def late(given):
    """Late arms: rad/s at the end, how they vibrate, and where they are; reachable, at the edge and out of reach."""
    bad = runs = 0
    arrived = []
    for name, dt, delay, acceleration, where in product(
        given.arms, given.ticks, given.delays, (None, 10.0), (0.0, 1.0, 1.4)
    ):
        if delay > 0.0 and delay < dt:
            continue
        robot = iq.load_robot(name)
        for seed in range(given.seeds):
            rng = np.random.default_rng([SEED, ARMS.index(name), seed])
            q, T = start(robot, rng, 0.6), robot.pose(start(robot, rng, 0.8)).copy()
            if where:  # that share of its reach away
                T[:3, 3] *= where * iq.Controller(robot, dt=dt).measure.length / np.linalg.norm(T[:3, 3])
            options = {} if acceleration is None else {"acceleration_limit": acceleration}
            loop, (whole, part) = iq.Controller(robot, dt=dt, delay=delay, **options), ticks_of_delay(delay, dt)
            commands = [np.zeros(len(q))] * (whole + 1)
            for _ in range(round(given.seconds / dt)):
                commands.append(loop.step(q, T).velocity)
                q = q + dt * ((1.0 - part) * commands[-1 - whole] + part * commands[-2 - whole])
            tail = np.array(commands[-round(1.0 / dt) :])
            fast, shakes, mm = np.abs(tail).max(), np.abs(np.diff(tail, axis=0)).max() / dt, off(robot, q, T)[0]
            turns = (np.diff(np.sign(np.where(np.abs(tail) > 1e-6, tail, 0.0)), axis=0) != 0).sum(axis=0).max()
            runs += 1
            arrived += [mm < 2.0] if where == 0.0 else []
            if fast > RESTS:
                bad += 1
                place = {0.0: "reachable", 1.0: "at the edge"}.get(where, "out of reach")
                print(
                    f"{name:7s} {1e3 * dt:3g} ms, {1e3 * delay:3g} ms late, {acceleration or 'no'} rad/s^2, {place}, seed {seed}: {fast:.4f} rad/s, {shakes:.3g} rad/s^2, {turns} turns a second, {mm:.1f} mm off",
                    flush=True,
                )
    print(f"not at rest {bad} of {runs}; arrived {sum(arrived)} of {len(arrived)} reachable")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("first", "late"))
    parser.add_argument("--arms", nargs="+")
    parser.add_argument("--rates", nargs="+", type=int, default=[100, 250, 500, 1000])
    parser.add_argument("--only", choices=FIGURES, default="")
    parser.add_argument("--ticks", nargs="+", type=float, default=[0.001, 0.002, 0.004, 0.01])
    parser.add_argument("--delays", nargs="+", type=float, default=[0.01, 0.02, 0.04, 0.08])
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--seeds", type=int, default=1)
    given = parser.parse_args()
    given.arms = given.arms or (ARMS if given.what == "first" else ["panda", "ur5", "kinova", "so101"])
    first(given) if given.what == "first" else late(given)


if __name__ == "__main__":
    main()
