"""The base of every table of a task file, and the kinds of numbers in them.

A number in a file is a number: no text, no booleans, and nothing so large that its square would overflow. Units are SI
and radians.
"""

from __future__ import annotations

from math import isnan
from typing import Annotated, ClassVar

from pydantic import AfterValidator, AllowInfNan, BaseModel, ConfigDict, Field, Strict

# Any quantity of a robot cell is far below this in SI units; a larger one is a typing error.
LARGEST = 1e12
# A vector shorter than this has no direction that can be trusted.
SHORTEST = 1e-9

Number = Annotated[float, Strict(), AllowInfNan(False), Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[Number, Field(gt=0.0)]
NotNegative = Annotated[Number, Field(ge=0.0)]
Vector3 = tuple[Number, Number, Number]
Vector6 = tuple[Number, Number, Number, Number, Number, Number]


class Section(BaseModel):
    """A table of a task file. Unknown keys are refused.

    Attributes:
        RENAMED: old keys, each with what replaced it; the error message for an old key says so.
    """

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", frozen=True)
    RENAMED: ClassVar[dict[str, str]] = {}


def checked_number(number: float) -> float:
    """The number, infinite or not.

    Raises:
        ValueError: it is NaN.
    """
    if isnan(number):
        raise ValueError("a limit or a pitch is a number, or inf or -inf")
    return number


# Infinity is allowed where it has a meaning: no limit, or the pitch of a prismatic joint.
OpenNumber = Annotated[float, Strict(), AfterValidator(checked_number)]


def checked_direction(vector: Vector3) -> Vector3:
    """The vector, if it has a direction.

    Raises:
        ValueError: it is zero.
    """
    if sum(x * x for x in vector) < SHORTEST**2:
        raise ValueError("a direction cannot be the zero vector")
    return vector


# A direction in space; its length does not matter.
Direction = Annotated[Vector3, AfterValidator(checked_direction)]
