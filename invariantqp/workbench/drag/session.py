"""The arm that a visitor drags, and the same arm driven by other methods: state, ticks, histories.

Our arm is driven as a teleoperator's would be: `Follower.add` with the target at RATE, a tick every DT. The other arms
have a tick every DT, too, with the target interpolated between the samples. All move as commanded.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from invariantqp.control.clearance import Clearance
from invariantqp.control.controller import Controller
from invariantqp.control.demands import ExactPoint
from invariantqp.errors import InvariantQPError
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.shapes import HalfSpace, Sphere
from invariantqp.paths.follower import Follower
from invariantqp.robots.chain import Chain
from invariantqp.workbench.compare.method import LoopSpec, Method
from invariantqp.workbench.compare.tasks import spec_of
from invariantqp.workbench.drag.recording import Recorder
from invariantqp.workbench.runs.newtask import well_conditioned_start
from invariantqp.workbench.runs.taskfile import LawSpec
from invariantqp.workbench.runs.trace import distance

# Duration of a tick [s], samples of the target per second, ticks of a sample.
DT, RATE = 0.002, 62.5
SAMPLE_TICKS = round(1.0 / (RATE * DT))
# What the histories hold [s], with a value of each sample.
HISTORY = 10.0
# The loop catches up with the clock by at most this [s]: on a busy machine the motion is slower.
MOST_LATE = 0.1
# The displaced tool frame: along its x axis [m], about its y axis [rad].
DISPLACED = se3.transform(se3.rotation(np.array([0.0, 0.7, 0.0])), (0.15, 0.0, 0.0))
# Radius of the sphere about the tool that keeps clear of the table [m]; how far below it the table is, of the reach.
HAND, TABLE = 0.05, 0.15
# Acceleration limit of all joints [rad/s^2, m/s^2], and damping of the damped form.
ACCELERATION, DAMPING = 15.0, 0.05
FORMS = ("least squares", "pitch h", "pitch h, damped")


class Settings(NamedTuple):
    """What a visitor can change; the arms come to rest when one of them changes."""

    form: str = FORMS[0]  # one of FORMS
    pitch: float = 0.1  # h of the two pitch forms [m/rad]
    exact: bool = False  # whether the position is exact
    table: bool = False  # whether the hand keeps clear of a table
    displaced: bool = False  # whether the tool frame is elsewhere on the tool
    speed: float = 1.0  # share of the joints' velocity limits
    ghost_limit: bool = True  # whether the ghosts keep the acceleration limit, too


class Sample(NamedTuple):
    """One value of a history."""

    time: float  # [s]
    mm: float  # position error
    deg: float  # orientation error
    acceleration: float  # largest of any joint since the sample before [rad/s^2, m/s^2]


@dataclass(eq=False)
class Arm:
    """One arm: its state and its history."""

    name: str
    q: Array  # (m,)
    velocity: Array  # (m,)
    status: str = ""
    reason: str = ""
    acceleration: float = 0.0  # largest since the last sample
    history: deque[Sample] = field(default_factory=lambda: deque(maxlen=round(HISTORY * RATE)))

    def move(self, velocity: Array) -> None:
        """Move for a tick."""
        self.acceleration = max(self.acceleration, float(np.abs(velocity - self.velocity).max()) / DT)
        self.velocity, self.q = velocity, self.q + DT * velocity

    def worst(self) -> list[float]:
        """The largest position error [mm], orientation error [deg] and acceleration of the history."""
        rows = list(self.history)
        return [max((row[i] for row in rows), default=0.0) for i in (1, 2, 3)]


class Ghost:
    """The same arm by another method of the comparison."""

    def __init__(self, method: Method, spec: LoopSpec, arm: Arm) -> None:
        self.arm, self.loop = arm, method.loop(spec)

    def step(self, target: Array) -> None:
        """One tick towards a target; where the method raises, or its answer is not finite, the arm stops."""
        arm, velocity = self.arm, np.zeros(len(self.arm.q))
        try:
            found = np.asarray(self.loop.step(arm.q, self.loop.target(target, None), None, arm.velocity), np.float64)
            arm.status, arm.reason = "", ""
            if np.isfinite(found).all():
                velocity = found
            else:
                arm.status, arm.reason = "fails", "the answer is not finite"
        except (Exception, SystemExit) as error:  # noqa: BLE001 (whatever a method raises)
            arm.status, arm.reason = "fails", f"{type(error).__name__}: {error}".splitlines()[0][:100]
        arm.move(velocity)


class Session:
    """Arms that follow one target. `advance` is called by one thread; `target`, `override`, `requested` are set by any.

    Attributes:
        robot: the arm.
        target: (4, 4) where the tool is to be, of the arm's own tool frame.
        override: share of the requested speed, 0 to 1; of our arm alone.
        requested: settings to take over with the next tick.
        settings: the settings that hold.
        refused: why requested settings were not taken over; "" if they were.
        arms: our arm first, then one for each other method.
    """

    def __init__(self, robot: Chain, source: str, against: Sequence[Method] = ()) -> None:
        self.robot, self.source, self.against = robot, source, tuple(against)
        self.start = well_conditioned_start(robot)
        self.target: Array = robot.pose(self.start)
        points = np.vstack((np.zeros(3), robot.origins(self.start), self.target[:3, 3]))
        self.reach = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        self.table_height = self._below(self.start)
        self.override = 1.0
        self.settings = self.requested = Settings()
        self.refused = ""
        self.ticks, self._owed = 0, 0.0
        self.recorder: Recorder | None = None
        self.arms = [
            Arm(name, self.start, np.zeros(len(self.start))) for name in ("invariantqp", *(m.name for m in against))
        ]
        self._before, self._sample = self.target, self.target
        self._build(self.settings)

    @property
    def ours(self) -> Arm:
        """Our arm."""
        return self.arms[0]

    @property
    def time(self) -> float:
        """Time of the arms [s]."""
        return DT * self.ticks

    def _build(self, settings: Settings) -> None:
        """Controllers of all arms for some settings, at rest where the arms are.

        Raises:
            InvariantQPError: the settings contradict one another.
        """
        robot = self.robot.with_limits(velocity_limit=settings.speed * self.robot.velocity_limit)
        displacement = DISPLACED if settings.displaced else np.eye(4)
        measure = Controller(robot, dt=DT).measure
        moved = robot.with_tool(displacement) if settings.displaced else robot
        point = se3.inverse(displacement)[:3, 3]  # accuracy counts where the frame was
        limits: list[Any] = []
        if settings.table:
            if not self.settings.table:
                self.table_height = self._below(self.ours.q)
            hand = {moved.tool: [Sphere(point, HAND, name="hand")]}
            table = HalfSpace([0.0, 0.0, self.table_height], [0.0, 0.0, 1.0], name="table")
            limits.append(Clearance(moved, hand, [table], distance=0.01))
        form = form_of(settings)
        controller = Controller(
            moved,
            dt=DT,
            point=point if settings.displaced and not form else None,
            length=measure.length if not form else None,
            exact=ExactPoint(point) if settings.exact else None,
            acceleration_limit=ACCELERATION,
            limits=limits,
            **form,
        )
        self._displacement, self._follower = displacement, Follower(controller)
        self._ghosts = []
        for method, arm in zip(self.against, self.arms[1:], strict=True):
            limit = ACCELERATION if settings.ghost_limit and method.accelerations else None
            self._ghosts.append(Ghost(method, spec_of(moved, LawSpec(dt=DT, acceleration_limit=limit)), arm))
        for arm in self.arms:
            arm.velocity = np.zeros(len(arm.q))
        self.settings = settings

    def _below(self, q: Array) -> float:
        """The height of a table that is below the hand."""
        return float(self.robot.pose(q)[2, 3]) - HAND - TABLE * self.reach

    def reset(self) -> None:
        """Bring all arms and the target back to the start."""
        for arm in self.arms:
            arm.q = self.start
            arm.history.clear()
        self.target = self._before = self._sample = self.robot.pose(self.start)
        self._build(self.settings)

    def advance(self, seconds: float) -> None:
        """Run the ticks of some time [s], at most those of MOST_LATE."""
        self._owed = min(self._owed + seconds, MOST_LATE)
        while self._owed > DT * (1.0 - 1e-6):
            self._owed -= DT
            self.tick()

    def tick(self) -> None:
        """One tick of every arm."""
        if self.requested != self.settings:
            wanted = self.requested
            try:
                self._build(wanted)
                self.refused = ""
            except InvariantQPError as error:
                self.refused, self.requested = str(error), self.settings
        part = self.ticks % SAMPLE_TICKS
        if part == 0:
            self._before, self._sample = self._sample, self.target
            self._follower.add(self._sample @ self._displacement)
        ours = self.ours
        solution = self._follower.step(ours.q, override=self.override)
        ours.move(solution.velocity)
        ours.status = str(solution.status)
        between = se3.exp((part + 1) / SAMPLE_TICKS * se3.log(self._sample @ se3.inverse(self._before))) @ self._before
        for ghost in self._ghosts:
            ghost.step(between @ self._displacement)
        self.ticks += 1
        if part == SAMPLE_TICKS - 1:
            ours.reason = solution.reason
            for arm in self.arms:
                length, angle = distance(self.robot.pose(arm.q), self._sample)
                arm.history.append(Sample(self.time, 1e3 * length, float(np.degrees(angle)), arm.acceleration))
                arm.acceleration = 0.0
        if self.recorder is not None:
            self.recorder.add(ours.q, ours.velocity, ours.status, self._sample, is_limited=ours.status == "limited")

    def record(self) -> None:
        """Begin to record our arm."""
        self.recorder = Recorder(self.robot, self.source, DT, self.ours.q, law_of(self.settings))


def form_of(settings: Settings) -> dict[str, Any]:
    """The arguments of a controller, or the keys of a [law] table, that choose the form; none for least squares."""
    pitch = {} if settings.form == FORMS[0] else {"form": settings.pitch}
    return pitch | ({"damping": DAMPING} if settings.form == FORMS[2] else {})


def law_of(settings: Settings) -> dict[str, Any]:
    """The [law] table of a task file for some settings."""
    exact = {"exact": "position"} if settings.exact else {}
    return {"dt": DT, "acceleration_limit": ACCELERATION, **form_of(settings), **exact}
