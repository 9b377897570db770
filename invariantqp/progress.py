"""How a long job reports its progress: it calls progress(done, total), with total the number of steps in all."""

from __future__ import annotations

from collections.abc import Callable

# What is expected of one, for messages.
PROGRESS = "a function of (steps done, steps in all)"
Progress = Callable[[int, int], None]
