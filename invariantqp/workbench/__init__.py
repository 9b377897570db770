"""The workbench: what looks at the library and compares it, on top of it.

Holds: task files and their runs in closed loop (`runs`), other methods on the same tasks (`compare`), properties of an
arm before it moves (`analysis`), charts (`pictures`), pages (`view`), arms to drag (`drag`), the command line (`cli`).
In: a robot, a task, a trace. Out: figures, files, pages.
The library does not import it (an import contract). `iq.load_task`, `iq.run_task` and `iq.tasks` are loaded from here.
"""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.workbench.analysis.inspection import Inspection as Inspection
    from invariantqp.workbench.analysis.inspection import inspect as inspect
    from invariantqp.workbench.pictures.inspection import pitch_picture as pitch_picture
    from invariantqp.workbench.pictures.run import picture as picture
    from invariantqp.workbench.runs.frames import frame_check as frame_check
    from invariantqp.workbench.view.page import animation as animation
