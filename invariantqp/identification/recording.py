"""A recording, checked: poses, the wrenches that the tool exerts, and the noise of both.

    noise    given, or  cov(third differences) / 20,  the covariance of white noise on a smooth motion
    blocks   wrenches averaged over about 150 stretches of the recording, which reduces their white noise

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
from scipy.special import chdtri

from invariantqp.errors import BadInput, excerpt
from invariantqp.force.sensor import WrenchSensor, load_of
from invariantqp.force.wrench import wrench_of
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.identification.fit import SIGMAS, Samples
from invariantqp.identification.se3_batch import approximate_log, coadjoint, inverse, matvec

# Fewest samples that determine a noise and a contact.
MIN_SAMPLES = 30
# Blocks by which the kind is decided: a person's motion has a few hertz, a recording ten seconds.
BLOCKS = 150
# Most samples by which the geometry is fitted: ten seconds at 200 Hz.
MAX_SAMPLES = 2000


@frozen(eq=False, slots=False)
class Recording(Compared):
    """Poses and wrenches with the covariances of their noise."""

    pose: Array  # (n, 4, 4)
    accumulated_rotation: Array  # (n, 3) sum of the rotation vectors from sample to sample, in the tool frame [rad]
    wrench: Array  # (n, 6) that the tool exerts, in the tool frame
    pose_noise: Array  # (6, 6)
    wrench_noise: Array  # (6, 6)
    white: float  # share of the wrench noise that is white
    accuracy: Array | None  # (6,) deviation of the contact from an ideal one, in addition to noise

    def blocks(self, start: int, stop: int) -> Samples:
        """Block averages of a stretch, without those that have no contact force."""
        samples = self._samples(start, stop, BLOCKS)
        loaded = _is_loaded(samples.wrench, samples.wrench_noise[0])
        return Samples(*(part[loaded] for part in samples)) if loaded.sum() >= MIN_SAMPLES else samples

    def every(self, start: int, stop: int) -> Samples:
        """At most MAX_SAMPLES samples of a stretch, those in contact; with a compliance if an accuracy is given."""
        blocks, samples = self.blocks(start, stop), self._samples(start, stop, MAX_SAMPLES)
        after = np.searchsorted(blocks.indices, samples.indices).clip(1, len(blocks.indices) - 1)
        near = (samples.indices >= blocks.indices[after - 1]) & (samples.indices <= blocks.indices[after])
        near &= np.diff(blocks.indices)[after - 1] <= 2 * ((stop - start) // BLOCKS | 1)  # adjacent blocks
        samples = Samples(*(part[near] for part in samples))
        if self.accuracy is None:
            return samples
        w, n = samples.wrench, len(samples.wrench)
        root = np.linalg.cholesky(w.T @ w / n + self.wrench_noise)
        u = np.linalg.solve(root, w.T).T / sqrt(6.0)
        by_compliance = np.einsum("ij,nk->nijk", np.diag(self.accuracy), u).reshape(n, 6, 36)
        return samples._replace(compliance_jacobian=by_compliance)

    def _samples(self, start: int, stop: int, most: int) -> Samples:
        """At most so many samples of a stretch, wrenches averaged over the samples between them."""
        n = stop - start
        size = max(1, n // most | 1)
        half, count = size // 2, min(most, n // size)
        at = start + np.linspace(half, n - 1 - half, count).round().astype(int)
        w = np.mean([self.wrench[at + j] for j in range(-half, half + 1)], axis=0)
        of_poses, of_wrenches = (
            np.broadcast_to(N, (count, 6, 6)) for N in (self.pose_noise, self._noise_of_mean(size))
        )
        no_compliance, rotation = np.zeros((count, 6, 0)), self.accumulated_rotation[at]
        return Samples(at, rotation, self.pose[at], w, of_poses, of_wrenches, no_compliance)

    def _noise_of_mean(self, size: int) -> Array:
        """(6, 6) covariance of the mean of so many wrenches."""
        return self.wrench_noise * (self.white / size + 1.0 - self.white)

    def loaded_stretches(self) -> list[tuple[int, int]]:
        """(start, stop) of each stretch in which the wrench exceeds its noise."""
        n = len(self.pose)
        size = max(1, n // BLOCKS | 1)
        edges = np.linspace(0, n, n // size + 1).round().astype(int)
        w = np.array([self.wrench[a:b].mean(axis=0) for a, b in pairwise(edges.tolist())])
        loaded = _is_loaded(w, self._noise_of_mean(size))
        # Forces pass zero within a contact: short gaps belong to it.
        spans: list[tuple[int, int]] = []
        for k in np.flatnonzero(loaded).tolist():
            a, b = int(edges[k]), int(edges[k + 1])
            if spans and a - spans[-1][1] < max(MIN_SAMPLES, 3 * size):
                spans[-1] = spans[-1][0], b
            else:
                spans.append((a, b))
        return spans


def _is_loaded(w: Array, noise: Array) -> NDArray[np.bool_]:
    """(n,) whether wrenches (n, 6) exceed their noise (6, 6) significantly."""
    return np.asarray((w * np.linalg.solve(noise, w.T).T).sum(axis=1) > 6.0 * SIGMAS**2)


def recording(
    poses: Any, wrenches: Any, exerts: bool, noise: Any, accuracy: ArrayLike | None, sensor: WrenchSensor | None
) -> Recording:
    """The recording of `identify`'s arguments, which are checked here."""
    X = _poses(poses)
    w = _wrenches(wrenches, X, arrays.flag(exerts, "exerts"), sensor)
    steps = approximate_log(inverse(X[:-1]) @ X[1:])
    rotation = np.concatenate((np.zeros((1, 3)), np.cumsum(steps[:, :3], axis=0)))
    # Third differences of white noise have 1 + 9 + 9 + 1 times its variance.
    white_pose, white_wrench = (_covariance(a) / 20.0 for a in (np.diff(steps, n=2, axis=0), np.diff(w, n=3, axis=0)))
    if noise is None:
        pose_noise, wrench_noise, white = white_pose, white_wrench, 1.0
    else:
        pose_noise, wrench_noise = _noise(noise)
        white = float(np.clip(np.trace(np.linalg.solve(wrench_noise, white_wrench)) / 6.0, 0.0, 1.0))
    pose_noise, wrench_noise, deviation = _with_accuracy(accuracy, pose_noise, wrench_noise)
    of_poses = 1.0, float(np.abs(X[:, :3, 3]).max()) or 1.0
    of_wrenches = [float(np.abs(part).max()) or 1.0 for part in (w[:, :3], w[:, 3:])]
    for name, N, sizes in (("poses", pose_noise, of_poses), ("wrenches", wrench_noise, of_wrenches)):
        scale = np.repeat(sizes, 3)
        if not np.linalg.eigvalsh(N / np.outer(scale, scale))[0] > arrays.ROUNDING**2:
            raise BadInput(
                name,
                "no noise in some direction: a simulation, or constant values",
                "noise that can be estimated from the recording",
                "Pass noise=(pose, wrench), or accuracy=(angle, length, moment, force).",
            )
    return Recording(X, rotation, w, pose_noise, wrench_noise, white, deviation)


def _poses(poses: Any) -> Array:
    expected = "(n, 4, 4) poses of the tool frame in the base frame"
    if isinstance(poses, Sequence):
        poses = [arrays.pose_matrix(pose) for pose in poses]
    X = arrays.array(poses, "poses", expected)
    if X.ndim != 3 or X.shape[1:] != (4, 4):
        raise BadInput("poses", f"shape {X.shape}", expected)
    if len(X) < MIN_SAMPLES:
        raise BadInput("poses", f"{len(X)} samples", f"{MIN_SAMPLES} or more, as a few seconds at 100 Hz give")
    for k in np.flatnonzero(~np.isfinite(X).all(axis=(1, 2)))[:1].tolist():
        raise BadInput("poses", f"NaN or infinity in sample {k}", expected, "Leave such samples out.")
    return arrays.poses(X, "poses")


def _wrenches(wrenches: Any, X: Array, exerts: bool, sensor: WrenchSensor | None) -> Array:
    n = len(X)
    expected = f"({n}, 6), one a pose, moment first"
    if sensor is not None and not isinstance(sensor, WrenchSensor):
        raise BadInput("sensor", excerpt(sensor), "a WrenchSensor, or None for wrenches in the tool frame")
    if sensor is not None and not exerts:
        raise BadInput("exerts", "False with a sensor", "True: the sensor's reads= says the sign")
    order = "moment first" if sensor is None else sensor.order
    readings = wrenches if isinstance(wrenches, np.ndarray) else arrays.sequence(wrenches, "wrenches", expected)
    if len(readings) != n:
        raise BadInput("wrenches", f"{len(readings)}", f"{n}, one a pose")
    w = np.array([wrench_of(reading, order, f"wrenches[{k}]") for k, reading in enumerate(readings)])
    if sensor is None:
        return w if exerts else -w
    loads = np.array([load_of(sensor, a, pose) for a, pose in zip(w, X, strict=True)])
    return matvec(coadjoint(sensor.mount), loads)


def _covariance(differences: Array) -> Array:
    """(6, 6) second moment about zero, trimmed of outliers, such as impacts, until none is left.

    An outlier is longer than the longest of n Gaussian vectors, with a probability of one half.
    """
    inliers, longest = differences, float(chdtri(6, 0.5 / max(1, len(differences))))
    for _ in range(20):
        N = inliers.T @ inliers / max(1, len(inliers))
        try:
            distance = (differences * np.linalg.solve(N, differences.T).T).sum(axis=1)
        except np.linalg.LinAlgError:  # no noise: `recording` refuses it
            return np.asarray(N)
        inside = differences[distance < longest]
        if len(inside) == len(inliers) or len(inside) < MIN_SAMPLES // 2:
            break
        inliers = inside
    return np.asarray(inliers.T @ inliers / max(1, len(inliers)))


def _noise(noise: Any) -> tuple[Array, Array]:
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


def _with_accuracy(accuracy: ArrayLike | None, pose: Array, wrench: Array) -> tuple[Array, Array, Array | None]:
    """Covariances of poses and wrenches with the accuracy added, and the accuracy (6,) of the contact."""
    if accuracy is None:
        return pose, wrench, None
    expected = "(angle [rad], length), or (angle, length, moment, force), all above zero"
    a = arrays.vector(accuracy, None, "accuracy")
    if len(a) not in (2, 4) or (a <= 0.0).any():
        raise BadInput("accuracy", excerpt(accuracy), expected, "It is the deviation of the contact from an ideal one.")
    deviation = np.repeat(a, 3)
    pose = pose + np.diag(deviation[:6] ** 2)
    return pose, wrench if len(a) == 2 else wrench + np.diag(deviation[6:] ** 2), deviation[:6]
