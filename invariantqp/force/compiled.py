"""A hybrid tick in the compiled core, as long as nothing stops the tool: a check that finds something is Python's.

What the core is told of a task, a sensor and a split are tables of `csrc/fields.h`, by name.
"""

from __future__ import annotations

from collections.abc import Callable
from struct import Struct
from typing import TYPE_CHECKING, Any

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.engine import core
from invariantqp.force.contact import HybridTask, Split
from invariantqp.force.memory import MEMORY, Memory, made_of, numbers_of, size_of
from invariantqp.force.sensor import WrenchSensor

if TYPE_CHECKING:
    from invariantqp.engine import Press
    from invariantqp.engine import Split as CoreSplit

# A hybrid tick by the core (`csrc/press.c` says what it takes and gives); None where Python has to answer.
compiled_press: Callable[..., tuple[Any, ...] | None] = getattr(core, "press", lambda *_, **__: None)
# What it says beside a status, by bits.
NOISY, UNSETTLED, GAIN_LOWERED, STANDS, WRONG_STIFFNESS, ASKING = (1 << k for k in range(6))
PACKED = Struct(f"{size_of(MEMORY)}d")


def packed(memory: Memory) -> bytes | None:
    """The numbers of a memory; None for one that the core does not have."""
    try:
        return PACKED.pack(*numbers_of(memory))
    except ValueError:
        return None


def memory_of(numbers: bytes) -> Memory:
    """The memory that these numbers are."""
    made: Memory = made_of(iter(PACKED.unpack(numbers)))
    return made


def core_split(split: Split) -> CoreSplit | None:
    """A split as the core takes it; None for one without constraints."""
    kind = split.kind
    if core is None or not len(split.unit_parts):
        return None
    made: CoreSplit = core.Split(
        presses=kind.presses,
        constraints=np.array(kind.constraints).T,
        motion=split.projectors.motion,
        force=split.projectors.force,
        intensities=split.intensities,
        unit_parts=split.unit_parts,
        unit_rates=split.unit_rates,
        twist=split.twist,
        gain=split.gain,
        exert=split.exert,
        load_force=split.load[0],
        load_moment=split.load[1],
        out=kind.out,
        origin=kind.origin,
    )
    return made


def core_press(
    task: HybridTask,
    sensor: WrenchSensor | None,
    loop: Controller,
    *,
    order: str | None,
    share: float,
    filter_time: float,
    force_first: bool,
    at_contact: bool,
) -> Press | None:
    """What does not change in a hybrid loop, as the core takes it; None for a loop that it does not have.

    Args:
        task: the task.
        sensor: or None.
        loop: that follows its twists.
        order: of plain readings.
        share: of a step that the low-pass passes on in a tick.
        filter_time: its time constant [s].
        force_first: whether the force part of a twist is met exactly.
        at_contact: whether twists are measured at the place of contact.
    """
    if core is None or loop.compiled is None or loop.varies:
        return None
    fields: dict[str, Any] = {}
    if sensor is not None:
        fields = {
            "mount": sensor.mount,
            "reaction": sensor.reads == "reaction",
            "mass": sensor.mass,
            "centre": sensor.centre,
            "gravity": sensor.gravity,
            "bias": sensor.bias,
            "force_deadband": sensor.force_deadband,
            "moment_deadband": sensor.moment_deadband,
            "origin": sensor.origin,
            "noise": sensor.noise,
        }
    made: Press = core.Press(
        moment_first=order != "force first",
        share=share,
        filter_time=filter_time,
        size=task.size,
        slope=task.slope,
        yields=task.yields,
        stiffness=task.stiffness or 0.0,
        has_compliance=task.compliance is not None,
        lost_below=-1.0 if task.lost_below is None else task.lost_below,
        lost_after=task.lost_after,
        on_loss=task.on_loss,
        approach_speed=task.approach_speed,
        approach_distance=task.approach_distance,
        approach_time=task.approach_time,
        slide_speed=task.slide_speed,
        max_force=-1.0 if task.max_force is None else task.max_force,
        max_moment=-1.0 if task.max_moment is None else task.max_moment,
        grip=task.grip,
        retreat_distance=task.retreat_distance,
        checks_noise="noise" in task.checks,
        checks_settling="settling" in task.checks,
        force_first=force_first,
        at_contact=at_contact,
        **fields,
    )
    return made
