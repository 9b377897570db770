"""A recording, checked: poses, the wrenches that the tool exerts, and the noise of both.

    noise    given, or  cov(third differences) / 20:  of a smooth motion with white noise those are noise
    blocks   wrenches are averaged over about 150 stretches of the recording; white noise falls by their length, what
             is given beyond it does not

Noise is a tensor: the covariance of a twist or a wrench in the tool frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import sqrt
from typing import Any

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike, NDArray

from invariantqp.errors import BadInput, excerpt
from invariantqp.force.sensor import WrenchSensor, load_of, wrench_of
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.identification.fit import SURELY, Samples
from invariantqp.identification.motions import applied, coadjoint, inverse, twists

# Fewer samples say nothing of their noise, and too little of a contact.
FEWEST = 30
# Stretches into which a recording is divided: a person's motion has a few hertz, a recording ten seconds.
BLOCKS = 150
# The kind is decided by these; where the contact is, by so many samples at most: every one of ten seconds at 200 Hz.
MOST_SAMPLES = 2000
# A normal (6,) vector is longer than this, squared, once in a thousand: jerks, such as impacts, are not noise.
JERK = 22.46


@frozen(eq=False, slots=False)
class Recording(Compared):
    """Poses and wrenches with their noise."""

    pose: Array  # (n, 4, 4)
    turned: Array  # (n, 3) the turns from sample to sample, in the tool frame, summed up [rad]
    wrench: Array  # (n, 6) that the tool exerts, in the tool frame
    pose_noise: Array  # (6, 6)
    wrench_noise: Array  # (6, 6)
    white: float  # share of the wrenches' noise that is white, and so falls where they are averaged
    allowed: Array | None  # (6,) how far a contact may be off beside noise

    def blocks(self, start: int, stop: int) -> Samples:
        """Samples of a stretch, wrenches averaged; those without contact force left out."""
        samples = self._samples(start, stop, BLOCKS)
        loaded = _loaded(samples.wrench, samples.wrench_noise[0])
        return Samples(*(part[loaded] for part in samples)) if loaded.sum() >= FEWEST else samples

    def every(self, start: int, stop: int) -> Samples:
        """All samples of a stretch between blocks in contact; of a very long one, so many at most.

        They give way to the wrench where a contact may be off.
        """
        blocks, samples = self.blocks(start, stop), self._samples(start, stop, MOST_SAMPLES)
        after = np.searchsorted(blocks.at, samples.at).clip(1, len(blocks.at) - 1)
        near = (samples.at >= blocks.at[after - 1]) & (samples.at <= blocks.at[after])
        near &= np.diff(blocks.at)[after - 1] <= 2 * ((stop - start) // BLOCKS | 1)  # next to each other
        samples = Samples(*(part[near] for part in samples))
        if self.allowed is None:
            return samples
        w, n = samples.wrench, len(samples.wrench)
        root = np.linalg.cholesky(w.T @ w / n + self.wrench_noise)
        u = np.linalg.solve(root, w.T).T / sqrt(6.0)
        return samples._replace(bending=np.einsum("ij,nk->nijk", np.diag(self.allowed), u).reshape(n, 6, 36))

    def _samples(self, start: int, stop: int, most: int) -> Samples:
        """So many samples of a stretch at most, wrenches averaged over what is between them."""
        n = stop - start
        size = max(1, n // most | 1)
        half, count = size // 2, min(most, n // size)
        at = start + np.linspace(half, n - 1 - half, count).round().astype(int)
        w = np.mean([self.wrench[at + j] for j in range(-half, half + 1)], axis=0)
        pose_noise, wrench_noise = (np.broadcast_to(N, (count, 6, 6)) for N in (self.pose_noise, self._averaged(size)))
        return Samples(at, self.turned[at], self.pose[at], w, pose_noise, wrench_noise, np.zeros((count, 6, 0)))

    def _averaged(self, size: int) -> Array:
        """(6, 6) noise of the mean of so many wrenches."""
        return self.wrench_noise * (self.white / size + 1.0 - self.white)

    def contacts(self) -> list[tuple[int, int]]:
        """First sample of each stretch in which the tool is loaded, and the one after its last."""
        n = len(self.pose)
        size = max(1, n // BLOCKS | 1)
        edges = np.linspace(0, n, n // size + 1).round().astype(int)
        w = np.array([self.wrench[a:b].mean(axis=0) for a, b in pairwise(edges.tolist())])
        loaded = _loaded(w, self._averaged(size))
        # Forces pass zero within a contact: gaps of less than the fewest samples belong to it.
        spans: list[tuple[int, int]] = []
        for k in np.flatnonzero(loaded).tolist():
            a, b = int(edges[k]), int(edges[k + 1])
            if spans and a - spans[-1][1] < max(FEWEST, 3 * size):
                spans[-1] = spans[-1][0], b
            else:
                spans.append((a, b))
        return spans


def _loaded(w: Array, noise: Array) -> NDArray[np.bool_]:
    """(n,) whether wrenches (n, 6) are surely more than their noise (6, 6)."""
    return np.asarray((w * np.linalg.solve(noise, w.T).T).sum(axis=1) > 6.0 * SURELY**2)


def recording(
    poses: Any, wrenches: Any, exerts: bool, noise: Any, accuracy: ArrayLike | None, sensor: WrenchSensor | None
) -> Recording:
    """What `identify` takes, checked."""
    X = _poses(poses)
    w = _wrenches(wrenches, X, arrays.flag(exerts, "exerts"), sensor)
    steps = twists(inverse(X[:-1]) @ X[1:])
    turned = np.concatenate((np.zeros((1, 3)), np.cumsum(steps[:, :3], axis=0)))
    # Third differences of white noise have 1 + 9 + 9 + 1 times its variance.
    white_pose, white_wrench = (_covariance(a) / 20.0 for a in (np.diff(steps, n=2, axis=0), np.diff(w, n=3, axis=0)))
    if noise is None:
        pose_noise, wrench_noise, white = white_pose, white_wrench, 1.0
    else:
        pose_noise, wrench_noise = _given(noise)
        white = float(np.clip(np.trace(np.linalg.solve(wrench_noise, white_wrench)) / 6.0, 0.0, 1.0))
    pose_noise, wrench_noise, allowed = _allowed(accuracy, pose_noise, wrench_noise)
    of_poses = 1.0, float(np.abs(X[:, :3, 3]).max()) or 1.0
    of_wrenches = [float(np.abs(part).max()) or 1.0 for part in (w[:, :3], w[:, 3:])]
    for name, N, sizes in (("poses", pose_noise, of_poses), ("wrenches", wrench_noise, of_wrenches)):
        scale = np.repeat(sizes, 3)
        if not np.linalg.eigvalsh(N / np.outer(scale, scale))[0] > arrays.ROUNDING**2:
            raise BadInput(
                name,
                "no noise in some direction: a simulation, or numbers that stand still",
                "noise that can be estimated from the recording",
                "Give it: noise=(pose, wrench), or accuracy=(angle, length, moment, force).",
            )
    return Recording(X, turned, w, pose_noise, wrench_noise, white, allowed)


def _poses(poses: Any) -> Array:
    expected = "(n, 4, 4) poses of the tool frame in the base frame"
    if isinstance(poses, Sequence):
        poses = [arrays.matrix_of(pose) for pose in poses]
    X = arrays.array(poses, "poses", expected)
    if X.ndim != 3 or X.shape[1:] != (4, 4):
        raise BadInput("poses", f"shape {X.shape}", expected)
    if len(X) < FEWEST:
        raise BadInput("poses", f"{len(X)} samples", f"{FEWEST} or more, as a few seconds at 100 Hz give")
    for k in np.flatnonzero(~np.isfinite(X).all(axis=(1, 2)))[:1].tolist():
        raise BadInput("poses", f"NaN or infinity in sample {k}", expected, "Leave such samples out.")
    return arrays.poses(X, "poses")


def _wrenches(wrenches: Any, X: Array, exerts: bool, sensor: WrenchSensor | None) -> Array:
    n = len(X)
    expected = f"({n}, 6), one a pose, moment first"
    if sensor is not None and not isinstance(sensor, WrenchSensor):
        raise BadInput("sensor", excerpt(sensor), "a WrenchSensor, or None for wrenches in the tool frame")
    if sensor is not None and not exerts:
        raise BadInput("exerts", "False beside a sensor", "the sign in one place: the sensor's reads=")
    order = "moment first" if sensor is None else sensor.order
    readings = wrenches if isinstance(wrenches, np.ndarray) else arrays.listed(wrenches, "wrenches", expected)
    if len(readings) != n:
        raise BadInput("wrenches", f"{len(readings)}", f"{n}, one a pose")
    w = np.array([wrench_of(reading, order, f"wrenches[{k}]") for k, reading in enumerate(readings)])
    if sensor is None:
        return w if exerts else -w
    loads = np.array([load_of(sensor, a, pose.dot(sensor.mount)) for a, pose in zip(w, X, strict=True)])
    return applied(coadjoint(sensor.mount), loads)


def _covariance(differences: Array) -> Array:
    """(6, 6) second moment about zero without jerks: trimmed until nothing more is left out."""
    kept = differences
    for _ in range(20):
        N = kept.T @ kept / max(1, len(kept))
        try:
            distance = (differences * np.linalg.solve(N, differences.T).T).sum(axis=1)
        except np.linalg.LinAlgError:  # no noise: the caller says so
            return np.asarray(N)
        inside = differences[distance < JERK]
        if len(inside) == len(kept) or len(inside) < FEWEST // 2:
            break
        kept = inside
    return np.asarray(kept.T @ kept / max(1, len(kept)))


def _given(noise: Any) -> tuple[Array, Array]:
    expected = "(pose, wrench), each six standard deviations or a (6, 6) covariance, in the tool frame"
    try:
        pose, wrench = noise
    except (TypeError, ValueError) as error:
        raise BadInput("noise", excerpt(noise), expected) from error
    given = []
    for value, argument in ((pose, "noise[0]"), (wrench, "noise[1]")):
        a = arrays.array(value, argument, expected)
        given.append(arrays.positive_definite(a * a if a.shape == (6,) else a, 6, argument))
    return given[0], given[1]


def _allowed(accuracy: ArrayLike | None, pose: Array, wrench: Array) -> tuple[Array, Array, Array | None]:
    """Noise with what a real contact, or a sensor, may be off beside it, and what that is of a contact."""
    if accuracy is None:
        return pose, wrench, None
    expected = (
        "(angle [rad], length), or (angle, length, moment, force): how far a real contact may be from an ideal one"
    )
    a = arrays.vector(accuracy, None, "accuracy")
    if len(a) not in (2, 4) or (a <= 0.0).any():
        raise BadInput("accuracy", excerpt(accuracy), f"{expected}, all above zero")
    allowed = np.repeat(a, 3)
    pose = pose + np.diag(allowed[:6] ** 2)
    return pose, wrench if len(a) == 2 else wrench + np.diag(allowed[6:] ** 2), allowed[:6]
