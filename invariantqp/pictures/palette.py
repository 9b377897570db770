"""The colours of every picture and page, and tracking errors as all of them draw them.

Okabe and Ito's palette, which colour-blind readers can tell apart. Errors are in millimetres and degrees, logarithmic.

Reference: Okabe & Ito 2008, Color Universal Design.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from invariantqp.geometry.arrays import Array

if TYPE_CHECKING:
    from invariantqp.runs.trace import Trace

BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
SKY = "#56B4E9"
VERMILION = "#D55E00"
BLACK = "#000000"
YELLOW = "#F0E442"

# On white paper, in the order in which curves take them.
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, BLACK, YELLOW)
# On a page that may be dark or light: grey and olive instead of black and yellow, which one of the two would hide.
SCREEN_COLOURS = (*COLOURS[:6], "#7F7F7F", "#B8A900")

# Greys of what is not a result: text beside the data, reference lines, and shaded areas.
TEXT, RULE, SHADE = "#444444", "#777777", "#999999"

# Curves and their colours.
CURVES = {"position [mm]": BLUE, "orientation [deg]": ORANGE}


def errors_of(trace: Trace) -> Array:
    """(n, 2) of each tick, in the order of CURVES; at least what a logarithmic axis can show, a picometre."""
    errors: Array = np.column_stack((1e3 * trace.position_error, np.degrees(trace.orientation_error)))
    return errors
