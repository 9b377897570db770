"""A kind of contact that explains a recording: where it is, how surely, and the contact and the task that it makes."""

from __future__ import annotations

from functools import cached_property
from math import inf, sqrt
from typing import Any

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.force.contact import HybridTask
from invariantqp.force.contact_kinds import BALL, FACE, LINE, PEG, POINT, Contact, ContactKind, screw_kind
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.identification.fit import OPEN, Fit, covariance
from invariantqp.identification.models import MODELS
from invariantqp.systems.classification import gibson_hunt

_KINDS = {"point": POINT, "sphere": POINT, "line": LINE, "face": FACE, "ball": BALL, "peg": PEG}


@frozen(eq=False, repr=False, slots=False)
class Candidate(Compared):
    """A kind of contact that neither motion nor wrench refutes.

    What is fixed to the base is given in the base frame and what is fixed to the tool in the tool frame. A surface is
    fixed to one of them, an axis of a hinge to both: it is given in the base frame.

    Attributes:
        kind: "point", "sphere", "line", "face", "ball", "peg", "hinge", "screw" or "slide".
        fixed_to: where the surface is, "base" or "tool"; "both" for faces and joints, which have a part of either.
        misfit: root mean square of what poses are off, in their noise; 1 is all that noise explains.
        wrench_misfit: likewise of wrenches, in the moments that are free whatever the friction; 0 where none is.
        surface: (4, 4) frame of the part that surface or axis belongs to, in the frame of what it is fixed to, the
            base's for "both"; z is the way that the tool presses, or the axis.
        tip: (4, 4) frame of the other part, in the tool frame, or in the base frame for a surface fixed to the tool.
        covariance: (12 + e, 12 + e) of the small twists (omega; v) of `surface` and of `tip` in themselves, and of e
            numbers, the curvature or the pitch. What changes nothing about the contact has no variance; what the
            recording does not determine has a large one.
    """

    kind: str
    fixed_to: str
    misfit: float
    wrench_misfit: float
    surface: Array
    tip: Array
    extra: Array
    covariance: Array
    size: float  # of the motion [length], by which the covariance is large or not

    def __repr__(self) -> str:
        return f"Candidate({self.kind!r}, fixed_to={self.fixed_to!r}, misfit={self.misfit:.2f})"

    @property
    def point(self) -> Array | None:
        """(3,) the tip, in the frame of what it is fixed to; of a joint a point of its axis, or its centre."""
        place = self.surface if self.kind in ("ball", "peg", "hinge", "screw") else self.tip
        return None if self.kind == "slide" else np.asarray(place[:3, 3])

    @property
    def normal(self) -> Array | None:
        """(3,) outward normal of the plane, in the frame of what it is fixed to; None where there is none, or many."""
        return np.asarray(-self.surface[:3, 2]) if self.kind in ("point", "line", "face") else None

    @property
    def axis(self) -> Array | None:
        """(3,) direction of a joint's axis, or of an edge in the frame of what it is fixed to."""
        if self.kind == "line":
            return np.asarray(self.tip[:3, 0])
        return np.asarray(self.surface[:3, 2]) if self.kind in ("peg", "hinge", "screw", "slide") else None

    @property
    def pitch(self) -> float | None:
        """Translation along the axis per radian [length/rad]: 0 of a hinge, inf of a slide."""
        return float(self.extra[0]) if self.kind == "screw" else {"hinge": 0.0, "slide": inf}.get(self.kind)

    @property
    def centre(self) -> Array | None:
        """(3,) of a sphere, in the frame of what it is fixed to."""
        s = self.surface
        return np.asarray(s[:3, 3] - s[:3, 2] / self.extra[0]) if self.kind == "sphere" else None

    @property
    def radius(self) -> float | None:
        """Of a sphere [length]: positive where the tool is outside of a ball, negative where it is in a hollow."""
        side = 1.0 if self.fixed_to == "tool" else -1.0
        return float(side / self.extra[0]) if self.kind == "sphere" else None

    @cached_property
    def deviations(self) -> dict[str, float]:
        """Standard deviations: of "normal" and "axis" [rad], "point" [length], "pitch" [length/rad], "radius" [length].

        inf is what the recording does not determine.
        """
        found = {}
        for name, entries in MODELS[self.kind].known.items():
            variance = float(np.diag(self.covariance)[entries].sum())
            limit = OPEN if max(entries) % 6 < 3 else OPEN * self.size
            found[name] = sqrt(variance) if variance < limit * limit else inf
        if self.kind == "screw":
            found["pitch"] = sqrt(self.covariance[12, 12])
        if self.kind == "sphere":
            found["radius"] = sqrt(self.covariance[12, 12]) / float(self.extra[0]) ** 2
        return found

    @cached_property
    def contact_kind(self) -> ContactKind:
        """What it allows and constrains, in the contact's own frame."""
        return _KINDS.get(self.kind) or screw_kind(self.pitch or 0.0)

    @property
    def gibson_hunt(self) -> str:
        """The type of its freedoms S as a screw system ([DS] Sect. 3)."""
        return str(gibson_hunt(np.asarray(self.contact_kind.freedoms)))

    def contact(self, tool: ArrayLike) -> Contact:
        """The contact with the tool at a (4, 4) pose in the base frame."""
        return Contact(self.contact_kind, self.frame(arrays.pose(tool, "tool")))

    def frame(self, X: Array) -> Array:
        """(4, 4) of the contact at a tool pose: z the way the tool presses, or the axis; x along an edge."""
        surface, tip = (X.dot(self.surface), self.tip) if self.fixed_to == "tool" else (self.surface, X.dot(self.tip))
        frame = np.array(surface)
        frame[:3, 3] = tip[:3, 3]
        if self.kind in ("peg", "hinge", "screw"):
            along = surface[:3, 2]
            reach = along.dot(tip[:3, 3] - surface[:3, 3]) if self.kind == "peg" else 0.0
            frame[:3, 3] = surface[:3, 3] + reach * along
        if self.kind == "sphere":
            p = surface[:3, :3].T.dot(tip[:3, 3] - surface[:3, 3])
            n = surface[:3, :3].dot(np.array([0.0, 0.0, 1.0]) + self.extra[0] * p)
            frame = se3.pose_along_z(n, tip[:3, 3])
        if self.kind == "line":
            edge, z = tip[:3, 0], surface[:3, 2]
            x = edge - z * z.dot(edge)
            x /= se3.norm(x)
            frame[:3, :3] = np.column_stack((x, se3.cross(z, x), z))
        return frame

    def as_json(self) -> dict[str, Any]:
        """Everything in numbers, text, lists and dictionaries; null is what there is none of, or is not known."""
        found: dict[str, Any] = {"kind": self.kind, "fixed_to": self.fixed_to, "gibson_hunt": self.gibson_hunt}
        found.update(misfit=self.misfit, wrench_misfit=self.wrench_misfit)
        for name in ("point", "normal", "axis", "centre"):
            value = getattr(self, name)
            found[name] = None if value is None else value.tolist()
        found.update(pitch=None if self.pitch == inf else self.pitch, radius=self.radius)
        found["deviations"] = {name: None if d == inf else d for name, d in self.deviations.items()}
        return found

    def task(self, press: float | ArrayLike = 0.0, **options: Any) -> HybridTask:
        """A task that presses on this contact, or moves along it without forcing it.

        `press` is the force to press with; of a joint the parts in its constraints, 0 for all by default. `options` are
        of `HybridTask`.
        """
        kind = self.contact_kind
        count = kind.constraints.shape[1]
        given = arrays.array(press, "press", "a force, or parts in the contact's constraints")
        if given.ndim:
            wanted = arrays.vector(given, count, "press")
        else:
            force = arrays.number(float(given), "press", "a force")
            if force and not kind.presses:
                expected = f"0, or {count} parts in its constraints"
                raise BadInput("press", f"{force:g}, and a {self.kind} that holds both ways", expected)
            wanted = np.array([force, *[0.0] * (count - 1)])
        fixed = self.kind in ("hinge", "screw")
        return HybridTask(self.contact(np.eye(4)) if fixed else self.contact, wanted, **options)


def candidate(fit: Fit, reversed_: bool, press: float, size: float) -> Candidate:
    """A candidate from its fit, of inverse poses where the surface is fixed to the tool.

    `press` is 1 where the fitted wrench presses along z of the base frame of the contact, -1 against it, 0 for joints;
    `size` is that of the motion [length].
    """
    surface, tip, extra = fit.base, fit.tool, fit.extra.copy()
    # Of inverse poses the wrench was the base's: the tool presses the other way.
    flip = press * (-1.0 if reversed_ else 1.0) < 0.0
    spread = covariance(fit, size)
    if flip:
        over = np.diag([1.0, -1.0, -1.0, 1.0])
        surface, tip = surface @ over, tip @ over
        turn = np.diag([1.0, -1.0, -1.0] * 4 + [-1.0] * len(extra))
        spread = turn @ spread @ turn
        extra = -extra if fit.model.kind == "sphere" else extra
    side = ("tool" if reversed_ else "base") if fit.model.reversible else "both"
    return Candidate(fit.model.kind, side, fit.motion, fit.wrench, surface, tip, extra, spread, size)
