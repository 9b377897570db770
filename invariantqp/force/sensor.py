"""From a wrench sensor's reading to what the law needs: the wrench that the tool exerts, in the base frame.

    W = -Ad*_{base<-sensor} deadband(smooth(reading - bias - weight(R)))

    weight    (c x R'g m; R'g m), c the tool's centre of mass in the sensor's frame
    deadband  soft thresholds, f max(0, 1 - d/|f|): continuous, forces and moments apart
    smooth    first-order low-pass, y += (1 - exp(-2 pi f_c dt)) (x - y)

A reading comes with its order, its sign and its frame said: `order`, `reads`, `mount`. Six plain numbers do not tell
them: read the wrong way round, a press of 5 N is one of 0.1 N. `WrenchSensor.check` finds all three from readings in
free air,

    forces    f_k = b_f + a g_k,         a = m for reactions, -m for actions,   g_k gravity in the sensor's frame
    moments   m_k = b_m + d x g_k,       d = a c

which are linear in their unknowns. The coadjoint changes moments with the point they are about: a wrist sensor 100 mm
off the tip reads moments that the tip does not feel. Everything but the last step happens in the sensor's frame, where
the wrench of a steady press does not change while the tool travels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import inf
from numbers import Real
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from attrs import evolve, field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, excerpt, written
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared, Value, own

Order = Literal["moment first", "force first"]
ORDERS: tuple[str, ...] = get_args(Order)

# What the parts are called: here, in ROS (geometry_msgs/Wrench), in Pinocchio.
MOMENT_NAMES = ("moment", "torque", "angular")
FORCE_NAMES = ("force", "linear")


@frozen(init=False, eq=False, repr=False, slots=False)
class Wrench(Value):
    """A moment about the origin of a frame and a force.

    Attributes:
        moment: (3,) [N length].
        force: (3,) [N].
    """

    moment: Array = field(converter=own)
    force: Array = field(converter=own)

    def __init__(self, *, moment: ArrayLike, force: ArrayLike) -> None:
        """A wrench.

        Args:
            moment: (3,) about the frame's origin [N length].
            force: (3,) [N].

        Raises:
            BadInput: NaN, shapes.
        """
        self.__attrs_init__(arrays.vector(moment, 3, "moment"), arrays.vector(force, 3, "force"))


def wrench_of(reading: Any, order: str | None, argument: str) -> Array:
    """(6,) moment first, from a reading whose order is said by names or by a word.

    Args:
        reading: a `Wrench`, a `pinocchio.Force`, a `geometry_msgs/Wrench` or what carries one in `.wrench`, a mapping
            with the same names, or (6,) numbers in `order`.
        order: of plain numbers; None refuses them.
        argument: how the caller calls it.

    Raises:
        BadInput: numbers without an order, NaN, shapes.
    """
    if are_numbers(reading):
        numbers = arrays.vector(reading, 6, argument)
        if order is None:
            raise BadInput(
                argument,
                "six numbers whose order is not said",
                'a sensor with order="moment first" or order="force first", or iq.Wrench(moment=..., force=...)',
                "ROS, Pinocchio's arrays and most sensors have forces first.",
            )
        return ordered(numbers, order)
    if isinstance(reading, Wrench):
        return np.concatenate((reading.moment, reading.force))
    whole = _part(reading, ("wrench",))
    named = reading if whole is None else whole
    moment, force = _part(named, MOMENT_NAMES), _part(named, FORCE_NAMES)
    if moment is None or force is None:
        expected = (
            "iq.Wrench(moment=..., force=...), pinocchio.Force, a geometry_msgs/Wrench, or six numbers in an order"
        )
        raise BadInput(argument, excerpt(reading), expected)
    return np.concatenate((_vector(moment, argument), _vector(force, argument)))


def ordered(wrench: Array, order: str | None) -> Array:
    """(6,) moment first from numbers in an order, or the other way round; None is moment first."""
    return np.concatenate((wrench[3:], wrench[:3])) if order == "force first" else wrench


def by_name(wrench: Array) -> Wrench:
    """A `Wrench` from (6,) moment first."""
    return Wrench(moment=wrench[:3], force=wrench[3:])


def wanted_of(wrench: Any, constraints: Callable[[], int], argument: str = "wrench") -> Array:
    """(6,) (m; f) of a `Wrench` or what `wrench_of` takes by name, or (n,) parts in a contact's constraints.

    Args:
        wrench: as above; six numbers are the parts of a contact with six constraints.
        constraints: how many the contact has; asked where six numbers are given.
        argument: how the caller calls it.

    Raises:
        BadInput: NaN, shapes; six numbers for a contact with fewer constraints, unless all are zero: whether these are
            a wrench, and in which order, is not said.
    """
    if isinstance(wrench, Real):
        raise BadInput(argument, excerpt(wrench), "a list, one number a constraint of the contact, such as [5.0]")
    if are_numbers(wrench):
        parts = arrays.vector(wrench, None, argument)
        if len(parts) == 6 and parts.any() and constraints() != 6:
            wrench_of(parts, None, argument)
        return parts
    return wrench_of(wrench, None, argument)


def order_of(order: str | None, argument: str = "order") -> str | None:
    """A checked order: one of ORDERS, or None where wrenches come by name.

    Raises:
        BadInput: another word.
    """
    return None if order is None else arrays.choice(order, argument, ORDERS)


def are_numbers(value: Any) -> bool:
    """Whether a value is numbers in a row: a NumPy array, a list, an `array.array` as fields of ROS 2 messages are."""
    return isinstance(value, (np.ndarray, Sequence)) and not isinstance(value, str)


def _part(value: Any, names: tuple[str, ...]) -> Any:
    """The part of one of these names, of a mapping or an object; None where it has none."""
    for name in names:
        part = value.get(name) if isinstance(value, Mapping) else getattr(value, name, None)
        if part is not None:
            return part
    return None


def _vector(part: Any, argument: str) -> Array:
    """(3,) from numbers, or from x, y, z by name."""
    by_name = [_part(part, (axis,)) for axis in "xyz"]
    return arrays.vector(part if None in by_name else by_name, 3, argument)


# Standard gravity in a base frame whose z points up [m/s^2].
GRAVITY = (0.0, 0.0, -9.80665)
# Standard deviation of a force component where nobody says it [N]: that of small wrist sensors.
NOISE = 0.2
# Drift of the bias where nobody says it [N/s]: 10 N an hour, warming up.
DRIFT = 0.003
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
        drift: of the bias [N/s].
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
        noise: float = NOISE,
        drift: float = DRIFT,
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
            drift: of the bias [N/s]: the press may be off by so much times the time since the sensor was tared, in the
                air before the touch.
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
            drift=arrays.not_negative(drift, "drift", "a number in N/s"),
            origin=arrays.vector(origin, 3, "origin"),
        )

    def fields(self) -> dict[str, Any]:
        """The sensor as the engine takes it."""
        names = "mount", "mass", "centre", "gravity", "origin", "bias", "reads", "force_deadband", "moment_deadband"
        return {name: getattr(self, name) for name in names}

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


def _unloaded(sensor: WrenchSensor, pose: Array) -> Array:
    """(6,) moment first, what the sensor at a (4, 4) pose reads with nothing touching the tool."""
    if sensor.mass == 0.0:
        return sensor.bias.copy()
    f = sensor.mass * pose[:3, :3].T.dot(sensor.gravity)
    weight = np.concatenate((se3.cross(sensor.centre, f), f))
    reading: Array = sensor.bias + (weight if sensor.reads == "reaction" else -weight)
    return reading


def soft(vector: Array, width: float) -> Array:
    """The vector shortened by `width`, zero where it is shorter: continuous, and the same for axes of any direction."""
    length = float(np.sqrt(vector.dot(vector)))
    share = 1.0 - width / length if length > width else 0.0
    shortened: Array = vector * share
    return shortened


# Directions of gravity count as different where their spread in two directions is at least this share of it.
SPREAD = 0.1
# A fit that leaves less than this share of the readings' variation explains them.
EXPLAINED = 0.1
# Found and said may differ by this: an angle of the mount [rad], a share of the mass.
TURNED = 0.1
MASS_SHARE = 0.2
# Variations of a force below this are noise [N]. Moments are as noisy as forces this way off [length]: the ranges of
# wrist sensors are to each other as 0.05 to 0.1 m.
NOTHING = 1e-6
LEVER = 0.05


class FreeAir(NamedTuple):
    """What readings in free air are explained by.

    Attributes:
        order: "moment first" or "force first".
        reads: "reaction" or "action".
        mass: of what hangs on the sensor [kg].
        centre: (3,) of it in the sensor's frame [length].
        bias: (6,) (m; f) of the unloaded sensor.
        turn: by how much the sensor's frame is turned from where it was said to be [rad].
        left: share of the readings' variation that stays unexplained, forces and moments.
    """

    order: Order
    reads: Literal["reaction", "action"]
    mass: float
    centre: Array
    bias: Array
    turn: float
    left: tuple[float, float]

    def differences(self, order: str | None, reads: str, mass: float) -> list[str]:
        """What differs from what the sensor is said to be, in words."""
        wrong = []
        if order is not None and self.order != order:
            wrong.append(f"its order is {self.order!r}, not {order!r}")
        if self.reads != reads:
            wrong.append(f"it reads the {self.reads}, not the {reads}")
        if self.turn > TURNED:
            wrong.append(f"its frame is turned by {written(np.degrees(self.turn), 3)} deg from mount")
        if abs(self.mass - mass) > MASS_SHARE * self.mass:
            wrong.append(f"{written(self.mass)} kg hang on it, not {written(mass)}")
        if self.left[1] > EXPLAINED and not wrong:
            wrong.append("its moments fit no centre of mass")
        return wrong


def spread(gravity: Array) -> float:
    """How much directions of gravity (n, 3) in the sensor's frame differ: the second largest spread, relative."""
    sizes = np.linalg.svd(gravity - gravity.mean(axis=0), compute_uv=False)
    return float(sizes[1] / np.sqrt(len(gravity)) / np.linalg.norm(gravity[0])) if len(sizes) > 1 else 0.0


def explained(readings: Array, gravity: Array) -> FreeAir | None:
    """The better of both orders; None where neither explains the readings.

    Args:
        readings: (n, 6) as the sensor gives them.
        gravity: (n, 3) in the sensor's frame [length/s^2].
    """
    first, last = readings[:, :3], readings[:, 3:]
    found = [_fit("moment first", first, last, gravity), _fit("force first", last, first, gravity)]
    best = min(found, key=lambda fit: fit.left[0])
    return best if best.left[0] < EXPLAINED else None


def _fit(order: Order, moments: Array, forces: Array, gravity: Array) -> FreeAir:
    n = len(gravity)
    f, g = forces - forces.mean(axis=0), gravity - gravity.mean(axis=0)
    scale = float(np.vdot(f, f))
    a = float(np.vdot(f, g) / np.vdot(g, g))
    left = float(np.vdot(f - a * g, f - a * g)) / scale if scale > n * NOTHING**2 else np.inf
    turn, mean = 0.0, gravity.mean(axis=0)
    if left >= EXPLAINED and np.isfinite(left):  # perhaps the sensor is not mounted as it was said
        from scipy.spatial.transform import Rotation  # a tenth of a second to import, for this alone

        for sign in (1.0, -1.0):
            R, _ = Rotation.align_vectors(f, sign * (gravity - gravity.mean(axis=0)))
            turned = (gravity - gravity.mean(axis=0)).dot(R.as_matrix().T)
            b = float(np.vdot(f, turned) / np.vdot(g, g))
            rest = float(np.vdot(f - b * turned, f - b * turned)) / scale
            if rest < min(left, EXPLAINED):
                left, turn, a, g, mean = rest, float(R.magnitude()), b, turned, R.apply(gravity.mean(axis=0))
    # m_k - mean = d x g_k: linear in d.
    m = moments - moments.mean(axis=0)
    A = -np.concatenate([se3.cross_matrix(row) for row in g])
    d = np.linalg.lstsq(A, m.ravel(), rcond=None)[0]
    missed = m.ravel() - A.dot(d)
    unexplained = max(float(missed.dot(missed)) - LEVER * LEVER * left * scale, 0.0)
    size = float(np.vdot(m, m))
    bias_f = forces.mean(axis=0) - a * mean
    bias_m = moments.mean(axis=0) - se3.cross(d, mean)
    return FreeAir(
        order=order,
        reads="reaction" if a > 0.0 else "action",
        mass=abs(a),
        centre=d / a if a != 0.0 else np.zeros(3),
        bias=np.concatenate((bias_m, bias_f)),
        turn=turn,
        left=(left, unexplained / size if size > 0.0 else 0.0),
    )
