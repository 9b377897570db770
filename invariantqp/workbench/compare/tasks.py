"""The bed: kinds of tasks on five arms, made from a seed; and task files as such tasks.

A task is data: the joint positions at the start, and for each tick a target, its twist and the noise of the measured
positions. Commands are executed exactly: q <- q + dt x. Paths are joint paths of minimum jerk, so that targets are
within reach unless the kind says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from invariantqp.control.controller import posture_of
from invariantqp.control.measure import ToolMeasure
from invariantqp.control.tracking import tracking_gain
from invariantqp.errors import BadInput, RobotModelError
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.systems.gram import principal_pitches
from invariantqp.workbench.compare.arms import STARTS, arm, as_chain, chain_of, urdf
from invariantqp.workbench.compare.method import LoopSpec
from invariantqp.workbench.runs.frames import random_displacement
from invariantqp.workbench.runs.prepare import prepare, twists_between
from invariantqp.workbench.runs.taskfile import LawSpec, Task

# The length of the measure in the search for singularities [m/rad].
RADIAN = 0.4
# Joint positions on either side of well-known singularities; for other arms three are searched for.
SINGULARITIES: dict[str, dict[str, tuple[tuple[float, ...], tuple[float, ...]]]] = {
    "panda": {
        "elbow": ((0.0, -0.2, 0.0, -1.2, 0.0, 1.6, 0.8), (0.1, 0.35, 0.1, -0.12, 0.1, 1.6, 0.9)),
        "shoulder": ((-0.3, -0.25, 1.2, -2.0, 0.0, 1.6, 0.8), (0.3, 0.25, 1.9, -1.9, 0.0, 1.7, 0.7)),
    },
    "ur5e": {
        "wrist": ((0.0, -1.2, 1.6, -0.6, -0.4, 0.3), (0.5, -1.0, 1.4, -0.9, 0.45, 0.8)),
        "elbow": ((0.0, -1.2, 0.6, -0.6, -1.2, 0.3), (0.2, -1.0, -0.25, -0.4, -1.2, 0.4)),
    },
}
SINGULAR_TASKS = 3
# Tolerance of the smallest singular value in a singularity [m/rad].
SINGULAR = 2e-3
# Arms whose targets jump half as far.
SMALL = ("so101", "random4")
# Noise of encoders [rad], and the largest delay of a target [s].
COUNTS, LATE = 2e-5, 0.02
# The same motion, told in another tool frame and in millimetres.
OTHER_FRAME, OTHER_UNIT = "other tool frame", "other unit"
MILLIMETRES = 1e3
# How far targets are off the path where joints cannot do all of it [m], [rad].
OFF_PATH = 0.005, 0.01
# Rates of a stream of targets and of a stale one [Hz].
STREAM, STALE = 50.0, 10.0


@dataclass(frozen=True, eq=False)
class BedTask:
    """One motion of one arm."""

    name: str  # "panda/free", or that of a task file
    arm: str
    kind: str  # a key of KINDS, or "task file"
    spec: LoopSpec
    q0: Array  # (m,) joint positions at the start
    targets: Array  # (n, 4, 4) commanded tool poses
    feedforward: Array | None  # (n, 6) their twists
    noise: Array  # (n, m) of the measured joint positions
    desired: Array  # (n, 4, 4) tool poses that errors are measured from
    judged: LoopSpec  # the arm with the tool frame of `desired` and the point at which errors are measured
    settles_from: int = 0  # the tick from which settling counts
    original: BedTask | None = None  # the same motion in the original tool frame and unit


def minimum_jerk(u: ArrayLike) -> Array:
    """Minimum-jerk profile from 0 at u = 0 to 1 at u = 1."""
    s = np.clip(u, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def joint_path(points: Sequence[ArrayLike], duration: float, dt: float, rest: float = 0.0) -> Array:
    """(n, m) joint positions through points, at rest at each, and for `rest` [s] at the last."""
    corners = np.array(points, np.float64)
    u = np.linspace(0.0, len(corners) - 1.0, int(duration / dt) + 1)
    i = np.minimum(u.astype(int), len(corners) - 2)
    path = corners[i] + minimum_jerk(u - i)[:, None] * (corners[i + 1] - corners[i])
    return np.concatenate((path, np.repeat(path[-1:], int(rest / dt), axis=0)))


def twists_of(poses: Array, dt: float) -> Array:
    """(n, 6) twists from each pose to the next; the last is zero."""
    return np.vstack((twists_between(poses, dt), np.zeros(6)))


class Maker:
    """Makes the tasks of one arm."""

    def __init__(self, name: str, seed: int) -> None:
        self.name, self.seed, self.robot = name, seed, arm(name, seed)
        robot, q0 = self.robot, np.array(STARTS[name])
        self.rng = np.random.default_rng([seed, *name.encode()])
        self.q0, self.T0 = q0, robot.pose(q0)
        low, high = np.maximum(robot.position_lower, -np.pi), np.minimum(robot.position_upper, np.pi)
        self.low, self.high = low, high
        away = self.rng.uniform(-1.0, 1.0, len(q0))
        self.path_end = np.clip(q0 + 0.35 * away / np.abs(away).max(), low + 0.15, high - 0.15)
        # The joint nearest to a limit, wrists excepted.
        self.joint = int(np.argmin(np.minimum(high - q0, q0 - low)[: max(4, len(q0) - 2)]))
        self.up = high[self.joint] - q0[self.joint] < q0[self.joint] - low[self.joint]
        self.free_path = self.poses(joint_path([q0, self.path_end, q0], 3.0, 0.002))

    def poses(self, path: Array) -> Array:
        """(n, 4, 4) tool poses of joint positions (n, m)."""
        return np.array([self.robot.pose(q) for q in path])

    def task(
        self,
        name: str,
        targets: Array,
        dt: float,
        gain: float,
        *,
        feedforward: Array | bool = True,
        q0: Array | None = None,
        acceleration: float | None = None,
        noise: float = 0.0,
        desired: Array | None = None,
        settles_from: int = 0,
    ) -> BedTask:
        """A task of targets (n, 4, 4); `feedforward`: True is their twist; `noise` is a deviation."""
        spec = spec_of(self.robot, LawSpec(dt=dt, gain=gain, acceleration_limit=acceleration))
        ahead = twists_of(targets, dt) if feedforward is True else None if feedforward is False else feedforward
        return BedTask(
            name=f"{self.name}/{name}",
            arm=self.name,
            kind=name,
            spec=spec,
            q0=self.q0 if q0 is None else q0,
            targets=targets,
            feedforward=ahead,
            noise=noise * self.rng.standard_normal((len(targets), len(self.q0))),
            desired=targets if desired is None else desired,
            judged=spec,
            settles_from=settles_from,
        )

    def beyond(self, by: float) -> float:
        """The position of the joint nearest to a limit, this far beyond the limit."""
        return float(self.high[self.joint] + by if self.up else self.low[self.joint] - by)

    def path_beyond_limits(self) -> tuple[Array, float]:
        """Targets (n, 4, 4) at 1.4 times the speed limit and 0.2 rad beyond a position limit, and the duration."""
        far = self.path_end.copy()
        far[self.joint] = self.beyond(0.2)
        duration = 2.0 * 1.875 / 1.4 * float((np.abs(far - self.q0) / self.robot.velocity_limit).max())
        return self.poses(joint_path([self.q0, far, self.q0], duration, 0.002, rest=0.5)), duration

    def at_limits(self, kind: str = "limits", acceleration: float | None = None) -> BedTask:
        """A path that meets position and speed limits, and acceleration limits if given."""
        targets, duration = self.path_beyond_limits()
        return self.task(kind, targets, 0.002, 50.0, acceleration=acceleration, settles_from=int(duration / 0.002))

    def singularities(self) -> list[BedTask]:
        """Paths through singularities, with targets displaced by 5 mm and 0.01 rad."""
        tasks = []
        for kind, ends in self.ends().items():
            targets = self.off_path(self.poses(joint_path(ends, 3.0, 0.005, rest=1.0)))
            tasks.append(self.task(f"singular {kind}", targets, 0.005, 20.0, q0=ends[0], settles_from=600))
        return tasks

    def off_path(self, targets: Array) -> Array:
        """Targets (n, 4, 4) displaced by OFF_PATH in a random direction, in ticks 200 to 400; reached over a second."""
        k, targets = np.arange(len(targets)), targets.copy()
        weight = minimum_jerk(k / 200) * (1.0 - minimum_jerk((k - 400) / 200))
        dv, dw = (
            size * d / np.linalg.norm(d) for size, d in zip(OFF_PATH, self.rng.standard_normal((2, 3)), strict=True)
        )
        targets[:, :3, 3] += weight[:, None] * dv
        targets[:, :3, :3] = [se3.rotation(u * dw).dot(T[:3, :3]) for u, T in zip(weight, targets, strict=True)]
        return targets

    def at_a_principal_pitch(self) -> list[BedTask]:
        """A slow path, its targets off it, with the form of the pitch that is principal half-way; for under six joints.

        Half-way J'Q_h J has no inverse, so the h-pseudoinverse does not exist there; nor anywhere else on an SO-101,
        whose three parallel axes have the principal pitch 0 in all positions.
        """
        if len(self.q0) > 5:
            return []
        path = joint_path([self.q0, self.path_end], 3.0, 0.005, rest=1.0)
        pitches = principal_pitches(self.robot.jacobian(0.5 * (self.q0 + self.path_end)))
        task = self.task("principal pitch", self.off_path(self.poses(path)), 0.005, 20.0, settles_from=600)
        law = {**task.spec.law, "form": float(pitches[np.argmin(np.abs(pitches))])}
        return [replace(task, spec=replace(task.spec, law=law))]

    def ends(self) -> dict[str, tuple[Array, Array]]:
        """Joint positions on either side of up to three singularities."""
        known = SINGULARITIES.get(self.name, {})
        found = {key: (np.array(a), np.array(b)) for key, (a, b) in known.items()}
        if self.name == "ur5e":  # the wrist's centre over the first axis
            q = np.tile([0.1, 0.0, 1.9, -1.6, -1.4, 0.3], (3001, 1))
            q[:, 1] = np.linspace(-3.0, 0.0, len(q))
            over = q[int(np.argmin([self.smallest(x) for x in q]))]
            step = np.array([-0.1, 0.35, -0.1, -0.1, -0.1, -0.1])
            found["shoulder"] = (over + step, over - step)
        for k in range(len(found), SINGULAR_TASKS):
            around = self.around_a_singularity()
            if around is not None:  # four joints seldom have one
                found[f"{k + 1}"] = around
        return found

    def smallest(self, q: Array) -> float:
        """The smallest singular value at joint positions (m,), measured with the length RADIAN."""
        weight = np.repeat([RADIAN, 1.0], 3)[:, None]
        twists = self.robot.jacobian(q).copy()
        twists[3:] = se3.velocity_at(twists, self.robot.pose(q)[:3, 3])
        return float(np.linalg.svd(weight * twists, compute_uv=False)[-1])

    def around_a_singularity(self) -> tuple[Array, Array] | None:
        """Joint positions on either side of a singularity, searched for from random starts; None if none is found."""
        low, high, m = self.low, self.high, len(self.q0)
        best = self.q0
        for _ in range(12):
            start = self.rng.uniform(low + 0.3 * (high - low), high - 0.3 * (high - low))
            options = {"maxiter": 400, "xatol": 1e-5, "fatol": 1e-7}
            found = minimize(self.smallest, start, method="Nelder-Mead", options=options).x
            found = np.clip(found, low + 0.1, high - 0.1)
            best = min(best, found, key=self.smallest)
            if self.smallest(best) < SINGULAR:
                break
        else:
            return None
        away = np.array([self.smallest(best + 0.05 * e) + self.smallest(best - 0.05 * e) for e in np.eye(m)])
        side = np.sign(self.rng.standard_normal(m)) * away / np.linalg.norm(away)  # joints that lead out of it
        step = 0.45 * side + 0.1 * self.rng.uniform(-1.0, 1.0, m)
        return np.clip(best - step, low + 0.02, high - 0.02), np.clip(best + step, low + 0.02, high - 0.02)

    def out_of_reach(self) -> list[BedTask]:
        """A target that jumps 3 m away and back, and one that leaves the reach and returns."""
        far = self.T0.copy()
        far[0, 3] += 3.0
        targets = np.array([far] * 400 + [self.T0] * 600)
        once = self.task("out of reach at once", targets, 0.005, 5.0, feedforward=False, settles_from=400)
        t = 0.005 * np.arange(1200)
        out = minimum_jerk(t / 2.0) * (1.0 - minimum_jerk((t - 2.5) / 2.0))
        targets = np.repeat(self.T0[None], len(t), axis=0)
        targets[:, :3, 3] += 1.5 * out[:, None] * self.T0[:3, 3]
        return [once, self.task("out of reach slowly", targets, 0.005, 20.0, settles_from=900)]

    def stay(self) -> list[BedTask]:
        """Hold a pose with measurement noise."""
        targets = np.repeat(self.T0[None], 1000, axis=0)
        return [self.task("stay", targets, 0.01, 10.0, feedforward=False, noise=COUNTS)]

    def turn(self, degrees: float) -> BedTask:
        """A turn in place about the tool's y axis."""
        end = self.T0.copy()
        end[:3, :3] = end[:3, :3].dot(se3.rotation(np.array([0.0, np.radians(degrees), 0.0])))
        targets = np.repeat(end[None], 400, axis=0)
        return self.task(f"turn {degrees:g}", targets, 0.01, 10.0, feedforward=False)

    def jump(self, kind: str, dt: float, ticks: int, acceleration: float | None = None) -> BedTask:
        """A jump of 150 mm without a rotation."""
        end, step = self.T0.copy(), np.array([0.5, 0.6, -0.6])
        end[:3, 3] += (0.075 if self.name in SMALL else 0.15) * step / np.linalg.norm(step)
        targets = np.repeat(end[None], ticks, axis=0)
        return self.task(kind, targets, dt, 10.0, feedforward=False, acceleration=acceleration)

    def outside(self) -> list[BedTask]:
        """A start 0.05 rad outside a position limit, a target inside."""
        q0, robot, j = self.q0.copy(), self.robot, self.joint
        q0[j] = robot.position_upper[j] + 0.05 if self.up else robot.position_lower[j] - 0.05
        targets = np.repeat(robot.pose(self.path_end)[None], 600, axis=0)
        return [self.task("outside", targets, 0.005, 10.0, q0=q0, feedforward=False)]

    def invalid(self) -> list[BedTask]:
        """The free path with some targets that are not finite."""
        targets = self.free_path.copy()
        targets[300:306], targets[400, 0, 3], targets[500, :3, :3], targets[600, 0, 3] = np.nan, np.nan, np.nan, np.inf
        ahead = twists_of(self.free_path, 0.002)
        return [self.task("NaN", targets, 0.002, 50.0, feedforward=ahead, desired=self.free_path)]

    def stream(self, kind: str, rate: float, late: float) -> BedTask:
        """The free path as a stream of targets at a rate [Hz], each late by up to `late` [s], without feedforward."""
        path, dt = self.free_path, 0.002
        sent = np.arange(0.0, len(path) * dt, 1.0 / rate)
        arrived = sent + self.rng.uniform(0.0, late, len(sent))
        arrived[0] = 0.0
        newest = np.searchsorted(arrived, dt * np.arange(len(path)) + 1e-9, side="right") - 1
        targets = path[np.round(sent / dt).astype(int)[newest]]
        return self.task(kind, targets, dt, 50.0, feedforward=False, desired=path)

    def other_frame(self) -> list[BedTask]:
        """The path at limits, in another tool frame."""
        return [displaced(self.at_limits(OTHER_FRAME), random_displacement(self.seed))]

    def other_unit(self) -> list[BedTask]:
        """The path at limits, in millimetres."""
        return [in_unit(self.at_limits(OTHER_UNIT), MILLIMETRES)]


def spec_of(robot: Robot, law: LawSpec) -> LoopSpec:
    """The inputs of every method, from an arm and a [law]."""
    posture, posture_gain = posture_of(law.posture, law.posture_gain, robot)
    limit, point, chain = law.acceleration_limit, np.array(law.point), as_chain(robot)
    if law.position_margin:
        chain = chain.with_limits(
            chain.position_lower + law.position_margin, chain.position_upper - law.position_margin
        )
    try:
        text = urdf(chain)
    except RobotModelError:
        text = ""  # methods that need a URDF refuse it
    return LoopSpec(
        names=chain.names,
        screws=chain.screws,
        home=chain.home,
        lower=chain.position_lower,
        upper=chain.position_upper,
        velocity_limit=chain.velocity_limit,
        posture=np.asarray(posture),
        posture_gain=np.asarray(posture_gain),
        dt=law.dt,
        gain=tracking_gain(law.gain, law.dt, law.delay),
        acceleration_limit=None if limit is None else np.full(len(chain.names), limit),
        point=point,
        length=ToolMeasure(robot, point, law.length).length,
        urdf=text,
        law={**law.model_dump(), "position_margin": 0.0},
    )


def displaced(task: BedTask, X: Array) -> BedTask:
    """The same motion in a tool frame displaced by X (4, 4); point and length stay where they are."""
    spec = task.spec
    robot = chain_of(spec).with_tool(X)
    point = se3.inverse(X).dot([*spec.point, 1.0])[:3]
    law = {**spec.law, "point": tuple(point.tolist()), "length": spec.length}
    text = urdf(robot) if spec.urdf else ""
    return replace(
        task,
        spec=replace(spec, home=robot.home, point=point, urdf=text, law=law),
        targets=task.targets @ X,
        original=task,
    )


def in_unit(task: BedTask, scale: float) -> BedTask:
    """The same motion of an arm with hinges alone, with lengths in a unit of which a metre has `scale`."""
    spec = task.spec
    scales = np.repeat([1.0, scale], 3)
    home, targets = spec.home.copy(), task.targets.copy()
    home[:3, 3] *= scale
    targets[:, :3, 3] *= scale
    scaled = replace(spec, screws=spec.screws * scales[:, None], home=home)
    law = {**spec.law, "point": tuple((scale * spec.point).tolist()), "length": scale * spec.length}
    return replace(
        task,
        spec=replace(
            scaled, point=scale * spec.point, length=scale * spec.length, urdf=urdf(chain_of(scaled)), law=law
        ),
        targets=targets,
        feedforward=None if task.feedforward is None else scales * task.feedforward,
        original=task,
    )


# Kinds of tasks: a line for tables, and the function that makes them.
KINDS: dict[str, tuple[str, Callable[[Maker], list[BedTask]]]] = {
    "free": ("a slow path", lambda a: [a.task("free", a.free_path, 0.002, 50.0)]),
    "no feedforward": (
        "the slow path, without feedforward",
        lambda a: [a.task("no feedforward", a.free_path, 0.002, 50.0, feedforward=False)],
    ),
    "limits": ("a path 1.4 times too fast and 0.2 rad beyond a position limit", lambda a: [a.at_limits()]),
    "accelerations": ("the same path, with limits of 15 rad/s^2", lambda a: [a.at_limits("accelerations", 15.0)]),
    OTHER_FRAME: ("the path at limits, for a frame elsewhere on the tool", Maker.other_frame),
    OTHER_UNIT: ("the path at limits, with lengths in millimetres", Maker.other_unit),
    "singular": ("paths through singularities, the targets 5 mm and 0.01 rad off", Maker.singularities),
    "principal pitch": (
        "a path on which J^{+h} does not exist half-way, the targets 5 mm and 0.01 rad off",
        Maker.at_a_principal_pitch,
    ),
    "turn": ("the target turns by 45 and by 90 degrees at once, in place", lambda a: [a.turn(45.0), a.turn(90.0)]),
    "jump": (
        "the target jumps by 150 mm; SO-101 and random arm: 75 mm, out of their reach without turning",
        lambda a: [a.jump("jump", 0.01, 400)],
    ),
    "jump accelerations": (
        "the same jumps, with limits of 10 rad/s^2",
        lambda a: [a.jump("jump accelerations", 0.005, 500, 10.0)],
    ),
    "out of reach": ("the target is 3 m away, and back, at once; it goes far out and comes back", Maker.out_of_reach),
    "stay": ("hold a pose; measured joint positions have the noise of encoders", Maker.stay),
    "outside": ("start 0.05 rad outside a position limit", Maker.outside),
    "stale": ("the slow path, as a stream of 10 Hz in a loop of 500 Hz", lambda a: [a.stream("stale", STALE, 0.0)]),
    "jitter": ("the slow path, as a stream of 50 Hz, up to 20 ms late", lambda a: [a.stream("jitter", STREAM, LATE)]),
    "NaN": ("the slow path; nine targets contain NaN or infinity", Maker.invalid),
}


def bed(arms: Sequence[str], kinds: Sequence[str], seed: int = 0) -> list[BedTask]:
    """The tasks of some arms and kinds; each depends on nothing but its arm, kind and seed."""
    return [replace(task, kind=kind) for name in arms for kind in kinds for task in KINDS[kind][1](Maker(name, seed))]


def from_file(task: Task, seed: int = 0) -> list[BedTask]:
    """A task file as a task with one second of rest at its end; and the same in another tool frame.

    Raises:
        BadInput: the task needs something that other methods do not have.
    """
    unsupported = {
        "in contact": task.contact,
        "with elastic timing": task.path.timing == "elastic",
        "with something free": task.part,
        "with an operator": task.operator,
        "with obstacles": task.obstacle,
        "with a clearance": task.clearance,
        "with a tool speed": task.law.tool_speed,
        "with a delay": task.law.delay or task.physics.delay,
    }
    for feature, is_used in unsupported.items():
        if is_used:
            raise BadInput("TASK", f"{task.name}, {feature}", "a task without this, which other methods do not have")
    setup = prepare(task)
    problem, rest = setup.problem, round(1.0 / task.law.dt)
    targets = np.concatenate((problem.poses, np.repeat(problem.poses[-1:], rest, axis=0)))
    ahead = np.concatenate((problem.feedforward, np.zeros((rest + 1, 6))))
    noise = np.resize(setup.noise, (len(targets), setup.noise.shape[1]))
    spec, q0, end = spec_of(setup.robot, task.law), np.array(task.start(), np.float64), len(problem.poses) - 1
    mine = BedTask(task.name, task.name, "task file", spec, q0, targets, ahead, noise, targets, spec, end)
    other = displaced(mine, random_displacement(seed))
    return [mine, replace(other, name=f"{task.name}, {OTHER_FRAME}", kind=OTHER_FRAME)]
