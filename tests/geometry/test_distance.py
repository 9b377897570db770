"""Distances against coal's and MuJoCo's, where they touch, where they are degenerate, and at both engines."""

from itertools import combinations_with_replacement

import numpy as np
import pytest
from support.repeats import repeats

from invariantqp.control.clearance_rows import rows_of
from invariantqp.engine import core
from invariantqp.geometry.distance import Placed, distance
from invariantqp.geometry.se3 import transform
from invariantqp.geometry.shapes import Box, Capsule, Core, HalfSpace, Shape, Sphere
from invariantqp.robots.chain import Chain

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


def by_core(a: Shape, b: Shape) -> float:
    """By the compiled kernel, a on a slide so that some joint moves it; of NumPy's definition without it."""
    slides = Chain(np.vstack((np.zeros((3, 3)), np.eye(3))), np.eye(4))
    table = np.array([np.concatenate(((body, s.core, s.radius), s.half, T[:3, :3].ravel(), T[:3, 3]))
                      for body, s in ((3, a), (0, b)) for T in [s.pose.dot(s.place)]])  # fmt: skip
    free = np.full(3, np.inf)
    pairs, limits = np.array([[0.0, 1.0, 1.0, 1.0]]), np.array((free, free, -free, free))
    settings = np.array([1.0, 1.0, 1.0, 0.0, 1.0, 1.0])
    shapes, still = (table, np.zeros((2, 6)), pairs), np.zeros(3)
    if core is None:
        return float(rows_of([slides], still, still, *shapes, limits, settings)[3][0])
    scene = core.scene(slides.screws, np.zeros(4), *shapes, np.full((2, 3), np.inf), np.zeros(1, bool))
    return float(core.clearance(scene, still, still, limits, settings, None, None)[3][0])


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_distances_are_those_of_coal_and_mujoco(one, other):
    rng = np.random.default_rng(4 * KINDS.index(one) + KINDS.index(other))
    apart = inside = 0
    for _ in range(repeats(1000, 80)):
        a, b = made(one, rng), made(other, rng)
        d = distance(placed(a), placed(b))
        assert by_core(a, b) == pytest.approx(d, abs=1e-14)
        assert distance(placed(b), placed(a)) == pytest.approx(d, abs=1e-14)
        reference = by_coal(a, b)
        if d > 0.0:
            apart += 1
            # coal's and MuJoCo's general solvers end at 1e-6 where boxes are involved.
            assert d == pytest.approx(reference, abs=2e-6)
            if "half-space" not in (one, other):
                assert d == pytest.approx(by_mujoco(a, b), abs=2e-6)
        else:
            inside += 1
            assert d == pytest.approx(reference, abs=2e-6)
    assert apart > 10
    assert inside > 3
