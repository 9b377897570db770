"""What is attempted of a twist beyond the joints: the forms of the law and their matrices."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.control.measure import tool_metric as tool_metric
    from invariantqp.geometry.forms import invariant_form as invariant_form
    from invariantqp.geometry.forms import pitch_form as pitch_form
    from invariantqp.geometry.forms import pitch_form_inverse as pitch_form_inverse
    from invariantqp.velocity.forms import CarriedMetric as CarriedMetric
    from invariantqp.velocity.forms import Complement as Complement
    from invariantqp.velocity.forms import Form as Form
    from invariantqp.velocity.forms import PitchForm as PitchForm
