"""How long work tells how far it is: a function of (steps done, steps in all)."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int], None]
