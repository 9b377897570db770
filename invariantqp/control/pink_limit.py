"""Limits and barriers that were made for Pink, as rows of a controller."""

from __future__ import annotations

from copy import copy
from math import inf
from typing import Any, Protocol

import numpy as np

from invariantqp.control.limits import Limit, Loop, UnusableRows
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, middle
from invariantqp.velocity.limits import LimitRows
from invariantqp.velocity.reasons import Code, Reason


class ForPink(Protocol):
    """A limit or barrier made for Pink from `robot.model`: G dq <= h on the joint displacement dq of a tick."""

    def compute_qp_inequalities(self, configuration: Any, dt: float) -> tuple[Any, Any] | None:
        """G (k, m) and h (k,) in a `pink.Configuration` for a tick of dt [s]; None where nothing is limited now."""
        ...


class PinkLimit(Limit):
    """A limit or barrier made for Pink from `robot.model`, with the collision model that some of them read.

        G dq <= h  on the displacement of a tick becomes  G x <= h / dt, with rows of unit length

    `limits=[barrier]` is short for `limits=[PinkLimit(barrier)]`.

    Attributes:
        limit: anything with `compute_qp_inequalities(configuration, dt)`.
        collision_model: a `pinocchio.GeometryModel` on the joints of `robot.model` if the limit reads one, or None.
        name: the name of its class.
    """

    _configuration: Any
    _dt: float

    def __init__(self, limit: ForPink, collision_model: Any = None) -> None:
        """See the attributes."""
        if not is_for_pink(limit):
            raise BadInput("limit", excerpt(limit), "a limit made for Pink: compute_qp_inequalities(...)")
        self.limit: Any = limit
        self.collision_model = collision_model
        self.name = type(limit).__name__

    def for_loop(self, loop: Loop) -> Limit:
        """The limit with a configuration of this loop, evaluated once.

        Raises:
            BadInput: a robot without a model; a limit that fails on this arm.
            MissingExtra: without Pink.
        """
        model: Any = getattr(loop.robot, "model", None)
        if model is None:
            raise BadInput("limits", "a robot of joint screws", "one of a URDF: Pink's limits read its model")
        from invariantqp.robots.pink import Configuration, SelfCollisionBarrier  # loads Pink

        made, q, geometry = copy(self), middle(loop.robot), self.collision_model
        if geometry is None and isinstance(self.limit, SelfCollisionBarrier):
            geometry = _collision_model(loop.robot)
        collisions = {} if geometry is None else {"collision_model": geometry}
        configuration = Configuration(model, model.createData(), q, **collisions)
        vars(made).update(_configuration=configuration, _dt=loop.dt)
        try:
            made.rows(q, np.zeros(len(q)))
        except UnusableRows:  # other states may do
            pass
        except Exception as error:  # a class of another library may raise anything
            if isinstance(error, BadInput) and error.argument == "limits":
                raise
            remedy = (
                "One that reads collisions is given them by iq.limits.PinkLimit(limit, collision_model=...); "
                "iq.limits.Clearance(robot, bodies={link: [shapes]}) needs no model."
            )
            raise BadInput(
                "limits",
                f"{self.name}, which fails on this arm: {type(error).__name__}: {error}",
                "a limit made from robot.model",
                remedy if self.collision_model is None else "",
            ) from error
        return made

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        """The rows of a tick, of unit length."""
        self._configuration.update(q)
        if hasattr(self.limit, "set_last_integration"):  # Pink's acceleration limit
            self.limit.set_last_integration(velocity.copy(), self._dt)
        with np.errstate(invalid="ignore"):  # NaN is checked for below
            answer = self.limit.compute_qp_inequalities(self._configuration, self._dt)
        if answer is None:
            return None
        G, h = answer
        C = np.array(G, dtype=np.float64).reshape(-1, np.shape(G)[-1])
        upper = np.array(h, dtype=np.float64).reshape(-1) / self._dt
        if C.shape != (len(upper), len(q)):
            raise BadInput(
                "limits",
                f"{self.name} with rows of shape {C.shape} and {len(upper)} bounds",
                f"rows on {len(q)} joints",
                "Make it from robot.model.",
            )
        length = np.linalg.norm(C, axis=1)
        if np.isnan(upper).any() or not np.isfinite(length).all():
            raise UnusableRows(Reason(Code.LIMIT_NAN, rows=(self.name,)))
        empty = length == 0.0
        if (upper[empty] < 0.0).any() or (upper == -inf).any():
            raise UnusableRows(Reason(Code.LIMIT_INFEASIBLE, rows=(self.name,)))
        kept = np.flatnonzero(~empty & (upper < inf))
        if not len(kept):
            return None
        names = [f"{self.name} row {i}" for i in kept] if len(upper) > 1 else self.name
        return LimitRows(C[kept] / length[kept, None], np.full(len(kept), -inf), upper[kept] / length[kept], names)


def _collision_model(robot: Robot) -> Any:
    """The collision model of an arm for Pink's SelfCollisionBarrier, None for an arm without collision geometry."""
    if not any(link.parts for link in getattr(robot, "links", ())):
        return None
    from invariantqp.robots.pinocchio_arms import collision_model

    return collision_model(robot)  # type: ignore[arg-type]


def is_for_pink(limit: object) -> bool:
    """Whether an object is a limit or barrier made for Pink."""
    return hasattr(limit, "compute_qp_inequalities") and not isinstance(limit, type)
