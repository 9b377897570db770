"""A robot that `yourdfpy` has read, as the joints of a tree of links."""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np

from invariantqp.robots.urdf import TreeJoint, open_limit


def joints_of_yourdfpy(urdf: Any) -> list[TreeJoint]:
    """The joints of a `yourdfpy.URDF`."""
    return [_joint(joint) for joint in urdf.robot.joints]


def _joint(joint: Any) -> TreeJoint:
    origin = np.eye(4) if joint.origin is None else np.array(joint.origin, np.float64)
    axis = np.array((1.0, 0.0, 0.0) if joint.axis is None else joint.axis, np.float64)
    limit = None if joint.type == "continuous" else joint.limit
    # As in a URDF, positions that are left out are 0.
    lower, upper = (-inf, inf) if limit is None else (open_limit(x or 0.0) for x in (limit.lower, limit.upper))
    speed = (joint.limit and joint.limit.velocity) or inf
    length = float(np.linalg.norm(axis)) or 1.0
    follows = "" if joint.mimic is None else joint.mimic.joint
    return TreeJoint(
        joint.name, joint.type, joint.parent, joint.child, origin, axis / length, lower, upper, speed, follows
    )
