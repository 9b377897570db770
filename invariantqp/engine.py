"""The compiled engine, `law`: the module invariantqp._core.

A Python that is started in a folder with the sources imports these, not an installed package; if they were not compiled
there, an ImportError says so.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

NOT_BUILT = (
    "the compiled engine of invariantqp in {folder} cannot be imported ({error}). If this is the folder of its "
    "sources, run there: pip install -e . Else install invariantqp again for this Python."
)


def _imported(name: str) -> ModuleType:
    """A compiled module of this package."""
    try:
        return import_module(name)
    except ImportError as error:  # none was built, or one for another machine
        raise ImportError(NOT_BUILT.format(folder=Path(__file__).parents[1], error=error)) from None


# The engine: the velocity law of velocity/definition.py, and everything that ticks.
law: ModuleType = _imported("invariantqp._core")
# There is no other: the package always has it.
native = True
