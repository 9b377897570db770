"""A run expressed in displaced frames: the same arm, the same contact and the same motion, with other labels on them.

    T_tool' = T_tool X,  T_target' = T_target X,  T_sensor' = T_sensor Y,  T_contact' = T_contact Z

Nothing physical moves. The displaced values are made here, outside the run, which knows nothing of it.
"""

from __future__ import annotations

from dataclasses import replace

from numpy.typing import ArrayLike

from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.runs.brief import Brief
from invariantqp.runs.plants.plant import Measurement, Plant, PlantState
from invariantqp.runs.prepare import Setup


def displaced(
    setup: Setup,
    tool: ArrayLike | None = None,
    sensor: ArrayLike | None = None,
    contact: ArrayLike | None = None,
) -> Setup:
    """The setup of a run with frames displaced in themselves, (4, 4) or None each; its plant is the new one's too.

    Raises:
        BadInput: not finite (4, 4) rigid motions.
    """
    brief, plant = setup.brief, setup.plant
    if tool is not None:
        brief = _with_tool(brief, arrays.pose(tool, "tool"))
    if sensor is not None:
        Y = arrays.pose(sensor, "sensor")
        plant = DisplacedSensor(plant, Y)
        brief = replace(brief, sensor=None if brief.sensor is None else brief.sensor.relabelled(Y))
    if contact is not None and brief.contact_task is not None:
        brief = replace(brief, contact_task=brief.contact_task.relabelled(arrays.pose(contact, "contact")))
    return replace(setup, plant=plant, brief=brief)


def _with_tool(brief: Brief, X: Array) -> Brief:
    """The brief for a tool frame displaced by X in itself: points, poses, sensor and contact are expressed in it."""
    back = se3.inverse(X)
    law = brief.law
    points = {key: back.dot([*getattr(law, key), 1.0])[:3] for key in ("point", "tool_speed_point")}
    return replace(
        brief,
        robot=brief.robot.with_tool(X),
        law=law.model_copy(update={key: tuple(p.tolist()) for key, p in points.items()}),
        poses=brief.poses.dot(X),
        contact_task=None if brief.contact_task is None else brief.contact_task.relabelled(None, X),
        sensor=None if brief.sensor is None else brief.sensor.relabelled(None, X),
    )


class DisplacedSensor:
    """A plant whose force sensor's readings are expressed in a frame displaced by Y (4, 4) in the sensor's own."""

    def __init__(self, plant: Plant, Y: Array) -> None:
        self._plant = plant
        self._from_sensor = se3.coadjoint(se3.inverse(Y))

    def measure(self) -> Measurement:
        """What the sensors say, the wrench in the displaced frame."""
        measured = self._plant.measure()
        wrench = None if measured.wrench is None else self._from_sensor.dot(measured.wrench)
        return measured._replace(wrench=wrench)

    def command(self, velocity: Array) -> None:
        """Move for one tick at joint velocities (m,)."""
        self._plant.command(velocity)

    def state(self) -> PlantState:
        """How things really are now."""
        return self._plant.state()
