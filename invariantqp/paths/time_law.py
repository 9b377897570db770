"""Limits of the joints in time: position, velocity, acceleration and jerk, in every tick.

    v = v_before + dt a,    |v| <= V,   |a| <= A,   |a - a_before| <= J dt,    lower <= q <= upper

A tick is taken only if the joint can come to rest inside all of them afterwards: then there is always a next tick.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.control.tracking import TRACKING_SHARE
from invariantqp.geometry.arrays import Array

# An acceleration that differs from the wanted one by less than this share of what jerk changes in a tick is the same.
ROUNDING = 1e-6
# A joint this close to a position limit [rad, length] is at it, and one that is off by as little is where it is wanted.
AT_LIMIT = 1e-6
# A speed below this share of its limit, or of the largest on the way, is rest.
AT_REST = 1e-6
# Halvings of the interval of accelerations in which the largest is looked for that leaves room to stop.
HALVINGS = 24

# Shares of acceleration and velocity that joints catch up at: what they follow needs some, too.
CATCH_UP_SHARE, CATCH_UP_SPEED = 0.7, 0.99


def usual(limit: Array) -> Array:
    """(m,) speeds beside which those of joints count: their limits, a unit where there is none."""
    return np.where(np.isfinite(limit), limit, 1.0)


class JointLimits(NamedTuple):
    """What joints may do."""

    lower: Array  # (m,) positions [rad, length]
    upper: Array  # (m,)
    velocity: Array  # (m,)
    acceleration: Array  # (m,)
    jerk: Array  # (m,)
    dt: float

    @property
    def rows(self) -> Array:
        """(5, m) as the compiled core takes them."""
        return np.array(self[:5])

    def of(self, joint: int) -> JointLimits:
        """Those of one joint."""
        lower, upper, velocity, acceleration, jerk = self.rows[:, joint, None]
        return JointLimits(lower, upper, velocity, acceleration, jerk, self.dt)

    def slowed(self, share: Array) -> JointLimits:
        """With speeds that are shares (m,) of these, or of a unit where there is no limit."""
        return self._replace(velocity=np.maximum(share, AT_REST) * usual(self.velocity))

    def ratio(self, position: Array, velocity: Array, acceleration: Array, jerk: Array) -> Array:
        """(...) the largest share of a limit that motions (..., m) need; 2 and more where they leave the ranges."""
        needs = np.maximum(np.abs(velocity) / self.velocity, np.abs(acceleration) / self.acceleration)
        needs = np.maximum(needs, np.abs(jerk) / self.jerk)
        out = np.maximum(position - self.upper, self.lower - position)
        return np.asarray(np.where(out > AT_LIMIT, np.maximum(needs, 2.0 + out), needs).max(axis=-1))

    def towards(self, velocity: Array, wanted: Array) -> Array:
        """(m,) accelerations that bring a velocity to the wanted one soonest, jerk taking them back in time."""
        d = wanted - velocity
        J, h = self.jerk, 0.5 * self.jerk * self.dt
        # In ticks: what an acceleration a that falls by J dt a tick still adds is a^2 / 2 J - a dt / 2.
        twice = 2.0 * J * np.abs(d)
        most = np.minimum(twice / (np.sqrt(h * h + twice) + h), self.acceleration)
        return np.asarray(np.clip(d / self.dt, -most, most))

    def catching_up(self, position: Array, velocity: Array, there: Array) -> Array:
        """(m,) accelerations that bring joints soonest to a motion: its position and velocity (2+, m)."""
        x = there[0] - position
        w = self.homing(x, TRACKING_SHARE / self.dt)
        fastest = CATCH_UP_SPEED * self.velocity
        return self.towards(velocity, np.clip(there[1] + np.copysign(w, x), -fastest, fastest))

    def homing(self, way: Array, gain: float) -> Array:
        """(m,) speeds at which joints go a way (m,), and stop at its end: at a gain [1/s] where that is little."""
        A = CATCH_UP_SHARE * self.acceleration
        # The way to stop from w is w^2 / 2 A and, at w for 2 A / J, the time in which braking begins and ends.
        lag = 2.0 * A * A / self.jerk
        return np.asarray(np.minimum(np.sqrt(lag * lag + 2.0 * A * np.abs(way)) - lag, gain * np.abs(way)))

    def peak(self, way: Array) -> Array:
        """(m,) the largest speeds of joints that catch up a way (m,) from rest to rest, nearly."""
        A, J, d, gain = self.acceleration, self.jerk, np.abs(way), TRACKING_SHARE / self.dt
        # The way from rest to v and back: v^2 / 2 A and v A / 2 J, then as in `homing`, at first v / gain.
        a, b = 0.5 * (1.0 + 1.0 / CATCH_UP_SHARE) / A, (0.5 + 2.0 * CATCH_UP_SHARE) * A / J
        speeds = [
            2.0 * d / (b + np.sqrt(b * b + 4.0 * a * d)),
            2.0 * d / (1.0 / gain + np.sqrt(1.0 / gain**2 + 2.0 * d / A)),
        ]
        return np.minimum(np.minimum(*speeds), self.velocity)

    def nearest(self, q: Array, velocity: Array, acceleration: Array, wanted: Array) -> Array:
        """(m,) the joint velocity of a tick nearest the wanted one (m,), as `within`; to rounding that itself."""
        a = (wanted - velocity) / self.dt
        allowed = self.within(q, velocity, acceleration, a)
        other = np.abs(allowed - a) > ROUNDING * self.jerk * self.dt
        return np.where(other, velocity + self.dt * allowed, wanted)

    def within(self, q: Array, velocity: Array, acceleration: Array, wanted: Array) -> Array:
        """(m,) the acceleration of a tick nearest the wanted one, after which every joint can still stop.

        `velocity` and `acceleration` are those of the tick before.
        """
        A, J, dt = self.acceleration, self.jerk, self.dt
        low, high = np.maximum(-A, acceleration - J * dt), np.minimum(A, acceleration + J * dt)
        low, high = np.minimum(low, A), np.maximum(high, -A)
        chosen = np.minimum(np.maximum(wanted, low), high)
        up = self._most(np.maximum(self.upper - q, 0.0), velocity, low, chosen)
        down = -self._most(np.maximum(q - self.lower, 0.0), -velocity, -high, -chosen)
        return np.asarray(np.where(up < chosen, up, np.where(down > chosen, down, chosen)))

    def _most(self, room: Array, velocity: Array, low: Array, wanted: Array) -> Array:
        """(m,) the largest acceleration, up to the wanted one, after which a joint still stops in its room upward."""
        J, dt = self.jerk, self.dt
        left = self.velocity - velocity
        # v + dt a + a^2 / 2 J <= V; where braking has to begin at once, a falls as fast as it may.
        fastest = np.where(left > 0.0, np.sqrt(J * J * dt * dt + 2.0 * J * np.maximum(left, 0.0)) - J * dt, left / dt)
        a = np.maximum(np.minimum(wanted, fastest), low)
        if (self._needed(velocity, a) <= room).all():
            return a
        lo, hi = low.copy(), a.copy()
        for _ in range(HALVINGS):
            middle = 0.5 * (lo + hi)
            fits = self._needed(velocity, middle) <= room
            lo, hi = np.where(fits, middle, lo), np.where(fits, hi, middle)
        return np.where(self._needed(velocity, a) <= room, a, lo)

    def _needed(self, velocity: Array, a: Array) -> Array:
        """(m,) the way a joint goes upward in a tick at acceleration a and in stopping after it."""
        A, J, dt = self.acceleration, self.jerk, self.dt
        v = velocity + dt * a
        square = J * v + 0.5 * a * a
        p = np.sqrt(np.maximum(square, 0.0))
        full = p > A
        p = np.minimum(p, A)
        t = np.maximum((a + p) / J, 0.0)
        v1 = v + a * t - 0.5 * J * t * t
        hold = np.where(full, np.maximum(v1 - p * p / (2.0 * J), 0.0) / np.where(full, p, 1.0), 0.0)
        way = v * t + 0.5 * a * t * t - J * t**3 / 6.0 + v1 * hold - 0.5 * p * hold * hold + p**3 / (6.0 * J * J)
        # Braking harder than the stop needs: it ends while the acceleration still rises.
        over = (a < 0.0) & (v > 0.0) & (J * v <= 0.5 * a * a)
        root = np.sqrt(np.maximum(a * a - 2.0 * J * np.maximum(v, 0.0), 0.0))
        s = np.where(over, (-a - root) / J, 0.0)
        way = np.where(over, v * s + 0.5 * a * s * s + J * s**3 / 6.0, way)
        # One tick more, in which the discrete motion is ahead of the continuous one.
        way = np.where((v <= 0.0) & (a <= 0.0), 0.0, np.maximum(way, 0.0) + dt * np.maximum(v, 0.0))
        return dt * np.maximum(v, 0.0) + way
