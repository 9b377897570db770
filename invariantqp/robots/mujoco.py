"""Arms of MuJoCo models (MJCF) as `Chain`s: joint screws are the Jacobian of a body with the moving joints at zero.

MuJoCo models have no velocity limits. This is the only file of the room that imports MuJoCo (extra `sim`).
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from invariantqp.errors import RobotModelError, UnknownName
from invariantqp.extras import optional
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain, Geometry, Link
from invariantqp.robots.description import files_that_include
from invariantqp.robots.tree import (
    SINGLE_AXIS_TYPES,
    UNPLACED,
    Mimic,
    TreeJoint,
    coupled_joints,
    default_tools,
    driver_of,
    joint_notes,
    limits_with_mimics,
    not_movable,
    other_tools,
    ratio_of,
    resolved_mimic,
    rest_positions,
    selected_joints,
    with_exclusions,
)

with optional("sim", "mujoco"):
    import mujoco

MODEL = "the MuJoCo model"
NO_POSITIONS: Mapping[int, float] = {}
HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


def read_mjcf(source: Path | str) -> Any:
    """The `mujoco.MjModel` of an MJCF file, or of its text."""
    name = str(source) if isinstance(source, Path) else "the MJCF text"
    try:
        if isinstance(source, Path):
            return mujoco.MjModel.from_xml_path(name)
        return mujoco.MjModel.from_xml_string(source)
    except ValueError as error:
        reason = " ".join(str(error).split())
        advice = f" If it is a part of another model: {files_that_include(name)}." if isinstance(source, Path) else ""
        raise RobotModelError(f"{name}: MuJoCo cannot make a model of it ({reason}).{advice}") from error


def load_mujoco(model: Any, tool: str | None, chosen: Sequence[str] | None) -> Chain:
    """The arm from the world of a `mujoco.MjModel` to a site or, where no site has that name, a body.

    Held joints without a single coordinate keep the model's reference position.
    """
    bodies = [model.body(i).name or f"unnamed body {i}" for i in range(model.nbody)]
    sites = {model.site(i).name: int(model.site_bodyid[i]) for i in range(model.nsite) if model.site(i).name}
    carriers = {name: i for i, name in enumerate(bodies)} | sites
    paths = [_joints_to(model, body) for body in range(model.nbody)]
    tree = _tree(model, bodies)
    by_name = {name: [tree[i] for i in path] for name, path in zip(bodies, paths, strict=True)}
    tools = default_tools(by_name) if tool is None else [tool]
    tool = tools[0]
    if tool not in carriers:
        raise UnknownName("frame", tool, difflib.get_close_matches(tool, carriers), list(carriers))
    body = carriers[tool]
    names = [joint.name for joint in tree]
    movable = [names[i] for i in paths[body] if tree[i].mimics is None]
    moving = selected_joints(MODEL, tool, movable, tree, chosen)
    driven = [i for i in paths[body] if driver_of(tree[i]) in moving]
    for i in driven:
        if tree[i].kind not in SINGLE_AXIS_TYPES:
            why = "has no single coordinate; only hinges and slides are modelled"
            raise not_movable(MODEL, names[i], why, [name for name in movable if name != names[i]])
    data = _data_at_rest(model, tree, moving)
    place = data.site(tool) if tool in sites else data.body(body)
    arm = [i for i in driven if tree[i].mimics is None]
    lower, upper, _ = zip(*(limits_with_mimics(tree[i], [tree[k] for k in driven], MODEL) for i in arm), strict=True)
    screws = _twists(model, data, body)[:, model.jnt_dofadr[driven]] * [ratio_of(tree[i]) for i in driven]
    coupled = coupled_joints(screws, [(names[i], driver_of(tree[i])) for i in driven], moving)
    return Chain(
        coupled.columns(),
        se3.transform(place.xmat.reshape(3, 3), place.xpos),
        moving,
        lower,
        upper,
        tool=tool,
        places=data.xanchor[arm],
        links=_links(model, data, bodies, paths, driven, paths[body]),
        coupled=coupled if len(driven) > len(arm) else None,
        notes=(
            *other_tools(tools, by_name),
            *joint_notes(tree, by_name, [tree[i] for i in paths[body]], moving, rest_positions(tree)),
        ),
    )


def _tree(model: Any, bodies: list[str]) -> list[TreeJoint]:
    """The joints of a model, without their poses."""
    kinds = {HINGE: "revolute", SLIDE: "prismatic"}
    made = []
    for i in range(model.njnt):
        name, body = model.joint(i).name or f"unnamed joint {i}", int(model.jnt_bodyid[i])
        lower, upper = (float(limit[0]) for limit in _limits(model, [i]))
        kind = kinds.get(int(model.jnt_type[i]), "floating")
        above = bodies[int(model.body_parentid[body])]
        made.append(TreeJoint(name, kind, above, bodies[body], *UNPLACED, lower, upper))
    active = (model.eq_type == int(mujoco.mjtEq.mjEQ_JOINT)) & model.eq_active0.astype(bool)
    for k in np.flatnonzero(active):  # y - y0 = a0 + a1 (x - x0) + ...
        one, driver = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        a, at = model.eq_data[k, :5], model.qpos0[model.jnt_qposadr[[one, max(driver, 0)]]]
        if driver < 0:
            continue
        if a[2:].any():
            raise not_movable(
                MODEL, made[one].name, f"is coupled to {made[driver].name!r} by a polynomial that is no line"
            )
        made[one] = made[one]._replace(mimics=Mimic(made[driver].name, float(a[1]), float(at[0] + a[0] - a[1] * at[1])))
    return [resolved_mimic(joint, made) for joint in made]


def chain_to(model: Any, frame: str | int, kind: str) -> tuple[Chain, NDArray[np.intp]]:
    """The joints of a `mujoco.MjModel` that move a frame, as screws at q = 0, and their tangent indices.

    The frame is the name or id of a "body", "geom" or "site". A free joint or a ball has one screw without limits for
    each degree of freedom.
    """
    data = _neutral(model)
    place = getattr(data, kind)(frame)
    J = _twists(model, data, _body_of(model, frame, kind))
    moving = np.flatnonzero(J.any(axis=0))
    if not len(moving):
        raise RobotModelError(f"no joint moves the {kind} {frame!r}; choose one beyond the first joint")
    lower, upper = _limits(model, model.dof_jntid[moving])
    home = se3.transform(place.xmat.reshape(3, 3), place.xpos)
    return Chain(J[:, moving], home, position_lower=lower, position_upper=upper), moving


def _limits(model: Any, joints: Sequence[int]) -> tuple[Array, Array]:
    """Position limits (m,) of joints, infinite where there is none or the joint is neither a hinge nor a slide."""
    limited = np.isin(model.jnt_type[joints], (HINGE, SLIDE)) & (model.jnt_limited[joints] != 0)
    lower, upper = np.where(limited[:, None], model.jnt_range[joints], (-np.inf, np.inf)).T
    return lower, upper


def _links(
    model: Any, data: Any, names: list[str], paths: list[list[int]], joints: list[int], to_tool: list[int]
) -> tuple[Link, ...]:
    """All bodies with the arm's joints at zero; those behind joints off the path to the tool are `unknown`."""
    made = []
    for i, name in enumerate(names):
        body = sum(joint in joints for joint in paths[i])
        away = [joint for joint in paths[i] if joint not in to_tool]
        unknown = model.joint(away[0]).name or "a free joint" if away and body < len(joints) else ""
        frame = se3.transform(data.xmat[i].reshape(3, 3), data.xpos[i])
        geoms = range(model.body_geomadr[i], model.body_geomadr[i] + model.body_geomnum[i])
        parts = tuple(
            _collision_geometry(model, g) for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]
        )
        made.append(Link(name, body, frame, parts, unknown))
    signatures = model.exclude_signature.tolist()
    pairs = {frozenset((names[pair >> 16], names[pair & 0xFFFF])): "by the MJCF: <exclude>" for pair in signatures}
    return with_exclusions(made, pairs)


def _collision_geometry(model: Any, geom: int) -> Geometry:
    """The collision geometry of a geom; an ellipsoid becomes its bounding box."""
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    rotation, size = np.empty(9), model.geom_size[geom].tolist()
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    pose = se3.transform(rotation.reshape(3, 3), model.geom_pos[geom])
    types = mujoco.mjtGeom
    if kind == types.mjGEOM_SPHERE:
        return Geometry("sphere", (size[0],), pose)
    if kind == types.mjGEOM_PLANE:
        return Geometry("plane", (), pose)
    if kind in (types.mjGEOM_CAPSULE, types.mjGEOM_CYLINDER):
        return Geometry("capsule" if kind == types.mjGEOM_CAPSULE else "cylinder", (size[0], 2.0 * size[1]), pose)
    if kind in (types.mjGEOM_BOX, types.mjGEOM_ELLIPSOID):
        return Geometry("box", tuple(2.0 * edge for edge in size), pose)
    if kind == types.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        return Geometry("mesh", (1.0, 1.0, 1.0), pose, np.array(model.mesh_vert[first : first + count], np.float64))
    return Geometry("unreadable", (), pose, f"a geom of type {kind.name}; give bodies= for its body")


def _joints_to(model: Any, body: int) -> list[int]:
    """The joints from the world to a body."""
    path: list[int] = []
    while body > 0:
        first = int(model.body_jntadr[body])
        path[:0] = range(first, first + int(model.body_jntnum[body]))
        body = int(model.body_parentid[body])
    return path


def _neutral(model: Any, at: Mapping[int, float] = NO_POSITIONS) -> Any:
    """The model's data with hinges and slides at given positions, by index, or at zero."""
    data = mujoco.MjData(model)
    for i in range(model.njnt):
        if model.jnt_type[i] in (HINGE, SLIDE):
            data.qpos[model.jnt_qposadr[i]] = at.get(i, 0.0)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)  # the Jacobian needs it
    return data


def _data_at_rest(model: Any, tree: Sequence[TreeJoint], moving: Sequence[str]) -> Any:
    """The model's data with the moving joints at zero, mimic joints accordingly, and the others at rest."""
    at, rests = {}, rest_positions(tree)
    for i, joint in enumerate(tree):
        if joint.mimics is not None and joint.mimics.driver in moving:
            at[i] = joint.mimics.offset
        elif joint.kind in SINGLE_AXIS_TYPES and joint.name not in moving:
            at[i] = rests[joint.name]
    return _neutral(model, at)


def _body_of(model: Any, frame: str | int, kind: str) -> int:
    """The body that carries a "body", "geom" or "site"."""
    carrier = getattr(model, kind)(frame)
    return int(carrier.id if kind == "body" else carrier.bodyid[0])


def _twists(model: Any, data: Any, body: int) -> Array:
    """(6, nv) twists of a body, in the world frame, one for each degree of freedom."""
    linear, angular = np.zeros((2, 3, model.nv))
    mujoco.mj_jac(model, data, linear, angular, np.zeros(3), body)
    return np.vstack((angular, linear))
