"""Robot models: from joint positions to tool pose, joint twists and link shapes, all in the base frame.

In: a name, a URDF or MJCF, a model of Pinocchio, MuJoCo or yourdfpy, or joint screws. Out: a `Chain`, whose kinematics
the compiled core computes. `Robot` is the protocol that controllers need. The room knows nothing of control.
"""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.robots.bodies import bodies_of as bodies_of
    from invariantqp.robots.chain import Chain as Chain
    from invariantqp.robots.compose import mobile_base as mobile_base
    from invariantqp.robots.compose import rail as rail
    from invariantqp.robots.compose import relative as relative
    from invariantqp.robots.compose import stand_on as stand_on
    from invariantqp.robots.kinematics import Robot as Robot
    from invariantqp.robots.kinematics import RobotState as RobotState
    from invariantqp.robots.kinematics import joint_ranges as joint_ranges
    from invariantqp.robots.kinematics import middle as middle
    from invariantqp.robots.load import load_robot as load_robot
    from invariantqp.robots.load import urdf_of as urdf_of
