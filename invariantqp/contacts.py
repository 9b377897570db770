"""Contacts between a tool and its surroundings: what may move, what can be pressed."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.identification.candidate import Candidate as Candidate
    from invariantqp.identification.identify import Identification as Identification
    from invariantqp.identification.identify import identify as identify
    from invariantqp.systems.contacts import Contact as Contact
    from invariantqp.systems.contacts import ContactKind as ContactKind
    from invariantqp.systems.contacts import ball_joint as ball_joint
    from invariantqp.systems.contacts import face_contact as face_contact
    from invariantqp.systems.contacts import hinge as hinge
    from invariantqp.systems.contacts import line_contact as line_contact
    from invariantqp.systems.contacts import peg_in_hole as peg_in_hole
    from invariantqp.systems.contacts import point_contact as point_contact
    from invariantqp.systems.contacts import surface_contact as surface_contact
    from invariantqp.systems.contacts import two_contacts as two_contacts
