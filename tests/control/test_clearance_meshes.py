"""Meshes as obstacles: distances of boxes and of MuJoCo's hulls, loops that keep off them, what is refused."""

import copy
import pickle
import sys
from itertools import product
from unittest.mock import patch

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from support.loops import drive

import invariantqp as iq
from invariantqp.limits import Box, Capsule, Clearance, HalfSpace, Sphere

pytest.importorskip("coal")
from invariantqp.limits import Mesh

DT = 0.002
SIZE = np.array([0.24, 0.4, 0.3])
CORNERS = 0.5 * SIZE * np.array(list(product((-1.0, 1.0), repeat=3)))
START = np.array([1.2, -1.4, 1.6, -1.8, -1.57, 0.0])
GANTRY = iq.robots.Chain(np.vstack((np.zeros((3, 3)), np.eye(3))), np.eye(4), velocity_limit=1.0)


def surface(place, **options):
    return Mesh((CORNERS, ConvexHull(CORNERS).simplices), place, **options)


def test_a_mesh_of_a_box_is_as_far_as_the_box(ur5):
    """The closed forms of boxes are the reference; of a surface outside and up to the middle of a capsule."""
    place, rng = iq.transform(translation=[0.45, 0.0, 0.15]), np.random.default_rng(0)
    bodies = {**iq.robots.bodies_of(ur5), "tool": [Box(np.eye(4), [0.03, 0.1, 0.05])]}
    limits = [
        Clearance(ur5, bodies, [made], exclude=[("tool", "wrist_2_link"), ("tool", "wrist_1_link")])
        for made in (Box(place, SIZE, name="block"), Mesh(CORNERS, place, hull=True, name="block"),
                     surface(place, name="block"))
    ]  # fmt: skip
    thinnest = min(shape.radius for link in bodies.values() for shape in link if shape.radius)
    near = inside = 0
    for _ in range(120):
        q = rng.uniform(-2.5, 2.5, 6)
        box, hull, shell = (limit.distances(q) for limit in limits)
        assert box.keys() == hull.keys() == shell.keys()
        for pair, d in box.items():
            assert hull[pair] == pytest.approx(d, abs=2e-6)
            if d > (-thinnest if "tool" not in pair else 0.0):
                assert shell[pair] == pytest.approx(d, abs=2e-6)
            near += 0.0 < d < 0.05
            inside += d < 0.0
    assert near > 50
    assert inside > 25


def test_a_hull_is_as_far_as_mujoco_says():
    rng = np.random.default_rng(4)
    points = rng.normal(size=(12, 3)) * [0.1, 0.2, 0.15]
    vertices = " ".join(repr(float(x)) for x in points.ravel())
    limit = Clearance(GANTRY, {"tool": [Capsule([0, 0, -0.1], [0, 0, 0.1], 0.03)]}, [Mesh(points, hull=True)])
    text = (f'<mujoco><asset><mesh name="m" vertex="{vertices}"/></asset><worldbody><body>'
            '<geom type="mesh" mesh="m"/></body>'
            '<body name="b" mocap="true"><geom type="capsule" size=".03 .1"/></body></worldbody></mujoco>')  # fmt: skip
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    for _ in range(100):
        q = rng.uniform(-0.5, 0.5, 3)
        data.mocap_pos[0] = q
        mujoco.mj_kinematics(model, data)
        d = mujoco.mj_geomDistance(model, data, 0, 1, 10.0, np.empty(6))
        if d > 1e-3:  # MuJoCo's depths are of another kind
            assert limit.at(q).distance == pytest.approx(d, abs=2e-6)


@pytest.mark.parametrize(("acceleration", "hull"), [(None, True), (10.0, False)])
def test_an_arm_keeps_off_a_mesh_while_targets_jump(ur5, acceleration, hull):
    place, rng = iq.transform(translation=[0.45, 0.0, 0.15]), np.random.default_rng(6)
    block = Mesh(CORNERS, place, hull=True, name="block") if hull else surface(place, name="block")
    limit, truth = Clearance(ur5, None, [block]), Clearance(ur5, None, [Box(place, SIZE, name="block")])
    loop = iq.Controller(ur5, dt=DT, limits=[limit], acceleration_limit=acceleration)
    q, least, said = START, 9.0, ""
    for i in range(600):
        if i % 300 == 0:
            target = ur5.pose(rng.uniform(-2.0, 2.0, 6))
        solution = loop.step(q, target)
        q = q + DT * solution.velocity
        least = min(least, truth.at(q).distance)
        if i % 20 == 0:
            assert limit.nearest.distance == pytest.approx(limit.at(q - DT * solution.velocity).distance, abs=1e-9)
        said += solution.reason
    assert 0.0199 < least < 0.03
    assert "and block, 2" in said


def test_a_hand_goes_into_a_hollow_but_not_through_its_sides():
    """A channel of three plates: its surface is open, its hull is not."""
    plates = [(np.array([0.0, s * 0.1, 0.1]), (0.2, 0.0, 0.1)) for s in (-1, 1)] + [(np.zeros(3), (0.2, 0.1, 0.0))]
    points, faces = [], []
    for middle, (a, b, c) in plates:
        u, v = np.array([a, 0, 0]), np.array([0, b, c])
        faces += [[len(points) + k for k in three] for three in ((0, 1, 2), (0, 2, 3))]
        points += [middle - u - v, middle + u - v, middle + u + v, middle - u + v]
    ball = {"tool": [Sphere([0, 0, 0], 0.02)]}
    inside = np.array([0.0, 0.03, 0.12])
    assert Clearance(GANTRY, ball, [Mesh(points, hull=True)]).at(inside).distance < 0.0
    limit = Clearance(GANTRY, ball, [Mesh((points, faces), name="channel")])
    assert limit.at(inside).distance == pytest.approx(0.07 - 0.02, abs=1e-9)
    loop, q = iq.Controller(GANTRY, dt=DT, limits=[limit]), np.array([0.0, 0.05, 0.4])
    for target, ends in (([0, 0.05, 0.01], [0, 0.05, 0.04]), ([0, 0.3, 0.04], [0, 0.06, 0.04])):
        q, _ = drive(loop, q, iq.transform(translation=target), 600).end
        np.testing.assert_allclose(q, ends, atol=1e-4)


def test_rows_of_a_mesh_that_moves_are_those_of_the_box_that_it_is(ur5):
    block, box = Mesh(CORNERS, hull=True, name="block"), Box(np.eye(4), SIZE, name="block")
    here, found = np.array([0.3, -1.3, 1.9, -2.17, -1.57, 0.0]), []
    for shape in (block, box):
        limit = Clearance(ur5, None, [shape])
        shape.move(iq.transform(translation=[0.5, 0.0, 0.15]), [0, 0, 0, -0.3, 0, 0])
        rows = limit.rows_at(here, limit._at_rate(20.0))
        nearest = rows.names.index(f"clearance: {limit.nearest}")
        found.append((rows.C[nearest], rows.lower[nearest], limit.nearest.distance))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


def test_a_mesh_is_copied_and_pickled_and_says_what_it_is():
    mesh = Mesh(CORNERS, scale=0.5, hull=True, name="block")
    for other in (copy.deepcopy(mesh), pickle.loads(pickle.dumps(mesh))):
        assert repr(other) == repr(mesh) == "<block at [0. 0. 0.], [0.12 0.2  0.15] in size>"


def test_a_file_is_read_in_its_units(tmp_path):
    file = tmp_path / "plate.obj"
    file.write_text("v 0 0 0\nv 1000 0 0\nv 0 1000 0\nf 1 2 3\n")
    limit = Clearance(GANTRY, {"tool": [Sphere([0, 0, 0], 0.1)]}, [Mesh(file, scale=0.001)])
    assert limit.at([0.2, 0.2, 0.5]).distance == pytest.approx(0.4, abs=1e-9)
    assert limit.at([-0.3, 0.2, 0.4]).distance == pytest.approx(0.4, abs=1e-9)


def test_a_half_space_that_moves_is_kept_off_a_mesh():
    limit = Clearance(GANTRY, {"tool": [HalfSpace([0, 0, 0], [0, 0, 1])]}, [Mesh(CORNERS, hull=True)])
    assert limit.at([0.0, 0.0, -0.5]).distance == pytest.approx(0.35, abs=1e-12)


@pytest.mark.parametrize(("make", "said"), [
    (lambda: Mesh("nowhere.stl"), "source: found 'no mesh at nowhere.stl'|source: found no mesh at"),
    (lambda: Mesh(CORNERS), "source"),
    (lambda: Mesh((CORNERS, [[0, 1, 9]])), "triangles of corners that are not there"),
    (lambda: Mesh((CORNERS, [[0, 1, 0.5]])), "source"),
    (lambda: Mesh(CORNERS * [1, 1, 0], hull=True), "without a volume"),
    (lambda: Mesh(CORNERS, scale=-1.0, hull=True), "scale"),
    (lambda: Clearance(iq.load_robot("ur5"), {"tool": [Mesh(CORNERS, hull=True)]}), "Meshes are for obstacles"),
])  # fmt: skip
def test_what_is_no_mesh_is_refused_by_name(make, said):
    with pytest.raises(iq.BadInput, match=said):
        make()


def test_without_coal_a_mesh_is_refused_with_what_to_install():
    for name in ("invariantqp.geometry.coal", "coal"):
        assert name in sys.modules
    hidden = {name: module for name, module in sys.modules.items() if name != "invariantqp.geometry.coal"}
    with patch.dict(sys.modules, {**hidden, "coal": None}, clear=True):
        import invariantqp.limits

        vars(invariantqp.limits).pop("Mesh", None)
        with pytest.raises(iq.errors.MissingExtra, match=r"coal is not installed.*pin") as caught:
            invariantqp.limits.Mesh  # noqa: B018 (it is loaded when it is asked for)
    assert caught.value.extra == "pin"


def test_what_its_library_raises_comes_through(ur5):
    block = Mesh(CORNERS, iq.transform(translation=[0.5, 0, 0.2]), hull=True)
    limit = Clearance(ur5, None, [block])
    broken = patch.object(type(block.mesh), "distances", side_effect=RuntimeError("no mesh"))
    with broken, pytest.raises(RuntimeError, match="no mesh"):
        limit.at(START)
