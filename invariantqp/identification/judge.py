"""Which kinds of contact explain a stretch of a recording, and why the others do not.

A kind is refuted by motion, where poses leave it by more than their noise; by wrenches, where moments act about what
turns freely; and a kind that can only be pressed also where it is pulled, where its side force is more than friction
has, acts across the slide instead of along it, or drives it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.identification.fit import SURELY, Fit, Samples, Start, covariance, fit, starts
from invariantqp.identification.models import MODELS, Model, angles
from invariantqp.identification.motions import applied, coadjoint, cross, inverse, skew

# A kind is refuted where poses or wrenches leave it by so many times their noise, root mean square: noise given or
# estimated half as large as it is refutes nothing.
MISFIT = 2.0
# A misfit that a further start ends at again, to this share, is the least.
SAME = 1e-2
# A step that would lower the sum of squares by less than this moves no parameter by a third of its standard deviation.
ENOUGH = 0.1
# Beyond so many standard deviations a pitch or a curvature is not zero.
SURE = 5.0
# Kinds whose frames are those of another kind that moves in more ways.
_WITHIN = {
    "peg": ("slide", "hinge", "screw"),
    "ball": ("hinge",),
    "line": ("face",),
    "point": ("line",),
    "sphere": ("point",),
}
# Pressed for so large a share of the samples is pressed.
PRESSED = 0.95
# Share of the side force that acts across the slide where it is not friction; by chance it is 0.7.
CROSSWISE = 0.6


class Verdict(NamedTuple):
    """What is said of one kind, its surface fixed to the base or to the tool."""

    model: Model
    reversed: bool
    fit: Fit
    why: str  # why it is refuted; "" if it is not
    press: float = 0.0  # 1 where the fitted wrench presses along z, -1 against; 0 of joints

    @property
    def key(self) -> str:
        """Its name, with the side of the surface where that may be either."""
        side = " on the tool" if self.reversed else " on the base" if self.model.reversible else ""
        return f"{self.model.kind}{side}"

    @property
    def misfit(self) -> float:
        """The larger one."""
        return max(self.fit.motion, self.fit.wrench)


def judged(samples: Samples, kinds: tuple[str, ...]) -> list[Verdict]:
    """A verdict on each kind."""
    return _simplest(list(_verdicts(samples, kinds)), samples)


def explains(samples: Samples, kinds: tuple[str, ...]) -> bool:
    """Whether some kind is not refuted."""
    return any(not v.why for v in _verdicts(samples, kinds))


def _verdicts(samples: Samples, kinds: tuple[str, ...]) -> Iterator[Verdict]:
    """One kind after the other, those that move in fewer ways first."""
    sides, found = (samples, samples.reversed), list[Verdict]()
    for model in MODELS.values():
        for reversed_ in (False, True)[: 1 + model.reversible] if model.kind in kinds else ():
            side = sides[reversed_]
            found.append(_verdict(reversed_, _best(model, side, _inside(model, reversed_, found)), side))
            yield found[-1]


def _inside(model: Model, reversed_: bool, found: list[Verdict]) -> list[Start]:
    """Where a kind may begin: at kinds that fit and move in fewer ways, all of which are its own too."""
    at = []
    for v in found:
        if v.model.kind not in _WITHIN.get(model.kind, ()) or not v.fit.motion < MISFIT:
            continue
        if v.reversed == reversed_ or not v.model.reversible:
            base, tool = (v.fit.base, v.fit.tool) if v.reversed == reversed_ else (v.fit.tool, v.fit.base)
            at.append((base, tool, np.zeros(model.extra)))
    return at


def _best(model: Model, samples: Samples, inside: Sequence[Start]) -> Fit:
    """The best fit from any start, until one is near, or two end at the same."""
    tried: list[Fit] = []
    for start in (*inside, *starts(model, samples)):
        tried.append(_at_its_press(fit(model, samples, start, ENOUGH), samples))
        least, *others = sorted(one.worst for one in tried)
        if least < 0.75 * MISFIT or (others and others[0] < (1.0 + SAME) * least):
            break
    return next(one for one in tried if one.worst <= (1.0 + SAME) * least)


def _at_its_press(found: Fit, samples: Samples) -> Fit:
    """A face or an edge with its origin where it is pressed: m = p x f in the mean."""
    if found.model.kind not in ("face", "line"):
        return found
    w = samples.wrench @ coadjoint(inverse(found.tool)).T
    F = skew(w[:, 3:])
    p = np.linalg.lstsq(F.reshape(-1, 3), -w[:, :3].reshape(-1), rcond=1e-6)[0]
    if found.model.kind == "line":
        p[1:] = 0.0
    base, tool = found.base.copy(), found.tool.copy()
    tool[:3, 3] += tool[:3, :3] @ p
    base[:3, 3] += base[:3, 2] * p[2]  # a face keeps its distance
    return found._replace(base=base, tool=tool)


def _verdict(reversed_: bool, found: Fit, samples: Samples) -> Verdict:
    """What poses and wrenches say of a fit."""
    why, press = _refuted(found, samples), 0.0
    if found.model.pressed and not why:
        why, press = _pressed(found, samples)
    return Verdict(found.model, reversed_, found, why, press)


def _refuted(found: Fit, samples: Samples) -> str:
    """Why a fit is refuted, whether it is pressed or holds both ways; "" if it is not."""
    if not found.motion < MISFIT:
        return f"poses leave it by {found.motion:.3g} times their noise"
    if not found.wrench < MISFIT:
        return f"moments about what turns freely are {found.wrench:.3g} times their noise"
    if found.model.kind in ("hinge", "screw"):
        turned = angles(inverse(found.base) @ samples.pose @ found.tool, samples.turned @ found.tool[:3, 2])
        noise = sqrt(float(np.trace(samples.pose_noise[:, :3, :3], axis1=1, axis2=2).mean()) / 3.0)
        if np.std(turned) < SURELY * noise and (samples.slides(found.tool[:3, 3])[2] > 0.5).any():
            return "it slid and never turned"
    if found.model.kind == "peg":
        x, y, z = np.mean(_forces(found, samples) ** 2, axis=0)
        if z > x + y:  # rubber on dry concrete has a friction of one
            return "it was pushed along its axis, harder than friction holds"
    return ""


def _forces(found: Fit, samples: Samples) -> Array:
    """(n, 3) in the base frame of the contact."""
    return applied(found.base[:3, :3].T @ samples.pose[:, :3, :3], samples.wrench[:, 3:])


def _pressed(found: Fit, samples: Samples) -> tuple[str, float]:
    """Why friction refutes a contact that is pressed, not pulled, or "", and the sign of its press along z."""
    f, p = _forces(found, samples), (inverse(found.base) @ samples.pose @ found.tool)[:, :3, 3]
    n = np.broadcast_to(np.array([0.0, 0.0, 1.0]), p.shape)
    if found.model.kind == "sphere":
        n = n + found.extra[0] * p
        n = n / np.linalg.norm(n, axis=1)[:, None]
    press = (f * n).sum(axis=1)
    sign = float(np.sign(np.median(press)))
    noise = sqrt(float(np.trace(samples.wrench_noise[:, 3:, 3:], axis1=1, axis2=2).mean()) / 3.0)
    if np.mean(sign * press > -SURELY * noise) < PRESSED:
        return "it was pulled as well as pressed", sign
    side = f - press[:, None] * n
    if np.mean(np.linalg.norm(side, axis=1) < np.abs(press) + SURELY * noise) < PRESSED:
        return "its side force is more than friction has", sign
    which, way, sure = samples.slides(found.tool[:3, 3])
    slides = sure > 0.5
    u, f, normal = way[slides] @ found.base[:3, :3], side[which[slides]], n[which[slides]]
    along, across = (f * u).sum(axis=1), (f * cross(normal, u)).sum(axis=1)  # of the side force, where it slides
    if len(along) >= 10 and np.sqrt(np.mean(across**2 + along**2)) > SURELY * noise:
        if np.mean(across**2) > CROSSWISE**2 * np.mean(along**2 + across**2):
            return "its side force acts across the slide, and friction along it", sign
        if -along.sum() > CROSSWISE * np.abs(along).sum():
            return "friction would drive it: is the sign of the wrenches right?", sign
    return "", sign


def _simplest(verdicts: list[Verdict], samples: Samples) -> list[Verdict]:
    """A screw without pitch is a hinge, a sphere without curvature a plane: where the simpler kind is left."""
    left = {(v.model.kind, v.reversed) for v in verdicts if not v.why}
    found = []
    for v in verdicts:
        simpler, name = {"screw": ("hinge", "pitch"), "sphere": ("point", "curvature")}.get(v.model.kind, ("", ""))
        if not v.why and (simpler, v.reversed) in left and _is_zero(v, samples):
            v = v._replace(why=f"its {name} is zero, within its noise: a {simpler}")  # noqa: PLW2901
        found.append(v)
    return found


def _is_zero(v: Verdict, samples: Samples) -> bool:
    """Whether a pitch or a curvature is zero within what is known of it, and that is something."""
    size = float(np.sqrt(samples.pose[:, :3, 3].var(axis=0).sum()))
    value, deviation = float(v.fit.extra[0]), sqrt(covariance(v.fit, size)[-1, -1])
    usual = size if v.model.kind == "screw" else 1.0 / size
    return abs(value) < SURE * deviation < usual
