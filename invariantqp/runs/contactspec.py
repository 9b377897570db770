"""What a task file says of contact: [contact] is touched, [force] presses, [operator] shares, [physics] referees.

Lengths in metres, directions in base axes, everything relative to where the tool is at the start. The controller is
told all of [contact] but `tilt`: how the surface really lies is what force control is for.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from invariantqp.runs.path import Number, Positive, Section, Vector3

Vector6 = tuple[Number, Number, Number, Number, Number, Number]
NotNegative = Annotated[Number, Field(ge=0.0)]


class ContactSpec(Section):
    """What the tool touches, and with what."""

    kind: Literal["point", "edge", "face", "hinge"] = Field(
        description="a pen's ball, a straight edge or a flat face on a surface; a handle on a hinge", examples=["point"]
    )
    normal: Vector3 = Field((0.0, 0.0, 1.0), description="out of the surface", examples=[[0.0, 0.0, 1.0]])
    along: Vector3 = Field(
        (1.0, 0.0, 0.0), description="of an edge, or of a face's first side", examples=[[1.0, 0.0, 0.0]]
    )
    size: list[Positive] | None = Field(
        None,
        min_length=1,
        max_length=2,
        description="length of an edge, or the sides of a face or of a grip [m]",
        examples=[[0.08, 0.05]],
    )
    gap: Number = Field(0.0, description="between tool and surface at the start [m]", examples=[0.003])
    radius: Positive | None = Field(
        None, description="of a round bar along `along`, for a point; left out: a plane [m]", examples=[0.3]
    )
    axis: Vector3 = Field((0.0, 0.0, 1.0), description="of a hinge", examples=[[0.0, 0.0, 1.0]])
    point: Vector3 = Field(
        (-0.4, 0.0, 0.0), description="of a hinge's axis, from the tool [m]", examples=[[0.0, -0.4, 0.0]]
    )
    stiffness: Positive = Field(2e4, description="of the contact [N/m]", examples=[2e4])
    tilt: Vector3 = Field(
        (0.0, 0.0, 0.0),
        description="how the real surface or axis is turned about the tool; the controller is not told [rad]",
        examples=[[0.01, 0.0, 0.0]],
    )
    settle: Positive = Field(1.0, description="the path waits, and errors count, from this time on [s]", examples=[1.0])

    @field_validator("normal", "along", "axis")
    @classmethod
    def _direction(cls, given: Vector3) -> Vector3:
        if not any(given):
            raise ValueError("a direction is not zero")
        return given

    @model_validator(mode="after")
    def _of_a_kind(self) -> ContactSpec:
        sides = {"point": 0, "edge": 1, "face": 2, "hinge": 2}[self.kind]
        given = 0 if self.size is None else len(self.size)
        if given != sides:
            raise ValueError(f"size of a {self.kind} is {sides} numbers, not {given}")
        if self.radius is not None and self.kind != "point":
            raise ValueError(f"radius is for a point on a round bar, not for a {self.kind}")
        return self


class ForceSpec(Section):
    """How hard to press, how softly to answer, and what cleans the sensor's readings."""

    press: Number = Field(description="into the surface; on a hinge, away from its axis [N]", examples=[5.0])
    rate: Positive = Field(
        20.0, description="at which a force error is mended; the compliance is rate / stiffness [1/s]", examples=[20.0]
    )
    form: Literal["stiffness", "pitch", "complement"] = Field(
        "stiffness",
        description="what Z, in which force errors are mended, comes from: the contact's stiffness as a metric, which "
        "does for every contact; a pitch h; or Z itself",
        examples=["stiffness"],
    )
    pitch: Number | None = Field(None, description='h [m/rad] of form = "pitch"', examples=[0.3])
    complement: list[Vector6] | None = Field(
        None,
        description="twists of Z in the contact's frame (z into the surface), one for each constraint",
        examples=[[[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]],
    )
    cutoff: Positive | None = Field(None, description="of the low-pass on the readings [Hz]; none", examples=[30.0])
    force_deadband: NotNegative = Field(0.0, description="[N]", examples=[0.2])
    moment_deadband: NotNegative = Field(0.0, description="[N m]", examples=[0.02])
    max_force: Positive | None = Field(None, description="an overload above it [N]; none", examples=[40.0])
    max_moment: Positive | None = Field(None, description="an overload above it [N m]; none", examples=[4.0])
    on_overload: Literal["hold", "retreat"] = Field("hold", examples=["retreat"])
    on_loss: Literal["approach", "hold", "retreat", "continue"] = Field("approach", examples=["hold"])
    approach_speed: Positive = Field(0.02, description="in the air, at most [m/s]", examples=[0.02])
    sensor: Vector3 = Field(
        (0.0, 0.0, 0.0),
        description="where the force sensor is, in tool axes [m]",
        examples=[[0, 0, -0.1]],
    )
    sensor_turn: Vector3 = Field(
        (0.0, 0.0, 0.0), description="rotation vector of its frame in the tool's [rad]", examples=[[0.0, 0.0, 0.785]]
    )
    tool_mass: NotNegative = Field(0.0, description="beyond the sensor [kg]", examples=[0.2])
    tool_centre: Vector3 = Field(
        (0.0, 0.0, 0.0), description="centre of that mass in the sensor's frame [m]", examples=[[0.0, 0.0, 0.05]]
    )

    @field_validator("pitch")
    @classmethod
    def _pitch_of_a_form(cls, pitch: float | None, info: ValidationInfo) -> float | None:
        if (pitch is None) == (info.data.get("form") == "pitch"):
            raise ValueError('a pitch and form = "pitch" go together')
        return pitch

    @model_validator(mode="after")
    def _complete(self) -> ForceSpec:
        if self.form == "pitch" and self.pitch is None:
            raise ValueError('form = "pitch" needs pitch = h')
        if (self.form == "complement") != (self.complement is not None):
            raise ValueError('complement and form = "complement" go together')
        return self


class OperatorSpec(Section):
    """A person who moves the tool on a plane while the robot keeps it there: [path] is where the person goes."""

    normal: Vector3 = Field((0.0, 0.0, 1.0), description="of the plane", examples=[[0.0, 0.0, 1.0]])
    strays: NotNegative = Field(
        0.0, description="what the person also pushes off the plane, and takes back [m/s]", examples=[0.05]
    )
    tilts: NotNegative = Field(0.0, description="what the person also tilts, likewise [rad/s]", examples=[0.3])
    beats: Positive = Field(1.0, description="how often [Hz]", examples=[1.0])

    @field_validator("normal")
    @classmethod
    def _direction(cls, given: Vector3) -> Vector3:
        if not any(given):
            raise ValueError("a direction is not zero")
        return given


class PhysicsSpec(Section):
    """What the referee adds to geometry; the ideal scene has none of it."""

    friction: NotNegative = Field(0.3, description="Coulomb's coefficient", examples=[0.3])
    hinge_friction: NotNegative = Field(0.3, description="torque [N m]", examples=[0.3])
    lag: Positive = Field(0.01, description="time constant of the joints' velocity loops [s]", examples=[0.01])
    force_noise: NotNegative = Field(1.0, description="standard deviation of a measured force [N]", examples=[1.0])
    moment_noise: NotNegative = Field(0.03, description="of a measured moment [N m]", examples=[0.03])
    seed: int = Field(0, ge=0, strict=True, examples=[0])
