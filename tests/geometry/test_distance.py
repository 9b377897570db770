"""Distances against coal's and MuJoCo's, where shapes touch and where they are degenerate; places and frames."""

from itertools import combinations_with_replacement

import numpy as np
import pytest
from support.repeats import repeats

from invariantqp.engine import law
from invariantqp.geometry.distance import Placed, places
from invariantqp.geometry.se3 import transform
from invariantqp.geometry.shapes import Box, Capsule, Core, HalfSpace, Shape, Sphere

coal = pytest.importorskip("coal")
mujoco = pytest.importorskip("mujoco")

KINDS = ("sphere", "capsule", "box", "half-space")
PAIRS = [pair for pair in combinations_with_replacement(KINDS, 2) if pair != ("half-space", "half-space")]


def rotation(rng):
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return R * np.linalg.det(R)


def made(kind, rng, spread=0.35):
    p, R = rng.uniform(-spread, spread, 3), rotation(rng)
    if kind == "sphere":
        return Sphere(p, rng.uniform(0.01, 0.2))
    if kind == "capsule":
        return Capsule(p, p + rng.uniform(0.01, 0.6) * R[:, 0], rng.uniform(0.01, 0.1))
    if kind == "box":
        return Box(transform(R, p), rng.uniform(0.02, 0.4, 3))
    return HalfSpace(p, R[:, 0])


def placed(shape: Shape) -> Placed:
    return Placed(shape.core, shape.radius, shape.half, shape.pose.dot(shape.place))


def by_coal(a: Shape, b: Shape) -> float:
    def of(shape):
        T = shape.pose.dot(shape.place)
        if shape.core is Core.SEGMENT:
            length = 2.0 * float(shape.half[2])
            made = coal.Capsule(shape.radius, length) if length > 0.0 else coal.Sphere(shape.radius)
        elif shape.core is Core.BOX:
            made = coal.Box(*(2.0 * shape.half))
        else:
            made = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
        return made, coal.Transform3s(np.ascontiguousarray(T[:3, :3]), T[:3, 3].copy())

    (one, at), (other, there) = of(a), of(b)
    return coal.distance(one, at, other, there, coal.DistanceRequest(), coal.DistanceResult())


def by_mujoco(a: Shape, b: Shape) -> float:
    geoms = ""
    for i, shape in enumerate((a, b)):
        T = shape.pose.dot(shape.place)
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(T[:3, :3]).ravel())
        kind, size = "box", shape.half
        if shape.core is Core.SEGMENT:
            round_ = shape.half[2] == 0.0
            kind, size = ("sphere", (shape.radius,)) if round_ else ("capsule", (shape.radius, shape.half[2]))
        at, turned, sizes = (" ".join(repr(float(x)) for x in numbers) for numbers in (T[:3, 3], quaternion, size))
        geoms += f'<geom name="{i}" type="{kind}" size="{sizes}" pos="{at}" quat="{turned}"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return mujoco.mj_geomDistance(model, data, 0, 1, 10.0, np.empty(6))


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_distances_are_those_of_coal_and_mujoco(one, other):
    rng = np.random.default_rng(4 * KINDS.index(one) + KINDS.index(other))
    apart = inside = 0
    for _ in range(repeats(1000, 80)):
        a, b = made(one, rng), made(other, rng)
        near = places(placed(a), placed(b))
        d = near[0].distance
        assert places(placed(b), placed(a))[0].distance == pytest.approx(d, abs=1e-14)
        assert [place.distance for place in near] == sorted(place.distance for place in near)
        reference = by_coal(a, b)
        # coal's and MuJoCo's general solvers end at 1e-6 where boxes are involved.
        assert d == pytest.approx(reference, abs=2e-6)
        apart, inside = apart + (d > 0.0), inside + (d <= 0.0)
        if d > 0.0 and "half-space" not in (one, other):
            assert d == pytest.approx(by_mujoco(a, b), abs=2e-6)
    assert apart > 10
    assert inside > 3


def core_distance(placed: Placed, x: np.ndarray) -> float:
    """How far a point is from a core, 0 inside."""
    y = placed.pose[:3, :3].T @ (x - placed.pose[:3, 3])
    if placed.core is Core.HALF_SPACE:
        return max(float(y[2]), 0.0)
    return float(np.linalg.norm(y - np.clip(y, -placed.half, placed.half)))


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_each_place_is_a_point_of_either_core_and_the_line_between_them(one, other):
    rng, apart = np.random.default_rng(40 + 4 * KINDS.index(one) + KINDS.index(other)), 0
    for _ in range(repeats(500, 40)):
        a, b = placed(made(one, rng)), placed(made(other, rng))
        for place in places(a, b):
            thick = a.radius + b.radius
            assert np.linalg.norm(place.normal) == pytest.approx(1.0, abs=1e-12)
            if place.distance + thick <= 1e-9:
                continue  # cores that meet: the least way out, which need not be between two points of them
            apart += 1
            assert core_distance(a, place.point) < 1e-12
            assert core_distance(b, place.point + (place.distance + thick) * place.normal) < 1e-12
    assert apart > 10


def test_a_frame_changes_no_distance_and_turns_normals_and_points():
    rng = np.random.default_rng(0)
    for one, other in PAIRS * 3:
        a, b = placed(made(one, rng)), placed(made(other, rng))
        X = transform(rotation(rng), rng.uniform(-2.0, 2.0, 3))
        moved = (p._replace(pose=X @ p.pose) for p in (a, b))
        near, seen = places(a, b)[0], places(*moved)[0]
        assert seen.distance == pytest.approx(near.distance, abs=1e-12)
        if near.distance > 1e-3:
            np.testing.assert_allclose(seen.normal, X[:3, :3] @ near.normal, atol=1e-9)


def test_shapes_without_a_size_have_numbers_and_half_spaces_no_distance():
    point, sheet = Sphere([0, 0, 0.3], 0.0), Box(np.eye(4), [0.2, 0.2, 0.0])
    assert places(placed(point), placed(sheet))[0].distance == pytest.approx(0.3, abs=1e-15)
    same = [point, sheet, Box(np.eye(4), [0, 0, 0]), Capsule([0, 0, 0], [0, 0, 0], 0.0)]
    for a in same:
        for b in same:
            for place in places(placed(a), placed(b)):
                assert np.isfinite((place.distance, *place.normal, *place.point)).all()
    floor = placed(HalfSpace([0, 0, 0], [0, 0, 1]))
    assert places(floor, floor) == []


@pytest.mark.parametrize(
    "wrong",
    [np.zeros(16), np.zeros(18), np.zeros((17, 1)), np.full(17, np.nan), np.full(17, 1j), np.zeros(0), None, "shape",
     np.r_[5.0, np.zeros(16)], np.r_[0.5, np.zeros(16)], np.r_[3.0, np.zeros(16)], np.r_[0.0, -1.0, np.zeros(15)]],
)  # fmt: skip
def test_what_is_no_shape_is_refused(wrong):
    good = placed(Sphere([0, 0, 0], 0.1)).numbers
    for two in ((wrong, good), (good, wrong)):
        with pytest.raises((ValueError, TypeError)):
            law.witnesses(*two)
