"""Force and motion at once: tasks in contact, wrench sensors, the hybrid controller."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.force.contact import HybridTask as HybridTask
    from invariantqp.force.control import HybridController as HybridController
    from invariantqp.force.control import HybridSolution as HybridSolution
    from invariantqp.force.loop_margins import Margins as Margins
    from invariantqp.force.loop_margins import margins as margins
    from invariantqp.force.sensor import SensorCheck as SensorCheck
    from invariantqp.force.sensor import Wrench as Wrench
    from invariantqp.force.sensor import WrenchSensor as WrenchSensor
