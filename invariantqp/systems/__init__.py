"""Screw systems: reciprocals, Gram matrices, types, involution, and the hyperbolic pseudoinverse of [DS].

In come (6, m) joint twists or wrenches as arrays, out come read-only values and arrays. `ScrewSystem` is a system as
one value; functions are short spellings of its methods. Nothing here knows robots, contacts or control loops. A file a
section of [DS], P. Donelan and J. M. Selig, Hyperbolic pseudoinverses for kinematics in the Euclidean group:
Sect. 2 subspaces, pseudoinverses (Theorem 2.2), points (Example 3); Sect. 3 classification, report, pseudoinverses
(Theorem 3.1); Sect. 4 lines; Sect. 5 gram; Sect. 6 stationary, projectors, stiffness; Sect. 7 spectra, stiffness;
Figure 1 families. mechanisms is not in [DS]. examples/guide/paper.md has a table of every function, and the errata.
"""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.systems.classification import GibsonHunt as GibsonHunt
    from invariantqp.systems.classification import gibson_hunt as gibson_hunt
    from invariantqp.systems.families import Cylindroid as Cylindroid
    from invariantqp.systems.families import PitchField as PitchField
    from invariantqp.systems.families import cylindroid as cylindroid
    from invariantqp.systems.families import pitch_field as pitch_field
    from invariantqp.systems.gram import blind_directions as blind_directions
    from invariantqp.systems.gram import gram_matrix as gram_matrix
    from invariantqp.systems.gram import gram_polynomial as gram_polynomial
    from invariantqp.systems.gram import principal_pitches as principal_pitches
    from invariantqp.systems.gram import principal_screws as principal_screws
    from invariantqp.systems.lines import Involution as Involution
    from invariantqp.systems.lines import NullPlane as NullPlane
    from invariantqp.systems.lines import alpha_plane as alpha_plane
    from invariantqp.systems.lines import beta_plane as beta_plane
    from invariantqp.systems.lines import involution as involution
    from invariantqp.systems.lines import null_plane as null_plane
    from invariantqp.systems.mechanisms import limb_constraints as limb_constraints
    from invariantqp.systems.mechanisms import mobility as mobility
    from invariantqp.systems.points import centre as centre
    from invariantqp.systems.points import motions_along as motions_along
    from invariantqp.systems.points import point_motion as point_motion
    from invariantqp.systems.points import reach as reach
    from invariantqp.systems.projectors import DualProjectors as DualProjectors
    from invariantqp.systems.projectors import dual_projectors as dual_projectors
    from invariantqp.systems.pseudoinverses import damped_pseudoinverse as damped_pseudoinverse
    from invariantqp.systems.pseudoinverses import existence as existence
    from invariantqp.systems.pseudoinverses import form_adjoint as form_adjoint
    from invariantqp.systems.pseudoinverses import h_adjoint as h_adjoint
    from invariantqp.systems.pseudoinverses import has_pseudoinverse as has_pseudoinverse
    from invariantqp.systems.pseudoinverses import penrose_conditions as penrose_conditions
    from invariantqp.systems.pseudoinverses import pseudoinverse as pseudoinverse
    from invariantqp.systems.report import SystemReport as SystemReport
    from invariantqp.systems.report import describe as describe
    from invariantqp.systems.spectra import hyperbolic_polar as hyperbolic_polar
    from invariantqp.systems.spectra import hyperbolic_singular_values as hyperbolic_singular_values
    from invariantqp.systems.stationary import error_form as error_form
    from invariantqp.systems.stationary import psi as psi
    from invariantqp.systems.stationary import stationary_point as stationary_point
    from invariantqp.systems.stationary import vanishing_pitches as vanishing_pitches
    from invariantqp.systems.stiffness import eigenscrews as eigenscrews
    from invariantqp.systems.stiffness import leg_spectrum as leg_spectrum
    from invariantqp.systems.stiffness import leg_wrenches as leg_wrenches
    from invariantqp.systems.stiffness import platform_stiffness as platform_stiffness
    from invariantqp.systems.stiffness import wrench_pseudoinverse as wrench_pseudoinverse
    from invariantqp.systems.subspaces import annihilator as annihilator
    from invariantqp.systems.subspaces import reciprocal as reciprocal
    from invariantqp.systems.subspaces import screw_system as screw_system
    from invariantqp.systems.subspaces import self_reciprocal as self_reciprocal
    from invariantqp.systems.subspaces import system_meet as system_meet
    from invariantqp.systems.subspaces import system_sum as system_sum
    from invariantqp.systems.system import ScrewSystem as ScrewSystem
