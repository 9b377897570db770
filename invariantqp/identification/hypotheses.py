"""Tests of each kind of contact on a stretch of a recording.

A kind is refuted by motion if the poses violate its constraints by more than their noise, and by wrenches if moments
act about axes of free rotation. A unilateral kind is also refuted if it is pulled, and if its side force exceeds
friction, acts across the slide, or drives it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.identification.fit import SIGMAS, Fit, InitialGuess, Samples, covariance, fit, initial_guesses
from invariantqp.identification.models import MODELS, Model, angles
from invariantqp.identification.se3_batch import coadjoint, inverse, matvec, skew

# Misfit above which a kind is refuted, in standard deviations: a noise estimate of half the true noise refutes nothing.
MISFIT = 2.0
# Relative difference of two misfits that counts as the same minimum.
SAME_MISFIT = 1e-2
# Convergence tolerance of a first fit: its last step is below a third of a standard deviation.
COARSE_CONVERGENCE = 0.1
# Standard deviations beyond which a pitch or curvature is not zero.
NONZERO = 5.0
# Kinds whose motion is a special case of another kind's: their frames are initial guesses for it.
_SPECIAL_CASES = {
    "peg": ("slide", "hinge", "screw"),
    "ball": ("hinge",),
    "line": ("face",),
    "point": ("line",),
    "sphere": ("point",),
}
# Share of the samples in which a unilateral contact must be pressed, with its side force inside the friction cone.
PRESSED_SHARE = 0.95
# Share of the side force that may act across the slide; of a random direction it is 0.7.
LATERAL_SHARE = 0.6


class Hypothesis(NamedTuple):
    """One kind of contact, with its surface on the base or on the tool, and the result of its test."""

    model: Model
    on_tool: bool
    fit: Fit
    rejection: str  # why it is refuted; "" if it is not
    press: float = 0.0  # 1 if the fitted wrench presses along z, -1 against it; 0 for joints

    @property
    def name(self) -> str:
        """The kind, and the body with the surface if the kind allows both."""
        side = " on the tool" if self.on_tool else " on the base" if self.model.is_reversible else ""
        return f"{self.model.kind}{side}"

    @property
    def misfit(self) -> float:
        """The larger one of the misfits of poses and wrenches."""
        return max(self.fit.pose_misfit, self.fit.wrench_misfit)


def tested_kinds(samples: Samples, kinds: tuple[str, ...]) -> list[Hypothesis]:
    """The results for all kinds; a general kind is refuted if it degenerates to a simpler one that is left."""
    hypotheses = list(_hypotheses(samples, kinds))
    left = {(one.model.kind, one.on_tool) for one in hypotheses if not one.rejection}
    tested = []
    for one in hypotheses:
        simpler, name = {"screw": ("hinge", "pitch"), "sphere": ("point", "curvature")}.get(one.model.kind, ("", ""))
        if not one.rejection and (simpler, one.on_tool) in left and _is_degenerate(one, samples):
            tested.append(one._replace(rejection=f"its {name} is zero, within its noise: a {simpler}"))
        else:
            tested.append(one)
    return tested


def is_explained(samples: Samples, kinds: tuple[str, ...]) -> bool:
    """Whether some kind is not refuted."""
    return any(not one.rejection for one in _hypotheses(samples, kinds))


def _hypotheses(samples: Samples, kinds: tuple[str, ...]) -> Iterator[Hypothesis]:
    """The result for one kind after the other, those with fewer degrees of freedom first."""
    sides, tested = (samples, samples.inverted), list[Hypothesis]()
    for model in MODELS.values():
        for on_tool in (False, True)[: 1 + model.is_reversible] if model.kind in kinds else ():
            side = sides[on_tool]
            best = _best_fit(model, side, _from_special_cases(model, on_tool, tested))
            rejection, press = _rejection(best, side), 0.0
            if model.is_unilateral and not rejection:
                rejection, press = _unilateral_rejection(best, side)
            tested.append(Hypothesis(model, on_tool, best, rejection, press))
            yield tested[-1]


def _from_special_cases(model: Model, on_tool: bool, tested: list[Hypothesis]) -> list[InitialGuess]:
    """Frames of the special cases of a kind that fit."""
    guesses = []
    for one in tested:
        if one.model.kind not in _SPECIAL_CASES.get(model.kind, ()) or not one.fit.pose_misfit < MISFIT:
            continue
        if one.on_tool == on_tool or not one.model.is_reversible:
            base, tool = (one.fit.base, one.fit.tool) if one.on_tool == on_tool else (one.fit.tool, one.fit.base)
            guesses.append((base, tool, np.zeros(model.parameter_count)))
    return guesses


def _best_fit(model: Model, samples: Samples, guesses: Sequence[InitialGuess]) -> Fit:
    """The best fit from any guess, until one is good or two end in the same minimum."""
    tried: list[Fit] = []
    for guess in (*guesses, *initial_guesses(model, samples)):
        tried.append(_at_centre_of_pressure(fit(model, samples, guess, COARSE_CONVERGENCE), samples))
        least, *others = sorted(one.largest_misfit for one in tried)
        if least < 0.75 * MISFIT or (others and others[0] < (1.0 + SAME_MISFIT) * least):
            break
    return next(one for one in tried if one.largest_misfit <= (1.0 + SAME_MISFIT) * least)


def _at_centre_of_pressure(found: Fit, samples: Samples) -> Fit:
    """A face or an edge with its origin at the mean centre of pressure, m = p x f."""
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


def _rejection(found: Fit, samples: Samples) -> str:
    """Why a fit is refuted, for unilateral kinds and joints alike; "" if it is not."""
    if not found.pose_misfit < MISFIT:
        return f"poses leave it by {found.pose_misfit:.3g} times their noise"
    if not found.wrench_misfit < MISFIT:
        return f"moments about free axes are {found.wrench_misfit:.3g} times their noise"
    if found.model.kind in ("hinge", "screw"):
        C = inverse(found.base) @ samples.pose @ found.tool
        angle = angles(C, samples.accumulated_rotation @ found.tool[:3, 2])
        noise = _deviation(samples.pose_noise[:, :3, :3])
        if np.std(angle) < SIGMAS * noise and (samples.slides(found.tool[:3, 3])[2] > 0.5).any():
            return "it slid and never turned"
    if found.model.kind == "peg":
        x, y, z = np.mean(_forces(found, samples) ** 2, axis=0)
        if z > x + y:  # a friction coefficient of one, as rubber on dry concrete has
            return "it was pushed along its axis, harder than friction holds"
    return ""


def _deviation(covariances: Array) -> float:
    """Root mean square standard deviation of an entry, of covariances (n, 3, 3)."""
    return sqrt(float(np.trace(covariances, axis1=1, axis2=2).mean()) / 3.0)


def _forces(found: Fit, samples: Samples) -> Array:
    """(n, 3) forces in the contact's base frame."""
    return matvec(found.base[:3, :3].T @ samples.pose[:, :3, :3], samples.wrench[:, 3:])


def _unilateral_rejection(found: Fit, samples: Samples) -> tuple[str, float]:
    """Why press and friction refute a unilateral contact, or "", and the sign of its press along z."""
    f, p = _forces(found, samples), (inverse(found.base) @ samples.pose @ found.tool)[:, :3, 3]
    n = np.broadcast_to(np.array([0.0, 0.0, 1.0]), p.shape)
    if found.model.kind == "sphere":
        n = n + found.parameters[0] * p
        n = n / np.linalg.norm(n, axis=1)[:, None]
    press = (f * n).sum(axis=1)
    sign = float(np.sign(np.median(press)))
    noise = _deviation(samples.wrench_noise[:, 3:, 3:])
    if np.mean(sign * press > -SIGMAS * noise) < PRESSED_SHARE:
        return "it was pulled as well as pressed", sign
    side = f - press[:, None] * n
    if np.mean(np.linalg.norm(side, axis=1) < np.abs(press) + SIGMAS * noise) < PRESSED_SHARE:
        return "its side force is larger than friction can be", sign
    which, direction, confidence = samples.slides(found.tool[:3, 3])
    is_sliding = confidence > 0.5
    u, f, normal = direction[is_sliding] @ found.base[:3, :3], side[which[is_sliding]], n[which[is_sliding]]
    along, across = (f * u).sum(axis=1), (f * np.cross(normal, u)).sum(axis=1)
    if len(along) >= 10 and np.sqrt(np.mean(across**2 + along**2)) > SIGMAS * noise:
        if np.mean(across**2) > LATERAL_SHARE**2 * np.mean(along**2 + across**2):
            return "its side force acts across the slide, and friction along it", sign
        if -along.sum() > LATERAL_SHARE * np.abs(along).sum():
            return "friction would drive it: is the sign of the wrenches right?", sign
    return "", sign


def _is_degenerate(one: Hypothesis, samples: Samples) -> bool:
    """Whether a pitch or curvature is zero within its standard deviation, and that deviation is small."""
    size = samples.size
    value, deviation = float(one.fit.parameters[0]), sqrt(covariance(one.fit, size)[-1, -1])
    usual = size if one.model.kind == "screw" else 1.0 / size
    return abs(value) < NONZERO * deviation < usual
