"""Limits on combinations of joint velocities in the loop: the user's rows, and limits and barriers made for Pink.

    lower <= C x <= upper                      rows of the user's, fixed or a function of q
    G x <= h / dt, rows of unit length         what a Pink limit or barrier returns, G dq <= h
    rows of a Clearance                        at a rate that depends on the loop

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
from invariantqp.velocity.limits import LimitRows
from invariantqp.velocity.solution import VelocitySolution

Rows = LimitRows | Callable[[Array], LimitRows | None]
LIMITS = (
    "LimitRows, a function of q that returns them, ToolSpeed, Clearance, or a limit made for Pink: "
    "compute_qp_inequalities(...)"
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


class LoopRows(Protocol):
    """Rows that depend on the loop they are in: a `Clearance`."""

    def in_loop(self, dt: float, delay: float, acceleration_limit: Array | None, speed: Array) -> Any:
        """What `rows` takes of a loop with ticks of dt [s], a delay [s], accelerations (m,) or None, speeds (m,)."""
        ...

    def rows(self, q: Array, rate: Any) -> LimitRows | None:
        """The rows at joint positions q (m,)."""
        ...

    def told(self, solution: VelocitySolution) -> VelocitySolution:
        """The solution of the tick whose rows were asked last, its reason with what of them holds it."""
        ...

    def blocked(self, q: Array) -> str:
        """Why an arm cannot come to rest at joint positions q (m,), "" where it can."""
        ...


class Loop(NamedTuple):
    """What of a loop its rows may depend on."""

    dt: float  # [s]
    delay: float  # [s]
    acceleration_limit: Array | None  # (m,)


def joint_rows(
    robot: Robot, rows: Rows | None, limits: Sequence[Rows | PinkLimit | LoopRows], loop: Loop
) -> JointRows | None:
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
    return JointRows(robot, tuple(given), loop) if given else None


class JointRows:
    """All row limits of a loop, in their order."""

    def __init__(self, robot: Robot, given: tuple[tuple[str, Any], ...], loop: Loop) -> None:
        """As `joint_rows`; each limit with the argument that it was given by."""
        self._robot = robot
        self._m = len(robot.names)
        self._loop = loop
        self._dt = loop.dt
        self._given = given
        self._rates: dict[int, Any] = {}
        self._configuration: Any = None
        for i, (argument, limit) in enumerate(given):
            if isinstance(limit, LimitRows):
                self._require(limit, argument)
            elif _is_of_loop(limit):
                if limit.robot.names != robot.names:
                    raise BadInput(argument, f"{limit!r} of another robot", "one made with this controller's robot")
                self._rates[i] = limit.in_loop(*loop, robot.velocity_limit)
            elif not _is_pinks(limit) and not callable(limit):
                raise BadInput(argument, excerpt(limit), LIMITS)
        if any(_is_pinks(limit) for _, limit in given):
            model: Any = getattr(robot, "model", None)
            if model is None:
                raise BadInput("limits", "a robot of joint screws", "one of a URDF: Pink's limits read its model")
            from invariantqp.robots.pink import Configuration, SelfCollisionBarrier  # Pink is loaded when asked for

            shapes = None
            if any(isinstance(limit, SelfCollisionBarrier) for _, limit in given):
                shapes = _collision_model(robot)
            self._configuration = Configuration(model, model.createData(), np.zeros(model.nq), collision_model=shapes)

    def __deepcopy__(self, memo: dict[int, Any]) -> JointRows:
        """Row limits for another loop, which shares rows and limits but has a configuration of its own."""
        return JointRows(self._robot, self._given, self._loop)

    def at(self, q: Array, before: Array) -> TickRows:
        """The rows at joint positions q (m,), `before` (m,) being the velocity now.

        Raises:
            BadInput: rows on another number of joints.
        """
        try:
            if self._configuration is not None:
                self._configuration.update(q)
            parts = [part for i in range(len(self._given)) for part in self._parts(i, q, before)]
        except _Unusable as trouble:
            return TickRows(None, str(trouble))
        return TickRows(_stacked(parts))

    @property
    def fixed(self) -> LimitRows | None:
        """The rows where they are the same in every tick."""
        if not all(isinstance(limit, LimitRows) for _, limit in self._given):
            return None
        return self.at(np.zeros(self._m), np.zeros(self._m)).rows

    def own(self, q: Array) -> LimitRows | None:
        """The rows at joint positions q (m,) but Pink's, None where there are none or they cannot be used."""
        try:
            parts = [
                part for i, (_, limit) in enumerate(self._given) if not _is_pinks(limit) for part in self._own(i, q)
            ]
        except _Unusable:
            return None
        return _stacked(parts)

    def told(self, solution: VelocitySolution) -> VelocitySolution:
        """The solution of a tick, its reason with the limit that holds it where a limit has words for that."""
        for i in self._rates:
            solution = self._given[i][1].told(solution)
        return solution

    def blocked(self, q: Array) -> str:
        """Why an arm cannot come to rest at joint positions q (m,), by the limits that have words for that."""
        return next((why for i in self._rates if (why := self._given[i][1].blocked(q))), "")

    def _parts(self, i: int, q: Array, before: Array) -> Iterator[_Part]:
        limit: Any = self._given[i][1]
        return self._foreign(limit, before) if _is_pinks(limit) else self._own(i, q)

    def _own(self, i: int, q: Array) -> Iterator[_Part]:
        argument, own = self._given[i]
        if i in self._rates:
            own = own.rows(q, self._rates[i])
        elif not isinstance(own, LimitRows):
            try:
                own = own(q.copy())
            except BadInput as error:
                raise _Unusable(f"rows: {error}") from error
            if own is not None:
                self._require(own, argument)
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


def _collision_model(robot: Any) -> Any:
    """The shapes of an arm that SelfCollisionBarrier keeps apart; Pink has them beside its model.

    Raises:
        BadInput: the arm is known without.
    """
    from invariantqp.robots.collision_model import collision_model

    if not any(link.parts for link in getattr(robot, "links", ())):
        raise BadInput(
            "limits",
            "a SelfCollisionBarrier, and a robot known without collision geometry",
            "a robot of a URDF that has it, or limits.Clearance(robot, bodies={link: [shapes]})",
        )
    return collision_model(robot)


def _is_of_loop(limit: object) -> bool:
    return hasattr(limit, "in_loop")


def _is_pinks(limit: object) -> bool:
    return hasattr(limit, "compute_qp_inequalities")


def _stacked(parts: list[_Part]) -> LimitRows | None:
    """All rows together, None where there are none."""
    if not sum(len(part[0]) for part in parts):
        return None
    C, lower, upper = (np.concatenate(sides) for sides in zip(*parts, strict=True))
    return LimitRows(C, lower, upper)
