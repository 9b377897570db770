"""Hybrid force and motion control of one arm in contact.

In: joint positions, a target pose, the reading of a wrench sensor. Out: a joint velocity within the limits, a status
and a reason. `contact_kinds` has the contacts, `contact` the task and its projectors, `wrench` and `sensor` the
readings, `control` the loop body, `loop_margins` the stability margins; the force law and its monitor are
`core/force.hpp` and `core/hybrid.hpp`. The room does not know of paths, plants or task files.
"""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.force.contact import HybridTask as HybridTask
    from invariantqp.force.control import HybridController as HybridController
    from invariantqp.force.control import HybridSolution as HybridSolution
    from invariantqp.force.loop_margins import Margins as Margins
    from invariantqp.force.loop_margins import margins as margins
    from invariantqp.force.sensor import WrenchSensor as WrenchSensor
    from invariantqp.force.wrench import Wrench as Wrench
