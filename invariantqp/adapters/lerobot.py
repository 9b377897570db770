"""LeRobot's kinematics class, and its action chunks on a `Follower`, in degrees. It imports no LeRobot.

    RobotKinematics(urdf_path, target_frame_name, joint_names)
        .forward_kinematics(joint_pos_deg) -> (4, 4)
        .inverse_kinematics(current_joint_pos, desired_ee_pose, position_weight, orientation_weight) -> degrees
    ActionFollower(kinematics, acceleration_limit=...)
        .follow(policy.predict_action_chunk(batch), observed)      .add(action or pose, stamp)
        .step(now) -> degrees to command

`inverse_kinematics` returns joint positions that the joints can reach within a frame: a few ticks of the velocity law
within the velocity limits. In reach this is Newton's method; out of reach the arm approaches the nearest pose by the
weights. The command never jumps, whatever the target does.

Reference: LeRobot, src/lerobot/model/kinematics.py (its own class uses placo).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.control.loop_limits import AnyLimit
from invariantqp.control.measure import ToolMeasure
from invariantqp.control.tracking import same_turn
from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.screws import angular_speeds
from invariantqp.geometry.se3 import cross
from invariantqp.paths.follower import Follower
from invariantqp.paths.solution import FollowerSolution
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.load import read_arm
from invariantqp.velocity.measure import root_at

__all__ = ["ActionFollower", "RobotKinematics"]

# Ticks in a frame: Newton's method converges in three for targets a few centimetres away.
TICKS = 4
# Largest step of the point in a tick, as a share of the arm's reach: from 1 on Newton's method oscillates out of reach.
MAX_STEP = 0.2
# Smoothing factor of the missed share of the point's step. On an SO-101 the arm comes to rest at each of six targets
# out of reach; with 1 it oscillates at one of them.
SMOOTHING = 0.05
# Deviation of the singular values of a rotation from 1 up to which the nearest rotation is taken.
ROTATION_TOLERANCE = 1e-2


class RobotKinematics:
    """Forward and inverse kinematics of one arm, with the interface of LeRobot's class; one stream, one thread.

    Attributes:
        robot: the arm, of the joints that move the frame, base first.
        target_frame_name, joint_names, position_first: as given.
        joint_indices: (m,) indices of the robot's joints in `joint_names`.
        position_error: distance of the frame from the last target, at the joint positions returned [length].
    """

    def __init__(
        self,
        urdf_path: str | PathLike[str],
        target_frame_name: str = "gripper_frame_link",
        joint_names: Sequence[str] | None = None,
        *,
        frame_time: float = 1.0 / 30.0,
        velocity_limit: ArrayLike | None = None,
        position_first: bool = True,
    ) -> None:
        """The arm of a URDF.

        Args:
            urdf_path: the path or the text of a URDF, or a name that `load_robot` knows.
            target_frame_name: the frame whose pose is controlled.
            joint_names: the joints, in the order of the positions. Those that do not move the frame, such as a
                gripper's, pass through. Other joints are fixed at zero. None is all that move the frame, base first.
            frame_time: time for which a command is held [s].
            velocity_limit: [deg/s], one for all joints that move the frame or one each, base first; None is the URDF's.
            position_first: True gives the position priority over the orientation in reach, and weights both out of
                reach. False always weights both, as placo does.

        Raises:
            BadInput: a frame time or velocity limit that is not positive, a joint without any velocity limit, a
                prismatic joint.
            UnknownName: no such frame or robot.
            RobotModelError: the URDF cannot be read, or none of the joints moves the frame.
        """
        given = None if joint_names is None else arrays.strings(joint_names, "joint_names")
        period = arrays.number(frame_time, "frame_time", "seconds", positive=True)
        self.position_first = arrays.flag(position_first, "position_first")
        arm = _arm(urdf_path, target_frame_name, given, velocity_limit)
        self.robot = arm
        self.target_frame_name = target_frame_name
        self.joint_names: list[str] = list(arm.names if given is None else given)
        self.position_error = 0.0
        self.joint_indices = np.array([self.joint_names.index(name) for name in arm.names])
        self._frame_displacement = period * arm.velocity_limit
        self._dt = period / TICKS
        self._max_step = MAX_STEP * ToolMeasure(arm).length
        self._last_turn: Array | None = None
        self._missed_share = 0.0

    def forward_kinematics(self, joint_pos_deg: ArrayLike) -> Array:
        """(4, 4) pose of the frame in the base frame, for positions of `joint_names` [deg]; others are ignored."""
        return self.robot.pose(np.radians(self._positions(joint_pos_deg, "joint_pos_deg")[self.joint_indices]))

    def inverse_kinematics(
        self,
        current_joint_pos: ArrayLike,
        desired_ee_pose: ArrayLike,
        position_weight: float = 1.0,
        orientation_weight: float = 0.01,
    ) -> Array:
        """Joint positions to command for the next frame [deg], each within a frame's motion of the current one.

        A joint outside its position limits is not moved back inside, but no farther out.

        Args:
            current_joint_pos: measured or last commanded joint positions [deg]; entries after `joint_names` pass
                through.
            desired_ee_pose: (4, 4) in the base frame; a rotation with rounding errors up to 0.01 is made orthogonal.
            position_weight: weight of the squared distance [1/length^2]; 0 leaves the position free.
            orientation_weight: weight of the squared angle [1/rad^2]; 0 leaves the orientation free.
        """
        positions = self._positions(current_joint_pos, "current_joint_pos")
        pose = _rigid(desired_ee_pose, "desired_ee_pose")
        target = self.robot.target(pose)
        weights = (
            arrays.not_negative(orientation_weight, "orientation_weight", "a weight") ** 0.5,
            arrays.not_negative(position_weight, "position_weight", "a weight") ** 0.5,
        )
        q = np.radians(positions[self.joint_indices])
        lower = np.maximum(q - self._frame_displacement, np.minimum(self.robot.position_lower, q))
        upper = np.minimum(q + self._frame_displacement, np.maximum(self.robot.position_upper, q))
        for tick in range(TICKS):
            J, error, _ = state = self.robot.state(q, target)
            position, desired = self.robot.points(state, target, np.zeros(3))
            turn = same_turn(error, self._last_turn)[:3]
            self._last_turn = turn.copy()
            # A straight line, on which the point's velocity does not depend on the rotation.
            displacement = desired - position
            if np.abs(np.concatenate((weights[0] * turn, weights[1] * displacement))).max() <= arrays.NEGLIGIBLE:
                break
            distance = float(np.linalg.norm(displacement)) if weights[1] else 0.0
            share = self._max_step / max(distance, self._max_step)
            s = share / self._dt * np.concatenate((turn, displacement - cross(turn, position)))
            bounds = (lower - q) / self._dt, (upper - q) / self._dt
            x = self._velocity(J, s, position, weights, bounds, last=tick == TICKS - 1)
            q = np.clip(q + self._dt * x, lower, upper)
        self.position_error = float(np.linalg.norm(self.robot.pose(q)[:3, 3] - pose[:3, 3]))
        commanded = positions.copy()
        commanded[self.joint_indices] = np.degrees(q)
        return commanded

    def _velocity(
        self,
        J: Array,
        s: Array,
        position: Array,
        weights: tuple[float, float],
        bounds: tuple[Array, Array],
        *,
        last: bool,
    ) -> Array:
        """(m,) joint velocity of a tick: weighted, or blended with the position's priority by what that misses."""
        lower, upper = bounds
        root = root_at(position, 1.0)
        weighted, point = (root * np.repeat(each, 3)[:, None] for each in (weights, (0.0, 1.0)))
        x = self._damped(J, s, weighted, lower, upper)
        if not self.position_first or not all(weights):
            return x
        y = self._damped(J, s, point, lower, upper)
        desired, residual = point.dot(s), point.dot(s - J.dot(y))
        missed = float(np.linalg.norm(residual)) / max(float(np.linalg.norm(desired)), arrays.NEGLIGIBLE)
        self._missed_share += SMOOTHING * (min(1.0, missed) - self._missed_share)
        share = self._missed_share
        if last:  # corrects the point, which the rotations before have moved to second order
            return (1.0 - share) * y
        turn = s[:3] - J[:3].dot(y)
        rest = np.concatenate((turn, -cross(turn, position)))
        fixed_point = point[3:].dot(J), np.zeros(3), None
        z = self._damped(J, rest, root, lower - y, upper - y, exact=fixed_point)
        return share * x + (1.0 - share) * (y + z)

    def _damped(self, J: Array, s: Array, root: Array, lower: Array, upper: Array, **more: Any) -> Array:
        """(m,) joint velocity for a twist, with residual-dependent damping."""
        fields = {"lower": lower, "upper": upper, **more}
        missed = law.tick(J, root, s, **fields)[3]
        damping = (self._dt * float(np.linalg.norm(root.dot(J))) * missed) ** 0.5
        x: Array = law.tick(J, root, s, damping=damping, **fields)[0]
        return x

    def _positions(self, value: ArrayLike, argument: str) -> Array:
        positions = arrays.vector(value, None, argument)
        if len(positions) < len(self.joint_names):
            raise BadInput(argument, f"{len(positions)} positions", f"{len(self.joint_names)}, one for each joint name")
        return positions


class ActionFollower:
    """Commands a robot along the action chunks of a LeRobot policy, or a teleoperator's stream; one thread.

    Chunks may be late, overlap, disagree or be missing, as for the `Follower` that it drives. The commanded positions
    are those of the follower's own motion, not of measured joints.

    Attributes:
        follower: the `Follower` of the joints that move the frame.
        solution: of the last tick, None before the first.
        action: (n,) last command, in the order of `kinematics.joint_names` [deg].
    """

    def __init__(
        self,
        kinematics: RobotKinematics,
        *,
        acceleration_limit: ArrayLike,
        jerk: ArrayLike | None = None,
        fps: float = 30.0,
        period: float = 0.01,
        cutoff: float = 3.0,
        timeout: float = 0.1,
        approach: float = 1.0 / 3.0,
        drop_outliers: bool = True,
        limits: Sequence[AnyLimit] = (),
    ) -> None:
        """A follower without a path; `reset` sets the joint positions first.

        Args:
            kinematics: the arm, its joints and velocity limits; its `position_first` applies to poses.
            acceleration_limit: one for all joints that move the frame or one each, base first [deg/s^2].
            jerk: likewise [deg/s^3]; None is the acceleration limit in 20 ms.
            fps: rate of the actions in a chunk [1/s].
            period: of `step` [s].
            cutoff: of the low-pass filter on a stream of samples [Hz].
            timeout: time after the last sample of a stream until the arm begins to stop [s], see `Follower`.
            approach: largest share of the velocity limits on the way to a stream's first sample.
            drop_outliers: whether single samples that the joints cannot reach in time are dropped, see `Follower`.
            limits: further limits of `Controller`, in radians: a `ToolSpeed`, a `Clearance` of `kinematics.robot`.
        """
        arrays.instance(kinematics, RobotKinematics, "kinematics", "an invariantqp.lerobot.RobotKinematics")
        arrays.instance(limits, (list, tuple), "limits", "a list of limits, as a Controller takes them")
        arm, has_few_joints = kinematics.robot, len(kinematics.robot.names) < 6
        controller = Controller(
            arm,
            dt=arrays.number(period, "period", "seconds", positive=True),
            acceleration_limit=_radians(acceleration_limit, "acceleration_limit"),
            limits=limits,
            exact="position" if kinematics.position_first and has_few_joints else None,
        )
        self._kinematics = kinematics
        self._action_period = 1.0 / arrays.number(fps, "fps", "a rate in 1/s", positive=True)
        self.follower = Follower(
            controller,
            jerk=None if jerk is None else _radians(jerk, "jerk"),
            cutoff=cutoff,
            timeout=timeout,
            approach=approach,
            drop_outliers=drop_outliers,
        )
        self.solution: FollowerSolution | None = None
        self.action: Array | None = None
        self._chunk: tuple[Array, Array] | None = None  # stamps and actions, for joints that do not move the frame

    def reset(self, action: ArrayLike) -> None:
        """Set the joint positions (n,) of `joint_names` [deg], at the start and after the robot was moved by hand."""
        measured = arrays.vector(action, len(self._kinematics.joint_names), "action")
        self.follower.controller.checked_positions(np.radians(measured[self._kinematics.joint_indices]), "action")
        self.action, self._chunk = measured.copy(), None

    def follow(self, chunk: Any, observed: float) -> None:
        """Follow a chunk, which replaces the path before; actions in the past are skipped.

        After an error the follower is unchanged.

        Args:
            chunk: (n, actions) or (1, n, actions) of `predict_action_chunk`, an array or a torch tensor, in the order
                of `joint_names` [deg]. A gripper is interpolated linearly.
            observed: time stamp of the observation, and so of the first action [s].
        """
        count = len(self._kinematics.joint_names)
        given = chunk.detach().cpu().numpy() if hasattr(chunk, "detach") else chunk
        actions = arrays.array(given, "chunk", f"actions (n, {count}) or (1, n, {count}) [deg]")
        actions = actions[0] if actions.ndim == 3 and len(actions) == 1 else actions
        actions = arrays.matrix(actions, (None, count), "chunk")
        start = arrays.number(observed, "observed", "a time in seconds")
        if start + self._action_period == start:
            raise BadInput("observed", f"{start:g}", "a time in seconds")
        stamps: Array = start + self._action_period * np.arange(len(actions), dtype=np.float64)
        self.follower.follow(np.radians(actions[:, self._kinematics.joint_indices]), stamps)
        self._chunk = stamps, actions

    def add(self, point: Any, stamp: float | None = None) -> None:
        """Add a sample to a teleoperator's stream. After an error the follower is unchanged.

        Args:
            point: (n,) action of a leader arm [deg], or (4, 4) pose of the frame in the base frame.
            stamp: time stamp of the sample [s]; None is now.
        """
        given = arrays.array(arrays.pose_matrix(point), "point", "an action [deg], or a pose (4, 4)")
        if given.ndim == 2:
            self.follower.add(given, stamp)
            return
        action = arrays.vector(given, len(self._kinematics.joint_names), "point")
        self.follower.add(np.radians(action[self._kinematics.joint_indices]), stamp)
        self._chunk = np.zeros(1), action[None].copy()

    def step(self, now: float | None = None) -> Array:
        """(n,) action for the next period, in the order of `joint_names` [deg]; `solution` has its status and reason.

        `now` is the time [s] on the clock of the stamps; None counts periods. Call `reset` before the first step.
        """
        if self.action is None:
            raise BadInput("now", "a step before the joint positions are known", "reset(measured) first")
        moving, follower = self._kinematics.joint_indices, self.follower
        q = np.radians(self.action[moving])
        self.solution = follower.step(q, now=now)
        action = self.action.copy()
        if self._chunk is not None:
            stamps, actions = self._chunk
            time = self.solution.place + self.solution.late
            for j in set(range(len(action))) - set(moving.tolist()):
                action[j] = np.interp(time, stamps, actions[:, j])
        action[moving] = np.degrees(q + follower.controller.dt * self.solution.velocity)
        self.action = action
        return action.copy()


def _radians(value: ArrayLike, argument: str) -> Array:
    """Positive limits in degrees, converted to radians."""
    given = arrays.array(value, argument, "numbers above zero, in degrees")
    if not (np.isfinite(given) & (given > 0.0)).all():
        raise BadInput(argument, excerpt(value), "finite numbers above zero, in degrees")
    return np.radians(given)


def _rigid(value: ArrayLike, argument: str) -> Array:
    """A (4, 4) pose, its rotation made orthogonal within ROTATION_TOLERANCE."""
    given = arrays.array(arrays.pose_matrix(value), argument, "a (4, 4) homogeneous rigid motion")
    if given.shape == (4, 4) and np.isfinite(given).all() and not arrays.is_rigid(given):
        U, sigma, Vt = np.linalg.svd(given[:3, :3])
        if np.abs(sigma - 1.0).max() <= ROTATION_TOLERANCE:
            given = given.copy()
            given[:3, :3] = U.dot(Vt)
    return arrays.pose(given, argument)


def _arm(source: str | PathLike[str], frame: str, given: tuple[str, ...] | None, speed: ArrayLike | None) -> Robot:
    """The arm of the given joints that move the frame, with velocity limits [deg/s]; None are the source's."""
    arrays.instance(source, (str, PathLike), "urdf_path", "the path or the text of a URDF, or a robot's name")
    arrays.instance(frame, str, "target_frame_name", "the name of a frame")
    if given is not None and len(set(given)) < len(given):
        raise BadInput("joint_names", "a name twice", "each joint once")
    moving = None if given is None else [name for name in given if _moves(source, frame, name)]
    if moving is not None and not moving:
        raise BadInput("joint_names", arrays.names(given or ()), f"joints that move {frame!r}")
    arm = read_arm(source, frame, None if moving is None else tuple(moving))
    rates = angular_speeds(arm.screws)
    if not rates.all():
        slides = arm.names[int(np.argmin(rates))]
        raise BadInput("urdf_path", f"joint {slides} slides", "joints that turn", "Positions are in degrees.")
    if speed is not None:
        arm = arm.with_limits(velocity_limit=_radians(speed, "velocity_limit"))
    if np.isinf(arm.velocity_limit).any():
        joints = arrays.names([n for n, v in zip(arm.names, arm.velocity_limit.tolist(), strict=True) if v == inf])
        raise BadInput("velocity_limit", f"none for {joints}", "finite limits [deg/s]", "Pass velocity_limit=...")
    return arm


def _moves(source: str | PathLike[str], frame: str, joint: str) -> bool:
    """Whether a joint moves the frame."""
    try:
        read_arm(source, frame, (joint,))
    except BadInput as error:
        if error.argument != "joints":
            raise
        return False
    return True
