"""Shapes of links: they contain what they stand for, and descriptions say which may touch."""

import copy
import operator
import pickle
from itertools import chain

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import invariantqp as iq
from invariantqp.geometry.coal import triangles as mesh_of
from invariantqp.geometry.shapes import Box, Capsule, HalfSpace, Sphere
from invariantqp.robots.bodies import (
    _decimated,
    _mesh_triangles,
    _triangles,
    bodies_of,
    enclosing_box,
    enclosing_capsule,
    enclosing_shapes,
)
from invariantqp.robots.urdf import excluded_pairs, srdf_exclusions

ARM = """<mujoco><compiler angle="radian"/><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
<body name="a" pos="0 0 .3"><joint name="j1" axis="0 0 1"/><geom type="capsule" size=".05" fromto="0 0 0 .3 0 0"/>
<body name="b" pos=".3 0 0"><joint name="j2" axis="0 1 0"/>
<geom type="cylinder" size=".04 .15" pos=".15 0 0" euler="0 1.5708 0"/>
<body name="c" pos=".3 0 0"><joint name="j3" axis="0 1 0"/><geom type="ellipsoid" size=".04 .15 .05" pos=".15 0 0"/>
<geom type="box" size=".4 .4 .4" contype="0" conaffinity="0"/></body></body></body></worldbody>
<contact><exclude body1="a" body2="c"/></contact></mujoco>"""


def off(shape, points):
    """How far points (n, 3) stick out of a capsule or a box."""
    local = (points - shape.placement[:3, 3]) @ shape.placement[:3, :3]
    return np.linalg.norm(local - np.clip(local, -shape.half, shape.half), axis=1) - shape.radius


def volume(shape):
    if isinstance(shape, Box):
        return 8.0 * shape.half.prod()
    return np.pi * shape.radius**2 * (2.0 * shape.half[2] + 4.0 / 3.0 * shape.radius)


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
        found = enclosing_capsule(points)
        assert off(found, points).max() < 1e-12
        assert found.radius <= 0.51 * np.linalg.norm(size) + 1e-12


def test_several_shapes_contain_every_triangle():
    rng = np.random.default_rng(1)
    bars = [np.array([[x, y, z] for x in (0, 0.5) for y in (0, 0.05) for z in (0, 0.05)]),
            np.array([[x, y, z] for x in (0, 0.05) for y in (0, 0.5) for z in (0, 0.05)])]  # fmt: skip
    corners = np.vstack(bars)
    faces = np.vstack([ConvexHull(bar).simplices + 8 * i for i, bar in enumerate(bars)])
    made = enclosing_shapes(corners[faces])
    assert len(made) > 1
    weights = rng.dirichlet(np.ones(3), size=(len(faces), 50))
    points = np.einsum("fkc,fcx->fkx", weights, corners[faces]).reshape(-1, 3)
    assert np.min([off(one, points) for one in made], axis=0).max() < 1e-9


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_bodies_contain_the_meshes_of_a_urdf(name):
    robot = iq.load_robot(name)
    bodies = bodies_of(robot)
    again = bodies_of(iq.load_robot(name))  # computed once
    assert all(map(operator.is_, chain(*again.values()), chain(*bodies.values())))
    checked = 0
    for link in robot.links:
        for part in link.parts:
            if part.kind == "mesh":
                corners, faces = mesh_of(part.mesh)
                read = _mesh_triangles(part.mesh).reshape(-1, 3)  # coal leaves out triangles without an area
                np.testing.assert_allclose(read.max(axis=0), corners.max(axis=0), atol=1e-7)
                np.testing.assert_allclose(read.min(axis=0), corners.min(axis=0), atol=1e-7)
                assert len(faces) <= len(read) // 3
                points = (corners * part.size) @ part.pose[:3, :3].T + part.pose[:3, 3]
                assert np.min([off(one, points) for one in bodies[link.name]], axis=0).max() < 1e-9
                checked += 1
    assert checked >= 7


def test_shapes_of_decimated_triangles_contain_all_of_them():
    """A bar of many small triangles with one thin spike, which no cell of the grid need show."""
    rng = np.random.default_rng(2)
    points = rng.normal(size=(30000, 3))
    points *= np.array([0.3, 0.05, 0.05]) / np.linalg.norm(points, axis=1)[:, None]
    triangles = np.concatenate((points[ConvexHull(points).simplices], [[[0, 0, 0], [1e-4, 0, 0.06], [0, 1e-4, 0.06]]]))
    assert len(_decimated(triangles)) < 0.5 * len(triangles)
    made = enclosing_shapes(triangles)
    assert np.min([off(one, triangles.reshape(-1, 3)) for one in made], axis=0).max() < 1e-12
    assert sum(map(volume, made)) < 0.008


@pytest.mark.parametrize("size", [(1.2, 0.75, 0.03), (0.3, 0.3, 0.002), (0.2, 0.1, 0.08), (0.5, 0.2, 0.0)])
def test_a_plate_becomes_a_box_however_it_is_turned(size):
    corners = np.array(np.meshgrid(*([-0.5, 0.5],) * 3)).reshape(3, -1).T
    faces = ConvexHull(corners).simplices
    rng = np.random.default_rng(0)
    for turn in [np.eye(3), *np.linalg.qr(rng.normal(size=(4, 3, 3)))[0]]:
        points = (corners * size) @ turn.T + [0.1, -0.2, 0.3]
        made = enclosing_shapes(points[faces])
        assert {type(one) for one in made} == {Box}
        assert np.min([off(one, points) for one in made], axis=0).max() < 1e-12
        assert sum(map(volume, made)) == pytest.approx(np.prod(size), rel=1e-9, abs=1e-12)


def test_a_box_lies_along_a_face_of_what_it_contains():
    """About a wedge, whose principal axes are along none of its faces."""
    wedge = np.array([(x, y, z) for y in (0.0, 0.1) for x, z in ((0.0, 0.0), (0.4, 0.0), (0.0, 0.1))])
    turn = iq.exp([0.3, -0.7, 0.4, 0.0, 0.0, 0.0])[:3, :3]
    made = enclosing_box(wedge @ turn.T, turn.T[:2])
    assert off(made, wedge @ turn.T).max() < 1e-12
    assert volume(made) == pytest.approx(0.4 * 0.1 * 0.1)


def test_shapes_have_less_than_three_times_the_volume_of_their_link():
    """By the volume of each link's convex hull, or of those of its parts."""
    ratios = []
    for name in ("panda", "ur5", "xarm7", "so101", "gen3"):
        robot = iq.load_robot(name)
        made = bodies_of(robot) if any(link.parts for link in robot.links) else {}
        for link in robot.links:
            meshes = [part for part in link.parts if part.kind == "mesh"]
            if len(meshes) == len(link.parts) > 0:
                hulls = [ConvexHull(_triangles(p).reshape(-1, 3) @ p.pose[:3, :3].T + p.pose[:3, 3]) for p in meshes]
                ratios.append(sum(map(volume, made[link.name])) / sum(hull.volume for hull in hulls))
    assert len(ratios) > 20
    assert max(ratios) < 3.0


def test_an_mjcf_gives_bodies_and_excludes():
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


def test_links_move_with_the_arm_and_those_of_other_arms_are_unknown():
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


def test_unreadable_geometry_is_an_error_only_when_shapes_are_needed(tmp_path):
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
        srdf_exclusions(wrong)


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
    bar, (ball,) = found["a"], found["b"]
    assert np.min([off(one, corners) for one in bar], axis=0).max() < 1e-6
    assert sum(map(volume, bar)) < 1.01 * 0.3 * 0.08 * 0.08
    assert (ball.radius, ball.placement[:3, 3].tolist()) == (0.05, [0.1, 0.0, 0.0])


# Another tool

PEN = [Capsule([0, 0, -0.2], [0, 0, 0], 0.01), Box(iq.transform(translation=[0, 0, -0.15]), [0.06, 0.04, 0.05])]
GRIPPER = ["panda_hand", "panda_leftfinger", "panda_rightfinger"]
TIP = iq.exp([0.3, 0.2, 0.1, 0.02, -0.03, 0.2])


def same_shape(one, other):
    np.testing.assert_allclose(one.placement, other.placement, atol=1e-15)
    np.testing.assert_allclose([*one.half, one.radius], [*other.half, other.radius], atol=1e-15)
    return type(one) is type(other)


def test_bodies_of_a_tool_are_a_link_and_stay_exact(panda):
    pen = panda.with_tool(TIP, [*PEN, Sphere([0, 0, 0], 0.012)], name="pen", without=GRIPPER)
    bodies, q = bodies_of(pen), np.linspace(-0.5, 0.5, 7)
    assert pen.tool == "pen"
    assert all(map(same_shape, bodies["pen"], [*PEN, Sphere([0, 0, 0], 0.012)]))
    assert set(bodies) == set(bodies_of(panda)) - set(GRIPPER) | {"pen"}
    np.testing.assert_allclose(pen.pose(q), panda.pose(q) @ TIP, atol=1e-15)
    moved = pen.with_tool(TIP)  # the bodies stay where they are
    assert all(map(same_shape, bodies_of(moved)["pen"], bodies["pen"]))
    np.testing.assert_array_equal(moved.links[-1].frame, pen.home)
    assert bodies_of(pen.with_tool(np.eye(4), without=["pen"]))  # and go
    assert "pen" not in bodies_of(pen.with_tool(np.eye(4), without=["pen"]))


def test_a_tool_may_have_one_shape_and_no_name(panda):
    named = panda.with_tool(TIP, Sphere([0, 0, 0], 0.1))
    assert named.tool == "panda_hand_tcp+offset"
    assert len(bodies_of(named)["panda_hand_tcp+offset"]) == 1
    bare = iq.load_robot("ur5e").with_tool(TIP, PEN, name="pen")  # known without geometry
    assert list(bodies_of(bare)) == ["pen"]


def test_a_tool_is_copied_pickled_and_compared(panda):
    pen = panda.with_tool(TIP, PEN, name="pen", without=GRIPPER)
    for again in (pickle.loads(pickle.dumps(pen)), copy.deepcopy(pen), copy.copy(pen)):
        assert again == pen
        assert hash(again) == hash(pen)
        assert all(map(same_shape, bodies_of(again)["pen"], PEN))
    assert pen != panda.with_tool(TIP, PEN[:1], name="pen", without=GRIPPER)
    assert pen != panda.with_tool(TIP, name="pen")
    assert pen != 3


def test_exclusions_do_not_hold_for_a_new_link_of_an_old_name(panda):
    """The SRDF lets the old hand touch the fifth link; a new one of the same name may not."""
    assert frozenset(("panda_hand", "panda_link5")) in excluded_pairs(panda)
    assert not any(
        "panda_hand" in pair for pair in excluded_pairs(panda.with_tool(TIP, PEN, name="panda_hand", without=GRIPPER))
    )


def test_a_tool_keeps_its_bodies_on_a_rail_and_in_a_relative_chain(panda):
    pen = panda.with_tool(TIP, PEN, name="pen", without=GRIPPER)
    for robot in (
        iq.robots.stand_on(iq.robots.rail([0, 1, 0]), pen),
        iq.robots.relative(pen, iq.robots.stand_on(iq.transform(translation=[1, 0, 0]), pen)),
    ):
        assert all(map(same_shape, bodies_of(robot)["pen"], PEN))
        pose, link = robot.pose(np.zeros(len(robot.names))), next(link for link in robot.links if link.name == "pen")
        np.testing.assert_allclose(link.frame, pose, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"bodies": [HalfSpace([0, 0, 0], [0, 0, 1])]}, "bodies: .*Sphere, Capsule or Box"),
        ({"bodies": [[0.1, 0.2]]}, "bodies: .*Sphere, Capsule or Box"),
        ({"bodies": PEN, "name": "panda_link7"}, "name: .*a name of its own"),
        ({"name": 3}, "name: "),
        ({"without": ["panda_link4"]}, "without: .*links that the last joint moves: .*panda_hand"),
        ({"without": "panda_hand"}, "without: .*a list of names"),
    ],
)
def test_an_invalid_tool_is_refused(panda, arguments, reason):
    with pytest.raises(iq.BadInput, match=reason):
        panda.with_tool(np.eye(4), **arguments)
