"""The compiled core. Its sources are in core/."""

from typing import Any

from invariantqp.geometry.arrays import Array

CONSTANTS: dict[str, float]

def tick(
    J: Array,
    s: Array,
    root: Array,
    lower: Array,
    upper: Array,
    posture: Array | None,
    dt: float,
    policy: tuple[float, float, float],
) -> tuple[Any, ...] | None: ...
