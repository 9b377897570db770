# The compiled core; its sources are in csrc/.
from typing import Any

import numpy as np
from numpy.typing import NDArray

from invariantqp.control.path_state import PathState
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.law import Policy
from invariantqp.velocity.solution import Status, VelocitySolution

CONSTANTS: dict[str, float]
MOST_JOINTS: int
MOST_ROWS: int
RECORD: int

def answer_as(kind: type[VelocitySolution], statuses: type[Status], /) -> None: ...
def tick(
    J: Array,
    s: Array,
    root: Array,
    lower: Array,
    upper: Array,
    posture: Array | None,
    dt: float,
    policy: Policy,
    exact: tuple[Array, Array, Array | None, int | None] | None,
    cone: tuple[Array, float, Array] | None,
    limits: tuple[Array, Array, Array] | None,
    metric: tuple[Array | None, Array | None] | None,
    /,
) -> VelocitySolution | None: ...
def ticks(
    J: Array,
    s: Array,
    roots: Array,
    lower: Array,
    upper: Array,
    posture: Array | None,
    velocity: Array,
    residual: Array,
    record: NDArray[np.int32],
    method: NDArray[np.str_],
    status: NDArray[np.str_],
    numbers: Array,
    records: Array,
    policy: Policy,
    metric: tuple[Array | None, Array | None] | None,
    taken: NDArray[np.int32],
    size: int,
    /,
) -> None: ...
def solution(record: Array, /) -> VelocitySolution: ...
def optimum(
    K: Array,
    T: Array,
    centre: Array,
    A: Array | None,
    lower: Array,
    upper: Array,
    cone: tuple[Array, float, Array] | None,
    inside: Array,
    /,
) -> tuple[Array, Array, float] | None: ...
def cost(J: Array, s: Array, root: Array, policy: Policy, more: float, /) -> tuple[Array, Array] | None: ...
def loop(
    numbers: Array,
    point: Array,
    fast: Array,
    home: Array,
    screws: Array,
    low: Array,
    high: Array,
    fastest: Array,
    middle: Array,
    pull: Array,
    position_lower: Array,
    position_upper: Array,
    acceleration: Array,
    exact: Array,
    rows: Array,
    rows_lower: Array,
    rows_upper: Array,
    to_joint: Array,
    from_joint: Array,
    policy: Policy,
    root: Array,
    /,
) -> Array: ...
def step(
    loop: Array, memory: Array, q: Any, target: Any, feedforward: Any, velocity: Any, /
) -> tuple[VelocitySolution, bool] | None: ...
def drive(
    loop: Array,
    memory: Array,
    course: Array,
    q: Any,
    state: tuple[Any, ...],
    velocity: Any,
    override: Any,
    paused: bool,
    back: bool,
    /,
) -> tuple[VelocitySolution, PathState, float, float, float, int, str, bool] | None: ...
def arm(
    numbers: Array,
    point: Array,
    home: Array,
    screws: Array,
    lower: Array,
    upper: Array,
    turn: Array,
    whole: Array,
    exact: Array,
    /,
) -> Array: ...
def descend(
    arm: Array, target: Any, start: Array, goal: float, turning: bool, patient: bool, known: Array | None, /
) -> tuple[Array, float, float, float, int, bool, bool, Array | None] | None: ...
def misses(arm: Array, target: Any, q: Array, /) -> tuple[float, float] | None: ...
def clearance(
    screws: Array, q: Array, shapes: Array, twists: Array, pairs: Array, speeds: Array, settings: Array, /
) -> tuple[Array, Array, Array, Array] | None: ...
def sight(
    screws: Array, home: Array, q: Array, target: Array | None, /
) -> tuple[Array, Array, Array | None] | None: ...
