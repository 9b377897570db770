"""A kind of contact that fits a recording: geometry, covariance, and the contact and task made of it."""

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
from invariantqp.identification.fit import UNDETERMINED, Fit, covariance
from invariantqp.identification.models import MODELS
from invariantqp.systems.classification import gibson_hunt

_KINDS = {"point": POINT, "sphere": POINT, "line": LINE, "face": FACE, "ball": BALL, "peg": PEG}


@frozen(eq=False, repr=False, slots=False)
class Candidate(Compared):
    """A kind of contact that neither motion nor wrench refutes.

    Geometry that is fixed to the base is given in the base frame, geometry that is fixed to the tool in the tool frame.
    The axis of a joint is given in the base frame.

    Attributes:
        kind: "point", "sphere", "line", "face", "ball", "peg", "hinge", "screw" or "slide".
        fixed_to: the body with the surface, "base" or "tool"; "both" for faces and joints.
        misfit: root mean square of the pose residuals, in standard deviations of their noise; 1 is noise alone.
        wrench_misfit: likewise of the free moments; 0 if the kind has none.
        surface: (4, 4) frame of the surface or axis, in the base frame, or in the tool frame if it is fixed to the
            tool; z is the direction in which the tool presses, or the axis.
        tip: (4, 4) frame of the other part, in the tool frame, or the base frame if the surface is fixed to the tool.
        parameters: (e,) curvature [1/length] of a sphere or pitch [length/rad] of a screw; e = 0 for other kinds.
        covariance: (12 + e, 12 + e) of the small twists (omega; v) of `surface` and `tip`, in their own axes, and of
            `parameters`. Changes that leave the contact the same have no variance, undetermined ones a large variance.
        size: extent of the motion [length], which scales the variance of what is undetermined.
    """

    kind: str
    fixed_to: str
    misfit: float
    wrench_misfit: float
    surface: Array
    tip: Array
    parameters: Array
    covariance: Array
    size: float

    def __repr__(self) -> str:
        return f"Candidate({self.kind!r}, fixed_to={self.fixed_to!r}, misfit={self.misfit:.2f})"

    @property
    def point(self) -> Array | None:
        """(3,) position of the tip; of a joint a point of its axis, or its centre; None of a slide."""
        frame = self.surface if self.kind in ("ball", "peg", "hinge", "screw") else self.tip
        return None if self.kind == "slide" else np.asarray(frame[:3, 3])

    @property
    def normal(self) -> Array | None:
        """(3,) outward normal of the plane; None for a sphere or a joint."""
        return np.asarray(-self.surface[:3, 2]) if self.kind in ("point", "line", "face") else None

    @property
    def axis(self) -> Array | None:
        """(3,) direction of a joint's axis or of an edge; None for other kinds."""
        if self.kind == "line":
            return np.asarray(self.tip[:3, 0])
        return np.asarray(self.surface[:3, 2]) if self.kind in ("peg", "hinge", "screw", "slide") else None

    @property
    def pitch(self) -> float | None:
        """Pitch of a joint [length/rad]: 0 for a hinge, inf for a slide, None for other kinds."""
        return float(self.parameters[0]) if self.kind == "screw" else {"hinge": 0.0, "slide": inf}.get(self.kind)

    @property
    def centre(self) -> Array | None:
        """(3,) centre of a sphere, None for other kinds."""
        s = self.surface
        return np.asarray(s[:3, 3] - s[:3, 2] / self.parameters[0]) if self.kind == "sphere" else None

    @property
    def radius(self) -> float | None:
        """Radius of a sphere [length]: positive outside a ball, negative in a hollow; None for other kinds."""
        side = 1.0 if self.fixed_to == "tool" else -1.0
        return float(side / self.parameters[0]) if self.kind == "sphere" else None

    @cached_property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of "normal" and "axis" [rad], "point" and "radius" [length], "pitch" [length/rad].

        A quantity that the recording does not determine has inf.
        """
        deviations = {}
        for name, entries in MODELS[self.kind].determined_by.items():
            variance = float(np.diag(self.covariance)[entries].sum())
            limit = UNDETERMINED if max(entries) % 6 < 3 else UNDETERMINED * self.size
            deviations[name] = sqrt(variance) if variance < limit * limit else inf
        if self.kind == "screw":
            deviations["pitch"] = sqrt(self.covariance[12, 12])
        if self.kind == "sphere":
            deviations["radius"] = sqrt(self.covariance[12, 12]) / float(self.parameters[0]) ** 2
        return deviations

    @cached_property
    def contact_kind(self) -> ContactKind:
        """Freedoms and constraints, in the contact frame."""
        return _KINDS.get(self.kind) or screw_kind(self.pitch or 0.0)

    @property
    def gibson_hunt(self) -> str:
        """Gibson-Hunt type of the screw system of its freedoms ([DS] Sect. 3)."""
        return str(gibson_hunt(np.asarray(self.contact_kind.freedoms)))

    def contact(self, tool: ArrayLike) -> Contact:
        """The contact at a tool pose (4, 4) in the base frame."""
        return Contact(self.contact_kind, self.frame(arrays.pose(tool, "tool")))

    def frame(self, X: Array) -> Array:
        """(4, 4) contact frame at a tool pose: z is the direction of the press, or the axis; x is along an edge."""
        surface, tip = (X.dot(self.surface), self.tip) if self.fixed_to == "tool" else (self.surface, X.dot(self.tip))
        frame = np.array(surface)
        frame[:3, 3] = tip[:3, 3]
        if self.kind in ("peg", "hinge", "screw"):
            axis = surface[:3, 2]
            depth = axis.dot(tip[:3, 3] - surface[:3, 3]) if self.kind == "peg" else 0.0
            frame[:3, 3] = surface[:3, 3] + depth * axis
        if self.kind == "sphere":
            p = surface[:3, :3].T.dot(tip[:3, 3] - surface[:3, 3])
            n = surface[:3, :3].dot(np.array([0.0, 0.0, 1.0]) + self.parameters[0] * p)
            frame = se3.pose_along_z(n, tip[:3, 3])
        if self.kind == "line":
            edge, z = tip[:3, 0], surface[:3, 2]
            x = edge - z * z.dot(edge)
            x /= se3.norm(x)
            frame[:3, :3] = np.column_stack((x, se3.cross(z, x), z))
        return frame

    def as_json(self) -> dict[str, Any]:
        """The candidate as JSON types; None for infinity and for quantities that the kind does not have."""
        vectors = {name: getattr(self, name) for name in ("point", "normal", "axis", "centre")}
        return {
            **{name: getattr(self, name) for name in ("kind", "fixed_to", "gibson_hunt", "misfit", "wrench_misfit")},
            **{name: None if value is None else value.tolist() for name, value in vectors.items()},
            "pitch": None if self.pitch == inf else self.pitch,
            "radius": self.radius,
            "deviations": {name: None if d == inf else d for name, d in self.deviations.items()},
        }

    def task(self, press: float | ArrayLike = 0.0, **options: Any) -> HybridTask:
        """A task that presses on this contact, or moves along it without force.

        Args:
            press: force of the press [N], or a wrench as coefficients in the contact's constraints.
            options: of `HybridTask`.

        Raises:
            BadInput: a force alone on a joint, which has no direction of press.
        """
        kind = self.contact_kind
        count = kind.constraints.shape[1]
        given = arrays.array(press, "press", "a force, or coefficients in the contact's constraints")
        if given.ndim:
            intensities = arrays.vector(given, count, "press")
        else:
            force = arrays.number(float(given), "press", "a force")
            if force and not kind.presses:
                expected = f"0, or {count} coefficients in its constraints"
                raise BadInput("press", f"{force:g}, and a {self.kind} that holds both ways", expected)
            intensities = np.array([force, *[0.0] * (count - 1)])
        is_fixed = self.kind in ("hinge", "screw")
        return HybridTask(self.contact(np.eye(4)) if is_fixed else self.contact, intensities, **options)


def candidate(fit: Fit, on_tool: bool, press: float, size: float) -> Candidate:
    """The candidate of a fit, which is one of inverse poses if the surface is fixed to the tool.

    `press` is 1 if the fitted wrench presses along z of the contact's base frame, -1 against it, 0 for joints; `size`
    is the extent of the motion [length].
    """
    surface, tip, parameters = fit.base, fit.tool, fit.parameters.copy()
    variances = covariance(fit, size)
    # For inverse poses the wrench is the one that the base exerts: the tool presses the other way.
    if press * (-1.0 if on_tool else 1.0) < 0.0:
        flip = np.diag([1.0, -1.0, -1.0, 1.0])
        surface, tip = surface @ flip, tip @ flip
        signs = np.diag([1.0, -1.0, -1.0] * 4 + [-1.0] * len(parameters))
        variances = signs @ variances @ signs
        parameters = -parameters if fit.model.kind == "sphere" else parameters
    side = ("tool" if on_tool else "base") if fit.model.is_reversible else "both"
    misfits = fit.pose_misfit, fit.wrench_misfit
    return Candidate(fit.model.kind, side, *misfits, surface, tip, parameters, variances, size)
