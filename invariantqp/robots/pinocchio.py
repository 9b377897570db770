"""Pinocchio, and a model of it made from joint screws.

This is the only file that imports Pinocchio, 3.8 or later (extra `pin`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from invariantqp.errors import BadInput
from invariantqp.extras import optional
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.screws import pitch
from invariantqp.robots.kinematics import UNLIMITED

with optional("pin", "Pinocchio"):
    import pinocchio as pin

__all__ = ["model_of", "pin"]


def model_of(
    screws: Array, places: Array, home: Array, names: Sequence[str], limits: Sequence[Array], tool: str
) -> pin.Model:
    """A `pinocchio.Model` without masses from unit screws (6, m) at q = 0, base frame, on axes through places (m, 3).

    `home` is the (4, 4) tool pose at q = 0; `limits` are lower and upper position and velocity limits, (m,) each.
    """
    model, last = pin.Model(), np.eye(4)
    joint = 0
    for i, (screw, place) in enumerate(zip(screws.T, places, strict=True)):
        along = screw[:3] if screw[:3].any() else screw[3:]
        if abs(np.linalg.norm(along) - 1.0) > arrays.NEGLIGIBLE:
            raise BadInput(
                "screws", f"a joint {names[i]} that is not a unit screw", "unit screws for a pinocchio.Model"
            )
        frame = se3.pose_along_z(along, place)
        bounds = [np.array([np.clip(limit[i], -UNLIMITED, UNLIMITED)]) for limit in limits]
        to_frame = pin.SE3(se3.inverse(last, check=False).dot(frame))
        h = pitch(screw)
        kind = pin.JointModelPZ() if np.isinf(h) else pin.JointModelHZ(h)
        kind = pin.JointModelRZ() if abs(h) < arrays.NEGLIGIBLE else kind
        joint = model.addJoint(joint, kind, to_frame, names[i], np.full(1, np.inf), bounds[2], *bounds[:2])
        model.addJointFrame(joint)
        last = frame
    place_in_joint = pin.SE3(se3.inverse(last, check=False).dot(home))
    model.addFrame(pin.Frame(tool, joint, 0, place_in_joint, pin.FrameType.OP_FRAME))
    return model
