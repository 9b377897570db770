"""Acceleration limits on top of the box: a joint is never faster than it can still brake in the room it has left.

    |x - x_before| <= a dt,     D(x) = dt (x + (x - a dt) + (x - 2 a dt) + ... while positive) <= room

D is what a joint travels that moves at x for this tick and brakes at a from the next on, tick by tick: with
u = x / (a dt) and n = ceil(u) ticks, D = a dt^2 (n u - n (n - 1) / 2). If D(x) fits into the room now, D(x - a dt) fits
into what is left after the tick, so a joint that obeys both limits once can obey them for ever.

Where they contradict each other the box is still not empty, and reports the joint:
    too fast for the room        the smallest deceleration, kept up, that stops inside; more than a
    outside a position limit     not further out, and back as fast as acceleration and the opposite limit allow
    faster than v_max            v_max: velocity never gives way
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from attrs import field, frozen

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.velocity.limits.box import JointBox
from invariantqp.velocity.reasons import Code, Reason, of_joints

# Limits that contradict each other by less than this, relative to what the acceleration allows in a tick and to the
# velocity, do so by rounding alone.
STRAIN_TOLERANCE = 1e-9
# Stands in for an infinite acceleration or room where infinity times zero would be NaN.
BOUNDLESS = 1e30


class BrakingBounds(NamedTuple):
    """A box that is never empty, and the joints at which the limits contradict each other."""

    lower: Array  # (m,)
    upper: Array  # (m,)
    strained: tuple[Reason, ...]  # what gave way, joint by joint
    placed_lower: Array  # (m,) by the room to the position limits alone
    placed_upper: Array  # (m,)


@frozen(eq=False, repr=False, slots=False)
class BrakingBox(Value):
    """The box of position, velocity and acceleration limits."""

    box: JointBox  # position and velocity limits
    acceleration: Array = field(converter=own)  # (m,) [rad/s^2, length/s^2], positive, inf where there is none

    def at(self, q: Array, before: Array) -> BrakingBounds:
        """The box at joint positions q (m,), coming from the joint velocity `before` (m,)."""
        fastest = self.box.velocity_limit
        ahead, behind = self.box.room(q)
        # Down is the same problem as up with all signs changed.
        (least, least_back), (most, most_back) = self._towards(np.array((ahead, behind)), np.array((before, -before)))
        lower, upper = np.maximum(least, -most_back), np.minimum(most, -least_back)
        lower = np.minimum(np.maximum(lower, -fastest), fastest)
        upper = np.maximum(np.minimum(np.maximum(upper, -fastest), fastest), lower)
        down, up = (braking_speed(room, self.acceleration, self.box.dt) for room in (behind, ahead))
        placed = np.minimum(lower, -down), np.maximum(upper, up)
        return BrakingBounds(lower, upper, self._strained(q, before, lower, upper), *placed)

    def _towards(self, room: Array, before: Array) -> tuple[Array, Array]:
        """(least, most) velocities (2, m) towards the limits `room` (2, m) away, up and down.

        `least` is what one tick of braking leaves of `before`, or `most` where that is not slow enough.
        """
        dt = self.box.dt
        slowest = before - self.acceleration * dt
        braking = braking_speed(room, self.acceleration, dt)
        # Outside: never further out, and back inside as fast as acceleration and the opposite limit allow.
        back = np.maximum(room / dt, -braking[::-1])
        inside = room >= 0.0
        returning = np.minimum(np.maximum(back, slowest), 0.0)
        most = np.where(inside, braking, returning)
        late = inside & (most < slowest)
        if late.any():
            most = np.where(late, _late_braking(room, before, dt), most)
        return np.minimum(slowest, most), most

    def _strained(self, q: Array, before: Array, lower: Array, upper: Array) -> tuple[Reason, ...]:
        """Joints that cannot have all their limits kept."""
        step = self.acceleration * self.box.dt
        jerked = np.maximum(lower - before, before - upper) - step
        allowance = STRAIN_TOLERANCE * (1.0 + np.abs(before) + np.where(np.isfinite(step), step, 0.0))
        dt, a = self.box.dt, self.acceleration
        found = [
            (i, (float(jerked[i] + step[i]) / dt, float(a[i]))) for i in np.flatnonzero(jerked > allowance).tolist()
        ]
        return (*self.box.outside(q.tolist(), range(len(q))), *of_joints(Code.ACCELERATION, found))


def braking_speed(room: Array, acceleration: Array, dt: float) -> Array:
    """The largest x >= 0 with D(x) <= room, for each joint; inf where the room is, 0 where there is none."""
    a = np.minimum(acceleration, BOUNDLESS)
    # Room in units of what one tick of acceleration makes in one tick; n ticks of braking need n (n + 1) / 2 of it.
    r = np.minimum(np.maximum(room, 0.0), BOUNDLESS) / (a * dt * dt)
    n = np.maximum(np.ceil(0.5 * (np.sqrt(8.0 * r + 1.0) - 1.0)), 1.0)
    return np.where(np.isinf(room), np.inf, a * dt * (r / n + 0.5 * (n - 1.0)))


def _late_braking(room: Array, before: Array, dt: float) -> Array:
    """The next velocity under the smallest constant deceleration that stops within the room, at each joint.

    From w = `before`, ticks at w - b, w - 2b, ... sum to the room for b = 2 w (n - d) / (n (n - 1)), where
    d = 1 + room / (w dt), n = ceil(2 d - 1) ticks; one tick, b = w, where there is no room.
    """
    w = np.where(before > 0.0, before, 1.0)
    d = 1.0 + np.minimum(np.maximum(room, 0.0), BOUNDLESS) / (w * dt)
    n = np.maximum(np.ceil(2.0 * d - 1.0), 1.0)
    share = np.where(n > 1.0, 2.0 * (n - d) / np.maximum(n * (n - 1.0), 1.0), 1.0)
    return np.where(before > 0.0, w * (1.0 - share), 0.0)
