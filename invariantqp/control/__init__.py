"""Task-space velocity control of one arm: the controller, its limits, exact demands, partial targets, clearance.

In: measured joint positions and a target or a twist. Out: a joint velocity inside the limits, a `VelocitySolution`.
The engine (`core/loop.hpp`, `core/clearance.hpp`) computes a tick; this room checks arguments and calls the user's own
limits, demands and robots. It must not know of contacts, forces, paths or task files.
"""

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
    from invariantqp.control.shared import SharedTask as SharedTask
    from invariantqp.control.target import Target as Target
