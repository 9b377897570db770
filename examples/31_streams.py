"""One driver for what comes in over time: a policy's action chunks, a hand, a conveyor.

1. An SO-101 by chunks as LeRobot's policies send them: (50, 6) joint positions in degrees at 30 Hz, the last one
   the gripper, 150 to 350 ms late, disagreeing with one another, one in eight lost.
2. A UR5 by a hand's poses at 60 Hz, with noise, a gap, and a clutch that closes elsewhere.
3. A Panda above a conveyor: a pose on a moving frame, as a function of time.

What is printed: the largest share of a limit (speed, acceleration, jerk) in any tick, and how far the tool is off.

Run: python examples/31_streams.py
"""

import numpy as np

import invariantqp as iq

DT = 0.002  # [s]


def shares(robot, acceleration, jerk, Q):
    """The largest shares of the joints' limits in positions tick by tick (n, m)."""
    v = np.diff(Q, axis=0, prepend=Q[:1]) / DT
    a = np.diff(v, axis=0, prepend=v[:1]) / DT
    j = np.diff(a, axis=0, prepend=a[:1]) / DT
    return [round(float(np.abs(x).max()), 3) for x in (v / robot.velocity_limit, a / acceleration, j / jerk)]


def policy():
    """Action chunks of an SO-101."""
    robot, rng = iq.load_robot("so101"), np.random.default_rng(0)
    start = np.array([0.0, -0.4, 0.5, 0.6, 0.0])
    loop = iq.Controller(robot, dt=DT, exact="position", acceleration_limit=30.0)
    follower = iq.Follower(loop, jerk=1500.0)

    def wanted(t):
        return start + 0.3 * np.sin(0.9 * t) * np.array([1.0, 0.5, -0.5, 0.3, 0.8])

    arrivals, late = [], 0.0
    while late < 6.0:
        stamps = late + np.arange(50) / 30
        actions = np.degrees([np.append(wanted(t), 0.2) for t in stamps])  # (50, 6), the gripper last
        actions += rng.normal(size=6) + 0.1 * rng.normal(size=(50, 6))  # chunks disagree by a degree
        if rng.random() > 1 / 8:
            arrivals.append((late + rng.uniform(0.15, 0.35), actions, stamps))
        late += 0.5
    q, Q, off = start, [start], []
    for now in np.arange(0.0, 6.0, DT):
        while arrivals and arrivals[0][0] <= now:
            _, actions, stamps = arrivals.pop(0)
            follower.follow(np.radians(actions[:, :5]), stamps)
        q = q + DT * follower.step(q, now=now).velocity
        Q.append(q)
        off.append(np.linalg.norm((robot.pose(q) - robot.pose(wanted(now)))[:3, 3]))
    print(f"policy: {np.median(off[500:]) * 1e3:.1f} mm off in the median, limits", shares(robot, 30.0, 1500.0, Q))


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


if __name__ == "__main__":
    policy()
    hand()
    conveyor()
