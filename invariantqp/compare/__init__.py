"""Other methods of velocity control beside ours, measured on the same problems.

method                     what a row is, what every row is given; the loop around a function of a tick
ours  qp  linear  libraries    the rows, one family a file
registry                   the table of all rows
frames  measurements       what is measured: other frames, all of it
sweep                      every measurement of every method on every task
results  tables  report    results.json; tables, chart, sentences and page made from it
"""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.compare.frames import ContactFrameCheck as ContactFrameCheck
    from invariantqp.compare.frames import FrameCheck as FrameCheck
    from invariantqp.compare.frames import contact_frame_check as contact_frame_check
    from invariantqp.compare.frames import frame_check as frame_check
