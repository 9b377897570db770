"""How far a velocity jumps along a segment: its steepest step, bisected down to 1e-12 of the segment."""

from itertools import pairwise

import numpy as np

SAMPLES = 24
BISECTIONS = 36
# A step of 1e-12 of a segment that moves the velocity by more than this, relative to its size on the segment. Damping
# near a singularity has slopes of 1 / ceiling^2, 1e9 at most.
JUMP = 1e-3
# Of segments slower than this [rad/s]: an arm that is all but at rest.
SLOW = 0.1


def height(velocity, jump=JUMP):
    """The largest change of velocity(t) over 2^-36 of a step of [0, 1], relative to the largest; ends at `jump`."""
    times = np.linspace(0.0, 1.0, SAMPLES + 1)
    path = [velocity(t) for t in times]
    size = max(SLOW, *(np.abs(x).max() for x in path))
    steps = [np.abs(b - a).max() for a, b in pairwise(path)]
    k = int(np.argmax(steps))
    low, high, x_low, x_high = times[k], times[k + 1], path[k], path[k + 1]
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        x = velocity(middle)
        if np.abs(x - x_low).max() >= np.abs(x_high - x).max():
            high, x_high = middle, x
        else:
            low, x_low = middle, x
        if np.abs(x_high - x_low).max() <= jump * size:
            break
    return np.abs(x_high - x_low).max() / size
