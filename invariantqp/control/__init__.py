"""What a control script uses: the controller, what it meets exactly, and a twist split with an operator.

Each name is loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from invariantqp.lazy import load_lazily

if TYPE_CHECKING:
    from invariantqp.control.controller import Controller as Controller
    from invariantqp.control.controls import Controls as Controls
    from invariantqp.control.demands import Exact as Exact
    from invariantqp.control.demands import ExactAxis as ExactAxis
    from invariantqp.control.demands import ExactJoints as ExactJoints
    from invariantqp.control.demands import ExactPlane as ExactPlane
    from invariantqp.control.demands import ExactPoint as ExactPoint
    from invariantqp.control.demands import View as View
    from invariantqp.control.passivity import LinkEnd as LinkEnd
    from invariantqp.control.passivity import LinkTick as LinkTick
    from invariantqp.control.path_follower import PathFollower as PathFollower
    from invariantqp.control.path_solution import PathSolution as PathSolution
    from invariantqp.control.servo import Servo as Servo
    from invariantqp.control.shared import SharedTask as SharedTask
    from invariantqp.control.streamed_path import StreamedPath as StreamedPath

load_lazily(
    __name__,
    {
        "invariantqp.control.controller": ("Controller",),
        "invariantqp.control.controls": ("Controls",),
        "invariantqp.control.demands": ("Exact", "ExactAxis", "ExactJoints", "ExactPlane", "ExactPoint", "View"),
        "invariantqp.control.passivity": ("LinkEnd", "LinkTick"),
        "invariantqp.control.path_follower": ("PathFollower",),
        "invariantqp.control.path_solution": ("PathSolution",),
        "invariantqp.control.servo": ("Servo",),
        "invariantqp.control.shared": ("SharedTask",),
        "invariantqp.control.streamed_path": ("StreamedPath",),
    },
)
