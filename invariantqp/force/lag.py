"""How much later than told commands act, from how far the tool is behind them when an approach begins in the air.

    behind = speed late + share way          judged once, over the way in which the way commanded triples

`share` is what an arm leaves out of all commands, and no delay. What is late in the readings cannot be seen so.
"""

from __future__ import annotations

from typing import NamedTuple

from invariantqp.errors import written

# The tool follows where it has come this share of the way.
FOLLOWS = 0.5
# The least way from which on it is judged, and by how much it is behind at least, in sizes of the contact: less are
# rounding of joint positions.
LEAST_WAY = 0.01
LEAST_BEHIND = 0.006
# A delay counts where it is this multiple of what is late by what was told: from then on a force swings visibly.
LATE = 2.0


class Lag(NamedTuple):
    """What is remembered of the approach since it began.

    Attributes:
        led: way that was commanded, and the way come [length].
        came: likewise.
        since: the way commanded from which on it is judged; 0 before.
        halves: sums over both halves of that: readings, how far behind [length], ways in them [length].
        late: by how much later than told commands act [s]; None before that is known.
    """

    led: float = 0.0
    came: float = 0.0
    since: float = 0.0
    halves: tuple[tuple[int, float, float], tuple[int, float, float]] = ((0, 0.0, 0.0), (0, 0.0, 0.0))
    late: float | None = None

    def after(self, told: float, came: float, size: float, dt: float) -> Lag:
        """What is remembered after a tick in the air.

        Args:
            told: way commanded, of commands that can have acted by what was told [length].
            came: way come since the last tick [length].
            size: of the contact [length].
            dt: tick [s].
        """
        if self.late is not None:
            return self
        now = self._replace(led=self.led + told, came=self.came + came)
        if not self.since:
            begins = now.led > LEAST_WAY * size and now.came > FOLLOWS * now.led
            return now._replace(since=now.led) if begins else now
        if now.led > 3.0 * self.since:
            return now._replace(late=self._judged(size, dt))
        first, second = self.halves
        n, behind, way = second if now.led > 2.0 * self.since else first
        half = (n + 1, behind + now.led - now.came, way + told)
        return now._replace(halves=(first, half) if now.led > 2.0 * self.since else (half, second))

    def _judged(self, size: float, dt: float) -> float:
        """The delay: what the tool would be behind by where nothing had been commanded yet, at the speed it had."""
        (n, early, way), (m, later, more) = self.halves
        if not n or not m:
            return 0.0
        behind = 2.5 * early / n - 1.5 * later / m  # means at 1.5 and 2.5 of the way, drawn out to 0
        return behind * (n + m) * dt / (way + more) if behind > LEAST_BEHIND * size else 0.0

    def beyond(self, late: float) -> float:
        """The delay beside the sum `late` of tick, delay and low-pass that was told [s]; 0 where it does not count."""
        return self.late if self.late is not None and self.late > LATE * late else 0.0

    def trouble(self, late: float) -> str:
        """What is wrong, in words, "" for nothing."""
        more = self.beyond(late)
        return f"commands act {written(1e3 * more, 3)} ms later than told: tell delay=" if more else ""
