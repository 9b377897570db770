"""A wrench sensor's reading made into what the law needs: the wrench that the tool exerts, in the base frame.

    W = -Ad*_{base<-sensor} dead(smooth(reading - bias - weight(R)))

    weight    (c x R'g m; R'g m), c the tool's centre of mass in the sensor's frame
    dead      soft thresholds, f max(0, 1 - d/|f|): continuous, forces and moments apart
    smooth    first-order low-pass, y += (1 - exp(-2 pi f_c dt)) (x - y)

The coadjoint carries moments along: a wrist sensor 100 mm off the tip reads moments that the tip does not feel.
All of it happens in the sensor's frame, where a pressed wrench keeps its numbers while the tool travels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, inf, pi
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array

# Standard gravity in a base frame whose z points up [m/s^2].
GRAVITY = (0.0, 0.0, -9.80665)


@dataclass(frozen=True, eq=False)
class WrenchSensor:
    """Where a sensor sits, what hangs on it, and how its reading is cleaned.

    Attributes:
        mount: (4, 4) pose of the sensor's frame in the tool frame; the identity by default.
        mass: of everything beyond the sensor [kg].
        centre: (3,) centre of that mass in the sensor's frame [length].
        gravity: (3,) in the base frame [length/s^2].
        bias: (6,) reading of the unloaded sensor, (m; f).
        cutoff: of the low-pass [Hz]; inf is none.
        force_deadband: forces below this are nothing [N].
        moment_deadband: moments below this, about `origin`, are nothing [N length].
        reads: "reaction" is what the world does to the tool: pressing on a table reads a force upwards, the weight of
            the tool one downwards. "action" is the opposite.
        origin: (3,) the point about which the moment deadband is taken, in the sensor's frame.

    Raises:
        BadInput: NaN, shapes, a negative mass, cut-off or deadband.
    """

    mount: ArrayLike | None = None
    mass: float = 0.0
    centre: ArrayLike = (0.0, 0.0, 0.0)
    gravity: ArrayLike = GRAVITY
    bias: ArrayLike = (0.0,) * 6
    cutoff: float = inf
    force_deadband: float = 0.0
    moment_deadband: float = 0.0
    reads: Literal["reaction", "action"] = "reaction"
    origin: ArrayLike = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("centre", "gravity", "origin"):
            object.__setattr__(self, name, arrays.vector(getattr(self, name), 3, name))
        object.__setattr__(self, "mount", np.eye(4) if self.mount is None else arrays.pose(self.mount, "mount"))
        object.__setattr__(self, "bias", arrays.vector(self.bias, 6, "bias"))
        for name, unit in (("mass", "kg"), ("force_deadband", "N"), ("moment_deadband", "N m")):
            arrays.not_negative(getattr(self, name), name, f"a number in {unit}")
        if self.cutoff != inf:
            arrays.number(self.cutoff, "cutoff", "a frequency in Hz, or inf", positive=True)
        if self.reads not in ("reaction", "action"):
            raise BadInput("reads", repr(self.reads), '"reaction" or "action"')

    def unloaded(self, tool: ArrayLike) -> Array:
        """(6,) what the sensor would read with nothing touching the tool, at a (4, 4) tool pose in the base frame."""
        return self._unloaded(arrays.pose(tool, "tool"))

    def loaded(self, reading: ArrayLike, tool: ArrayLike) -> Array:
        """(6,) the reading without bias and weight, in the sensor's frame, as the tool exerts it.

        Raises:
            BadInput: NaN, shapes.
        """
        return self._loaded(arrays.vector(reading, 6, "wrench"), arrays.pose(tool, "tool"))

    def in_base(self, wrench: ArrayLike, tool: ArrayLike) -> Array:
        """(6,) a wrench in the sensor's frame told in the base frame, its moment about the base's origin."""
        T = arrays.pose(tool, "tool").dot(np.asarray(self.mount))
        carried: Array = se3.coadjoint(T, check=False).dot(arrays.vector(wrench, 6, "wrench"))
        return carried

    def measured(self, reading: ArrayLike, tool: ArrayLike) -> Array:
        """(6,) the wrench that the tool exerts, base frame: bias, weight and deadbands taken off, not smoothed.

        Raises:
            BadInput: NaN, shapes.
        """
        return self.in_base(self.dead(self.loaded(reading, tool)), tool)

    def dead(self, wrench: Array) -> Array:
        """(6,) a wrench in the sensor's frame after the deadbands."""
        if self.force_deadband == 0.0 and self.moment_deadband == 0.0:
            return wrench
        p = np.asarray(self.origin)
        f = wrench[3:]
        m = wrench[:3] - se3.cross(p, f)
        f = soft(f, self.force_deadband)
        return np.concatenate((soft(m, self.moment_deadband) + se3.cross(p, f), f))

    def relabelled(self, offset: ArrayLike | None = None, tool_offset: ArrayLike | None = None) -> WrenchSensor:
        """The same sensor told with its frame displaced by `offset` in itself, and the tool's by `tool_offset`."""
        X = np.eye(4) if offset is None else arrays.pose(offset, "offset")
        Y = np.eye(4) if tool_offset is None else arrays.pose(tool_offset, "tool_offset")
        back = se3.inverse(X, check=False)
        return replace(
            self,
            mount=se3.inverse(Y, check=False).dot(np.asarray(self.mount)).dot(X),
            centre=back[:3, :3].dot(np.asarray(self.centre)) + back[:3, 3],
            origin=back[:3, :3].dot(np.asarray(self.origin)) + back[:3, 3],
            bias=se3.coadjoint(back, check=False).dot(np.asarray(self.bias)),
        )

    def _unloaded(self, tool: Array) -> Array:
        R = tool[:3, :3].dot(np.asarray(self.mount)[:3, :3])
        f = self.mass * R.T.dot(np.asarray(self.gravity))
        weight = np.concatenate((se3.cross(np.asarray(self.centre), f), f))
        reading: Array = np.asarray(self.bias) + (weight if self.reads == "reaction" else -weight)
        return reading

    def _loaded(self, reading: Array, tool: Array) -> Array:
        load = reading - self._unloaded(tool)
        return -load if self.reads == "reaction" else load


class Smoothing(NamedTuple):
    """A low-pass in one state: its owner replaces it by `after` once in every tick.

    Attributes:
        share: of a step that one tick passes on, 1 - exp(-2 pi f_c dt).
        value: the smoothed wrench; None before the first, which is taken as it is.
    """

    share: float
    value: Array | None = None

    @classmethod
    def of(cls, cutoff: float, dt: float) -> Smoothing:
        """The low-pass with a cut-off in Hz for ticks of dt seconds."""
        return cls(1.0 - exp(-2.0 * pi * cutoff * dt))

    def after(self, wrench: Array) -> tuple[Array, Smoothing]:
        """The smoothed wrench after one more reading, and the state then."""
        smooth = wrench if self.value is None else self.value + self.share * (wrench - self.value)
        return smooth, self._replace(value=smooth)


def soft(vector: Array, width: float) -> Array:
    """The vector shortened by `width`, zero where it is shorter: continuous, and the same whatever way axes point."""
    length = float(np.sqrt(vector.dot(vector)))
    share = 1.0 - width / length if length > width else 0.0
    shortened: Array = vector * share
    return shortened
