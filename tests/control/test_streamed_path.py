"""Poses that come one by one: the tool stays on the path through them, and is never beyond a limit."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import invariantqp as iq

DT, RISE = 0.002, 0.2


def streamed(robot, **given):
    return iq.control.StreamedPath(iq.Controller(robot, dt=DT, acceleration_limit=robot.velocity_limit / RISE), **given)


def drive(path, q, coming, ticks=3000):
    """Solutions and joint positions; `coming` is the poses by the tick in which they come."""
    solutions, positions = [], [q]
    for k in range(ticks):
        if k in coming:
            path.add(coming[k])
            if k == max(coming):
                path.close()
        solutions.append(path.step(positions[-1]))
        positions.append(positions[-1] + DT * solutions[-1].velocity)
        if solutions[-1].status in ("done", "blocked"):
            break
    return solutions, np.array(positions)


def from_the_line(points, line):
    """(n,) distances of points from a line of many short pieces."""
    a, d = line[:-1], np.diff(line, axis=0)
    u = np.clip(np.einsum("nij,ij->ni", points[:, None] - a, d) / np.einsum("ij,ij->i", d, d), 0.0, 1.0)
    return np.linalg.norm(points[:, None] - a - u[..., None] * d, axis=2).min(axis=1)


def joint_path(robot):
    mid = np.array([0.0, -1.4, 1.6, -1.8, -1.57, 0.0]) if len(robot.names) == 6 else np.array([0, -0.4, 0.5, 0.6, 0])
    step = 0.3 * (-1.0) ** np.arange(len(mid))
    return CubicSpline([0.0, 0.5, 1.0], [mid, mid + step, mid + 0.5 * step[::-1]])


@pytest.mark.parametrize(("name", "each"), [("ur5", 10), ("so101", 10), ("ur5", 1)])
def test_the_tool_stays_on_the_path_and_inside_limits(name, each):
    robot = iq.load_robot(name)
    joints = joint_path(robot)
    poses = [robot.pose(joints(u)) for u in np.linspace(0.0, 1.0, 80)]
    late = 40 * each + np.arange(40) * each + 300  # after half of them none comes for 0.6 s
    when = [*(np.arange(40) * each).tolist(), *late.tolist()]
    solutions, q = drive(streamed(robot), joints(0.0), dict(zip(when, poses, strict=True)))
    velocity = np.array([s.velocity for s in solutions])
    assert solutions[-1].status == "done"
    assert np.linalg.norm(robot.pose(q[-1])[:3, 3] - poses[-1][:3, 3]) < 1e-5
    line = np.array([robot.pose(joints(u))[:3, 3] for u in np.linspace(0.0, 1.0, 1000)])
    assert from_the_line(np.array([robot.pose(p)[:3, 3] for p in q[::8]]), line).max() < 5e-5
    assert max(s.across for s in solutions[when[2] + 30 :]) < 1e-5
    assert (np.abs(velocity) <= robot.velocity_limit + 1e-9).all()
    jumps = np.diff(velocity, axis=0, prepend=np.zeros((1, len(velocity[0])))) / DT
    assert (np.abs(jumps) <= robot.velocity_limit / RISE * (1.0 + 1e-9)).all()
    pause = solutions[late[0] - 1]
    assert (pause.status, pause.ruling) == ("waiting", "the end of the stream")
    assert "no pose for" in pause.reason
    assert np.abs(pause.velocity).max() < 1e-3


@pytest.mark.parametrize("dt", [0.001, 0.004, 0.01])
@pytest.mark.parametrize("paused", [False, True])
def test_a_stream_that_doubles_back_is_driven_into_its_corners(dt, paused):
    robot = iq.load_robot("ur5")
    q = joint_path(robot)(0.0)
    T = robot.pose(q)
    way, back = np.array([0.0, 0.008, 0.0]), np.array([0.002, -0.008, 0.001])
    line = T[:3, 3] + np.cumsum([way] * 8 + [back] * 8 + [-back] * 8, axis=0)
    path = iq.control.StreamedPath(iq.Controller(robot, dt=dt, acceleration_limit=robot.velocity_limit / RISE))
    poses = [iq.transform(T[:3, :3], p) for p in (T[:3, 3], *line)]
    tool, status, ticks = [T[:3, 3]], "", 0
    while status != "done":
        assert ticks * dt < 10.0
        if poses and ticks * dt >= 0.005 * (len(line) + 1 - len(poses)) + (0.5 if paused and len(poses) <= 16 else 0.0):
            path.add(poses.pop(0))
            if not poses:
                path.close()
        told = path.step(q)
        q, status, ticks = q + dt * told.velocity, told.status, ticks + 1
        tool.append(robot.pose(q)[:3, 3])
    corners = np.vstack((T[:3, 3], line))
    assert from_the_line(np.array(tool), corners).max() < 5e-6
    for corner in (line[7], line[15]):
        assert np.linalg.norm(np.array(tool) - corner, axis=1).min() < 1e-4


def test_a_dense_stream_with_tight_bends_is_driven_without_stops():
    robot = iq.load_robot("ur5")
    q, dt, gap, radius = joint_path(robot)(0.0), 0.005, 5e-4, 0.012
    T = robot.pose(q)
    path = iq.control.StreamedPath(iq.Controller(robot, dt=dt, acceleration_limit=robot.velocity_limit / RISE))
    tool, status = [T[:3, 3]], ""
    while status != "done":
        assert len(tool) < 300
        for u in np.arange(5 * len(tool), 5 * len(tool) + 5) * gap / radius:  # 1000 poses a second, for 0.3 s
            if len(tool) <= 60:
                path.add(iq.transform(T[:3, :3], T[:3, 3] + radius * np.array([0.0, np.sin(u), np.cos(u) - 1.0])))
        if len(tool) == 60:
            path.close()
        told = path.step(q)
        q, status = q + dt * told.velocity, told.status
        tool.append(robot.pose(q)[:3, 3])
    speed = np.linalg.norm(np.diff(tool, axis=0), axis=1) / dt
    moving = np.flatnonzero(speed > 0.5 * np.median(speed))
    assert speed[moving[0] : moving[-1]].min() > 0.5 * np.median(speed)


def test_a_stream_that_stands_still_is_no_path():
    robot = iq.load_robot("ur5")
    joints = joint_path(robot)
    path = streamed(robot, speed=0.1)
    assert path.step(joints(0.0)).reason == "no pose yet"
    rng = np.random.default_rng(0)
    T = robot.pose(joints(0.0))
    for _ in range(100):  # noise around a pose
        path.add(iq.transform(T[:3, :3], T[:3, 3] + rng.normal(0.0, 1e-5, 3)))
        told = path.step(joints(0.0))
    assert told.status == "waiting"
    assert np.abs(told.velocity).max() < 1e-2
    path.close()
    solutions, _ = drive(path, joints(0.0), {}, 100)
    assert solutions[-1].status == "done"


@pytest.mark.parametrize("noise", [(0.0, 0.0, 0.0), (1e-6, 0.0, 0.0), (0.0, -1e-6, 0.0)])
def test_the_last_pose_again_bends_no_path(noise):
    robot = iq.load_robot("ur5")
    T = robot.pose(joint_path(robot)(0.0))
    line = T[:3, 3] + np.outer(np.arange(8), [0.0, 0.01, 0.0])
    poses = [iq.transform(T[:3, :3], p) for p in (*line, line[-1] + noise)]
    solutions, q = drive(streamed(robot), joint_path(robot)(0.0), dict(enumerate(poses)))
    assert solutions[-1].status == "done"
    assert from_the_line(np.array([robot.pose(p)[:3, 3] for p in q]), line).max() < 1e-5


def test_poses_that_have_come_are_not_waited_for():
    robot = iq.load_robot("so101")
    joints = joint_path(robot)
    path, q = streamed(robot), joints(0.0)
    for u in np.linspace(0.0, 1.0, 40):
        path.add(robot.pose(joints(u)))
    path.close()
    told = []
    while not told or told[-1].status != "done":
        told.append(path.step(q))
        q = q + DT * told[-1].velocity
        assert len(told) < 3000
    waits = [s for s in told if s.status == "waiting"]
    assert {s.ruling for s in waits} <= {"the start", "the look ahead"}
    assert {s.reason for s in waits} == {"looking along the path"}


def test_what_cannot_be_driven_is_refused():
    robot = iq.load_robot("ur5")
    with pytest.raises(iq.BadInput, match="acceleration limit"):
        iq.control.StreamedPath(iq.Controller(robot, dt=DT))
    path = streamed(robot)
    with pytest.raises(iq.BadInput, match="pose"):
        path.add(np.ones((4, 4)))
    path.close()
    with pytest.raises(iq.BadInput, match="close"):
        path.add(np.eye(4))
