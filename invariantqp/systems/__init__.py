"""Screw systems: reciprocals, Gram matrices, types, involution, and the hyperbolic pseudoinverse. numpy alone."""

from invariantqp.lazy import lazily

with lazily(__name__):
    from invariantqp.systems.adjoints import form_adjoint as form_adjoint
    from invariantqp.systems.adjoints import h_adjoint as h_adjoint
    from invariantqp.systems.centre import Centre as Centre
    from invariantqp.systems.centre import centre as centre
    from invariantqp.systems.centre import reach as reach
    from invariantqp.systems.classification import Border as Border
    from invariantqp.systems.classification import GibsonHunt as GibsonHunt
    from invariantqp.systems.classification import gibson_hunt as gibson_hunt
    from invariantqp.systems.damped import psi as psi
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
    from invariantqp.systems.null_planes import NullPlane as NullPlane
    from invariantqp.systems.null_planes import alpha_plane as alpha_plane
    from invariantqp.systems.null_planes import beta_plane as beta_plane
    from invariantqp.systems.null_planes import null_plane as null_plane
    from invariantqp.systems.parallel import leg_spectrum as leg_spectrum
    from invariantqp.systems.parallel import leg_wrenches as leg_wrenches
    from invariantqp.systems.parallel import platform_stiffness as platform_stiffness
    from invariantqp.systems.parallel import wrench_pseudoinverse as wrench_pseudoinverse
    from invariantqp.systems.penrose import PenroseConditions as PenroseConditions
    from invariantqp.systems.penrose import penrose_conditions as penrose_conditions
    from invariantqp.systems.point_motion import PointMotion as PointMotion
    from invariantqp.systems.point_motion import motions_along as motions_along
    from invariantqp.systems.point_motion import point_motion as point_motion
    from invariantqp.systems.polar import HyperbolicPolar as HyperbolicPolar
    from invariantqp.systems.polar import hyperbolic_polar as hyperbolic_polar
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
