"""Calls of geometry, systems and velocity with the right arguments."""

import inspect

import numpy as np

import invariantqp as iq
from invariantqp.velocity.problem import VelocityOptions

RNG = np.random.default_rng(0)
J, S = RNG.normal(size=(6, 6)), RNG.normal(size=(6, 2))
T, TWIST, Q, H = iq.exp([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), RNG.normal(size=6), np.full(6, 0.2), 0.3
POINT, AXIS = [0.1, 0.2, 0.3], [0.0, 0.6, 0.8]

OF_TWISTS = ("blind_directions", "describe", "gram_polynomial", "principal_pitches", "principal_screws")
WITH_PITCH = ("existence", "gram_matrix", "has_pseudoinverse")


def contact():
    return iq.point_contact(POINT, AXIS)


def usual(function, names):
    """Arguments that are what they are unless something else is said."""
    parameters = inspect.signature(function).parameters
    return {name: parameters[name].default for name in names.split()}


def law_options(*left_out, backend=None):
    good = {"form": H, "guard": True, "joint_metric": np.ones(6), "posture": Q, "damping": 0.01, "point": POINT}
    good |= {"backend": backend, "length": 0.5}
    names = VelocityOptions.__annotations__
    return {name: good.get(name) for name in names if name not in left_out}


# What is called, and arguments that it takes.
ALGEBRA = {
    # geometry
    **{
        name: lambda name=name: (getattr(iq, name), {"pose": T, "check": True})
        for name in ("adjoint", "coadjoint", "inverse", "log")
    },
    "exp": lambda: (iq.exp, {"twist": TWIST, "check": True}),
    "bracket": lambda: (iq.se3.bracket, {"first": TWIST, "second": TWIST, "check": True}),
    "transform": lambda: (iq.transform, {"rotation": np.eye(3), "translation": POINT}),
    "pitch_form": lambda: (iq.pitch_form, {"h": H}),
    "pitch_form_inverse": lambda: (iq.pitch_form_inverse, {"h": H}),
    "invariant_form": lambda: (iq.forms.invariant_form, {"alpha": 1.0, "beta": 1.0}),
    "helical": lambda: (iq.se3.helical, {"axis": AXIS, "point": POINT, "pitch": H}),
    "revolute": lambda: (iq.revolute, {"axis": AXIS, "point": POINT}),
    "prismatic": lambda: (iq.se3.prismatic, {"axis": AXIS}),
    "pitch": lambda: (iq.se3.pitch, {"twist": TWIST}),
    "axis": lambda: (iq.se3.axis, {"twist": TWIST}),
    # systems
    "gibson_hunt": lambda: (iq.gibson_hunt, {"J": S, "tolerance": 1e-10, "length": None}),
    **{name: lambda name=name: (getattr(iq.systems, name), {"J": S}) for name in OF_TWISTS},
    **{name: lambda name=name: (getattr(iq.systems, name), {"J": S, "h": H}) for name in WITH_PITCH},
    "annihilator": lambda: (iq.systems.annihilator, {"S": S}),
    "reciprocal": lambda: (iq.reciprocal, {"S": S, "h": H}),
    "self_reciprocal": lambda: (iq.systems.self_reciprocal, {"S": S, "h": H, "tolerance": 1e-10}),
    "screw_system": lambda: (iq.systems.screw_system, {"J": S}),
    "system_meet": lambda: (iq.systems.system_meet, {"first": S, "second": J, "tolerance": 1e-10}),
    "system_sum": lambda: (iq.systems.system_sum, {"first": S, "second": J, "tolerance": 1e-10}),
    "pseudoinverse": lambda: (
        iq.pseudoinverse,
        {"J": S, "h": H, "joint_metric": None, "return_condition": False},
    ),
    "damped_pseudoinverse": lambda: (
        iq.systems.damped_pseudoinverse,
        {"J": S, "h": H, "damping": 0.1, "joint_metric": None},
    ),
    "ScrewSystem": lambda: (
        iq.systems.ScrewSystem,
        {"twists": S, "tolerance": 1e-7, "length": None, "argument": "twists"},
    ),
    **{
        f"ScrewSystem.{name}": lambda name=name: (getattr(iq.systems.ScrewSystem(S), name), {"h": H})
        for name in ("existence", "gram", "has_pseudoinverse", "reciprocal", "self_reciprocal")
    },
    "ScrewSystem.contains": lambda: (iq.systems.ScrewSystem(S).contains, {"twists": S}),
    **{
        f"ScrewSystem.{name}": lambda name=name: (
            getattr(iq.systems.ScrewSystem(S), name),
            {"other": iq.systems.ScrewSystem(S)},
        )
        for name in ("meet", "sum")
    },
    "ScrewSystem.pseudoinverse": lambda: (
        iq.systems.ScrewSystem(S).pseudoinverse,
        {"h": None, "complement": None, "metric": np.ones(6), "joint_metric": None, "return_condition": False},
    ),
    "ScrewSystem.projectors": lambda: (
        iq.systems.ScrewSystem(S).projectors,
        {"h": None, "complement": None, "metric": np.ones(6)},
    ),
    "ScrewSystem.damped_pseudoinverse": lambda: (
        iq.systems.ScrewSystem(S).damped_pseudoinverse,
        {"h": H, "damping": 0.1, "joint_metric": None},
    ),
    "ScrewSystem.singular_values": lambda: (
        iq.systems.ScrewSystem(S).singular_values,
        {"h": H, "joint_metric": None},
    ),
    "ScrewSystem.stationary_point": lambda: (
        iq.systems.ScrewSystem(S).stationary_point,
        {"twist": TWIST, "h": H},
    ),
    "cylindroid": lambda: (iq.systems.cylindroid, {"J": S}),
    "Cylindroid.at": lambda: (iq.systems.cylindroid(S).at, {"angles": POINT}),
    **{
        f"Cylindroid.{name}": lambda name=name: (
            getattr(iq.systems.cylindroid(S), name),
            {"coefficients": np.eye(2)},
        )
        for name in ("axes", "pitches", "screws")
    },
    "pitch_field": lambda: (iq.systems.pitch_field, {"J": J[:, :3]}),
    "PitchField.quadric": lambda: (iq.systems.pitch_field(J[:, :3]).quadric, {"h": H}),
    **{
        f"PitchField.{name}": lambda name=name: (
            getattr(iq.systems.pitch_field(J[:, :3]), name),
            {"coefficients": np.eye(3)},
        )
        for name in ("axes", "pitches", "screws")
    },
    "limb_constraints": lambda: (iq.systems.limb_constraints, {"J": S, "tolerance": 1e-7}),
    "mobility": lambda: (iq.systems.mobility, {"limbs": [S, J], "tolerance": 1e-7}),
    "eigenscrews": lambda: (iq.systems.eigenscrews, {"K": J @ J.T, "compliance": False}),
    "screw_of": lambda: (iq.se3.screw_of, {"twist": TWIST}),
    "screw_of_wrench": lambda: (iq.se3.screw_of_wrench, {"wrench": TWIST}),
    "hyperbolic_singular_values": lambda: (
        iq.systems.hyperbolic_singular_values,
        {"J": S, "h": H, "joint_metric": None},
    ),
    "form_adjoint": lambda: (iq.systems.form_adjoint, {"A": J, "domain": np.eye(6), "codomain": iq.pitch_form(H)}),
    "h_adjoint": lambda: (iq.systems.h_adjoint, {"J": S, "h": H, "joint_metric": None}),
    "psi": lambda: (iq.systems.psi, {"J": S, "h": H, "Lambda": 0.1}),
    "penrose_conditions": lambda: (
        iq.systems.penrose_conditions,
        {"J": S, "X": iq.pseudoinverse(S, H), "h": H, "joint_metric": None, "tolerance": 1e-10},
    ),
    "alpha_plane": lambda: (iq.systems.alpha_plane, {"point": POINT, "h": H, "direction": None}),
    "beta_plane": lambda: (iq.systems.beta_plane, {"point": POINT, "normal": AXIS, "h": H}),
    "null_plane": lambda: (iq.systems.null_plane, {"S": S}),
    "hyperbolic_polar": lambda: (iq.systems.hyperbolic_polar, {"J": S, "h": H, "joint_metric": None}),
    "involution": lambda: (iq.involution, {"lines": np.array([iq.revolute(AXIS)] * 2).T, "tolerance": 1e-10}),
    "reach": lambda: (iq.systems.reach, {"J": J, "point": POINT}),
    "centre": lambda: (iq.systems.centre, {"J": J, "twist": None}),
    "error_form": lambda: (iq.systems.error_form, {"J": J, "twist": TWIST, "h": H, "velocity": Q}),
    "stationary_point": lambda: (iq.systems.stationary_point, {"J": J, "twist": TWIST, "h": H}),
    "vanishing_pitches": lambda: (iq.systems.vanishing_pitches, {"J": S, "twist": TWIST}),
    "leg_wrenches": lambda: (
        iq.systems.leg_wrenches,
        {"base": RNG.normal(size=(6, 3)), "platform": RNG.normal(size=(6, 3))},
    ),
    "leg_spectrum": lambda: (iq.systems.leg_spectrum, {"W": J, "h": H, "leg_stiffness": None}),
    "platform_stiffness": lambda: (iq.systems.platform_stiffness, {"W": J, "leg_stiffness": np.ones(6)}),
    "wrench_pseudoinverse": lambda: (iq.systems.wrench_pseudoinverse, {"W": S, "h": H}),
    "dual_projectors": lambda: (
        iq.dual_projectors,
        {"S": S, "wrenches": None, "h": None, "complement": None, "metric": np.ones(6)},
    ),
    "DualProjectors.moved": lambda: (iq.dual_projectors(S, h=H).moved, {"pose": T}),
    "point_motion": lambda: (iq.systems.point_motion, {"J": J, "point": POINT, "direction": AXIS}),
    "motions_along": lambda: (iq.systems.motions_along, {"point": POINT, "direction": AXIS}),
    "point_contact": lambda: (iq.point_contact, {"point": POINT, "normal": AXIS, "slip": True, "tangent": None}),
    "line_contact": lambda: (
        iq.contacts.line_contact,
        {"point": POINT, "direction": [1, 0, 0], "normal": [0, 0, 1], "slip": True},
    ),
    "face_contact": lambda: (
        iq.contacts.face_contact,
        {"point": POINT, "normal": AXIS, "slip": True, "twist": False, "tangent": None},
    ),
    "ball_joint": lambda: (iq.contacts.ball_joint, {"point": POINT}),
    "hinge": lambda: (iq.contacts.hinge, {"point": POINT, "axis": AXIS, "pitch": 0.0}),
    "peg_in_hole": lambda: (iq.contacts.peg_in_hole, {"point": POINT, "axis": AXIS}),
    "surface_contact": lambda: (
        iq.contacts.surface_contact,
        {"point": POINT, "normal": lambda _: AXIS, "implicit": None, "slip": True, "extent": None},
    ),
    "two_contacts": lambda: (
        iq.contacts.two_contacts,
        {"first": contact(), "second": iq.point_contact(POINT, np.roll(AXIS, 1))},
    ),
    "ContactKind": lambda: (
        iq.contacts.ContactKind,
        {"name": "a kind", "freedoms": J[:, :5], "origin": POINT}
        | usual(iq.contacts.ContactKind, "constraints presses out"),
    ),
    "ContactKind.relabelled": lambda: (contact().kind.relabelled, {"offset": T}),
    "Contact": lambda: (iq.contacts.Contact, {"kind": contact().kind, "pose": T, "edge": None}),
    "Contact.moved": lambda: (contact().moved, {"pose": T}),
    "Contact.relabelled": lambda: (contact().relabelled, {"offset": T}),
    # velocity
    "PitchForm": lambda: (iq.PitchForm, {"h": H}),
    "CarriedMetric": lambda: (iq.CarriedMetric, {"matrix": np.ones(6), "pose": T}),
    "Complement": lambda: (iq.Complement, {"Z": S}),
    "Guard": lambda: (iq.Guard, {"fraction": 0.5}),
    "Bounds": lambda: (iq.Bounds, {"lower": -np.ones(6), "upper": np.ones(6)}),
    "ExactRows": lambda: (iq.ExactRows, {"A": J[:2], "b": [0.1, 0.2], "of_twist": np.eye(6)[:2]}),
    "ExactRows.axis": lambda: (iq.ExactRows.axis, {"J": J, "axis": AXIS, "omega": POINT}),
    "ExactRows.plane": lambda: (iq.ExactRows.plane, {"J": J, "point": POINT, "normal": AXIS, "speed": 0.1}),
    "ExactRows.point": lambda: (iq.ExactRows.point, {"J": J, "point": POINT, "velocity": AXIS}),
    "ExactRows.of": lambda: (iq.ExactRows.of, {"J": J, "D": np.eye(6)[:2], "b": [0.1, 0.2], "check": True}),
    "ExactRows.with_rows": lambda: (iq.ExactRows(J[:2], [0.1, 0.2]).with_rows, {"others": iq.ExactRows(J[:1], [0.1])}),
    "LimitRows": lambda: (iq.limits.LimitRows, {"C": J[:2], "lower": [-1, -1], "upper": [1, 1], "names": ["a", "b"]}),
    "JointLimits": lambda: (
        iq.limits.JointLimits,
        {"position_lower": -1.0, "position_upper": [1.0, 2.0], "velocity_limit": 0.5, "margin": 0.1},
    ),
    "AccelerationLimit": lambda: (iq.limits.AccelerationLimit, {"limit": [1.0, 2.0]}),
    "Sphere": lambda: (iq.limits.Sphere, {"centre": POINT, "radius": 0.1, "name": ""}),
    "Capsule": lambda: (iq.limits.Capsule, {"a": POINT, "b": [0.0, 0.0, 1.0], "radius": 0.1, "name": ""}),
    "Box": lambda: (iq.limits.Box, {"pose": T, "size": [0.1, 0.2, 0.3], "name": ""}),
    "Mesh": lambda: (
        iq.limits.Mesh,
        {"source": np.eye(4, 3).tolist(), "pose": T, "scale": 1.0, "hull": True, "name": ""},
    ),
    "Mesh.move": lambda: (iq.limits.Mesh(np.eye(4, 3), hull=True).move, {"pose": T, "twist": None}),
    "HalfSpace": lambda: (iq.limits.HalfSpace, {"point": POINT, "normal": AXIS, "name": ""}),
    "Sphere.move": lambda: (iq.limits.Sphere(POINT, 0.1).move, {"pose": T, "twist": None}),
    "Capsule.move": lambda: (iq.limits.Capsule(POINT, POINT, 0.1).move, {"pose": T, "twist": None}),
    "Box.move": lambda: (iq.limits.Box(T, [0.1, 0.1, 0.1]).move, {"pose": T, "twist": None}),
    "HalfSpace.move": lambda: (iq.limits.HalfSpace(POINT, AXIS).move, {"pose": T, "twist": None}),
    "ToolSpeed": lambda: (iq.limits.ToolSpeed, {"limit": 0.25, "point": None}),
    "JointTask": lambda: (iq.velocity.JointTask, {"velocity": Q, "weight": 1.0, "priority": 0}),
    "TwistTask": lambda: (
        iq.velocity.TwistTask,
        {"J": J, "twist": TWIST, "form": H, "weight": 1.0, "priority": 0, "point": None},
    ),
    "solve_velocity": lambda: (iq.solve_velocity, {"J": J, "twist": TWIST, **law_options()}),
    "solve_velocity, daqp": lambda: (iq.solve_velocity, {"J": J, "twist": TWIST, **law_options(backend="daqp")}),
    "solve_velocities": lambda: (
        iq.solve_velocities,
        {"J": np.stack([J, J]), "twist": np.stack([TWIST, TWIST]), **law_options("exact", "rows", "tool_speed")},
    ),
    "solve_tasks": lambda: (
        iq.velocity.solve_tasks,
        {
            "tasks": [iq.velocity.TwistTask(J, TWIST, form=H)],
            **law_options("form", "guard", "posture", "point", "length"),
        },
    ),
}
