"""The colours of every picture and page: Okabe and Ito's palette, which colour-blind readers can tell apart.

Reference: Okabe & Ito 2008, Color Universal Design.
"""

from __future__ import annotations

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
