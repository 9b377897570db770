"""The compiled engine, `law`: the module invariantqp._core.

Python started in the folder of the sources imports these, not an installed package; an ImportError says if they were
not compiled there.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

NOT_BUILT = (
    "the compiled engine of invariantqp in {folder} cannot be imported ({error}). If this is the folder of its "
    "sources, run there: pip install -e . Else install invariantqp again for this Python."
)


try:
    law: ModuleType = import_module("invariantqp._core")
except ImportError as _error:  # not compiled, or for another machine
    raise ImportError(NOT_BUILT.format(folder=Path(__file__).parents[1], error=_error)) from None
# Fixed public name: there is no other engine.
native = True
