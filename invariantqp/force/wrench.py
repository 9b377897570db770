"""From a wrench sensor's reading to what the law needs: the wrench that the tool exerts, in the base frame.

    W = -Ad*_{base<-sensor} deadband(smooth(reading - bias - weight(R)))

    weight    (c x R'g m; R'g m), c the tool's centre of mass in the sensor's frame
    deadband  soft thresholds, f max(0, 1 - d/|f|): continuous, forces and moments apart
    smooth    first-order low-pass, y += (1 - exp(-2 pi f_c dt)) (x - y)

A reading comes with its order, its sign and its frame said: `order`, `reads`, `mount`. `WrenchSensor.check` finds all
three from readings in free air. The coadjoint changes moments with the point they are about: a wrist sensor 100 mm
off the tip reads moments that the tip does not feel. Everything but the last step happens in the sensor's frame,
where the wrench of a steady press does not change while the tool travels.
"""

from __future__ import annotations

from math import inf
from typing import Any, Literal

import numpy as np
from attrs import evolve, field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, written
from invariantqp.force.free_air import SPREAD, TURNED, explained, spread
from invariantqp.force.reading import Order, by_name, order_of, ordered, wrench_of
from invariantqp.force.smoothing import Smoothing, soft
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared, Value, own

# Standard gravity in a base frame whose z points up [m/s^2].
GRAVITY = (0.0, 0.0, -9.80665)
# Standard deviation of a force component where nobody says it [N]: that of small wrist sensors.
NOISE = 0.2
# Readings in free air that `check` needs at least: three numbers of gravity and a bias.
FEWEST_POSES = 3


@frozen(eq=False, slots=False)
class SensorCheck(Compared):
    """What readings in free air say of a sensor.

    Attributes:
        agrees: whether they fit what the sensor is said to be.
        found: order, sign, mass, and what disagrees, in words.
        sensor: the same sensor with order, sign, mass, centre and bias as found; None where that is not enough.
    """

    agrees: bool
    found: str
    sensor: WrenchSensor | None


@frozen(init=False, eq=False, repr=False, slots=False)
class WrenchSensor(Value):
    """Where a sensor sits, what hangs on it, and how its reading is cleaned.

    Attributes:
        mount: (4, 4) pose of the sensor's frame in the tool frame.
        order: of plain numbers, "moment first" or "force first"; None refuses plain numbers.
        reads: "reaction" or "action".
        mass: of everything beyond the sensor [kg].
        centre: (3,) centre of that mass in the sensor's frame [length].
        gravity: (3,) in the base frame [length/s^2].
        bias: (6,) reading of the unloaded sensor, (m; f).
        cutoff: of the low-pass [Hz]; inf is none.
        force_deadband: forces below this count as zero [N].
        moment_deadband: moments below this, about `origin`, count as zero [N length].
        noise: standard deviation of a force component [N].
        origin: (3,) the point about which the moment deadband is taken, in the sensor's frame.
    """

    mount: Array = field(converter=own)
    order: str | None
    reads: str
    mass: float
    centre: Array = field(converter=own)
    gravity: Array = field(converter=own, repr=False)
    bias: Array = field(converter=own)
    cutoff: float
    force_deadband: float
    moment_deadband: float
    noise: float
    origin: Array = field(converter=own, repr=False)

    def __init__(
        self,
        mount: ArrayLike,
        *,
        order: Order | None,
        reads: Literal["reaction", "action"],
        mass: float = 0.0,
        centre: ArrayLike = (0.0, 0.0, 0.0),
        gravity: ArrayLike = GRAVITY,
        bias: Any = None,
        cutoff: float = inf,
        force_deadband: float = 0.0,
        moment_deadband: float = 0.0,
        noise: float = NOISE,
        origin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """A sensor. Frame, order and sign have no default: a wrong guess presses on without end.

        Args:
            mount: (4, 4) pose of the sensor's frame in the tool frame, `np.eye(4)` where they are the same.
            order: of plain (6,) readings: "force first" (ROS drivers, Pinocchio's arrays, most sensors) or "moment
                first" (as everywhere in this library); None where readings come by name: `iq.Wrench`,
                `pinocchio.Force`, `geometry_msgs/Wrench`.
            reads: "reaction" is what the world does to the tool: pressing on a table reads a force upwards, the weight
                of the tool one downwards. "action" is the opposite.
            mass: of everything beyond the sensor [kg].
            centre: (3,) centre of that mass in the sensor's frame [length].
            gravity: (3,) in the base frame [length/s^2]; standard gravity against z by default.
            bias: reading of the unloaded sensor, as readings come; None is zero.
            cutoff: of the low-pass [Hz]; inf is none.
            force_deadband: forces below this count as zero [N].
            moment_deadband: moments below this, about `origin`, count as zero [N length].
            noise: standard deviation of a force component [N]. Contact and its loss are decided against it, and a
                sensor that has noise but reads the same for long is dead; 0 for a simulated sensor without noise.
            origin: (3,) the point about which the moment deadband is taken, in the sensor's frame.

        Raises:
            BadInput: NaN, shapes, another word, a negative mass, noise, cut-off or deadband.
        """
        said = order_of(order)
        self.__attrs_init__(
            mount=arrays.pose(mount, "mount"),
            order=said,
            reads=arrays.choice(reads, "reads", ("reaction", "action")),
            mass=arrays.not_negative(mass, "mass", "a number in kg"),
            centre=arrays.vector(centre, 3, "centre"),
            gravity=arrays.vector(gravity, 3, "gravity"),
            bias=np.zeros(6) if bias is None else wrench_of(bias, said, "bias"),
            cutoff=arrays.number(cutoff, "cutoff", "a frequency in Hz or inf", positive=True, infinite=True),
            force_deadband=arrays.not_negative(force_deadband, "force_deadband", "a number in N"),
            moment_deadband=arrays.not_negative(moment_deadband, "moment_deadband", "a number in N m"),
            noise=arrays.not_negative(noise, "noise", "a number in N"),
            origin=arrays.vector(origin, 3, "origin"),
        )

    def tare(self, tool: ArrayLike) -> Array:
        """(6,) what the sensor reads with nothing touching the tool, at a (4, 4) tool pose in the base frame.

        The numbers come in the sensor's order, moment first where it has none.
        """
        return ordered(_unloaded(self, arrays.pose(tool, "tool").dot(self.mount)), self.order)

    def load(self, reading: Any, tool: ArrayLike) -> Array:
        """(6,) (m; f) the wrench that the tool exerts, in the sensor's frame: the reading without bias and weight.

        Raises:
            BadInput: numbers without an order, NaN, shapes.
        """
        return load_of(self, wrench_of(reading, self.order, "reading"), arrays.pose(tool, "tool").dot(self.mount))

    def check(self, readings: ArrayLike, poses: ArrayLike) -> SensorCheck:
        """Find order, sign, weight and mount from readings with nothing touching the tool; compare with this sensor.

        Args:
            readings: (n, 6) as the sensor gives them, n >= 3.
            poses: (n, 4, 4) of the tool in the base frame, turned differently against gravity.

        Returns:
            SensorCheck: what was found, in words, and a sensor with it.

        Raises:
            BadInput: NaN, shapes, or poses that are turned too little.
        """
        R = arrays.array(readings, "readings", "an (n, 6) matrix")
        if R.ndim != 2 or R.shape[1] != 6 or len(R) < FEWEST_POSES or not np.isfinite(R).all():
            raise BadInput("readings", f"shape {R.shape} or NaN", f"finite (n, 6) with n >= {FEWEST_POSES}")
        T = arrays.array(poses, "poses", "(n, 4, 4) poses")
        if T.shape != (len(R), 4, 4):
            raise BadInput("poses", f"shape {T.shape}", f"({len(R)}, 4, 4), one a reading")
        tools = [arrays.pose(pose, f"poses[{k}]") for k, pose in enumerate(T)]
        g = np.array([(tool[:3, :3].dot(self.mount[:3, :3])).T.dot(self.gravity) for tool in tools])
        if spread(g) < SPREAD:
            remedy = "Turn the tool by 30 degrees or more about two horizontal axes."
            raise BadInput("poses", "tools turned almost alike against gravity", "different tilts", remedy)
        found = explained(R, g)
        if found is None:
            return SensorCheck(
                False, "no weight explains the readings: they vary too little, or something touches", None
            )
        wrong = found.differences(self.order, self.reads, self.mass)
        words = [f"{found.order}, {found.reads}, {written(found.mass)} kg", *wrong]
        sensor = None
        if found.turn <= TURNED:
            sensor = evolve(
                self,
                order=found.order,
                reads=found.reads,
                mass=found.mass,
                centre=found.centre,
                bias=by_name(found.bias),
            )
        return SensorCheck(not wrong, "; ".join(words), sensor)

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
            bias=by_name(se3.coadjoint(back, check=False).dot(self.bias)),
        )


def load_of(sensor: WrenchSensor, reading: Array, pose: Array) -> Array:
    """`WrenchSensor.load` for a reading that is checked and moment first, and the (4, 4) pose of the sensor."""
    load: Array = reading - _unloaded(sensor, pose)
    return -load if sensor.reads == "reaction" else load


def cleaned(
    sensor: WrenchSensor | None, reading: Array, tool: Array, smoothing: Smoothing
) -> tuple[Array, Array, Smoothing]:
    """The (6,) wrench that the tool exerts, base frame, raw and cleaned; and the low-pass after a reading."""
    if sensor is None:
        return reading, reading, smoothing
    pose = tool.dot(sensor.mount)
    load = load_of(sensor, reading, pose)
    smooth, after = smoothing.after(load)
    to_base = se3.coadjoint(pose, check=False)
    return to_base.dot(load), to_base.dot(sensor.deadband(smooth)), after


def _unloaded(sensor: WrenchSensor, pose: Array) -> Array:
    """(6,) moment first, what the sensor at a (4, 4) pose reads with nothing touching the tool."""
    if sensor.mass == 0.0:
        return sensor.bias.copy()
    f = sensor.mass * pose[:3, :3].T.dot(sensor.gravity)
    weight = np.concatenate((se3.cross(sensor.centre, f), f))
    reading: Array = sensor.bias + (weight if sensor.reads == "reaction" else -weight)
    return reading
