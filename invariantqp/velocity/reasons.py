"""Why a tick is as it is: reasons as data, and the one place where they become sentences.

A reason is a code, joints by index and name, limits by name and numbers. Loops and tests compare and count these; the
sentence is made where somebody reads it. Codes stand in the order of their gravity: a solution names the worst first.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from enum import Enum, IntEnum, auto
from typing import Any, NamedTuple, TypeAlias

from invariantqp.geometry.fields import same

# Limits named one by one in a sentence; a crowd of them is counted.
MOST_NAMED = 3
TOOL_SPEED = "the tool's speed"


class Code(IntEnum):
    """What a reason says; `SENTENCES` has the words."""

    # The velocity of the tick is no answer: "held".
    NOT_BELIEVED = auto()
    TOLD = auto()
    STOPPED = auto()
    ROWS_REFUSED = auto()
    ROWS_ARE_NAN = auto()
    ROWS_ALLOW_NOTHING = auto()
    NO_VELOCITY = auto()
    NO_NUMBERS = auto()
    MOVING_BACK = auto()
    # Something declared does not hold: "degraded".
    NO_MOTION = auto()
    STATES_ARE_OLD = auto()
    DT_IS_WRONG = auto()
    NOT_FOLLOWING = auto()
    OUTSIDE = auto()
    ACCELERATION = auto()
    ROWS_CONTRADICT = auto()
    TOOL_FASTER = auto()
    ROWS_UNKEPT = auto()
    # What limits and singularities keep away.
    STUCK = auto()
    ROWS_SLOWED = auto()
    ROWS_MOVED = auto()
    CHASE_SLOWED = auto()
    GUARDED = auto()
    FEW_JOINTS = auto()
    POSITION_ALONE = auto()
    MISSED = auto()
    MOVED = auto()
    AT_LIMITS = auto()


# {0}, {1} are the numbers of a reason, {joint} and {bounds} its first joints, {limits} all of them and rows, {each} its
# rows, each with its number, {words} what is not ours to word; {because} words, or none.
SENTENCES = {
    Code.NOT_BELIEVED: "{joint}: {0:.4g} rad is {1:.4g} outside its position range; are these degrees? "
    'Give far_outside="return" to move back from there',
    Code.TOLD: "{words}",
    Code.STOPPED: "speed is 0",
    Code.ROWS_REFUSED: "{limits}: {words}",
    Code.ROWS_ARE_NAN: "{limits} gives NaN here",
    Code.ROWS_ALLOW_NOTHING: "{limits} allows no velocity at all here",
    Code.NO_VELOCITY: "no velocity found{because}",
    Code.NO_NUMBERS: "the numbers are too large or too small to compute with{because}",
    Code.MOVING_BACK: "moving back inside the limits",
    Code.NO_MOTION: "no motion measured of {joint} although it is commanded: the robot is stopped, paused or blocked, "
    "or its joint states are old; the motion starts from rest when the robot moves again",
    Code.STATES_ARE_OLD: "the measured joint positions change once in {0:.0f} ticks ({1:.3g} ms; dt is {2:.3g} ms), "
    "too rarely for this gain: read them more often, or run the loop with dt= their period",
    Code.DT_IS_WRONG: "the joints moved {0:.3g} times as far as commanded, as in ticks of {1:.3g} ms; dt is {2:.3g} "
    "ms: check that dt= is the period of the loop, and that the driver does not scale velocities",
    Code.NOT_FOLLOWING: "not converging: the joints do not follow their commands, {joint} least; "
    "the cause may be a delay (give it as "
    "delay=), a gain too high for the robot, or a robot that does not do what it is told",
    Code.OUTSIDE: "{joint}: {0:.3g} outside its position range",
    Code.ACCELERATION: "{joint}: acceleration {0:.3g}, above its limit {1:.3g}",
    Code.ROWS_CONTRADICT: "rows contradict {bounds}: exceeded at {each}",
    Code.TOOL_FASTER: "the tool's speed is {0:.3g}, not {1:.3g}: other limits require it",
    Code.ROWS_UNKEPT: "the joints cannot keep the direction of the exact rows: {0:.1e} of the demand is unmet",
    Code.STUCK: "no velocity reduces the error: it is the least that these joints and limits allow",
    Code.ROWS_SLOWED: "limits allow {0:.3g} of the exact rows' speed",
    Code.ROWS_MOVED: "limits require motion beside the exact rows: {each}",
    Code.CHASE_SLOWED: "limits allow {0:.3g} of the approach's speed",
    Code.GUARDED: "descent guard: {0:.3g} of least squares blended in",
    Code.FEW_JOINTS: "fewer than six joints ({0:.0f}) can achieve {1:.0%} of this twist",
    Code.POSITION_ALONE: 'exact="position" (in solve_velocity, ExactRows) keeps the velocity of the tool point',
    Code.MISSED: "{0:.0%} of the twist is missed",
    Code.MOVED: "limits move the tool where nothing is to move",
    Code.AT_LIMITS: "at the limits of {limits}",
}


class Reason(NamedTuple):
    """One reason of a tick; `str` gives its sentence.

    Attributes:
        code: what it says.
        joints: indices of joints.
        rows: names of limits that are no joint's: the names that `LimitRows` give, "row 3" for one without,
            "the tool's speed", "exact row 0".
        numbers: as the sentence has them; of `rows` and numbers that belong together, the worst comes first.
        words: a solver's own words, a text.
        names: what the joints are called; () where nobody said.
    """

    code: Code
    joints: tuple[int, ...] = ()
    rows: tuple[str, ...] = ()
    numbers: tuple[float, ...] = ()
    words: str = ""
    names: tuple[str, ...] = ()

    def __str__(self) -> str:
        joints, more = named(self.joints[:MOST_NAMED], names=self.names), len(self.joints) - MOST_NAMED
        if more > 0:
            joints += f" and {more} more"
        return SENTENCES[self.code].format(
            *self.numbers,
            joint=joints,
            limits=named(self.joints, self.rows, self.names),
            bounds=f"the bounds of {joints}" if joints else "each other",
            each=_each(self),
            words=self.words,
            because=f": {self.words}" if self.words else "",
        )


def told(words: str) -> tuple[Reason, ...]:
    """A text as reasons, () for none."""
    return (Reason(Code.TOLD, words=words),) if words else ()


def sentences(reasons: Iterable[Reason]) -> str:
    """Reasons in words, "" for none."""
    return "; ".join(filter(None, map(str, reasons)))


def named(joints: Sequence[int], rows: Sequence[str] = (), names: Sequence[str] = ()) -> str:
    """Limits in words: "joints 0 (base), 2 (elbow) and the cable"; of many rows, the first few and how many more.

    Rows of one name are one limit. `names` are those of the joints, if they have any.
    """
    rows = list(dict.fromkeys(rows))
    called = [f"{i} ({name})" for i, name in zip(joints, names, strict=False)] or map(str, joints)
    words = [f"joint{'s' if len(joints) > 1 else ''} {', '.join(called)}"] if joints else []
    shown = list(rows[:MOST_NAMED])
    numbers = [name.removeprefix("row ") for name in shown if name.startswith("row ")]
    if len(numbers) > 1:
        shown = [f"rows {', '.join(numbers)}", *(name for name in shown if not name.startswith("row "))]
    words += shown
    if len(rows) > MOST_NAMED:
        words.append(f"{len(rows) - MOST_NAMED} more")
    return " and ".join(words)


def _each(reason: Reason) -> str:
    """Rows, each with its number."""
    verb = " is off" if reason.code is Code.ROWS_MOVED else ""
    pairs = list(zip(reason.rows, reason.numbers, strict=False))
    words = [f"{name}{verb} by {abs(number):.3g}" for name, number in pairs[:MOST_NAMED]]
    if len(pairs) > MOST_NAMED:
        words.append(f"{len(pairs) - MOST_NAMED} more")
    return ", ".join(words)


# Reasons as the engine writes them, in doubles: of each its code, how many joints, rows and numbers, and these.
Written: TypeAlias = bytes
# What a solution is made with: reasons, a text of a law that has none, what the engine wrote, or several of these.
Why: TypeAlias = "tuple[Reason | str | Written, ...] | str | Written"
# In place of the index of a row.
TOOL_SPEED_ROW, FIRST_EXACT_ROW = -1, -2


def row_name(i: int, names: Sequence[str] = ()) -> str:
    """What row i is called: by its name, or by its number; -1 is the tool's speed, -2 - i is exact row i."""
    if i == TOOL_SPEED_ROW:
        return TOOL_SPEED
    if i < 0:
        return f"exact row {FIRST_EXACT_ROW - i}"
    return (names[i] if i < len(names) else "") or f"row {i}"


def read(written: Written, names: Sequence[str] = ()) -> tuple[Reason, ...]:
    """The reasons that the engine wrote; `names` (k,) are those of the rows."""
    numbers = array("d", written).tolist()
    found, at = [], 0
    while at < len(numbers):
        code, joints, rows, count = map(int, numbers[at : at + 4])
        at += 4
        parts = []
        for size in (joints, rows, count):
            parts.append(numbers[at : at + size])
            at += size
        called = tuple(row_name(int(i), names) for i in parts[1])
        found.append(Reason(Code(code), tuple(map(int, parts[0])), called, tuple(parts[2])))
    return tuple(found)


def parts(why: Why) -> tuple[Reason | str | Written, ...]:
    """The parts of what a solution is made with."""
    return why if isinstance(why, tuple) else (why,)


class Explained:
    """Base of a named tuple with fields `reasons`, `row_names` and `joint_names`, which are made when they are read.

    Equal and printed as what they say, whatever they are made from.
    """

    __slots__ = ()

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """Why, as data, the worst first."""
        found: list[Reason] = []
        for part in parts(self._given("reasons")):
            if isinstance(part, Reason):
                found.append(part)
            else:
                found += told(part) if isinstance(part, str) else read(part, self.row_names)
        names = self._given("joint_names")
        return tuple(one._replace(names=tuple(names[i] for i in one.joints)) if names else one for one in found)

    @property
    def reason(self) -> str:
        """Why, in words, "" where there is nothing to report."""
        return sentences(self.reasons) if self._given("reasons") else ""

    @property
    def row_names(self) -> tuple[str, ...]:
        """What rows of limits are called."""
        return tuple(self._given("row_names"))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Explained) and type(other) is type(self) and same(self._plain(), other._plain())

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        items: tuple[Any, ...] = tuple(self)  # type: ignore[arg-type]
        return hash((tuple(items[0].tolist()), *(item for item in items if isinstance(item, Enum))))

    def __repr__(self) -> str:
        names = type(self)._fields  # type: ignore[attr-defined]
        shown = (f"{name}={value!r}" for name, value in zip(names, self._plain(), strict=True))
        return f"{type(self).__name__}({', '.join(shown)})"

    def _given(self, field: str) -> Any:
        """What a field was made with."""
        return self[type(self)._fields.index(field)]  # type: ignore[index,attr-defined]

    def _plain(self) -> tuple[Any, ...]:
        """The fields, as they are read."""
        return tuple(getattr(self, name) for name in type(self)._fields)  # type: ignore[attr-defined]
