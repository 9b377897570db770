"""Where other methods fail, in this process, and ours does not: each failure is asserted before ours is."""

import numpy as np
import osqp
import pink
import pinocchio as pin
import pytest
from scipy import sparse
from support.arms import ready

import invariantqp as iq
from invariantqp.compare.libraries import PinkLaw
from invariantqp.compare.ours import paper_law
from invariantqp.compare.stability import Case, run_case
from invariantqp.robots.kinematics import middle
from invariantqp.runs.controllers import our_controller

READY = ready("panda")
FULL = 0.99  # of the velocity limit


def pink_step(robot, q, target, dt, **options):
    configuration = pink.Configuration(robot.model, robot.model.createData(), np.asarray(q, dtype=float))
    task = pink.FrameTask(robot.tool, 1.0, 1.0)
    task.set_target(pin.SE3(target.homogeneous))
    return pink.solve_ik(configuration, [task], dt, solver="daqp", safety_break=False, **options)


@pytest.fixture(scope="module")
def panda():
    return iq.load_robot("panda")


def test_moore_penrose_at_the_wrist_singularity():
    robot = iq.load_robot("ur5")
    q = np.array([0.0, -1.2, 1.6, -0.6, 1e-7, 0.3])
    target = robot.target(iq.exp([0.3, 0.2, 0.1, 0.05, 0.05, 0.05]) @ robot.pose(q))
    wanted = 10.0 * robot.sight(q, target).error
    assert np.abs(np.linalg.pinv(robot.jacobian(q)) @ wanted / robot.velocity_limit).max() > 1e4
    solution = iq.Controller(robot, dt=0.01, gain=10.0).step(q, target)
    assert (np.abs(solution.velocity) <= robot.velocity_limit).all()
    assert np.abs(iq.solve_velocity(robot.jacobian(q), wanted).velocity).max() < 1e2


def test_the_papers_lambda_through_the_wrist_singularity():
    case = Case("stability/ur5_wrist")

    def paper_at(robot, law):  # with the pitch that [DS] suggests for a 6R arm, of the order of its own length
        length = iq.systems.centre(robot.jacobian(middle(robot))).length
        return paper_law(robot, law.model_copy(update={"form": length}))

    paper, _ = run_case(case, paper_at)
    ours, _ = run_case(case, our_controller)
    assert paper["final_mm"] > 100.0
    assert paper["tail"] > 3.0
    assert ours["final_mm"] < 1e-3
    assert ours["tail"] < 0.1


def test_outside_its_limits_pink_finds_nothing_at_all():
    case = Case("stability/outside_limits")
    theirs, _ = run_case(case, PinkLaw)
    assert theirs["raised"] == 1.0
    assert theirs["excess"] > 0.09
    ours, _ = run_case(case, our_controller)
    assert ours["raised"] == 0.0
    assert ours["excess"] <= 1e-9


def test_a_target_out_of_reach_keeps_pink_rattling_at_full_speed():
    case = Case("stability/out_of_reach_fast")
    _, theirs = run_case(case, PinkLaw)
    tail = theirs.velocity[-200:] / theirs.velocity_limit
    assert np.abs(tail).max() > FULL
    assert (np.sign(tail[1:]) != np.sign(tail[:-1])).any(axis=1).mean() > 0.9
    ours, _ = run_case(case, our_controller)
    assert ours["tail"] < 1e-2


def test_nan_in_the_target_is_nan_out_of_pink(panda):
    pose = pin.SE3(panda.pose(READY))
    pose.translation = np.array([np.nan, 0.0, 0.5])
    assert np.isnan(pink_step(panda, READY, pose, 0.01, damping=1e-6)).any()
    with pytest.raises(iq.BadInput, match="target: found NaN"):
        iq.Controller(panda, dt=0.01).step(READY, pose)


def test_pinks_default_damping_fails_daqp_where_a_limit_is_active(panda):
    rng = np.random.default_rng(0)
    failed = 0
    for _ in range(400):
        q = np.clip(rng.normal(READY, 0.4), panda.position_lower, panda.position_upper)
        target = panda.target(iq.exp(rng.normal(size=6)) @ panda.pose(q))
        try:
            pink_step(panda, q, target, 0.01)
        except pink.exceptions.PinkError:
            failed += 1
        loop = iq.Controller(panda, dt=0.01, gain=100.0)
        assert loop.step(q, target).status in ("ok", "limited")
    assert failed > 0


def test_one_nan_poisons_a_kept_osqp_for_good_and_not_ours(panda):
    n = 3
    solver = osqp.OSQP()
    eye = sparse.identity(n, format="csc")
    solver.setup(eye, -np.ones(n), eye, -np.ones(n), np.ones(n), verbose=False)
    solver.update(q=np.full(n, np.nan))
    solver.solve(raise_error=False)
    solver.update(q=-np.ones(n))
    assert not np.isfinite(np.asarray(solver.solve(raise_error=False).x, dtype=float)).all()
    target = panda.target(iq.exp([0.5, 0.0, 0.3, 0.3, 0.2, 0.1]) @ panda.pose(READY))
    ours = iq.Controller(panda, dt=0.01, gain=100.0, backend="osqp")
    before = ours.step(READY, target)
    with pytest.raises(iq.BadInput):
        ours.step(READY, target, np.full(6, np.nan))
    np.testing.assert_allclose(ours.step(READY, target).velocity, before.velocity, atol=1e-12)


@pytest.mark.parametrize("backend", ["daqp", "osqp"])
def test_a_refused_call_leaves_the_controller_as_it_was(panda, backend):
    rng = np.random.default_rng(1)
    target = panda.target(iq.exp([0.4, 0.0, 0.3, 0.3, 0.2, 0.1]) @ panda.pose(READY))
    nowhere = pin.SE3(panda.pose(READY))
    nowhere.translation = np.full(3, np.inf)
    plain, disturbed = (
        iq.Controller(panda, dt=0.01, gain=50.0, backend=backend, acceleration_limit=20.0) for _ in range(2)
    )
    bad = [
        (np.full(7, np.nan), target, None),
        (READY[:6], target, None),
        (READY, nowhere, None),
        (READY, np.full((4, 4), np.nan), None),
        (READY, np.eye(3), None),
        (READY, target, np.full(6, -np.inf)),
        (READY, target, np.zeros(5)),
        (READY, target, None, np.full(7, np.nan)),
        (READY, target, None, np.zeros(1)),
    ]
    q = np.array(READY)
    for k in range(60):
        with pytest.raises(iq.BadInput):
            disturbed.step(*bad[k % len(bad)])
        a, b = plain.step(q, target), disturbed.step(q, target)
        assert a.velocity.tobytes() == b.velocity.tobytes()
        assert a[1:5] == b[1:5]
        q = q + 0.01 * a.velocity + 1e-3 * rng.normal(size=7)
