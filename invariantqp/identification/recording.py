"""A recording, checked: poses, the wrenches that the tool exerts, and the noise of both.

    noise    given, or  cov(third differences) / 20:  of a smooth motion with white noise those are noise
    blocks   wrenches are averaged over about 150 stretches of the recording; white noise falls by their length, what
             is given beyond it does not

Noise is a tensor: the covariance of a twist or a wrench in the tool frame.

In a file, a CSV with a header or an NPZ, a recording is

    time or t                       [s], evenly spaced; left out where it is not known
    joint names, or q1 ... qm       [rad, length], with a robot; or
    x y z qx qy qz qw               of the tool frame in the base frame
    fx fy fz, mx my mz or tx ty tz  what the sensor reads

An NPZ has the same as arrays: `time` (n,), `q` (n, m) or `poses` (n, 4, 4), `force` (n, 3) and `moment` (n, 3).
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from math import sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from invariantqp.control.tracking import LONG_TIME
from invariantqp.errors import BadInput, excerpt
from invariantqp.force.sensor import WrenchSensor, load_of, wrench_of
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.identification.fit import SURELY, Samples
from invariantqp.identification.motions import applied, coadjoint, inverse, poses, twists
from invariantqp.robots.kinematics import Robot

# Fewer samples say nothing of their noise, and too little of a contact.
FEWEST = 30
# Stretches into which a recording is divided: a person's motion has a few hertz, a recording ten seconds.
BLOCKS = 150
# The kind is decided by these; where the contact is, by so many samples at most: every one of ten seconds at 200 Hz.
MOST_SAMPLES = 2000
FORCE, MOMENT, POSE = (
    ("fx", "fy", "fz"),
    (("mx", "my", "mz"), ("tx", "ty", "tz")),
    ("x", "y", "z", "qx", "qy", "qz", "qw"),
)
# How far a quaternion's length may be from one: files with four digits pass.
UNIT = 1e-3
WITH_ROBOT = "Joint positions need a robot: --robot NAME, or a URDF file."


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
    """(6, 6) second moment about zero without jerks, such as impacts: trimmed until nothing more is left out.

    A jerk is longer than one of so many vectors of noise would be with a chance of one half.
    """
    kept, most = differences, float(chdtri(6, 0.5 / max(1, len(differences))))
    for _ in range(20):
        N = kept.T @ kept / max(1, len(kept))
        try:
            distance = (differences * np.linalg.solve(N, differences.T).T).sum(axis=1)
        except np.linalg.LinAlgError:  # no noise: the caller says so
            return np.asarray(N)
        inside = differences[distance < most]
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


class File(NamedTuple):
    """A recording as read from a file."""

    time: Array | None  # (n,) [s]
    q: Array | None  # (n, m), or None where poses were recorded
    poses: Array  # (n, 4, 4) of the tool frame
    readings: Array  # (n, 6) (m; f) as the sensor gives them
    unused: tuple[str, ...] = ()  # columns that nothing was read from


def read(path: Path | str, robot: Robot | None = None) -> File:
    """A recording from a .csv or .npz file, with the robot whose joint positions it has, if any."""
    file = Path(path)
    name = str(file)
    expected = "a .csv or .npz file of numbers"
    if file.suffix.lower() not in (".csv", ".npz"):
        raise BadInput(name, f"the ending {file.suffix!r}", expected)
    try:
        if file.suffix.lower() == ".csv":
            columns = _csv(file, name)
        else:
            with np.load(file, allow_pickle=False) as archive:
                columns = _flat({key: np.asarray(archive[key], dtype=float) for key in archive.files})
    except OSError as error:
        raise BadInput(name, (error.strerror or str(error)).lower(), expected) from error
    except (ValueError, EOFError) as error:
        if isinstance(error, BadInput):
            raise
        raise BadInput(name, str(error), expected) from error
    return _recording(columns, name, robot)


def _csv(file: Path, name: str) -> dict[str, Array]:
    with file.open(newline="", encoding="utf-8-sig") as lines:
        rows = [row for row in csv.reader(lines, skipinitialspace=True) if row and not row[0].startswith("#")]
    if not rows:
        raise BadInput(name, "nothing", "a header and a line a sample")
    header = [word.strip() for word in rows[0]]
    for column in header:
        if header.count(column) > 1:
            raise BadInput(name, f"two columns {column!r}", "each name once")
    values = np.empty((len(rows) - 1, len(header)))
    for k, row in enumerate(rows[1:]):
        if len(row) != len(header):
            raise BadInput(name, f"{len(row)} numbers in sample {k}", f"{len(header)}, as the header has names")
        for j, word in enumerate(row):
            try:
                values[k, j] = float(word)
            except ValueError as error:
                raise BadInput(name, f"{word!r} for {header[j]} in sample {k}", "a number") from error
    return dict(zip(header, values.T, strict=True))


def _flat(archive: Mapping[str, Array]) -> dict[str, Array]:
    """The columns of an NPZ's arrays, by the names that a CSV has."""
    columns: dict[str, Array] = {}
    names = {"force": FORCE, "moment": MOMENT[0]}
    for key, a in archive.items():
        if key in names and a.ndim == 2 and a.shape[1] == 3:
            columns.update(zip(names[key], a.T, strict=True))
        elif key == "q" and a.ndim == 2:
            columns.update({f"q{j + 1}": column for j, column in enumerate(a.T)})
        elif key == "poses" and a.ndim == 3:
            columns["poses"] = a
        elif a.ndim == 1:
            columns[key] = a
        else:
            raise ValueError(f"{key} of shape {a.shape}")
    return columns


def _recording(columns: dict[str, Array], name: str, robot: Robot | None) -> File:
    moment = _named(columns, *MOMENT)
    if not moment or not _named(columns, FORCE):
        found = f"columns {', '.join(columns) or 'none'}"
        raise BadInput(name, found, "fx, fy, fz and mx, my, mz: what the sensor reads")
    if len({len(a) for a in columns.values()}) > 1:
        raise BadInput(name, "arrays of different lengths", "one entry a sample in each")
    readings = _stacked(columns, (*moment, *FORCE))
    if not len(readings):
        raise BadInput(name, "no sample", "one a line")
    clock = _named(columns, ("time",), ("t",))
    time = _time(columns[clock[0]], name) if clock else None
    q: Array | None = None
    used: tuple[str, ...] = POSE
    if "poses" in columns:
        used, tool = ("poses",), columns["poses"]
    elif _named(columns, POSE):
        tool = quaternion_poses(_stacked(columns, POSE), name)
    elif robot is None:
        expected = f"{', '.join(POSE)}; or joint positions and a robot"
        raise BadInput(name, f"columns {', '.join(columns)}", expected, WITH_ROBOT)
    else:
        used, q = _positions(columns, name, robot)
        tool = np.array([robot.pose(state) for state in q])
    read_from = {*clock, *moment, *FORCE, *used}
    return File(time, q, tool, readings, tuple(w for w in columns if w not in read_from))


def _named(columns: dict[str, Array], *choices: tuple[str, ...]) -> tuple[str, ...]:
    """The first of some sets of names that are all of columns; () for none."""
    return next((names for names in choices if all(name in columns for name in names)), ())


def _time(time: Array, name: str) -> Array:
    """(n,) times [s], checked."""
    steps = np.diff(time)
    for k in np.flatnonzero(~((steps > 0.0) & np.isfinite(steps)))[:1].tolist():
        raise BadInput(name, f"time that does not grow after sample {k}", "seconds, evenly spaced")
    if len(steps) and np.median(steps) >= LONG_TIME:
        found = f"samples {np.median(steps):g} s apart"
        raise BadInput(name, found, "times in seconds, of samples at some 100 Hz", "Are these milliseconds?")
    return time


def _stacked(columns: dict[str, Array], names: Iterable[str]) -> Array:
    """(n, k) some of the columns."""
    return np.stack([columns[w] for w in names], axis=1)


def _positions(columns: dict[str, Array], name: str, robot: Robot) -> tuple[tuple[str, ...], Array]:
    """The columns of joint positions, called as the joints or numbered, and what they have (n, m)."""
    m = len(robot.names)
    words = _named(columns, robot.names, tuple(f"q{j + 1}" for j in range(m)), tuple(f"q{j}" for j in range(m)))
    if not words:
        raise BadInput(name, f"columns {', '.join(columns)}", f"{', '.join(robot.names)}; or q1 to q{m}")
    q = _stacked(columns, words)
    for k in np.flatnonzero(~np.isfinite(q).all(axis=1))[:1].tolist():
        raise BadInput(name, f"NaN or infinity in sample {k}", "joint positions", "Leave such samples out.")
    return words, q


def quaternion_poses(values: Array, name: str) -> Array:
    """(n, 4, 4) from rows x, y, z, qx, qy, qz, qw."""
    quaternions = values[:, 3:]
    length = np.sqrt((quaternions**2).sum(axis=1))
    for k in np.flatnonzero(~(np.abs(length - 1.0) < UNIT))[:1].tolist():
        raise BadInput(name, f"a quaternion of length {length[k]:.4g} in sample {k}", "qx, qy, qz, qw of length one")
    return poses(Rotation.from_quat(quaternions).as_matrix(), values[:, :3])


def seconds(file: File) -> Array:
    """(n,) times; 100 Hz where the file has none."""
    return np.arange(len(file.poses)) / 100.0 if file.time is None else file.time - file.time[0]
