"""A peg of 10 mm goes into a hole of 10.1 mm that is 1 mm and 2 deg away from where it is said to be.

1. It presses on the plate with 4 N, and its place is led along a spiral whose turns are nearer than the clearance.
2. Where the press is gone it waits; where it falls, or something holds it from the side, that may be the hole's mouth.
3. Then it is taken for a peg in a hole: no force across and no moment is wanted, so it turns into the hole's direction,
   and it is pushed in along its own axis, the more slowly the harder that is. If that leads nowhere the search goes on.

Run: python examples/35_insertion.py [attempts, 2] [millimetres off, 1] [arm ...]
"""

import sys

import numpy as np
from shared.cells import ARMS, DELAY, DT
from shared.peg_cell import PegCell

import invariantqp as iq

PEG, CLEARANCE, DEPTH = 0.010, 1e-4, 0.02  # diameters [m], how deep it has to go [m]
TILT = np.radians(2.0)
PITCH, SEARCH, WIDEST = 0.07e-3, 0.004, 1.5e-3  # of the spiral [m], along it [m/s], its last radius [m]
PRESS, PUSH, SPEED = 4.0, 8.0, 0.01  # of the search [N], at most along the peg [N], how fast it goes in [m/s]
MOST = 15.0  # is too much [N]: into what gives way it goes no faster than that allows
LETS, LATE = 0.3, 0.02  # with less than this share of the press it waits, so far back [s]
DENT, CAUGHT = 0.25e-3, 1.6  # so deep [m], or held from the side by so many presses, it may be in the hole
STEEP = np.tan(TILT) * SEARCH  # as fast the plate may rise or fall under the tip [m/s]
PATIENCE, WITHIN = 0.6, 0.5e-3  # after so long [s] it is so deep [m], or was not
LONGEST = 60.0  # [s]


def spiral(t):
    """Where the search is after t seconds, and how fast it moves (3,), (3,): at one speed along its way."""
    angle = 2.0 * np.sqrt(np.pi * SEARCH * max(t, 1e-3) / PITCH)
    radius = PITCH * angle / (2.0 * np.pi)
    way = np.array([-np.sin(angle), np.cos(angle), 0.0])
    return radius * np.array([np.cos(angle), np.sin(angle), 0.0]), SEARCH * way


def inserted(arm, off, seed):
    """How deep it went into a hole `off` [m] away from where it is said to be, the largest force [N], the seconds that
    took, and what stopped it."""
    random = np.random.default_rng(seed)
    home, (a, b) = iq.load_robot(arm).pose(ARMS[arm]), random.uniform(0.0, 2.0 * np.pi, 2)
    mouth = home[:3, 3] + [off * np.cos(a), off * np.sin(a), -3e-3]
    hole = iq.transform(translation=mouth) @ iq.exp([TILT * np.cos(b), TILT * np.sin(b), 0.0, 0.0, 0.0, 0.0])
    cell = PegCell(arm, hole, 0.5 * PEG, CLEARANCE, mass=0.3, seed=seed)
    told = {"dt": DT, "sensor": cell.sensor, "delay": DELAY}
    flat = iq.HybridTask(
        lambda tool: iq.point_contact(tool[:3, 3], [0, 0, 1]), [PRESS], max_force=MOST, slide_speed=SEARCH
    )
    peg = iq.HybridTask(lambda tool: iq.contacts.peg_in_hole(tool[:3, 3], tool[:3, 2]), np.zeros(4), max_force=MOST)
    search, push = iq.HybridController(cell.robot, flat, **told), iq.HybridController(cell.robot, peg, **told)
    since, pushed, fell, astray = None, None, False, False
    most, height, deep, seconds, reason = 0.0, 0.0, 0.0, 0.0, "time"
    while seconds < LONGEST:
        seconds += DT
        q, reading = cell.read()
        tool = cell.robot.pose(q)
        force = cell.sensor.wrench(reading, tool)[3:]
        if pushed is None:  # the search
            falls = force[2] > -LETS * PRESS  # less than a part of the press is felt: a dent, or the hole
            if since is not None:
                aside = np.linalg.norm(tool[:2, 3] - cell.home[:2, 3] - spiral(since)[0][:2])
                astray = astray and aside > LATE * SEARCH  # since a push that led nowhere: it comes back first
                since += (DT if not (falls or astray) else 0.0) - (LATE if falls and not fell else 0.0)
                height, fell = height + np.clip(tool[2, 3] - height, -STEEP * DT, STEEP * DT), falls
                if tool[2, 3] < height - DENT or np.hypot(*force[:2]) > CAUGHT * PRESS:
                    pushed = 0.0
                    push.reset()
            at, along = (np.zeros(3), np.zeros(3)) if since is None else spiral(since)
            target = iq.transform(translation=at) @ cell.home
            solution = search.step(q, target, reading, [0, 0, 0, *(np.zeros(3) if falls or astray else along)])
            if since is None and solution.status == "ok":
                since, height = 0.0, tool[2, 3]
            if np.linalg.norm(at) > WIDEST:
                reason = "no hole found"
                break
        else:  # in its mouth, as far as is known
            pushed += DT
            speed = SPEED * min(1.0, max(0.0, 1.0 - force @ tool[:3, 2] / PUSH))
            solution = push.step(q, tool, reading, [0, 0, 0, *(speed * tool[:3, 2])])
            if pushed > PATIENCE and tool[2, 3] > height - WITHIN:
                pushed, since, astray = None, since + 2.0 * LATE, True
        cell.drive(solution.velocity)
        most = max(most, np.linalg.norm(cell.pressed()))
        deep = (mouth - tool[:3, 3]) @ hole[:3, 2]
        if deep > DEPTH:
            reason = "in"
            break
        if solution.status in ("overload", "fault"):
            reason = solution.reason
            break
    return deep, most, seconds, reason


def main(attempts="2", off="1", *arms):
    for arm in arms or ARMS:
        found = [inserted(arm, 1e-3 * float(off), seed) for seed in range(int(attempts))]
        _, most, time, said = zip(*found, strict=True)
        print(f"{arm:6s} {said.count('in')} of {attempts} in, {max(most):.1f} N at most", end=", ")
        print(f"{min(time):.1f} to {max(time):.1f} s; {', '.join(sorted(set(said)))}")


if __name__ == "__main__":
    main(*sys.argv[1:])
