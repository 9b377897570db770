"""From a wrench sensor's reading to what the law needs: the wrench that the tool exerts, in the base frame.

    W = -Ad*_{base<-sensor} deadband(smooth(reading - bias - weight(R)))

    weight    (c x R'g m; R'g m), c the tool's centre of mass in the sensor's frame
    deadband  soft thresholds, f max(0, 1 - d/|f|): continuous, forces and moments apart
    smooth    first-order low-pass, y += (1 - exp(-2 pi f_c dt)) (x - y)

The coadjoint changes moments with the point they are about: a wrist sensor 100 mm off the tip reads moments that the
tip does not feel. Everything but the last step happens in the sensor's frame, where the wrench of a steady press does
not change while the tool travels.
"""

from __future__ import annotations

from math import exp, inf, pi
from typing import Literal, NamedTuple

import numpy as np
from attrs import evolve, field, frozen
from numpy.typing import ArrayLike

from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own

# Standard gravity in a base frame whose z points up [m/s^2].
GRAVITY = (0.0, 0.0, -9.80665)


@frozen(init=False, eq=False, repr=False, slots=False)
class WrenchSensor(Value):
    """Where a sensor sits, what hangs on it, and how its reading is cleaned.

    Attributes:
        mount: (4, 4) pose of the sensor's frame in the tool frame.
        mass: of everything beyond the sensor [kg].
        centre: (3,) centre of that mass in the sensor's frame [length].
        gravity: (3,) in the base frame [length/s^2].
        bias: (6,) reading of the unloaded sensor, (m; f).
        cutoff: of the low-pass [Hz]; inf is none.
        force_deadband: forces below this count as zero [N].
        moment_deadband: moments below this, about `origin`, count as zero [N length].
        reads: "reaction" or "action".
        origin: (3,) the point about which the moment deadband is taken, in the sensor's frame.
    """

    mount: Array = field(converter=own)
    mass: float
    centre: Array = field(converter=own)
    gravity: Array = field(converter=own, repr=False)
    bias: Array = field(converter=own)
    cutoff: float
    force_deadband: float
    moment_deadband: float
    reads: str
    origin: Array = field(converter=own, repr=False)

    def __init__(
        self,
        mount: ArrayLike | None = None,
        mass: float = 0.0,
        centre: ArrayLike = (0.0, 0.0, 0.0),
        gravity: ArrayLike = GRAVITY,
        bias: ArrayLike = (0.0,) * 6,
        cutoff: float = inf,
        force_deadband: float = 0.0,
        moment_deadband: float = 0.0,
        reads: Literal["reaction", "action"] = "reaction",
        origin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """A sensor; by default it sits in the tool frame, nothing hangs on it and nothing is filtered.

        Args:
            mount: (4, 4) pose of the sensor's frame in the tool frame; None is the identity.
            mass: of everything beyond the sensor [kg].
            centre: (3,) centre of that mass in the sensor's frame [length].
            gravity: (3,) in the base frame [length/s^2]; standard gravity against z by default.
            bias: (6,) reading of the unloaded sensor, (m; f).
            cutoff: of the low-pass [Hz]; inf is none.
            force_deadband: forces below this count as zero [N].
            moment_deadband: moments below this, about `origin`, count as zero [N length].
            reads: "reaction" is what the world does to the tool: pressing on a table reads a force upwards, the weight
                of the tool one downwards. "action" is the opposite.
            origin: (3,) the point about which the moment deadband is taken, in the sensor's frame.

        Raises:
            BadInput: NaN, shapes, a negative mass, cut-off or deadband.
        """
        self.__attrs_init__(
            mount=np.eye(4) if mount is None else arrays.pose(mount, "mount"),
            mass=arrays.not_negative(mass, "mass", "a number in kg"),
            centre=arrays.vector(centre, 3, "centre"),
            gravity=arrays.vector(gravity, 3, "gravity"),
            bias=arrays.vector(bias, 6, "bias"),
            cutoff=arrays.number(cutoff, "cutoff", "a frequency in Hz, or inf,", positive=True, infinite=True),
            force_deadband=arrays.not_negative(force_deadband, "force_deadband", "a number in N"),
            moment_deadband=arrays.not_negative(moment_deadband, "moment_deadband", "a number in N m"),
            reads=arrays.choice(reads, "reads", ("reaction", "action")),
            origin=arrays.vector(origin, 3, "origin"),
        )

    def tare(self, tool: ArrayLike) -> Array:
        """(6,) what the sensor reads with nothing touching the tool, at a (4, 4) tool pose in the base frame."""
        R = arrays.pose(tool, "tool")[:3, :3].dot(self.mount[:3, :3])
        f = self.mass * R.T.dot(self.gravity)
        weight = np.concatenate((se3.cross(self.centre, f), f))
        reading: Array = self.bias + (weight if self.reads == "reaction" else -weight)
        return reading

    def load(self, reading: ArrayLike, tool: ArrayLike) -> Array:
        """(6,) the wrench that the tool exerts, in the sensor's frame: the reading without bias and weight.

        Raises:
            BadInput: NaN, shapes.
        """
        load: Array = arrays.vector(reading, 6, "reading") - self.tare(tool)
        return -load if self.reads == "reaction" else load

    def in_base(self, wrench: ArrayLike, tool: ArrayLike) -> Array:
        """(6,) a wrench given in the sensor's frame, in the base frame, its moment about the base's origin."""
        T = arrays.pose(tool, "tool").dot(self.mount)
        there: Array = se3.coadjoint(T, check=False).dot(arrays.vector(wrench, 6, "wrench"))
        return there

    def wrench(self, reading: ArrayLike, tool: ArrayLike) -> Array:
        """(6,) the wrench that the tool exerts, base frame: bias, weight and deadbands taken off, not smoothed.

        Raises:
            BadInput: NaN, shapes.
        """
        return self.in_base(self.deadband(self.load(reading, tool)), tool)

    def deadband(self, wrench: ArrayLike) -> Array:
        """(6,) a wrench in the sensor's frame after the deadbands.

        Raises:
            BadInput: NaN, shapes.
        """
        w = arrays.vector(wrench, 6, "wrench")
        if self.force_deadband == 0.0 and self.moment_deadband == 0.0:
            return w
        f = w[3:]
        m = w[:3] - se3.cross(self.origin, f)
        f = soft(f, self.force_deadband)
        return np.concatenate((soft(m, self.moment_deadband) + se3.cross(self.origin, f), f))

    def relabelled(self, offset: ArrayLike | None = None, tool_offset: ArrayLike | None = None) -> WrenchSensor:
        """The same sensor in other frames: its own displaced by `offset` in itself, the tool's by `tool_offset`.

        Raises:
            BadInput: not finite (4, 4) rigid motions.
        """
        X = np.eye(4) if offset is None else arrays.pose(offset, "offset")
        Y = np.eye(4) if tool_offset is None else arrays.pose(tool_offset, "tool_offset")
        back = se3.inverse(X, check=False)
        return evolve(
            self,
            mount=se3.inverse(Y, check=False).dot(self.mount).dot(X),
            centre=back[:3, :3].dot(self.centre) + back[:3, 3],
            origin=back[:3, :3].dot(self.origin) + back[:3, 3],
            bias=se3.coadjoint(back, check=False).dot(self.bias),
        )


class Smoothing(NamedTuple):
    """The state of a low-pass: its owner replaces it by what `after` returns, once in every tick.

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
    """The vector shortened by `width`, zero where it is shorter: continuous, and the same for axes of any direction."""
    length = float(np.sqrt(vector.dot(vector)))
    share = 1.0 - width / length if length > width else 0.0
    shortened: Array = vector * share
    return shortened
