"""A batched differential-IK controller with Isaac Lab's calls, inside joint limits; it imports no Isaac Lab.

    DifferentialIK(cfg, num_envs, device, quaternion="wxyz")
        .set_command(command, ee_pos, ee_quat)
        .compute(ee_pos, ee_quat, jacobian, joint_pos) -> joint position targets

What differs from `isaaclab.controllers.DifferentialIKController`: position and velocity limits hold in every answer;
rows with NaN hold their joints; the law's own damping stands in place of `ik_method` and `ik_params`, so that an arm
comes to rest where its target is out of reach.

Reference: Isaac Lab, source/isaaclab/isaaclab/controllers/differential_ik.py (2.3 and 3.0).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.batches.law import pair, velocities
from invariantqp.batches.motions import vector_of
from invariantqp.batches.namespace import Namespace, Rows, as_arrays, length_of, shaped
from invariantqp.errors import BadInput
from invariantqp.geometry import arrays


class DifferentialIK:
    """Joint position targets for tool commands, `num_envs` rows at once.

    Attributes:
        cfg: as it was given.
        num_envs: how many rows.
        ee_pos_des: (N, 3) the target's position, None before the first command.
        ee_quat_des: (N, 4) its orientation.
        status: (N,) of the last answer, as `Velocities.status`.
    """

    def __init__(
        self,
        cfg: Any,
        num_envs: int,
        device: str | None = None,  # noqa: ARG002 (a place in the call)
        *,
        quaternion: str,
        position_limits: tuple[ArrayLike, ArrayLike] | None = None,
        velocity_limit: ArrayLike | None = None,
        dt: float = 1.0,
    ) -> None:
        """A controller.

        Args:
            cfg: anything with `command_type` ("position" or "pose") and `use_relative_mode`, such as a
                `DifferentialIKControllerCfg`.
            num_envs: how many rows.
            device: taken for the sake of the call; arrays stay where they are given.
            quaternion: the order of quaternions, "wxyz" up to Isaac Lab 2.3, "xyzw" from 3.0.
            position_limits: lower and upper joint positions, (m,) or (N, m).
            velocity_limit: (m,) or (N, m) positive [rad/s, length/s]; None is none.
            dt: time between two calls [s], which turns the velocity limit into a step.

        Raises:
            BadInput: another command type or order of quaternions, limits that are not two arrays, that cross, or a
                velocity limit that is not positive.
        """
        self.cfg = cfg
        self._position = arrays.choice(getattr(cfg, "command_type", cfg), "cfg", ("position", "pose")) == "position"
        self._relative = arrays.flag(getattr(cfg, "use_relative_mode", False), "cfg")
        self.num_envs = arrays.count(num_envs, "num_envs")
        self._order = arrays.choice(quaternion, "quaternion", ("wxyz", "xyzw"))
        self._dt = arrays.number(dt, "dt", "a time", positive=True)
        self._limits = _checked(*pair(position_limits, "position_limits"), velocity_limit)
        self.ee_pos_des: Rows | None = None
        self.ee_quat_des: Rows | None = None
        self.status: Rows | None = None

    @property
    def action_dim(self) -> int:
        """How many numbers a command has: 3 of a position, 6 of a relative pose, 7 of a pose."""
        return 3 if self._position else 6 if self._relative else 7

    def reset(self, env_ids: Any = None) -> None:
        """Nothing is remembered that would have to be reset; commands stay."""

    def set_command(
        self, command: ArrayLike, ee_pos: ArrayLike | None = None, ee_quat: ArrayLike | None = None
    ) -> None:
        """Where the tool is to go.

        Args:
            command: (N, 3) a position or, relative, a way; (N, 6) a way and a rotation vector; (N, 7) a pose, position
                before quaternion.
            ee_pos: (N, 3) where the tool is, for relative commands.
            ee_quat: (N, 4) likewise, and for positions.

        Raises:
            BadInput: shapes that do not fit, or a pose of the tool that is needed and missing.
        """
        needed = {"ee_pos": self._relative, "ee_quat": self._relative or self._position}
        given = {"ee_pos": ee_pos, "ee_quat": ee_quat}
        for name, value in given.items():
            if needed[name] and value is None:
                raise BadInput(name, "None", "the tool's, which this kind of command needs")
        xp, (c, p, quat) = as_arrays({"command": command}, given)
        self._rows(command=(c, self.action_dim), ee_pos=(p, 3), ee_quat=(quat, 4))
        way = c[..., :3]
        self.ee_pos_des = p + way if self._relative else way
        if self._position:
            self.ee_quat_des = quat
        elif self._relative:
            half = 0.5 * length_of(xp, c[..., 3:])[..., None]
            some, one = half > 0.0, xp.ones_like(half)
            share = xp.where(some, 0.5 * xp.sin(half) / xp.where(some, half, one), 0.5 * one)
            turned = product(xp, xp.concat((xp.cos(half), share * c[..., 3:]), axis=-1), self._scalar_first(xp, quat))
            self.ee_quat_des = turned if self._order == "wxyz" else xp.roll(turned, -1, axis=-1)
        else:
            self.ee_quat_des = c[..., 3:]

    def compute(self, ee_pos: ArrayLike, ee_quat: ArrayLike, jacobian: ArrayLike, joint_pos: ArrayLike) -> Rows:
        """(N, m) joint position targets.

        Args:
            ee_pos: (N, 3) the tool's position.
            ee_quat: (N, 4) its orientation.
            jacobian: (N, 6, m) of the tool's point, linear rows first, as simulators give it.
            joint_pos: (N, m) joint positions.

        Raises:
            BadInput: shapes that do not fit, or no command yet.
        """
        if self.ee_pos_des is None:
            raise BadInput("command", "none yet", "set_command before compute")
        lower, upper, speed = self._limits
        here = {"ee_pos": ee_pos, "ee_quat": ee_quat, "jacobian": jacobian, "joint_pos": joint_pos}
        there = {"ee_pos_des": self.ee_pos_des, "ee_quat_des": self.ee_quat_des}
        limits = {"position_limits[0]": lower, "position_limits[1]": upper, "velocity_limit": speed}
        xp, (p, quat, J, q, p_des, quat_des, low, high, fastest) = as_arrays(here, there | limits)
        shaped(J, (6, None), "jacobian", "shape (N, 6, m), linear rows first")
        self._rows(ee_pos=(p, 3), ee_quat=(quat, 4), joint_pos=(q, J.shape[-1]))
        with np.errstate(all="ignore"):  # quaternions of size zero: such rows are held
            here_first = self._scalar_first(xp, quat)
            back = xp.concat((here_first[..., :1], -here_first[..., 1:]), axis=-1)
            turn = product(xp, self._scalar_first(xp, quat_des), back)
            twist = xp.concat((vector_of(xp, turn), p_des - p), axis=-1)
        if self._position:
            twist = xp.concat((xp.zeros_like(p), p_des - p), axis=-1)
        twists = xp.concat((J[..., 3:, :], J[..., :3, :]), axis=-2)
        step = q * 0.0 + (xp.inf if fastest is None else fastest * self._dt)
        bounds = (
            -step if low is None else xp.minimum(xp.maximum(low - q, -step), step),
            step if high is None else xp.minimum(xp.maximum(high - q, -step), step),
        )
        length = 0.0 if self._position else None
        answer = velocities(twists, twist, point=p * 0.0, bounds=bounds, length=length, dt=1.0)
        self.status = answer.status
        return q + answer.velocity

    def _rows(self, **given: tuple[Rows, int]) -> None:
        """Check that arguments have a row for each environment."""
        for name, (value, size) in given.items():
            expected = (self.num_envs, size)
            if value is not None and tuple(value.shape) != expected:
                raise BadInput(name, f"shape {tuple(value.shape)}", f"shape {expected}, a row for each environment")

    def _scalar_first(self, xp: Namespace, quaternion: Rows) -> Rows:
        """(w, x, y, z) of a quaternion in the caller's order."""
        return quaternion if self._order == "wxyz" else xp.roll(quaternion, 1, axis=-1)


def _checked(lower: Any, upper: Any, speed: Any) -> tuple[Rows, Rows, Rows]:
    """Limits, refused where they leave no motion; None where there is none."""
    xp, (low, high, fastest) = as_arrays(
        {}, {"position_limits[0]": lower, "position_limits[1]": upper, "velocity_limit": speed}
    )
    if fastest is not None and not xp.all(fastest > 0.0):  # NaN is not above zero either
        raise BadInput("velocity_limit", f"{float(xp.min(fastest)):g} among them", "positive limits")
    if low is not None and high is not None and not xp.all(low <= high):
        raise BadInput("position_limits", "NaN, or a lower limit above its upper one", "lower <= upper for every joint")
    return low, high, fastest


def product(xp: Namespace, a: Rows, b: Rows) -> Rows:
    """(..., 4) the product of quaternions (w, x, y, z): the rotation b, then a."""
    s, x, y, z = (a[..., i] for i in range(4))
    t, u, v, w = (b[..., i] for i in range(4))
    return xp.stack(
        (
            s * t - x * u - y * v - z * w,
            s * u + x * t + y * w - z * v,
            s * v - x * w + y * t + z * u,
            s * w + x * v - y * u + z * t,
        ),
        axis=-1,
    )
