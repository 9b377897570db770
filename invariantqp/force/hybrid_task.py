"""A force/motion task as a value: the contact, the wrench to exert on it, and the compliance of the force law.

    s = P s_motion + (I - P) C (I - P)' (W_d - W)            P* = (I - P)'

Motion keeps to the freedoms S and force to the constraints S*: a wrench error never moves the tool along S, and motion
never changes the force. The compliance C, twist per wrench, is a tensor fixed to the contact (it changes frames as
Ad C Ad'), so that no frame is preferred.

    intensities w of the constraints:   dw/dt = K W'C W (w_d - w)     on a contact of stiffness K

For one stiffness k [force/length] and C = c [length/s/force] the loop is stable below dt c k = 2 and does not overshoot
below 1; a low-pass with time constant T also needs c k T < 1/4. Without a compliance, c follows the stiffness, told or
identified at the touch (`regulation`).

Reference: [DS] Sect. 6.3; Lipkin & Duffy 1988; Selig & McAree 1996.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import Literal, get_args

import numpy as np
from attrs import evolve, field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, excerpt
from invariantqp.force.reading import Wrench, by_name, wanted_of
from invariantqp.force.split import Split, compliance_of, split_of
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared, Value, own
from invariantqp.geometry.forms import finite_pitch
from invariantqp.systems.contacts import Contact, ContactKind

OnLoss = Literal["approach", "hold", "retreat", "continue"]
OnOverload = Literal["hold", "retreat"]

# Share of the wanted press below which the contact counts as lost: above the noise of a sensor in the air.
LOST_SHARE = 0.1
# How far a normal may be corrected [rad]: beyond it the told one says nothing.
MOST_TILT = pi / 4.0


@frozen(init=False, eq=False, repr=False, slots=False)
class HybridTask(Value):
    """Move along the freedoms of a contact, press against its constraints.

    Attributes:
        contact: the contact, or a function that gives it for the tool's (4, 4) pose in the base frame.
        wrench: what the tool is to exert: (6-k,) parts in the contact's constraints, or a (6,) wrench.
        h: pitch whose reciprocal system is the complement Z, or None.
        complement: Z itself, (6, 6-k) in the contact's own frame, or None.
        metric: (6, 6) in the contact's own frame, or None.
        compliance: (6, 6) C, twist per wrench, in the contact's own frame; None is the same in all directions about
            the place of contact, or about the grip of a contact that cannot be lost.
        adapts: whether C is scaled to the stiffness, because no compliance was given.
        stiffness: of the contact along the press [force/length], or None where it is not known.
        two_presses: whether the stiffness is taken from two presses at rest.
        size: over what length the contact spreads [length].
        normal_within: how far off the told normal the found one may be [rad]; None trusts the told one.
        lost_below, lost_after, on_loss: when a contact is lost, and what is done then.
        yields: how far the surface may give way.
        edge_margin: how near to the surface's edge that is told.
        approach_speed, approach_distance, approach_time: how it is looked for.
        max_force, max_moment, on_overload: what is too much, and what is done then.
        grip: (3,) where the tool holds what it moves, in the tool frame.
        retreat_speed, retreat_distance: how a contact is left.
    """

    contact: Contact | Callable[[Array], Contact]
    wrench: Array = field(converter=own)
    h: float | None
    complement: Array | None = field(converter=optional(own))
    metric: Array | None = field(converter=optional(own))
    compliance: Array | None = field(converter=optional(own), repr=False)
    adapts: bool = field(repr=False)
    stiffness: float | None
    two_presses: bool = field(repr=False)
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
        adapts: bool | None = None,
        stiffness: float | None = None,
        two_presses: bool = False,
        size: float = 0.05,
        normal_within: float | None = None,
        lost_below: float | None = None,
        lost_after: float = 0.1,
        on_loss: OnLoss = "approach",
        yields: float = 0.0,
        edge_margin: float = 0.01,
        approach_speed: float = 0.02,
        approach_distance: float = 0.1,
        approach_time: float = 20.0,
        max_force: float | None = None,
        max_moment: float | None = None,
        on_overload: OnOverload | None = None,
        grip: ArrayLike = (0.0, 0.0, 0.0),
        retreat_speed: float = 0.02,
        retreat_distance: float = 0.02,
    ) -> None:
        """The task for one contact. Defaults of lengths and speeds are metres and m/s; in another unit give them all.

        Args:
            contact: the contact, or a function that gives it for the tool's (4, 4) pose in the base frame.
            wrench: what the tool is to exert: (6-k,) parts in the contact's constraints, in their order (the first is
                the press [N]), or a `Wrench` in the contact's own frame, of which the part in S* counts.
            h: pitch whose reciprocal system is the complement Z; see `dual_projectors` for what it cannot do.
            complement: Z itself, (6, 6-k) in the contact's own frame.
            metric: (6, 6) or (6,) positive definite, in the contact's own frame, a contact stiffness for instance. With
                none of the three, Z = C W follows from the compliance; it exists for every contact.
            compliance: C, twist per wrench: one number c [length/s per N] for diag(c/size^2 I, c I), or (6,), or (6, 6)
                in the contact's own frame. It is the force loop's gain: c k on a contact of stiffness k. None chooses
                it by the stiffness, tick, delay and low-pass, as for 2e4 N/m until that is known, and takes it about
                the grip, over twice the size, in a contact that cannot be lost.
            adapts: whether C is scaled by the stiffness; None is if no compliance is given.
            stiffness: of the contact along the press [force/length]; once known, the law has integral action. None
                identifies it at each touch, unless a compliance is given; until then a usual one in N/m is supposed.
            two_presses: takes it from two presses at two forces after each touch, half of the wanted one first, while
                the tool rests on the surface: ten time constants of the force law each. For contacts with one press.
            size: over what length the contact spreads, which weighs moments against forces [length].
            normal_within: corrects the told normal by how the tool moves along the surface, by this angle at most
                [rad], up to pi/4; None trusts the told one. Friction does not disturb it. One press only.
            lost_below: press [N] below which contact is lost; None is a tenth of the wanted one, 0 is never once felt.
            lost_after: for how long [s].
            on_loss: "approach" goes on, no faster than `approach_speed` towards the contact; "hold" stands still until
                it is felt again; "retreat" leaves; "continue" only reports it. Before the first touch it is "approach".
            yields: how far the surface may give way, or step down, under the tool [length]; inf is any way. Where the
                way in exceeds this and what stiffness and slope explain, the status is "fault".
            edge_margin: a contact nearer to the edge of its surface than this is told [length]; beyond the edge nothing
                is pushed. Only for contacts that say where their edge is.
            approach_speed: the most that the force law moves the place of contact in the air [length/s], and into the
                contact beside as much as the tool slides, unless a compliance is given.
            approach_distance: after this way towards the contact without feeling it, stand still [length]; inf: never.
            approach_time: likewise [s].
            max_force: force [N] above which the status is "overload"; None is twice the wanted one, the task's or the
                tick's, whichever is larger, 20 N where none is wanted; inf is never. Where a press is lowered, the
                limit falls with what is felt.
            max_moment: moment likewise, about the place of contact or the grip, where it is less [N length]; None is
                twice the wanted one, or `size` times the force where that is more.
            on_overload: "hold" or "retreat", until `HybridController.reset`, at an overload or a sensor's fault; None
                is "retreat" from a contact that can be left.
            grip: (3,) where the tool holds a handle, which may be far from its hinge, in the tool frame [length].
            retreat_speed: along the contact's way out [length/s].
            retreat_distance: so far from the touch, after a fault from where the approach began, stand still [length].

        Raises:
            BadInput: more than one of h, complement and metric, NaN, shapes, "retreat" from a contact that cannot be
                left.
            NoProjectors: h does not do for this contact; names its type.
        """
        rules = {"h": h, "complement": complement, "metric": metric}
        given = [name for name, rule in rules.items() if rule is not None]
        if len(given) > 1:
            raise BadInput(given[0], " and ".join(given), "one of h, complement, metric, or none")
        if not isinstance(contact, Contact) and not callable(contact):
            raise BadInput("contact", excerpt(contact), "a Contact, or a function of the tool's pose that gives one")
        if stiffness is not None and arrays.flag(two_presses, "two_presses"):
            raise BadInput("two_presses", "True beside a stiffness", "one of them")
        length = arrays.number(size, "size", "a length", positive=True)
        self.__attrs_init__(
            contact=contact,
            wrench=wanted_of(wrench),
            h=None if h is None else finite_pitch(h),
            complement=None if complement is None else arrays.system(complement, "complement"),
            metric=None if metric is None else arrays.positive_definite(metric, 6, "metric"),
            compliance=None if compliance is None else compliance_of(compliance, length),
            adapts=compliance is None if adapts is None else arrays.flag(adapts, "adapts"),
            stiffness=None if stiffness is None else arrays.number(stiffness, "stiffness", "N/m", positive=True),
            two_presses=arrays.flag(two_presses, "two_presses"),
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
            max_force=None if max_force is None else _limit(max_force, "max_force"),
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

    def contact_at(self, tool: Array) -> Contact:
        """The contact with the tool at a (4, 4) pose.

        Raises:
            BadInput: the function gave something else.
        """
        if isinstance(self.contact, Contact):
            return self.contact
        contact = self.contact(tool)
        if not isinstance(contact, Contact):
            raise BadInput("contact", f"a function that gave {excerpt(contact)}", "one that gives a Contact")
        return contact

    def split(self, kind: ContactKind, grip: ArrayLike | None = None) -> Split:
        """P, P* and the admittance for a kind of contact, in its own frame.

        Args:
            kind: of contact.
            grip: (3,) the place of the grip in that frame; None is the place of contact.

        Raises:
            BadInput, NoProjectors: the task does not fit this contact.
        """
        if not isinstance(kind, ContactKind):
            raise BadInput("kind", excerpt(kind), "a ContactKind, such as contact.kind")
        if kind.out is None and "retreat" in (self.on_loss, self.on_overload):
            raise BadInput("contact", f"a {kind.name} and a retreat", "a contact that can be left", "Hold instead.")
        for argument, given, none in (
            ("normal_within", self.normal_within is not None, "None"),
            ("two_presses", self.two_presses, "False"),
        ):
            if given and kind.presses != 1:
                found = f"{getattr(self, argument)!r}, and a {kind.name} with {kind.presses} presses"
                raise BadInput(argument, found, f"{none} for a contact without a press or with more than one")
        at = kind.origin if grip is None else arrays.vector(grip, 3, "grip")
        return split_of(kind, self.wrench, self.compliance, at, self.size, (self.h, self.complement, self.metric))

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
    """A function that gives a contact, for other frames of contact and tool."""

    function: Callable[[Array], Contact]
    offset: Array
    tool_offset: Array

    def __call__(self, tool: Array) -> Contact:
        """The contact for a tool's pose in the new tool frame."""
        return self.function(tool.dot(se3.inverse(self.tool_offset, check=False))).relabelled(self.offset)


def _angle(value: float) -> float:
    angle = arrays.number(value, "normal_within", "an angle in radians", positive=True)
    if angle > MOST_TILT:
        raise BadInput("normal_within", f"{angle:g} rad", f"at most {MOST_TILT:g} rad")
    return angle


def _limit(value: float, argument: str) -> float:
    return arrays.number(value, argument, "a number or inf", positive=True, infinite=True)
