"""Force and motion at once: tasks in contact, wrench sensors, the hybrid controller."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.force.hybrid import HybridController as HybridController
    from invariantqp.force.hybrid_task import HybridTask as HybridTask
    from invariantqp.force.reading import Wrench as Wrench
    from invariantqp.force.solution import HybridSolution as HybridSolution
    from invariantqp.force.wrench import SensorCheck as SensorCheck
    from invariantqp.force.wrench import WrenchSensor as WrenchSensor
