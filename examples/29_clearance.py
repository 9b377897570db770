"""What an arm must not touch: a table, a ball that comes, another arm; each named in the reason that it holds.

The same loops without a clearance say where the arm would have gone. Where Pink and mink are installed, they follow the
same path along a box with the same shapes, pairs, limits and gain; the guide's page on clearance has the whole table.
"""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

import invariantqp as iq
from invariantqp.limits import Box, Capsule, Clearance, HalfSpace, OtherArm, Sphere

DT = 0.002
READY = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])
# A few capsules a link are enough; without bodies= they are fitted to the meshes of the robot's URDF (extra `pin`).
BODIES = {
    "panda_link5": [Capsule([0, 0, -0.31], [0, 0, -0.21], 0.06)],
    "panda_link7": [Capsule([0, 0, -0.06], [0, 0, 0.08], 0.05)],
    "panda_hand": [
        Capsule([0, -0.06, 0.03], [0, 0.06, 0.03], 0.04),
        Capsule([0, -0.04, 0.085], [0, 0.04, 0.085], 0.025),
    ],
}


def drive(loop: iq.Controller, watched: Clearance, target: np.ndarray, ticks: int, each=None) -> tuple[float, str]:
    """Go for a target: the least distance on the way [m], and the last reason."""
    q, least = READY.copy(), np.inf
    reason = ""
    for i in range(ticks):
        if each is not None:
            each(i * DT)
        solution = loop.step(q, target)
        q = q + DT * solution.velocity
        reason = str(solution.reasons[-1]) if solution.reasons else reason
        if each is not None:
            each((i + 1) * DT)
        least = min(least, watched.at(q).distance)
    return least, reason


def beside_peers(robot: iq.robots.Chain) -> None:
    """Fingers parallel to the face of a box, led 40 mm too low: how near they come, and how they tremble."""
    if any(find_spec(name) is None for name in ("coal", "mink", "mujoco", "pink")):
        print("not compared: pip install -e '.[pink,mink]' brings Pink and mink")
        return
    from shared.clearance_peers import GAINS, Peer

    box = Box(iq.transform(translation=[0.5, 0.0, 0.1]), [0.3, 0.5, 0.2], name="box")
    limit = Clearance(robot, BODIES, [box], distance=0.02, exclude=[("panda_link5", "panda_link7")])
    down = iq.transform(np.diag([1.0, -1.0, -1.0]), [0.5, 0.0, 0.3])
    start = iq.solve_pose(robot, down, q0=[0, -0.1, 0, -2.2, 0, 2.1, 0.785]).q
    loop = iq.Controller(robot, dt=DT, limits=[limit])
    steps = {"ours": lambda q, target: loop.step(q, target).velocity}
    steps |= {name: Peer(name, limit, DT, start, gain) for name, gain in GAINS.items()}
    print("along a box:     least distance [mm]   median change of a joint's velocity in a tick [rad/s]")
    for name, step in steps.items():
        q, near, velocities = start, [], []
        for i in range(500):
            t = i * DT
            target = down.copy()
            target[:3, 3] = 0.5 + 0.08 * np.sin(4.2 * t), 0.05 * np.sin(5.7 * t), 0.15
            velocities.append(step(q, target))
            q = q + DT * velocities[-1]
            near.append(limit.at(q).distance)
        change = np.abs(np.diff(velocities[200:], axis=0)).max(axis=1)
        print(f"  {name:14s} {1e3 * min(near):10.2f} {np.median(change):20.4f}")


def main() -> None:
    """Print the least distances with a clearance and without, and what is said of them."""
    robot = iq.load_robot("panda")
    table, ball = HalfSpace([0, 0, 0], [0, 0, 1], name="table"), Sphere([0, 0, 0], 0.08, name="ball")
    other = OtherArm(iq.load_robot("panda", base=iq.transform(np.diag([-1.0, -1.0, 1.0]), [0.95, 0, 0])), BODIES)
    limit = Clearance(robot, BODIES, [table, ball, other], distance=0.02)
    ball.move(iq.transform(translation=[0, 0, 5.0]))  # away, for now
    other.move(READY + np.array([1.5, 0, 0, 0, 0, 0, 0]))
    print(limit)
    print("not kept apart:", *(f"{a} and {b} ({why})" for a, b, why in limit.dropped[:2]), "...", sep="\n  ")

    here = robot.pose(READY)
    below = here @ iq.transform(translation=[0, 0, 0.8])  # the tool points down: under the table
    hand = here[:3, 3]

    def throw(t: float) -> None:
        """A ball that comes at 0.6 m/s, and stays where the hand was."""
        way = max(0.6 - 0.6 * t, 0.0)
        twist = np.array([0, 0, 0, 0, -0.6, 0]) if way > 0.0 else None
        ball.move(iq.transform(translation=hand + np.array([0, way, 0])), twist)

    def reach(t: float) -> None:
        """The other arm reaches over."""
        swing = 1.5 - 1.5 * min(t, 1.0)
        speed = np.array([-1.5 if t < 1.0 else 0.0, 0, 0, 0, 0, 0, 0])
        other.move(READY + np.array([swing, 0.4, 0, 0, 0, 0, 0]), speed)

    for what, target, each in (
        ("under the table", below, None),
        ("a ball", here, throw),
        ("the other arm", here, reach),
    ):
        kept, reason = drive(iq.Controller(robot, dt=DT, limits=[limit]), limit, target, 700, each)
        free, _ = drive(iq.Controller(robot, dt=DT), limit, target, 700, each)
        print(f"{what}: {1e3 * kept:.1f} mm; without {1e3 * free:.1f} mm. {reason}")
        ball.move(iq.transform(translation=[0, 0, 5.0]))
        other.move(READY + np.array([1.5, 0, 0, 0, 0, 0, 0]))

    found = iq.solve_pose(robot, below, q0=READY, clearance=limit)
    print("a pose under the table:", found.success, "-", found.reason.partition(",")[0])
    beside_peers(robot)


if __name__ == "__main__":
    main()
