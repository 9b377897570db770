"""A picture of bodies: their shadows lie where the arm is, and the two nearest are named."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.limits import Capsule, Clearance, HalfSpace, Sphere
from invariantqp.workbench.pictures.inspection import _outline, bodies_picture

ARM = iq.robots.Chain(np.stack((iq.revolute([0, 0, 1]), iq.revolute([0, 1, 0], [0.3, 0, 0])), axis=1), np.eye(4))
BODIES = {"base": [Capsule([0, 0, 0], [0, 0, 0.2], 0.05)], "joint2": [Sphere([0.6, 0, 0], 0.04)]}


@pytest.mark.filterwarnings("ignore:clearance. nothing is kept apart")
def test_shadows_are_as_wide_as_the_shapes(tmp_path):
    limit = Clearance(ARM, BODIES, [HalfSpace([0, 0, -1], [0, 0, 1])])
    shapes = limit.shapes([np.pi / 2.0, 0.0])
    ball = _outline(next(placed for name, _, placed in shapes if name == "joint2"), [0, 1])
    np.testing.assert_allclose(ball.mean(axis=0), [0.0, 0.6], atol=1e-3)
    np.testing.assert_allclose(np.ptp(ball, axis=0), 0.08, atol=1e-3)
    post = _outline(next(placed for name, _, placed in shapes if name == "base"), [0, 2])
    np.testing.assert_allclose(np.ptp(post, axis=0), [0.1, 0.3], atol=1e-3)
    text = bodies_picture(limit, [0.4, -0.3], tmp_path / "bodies.svg").read_text(encoding="utf-8")
    ball = np.array([0.3 + 0.3 * np.cos(0.3), 0.3 * np.sin(0.3)])
    assert f"nearest: base and joint2, {1e3 * (ball[0] - 0.09):.1f} mm" in text
    with pytest.raises(iq.BadInput, match="no bodies"):
        bodies_picture(Clearance(ARM, {}), np.zeros(2), tmp_path / "none.svg")
