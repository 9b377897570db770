"""The pairs of bodies of a clearance: which are kept apart, which are left out and why, and what is refused."""

import pickle
import warnings
from copy import deepcopy

import numpy as np
import pytest
from support.clearances import DT, HAND, LINKS, READY, TABLE

import invariantqp as iq
from invariantqp.limits import Box, Capsule, Clearance, HalfSpace, OtherArm, Sphere

UP = iq.transform(translation=[0.0, 0.0, 0.1])


def test_a_pair_that_is_always_near_is_dropped_until_the_obstacle_moves(ur5):
    """An arm on a desk, its upper arm mounted 5 mm above it, goes as fast as without; so beside what stands there."""
    desk, post = HalfSpace([0, 0, 0], [0, 0, 1], name="desk"), Sphere([0.0, 0.0, 0.0], 0.03, name="post")
    other = OtherArm(iq.load_robot("ur5", base=iq.transform(translation=[0, 2.0, 0])), name="left")
    q, twist = np.array([1.2, -1.4, 1.6, -1.8, -1.57, 0.0]), np.array([0, 0, 0, 0.2, 0, 0])
    limit = Clearance(ur5, None, [desk, post, other], exclude=[("base_link", "desk")])
    post.move(iq.transform(translation=[0, 3.0, 0]))
    assert {d[:2] for d in limit.dropped if d.reason == "always nearer than 20.0 mm"} >= {
        ("shoulder_link", "desk"), ("upper_arm_link", "desk")
    }  # fmt: skip
    alone = iq.Controller(ur5, dt=DT)
    loop = iq.Controller(ur5, dt=DT, limits=[limit])
    for place, near in (([0.1, -0.02, 0.1], True), ([0, 3.0, 0.1], False), ([0.1, -0.02, 0.1], True)):
        post.move(iq.transform(translation=place))
        np.testing.assert_allclose(loop.follow(q, twist).velocity, alone.follow(q, twist).velocity, atol=1e-12)
        assert (("shoulder_link", "post") in {d[:2] for d in limit.dropped}) == near
        assert (("shoulder_link", "post") in limit.pairs) != near
    assert limit.at(q).distance > 0.02
    post.move(ur5.pose(q))
    assert limit.at(q).distance < 0.0
    assert ("shoulder_link", "post") in limit.pairs


def test_dropped_pairs_are_listed_with_a_reason(panda, ur5):
    limit = Clearance(panda, None, [TABLE], exclude=[("panda_hand", "table")])
    why = {(one, other): reason for one, other, reason in limit.dropped}
    assert why["panda_link0", "panda_link1"] == "by the SRDF: Adjacent"
    assert why["panda_link0", "table"] == "no joint moves it"
    assert why["panda_hand", "table"] == "excluded"
    assert ("panda_hand", "table") not in limit.pairs
    assert ("panda_link7", "table") in limit.pairs
    assert len(limit.pairs) + len(limit.dropped) == 12 * 11 // 2
    near = {"shoulder_link": [Sphere([0, 0, 0], 0.1)], "forearm_link": [Sphere([0, 0, -0.2], 0.05)],
            "upper_arm_link": [Sphere([0, 0, 0.1], 0.05)], "base_link": [Sphere([0, 0, 0.05], 0.1)]}  # fmt: skip
    free = {(one, other): reason for one, other, reason in Clearance(ur5, near).dropped}
    assert free["shoulder_link", "upper_arm_link"].startswith(("neighbours", "by the SRDF"))
    chosen = Clearance(panda, HAND, [TABLE], pairs=[("table", "panda_link5")])
    assert chosen.pairs == (("panda_link5", "table"),)


@pytest.mark.filterwarnings("ignore:clearance. nothing is kept apart")
def test_only_links_that_are_provably_always_near_are_dropped():
    """Two hinges through one point: a ball on the last link stays within reach of one at the base, or comes off it.

    So does a rod that begins 10 mm beside the axes and ends half a metre from them; its end takes no part in it.
    """
    wrist = iq.robots.Chain(
        np.column_stack([iq.revolute((0, 0, 1)), iq.revolute((0, 1, 0))]), np.eye(4), velocity_limit=1.0
    )
    rod, pin, ball = Capsule([0.012, 0, 0], [0.5, 0, 0], 0.002), Sphere([0, 0, 0], 0.005), Sphere([0, 0, 0], 0.05)
    near, off = Sphere([0.03, 0, 0], 0.01), Sphere([0.2, 0, 0], 0.01)
    for base, last, mm, always in ((ball, near, 20, 1), (ball, off, 20, 0), (pin, rod, 20, 1), (pin, rod, 4.9, 0)):
        for bodies in ({"base": [base], "joint2": [last]}, {"joint2": [last], "base": [base]}):
            dropped = Clearance(wrist, bodies, distance=1e-3 * mm).dropped
            assert [d.reason for d in dropped] == ["always nearer than 20.0 mm"] * always


@pytest.mark.parametrize(("make", "said"), [
    (lambda r: Clearance("panda"), "robot: found 'panda'"),
    (lambda r: Clearance(r, HAND, 3), "obstacles: found 3"),
    (lambda r: Clearance(r, HAND, [np.eye(4)]), "obstacles"),
    (lambda r: Clearance(r, HAND, distance=-0.1), "distance"),
    (lambda r: Clearance(r, {"panda_hand": [3]}), "bodies"),
    (lambda r: Clearance(r, 3), "bodies"),
    (lambda r: Clearance(r, HAND, exclude=["ab"]), "exclude"),
    (lambda r: Clearance(iq.load_robot("fr3")), "known without collision geometry"),
    (lambda r: Sphere([0, 0, 0], -0.1), "radius"),
    (lambda r: Capsule([0, 0, 0], [0, np.inf, 0], 0.1), "b"),
    (lambda r: Capsule([0, 0, -1e308], [0, 0, 1e308], 0.1), "b"),
    (lambda r: Box(np.eye(4), [0.1, -0.1, 0.1]), "size"),
    (lambda r: Box(2 * np.eye(4), [0.1, 0.1, 0.1]), "pose"),
    (lambda r: HalfSpace([0, 0, 0], [0, 0, 0]), "normal"),
    (lambda r: Sphere([0, 0, 0], 0.1, name=3), "name"),
    (lambda r: Sphere([0, 0, 0], 0.1).move(np.zeros((4, 4))), "pose"),
    (lambda r: Clearance(r, HAND, [TABLE]).rows(READY, np.zeros(7)), "rate"),
    (lambda r: iq.Controller(iq.load_robot("ur5"), dt=DT, limits=[Clearance(r, HAND, [TABLE])]), "of another robot"),
    (lambda r: iq.Controller(r.with_tool(UP), dt=DT, limits=[Clearance(r, HAND, [TABLE])]), "offset="),
    (lambda r: iq.solve_pose(r.with_tool(UP), UP, clearance=Clearance(r, HAND, [TABLE])), "clearance: .* of another"),
    (lambda r: iq.Controller(iq.load_robot("panda", base=UP), dt=DT, limits=[Clearance(r, HAND, [TABLE])]), "base="),
    (lambda r: Clearance(r, HAND, [TABLE, HalfSpace([0, 0, -1], [0, 0, 1], name="table")]), "a second body 'table'"),
    (lambda r: Clearance(r, HAND, [Sphere([0, 0, 1], 0.1, name="panda_hand")]), "a second body 'panda_hand'"),
    (lambda r: Clearance(r, HAND, [OtherArm(r, HAND), OtherArm(r, HAND)]), "a second body 'other'"),
])  # fmt: skip
def test_bad_arguments_of_a_clearance_are_refused_by_name(panda, make, said):
    with pytest.raises(iq.BadInput, match=said):
        make(panda)


def test_obstacles_in_millimetres_warn_and_parked_ones_do_not(panda):
    box = Box(iq.transform(translation=[500.0, 0.0, 200.0]), [200.0, 200.0, 400.0], name="box")
    table = HalfSpace([0.0, 0.0, -100.0], [0.0, 0.0, 1.0], name="table")
    with pytest.warns(
        UserWarning, match=r"away from box by 399\.\d.*, table by 10.* \[length\]. Are these millimetres"
    ):
        Clearance(panda, HAND, [box, table])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        floor = Box(iq.transform(translation=[0.0, 0.0, -0.5]), [200.0, 200.0, 1.0], name="floor")
        Clearance(panda, HAND, [Sphere([100.0, 0.0, 0.0], 0.1, name="parked"), floor])


def test_a_distance_that_drops_all_pairs_warns_once(ur5):
    bodies = {"forearm_link": LINKS["forearm_link"], "tool": [Sphere([0.0, 0.0, 0.0], 0.05)]}
    with pytest.warns(UserWarning, match="nothing is kept 20 apart from .*table, .*than 20000.0 mm; .* metres") as told:
        assert not Clearance(ur5, bodies, [TABLE], distance=20).pairs
    assert len(told) == 1
    foot = Sphere([0.0, 0.0, 0.0], 0.08, name="foot")
    with pytest.warns(UserWarning, match="apart from foot, being always nearer than 20.0 mm"):
        Clearance(ur5, {**bodies, "shoulder_link": LINKS["shoulder_link"]}, [TABLE, foot],
                  exclude=[(link, "foot") for link in bodies])  # fmt: skip


def test_a_clearance_without_pairs_warns(panda):
    hand, ball = {"panda_hand": [Sphere([0.0, 0.0, 0.0], 0.05)]}, Sphere([1.0, 0.0, 0.0], 0.1, name="ball")
    with pytest.warns(UserWarning, match=r"nothing is kept apart \(there are no two bodies\)"):
        Clearance(panda, hand)
    with pytest.warns(UserWarning, match="panda_hand and panda_link7.*Adjacent"):
        Clearance(panda, hand | {"panda_link7": [Sphere([0.0, 0.0, 0.0], 0.05)]})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not Clearance(panda, hand, [ball], exclude=[("panda_hand", "ball")]).pairs


def test_unknown_bodies_are_refused(panda):
    with pytest.raises(iq.errors.UnknownName, match="elbow"):
        Clearance(panda, {"elbow": [Sphere([0, 0, 0], 0.1)]})
    with pytest.raises(iq.errors.UnknownName, match="shelf"):
        Clearance(panda, HAND, [TABLE], exclude=[("panda_hand", "shelf")])


def test_attributes_of_a_clearance_do_not_change(panda):
    limit = Clearance(panda, HAND, [TABLE])
    for name, value in (("obstacles", []), ("distance", 0.05), ("robot", panda), ("bodies", HAND)):
        with pytest.raises(AttributeError, match=rf"{name} of a clearance does not change: .*limits="):
            setattr(limit, name, value)
    with pytest.raises(AttributeError, match="radius of a shape does not change: move"):
        HAND["panda_hand"][0].radius = 0.2
    for one in (limit, pickle.loads(pickle.dumps(limit)), deepcopy(limit)):
        with pytest.raises(TypeError, match="does not support item assignment"):
            one.bodies["tool"] = []
        assert one.at(READY) == limit.at(READY)
