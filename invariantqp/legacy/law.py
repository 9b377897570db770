"""The two inputs of a tick: the law, which is fixed, and the demand of this tick.

minimise |A x - b|^2 + ...   inside the limits,    A = root J,   b = root s (or what a form attempts of it)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from invariantqp.engine import Engine, core_for
from invariantqp.geometry.arrays import Array
from invariantqp.legacy.damping import Adaptive, Damping, Fixed, PaperLambda, Selective
from invariantqp.velocity.backends import Backend, Daqp
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.forms import Complement, Form, PitchForm
from invariantqp.velocity.guard import Guard
from invariantqp.velocity.limits import Cone, LimitRows

if TYPE_CHECKING:
    from invariantqp.engine import Law


class Chase(NamedTuple):
    """Which part of a twist closes an error: limits slow that part down before they bend it."""

    ahead: Array  # (6,) the other part of s, the target's own twist
    rows_ahead: Array | None  # (k,) what the exact rows demand for `ahead` alone; None without rows
    lower: Array  # (m,) velocity bounds by position limits alone
    upper: Array  # (m,)
    slack: float  # a measured twist that counts as nothing: `SLACK` of the gain times a radian
    apart: bool  # whether the measure tells position and angle apart, as a point's does

    def slowed(self, share: float) -> Chase:
        """The same at a share of its speed."""
        rows = None if self.rows_ahead is None else share * self.rows_ahead
        return self._replace(ahead=share * self.ahead, rows_ahead=rows, slack=share * self.slack)


class Demand(NamedTuple):
    """The input of one tick; already checked."""

    J: Array  # (6, m) joint twists
    s: Array  # (6,) wanted twist, in the frame of J
    root: Array  # (6, 6) root of the measure: the size of a twist is |root s|
    lower: Array  # (m,) velocity bounds, -inf where there is none
    upper: Array  # (m,)
    exact: ExactRows | None = None  # rows to be met exactly, or None
    posture: Array | None = None  # (m,) joint velocity wanted where the twist leaves joints free, or None for zero
    rows: LimitRows | None = None  # limits on combinations of joint velocities, or None
    cone: Cone | None = None  # speed limit of a point, or None
    row_rank: int | None = None  # how many independent exact rows the arm can keep at best; None is all
    chase: Chase | None = None  # None is a twist by itself: least squares inside the limits
    # (m,) speeds beside which joint velocities count, where the posture rests while the task rests; None is a posture
    # that is followed as it is
    fastest: Array | None = None
    before: Array | None = None  # (m,) joint velocities of the tick before, from which the posture sets in by and by;
    change: Array | None = None  # (m,) by how much it may change them in a tick; None is any
    held: float = 0.0  # how much longer than the law's dt the velocity is held [s]

    def slowed(self, share: float) -> Demand:
        """All that is wanted, at a share of its speed; the limits are as they were."""
        exact, chase = self.exact, self.chase
        return self._replace(
            s=share * self.s,
            exact=None if exact is None else exact.demanding(share * np.asarray(exact.b)),
            posture=None if self.posture is None else share * self.posture,
            chase=None if chase is None else chase.slowed(share),
            fastest=None if self.fastest is None else share * self.fastest,
            change=None if self.change is None else share * self.change,
            held=self.held / share,
        )

    def allows(self, x: Array) -> bool:
        """Whether x is inside all limits: clipping to the box changes no bit, rows and cone hold."""
        boxed = bool(np.minimum(np.maximum(x, self.lower), self.upper).tobytes() == x.tobytes())
        if self.rows is None and self.cone is None:
            return boxed
        return boxed and (self.rows is None or self.rows.allow(x)) and (self.cone is None or self.cone.allows(x))


# A twist of this share of gain times a radian is none: limits may take that much away before they slow the chase down,
# and an error of a position or an angle that small may stay. The gain counts as at most the second [1/s]: how fast is
# asked for does not decide which way an arm goes that cannot be so fast. Measured: a tool that turns in place swings in
# proportion to it, a Panda's by 1.8, 3.2 and 5.9 mm in the median with 1e-3, 2e-3 and 4e-3; of 216 targets ten arms
# reach 158, 159 and 159; with 1e-3 loops are "ok" in fewer ticks, and farther off a target that outruns them.
SLACK, SLACK_GAIN = 2e-3, 10.0
# Threshold and ceiling of the default damping of a path that is looked at ahead: it slows down before joints are fast.
PLANNED_DAMPING = 1e-3, 3e-5


@dataclass(frozen=True, eq=False)
class VelocityLaw:
    """Everything about the law that does not change from tick to tick.

    Attributes:
        form: what is attempted of a twist that the joints cannot do; None is least squares.
        damping: the policy near singularities; `PaperLambda` is [DS]'s own problem as printed.
        guard: the descent guard of a form, or None to switch it off.
        metric: (m, m) joint metric, or None for the identity.
        backend: the QP solver.
        dt: how long the velocity is held [s], for the damping in `calm`; 0 is none.
        engine: "compiled" for the core where there is one and it has this law, "python" for Python alone.
    """

    form: Form | None = None
    damping: Damping | PaperLambda = field(default_factory=Adaptive)
    guard: Guard | None = field(default_factory=Guard)
    metric: Array | None = None
    backend: Backend = field(default_factory=Daqp)
    dt: float = 0.0
    engine: Engine = "compiled"

    @cached_property
    def planned(self) -> VelocityLaw:
        """For a joint motion that was looked at ahead: not calm, and by default hardly damped."""
        damping = Adaptive(*PLANNED_DAMPING) if self.damping == Adaptive() else self.damping
        return replace(self, damping=damping, dt=0.0)

    def slowed(self, share: float) -> VelocityLaw:
        """The same for demands at a share of their speed: as calm as at the whole speed, so the way is the same."""
        return replace(self, dt=self.dt / share)

    @cached_property
    def compiled(self) -> Law | None:
        """The same for the compiled core; None where it does not have this law.

        Python's are `PaperLambda`, a convexified form, damping of the user's, and other solvers.
        """
        core = core_for(self.engine)
        damping, form = self.damping, self.form
        fields: dict[str, Any] = {"dt": self.dt, "T": self.to_joint, "inverse": self.from_joint}
        if type(damping) is Selective and type(damping.adaptive) is Adaptive:
            fields["speed"], damping = damping.speed, damping.adaptive
        if type(damping) is Adaptive:
            fields |= {"threshold": damping.threshold, "ceiling": damping.ceiling}
        elif type(damping) is Fixed:
            fields |= {"threshold": np.inf if damping.value else 0.0, "fixed": damping.value}
        else:
            return None
        if form is not None:
            fields |= {"form": "brought", "fraction": -1.0 if self.guard is None else self.guard.fraction}
        if type(form) is Complement:
            fields |= {"form": "complement", "Z": np.asarray(form.Z).T}
        elif isinstance(form, PitchForm):
            fields |= {"form": "pitch", "pitch": form.h}
        if core is None or type(self.backend) is not Daqp or getattr(form, "convexified", False):
            return None
        made: Law = core.Law(**fields)
        return made

    @cached_property
    def to_joint(self) -> Array | None:
        """(m, m) T with T'MT = I for the joint metric M: x = T y."""
        return None if self.metric is None else np.asarray(np.linalg.inv(np.linalg.cholesky(self.metric)).T, np.float64)

    @cached_property
    def from_joint(self) -> Array | None:
        """(m, m) the inverse of T."""
        return None if self.metric is None else np.asarray(np.linalg.cholesky(self.metric).T, np.float64)
