"""Recordings in files: round trips, and errors by the name of the file."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.recordings import record

import invariantqp as iq
from invariantqp.identification.recording_files import read_recording

X, W, _ = record("point", 3, duration=1.0)
T = np.arange(len(X)) / 100.0
POSES = np.column_stack((X[:, :3, 3], Rotation.from_matrix(X[:, :3, :3]).as_quat()))
HEADER = "time,x,y,z,qx,qy,qz,qw,fx,fy,fz,mx,my,mz"


def written(path, header=HEADER, rows=None):
    rows = np.column_stack((T, POSES, W[:, 3:], W[:, :3])) if rows is None else rows
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def test_poses_and_readings_come_back(tmp_path):
    file = read_recording(written(tmp_path / "a.csv"))
    np.testing.assert_allclose(file.poses, X, atol=1e-8)
    np.testing.assert_allclose(file.readings, W, atol=1e-7)
    np.testing.assert_allclose(file.time, T)
    np.savez(tmp_path / "a.npz", time=T, poses=X, force=W[:, 3:], moment=W[:, :3])
    again = read_recording(tmp_path / "a.npz")
    np.testing.assert_array_equal(again.poses, X)
    np.testing.assert_array_equal(again.readings, W)
    np.testing.assert_allclose(np.diff(file.seconds), T[1] - T[0], rtol=1e-6)


@pytest.mark.parametrize("names", ["robot", "q1"])
def test_joint_positions_become_poses(tmp_path, names):
    robot = iq.load_robot("ur5")
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 6))
    words = robot.names if names == "robot" else [f"q{j + 1}" for j in range(6)]
    header = ",".join((*words, "fx", "fy", "fz", "tx", "ty", "tz"))
    file = read_recording(written(tmp_path / "q.csv", header, np.column_stack((q, W[:40, 3:], W[:40, :3]))), robot)
    np.testing.assert_allclose(file.poses, [robot.pose(state) for state in q], atol=1e-7)
    assert file.time is None
    np.savez(tmp_path / "q.npz", q=q, force=W[:40, 3:], moment=W[:40, :3])
    np.testing.assert_allclose(read_recording(tmp_path / "q.npz", robot).poses, file.poses, atol=1e-7)


def test_unused_columns_are_reported(tmp_path):
    header, rows = HEADER.replace("time", "stamp"), np.column_stack((T, POSES, W[:, 3:], W[:, :3], T))
    file = read_recording(written(tmp_path / "a.csv", f"{header},gripper", rows))
    assert file.time is None
    assert file.unused_columns == ("stamp", "gripper")
    assert read_recording(written(tmp_path / "b.csv")).unused_columns == ()
    robot = iq.load_robot("ur5")
    np.savez(tmp_path / "q.npz", q=np.zeros((40, 7)), force=W[:40, 3:], moment=W[:40, :3])
    assert read_recording(tmp_path / "q.npz", robot).unused_columns == ("q7",)


def test_times_in_milliseconds_are_refused(tmp_path):
    rows = np.column_stack((1e3 * T, POSES, W[:, 3:], W[:, :3]))
    with pytest.raises(iq.BadInput, match=r"samples 10 s apart; expected times in seconds.* Are these milliseconds"):
        read_recording(written(tmp_path / "a.csv", rows=rows))


LINES = {
    "a,b\n1,2\n": "columns a, b; expected fx, fy, fz and mx, my, mz",
    "": "found nothing",
    "fx,fy,fz,mx,my,mz\n1,2,3,4,5,6\n": "Joint positions need a robot",
    "fx,fx\n1,2\n": "two columns 'fx'",
    "fx,fy,fz,mx,my,mz\n1,2,3\n": "3 numbers in sample 0",
    "fx,fy,fz,mx,my,mz\n1,2,3,4,5,six\n": "'six' for mz in sample 0",
    HEADER + "\n": "found no sample; expected one a line",
    HEADER + "\n0,0,0,0,0,0,0,2,1,1,1,1,1,1\n": "a quaternion of length 2 in sample 0",
    HEADER + "\n1,0,0,0,0,0,0,1,1,1,1,1,1,1\n0,0,0,0,0,0,0,1,1,1,1,1,1,1\n": "time that does not increase",
}


@pytest.mark.parametrize("text", LINES, ids=LINES.values())
def test_invalid_files_are_refused(tmp_path, text):
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    with pytest.raises(iq.BadInput, match=LINES[text].replace("(", r"\(")):
        read_recording(tmp_path / "a.csv")


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"no archive")
    for name, message in (
        ("none.csv", "none.csv: found no such file"),
        ("a.txt", "the ending '.txt'"),
        ("a.npz", "a .csv or .npz file"),
    ):
        with pytest.raises(iq.BadInput, match=message):
            read_recording(tmp_path / name)
    np.savez(tmp_path / "b.npz", poses=X, force=W[:5, 3:], moment=W[:5, :3])
    with pytest.raises(iq.BadInput, match="different lengths"):
        read_recording(tmp_path / "b.npz")
