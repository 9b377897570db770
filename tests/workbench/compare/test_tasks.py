"""The tasks of the bed are what their kinds say."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.errors import RobotModelError
from invariantqp.robots.chain import Chain
from invariantqp.workbench.compare.arms import STARTS, arm, chain_of, random_arm, urdf
from invariantqp.workbench.compare.method import LoopSpec
from invariantqp.workbench.compare.tasks import COUNTS, KINDS, LATE, SINGULAR, STREAM, Maker, bed, from_file, joint_path

SEED = 3


@pytest.fixture(scope="module")
def tasks():
    return {task.name: task for task in bed(list(STARTS), list(KINDS), SEED)}


def test_every_kind_is_on_every_arm(tasks):
    counts = {kind: sum(task.kind == kind for task in tasks.values()) for kind in KINDS}
    others = {"singular": 12, "principal pitch": 2, "turn": 10, "out of reach": 10}
    assert counts == {kind: others.get(kind, 5) for kind in KINDS}
    for task in tasks.values():
        n, m = task.noise.shape
        assert task.name.startswith(f"{task.arm}/")
        assert task.targets.shape == task.desired.shape == (n, 4, 4)
        assert task.feedforward is None or task.feedforward.shape == (n, 6)
        assert task.q0.shape == (m,) == task.spec.velocity_limit.shape
        assert 0 <= task.settles_from < n
        assert np.isfinite(task.desired).all()
        assert np.isfinite(task.targets).all() or task.kind == "NaN"
        assert task.spec.posture_gain.any() == (m > 6)


def test_a_task_is_the_same_whichever_others_are_made(tasks):
    for kind in ("jitter", "singular", "other tool frame", "stay"):
        for alone in bed(["so101"], [kind], SEED):
            for field in ("targets", "noise", "q0", "desired"):
                np.testing.assert_array_equal(getattr(alone, field), getattr(tasks[alone.name], field))


def test_the_seed_is_that_of_paths_and_of_the_random_arm(tasks):
    other = {task.name: task for task in bed(["random4", "panda"], ["free"], SEED + 1)}
    for name, task in other.items():
        assert np.abs(task.targets - tasks[name].targets).max() > 1e-2
    assert np.abs(other["random4/free"].spec.screws - tasks["random4/free"].spec.screws).max() > 1e-2


@pytest.mark.parametrize("name", STARTS)
def test_a_free_path_stays_inside_and_a_path_at_limits_does_not(name):
    maker = Maker(name, SEED)
    path = joint_path([maker.q0, maker.path_end, maker.q0], 3.0, 0.002)
    speed = np.abs(np.diff(path, axis=0)).max(axis=0) / 0.002
    assert (path > maker.low).all()
    assert (path < maker.high).all()
    assert (speed < maker.robot.velocity_limit).all()
    np.testing.assert_allclose(maker.poses(path), maker.free_path, atol=1e-12)
    targets, duration = maker.path_beyond_limits()
    far = maker.path_end.copy()
    far[maker.joint] = maker.beyond(0.2)
    asked = joint_path([maker.q0, far, maker.q0], duration, 0.002, rest=0.5)
    np.testing.assert_allclose(maker.poses(asked), targets, atol=1e-12)
    fastest = (np.abs(np.diff(asked, axis=0)).max(axis=0) / 0.002 / maker.robot.velocity_limit).max()
    assert fastest == pytest.approx(1.4, rel=0.01)
    assert max((maker.low - asked).max(), (asked - maker.high).max()) == pytest.approx(0.2, abs=1e-3)


@pytest.mark.parametrize("seed", [0, SEED])
@pytest.mark.parametrize("name", STARTS)
def test_the_way_through_a_singularity_goes_through_one(name, seed):
    maker = Maker(name, seed)
    ends = maker.ends()
    assert len(ends) == (0 if name == "random4" else 3)  # four hinges have none
    for a, b in ends.values():
        smallest = min(maker.smallest(a + u * (b - a)) for u in np.linspace(0.0, 1.0, 2001))
        assert smallest < 2.5 * SINGULAR
        assert smallest < 0.2 * max(maker.smallest(a), maker.smallest(b))


def test_targets_of_a_stream_are_late_and_never_early(tasks):
    for kind, rate, late in (("stale", 10.0, 0.0), ("jitter", STREAM, LATE)):
        task = tasks[f"ur5e/{kind}"]
        path = task.desired
        assert task.feedforward is None
        for k in range(20, len(path) // 2, 37):  # on the way out, where no two poses are alike
            (same,) = np.flatnonzero(np.abs(path[: len(path) // 2] - task.targets[k]).max(axis=(1, 2)) == 0.0)
            assert 0 <= k - same <= (1.0 / rate + late) / 0.002 + 1


def test_nine_targets_are_not_finite(tasks):
    for name in STARTS:
        bad = ~np.isfinite(tasks[f"{name}/NaN"].targets).all(axis=(1, 2))
        assert bad.sum() == 9


def test_it_starts_outside_by_as_much_as_it_says_and_is_to_stay_with_noise(tasks):
    for name in STARTS:
        task = tasks[f"{name}/outside"]
        outside = np.maximum(task.spec.lower - task.q0, task.q0 - task.spec.upper)
        assert np.sort(outside)[-2] < 0.0
        assert outside.max() == pytest.approx(0.05)
        assert np.std(tasks[f"{name}/stay"].noise) == pytest.approx(COUNTS, rel=0.1)


def test_another_tool_frame_is_the_same_motion_of_the_same_arm(tasks):
    for name in STARTS:
        task, plain = tasks[f"{name}/other tool frame"], tasks[f"{name}/limits"]
        X = np.linalg.solve(plain.spec.home, task.spec.home)
        assert np.linalg.norm(X[:3, 3]) > 0.05
        np.testing.assert_allclose(task.targets, plain.targets @ X, atol=1e-12)
        np.testing.assert_allclose(task.feedforward, plain.feedforward)
        np.testing.assert_allclose((X @ [*task.spec.point, 1.0])[:3], plain.spec.point, atol=1e-12)
        assert task.spec.length == plain.spec.length
        assert task.desired is task.original.desired


def test_in_millimetres_it_is_the_same_motion_of_the_same_arm(tasks):
    for name in STARTS:
        task, plain = tasks[f"{name}/other unit"], tasks[f"{name}/limits"]
        metres = np.array([1e-3, 1e-3, 1e-3])
        q = 0.5 * (plain.spec.lower.clip(-3.0) + plain.spec.upper.clip(max=3.0))
        pose, then = chain_of(plain.spec).pose(q), chain_of(task.spec).pose(q)
        np.testing.assert_allclose(metres * then[:3, 3], pose[:3, 3], atol=1e-12)
        np.testing.assert_allclose(metres * task.targets[:, :3, 3], plain.targets[:, :3, 3], atol=1e-12)
        np.testing.assert_allclose(task.feedforward, plain.feedforward * [1.0, 1.0, 1.0, 1e3, 1e3, 1e3])
        assert task.spec.length == 1e3 * plain.spec.length
        assert task.desired is task.original.desired


def test_the_pseudoinverse_does_not_exist_half_way_at_the_principal_pitch(tasks):
    for name in ("so101", "random4"):
        task, maker = tasks[f"{name}/principal pitch"], Maker(name, SEED)
        pitch = task.spec.law["form"]
        half, end = 0.5 * (maker.q0 + maker.path_end), maker.path_end
        assert not iq.has_pseudoinverse(maker.robot.jacobian(half), pitch)
        assert iq.has_pseudoinverse(maker.robot.jacobian(end), pitch) == (name == "random4")
        off = np.linalg.norm(
            (task.targets - maker.poses(joint_path([maker.q0, end], 3.0, 0.005, rest=1.0)))[:, :3, 3], axis=1
        )
        assert off.max() == pytest.approx(0.005)


def test_what_methods_are_given_survives_json(tasks):
    given = tasks["panda/accelerations"].spec
    again = LoopSpec.from_json(given.as_json())
    for key, value in vars(given).items():
        np.testing.assert_array_equal(getattr(again, key), value)


@pytest.mark.parametrize("name", STARTS)
def test_the_text_is_the_same_arm(name):
    pin = pytest.importorskip("pinocchio")
    robot = arm(name, SEED)
    model = pin.buildModelFromXML(urdf(robot))
    data = model.createData()
    assert list(model.names)[1:] == list(robot.names)
    for q in np.random.default_rng(0).uniform(-1.0, 1.0, (5, len(robot.names))):
        pin.framesForwardKinematics(model, data, q)
        np.testing.assert_allclose(data.oMf[model.getFrameId("tool")].homogeneous, robot.pose(q), atol=1e-12)
    np.testing.assert_allclose(model.velocityLimit, robot.velocity_limit)
    np.testing.assert_allclose(model.lowerPositionLimit, robot.position_lower)
    np.testing.assert_allclose(model.upperPositionLimit, robot.position_upper)


def test_a_helical_joint_has_no_urdf():
    robot = Chain(np.array([iq.se3.helical([1, 0, 0], [0, 1, 0], 0.3)]).T, np.eye(4))
    with pytest.raises(RobotModelError, match="helical"):
        urdf(robot)


def test_a_random_arm_is_a_metre_long_and_has_its_limits():
    robot = random_arm(4, 0)
    assert len(robot.names) == 4
    assert (robot.velocity_limit == 2.0).all()
    assert np.linalg.norm(robot.pose(np.zeros(4))[:3, 3]) <= 1.0


def test_a_task_file_comes_with_its_twin_in_another_tool_frame():
    mine, other = from_file(iq.load_task("arm_3r"), seed=1)
    n = len(mine.targets)
    assert other.original is mine
    assert mine.settles_from == n - 1 - round(1.0 / mine.spec.dt)
    np.testing.assert_array_equal(mine.targets[mine.settles_from :], mine.targets[-1:].repeat(n - mine.settles_from, 0))


REFUSED = {
    "pen_on_paper": "in contact",
    "ur5_elastic": "with elastic timing",
    "two_arms_pass": "with obstacles",
    "shared_surface": "with an operator",
}


@pytest.mark.parametrize(("name", "found"), REFUSED.items())
def test_what_other_methods_do_not_have_is_refused(name, found):
    with pytest.raises(iq.BadInput, match=f"TASK: found {name}, {found}; expected a task without this"):
        from_file(iq.load_task(name))


@pytest.mark.parametrize(("law", "found"), [({"delay": 0.01}, "a delay"), ({"tool_speed": 0.1}, "a tool speed")])
def test_a_law_that_other_methods_do_not_have_is_refused(law, found):
    task = iq.load_task("arm_3r")
    with pytest.raises(iq.BadInput, match=f"with {found}"):
        from_file(task.model_copy(update={"law": task.law.model_copy(update=law)}))


def test_all_keep_a_margin_of_position_limits():
    task = iq.load_task("panda_path")
    wide, narrow = (
        from_file(task.model_copy(update={"law": task.law.model_copy(update={"position_margin": x})}))[0].spec
        for x in (0.0, 0.1)
    )
    np.testing.assert_allclose(narrow.lower, wide.lower + 0.1)
    np.testing.assert_allclose(narrow.upper, wide.upper - 0.1)
    assert narrow.law["position_margin"] == 0.0  # it is in the limits
    assert narrow.urdf != wide.urdf
