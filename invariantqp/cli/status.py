"""Exit statuses; 0 is done."""

from __future__ import annotations

NOT_ACCEPTED = 1
BAD_INPUT = 2
