# The compiled core; its sources are in csrc/.
from typing import Any, Literal

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.solution import Status, VelocitySolution

CONSTANTS: dict[str, float]
MOST_JOINTS: int
MOST_ROWS: int
MOST_LIMITS: int
METHODS: tuple[str, ...]
STATUSES: tuple[str, ...]

# From csrc/fields.h by csrc/stub.py:

class Law:
    threshold: float  # of damping: the share of the largest singular value below which it begins
    ceiling: float  # of damping: the share of the largest singular value that it ends at
    fixed: float  # damping everywhere [length]
    speed: float  # the joint speed from which one direction is damped by itself; 0 is none
    dt: float  # how long a velocity is held [s]
    form: Literal["least squares", "pitch", "complement", "brought"]  # what is attempted of a twist beyond the joints
    pitch: float  # of a pitch form [length/rad]
    fraction: float  # of the descent guard; -1 is none
    Z: Array  # (twists, 6) twists along which a complement projects
    T: Array | None  # (joints, joints) from y to joint velocities
    inverse: Array  # (joints, joints) of T
    def __init__(
        self,
        *,
        threshold: float | None = None,
        ceiling: float | None = None,
        fixed: float | None = None,
        speed: float | None = None,
        dt: float | None = None,
        form: Literal["least squares", "pitch", "complement", "brought"] | None = None,
        pitch: float | None = None,
        fraction: float | None = None,
        Z: Array | None = None,
        T: Array | None = None,
        inverse: Array | None = None,
    ) -> None: ...

class Wanted:
    kind: Literal["point", "axis", "plane", "joints"]  # what is met
    point: Array  # (3,) of the tool [length]
    direction: Array  # (3,) an axis of the tool, or the normal of a plane
    row: Array  # (joints,) on the joint velocity
    speed: float  # that the row asks for
    def __init__(
        self,
        *,
        kind: Literal["point", "axis", "plane", "joints"],
        point: Array | None = None,
        direction: Array | None = None,
        row: Array | None = None,
        speed: float | None = None,
    ) -> None: ...

class Loop:
    law: Law  # of its ticks
    screws: Array  # (6, joints) joint twists at q = 0
    home: Array  # (4, 4) tool pose at q = 0
    dt: float  # tick [s]
    gain: float  # of the error [1/s]
    rate: float  # at which position limits are approached [1/s]
    delay: float  # until a command shows, beyond one tick [s]
    point: Array  # (3,) of the tool, where the error is measured [length]
    length: float  # what a radian counts as there [length]
    carried: Literal["nothing", "base", "tool"]  # a metric instead of a point, fixed to the base or the tool
    root: Array  # (6, 6) of that metric
    slack: float  # of a chase: a measured twist that counts as nothing
    posture: Array | None  # (joints,) joint positions to be near where joints are free
    pull: Array  # (joints,) gains of the posture [1/s]
    change: Array  # (joints,) by how much it may change joint velocities in a tick
    position_lower: Array  # (joints,) [rad, length]
    position_upper: Array  # (joints,) [rad, length]
    turns: Array  # (joints,) a whole turn of continuous joints, 0 of others
    beyond: Array  # (joints,) how far outside it a joint's position is believed
    tip: Array  # (3,) where the tool is in the middle of the joint range [length]
    far: float  # how far away from there a target is believed [length]
    fastest: Array  # (joints,) joint speeds [rad/s, length/s]
    acceleration: Array | None  # (joints,) limits of acceleration
    brakes: Array  # (joints,) accelerations at which joints stop, whoever limits them
    rise: float  # in which they are had [s]
    fast: Array  # (3,) of the tool, a point whose speed is limited [length]
    speed_limit: float  # of that point [length/s]; 0 is none
    exact: tuple[Wanted, ...]  # what is met exactly
    row_rank: int  # how many exact rows the arm can keep in its best state; -1 is all
    G: Array  # (limits, joints) rows of limits, least <= G x <= most
    least: Array  # (limits,) -inf where there is none
    most: Array  # (limits,) inf where there is none
    joint_names: tuple[str, ...]  # of its joints, which its answers have
    row_names: tuple[str, ...]  # of those rows, likewise
    def __init__(
        self,
        *,
        law: Law,
        screws: Array,
        home: Array,
        dt: float,
        gain: float,
        rate: float,
        delay: float | None = None,
        point: Array | None = None,
        length: float | None = None,
        carried: Literal["nothing", "base", "tool"] | None = None,
        root: Array | None = None,
        slack: float | None = None,
        posture: Array | None = None,
        pull: Array | None = None,
        change: Array | None = None,
        position_lower: Array,
        position_upper: Array,
        turns: Array | None = None,
        beyond: Array,
        tip: Array | None = None,
        far: float | None = None,
        fastest: Array,
        acceleration: Array | None = None,
        brakes: Array | None = None,
        rise: float | None = None,
        fast: Array | None = None,
        speed_limit: float | None = None,
        exact: tuple[Wanted, ...] | None = None,
        row_rank: int | None = None,
        G: Array | None = None,
        least: Array | None = None,
        most: Array | None = None,
        joint_names: tuple[str, ...] | None = None,
        row_names: tuple[str, ...] | None = None,
    ) -> None: ...

def tick(
    law: Law,
    unlimited: Law = ...,
    /,
    *,
    J: Array,
    s: Array,
    root: Array | None = None,
    point: Array | None = None,
    length: float | None = None,
    lower: Array,
    upper: Array,
    posture: Array | None = None,
    fastest: Array | None = None,
    before: Array | None = None,
    change: Array | None = None,
    C: Array | None = None,
    e: Array | None = None,
    D: Array | None = None,
    row_rank: int | None = None,
    held: float | None = None,
    G: Array | None = None,
    least: Array | None = None,
    most: Array | None = None,
    cone_limit: float | None = None,
    cone_start: Array | None = None,
    cone_J: Array | None = None,
    chase_ahead: Array | None = None,
    chase_rows_ahead: Array | None = None,
    chase_lower: Array | None = None,
    chase_upper: Array | None = None,
    chase_slack: float | None = None,
    chase_apart: bool | None = None,
    brought: Array | None = None,
) -> VelocitySolution | None: ...

# By hand:
def answer_as(kind: type[VelocitySolution], statuses: type[Status], /) -> None: ...
def pseudoinverse(J: Array, h: float, /) -> Array | None: ...
def projectors(
    S: Any, wrenches: Any, h: Any, complement: Any, metric: Any, /
) -> tuple[Array, Array, Array, Array, Array, float, float] | None: ...
def acts_at(loop: Loop, memory: Array, q: Any, /) -> Array | None: ...
def step(
    loop: Loop, memory: Array, q: Any, target: Any, feedforward: Any, velocity: Any, /
) -> tuple[VelocitySolution, bool] | None: ...
def follow(
    course: Array,
    law: Loop | tuple[Any, ...],
    joints: Loop | tuple[Any, ...] | None,
    memory: Array,
    twist: Array | None,
    override: float,
    late: bool,
    ease: float,
    time: float,
    q: Any,
    sent: Array,
    seen: Array,
    shown: Array,
    response: Array | None,
    position: Array,
    velocity: Array,
    acceleration: Array,
    command: Array,
    pace: Array,
    /,
) -> tuple[Any, ...] | None: ...
def splice(course: Array, time: float, state: Array, duration: float, /) -> Array | None: ...
def planned(
    limits: Array, state: Array, times: Array, wanted: Array, calm: float, pieces: int, /
) -> tuple[Array, float]: ...
def sight(
    screws: Array, home: Array, q: Array, target: Array | None, /
) -> tuple[Array, Array, Array | None] | None: ...
