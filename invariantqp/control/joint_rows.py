"""Limits on combinations of joint velocities in the loop: the user's rows, and limits and barriers made for Pink.

    lower <= C x <= upper                      rows of the user's, fixed or a function of q
    G x <= h / dt, rows of unit length         what a Pink limit or barrier returns, G dq <= h

Where a limit gives NaN or allows no velocity, it cannot be kept: the tick is then held, with the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import inf
from typing import Any, NamedTuple, Protocol

import numpy as np

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.velocity.limits.rows import LimitRows

Rows = LimitRows | Callable[[Array], LimitRows | None]


class PinkLimit(Protocol):
    """A limit or barrier made for Pink from `robot.model`: G dq <= h for the joint displacement dq of a tick."""

    def compute_qp_inequalities(self, configuration: Any, dt: float) -> tuple[Any, Any] | None:
        """G (k, m) and h (k,) in a `pink.Configuration` for a tick of dt [s]; None where nothing is limited now."""
        ...


_Part = tuple[Array, Array, Array]


class _Unusable(Exception):
    """The rows of this tick cannot be used; the message is the reason."""


class TickRows(NamedTuple):
    """The rows of one tick, None where there are none; and why they cannot be used, "" where they can."""

    rows: LimitRows | None
    trouble: str = ""


def joint_rows(robot: Robot, rows: Rows | None, limits: Sequence[PinkLimit], dt: float) -> JointRows | None:
    """The row limits of a loop, the user's and Pink's, None where it has none; checked as far as it can be now.

    Raises:
        BadInput: neither rows nor a function; a limit that has no inequalities; a robot without a Pinocchio model.
        MissingExtra: limits without Pink.
    """
    if rows is not None and not isinstance(rows, LimitRows) and not callable(rows):
        raise BadInput("rows", excerpt(rows), "LimitRows(C, lower, upper), or a function of q that returns it")
    if not isinstance(limits, (list, tuple)):
        raise BadInput("limits", excerpt(limits), "a list of Pink's limits or barriers")
    return JointRows(robot, rows, limits, dt) if rows is not None or limits else None


class JointRows:
    """All row limits of a loop: the user's first, then those of each of Pink's limits in turn."""

    def __init__(self, robot: Robot, rows: Rows | None, limits: Sequence[PinkLimit], dt: float) -> None:
        """As `joint_rows`."""
        self._robot = robot
        self._m = len(robot.names)
        self._rows = rows
        self._dt = dt
        self._limits = tuple(limits)
        self._configuration: Any = None
        if isinstance(rows, LimitRows):
            self._require(rows)
        for limit in self._limits:
            if not hasattr(limit, "compute_qp_inequalities"):
                raise BadInput("limits", excerpt(limit), "Pink's limits or barriers: compute_qp_inequalities(...)")
        if self._limits:
            model: Any = getattr(robot, "model", None)
            if model is None:
                raise BadInput("limits", "a robot of joint screws", "one of a URDF: Pink's limits read its model")
            from invariantqp.robots.pink import Configuration  # Pink is loaded when a limit of its kind is

            self._configuration = Configuration(model, model.createData(), np.zeros(model.nq))

    def __deepcopy__(self, memo: dict[int, Any]) -> JointRows:
        """Row limits for another loop, which shares rows and limits but has a configuration of its own."""
        return JointRows(self._robot, self._rows, self._limits, self._dt)

    def at(self, q: Array, before: Array) -> TickRows:
        """The rows at joint positions q (m,), `before` (m,) being the velocity now.

        Raises:
            BadInput: rows on another number of joints.
        """
        try:
            parts = [*self._own(q), *self._foreign(q, before)]
        except _Unusable as trouble:
            return TickRows(None, str(trouble))
        if not sum(len(part[0]) for part in parts):
            return TickRows(None)
        C, lower, upper = (np.concatenate(sides) for sides in zip(*parts, strict=True))
        return TickRows(LimitRows(C, lower, upper))

    @property
    def fixed(self) -> LimitRows | None:
        """The rows where they are the same in every tick."""
        return self._rows if isinstance(self._rows, LimitRows) and not self._limits else None

    def own(self, q: Array) -> LimitRows | None:
        """The user's rows at joint positions q (m,), None where there are none or they cannot be used."""
        try:
            part = next(self._own(q), None)
        except _Unusable:
            return None
        return None if part is None else LimitRows(*part)

    def _own(self, q: Array) -> Iterator[_Part]:
        own = self._rows
        if own is not None and not isinstance(own, LimitRows):
            try:
                own = own(q.copy())
            except BadInput as error:
                raise _Unusable(f"rows: {error}") from error
            if own is not None:
                self._require(own)
        if own is not None:
            yield np.asarray(own.C), np.asarray(own.lower), np.asarray(own.upper)

    def _foreign(self, q: Array, before: Array) -> Iterator[_Part]:
        if self._limits:
            self._configuration.update(q)
        for limit in self._limits:
            if hasattr(limit, "set_last_integration"):  # an acceleration limit
                limit.set_last_integration(before.copy(), self._dt)
            with np.errstate(invalid="ignore"):  # NaN is checked for below
                answer = limit.compute_qp_inequalities(self._configuration, self._dt)
            if answer is not None:
                yield self._part(type(limit).__name__, *answer)

    def _part(self, name: str, G: Any, h: Any) -> _Part:
        """C, lower, upper of G dq <= h."""
        C = np.array(G, dtype=np.float64).reshape(-1, np.shape(G)[-1])
        upper = np.array(h, dtype=np.float64).reshape(-1) / self._dt
        if C.shape != (len(upper), self._m):
            found = f"{name} with rows of shape {C.shape} and {len(upper)} bounds"
            raise BadInput("limits", found, f"rows on {self._m} joints", "Make it from robot.model.")
        length = np.linalg.norm(C, axis=1)
        if np.isnan(upper).any() or not np.isfinite(length).all():
            raise _Unusable(f"{name} gives NaN here")
        still = length == 0.0
        if (upper[still] < 0.0).any() or (upper == -inf).any():
            raise _Unusable(f"{name} allows no velocity at all here")
        kept = ~still & (upper < inf)
        length = length[kept]
        return C[kept] / length[:, None], np.full(len(length), -inf), upper[kept] / length

    def _require(self, rows: object) -> None:
        """Refuse what is not rows on the arm's joints."""
        if not isinstance(rows, LimitRows):
            raise BadInput("rows", type(rows).__name__, "LimitRows(C, lower, upper), or None for no limit")
        if np.shape(rows.C)[1] != self._m:
            raise BadInput("rows", f"rows on {np.shape(rows.C)[1]} joints", f"rows on {self._m}, one for each joint")
