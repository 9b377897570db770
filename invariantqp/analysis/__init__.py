"""What can be said of an arm before it moves: singular states, principal pitches, the form to give it.

Each name is loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from invariantqp.lazy import load_lazily

if TYPE_CHECKING:
    from invariantqp.analysis.inspection import Inspection as Inspection
    from invariantqp.analysis.inspection import inspect as inspect
    from invariantqp.analysis.recommendation import Recommendation as Recommendation
    from invariantqp.analysis.survey import Survey as Survey

load_lazily(
    __name__,
    {
        "invariantqp.analysis.inspection": ("Inspection", "inspect"),
        "invariantqp.analysis.recommendation": ("Recommendation",),
        "invariantqp.analysis.survey": ("Survey",),
    },
)
