"""A wrist sensor without noise that reads moments first: what the tests have, unless they say otherwise."""

import numpy as np

import invariantqp as iq


def wrist(mount=None, **options):
    said = {"order": "moment first", "reads": "reaction", "noise": 0.0, **options}
    return iq.WrenchSensor(np.eye(4) if mount is None else mount, **said)
