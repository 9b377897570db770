"""`Trace`, the record of a run: trajectory, errors, methods, statuses, times; contact, elastic path and clearance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any

import numpy as np

from invariantqp.control.target import Target
from invariantqp.force.contact_kinds import Contact
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.paths.path_drive import ENDED, SETTLING
from invariantqp.paths.plan import ON_TIME
from invariantqp.paths.solution import FollowerSolution
from invariantqp.velocity.solution import VelocitySolution
from invariantqp.workbench.runs.path import PoseAt
from invariantqp.workbench.runs.plant import PlantState
from invariantqp.workbench.runs.scene import ContactScene
from invariantqp.workbench.runs.taskfile import Task


def is_limit_active(solution: VelocitySolution) -> bool:
    """Whether a limit of a joint or another one, such as a clearance, was active in a tick."""
    return solution.method == "qp" or bool(solution.active)


@dataclass(frozen=True, eq=False)
class ContactTrace:
    """The record of a contact. Wrenches (m; f) are exerted by the tool, base frame, after each tick."""

    wrench: Array  # (n, 6) true
    measured: Array  # (n, 6) measured by the controller at the beginning of the tick
    press: Array  # (n,) part along the desired wrench [N], in the metric of the contact's stiffness
    measured_press: Array  # (n,) the same of the measured wrench
    error: Array  # (n,) |P*(W_d - W)| [N], in the same metric
    measured_error: Array  # (n,) the same of the measured wrench
    wanted: float  # |W_d| [N]
    position: Array  # (n, 3) of the tool point [m]
    desired: Array  # (n, 3) desired position of the tool point [m]
    normal: Array  # (3,) of the plane of the path

    def relative_rms(self, first: int, *, measured: bool = False) -> float | None:
        """Root mean square of the force error from tick `first` on, over |W_d|; None where no force is desired."""
        error = (self.measured_error if measured else self.error)[first:]
        return float(np.sqrt(np.mean(error**2))) / self.wanted if self.wanted > 0.0 else None


def contact_trace(
    scene: ContactScene, contacts: Sequence[Contact], after: Sequence[PlantState], measured: Array, wanted: Array
) -> ContactTrace:
    """The record of a contact in n ticks.

    `contacts` are the nominal ones at the poses of `after`, the plant's state after each tick; `measured` (n, 6) are
    the wrenches measured by the controller, `wanted` (n, 4, 4) the desired poses.
    """
    exerted = np.array([-state.wrench for state in after])
    press, error = np.array([scene.force(c, W) for c, W in zip(contacts, exerted, strict=True)]).T
    measured_press, measured_error = np.array([scene.force(c, W) for c, W in zip(contacts, measured, strict=True)]).T
    return ContactTrace(
        wrench=exerted,
        measured=measured,
        press=press,
        measured_press=measured_press,
        error=error,
        measured_error=measured_error,
        wanted=scene.wanted_norm,
        position=np.array([state.pose[:3, 3] for state in after]),
        desired=wanted[:, :3, 3],
        normal=scene.normal,
    )


def errors(
    scene: ContactScene | None,
    contacts: Sequence[Contact],
    after: Sequence[PlantState],
    wanted: Array,
    part: Target | None = None,
) -> Array:
    """(n, 2) distance [m] and angle [rad] from the desired poses (n, 4, 4), of what `part` constrains.

    In contact they are those along its freedoms.
    """
    if part is not None:
        return np.array([part.met_by(T).errors(state.pose) for state, T in zip(after, wanted, strict=True)])
    if scene is None:
        return np.array([distance(state.pose, T) for state, T in zip(after, wanted, strict=True)])
    return np.array([scene.motion_error(c, s.pose, T) for c, s, T in zip(contacts, after, wanted, strict=True)])


def distance(T: Array, wanted: Array) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses."""
    turn = se3.rotation_vector(T[:3, :3].T.dot(wanted[:3, :3]))
    return se3.norm(wanted[:3, 3] - T[:3, 3]), se3.norm(turn)


@dataclass(frozen=True, eq=False)
class PathTrace:
    """The record of an elastic path."""

    place: Array  # (n,) the path's own time [s]
    speed: Array  # (n,) over that of the path's timing
    lag: Array  # (n,) how late the tool is [s]
    ruling: list[str]  # (n,) what limits the speed, in words
    poses: Array  # (n + 1, 4, 4) of the path where the tool is, before the first tick and after each
    status: str  # in the last tick, as in `FollowerSolution`

    @property
    def moving_speed(self) -> Array:
        """The speeds before the joints come to rest at the end of the path."""
        moving = [ruling not in (SETTLING, ENDED) for ruling in self.ruling]
        return self.speed[moving] if any(moving) else self.speed

    @property
    def slowdowns(self) -> dict[str, float]:
        """The causes of slowdowns with their share of the moving ticks, most frequent first."""
        counts = Counter(ruling for ruling in self.ruling if ruling not in (ON_TIME, SETTLING, ENDED))
        return {name: count / len(self.moving_speed) for name, count in counts.most_common()}


def path_trace(path: PoseAt, followed: Sequence[FollowerSolution]) -> PathTrace:
    """The record of an elastic path, from the solutions of its follower."""
    place = np.array([s.place for s in followed])
    return PathTrace(
        place=place,
        speed=np.array([s.speed for s in followed]),
        lag=np.array([s.late for s in followed]),
        ruling=[s.ruling for s in followed],
        poses=np.array([path(at) for at in (0.0, *place.tolist())]),
        status=followed[-1].status,
    )


@dataclass(frozen=True, eq=False)
class ClearanceTrace:
    """The least distances of an arm from itself and from obstacles, in a run of n ticks."""

    distance: Array  # (n + 1,) the least [m], negative inside
    pairs: list[str]  # (n + 1,) their bodies
    required: float  # the least that is allowed [m]

    @property
    def chart_range(self) -> tuple[Array, float]:
        """(n + 1,) distances cut off for a chart, and the cut-off [m]: at most ten times the required distance."""
        farthest = float(np.max(self.distance, where=np.isfinite(self.distance), initial=0.0))
        most = max(min(farthest, 10.0 * self.required or inf), 2.0 * self.required)
        return np.minimum(self.distance, most), most

    def describe(self) -> str:
        """The least of the run."""
        i = int(self.distance.argmin())
        return f"{1e3 * self.distance[i]:.2f} mm, {self.pairs[i]}"


@dataclass(frozen=True, eq=False)
class Trace:
    """The record of a run.

    Attributes:
        task: the task.
        names: joint names.
        time: (n + 1,) [s].
        q: (n + 1, m) joint positions [rad, m].
        velocity: (n, m) commanded [rad/s, m/s].
        position_error: (n,) distance of the tool point from the path after each tick [m]; 0 where it is free.
        orientation_error: (n,) [rad]; of the axis alone where the turn about it is free, 0 where all of it is.
        position_limits: (2, m), lower and upper.
        velocity_limit: (m,).
        methods: (n,) names, as in `VelocitySolution`.
        statuses: (n,) names, as in `VelocitySolution`.
        limit_active: (n,) whether a limit was active.
        tick_ns: (n,) time that the controller took for each tick [ns].
        wanted: (n + 1, 4, 4) desired tool poses.
        form: description of the controller's form; "" where it has none.
        warnings: in sentences.
        physics: the plant, "ideal" or "mujoco".
        counted_from: the first tick whose errors count; 0 without contact.
        contact: forces and positions; None without contact.
        along: progress on an elastic path; None for fixed timing.
        clearance: least distances of bodies; None where no pair is kept apart.
    """

    task: Task
    names: tuple[str, ...]
    time: Array
    q: Array
    velocity: Array
    position_error: Array
    orientation_error: Array
    position_limits: Array
    velocity_limit: Array
    methods: list[str]
    statuses: list[str]
    limit_active: list[bool]
    tick_ns: Array
    wanted: Array
    form: str = ""
    warnings: list[str] = field(default_factory=list)
    physics: str = "ideal"
    counted_from: int = 0
    contact: ContactTrace | None = None
    along: PathTrace | None = None
    clearance: ClearanceTrace | None = None

    @property
    def position_violation(self) -> Array:
        """(n + 1, m) excess of each joint over its position limits [rad, m]; 0 inside."""
        low, high = self.position_limits
        return np.asarray(np.maximum(np.maximum(low - self.q, self.q - high), 0.0))

    @property
    def acceleration(self) -> Array:
        """(n, m) change of the commanded velocity over dt [rad/s^2, m/s^2]; the first from rest."""
        change: Array = np.diff(self.velocity, axis=0, prepend=0.0)
        return change / self.task.law.dt

    @property
    def limit_violation(self) -> float:
        """Largest excess over a position [rad, m] or velocity [rad/s, m/s] limit; 0 inside.

        An acceleration limit of the task counts as a velocity limit for each tick.
        """
        velocity = float((np.abs(self.velocity) - self.velocity_limit).max())
        change = self.task.law.dt * (self.acceleration_violation or 0.0)
        return max(float(self.position_violation[1:].max()), velocity, change)

    @property
    def acceleration_violation(self) -> float | None:
        """Largest excess over the task's acceleration limit [rad/s^2, m/s^2], from rest; None where it has none."""
        limit = self.task.law.acceleration_limit
        return None if limit is None else max(0.0, float((np.abs(self.acceleration) - np.asarray(limit)).max()))

    @property
    def shortfalls(self) -> list[str]:
        """The acceptance limits that were missed, a sentence each; empty if the run is accepted."""
        accept = self.task.accept
        if self.physics == "mujoco" and self.task.accept_mujoco is not None:
            accept = self.task.accept_mujoco
        mm, deg = self._counted
        limits = [
            ("largest position error", float(mm.max()), accept.position_error_mm, "mm"),
            ("largest orientation error", float(deg.max()), accept.orientation_error_deg, "deg"),
            ("final position error", float(mm[-1]), accept.final_position_error_mm, "mm"),
            ("final orientation error", float(deg[-1]), accept.final_orientation_error_deg, "deg"),
            ("limit violation", self.limit_violation, accept.limit_violation, "rad, m, rad/s or m/s"),
            ("rms force error", self.force_error or 0.0, accept.force_error, "of the wanted force"),
        ]
        missed = [
            f"{what} {got:.3g} {unit}, at most {limit:g} {unit} accepted"
            for what, got, limit, unit in limits
            if limit is not None and not got <= limit
        ]
        if accept.clearance_mm is not None and self.clearance is not None:
            least = 1e3 * float(self.clearance.distance.min())
            if not least >= accept.clearance_mm:
                missed.append(
                    f"least distance {self.clearance.describe()}, at least {accept.clearance_mm:g} mm accepted"
                )
        unfinished = self.along is not None and self.along.status != "done"
        return [*missed, "the path was not finished"] if unfinished else missed

    @property
    def force_error(self) -> float | None:
        """Root mean square of the force error over the desired force, after settling; None without contact."""
        return None if self.contact is None else self.contact.relative_rms(self.counted_from)

    @property
    def _counted(self) -> tuple[Array, Array]:
        """Errors [mm] and [deg] from the first tick that counts."""
        return 1e3 * self.position_error[self.counted_from :], np.degrees(self.orientation_error[self.counted_from :])

    @property
    def passed(self) -> bool:
        """Whether the task's acceptance limits are met."""
        return not self.shortfalls

    def summary(self) -> dict[str, Any]:
        """Figures of the run, in SI units unless the key has another."""
        n = len(self.velocity)
        mm, deg = self._counted
        measured = None if self.contact is None else self.contact.relative_rms(self.counted_from, measured=True)
        return {
            "task": self.task.name,
            "physics": self.physics,
            "passed": self.passed,
            "ticks": n,
            "position_error_mm": _spread(mm),
            "orientation_error_deg": _spread(deg),
            "final_position_error_mm": 1e3 * float(self.position_error[-1]),
            "final_orientation_error_deg": float(np.degrees(self.orientation_error[-1])),
            "limit_violation": self.limit_violation,
            "acceleration_violation": self.acceleration_violation,
            "peak_speed": float(np.abs(self.velocity).max()),
            "peak_acceleration": float(np.abs(self.acceleration).max()),
            "limits_active": sum(self.limit_active) / n,
            "methods": {name: count / n for name, count in Counter(self.methods).items()},
            "form": self.form,
            "statuses": {name: count / n for name, count in Counter(self.statuses).items()},
            "tick_us": _spread(1e-3 * self.tick_ns),
            "force_error_relative_rms": self.force_error,
            "force_error_relative_rms_measured": measured,
            "path_lag": None if self.along is None else float(self.along.lag[-1]),
            "path_speed": None if self.along is None else _spread(self.along.moving_speed),
            "slowed_by": None if self.along is None else self.along.slowdowns,
            "least_clearance_mm": None if self.clearance is None else 1e3 * float(self.clearance.distance.min()),
            "nearest": None if self.clearance is None else self.clearance.describe(),
            "shortfalls": self.shortfalls,
            "warnings": self.warnings,
        }

    def as_json(self) -> dict[str, Any]:
        """The summary and the joint trajectory."""
        return {**self.summary(), "joints": list(self.names), "dt": self.task.law.dt, "q": self.q.tolist()}


def _spread(values: Array) -> dict[str, float]:
    return {"median": float(np.median(values)), "p99": float(np.percentile(values, 99)), "max": float(values.max())}
