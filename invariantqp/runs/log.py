"""What happened at a contact in a run: wrenches, force errors and the curve drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.runs.plants.plant import PlantState
from invariantqp.runs.scene import ContactScene
from invariantqp.systems.contacts import Contact


@dataclass(frozen=True, eq=False)
class ContactTrace:
    """What happened at the contact. Wrenches are those that the tool exerts (m; f), base frame, after each tick.

    Attributes:
        wrench: (n, 6) as it really was.
        measured: (n, 6) as the controller read it, at the beginning of the tick.
        press: (n,) how much of the wanted wrench was there [N]: its part along P*, in the contact's stiffness.
        measured_press: (n,) the same of the wrench as read.
        error: (n,) |P*(W_d - W)| [N]; a moment counts as the force that stretches the contact as much.
        measured_error: (n,) the same of the wrench as read.
        wanted: |W_d| [N].
        drawn: (n, 3) where the tool's point was [m].
        asked: (n, 3) where it should have been.
        normal: (3,) of the plane to look at these points in.
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


def contact_trace(
    scene: ContactScene, contacts: Sequence[Contact], after: Sequence[PlantState], read: Array, wanted: Array
) -> ContactTrace:
    """What happened at a contact in n ticks.

    `contacts` are those believed in at the poses of `after`, the plant after each tick; `read` (n, 6) the wrenches as
    the controller read them; `wanted` (n, 4, 4) the poses that were asked for.
    """
    exerted = np.array([-state.wrench for state in after])
    press, error = np.array([scene.force(c, W) for c, W in zip(contacts, exerted, strict=True)]).T
    measured_press, measured_error = np.array([scene.force(c, W) for c, W in zip(contacts, read, strict=True)]).T
    return ContactTrace(
        wrench=exerted,
        measured=read,
        press=press,
        measured_press=measured_press,
        error=error,
        measured_error=measured_error,
        wanted=scene.wanted_norm,
        drawn=np.array([state.pose[:3, 3] for state in after]),
        asked=wanted[:, :3, 3],
        normal=scene.normal,
    )


def errors(
    scene: ContactScene | None, contacts: Sequence[Contact], after: Sequence[PlantState], wanted: Array
) -> Array:
    """(n, 2) distance [m] and angle [rad] from the poses (n, 4, 4) wanted; in contact along what it leaves free."""
    if scene is None:
        return np.array([distance(state.pose, T) for state, T in zip(after, wanted, strict=True)])
    return np.array([scene.motion_error(c, s.pose, T) for c, s, T in zip(contacts, after, wanted, strict=True)])


def distance(T: Array, wanted: Array) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses."""
    R = T[:3, :3].T.dot(wanted[:3, :3])
    # |R - I|_F = 2 sqrt(2) sin(angle / 2): keeps its digits at small angles, where the trace loses them.
    angle = 2.0 * np.arcsin(min(1.0, float(np.linalg.norm(R - np.eye(3))) / np.sqrt(8.0)))
    return float(np.linalg.norm(wanted[:3, 3] - T[:3, 3])), float(angle)
