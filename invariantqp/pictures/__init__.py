"""Pictures of runs, of contact and of the pitches of an arm, written to files.

Each name is loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from invariantqp.lazy import load_lazily

if TYPE_CHECKING:
    from invariantqp.pictures.pitches import pitch_picture as pitch_picture
    from invariantqp.pictures.run import picture as picture

load_lazily(
    __name__,
    {"invariantqp.pictures.pitches": ("pitch_picture",), "invariantqp.pictures.run": ("picture",)},
)
