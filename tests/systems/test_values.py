"""What this floor returns is a value: read-only, equal to its like, printed in short, and the same after a pickle."""

import pickle

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.systems.pseudoinverses import penrose_conditions
from invariantqp.systems.spectra import hyperbolic_polar

J = np.random.default_rng(0).normal(size=(6, 3))
LINES = np.column_stack([iq.revolute((1, 0, 0)), iq.revolute((0, 1, 0)), iq.revolute((0, 0, 1), (1, 0, 0))])
MAKE = {
    "Existence": lambda x: iq.systems.existence(J, 0.3 * x),
    "GibsonHunt": lambda x: iq.gibson_hunt(np.array([(1, 0, 0, x, 0, 0), (0, 1, 0, 0, 2, 0)]).T),
    "HyperbolicSpectrum": lambda x: iq.systems.hyperbolic_singular_values(x * J, 0.3),
    "HyperbolicPolar": lambda x: hyperbolic_polar(x * J, 0.3),
    "Involution": lambda x: iq.involution(x * LINES),
    "NullPlane": lambda x: iq.systems.beta_plane((1, 2, 3), (0, 0, 2), x),
    "PenroseConditions": lambda x: penrose_conditions(x * J, np.linalg.pinv(J), 0.3),
    "PointMotion": lambda x: iq.systems.point_motion(J, (0, 0, x), (1, 0, 0)),
    "DualProjectors": lambda x: iq.dual_projectors(J, h=0.3 * x),
    "StationaryPoint": lambda x: iq.systems.stationary_point(J, np.full(6, x), 0.3),
    "SystemReport": lambda x: iq.systems.describe(np.array([(1, 0, 0, x, 0, 0), (0, 1, 0, 0, 2, 0)]).T),
    "ContactKind": lambda x: iq.contacts.ContactKind("mine", x * np.eye(6)[:, :2], out=np.eye(6)[5]),
    "Contact": lambda x: iq.point_contact((0, 0, x), (0, 0, 1)),
}


@pytest.mark.parametrize("name", MAKE)
def test_results_are_values(name):
    value, again, other = MAKE[name](1.0), MAKE[name](1.0), MAKE[name](0.5)
    assert type(value).__name__ == name
    assert value == again != other
    assert hash(value) == hash(again)
    assert value != "something else"
    back = pickle.loads(pickle.dumps(value))
    assert back == value
    assert repr(value).startswith(f"{name}(")
    for kept in (value, back):
        for field, content in vars(kept).items():
            if isinstance(content, np.ndarray) and content.size:
                with pytest.raises(ValueError, match="read-only"):
                    content[...] = 0.0
            with pytest.raises(AttributeError):
                setattr(kept, field, content)


def test_a_contact_keeps_its_own_arrays():
    E = np.eye(6)
    freedoms, W, out, origin = E[:, :2].copy(), E[:, 2:].copy(), E[5].copy(), np.ones(3)
    kind = iq.contacts.ContactKind("mine", freedoms, W, out=out, origin=origin)
    pose = np.eye(4)
    contact = iq.contacts.Contact(kind, pose)
    before = [np.copy(a) for a in (kind.freedoms, kind.constraints, kind.out, kind.origin, contact.pose)]
    for given in (freedoms, W, out, origin, pose):
        given[...] = 7.0
    for kept, was in zip((kind.freedoms, kind.constraints, kind.out, kind.origin, contact.pose), before, strict=True):
        np.testing.assert_array_equal(kept, was)


def test_projectors_move_to_values():
    moved = iq.dual_projectors(J, h=0.3).moved(iq.transform(translation=(1, 2, 3)))
    assert not moved.motion.flags.writeable
    assert moved.unit == iq.dual_projectors(J, h=0.3).unit
