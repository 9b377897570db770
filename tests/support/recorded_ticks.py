"""The file of recorded ticks: how they are stored, and `read`, which returns them exactly as they were recorded.

Each field of a tick is one array in the file, the numbers of all ticks one after another; `shapes` has their sizes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields as fields_of
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import invariantqp as iq
from invariantqp.errors import BadInput, NoPseudoinverse
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.backends import SolverFailure
from invariantqp.velocity.definition import Answer, Rows, Tick, velocity
from invariantqp.velocity.forms import Complement, Form, PitchForm

FILE = Path(__file__).parents[1] / "velocity" / "ticks.npz"
FAILED, NO_PSEUDOINVERSE = "failed", "no pseudoinverse"
ROUNDING = 4.0 * np.finfo(float).eps
PERTURBED = 4  # times that a tick is solved again, to see how much its answer depends on rounding
# The fields of a tick by name; those with a shape of their own are stored and given in parts.
PARTS = {"rows", "exact", "twist_rows", "form", "guard"}
SCALARS = ("hold_time", "last_residual", "damping", "exact_rank")
ARRAYS = tuple(field.name for field in fields_of(Tick) if field.name not in {*PARTS, *SCALARS})


class UserForm:
    """A definite form that is known by its matrix Q (6, 6) on twists."""

    def __init__(self, Q: Array) -> None:
        self.Q = Q

    def matrix(self, inverse_root: Array) -> Array:
        """(6, 6) the form on measured twists."""
        return inverse_root.T @ self.Q @ inverse_root

    def describe(self) -> str:
        """One phrase for reports."""
        return "user form"


class Recorded(NamedTuple):
    """A tick and what the definition answered."""

    kind: str
    tick: Tick
    answer: Answer | str  # FAILED or NO_PSEUDOINVERSE where there is none
    sensitivity: float  # how far answers are `apart` whose data differ by rounding; inf where some of them fail


def solve(tick: Tick) -> Answer | str:
    """What the definition answers."""
    try:
        with np.errstate(all="ignore"):
            return velocity(tick)
    except (NoPseudoinverse, BadInput):  # BadInput: a complement whose dimension does not fit the joints
        return NO_PSEUDOINVERSE
    except (SolverFailure, np.linalg.LinAlgError):
        return FAILED


def engine_fields(tick: Tick) -> dict[str, Any]:
    """The tick as the engine takes it."""
    given = {name: getattr(tick, name) for name in (*ARRAYS, *SCALARS, "guard")}
    if tick.exact is None:
        del given["exact_rank"]
    if tick.rows is not None:
        given["rows"] = tick.rows.C, tick.rows.lower, tick.rows.upper
        if tick.rows.P is not None and tick.rows.speed < np.inf:
            given["tool_speed"] = tick.rows.P, tick.rows.speed
    if tick.exact is not None:
        given["exact"] = tuple(tick.exact)
    if isinstance(tick.form, PitchForm):
        given["form"] = "pitch", tick.form.h
    elif isinstance(tick.form, Complement):
        given["form"] = "complement", tick.form.Z
    elif tick.form is not None:
        given["form"] = "definite", tick.form.matrix(np.eye(6))
    return {name: value for name, value in given.items() if value is not None}


def scale(tick: Tick, x: Array) -> float:
    """The speed beside which velocities are compared: the larger of |x| and the smallest speed limit, at least 1e-6."""
    limits = np.abs(np.concatenate((tick.lower, tick.upper)))
    some = limits[(limits > 0.0) & np.isfinite(limits)]
    return max(float(np.linalg.norm(x)), float(some.min()) if len(some) else 0.0, 1e-6)


def perturbed(tick: Tick, rng: np.random.Generator) -> Tick:
    """The tick with joint twists, demands and exact rows changed by a few roundings."""

    def rounded(a: Array) -> Array:
        return a * (1.0 + ROUNDING * rng.choice((-1.0, 1.0), np.shape(a)))

    exact = None if tick.exact is None else tuple(rounded(np.asarray(part)) for part in tick.exact)
    changed = {name: rounded(getattr(tick, name)) for name in ("J", "feedforward", "error")}
    return replace(tick, **changed, exact=exact)


def apart(tick: Tick, one: Answer | str, other: Answer | str) -> float:
    """How far the velocities of two answers are apart, relative to `scale`; inf where only one of them is an answer."""
    if isinstance(one, str) or isinstance(other, str):
        return 0.0 if one == other else np.inf
    return float(np.linalg.norm(one.velocity - other.velocity)) / scale(tick, one.velocity)


def record(kind: str, tick: Tick) -> Recorded:
    """The tick with its answer."""
    answer, rng = solve(tick), np.random.default_rng(0)
    others = [solve(perturbed(tick, rng)) for _ in range(PERTURBED)]
    return Recorded(kind, tick, answer, max(apart(tick, answer, other) for other in others))


def write(path: Path, ticks: Iterable[Recorded]) -> None:
    """Write ticks into a compressed file."""
    words: dict[str, int] = {}
    packed = [_packed(recorded, words) for recorded in ticks]
    names = list(packed[0])
    shapes = np.full((len(packed), len(names), 2), -1, dtype=np.int16)
    for i, fields in enumerate(packed):
        for j, name in enumerate(names):
            shape = () if fields[name] is None else fields[name].shape
            shapes[i, j, : len(shape)] = shape
    flat = {
        name: np.concatenate([np.zeros(0), *(fields[name].ravel() for fields in packed if fields[name] is not None)])
        for name in names
    }
    np.savez_compressed(path, shapes=shapes, fields=np.array(names), words=np.array(list(words)), **flat)


def read(path: Path = FILE) -> Iterator[Recorded]:
    """All ticks of a file, in the order in which they were recorded."""
    with np.load(path, allow_pickle=False) as file:
        stored = dict(file)
    names, words = stored["fields"].tolist(), stored["words"].tolist()
    at = dict.fromkeys(names, 0)
    for shapes in stored["shapes"].tolist():
        fields: dict[str, Array | None] = {}
        for name, (rows, columns) in zip(names, shapes, strict=True):
            if rows < 0:
                fields[name] = None
                continue
            size = rows if columns < 0 else rows * columns
            numbers = stored[name][at[name] : at[name] + size].copy()
            at[name] += size
            fields[name] = numbers if columns < 0 else numbers.reshape(rows, columns)
        yield _unpacked(fields, words)


def _packed(recorded: Recorded, words: dict[str, int]) -> dict[str, Array | None]:
    """The arrays of a tick and its answer; names are numbers of `words`, which grows."""
    kind, tick, answer, sensitivity = recorded

    def coded(texts: Iterable[str]) -> Array:
        return np.array([words.setdefault(text, len(words)) for text in texts], dtype=float)

    fields: dict[str, Array | None] = {name: getattr(tick, name) for name in ARRAYS}
    fields |= dict.fromkeys(("C", "C_lower", "C_upper", "C_names", "P", "speed", "E", "E_feedforward", "E_error"))
    fields |= dict.fromkeys(("velocity", "result", "relaxed", "relaxed_names", "failure"))
    fields |= dict.fromkeys(("pitch", "Z", "Q", "guard"))
    fields["kind"] = coded([kind])
    fields["scalars"] = np.array([*(getattr(tick, name) for name in SCALARS), sensitivity])
    if tick.rows is not None:
        rows = tick.rows
        fields |= {"C": rows.C, "C_lower": rows.lower, "C_upper": rows.upper, "C_names": coded(rows.names)}
        fields |= {"P": rows.P, "speed": np.array([rows.speed])}
    if tick.exact is not None:
        fields |= dict(zip(("E", "E_feedforward", "E_error"), map(np.asarray, tick.exact), strict=True))
    if isinstance(tick.form, PitchForm):
        fields["pitch"] = np.array([tick.form.h])
    elif isinstance(tick.form, Complement):
        fields["Z"] = np.asarray(tick.form.Z)
    elif tick.form is not None:
        fields["Q"] = tick.form.matrix(np.eye(6))
    if tick.guard is not None:
        fields["guard"] = np.array([tick.guard])
    if isinstance(answer, str):
        fields["failure"] = coded([answer])
        return fields
    fields["velocity"] = answer.velocity
    fields["result"] = np.array([answer.approach_scale, answer.scale, answer.residual, answer.form_share])
    fields["relaxed"] = np.array([amount for _, amount in answer.relaxed])
    fields["relaxed_names"] = coded(name for name, _ in answer.relaxed)
    return fields


def _unpacked(fields: dict[str, Any], words: list[str]) -> Recorded:
    """A tick and its answer of their arrays."""

    def decoded(name: str) -> tuple[str, ...]:
        return tuple(words[int(code)] for code in fields[name])

    rows = exact = None
    if fields["C"] is not None:
        numbers = (fields[name] for name in ("C", "C_lower", "C_upper"))
        rows = Rows(*numbers, decoded("C_names"), fields["P"], float(fields["speed"][0]))
    if fields["E"] is not None:
        exact = fields["E"], fields["E_feedforward"], fields["E_error"]
    form: Form | None = None
    if fields["pitch"] is not None:
        form = iq.PitchForm(float(fields["pitch"][0]))
    elif fields["Z"] is not None:
        form = iq.Complement(fields["Z"])
    elif fields["Q"] is not None:
        form = UserForm(fields["Q"])
    *scalars, sensitivity = fields["scalars"].tolist()
    given = {name: fields[name] for name in ARRAYS} | dict(zip(SCALARS, scalars, strict=True))
    given["exact_rank"] = int(given["exact_rank"])
    guard = None if fields["guard"] is None else float(fields["guard"][0])
    tick = Tick(**given, rows=rows, exact=exact, form=form, guard=guard)
    if fields["failure"] is not None:
        return Recorded(*decoded("kind"), tick, *decoded("failure"), sensitivity)
    approach_scale, scale, residual, form_share = fields["result"].tolist()
    relaxed = tuple(zip(decoded("relaxed_names"), fields["relaxed"].tolist(), strict=True))
    answer = Answer(fields["velocity"], approach_scale, scale, residual, relaxed, form_share)
    return Recorded(*decoded("kind"), tick, answer, sensitivity)
