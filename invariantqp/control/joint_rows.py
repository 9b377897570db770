"""Limits on combinations of joint velocities in the loop: the user's rows, and limits and barriers made for Pink.

    lower <= C x <= upper                      rows of the user's, fixed or a function of q
    G x <= h / dt, rows of unit length         what a Pink limit or barrier returns, G dq <= h

Where a limit gives NaN or allows no velocity, it cannot be kept: the tick is then held, with the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from math import inf
from typing import Any, NamedTuple, Protocol, cast

import numpy as np

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.velocity.limits.rows import LimitRows

Rows = LimitRows | Callable[[Array], LimitRows | None]
LIMITS = (
    "LimitRows, a function of q that returns them, ToolSpeed, or a limit made for Pink: compute_qp_inequalities(...)"
)


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


def joint_rows(robot: Robot, rows: Rows | None, limits: Sequence[Rows | PinkLimit], dt: float) -> JointRows | None:
    """The row limits of a loop, None where it has none; checked as far as it can be now.

    Raises:
        BadInput: neither rows nor a function; a limit of another kind; a limit of Pink's for a robot without a model.
        MissingExtra: limits of Pink's without Pink.
    """
    if rows is not None and not isinstance(rows, LimitRows) and not callable(rows):
        raise BadInput("rows", excerpt(rows), "LimitRows(C, lower, upper), or a function of q that returns it")
    given = [("limits", limit) for limit in limits]
    if rows is not None:
        given.insert(0, ("rows", rows))
    return JointRows(robot, tuple(given), dt) if given else None


class JointRows:
    """All row limits of a loop, in their order."""

    def __init__(self, robot: Robot, given: tuple[tuple[str, Rows | PinkLimit], ...], dt: float) -> None:
        """As `joint_rows`; each limit with the argument that it was given by."""
        self._robot = robot
        self._m = len(robot.names)
        self._dt = dt
        self._given = given
        self._configuration: Any = None
        alone = len(given) == 1 and callable(given[0][1]) and not _is_pinks(given[0][1])
        self._function = given[0][1] if alone else None  # where there is nothing beside it
        for argument, limit in given:
            if isinstance(limit, LimitRows):
                self._require(limit, argument)
            elif not _is_pinks(limit) and not callable(limit):
                raise BadInput(argument, excerpt(limit), LIMITS)
        if any(_is_pinks(limit) for _, limit in given):
            model: Any = getattr(robot, "model", None)
            if model is None:
                raise BadInput("limits", "a robot of joint screws", "one of a URDF: Pink's limits read its model")
            from invariantqp.robots.pink import Configuration  # Pink is loaded when a limit of its kind is

            self._configuration = Configuration(model, model.createData(), np.zeros(model.nq))

    def __deepcopy__(self, memo: dict[int, Any]) -> JointRows:
        """Row limits for another loop, which shares rows and limits but has a configuration of its own."""
        return JointRows(self._robot, self._given, self._dt)

    def at(self, q: Array, before: Array) -> TickRows:
        """The rows at joint positions q (m,), `before` (m,) being the velocity now.

        Raises:
            BadInput: rows on another number of joints.
        """
        try:
            if self._function is not None:
                return TickRows(self._checked(*self._given[0], q))
            if self._configuration is not None:
                self._configuration.update(q)
            parts = [part for given in self._given for part in self._parts(*given, q, before)]
        except _Unusable as trouble:
            return TickRows(None, str(trouble))
        return TickRows(_stacked(parts))

    @cached_property
    def fixed(self) -> LimitRows | None:
        """The rows where they are the same in every tick."""
        if not all(isinstance(limit, LimitRows) for _, limit in self._given):
            return None
        return self.at(np.zeros(self._m), np.zeros(self._m)).rows

    def own(self, q: Array) -> LimitRows | None:
        """The rows at joint positions q (m,) but Pink's, None where there are none or they cannot be used."""
        try:
            parts = [part for name, limit in self._given if not _is_pinks(limit) for part in self._own(name, limit, q)]
        except _Unusable:
            return None
        return _stacked(parts)

    def _parts(self, argument: str, limit: Any, q: Array, before: Array) -> Iterator[_Part]:
        return self._foreign(limit, before) if _is_pinks(limit) else self._own(argument, limit, q)

    def _checked(self, argument: str, own: Any, q: Array) -> LimitRows | None:
        """Rows of the user's at joint positions q (m,)."""
        if isinstance(own, LimitRows):
            return own
        try:
            rows = own(q.copy())
        except BadInput as error:
            raise _Unusable(f"rows: {error}") from error
        if rows is None:
            return None
        self._require(rows, argument)
        return cast("LimitRows", rows)

    def _own(self, argument: str, limit: Any, q: Array) -> Iterator[_Part]:
        own = self._checked(argument, limit, q)
        if own is not None:
            yield np.asarray(own.C), np.asarray(own.lower), np.asarray(own.upper)

    def _foreign(self, limit: Any, before: Array) -> Iterator[_Part]:
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

    def _require(self, rows: object, argument: str) -> None:
        """Refuse what is not rows on the arm's joints."""
        if not isinstance(rows, LimitRows):
            raise BadInput(argument, type(rows).__name__, "LimitRows(C, lower, upper), or None for no limit")
        if np.shape(rows.C)[1] != self._m:
            raise BadInput(argument, f"rows on {np.shape(rows.C)[1]} joints", f"rows on {self._m}, one for each joint")


def _is_pinks(limit: object) -> bool:
    return hasattr(limit, "compute_qp_inequalities")


def _stacked(parts: list[_Part]) -> LimitRows | None:
    """All rows together, None where there are none."""
    if not sum(len(part[0]) for part in parts):
        return None
    C, lower, upper = (np.concatenate(sides) for sides in zip(*parts, strict=True))
    return LimitRows(C, lower, upper)
