"""A reading says its order, its sign and its frame, by name or by a word; free air tells all three."""

from array import array

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.plane import DT, PANDA, pen
from support.random_systems import motion
from support.wrist import wrist

import invariantqp as iq
from invariantqp.contacts import Contact, ContactKind
from invariantqp.force.wrench import wrench_of

M, F = [0.1, -0.2, 0.3], [4.0, 5.0, -6.0]


class Stamped:
    """What a ROS callback is given: geometry_msgs/WrenchStamped."""

    class wrench:  # noqa: N801
        class force:  # noqa: N801
            x, y, z = F

        class torque:  # noqa: N801
            x, y, z = M


NAMED = {
    "ours": iq.Wrench(moment=M, force=F),
    "Pinocchio's": pin.Force(np.array(F), np.array(M)),
    "ROS": Stamped(),
    "a mapping": {"force": dict(zip("xyz", F, strict=True)), "torque": dict(zip("xyz", M, strict=True))},
    "a mapping of vectors": {"wrench": {"force": F, "torque": M}},
}


@pytest.mark.parametrize("kind", NAMED)
@pytest.mark.parametrize("order", [None, "moment first", "force first"])
def test_named_parts_need_no_order(kind, order):
    np.testing.assert_array_equal(wrench_of(NAMED[kind], order, "wrench"), M + F)


def test_plain_numbers_need_an_order():
    np.testing.assert_array_equal(wrench_of(M + F, "moment first", "wrench"), M + F)
    np.testing.assert_array_equal(wrench_of(F + M, "force first", "wrench"), M + F)
    np.testing.assert_array_equal(wrench_of(array("d", F + M), "force first", "wrench"), M + F)  # a field of ROS 2
    spellings = r'order="moment first" or order="force first", or iq\.Wrench\(moment=\.\.\., force=\.\.\.\)'
    with pytest.raises(iq.BadInput, match=spellings):
        wrench_of(M + F, None, "wrench")


@pytest.mark.parametrize("reading", ["4", 4.0, None, {"force": F}, np.zeros(5), {"force": F, "torque": [1, 2]}])
def test_bad_wrenches_are_refused(reading):
    with pytest.raises(iq.BadInput, match=r"^wrench: found "):
        wrench_of(reading, "force first", "wrench")


def test_every_argument_with_plain_numbers_needs_the_order():
    panda = iq.load_robot("panda")
    loop = iq.HybridController(panda, pen(), dt=DT)
    with pytest.raises(iq.BadInput, match="without a declared order"):
        loop.step(PANDA, panda.pose(PANDA), np.zeros(6))
    assert loop.step(PANDA, panda.pose(PANDA), iq.Wrench(moment=[0, 0, 0], force=[0, 0, 0])).status == "lost"
    with pytest.raises(iq.BadInput, match="without a declared order"):
        pen().relabelled().__class__(pen().contact, np.arange(6.0))
    with pytest.raises(iq.BadInput, match="without a declared order"):
        wrist(order=None, bias=np.arange(6.0))
    with pytest.raises(iq.BadInput, match=r"^order: found 'force'"):
        wrist(order="force")
    with pytest.raises(iq.BadInput, match=r"^order: found 'force first' and a sensor"):
        iq.HybridController(panda, pen(), dt=DT, sensor=wrist(), order="force first")
    with pytest.raises(TypeError):
        iq.WrenchSensor(np.eye(4))


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**31), reads=st.sampled_from(["reaction", "action"]))
def test_both_orders_of_the_same_readings_are_the_same_wrench(seed, reads):
    rng = np.random.default_rng(seed)
    mount, tool, bias, reading = motion(rng, 0.2), motion(rng), rng.normal(size=6), rng.normal(size=6)
    options = {"mass": 0.7, "centre": [0.0, 0.01, 0.05], "reads": reads}
    one = wrist(mount, bias=bias, **options)
    other = wrist(mount, order="force first", bias=np.roll(bias, 3), **options)
    np.testing.assert_array_equal(one.wrench(reading, tool), other.wrench(np.roll(reading, 3), tool))
    np.testing.assert_array_equal(np.roll(one.tare(tool), 3), other.tare(tool))
    X, Y = motion(rng), motion(rng)
    moved = one.relabelled(X, Y), other.relabelled(X, Y)
    np.testing.assert_array_equal(moved[0].bias, moved[1].bias)


@pytest.mark.parametrize("order", ["moment first", "force first"])
@pytest.mark.parametrize("reads", ["reaction", "action"])
@pytest.mark.parametrize("turn", [0.0, 1.0])
def test_order_sign_weight_and_mount_are_found_in_free_air(order, reads, turn):
    rng = np.random.default_rng(3)
    mount = motion(rng, 0.2)
    true = wrist(mount, order=order, reads=reads, mass=0.7, centre=[0.01, 0.02, 0.05], bias=rng.normal(size=6))
    poses = [iq.exp([*rng.normal(scale=0.6, size=3), 0, 0, 0]) for _ in range(8)]
    readings = [true.tare(pose) + 0.02 * rng.normal(size=6) for pose in poses]
    reports = wrist(mount @ iq.exp([0.0, 0.0, turn, 0, 0, 0]), mass=0.7)
    check = reports.check(readings, poses)
    assert check.agrees == (order == "moment first" and reads == "reaction" and turn == 0.0)
    assert check.found.startswith((f"{order}, {reads}, 0.69", f"{order}, {reads}, 0.70"))
    assert ("its order is 'force first', not 'moment first'" in check.found) == (order == "force first")
    assert ("it reads the action, not the reaction" in check.found) == (reads == "action")
    assert ("turned by 57.3 deg" in check.found or "turned by 57" in check.found) == (turn > 0.0)
    if turn == 0.0:
        assert check.sensor.check(readings, poses).agrees
        np.testing.assert_allclose(check.sensor.centre, true.centre, atol=0.01)
        np.testing.assert_allclose(check.sensor.tare(poses[0]), true.tare(poses[0]), atol=0.1)
    else:
        assert check.sensor is None


@pytest.mark.parametrize(("noise", "agrees"), [(3e-4, True), (0.01, False)])
def test_moments_that_are_noise_alone_contradict_no_centre(noise, agrees):
    """A tool whose mass is where the sensor is; beside 0.02 N a moment of 0.01 N m is no noise."""
    rng, sensor = np.random.default_rng(0), wrist(mass=0.2)
    poses = [iq.exp([*rng.uniform(-1.0, 1.0, 3), 0, 0, 0]) for _ in range(6)]
    readings = [sensor.tare(pose) + np.repeat([noise, 0.02], 3) * rng.normal(size=6) for pose in poses]
    assert sensor.check(readings, poses).agrees == agrees


def test_uninformative_readings_in_free_air_are_reported():
    rng = np.random.default_rng(0)
    poses = [iq.exp([*rng.normal(scale=0.6, size=3), 0, 0, 0]) for _ in range(6)]
    nothing = wrist().check(0.02 * rng.normal(size=(6, 6)), poses)
    assert not nothing.agrees
    assert nothing.sensor is None
    assert "no weight explains the readings" in nothing.found
    with pytest.raises(iq.BadInput, match="turned almost alike"):
        wrist().check(np.ones((6, 6)), [np.eye(4)] * 6)
    for readings, argument in ((np.ones((2, 6)), "readings"), (np.full((6, 6), np.nan), "readings")):
        with pytest.raises(iq.BadInput, match=f"^{argument}: found"):
            wrist().check(readings, poses)
    with pytest.raises(iq.BadInput, match=r"^poses: found"):
        wrist().check(np.ones((6, 6)), poses[:5])


def free_hand(where):
    """Led in all directions: six constraints, no freedom."""
    return Contact(ContactKind("hand", np.zeros((6, 0))), iq.transform(translation=where))


@pytest.mark.parametrize(
    "contact", [lambda tool: free_hand(tool[:3, 3]), free_hand([0.4, 0.0, 0.3])], ids=["of q", "fixed"]
)
def test_six_parts_of_six_constraints_are_six_plain_numbers(contact):
    panda, push = iq.load_robot("panda"), iq.Wrench(moment=[0, 0, 0.1], force=[1, 0, 0])
    home, reading = panda.pose(PANDA), iq.Wrench(moment=[0, 0, 0], force=[0, 0, 0])
    x = []
    for wanted in ([0, 0, 0.1, 1, 0, 0], push):
        task = iq.HybridTask(contact, wanted, compliance=0.01, max_force=30.0)
        loop = iq.HybridController(panda, task, dt=DT)
        x.append([loop.step(PANDA, home, reading).velocity, loop.step(PANDA, home, reading, wanted=wanted).velocity])
    np.testing.assert_array_equal(x[0], x[1])
    assert np.abs(x[0]).max() > 1e-3
    iq.HybridTask(contact, [0] * 6, compliance=0.01)


def test_six_zeros_have_no_order():
    panda = iq.load_robot("panda")
    task = iq.HybridTask(pen().contact, np.zeros(6))
    loop = iq.HybridController(panda, task, dt=DT)
    home, reading = panda.pose(PANDA), iq.Wrench(moment=[0, 0, 0], force=[0, 0, 0])
    assert not loop.step(PANDA, home, reading, wanted=(0.0,) * 6).wanted.any()
    with pytest.raises(iq.BadInput, match="without a declared order"):
        loop.step(PANDA, home, reading, wanted=[0, 0, 0, 0, 0, 1.0])
