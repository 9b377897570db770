"""The velocity law: joint twists, a desired twist and limits in; a joint velocity with its status and reasons out.

`definition` states the law on a page; the compiled engine solves it. `solve_velocity` is one twist, `solve_velocities`
a batch, `solve_tasks` several twists with weights and priorities. It knows no robots and no time: see `control`.
"""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.velocity import definition as definition
    from invariantqp.velocity.backends import Backend as Backend
    from invariantqp.velocity.backends import BoxQP as BoxQP
    from invariantqp.velocity.backends import SolverFailure as SolverFailure
    from invariantqp.velocity.batch import VelocitySolutions as VelocitySolutions
    from invariantqp.velocity.batch import solve_velocities as solve_velocities
    from invariantqp.velocity.exact import ExactRows as ExactRows
    from invariantqp.velocity.guard import Guard as Guard
    from invariantqp.velocity.problem import solve_velocity as solve_velocity
    from invariantqp.velocity.reasons import Code as Code
    from invariantqp.velocity.reasons import Reason as Reason
    from invariantqp.velocity.solution import Status as Status
    from invariantqp.velocity.solution import VelocitySolution as VelocitySolution
    from invariantqp.velocity.tasks import JointTask as JointTask
    from invariantqp.velocity.tasks import TwistTask as TwistTask
    from invariantqp.velocity.tasks import solve_tasks as solve_tasks
