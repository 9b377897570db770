"""Task-space velocity control of robot arms whose answers do not depend on frames or length units.

Names are loaded when first used: importing the package loads neither Pinocchio nor a solver.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from invariantqp.lazy import load_lazily
from invariantqp.version import __version__ as __version__

if TYPE_CHECKING:
    from invariantqp import contacts as contacts
    from invariantqp import pink as pink
    from invariantqp import se3 as se3
    from invariantqp import systems as systems
    from invariantqp import tasks as tasks
    from invariantqp.analysis.inspection import Inspection as Inspection
    from invariantqp.analysis.inspection import inspect as inspect
    from invariantqp.analysis.recommendation import Recommendation as Recommendation
    from invariantqp.analysis.survey import Survey as Survey
    from invariantqp.compare.measure.contact_frames import ContactFrameCheck as ContactFrameCheck
    from invariantqp.compare.measure.contact_frames import contact_frame_check as contact_frame_check
    from invariantqp.compare.measure.frames import FrameCheck as FrameCheck
    from invariantqp.compare.measure.frames import frame_check as frame_check
    from invariantqp.control.controller import Controller as Controller
    from invariantqp.control.demands import ExactAxis as ExactAxis
    from invariantqp.control.demands import ExactJoints as ExactJoints
    from invariantqp.control.demands import ExactPlane as ExactPlane
    from invariantqp.control.demands import ExactPoint as ExactPoint
    from invariantqp.control.own_form import own_form as own_form
    from invariantqp.control.own_form import tool_metric as tool_metric
    from invariantqp.control.shared import SharedTask as SharedTask
    from invariantqp.errors import BadInput as BadInput
    from invariantqp.errors import BlindSystem as BlindSystem
    from invariantqp.errors import InvariantQPError as InvariantQPError
    from invariantqp.errors import MissingExtra as MissingExtra
    from invariantqp.errors import NoProjectors as NoProjectors
    from invariantqp.errors import NoPseudoinverse as NoPseudoinverse
    from invariantqp.errors import RobotModelError as RobotModelError
    from invariantqp.errors import TaskFileError as TaskFileError
    from invariantqp.errors import UnknownName as UnknownName
    from invariantqp.force.hybrid import HybridController as HybridController
    from invariantqp.force.hybrid import HybridSolution as HybridSolution
    from invariantqp.force.hybrid_task import HybridTask as HybridTask
    from invariantqp.force.wrench import WrenchSensor as WrenchSensor
    from invariantqp.geometry.forms import invariant_form as invariant_form
    from invariantqp.geometry.forms import pitch_form as pitch_form
    from invariantqp.geometry.forms import pitch_form_inverse as pitch_form_inverse
    from invariantqp.geometry.screws import axis as axis
    from invariantqp.geometry.screws import helical as helical
    from invariantqp.geometry.screws import pitch as pitch
    from invariantqp.geometry.screws import prismatic as prismatic
    from invariantqp.geometry.screws import revolute as revolute
    from invariantqp.geometry.se3 import adjoint as adjoint
    from invariantqp.geometry.se3 import bracket as bracket
    from invariantqp.geometry.se3 import coadjoint as coadjoint
    from invariantqp.geometry.se3 import exp as exp
    from invariantqp.geometry.se3 import inverse as inverse
    from invariantqp.geometry.se3 import log as log
    from invariantqp.geometry.se3 import transform as transform
    from invariantqp.pictures.pitches import pitch_picture as pitch_picture
    from invariantqp.pictures.run import picture as picture
    from invariantqp.pose.batch import solve_poses as solve_poses
    from invariantqp.pose.ik import PoseSolution as PoseSolution
    from invariantqp.pose.ik import solve_pose as solve_pose
    from invariantqp.robots.chain import Chain as Chain
    from invariantqp.robots.kinematics import Robot as Robot
    from invariantqp.robots.load import load_robot as load_robot
    from invariantqp.runs.log import ContactTrace as ContactTrace
    from invariantqp.runs.run import run_task as run_task
    from invariantqp.runs.taskfile import Task as Task
    from invariantqp.runs.taskfile import load_task as load_task
    from invariantqp.runs.taskfile import shipped_tasks as shipped_tasks
    from invariantqp.runs.trace import Trace as Trace
    from invariantqp.systems.centre import centre as centre
    from invariantqp.systems.classification import Border as Border
    from invariantqp.systems.classification import GibsonHunt as GibsonHunt
    from invariantqp.systems.classification import gibson_hunt as gibson_hunt
    from invariantqp.systems.contact_kinds import ContactKind as ContactKind
    from invariantqp.systems.contacts import Contact as Contact
    from invariantqp.systems.contacts import face_contact as face_contact
    from invariantqp.systems.contacts import hinge as hinge
    from invariantqp.systems.contacts import line_contact as line_contact
    from invariantqp.systems.contacts import peg_in_hole as peg_in_hole
    from invariantqp.systems.contacts import point_contact as point_contact
    from invariantqp.systems.contacts import surface_contact as surface_contact
    from invariantqp.systems.existence import Existence as Existence
    from invariantqp.systems.existence import existence as existence
    from invariantqp.systems.existence import reciprocal_has_pseudoinverse as reciprocal_has_pseudoinverse
    from invariantqp.systems.gram import blind_directions as blind_directions
    from invariantqp.systems.gram import gram_matrix as gram_matrix
    from invariantqp.systems.gram import gram_polynomial as gram_polynomial
    from invariantqp.systems.gram import principal_pitches as principal_pitches
    from invariantqp.systems.gram import principal_screws as principal_screws
    from invariantqp.systems.hyperbolic import HyperbolicSpectrum as HyperbolicSpectrum
    from invariantqp.systems.hyperbolic import hyperbolic_singular_values as hyperbolic_singular_values
    from invariantqp.systems.involution import Involution as Involution
    from invariantqp.systems.involution import involution as involution
    from invariantqp.systems.parallel import leg_spectrum as leg_spectrum
    from invariantqp.systems.parallel import leg_wrenches as leg_wrenches
    from invariantqp.systems.parallel import platform_stiffness as platform_stiffness
    from invariantqp.systems.parallel import wrench_pseudoinverse as wrench_pseudoinverse
    from invariantqp.systems.point_motion import PointMotion as PointMotion
    from invariantqp.systems.point_motion import motions_along as motions_along
    from invariantqp.systems.point_motion import point_motion as point_motion
    from invariantqp.systems.projectors import DualProjectors as DualProjectors
    from invariantqp.systems.projectors import dual_projectors as dual_projectors
    from invariantqp.systems.pseudoinverse import has_pseudoinverse as has_pseudoinverse
    from invariantqp.systems.pseudoinverse import pseudoinverse as pseudoinverse
    from invariantqp.systems.report import SystemReport as SystemReport
    from invariantqp.systems.report import describe as describe
    from invariantqp.systems.stationarity import StationaryPoint as StationaryPoint
    from invariantqp.systems.stationarity import error_form as error_form
    from invariantqp.systems.stationarity import stationary_point as stationary_point
    from invariantqp.systems.stationarity import vanishing_pitches as vanishing_pitches
    from invariantqp.systems.subspaces import annihilator as annihilator
    from invariantqp.systems.subspaces import reciprocal as reciprocal
    from invariantqp.systems.subspaces import screw_system as screw_system
    from invariantqp.systems.subspaces import self_reciprocal as self_reciprocal
    from invariantqp.systems.subspaces import system_meet as system_meet
    from invariantqp.systems.subspaces import system_sum as system_sum
    from invariantqp.velocity.batch import VelocitySolutions as VelocitySolutions
    from invariantqp.velocity.batch import solve_velocities as solve_velocities
    from invariantqp.velocity.damping import Adaptive as Adaptive
    from invariantqp.velocity.damping import Fixed as Fixed
    from invariantqp.velocity.damping import None_ as None_
    from invariantqp.velocity.damping import PaperLambda as PaperLambda
    from invariantqp.velocity.damping import Selective as Selective
    from invariantqp.velocity.exact import ExactRows as ExactRows
    from invariantqp.velocity.forms import CarriedMetric as CarriedMetric
    from invariantqp.velocity.forms import Complement as Complement
    from invariantqp.velocity.forms import PitchForm as PitchForm
    from invariantqp.velocity.guard import Guard as Guard
    from invariantqp.velocity.limits.box import Bounds as Bounds
    from invariantqp.velocity.limits.rows import LimitRows as LimitRows
    from invariantqp.velocity.limits.toolspeed import ToolSpeed as ToolSpeed
    from invariantqp.velocity.qp.backends import Osqp as Osqp
    from invariantqp.velocity.qp.boxqp import BoxQP as BoxQP
    from invariantqp.velocity.request import MethodChoice as MethodChoice
    from invariantqp.velocity.request import UnitsMixed as UnitsMixed
    from invariantqp.velocity.request import method_for as method_for
    from invariantqp.velocity.request import solve_velocity as solve_velocity
    from invariantqp.velocity.several import JointTask as JointTask
    from invariantqp.velocity.several import TwistTask as TwistTask
    from invariantqp.velocity.several import solve_tasks as solve_tasks
    from invariantqp.velocity.solution import VelocitySolution as VelocitySolution
    from invariantqp.view.page import animation as animation
    from invariantqp.view.server import Viewer as Viewer

load_lazily(
    __name__,
    {
        "invariantqp.analysis.inspection": ("Inspection", "inspect"),
        "invariantqp.analysis.recommendation": ("Recommendation",),
        "invariantqp.analysis.survey": ("Survey",),
        "invariantqp.compare.measure.contact_frames": ("ContactFrameCheck", "contact_frame_check"),
        "invariantqp.compare.measure.frames": ("FrameCheck", "frame_check"),
        "invariantqp.control.controller": ("Controller",),
        "invariantqp.control.demands": ("ExactAxis", "ExactJoints", "ExactPlane", "ExactPoint"),
        "invariantqp.control.own_form": ("own_form", "tool_metric"),
        "invariantqp.control.shared": ("SharedTask",),
        "invariantqp.errors": (
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
        "invariantqp.force.hybrid": ("HybridController", "HybridSolution"),
        "invariantqp.force.hybrid_task": ("HybridTask",),
        "invariantqp.force.wrench": ("WrenchSensor",),
        "invariantqp.geometry.forms": ("invariant_form", "pitch_form", "pitch_form_inverse"),
        "invariantqp.geometry.screws": ("axis", "helical", "pitch", "prismatic", "revolute"),
        "invariantqp.geometry.se3": ("adjoint", "bracket", "coadjoint", "exp", "inverse", "log", "transform"),
        "invariantqp.pictures.pitches": ("pitch_picture",),
        "invariantqp.pictures.run": ("picture",),
        "invariantqp.pose.batch": ("solve_poses",),
        "invariantqp.pose.ik": ("PoseSolution", "solve_pose"),
        "invariantqp.robots.chain": ("Chain",),
        "invariantqp.robots.kinematics": ("Robot",),
        "invariantqp.robots.load": ("load_robot",),
        "invariantqp.runs.log": ("ContactTrace",),
        "invariantqp.runs.run": ("run_task",),
        "invariantqp.runs.taskfile": ("Task", "load_task", "shipped_tasks"),
        "invariantqp.runs.trace": ("Trace",),
        "invariantqp.systems.centre": ("centre",),
        "invariantqp.systems.classification": ("Border", "GibsonHunt", "gibson_hunt"),
        "invariantqp.systems.contact_kinds": ("ContactKind",),
        "invariantqp.systems.contacts": (
            "Contact",
            "face_contact",
            "hinge",
            "line_contact",
            "peg_in_hole",
            "point_contact",
            "surface_contact",
        ),
        "invariantqp.systems.existence": ("Existence", "existence", "reciprocal_has_pseudoinverse"),
        "invariantqp.systems.gram": (
            "blind_directions",
            "gram_matrix",
            "gram_polynomial",
            "principal_pitches",
            "principal_screws",
        ),
        "invariantqp.systems.hyperbolic": ("HyperbolicSpectrum", "hyperbolic_singular_values"),
        "invariantqp.systems.involution": ("Involution", "involution"),
        "invariantqp.systems.parallel": ("leg_spectrum", "leg_wrenches", "platform_stiffness", "wrench_pseudoinverse"),
        "invariantqp.systems.point_motion": ("PointMotion", "motions_along", "point_motion"),
        "invariantqp.systems.projectors": ("DualProjectors", "dual_projectors"),
        "invariantqp.systems.pseudoinverse": ("has_pseudoinverse", "pseudoinverse"),
        "invariantqp.systems.report": ("SystemReport", "describe"),
        "invariantqp.systems.stationarity": ("StationaryPoint", "error_form", "stationary_point", "vanishing_pitches"),
        "invariantqp.systems.subspaces": (
            "annihilator",
            "reciprocal",
            "screw_system",
            "self_reciprocal",
            "system_meet",
            "system_sum",
        ),
        "invariantqp.velocity.batch": ("VelocitySolutions", "solve_velocities"),
        "invariantqp.velocity.damping": ("Adaptive", "Fixed", "None_", "PaperLambda", "Selective"),
        "invariantqp.velocity.exact": ("ExactRows",),
        "invariantqp.velocity.forms": ("CarriedMetric", "Complement", "PitchForm"),
        "invariantqp.velocity.guard": ("Guard",),
        "invariantqp.velocity.limits.box": ("Bounds",),
        "invariantqp.velocity.limits.rows": ("LimitRows",),
        "invariantqp.velocity.limits.toolspeed": ("ToolSpeed",),
        "invariantqp.velocity.qp.backends": ("Osqp",),
        "invariantqp.velocity.qp.boxqp": ("BoxQP",),
        "invariantqp.velocity.request": ("MethodChoice", "UnitsMixed", "method_for", "solve_velocity"),
        "invariantqp.velocity.several": ("JointTask", "TwistTask", "solve_tasks"),
        "invariantqp.velocity.solution": ("VelocitySolution",),
        "invariantqp.view.page": ("animation",),
        "invariantqp.view.server": ("Viewer",),
    },
    namespaces=("contacts", "pink", "se3", "systems", "tasks"),
    own=("__version__",),
)
