"""The arms of the bed, and URDFs without meshes that every library reads alike."""

from __future__ import annotations

import warnings

import numpy as np

from invariantqp.errors import RobotModelError
from invariantqp.geometry import arrays, screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import UNLIMITED, Robot
from invariantqp.robots.load import load_robot
from invariantqp.workbench.compare.method import LoopSpec

# Where each arm starts [rad]: in the middle of its work space.
STARTS = {
    "panda": (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785),
    "ur5e": (0.0, -1.2, 1.6, -0.6, -1.2, 0.3),
    "so101": (0.0, -0.6, 0.8, 0.6, 0.2),
    "xarm7": (0.0, -0.4, 0.1, 1.1, 0.1, 1.4, 0.3),
    "random4": (0.3, -0.5, 0.6, 0.4),
}
# MuJoCo and placo require masses of moving links; kinematics does not depend on them [kg], [kg m^2].
LINK = (
    '<link name="{}"><inertial><origin xyz="0 0 0"/><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}" '
    'rpy="{rpy}"/><axis xyz="0 0 1"/><limit lower="{lower}" upper="{upper}" velocity="{speed}" effort="100"/></joint>'
)


def arm(name: str, seed: int = 0) -> Chain:
    """One of the arms of STARTS; `seed` is that of the random arm."""
    return random_arm(4, seed) if name == "random4" else as_chain(load_robot(name))


def as_chain(robot: Robot) -> Chain:
    """The screws and limits of an arm alone."""
    zero, limits = np.zeros(len(robot.names)), (robot.position_lower, robot.position_upper, robot.velocity_limit)
    return Chain(robot.jacobian(zero), robot.pose(zero), robot.names, *limits)


def random_arm(m: int, seed: int) -> Chain:
    """An arm of m hinges with random axes, one metre long, with limits of 2.5 rad and 2 rad/s."""
    rng = np.random.default_rng([seed, m])
    point, hinges = np.zeros(3), []
    for _ in range(m):
        axis, step = rng.standard_normal((2, 3))
        hinges.append(screws.revolute(axis / np.linalg.norm(axis), point))
        step[2] = abs(step[2]) + 0.5  # away from the base
        point = point + step / np.linalg.norm(step) / m
    return Chain(np.column_stack(hinges), se3.transform(None, point), (), -2.5, 2.5, 2.0)


def chain_of(spec: LoopSpec) -> Chain:
    """The arm of a spec."""
    return Chain(spec.screws, spec.home, spec.names, spec.lower, spec.upper, spec.velocity_limit)


def joint_frames(robot: Chain) -> list[tuple[bool, Array]]:
    """Whether each joint is prismatic, and a frame (4, 4) at q = 0 with the joint along its z axis, base first.

    Raises:
        RobotModelError: a helical joint, which other libraries do not model.
    """
    frames = []
    for name, screw, point in zip(robot.names, robot.screws.T, robot.places, strict=True):
        is_prismatic = not screw[:3].any()
        if not is_prismatic and abs(screws.pitch(screw)) > arrays.NEGLIGIBLE:
            raise RobotModelError(f"joint {name} is helical; other libraries model hinges and slides only")
        frames.append((is_prismatic, se3.pose_along_z(screw[3:] if is_prismatic else screw[:3], point)))
    return frames


def urdf(robot: Chain) -> str:
    """The arm as a URDF: each joint along z of its link, the tool frame as the link "tool".

    Raises:
        RobotModelError: a helical joint.
    """
    from scipy.spatial.transform import Rotation

    def place(frame: Array) -> dict[str, str]:
        with warnings.catch_warnings():  # of gimbal lock
            warnings.simplefilter("ignore")
            rpy = Rotation.from_matrix(frame[:3, :3]).as_euler("xyz")
        return {key: " ".join(map(repr, values.tolist())) for key, values in (("xyz", frame[:3, 3]), ("rpy", rpy))}

    parts, parent, before = [LINK.format("base")], "base", np.eye(4)
    bounds = zip(robot.position_lower, robot.position_upper, robot.velocity_limit, strict=True)
    for name, (is_prismatic, frame), limits in zip(robot.names, joint_frames(robot), bounds, strict=True):
        ends = dict(zip(("lower", "upper", "speed"), np.clip(limits, -UNLIMITED, UNLIMITED).tolist(), strict=True))
        kind, link = "prismatic" if is_prismatic else "revolute", f"{name}_link"
        where = place(se3.inverse(before).dot(frame))
        parts += [LINK.format(link), JOINT.format(name=name, kind=kind, parent=parent, child=link, **where, **ends)]
        parent, before = link, frame
    fixed = {"kind": "fixed", "lower": 0.0, "upper": 0.0, "speed": 0.0}
    where = place(se3.inverse(before).dot(robot.home))
    parts += [LINK.format("tool"), JOINT.format(name="to_tool", parent=parent, child="tool", **where, **fixed)]
    compiler = '<mujoco><compiler fusestatic="false" discardvisual="true"/></mujoco>'  # keeps the tool's link
    return f'<robot name="arm">{compiler}{"".join(parts)}</robot>'
