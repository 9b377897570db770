"""A call that is refused changes nothing: the controller goes on as one that was never asked."""

import numpy as np
import pinocchio as pin
import pytest
from support.arms import ready

import invariantqp as iq

READY = ready("panda")


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
        (READY, panda.pose(READY) + np.eye(4)[3:], None),
        (READY, 2.0 * panda.pose(READY), None),
        (READY, None, None),
        (READY, target, np.full(6, -np.inf)),
        (READY, target, np.zeros(5)),
        (READY, target, None, np.full(7, np.nan)),
        (READY, target, None, np.zeros(1)),
    ]
    q = np.array(READY)
    for k in range(2 * len(bad)):
        with pytest.raises(iq.BadInput):
            disturbed.step(*bad[k % len(bad)])
        for twist in (np.full(6, np.nan), np.zeros(5), np.full(6, 2e12), None):
            with pytest.raises(iq.BadInput):
                disturbed.follow(q, twist)
        a, b = plain.step(q, target), disturbed.step(q, target)
        assert a.velocity.tobytes() == b.velocity.tobytes()
        assert a[1:5] == b[1:5]
        q = q + 0.01 * a.velocity + 1e-3 * rng.normal(size=7)
