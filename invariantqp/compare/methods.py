"""The methods compared, one type for all: a solver (J, s, lower, upper) -> x, or a whole system with a loop of its own.

Each says which frame its J is in, which exact problem its answer is held against, and how it treats limits: a method
that is told about them stays inside, every other is clipped joint by joint.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Literal

import numpy as np

from invariantqp.errors import BadInput, UnknownName
from invariantqp.geometry.arrays import Array
from invariantqp.runs.controllers import MakeController

# (J (6, m), s (6,), lower (m,), upper (m,)) to a joint velocity (m,), all in the frame that the method names.
Solve = Callable[[Array, Array, Array, Array], Array]

Family = Literal["invariant", "Moore-Penrose", "damped", "QP", "system"]
FAMILIES: tuple[Family, ...] = ("invariant", "Moore-Penrose", "damped", "QP", "system")

# The exact problems of `compare.exact.references`; "" where a rule solves none that is worth a name.
Problem = Literal[
    "",
    "pitch",
    "filter",
    "adaptive",
    "adaptive box",
    "inertia",
    "inertia box",
    "least squares",
    "ridge",
    "least squares box",
    "weighted",
    "damped",
    "damped box",
]

# A tool of one kilogram that turns like a ball of 5 cm about the origin of its frame [kg m^2; kg].
TOOL_INERTIA = np.repeat((0.0025, 1.0), 3)


@dataclass(frozen=True, eq=False)
class Setting:
    """What a method may know of an arm and its loop before the first tick.

    Attributes:
        m: number of joints.
        dt: tick [s].
        pitch: h for the pitch forms [length/rad].
        inertia: (6,) diagonal of the tool's inertia in its own frame.
        body: (4, 4) pose of that frame in the frame of J.
        unit: how many of the units of length that J is in make a metre.
    """

    m: int
    dt: float = 0.001
    pitch: float = 0.3
    inertia: Array = field(default_factory=TOOL_INERTIA.copy)
    body: Array = field(default_factory=lambda: np.eye(4))
    unit: float = 1.0


@dataclass(frozen=True, eq=False)
class Method:
    """One way from a twist to joint velocities.

    Attributes:
        name: how tables and charts call it.
        family: whose kind it is.
        limits: "inside" where the method is told about limits, "clipped" where its answer is cut to them.
        why: what it is and where it comes from, in one line.
        make: a solver with a workspace of its own; None for a system that is no function of J and s.
        frame: the frame of J, s in which it is meant; an invariant method does not care.
        problem: the exact problem its answer solves where no limit is met.
        limited: the exact problem that it, or what its clipping stands for, solves where limits are met.
        system: a whole loop (robot, law) -> controller; None to have one made of `make` by `baselines.controller_of`.
        needs: modules that have to be installed.
        group: methods that differ by a setting alone share a group; charts may draw one line through it.
    """

    name: str
    family: Family
    limits: Literal["inside", "clipped"]
    why: str
    make: Callable[[Setting], Solve] | None = None
    frame: Literal["base", "tool"] = "tool"
    problem: Problem = ""
    limited: Problem = ""
    system: MakeController | None = None
    needs: tuple[str, ...] = ()
    group: str = ""

    @property
    def installed(self) -> bool:
        """Whether this machine has what it needs."""
        return all(find_spec(module) is not None for module in self.needs)

    def as_json(self) -> dict[str, str]:
        """What results.json says of it."""
        keys = ("name", "family", "limits", "why", "frame", "problem", "limited", "group")
        return {key: getattr(self, key) for key in keys}


def methods() -> dict[str, Method]:
    """Every method, installed or not, ours first."""
    from invariantqp.compare.laws import damped, invariant, moore_penrose, qp_backends, systems

    families = (invariant.METHODS, moore_penrose.METHODS, damped.METHODS, qp_backends.METHODS, systems.METHODS)
    return {method.name: method for family in families for method in family}


def chosen(names: str | Iterable[str] | None = None) -> dict[str, Method]:
    """The methods meant; every installed one by default.

    Args:
        names: methods, families ("damped") or parts of names ("osqp" is every OSQP), in any case; a string has them
            apart by commas.

    Raises:
        UnknownName: no method has that in its name; the near ones are listed.
        BadInput: a method that is not installed, or no method at all.
    """
    table = methods()
    if names is None:
        return {name: method for name, method in table.items() if method.installed}
    found: dict[str, Method] = {}
    for word in _split(names, table) if isinstance(names, str) else names:
        found.update(_meant(word.strip(), table))
    if not found:
        raise BadInput("--methods", "no method", f"some of {', '.join(table)}, or families: {', '.join(FAMILIES)}")
    return {name: found[name] for name in table if name in found}


def first_of_groups(names: Iterable[str]) -> list[str]:
    """The names without those that share a group with one before them."""
    table = methods()
    firsts: dict[str, str] = {}
    for name in names:
        firsts.setdefault(table[name].group or name, name)
    return list(firsts.values())


def _split(text: str, table: dict[str, Method]) -> list[str]:
    """Names apart by commas, some of which have commas of their own."""
    parts = [part.strip() for part in text.split(",") if part.strip()]
    known = {name.lower() for name in table}
    words = []
    while parts:
        joined = [", ".join(parts[:k]) for k in range(len(parts), 1, -1)]
        name = next((name for name in joined if name.lower() in known), parts[0])
        words.append(name)
        del parts[: name.count(",") + 1]
    return words


def _meant(word: str, table: dict[str, Method]) -> dict[str, Method]:
    exact = {name: method for name, method in table.items() if name.lower() == word.lower()}
    if exact:
        (method,) = exact.values()
        if not method.installed:
            raise BadInput("--methods", f"{method.name}, which needs {' and '.join(method.needs)}", "installed methods")
        return exact
    kin = {name: method for name, method in table.items() if method.family.lower() == word.lower()}
    like = kin or {name: method for name, method in table.items() if word and word.lower() in name.lower()}
    if not like:
        known = [*table, *FAMILIES]
        raise UnknownName("method", word, difflib.get_close_matches(word, known, cutoff=0.5), known)
    return {name: method for name, method in like.items() if method.installed}
