"""One solve against its exact answer in rational numbers: free, at limits, near a singularity."""

import numpy as np
import pytest
from scipy.optimize import minimize
from support.velocity_reference import root_of, shipped

import invariantqp as iq
from invariantqp.analysis.survey import joint_ranges
from invariantqp.legacy.damping import Adaptive
from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.legacy.problem import problem_of
from invariantqp.legacy.solve import solve

POINT, LENGTH, TWIST = np.array([0.1, -0.2, 0.3]), 0.7, 0.3
SORTS = ("free", "limited", "singular")
# What the guide says of one solve, relative.
ACCURACY = 1e-10


def near_singular(robot, q, rng):
    """Joint positions 1e-4 to 3e-2 rad from a singularity, which a minimiser finds from q."""

    def distance(x):
        sigma = np.linalg.svd(robot.jacobian(x), compute_uv=False)
        return float((sigma[-1] / sigma[0]) ** 2)

    low, high = joint_ranges(robot)
    singular = minimize(distance, q, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)), tol=1e-14).x
    step = rng.standard_normal(len(q))
    return np.clip(singular + 10.0 ** rng.uniform(-4.0, -1.5) * step / np.linalg.norm(step), low, high)


def state(robot, sort, rng):
    """(J, s, lower, upper) in the tool frame."""
    low, high = joint_ranges(robot)
    while True:
        q = rng.uniform(low, high)
        q = near_singular(robot, q, rng) if sort == "singular" else q
        J = iq.adjoint(iq.inverse(robot.pose(q))) @ robot.jacobian(q)
        sigma = np.linalg.svd(J, compute_uv=False)
        if sort == "singular" or sigma[-1] > 1e-2 * sigma[0]:
            s = TWIST * rng.standard_normal(6)
            fast = np.abs(np.linalg.pinv(J) @ s).max()
            reach = fast * rng.uniform(0.7, 1.3, len(q)) * (0.7 if sort == "limited" else 10.0)
            return J, s, -reach, reach


@pytest.mark.cases(5)
@pytest.mark.parametrize("sort", SORTS)
@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
def test_one_solve_is_its_exact_answer(name, sort):
    robot, rng, root = iq.load_robot(name), np.random.default_rng(SORTS.index(sort)), root_of(POINT, LENGTH)
    for _ in range(6):
        J, s, lower, upper = state(robot, sort, rng)
        exact = shipped(root @ J, root @ s, 0.002, lower, upper)
        x = solve(VelocityLaw(dt=0.002), Demand(J, s, root, lower, upper)).velocity
        assert np.linalg.norm(x - exact) <= ACCURACY * np.linalg.norm(exact)
        assert sort == "singular" or ((lower < exact) & (exact < upper)).all() == (sort == "free")


@pytest.mark.cases(4)
@pytest.mark.parametrize("last", [1e-2, 5e-4, 1e-6, 0.0], ids=lambda x: f"sigma {x:g}")
@pytest.mark.parametrize("share", [0.8, 1e6], ids=["limited", "free"])
def test_to_rounding_damping_and_calm_included(share, last):
    rng, root = np.random.default_rng(3), root_of(POINT, LENGTH)
    U, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    V, _ = np.linalg.qr(rng.normal(size=(7, 7)))
    J, s = np.linalg.solve(root, U * np.r_[np.geomspace(1.0, 0.1, 5), last] @ V[:6]), rng.normal(size=6)
    free = solve(*problem_of(J, s, point=POINT, length=LENGTH, damping=Adaptive())).velocity
    reach = np.full(7, share * np.abs(free).max())
    x = solve(VelocityLaw(dt=0.01), Demand(J, s, root, -reach, reach)).velocity
    exact = shipped(root @ J, root @ s, 0.01, -reach, reach)
    # No further off than ten times what rounding moves of the exact answer: an SVD rounds relative to the whole of J.
    rounded = J + np.finfo(float).eps * np.linalg.norm(J) * rng.normal(size=J.shape)
    moved = np.abs(shipped(root @ rounded, root @ s, 0.01, -reach, reach) - exact).max()
    np.testing.assert_allclose(x, exact, rtol=0.0, atol=10.0 * moved + 1e-14 * np.abs(exact).max())
    if last < 1e-3 and share < 1.0:  # the residual adds damping, in the reference too
        slow = shipped(root @ J, root @ s, 1e-9, -reach, reach)
        assert np.abs(exact - slow).max() > 1e-6 * np.abs(exact).max()
