"""What is noted in each tick of a run: errors of motion and force, the wrench, the curve drawn."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.runs.plants.touch import Truth
from invariantqp.runs.scene import Scene


@dataclass(frozen=True, eq=False)
class ContactTrace:
    """What happened at the contact; wrenches are what the tool exerts (m; f), base frame, after each tick.

    Attributes:
        wrench: (n, 6) as it was.
        measured: (n, 6) as the controller took it to be, at the tick's beginning.
        press: (n,) how much of the wanted wrench was there [N]; its share along P*, in the contact's stiffness.
        measured_press: (n,) as the controller took it to be.
        error: (n,) |P*(W_d - W)| [N], moments as the forces that strain the contact as much.
        measured_error: (n,).
        wanted: |W_d| [N].
        drawn: (n, 3) where the tool's point was [m].
        asked: (n, 3) where it should have been.
        normal: (3,) of the plane to look at them in.
    """

    wrench: Array
    measured: Array
    press: Array
    measured_press: Array
    error: Array
    measured_error: Array
    wanted: float
    drawn: Array
    asked: Array
    normal: Array

    def relative_rms(self, first: int, *, measured: bool = False) -> float | None:
        """Force error from tick `first` on, root mean square over |W_d|; None where no force is wanted."""
        error = (self.measured_error if measured else self.error)[first:]
        return float(np.sqrt(np.mean(error**2))) / self.wanted if self.wanted > 0.0 else None


@dataclass(eq=False)
class Log:
    """Lists that grow by one a tick.

    Attributes:
        scene: what is touched.
        errors: distance [m] and angle [rad] from the path, along what the contact leaves free.
    """

    scene: Scene
    errors: list[tuple[float, float]] = field(default_factory=list)
    _touched: list[tuple[Array, Array, Array, Array]] = field(default_factory=list)
    _forces: list[tuple[float, float, float, float]] = field(default_factory=list)

    def add(self, truth: Truth, wanted: Array, measured: Array) -> None:
        """One tick: what was so after it, where the tool should have been, and the wrench the controller read in it."""
        T, scene = truth.pose, self.scene
        contact = scene.task.contact_at(T)
        exerted = -truth.wrench
        self.errors.append(scene.motion_error(contact, T, wanted))
        self._touched.append((exerted, measured, T[:3, 3], wanted[:3, 3]))
        self._forces.append((*scene.force(contact, exerted), *scene.force(contact, measured)))

    def contact(self) -> ContactTrace:
        """All of it."""
        wrench, measured, drawn, asked = (np.array(column) for column in zip(*self._touched, strict=True))
        press, error, felt, felt_error = np.array(self._forces).T
        wanted, normal = self.scene.wanted_norm, self.scene.normal
        return ContactTrace(wrench, measured, press, felt, error, felt_error, wanted, drawn, asked, normal)


def distance(T: Array, wanted: Array) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses."""
    R = T[:3, :3].T.dot(wanted[:3, :3])
    # |R - I|_F = 2 sqrt(2) sin(angle / 2): keeps its digits at small angles, where the trace loses them.
    angle = 2.0 * np.arcsin(min(1.0, float(np.linalg.norm(R - np.eye(3))) / np.sqrt(8.0)))
    return float(np.linalg.norm(wanted[:3, 3] - T[:3, 3])), float(angle)
