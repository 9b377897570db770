"""Figures of a run, and the rule of dominance."""

from dataclasses import replace

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.workbench.compare.figures import (
    ACCELERATION_TOLERANCE,
    BETTER,
    FLOORS,
    NOT_SETTLED,
    POSITION_TOLERANCE,
    VELOCITY_TOLERANCE,
    WORSE,
    compared,
    dominates,
    errors,
    figures,
)
from invariantqp.workbench.compare.tasks import bed

N = 50


@pytest.fixture(scope="module")
def task():
    """Fifty ticks of an SO-101 that is to stay, with limits of acceleration."""
    (found,) = bed(["so101"], ["jump accelerations"])
    stays = np.repeat(iq.load_robot("so101").pose(found.q0)[None], N, axis=0)
    return replace(found, targets=stays, desired=stays, noise=found.noise[:N])


def run(task, velocities, **more):
    x = np.array(velocities)
    positions = task.q0 + task.spec.dt * np.vstack((np.zeros(5), np.cumsum(x, axis=0)))
    return figures(
        task, {"positions": positions, "velocities": x, "times_us": [3.0] * N, "exceptions": {}, "stopped": [], **more}
    )


def still():
    return np.zeros((N, 5))


def test_an_arm_that_stays_has_no_figures(task):
    found = run(task, still())
    for key in (
        "mm",
        "deg",
        "mm_rms",
        "deg_rms",
        "acceleration",
        "acceleration_rms",
        "settling",
        "violations",
    ):
        assert found[key] == pytest.approx(0.0, abs=1e-6)
    assert found["us"] == found["us_p99"] == 3.0


def test_errors_are_distances_of_poses(task):
    rng = np.random.default_rng(0)
    Q = task.q0 + 0.3 * rng.normal(size=(N, 5))
    robot = iq.load_robot("so101")
    for q, wanted, (mm, deg) in zip(Q, task.desired, errors(task, Q), strict=True):
        gap = np.linalg.inv(robot.pose(q)) @ wanted
        assert mm == pytest.approx(1e3 * np.linalg.norm(robot.pose(q)[:3, 3] - wanted[:3, 3]), abs=1e-9)
        assert deg == pytest.approx(np.degrees(np.linalg.norm(iq.log(gap)[:3])), abs=1e-9)


def test_errors_are_those_before_a_tick_and_accelerations_begin_at_rest(task):
    x = still()
    x[0, 4] = 0.01
    found = run(task, x)
    assert found["acceleration"] == pytest.approx(0.01 / task.spec.dt)
    assert found["acceleration_rms"] == pytest.approx(0.01 / task.spec.dt * np.sqrt(2.0 / (5 * N)))
    assert found["joints_deg"] == pytest.approx(np.degrees(0.01 * task.spec.dt))
    turned = np.degrees(0.01 * task.spec.dt)
    assert found["deg"] == pytest.approx(turned, rel=1e-6)
    assert found["deg_rms"] == pytest.approx(turned * np.sqrt((N - 1) / N), rel=1e-6)


def test_a_tool_has_settled_after_its_last_error_above_a_millimetre_or_a_degree(task):
    x = still()
    x[9, 4], x[12, 4] = 10.0, -10.0  # away after ten ticks, back after thirteen
    dt = task.spec.dt
    assert run(task, x)["settling"] == pytest.approx(13 * dt)
    assert run(replace(task, settles_from=11), x)["settling"] == pytest.approx(2 * dt)
    assert run(replace(task, settles_from=13), x)["settling"] == 0.0
    x[12, 4] = 0.0
    assert run(task, x)["settling"] is None


def test_limits_of_position_speed_and_acceleration_are_each_seen(task):
    spec, dt = task.spec, task.spec.dt
    x = still()
    x[5:7, 1] = [0.04, 0.08]
    most = spec.acceleration_limit[1] * dt
    assert run(task, x)["violations"] == 1  # from 0.08 to 0 at once
    assert run(task, x, stopped=[7])["violations"] == 0  # the arm was stopped
    x[6, 1] = 0.04 + most * (1.0 + 0.5 * ACCELERATION_TOLERANCE)
    x[7:9, 1] = x[6, 1] - most, 0.04
    assert run(task, x)["violations"] == 0  # rounding of solvers
    free = replace(spec, acceleration_limit=None)
    assert run(replace(task, spec=free), x)["violations"] == 0
    for share, found in ((1.0 - 0.5 * VELOCITY_TOLERANCE, 0), (1.0 - 2.0 * VELOCITY_TOLERANCE, 1)):
        fast = replace(free, velocity_limit=np.full(5, share * x[6, 1]))
        assert run(replace(task, spec=fast), x)["violations"] == found
    end = dt * x[:, 1].sum()
    for beyond, found in ((0.5 * POSITION_TOLERANCE, False), (2.0 * POSITION_TOLERANCE, True)):
        tight = replace(free, upper=task.q0 + end - beyond)
        assert bool(run(replace(task, spec=tight), x)["violations"]) is found


def test_who_creeps_out_of_a_limit_is_seen(task):
    spec = replace(task.spec, acceleration_limit=None, upper=task.q0 + 1e-9)
    x = still()
    x[:, 1] = 0.3 * POSITION_TOLERANCE / spec.dt  # a tick is too little to be seen
    assert run(replace(task, spec=spec), x)["violations"] > N // 2


def test_who_starts_outside_may_come_back(task):
    spec = replace(task.spec, acceleration_limit=None, upper=task.q0 - 0.1)
    x = still() - 0.01
    assert run(replace(task, spec=spec), x)["violations"] == 0
    x[30:] *= -1.0  # and not leave again
    assert run(replace(task, spec=spec), x)["violations"] > 10


def test_errors_are_those_of_the_point_where_accuracy_counts(task):
    spec = replace(task.judged, point=np.array([0.0, 0.0, 0.2]))
    robot, Q = iq.load_robot("so101"), task.q0 + 0.1
    there, here = (np.dot(T, [0.0, 0.0, 0.2, 1.0])[:3] for T in (robot.pose(Q), task.desired[0]))
    mm = errors(replace(task, judged=spec), np.tile(Q, (N, 1)))[0, 0]
    assert mm == pytest.approx(1e3 * np.linalg.norm(there - here), rel=1e-9)


def made(**more):
    one = {"mm": 1.0, "deg": 1.0, "acceleration": 10.0, "acceleration_rms": 1.0, "settling": 1.0}
    return {**one, "exceptions": 0, "violations": 0, "joints_deg": 5.0, **more}


def test_the_rule_of_dominance():
    one = made()
    assert not dominates(one, made())
    assert dominates(made(mm=0.99 / BETTER), one)
    assert not dominates(made(mm=1.01 / BETTER), one)
    assert dominates(made(mm=0.5, deg=0.99 * WORSE), one)
    assert not dominates(made(mm=0.5, deg=1.01 * WORSE), one)
    for key in ("exceptions", "violations"):
        assert not dominates(made(mm=0.5, **{key: 1}), one)
        assert dominates(made(mm=0.5), made(**{key: 1}))
    assert dominates(made(joints_deg=0.2, mm=0.5), one)
    assert not dominates(made(joints_deg=0.05, mm=1.5), made(mm=2.0))  # motionless
    assert not dominates(made(joints_deg=0.05, mm=0.5, deg=1.5), made(deg=2.0))
    assert dominates(made(joints_deg=0.05, mm=0.5), one)  # where it was to stay


def test_what_is_below_the_floors_is_not_told_apart():
    for key, floor in FLOORS.items():
        least = made(**dict.fromkeys(FLOORS, 0.0))
        assert not dominates(least, {**least, key: floor})
        assert dominates(least, {**least, key: 1.2 * floor})
    assert compared(made(settling=None))[-1] == NOT_SETTLED
