"""A wrong model and a camera: the error that a law sees is the true one, and the arm in its motion is another."""

from unittest import mock

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.compare.measure import calibration as measure
from invariantqp.compare.measure.cell import Cell
from invariantqp.compare.measure.loops import loops
from invariantqp.compare.measure.watched import figures, watched_run
from invariantqp.compare.registry import controller_named
from invariantqp.runs.prepare import prepare

CELL = Cell("calibration", "compare/ur5_limits", ("invariantqp",), quick=True)


def test_an_arm_that_is_where_its_model_says_is_the_ordinary_run():
    with mock.patch.multiple(measure, TURNED=0.0, SHIFTED=0.0):
        found = measure.calibration(CELL)["invariantqp"]
    plain = figures(*watched_run(prepare(CELL.load()), controller_named("invariantqp")))
    for name, value in found.items():
        assert value == pytest.approx(plain[name], rel=1e-6, abs=1e-9), name


def test_what_the_law_sees_is_the_true_error():
    model = iq.load_robot("ur5")
    true = measure.misplaced(model, 3)
    q, target = np.array([0.1, -1.1, 1.5, -0.5, -1.1, 0.2]), iq.transform(translation=[0.4, 0.2, 0.5])
    law = mock.Mock()
    measure.Seen(law, model, true).step(q, true.target(target), np.arange(6.0))
    _, seen, ahead = law.step.call_args.args
    np.testing.assert_allclose(
        np.linalg.inv(model.pose(q)) @ seen.pose, np.linalg.inv(true.pose(q)) @ target, atol=1e-12
    )
    in_tool = [iq.adjoint(np.linalg.inv(T)) for T in (model.pose(q), true.pose(q))]
    np.testing.assert_allclose(in_tool[0] @ ahead, in_tool[1] @ np.arange(6.0), atol=1e-12)


def test_joints_are_off_by_millimetres_and_the_run_is_worse():
    model, q = iq.load_robot("ur5"), np.array([0.1, -1.1, 1.5, -0.5, -1.1, 0.2])
    off = np.linalg.norm(measure.misplaced(model, 3).pose(q)[:3, 3] - model.pose(q)[:3, 3])
    assert 1e-3 < off < 5e-2
    assert measure.calibration(CELL)["invariantqp"]["position_mm"] > 2.0 * loops(CELL)["invariantqp"]["position_mm"]
