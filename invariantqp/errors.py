"""Every error this library raises: what was found, what was expected, what to do next.

`InvariantQPError` is the base. Each subclass keeps its evidence as attributes and builds its own message, so a
handler can read numbers instead of parsing text. Errors can be pickled and copied, message and attributes with them, so
they cross from a worker process to the one that waits for it.
"""

from __future__ import annotations

import re
import reprlib
from importlib import metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


__all__ = [
    "BadInput",
    "BlindSystem",
    "InvariantQPError",
    "MissingExtra",
    "NoContactFound",
    "NoPolarDecomposition",
    "NoProjectors",
    "NoPseudoinverse",
    "RobotModelError",
    "TaskFileError",
    "UnknownName",
]

# No argument takes more of a message than this: a line.
LONGEST_EXCERPT = 80
_SHORT = reprlib.Repr()
_SHORT.maxother = _SHORT.maxstring = LONGEST_EXCERPT

# Numbers below this are written as 0 in sentences: in unit vectors, and in lengths in any unit of a machine,
# they are rounding.
WRITTEN_ZERO = 1e-9


def written(x: float, digits: int = 4) -> str:
    """A number for a sentence, without the noise of rounding."""
    return f"{0.0 if abs(x) < WRITTEN_ZERO else x:.{digits}g}"


def listed(numbers: Iterable[float], digits: int = 4) -> str:
    """Numbers for a sentence."""
    return ", ".join(written(x, digits) for x in numbers)


def excerpt(value: object) -> str:
    """An argument for a message: its repr on one short line."""
    try:
        text = " ".join(_SHORT.repr(value).split())
    except Exception:  # noqa: BLE001 (an int of 5 000 digits has no repr, nor have objects whose own fails)
        return f"an object of type {type(value).__name__}"
    return text if len(text) <= LONGEST_EXCERPT else f"{text[:LONGEST_EXCERPT]}..."


class InvariantQPError(Exception):
    """Base of every error raised by invariantqp."""

    def __reduce__(self) -> tuple[Any, ...]:
        """How to make the error again: from its message and attributes, since its arguments are not kept."""
        return _restore, (type(self), self.args, vars(self))


def _restore(kind: type[InvariantQPError], args: tuple[Any, ...], attributes: dict[str, Any]) -> InvariantQPError:
    """An error as it was, without calling its own `__init__`."""
    error = kind.__new__(kind)
    super(InvariantQPError, error).__init__(*args)  # ValueError's, KeyError's or ImportError's: they keep the message
    vars(error).update(attributes)
    return error


class BadInput(InvariantQPError, ValueError):
    """An argument is not what its function takes: another kind or shape, NaN, or out of range.

    Docstrings say what is taken; they name this error where that is not all.

    Attributes:
        argument: the name of the offending argument.
        found: what was given, in words.
        expected: what would have been accepted.
        remedy: what to do next.
    """

    def __init__(self, argument: str, found: str, expected: str, remedy: str = "") -> None:
        self.argument = argument
        self.found = found
        self.expected = expected
        self.remedy = remedy
        advice = f" {remedy}" if remedy else ""
        super().__init__(f"{argument}: found {found}; expected {expected}.{advice}")


class NoPseudoinverse(InvariantQPError):
    """No h-pseudoinverse: the Gram matrix, J'Q_h J or W'Q_h^-1 W, has lost rank ([DS] Theorems 2.2 and 3.1).

    Attributes:
        h: the pitch given [length].
        rank: rank of J, or of the wrenches W.
        gram_rank: rank of the Gram matrix, as far as rounding leaves it; equal to `rank` where the columns are
            so nearly dependent that rounding decides, whatever h is.
        self_reciprocal: (6,) unit screw z of the system that the form pairs to zero with all of it, the proof; a twist
            in the span of J, or Q_0 w for a wrench w in the span of W. Where gram_rank = rank, the screw that the
            columns hardly reach.
        principal_pitches: (k',) every pitch at which the pseudoinverse fails, nearest to h first; empty when it
            fails at all of them.
    """

    def __init__(self, h: float, rank: int, gram_rank: int, self_reciprocal: Array, principal_pitches: Array) -> None:
        self.h = h
        self.rank = rank
        self.gram_rank = gram_rank
        self.self_reciprocal = self_reciprocal
        self.principal_pitches = principal_pitches
        super().__init__(self._message(listed(self_reciprocal)))

    def _message(self, z: str) -> str:
        """What to say, of the screw in words."""
        remedy = self._elsewhere or (
            "No h works for this system: use Complement(Z) to say what may be given up, or CarriedMetric(matrix, pose)"
        )
        if self.gram_rank == self.rank:
            return (
                f"no {self.h:g}-pseudoinverse: the columns are so nearly dependent that rounding decides what they do "
                f"along the screw ({z}). Leave out a column, or use damping."
            )
        return (
            f"no {self.h:g}-pseudoinverse: the Gram matrix has rank {self.gram_rank}, the system rank {self.rank}; "
            f"its screw z = ({z}) is paired to zero with all of it. {remedy}."
        )

    @property
    def _elsewhere(self) -> str:
        """What to do where some h works; "" where none does."""
        pitches = listed(self.principal_pitches, 6)
        return f"Choose h away from the principal pitches ({pitches})" if pitches else ""


class NoPolarDecomposition(NoPseudoinverse):
    """No hyperbolic polar decomposition J = W S: S would lose a joint velocity that moves the tool.

    Attributes:
        h, rank, gram_rank, self_reciprocal, principal_pitches: as in `NoPseudoinverse`.
    """

    def _message(self, z: str) -> str:
        if self.gram_rank == self.rank:
            why = f"the gain of the screw z = ({z}) is so small beside the largest that it is rounding."
            remedy = "The joints are nearly dependent: leave one out."
        else:
            why = f"the joints move the tool by the screw z = ({z}), whose gain is zero."
            remedy = f"{self._elsewhere or 'No h works for this system'}."
        return f"no polar decomposition for h = {self.h:g}: {why} {remedy}"


class NoProjectors(NoPseudoinverse):
    """S meets its h-reciprocal, so no projectors split twists along the two ([DS] Sect. 6.1, Theorem 3.1).

    Attributes:
        system: the Gibson-Hunt type of S, in words.
        h, rank, gram_rank, self_reciprocal, principal_pitches: as in `NoPseudoinverse`.
    """

    def __init__(
        self, h: float, system: str, ranks: tuple[int, int], self_reciprocal: Array, pitches: Array, choices: str
    ) -> None:
        self.system, self._choices = system, choices
        super().__init__(h, *ranks, self_reciprocal, pitches)

    def _message(self, z: str) -> str:
        away = f"{self._elsewhere}, or give" if self._elsewhere else "No h works for this type: give"
        shared = f"S, {self.system}, shares the twist z = ({z}) with its h-reciprocal"
        return f"no projectors for h = {self.h:g}: {shared}. {away} {self._choices}."


class BlindSystem(InvariantQPError):
    """No pitch form sees every direction of the system: det(J'Q_h J) vanishes for every h.

    Attributes:
        directions: (6, b) the pure translations in the system that no Q_h sees, as unit columns.
    """

    def __init__(self, directions: Array) -> None:
        self.directions = directions
        along = "; ".join(f"({listed(v[3:])})" for v in directions.T)
        super().__init__(
            f"every pitch form is blind to the translation(s) along {along}: this system has no h-pseudoinverse "
            "for any h. Use Complement(Z) to say what may be given up, or CarriedMetric(matrix, pose)."
        )


class NoContactFound(InvariantQPError):
    """No kind of contact explains a recording, or nothing is touched, or more than one kind explains it.

    Attributes:
        nearest: the kind that is off least; "" where nothing is touched or several kinds are left.
        misfit: by how many times the noise it is off.
    """

    def __init__(self, what: str, nearest: str = "", misfit: float = 0.0) -> None:
        self.nearest = nearest
        self.misfit = misfit
        super().__init__(what)


class RobotModelError(InvariantQPError):
    """A robot could not be loaded, or its tool or joints are not as required."""


class UnknownName(RobotModelError, KeyError):
    """A name (robot, frame, joint, task, back end) is not known; the near ones are listed.

    Attributes:
        kind: what was looked up.
        name: the name given.
        near: known names like it.
    """

    def __init__(self, kind: str, name: str, near: Sequence[str], known: Sequence[str]) -> None:
        self.kind = kind
        self.name = name
        self.near: tuple[str, ...] = tuple(near)
        comma = "; " if any("," in name for name in (*near, *known)) else ", "
        listed = f"did you mean {comma.join(near)}?" if near else f"known: {comma.join(known)}."
        super().__init__(f"unknown {kind} {excerpt(name)}; {listed}")

    def __str__(self) -> str:
        return Exception.__str__(self)  # KeyError would show the repr


class TaskFileError(InvariantQPError):
    """A task file does not decode; every problem is listed with its path.

    Attributes:
        source: the file.
        problems: one line a problem, "$.path: what is wrong (what would be right)".
    """

    def __init__(self, source: str, problems: Sequence[str]) -> None:
        self.source = source
        self.problems: tuple[str, ...] = tuple(problems)
        lines = "\n".join(f"  {p}" for p in problems)
        super().__init__(f"{source}: {len(problems)} problem{'s' if len(problems) != 1 else ''}\n{lines}")


class MissingExtra(InvariantQPError, ImportError):
    """An optional dependency is not installed; says how to install it.

    Attributes:
        what: the package that is missing.
        extra: the extra of this package that brings it.
        install: the command that installs what the extra brings.
    """

    def __init__(self, what: str, extra: str) -> None:
        self.what = what
        self.extra = extra
        self.install: str = install_command(extra)
        super().__init__(f"{what} is not installed. Run: {self.install}")


def install_command(extra: str) -> str:
    """The command that installs what an extra brings, wherever this package itself came from."""
    try:
        requirements = metadata.requires("invariantqp") or []
    except metadata.PackageNotFoundError:  # the sources alone, on the path
        requirements = []
    brought = [f"'{name}'" for name in _brought_by(extra, requirements)]
    return " ".join(["pip install", *(brought or [f"'.[{extra}]'"])])


def _brought_by(extra: str, requirements: list[str]) -> Iterator[str]:
    """What an extra requires, and what the extras require that it names."""
    for name, _, marker in (text.partition(";") for text in requirements):
        if re.search(rf"extra *== *.{extra}\b", marker):
            extras = re.fullmatch(r"invariantqp\[(.+)\]", name.strip())
            if extras is None:
                yield name.strip()
            for each in extras[1].split(",") if extras else ():
                yield from _brought_by(each, requirements)
