"""The quadratic inside limits by a primal active-set method from a point inside, for problems on which others fail.

Every step stays inside and lowers the objective or changes the active set. A limit becomes active where the step to the
optimum on the active ones meets it, and inactive where its multiplier has the wrong sign. Where the limits leave hardly
any room (a joint at its limit, rows that only zero satisfies) dual methods may report infeasible; this one cannot. A
speed limit is kept on every face: what is inside it is convex, so a step between two such points does not leave it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.qp.active import Face, face_of, weakest
from invariantqp.velocity.qp.slow import Slow

# Steps for each limit, at most; then the point reached is the answer.
STEPS = 10
# A row whose value the step changes by less than this, relative to its length and the step's, counts as parallel to it.
PARALLEL = 1e-9


def from_inside(
    N: Array, lower: Array, upper: Array, e: Array, slow: Slow | None = None
) -> tuple[Array, Face | None, Array, float]:
    """The shortest e with lower <= N e <= upper, its face, its multipliers, and that of the speed limit `slow`.

    N is (r, n); e (n,) begins inside, but for rounding. Where nearly dependent rows meet, or steps run out, it is the e
    reached by then, with no face.
    """
    nu = 0.0
    side: NDArray[np.intp] = np.zeros(len(lower), dtype=np.intp)
    length = np.sqrt((N * N).sum(axis=1))
    y = np.zeros(len(lower))
    for count in range(STEPS * len(lower)):
        try:
            face = face_of(N, lower, upper, side)
        except np.linalg.LinAlgError:  # nearly dependent rows meet at e
            break
        best, pull, nu = (face.e, face.e, 0.0) if slow is None else slow.on(face)
        pulls = face.multipliers(pull)
        y = face.spread(pulls, len(lower))
        step = face.along(best - e)  # what is off the face is rounding, and would meet rows that depend on its own
        change, value = N.dot(step), N.dot(e)
        moving = (side == 0) & (np.abs(change) > PARALLEL * length * float(np.linalg.norm(step)))
        room = np.where(change > 0.0, upper - value, lower - value)
        share = np.full(len(lower), np.inf)
        np.divide(room, change, out=share, where=moving)
        first = int(share.argmin())
        if share[first] < 1.0:
            e = e + max(0.0, float(share[first])) * step
            side[first] = 1 if change[first] > 0.0 else -1
            continue
        e = best
        wrong = weakest(N, face, pull, pulls, late=count > 2 * len(lower))
        if wrong < 0:
            return e, face, y, nu
        side[wrong] = 0
    return e, None, np.where(y * side > 0.0, y, 0.0), nu
