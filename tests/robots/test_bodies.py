"""Shapes of links: they contain what they stand for, and descriptions say which may touch."""

import operator
from itertools import chain

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.geometry.shapes import Box, Capsule, HalfSpace
from invariantqp.robots.bodies import _read, _thinned, bodies_of, capsule, capsules
from invariantqp.robots.urdf import disabled

ARM = """<mujoco><compiler angle="radian"/><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
<body name="a" pos="0 0 .3"><joint name="j1" axis="0 0 1"/><geom type="capsule" size=".05" fromto="0 0 0 .3 0 0"/>
<body name="b" pos=".3 0 0"><joint name="j2" axis="0 1 0"/>
<geom type="cylinder" size=".04 .15" pos=".15 0 0" euler="0 1.5708 0"/>
<body name="c" pos=".3 0 0"><joint name="j3" axis="0 1 0"/><geom type="ellipsoid" size=".04 .15 .05" pos=".15 0 0"/>
<geom type="box" size=".4 .4 .4" contype="0" conaffinity="0"/></body></body></body></worldbody>
<contact><exclude body1="a" body2="c"/></contact></mujoco>"""


def off(shape, points):
    """How far points (n, 3) stick out of a capsule."""
    local = (points - shape.place[:3, 3]) @ shape.place[:3, :3]
    local[:, 2] -= np.clip(local[:, 2], -shape.half[2], shape.half[2])
    return np.linalg.norm(local, axis=1) - shape.radius


def test_a_capsule_contains_its_points_and_is_not_large():
    rng = np.random.default_rng(0)
    for size in (
        [0.1, 0.1, 0.5],
        [0.2, 0.2, 0.2],
        [0.3, 0.05, 0.05],
        [0.2, 0.2, 0.0],
        [0.0, 0.0, 0.1],
        [0.0, 0.0, 0.0],
    ):
        points = rng.uniform(-0.5, 0.5, (60, 3)) * size
        found = capsule(points)
        assert off(found, points).max() < 1e-12
        assert found.radius <= 0.51 * np.linalg.norm(size) + 1e-12


def test_several_capsules_contain_every_triangle():
    rng = np.random.default_rng(1)
    bars = [np.array([[x, y, z] for x in (0, 0.5) for y in (0, 0.05) for z in (0, 0.05)]),
            np.array([[x, y, z] for x in (0, 0.05) for y in (0, 0.5) for z in (0, 0.05)])]  # fmt: skip
    from scipy.spatial import ConvexHull

    corners = np.vstack(bars)
    faces = np.vstack([ConvexHull(bar).simplices + 8 * i for i, bar in enumerate(bars)])
    made = capsules(corners[faces])
    assert len(made) > 1
    weights = rng.dirichlet(np.ones(3), size=(len(faces), 50))
    points = np.einsum("fkc,fcx->fkx", weights, corners[faces]).reshape(-1, 3)
    assert np.min([off(one, points) for one in made], axis=0).max() < 1e-9


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_what_a_urdf_has_is_inside_its_bodies(name):
    pytest.importorskip("coal")
    from invariantqp.geometry.coal import triangles

    robot = iq.load_robot(name)
    bodies = bodies_of(robot)
    again = bodies_of(iq.load_robot(name))  # computed once
    assert all(map(operator.is_, chain(*again.values()), chain(*bodies.values())))
    checked = 0
    for link in robot.links:
        for part in link.parts:
            if part.kind == "mesh":
                corners, faces = triangles(part.mesh)
                read = _read(part.mesh).reshape(-1, 3)  # coal leaves out triangles without an area
                np.testing.assert_allclose(read.max(axis=0), corners.max(axis=0), atol=1e-7)
                np.testing.assert_allclose(read.min(axis=0), corners.min(axis=0), atol=1e-7)
                assert len(faces) <= len(read) // 3
                points = (corners * part.size) @ part.pose[:3, :3].T + part.pose[:3, 3]
                assert np.min([off(one, points) for one in bodies[link.name]], axis=0).max() < 1e-9
                checked += 1
    assert checked >= 7


def test_axes_are_chosen_by_few_corners_but_all_are_contained():
    """A bar of many small triangles with one thin spike, which no cell of the grid need show."""
    from scipy.spatial import ConvexHull

    rng = np.random.default_rng(2)
    points = rng.normal(size=(30000, 3))
    points *= np.array([0.3, 0.05, 0.05]) / np.linalg.norm(points, axis=1)[:, None]
    triangles = np.concatenate((points[ConvexHull(points).simplices], [[[0, 0, 0], [1e-4, 0, 0.06], [0, 1e-4, 0.06]]]))
    assert len(_thinned(triangles)) < 0.5 * len(triangles)
    made = capsules(triangles)
    assert np.min([off(one, triangles.reshape(-1, 3)) for one in made], axis=0).max() < 1e-12
    assert sum(np.pi * c.radius**2 * (2 * c.half[2] + 4 / 3 * c.radius) for c in made) < 0.008


def test_an_mjcf_gives_bodies_and_excludes():
    pytest.importorskip("mujoco")
    with pytest.warns(UserWarning, match="no velocity limit"):
        robot = iq.load_robot(ARM)
    bodies = bodies_of(robot)
    kinds = {name: type(shapes[0]) for name, shapes in bodies.items()}
    assert kinds == {"world": HalfSpace, "a": Capsule, "b": Capsule, "c": Box}
    np.testing.assert_allclose(bodies["c"][0].half, [0.04, 0.15, 0.05])
    limit = iq.limits.Clearance(robot)
    why = {(one, other): reason for one, other, reason in limit.dropped}
    assert why["a", "c"] == "by the MJCF: <exclude>"
    assert ("world", "a") in limit.pairs  # a floor is nobody's neighbour


def test_links_go_where_the_arm_goes_and_those_of_other_arms_are_not_known():
    arm = iq.load_robot("ur5")
    q = np.array([0.3, -1.3, 1.9, -2.17, -1.57, 0.4])
    link = next(link for link in arm.links if link.name == "tool0")
    np.testing.assert_allclose(arm.motions(q)[link.body] @ link.frame, arm.pose(q), atol=1e-12)
    X = iq.exp([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    moved = iq.robots.stand_on(X, arm)
    np.testing.assert_allclose(next(k for k in moved.links if k.name == "tool0").frame, X @ link.frame, atol=1e-12)
    talos = iq.load_robot("talos")
    unknown = {link.name for link in talos.links if link.unknown}
    assert "arm_right_4_link" in unknown
    assert "arm_left_4_link" not in unknown
    assert "gripper_left_fingertip_1_link" not in unknown


def test_geometry_that_cannot_be_read_is_told_when_it_is_asked_for(tmp_path):
    text = """<robot name="r"><link name="a"/><link name="b"><collision><geometry>{}</geometry></collision></link>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/><limit velocity="1"/>
</joint></robot>"""
    for geometry, said in (
        ("<cone/>", "expected a box"),
        ('<sphere radius="big"/>', "radius='big'"),
        ('<mesh filename="package://nowhere/a.stl"/>', "no mesh at"),
    ):
        robot = iq.load_robot(text.format(geometry))
        with pytest.raises(iq.errors.RobotModelError, match=said):
            bodies_of(robot)
    wrong = tmp_path / "a.srdf"
    wrong.write_text("<mujoco/>")
    with pytest.raises(iq.errors.RobotModelError, match="<robot> of an SRDF"):
        disabled(wrong)


def test_meshes_and_balls_of_an_mjcf():
    corners = np.array([(x, y, z) for x in (0.0, 0.3) for y in (-0.04, 0.04) for z in (-0.04, 0.04)])
    vertices = " ".join(map(str, corners.ravel()))
    found = bodies_of(
        iq.load_robot(
            f"""<mujoco><asset><mesh name="bar" vertex="{vertices}"/></asset><worldbody>
            <body name="a"><joint name="j1" axis="0 0 1"/><geom type="mesh" mesh="bar"/>
            <body name="b" pos=".3 0 0"><joint name="j2" axis="0 1 0"/><geom type="sphere" size=".05" pos=".1 0 0"/>
            </body></body></worldbody></mujoco>""",
            velocity_limit=1.0,
        )
    )
    (bar,), (ball,) = found["a"], found["b"]
    assert off(bar, corners).max() < 1e-6
    assert bar.radius < 0.06
    assert (ball.radius, ball.place[:3, 3].tolist()) == (0.05, [0.1, 0.0, 0.0])
