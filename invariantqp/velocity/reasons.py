"""Reasons of a solution: data (code, joints, limits, numbers), and their sentences.

Sentences are formatted when they are read. Codes are in the order of severity: a solution lists the most severe first.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from enum import Enum, IntEnum, auto
from typing import Any, NamedTuple, TypeAlias

from invariantqp.geometry.fields import same

# Limits named in a sentence; further ones are counted.
MOST_NAMED = 3
TOOL_SPEED = "the tool's speed"


class Code(IntEnum):
    """The kind of a reason; `SENTENCES` has the texts."""

    # Status "held": there is no usable velocity.
    IMPLAUSIBLE_POSITION = auto()
    TEXT = auto()
    SPEED_ZERO = auto()
    LIMIT_FAILED = auto()
    LIMIT_NAN = auto()
    LIMIT_INFEASIBLE = auto()
    NO_SOLUTION = auto()
    NUMERICAL_FAILURE = auto()
    MOVING_BACK = auto()
    # Status "degraded": an assumption or a limit is violated.
    NO_MOTION = auto()
    STALE_JOINT_STATES = auto()
    WRONG_DT = auto()
    NOT_FOLLOWING = auto()
    OUTSIDE_POSITION_LIMITS = auto()
    ACCELERATION_EXCEEDED = auto()
    LIMITS_CONFLICT = auto()
    TOOL_SPEED_EXCEEDED = auto()
    EXACT_ROWS_INCONSISTENT = auto()
    # Effects of limits and singularities.
    NO_PROGRESS = auto()
    EXACT_ROWS_SCALED = auto()
    EXACT_ROWS_VIOLATED = auto()
    APPROACH_SCALED = auto()
    GUARDED = auto()
    FEW_JOINTS = auto()
    POSITION_ONLY = auto()
    TWIST_MISSED = auto()
    MOVED_BY_LIMITS = auto()
    AT_LIMITS = auto()


# {0}, {1}: numbers; {joint}, {bounds}: the first joints; {limits}: joints and rows; {each}: rows with their numbers;
# {words}: a foreign text; {because}: the same after a colon.
SENTENCES = {
    Code.IMPLAUSIBLE_POSITION: "{joint}: {0:.4g} rad is {1:.4g} outside its position range; are these degrees? "
    'Give far_outside="return" to move back from there',
    Code.TEXT: "{words}",
    Code.SPEED_ZERO: "speed is 0",
    Code.LIMIT_FAILED: "{limits}: {words}",
    Code.LIMIT_NAN: "{limits} gives NaN here",
    Code.LIMIT_INFEASIBLE: "{limits} allows no velocity at all here",
    Code.NO_SOLUTION: "no velocity found{because}",
    Code.NUMERICAL_FAILURE: "the numbers are too large or too small to compute with{because}",
    Code.MOVING_BACK: "moving back inside the limits",
    Code.NO_MOTION: "no motion measured of {joint} although it is commanded: the robot is stopped, paused or blocked, "
    "or its joint states are old; the motion starts from rest when the robot moves again",
    Code.STALE_JOINT_STATES: "the measured joint positions change once in {0:.0f} ticks ({1:.3g} ms; dt is {2:.3g} "
    "ms), too rarely for this gain: read them more often, or run the loop with dt= their period",
    Code.WRONG_DT: "the joints moved {0:.3g} times as far as commanded, as in ticks of {1:.3g} ms; dt is {2:.3g} "
    "ms: check that dt= is the period of the loop, and that the driver does not scale velocities",
    Code.NOT_FOLLOWING: "not converging: the joints do not follow their commands, {joint} least; "
    "the cause may be a delay (give it as "
    "delay=), a gain too high for the robot, or a robot that does not execute its commands",
    Code.OUTSIDE_POSITION_LIMITS: "{joint}: {0:.3g} outside its position range",
    Code.ACCELERATION_EXCEEDED: "{joint}: acceleration {0:.3g}, above its limit {1:.3g}",
    Code.LIMITS_CONFLICT: "limit rows conflict with {bounds}: exceeded at {each}",
    Code.TOOL_SPEED_EXCEEDED: "the tool's speed is {0:.3g}, not {1:.3g}: other limits require it",
    Code.EXACT_ROWS_INCONSISTENT: "the joints cannot keep the direction of the exact rows: "
    "{0:.1e} of the demand is unmet",
    Code.NO_PROGRESS: "no velocity reduces the error: it is the least that these joints and limits allow",
    Code.EXACT_ROWS_SCALED: "limits allow {0:.3g} of the exact rows' speed",
    Code.EXACT_ROWS_VIOLATED: "limits violate the exact rows: {each}",
    Code.APPROACH_SCALED: "limits allow {0:.3g} of the approach's speed",
    Code.GUARDED: "descent guard: {0:.3g} of least squares blended in",
    Code.FEW_JOINTS: "fewer than six joints ({0:.0f}) can achieve {1:.0%} of this twist",
    Code.POSITION_ONLY: 'exact="position" (in solve_velocity, ExactRows) keeps the velocity of the tool point',
    Code.TWIST_MISSED: "{0:.0%} of the twist is missed",
    Code.MOVED_BY_LIMITS: "limits force a motion although the commanded twist is zero",
    Code.AT_LIMITS: "at the limits of {limits}",
}


class Reason(NamedTuple):
    """One reason of a tick; `str` gives its sentence.

    Attributes:
        code: its kind.
        joints: indices of joints.
        rows: names of other limits: those of `LimitRows`, "row 3" for a row without name, "the tool's speed",
            "exact row 0".
        numbers: in the order of the sentence; one for each of `rows`, the largest first.
        words: text of a solver or a user.
        names: names of the joints, () if unknown.
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


def text_reasons(words: str) -> tuple[Reason, ...]:
    """A text as reasons, () for ""."""
    return (Reason(Code.TEXT, words=words),) if words else ()


def sentences(reasons: Iterable[Reason]) -> str:
    """The sentences of reasons, joined by semicolons."""
    return "; ".join(filter(None, map(str, reasons)))


def named(joints: Sequence[int], rows: Sequence[str] = (), names: Sequence[str] = ()) -> str:
    """A list of limits: "joints 0 (base), 2 (elbow) and the cable"; rows of equal name once, and at most MOST_NAMED.

    `names` are those of the joints, () if unknown.
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
    """Each row with its number."""
    verb = " is off" if reason.code is Code.EXACT_ROWS_VIOLATED else ""
    pairs = list(zip(reason.rows, reason.numbers, strict=False))
    words = [f"{name}{verb} by {abs(number):.3g}" for name, number in pairs[:MOST_NAMED]]
    if len(pairs) > MOST_NAMED:
        words.append(f"{len(pairs) - MOST_NAMED} more")
    return ", ".join(words)


# Reasons encoded by the engine as doubles; each: code, numbers of joints, rows and values, and these.
Encoded: TypeAlias = bytes
# The reasons that a solution stores: decoded, a text, encoded, or several of these.
Stored: TypeAlias = "tuple[Reason | str | Encoded, ...] | str | Encoded"
# In place of the index of a row.
TOOL_SPEED_ROW, FIRST_EXACT_ROW = -1, -2


def row_name(i: int, names: Sequence[str] = ()) -> str:
    """The name of row i, "row 3" without one; -1 is the tool speed limit, -2 - i exact row i."""
    if i == TOOL_SPEED_ROW:
        return TOOL_SPEED
    if i < 0:
        return f"exact row {FIRST_EXACT_ROW - i}"
    return (names[i] if i < len(names) else "") or f"row {i}"


def decoded(encoded: Encoded, names: Sequence[str] = ()) -> tuple[Reason, ...]:
    """The reasons that the engine encoded; `names` (k,) are those of the rows."""
    numbers = array("d", encoded).tolist()
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


def parts(stored: Stored) -> tuple[Reason | str | Encoded, ...]:
    """Stored reasons as a tuple."""
    return stored if isinstance(stored, tuple) else (stored,)


class WithReasons:
    """Base of a named tuple whose fields `reasons` and `row_names` are decoded when they are read.

    Equality and `repr` are those of the decoded fields.
    """

    __slots__ = ()

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """The reasons, the most severe first."""
        found: list[Reason] = []
        for part in parts(self._stored("reasons")):
            if isinstance(part, Reason):
                found.append(part)
            else:
                found += text_reasons(part) if isinstance(part, str) else decoded(part, self.row_names)
        names = self._stored("joint_names")
        return tuple(one._replace(names=tuple(names[i] for i in one.joints)) if names else one for one in found)

    @property
    def reason(self) -> str:
        """The reasons in words, "" for none."""
        return sentences(self.reasons) if self._stored("reasons") else ""

    @property
    def row_names(self) -> tuple[str, ...]:
        """The names of the limit rows."""
        return tuple(self._stored("row_names"))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, WithReasons) and type(other) is type(self) and same(self._decoded(), other._decoded())

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        items: tuple[Any, ...] = tuple(self)  # type: ignore[arg-type]
        return hash((tuple(items[0].tolist()), *(item for item in items if isinstance(item, Enum))))

    def __repr__(self) -> str:
        names = type(self)._fields  # type: ignore[attr-defined]
        shown = (f"{name}={value!r}" for name, value in zip(names, self._decoded(), strict=True))
        return f"{type(self).__name__}({', '.join(shown)})"

    def _stored(self, field: str) -> Any:
        """A field as it is stored."""
        return self[type(self)._fields.index(field)]  # type: ignore[index,attr-defined]

    def _decoded(self) -> tuple[Any, ...]:
        """The fields as they are read."""
        return tuple(getattr(self, name) for name in type(self)._fields)  # type: ignore[attr-defined]
