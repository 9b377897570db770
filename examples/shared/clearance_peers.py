"""Pink and mink with the shapes, pairs, limits, gain and posture of a `Clearance`, to compare with."""

# ruff: noqa: E501, BLE001, SLF001 (a model is text in long lines; whatever a solver raises, the arm stops; all shapes)
from __future__ import annotations

import coal
import mink
import mujoco
import numpy as np
import pink
import pinocchio as pin
from pink.barriers import SelfCollisionBarrier

from invariantqp.geometry.shapes import Core

# Each at the gain of its own examples.
GAINS = {"mink": 0.85, "Pink": 20.0}


def pinocchio_model(clearance):
    """The same pairs in a Pinocchio model, for coal."""
    model = clearance.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, np.zeros(model.nq))
    geometry = pin.GeometryModel()
    made = {}
    for k, (name, body, at) in enumerate(clearance.shapes(np.zeros(model.nq))):
        if at.core is Core.SEGMENT:
            shape = coal.Capsule(at.radius, 2.0 * float(at.half[2]))
        elif at.core is Core.BOX:
            shape = coal.Box(*(2.0 * at.half))
        else:  # Pinocchio's pairs of coal take a half-space; MuJoCo has planes
            shape = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
        place = data.oMi[body or 0].inverse() * pin.SE3(at.pose[:3, :3], at.pose[:3, 3])
        made[k] = geometry.addGeometryObject(pin.GeometryObject(f"{name} {k}", body or 0, place, shape))
    for i, j in clearance._shape_pairs:
        geometry.addCollisionPair(pin.CollisionPair(made[i], made[j]))
    return model, geometry


def mujoco_model(clearance):
    """The same shapes and pairs as a MuJoCo model; bodies are at the base frame at q = 0."""
    robot, m = clearance.robot, len(clearance.robot.names)

    def words(numbers):
        return " ".join(repr(float(x)) for x in numbers)

    def geoms(body):
        text = ""
        for k, (_, of, at) in enumerate(clearance.shapes(np.zeros(m))):
            if (of or 0) != body:
                continue
            T = at.pose
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(T[:3, :3]).ravel())
            if at.core is Core.HALF_SPACE:
                kind, size = "plane", (3.0, 3.0, 0.1)
            elif at.core is Core.BOX:
                kind, size = "box", at.half
            else:
                kind, size = "capsule", (at.radius, max(float(at.half[2]), 1e-6))
            text += f'<geom name="g{k}" type="{kind}" size="{words(size)}" pos="{words(T[:3, 3])}" quat="{words(quaternion)}" mass="1"/>'
        return text

    text = '<mujoco><compiler angle="radian" autolimits="true"/><option gravity="0 0 0"/><worldbody>' + geoms(0)
    for i, (screw, low, high) in enumerate(
        zip(robot.screws.T, robot.position_lower, robot.position_upper, strict=True)
    ):
        place = np.cross(screw[:3], screw[3:])
        text += (f'<body name="b{i + 1}"><joint name="j{i + 1}" type="hinge" axis="{words(screw[:3])}" pos="{words(place)}" '
                 f'range="{max(low, -1e3)} {min(high, 1e3)}"/>')  # fmt: skip
        text += geoms(i + 1) or '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(robot.home[:3, :3]).ravel())
    text += f'<site name="tool" pos="{words(robot.home[:3, 3])}" quat="{words(quaternion)}"/>' + "</body>" * m
    model = mujoco.MjModel.from_xml_string(text + "</worldbody></mujoco>")
    return model, [([f"g{i}"], [f"g{j}"]) for i, j in clearance._shape_pairs]


class Peer:
    """Pink or mink with the same shapes, pairs, limits, gain and posture as our loop."""

    def __init__(self, kind, clearance, dt, q, gain, *, kept=True):
        """`kept` False leaves the clearance out."""
        self.kind, self.dt, robot = kind, dt, clearance.robot
        middle = 0.5 * (np.maximum(robot.position_lower, -np.pi) + np.minimum(robot.position_upper, np.pi))
        if kind == "Pink":
            model, geometry = pinocchio_model(clearance)
            self.configuration = pink.Configuration(model, model.createData(), q, collision_model=geometry)
            self.task = pink.tasks.FrameTask(
                robot.tool, position_cost=1.0, orientation_cost=1.0, lm_damping=1e-6, gain=0.1
            )
            self.posture = pink.tasks.PostureTask(cost=1e-3, gain=0.001)
            barrier = SelfCollisionBarrier(len(geometry.collisionPairs), gain=gain, safe_displacement_gain=0.0,
                                           d_min=clearance.distance)  # fmt: skip
            self.more = {"barriers": [barrier] if kept else []}
        else:
            model, groups = mujoco_model(clearance)
            self.configuration = mink.Configuration(model)
            self.task = mink.FrameTask(
                "tool", "site", position_cost=1.0, orientation_cost=1.0, gain=0.1, lm_damping=1e-6
            )
            self.posture = mink.PostureTask(model, cost=1e-3, gain=0.001)
            speeds = {f"j{i + 1}": v for i, v in enumerate(robot.velocity_limit)}
            apart = mink.CollisionAvoidanceLimit(model, groups, gain=gain, collision_detection_distance=0.05,
                                                 minimum_distance_from_collisions=clearance.distance)  # fmt: skip
            self.more = {"limits": [mink.ConfigurationLimit(model), mink.VelocityLimit(model, speeds), *[apart] * kept]}
        self.posture.set_target(middle)

    def __call__(self, q, target):
        self.configuration.update(q)
        wanted = pin.SE3(target) if self.kind == "Pink" else mink.SE3.from_matrix(target)
        self.task.set_target(wanted)
        library = pink if self.kind == "Pink" else mink
        try:
            x = library.solve_ik(self.configuration, [self.task, self.posture], self.dt, solver="daqp",
                                 safety_break=False, **self.more)  # fmt: skip
        except Exception:  # whatever a solver raises where limits contradict each other: the arm stops
            return np.zeros(len(q))
        return x if np.isfinite(x).all() else np.zeros(len(q))
