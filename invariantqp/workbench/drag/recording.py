"""A recorded run of the dragged arm: the page of a run, and a task file."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain
from invariantqp.workbench.pictures.charts import extremes, frame_ends
from invariantqp.workbench.runs.section import toml
from invariantqp.workbench.runs.taskfile import task_from
from invariantqp.workbench.view.page import page
from invariantqp.workbench.view.timeline import arm_in, states, timeline_before

# A recording ends by itself [s]; a task file has this many poses per second.
LONGEST, RATE = 120.0, 20.0


class Recorder:
    """What our arm did, tick by tick."""

    def __init__(self, robot: Chain, source: str, dt: float, start: Array, law: dict[str, Any]) -> None:
        self.robot, self.source, self.dt, self.law, self.start = robot, source, dt, law, start
        self._ticks: list[tuple[Array, Array, str, Array, bool]] = []

    @property
    def seconds(self) -> float:
        """How long it is [s]."""
        return self.dt * len(self._ticks)

    def add(self, q: Array, velocity: Array, status: str, target: Array, *, is_limited: bool) -> None:
        """One more tick; none after LONGEST."""
        if self.seconds < LONGEST:
            self._ticks.append((q, velocity, status, target, is_limited))

    def task(self) -> dict[str, Any]:
        """The content of a task file: the arm follows the same targets from the same joint positions."""
        targets = np.array([tick[3] for tick in self._ticks])
        every = max(1, round(1.0 / (RATE * self.dt)))
        poses = targets[::every]
        duration = max(len(poses) - 1, 1) * every * self.dt
        T0 = self.robot.pose(self.start)
        rows = [[*se3.rotation_vector(T[:3, :3] @ T0[:3, :3].T), *(T[:3, 3] - T0[:3, 3])] for T in poses]
        return {
            "name": "dragged",
            "about": "A target that was dragged by hand",
            "robot": {"source": self.source, "start": np.round(self.start, 6).tolist()},
            "path": {"kind": "poses", "duration": duration, "poses": np.round(rows, 5).tolist()},
            "law": self.law,
        }

    def task_file(self) -> str:
        """The text of the task file."""
        content = self.task()
        lines = [f"{key} = {toml(content[key])}" for key in ("name", "about")]
        for table in ("robot", "path", "law"):
            lines += ["", f"[{table}]", *(f"{key} = {toml(value)}" for key, value in content[table].items())]
        return "\n".join(lines) + "\n"

    def page(self) -> str:
        """The page that replays it."""
        q, velocity, status, target, limited = zip(*self._ticks, strict=True)
        ends = frame_ends(len(q))
        latest = np.maximum(ends - 1, 0)
        positions = np.vstack((self.start, q))[ends]
        before = timeline_before(task_from(self.task(), "the recording"))
        arm = arm_in(self.robot, positions)
        timeline = replace(
            before,
            **arm,
            time=self.dt * ends,
            wanted=np.array(target)[latest],
            speed=extremes(np.array(velocity), ends),
            travel=np.gradient(arm["tool"][:, :3, 3], self.dt * ends, axis=0),
            **states(status, limited, ends),
        )
        return page(replace(timeline, charts=tuple(timeline.limit_charts)))
