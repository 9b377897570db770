"""Clearance of arms with mimic joints: distances and rows are those of Pinocchio's bodies."""

import numpy as np
import pinocchio as pin
import pytest

import invariantqp as iq
from invariantqp.geometry.shapes import Core
from invariantqp.limits import Capsule, Clearance, OtherArm, Sphere

# link, what it stands on, place, kind and axis of its joint, and which one that mimics: driver, ratio, offset
PARALLELOGRAM = (
    ("turn", "base", "0 0 0", "revolute", "0 0 1", None),
    ("lift", "turn", "0 0 0.08", "revolute", "0 1 0", None),
    ("level", "lift", "0 0 0.135", "revolute", "0 1 0", ("lift", -1.0, 0.0)),
    ("reach", "level", "0 0 0", "revolute", "0 1 0", None),
    ("hand", "reach", "0.147 0 0", "revolute", "0 1 0", ("reach", -1.0, 0.0)),
    ("spin", "hand", "0.06 0 0", "revolute", "0 0 1", None),
)
# A rail, a telescope in two stages, an arm, and a gripper's finger whose joint is before its driver.
TELESCOPE = (
    ("rail", "base", "0 0 0", "prismatic", "0 1 0", None),
    ("inner", "rail", "0 0 0.1", "prismatic", "0 0 1", ("outer", 0.6, 0.02)),
    ("outer", "inner", "0 0 0.1", "prismatic", "0 0 1", None),
    ("yaw", "outer", "0 0 0.1", "revolute", "0 0 1", None),
    ("pitch", "yaw", "0.25 0 0", "revolute", "0 1 0", None),
    ("finger", "pitch", "0.2 0 0", "revolute", "0 1 0", ("pitch", 1.7, -0.3)),
    ("tip", "finger", "0.15 0 0", "revolute", "1 0 0", None),
)
Z = np.array([0.0, 0.0, 1.0])
FAR = Sphere([9.0, 0.0, 0.0], 0.1, name="far")
SCENES = {"parallelogram": PARALLELOGRAM, "telescope": TELESCOPE}


def text_of(rows):
    links = "".join(f'<link name="{name}"/>' for name in ("base", *(row[0] for row in rows)))
    joints = "".join(
        f'<joint name="{name}_joint" type="{kind}"><parent link="{above}"/><child link="{name}"/><origin xyz="{xyz}"/>'
        f'<axis xyz="{axis}"/><limit lower="-1.4" upper="1.4" effort="1" velocity="1.5"/>'
        + (
            f'<mimic joint="{mimic[0]}_joint" multiplier="{mimic[1]}" offset="{mimic[2]}"/></joint>'
            if mimic
            else "</joint>"
        )
        for name, above, xyz, kind, axis, mimic in rows
    )
    return f'<robot name="arm">{links}{joints}</robot>'


@pytest.fixture(params=SCENES)
def scene(request):
    """A robot, spheres about its links, and the least distance of two bodies by Pinocchio."""
    rows = SCENES[request.param]
    robot, model = iq.load_robot(text_of(rows)), pin.buildModelFromXML(text_of(rows))
    data, radius = model.createData(), 0.03
    bodies = {link.name: [Sphere((0.02, 0.01, 0.0), radius)] for link in robot.links}

    def centre(name, q):
        if name == "ball":
            return np.array((0.3, 0.1, 0.2))
        at = dict(zip(robot.names, q, strict=True))
        moved = [(mimic or (link, 1.0, 0.0)) for link, *_, mimic in rows]  # each joint by itself
        q = np.array([ratio * at[f"{driver}_joint"] + offset for driver, ratio, offset in moved])
        pin.framesForwardKinematics(model, data, q)
        return data.oMf[model.getFrameId(name, pin.FrameType.BODY)].act(np.array((0.02, 0.01, 0.0)))

    def distance(pair, q):
        return np.linalg.norm(centre(pair[0], q) - centre(pair[1], q)) - 2.0 * radius

    return robot, bodies, Sphere((0.3, 0.1, 0.2), radius, name="ball"), distance


def test_distances_and_rows_are_those_of_pinocchios_bodies(scene):
    robot, bodies, ball, distance = scene
    names = [*bodies, "ball"]
    pairs = [(one, other) for i, one in enumerate(names[:-1]) for other in names[i + 1 :]]
    limit = Clearance(robot, bodies, [ball], 0.01, pairs=pairs)
    rng, h, seen = np.random.default_rng(0), 1e-6, set()
    for _ in range(200):
        q, x = rng.uniform(-1.0, 1.0, (2, len(robot.names)))
        found = limit.distances(q)
        for pair, d in found.items():
            if d < np.inf:
                assert d == pytest.approx(distance(pair, q), abs=1e-12)
        rows = limit._engine.rows(q, np.zeros(len(q)), limit._at_rate(10.0))
        if rows is None:
            continue
        C, lower, _, of_pair, _ = rows
        for row, low, k in zip(C, lower, of_pair, strict=True):
            if k < 0 or found[limit._body_pairs[k]] < 0.01:
                continue
            pair = limit._body_pairs[k]
            slope = (distance(pair, q + h * x) - distance(pair, q - h * x)) / (2.0 * h)
            assert row @ x == pytest.approx(slope, abs=1e-7)
            assert low == pytest.approx(-10.0 * (distance(pair, q) - 0.01), abs=1e-9)
            seen.add(pair)
    assert len(seen) > len(names)


def arms_with_bodies():
    """Arms with mimic joints, and one with capsules, fixed and on a rail."""
    for rows in SCENES.values():
        robot = iq.load_robot(text_of(rows))
        yield robot, {link.name: [Sphere((0.02, 0.01, 0.0), 0.03)] for link in robot.links}
    yield from ((iq.load_robot("ur5", base=base), None) for base in (None, iq.robots.rail([0, 1, 0], -1.0, 1.0, 0.5)))


@pytest.mark.parametrize(("robot", "bodies"), list(arms_with_bodies()), ids=[*SCENES, "ur5", "ur5 on a rail"])
def test_levers_bound_the_speed_of_every_point_of_a_shape(robot, bodies):
    limit, rng, h, closest = Clearance(robot, bodies, [FAR]), np.random.default_rng(1), 1e-6, 0.0
    coordinates = np.array(robot.joints.coordinates)
    low, high = np.maximum(robot.position_lower, -np.pi), np.minimum(robot.position_upper, np.pi)
    for _ in range(100):
        q, x = rng.uniform(low, high), rng.normal(size=len(low)) * (rng.random(len(low)) < 0.3)
        before, after = (limit.shapes(q + step) for step in (-h * x, h * x))
        for lever, (_, body, one), (_, _, other) in zip(limit._engine.levers, before, after, strict=True):
            most = lever @ np.abs(x[coordinates]) if body else 0.0
            tip = one.half + one.radius  # a corner beyond the shape's round
            for end in [s * one.half for s in (Z, -Z)] if one.core is Core.SEGMENT else [tip]:
                moved = (other.pose - one.pose)[:3, :3] @ end + (other.pose - one.pose)[:3, 3]
                speed = np.linalg.norm(moved) / (2.0 * h)
                assert not body or speed < most + 1e-6
                closest = max(closest, speed / most if most > 0.0 else 0.0)
    assert closest > 0.5


@pytest.mark.parametrize("acceleration", [None, 8.0])
def test_an_arm_that_is_led_at_an_obstacle_stops_before_it(scene, acceleration):
    robot, bodies, ball, distance = scene
    q = np.full(len(robot.names), -0.2)
    tip = list(bodies)[-1]
    limit = Clearance(robot, {tip: bodies[tip]}, [ball], 0.02)
    loop, least = iq.Controller(robot, dt=0.01, limits=[limit], acceleration_limit=acceleration), np.inf
    for _ in range(400):
        q = q + 0.01 * loop.step(q, np.array((0.3, 0.1, 0.2))).velocity
        least = min(least, distance((tip, "ball"), q))
        assert limit.at(q).distance == pytest.approx(distance((tip, "ball"), q), abs=1e-12)
    assert 0.0199 < least < 0.03


def test_links_that_meet_at_a_mimic_joint_are_left_out():
    """The middle link of a parallelogram has no length: its neighbours meet, by three joints of which two are one's."""
    robot = iq.load_robot(text_of(PARALLELOGRAM))
    bodies = {
        "lift": [Capsule((0, 0, 0.03), (0, 0, 0.135), 0.02)],
        "reach": [Capsule((0, 0, 0), (0.147, 0, 0), 0.02)],
        "hand": [Capsule((0, 0, 0), (0.06, 0, 0), 0.02)],
    }
    limit = Clearance(robot, bodies, exclude=[("lift", "hand")])
    assert {(one.first, one.second): one.reason for one in limit.dropped} == {
        ("lift", "reach"): "always nearer than 20.0 mm",
        ("reach", "hand"): "neighbours at reach_joint",
        ("lift", "hand"): "excluded",
    }


def test_bodies_by_the_name_of_a_joint_and_of_the_tool():
    robot = iq.load_robot(text_of(TELESCOPE))
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    at = {name: [Sphere((0, 0, 0), 0.01)] for name in ("outer_joint", "tip_joint", "tool")}
    poses = {name: shape.pose for name, _, shape in Clearance(robot, at, pairs=[("tool", "outer_joint")]).shapes(q)}
    np.testing.assert_allclose(poses["outer_joint"], iq.transform(translation=[0, 0.1, 1.6 * 0.2]), atol=1e-14)
    np.testing.assert_allclose(poses["tool"], robot.pose(q), atol=1e-14)


def test_two_such_arms_are_as_far_apart_for_each(scene):
    robot, bodies, _, _ = scene
    beside = iq.load_robot(text_of(PARALLELOGRAM), base=iq.transform(translation=[0.3, 0.2, 0.1]))
    others = {link.name: [Sphere((0, 0, 0), 0.02)] for link in beside.links}
    q, p = np.linspace(-0.3, 0.4, len(robot.names)), np.array([0.3, -0.2, 0.4, 0.1])
    arms = OtherArm(robot, bodies, name="one"), OtherArm(beside, others, name="other")
    arms[0].move(q, np.zeros(len(q)))
    arms[1].move(p, np.zeros(len(p)))
    seen = Clearance(robot, bodies, [arms[1]]).distances(q), Clearance(beside, others, [arms[0]]).distances(p)
    there = {tuple(pair): d for pair, d in seen[1].items()}
    shared = 0
    for (own, other), d in seen[0].items():
        back = there.get((other.removeprefix("other/"), f"one/{own}"), np.inf)
        if other.startswith("other/") and np.isfinite([d, back]).all():
            assert d == pytest.approx(back, abs=1e-12)
            shared += 1
    assert shared > 10
