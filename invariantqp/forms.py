"""What is attempted of a twist beyond the joints: the forms of the law and their matrices.

Each name is loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from invariantqp.lazy import load_lazily

if TYPE_CHECKING:
    from invariantqp.control.measure import tool_metric as tool_metric
    from invariantqp.geometry.forms import invariant_form as invariant_form
    from invariantqp.geometry.forms import pitch_form as pitch_form
    from invariantqp.geometry.forms import pitch_form_inverse as pitch_form_inverse
    from invariantqp.velocity.forms import CarriedMetric as CarriedMetric
    from invariantqp.velocity.forms import Complement as Complement
    from invariantqp.velocity.forms import Form as Form
    from invariantqp.velocity.forms import PitchForm as PitchForm

load_lazily(
    __name__,
    {
        "invariantqp.control.measure": ("tool_metric",),
        "invariantqp.geometry.forms": ("invariant_form", "pitch_form", "pitch_form_inverse"),
        "invariantqp.velocity.forms": ("CarriedMetric", "Complement", "Form", "PitchForm"),
    },
)
