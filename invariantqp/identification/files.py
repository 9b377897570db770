"""Recordings in files: a CSV with a header, or an NPZ, of joint positions or poses, and a sensor's readings.

    time or t                       [s], evenly spaced; left out where it is not known
    joint names, or q1 ... qm       [rad, length], with a robot; or
    x y z qx qy qz qw               of the tool frame in the base frame
    fx fy fz, mx my mz or tx ty tz  what the sensor reads

An NPZ has the same as arrays: `time` (n,), `q` (n, m) or `poses` (n, 4, 4), `force` (n, 3) and `moment` (n, 3).
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from invariantqp.control.tracking import QUESTIONED_TIME
from invariantqp.errors import BadInput
from invariantqp.geometry.arrays import Array
from invariantqp.identification.motions import poses
from invariantqp.robots.kinematics import Robot

FORCE, MOMENT, POSE = (
    ("fx", "fy", "fz"),
    (("mx", "my", "mz"), ("tx", "ty", "tz")),
    ("x", "y", "z", "qx", "qy", "qz", "qw"),
)
# How far a quaternion's length may be from one: files with four digits pass.
UNIT = 1e-3
WITH_ROBOT = "Joint positions need a robot: --robot NAME, or a URDF file."


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
            with np.load(file, allow_pickle=False) as held:
                columns = _flat({key: np.asarray(held[key], dtype=float) for key in held.files})
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


def _flat(held: Mapping[str, Array]) -> dict[str, Array]:
    """The columns of an NPZ's arrays, by the names that a CSV has."""
    columns: dict[str, Array] = {}
    names = {"force": FORCE, "moment": MOMENT[0]}
    for key, a in held.items():
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
    moment = next((words for words in MOMENT if all(w in columns for w in words)), None)
    if moment is None or any(w not in columns for w in FORCE):
        raise BadInput(
            name, f"columns {', '.join(columns) or 'none'}", "fx, fy, fz and mx, my, mz: what the sensor reads"
        )
    if len({len(a) for a in columns.values()}) > 1:
        raise BadInput(name, "arrays of different lengths", "one entry a sample in each")
    readings = _stacked(columns, (*moment, *FORCE))
    if not len(readings):
        raise BadInput(name, "no sample", "one a line")
    clock = next((w for w in ("time", "t") if w in columns), None)
    if clock is not None:
        steps = np.diff(columns[clock])
        for k in np.flatnonzero(~((steps > 0.0) & np.isfinite(steps)))[:1].tolist():
            raise BadInput(name, f"time that does not grow after sample {k}", "seconds, evenly spaced")
        if len(steps) and np.median(steps) >= QUESTIONED_TIME:
            found = f"samples {np.median(steps):g} s apart"
            raise BadInput(name, found, "times in seconds, of samples at some 100 Hz", "Are these milliseconds?")
    q: Array | None = None
    used: tuple[str, ...] = POSE
    if "poses" in columns:
        used, tool = ("poses",), columns["poses"]
    elif all(w in columns for w in POSE):
        tool = quaternion_poses(_stacked(columns, POSE), name)
    elif robot is None:
        expected = f"{', '.join(POSE)}; or joint positions and a robot"
        raise BadInput(name, f"columns {', '.join(columns)}", expected, WITH_ROBOT)
    else:
        used, q = _positions(columns, name, robot)
        tool = np.array([robot.pose(state) for state in q])
    read_from = {clock, *moment, *FORCE, *used}
    time = None if clock is None else columns[clock]
    return File(time, q, tool, readings, tuple(w for w in columns if w not in read_from))


def _stacked(columns: dict[str, Array], names: Iterable[str]) -> Array:
    """(n, k) some of the columns."""
    return np.stack([columns[w] for w in names], axis=1)


def _positions(columns: dict[str, Array], name: str, robot: Robot) -> tuple[tuple[str, ...], Array]:
    """The columns of joint positions, called as the joints or numbered, and what they have (n, m)."""
    m = len(robot.names)
    named = (robot.names, tuple(f"q{j + 1}" for j in range(m)), tuple(f"q{j}" for j in range(m)))
    words = next((words for words in named if all(w in columns for w in words)), None)
    if words is None:
        raise BadInput(name, f"columns {', '.join(columns)}", f"{', '.join(robot.names)}; or q1 to q{m}")
    q = _stacked(columns, words)
    if not np.isfinite(q).all():
        k = int(np.flatnonzero(~np.isfinite(q).all(axis=1))[0])
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
