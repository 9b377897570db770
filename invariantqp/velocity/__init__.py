"""The velocity law: a twist and its joint limits in, a joint velocity and the reason for it out.

Each name is loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from invariantqp.lazy import load_lazily

if TYPE_CHECKING:
    from invariantqp.velocity.batch import VelocitySolutions as VelocitySolutions
    from invariantqp.velocity.batch import solve_velocities as solve_velocities
    from invariantqp.velocity.damping import Adaptive as Adaptive
    from invariantqp.velocity.damping import Damping as Damping
    from invariantqp.velocity.damping import Fixed as Fixed
    from invariantqp.velocity.damping import PaperLambda as PaperLambda
    from invariantqp.velocity.damping import Selective as Selective
    from invariantqp.velocity.exact import ExactRows as ExactRows
    from invariantqp.velocity.guard import Guard as Guard
    from invariantqp.velocity.qp.backends import Backend as Backend
    from invariantqp.velocity.qp.backends import Osqp as Osqp
    from invariantqp.velocity.qp.backends import SolverFailure as SolverFailure
    from invariantqp.velocity.qp.scaling import BoxQP as BoxQP
    from invariantqp.velocity.request import MethodChoice as MethodChoice
    from invariantqp.velocity.request import method_for as method_for
    from invariantqp.velocity.request import solve_velocity as solve_velocity
    from invariantqp.velocity.several import JointTask as JointTask
    from invariantqp.velocity.several import TwistTask as TwistTask
    from invariantqp.velocity.several import solve_tasks as solve_tasks
    from invariantqp.velocity.solution import VelocitySolution as VelocitySolution

load_lazily(
    __name__,
    {
        "invariantqp.velocity.batch": ("VelocitySolutions", "solve_velocities"),
        "invariantqp.velocity.damping": ("Adaptive", "Damping", "Fixed", "PaperLambda", "Selective"),
        "invariantqp.velocity.exact": ("ExactRows",),
        "invariantqp.velocity.guard": ("Guard",),
        "invariantqp.velocity.qp.backends": ("Backend", "Osqp", "SolverFailure"),
        "invariantqp.velocity.qp.scaling": ("BoxQP",),
        "invariantqp.velocity.request": ("MethodChoice", "method_for", "solve_velocity"),
        "invariantqp.velocity.several": ("JointTask", "TwistTask", "solve_tasks"),
        "invariantqp.velocity.solution": ("VelocitySolution",),
    },
)
