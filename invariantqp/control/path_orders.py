"""What a drive along a path is told while it runs: to pause, to go on, to turn round, and how fast."""

from __future__ import annotations

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays

# Largest speed override.
FASTEST = 1.5
# Why a tool comes to rest that was told to.
PAUSE, TURN = "a pause", "the turn"


class Pausable:
    """A drive that can pause."""

    def __init__(self) -> None:
        """Driving forward."""
        self._paused = False
        self._wants_back = False

    def pause(self) -> None:
        """Come to rest on the path, and stay."""
        self._paused = True

    def resume(self) -> None:
        """Go on after a pause."""
        self._paused = False

    def _stop(self, *, back: bool) -> str:
        """Why a tool that goes backward, or does not, is to come to rest; "" where it is not."""
        return PAUSE if self._paused else TURN if back != self._wants_back else ""


class Reversible(Pausable):
    """One that can also turn round."""

    def reverse(self) -> None:
        """Come to rest and drive the path in the other direction."""
        self._wants_back = not self._wants_back


def override_of(value: float) -> float:
    """A checked share of the speed asked for.

    Raises:
        BadInput: not a number from 0 to 1.5.
    """
    part = arrays.not_negative(value, "override", "a share of the speed, 0 to 1.5")
    if part > FASTEST:
        raise BadInput("override", f"{part:g}", f"a share of the speed, 0 to {FASTEST:g}")
    return part
