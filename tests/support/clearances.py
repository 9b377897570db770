"""Scenes of clearances, and distances by coal."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.geometry.shapes import Core
from invariantqp.limits import Box, Capsule, HalfSpace
from support.arms import ready

coal = pytest.importorskip("coal")

DT = 0.002

READY = ready("panda")

TABLE = HalfSpace([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], name="table")

HAND = {
    "panda_link5": [Capsule([0, 0, -0.31], [0, 0, -0.21], 0.06)],
    "panda_hand": [
        Capsule([0, -0.06, 0.03], [0, 0.06, 0.03], 0.04),
        Capsule([0, -0.04, 0.085], [0, 0.04, 0.085], 0.025),
    ],
}

LINKS = {  # about those of a UR5, for states in which tenths of a millimetre count
    "base_link": [Capsule([-2e-05, 0.00072, 0.00841], [0.00168, -0.0362, 0.00916], 0.07439)],
    "shoulder_link": [Capsule([-6e-05, 0.00416, -0.00231], [1e-05, 0.00332, 0.00017], 0.0888)],
    "upper_arm_link": [Capsule([-0.00032, -0.0053, 0.00066], [-0.00085, -0.00493, 0.42496], 0.08442)],
    "forearm_link": [Capsule([0.00011, 0.02345, -0.00012], [4e-05, 0.00276, 0.38925], 0.06624)],
    "wrist_1_link": [Capsule([-8e-05, 0.09023, -0.00808], [-0.00011, 0.09014, 0.0075], 0.05689)],
    "wrist_2_link": [Capsule([-8e-05, 0.01113, 0.08996], [-0.0003, -0.00952, 0.09115], 0.05592)],
    "wrist_3_link": [Capsule([4e-05, 0.06126, -0.00027], [-0.00012, 0.06158, 0.00319], 0.04005)],
    "ee_link": [Box(iq.transform(translation=[-0.01, 0.0, 0.0]), [0.01, 0.01, 0.01])],
}


def by_coal(clearance, q):
    """The least distance of the pairs whose distance some joint changes."""
    placed = [place for _, _, place in clearance.shapes(q)]
    made = [(of_coal(p), coal.Transform3s(np.ascontiguousarray(p.pose[:3, :3]), p.pose[:3, 3].copy())) for p in placed]
    known = clearance._distances(q)
    return min(
        coal.distance(*made[i], *made[j], coal.DistanceRequest(), coal.DistanceResult())
        for (i, j), d in zip(clearance._shape_pairs, known, strict=True)
        if np.isfinite(d)
    )


def of_coal(placed):
    if placed.core is Core.SEGMENT:
        length = 2.0 * float(placed.half[2])
        return coal.Capsule(placed.radius, length) if length > 0.0 else coal.Sphere(placed.radius)
    return coal.Box(*(2.0 * placed.half)) if placed.core is Core.BOX else coal.Halfspace(np.array([0.0, 0, 1]), 0.0)


def below(robot, q, depth):
    target = robot.pose(q)
    target[2, 3] -= depth
    return target
