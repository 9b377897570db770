"""mink's names, and its models as joint screws: no file but this and the one of the comparison imports it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from invariantqp.errors import RobotModelError
from invariantqp.extras import optional
from invariantqp.geometry.se3 import adjoint
from invariantqp.robots.chain import Chain

with optional("mink", "mink"):
    from mink import SE3, Configuration, FrameTask, Objective

__all__ = ["SE3", "Configuration", "FrameTask", "Objective", "chain_to"]

# mjtJoint: free, ball, slide, hinge; those with one coordinate have limits.
FREE, BALL = 0, 1
TANGENT = {FREE: 6, BALL: 3}


def chain_to(model: Any, frame: str | int, kind: str) -> tuple[Chain, NDArray[np.intp]]:
    """The joints of a `mujoco.MjModel` that move a frame, as screws from q = 0, and their tangent indices.

    The frame is the name or id of a "body", "geom" or "site". A free joint or a ball is as many screws as it has
    degrees of freedom, without limits. A MuJoCo model has no velocity limits.

    Raises:
        mink.InvalidFrame, mink.UnsupportedFrame: no such frame.
        RobotModelError: no joint moves it.
    """
    rest = model.qpos0.copy()
    single = [j for j in range(model.njnt) if model.jnt_type[j] not in TANGENT]
    rest[model.jnt_qposadr[single]] = 0.0
    here = Configuration(model, rest)
    pose = here.get_transform_frame_to_world(frame, kind).as_matrix()
    J = adjoint(pose, check=False)[:, [3, 4, 5, 0, 1, 2]].dot(here.get_frame_jacobian(frame, kind))
    moving = np.flatnonzero(J.any(axis=0))
    if not len(moving):
        raise RobotModelError(f"no joint moves the {kind} {frame!r}; choose one beyond the first joint")
    joints = model.dof_jntid[moving]
    limited = np.isin(joints, single) & (model.jnt_limited[joints] != 0)
    lower, upper = model.jnt_range[joints].T
    return Chain(
        J[:, moving],
        pose,
        position_lower=np.where(limited, lower, -np.inf),
        position_upper=np.where(limited, upper, np.inf),
    ), moving
