"""Many rows at once where they are, by the Python array API: numpy, torch on any device, JAX under jit, CuPy."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.batches.differential_ik import DifferentialIK as DifferentialIK
    from invariantqp.batches.law import STATUSES as STATUSES
    from invariantqp.batches.law import Velocities as Velocities
    from invariantqp.batches.law import velocities as velocities
    from invariantqp.batches.motions import Kinematics as Kinematics
    from invariantqp.batches.motions import adjoints as adjoints
    from invariantqp.batches.motions import exps as exps
    from invariantqp.batches.motions import kinematics as kinematics
    from invariantqp.batches.motions import logs as logs
