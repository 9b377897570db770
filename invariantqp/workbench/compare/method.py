"""A method of the comparison, and what every method is given. Imported in environments with NumPy alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from typing import Any, NamedTuple, Protocol

import numpy as np

from invariantqp.geometry.arrays import Array

# The name of our method.
OURS = "invariantqp"
# Modules with a list METHODS. Environments of their own have methods of the last module.
MODULES = tuple(f"invariantqp.workbench.compare.{name}" for name in ("ours", "by_hand", "libraries"))
# Methods of this family have settings that are not the best; they are measured only by name.
OTHER_SETTINGS = "other settings"
FAMILIES = ("ours", "by hand", "library", OTHER_SETTINGS)


@dataclass(frozen=True, eq=False)
class LoopSpec:
    """An arm and a control loop, as every method is given them; m joints, SI units, base frame, angular part first."""

    names: tuple[str, ...]  # of the joints, base first
    screws: Array  # (6, m) joint twists at q = 0
    home: Array  # (4, 4) tool pose at q = 0
    lower: Array  # (m,) position limits [rad, m], infinite where there are none
    upper: Array  # (m,)
    velocity_limit: Array  # (m,)
    posture: Array  # (m,) joint positions to stay near
    posture_gain: Array  # (m,) towards these [1/s], zero where there is no posture; libraries use the largest
    dt: float  # duration of a tick [s]
    gain: float  # of the tracking error [1/s]
    acceleration_limit: Array | None  # (m,) [rad/s^2, m/s^2]
    point: Array  # (3,) the point of the tool where accuracy counts, in the tool frame [m]
    length: float  # the arm's reach to it [m]: what a radian may count for
    urdf: str  # the arm as text, its tool frame as the link "tool"; "" where it has helical joints
    law: dict[str, Any]  # the [law] table of a task file: what else our own law is given

    def as_json(self) -> dict[str, Any]:
        """As numbers, lists and strings."""
        return {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in asdict(self).items()}

    @staticmethod
    def from_json(content: dict[str, Any]) -> LoopSpec:
        """The inverse of `as_json`."""
        arrays = {field.name for field in fields(LoopSpec) if "Array" in str(field.type)}
        values: dict[str, Any] = {
            key: np.array(value, np.float64) if key in arrays and value is not None else value
            for key, value in content.items()
        }
        return LoopSpec(**values)


class MethodLoop(Protocol):
    """A method's control loop, made from a `LoopSpec`."""

    def target(self, pose: Array, feedforward: Array | None) -> Any:
        """The target that `step` takes, of a tool pose (4, 4) and its twist (6,); not timed."""

    def step(self, q: Array, target: Any, feedforward: Array | None, previous: Array) -> Array:
        """The joint velocities (m,) of a tick; `previous` are those of the tick before."""


# Entries of the table of settings: how a method keeps limits.
IN_QP, SCALES = "in the QP", "inside; the twist is scaled"


class MethodSetting(NamedTuple):
    """How a method uses what it is given: a row of the table of settings."""

    posture: str
    limits: str
    damping: str
    feedforward: str = "added"
    point: str = "tool frame's origin"


@dataclass(frozen=True)
class Method:
    """A row of the comparison."""

    name: str
    family: str  # one of FAMILIES
    loop: Callable[[LoopSpec], MethodLoop]  # the first line of its docstring is `about`
    setting: MethodSetting
    needs: tuple[str, ...] = ()  # Python modules
    distribution: str = ""  # the package to install, whose version is reported
    environment: str = ""  # name of its own environment; "" is the current one
    accelerations: bool = True  # whether it takes acceleration limits; if not, tasks that have them leave it out
    needs_pitch: bool = False  # whether it takes only tasks with the pitch of a form
    slow: bool = False  # whether the quick form leaves it out

    def takes(self, spec: LoopSpec) -> bool:
        """Whether the method has a meaning on a task."""
        return (self.accelerations or spec.acceleration_limit is None) and (
            not self.needs_pitch or spec.law["form"] is not None
        )

    @property
    def about(self) -> str:
        """The method and its source, in one line."""
        return (self.loop.__doc__ or "").splitlines()[0].rstrip(".")
