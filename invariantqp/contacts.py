"""Contacts between a tool and its surroundings: what may move, what can be pressed."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.force.contact_kinds import Contact as Contact
    from invariantqp.force.contact_kinds import ContactKind as ContactKind
    from invariantqp.force.contact_kinds import ball_joint as ball_joint
    from invariantqp.force.contact_kinds import face_contact as face_contact
    from invariantqp.force.contact_kinds import hinge as hinge
    from invariantqp.force.contact_kinds import line_contact as line_contact
    from invariantqp.force.contact_kinds import peg_in_hole as peg_in_hole
    from invariantqp.force.contact_kinds import point_contact as point_contact
    from invariantqp.force.contact_kinds import surface_contact as surface_contact
    from invariantqp.force.contact_kinds import two_contacts as two_contacts
    from invariantqp.identification.candidate import Candidate as Candidate
    from invariantqp.identification.identify import Identification as Identification
    from invariantqp.identification.identify import identify as identify
