"""Whether this installation has the compiled core and uses it; without it everything works in pure Python.

The core computes ticks of the velocity law faster than Python does. It answers what the Python law would answer, or
hands the tick back to it. `INVARIANTQP_NATIVE=0` in the environment switches it off.
"""

from __future__ import annotations

import os
from importlib import import_module
from types import ModuleType


def _found() -> tuple[ModuleType | None, str]:
    """The core, or None, and in words which it is."""
    if os.environ.get("INVARIANTQP_NATIVE") == "0":
        return None, "pure Python: INVARIANTQP_NATIVE=0"
    try:
        return import_module("invariantqp._native"), "compiled core"
    except ImportError:  # none was built, or one for another machine
        return None, "pure Python: no compiled core was built"


core, engine = _found()
# Whether ticks are computed by the core.
native: bool = core is not None
