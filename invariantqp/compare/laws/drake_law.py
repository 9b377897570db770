"""Drake's DoDifferentialInverseKinematics on the same tasks; no other file imports Drake.

    maximise alpha with J x = alpha s inside the limits, and bring x near the posture in the null space of J

It is given J and s in the tool frame and the told bounds, so that Drake needs no model of the arm.

Reference: Tedrake et al., Drake.
"""

from __future__ import annotations

import numpy as np

from invariantqp.compare.method import Method, Question, Setting, Solve, Takes
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.backends import SolverFailure


def _drake(setting: Setting) -> Solve:
    from pydrake.multibody import inverse_kinematics as drake

    parameters = drake.DifferentialInverseKinematicsParameters(setting.m, setting.m)
    parameters.set_time_step(setting.dt)
    parameters.set_joint_centering_gain(np.eye(setting.m))
    still = np.zeros(setting.m)

    def velocity(tick: Question) -> Array:
        parameters.set_nominal_joint_position(tick.q + tick.posture)
        parameters.set_joint_velocity_limits((tick.lower, tick.upper))
        found = drake.DoDifferentialInverseKinematics(tick.q, still, tick.s, tick.J, parameters)
        if found.joint_velocities is None:
            raise SolverFailure("drake", str(found.status))
        return np.asarray(found.joint_velocities)

    return velocity


METHODS = [
    Method(
        name="Drake",
        family="library",
        why="Drake's DoDifferentialInverseKinematics, which keeps the direction of the twist",
        takes=Takes("in what is left", "a part of the twist, with it", "inside; slows the twist down", "none"),
        make=_drake,
        needs=("pydrake",),
        extra="drake",
        shown=False,
    ),
]
