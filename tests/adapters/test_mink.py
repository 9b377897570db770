"""Inside mink: our frame task under mink's solver and limits."""

import mink
import mujoco
import numpy as np
import pytest

import invariantqp as iq
from invariantqp.mink import InvariantFrameTask
from invariantqp.robots.mujoco import chain_to
from invariantqp.workbench.compare.arms import urdf

DT = 0.01
POINT = "point"  # the second site, and where it is on the tool
OFFSET = iq.exp([0.9, -1.4, 0.6, 0.2, -0.1, 0.15])


@pytest.fixture(scope="module")
def arms():
    """MuJoCo models of the arms, with a second site on the tool's link."""
    return {name: (iq.load_robot(name), with_second_site(iq.load_robot(name))) for name in ("ur5", "panda", "so101")}


def with_second_site(robot):
    spec = mujoco.MjSpec.from_string(urdf(robot))
    for name, frame in (("tool", np.eye(4)), (POINT, OFFSET)):
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, frame[:3, :3].ravel())
        spec.body("tool").add_site(name=name, pos=frame[:3, 3], quat=quat)
    return spec.compile()


def random_joints(rng, robot):
    return rng.uniform(np.maximum(robot.position_lower, -np.pi), np.minimum(robot.position_upper, np.pi))


def limits(robot, model):
    speeds = dict(zip(robot.names, robot.velocity_limit, strict=True))
    return [mink.ConfigurationLimit(model), mink.VelocityLimit(model, speeds)]


def solved(here, tasks, limits, damping=1e-12):
    return mink.solve_ik(here, tasks, DT, solver="daqp", damping=damping, limits=limits)


@pytest.mark.parametrize("name", ["ur5", "panda", "so101"])
@pytest.mark.parametrize(
    "arguments", [(1.0, 1.0), (10.0, 1.0, 0.7, 1.0), ([1.0, 2.0, 3.0], [0.1, 0.0, 0.2]), (1.0, 0.0)], ids=str
)
def test_with_both_costs_it_equals_minks_task(arms, name, arguments):
    rng = np.random.default_rng(0)
    robot, model = arms[name]
    theirs, ours = mink.FrameTask("tool", "site", *arguments), InvariantFrameTask("tool", "site", *arguments)
    for change in (
        lambda _: None,
        lambda task: task.set_position_cost(4.0),
        lambda task: task.set_orientation_cost([0.5]),
    ):
        here = mink.Configuration(model, random_joints(rng, robot))
        target = iq.exp(0.5 * rng.normal(size=6)) @ here.get_transform_frame_to_world("tool", "site").as_matrix()
        for task in (theirs, ours):
            change(task)
            task.set_target(mink.SE3.from_matrix(target))
        (H, c), (G, d) = (task.compute_qp_objective(here) for task in (theirs, ours))
        np.testing.assert_allclose(G, H, rtol=0.0, atol=1e-9 * np.linalg.eigvalsh(H)[-1])
        np.testing.assert_allclose(d, c, rtol=0.0, atol=1e-12 * np.abs(c).max())
        np.testing.assert_array_equal(ours.cost, theirs.cost)


@pytest.mark.cases(1)
@pytest.mark.parametrize("name", ["ur5", "panda", "so101"])
def test_a_moved_frame_does_not_change_joint_velocities_inside_minks_limits(arms, name):
    rng = np.random.default_rng(1)
    robot, model = arms[name]
    at = iq.inverse(OFFSET)[:3, 3]
    laws = {
        "ours": [InvariantFrameTask("tool", "site"), InvariantFrameTask(POINT, "site", point=at)],
        "mink": [mink.FrameTask(frame, "site", 1.0, 1.0) for frame in ("tool", POINT)],
    }
    changes, limited = {law: [] for law in laws}, 0
    for _ in range(40):
        here = mink.Configuration(model, random_joints(rng, robot))
        target = iq.exp(0.05 * rng.normal(size=6)) @ here.get_transform_frame_to_world("tool", "site").as_matrix()
        for law, tasks in laws.items():
            for task, goal in zip(tasks, (target, target @ OFFSET), strict=True):
                task.set_target(mink.SE3.from_matrix(goal))
            x, y = (solved(here, [task], limits(robot, model), damping=1e-9) for task in tasks)
            changes[law].append(np.linalg.norm(y - x) / np.linalg.norm(x))
        limited += bool((np.abs(x) >= (1.0 - 1e-9) * robot.velocity_limit).any())
    assert limited > 10
    assert max(changes["ours"]) < 1e-8
    assert np.median(changes["mink"]) > 0.02


def test_it_arrives_inside_minks_limits_as_minks_task_does(arms):
    robot, model = arms["ur5"]
    q, errors = np.array([0.0, -1.2, 1.5, -1.0, 1.0, 0.3]), {}
    for make in (mink.FrameTask, InvariantFrameTask):
        here, task = mink.Configuration(model, q), make("tool", "site", position_cost=1.0, orientation_cost=1.0)
        task.set_target(mink.SE3.from_matrix(robot.pose(q + 0.6)))
        errors[make] = []
        for _ in range(60):
            here.integrate_inplace(solved(here, [task], limits(robot, model)), DT)
            errors[make].append(np.linalg.norm(task.compute_error(here)))
    assert errors[InvariantFrameTask][-1] < 1e-9
    np.testing.assert_allclose(errors[InvariantFrameTask], errors[mink.FrameTask], rtol=1e-6, atol=1e-9)


def test_joints_with_a_reference_position_have_the_models_pose():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body pos="0 0 .3"><joint axis="0 0 1" ref="40" range="-90 90"/><geom size=".1"/>
        <body pos=".4 0 0"><joint axis="0 1 0" ref="-70" pos=".1 0 0"/><geom size=".1"/>
        <body pos=".1 0 0"><joint type="slide" axis="1 0 0" ref=".2"/><geom size=".1"/>
        <site name="a" pos=".2 0 0"/></body>
        </body></body></worldbody></mujoco>"""
    )
    chain, moving = chain_to(model, "a", "site")
    assert moving.tolist() == [0, 1, 2]
    np.testing.assert_allclose(chain.position_lower, [-np.pi / 2, -np.inf, -np.inf])
    q = np.array([0.4, -1.1, 0.15])
    there = mink.Configuration(model, q).get_transform_frame_to_world("a", "site").as_matrix()
    np.testing.assert_allclose(chain.pose(q), there, atol=1e-12)


def test_joints_that_do_not_move_the_frame_do_not_move_and_a_free_base_does():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><freejoint/><geom size=".1"/>
        <body pos="0 .3 0"><joint axis="0 0 1" ref="10"/><geom size=".1"/><site name="a" pos=".2 0 0"/></body>
        <body pos="0 -.3 0"><joint axis="0 1 0"/><geom size=".1"/><site name="b" pos=".2 0 0"/></body>
        </body></worldbody></mujoco>"""
    )
    here = mink.Configuration(model)
    task = InvariantFrameTask("b", "site")
    task.set_target(
        iq.transform(translation=[0.01, -0.02, 0.03]) @ here.get_transform_frame_to_world("b", "site").as_matrix()
    )
    H, c = task.compute_qp_objective(here)
    assert not H[6].any()
    assert not c[6]
    x = solved(here, [task], [])
    assert x[6] == pytest.approx(0.0, abs=1e-9)
    here.integrate_inplace(x, DT)
    assert np.linalg.norm(task.compute_error(here)) < 1e-3
    fixed = mujoco.MjModel.from_xml_string('<mujoco><worldbody><site name="a"/></worldbody></mujoco>')
    task = InvariantFrameTask("a", "site")
    task.set_target(np.eye(4))
    with pytest.raises(iq.errors.RobotModelError, match="no joint moves the site 'a'"):
        task.compute_qp_objective(mink.Configuration(fixed))


def test_invalid_arguments_are_named(arms):
    here = mink.Configuration(arms["ur5"][1])
    task = InvariantFrameTask("tool", "site", form=0.37)
    assert "'tool', 'site', pitch form h = 0.37" in repr(task)
    with pytest.raises(mink.TargetNotSet):
        task.compute_qp_objective(here)
    for wrong in (np.eye(3), np.full((4, 4), np.nan), None):
        with pytest.raises(iq.BadInput, match="target"):
            task.set_target(wrong)
    with pytest.raises(iq.BadInput, match="frame_name: found None"):
        InvariantFrameTask(None, "site")
    nowhere = InvariantFrameTask("nowhere", "site")
    nowhere.set_target(np.eye(4))
    with pytest.raises(mink.InvalidFrame):
        nowhere.compute_qp_objective(here)
    task.set_target(np.eye(4))
    here.data.qpos[0] = np.nan
    here.update()
    with pytest.raises(iq.BadInput, match="configuration: found NaN"):
        task.compute_qp_objective(here)
