"""Other methods of velocity control beside ours, measured on the same problems.

method  names        what a row is, what every row is told; names that reports look for
laws/                the methods themselves, and the loop around them
registry             the table of all rows
exact/               exact answers that errors are measured against
measure/             what is measured
sweep                every measurement of every method on every task
results  report/     results.json; verdict, chart, tables and the page made from it
"""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.compare.measure.contact_frames import ContactFrameCheck as ContactFrameCheck
    from invariantqp.compare.measure.contact_frames import contact_frame_check as contact_frame_check
    from invariantqp.compare.measure.frames import FrameCheck as FrameCheck
    from invariantqp.compare.measure.frames import frame_check as frame_check
