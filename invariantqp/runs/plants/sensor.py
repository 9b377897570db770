"""The force sensor of a simulated robot, as it really is. What a controller believes of it is a `WrenchSensor`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.force.wrench import GRAVITY
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.runs.plants.springs import force_at


class SimulatedSensor(NamedTuple):
    """A force sensor and what hangs on it."""

    mount: Array  # (4, 4) pose of the sensor in the tool frame
    mass: float = 0.0  # of the tool beyond the sensor [kg]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)  # (3,) centre of that mass in the sensor's frame [m]

    def reading(self, T: Array, contact: Array) -> Array:
        """(6,) what it reads with the tool at rest at pose T under a contact wrench: that and weight, in its frame."""
        pose = T.dot(self.mount)
        weight = force_at(self.mass * np.array(GRAVITY), pose[:3, :3].dot(self.centre) + pose[:3, 3])
        reading: Array = se3.adjoint(pose, check=False).T.dot(contact + weight)
        return reading
