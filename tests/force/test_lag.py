"""Commands that act later than declared: measured from the joints after the first of them, in any contact."""

import re
from collections import deque

import numpy as np
import pytest
from support.plane import UP, gantry, press_on_plane

import invariantqp as iq

DT = 0.002


@pytest.mark.parametrize(("delay", "off"), [(0.04, 1e-3), (0.05, 1.5e-3)])
def test_motion_with_an_undeclared_delay_does_not_oscillate(delay, off):
    run = press_on_plane(noise=0.0, delay=delay, seconds=1.6)  # of gain 50/s
    assert run.off.max() < 0.008
    assert run.off[500:].max() < off
    assert run.press.max() < 12.0
    assert run.statuses()[-1] == "degraded"
    reason = run.solutions[-1].reason
    assert float(reason.partition("commands act ")[2].split()[0]) == pytest.approx(1e3 * delay, abs=2.0)
    assert "instead of 50 1/s" in reason


def test_an_undeclared_delay_on_a_screw_is_measured_without_an_approach():
    robot, q, late = gantry(), np.zeros(6), deque([np.zeros(6)] * 25)
    task = iq.HybridTask(iq.contacts.hinge(np.zeros(3), UP, 0.01), [0.0] * 5)
    loop, forces = iq.HybridController(robot, task, dt=DT, order="moment first"), []
    twist = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.01])
    for k in range(1000):
        turn = 0.5 * (1.0 - np.cos(2.0 * k * DT))
        tool = robot.pose(q)
        target = iq.exp(turn * twist)
        # held to its screw in all other directions
        along = float(iq.log(tool) @ twist) / float(twist @ twist)
        wrench = 1e4 * np.repeat([5e-3, 1.0], 3) * (iq.log(tool) - along * twist)
        solution = loop.step(q, target, wrench, np.sin(2.0 * k * DT) * twist)
        late.append(solution.velocity)
        q = q + DT * late.popleft()
        forces.append(np.linalg.norm(wrench[3:]))
    assert re.search("commands act 5[0-9.]+ ms later than declared", solution.reason)
    assert solution.status == "degraded"
    assert max(forces) < 1.0
    assert abs(along - turn) < 0.1


def test_a_small_delay_changes_no_gain():
    run = press_on_plane(10.0, delay=0.01, seconds=0.6)
    assert "later than declared" not in " ".join(s.reason for s in run.solutions)
