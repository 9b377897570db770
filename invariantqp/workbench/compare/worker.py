"""A process that runs methods of one environment: a line of JSON for each request and each answer.

    {"request": "methods"}                              installed methods and their versions
    {"request": "task", "task": ...}                    set the task
    {"request": "make", "method": ...}                  make a method's loop
    {"request": "run", "method": ..., "ticks": n}       run n more ticks
    {"request": "end", "method": ...}                   return joint positions, velocities, times, exceptions

Run: python -m invariantqp.workbench.compare.worker ENVIRONMENT. An environment of a library has NumPy and that library,
not the requirements of this package.
"""

from __future__ import annotations

import gc
import json
import logging
import os
import sys
import warnings
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from time import thread_time_ns
from typing import Any

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.workbench.compare.method import MODULES, LoopSpec, Method

RESULTS = ("positions", "velocities", "times_us", "exceptions", "stopped")


class Run:
    """A run of one method on one task."""

    def __init__(self, method: Method, task: dict[str, Any]) -> None:
        spec = LoopSpec.from_json(task["spec"])
        self.dt, self.noise, ahead = spec.dt, np.array(task["noise"]), task["feedforward"]
        self.ahead = [None] * len(self.noise) if ahead is None else list(np.array(ahead))
        self.loop: Any = method.loop(spec)
        poses = np.array(task["targets"])
        self.finite = np.isfinite(poses).all(axis=(1, 2))
        self.targets = [self.loop.target(pose, twist) for pose, twist in zip(poses, self.ahead, strict=True)]
        self.q = np.array(task["q0"])
        self.previous: Array = np.zeros(len(self.q))
        self.positions, self.velocities, self.times_us = [self.q.tolist()], list[Any](), list[float]()
        self.stopped: list[int] = []
        self.exceptions: dict[str, int] = {}

    def run(self, ticks: int) -> None:
        """Run more ticks. The arm stops in a tick that raises or whose answer is not finite.

        Such a tick counts as an exception unless its target is not finite: then a refusal is right.
        """
        first = len(self.times_us)
        for k in range(first, min(first + ticks, len(self.targets))):
            q, target, ahead = self.q + self.noise[k], self.targets[k], self.ahead[k]
            failed, x = "", self.previous
            start = thread_time_ns()
            try:
                x = self.loop.step(q, target, ahead, self.previous)
            except (Exception, SystemExit) as error:  # noqa: BLE001 (exceptions are counted; Drake leaves by SystemExit)
                failed = f"{type(error).__name__}: {error}".splitlines()[0][:100]
            self.times_us.append((thread_time_ns() - start) / 1e3)
            x = np.array(x, np.float64)
            if not failed and not np.isfinite(x).all():
                failed = "the answer was not finite"
            if failed:
                x = np.zeros(len(q))
                self.stopped.append(k)
                if self.finite[k]:
                    self.exceptions[failed] = self.exceptions.get(failed, 0) + 1
            self.previous, self.q = x, self.q + self.dt * x
            self.velocities.append(x.tolist())
            self.positions.append(self.q.tolist())

    def end(self) -> dict[str, Any]:
        """The results."""
        return {key: getattr(self, key) for key in RESULTS}


def methods_of(environment: str) -> dict[str, Method]:
    """The installed methods of an environment by their names."""
    modules = MODULES[-1:] if environment else MODULES
    rows = [row for module in modules for row in import_module(module).METHODS if row.environment == environment]
    return {row.name: row for row in rows if all(find_spec(name) is not None for name in row.needs)}


class Worker:
    """Answers requests; holds the task and the runs that have not ended."""

    def __init__(self, environment: str) -> None:
        self.methods, self.runs = methods_of(environment), dict[str, Run]()
        self.task: dict[str, Any] = {}

    def reply(self, request: str, method: str = "", **more: Any) -> Any:
        """The answer to a request."""
        if request == "methods":
            return {name: _version(row.distribution) for name, row in self.methods.items()}
        if request == "task":
            self.task = more["task"]
        if request == "make":
            self.runs[method] = Run(self.methods[method], self.task)
        if request == "run":
            self.runs[method].run(more["ticks"])
        return self.runs.pop(method).end() if request == "end" else None


def _version(distribution: str) -> str:
    try:
        return version(distribution) if distribution else ""
    except PackageNotFoundError:
        return ""


def main(environment: str = "") -> None:
    """Answer requests until the input ends."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # output of libraries goes to standard error
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    worker = Worker(environment)
    gc.disable()
    for line in sys.stdin:
        try:
            answer = {"reply": worker.reply(**json.loads(line))}
        except (Exception, SystemExit) as error:  # noqa: BLE001 (a method that fails is a row of the report)
            answer = {"failed": f"{type(error).__name__}: {error}"[:300]}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()
        if not worker.runs:
            gc.collect()  # between tasks, not within ticks


if __name__ == "__main__":
    main(*sys.argv[1:])
