"""The law and one tick's question, and the convex problem they make together: `build` beside `solve`.

    (J, s) -> (G, g) -> rows and joint metric removed, x = x0 + B z -> spectrum of B'GB, filtered

Reference: [DS] Sect. 6.2; the convex form is ours.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.systems.span import span
from invariantqp.velocity.convexify import Convexified, convexify
from invariantqp.velocity.damping import SINGULAR_RATIO, Adaptive, Damping
from invariantqp.velocity.exact import ExactRows, Reduction, reduce
from invariantqp.velocity.forms import Form, GramData
from invariantqp.velocity.guard import Guard
from invariantqp.velocity.limits.rows import LimitRows
from invariantqp.velocity.limits.toolspeed import Cone
from invariantqp.velocity.qp.backends import Backend, Daqp

# The rounding error of J'QJ relative to |J|^2 |Q|: a G smaller than that says nothing.
ROUNDING = 1e-15


class Demand(NamedTuple):
    """One tick's question, checked before it gets here.

    Attributes:
        J: (6, m) joint twists.
        s: (6,) wanted twist, in the frame of J.
        lower: (m,) velocity bounds, -inf where there is none.
        upper: (m,).
        exact: rows to be met exactly, or None.
        posture: (m,) joint velocity wanted in the null space, or None for none.
        anchor: (3,) point whose motion the exact rows fix, where the guard then measures; None is the arm's own point.
        rows: limits on combinations of joint velocities, or None.
        cone: speed limit of a point, or None.
        implied: whether the exact rows ask for parts of s alone, so that they hold wherever s is met.
    """

    J: Array
    s: Array
    lower: Array
    upper: Array
    exact: ExactRows | None = None
    posture: Array | None = None
    anchor: Array | None = None
    rows: LimitRows | None = None
    cone: Cone | None = None
    implied: bool = False

    def allows(self, x: Array) -> bool:
        """Whether no limit is met: clipping to the box changes no bit, rows and cone hold."""
        boxed = bool(np.minimum(np.maximum(x, self.lower), self.upper).tobytes() == x.tobytes())
        if self.rows is None and self.cone is None:
            return boxed
        return boxed and (self.rows is None or self.rows.allow(x)) and (self.cone is None or self.cone.allows(x))

    def slowed(self, alpha: float) -> Demand:
        """The same direction at a share of the speed."""
        if self.exact is None:
            return self._replace(s=alpha * self.s)
        rows = ExactRows(self.exact.A, alpha * np.asarray(self.exact.b))
        return self._replace(s=alpha * self.s, exact=rows)


class Problem(NamedTuple):
    """The convex problem of one tick: minimise over z, then x = x0 + B z."""

    convex: Convexified
    reduction: Reduction

    def unconstrained(self) -> Array:
        """The optimum where no bound is met, as a joint velocity."""
        return self.reduction.joint(self.convex.solution())


@dataclass(frozen=True, eq=False)
class VelocityLaw:
    """Everything about the law that does not change from tick to tick.

    Attributes:
        form: how twists are measured.
        damping: the policy near singularities.
        guard: the descent guard, or None to switch it off.
        metric: (m, m) joint metric, or None for the identity.
        backend: who solves the QPs.
        dt: how long the velocity is held [s], for the residual damping that keeps a loop still where its target is out
            of reach; 0 is none.
        note: what every solution's reason says of the form, "" for nothing.
    """

    form: Form
    damping: Damping = field(default_factory=Adaptive)
    guard: Guard | None = field(default_factory=Guard)
    metric: Array | None = None
    backend: Backend = field(default_factory=Daqp)
    dt: float = 0.0
    note: str = ""

    def build(self, demand: Demand) -> Problem:
        """The convex problem whose optimum is the stationary point of the form, filtered."""
        reduction = reduce(demand.J.shape[1], demand.exact, self.metric)
        return assemble(self.form.gram_data(demand.J, demand.s), reduction, demand, self.damping)


def assemble(data: GramData, reduction: Reduction, demand: Demand, damping: Damping) -> Problem:
    """Remove rows and metric from (G, g) and filter what is left."""
    G, g, size, seen = data
    noise = ROUNDING * size
    posture, B = demand.posture, reduction.basis
    if B is None:
        rank = min(len(g), seen)
    else:
        g = B.T.dot(g - G.dot(reduction.origin))
        G = B.T.dot(G).dot(B)
        posture = None if posture is None else reduction.reduced(posture)
        rank = min(len(g), seen if demand.exact is None else min(seen, numerical_rank(demand.J.dot(B))))
    convex = convexify(G, g, rank, damping, posture, noise)
    if convex.smallest <= SINGULAR_RATIO * convex.largest:
        # The form or the arm? Only joint motions that move nothing are null space; the rest is for the damping.
        moved = numerical_rank(demand.J if B is None else demand.J.dot(B))
        if moved < rank:
            convex = convexify(G, g, moved, damping, posture, noise)
    return Problem(convex, reduction)


def numerical_rank(twists: Array) -> int:
    """Rank of (6, n) twists by the library's one tolerance and in their own unit of length; 0 for no columns."""
    return span(twists).rank if twists.shape[1] else 0
