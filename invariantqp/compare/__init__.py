"""Other methods of velocity control beside ours, measured on the same problems.

method  names        what a method is and what it may know; names that reports look for
laws/                the methods themselves
registry             the table of all methods
exact/               exact answers that errors are measured against
cell                 one piece of work of a sweep
measure/             what is measured
sweep                every measurement of every method on every task
results  report/     results.json; charts, tables and the page made from it

What the package exports here is loaded when first used.

What the package exports here is loaded when first used.

What the package exports here is loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from invariantqp.lazy import load_lazily

if TYPE_CHECKING:
    from invariantqp.compare.measure.contact_frames import ContactFrameCheck as ContactFrameCheck
    from invariantqp.compare.measure.contact_frames import contact_frame_check as contact_frame_check
    from invariantqp.compare.measure.frames import FrameCheck as FrameCheck
    from invariantqp.compare.measure.frames import frame_check as frame_check

load_lazily(
    __name__,
    {
        "invariantqp.compare.measure.contact_frames": ("ContactFrameCheck", "contact_frame_check"),
        "invariantqp.compare.measure.frames": ("FrameCheck", "frame_check"),
    },
)
