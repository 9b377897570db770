"""The compiled modules: the engine in C++, `law`, and the older core in C for loops, and whether that is in use.

The engine answers `solve_velocity`, `solve_velocities`, `solve_tasks`, `solve_pose` and tasks for Pink and mink, and
has the rows of clearances. The C core has the ticks of loops, by the law in legacy/: it answers what that would, or
hands the tick back to it.
`INVARIANTQP_NATIVE=0` in the environment switches it off; `engine="python"` does for one loop or one robot.

What stays in Python, and what a tick of a Panda then costs beside a plain one of the core's (`tests/benchmarks`):

    ==============================================================================  ===============
    more than 16 joints, 32 rows of limits or 8 exact rows                          100 to 400
    damping of one's own, `PaperLambda`, a pitch form made convex, another solver   100 to 10 000
    `point="own"` in a controller                                                   40
    a slider at zero, joint positions that cannot be true                           10 to 35
    `follow` with rows, a sighting, a point or a posture of one tick                5 and more
    a hybrid tick in which a check finds something, or the tool stands still,       70
    leaves or is beyond an edge; more than 12 losses in a second
    joint positions of a robot that is no `Chain`                                   all of it: 120
    decisions that rounding would make: exact rows that limits move, and leave      150 and more
    next to nothing of, beside a tool speed that is met; exact rows of which one
    depends on others but for 1e-7 to 1e-10; a form on an arm that loses a
    direction; sizes beyond 1e70
    pseudoinverse and dual projectors of dependent twists, near a principal pitch   20; 35 to 70
    ==============================================================================  ===============

A Python that is started in a folder with the sources imports these, not an installed package; if they were not compiled
there, an ImportError says so.
"""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from invariantqp._native import Law as Law
    from invariantqp._native import Loop as Loop
    from invariantqp._native import Wanted as Wanted

# What computes: the compiled core, or Python alone.
Engine = Literal["compiled", "python"]
ENGINES: tuple[Engine, ...] = ("compiled", "python")
NOT_BUILT = (
    "the compiled core of invariantqp in {folder} cannot be imported ({error}). If this is the folder of its sources, "
    "run there: pip install -e . Else install invariantqp again for this Python."
)


def _imported(name: str) -> ModuleType:
    """A compiled module of this package."""
    try:
        return import_module(name)
    except ImportError as error:  # none was built, or one for another machine
        raise ImportError(NOT_BUILT.format(folder=Path(__file__).parents[1], error=error)) from None


def _found() -> tuple[ModuleType | None, str]:
    """The core, or None, and in words which it is."""
    if os.environ.get("INVARIANTQP_NATIVE") == "0":
        return None, "pure Python: INVARIANTQP_NATIVE=0"
    return _imported("invariantqp._native"), "compiled core"


def core_for(engine: Engine) -> ModuleType | None:
    """The compiled core; None for Python alone."""
    return core if engine == "compiled" else None


# The engine: the velocity law of velocity/definition.py.
law: ModuleType = _imported("invariantqp._core")
core, engine = _found()
# Whether ticks are computed by the core.
native: bool = core is not None
