"""Task-space velocity control of robot arms whose answers do not depend on frames or length units.

Names are loaded when first used: importing the package loads neither Pinocchio nor a solver.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from invariantqp.version import __version__

if TYPE_CHECKING:
    from invariantqp.analysis.inspection import Inspection, inspect
    from invariantqp.analysis.recommendation import Recommendation
    from invariantqp.analysis.survey import Survey
    from invariantqp.compare.measure.contact_frames import ContactFrameCheck, contact_frame_check
    from invariantqp.compare.measure.frames import FrameCheck, frame_check
    from invariantqp.control.controller import Controller
    from invariantqp.control.demands import ExactAxis, ExactJoints, ExactPlane, ExactPoint
    from invariantqp.control.own_form import own_form, tool_metric
    from invariantqp.control.shared import SharedTask
    from invariantqp.errors import (
        BadInput,
        BlindSystem,
        InvariantQPError,
        MissingExtra,
        NoProjectors,
        NoPseudoinverse,
        RobotModelError,
        TaskFileError,
        UnknownName,
    )
    from invariantqp.force.hybrid import HybridController, HybridSolution
    from invariantqp.force.hybrid_task import HybridTask
    from invariantqp.force.wrench import WrenchSensor
    from invariantqp.geometry.forms import invariant_form, pitch_form, pitch_form_inverse
    from invariantqp.geometry.screws import axis, helical, pitch, prismatic, revolute
    from invariantqp.geometry.se3 import adjoint, bracket, coadjoint, exp, inverse, log, transform
    from invariantqp.pictures.pitches import pitch_picture
    from invariantqp.pictures.run import picture
    from invariantqp.pose.batch import solve_poses
    from invariantqp.pose.ik import PoseSolution, solve_pose
    from invariantqp.robots.chain import Chain
    from invariantqp.robots.kinematics import Robot
    from invariantqp.robots.load import load_robot
    from invariantqp.runs.log import ContactTrace
    from invariantqp.runs.run import run_task
    from invariantqp.runs.taskfile import Task, load_task, shipped_tasks
    from invariantqp.runs.trace import Trace
    from invariantqp.systems.centre import centre
    from invariantqp.systems.classification import Border, GibsonHunt, gibson_hunt
    from invariantqp.systems.contact_kinds import ContactKind
    from invariantqp.systems.contacts import (
        Contact,
        face_contact,
        hinge,
        line_contact,
        peg_in_hole,
        point_contact,
        surface_contact,
    )
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
    from invariantqp.systems.projectors import DualProjectors, dual_projectors
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
    from invariantqp.velocity.batch import VelocitySolutions, solve_velocities
    from invariantqp.velocity.damping import Adaptive, Fixed, None_, PaperLambda, Selective
    from invariantqp.velocity.exact import ExactRows
    from invariantqp.velocity.forms import CarriedMetric, Complement, PitchForm
    from invariantqp.velocity.guard import Guard
    from invariantqp.velocity.limits.box import Bounds
    from invariantqp.velocity.limits.rows import LimitRows
    from invariantqp.velocity.limits.toolspeed import ToolSpeed
    from invariantqp.velocity.qp.backends import Osqp
    from invariantqp.velocity.qp.boxqp import BoxQP
    from invariantqp.velocity.request import MethodChoice, UnitsMixed, method_for, solve_velocity
    from invariantqp.velocity.several import JointTask, TwistTask, solve_tasks
    from invariantqp.velocity.solution import VelocitySolution
    from invariantqp.view.page import animation
    from invariantqp.view.server import Viewer

# Where each public name lives; the floors below load as they are asked for.
_HOME = {
    "compare.measure.contact_frames": ("ContactFrameCheck", "contact_frame_check"),
    "compare.measure.frames": ("FrameCheck", "frame_check"),
    "control.controller": ("Controller",),
    "control.demands": ("ExactAxis", "ExactJoints", "ExactPlane", "ExactPoint"),
    "force.hybrid": ("HybridController", "HybridSolution"),
    "force.hybrid_task": ("HybridTask",),
    "runs.log": ("ContactTrace",),
    "control.own_form": ("own_form", "tool_metric"),
    "analysis.inspection": ("Inspection", "inspect"),
    "pictures.run": ("picture",),
    "pictures.pitches": ("pitch_picture",),
    "pose.batch": ("solve_poses",),
    "pose.ik": ("PoseSolution", "solve_pose"),
    "analysis.recommendation": ("Recommendation",),
    "control.shared": ("SharedTask",),
    "runs.run": ("run_task",),
    "analysis.survey": ("Survey",),
    "runs.taskfile": ("Task", "load_task", "shipped_tasks"),
    "runs.trace": ("Trace",),
    "force.wrench": ("WrenchSensor",),
    "errors": (
        "BadInput",
        "BlindSystem",
        "InvariantQPError",
        "MissingExtra",
        "NoProjectors",
        "NoPseudoinverse",
        "RobotModelError",
        "TaskFileError",
        "UnknownName",
    ),
    "geometry.forms": ("invariant_form", "pitch_form", "pitch_form_inverse"),
    "geometry.screws": ("axis", "helical", "pitch", "prismatic", "revolute"),
    "geometry.se3": ("adjoint", "bracket", "coadjoint", "exp", "inverse", "log", "transform"),
    "robots.chain": ("Chain",),
    "robots.kinematics": ("Robot",),
    "robots.load": ("load_robot",),
    "systems.centre": ("centre",),
    "systems.classification": ("Border", "GibsonHunt", "gibson_hunt"),
    "systems.contact_kinds": ("ContactKind",),
    "systems.contacts": (
        "Contact",
        "face_contact",
        "hinge",
        "line_contact",
        "peg_in_hole",
        "point_contact",
        "surface_contact",
    ),
    "systems.existence": ("Existence", "existence", "reciprocal_has_pseudoinverse"),
    "systems.gram": ("blind_directions", "gram_matrix", "gram_polynomial", "principal_pitches", "principal_screws"),
    "systems.hyperbolic": ("HyperbolicSpectrum", "hyperbolic_singular_values"),
    "systems.involution": ("Involution", "involution"),
    "systems.parallel": ("leg_spectrum", "leg_wrenches", "platform_stiffness", "wrench_pseudoinverse"),
    "systems.point_motion": ("PointMotion", "motions_along", "point_motion"),
    "systems.projectors": ("DualProjectors", "dual_projectors"),
    "systems.pseudoinverse": ("has_pseudoinverse", "pseudoinverse"),
    "systems.report": ("SystemReport", "describe"),
    "systems.stationarity": ("StationaryPoint", "error_form", "stationary_point", "vanishing_pitches"),
    "systems.subspaces": ("annihilator", "reciprocal", "screw_system", "self_reciprocal", "system_meet", "system_sum"),
    "velocity.qp.backends": ("Osqp",),
    "velocity.batch": ("VelocitySolutions", "solve_velocities"),
    "velocity.qp.boxqp": ("BoxQP",),
    "velocity.damping": ("Adaptive", "Fixed", "None_", "PaperLambda", "Selective"),
    "velocity.exact": ("ExactRows",),
    "velocity.guard": ("Guard",),
    "velocity.limits.box": ("Bounds",),
    "velocity.forms": ("CarriedMetric", "Complement", "PitchForm"),
    "velocity.request": ("MethodChoice", "UnitsMixed", "method_for", "solve_velocity"),
    "velocity.limits.rows": ("LimitRows",),
    "velocity.several": ("JointTask", "TwistTask", "solve_tasks"),
    "velocity.solution": ("VelocitySolution",),
    "velocity.limits.toolspeed": ("ToolSpeed",),
    "view.page": ("animation",),
    "view.server": ("Viewer",),
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
