"""Runs methods on tasks: each environment in a process of its own, methods in turn in blocks of ticks.

Times are the processor's, of single ticks. The methods take turns every BLOCK ticks, so that a change of the clock rate
affects all alike; BLAS has one thread.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Timer
from typing import IO, Any, cast

import numpy as np
from joblib import Parallel, delayed
from joblib.parallel import get_active_backend

from invariantqp.workbench.compare.environments import python_of
from invariantqp.workbench.compare.figures import Figures, figures
from invariantqp.workbench.compare.method import Method
from invariantqp.workbench.compare.tasks import BedTask

BLOCK = 100
# A request that takes longer is the end of its process [s]: OInK takes 8 s for a target that is NaN.
REQUEST_TIMEOUT = 20.0
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")


class RequestFailure(Exception):
    """A method raised where its loop was made."""


class ProcessEnded(RequestFailure):
    """The process of a method ended, and with it the runs of all methods of its environment."""


class Process:
    """A worker of one environment; it is started again after it has ended."""

    def __init__(self, environment: str, python: str) -> None:
        self._command = [python, "-m", "invariantqp.workbench.compare.worker", environment]
        self._folder = tempfile.TemporaryDirectory()
        place = self._folder.name
        self._variables = {**os.environ, **ONE_THREAD, "TMPDIR": place, "GLOG_minloglevel": "3"}
        if python != sys.executable:  # this package's files, without what it requires
            (Path(place) / "invariantqp").symlink_to(Path(__file__).parents[2])
            self._variables["PYTHONPATH"] = place
        self._process: subprocess.Popen[str] | None = None
        self._closed = False

    def ask(self, request: str, **more: Any) -> Any:
        """The reply to a request.

        Raises:
            RequestFailure: what the method raised.
            ProcessEnded: there is no reply.
        """
        if self._closed:
            raise ProcessEnded("interrupted")
        process = self._process = self._process or self._start()
        pipes = cast("tuple[IO[str], IO[str]]", (process.stdin, process.stdout))
        timer = Timer(REQUEST_TIMEOUT, process.kill)
        timer.daemon = True  # so that an interrupted comparison ends at once
        timer.start()
        try:
            pipes[0].write(json.dumps({"request": request, **more}) + "\n")
            pipes[0].flush()
            line = pipes[1].readline()
        except BrokenPipeError:
            line = ""
        late = not timer.is_alive()
        timer.cancel()
        if self._closed:
            raise ProcessEnded("interrupted")
        if not line.endswith("\n"):
            self._end()
            said = (Path(self._folder.name) / "stderr").read_text("utf-8", errors="replace").strip().splitlines()
            why = f": {said[-1]}" if said else ""
            raise ProcessEnded(
                f"its process was ended after {REQUEST_TIMEOUT:g} s" if late else f"its process ended{why}"
            )
        found = json.loads(line)
        if "failed" in found:
            raise RequestFailure(found["failed"])
        return found["reply"]

    def _start(self) -> subprocess.Popen[str]:
        words: Any = {"env": self._variables, "cwd": self._folder.name, "text": True, "start_new_session": True}
        with (Path(self._folder.name) / "stderr").open("w", encoding="utf-8") as errors:
            pipe = subprocess.PIPE
            return subprocess.Popen(self._command, stdin=pipe, stdout=pipe, stderr=errors, **words)  # noqa: S603

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def close(self) -> None:
        """End the process for good."""
        self._closed = True
        self._end()
        self._folder.cleanup()


class Workers:
    """The processes of every environment that some methods need and that has been made."""

    def __init__(self, methods: Sequence[Method]) -> None:
        pythons = {method.environment: python_of(method.environment) for method in methods}
        self.processes = {name: Process(name, python) for name, python in pythons.items() if python}

    def installed(self) -> dict[str, str]:
        """The names of all methods that can be run, and the versions of what they need."""
        found: dict[str, str] = {}
        for process in self.processes.values():
            try:
                found |= process.ask("methods")
            except RequestFailure:  # an environment that is not complete
                continue
        return found

    def run(self, task: BedTask, methods: Sequence[Method]) -> dict[str, Figures]:
        """The figures of each method on a task, or {"failed": why}; without those that do not take its limits."""
        able = [method for method in methods if method.accelerations or task.spec.acceleration_limit is None]
        runs = self._runs(task, able)
        found = {name: figures(task, run) if "failed" not in run else run for name, run in runs.items()}
        if task.original is not None:
            for name, run in self._runs(task.original, able).items():
                if "failed" not in run and "failed" not in runs[name]:
                    change = np.array(run["positions"]) - np.array(runs[name]["positions"])
                    found[name]["frame_rad"] = float(np.abs(change).max())
        return found

    def _runs(self, task: BedTask, methods: Sequence[Method]) -> dict[str, dict[str, Any]]:
        """What `worker.Run.end` returns of each method, or {"failed": why}."""
        found: dict[str, dict[str, Any]] = {}
        lost: dict[str, Method] = {}  # with the process of another method

        def ask(method: Method, request: str, **more: Any) -> Any:
            if method.name in found or method.name in lost:
                return None
            try:
                return self.processes[method.environment].ask(request, method=method.name, **more)
            except RequestFailure as failure:
                found[method.name] = {"failed": str(failure)}
                if isinstance(failure, ProcessEnded):
                    others = [m for m in methods if m.environment == method.environment and m.name not in found]
                    lost.update({other.name: other for other in others})
                return None

        first = {method.environment: method for method in reversed(methods)}
        for method in first.values():
            ask(method, "task", task=as_json(task))
        for method in methods:
            ask(method, "make")
        for _ in range(0, len(task.targets), BLOCK):
            for method in methods:
                ask(method, "run", ticks=BLOCK)
        ended = {method.name: ask(method, "end") for method in methods}
        found |= {name: run for name, run in ended.items() if run is not None and name not in lost}
        if lost:
            found |= self._runs(task, list(lost.values()))
        return {method.name: found[method.name] for method in methods}

    def close(self) -> None:
        """End the processes."""
        for process in self.processes.values():
            process.close()


def as_json(task: BedTask) -> dict[str, Any]:
    """What a worker is given of a task."""
    ahead = None if task.feedforward is None else task.feedforward.tolist()
    arrays = {key: getattr(task, key).tolist() for key in ("q0", "targets", "noise")}
    return {"spec": task.spec.as_json(), "feedforward": ahead, **arrays}


class Teams:
    """The workers of this process: one set for each task that is measured at the same time, kept for the next task."""

    def __init__(self) -> None:
        self._all: list[Workers] = []
        self._free: dict[tuple[str, ...], SimpleQueue[Workers]] = {}

    def run(self, task: BedTask, methods: Sequence[Method]) -> dict[str, Figures]:
        """What `Workers.run` returns."""
        free = self._free.setdefault(tuple(method.name for method in methods), SimpleQueue())
        try:
            workers = free.get_nowait()
        except Empty:
            workers = Workers(methods)
            self._all.append(workers)
        try:
            return workers.run(task, methods)
        finally:
            free.put(workers)

    def close(self) -> None:
        """End the processes."""
        self._free = {}
        while self._all:
            self._all.pop().close()


# A cluster's processes keep theirs until they end.
TEAMS = Teams()


def measured(task: BedTask, methods: Sequence[Method]) -> tuple[BedTask, dict[str, Figures]]:
    """A task with the figures of every method, in whatever process this is called."""
    return task, TEAMS.run(task, methods)


def run_all(
    tasks: Sequence[BedTask], methods: Sequence[Method], jobs: int = 1
) -> Iterator[tuple[BedTask, dict[str, Figures]]]:
    """Every task with the figures of every method, in the order in which they are finished, by joblib.

    `jobs` tasks are measured at a time, -1 is one a core, or one for each worker of the back end that
    `joblib.parallel_config` names. The processes of methods are closed at the end, also where it is interrupted.
    """
    calls = [delayed(measured)(task, methods) for task in tasks]
    try:
        yield from Parallel(jobs, prefer="threads", **_as_finished())(calls)
    finally:
        TEAMS.close()


def _as_finished() -> dict[str, Any]:
    """The option of Parallel for results as they are finished, if the back end has that: Ray has not."""
    has = get_active_backend(prefer="threads")[0].supports_return_generator
    return {"return_as": "generator_unordered"} if has else {}
