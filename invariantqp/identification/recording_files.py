"""Recordings in files: a CSV with a header, or an NPZ.

    time or t                       [s], evenly spaced; may be left out
    joint names, or q1 ... qm       [rad, length], with a robot; or
    x y z qx qy qz qw               pose of the tool frame in the base frame
    fx fy fz, mx my mz or tx ty tz  readings of the sensor

An NPZ has the same columns, or arrays: `q` (n, m) or `poses` (n, 4, 4), `force` (n, 3) and `moment` (n, 3).
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from invariantqp.control.tracking import LONG_TIME
from invariantqp.errors import BadInput
from invariantqp.geometry.arrays import Array
from invariantqp.identification.se3_batch import homogeneous
from invariantqp.robots.kinematics import Robot

FORCE_COLUMNS = ("fx", "fy", "fz")
MOMENT_COLUMNS = (("mx", "my", "mz"), ("tx", "ty", "tz"))
POSE_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")
# Deviation of a quaternion's length from one: files with four digits pass.
QUATERNION_TOLERANCE = 1e-3


class RecordingFile(NamedTuple):
    """The contents of a recording's file."""

    time: Array | None  # (n,) [s]
    q: Array | None  # (n, m), or None if poses were recorded
    poses: Array  # (n, 4, 4) of the tool frame
    readings: Array  # (n, 6) (m; f) in the sensor frame
    unused_columns: tuple[str, ...]

    @property
    def seconds(self) -> Array:
        """(n,) times from the first sample on [s]; at 100 Hz if the file has none."""
        return np.arange(len(self.poses)) / 100.0 if self.time is None else self.time - self.time[0]


def read_recording(path: Path | str, robot: Robot | None = None) -> RecordingFile:
    """The recording in a .csv or .npz file; joint positions need the robot.

    Raises:
        BadInput: the file cannot be read, or is no recording.
    """
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
                columns = _columns({key: np.asarray(archive[key], dtype=float) for key in archive.files})
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


def _columns(archive: Mapping[str, Array]) -> dict[str, Array]:
    """The arrays of an NPZ as columns, by the names that a CSV has."""
    columns: dict[str, Array] = {}
    names = {"force": FORCE_COLUMNS, "moment": MOMENT_COLUMNS[0]}
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


def _recording(columns: dict[str, Array], name: str, robot: Robot | None) -> RecordingFile:
    moment = _first_complete(columns, *MOMENT_COLUMNS)
    if not moment or not _first_complete(columns, FORCE_COLUMNS):
        found = f"columns {', '.join(columns) or 'none'}"
        raise BadInput(name, found, "fx, fy, fz and mx, my, mz: the sensor's readings")
    if len({len(a) for a in columns.values()}) > 1:
        raise BadInput(name, "arrays of different lengths", "one entry a sample in each")
    readings = _stacked(columns, (*moment, *FORCE_COLUMNS))
    if not len(readings):
        raise BadInput(name, "no sample", "one a line")
    clock = _first_complete(columns, ("time",), ("t",))
    time = _checked_time(columns[clock[0]], name) if clock else None
    q: Array | None = None
    used: tuple[str, ...] = POSE_COLUMNS
    if "poses" in columns:
        used, tool = ("poses",), columns["poses"]
    elif _first_complete(columns, POSE_COLUMNS):
        tool = quaternion_poses(_stacked(columns, POSE_COLUMNS), name)
    elif robot is None:
        expected = f"{', '.join(POSE_COLUMNS)}; or joint positions and a robot"
        remedy = "Joint positions need a robot: --robot NAME, or a URDF file."
        raise BadInput(name, f"columns {', '.join(columns)}", expected, remedy)
    else:
        used, q = _joint_positions(columns, name, robot)
        tool = np.array([robot.pose(each) for each in q])
    all_used = {*clock, *moment, *FORCE_COLUMNS, *used}
    return RecordingFile(time, q, tool, readings, tuple(column for column in columns if column not in all_used))


def _first_complete(columns: dict[str, Array], *choices: tuple[str, ...]) -> tuple[str, ...]:
    """The first of several sets of names that has all its columns; () if none has."""
    return next((names for names in choices if all(name in columns for name in names)), ())


def _checked_time(time: Array, name: str) -> Array:
    """(n,) times [s], checked."""
    steps = np.diff(time)
    for k in np.flatnonzero(~((steps > 0.0) & np.isfinite(steps)))[:1].tolist():
        raise BadInput(name, f"time that does not increase after sample {k}", "seconds, evenly spaced")
    if len(steps) and np.median(steps) >= LONG_TIME:
        found = f"samples {np.median(steps):g} s apart"
        raise BadInput(name, found, "times in seconds, of samples at some 100 Hz", "Are these milliseconds?")
    return time


def _stacked(columns: dict[str, Array], names: Iterable[str]) -> Array:
    """(n, k) columns of these names."""
    return np.stack([columns[name] for name in names], axis=1)


def _joint_positions(columns: dict[str, Array], name: str, robot: Robot) -> tuple[tuple[str, ...], Array]:
    """Names of the columns of joint positions, which are those of the joints or numbers, and the positions (n, m)."""
    m = len(robot.names)
    numbered = (tuple(f"q{j + first}" for j in range(m)) for first in (1, 0))
    names = _first_complete(columns, robot.names, *numbered)
    if not names:
        raise BadInput(name, f"columns {', '.join(columns)}", f"{', '.join(robot.names)}; or q1 to q{m}")
    q = _stacked(columns, names)
    for k in np.flatnonzero(~np.isfinite(q).all(axis=1))[:1].tolist():
        raise BadInput(name, f"NaN or infinity in sample {k}", "joint positions", "Leave such samples out.")
    return names, q


def quaternion_poses(values: Array, name: str) -> Array:
    """(n, 4, 4) poses of rows (n, 7), x, y, z, qx, qy, qz, qw."""
    quaternions = values[:, 3:]
    length = np.sqrt((quaternions**2).sum(axis=1))
    for k in np.flatnonzero(~(np.abs(length - 1.0) < QUATERNION_TOLERANCE))[:1].tolist():
        raise BadInput(name, f"a quaternion of length {length[k]:.4g} in sample {k}", "qx, qy, qz, qw of length one")
    return homogeneous(Rotation.from_quat(quaternions).as_matrix(), values[:, :3])
