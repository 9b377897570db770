"""Calls of robots, control, force, pose and what is above them with the right arguments."""

from functools import cache
from types import SimpleNamespace

import numpy as np

import invariantqp as iq
from invariantqp.pink import InvariantFrameTask
from support.calls_algebra import AXIS, POINT, TWIST, H, J, Q, S, T, contact, usual
from support.recordings import record
from support.wrist import wrist


@cache
def ur5():
    return iq.load_robot("ur5")


SO101 = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]


@cache
def so101():
    return iq.lerobot.RobotKinematics("so101", joint_names=SO101)


def actions():
    """A follower of actions, at rest."""
    follower = iq.lerobot.ActionFollower(so101(), acceleration_limit=1500.0)
    follower.reset(np.zeros(6))
    return follower


@cache
def chain():
    return iq.robots.Chain(J, T)


@cache
def controller():
    return iq.Controller(ur5(), dt=0.01, form=H)


def task():
    return iq.HybridTask(contact(), [5.0])


@cache
def demonstration():
    poses, wrenches, _ = record("point", 3, duration=2.0)
    return poses, wrenches, iq.contacts.identify(poses, wrenches, kinds=["point"])


@cache
def hybrid():
    return iq.HybridController(ur5(), task(), dt=0.01, order="moment first", form=H)


@cache
def follower():
    start = ur5().pose(Q)
    return iq.PathFollower(controller(), [start, iq.transform(translation=[0.01, 0.0, 0.0]) @ start])


@cache
def clearance():
    return iq.limits.Clearance(ur5(), {"tool": [iq.limits.Sphere([0, 0, 0], 0.05)]}, [iq.limits.Sphere([1, 0, 0], 0.1)])


@cache
def other_arm():
    return iq.limits.OtherArm(ur5(), {"tool": [iq.limits.Sphere([0, 0, 0], 0.05)]})


@cache
def pressed():
    start = ur5().pose(Q)
    return iq.PathFollower(hybrid(), [start, iq.transform(translation=[0.01, 0.0, 0.0]) @ start])


def braking():
    return iq.Controller(chain(), dt=0.01, acceleration_limit=8.0)


def shape_follower():
    made = iq.Follower(braking(), keep="shape")
    made.follow([chain().pose(Q), chain().pose(np.array(Q) + 0.02)])
    return made


def any_follower():
    return iq.Follower(braking())


STEP = {"q": Q, "velocity": Q, "now": 0.0, "override": 1.0}


def loop_options():
    names = "damping guard posture posture_gain joint_metric backend exact point length acceleration_limit delay"
    more = "position_margin tool_speed rows limits far_outside"
    return {"dt": 0.01, "gain": 5.0, "form": H} | usual(iq.Controller, f"{names} {more}")


def pose_options():
    return {"time_limit": 0.01, "restarts": 0} | usual(iq.solve_pose, "form exact tolerance seed clearance")


def frame_options(task):
    own = {"form": H, "point": POINT, "length": None, "damping": 0.01, "guard": True}
    return {"orientation_cost": 0.5, "lm_damping": 0.2} | own | usual(task, "position_cost gain")


TILTS = [iq.exp([0.6 * np.cos(k), 0.6 * np.sin(k), 0.0, 0.0, 0.0, 0.0]) for k in range(5)]


def sensor():
    return wrist(mass=0.5)


def shared():
    return iq.control.SharedTask(S, h=H)


def robot_calls(name, robot):
    return {
        f"{name}.pose": lambda: (robot().pose, {"q": Q}),
        f"{name}.jacobian": lambda: (robot().jacobian, {"q": Q}),
        f"{name}.origins": lambda: (robot().origins, {"q": Q}),
        f"{name}.target": lambda: (robot().target, {"pose": T}),
        f"{name}.with_tool": lambda: (
            robot().with_tool,
            {"offset": T, "bodies": [iq.limits.Sphere(POINT, 0.1)], "name": "pen", "without": []},
        ),
        f"{name}.with_limits": lambda: (
            robot().with_limits,
            {"position_lower": -1.0, "position_upper": 2.0, "velocity_limit": 0.5},
        ),
    }


SOURCE = {"joints": None, "offset": T}
NOW = {"speed": 0.5, "velocity_limit": 1.0, "tool_speed": 0.25, "limits": ()}
# What is called, and arguments that it takes.
# fmt: off
CONTROL = {
    # robots
    "load_robot": lambda: (iq.load_robot, {**SOURCE, "source": "ur5e", "tool": None, "base": T, "velocity_limit": 2.0}),
    "load_robot, screws": lambda: (iq.load_robot, {**SOURCE, "source": J, "tool": T, "base": None,
        "velocity_limit": None}),
    "middle": lambda: (iq.robots.middle, {"robot": chain()}),
    "joint_ranges": lambda: (iq.robots.joint_ranges, {"robot": chain()}),
    "urdf_of": lambda: (iq.robots.urdf_of, {"source": "panda"}),
    "rail": lambda: (iq.robots.rail, {"axis": [0, 0, 1.0], "lower": -1.0, "upper": 1.0, "speed": 1.0, "name": "rail"}),
    "mobile_base": lambda: (iq.robots.mobile_base, {"speed": 1.0, "turn_speed": 1.0, "name": "base"}),
    "stand_on": lambda: (iq.robots.stand_on, {"base": T, "arm": chain()}),
    "relative": lambda: (iq.robots.relative, {"arm": chain(), "other": ur5()}),
    "Chain": lambda: (iq.robots.Chain, {"screws": J, "home": T, "position_lower": -1.0, "position_upper": 1.0,
        "velocity_limit": 1.0} | usual(iq.robots.Chain, "names tool places links coupled notes")),
    **robot_calls("Chain", chain),
    # control
    "Controller": lambda: (iq.Controller, {"robot": ur5(), **loop_options()}),
    "Controller.step": lambda: (controller().step, {"q": Q, "target": T, "feedforward": TWIST, "velocity": Q, **NOW}),
    "Controller.follow": lambda: (controller().follow, {"q": Q, "twist": TWIST, "velocity": Q, "at": "base",
        "rows": None, "robot_state": None, "measured_at": POINT, "posture": Q, **NOW}),
    "PinkLimit": lambda: (iq.limits.PinkLimit, {"limit": SimpleNamespace(compute_qp_inequalities=lambda *_: None),
        "collision_model": None}),
    "Controller.rest": lambda: (controller().rest, {"q": Q, "reason": "why", "velocity": Q, "robot_state": None}),
    "Controller.checked_positions": lambda: (controller().checked_positions, {"q": Q, "argument": "q"}),
    "PathFollower": lambda: (iq.PathFollower, {"loop": controller(), "path": [T, T @ iq.exp(TWIST)]} |
        usual(iq.PathFollower, "end times rate acceleration jerk joint_jerk blocked tolerance corners")),
    "Clearance": lambda: (iq.limits.Clearance, {"robot": ur5(),
        "bodies": {"tool": [iq.limits.Sphere([0, 0, 0], 0.05)]}, "obstacles": [iq.limits.Sphere([1, 0, 0], 0.1)],
        "distance": 0.02, "pairs": None, "exclude": (), "rate": 10.0}),
    "Clearance.at": lambda: (clearance().at, {"q": Q}),
    "Clearance.blocked": lambda: (clearance().blocked, {"q": Q}),
    "Clearance.distances": lambda: (clearance().distances, {"q": Q}),
    "Clearance.shapes": lambda: (clearance().shapes, {"q": Q}),
    "OtherArm": lambda: (iq.limits.OtherArm, {"robot": ur5(),
        "bodies": {"tool": [iq.limits.Sphere([0, 0, 0], 0.05)]}, "name": "left", "acceleration_limit": 5.0}),
    "OtherArm.move": lambda: (other_arm().move, {"q": Q, "velocity": None}),
    "bodies_of": lambda: (iq.robots.bodies_of, {"robot": ur5()}),
    "PathFollower.prepare": lambda: (follower().prepare, {"q": Q}),
    "PathFollower.step": lambda: (pressed().step, STEP | {"wrench": TWIST, "contact": contact(), "wanted": [5.0]}),
    "PathFollower.follow": lambda: (shape_follower().follow, {"points": [T, T @ iq.exp(TWIST)], "stamps": None,
        "at": None}),
    "PathFollower.add": lambda: (any_follower().add, {"point": T, "stamp": 0.0}),
    "PathFollower.twist": lambda: (shape_follower().twist, {"v": TWIST, "at": "base"}),
    "PathFollower.pose": lambda: (follower().pose, {"place": 0.5}),
    "Follower": lambda: (iq.Follower, {"loop": braking(), "jerk": 400.0, "cutoff": 4.0, "tolerance": 1e-4} |
        usual(iq.Follower, "keep rate timeout approach drop_outliers blocked")),
    "Follower.follow": lambda: (any_follower().follow, {"points": [Q, Q], "stamps": [0.0, 1.0], "at": 0.0}),
    "Follower.add": lambda: (any_follower().add, {"point": T, "stamp": 0.0}),
    "Follower.twist": lambda: (any_follower().twist, {"v": TWIST, "at": "tool"}),
    "Follower.prepare": lambda: (shape_follower().prepare, {"q": Q}),
    "Follower.step": lambda: (any_follower().step, STEP | {"wrench": None, "contact": None, "wanted": None}),
    "ExactTwist": lambda: (iq.control.ExactTwist, {}),
    "ExactPoint": lambda: (iq.control.ExactPoint, {"point": POINT}),
    "Target": lambda: (iq.Target, {"point": POINT, "axis": AXIS, "tool_point": POINT, "tool_axis": AXIS}),
    "Target.met_by": lambda: (iq.Target(POINT, AXIS).met_by, {"pose": T}),
    "Target.errors": lambda: (iq.Target(POINT, AXIS).errors, {"pose": T}),
    "Target.relabelled": lambda: (iq.Target(POINT, AXIS).relabelled, {"tool_offset": T}),
    "ExactAxis": lambda: (iq.control.ExactAxis, {"axis": AXIS}),
    "ExactPlane": lambda: (iq.control.ExactPlane, {"normal": AXIS, "point": POINT}),
    "ExactJoints": lambda: (iq.control.ExactJoints, {"A": J[:2], "b": 0.0}),
    "tool_metric": lambda: (iq.tool_metric, {"robot": chain(), "length": None}),
    "SharedTask": lambda: (iq.control.SharedTask, {"S1": S, "S2": None, "h": H, "metric": None}),
    "SharedTask.moved": lambda: (shared().moved, {"pose": T}),
    "SharedTask.twist": lambda: (shared().twist, {"robot": TWIST, "operator": TWIST}),
    "LinkEnd": lambda: (iq.control.LinkEnd, {"dt": 0.01, "passes": "twist", "store": 0.02, "timeout": 0.5,
        "delay": 0.05, "stiffness": 1e4}),
    "LinkEnd.step": lambda: (iq.control.LinkEnd(dt=0.01, passes="twist").step, {"twist": TWIST, "wrench": TWIST,
        "received": 0.1, "age": 0.0, "done": TWIST}),
    # force
    "HybridTask": lambda: (iq.HybridTask, {"contact": contact(), "wrench": [5.0], "compliance": 1e-3,
        "approach_time": 20.0, "max_force": 60.0, "max_moment": 10.0, "on_overload": "hold", "grip": POINT} |
        usual(iq.HybridTask, "h complement metric stiffness size normal_within slide_speed lost_below lost_after") |
        usual(iq.HybridTask, "on_loss yields edge_margin approach_speed approach_distance retreat_speed") |
        usual(iq.HybridTask, "retreat_distance")),
    "identify": lambda: (iq.contacts.identify, {"poses": demonstration()[0], "wrenches": demonstration()[1],
        "exerts": True, "noise": (np.repeat([1e-3, 2e-4], 3), np.repeat([0.02, 0.3], 3)), "accuracy": (1e-4, 1e-4),
        "kinds": ["point"], "sensor": None}),
    "Identification.contact": lambda: (demonstration()[2].contact, {"tool": T}),
    "Identification.task": lambda: (demonstration()[2].task, {"press": 5.0}),
    "Candidate.contact": lambda: (demonstration()[2].best.contact, {"tool": T}),
    "Candidate.task": lambda: (demonstration()[2].best.task, {"press": 5.0}),
    "HybridTask.contact_at": lambda: (task().contact_at, {"tool": T, "contact": contact()}),
    "HybridTask.relabelled": lambda: (task().relabelled, {"offset": T, "tool_offset": T}),
    "HybridTask.split": lambda: (task().split, {"kind": contact().kind, "grip": [0.0, 0.0, 0.1]}),
    "HybridController": lambda: (iq.HybridController, {"robot": ur5(), "task": task(), "sensor": None,
        "order": "moment first", "force_first": True, "tare": True, **loop_options()}),
    "margins": lambda: (iq.force.margins, {"k": 1e4, "b": 10.0, "T": 0.02, "k_bound": 2e4, "b_bound": 20.0}),
    "HybridController.step": lambda: (hybrid().step, {"q": Q, "target": T, "wrench": TWIST, "feedforward": TWIST,
        "contact": contact(), "velocity": Q, "wanted": [5.0], "posture": Q}),
    "WrenchSensor": lambda: (iq.WrenchSensor, {"mount": T, "order": "force first", "mass": 0.5, "centre": POINT,
        "gravity": [0, 0, -9.81], "bias": np.zeros(6), "cutoff": 50.0, "force_deadband": 0.1, "moment_deadband": 0.1,
        "noise": 0.2, "drift": 0.003, "reads": "reaction", "origin": POINT}),
    "WrenchSensor.tare": lambda: (sensor().tare, {"tool": T}),
    "WrenchSensor.load": lambda: (sensor().load, {"reading": TWIST, "tool": T}),
    "WrenchSensor.wrench": lambda: (sensor().wrench, {"reading": TWIST, "tool": T}),
    "WrenchSensor.check": lambda: (sensor().check, {"readings": np.array([sensor().tare(pose) for pose in TILTS]),
        "poses": np.array(TILTS)}),
    "Wrench": lambda: (iq.Wrench, {"moment": POINT, "force": POINT}),
    "WrenchSensor.in_base": lambda: (sensor().in_base, {"wrench": TWIST, "tool": T}),
    "WrenchSensor.deadband": lambda: (sensor().deadband, {"wrench": TWIST}),
    "WrenchSensor.relabelled": lambda: (sensor().relabelled, {"offset": T, "tool_offset": T}),
    # pose
    "solve_pose": lambda: (iq.solve_pose, {"robot": ur5(), "target": ur5().pose(Q), "q0": Q + 0.01, **pose_options()}),
    "solve_poses": lambda: (iq.solve_poses, {"robot": ur5(), "targets": [ur5().pose(Q)], "q0": Q + 0.01,
        "along": False, "jobs": 1, **pose_options()}),
    # Pink
    "InvariantFrameTask": lambda: (InvariantFrameTask, {"frame": "tool0"} | frame_options(InvariantFrameTask)),
    "InvariantFrameTask.set_target": lambda: (InvariantFrameTask("tool0").set_target, {"transform_target_to_world": T}),
    "InvariantFrameTask.set_position_cost": lambda: (
        InvariantFrameTask("tool0").set_position_cost, {"position_cost": 2.0}),
    "InvariantFrameTask.set_orientation_cost": lambda: (
        InvariantFrameTask("tool0").set_orientation_cost, {"orientation_cost": [1.0, 2.0, 0.0]}),
    "InvariantFrameTask, mink": lambda: (
        iq.mink.InvariantFrameTask,
        {"frame_name": "tool", "frame_type": "site"} | frame_options(iq.mink.InvariantFrameTask)),
    "InvariantFrameTask.set_target, mink": lambda: (
        iq.mink.InvariantFrameTask("tool", "site").set_target, {"transform_target_to_world": T}),
    # LeRobot
    "RobotKinematics": lambda: (iq.lerobot.RobotKinematics, {"urdf_path": "ur5e", "target_frame_name": "tool0",
        "joint_names": list(iq.load_robot("ur5e").names), "frame_time": 0.03, "velocity_limit": 100.0,
        "position_first": True}),
    "RobotKinematics.forward_kinematics": lambda: (so101().forward_kinematics, {"joint_pos_deg": np.zeros(6)}),
    "RobotKinematics.inverse_kinematics": lambda: (so101().inverse_kinematics, {"current_joint_pos": np.zeros(6),
        "desired_ee_pose": so101().forward_kinematics(np.ones(6)), "position_weight": 1.0, "orientation_weight": 0.01}),
    "ActionFollower": lambda: (iq.lerobot.ActionFollower, {"kinematics": so101(), "acceleration_limit": 1500.0,
        "jerk": 60000.0, "fps": 30.0, "period": 0.01, "cutoff": 4.0, "timeout": 0.1, "approach": 0.5,
        "drop_outliers": True, "limits": [iq.limits.ToolSpeed(0.25)]}),
    "ActionFollower.reset": lambda: (actions().reset, {"action": np.zeros(6)}),
    "ActionFollower.follow": lambda: (actions().follow, {"chunk": np.zeros((1, 50, 6)), "observed": 0.0}),
    "ActionFollower.add": lambda: (actions().add, {"point": np.zeros(6), "stamp": 0.0}),
    "ActionFollower.step": lambda: (actions().step, {"now": 0.0}),
    # runs, analysis, pictures
    "load_task": lambda: (iq.load_task, {"path_or_name": "panda_path"}),
    "new_task": lambda: (iq.tasks.new_task, {"name": "mine", "robot": "ur5", "path": "line", "contact": "point"}),
    "shipped_tasks": lambda: (iq.tasks.shipped_tasks, {"group": ""}),
    "inspect": lambda: (iq.workbench.inspect, {"robot": ur5(), "name": "robot", "q": Q, "samples": 4}),
}
# fmt: on
