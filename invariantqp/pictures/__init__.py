"""Pictures of runs, of contact and of the pitches of an arm, written to files."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.pictures.inspection import pitch_picture as pitch_picture
    from invariantqp.pictures.run import picture as picture
