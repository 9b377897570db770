"""LeRobot's kinematics class, and its action chunks on a `Follower`: degrees in and out. It imports no LeRobot.

    RobotKinematics(urdf_path, target_frame_name, joint_names)
        .forward_kinematics(joint_pos_deg) -> (4, 4)
        .inverse_kinematics(current_joint_pos, desired_ee_pose, position_weight, orientation_weight) -> degrees
    ActionFollower(kinematics, acceleration_limit=...)
        .follow(policy.predict_action_chunk(batch), observed)      .add(action or pose, stamp)
        .step(now) -> degrees to command

An answer of `inverse_kinematics` is where the joints can be a frame later: a few ticks of the velocity law, inside what
the velocity limits allow in a frame. In reach that is Newton's method, so the tool arrives within the frame if the
joints are fast enough; out of reach it is the way to the nearest pose by the weights. No answer jumps, whatever the
target does.

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
from invariantqp.control.limits import AnyLimit
from invariantqp.control.measure import ToolMeasure
from invariantqp.control.tracking import same_turn
from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.screws import turning
from invariantqp.geometry.se3 import cross
from invariantqp.paths.driver import Follower
from invariantqp.paths.solution import FollowerSolution
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.load import read_arm
from invariantqp.velocity.measure import root_at

__all__ = ["ActionFollower", "RobotKinematics"]

# Ticks of a frame: Newton's method is at rounding after three for targets a few centimetres away, one is to spare.
TICKS = 4
# The largest step of the point in a tick, as a share of the arm's reach. Towards a target beyond the workspace Newton's
# method overshoots by the distance over the reach: from 1 on it oscillates.
STRIDE = 0.2
# What a tick adds to the memory of the share of the point's way that the joints lose. That share decides how far the
# turn is weighed against the point. Measured on an SO-101: taken from one tick alone, one of six targets out of reach
# never sees it at rest; with 0.05 all do, and a point that returns is within a micrometre after ten frames.
MEMORY = 0.05
# Singular values of a rotation may be this far from 1 in a stream of poses: LeRobot goes on with those.
NEARLY_RIGID = 1e-2


class RobotKinematics:
    """Forward and inverse kinematics of one arm, called as LeRobot's class is; one stream, one thread.

    Attributes:
        robot: the arm.
        target_frame_name, joint_names, position_first: as given.
        position_error: how far the tool of the last answer is from its target [length].
        moving: (m,) which of them move the frame, base first.
        speed: (m,) their velocity limits [rad/s].
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
            target_frame_name: the frame whose pose is meant.
            joint_names: the joints, in the order of the positions; those that do not move the frame, a gripper's, pass
                through. Joints that are not among them are held at zero. None is all that move the frame, base first.
            frame_time: how long an answer is commanded [s].
            velocity_limit: [deg/s], one for all joints that move the frame or one each, base first; None is the URDF's.
            position_first: True brings the point to its target wherever the joints can, and turns the tool as far as
                that leaves them free; out of reach both are weighed. False always weighs both by the weights of a call,
                as placo does.

        Raises:
            BadInput: a frame time or velocity limit that is not positive, a joint without any velocity limit, a joint
                that slides.
            UnknownName: no such frame or robot.
            RobotModelError: the URDF cannot be read, or no joint of these moves the frame.
        """
        given = None if joint_names is None else arrays.strings(joint_names, "joint_names")
        period = arrays.number(frame_time, "frame_time", "seconds", positive=True)
        self.position_first = arrays.flag(position_first, "position_first")
        arm = _arm(urdf_path, target_frame_name, given, velocity_limit)
        self.robot = arm
        self.target_frame_name = target_frame_name
        self.joint_names: list[str] = list(arm.names if given is None else given)
        self.position_error = 0.0
        self.moving = np.array([self.joint_names.index(name) for name in arm.names])
        self.speed: Array = arm.velocity_limit
        self._step = period * self.speed
        self._dt = period / TICKS
        self._stride = STRIDE * ToolMeasure(arm).length
        self._turn: Array | None = None
        self._lost = 0.0

    def forward_kinematics(self, joint_pos_deg: ArrayLike) -> Array:
        """(4, 4) pose of the frame in the base frame; positions of `joint_names` [deg], more may follow."""
        return self.robot.pose(np.radians(self._positions(joint_pos_deg, "joint_pos_deg")[self.moving]))

    def inverse_kinematics(
        self,
        current_joint_pos: ArrayLike,
        desired_ee_pose: ArrayLike,
        position_weight: float = 1.0,
        orientation_weight: float = 0.01,
    ) -> Array:
        """Joint positions to command for the next frame [deg], each within a frame's motion of the current one.

        A joint outside its position limits is not pulled back inside; it moves no farther out.

        Args:
            current_joint_pos: where the joints are, measured or commanded last; what follows `joint_names` passes
                through [deg].
            desired_ee_pose: (4, 4) in the base frame. A rotation that is off by up to a hundredth, as sums of rounded
                numbers are, is taken as the nearest one.
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
        q = np.radians(positions[self.moving])
        lower = np.maximum(q - self._step, np.minimum(self.robot.position_lower, q))
        upper = np.minimum(q + self._step, np.maximum(self.robot.position_upper, q))
        for tick in range(TICKS):
            J, error, _ = state = self.robot.state(q, target)
            here, there = self.robot.points(state, target, np.zeros(3))
            turn = same_turn(error, self._turn)[:3]
            self._turn = turn.copy()
            if np.abs(np.concatenate((weights[0] * turn, weights[1] * (there - here)))).max() <= arrays.NEGLIGIBLE:
                break
            # The straight way, on which the point's velocity does not depend on how far the tool has to turn.
            way = there - here
            far = float(np.linalg.norm(way)) if weights[1] else 0.0
            share = self._stride / max(far, self._stride)
            s = share / self._dt * np.concatenate((turn, way - cross(turn, here)))
            bounds = (lower - q) / self._dt, (upper - q) / self._dt
            x = self._velocity(J, s, here, weights, bounds, last=tick == TICKS - 1)
            q = np.clip(q + self._dt * x, lower, upper)
        self.position_error = float(np.linalg.norm(self.robot.pose(q)[:3, 3] - pose[:3, 3]))
        answer = positions.copy()
        answer[self.moving] = np.degrees(q)
        return answer

    def _velocity(
        self,
        J: Array,
        s: Array,
        here: Array,
        weights: tuple[float, float],
        bounds: tuple[Array, Array],
        *,
        last: bool,
    ) -> Array:
        """(m,) the joint velocity of a tick: by the weights, or the point first as far as it can be brought."""
        lower, upper = bounds
        root = root_at(here, 1.0)
        weighed, point = (root * np.repeat(each, 3)[:, None] for each in (weights, (0.0, 1.0)))
        x = self._damped(J, s, weighed, lower, upper)
        if not self.position_first or not all(weights):
            return x
        y = self._damped(J, s, point, lower, upper)
        wanted, left = point.dot(s), point.dot(s - J.dot(y))
        lost = float(np.linalg.norm(left)) / max(float(np.linalg.norm(wanted)), arrays.NEGLIGIBLE)
        self._lost += MEMORY * (min(1.0, lost) - self._lost)
        share = self._lost
        if last:  # the turn of the ticks before has moved the point, to second order
            return (1.0 - share) * y
        turn = s[:3] - J[:3].dot(y)
        rest = np.concatenate((turn, -cross(turn, here)))
        still = point[3:].dot(J), np.zeros(3), None
        z = self._damped(J, rest, root, lower - y, upper - y, exact=still)
        return share * x + (1.0 - share) * (y + z)

    def _damped(self, J: Array, s: Array, root: Array, lower: Array, upper: Array, **more: Any) -> Array:
        """(m,) the law's joint velocity for a twist, damped by what it misses."""
        fields = {"lower": lower, "upper": upper, **more}
        missed = law.tick(J, root, s, **fields)[3]
        damping = (self._dt * float(np.linalg.norm(root.dot(J))) * missed) ** 0.5
        x: Array = law.tick(J, root, s, damping=damping, **fields)[0]
        return x

    def _positions(self, value: ArrayLike, argument: str) -> Array:
        positions = arrays.vector(value, None, argument)
        if len(positions) < len(self.joint_names):
            raise BadInput(argument, f"{len(positions)} positions", f"{len(self.joint_names)}, one for each joint")
        return positions


class ActionFollower:
    """Drives a robot along what a LeRobot policy or teleoperator sends, at the rate of its servos; one thread.

    Chunks may be late, overlap, disagree or not come: see `Follower`, whose state machine and limits these are. A robot
    that takes positions is commanded along the follower's own motion, which it is never asked to leave.

    Attributes:
        follower: what follows.
        solution: of the last tick, None before the first.
        action: (n,) commanded last, in the order of `kinematics.joint_names` [deg].
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
        """Nothing to follow yet; `reset` says where the robot is.

        Args:
            kinematics: the arm, its motors, their speeds; `position_first` says what poses ask of five joints.
            acceleration_limit: one for all joints that move the frame or one each, base first [deg/s^2].
            jerk: likewise [deg/s^3]; None lets the acceleration rise to its limit in 20 ms.
            fps: of the actions of a chunk [1/s].
            period: of `step` [s].
            cutoff: what is faster than this is smoothed away [Hz].
            timeout: how long after the last sample of a stream that is not of chunks the arm begins to stop [s]; more
                for a slow stream, as in `Follower`.
            approach: the share of the speed limits used at most on the way to a teleoperator's first sample.
            drop_outliers: whether a single sample is dropped that the motors could not reach in time; see `Follower`.
            limits: more of them, as `Controller` takes them, in radians: a `ToolSpeed`, a `Clearance` of
                `kinematics.robot`.
        """
        arrays.instance(kinematics, RobotKinematics, "kinematics", "an invariantqp.lerobot.RobotKinematics")
        arrays.instance(limits, (list, tuple), "limits", "a list of limits, as a Controller takes them")
        arm, few = kinematics.robot, len(kinematics.robot.names) < 6
        loop = Controller(
            arm,
            dt=arrays.number(period, "period", "seconds", positive=True),
            acceleration_limit=_radians(acceleration_limit, "acceleration_limit"),
            limits=limits,
            exact="position" if kinematics.position_first and few else None,
        )
        self._kinematics = kinematics
        self._gap = 1.0 / arrays.number(fps, "fps", "a rate in 1/s", positive=True)
        rise = None if jerk is None else _radians(jerk, "jerk")
        kept: dict[str, Any] = {"approach": approach, "drop_outliers": drop_outliers}
        self.follower = Follower(loop, jerk=rise, cutoff=cutoff, timeout=timeout, **kept)
        self.solution: FollowerSolution | None = None
        self.action: Array | None = None
        self._chunk: tuple[Array, Array] | None = None  # stamps, and actions of what does not move the frame

    def reset(self, action: ArrayLike) -> None:
        """Say where the robot is, at the start and after it was moved by hand: (n,), as `joint_names` are [deg]."""
        now = arrays.vector(action, len(self._kinematics.joint_names), "action")
        self.follower.controller.believed(np.radians(now[self._kinematics.moving]), "action")
        self.action, self._chunk = now.copy(), None

    def follow(self, chunk: Any, observed: float) -> None:
        """Follow a chunk in place of what was followed before; what of it is over already is skipped.

        After an error the follower is as it was.

        Args:
            chunk: (n, actions) or (1, n, actions) as `predict_action_chunk` returns it, in degrees, in the order of
                `joint_names`; a tensor of torch, too. A gripper goes straight from one action to the next.
            observed: when the observation was made that it answers [s], the time of its first action.
        """
        count = len(self._kinematics.joint_names)
        given = chunk.detach().cpu().numpy() if hasattr(chunk, "detach") else chunk
        actions = arrays.array(given, "chunk", f"actions (n, {count}) or (1, n, {count}) [deg]")
        actions = actions[0] if actions.ndim == 3 and len(actions) == 1 else actions
        actions = arrays.matrix(actions, (None, count), "chunk")
        begins = arrays.number(observed, "observed", "a time in seconds")
        if begins + self._gap == begins:
            raise BadInput("observed", f"{begins:g}", "a time in seconds")
        stamps: Array = begins + self._gap * np.arange(len(actions), dtype=np.float64)
        self.follower.follow(np.radians(actions[:, self._kinematics.moving]), stamps)
        self._chunk = stamps, actions

    def add(self, point: Any, stamp: float | None = None) -> None:
        """Follow a teleoperator: one more sample of a stream. After an error the follower is as it was.

        Args:
            point: (n,) an action, of a leader arm [deg], or a (4, 4) pose of the frame in the base frame.
            stamp: when it was so [s]; None is now.
        """
        given = arrays.array(arrays.matrix_of(point), "point", "an action [deg], or a pose (4, 4)")
        if given.ndim == 2:
            self.follower.add(given, stamp)
            return
        action = arrays.vector(given, len(self._kinematics.joint_names), "point")
        self.follower.add(np.radians(action[self._kinematics.moving]), stamp)
        self._chunk = np.zeros(1), action[None].copy()

    def step(self, now: float | None = None) -> Array:
        """(n,) the action for the next period, in the order of `joint_names` [deg]; `solution` has the rest.

        `now` is the time [s], by the clock of the stamps; None counts periods. `reset` has to say first where the robot
        is.
        """
        if self.action is None:
            raise BadInput("now", "a tick before it is known where the robot is", "reset(measured) first")
        moving, follower = self._kinematics.moving, self.follower
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
    """Limits in degrees, in radians."""
    given = arrays.array(value, argument, "numbers above zero, in degrees")
    if not (np.isfinite(given) & (given > 0.0)).all():
        raise BadInput(argument, excerpt(value), "finite numbers above zero, in degrees")
    return np.radians(given)


def _rigid(value: ArrayLike, argument: str) -> Array:
    """A (4, 4) rigid motion, its rotation the nearest where what is given is one but for a hundredth."""
    given = arrays.array(arrays.matrix_of(value), argument, "a (4, 4) homogeneous rigid motion")
    if given.shape == (4, 4) and np.isfinite(given).all() and not arrays.is_rigid(given):
        U, sigma, Vt = np.linalg.svd(given[:3, :3])
        if np.abs(sigma - 1.0).max() <= NEARLY_RIGID:
            given = given.copy()
            given[:3, :3] = U.dot(Vt)
    return arrays.pose(given, argument)


def _arm(source: str | PathLike[str], frame: str, given: tuple[str, ...] | None, speed: ArrayLike | None) -> Robot:
    """The joints that move the frame, of those given, with their speeds [deg/s]; None are the source's."""
    arrays.instance(source, (str, PathLike), "urdf_path", "the path or the text of a URDF, or a robot's name")
    arrays.instance(frame, str, "target_frame_name", "the name of a frame")
    if given is not None and len(set(given)) < len(given):
        raise BadInput("joint_names", "a name twice", "each joint once")
    moving = None if given is None else [name for name in given if _moves(source, frame, name)]
    if moving is not None and not moving:
        raise BadInput("joint_names", arrays.names(given or ()), f"joints that move {frame!r}")
    arm = read_arm(source, frame, None if moving is None else tuple(moving))
    rates = turning(arm.screws)
    if not rates.all():
        slides = arm.names[int(np.argmin(rates))]
        raise BadInput("urdf_path", f"joint {slides} slides", "joints that turn", "Positions are in degrees.")
    if speed is not None:
        arm = arm.with_limits(velocity_limit=_radians(speed, "velocity_limit"))
    if np.isinf(arm.velocity_limit).any():
        joints = arrays.names([n for n, v in zip(arm.names, arm.velocity_limit.tolist(), strict=True) if v == inf])
        raise BadInput("velocity_limit", f"none for {joints}", "finite limits [deg/s]", "Say velocity_limit=...")
    return arm


def _moves(source: str | PathLike[str], frame: str, joint: str) -> bool:
    """Whether a joint moves the frame; a gripper's does not."""
    try:
        read_arm(source, frame, (joint,))
    except BadInput as error:
        if error.argument != "joints":
            raise
        return False
    return True
