"""The errors of this library: what was found, what was expected, what to do.

`InvariantQPError` is the base. Each subclass has its values as attributes and builds its message of them. Errors can be
pickled and copied with message and attributes, so they cross process boundaries.
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

# Most characters of an argument in a message.
LONGEST_EXCERPT = 80
_SHORT = reprlib.Repr()
_SHORT.maxother = _SHORT.maxstring = LONGEST_EXCERPT

# Numbers below this are rounding in unit vectors and lengths, and are written as 0.
WRITTEN_ZERO = 1e-9


def written(x: float, digits: int = 4) -> str:
    """A number as text, without rounding errors."""
    return f"{0.0 if abs(x) < WRITTEN_ZERO else x:.{digits}g}"


def in_thousandths(x: float, digits: int = 4) -> str:
    """A length or a time in thousandths of its unit, mm or ms, as text."""
    return written(1e3 * x, digits)


def millimetres(length: float) -> str:
    """A length in m as text in mm, without the unit."""
    return f"{1e3 * length:.1f}"


def in_percent(share: float, digits: int = 4) -> str:
    """A share in per cent as text, without the sign."""
    return written(100.0 * share, digits)


def listed(numbers: Iterable[float], digits: int = 4) -> str:
    """Numbers as text, separated by commas."""
    return ", ".join(written(x, digits) for x in numbers)


def excerpt(value: object) -> str:
    """The repr of an argument, on one short line."""
    try:
        text = " ".join(_SHORT.repr(value).split())
    except Exception:  # noqa: BLE001 (an int of 5 000 digits has no repr, nor have objects whose own fails)
        return f"an object of type {type(value).__name__}"
    return text if len(text) <= LONGEST_EXCERPT else f"{text[:LONGEST_EXCERPT]}..."


class InvariantQPError(Exception):
    """Base of every error raised by invariantqp."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Restored from its message and attributes, since it does not keep the arguments of `__init__`."""
        return _restore, (type(self), self.args, vars(self))


def _restore(kind: type[InvariantQPError], args: tuple[Any, ...], attributes: dict[str, Any]) -> InvariantQPError:
    """An error of this message and these attributes, without calling its `__init__`."""
    error = kind.__new__(kind)
    super(InvariantQPError, error).__init__(*args)  # ValueError, KeyError and ImportError keep the message
    vars(error).update(attributes)
    return error


class BadInput(InvariantQPError, ValueError):
    """An argument has a wrong type, shape or value, or is not finite.

    Attributes:
        argument: the name of the argument.
        found: what was given, in words.
        expected: what is accepted.
        remedy: what to do; "" if that is clear.
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
        h: the given pitch [length].
        rank: rank of J, or of the wrenches W.
        gram_rank: numerical rank of the Gram matrix; equal to `rank` if the columns are dependent up to rounding.
        self_reciprocal: (6,) unit screw z of the system that is Q_h-orthogonal to all of it: a twist in the span of J,
            or Q_0 w for a wrench w in the span of W. If gram_rank = rank, the smallest singular direction.
        principal_pitches: (k',) all pitches without a pseudoinverse, nearest to h first; empty if no pitch has one.
    """

    def __init__(self, h: float, rank: int, gram_rank: int, self_reciprocal: Array, principal_pitches: Array) -> None:
        self.h = h
        self.rank = rank
        self.gram_rank = gram_rank
        self.self_reciprocal = self_reciprocal
        self.principal_pitches = principal_pitches
        super().__init__(self._message(listed(self_reciprocal)))

    def _message(self, z: str) -> str:
        """The message, for the screw z as text."""
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
        """The remedy if some h works; "" if none does."""
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
    """No dual projectors: S intersects its h-reciprocal ([DS] Sect. 6.1, Theorem 3.1).

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
    """No kind of contact explains a recording, more than one does, or there is no contact force.

    Attributes:
        nearest: the kind with the smallest misfit; "" without a contact force or with several kinds.
        misfit: its root mean square residual, in standard deviations of the noise.
    """

    def __init__(self, what: str, nearest: str = "", misfit: float = 0.0) -> None:
        self.nearest = nearest
        self.misfit = misfit
        super().__init__(what)


class RobotModelError(InvariantQPError):
    """A robot cannot be loaded, or has not the required tool or joints."""


class UnknownName(RobotModelError, KeyError):
    """An unknown name of a robot, frame, joint, task or back end.

    Attributes:
        kind: the kind of name.
        name: the given name.
        near: known names that are similar.
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
    """A task file is invalid; every problem is listed with its path.

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
    """An optional dependency is not installed.

    Attributes:
        what: the missing package.
        extra: the extra of this package that contains it.
        install: the command that installs the extra.
    """

    def __init__(self, what: str, extra: str) -> None:
        self.what = what
        self.extra = extra
        self.install: str = install_command(extra)
        super().__init__(f"{what} is not installed. Run: {self.install}")


def install_command(extra: str) -> str:
    """The command that installs the packages of an extra, without an index that has this package."""
    try:
        requirements = metadata.requires("invariantqp") or []
    except metadata.PackageNotFoundError:  # sources that were not installed
        requirements = []
    packages = [f"'{name}'" for name in _packages_of(extra, requirements)]
    return " ".join(["pip install", *(packages or [f"'.[{extra}]'"])])


def _packages_of(extra: str, requirements: list[str]) -> Iterator[str]:
    """The packages of an extra, and of the extras that it names."""
    for name, _, marker in (text.partition(";") for text in requirements):
        if re.search(rf"extra *== *.{extra}\b", marker):
            extras = re.fullmatch(r"invariantqp\[(.+)\]", name.strip())
            if extras is None:
                yield name.strip()
            for each in extras[1].split(",") if extras else ():
                yield from _packages_of(each, requirements)
