"""How a long job reports its progress: it calls progress(done, total), with total the number of steps in all."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int], None]
