"""A strict hierarchy of constraints, each level as far as those above allow, by DAQP.

    limits  >  exact rows  >  J x = s  >  x = x_p

Within a level DAQP weighs every row by one over its norm, so that what it misses of a twist is least in these units.

Reference: Escande, Mansard & Wieber 2014; Arnstrom, Bemporad & Axehill 2022 (DAQP).
"""

from __future__ import annotations

import daqp
import numpy as np

from invariantqp.compare.method import Question, Setting, Solve
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.qp.backends import SolverFailure


def levels(setting: Setting) -> Solve:
    """The maker of the hierarchical QP."""
    m, eye = setting.m, np.eye(setting.m)

    def velocity(tick: Question) -> Array:
        k = len(tick.C)
        # With exact rows the turn alone is left of the twist; rows told twice would take the posture's level away.
        rest = slice(0, 3 if k else 6)
        ends = np.cumsum([m, k, 3 if k else 6, m])[[0, 1, 2, 3] if k else [0, 2, 3]]
        rows = np.vstack((tick.C, tick.J[rest], eye))
        wanted = np.concatenate((tick.e, tick.s[rest], tick.posture))
        x, _, flag, _ = daqp.solve(
            None,
            None,
            rows,
            np.concatenate((tick.upper, wanted)),
            np.concatenate((tick.lower, wanted)),
            np.zeros(ends[-1], dtype=np.intc),
            ends.astype(np.intc),
        )
        if flag <= 0:
            raise SolverFailure("daqp", f"exit flag {flag}")
        return np.asarray(x)

    return velocity
