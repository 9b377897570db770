"""What a control script uses: the controller, what it meets exactly, and a twist split with an operator."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.control.controller import Controller as Controller
    from invariantqp.control.controller import Controls as Controls
    from invariantqp.control.demands import Exact as Exact
    from invariantqp.control.demands import ExactAxis as ExactAxis
    from invariantqp.control.demands import ExactJoints as ExactJoints
    from invariantqp.control.demands import ExactPlane as ExactPlane
    from invariantqp.control.demands import ExactPoint as ExactPoint
    from invariantqp.control.demands import ExactTwist as ExactTwist
    from invariantqp.control.demands import View as View
    from invariantqp.control.passivity import LinkEnd as LinkEnd
    from invariantqp.control.passivity import LinkTick as LinkTick
    from invariantqp.control.shared import SharedTask as SharedTask
    from invariantqp.control.target import Target as Target
