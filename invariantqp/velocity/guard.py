"""The descent guard of a form: the share of the least-squares decrease of the error that it must keep."""

from __future__ import annotations

from attrs import frozen

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.fields import Value

# The form's velocity is unchanged where it achieves at least half the decrease of least squares.
DEFAULT_FRACTION = 0.5


@frozen(init=False, eq=False, repr=False, slots=False)
class Guard(Value):
    """The least decrease of the error by a form, in the measure."""

    fraction: float

    def __init__(self, fraction: float = DEFAULT_FRACTION) -> None:
        """A guard.

        Args:
            fraction: eta in [0, 1], the share of the least-squares decrease that is required.

        Raises:
            BadInput: a fraction out of range.
        """
        share = arrays.number(fraction, "fraction")
        if not 0.0 <= share <= 1.0:
            raise BadInput("fraction", f"{share:g}", "a number from 0 to 1")
        self.__attrs_init__(share)


def guard_of(guard: Guard | bool) -> Guard | None:
    """The guard of an argument: True is the default one, False none.

    Raises:
        BadInput: neither.
    """
    if isinstance(guard, Guard):
        return guard
    if not isinstance(guard, bool):
        raise BadInput("guard", type(guard).__name__, "a Guard, True or False")
    return Guard() if guard else None
