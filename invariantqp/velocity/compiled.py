"""The tick that the compiled core answers: no form, no joint metric, no limits but the bounds. Python has all others.

The core answers what this package's own Python would, or hands the tick back.
"""

from __future__ import annotations

from invariantqp.native import core
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.solution import VelocitySolution


def compiled(law: VelocityLaw, demand: Demand) -> VelocitySolution | None:
    """The core's answer; None where Python has to answer."""
    policy = law.compiled
    if core is None or policy is None:
        return None
    J, s, root, lower, upper, exact, posture, rows, cone, _ = demand
    if exact is not None or rows is not None or cone is not None:
        return None
    found = core.tick(J, s, root, lower, upper, posture, law.dt, policy)
    return None if found is None else VelocitySolution._make(found)
