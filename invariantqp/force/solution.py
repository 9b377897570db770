"""The result of a hybrid tick: a joint velocity, its force and motion parts, and what was felt."""

from __future__ import annotations

from attrs import field, frozen

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.systems.contacts import Contact
from invariantqp.velocity.solution import Status, VelocitySolution


@frozen(eq=False, repr=False, slots=False)
class HybridSolution(Compared):
    """A joint velocity for a force/motion task, and how it was found; all twists and wrenches in the base frame.

    Attributes:
        velocity: (m,) joint velocity [rad/s, length/s], inside the limits.
        status: "lost", "overload" or "fault" (the sensor's), "degraded" where the force chatters or is not reached, the
            edge is near or the normal is out of bounds, or the velocity law's own: see `Status`.
        reason: why, in words, "" where there is nothing to report.
        motion: (6,) the wanted twist along S, P s_motion.
        force: (6,) the wanted twist for the wrench error, along Z; the way out in a retreat.
        wrench: (6,) the measured wrench: without weight and bias, smoothed, in the base frame.
        error: (6,) P*(W_d - W), in S*.
        intensities: (6-k,) the measured wrench's parts in the contact's constraints; the first is the press.
        wanted: (6,) W_d.
        contact: the contact of this tick, with the normal found.
        velocity_solution: the velocity law's answer.
        J: (6, m) joint twists.

    Where joint positions cannot be true, wrenches are NaN: where they act is not known.
    """

    velocity: Array
    status: Status
    reason: str
    motion: Array = field(repr=False)
    force: Array = field(repr=False)
    wrench: Array
    error: Array = field(repr=False)
    intensities: Array
    wanted: Array = field(repr=False)
    contact: Contact = field(repr=False)
    velocity_solution: VelocitySolution = field(repr=False)
    J: Array = field(repr=False)

    @property
    def twist(self) -> Array:
        """(6,) the wanted twist, motion and force together."""
        return self.motion + self.force

    @property
    def torque(self) -> Array:
        """(m,) J'W_d, the joint torques that exert the wanted wrench, for torque-controlled arms [N m, N]."""
        torque: Array = self.J.T.dot(self.wanted)
        return torque
