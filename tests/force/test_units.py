"""A hybrid tick in metres and in millimetres: the same joint velocities, status and reason.

Five to seven random hinges press on a random surface: rows of the force beside exact ones of the tip, which say the
same of a point contact twice, and beside rows on the joints.
"""

import numpy as np
import pytest
from support.random_systems import motion
from support.repeats import repeats

import invariantqp as iq

ARMS = repeats(300, 20)
LENGTHS = {"size": 0.05, "approach_speed": 0.02, "approach_distance": 0.1, "edge_margin": 0.01, "slide_speed": 0.1}
LENGTHS |= {"retreat_speed": 0.02, "retreat_distance": 0.02}
EXACT = {
    "nothing": lambda u, m: None,
    "tip": lambda u, m: "position",
    "point": lambda u, m: iq.control.ExactPoint([0.03 * u, 0.0, 0.02 * u]),
    "axis": lambda u, m: iq.control.ExactAxis([0.0, 0.0, 1.0]),
    "tip and joints": lambda u, m: [iq.control.ExactPoint(), iq.ExactRows(np.eye(1, m), [0.1])],
}


def tick_of(seed, exact, u):
    """The answer with u units of length to the metre."""
    rng = np.random.default_rng(seed)
    m, kind = int(rng.integers(5, 8)), rng.integers(3)
    axes, points, home = rng.normal(size=(m, 3)), rng.uniform(-0.4, 0.4, (m, 3)), motion(rng, 0.3)
    q, X, aside = rng.uniform(-1.0, 1.0, m), motion(rng, 0.1), motion(rng, 0.01)
    fast = rng.choice([0.05, 0.5, 5.0])  # limits slow the rows down, and do not
    home[:3, 3] *= u
    X[:3, 3] *= u
    aside[:3, :3], aside[:3, 3] = iq.exp(np.r_[0.05 * rng.normal(size=3), 0.0, 0.0, 0.0])[:3, :3], u * aside[:3, 3]
    screws = np.column_stack([iq.revolute(a, u * p) for a, p in zip(axes, points, strict=True)])
    robot = iq.robots.Chain(screws, home).with_limits(velocity_limit=fast)
    normal = rng.normal(size=3)
    tool = robot.pose(q)
    place, along = tool[:3, 3], rng.normal(size=3)
    makes = (
        lambda: iq.point_contact(place, normal),
        lambda: iq.contacts.line_contact(place, along, normal),
        lambda: iq.contacts.face_contact(place, normal),
    )
    contact = makes[kind]()
    wanted = np.r_[10.0, np.zeros(contact.constraints.shape[1] - 1)]
    task = iq.HybridTask(contact, wanted, stiffness=2e4 / u, **{name: u * value for name, value in LENGTHS.items()})
    loop = iq.HybridController(robot, task, dt=0.002, order="moment first", exact=EXACT[exact](u, m))
    press = 8.0 * -normal / np.linalg.norm(normal)
    wrench = np.r_[np.cross(place, press), press]
    for _ in range(3):
        solution = loop.step(q, tool @ aside, wrench)
        q = q + 0.002 * solution.velocity
    return solution


@pytest.mark.cases(2)
@pytest.mark.parametrize("exact", EXACT)
def test_millimetres_change_no_tick(exact):
    slowed = 0
    for seed in range(ARMS):
        here, there = tick_of(seed, exact, 1.0), tick_of(seed, exact, 1e3)
        assert here.status == there.status, (seed, here.reason, there.reason)
        apart = np.linalg.norm(here.velocity - there.velocity)
        slow = here.velocity_solution.scale < 1.0  # a change of q by 2e-15 changes such a tick by 5.4e-8 of itself
        assert apart <= (6e-8 if slow else 1e-9) * np.linalg.norm(here.velocity), (seed, apart)
        slowed += 0.0 < here.velocity_solution.scale < 1.0
    assert slowed > 0 or exact == "nothing"  # the force alone is slow
