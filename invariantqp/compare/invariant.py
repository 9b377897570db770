"""Our law and its parts: what is commanded, the closed forms by themselves, the damped family, the body-inertia metric.

    closed forms   Gram + LDL'  (J'Q_h J) x = J'Q_h s,   factored  J^{+h} s,   eigen  V diag(1/mu) V'J'Q_h s
    damped         V diag(mu / (mu^2 + lambda^2)) V'J'Q_h s

Reference: [DS] Theorem 2.2, (2.14), (6.4).
"""

from __future__ import annotations

from invariantqp.compare.methods import Method, Setting, Solve
from invariantqp.control.simulate import our_controller
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.objective import PitchForm
from invariantqp.velocity.solve import solve

OURS = "invariantqp"


def _ours(setting: Setting) -> Solve:
    law = VelocityLaw(PitchForm(setting.pitch))

    def velocity(J: Array, s: Array, lower: Array, upper: Array) -> Array:
        return solve(law, Demand(J, s, lower, upper)).velocity

    return velocity


METHODS = [
    Method(
        name=OURS,
        family="invariant",
        limits="inside",
        why="the law as it is commanded: closed form, or convex QP with prices and descent guard",
        make=_ours,
        frame="base",
        problem="pitch",
        limited="pitch box",
        system=our_controller,
    ),
]
