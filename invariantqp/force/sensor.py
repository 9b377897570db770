"""From the reading of a wrench sensor to the wrench that the tool exerts, in the base frame.

    W = -Ad*_{base<-sensor} deadband(filtered(reading - bias - weight(R)))

    weight    (c x R'g m; R'g m), c the centre of mass in the sensor's frame
    deadband  soft thresholds, f max(0, 1 - d/|f|), of forces and moments
    filtered  first-order low-pass, y += (1 - exp(-2 pi f_c dt)) (x - y)

The formulas are the engine's (`core/hybrid.cpp`). All but the change of frame happens in the sensor's frame, where a
constant press stays constant while the tool moves.
"""

from __future__ import annotations

from math import inf
from typing import Any, Literal

import numpy as np
from attrs import evolve, field, frozen
from numpy.typing import ArrayLike

from invariantqp.engine import law
from invariantqp.errors import BadInput, written
from invariantqp.force.free_air import TURNED, gravity_spread, identify_sensor
from invariantqp.force.wrench import Order, by_name, order_of, ordered, wrench_of
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared, Value, own

# Standard gravity in a base frame whose z points up [m/s^2].
GRAVITY = (0.0, 0.0, -9.80665)
# `check` needs at least so many poses: three numbers of gravity and a bias.
FEWEST_POSES = 3
# Directions of gravity are different if their spread in two directions is at least this share of it.
SPREAD = 0.1


@frozen(eq=False, slots=False)
class SensorCheck(Compared):
    """What readings in free air show of a sensor.

    Attributes:
        agrees: whether they fit the declared sensor.
        found: order, sign, mass, and the differences, in words.
        sensor: the sensor with the order, sign, mass, centre and bias that were found; None without enough information.
    """

    agrees: bool
    found: str
    sensor: WrenchSensor | None


@frozen(init=False, eq=False, repr=False, slots=False)
class WrenchSensor(Value):
    """Mount, load and filter of a wrench sensor.

    Attributes: as the arguments, with `bias` as (6,) moment first.
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
    drift: float
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
        noise: float = 0.2,
        drift: float = 0.003,
        origin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """A sensor. Mount, order and sign have no default: with a wrong one the force law is unstable.

        Args:
            mount: (4, 4) pose of the sensor's frame in the tool frame, `np.eye(4)` if they are the same.
            order: of plain (6,) readings: "force first" (ROS drivers, Pinocchio's arrays, most sensors) or "moment
                first" (as everywhere in this library); None if readings have named parts: `iq.Wrench`,
                `pinocchio.Force`, `geometry_msgs/Wrench`.
            reads: "reaction" is the wrench on the tool: pressing on a table reads a force upwards, the weight of the
                tool one downwards. "action" is the opposite.
            mass: of everything beyond the sensor [kg].
            centre: (3,) centre of that mass in the sensor's frame [length].
            gravity: (3,) in the base frame [length/s^2]; standard gravity against z by default.
            bias: reading of the unloaded sensor, in its order; None is zero.
            cutoff: of the low-pass [Hz]; inf is none.
            force_deadband: forces below this count as zero [N].
            moment_deadband: moments below this, about `origin`, count as zero [N length].
            noise: standard deviation of a force component [N], by default of a small wrist sensor. Contact and its loss
                are decided against it, and a sensor with noise whose reading does not change is stale; 0 for a
                simulated sensor without noise.
            drift: of the bias [N/s], by default 10 N an hour, of a sensor that warms up; times the time since the last
                tare it bounds the error of the press.
            origin: (3,) the point about which the moment deadband is taken, in the sensor's frame.

        Raises:
            BadInput: NaN, shapes, an unknown order or sign, a negative mass, noise, cut-off or deadband.
        """
        checked = order_of(order)
        self.__attrs_init__(
            mount=arrays.pose(mount, "mount"),
            order=checked,
            reads=arrays.choice(reads, "reads", ("reaction", "action")),
            mass=arrays.not_negative(mass, "mass", "a number in kg"),
            centre=arrays.vector(centre, 3, "centre"),
            gravity=arrays.vector(gravity, 3, "gravity"),
            bias=np.zeros(6) if bias is None else wrench_of(bias, checked, "bias"),
            cutoff=arrays.number(cutoff, "cutoff", "a frequency in Hz or inf", positive=True, infinite=True),
            force_deadband=arrays.not_negative(force_deadband, "force_deadband", "a number in N"),
            moment_deadband=arrays.not_negative(moment_deadband, "moment_deadband", "a number in N m"),
            noise=arrays.not_negative(noise, "noise", "a number in N"),
            drift=arrays.not_negative(drift, "drift", "a number in N/s"),
            origin=arrays.vector(origin, 3, "origin"),
        )

    def fields(self) -> dict[str, Any]:
        """The sensor as the engine takes it."""
        names = "mount", "mass", "centre", "gravity", "origin", "bias", "reads", "force_deadband", "moment_deadband"
        return {name: getattr(self, name) for name in names}

    def tare(self, tool: ArrayLike) -> Array:
        """(6,) the reading without contact at a (4, 4) tool pose in the base frame, in the sensor's order.

        A sensor without an order gives the moment first.
        """
        load = load_of(self, np.zeros(6), arrays.pose(tool, "tool"))
        return ordered(load if self.reads == "reaction" else -load, self.order)

    def load(self, reading: Any, tool: ArrayLike) -> Array:
        """(6,) (m; f) the wrench that the tool exerts, in the sensor's frame: the reading without bias and weight.

        Raises:
            BadInput: numbers without an order, NaN, shapes.
        """
        return load_of(self, wrench_of(reading, self.order, "reading"), arrays.pose(tool, "tool"))

    def check(self, readings: ArrayLike, poses: ArrayLike) -> SensorCheck:
        """Find order, sign, weight and mount from readings without contact, and compare them with this sensor.

        Args:
            readings: (n, 6) in the sensor's order, n >= 3.
            poses: (n, 4, 4) of the tool in the base frame, at different tilts.

        Raises:
            BadInput: NaN, shapes, or poses of almost the same tilt.
        """
        R = arrays.array(readings, "readings", "an (n, 6) matrix")
        if R.ndim != 2 or R.shape[1] != 6 or len(R) < FEWEST_POSES or not np.isfinite(R).all():
            raise BadInput("readings", f"shape {R.shape} or NaN", f"finite (n, 6) with n >= {FEWEST_POSES}")
        T = arrays.array(poses, "poses", "(n, 4, 4) poses")
        if T.shape != (len(R), 4, 4):
            raise BadInput("poses", f"shape {T.shape}", f"({len(R)}, 4, 4), one a reading")
        tools = [arrays.pose(pose, f"poses[{k}]") for k, pose in enumerate(T)]
        g = np.array([(tool[:3, :3].dot(self.mount[:3, :3])).T.dot(self.gravity) for tool in tools])
        if gravity_spread(g) < SPREAD:
            remedy = "Turn the tool by 30 degrees or more about two horizontal axes."
            raise BadInput("poses", "tools turned almost alike against gravity", "different tilts", remedy)
        found = identify_sensor(R, g)
        if found is None:
            return SensorCheck(
                False, "no weight explains the readings: they vary too little, or something touches", None
            )
        differences = found.differences(self.order, self.reads, self.mass)
        words = "; ".join((f"{found.order}, {found.reads}, {written(found.mass)} kg", *differences))
        if found.turn > TURNED:
            return SensorCheck(False, words, None)
        order, reads, mass, centre, bias, *_ = found
        found_sensor = evolve(self, order=order, reads=reads, mass=mass, centre=centre, bias=by_name(bias))
        return SensorCheck(not differences, words, found_sensor)

    def in_base(self, wrench: ArrayLike, tool: ArrayLike) -> Array:
        """(6,) a wrench in the sensor's frame, expressed in the base frame."""
        T = arrays.pose(tool, "tool").dot(self.mount)
        there: Array = se3.coadjoint(T, check=False).dot(arrays.vector(wrench, 6, "wrench"))
        return there

    def wrench(self, reading: ArrayLike, tool: ArrayLike) -> Array:
        """(6,) the wrench that the tool exerts, base frame: without bias, weight and deadbands, not filtered.

        Raises:
            BadInput: NaN, shapes.
        """
        return self.in_base(self.deadband(self.load(reading, tool)), tool)

    def deadband(self, wrench: ArrayLike) -> Array:
        """(6,) a wrench in the sensor's frame after the deadbands.

        Raises:
            BadInput: NaN, shapes.
        """
        shortened: Array = law.sensor_deadband(self.fields(), arrays.vector(wrench, 6, "wrench"))
        return shortened

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


def load_of(sensor: WrenchSensor, reading: Array, tool: Array) -> Array:
    """(6,) `WrenchSensor.load` of a checked reading, moment first."""
    load: Array = law.sensor_load(sensor.fields(), reading, tool)
    return load
