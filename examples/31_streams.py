"""One driver for what comes in over time: a hand, a conveyor; 17_teleoperation.py has the action chunks of a policy.

1. A UR5 by a hand's poses at 60 Hz, with noise, a gap, and a clutch that closes elsewhere.
2. A Panda above a conveyor: a pose on a moving frame, as a function of time.

What is printed: the largest share of a limit (speed, acceleration, jerk) in any tick, and how far the tool is off.

Run: python examples/31_streams.py
     python examples/31_streams.py --picture streams.png    a UR5 by chunks: the truth, this library and, where they are
                                                            installed, Pink and Ruckig on the chunks interpolated
"""

import argparse

import numpy as np

import invariantqp as iq

DT = 0.002  # [s]


def shares(robot, acceleration, jerk, Q):
    """The largest shares of the joints' limits in positions tick by tick (n, m)."""
    v = np.diff(Q, axis=0, prepend=Q[:1]) / DT
    a = np.diff(v, axis=0, prepend=v[:1]) / DT
    j = np.diff(a, axis=0, prepend=a[:1]) / DT
    return [round(float(np.abs(x).max()), 3) for x in (v / robot.velocity_limit, a / acceleration, j / jerk)]


def hand():
    """A hand's poses."""
    robot, rng = iq.load_robot("ur5"), np.random.default_rng(1)
    start = np.array([0.3, -1.4, 1.8, -1.9, -1.5, 0.3])
    follower = iq.Follower(iq.Controller(robot, dt=DT, acceleration_limit=8.0), jerk=400.0)
    home, lag = robot.pose(start), 0.02

    def wanted(t):
        place = 0.06 * np.array([np.sin(1.3 * t), np.sin(1.9 * t), 0.0]) * min(t, 1.0)
        return home @ iq.transform(translation=place + ([0.0, 0.0, 0.05] if t > 4.0 else [0.0, 0.0, 0.0]))

    q, Q, off, told, sent = start, [start], [], set(), 0
    for now in np.arange(0.0, 6.0, DT):
        if now * 60 >= sent:
            stamp, sent = now - lag, sent + 1
            if not (2.0 < now < 2.4 or 3.2 < now < 4.02):  # a gap; then the clutch is open
                noise = 2e-4 * rng.normal(size=3)
                follower.add(wanted(max(stamp, 0.0)) @ iq.transform(translation=noise), stamp)
        solution = follower.step(q, now=now)
        told.add(str(solution.status))
        q = q + DT * solution.velocity
        Q.append(q)
        if 1.0 < now < 2.0 or now > 5.0:
            off.append(np.linalg.norm((robot.pose(q) - wanted(now - solution.late))[:3, 3]))
    print(f"hand: {max(off) * 1e3:.1f} mm off at {1e3 * solution.late:.0f} ms, limits", shares(robot, 8.0, 400.0, Q))
    print("hand:", ", ".join(sorted(told)))


def conveyor():
    """A pose on a moving frame."""
    robot = iq.load_robot("panda")
    start = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])
    follower = iq.Follower(iq.Controller(robot, dt=DT, acceleration_limit=10.0), jerk=1000.0)
    home = robot.pose(start)

    def part(t):
        """25 mm above a part that passes at 0.1 m/s."""
        return iq.transform(translation=[0.0, 0.1 * (t - 2.0), -0.025]) @ home

    follower.follow(part)
    q, Q, off = start, [start], []
    for now in np.arange(0.0, 4.0, DT):
        solution = follower.step(q, now=now)
        q = q + DT * solution.velocity
        Q.append(q)
        off.append(np.linalg.norm((robot.pose(q) - part(now + DT))[:3, 3]))
    joined = np.flatnonzero(np.array(off) > 1e-4)[-1] * DT
    print(f"conveyor: on the part after {joined:.1f} s, then {max(off[1500:]) * 1e6:.2f} um off", end=", ")
    print("limits", shares(robot, 10.0, 1000.0, Q))


ACCELERATION, JERK = 8.0, 400.0  # of the UR5 in the picture


def sent(rng, truth, end):
    """Chunks of a policy that knows the truth to two hundredths of a radian: arrival, joints (30, 6), stamps (30,)."""
    chunks, seen = [], 0.0
    while seen < end:
        stamps = seen + np.arange(30) / 20
        joints = np.array([truth(t) for t in stamps]) + 0.015 * rng.normal(size=6) + 0.0015 * rng.normal(size=(30, 6))
        chunks.append((seen + rng.uniform(0.1, 0.3), joints, stamps))
        seen += rng.uniform(0.3, 0.7)
    return chunks


def interpolated(chunks, start):
    """What a program without a follower asks for at a time: the newest chunk that has come, from point to point."""

    def wanted(now):
        come = [chunk for chunk in chunks if chunk[0] <= now]
        return start if not come else np.array([np.interp(now, come[-1][2], column) for column in come[-1][1].T])

    return wanted


def by_follower(robot, _start, chunks):
    """A tick of a follower."""
    follower = iq.Follower(iq.Controller(robot, dt=DT, acceleration_limit=ACCELERATION), jerk=JERK)
    waiting = list(chunks)

    def tick(now, q):
        while waiting and waiting[0][0] <= now:
            follower.follow(*waiting.pop(0)[1:])
        return q + DT * follower.step(q, now=now).velocity

    return tick


def by_pink(robot, start, chunks):
    """A tick of Pink towards the interpolated pose."""
    import pink
    import pinocchio as pin

    wanted = interpolated(chunks, start)
    configuration = pink.Configuration(robot.model, robot.model.createData(), start.copy())
    task = pink.FrameTask(robot.tool, position_cost=1.0, orientation_cost=1.0, lm_damping=1e-3)

    def tick(now, q):
        task.set_target(pin.SE3(robot.pose(wanted(now + DT))))
        return q + DT * pink.solve_ik(configuration, [task], DT, solver="daqp") if not configuration.update(q) else q

    return tick


def by_ruckig(robot, start, chunks):
    """A tick of Ruckig towards the interpolated joints, with the follower's limits."""
    import ruckig

    wanted, m = interpolated(chunks, start), len(start)
    otg, given, answer = ruckig.Ruckig(m, DT), ruckig.InputParameter(m), ruckig.OutputParameter(m)
    given.current_position = start.tolist()
    given.max_velocity, given.max_acceleration = robot.velocity_limit.tolist(), [ACCELERATION] * m
    given.max_jerk = [JERK] * m

    def tick(now, q):  # noqa: ARG001 (it counts on its own)
        given.target_position = wanted(now + DT).tolist()
        otg.update(given, answer)
        answer.pass_to_input(given)
        return np.array(answer.new_position)

    return tick


def picture(path):
    """One chunked run: where the tool is beside the truth, and what the joints have to do for it."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    robot, rng, end = iq.load_robot("ur5"), np.random.default_rng(4), 5.0
    start = np.array([0.3, -1.4, 1.8, -1.9, -1.5, 0.3])
    f, ways = rng.uniform(0.1, 0.35, (3, 6)), 0.12 * rng.uniform(-1.0, 1.0, (3, 6))

    def truth(t):
        s = min(t / 1.5, 1.0)
        return start + s**3 * (10 - 15 * s + 6 * s * s) * (ways * np.sin(2.0 * np.pi * f * t)).sum(axis=0)

    chunks, times = sent(rng, truth, end), np.arange(0.0, end, DT)
    runs = {"truth": np.array([truth(t) for t in times])}
    for name, make in (("Pink", by_pink), ("Ruckig", by_ruckig), ("this library", by_follower)):
        try:
            tick = make(robot, start, chunks)
        except ImportError:
            print(f"{name} is not installed")
            continue
        q, Q = start, []
        for now in times:
            Q.append(q)
            q = tick(now, q)
        runs[name] = np.array(Q)
    figure, axes = plt.subplots(3, 1, figsize=(8, 8), sharex=True, layout="constrained")
    colours = {"truth": "0.55", "Pink": "tab:orange", "Ruckig": "tab:green", "this library": "tab:blue"}
    tips = {name: np.array([1e3 * robot.pose(q)[:3, 3] for q in Q]) for name, Q in runs.items()}
    print("                 tool off, rms mm   acceleration / limit   jerk / limit   jerk rms, rad/s^3")
    for name, Q in runs.items():
        style = {"color": colours[name], "lw": 3.0 if name == "truth" else 1.0, "label": name}
        axes[0].plot(times, tips[name][:, 1] - tips[name][0, 1], **style)
        v = np.diff(Q, axis=0, prepend=Q[:1]) / DT
        a = np.diff(v, axis=0, prepend=v[:1]) / DT
        j = np.diff(a, axis=0, prepend=a[:1]) / DT
        axes[1].plot(times, np.abs(a).max(axis=1) / ACCELERATION, **style)
        axes[2].plot(times, np.maximum(np.abs(j).max(axis=1) / JERK, 1e-4), **style)
        off = np.sqrt((np.linalg.norm(tips[name] - tips["truth"], axis=1) ** 2).mean())
        shares = np.abs(a).max() / ACCELERATION, np.abs(j).max() / JERK, np.sqrt((j**2).mean())
        print(f"{name:16s} {off:18.1f} {shares[0]:22.2f} {shares[1]:14.2f} {shares[2]:19.0f}")
    for arrival, _, _ in chunks:
        axes[0].axvline(arrival, color="0.85", lw=0.8, zorder=0)
    axes[0].set_ylabel("tool along y [mm]")
    axes[1].set_ylabel("largest joint acceleration\nover its limit")
    axes[2].set_ylabel("largest joint jerk\nover its limit")
    for axis in axes[1:]:
        axis.set_yscale("log")
        axis.axhline(1.0, color="0.3", lw=0.8, ls="--")
    axes[1].set_ylim(1e-3, None)
    axes[2].set_xlabel("time [s]; grey lines: a chunk comes")
    axes[0].legend(ncols=4, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Hands, conveyors, chunks.")
    parser.add_argument("--picture", help="draw one chunked run to this file")
    if drawn := parser.parse_args().picture:
        picture(drawn)
    else:
        hand()
        conveyor()
