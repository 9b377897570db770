"""A tool path longer than an arm's reach, by a rail; and two arms, one of which draws on what the other holds.

Each is one chain of joints, so that one controller drives it, with limits and exact demands as for an arm.
"""

from itertools import pairwise

import numpy as np

import invariantqp as iq
from invariantqp.robots import Robot, rail, relative

DT, SECONDS = 0.01, 8.0


def drive(robot: Robot, q: np.ndarray, way) -> tuple[np.ndarray, str]:
    """Follow a path, a pose for each u from 0 to 1, that begins and ends at rest: joint positions, and how far off."""
    controller = iq.Controller(robot, dt=DT, exact="position", posture=False)
    states, off, reasons = [q], 0.0, set()
    time = np.arange(0.0, 1.0, DT / SECONDS)
    poses = [way(u * u * (3.0 - 2.0 * u)) for u in (*time, 1.0)]
    for target, after in pairwise(poses):
        forward = iq.log(after @ np.linalg.inv(target)) / DT
        solution = controller.step(q, target, forward)
        q = q + DT * solution.velocity
        states.append(q)
        reasons.add(solution.status)
        off = max(off, np.linalg.norm((robot.pose(q) - after)[:3, 3]))
    return np.array(states), f"off the path by {1e3 * off:.3g} mm at most; {', '.join(sorted(reasons))}"


def wave(start: np.ndarray):
    """A wave of 40 mm over two metres along y, the tool's orientation kept."""
    return lambda u: iq.transform(start[:3, :3], start[:3, 3] + [0.04 * np.sin(4 * np.pi * u) ** 2, 2.0 * u, 0.0])


def ring(start: np.ndarray):
    """A circle of 50 mm radius on the part, its plane the part's xy plane."""
    return lambda u: iq.transform(
        start[:3, :3],
        start[:3, 3] + 0.05 * np.array([np.cos(2 * np.pi * u) - 1.0, np.sin(2 * np.pi * u), 0.0]),
    )


def main() -> None:
    """Print how far each of them comes."""
    ready = np.array([0.0, -1.4, 1.9, -2.1, -1.57, 0.0])
    alone = iq.load_robot("ur5e", base=iq.transform(translation=(0.0, 0.0, 0.3)))
    print("alone:    ", drive(alone, ready, wave(alone.pose(ready)))[1])
    track = rail([0, 1, 0], lower=-0.2, upper=2.5, speed=0.5)
    railed = iq.load_robot("ur5e", base=iq.robots.stand_on(iq.transform(translation=(0.0, 0.0, 0.3)), track))
    q = np.concatenate(([0.0], ready))
    states, told = drive(railed, q, wave(railed.pose(q)))
    print("on a rail:", told)
    print(f"the rail goes {states[-1, 0]:.2f} m of the 2 m, the arm does the rest")

    left = iq.load_robot("panda", base=iq.transform(translation=(0.0, -0.4, 0.0)))  # it holds the part
    right = iq.load_robot("panda", base=iq.transform(translation=(0.0, 0.4, 0.0)))  # it draws
    both = relative(right, left)
    q_left = np.array([0.5, 0.1, 0.0, -1.9, 0.0, 2.0, 0.8])
    q_right = np.array([-0.5, 0.1, 0.0, -2.1, 0.0, 2.2, 0.8])
    start = np.concatenate((q_left[::-1], q_right))  # the other's joints first, tool first
    states, told = drive(both, start, ring(both.pose(start)))
    print("two arms: ", told)
    held, drew = (np.ptp(states[:, part], axis=0).max() for part in (slice(7), slice(7, None)))
    print(f"joints turn by up to {np.degrees(held):.1f} deg in the arm that holds, {np.degrees(drew):.1f} in the other")


if __name__ == "__main__":
    main()
