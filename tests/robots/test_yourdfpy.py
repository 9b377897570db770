"""Robots read by yourdfpy: by stand-ins with its attributes, and by the library itself where it is installed."""

from types import SimpleNamespace

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.robots.load import urdf_of
from invariantqp.robots.urdf import joints_of, read_xml


def stand_in(file):
    """What yourdfpy makes of a URDF, with its names."""
    joints = [
        SimpleNamespace(
            name=joint.name,
            type=joint.kind,
            parent=joint.parent,
            child=joint.child,
            origin=None if np.array_equal(joint.origin, np.eye(4)) else joint.origin,
            axis=2.0 * joint.axis,
            limit=SimpleNamespace(
                lower=joint.lower, upper=joint.upper, velocity=None if np.isinf(joint.speed) else joint.speed
            ),
            mimic=joint.mimics
            and SimpleNamespace(**dict(zip(("joint", "multiplier", "offset"), joint.mimics, strict=True))),
        )
        for joint in joints_of(*read_xml(file))
    ]
    return SimpleNamespace(robot=SimpleNamespace(joints=joints), link_map={})


def by_yourdfpy(file):
    yourdfpy = pytest.importorskip("yourdfpy")
    return yourdfpy.URDF.load(str(file), load_meshes=False, build_scene_graph=False)


@pytest.mark.parametrize("read", [stand_in, by_yourdfpy])
@pytest.mark.parametrize(("name", "tool"), [("panda", "panda_hand_tcp"), ("kinova", "j2s6s200_end_effector")])
def test_an_arm_is_the_one_of_the_file(read, name, tool):
    file = urdf_of(name)
    given, ours = iq.load_robot(read(file), tool=tool), iq.load_robot(file, tool=tool)
    q = np.random.default_rng(0).normal(size=len(ours.names))
    assert given.names == ours.names
    np.testing.assert_allclose(given.pose(q), ours.pose(q), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(given.jacobian(q), ours.jacobian(q), rtol=0.0, atol=1e-12)
    for limit in ("position_lower", "position_upper", "velocity_limit"):
        np.testing.assert_array_equal(getattr(given, limit), getattr(ours, limit))
