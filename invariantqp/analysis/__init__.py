"""What can be said of an arm before it moves: singular states, principal pitches, the form to give it."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.analysis.inspection import Inspection as Inspection
    from invariantqp.analysis.inspection import Recommendation as Recommendation
    from invariantqp.analysis.inspection import inspect as inspect
    from invariantqp.analysis.survey import Survey as Survey
