"""Runs methods on tasks, in a process for each environment.

Times are processor times of single ticks. The methods take turns every BLOCK ticks, so that a change of the clock rate
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
from invariantqp.workbench.compare.figures import CHANGES, Figures, figures
from invariantqp.workbench.compare.method import Method
from invariantqp.workbench.compare.tasks import BedTask

BLOCK = 100
# A process that takes longer for a request is ended [s]: OInK takes 8 s for a NaN target.
REQUEST_TIMEOUT = 20.0
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")


class RequestFailure(Exception):
    """A request raised an exception in the worker."""


class ProcessEnded(RequestFailure):
    """A process ended, and with it the runs of all methods of its environment."""


class Process:
    """A worker process of one environment; it is restarted after it has ended."""

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
            RequestFailure: the method raised an exception.
            ProcessEnded: no reply.
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
        timed_out = not timer.is_alive()
        timer.cancel()
        if self._closed:
            raise ProcessEnded("interrupted")
        if not line.endswith("\n"):
            self._end()
            printed = (Path(self._folder.name) / "stderr").read_text("utf-8", errors="replace").strip().splitlines()
            why = f": {printed[-1]}" if printed else ""
            raise ProcessEnded(
                f"its process was ended after {REQUEST_TIMEOUT:g} s" if timed_out else f"its process ended{why}"
            )
        answer = json.loads(line)
        if "failed" in answer:
            raise RequestFailure(answer["failed"])
        return answer["reply"]

    def _start(self) -> subprocess.Popen[str]:
        options: Any = {"env": self._variables, "cwd": self._folder.name, "text": True, "start_new_session": True}
        with (Path(self._folder.name) / "stderr").open("w", encoding="utf-8") as errors:
            pipe = subprocess.PIPE
            return subprocess.Popen(self._command, stdin=pipe, stdout=pipe, stderr=errors, **options)  # noqa: S603

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def close(self) -> None:
        """End the process; later requests fail."""
        self._closed = True
        self._end()
        self._folder.cleanup()


class Workers:
    """A process for each environment of some methods that is installed."""

    def __init__(self, methods: Sequence[Method]) -> None:
        pythons = {method.environment: python_of(method.environment) for method in methods}
        self.processes = {name: Process(name, python) for name, python in pythons.items() if python}

    def installed(self) -> dict[str, str]:
        """The names of the methods that can be run, with the versions of their packages."""
        versions: dict[str, str] = {}
        for process in self.processes.values():
            try:
                versions |= process.ask("methods")
            except RequestFailure:  # an incomplete environment
                continue
        return versions

    def run(self, task: BedTask, methods: Sequence[Method]) -> dict[str, Figures]:
        """The figures of each method on a task, or {"failed": why}; without methods that do not take it."""
        able = [method for method in methods if method.takes(task.spec)]
        runs = self._runs(task, able)
        results = {name: figures(task, run) if "failed" not in run else run for name, run in runs.items()}
        if task.original is not None:
            for name, run in self._runs(task.original, able).items():
                if "failed" not in run and "failed" not in runs[name]:
                    change = np.array(run["positions"]) - np.array(runs[name]["positions"])
                    results[name][CHANGES[task.kind]] = float(np.abs(change).max())
        return results

    def _runs(self, task: BedTask, methods: Sequence[Method]) -> dict[str, dict[str, Any]]:
        """The result of `worker.Run.end` of each method, or {"failed": why}."""
        runs: dict[str, dict[str, Any]] = {}
        lost: dict[str, Method] = {}  # because another method ended their process

        def ask(method: Method, request: str, **more: Any) -> Any:
            if method.name in runs or method.name in lost:
                return None
            try:
                return self.processes[method.environment].ask(request, method=method.name, **more)
            except RequestFailure as failure:
                runs[method.name] = {"failed": str(failure)}
                if isinstance(failure, ProcessEnded):
                    others = [m for m in methods if m.environment == method.environment and m.name not in runs]
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
        runs |= {name: run for name, run in ended.items() if run is not None and name not in lost}
        if lost:
            runs |= self._runs(task, list(lost.values()))
        return {method.name: runs[method.name] for method in methods}

    def close(self) -> None:
        """End the processes."""
        for process in self.processes.values():
            process.close()


def as_json(task: BedTask) -> dict[str, Any]:
    """A task as a worker takes it."""
    ahead = None if task.feedforward is None else task.feedforward.tolist()
    arrays = {key: getattr(task, key).tolist() for key in ("q0", "targets", "noise")}
    return {"spec": task.spec.as_json(), "feedforward": ahead, **arrays}


class WorkerPool:
    """Workers of this process, reused from task to task: one set for each task that is measured at the same time."""

    def __init__(self) -> None:
        self._all: list[Workers] = []
        self._free: dict[tuple[str, ...], SimpleQueue[Workers]] = {}

    def run(self, task: BedTask, methods: Sequence[Method]) -> dict[str, Figures]:
        """The result of `Workers.run`."""
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


# Processes of a cluster keep their workers until they end.
POOL = WorkerPool()


def measured(task: BedTask, methods: Sequence[Method]) -> tuple[BedTask, dict[str, Figures]]:
    """A task with the figures of every method; called in any process."""
    return task, POOL.run(task, methods)


def run_all(
    tasks: Sequence[BedTask], methods: Sequence[Method], jobs: int = 1
) -> Iterator[tuple[BedTask, dict[str, Figures]]]:
    """Every task with the figures of every method, in the order of completion, by joblib.

    `jobs` tasks are measured at a time; -1 is one a core, or one for each worker of the back end of
    `joblib.parallel_config`. The processes of methods are closed at the end, and at an interrupt.
    """
    calls = [delayed(measured)(task, methods) for task in tasks]
    streams = get_active_backend(prefer="threads")[0].supports_return_generator  # Ray does not
    order: dict[str, Any] = {"return_as": "generator_unordered"} if streams else {}
    try:
        yield from Parallel(jobs, prefer="threads", **order)(calls)
    finally:
        POOL.close()
