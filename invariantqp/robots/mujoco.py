"""Arms of MuJoCo models (MJCF), as chains of joint screws: the Jacobian of a body at the origin of the world.

A model is looked at with its moving joints at zero. Velocity limits are not part of such models.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from invariantqp.errors import RobotModelError, UnknownName
from invariantqp.extras import optional
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain, Geometry, Link
from invariantqp.robots.tree import cannot_move, excluding, selected

with optional("sim", "mujoco"):
    import mujoco

MODEL = "the MuJoCo model"
HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


def read_mjcf(source: Path | str) -> Any:
    """The `mujoco.MjModel` of an MJCF file, or of its text."""
    name = str(source) if isinstance(source, Path) else "the MJCF text"
    try:
        if isinstance(source, Path):
            return mujoco.MjModel.from_xml_path(name)
        return mujoco.MjModel.from_xml_string(source)
    except ValueError as error:
        raise RobotModelError(f"{name}: MuJoCo cannot make a model of it ({error})") from error


def load_mujoco(model: Any, tool: str | None, chosen: Sequence[str] | None) -> Chain:
    """The arm from the world of a `mujoco.MjModel`, its base, to a site or, where no site is called so, a body.

    The rest is as in `load_robot`; joints that are held and have no single coordinate are as the model has them.
    """
    bodies = [model.body(i).name or f"unnamed body {i}" for i in range(model.nbody)]
    sites = {model.site(i).name: int(model.site_bodyid[i]) for i in range(model.nsite) if model.site(i).name}
    carriers = {name: i for i, name in enumerate(bodies)} | sites
    paths = [_joints_to(model, body) for body in range(model.nbody)]
    if tool is None:
        tool = bodies[max(range(model.nbody), key=lambda body: len(paths[body]))]
    if tool not in carriers:
        raise UnknownName("frame", tool, difflib.get_close_matches(tool, carriers), list(carriers))
    body = carriers[tool]
    names = [model.joint(i).name or f"unnamed joint {i}" for i in range(model.njnt)]
    moving = selected(MODEL, tool, [names[i] for i in paths[body]], names, chosen)
    joints = [i for i in paths[body] if names[i] in moving]
    coupled = model.eq_obj1id[(model.eq_type == int(mujoco.mjtEq.mjEQ_JOINT)) & model.eq_active0.astype(bool)]
    for i in joints:
        if model.jnt_type[i] not in (HINGE, SLIDE):
            raise cannot_move(MODEL, names[i], "has no single coordinate; only hinges and slides are modelled")
        if i in coupled:
            raise cannot_move(MODEL, names[i], "is coupled to another and has no coordinate of its own")
    data = _posed(model, joints)
    place = data.site(tool) if tool in sites else data.body(body)
    lower, upper = _limits(model, joints)
    return Chain(
        _twists(model, data, body)[:, model.jnt_dofadr[joints]],
        se3.transform(place.xmat.reshape(3, 3), place.xpos),
        moving,
        lower,
        upper,
        tool=tool,
        places=data.xanchor[joints],
        links=_links(model, data, bodies, paths, joints, paths[body]),
    )


def chain_to(model: Any, frame: str | int, kind: str) -> tuple[Chain, NDArray[np.intp]]:
    """The joints of a `mujoco.MjModel` that move a frame, as screws from q = 0, and their tangent indices.

    The frame is the name or id of a "body", "geom" or "site". A free joint or a ball is as many screws as it has
    degrees of freedom, without limits. A MuJoCo model has no velocity limits.
    """
    data = _posed(model, range(model.njnt))
    place = getattr(data, kind)(frame)
    J = _twists(model, data, _body_of(model, frame, kind))
    moving = np.flatnonzero(J.any(axis=0))
    if not len(moving):
        raise RobotModelError(f"no joint moves the {kind} {frame!r}; choose one beyond the first joint")
    lower, upper = _limits(model, model.dof_jntid[moving])
    home = se3.transform(place.xmat.reshape(3, 3), place.xpos)
    return Chain(J[:, moving], home, position_lower=lower, position_upper=upper), moving


def _limits(model: Any, joints: Sequence[int]) -> tuple[Array, Array]:
    """Position limits (m,) of joints, infinite where there is none or a joint is no hinge or slide."""
    limited = np.isin(model.jnt_type[joints], (HINGE, SLIDE)) & (model.jnt_limited[joints] != 0)
    lower, upper = np.where(limited[:, None], model.jnt_range[joints], (-np.inf, np.inf)).T
    return lower, upper


def _links(
    model: Any, data: Any, names: list[str], paths: list[list[int]], joints: list[int], to_tool: list[int]
) -> tuple[Link, ...]:
    """All bodies, the arm's joints at zero; those behind joints off the way to the tool are `unknown`."""
    made = []
    for i, name in enumerate(names):
        body = sum(joint in joints for joint in paths[i])
        away = [joint for joint in paths[i] if joint not in to_tool]
        unknown = model.joint(away[0]).name or "a free joint" if away and body < len(joints) else ""
        frame = se3.transform(data.xmat[i].reshape(3, 3), data.xpos[i])
        geoms = range(model.body_geomadr[i], model.body_geomadr[i] + model.body_geomnum[i])
        parts = tuple(_part(model, g) for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g])
        made.append(Link(name, body, frame, parts, unknown))
    signatures = model.exclude_signature.tolist()
    pairs = {frozenset((names[pair >> 16], names[pair & 0xFFFF])): "by the MJCF: <exclude>" for pair in signatures}
    return excluding(made, pairs)


def _part(model: Any, geom: int) -> Geometry:
    """A geom that collides; an ellipsoid is taken as the box about it."""
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    rotation, size = np.empty(9), model.geom_size[geom].tolist()
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    pose = se3.transform(rotation.reshape(3, 3), model.geom_pos[geom])
    known = mujoco.mjtGeom
    if kind == known.mjGEOM_SPHERE:
        return Geometry("sphere", (size[0],), pose)
    if kind == known.mjGEOM_PLANE:
        return Geometry("plane", (), pose)
    if kind in (known.mjGEOM_CAPSULE, known.mjGEOM_CYLINDER):
        return Geometry("capsule" if kind == known.mjGEOM_CAPSULE else "cylinder", (size[0], 2.0 * size[1]), pose)
    if kind in (known.mjGEOM_BOX, known.mjGEOM_ELLIPSOID):
        return Geometry("box", tuple(2.0 * edge for edge in size), pose)
    if kind == known.mjGEOM_MESH:
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


def _posed(model: Any, moving: Sequence[int]) -> Any:
    """The model's data with the moving joints at zero and the others where they rest."""
    data = mujoco.MjData(model)
    for i in range(model.njnt):
        if model.jnt_type[i] in (HINGE, SLIDE):
            held = i not in moving and model.jnt_limited[i]
            data.qpos[model.jnt_qposadr[i]] = np.clip(0.0, *model.jnt_range[i]) if held else 0.0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)  # the Jacobian needs it
    return data


def _body_of(model: Any, frame: str | int, kind: str) -> int:
    """The body that carries a "body", "geom" or "site"."""
    found = getattr(model, kind)(frame)
    return int(found.id if kind == "body" else found.bodyid[0])


def _twists(model: Any, data: Any, body: int) -> Array:
    """(6, nv) twists of a body in the world, one for each degree of freedom."""
    linear, angular = np.zeros((2, 3, model.nv))
    mujoco.mj_jac(model, data, linear, angular, np.zeros(3), body)
    return np.vstack((angular, linear))
