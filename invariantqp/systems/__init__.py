"""Screw systems: reciprocals, Gram matrices, types, involution, and the hyperbolic pseudoinverse. numpy alone.

[DS] is P. Donelan and J. M. Selig, Hyperbolic pseudoinverses for kinematics in the Euclidean group. Its parts are in:

    a system as one value         system.py            ScrewSystem; many functions below are short spellings of it
    Theorem 2.1, (2.6)            geometry/forms.py    pitch_form, pitch_form_inverse, invariant_form
    Sect. 2.2, (2.9), (2.10)      subspaces.py         screw_system, reciprocal, annihilator, system_sum, system_meet,
                                                       self_reciprocal
                                  lines.py             alpha_plane, beta_plane, null_plane (the two rulings)
    (2.12)-(2.15), (hP1)-(hP4)    pseudoinverses.py    form_adjoint, h_adjoint, pseudoinverse, penrose_conditions
    Theorem 2.2                   pseudoinverses.py    has_pseudoinverse
    Example 3                     points.py            motions_along, point_motion
    Sect. 3, Theorem 3.1          pseudoinverses.py    existence; ScrewSystem(J).reciprocal(h) (Corollary 3.2)
    Sect. 3, Tables 1 to 3        classification.py    gibson_hunt; report.py puts it in words: describe
    Sect. 4                       lines.py             involution
    Sect. 5, (5.1)                gram.py              gram_matrix, principal_pitches, principal_screws,
                                                       blind_directions, gram_polynomial
    Sect. 6.1, 6.3, (6.5)         projectors.py        dual_projectors
    Theorem 6.1, (6.3), (6.4)     stationary.py        error_form, stationary_point; vanishing_pitches (Example 4)
    Sect. 6.2, after Example 4    stationary.py        psi; pseudoinverses.py: damped_pseudoinverse
    Sect. 6.3                     stiffness.py         leg_wrenches, wrench_pseudoinverse
    Sect. 7 (asked for there)     spectra.py           hyperbolic_singular_values, hyperbolic_polar
                                  stiffness.py         platform_stiffness, leg_spectrum, eigenscrews
    Figure 1                      families.py          pitch_field; cylindroid
    (not in [DS])                 mechanisms.py        limb_constraints, mobility
                                  points.py            centre, reach: lengths that an arm has of itself

Its errata are in the guide, examples/guide/paper.md, each asserted as the truth in tests/properties/test_paper.py.
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
    from invariantqp.systems.gram import Border as Border
    from invariantqp.systems.gram import PrincipalPitches as PrincipalPitches
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
    from invariantqp.systems.mechanisms import Mobility as Mobility
    from invariantqp.systems.mechanisms import NamedScrew as NamedScrew
    from invariantqp.systems.mechanisms import limb_constraints as limb_constraints
    from invariantqp.systems.mechanisms import mobility as mobility
    from invariantqp.systems.points import Centre as Centre
    from invariantqp.systems.points import PointMotion as PointMotion
    from invariantqp.systems.points import centre as centre
    from invariantqp.systems.points import motions_along as motions_along
    from invariantqp.systems.points import point_motion as point_motion
    from invariantqp.systems.points import reach as reach
    from invariantqp.systems.projectors import DualProjectors as DualProjectors
    from invariantqp.systems.projectors import dual_projectors as dual_projectors
    from invariantqp.systems.pseudoinverses import Existence as Existence
    from invariantqp.systems.pseudoinverses import PenroseConditions as PenroseConditions
    from invariantqp.systems.pseudoinverses import damped_pseudoinverse as damped_pseudoinverse
    from invariantqp.systems.pseudoinverses import existence as existence
    from invariantqp.systems.pseudoinverses import form_adjoint as form_adjoint
    from invariantqp.systems.pseudoinverses import h_adjoint as h_adjoint
    from invariantqp.systems.pseudoinverses import has_pseudoinverse as has_pseudoinverse
    from invariantqp.systems.pseudoinverses import penrose_conditions as penrose_conditions
    from invariantqp.systems.pseudoinverses import pseudoinverse as pseudoinverse
    from invariantqp.systems.report import SystemReport as SystemReport
    from invariantqp.systems.report import describe as describe
    from invariantqp.systems.spectra import HyperbolicPolar as HyperbolicPolar
    from invariantqp.systems.spectra import HyperbolicSpectrum as HyperbolicSpectrum
    from invariantqp.systems.spectra import hyperbolic_polar as hyperbolic_polar
    from invariantqp.systems.spectra import hyperbolic_singular_values as hyperbolic_singular_values
    from invariantqp.systems.stationary import StationaryPoint as StationaryPoint
    from invariantqp.systems.stationary import error_form as error_form
    from invariantqp.systems.stationary import psi as psi
    from invariantqp.systems.stationary import stationary_point as stationary_point
    from invariantqp.systems.stationary import vanishing_pitches as vanishing_pitches
    from invariantqp.systems.stiffness import Eigenscrews as Eigenscrews
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
