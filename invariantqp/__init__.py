"""Task-space velocity control of robot arms whose answers do not depend on frames or length units.

`dir(invariantqp)` lists the names that most scripts use, and the namespaces of the others; anything else is private.
Names are imported on first use: importing the package loads neither Pinocchio nor a solver.
"""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp import contacts as contacts
    from invariantqp import control as control
    from invariantqp import errors as errors
    from invariantqp import force as force
    from invariantqp import forms as forms
    from invariantqp import lerobot as lerobot
    from invariantqp import limits as limits
    from invariantqp import mink as mink
    from invariantqp import paths as paths
    from invariantqp import pink as pink
    from invariantqp import pose as pose
    from invariantqp import robots as robots
    from invariantqp import se3 as se3
    from invariantqp import systems as systems
    from invariantqp import tasks as tasks
    from invariantqp import velocity as velocity
    from invariantqp import workbench as workbench
    from invariantqp.control.controller import Controller as Controller
    from invariantqp.control.measure import tool_metric as tool_metric
    from invariantqp.control.target import Target as Target
    from invariantqp.engine import native as native
    from invariantqp.errors import BadInput as BadInput
    from invariantqp.errors import BlindSystem as BlindSystem
    from invariantqp.errors import InvariantQPError as InvariantQPError
    from invariantqp.errors import NoProjectors as NoProjectors
    from invariantqp.errors import NoPseudoinverse as NoPseudoinverse
    from invariantqp.force.contact import HybridTask as HybridTask
    from invariantqp.force.contact_kinds import point_contact as point_contact
    from invariantqp.force.control import HybridController as HybridController
    from invariantqp.force.sensor import WrenchSensor as WrenchSensor
    from invariantqp.force.wrench import Wrench as Wrench
    from invariantqp.geometry.forms import pitch_form as pitch_form
    from invariantqp.geometry.forms import pitch_form_inverse as pitch_form_inverse
    from invariantqp.geometry.screws import revolute as revolute
    from invariantqp.geometry.se3 import adjoint as adjoint
    from invariantqp.geometry.se3 import coadjoint as coadjoint
    from invariantqp.geometry.se3 import exp as exp
    from invariantqp.geometry.se3 import inverse as inverse
    from invariantqp.geometry.se3 import log as log
    from invariantqp.geometry.se3 import transform as transform
    from invariantqp.paths.follower import Follower as Follower
    from invariantqp.paths.path_follower import PathFollower as PathFollower
    from invariantqp.pose.ik import solve_pose as solve_pose
    from invariantqp.pose.ik import solve_poses as solve_poses
    from invariantqp.robots.load import load_robot as load_robot
    from invariantqp.systems.classification import gibson_hunt as gibson_hunt
    from invariantqp.systems.gram import principal_pitches as principal_pitches
    from invariantqp.systems.lines import involution as involution
    from invariantqp.systems.projectors import dual_projectors as dual_projectors
    from invariantqp.systems.pseudoinverses import has_pseudoinverse as has_pseudoinverse
    from invariantqp.systems.pseudoinverses import pseudoinverse as pseudoinverse
    from invariantqp.systems.subspaces import reciprocal as reciprocal
    from invariantqp.velocity.batch import solve_velocities as solve_velocities
    from invariantqp.velocity.exact import ExactRows as ExactRows
    from invariantqp.velocity.forms import CarriedMetric as CarriedMetric
    from invariantqp.velocity.forms import Complement as Complement
    from invariantqp.velocity.forms import PitchForm as PitchForm
    from invariantqp.velocity.guard import Guard as Guard
    from invariantqp.velocity.limits import Bounds as Bounds
    from invariantqp.velocity.problem import solve_velocity as solve_velocity
    from invariantqp.velocity.solution import Status as Status
    from invariantqp.version import __version__ as __version__
    from invariantqp.workbench.runs.run import run_task as run_task
    from invariantqp.workbench.runs.taskfile import load_task as load_task
