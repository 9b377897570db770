"""Task-space velocity control of robot arms whose answers do not depend on frames or length units.

Names are loaded when first used: importing the package loads neither Pinocchio nor a solver.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from invariantqp.errors import (
        BadInput,
        BlindSystem,
        InvariantQPError,
        MissingExtra,
        NoPseudoinverse,
        RobotModelError,
        TaskFileError,
        UnknownName,
    )
    from invariantqp.geometry.forms import invariant_form, pitch_form, pitch_form_inverse
    from invariantqp.geometry.screws import axis, helical, pitch, prismatic, revolute
    from invariantqp.geometry.se3 import adjoint, bracket, coadjoint, exp, inverse, log, transform
    from invariantqp.systems.classification import Border, GibsonHunt, gibson_hunt
    from invariantqp.systems.existence import Existence, existence, reciprocal_has_pseudoinverse
    from invariantqp.systems.gram import (
        blind_directions,
        gram_matrix,
        gram_polynomial,
        principal_pitches,
        principal_screws,
    )
    from invariantqp.systems.hyperbolic import HyperbolicSpectrum, hyperbolic_singular_values
    from invariantqp.systems.involution import Involution, involution
    from invariantqp.systems.parallel import leg_spectrum, leg_wrenches, platform_stiffness, wrench_pseudoinverse
    from invariantqp.systems.point_motion import PointMotion, motions_along, point_motion
    from invariantqp.systems.pseudoinverse import has_pseudoinverse, pseudoinverse
    from invariantqp.systems.report import SystemReport, describe
    from invariantqp.systems.stationarity import StationaryPoint, error_form, stationary_point, vanishing_pitches
    from invariantqp.systems.subspaces import (
        annihilator,
        reciprocal,
        screw_system,
        self_reciprocal,
        system_meet,
        system_sum,
    )

__version__ = "0.1.0"

# Where each public name lives; the floors below load as they are asked for.
_HOME = {
    "errors": (
        "BadInput",
        "BlindSystem",
        "InvariantQPError",
        "MissingExtra",
        "NoPseudoinverse",
        "RobotModelError",
        "TaskFileError",
        "UnknownName",
    ),
    "geometry.forms": ("invariant_form", "pitch_form", "pitch_form_inverse"),
    "geometry.screws": ("axis", "helical", "pitch", "prismatic", "revolute"),
    "geometry.se3": ("adjoint", "bracket", "coadjoint", "exp", "inverse", "log", "transform"),
    "systems.classification": ("Border", "GibsonHunt", "gibson_hunt"),
    "systems.existence": ("Existence", "existence", "reciprocal_has_pseudoinverse"),
    "systems.gram": ("blind_directions", "gram_matrix", "gram_polynomial", "principal_pitches", "principal_screws"),
    "systems.hyperbolic": ("HyperbolicSpectrum", "hyperbolic_singular_values"),
    "systems.involution": ("Involution", "involution"),
    "systems.parallel": ("leg_spectrum", "leg_wrenches", "platform_stiffness", "wrench_pseudoinverse"),
    "systems.point_motion": ("PointMotion", "motions_along", "point_motion"),
    "systems.pseudoinverse": ("has_pseudoinverse", "pseudoinverse"),
    "systems.report": ("SystemReport", "describe"),
    "systems.stationarity": ("StationaryPoint", "error_form", "stationary_point", "vanishing_pitches"),
    "systems.subspaces": ("annihilator", "reciprocal", "screw_system", "self_reciprocal", "system_meet", "system_sum"),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [*_MODULE_OF, "__version__"]  # noqa: PLE0604 (names are strings; a test resolves each)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'invariantqp' has no attribute {name!r}")
    value = getattr(import_module(f"invariantqp.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
