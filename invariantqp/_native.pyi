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

class Split:
    presses: int  # how many of the first constraints are presses
    constraints: Array  # (n, 6) W', wrenches
    motion: Array  # (6, 6) P
    force: Array  # (6, 6) P*
    intensities: Array  # (n, 6) from a wrench to its parts
    unit_parts: Array  # (n, 6) from a wrench to its unit parts
    unit_rates: Array  # (n, 6) from a twist to its unit rates
    twist: Array  # (6, n) from unit rates to the twist along Z
    gain: float  # of a compliance that is given
    exert: Array  # (6,) the task's own W_d
    load_force: float  # of that
    load_moment: float  # of that about the place of contact
    out: Array | None  # (6,) unit twist that leads out
    origin: Array  # (3,) the place of contact
    def __init__(
        self,
        *,
        presses: int | None = None,
        constraints: Array,
        motion: Array,
        force: Array,
        intensities: Array,
        unit_parts: Array,
        unit_rates: Array,
        twist: Array,
        gain: float | None = None,
        exert: Array,
        load_force: float | None = None,
        load_moment: float | None = None,
        out: Array | None = None,
        origin: Array,
    ) -> None: ...

class Press:
    moment_first: bool  # whether readings are
    mount: Array | None  # (4, 4) pose of the sensor in the tool frame; None is a wrench in the base frame
    reaction: bool  # whether it reads what the world does to the tool
    mass: float  # of everything beyond the sensor [kg]
    centre: Array  # (3,) of that mass [length]
    gravity: Array  # (3,) in the base frame [length/s^2]
    bias: Array  # (6,) reading of the unloaded sensor
    force_deadband: float  # [N]
    moment_deadband: float  # about `origin` [N length]
    origin: Array  # (3,) in the sensor's frame [length]
    noise: float  # standard deviation of a force component [N]
    share: float  # of a step that the low-pass passes on in a tick
    filter_time: float  # its time constant [s]
    size: float  # over what the contact spreads [length]
    slope: float  # how steep the surface may be beside the declared one
    yields: float  # how far the surface may move [length]
    stiffness: float  # where the estimate begins; 0 is none declared [force/length]
    has_compliance: bool  # whether the gain is given
    lost_below: float  # press below which contact is lost; -1 is a share of the wanted one [N]
    lost_after: float  # for how long [s]
    on_loss: Literal["approach", "hold", "retreat", "continue"]  # what is done then
    approach_speed: float  # the most towards and into a contact [length/s]
    approach_distance: float  # way towards the contact without feeling it [length]
    approach_time: float  # likewise [s]
    slide_speed: float  # of an error of the target along the contact [length/s]
    max_force: float  # that is an overload; -1 is a multiple of the wanted one [N]
    max_moment: float  # likewise [N length]
    grip: Array  # (3,) where the tool holds what it moves, in the tool frame [length]
    retreat_distance: float  # [length]
    force_first: bool  # whether the force part of a twist is met exactly
    at_contact: bool  # whether twists are measured at the place of contact
    def __init__(
        self,
        *,
        moment_first: bool | None = None,
        mount: Array | None = None,
        reaction: bool | None = None,
        mass: float | None = None,
        centre: Array | None = None,
        gravity: Array | None = None,
        bias: Array | None = None,
        force_deadband: float | None = None,
        moment_deadband: float | None = None,
        origin: Array | None = None,
        noise: float | None = None,
        share: float | None = None,
        filter_time: float | None = None,
        size: float,
        slope: float,
        yields: float | None = None,
        stiffness: float | None = None,
        has_compliance: bool | None = None,
        lost_below: float | None = None,
        lost_after: float | None = None,
        on_loss: Literal["approach", "hold", "retreat", "continue"] | None = None,
        approach_speed: float,
        approach_distance: float | None = None,
        approach_time: float | None = None,
        slide_speed: float | None = None,
        max_force: float | None = None,
        max_moment: float | None = None,
        grip: Array | None = None,
        retreat_distance: float,
        force_first: bool | None = None,
        at_contact: bool | None = None,
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
def contact_frame(point: Any, normal: Any, tangent: Any, /) -> Array | None: ...
def pseudoinverse(J: Array, h: float, /) -> Array | None: ...
def projectors(
    S: Any, wrenches: Any, h: Any, complement: Any, metric: Any, /
) -> tuple[Array, Array, Array, Array, Array, float, float] | None: ...
def acts_at(loop: Loop, memory: Array, q: Any, /) -> Array | None: ...
def step(
    loop: Loop, memory: Array, q: Any, target: Any, feedforward: Any, velocity: Any, /
) -> tuple[VelocitySolution, bool] | None: ...
def sight(
    screws: Array, home: Array, q: Array, target: Array | None, /
) -> tuple[Array, Array, Array | None] | None: ...
