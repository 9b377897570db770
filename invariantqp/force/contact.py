"""The hybrid task, and its split into motion and force by dual projectors.

    s = P s_motion + (I - P) C (I - P)' (W_d - W)            P* = (I - P)'

A wrench error never moves the tool along the freedoms S, and motion never changes the force. The compliance C, twist
per wrench, is a tensor fixed to the contact (it changes frames as Ad C Ad'), so that no frame is preferred. With W the
constraints and W'C W = L L', a wrench W w has the *unit parts* L'w and a twist the *unit rates* L^-1 W' twist, in the
units of the first constraint; the force law is the same for each.

Reference: [DS] Sect. 6.3; Lipkin & Duffy 1988; Selig & McAree 1996.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import hypot, inf, pi, tan
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from attrs import evolve, field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt
from invariantqp.force.contact_kinds import Contact, ContactKind
from invariantqp.force.wrench import Wrench, by_name, desired_wrench_of
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared, Value, own
from invariantqp.geometry.forms import finite_pitch
from invariantqp.systems.projectors import DualProjectors, dual_projectors

OnLoss = Literal["approach", "hold", "retreat", "continue"]
OnOverload = Literal["hold", "retreat"]

# The largest correction of a normal [rad].
MAX_TILT = pi / 4.0
# The slope of a surface against the declared one, unless `normal_within` is larger: 6 deg.
SLOPE = 0.1
# The size over which a grip is compliant to moments, in sizes of the contact: with one size the moments of a stiff
# hinge would lower the gain of the forces, too.
GRIP_SIZES = 2.0
# A press below zero by less than this share of a wrench is rounding.
ROUNDING = arrays.NEGLIGIBLE
# The compliance of a grip is that of a place within this share of the contact's size.
GRIP_TOLERANCE = 0.2


@frozen(init=False, eq=False, repr=False, slots=False)
class HybridTask(Value):
    """Motion along the freedoms of a contact, force against its constraints.

    Attributes: as the arguments, with `metric` and `compliance` as (6, 6) in the contact's own frame.
    """

    contact: Contact | Callable[[Array], Contact]
    wrench: Array = field(converter=own)
    h: float | None
    complement: Array | None = field(converter=optional(own))
    metric: Array | None = field(converter=optional(own))
    compliance: Array | None = field(converter=optional(own), repr=False)
    stiffness: float | None
    size: float = field(repr=False)
    normal_within: float | None = field(repr=False)
    lost_below: float | None = field(repr=False)
    lost_after: float = field(repr=False)
    on_loss: str = field(repr=False)
    yields: float = field(repr=False)
    edge_margin: float = field(repr=False)
    approach_speed: float = field(repr=False)
    approach_distance: float = field(repr=False)
    approach_time: float = field(repr=False)
    slide_speed: float = field(repr=False)
    max_force: float | None = field(repr=False)
    max_moment: float | None = field(repr=False)
    on_overload: str | None = field(repr=False)
    grip: Array = field(converter=own, repr=False)
    retreat_speed: float = field(repr=False)
    retreat_distance: float = field(repr=False)

    def __init__(
        self,
        contact: Contact | Callable[[Array], Contact],
        wrench: ArrayLike | Wrench,
        *,
        h: float | None = None,
        complement: ArrayLike | None = None,
        metric: ArrayLike | None = None,
        compliance: ArrayLike | None = None,
        stiffness: float | None = None,
        size: float = 0.05,
        normal_within: float | None = None,
        lost_below: float | None = None,
        lost_after: float = 0.1,
        on_loss: OnLoss = "approach",
        yields: float = 0.0,
        edge_margin: float = 0.01,
        approach_speed: float = 0.02,
        approach_distance: float = 0.1,
        approach_time: float = inf,
        slide_speed: float = 0.1,
        max_force: float | None = None,
        max_moment: float | None = None,
        on_overload: OnOverload | None = None,
        grip: ArrayLike = (0.0, 0.0, 0.0),
        retreat_speed: float = 0.02,
        retreat_distance: float = 0.02,
    ) -> None:
        """The task for one contact. Defaults of lengths and speeds are metres and m/s; in another unit give them all.

        Args:
            contact: the contact, or a function that returns it for the tool's (4, 4) pose in the base frame.
            wrench: to exert: (6-k,) parts in the contact's constraints, in their order (first the press [N]; with six
                constraints moment, then force), or a `Wrench` in the contact's own frame; its part in S* counts.
            h: pitch whose reciprocal system is the complement Z; see `dual_projectors` for its limits.
            complement: Z itself, (6, 6-k) in the contact's own frame.
            metric: (6, 6) or (6,) positive definite, in the contact's own frame, a contact stiffness for instance. With
                none of the three, Z = C W follows from the compliance; it exists for every contact.
            compliance: C, twist per wrench: one number c [length/s per N] for diag(c/size^2 I, c I), or (6,), or (6, 6)
                in the contact's own frame. It is then the fixed gain of the force loop: c k on a contact of stiffness
                k, stable for dt c k < 2, without overshoot below 1, and with a low-pass of time constant T for
                c k T < 1/4. None adapts the gain to the estimated stiffness, damping and delay, with C isotropic about
                the place of contact, or over twice the size about the grip of a contact without a press.
            stiffness: of the contact along the press [force/length], arm in series included. A soft one allows an
                approach up to 2.5 times as fast, and is the prior of the estimate; a wrong one is corrected by the
                first contact. A fixed compliance has integral action only with it.
            size: over which the contact spreads, which weighs moments against forces [length].
            normal_within: estimates the normal from the motion along the surface, within this angle of the declared one
                [rad], up to pi/4; None trusts the declared one. For contacts with one press; friction does not matter.
            lost_below: press [N] below which contact is lost; None is a tenth of the desired one, 0 is never once felt.
            lost_after: for so long [s].
            on_loss: "approach" moves towards the contact, no faster than `approach_speed`; "hold" stands still until it
                is felt again; "retreat" leaves; "continue" only reports it. Before the first contact it is "approach".
            yields: how far the surface may move, give way, or step down, under the tool [length]; inf is any distance.
                Readings that lead the tool further than this and the slope explain are a "fault".
            edge_margin: a contact nearer to the edge of its surface than this is reported [length]; beyond the edge
                nothing is pushed. Only for contacts with an edge.
            approach_speed: the largest speed of the force law in the air and into the contact [length/s], without that
                of a slope. Without a fixed compliance an impact is slower if tick and delay require it: the desired
                press over 1e5 N/m, or the softer declared stiffness, and over the delay.
            approach_distance: stand still after so far towards the contact without feeling it [length]; inf: never.
            approach_time: likewise [s]; by default the distance alone ends the approach.
            slide_speed: the largest speed along the contact for an error of the target [length/s], rotation counted
                over `size`; inf is any. A feedforward is not limited. Without acceleration limits of the joints, the
                speed is reached within 0.1 s.
            max_force: force [N] above which the status is "overload"; None is 2.5 times the desired one of task or
                tick, 20 N if none is desired, for the press and for the force across it (mostly friction), each by
                itself; inf is never. After the desired press was lowered, the limit falls with the force.
            max_moment: likewise of the moment about the place of contact or the grip, the smaller one [N length]; None
                is 2.5 times the desired one, or `size` times the force if that is more.
            on_overload: "hold" or "retreat", until `HybridController.reset`, after an overload or a fault; None is
                "retreat" from a contact that can be left.
            grip: (3,) where the tool holds a handle, which may be far from its hinge, in the tool frame [length].
            retreat_speed: along the contact's outward twist [length/s].
            retreat_distance: from the contact, after a fault from the start of the approach [length].

        Raises:
            BadInput: more than one of h, complement and metric, NaN, shapes, "retreat" from a contact that cannot be
                left, a `max_force` below the desired force.
            NoProjectors: there is none for h and this contact; names the contact's type.
        """
        rules = {"h": h, "complement": complement, "metric": metric}
        given = [name for name, rule in rules.items() if rule is not None]
        if len(given) > 1:
            raise BadInput(given[0], " and ".join(given), "one of h, complement, metric, or none")
        if not isinstance(contact, Contact) and not callable(contact):
            raise BadInput("contact", excerpt(contact), "a Contact, or a function of the tool's pose that returns one")
        length = arrays.number(size, "size", "a length", positive=True)
        desired = desired_wrench_of(wrench, partial(_constraints, contact))
        self.__attrs_init__(
            contact=contact,
            wrench=desired,
            h=None if h is None else finite_pitch(h),
            complement=None if complement is None else arrays.system(complement, "complement"),
            metric=None if metric is None else arrays.positive_definite(metric, 6, "metric"),
            compliance=None if compliance is None else compliance_of(compliance, length),
            stiffness=None if stiffness is None else arrays.number(stiffness, "stiffness", "N/m", positive=True),
            size=length,
            normal_within=None if normal_within is None else _angle(normal_within),
            lost_below=None if lost_below is None else arrays.not_negative(lost_below, "lost_below", "a force"),
            lost_after=arrays.not_negative(lost_after, "lost_after", "a time in seconds"),
            on_loss=arrays.choice(on_loss, "on_loss", get_args(OnLoss)),
            yields=arrays.not_negative(yields, "yields", "a length", infinite=True),
            edge_margin=arrays.not_negative(edge_margin, "edge_margin", "a length"),
            approach_speed=arrays.number(approach_speed, "approach_speed", "a speed", positive=True),
            approach_distance=_limit(approach_distance, "approach_distance"),
            approach_time=_limit(approach_time, "approach_time"),
            slide_speed=_limit(slide_speed, "slide_speed"),
            max_force=None if max_force is None else _force_limit(max_force, desired, contact),
            max_moment=None if max_moment is None else _limit(max_moment, "max_moment"),
            on_overload=None
            if on_overload is None
            else arrays.choice(on_overload, "on_overload", get_args(OnOverload)),
            grip=arrays.vector(grip, 3, "grip"),
            retreat_speed=arrays.number(retreat_speed, "retreat_speed", "a speed", positive=True),
            retreat_distance=arrays.number(retreat_distance, "retreat_distance", "a length", positive=True),
        )
        if isinstance(contact, Contact):
            self.split(contact.kind)

    @property
    def slope(self) -> float:
        """The largest slope of the surface against the declared one, a tangent."""
        return max(SLOPE, tan(self.normal_within or 0.0))

    def contact_at(self, tool: Array, contact: Any = None) -> Contact:
        """The given contact of a tick, else the task's with the tool at a (4, 4) pose.

        Raises:
            BadInput: not a contact.
        """
        declared = self.contact if contact is None else contact
        if isinstance(declared, Contact):
            return declared
        if contact is not None:
            raise BadInput("contact", excerpt(contact), "a Contact")
        found = declared(tool)
        if not isinstance(found, Contact):
            raise BadInput("contact", f"a function that gave {excerpt(found)}", "one that gives a Contact")
        return found

    def split(self, kind: ContactKind, grip: ArrayLike | None = None) -> Split:
        """P, P* and the admittance for a kind of contact, in its own frame.

        Args:
            kind: of contact.
            grip: (3,) in that frame; None is the place of contact.

        Raises:
            BadInput, NoProjectors: the task does not fit this contact.
        """
        if not isinstance(kind, ContactKind):
            raise BadInput("kind", excerpt(kind), "a ContactKind, such as contact.kind")
        if kind.out is None and "retreat" in (self.on_loss, self.on_overload):
            raise BadInput("contact", f"a {kind.name} and a retreat", "a contact that can be left", "Hold instead.")
        if self.normal_within is not None and kind.presses != 1:
            raise BadInput(
                "normal_within",
                f"{self.normal_within!r}, and a {kind.name} with {kind.presses} presses",
                "None for a contact without a press or with more than one",
            )
        W, C, complement = np.asarray(kind.constraints), self.compliance, self.complement
        if C is None:
            at = kind.origin if grip is None else arrays.vector(grip, 3, "grip")
            place = se3.adjoint(se3.transform(None, at), check=False)
            C = place.dot(compliance_of(1.0, self.size if kind.presses else GRIP_SIZES * self.size)).dot(place.T)
        if self.h is None and self.metric is None and complement is None:
            complement = C.dot(W)
        projectors = dual_projectors(np.asarray(kind.freedoms), h=self.h, complement=complement, metric=self.metric)
        Z = projectors.complement
        parts = np.linalg.solve(Z.T.dot(W), Z.T) if W.shape[1] else np.zeros((0, 6))
        L: Array = np.linalg.cholesky(W.T.dot(C).dot(W))
        one = float(L[0, 0]) if self.compliance is not None and len(L) else 1.0
        split = Split(
            kind,
            projectors,
            parts,
            L.T.dot(parts) / one,
            one * np.asarray(np.linalg.solve(L, W.T)),
            Z.dot(np.linalg.solve(W.T.dot(Z), L)) / one if W.shape[1] else np.zeros((6, 0)),
            one * one if self.compliance is not None else 0.0,
        )
        return split._replace(wrench=split.desired(self.wrench))

    def relabelled(self, offset: ArrayLike | None = None, tool_offset: ArrayLike | None = None) -> HybridTask:
        """The same task in other frames: the contact's displaced by `offset` in itself, the tool's by `tool_offset`.

        Raises:
            BadInput: not finite (4, 4) rigid motions.
        """
        X = np.eye(4) if offset is None else arrays.pose(offset, "offset")
        Y = np.eye(4) if tool_offset is None else arrays.pose(tool_offset, "tool_offset")
        back = se3.inverse(X, check=False)
        A, B = se3.adjoint(back, check=False), se3.coadjoint(back, check=False)
        contact, C, M, Z, w = self.contact, self.compliance, self.metric, self.complement, self.wrench
        return evolve(
            self,
            contact=contact.relabelled(X) if isinstance(contact, Contact) else _Relabelled(contact, X, Y),
            wrench=by_name(B.dot(w)) if len(w) == 6 else w,
            complement=None if Z is None else A.dot(Z),
            metric=None if M is None else B.dot(M).dot(B.T),
            compliance=None if C is None else A.dot(C).dot(A.T),
            grip=Y[:3, :3].T.dot(self.grip - Y[:3, 3]),
        )


@frozen(eq=False, slots=False)
class _Relabelled(Compared):
    """The function of a contact for other frames of contact and tool."""

    function: Callable[[Array], Contact]
    offset: Array
    tool_offset: Array

    def __call__(self, tool: Array) -> Contact:
        """The contact for the pose of the new tool frame."""
        return self.function(tool.dot(se3.inverse(self.tool_offset, check=False))).relabelled(self.offset)


def _angle(value: float) -> float:
    angle = arrays.number(value, "normal_within", "an angle in radians", positive=True)
    if angle > MAX_TILT:
        raise BadInput("normal_within", f"{angle:g} rad", f"at most {MAX_TILT:g} rad")
    return angle


def _constraints(contact: Contact | Callable[[Array], Contact]) -> int:
    """The number of constraints of a contact, for a function with the tool at the origin; 0 if that is not possible."""
    if isinstance(contact, Contact):
        return int(contact.kind.constraints.shape[1])
    try:
        return int(contact(np.eye(4)).kind.constraints.shape[1])
    except Exception:  # noqa: BLE001 - a user's function may not be made for that pose
        return 0


def _force_limit(limit: float, desired: Array, contact: Contact | Callable[[Array], Contact]) -> float:
    """A checked largest force; BadInput if the desired force alone reaches it."""
    largest = _limit(limit, "max_force")
    if len(desired) == 6:
        force = se3.norm(desired[3:])
    elif isinstance(contact, Contact) and len(desired) == contact.kind.constraints.shape[1]:
        force = se3.norm(np.asarray(contact.kind.constraints)[3:].dot(desired))
    else:  # the first part is the press
        force = abs(float(desired[0])) if len(desired) else 0.0
    if force > 0.0 and largest <= force:
        raise BadInput("max_force", f"{largest:g} beside a desired force of {force:g}", "more than the desired force")
    return largest


def _limit(value: float, argument: str) -> float:
    return arrays.number(value, argument, "a number or inf", positive=True, infinite=True)


class Split(NamedTuple):
    """The projectors of a task for one kind of contact, in the contact's own frame; n = 6-k constraints."""

    kind: ContactKind
    projectors: DualProjectors  # P and P*
    intensities: Array  # (n, 6) from a wrench to its parts in the constraints
    unit_parts: Array  # (n, 6) from a wrench to its unit parts
    unit_rates: Array  # (n, 6) from a twist to its unit rates
    twist: Array  # (6, n) from unit rates to the twist along Z that has them
    compliance: float  # a declared one, from unit parts to unit rates [length/s/force], else 0
    wrench: Array = np.zeros(6)  # (6,) the task's own W_d

    def fields(self) -> dict[str, Any]:
        """The split as the engine takes it."""
        kind, projectors = self.kind, self.projectors
        more = {"motion": projectors.motion, "force": projectors.force, "constraints": np.asarray(kind.constraints).T}
        names = "presses", "out", "origin"
        return {"n": len(self.unit_parts), **self._asdict(), **more, **{name: getattr(kind, name) for name in names}}

    def desired_now(self, wrench: Any) -> Array:
        """(6,) W_d of one tick, from the `wanted` of a step."""
        return self.desired(desired_wrench_of(wrench, lambda: int(self.kind.constraints.shape[1]), "wanted"), "wanted")

    def desired(self, wrench: Array, argument: str = "wrench") -> Array:
        """(6,) W_d in S*, from parts in the constraints or from a wrench.

        Raises:
            BadInput: neither as many numbers as constraints, nor six; a pull, where a contact only presses.
        """
        W = np.asarray(self.kind.constraints)
        n, found = W.shape[1], len(wrench)
        if found not in (n, 6):
            expected = f"{n}, one a constraint of a {self.kind.name}, or a (6,) wrench"
            raise BadInput(argument, f"{found} number{'s' if found != 1 else ''}", expected)
        parts = self.intensities.dot(wrench) if found == 6 else wrench
        press = min(parts[: self.kind.presses].tolist(), default=0.0)
        if press < -ROUNDING * se3.norm(wrench):
            expected = "zero or more: the tool presses along the contact's z"
            raise BadInput(argument, f"a press of {press:g}", expected, "A contact that pulls is not unilateral.")
        exert: Array = W.dot(parts)
        return exert


def compliance_of(value: ArrayLike, size: float) -> Array:
    """(6, 6) C from one number, six or a matrix."""
    c = arrays.array(value, "compliance", "a number, 6 numbers or a (6, 6) matrix")
    if c.ndim == 0:
        one = arrays.number(float(c), "compliance", "a speed per newton", positive=True)
        c = np.repeat((one / size**2, one), 3)
    return arrays.positive_definite(c, 6, "compliance")


class SplitCache:
    """The last split of a task, and `in_engine`, the same as the engine takes it."""

    def __init__(self, task: HybridTask, kind: ContactKind) -> None:
        """Of the kind of its first contact."""
        self.task = task
        self._grip: Array | None = None  # of the split
        self._keep(task.split(kind))

    def __reduce__(self) -> tuple[Any, ...]:
        return SplitCache, (self.task, self._split.kind)

    def at(self, contact: Contact, tool: Array) -> Split:
        """The split for a contact with the tool at a (4, 4) pose; raises as `HybridTask.split`."""
        task, kind, split = self.task, contact.kind, self._split
        if task.compliance is None and kind.presses == 0:
            grip = se3.inverse(contact.pose, check=False).dot(tool.dot([*task.grip, 1.0]))[:3]
            if self._grip is None or kind != split.kind or hypot(*(grip - self._grip)) > GRIP_TOLERANCE * task.size:
                self._keep(task.split(kind, grip))
                self._grip = grip
        elif kind is not split.kind:
            self._keep(task.split(kind))
        return self._split

    def _keep(self, split: Split) -> None:
        self._split = split
        self.in_engine: Any = law.ContactSplit(split.fields())
