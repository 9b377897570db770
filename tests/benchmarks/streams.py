"""Streams as policies and hands send them, and what followers make of them: ours, point by point, Ruckig, Pink.

    python tests/benchmarks/streams.py poses [--seeds 1410 1420] [--arms panda xarm7]   chunks of poses
    python tests/benchmarks/streams.py joints                                           chunks of joint positions
    python tests/benchmarks/streams.py hands                                            a hand's samples
    python tests/benchmarks/streams.py noise        how late a hand is followed, with noise and without
    python tests/benchmarks/streams.py reach        out of reach and back: how many stay stuck
    python tests/benchmarks/streams.py time         a tick beside a plain one; the arrival of 50 points
    ... [--each]                                    a line for each run

A policy knows the truth, joint moves with little jerk that overlap, to 5-20 mm and 20-70 mrad (joints: 20-70 mrad), anew in
each chunk, and less well from point to point. Chunks have 10-50 points at 10-30 Hz and come 50-700 ms late; 7 % are
lost, 6 % come 2.5 times as late. A hand is noise up to 4 Hz, as fast as 0.6 of the arm's limits allow, with
tremor, sensor noise, jitter of stamps and ways, two gaps, a clutch that closes elsewhere and a phase out of reach.
After these a follower may be as fast as the limits allow (`approach=1`), as the others are.

"point by point" is what the newest chunk says now, interpolated, put straight into the joints; of a hand, what it was 40 ms
before. Pink is asked for the same poses inside the speed limits, Ruckig for the same joints inside all limits; each takes part
where it is installed. Errors are the tool's, at the delay [ms] where they are least. "catch up" is how long after the first
sample behind a gap the tool is back within what ours is off otherwise, 3 mm at least; "least" the shortest time in which joints inside
their limits, who knew the hand beforehand, could be on it with its speed, by Ruckig's time-optimal motions.
"""

# ruff: noqa: E501 (figures are printed in long lines)
from __future__ import annotations

import argparse
from collections import deque
from contextlib import suppress
from copy import deepcopy
from math import inf, log, pi
from statistics import median
from time import thread_time_ns
from types import SimpleNamespace

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

import invariantqp as iq

ruckig = pink = None
with suppress(ImportError):
    import ruckig
with suppress(ImportError):
    import pink
    import pinocchio as pin

DT = 0.002
# Start, acceleration limits [rad/s^2], jerk limits as so many times these [1/s], how far joints go from the start [rad].
ARMS = {
    "panda": ([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8], [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0], 500.0, 0.35),
    "xarm7": ([0.0, -0.3, 0.0, 1.1, 0.0, 1.3, 0.0], [20.0] * 7, 25.0, 0.35),
    "ur5": ([0.3, -1.4, 1.8, -1.9, -1.5, 0.3], [8.0] * 6, 50.0, 0.4),
    "so101": ([0.0, -0.4, 0.5, 0.6, 0.0], [30.0] * 5, 50.0, 0.45),
}
BUFFER = 0.04  # of a hand, point by point [s]
LASTS, OUT, BACK = 12.0, 9.0, 11.5  # a run of chunks; when a hand goes out of reach, and back [s]


class Arm:
    """An arm, and its tool's pose as six numbers: the rotation vector from the start's orientation, the position."""

    def __init__(self, name):
        start, acceleration, share, self.spread = ARMS[name]
        self.name, self.robot, self.start, self.acceleration = (
            name,
            iq.load_robot(name),
            np.array(start),
            np.array(acceleration),
        )
        self.jerk, self.speed = share * self.acceleration, np.asarray(self.robot.velocity_limit, dtype=float)
        self.m, self.exact = len(start), "position" if len(start) < 6 else None
        self.home = Rotation.from_matrix(self.robot.pose(self.start)[:3, :3])

    def seen(self, q):
        T = self.robot.pose(q)
        return np.append((Rotation.from_matrix(T[:3, :3]) * self.home.inv()).as_rotvec(), T[:3, 3])

    def pose(self, x):
        return iq.transform(rotation=(Rotation.from_rotvec(x[:3]) * self.home).as_matrix(), translation=x[3:])

    def solved(self, x, near):
        more = {"exact": self.exact} if self.exact else {}
        return iq.solve_pose(self.robot, self.pose(x), q0=near, restarts=0, time_limit=inf, **more)

    def loop(self, **more):
        return iq.Controller(self.robot, dt=DT, exact=self.exact, **more)

    def follower(self):
        return iq.Follower(self.loop(acceleration_limit=self.acceleration), jerk=self.jerk, approach=1.0)


# Streams


def eased(s):
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def unit(rng, n):
    v = rng.normal(size=n)
    return v / np.linalg.norm(v)


def joint_truth(arm, rng, lasts=LASTS):
    """Joint positions (k, m) at times (k,): moves with the least jerk that overlap, at half the speed and a third of the acceleration."""
    lower, upper = arm.robot.position_lower + 0.15, arm.robot.position_upper - 0.15
    moves, t, here = [], 0.4, arm.start
    while t < lasts:
        D = rng.uniform(0.6, 1.8)
        way = np.clip(arm.start + arm.spread * rng.uniform(-1.0, 1.0, arm.m), lower, upper) - here
        size = np.maximum(np.abs(way), 1e-9)
        way = way * min(
            1.0, (0.5 * arm.speed * D / 1.875 / size).min(), (0.33 * arm.acceleration * D**2 / 5.78 / size).min()
        )
        moves.append((t, D, way))
        here, t = here + way, t + D * rng.uniform(0.6, 1.1) + (rng.uniform(0.2, 0.6) if rng.random() < 0.15 else 0.0)

    def truth(times):
        return arm.start + sum(eased((times - a) / D)[:, None] * way for a, D, way in moves)

    return truth


def chunks_of(arm, seed):
    """A run of a policy: chunks with their arrival, stamps, joints, and poses as six numbers; and the truth."""
    rng = np.random.default_rng([seed, 1, arm.m, len(arm.name)])
    truth, rate, late = (
        joint_truth(arm, rng),
        float(rng.choice([10, 15, 20, 30])),
        float(np.exp(rng.uniform(log(0.05), log(0.7)))),
    )
    n = int(np.clip(round((2.2 * late + rng.uniform(0.4, 1.2)) * rate), 10, 50))
    off = (
        np.array((rng.uniform(20.0, 70.0), rng.uniform(5.0, 20.0), rng.uniform(20.0, 70.0))) * 1e-3 / np.sqrt(2.0)
    )  # of two that disagree
    again, chunks, t = rng.uniform(0.15, 0.5) * n / rate, [], 0.0
    while t < LASTS:
        delay = late * rng.uniform(0.8, 1.2) * (2.0 if t == 0.0 else 2.5 if rng.random() < 0.06 else 1.0)
        stamps, grows = t + np.arange(n) / rate, np.linspace(0.7, 1.3, n)[:, None]
        q = truth(stamps)
        x = np.array([arm.seen(k) for k in q]) + grows * np.append(off[0] * unit(rng, 3), off[1] * unit(rng, 3))
        x = x + rng.normal(size=x.shape) * np.repeat((1.5e-3, 4e-4), 3)
        q = q + grows * off[2] * unit(rng, arm.m) + 1.5e-3 * rng.normal(size=q.shape)
        if t == 0.0 or rng.random() > 0.07:
            chunks.append(SimpleNamespace(arrival=t + delay, stamps=stamps, joints=q, poses=x))
        t += max(delay, again)
    return sorted(chunks, key=lambda c: c.arrival), truth


def hand_of(arm, seed, *, noise=1.0):
    """A run of a hand: samples with their arrival, stamp and pose as six numbers; and what it does."""
    rng = np.random.default_rng([seed, 2, arm.m, len(arm.name)])
    home, f, phase = arm.seen(arm.start), rng.uniform(0.05, 4.0, 24)[:, None], rng.uniform(0.0, 2.0 * pi, (24, 6))
    reach = float(np.linalg.norm(home[3:]))
    size = rng.normal(size=(24, 6)) / (0.15 + f**2.5)
    size = size * np.repeat((0.12, 0.06 * min(1.0, reach / 0.55)), 3) / np.sqrt(0.5 * (size**2).sum(axis=0))
    gaps = [(a, a + rng.uniform(0.1, 0.8)) for a in (rng.uniform(2.0, 2.6), rng.uniform(4.0, 4.6))]
    opens = rng.uniform(6.0, 6.4)
    closes = opens + rng.uniform(0.5, 1.2)
    leap = np.append(rng.uniform(0.1, 0.3) * unit(rng, 3), rng.uniform(0.05, 0.12) * unit(rng, 3))
    away = np.append(np.zeros(3), 1.1 * home[3:])

    def truth(t):
        x = home + eased((t - 0.3) / 1.0) * (size * np.sin(2.0 * pi * f * t + phase)).sum(axis=0) + (t >= closes) * leap
        return x + (eased(t - OUT) - eased(t - BACK)) * away

    times, k = np.arange(0.0, OUT, 0.01), round(closes / 0.01)
    for _ in range(60):  # until the arm can do it, with room left
        joints, q = [], arm.start
        for t in times:
            found = arm.solved(truth(t), q)
            if found.position_error > 1e-5:
                break
            q = found.q
            joints.append(q)
        if len(joints) == len(times):
            v = np.diff(joints, axis=0) / 0.01
            a = np.diff(v, axis=0) / 0.01
            v[k - 3 : k + 3], a[k - 4 : k + 3] = 0.0, 0.0
            if (np.abs(v) <= 0.6 * arm.speed).all() and (np.abs(a) <= 0.6 * arm.acceleration).all():
                break
        size, leap = 0.8 * size, 0.95 * leap
    rate, lag, tremor, way = (
        float(rng.choice([30, 45, 60, 72, 90])),
        rng.uniform(0.005, 0.04),
        rng.uniform(0.2, 0.6),
        rng.uniform(0.0, 2.0 * pi, 6),
    )
    samples, last = [], 0.0
    for t in np.arange(0.0, OUT + 5.0, 1.0 / rate):
        jitter, delay, error = (
            rng.normal() * 0.05 / rate,
            lag + rng.exponential(0.15 / rate),
            rng.normal(size=6) * np.repeat((1e-3, 2e-4), 3),
        )
        if any(a < t < b for a, b in (*gaps, (opens, closes))):
            continue
        last = max(last + 1e-4, t + jitter + delay)
        shake = tremor * np.sin(16.0 * pi * (t + jitter) + way) * np.repeat((4e-3, 1e-3), 3)
        samples.append(SimpleNamespace(arrival=last, stamp=t + jitter, x=truth(t + jitter) + noise * (shake + error)))
    return samples, SimpleNamespace(
        at=truth, gaps=gaps, clutch=(opens, closes), joints=make_interp_spline(times, np.array(joints), k=5)
    )


# Followers: take(event) and tick(now, q), which returns the next q


class Ours:
    def __init__(self, arm, kind):
        self.arm, self.kind, self.follower = arm, kind, arm.follower()

    def take(self, event):
        if self.kind == "hands":
            self.follower.add(self.arm.pose(event.x), event.stamp)
        elif self.kind == "poses":
            self.follower.follow(np.array([self.arm.pose(x) for x in event.poses]), event.stamps)
        else:
            self.follower.follow(event.joints, event.stamps)

    def tick(self, now, q):
        return q + DT * self.follower.step(q, now=now).velocity


class PointByPoint:
    def __init__(self, arm, kind):
        self.arm, self.kind, self.q, self.samples, self.chunk = arm, kind, arm.start, deque(maxlen=64), None
        self.x = arm.start if kind == "joints" else arm.seen(arm.start)

    def take(self, event):
        if self.kind == "hands":
            self.samples.append(event)
        else:
            self.chunk = event

    def wanted(self, now):
        if self.samples:
            stamps, points, now = [s.stamp for s in self.samples], np.array([s.x for s in self.samples]), now - BUFFER
        elif self.chunk is not None:
            stamps, points = self.chunk.stamps, self.chunk.joints if self.kind == "joints" else self.chunk.poses
        else:
            return self.x
        return np.array([np.interp(now, stamps, column) for column in points.T])

    def joints(self, now):
        x = self.wanted(now)
        self.q = x if self.kind == "joints" else self.arm.solved(x, self.q).q
        return self.q

    def tick(self, now, q):
        return self.joints(now)


class ByRuckig(PointByPoint):
    def __init__(self, arm, kind):
        super().__init__(arm, kind)
        m, self.otg = arm.m, ruckig.Ruckig(arm.m, DT)
        self.given, self.answer = ruckig.InputParameter(m), ruckig.OutputParameter(m)
        self.given.current_position = arm.start.tolist()
        self.given.current_velocity = self.given.current_acceleration = [0.0] * m
        self.given.max_velocity, self.given.max_acceleration = arm.speed.tolist(), arm.acceleration.tolist()
        self.given.max_jerk = arm.jerk.tolist()
        self.given.synchronization = ruckig.Synchronization.No

    def tick(self, now, q):
        self.given.target_position = self.joints(now).tolist()  # at rest: asked for its speed, too, it is farther off
        with suppress(ruckig.RuckigError):
            if self.otg.update(self.given, self.answer) >= 0:
                self.answer.pass_to_input(self.given)
                return np.array(self.answer.new_position)
        return q


class ByPink(PointByPoint):
    def __init__(self, arm, kind):
        super().__init__(arm, kind)
        model = arm.robot.model
        self.configuration = pink.Configuration(model, model.createData(), arm.start.copy())
        self.task = pink.FrameTask(
            arm.robot.tool, position_cost=1.0, orientation_cost=0.01 if arm.exact else 1.0, lm_damping=1e-3
        )

    def tick(self, now, q):
        x = self.wanted(now)
        self.task.set_target(pin.SE3(self.arm.robot.pose(x) if self.kind == "joints" else self.arm.pose(x)))
        with suppress(pink.exceptions.PinkError):
            self.configuration.integrate_inplace(pink.solve_ik(self.configuration, [self.task], DT, solver="daqp"), DT)
        return self.configuration.q.copy()


METHODS = {
    "ours": Ours,
    "point by point": PointByPoint,
    **({"Ruckig": ByRuckig} if ruckig else {}),
    **({"Pink": ByPink} if pink else {}),
}


def played(method, events, lasts, start):
    """(n + 1, m) joint positions tick by tick."""
    Q, waiting = [start], deque(events)
    for i in range(round(lasts / DT)):
        while waiting and waiting[0].arrival <= i * DT:
            method.take(waiting.popleft())
        Q.append(method.tick(i * DT, Q[-1]))
    return np.array(Q)


# Figures


def shares(arm, Q):
    """The largest share of the speed, acceleration and jerk limits in any tick."""
    v = np.diff(Q, axis=0, prepend=Q[:1]) / DT
    a = np.diff(v, axis=0, prepend=v[:1]) / DT
    j = np.diff(a, axis=0, prepend=a[:1]) / DT
    return [float(np.abs(x).max()) for x in (v / arm.speed, a / arm.acceleration, j / arm.jerk)]


def delayed(X, Y, counts, least=-0.02, most=1.2):
    """The delay [ticks] at which positions Y are nearest to X, how far they are off then [mm], rms, and tick by tick [m]."""
    best, n = (inf, 0), len(X)
    for d in range(round(least / DT), round(most / DT)):
        i = np.flatnonzero(counts[max(-d, 0) : n - max(d, 0)] & counts[max(d, 0) : n + min(d, 0)]) + max(-d, 0)
        best = min(best, (float(((Y[i + d] - X[i]) ** 2).sum(axis=1).mean()), d))
    d, e = best[1], np.full(n, np.nan)
    e[max(d, 0) : n + min(d, 0)] = np.linalg.norm(Y[max(d, 0) : n + min(d, 0)] - X[max(-d, 0) : n - max(d, 0)], axis=1)
    return d, 1e3 * np.sqrt(best[0]), e


def jerk_rms(Q, counts):
    return float(np.sqrt(((np.diff(Q, 3, axis=0) / DT**3)[counts[3:]] ** 2).mean()))


def compared(x, y, counts):
    """Shares of the ticks in which the truth moves: of those in which the tool stands, and in which it goes back [%]."""
    x, y = np.diff(x, axis=0) / DT, np.diff(y, axis=0) / DT
    moves, fast = (np.linalg.norm(x, axis=1) > 0.03) & counts[1:], np.linalg.norm(y, axis=1)
    return 100.0 * float((fast < 1e-3)[moves].mean()), 100.0 * float(
        (((x * y).sum(axis=1) < 0.0) & (fast > 0.02))[moves].mean()
    )


def policy(arm, seed, kind):
    """A line of figures for each method."""
    chunks, truth = chunks_of(arm, seed)
    times = DT * np.arange(round(LASTS / DT) + 1)
    Q = truth(times)
    X, counts = np.array([arm.seen(q)[3:] for q in Q]), times > chunks[0].arrival + 0.3
    known = np.full(len(times), -1.0)
    for c in chunks:
        known[times >= c.arrival] = np.maximum(known[times >= c.arrival], c.stamps[-1])
    found = {}
    for name, make in METHODS.items():
        P = played(make(arm, kind), chunks, LASTS, arm.start)
        Y = np.array([arm.robot.pose(q)[:3, 3] for q in P])
        d, rms, _ = delayed(X, Y, counts)
        stands, back = compared(X, Y, counts & (times <= known))
        found[name] = dict(zip(("speed", "acceleration", "jerk"), shares(arm, P), strict=True)) | {
            "jerk rms / truth's": jerk_rms(P, counts) / jerk_rms(Q, counts), "rms mm": rms, "delay ms": 1e3 * DT * d, "stands %": stands, "back %": back,
        }  # fmt: skip
    for row in found.values():
        row["error / point by point"] = row["rms mm"] / found["point by point"]["rms mm"]
    return found


def hand(arm, seed):
    """A line of figures for each method."""
    samples, truth = hand_of(arm, seed)
    lasts = OUT + 5.0
    times = DT * np.arange(round(lasts / DT) + 1)
    X, counts = np.array([truth.at(t)[3:] for t in times]), (times > 1.0) & (times < OUT - 0.1)
    for a, b in (*truth.gaps, truth.clutch):
        counts &= ~((times > a - 0.02) & (times < b + 0.5))
    transport = float(np.mean([s.arrival - s.stamp for s in samples]))
    jerk = truth.joints.derivative(3)(times[counts])
    found, near = {}, 0.0
    for name, make in METHODS.items():
        P = played(make(arm, "hands"), samples, lasts, arm.start)
        Y = np.array([arm.robot.pose(q)[:3, 3] for q in P])
        d, rms, off = delayed(X, Y, counts, 0.0)
        catch, least = [], []
        near = near or max(float(np.quantile(off[counts], 0.95)), 3e-3)  # that of ours, for all
        for _, end in truth.gaps:
            i = round(min(s.arrival for s in samples if s.stamp >= end - 0.02) / DT) + 1
            back = np.flatnonzero(off[i:] <= near)
            catch.append(DT * int(back[0]) if len(back) else inf)
            if ruckig and name == "ours":
                least.append(shortest(arm, P[i - 3 : i + 1], truth.joints, (i - d) * DT))
        found[name] = dict(zip(("speed", "acceleration", "jerk"), shares(arm, P), strict=True)) | {
            "jerk rms / truth's": jerk_rms(P, counts) / float(np.sqrt((jerk**2).mean())), "rms mm": rms, "delay - transport ms": 1e3 * (DT * d - transport),
            "catch up s": max(catch), "home mm": 1e3 * float(np.linalg.norm(Y[-200:] - X[-200:], axis=1).max()),
        }  # fmt: skip
        if least:
            found[name] |= {
                "least s": least[int(np.argmax(catch))],
                "catch up - least s": float(np.max(np.subtract(catch, least))),
            }
    return found


def shortest(arm, last, wanted, time):
    """The shortest time in which joints that were in the last four positions can be with what is wanted then, inside their limits."""
    v = np.diff(last, axis=0) / DT
    a = (v[-1] - v[-2]) / DT
    otg, given = ruckig.Ruckig(1), ruckig.InputParameter(1)
    for T in np.arange(DT, 1.5, 2.0 * DT):
        there = [wanted.derivative(k)(time + T) if k else wanted(time + T) for k in range(3)]
        for j in range(arm.m):
            given.current_position, given.current_velocity, given.current_acceleration = (
                [last[-1, j]],
                [v[-1, j]],
                [a[j]],
            )
            given.target_position, given.target_velocity, given.target_acceleration = ([x[j]] for x in there)
            given.max_velocity, given.max_acceleration, given.max_jerk = (
                [arm.speed[j]],
                [arm.acceleration[j]],
                [arm.jerk[j]],
            )
            way = ruckig.Trajectory(1)
            if otg.calculate(given, way) < 0 or way.duration > T:
                break
        else:
            return float(T)
    return inf


def noise(arm, seed):
    """How late a hand is followed beyond its transport, and how far off, with its noise and without."""
    found = {}
    for name, share in (("clean", 0.0), ("noisy", 1.0)):
        samples, truth = hand_of(arm, seed, noise=share)
        end = truth.gaps[0][0]
        P = played(Ours(arm, "hands"), samples, end, arm.start)
        times = DT * np.arange(len(P))
        X, Y = np.array([truth.at(t)[3:] for t in times]), np.array([arm.robot.pose(q)[:3, 3] for q in P])
        d, rms, _ = delayed(X, Y, times > 1.0, 0.0, 0.5)
        found[name] = {
            "delay - transport ms": 1e3 * (DT * d - float(np.mean([s.arrival - s.stamp for s in samples]))),
            "rms mm": rms,
        }
    return found


def reach(arm, seed):
    """Led out of reach and back to where pose IK finds a way: whether the arm comes along."""
    rng = np.random.default_rng([seed, 3, arm.m, len(arm.name)])
    home, out = arm.seen(arm.start), unit(rng, 3)
    out = out if out @ home[3:] > 0.0 else -out
    there = np.append(0.15 * rng.normal(size=3), 1.2 * arm.loop().measure.length * out)
    end = np.append(rng.uniform(0.0, 0.2) * unit(rng, 3), 0.05 * unit(rng, 3))
    samples = [
        SimpleNamespace(arrival=t, stamp=t, x=home + (eased(t) - eased(t - 1.5)) * there + eased((t - 1.0) / 1.5) * end)
        for t in np.arange(0.0, 5.5, 1 / 60)
    ]
    P = played(Ours(arm, "hands"), samples, 5.5, arm.start)
    off, can = (
        np.linalg.norm(arm.robot.pose(P[-1])[:3, 3] - samples[-1].x[3:]),
        arm.solved(samples[-1].x, P[-1]).position_error < 1e-3,
    )
    return {
        "ours": dict(zip(("speed", "acceleration", "jerk"), shares(arm, P), strict=True))
        | {"off mm": 1e3 * off, "stuck": float(can and off > 0.02)}
    }


def spent(call, times):
    """The least and the median of the processor's time that a call takes [us], and its 99.9th percentile."""
    cost = np.empty(times)
    for i in range(times):
        before = thread_time_ns()
        call(i)
        cost[i] = 1e-3 * (thread_time_ns() - before)
    return {"median us": float(np.median(cost)), "p99.9 us": float(np.quantile(cost, 0.999))}


def timed(arm, seed):
    """A tick along chunks that nothing comes in, beside a plain one; the arrival of a chunk of 50 points with the tick that takes it in."""
    rng = np.random.default_rng([seed, 4, arm.m])
    truth, found = joint_truth(arm, rng), {}
    stamps = np.arange(50) / 30.0
    q, follower, loop = arm.start, arm.follower(), arm.loop(acceleration_limit=arm.acceleration)
    follower.follow(truth(stamps + 1.0) - truth(np.array((1.0,))) + arm.start, stamps)
    state = SimpleNamespace(q=q)

    def ours(i):
        state.told = follower.step(state.q, now=i * DT)
        state.q = state.q + DT * state.told.velocity

    def plain(_):
        loop.step(q, target)

    target = arm.pose(arm.seen(q) + np.append(np.zeros(3), (0.0, 0.0, 0.01)))
    found["a tick"], found["a plain tick"] = spent(ours, 800), spent(plain, 800)
    for kind in ("poses", "joints"):
        followers = []
        for k in range(20):
            follower, q = arm.follower(), arm.start
            error = np.append(0.006 * unit(rng, 3), 0.02 * unit(rng, 3)) if kind == "poses" else 0.01 * unit(rng, arm.m)

            def chunk(at, kind=kind, error=error):
                points = truth(at)
                return np.array([arm.pose(arm.seen(p) + error) for p in points]) if kind == "poses" else points + error

            follower.follow(chunk(stamps), stamps)
            for i in range(200 + k):
                q = q + DT * follower.step(q, now=i * DT).velocity
            now = (200 + k) * DT
            followers.append((follower, q, now, chunk(stamps + now - 0.2), stamps + now - 0.2))
        fresh = [(deepcopy(f), *rest) for _ in range(10) for f, *rest in followers]

        def arrives(i, fresh=fresh):
            follower, q, now, points, at = fresh[i]
            follower.follow(points, at)
            follower.step(q, now=now)

        found[f"50 {kind}"] = spent(arrives, len(fresh))
    return found


def table(runs):
    """Median and worst of each figure, method by method."""
    for name in runs[0]:
        rows = [run[name] for run in runs if name in run]
        figures = {key: [row[key] for row in rows] for key in rows[0]}
        print(f"{name:15s}", "; ".join(f"{key} {median(x):.3g} ({max(x):.3g})" for key, x in figures.items()))


def counted(kind, runs):
    """How many runs are above the bars."""
    bars = {"jerk rms / truth's": 8.0, "error / point by point": 1.1, "delay ms": 10.0, "back %": 1.0}
    if kind == "hands":
        bars = {
            "jerk rms / truth's": 6.0,
            "rms mm": 1.0,
            "delay - transport ms": 70.0,
            "catch up s": 0.3,
            "least s": 0.3,
        }
    for name in METHODS:
        over = {key: sum(run[name].get(key, 0.0) > bar + 1e-9 for run in runs) for key, bar in bars.items()}
        print(f"{name:15s} of {len(runs)} above", ", ".join(f"{key} {bar}: {over[key]}" for key, bar in bars.items()))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["poses", "joints", "hands", "noise", "reach", "time"])
    parser.add_argument("--seeds", nargs=2, type=int, default=(1410, 1420), metavar=("FIRST", "END"))
    parser.add_argument("--arms", nargs="+", default=list(ARMS), choices=list(ARMS))
    parser.add_argument("--each", action="store_true")
    given = parser.parse_args()
    run = {"hands": hand, "noise": noise, "reach": reach, "time": timed}.get(given.what) or (
        lambda arm, seed: policy(arm, seed, given.what)
    )
    runs = []
    for name in given.arms:
        arm = Arm(name)
        for seed in range(*given.seeds):
            runs.append(run(arm, seed))
            if given.each:
                print(
                    name,
                    seed,
                    {key: {k: float(f"{x:.4g}") for k, x in row.items()} for key, row in runs[-1].items()},
                    flush=True,
                )
    table(runs)
    if given.what in ("poses", "joints", "hands"):
        counted(given.what, runs)


if __name__ == "__main__":
    main()
