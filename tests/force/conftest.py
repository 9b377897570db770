"""Arms of the tests of the force room."""

import pytest

import invariantqp as iq


@pytest.fixture(scope="session")
def panda():
    return iq.load_robot("panda")


@pytest.fixture(scope="session")
def so101():
    return iq.load_robot("so101")
