"""The tables of a task file about contact: [contact], [force], [sensor], [operator] and [physics].

Lengths are in metres, directions along the axes of the base, positions relative to the tool at the start. The
controller knows all of [contact] except `tilt`, by which the real surface or axis differs.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from invariantqp.force.contact import MAX_TILT
from invariantqp.workbench.runs.section import (
    Direction,
    NotNegative,
    Number,
    OpenNumber,
    Positive,
    Section,
    Vector3,
    Vector6,
)

# How many numbers the size of each kind of contact has: an edge one length, a face two sides.
SIZE_COUNT = {"point": 0, "edge": 1, "face": 2, "hinge": 2}


class ContactSpec(Section):
    """The contact of the tool, and the part of the tool that touches."""

    kind: Literal["point", "edge", "face", "hinge"] = Field(
        description="the tip of a pen, a straight edge or a flat face on a surface; or a handle on a hinge",
        examples=["point"],
    )
    normal: Direction = Field((0.0, 0.0, 1.0), description="of the surface, pointing out of it", examples=[[0, 0, 1]])
    along: Direction = Field(
        (1.0, 0.0, 0.0), description="direction of an edge, or of a face's first side", examples=[[1, 0, 0]]
    )
    size: list[Positive] | None = Field(
        None,
        min_length=1,
        max_length=2,
        description="length of an edge, or the two sides of a face or of a handle [m]",
        examples=[[0.08, 0.05]],
    )
    gap: Number = Field(0.0, description="distance between tool and surface at the start [m]", examples=[0.003])
    edges: list[Vector3] = Field(
        [],
        description="of a plane that ends, each the vector from the tool at the start to a straight edge, normal to "
        "it [m]; there is no surface beyond",
        examples=[[[0.08, 0.0, 0.0]]],
    )
    normal_within: Positive | None = Field(
        None,
        description="the largest correction of the normal by the tool's motion [rad]; left out: none",
        examples=[0.1],
        le=MAX_TILT,
    )
    axis: Direction = Field((0.0, 0.0, 1.0), description="axis of a hinge", examples=[[0, 0, 1]])
    point: Vector3 = Field((-0.4, 0.0, 0.0), description="of that axis, from the tool [m]", examples=[[0, -0.4, 0]])
    stiffness: Positive = Field(2e4, description="of the contact [N/m]", examples=[2e4])
    yields: Annotated[OpenNumber, Field(ge=0.0)] = Field(
        0.0,
        description="how far the surface may yield, slope or step down under the tool before a sensor without response "
        "is a fault; inf: without bound [m]",
        examples=[0.01],
    )
    tilt: Vector3 = Field(
        (0.0, 0.0, 0.0),
        description="rotation vector of the true surface or axis from the one that the controller knows [rad]",
        examples=[[0.01, 0.0, 0.0]],
    )
    settle: Positive = Field(
        1.0, description="the path waits, and errors do not count, for this long after the start [s]", examples=[1.0]
    )

    @model_validator(mode="after")
    def _fits_its_kind(self) -> ContactSpec:
        wanted, given = SIZE_COUNT[self.kind], 0 if self.size is None else len(self.size)
        if given != wanted:
            article = "an" if self.kind == "edge" else "a"
            raise ValueError(f"size of {article} {self.kind} has {wanted} number{'s' * (wanted != 1)}, not {given}")
        if self.edges and self.kind == "hinge":
            raise ValueError("edges are those of a plane; a hinge has none, leave them out")
        if self.normal_within is not None and self.kind == "hinge":
            raise ValueError("normal_within is for a surface; a hinge has no normal, leave it out")
        return self


class ForceSpec(Section):
    """The desired force, how fast it is corrected, and what to do when contact is lost or the force is too large.

    The complement Z, along which force errors are corrected, comes from the contact's stiffness, which works for every
    contact, or from a pitch h, or is given.
    """

    press: Number = Field(description="into the surface; on a hinge, away from its axis [N]", examples=[5.0])
    rate: Positive = Field(
        20.0,
        description="how fast a force error is corrected; the compliance is rate / stiffness [1/s]",
        examples=[20.0],
    )
    h: Number | None = Field(None, description="pitch whose reciprocal system is Z [m/rad]", examples=[0.3])
    complement: Annotated[list[Vector6], Field(min_length=1)] | None = Field(
        None,
        description="twists that span Z, in the contact's frame (z into the surface), one for each constraint",
        examples=[[[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]],
    )
    max_force: Positive | None = Field(
        None, description="a larger force is an overload [N]; left out: 2.5 times the press", examples=[40.0]
    )
    max_moment: Positive | None = Field(
        None, description="a larger moment is an overload [N m]; left out: from max_force", examples=[4.0]
    )
    on_overload: Literal["hold", "retreat"] | None = Field(
        None, description="left out: retreat from a contact that can be left", examples=["retreat"]
    )
    on_loss: Literal["approach", "hold", "retreat", "continue"] = Field(
        "approach", description="what to do when contact is lost", examples=["hold"]
    )
    edge_margin: NotNegative = Field(
        0.01, description="distance to an edge of the surface below which it is reported [m]", examples=[0.01]
    )
    approach_speed: Positive = Field(0.02, description="largest speed before contact [m/s]", examples=[0.02])

    @model_validator(mode="after")
    def _one_complement(self) -> ForceSpec:
        if self.h is not None and self.complement is not None:
            raise ValueError("h and complement both define Z; give one of them")
        return self


class SensorSpec(Section):
    """The force sensor: its pose, the mass beyond it, and the filter and deadbands of its readings."""

    mount: Vector3 = Field((0.0, 0.0, 0.0), description="position in the tool frame [m]", examples=[[0, 0, -0.1]])
    mount_turn: Vector3 = Field(
        (0.0, 0.0, 0.0), description="rotation vector of its frame in the tool frame [rad]", examples=[[0, 0, 0.785]]
    )
    mass: NotNegative = Field(0.0, description="of the tool beyond the sensor [kg]", examples=[0.2])
    centre: Vector3 = Field(
        (0.0, 0.0, 0.0), description="centre of that mass in the sensor's frame [m]", examples=[[0, 0, 0.05]]
    )
    cutoff: Positive | None = Field(
        None, description="of the low-pass filter on its readings [Hz]; left out: no filter", examples=[30.0]
    )
    force_deadband: NotNegative = Field(0.0, description="smaller forces count as zero [N]", examples=[0.2])
    moment_deadband: NotNegative = Field(0.0, description="smaller moments count as zero [N m]", examples=[0.02])


class OperatorSpec(Section):
    """A person who moves the tool on a plane while the robot keeps it on the plane. [path] is where the person goes."""

    normal: Direction = Field((0.0, 0.0, 1.0), description="of the plane", examples=[[0, 0, 1]])
    strays: NotNegative = Field(
        0.0, description="amplitude of the velocity by which the person also leaves the plane [m/s]", examples=[0.05]
    )
    tilts: NotNegative = Field(
        0.0, description="amplitude of the angular velocity by which the person tilts the tool [rad/s]", examples=[0.3]
    )
    beats: Positive = Field(1.0, description="frequency of both [Hz]", examples=[1.0])


class Physics(Section):
    """Friction, lag, dead time and noise of the MuJoCo plant; of these the ideal plant has the dead time alone."""

    friction: NotNegative = Field(0.3, description="Coulomb coefficient between tool and surface", examples=[0.3])
    hinge_friction: NotNegative = Field(0.3, description="friction torque of a hinge [N m]", examples=[0.3])
    lag: Positive = Field(0.01, description="time constant of the joints' velocity loops [s]", examples=[0.01])
    delay: NotNegative = Field(0.0, description="dead time of the commands [s]", examples=[0.004], lt=10.0)
    armature: NotNegative = Field(
        0.0, description="inertia of each motor's rotor behind its gear [kg m^2]", examples=[0.1]
    )
    force_noise: NotNegative = Field(1.0, description="standard deviation of a measured force [N]", examples=[1.0])
    moment_noise: NotNegative = Field(0.03, description="the same of a measured moment [N m]", examples=[0.03])
    seed: int = Field(0, ge=0, strict=True, description="seed of the noise", examples=[0])
