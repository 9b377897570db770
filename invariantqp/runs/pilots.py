"""What steers a plant in a run: a controller, told in each tick what the plant senses and what the task wants.

Alone it follows the path; in touch it moves along S and presses along S*; together with an operator it keeps the tool
on a plane while the operator moves it there, s = P1 gain log(T_d T^-1) + P2 s_operator.
"""

from __future__ import annotations

from math import pi
from typing import Any, NamedTuple, Protocol

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.control.controls import Controls
from invariantqp.control.shared import SharedTask
from invariantqp.errors import BadInput
from invariantqp.force.hybrid import HybridController
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.runs.contactspec import OperatorSpec
from invariantqp.runs.plants.touch import Sensed
from invariantqp.systems.contacts import face_contact
from invariantqp.velocity.forms import Form
from invariantqp.velocity.solution import VelocitySolution


class Wish(NamedTuple):
    """What the task wants in a tick: a tool pose as the robot's `target` made it, its twist (6,), and the time [s]."""

    target: Any
    ahead: Array
    time: float


class Offsets(NamedTuple):
    """How the frames are displaced that a task is told in, each (4, 4) in itself; nothing physical moves."""

    tool: Array
    sensor: Array
    contact: Array


class Pilot(Protocol):
    """Steers a plant."""

    @property
    def form(self) -> Form | None:
        """What its law measures twists by, if it says."""
        ...

    @property
    def measured(self) -> Array:
        """(6,) the wrench that it took the tool to exert in the last tick, base frame; zero where it reads none."""
        ...

    def step(self, sensed: Sensed, wish: Wish) -> VelocitySolution:
        """One tick."""
        ...


class Alone:
    """A velocity controller that follows the path."""

    def __init__(self, loop: Controls) -> None:
        self._loop = loop
        self.form: Form | None = loop.law.form if isinstance(loop, Controller) else None
        self.measured: Array = np.zeros(6)

    def step(self, sensed: Sensed, wish: Wish) -> VelocitySolution:
        """One tick."""
        return self._loop.step(sensed.q, wish.target, wish.ahead)


class InTouch:
    """The hybrid controller.

    Args:
        loop: made for the frames that it is told in.
        sensor_offset: (4, 4) of the frame it takes readings in, from the sensor's own.
    """

    def __init__(self, loop: HybridController, sensor_offset: Array) -> None:
        self._loop = loop
        self.form: Form | None = loop.loop.law.form
        self._reading = se3.coadjoint(se3.inverse(sensor_offset, check=False))
        self.measured = np.zeros(6)

    def step(self, sensed: Sensed, wish: Wish) -> VelocitySolution:
        """One tick."""
        if sensed.wrench is None:
            raise BadInput("plant", "no force sensor", "one that senses the wrench at the tool")
        reading = self._reading.dot(sensed.wrench)
        solution = self._loop.step(sensed.q, wish.target, reading, wish.ahead)
        self.measured = solution.wrench
        return solution.velocity_solution._replace(status=solution.status, reason=solution.reason)


class Together:
    """An operator who moves the tool on a plane, straying off it, and the robot that keeps it there.

    Args:
        loop: the velocity controller.
        operator: what the operator does.
        point: (3,) of the tool frame, about which the robot levels the tool [m].
    """

    def __init__(self, loop: Controller, operator: OperatorSpec, point: Array) -> None:
        plane = face_contact((0.0, 0.0, 0.0), operator.normal)
        lift, tilts = np.eye(6)[:, [5]], np.eye(6)[:, :2]
        theirs = plane.freedoms
        ours = se3.adjoint(np.asarray(plane.pose), check=False).dot(np.hstack((lift, tilts)))
        self._loop = loop
        self.form: Form | None = loop.law.form
        self.measured: Array = np.zeros(6)
        self._shared = SharedTask(ours, theirs)
        self._strays = ours.dot([operator.strays, operator.tilts, operator.tilts])
        self._beats = operator.beats
        self._point = np.append(point, 1.0)

    def step(self, sensed: Sensed, wish: Wish) -> VelocitySolution:
        """One tick."""
        robot = self._loop.robot
        sighting = robot.sight(sensed.q, wish.target)
        here = se3.transform(None, robot.pose(sensed.q).dot(self._point)[:3])
        astray = se3.adjoint(here, check=False).dot(self._strays) * np.sin(2.0 * pi * self._beats * wish.time)
        s = self._shared.moved(here).twist(self._loop.gain * sighting.error, wish.ahead + astray)
        return self._loop.follow(sensed.q, s)
