"""Arms of Pinocchio models as `Chain`s, and the collision model of an arm.

Only the joints between base and tool are taken: a humanoid's arm is a robot with seven joints.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from invariantqp.errors import RobotModelError, UnknownName
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import UNLIMITED
from invariantqp.robots.pinocchio import pin
from invariantqp.robots.tree import (
    NOT_SINGLE,
    UNPLACED,
    Mimic,
    TreeJoint,
    coupled_joints,
    default_tools,
    joint_notes,
    not_movable,
    other_tools,
    rest_positions,
    selected_joints,
)
from invariantqp.robots.urdf import excluded_pairs, infinite_if_large


def load_model(model: pin.Model, tool: str | None, joints: Sequence[str] | None) -> Chain:
    """The arm from the root of a `pinocchio.Model` to a frame, as in `load_robot`; the model does not change."""
    arrays.instance(model, pin.Model, "source", "a pinocchio.Model")
    name = f"the model {model.name!r}"
    tree, drivers = _tree(model), _drivers(model)
    paths = {frame.name: [tree[i] for i in _support(model, frame)] for frame in model.frames}
    tools = _default_tools(model, paths) if tool is None else [tool]
    tool = tools[0]
    index = _frame(model, tool)
    movable = {model.names[i]: i for i in _support(model, model.frames[index]) if i not in drivers}
    moving = [movable[joint] for joint in selected_joints(name, tool, list(movable), list(model.names)[1:], joints)]
    for i in moving:
        if model.nvs[i] != 1:
            raise not_movable(name, model.names[i], NOT_SINGLE.format(model.joints[i].shortname()))
    q = np.clip(pin.neutral(model), model.lowerPositionLimit, model.upperPositionLimit)
    for i in moving:
        q[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]] = pin.neutral(model)[model.idx_qs[i] :][: model.nqs[i]]
    names, path = [model.names[i] for i in moving], [tree[i] for i in _support(model, model.frames[index])]
    notes = (
        *other_tools(tools, paths),
        *joint_notes(list(tree.values()), paths, path, names, rest_positions(list(tree.values()))),
    )
    return _chain(model, q, index, moving, names, notes)[0]


def collision_model(robot: Chain) -> pin.GeometryModel:
    """The shapes of an arm's links as a `pinocchio.GeometryModel` for `robot.model`, for Pink's SelfCollisionBarrier.

    Pairs of neighbouring links, and those that the robot's description excludes, are left out.
    """
    from invariantqp.geometry.coal import shape_of  # coal and the search for capsules are loaded only here
    from invariantqp.robots.bodies import bodies_of

    bodies, known = bodies_of(robot), {link.name: link for link in robot.links}
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, np.zeros(robot.model.nq))
    made, exclusions = pin.GeometryModel(), excluded_pairs(robot)
    indices: dict[str, list[int]] = {}
    for name, shapes in bodies.items():
        link = known[name]
        for i, shape in enumerate(shapes if not link.unknown else ()):
            place = data.oMi[link.body].inverse() * pin.SE3(link.frame.dot(shape.placement))
            one = pin.GeometryObject(f"{name}_{i}", link.body, place, shape_of(shape))
            indices.setdefault(name, []).append(made.addGeometryObject(one))
    for one, other in combinations(indices, 2):
        if abs(known[one].body - known[other].body) > 1 and frozenset((one, other)) not in exclusions:
            for i in indices[one]:
                for j in indices[other]:
                    made.addCollisionPair(pin.CollisionPair(i, j))
    return made


def chain_to(model: pin.Model, frame: str) -> tuple[Chain, NDArray[np.intp]]:
    """The joints of a model that move a frame, as screws at the neutral configuration, and their tangent indices.

    A free flyer, a ball or a planar joint has one screw without limits for each degree of freedom.
    """
    index = _frame(model, frame)
    joints = [i for i in _support(model, model.frames[index]) if model.nvs[i] > 0]
    if not joints:
        raise RobotModelError(f"no joint moves the frame {frame!r}; choose one beyond the first joint")
    return _chain(model, pin.neutral(model), index, joints, ())


def _default_tools(model: pin.Model, paths: dict[str, list[TreeJoint]]) -> list[str]:
    """As `default_tools`; in a model without links, the frame at the end of the longest chain."""
    links = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    return default_tools({name: paths[name] for name in links}) if links else [max(paths, key=lambda k: len(paths[k]))]


def _tree(model: pin.Model) -> dict[int, TreeJoint]:
    """The joints of a model, without their poses."""
    links = [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
    drivers, child = _drivers(model), {frame.parentJoint: frame.name for frame in reversed(links)}
    tree = {}
    for i in range(1, model.njoints):
        at = model.getFrameId(model.names[i], pin.FrameType.JOINT)  # a model made by hand may have no such frame
        above = model.frames[model.frames[at].parentFrame if at < model.nframes else 0].name
        kind, mimic = "revolute" if model.nvs[i] <= 1 else "floating", None
        if i in drivers:
            joint = model.joints[i].extract()
            mimic = Mimic(model.names[drivers[i]], joint.scaling, joint.offset)
        limits = (-np.inf, np.inf) if mimic else _limits(model, i)
        tree[i] = TreeJoint(model.names[i], kind, above, child.get(i, ""), *UNPLACED, *limits, mimics=mimic)
    return tree


def _drivers(model: pin.Model) -> dict[int, int]:
    """The joint that drives each mimic joint, in a model built with mimic=True."""
    return dict(zip(getattr(model, "mimicking_joints", ()), getattr(model, "mimicked_joints", ()), strict=True))


def _chain(
    model: pin.Model,
    q: Array,
    index: int,
    joints: Sequence[int],
    names: Sequence[str],
    notes: tuple[str, ...] = (),
) -> tuple[Chain, NDArray[np.intp]]:
    """Joints of a model as screws from its configuration q to a frame, and their tangent indices."""
    data = model.createData()
    # (6, nv), the angular part first; Pinocchio leaves the second dimension out for one joint.
    J = pin.computeJointJacobians(model, data, q).reshape(6, -1).take(se3.SWAPPED, axis=0)
    home = pin.updateFramePlacement(model, data, index).homogeneous
    tangent = [np.arange(model.idx_vs[i], model.idx_vs[i] + model.nvs[i]) for i in joints]
    lower, upper = zip(*(_limits(model, i) for i in joints for _ in range(model.nvs[i])), strict=True)
    places = [data.oMi[i].translation for i in joints for _ in range(model.nvs[i])]
    moving = np.concatenate(tangent).astype(np.intp)
    speed = model.velocityLimit[moving]
    speed = np.where((speed > 0.0) & (speed < UNLIMITED), speed, np.inf)
    tool = model.frames[index].name
    columns = model.idx_vExtendeds if J.shape[1] > model.nv else model.idx_vs
    drivers = _drivers(model)
    to_frame = ((i, drivers.get(i, i)) for i in _support(model, model.frames[index]))
    # Each degree of freedom with its driver; the columns of mimic joints have their ratio already.
    driven = [((i, k), (of, k)) for i, of in to_frame if of in joints for k in range(model.nvs[of])]
    coordinates = [(i, k) for i in joints for k in range(model.nvs[i])]
    coupled = coupled_joints(J[:, [columns[i] + k for (i, k), _ in driven]], driven, coordinates)
    more: dict[str, Any] = {"coupled": coupled if len(driven) > len(moving) else None, "notes": notes}
    return Chain(coupled.columns(), home, names, lower, upper, speed, tool=tool, places=places, **more), moving


def _limits(model: pin.Model, joint: int) -> tuple[float, float]:
    """Position limits of a joint, infinite where it has none."""
    at = model.idx_qs[joint]
    low, high = model.lowerPositionLimit[at], model.upperPositionLimit[at]
    if not (model.nqs[joint] == model.nvs[joint] == 1 and low <= high):
        return -np.inf, np.inf
    return infinite_if_large(low), infinite_if_large(high)


def _frame(model: pin.Model, name: str) -> int:
    """The index of a frame; of two with the same name the link's."""
    indices = [i for i, frame in enumerate(model.frames) if frame.name == name]
    if not indices:
        known = [frame.name for frame in model.frames]
        raise UnknownName("frame", name, difflib.get_close_matches(name, known), known)
    return max(indices, key=lambda i: model.frames[i].type == pin.FrameType.BODY)


def _support(model: pin.Model, frame: Any) -> list[int]:
    """The joints from the base to the one that carries a frame."""
    return [i for i in model.supports[frame.parentJoint] if i > 0]
