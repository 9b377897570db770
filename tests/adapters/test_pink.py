"""Inside Pink: our frame task under Pink's solver and limits, and Pink's limits and barriers under our controller."""

import numpy as np
import pink
import pinocchio as pin
import pytest
from pink.barriers import PositionBarrier, SelfCollisionBarrier
from pink.limits import AccelerationLimit, ConfigurationLimit, VelocityLimit
from support.arms import ready

import invariantqp as iq
from invariantqp.pink import InvariantFrameTask
from invariantqp.robots.kinematics import ROBOT

DT = 0.01
STATES = 30


@pytest.fixture(scope="module")
def arms():
    return {name: iq.load_robot(name) for name in ("panda", "ur5", "so101")}


def configuration(robot, q, model=None):
    model = robot.model if model is None else model
    return pink.Configuration(model, model.createData(), np.asarray(q, dtype=float))


def with_second_frame(robot, rng):
    """The model with one more frame on the tool's link, 25 cm away and turned at random; and where it is."""
    model = robot.model.copy()
    index = model.getFrameId(robot.tool)
    tool = model.frames[index]
    away = rng.normal(size=3)
    offset = pin.SE3(pin.exp3(2.0 * rng.normal(size=3)), 0.25 * away / np.linalg.norm(away))
    model.addFrame(pin.Frame("moved", tool.parentJoint, index, tool.placement * offset, pin.FrameType.OP_FRAME))
    return model, offset


def near(rng, pose, size=0.05):
    return pin.exp6(size * rng.normal(size=6)) * pose


def random_joints(rng, robot):
    return rng.uniform(np.maximum(robot.position_lower, -np.pi), np.minimum(robot.position_upper, np.pi))


def solved(here, task, **options):
    return pink.solve_ik(here, [task] if isinstance(task, pink.Task) else task, DT, solver="daqp", **options)


@pytest.mark.cases(5)
@pytest.mark.parametrize("named", ["the tool's origin", "another point", "own"])
@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
def test_a_moved_frame_does_not_change_joint_velocities_inside_pinks_limits(arms, name, named):
    rng = np.random.default_rng(0)
    robot = arms[name]
    model, offset = with_second_frame(robot, rng)
    point = np.zeros(3) if named == "the tool's origin" else np.array([0.03, -0.1, 0.2])
    ours = [InvariantFrameTask(robot.tool, point=point), InvariantFrameTask("moved", point=offset.actInv(point))]
    if named == "own":
        ours = [InvariantFrameTask(frame, point="own") for frame in (robot.tool, "moved")]
    with_costs = [
        InvariantFrameTask(frame, 10.0, 1.0, 0.5, 0.8, point=at)
        for frame, at in ((robot.tool, point), ("moved", offset.actInv(point)))
    ]
    theirs = [pink.FrameTask(frame, 1.0, 1.0) for frame in (robot.tool, "moved")]
    changes, limited = {"ours": [], "costs": [], "pink": []}, 0
    for _ in range(STATES):
        here = configuration(robot, random_joints(rng, robot), model)
        target = near(rng, here.get_transform_frame_to_world(robot.tool))
        for law, tasks in (("ours", ours), ("costs", with_costs), ("pink", theirs)):
            tasks[0].set_target(target)
            tasks[1].set_target(target * offset)
            # With Pink's default 1e-12 DAQP fails on its frame task for seven joints; ours has the default.
            options = {"damping": 1e-6} if law == "pink" else {}
            x, y = (solved(here, task, **options) for task in tasks)
            changes[law].append(np.linalg.norm(y - x) / np.linalg.norm(x))
        limited += bool((np.abs(solved(here, ours[0])) >= (1.0 - 1e-9) * robot.velocity_limit).any())
    assert limited > STATES // 4
    assert max(changes["ours"]) < 1e-9
    assert max(changes["costs"]) < 1e-9
    assert np.median(changes["pink"]) > 0.02


class Definite:
    """A form of the user's own, in the world frame."""

    def matrix(self, inverse_root):
        return inverse_root.T @ np.diag([0.3, 0.1, 0.2, 1.0, 2.0, 3.0]) @ inverse_root

    def describe(self):
        return "mine"


FORMS = {
    "least squares": {},
    "damped": {"damping": 0.05},
    "pitch": {"form": 0.7},
    "pitch, not guarded": {"form": -0.4, "guard": False},
    "pitch, damped": {"form": -0.4, "damping": 0.02},
    "complement": {"form": iq.Complement([[0.1], [0.2], [1.0], [0.0], [0.3], [0.0]])},
    "definite": {"form": Definite()},
    "metric": {"form": iq.CarriedMetric([0.2, 0.1, 0.3, 1.0, 2.0, 1.0], iq.exp([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]))},
}


@pytest.mark.cases(8)
@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
@pytest.mark.parametrize("kind", FORMS)
def test_without_limits_it_equals_solve_velocity_on_the_derivative_of_the_error(arms, name, kind):
    if kind == "complement" and name != "so101":
        return  # it goes with five joints
    rng, robot, options = np.random.default_rng(1), arms[name], FORMS[kind]
    task = InvariantFrameTask(robot.tool, 2.0, gain=0.5, **options)
    length = iq.Controller(robot, dt=DT).measure.length
    for _ in range(40):
        here = configuration(robot, random_joints(rng, robot))
        pose = here.get_transform_frame_to_world(robot.tool)
        target = near(rng, pose, 3e-3)
        task.set_target(target)
        error = iq.log(target.homogeneous @ iq.inverse(pose.homogeneous))
        J = -pose.action[[3, 4, 5, 0, 1, 2]] @ task.compute_jacobian(here)
        wanted = iq.solve_velocity(
            J, 0.5 * error, **{"guard": True, **options}, point=pose.translation, length=length, backend="daqp"
        ).velocity
        H, c = task.compute_qp_objective(here)
        # Where a direction hardly moves the frame, the condition of H decides the digits.
        near_rounding = 1e-9 + 1e-14 * np.linalg.cond(H)
        np.testing.assert_allclose(H @ wanted, -c, rtol=0.0, atol=1e-9 * np.abs(c).max())
        moved = J @ (np.linalg.solve(H, -c) - wanted)
        np.testing.assert_allclose(moved, 0.0, atol=near_rounding * np.abs(error).max())


def test_a_planar_arm_follows_a_target_in_its_plane():
    model = pin.Model()
    joint = 0
    for i, length in enumerate((0.0, 0.4, 0.3)):
        joint = model.addJoint(joint, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([length, 0.0, 0.0])), f"j{i}")
    model.addFrame(pin.Frame("tip", joint, pin.SE3(np.eye(3), np.array([0.2, 0.0, 0.0])), pin.FrameType.OP_FRAME))
    here = pink.Configuration(model, model.createData(), np.array([0.3, 0.5, -0.7]))
    step = np.array([0.01, -0.02, 0.0])  # in the plane of the arm, which can follow it
    for form in (None, iq.CarriedMetric(np.ones(6), here.get_transform_frame_to_world("tip").homogeneous)):
        task = InvariantFrameTask("tip", form=form)
        target = here.get_transform_frame_to_world("tip").copy()
        target.translation += step
        task.set_target(target)
        x = solved(here, task, limits=[])
        moved = pin.SE3(here.data.oMf[model.getFrameId("tip")].rotation, np.zeros(3)).action @ here.get_frame_jacobian(
            "tip"
        )
        np.testing.assert_allclose(DT * moved @ x, [*step, 0.0, 0.0, 0.0], atol=1e-9)
    task = InvariantFrameTask("tip", form=0.4)
    task.set_target(target)
    with pytest.raises(iq.NoPseudoinverse, match="No h works for this system"):
        task.compute_qp_objective(here)
    task.damping = 0.1
    assert np.isfinite(solved(here, task, limits=[])).all()


def test_joints_that_do_not_move_the_frame_do_not_move():
    """A floating base with two continuous arms: nq is not nv, and one arm's task says nothing of the other."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    for side in (-1.0, 1.0):
        joint = base
        for i, kind in enumerate((pin.JointModelRUBZ(), pin.JointModelRY(), pin.JointModelRX())):
            place = pin.SE3(np.eye(3), np.array([0.1, 0.3 * side, 0.1 * i]))
            joint = model.addJoint(joint, kind, place, f"{side}{i}")
        tip = pin.SE3(np.eye(3), np.array([0.2, 0.0, 0.1]))
        model.addFrame(pin.Frame(f"tip{side:+.0f}", joint, tip, pin.FrameType.OP_FRAME))
    assert (model.nq, model.nv) == (15, 12)
    rng = np.random.default_rng(2)
    here = pink.Configuration(model, model.createData(), pin.integrate(model, pin.neutral(model), rng.normal(size=12)))
    task = InvariantFrameTask("tip+1")
    target = near(rng, here.get_transform_frame_to_world("tip+1"))
    task.set_target(target)
    H, c = task.compute_qp_objective(here)
    assert not H[6:9].any()
    assert not H[:, 6:9].any()
    assert not c[6:9].any()
    assert np.linalg.eigvalsh(H).min() > -1e-12
    x = solved(here, task, limits=[])
    np.testing.assert_allclose(x[6:9], 0.0, atol=1e-9)
    reached = here.integrate(x, DT)
    error = pin.log6(
        pink.Configuration(model, model.createData(), reached).get_transform_frame_to_world("tip+1").actInv(target)
    )
    before = pin.log6(here.get_transform_frame_to_world("tip+1").actInv(target))
    assert np.linalg.norm(error.vector) < 0.1 * np.linalg.norm(before.vector)


@pytest.mark.parametrize("kind", [pin.JointModelSpherical(), pin.JointModelTranslation()], ids=["ball", "gantry"])
def test_joints_without_an_own_length_follow_a_target(kind):
    """All axes meet in one point, or none turns."""
    model = pin.Model()
    joint = model.addJoint(0, kind, pin.SE3.Identity(), "it")
    model.addFrame(pin.Frame("tip", joint, pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3])), pin.FrameType.OP_FRAME))
    here = pink.Configuration(model, model.createData(), pin.neutral(model))
    wanted = np.array([0.02, -0.01, 0.03])
    place = pin.SE3(pin.exp3(wanted), np.zeros(3)) if model.nq == 4 else pin.SE3(np.eye(3), wanted)
    task = InvariantFrameTask("tip")
    task.set_target(place * here.get_transform_frame_to_world("tip"))
    np.testing.assert_allclose(DT * solved(here, task, limits=[]), wanted, atol=1e-6)


def test_a_posture_task_moves_the_null_space_alone(arms):
    rng = np.random.default_rng(3)
    robot = arms["panda"]
    posture = pink.PostureTask(cost=1e-3, gain=0.1)
    task = InvariantFrameTask(robot.tool)
    for _ in range(20):
        q = random_joints(rng, robot)
        here = configuration(robot, q)
        posture.set_target(0.5 * (robot.position_lower + robot.position_upper))
        task.set_target(near(rng, here.get_transform_frame_to_world(robot.tool), 1e-3))
        J = here.get_frame_jacobian(robot.tool)
        if np.linalg.cond(J) > 20.0:
            continue
        alone, both = (solved(here, tasks, limits=[]) for tasks in ([task], [task, posture]))
        null = np.eye(7) - np.linalg.pinv(J) @ J
        wanted = alone + null @ (-posture.gain * posture.compute_error(here) / DT - alone)
        np.testing.assert_allclose(both, wanted, atol=2e-3 * np.linalg.norm(wanted))


def test_lm_damping_keeps_an_arm_still_at_a_target_out_of_reach(arms):
    robot = arms["ur5"]
    speeds = {}
    for label, task in (
        ("damped", InvariantFrameTask(robot.tool, lm_damping=1.0)),
        ("undamped", InvariantFrameTask(robot.tool)),
    ):
        here = configuration(robot, [0.0, -1.2, 1.5, -1.0, 1.0, 0.3])
        start = here.get_transform_frame_to_world(robot.tool)
        task.set_target(pin.SE3(pin.exp3(np.array([0.5, 1.0, -0.4])), np.array([3.0, 0.9, 0.6])) * start)
        for _ in range(300):
            here.update(here.q + DT * solved(here, task, damping=1e-9, safety_break=False))
        speeds[label] = np.abs(solved(here, task, damping=1e-9, safety_break=False)).max()
    assert speeds["damped"] < 1e-3
    assert speeds["undamped"] > 1.0


@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
@pytest.mark.parametrize(
    "arguments",
    [(1.0, 1.0), (10.0, 1.0, 1.0), (1.0, 0.3, 0.5, 0.7), ([1.0, 2.0, 3.0], [0.1, 0.0, 0.2]), (1.0, 0.0), (0.0, 2.0)],
    ids=str,
)
def test_with_both_costs_it_equals_pinks_task(arms, name, arguments):
    rng = np.random.default_rng(6)
    robot = arms[name]
    theirs, ours = pink.FrameTask(robot.tool, *arguments), InvariantFrameTask(robot.tool, *arguments)
    for change in (
        lambda _: None,
        lambda task: task.set_position_cost(4.0),
        lambda task: task.set_orientation_cost(0.5),
    ):
        here = configuration(robot, random_joints(rng, robot))
        target = near(rng, here.get_transform_frame_to_world(robot.tool), 0.5)
        for task in (theirs, ours):
            change(task)
            task.set_target(target)
        (H, c), (G, d) = (task.compute_qp_objective(here) for task in (theirs, ours))
        size = np.linalg.eigvalsh(H)[-1]
        np.testing.assert_allclose(G, H, rtol=0.0, atol=1e-9 * size)  # our least cost of what moves nothing is 3e-10
        np.testing.assert_allclose(d, c, rtol=0.0, atol=1e-12 * np.abs(c).max())
        np.testing.assert_array_equal(ours.cost, theirs.cost)
        np.testing.assert_array_equal(ours.position_cost, theirs.position_cost)


def test_the_loop_of_pinks_example_with_a_ur5_is_the_same():
    """A target that jumps 30 cm away and then moves; posture task, velocity limits active."""
    robot, errors, limited = iq.load_robot("ur5", tool="ee_link"), {}, 0
    for make in (pink.FrameTask, InvariantFrameTask):
        task, posture = make("ee_link", position_cost=1.0, orientation_cost=1.0, lm_damping=1.0), pink.PostureTask(1e-3)
        here = configuration(robot, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        task.set_target_from_configuration(here)
        posture.set_target_from_configuration(here)
        errors[make] = []
        for k in range(200):
            task.transform_target_to_world.translation[1:] = 0.5 + 0.1 * np.sin(0.01 * k), 0.2
            x = pink.solve_ik(here, [task, posture], 0.005, solver="quadprog")
            limited += bool((np.abs(x) >= 0.999 * robot.velocity_limit).any())
            here.integrate_inplace(x, 0.005)
            errors[make].append(np.linalg.norm(task.compute_error(here)))
    assert limited > 100
    assert errors[pink.FrameTask][-1] < 1e-4
    np.testing.assert_allclose(errors[InvariantFrameTask], errors[pink.FrameTask], rtol=1e-3, atol=1e-7)


def test_daqp_solves_it_near_a_singularity_with_pinks_default_damping(arms):
    robot = arms["ur5"]
    task = InvariantFrameTask(robot.tool, 1.0, 1.0)
    for bend in (0.0, 1e-7, 1e-6, 1e-5):
        here = configuration(robot, [0.4, -1.2, 1.5, -0.3, bend, 0.3])
        task.set_target(near(np.random.default_rng(8), here.get_transform_frame_to_world(robot.tool), 0.3))
        assert (np.abs(solved(here, task)) <= robot.velocity_limit * (1.0 + 1e-6)).all()


def test_the_default_orientation_cost_is_the_reach_times_the_position_cost(arms):
    robot = arms["ur5"]
    here = configuration(robot, [0.0, -1.2, 1.5, -1.0, 1.0, 0.3])
    task = InvariantFrameTask(robot.tool, 2.0)
    task.set_target_from_configuration(here)
    assert np.isnan(task.orientation_cost).all()
    task.compute_qp_objective(here)
    reach = iq.Controller(robot, dt=DT).measure.length
    np.testing.assert_allclose(task.orientation_cost, 2.0 * reach)
    task.set_position_cost(3.0)
    task.compute_qp_objective(here)
    np.testing.assert_allclose(task.orientation_cost, 3.0 * reach)
    task.set_orientation_cost(0.25)
    task.set_position_cost(1.0)
    task.compute_qp_objective(here)
    np.testing.assert_array_equal(task.cost, [1.0, 1.0, 1.0, 0.25, 0.25, 0.25])
    task.set_orientation_cost(None)
    task.compute_qp_objective(here)
    np.testing.assert_allclose(task.orientation_cost, reach)
    for off in (task.set_position_cost, task.set_orientation_cost):
        off(0.0)
    H, c = task.compute_qp_objective(here)
    assert not H.any()
    assert not c.any()


def test_changed_attributes_take_effect_in_the_next_step(arms):
    robot = arms["so101"]
    here = configuration(robot, [0.1, -0.5, 0.8, 0.3, 0.2])
    target = near(np.random.default_rng(8), here.get_transform_frame_to_world(robot.tool))
    task = InvariantFrameTask(robot.tool)
    changes = ("damping", 0.3), ("form", iq.PitchForm(0.4)), ("damping", 0.0), ("point", np.array([0.0, 0.1, 0.2]))
    changes += ("length", 0.3), ("guard", None), ("gain", 0.5)
    for name, value in changes:
        task.set_target(target)
        before, pull = task.compute_qp_objective(here)
        setattr(task, name, value)
        options = {"damping": task.damping, "point": task.point, "length": task.length, "gain": task.gain}
        fresh = InvariantFrameTask(robot.tool, form=task.form, guard=task.guard or False, **options)
        fresh.set_target(target)
        (H, c), (G, d) = (one.compute_qp_objective(here) for one in (task, fresh))
        np.testing.assert_array_equal(H, G)
        np.testing.assert_array_equal(c, d)
        assert max(np.abs(H - before).max(), np.abs(c - pull).max()) > 1e-6


def test_the_objective_grows_with_the_cost_squared(arms):
    """H and c grow with the cost squared; a radian costs L metres."""
    robot = arms["ur5"]
    here = configuration(robot, [0.0, -1.2, 1.5, -1.0, 1.0, 0.3])
    one, three = InvariantFrameTask(robot.tool), InvariantFrameTask(robot.tool, 3.0)
    for task in (one, three):
        task.set_target(near(np.random.default_rng(4), here.get_transform_frame_to_world(robot.tool)))
    (H, c), (H3, c3) = (task.compute_qp_objective(here) for task in (one, three))
    np.testing.assert_allclose(H3, 9.0 * H, rtol=1e-12)
    np.testing.assert_allclose(c3, 9.0 * c, rtol=1e-12)
    theirs = pink.FrameTask(robot.tool, 1.0, iq.Controller(robot, dt=DT).measure.length)
    theirs.set_target_from_configuration(here)
    weight, _ = theirs.compute_qp_objective(here)
    still = InvariantFrameTask(robot.tool)
    still.set_target_from_configuration(here)
    # At rest on the target it weighs what Pink's task does with L as its orientation cost.
    np.testing.assert_allclose(still.compute_qp_objective(here)[0], weight, atol=1e-9)


def test_it_arrives_inside_pinks_limits_with_a_posture_task(arms):
    robot = arms["panda"]
    rng = np.random.default_rng(5)
    posture = pink.PostureTask(cost=1e-3)
    posture.set_target(0.5 * (robot.position_lower + robot.position_upper))
    for task in (InvariantFrameTask(robot.tool), InvariantFrameTask(robot.tool, point=[0.0, 0.0, 0.1], gain=0.5)):
        q = 0.5 * (robot.position_lower + robot.position_upper) + 0.1 * rng.normal(size=7)
        here = configuration(robot, q)
        target = pin.SE3(robot.pose(q + 0.3 * rng.normal(size=7)))
        task.set_target(target)
        limited = 0
        for _ in range(400):
            x = solved(here, [task, posture])
            assert (np.abs(x) <= robot.velocity_limit * (1.0 + 1e-6)).all()
            limited += bool((np.abs(x) >= robot.velocity_limit * (1.0 - 1e-6)).any())
            here.update(here.q + DT * x)
            assert (here.q >= robot.position_lower - 1e-9).all()
            assert (here.q <= robot.position_upper + 1e-9).all()
        assert limited > 5
        assert np.linalg.norm(pin.log6(here.get_transform_frame_to_world(robot.tool).actInv(target))) < 1e-5


def test_invalid_arguments_are_named(arms):
    robot = arms["ur5"]
    here = configuration(robot, np.zeros(6))
    task = InvariantFrameTask("nowhere")
    task.set_target(pin.SE3.Identity())
    with pytest.raises(pink.exceptions.FrameNotFound, match="nowhere"):
        task.compute_qp_objective(here)
    task = InvariantFrameTask(robot.tool)
    with pytest.raises(pink.exceptions.TargetNotSet):
        task.compute_qp_objective(here)
    task.set_target(robot.target(robot.pose(np.zeros(6))))
    task.transform_target_to_world.translation = np.array([np.nan, 0.0, 0.0])
    with pytest.raises(iq.BadInput, match="target: found NaN"):
        task.compute_qp_objective(here)
    assert "h = 0.37" in repr(InvariantFrameTask("tool0", form=0.37))
    assert "least squares" in repr(InvariantFrameTask("tool0"))
    for options, message in (
        ({"gain": 1.5}, "gain"),
        ({"position_cost": -1.0}, "position_cost"),
        ({"point": "tip"}, "point"),
        ({"length": 0.0}, "length"),
        ({"length": 0.5, "orientation_cost": 1.0}, "Both say what a radian costs"),
        ({"position_cost": [1.0, 2.0, 1.0]}, "Give orientation_cost too"),
        ({"orientation_cost": 1.0, "form": iq.CarriedMetric(np.ones(6), np.eye(4))}, "the metric includes it"),
        ({"damping": iq.Guard(0.5)}, "damping: found Guard"),
        ({"damping": -0.1}, "damping"),
    ):
        with pytest.raises(iq.BadInput, match=message):
            InvariantFrameTask(robot.tool, **options)


def test_our_controller_satisfies_pinks_limits(arms):
    """The same inequalities, in every tick of a run that meets all of them."""
    robot = arms["panda"]
    q = robot.position_lower + 0.2 * (robot.position_upper - robot.position_lower)
    slow = robot.model.copy()
    slow.velocityLimit = np.full(7, 0.4)
    limits = [
        VelocityLimit(slow),
        ConfigurationLimit(robot.model, 0.02),
        AccelerationLimit(robot.model, np.full(7, 3.0)),
    ]
    controller = iq.Controller(robot, dt=DT, gain=20.0, limits=limits)
    target = iq.transform(translation=(-0.5, 0.0, 0.2))
    before, reached = np.zeros(7), {type(limit).__name__: 0 for limit in limits}
    for _ in range(400):
        solution = controller.step(q, target)
        here = configuration(robot, q)
        for limit in limits:
            if isinstance(limit, AccelerationLimit):
                limit.set_last_integration(before, DT)
            G, h = limit.compute_qp_inequalities(here, DT)
            slack = h / DT - G @ solution.velocity
            assert slack.min() > -1e-9
            reached[type(limit).__name__] += slack.min() < 1e-7
        assert solution.status in {"ok", "guarded", "limited"}, solution.reason
        before = solution.velocity
        q = q + DT * before
    assert min(reached.values()) > 0


def test_our_controller_satisfies_a_barrier(arms):
    robot = arms["panda"]
    q = ready("panda")
    height = robot.pose(q)[2, 3]
    floor = PositionBarrier(robot.tool, indices=[2], p_min=np.array([height - 0.05]), gain=20.0)
    below = robot.pose(q)
    below[2, 3] -= 0.3
    lowest = {}
    for label, options in (("with", {"limits": [floor]}), ("without", {})):
        controller = iq.Controller(robot, dt=DT, gain=10.0, **options)
        here, heights = q, []
        for _ in range(150):
            solution = controller.step(here, below)
            here = here + DT * solution.velocity
            heights.append(robot.pose(here)[2, 3])
        lowest[label] = min(heights)
    assert lowest["with"] > height - 0.0501
    assert lowest["with"] < height - 0.049  # it got there
    assert lowest["without"] < height - 0.2


def test_a_self_collision_barrier_has_the_shapes_of_the_robots_urdf(arms):
    robot = arms["panda"]
    q = ready("panda")
    barrier = SelfCollisionBarrier(5, gain=20.0, d_min=0.02)
    solution = iq.Controller(robot, dt=DT, limits=[barrier]).step(q, robot.pose(q))
    assert np.isfinite(solution.velocity).all()
    bare = iq.robots.Chain(robot.screws, robot.home, robot.names)
    with pytest.raises(iq.BadInput, match="SelfCollisionBarrier, which fails on this arm"):
        iq.Controller(bare, dt=DT, limits=[barrier])


class ConstantLimit:
    """A limit with constant rows."""

    def __init__(self, G, h):
        self.rows = G, h

    def compute_qp_inequalities(self, configuration, dt):
        return self.rows


def test_limits_that_are_nan_or_infeasible_are_a_status(arms):
    robot = arms["ur5"]
    q, away = np.zeros(6), iq.transform(translation=(0.5, 0.2, 0.4))
    row = np.eye(6)[:1]
    for limit, status, reason in (
        (ConstantLimit(row, np.array([np.nan])), "held", "ConstantLimit gives NaN here"),
        (ConstantLimit(np.nan * row, np.zeros(1)), "held", "ConstantLimit gives NaN here"),
        (ConstantLimit(0.0 * row, -np.ones(1)), "held", "allows no velocity"),
        (ConstantLimit(np.vstack((row, -row)), -0.001 * np.ones(2)), "degraded", "limit rows conflict with each other"),
        (ConstantLimit(row, np.array([-100.0])), "degraded", "limit rows conflict with the bounds of joint 0"),
        (ConstantLimit(row, np.array([np.inf])), "", ""),
        (ConstantLimit(np.empty((0, 6)), np.empty(0)), "", ""),
    ):
        solution = iq.Controller(robot, dt=DT, limits=[limit]).step(q, away)
        assert solution.status == (status or iq.Controller(robot, dt=DT).step(q, away).status)
        assert reason in solution.reason
        assert np.isfinite(solution.velocity).all()
        assert (np.abs(solution.velocity) <= robot.velocity_limit).all()
    # Pink's acceleration limit gives NaN outside the position limits: the arm returns, a tenth of the way in a tick.
    outside = robot.position_upper + 0.1
    limit = AccelerationLimit(robot.model, np.ones(6))
    solution = iq.Controller(robot, dt=DT, limits=[limit]).step(outside, away)
    assert solution.status == "held"
    assert solution.reason.startswith("AccelerationLimit gives NaN here; joint ")
    assert "joint 0 (shoulder_pan_joint): 0.1 outside its position range; " in solution.reason
    np.testing.assert_allclose(solution.velocity, -0.1 * 0.1 / DT)


def test_limits_for_another_model_are_refused(arms):
    with pytest.raises(iq.BadInput, match="rows on 7 joints"):
        iq.Controller(arms["panda"], dt=DT, limits=[VelocityLimit(arms["ur5"].model)]).step(np.zeros(7), np.eye(4))
    with pytest.raises(iq.BadInput, match="compute_qp_inequalities"):
        iq.Controller(arms["panda"], dt=DT, limits=[3.0])
    modelless = Modelless(arms["ur5"])
    with pytest.raises(iq.BadInput, match="one of a URDF"):
        iq.Controller(modelless, dt=DT, limits=[VelocityLimit(arms["ur5"].model)])


class Modelless:
    """A robot of the user's own."""

    def __init__(self, robot):
        for name in ROBOT:
            setattr(self, name, getattr(robot, name))


def test_joint_screws_have_a_model_for_pinks_limits():
    screws = [iq.revolute((0, 0, 1)), iq.revolute((0, 1, 0), (0.1, 0, 0.2)), iq.se3.prismatic((1, 0, 1))]
    arm = iq.robots.Chain(np.column_stack(screws), iq.transform(translation=(0.5, 0, 0.3)), velocity_limit=0.1)
    limit, q = VelocityLimit(arm.model), np.array([0.3, -0.4, 0.2])
    solution = iq.Controller(arm, dt=DT, joint_metric=np.ones(3), limits=[limit]).step(q, arm.pose(q + 0.3))
    assert np.abs(solution.velocity).max() == pytest.approx(0.1)
    with pytest.raises(iq.BadInput, match="not a unit screw"):
        iq.robots.Chain(2.0 * np.eye(6)[:, :1], np.eye(4)).model  # noqa: B018


def test_a_target_is_a_pose_or_an_array(arms):
    robot = arms["ur5"]
    q = np.array([0.1, -1.2, 1.4, -1.0, -1.3, 0.2])
    plain, array = (InvariantFrameTask(robot.tool) for _ in range(2))
    target = robot.pose(q + 0.01)
    plain.set_target(pin.SE3(target))
    array.set_target(target)
    configuration = pink.Configuration(robot.model, robot.model.createData(), q)
    for one, other in zip(
        plain.compute_qp_objective(configuration), array.compute_qp_objective(configuration), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    with pytest.raises(iq.BadInput, match="target"):
        array.set_target(None)
    with pytest.raises(iq.BadInput, match="frame: found None"):
        InvariantFrameTask(None)


def test_damping_reaches_joints_that_do_not_move_the_frame():
    model = iq.load_robot("ur5e").model.copy()
    limits = -3.0 * np.ones(1), 3.0 * np.ones(1)
    model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "side", np.ones(1), 10.0 * np.ones(1), *limits)
    here = pink.Configuration(model, model.createData(), np.array([0.3, -1.2, 1.5, -1.0, 1.0, 0.3, 0.5]))
    found = []
    for make in (pink.FrameTask, InvariantFrameTask):
        task = make("tool0", position_cost=1.0, orientation_cost=1.0, lm_damping=1.0)
        task.set_target_from_configuration(here)
        task.transform_target_to_world.translation[2] += 0.3
        found.append(task.compute_qp_objective(here)[0][6, 6])
    assert found[0] == pytest.approx(0.09)
    assert found[1] == pytest.approx(found[0])
