"""Many rows at once where they are, by the Python array API: numpy, torch on any device, JAX under jit, CuPy."""

from invariantqp.lazy import lazily

with lazily(__name__):
    from invariantqp.batches.differential_ik import DifferentialIK as DifferentialIK
    from invariantqp.batches.kinematics import Kinematics as Kinematics
    from invariantqp.batches.kinematics import kinematics as kinematics
    from invariantqp.batches.motions import adjoints as adjoints
    from invariantqp.batches.motions import exps as exps
    from invariantqp.batches.motions import logs as logs
    from invariantqp.batches.velocities import STATUSES as STATUSES
    from invariantqp.batches.velocities import Velocities as Velocities
    from invariantqp.batches.velocities import velocities as velocities
