"""[DS]'s damped formula as it is printed, for comparison, with what it does to the loop said aloud.

    x = (G + Lambda)^-1 g,   closed-loop gains: the eigenvalues of (G + Lambda)^-1 G

Reference: [DS] (6.4).
"""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.damping import PaperLambda
from invariantqp.velocity.law import Demand, VelocityLaw

# Gains beyond [0, 1] by less than this are rounding.
GAIN_TOLERANCE = 1e-9


def paper_velocity(law: VelocityLaw, damping: PaperLambda, demand: Demand) -> tuple[Array, str]:
    """The velocity (m,), unbounded, and what is wrong with it in words, "" if nothing is.

    Raises:
        numpy.linalg.LinAlgError: G + Lambda is singular, the pole itself.
    """
    data = law.form.gram_data(demand.J, demand.s)
    total = data.G + damping.of_size(len(data.g))
    x: Array = np.asarray(np.linalg.solve(total, data.g), dtype=np.float64)
    gains = np.linalg.eigvals(np.linalg.solve(total, data.G)).real
    bad = gains[(gains < -GAIN_TOLERANCE) | (gains > 1.0 + GAIN_TOLERANCE)]
    if not len(bad):
        return x, ""
    listed = ", ".join(f"{gain:.3g}" for gain in np.sort(bad))
    return x, f"[DS]'s Lambda gives closed-loop gains outside [0, 1]: {listed}; negative ones drive the tool away"
