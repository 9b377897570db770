"""Rigid motions, twists and screws: poses are (4, 4), twists (omega; v), wrenches (m; f)."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.geometry.screws import axis as axis
    from invariantqp.geometry.screws import helical as helical
    from invariantqp.geometry.screws import pitch as pitch
    from invariantqp.geometry.screws import prismatic as prismatic
    from invariantqp.geometry.screws import revolute as revolute
    from invariantqp.geometry.screws import screw_of as screw_of
    from invariantqp.geometry.screws import screw_of_wrench as screw_of_wrench
    from invariantqp.geometry.se3 import adjoint as adjoint
    from invariantqp.geometry.se3 import bracket as bracket
    from invariantqp.geometry.se3 import coadjoint as coadjoint
    from invariantqp.geometry.se3 import exp as exp
    from invariantqp.geometry.se3 import inverse as inverse
    from invariantqp.geometry.se3 import log as log
    from invariantqp.geometry.se3 import transform as transform
