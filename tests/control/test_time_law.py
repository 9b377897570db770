"""The S-curve: a stop within the limits, from any speed."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from invariantqp.control.time_law import Ramp

LIMIT = st.floats(0.1, 10.0)


@given(acceleration=LIMIT, jerk=LIMIT, speed=st.floats(0.0, 5.0), share=st.floats(-1.0, 1.0))
def test_a_stop_ends_at_rest_within_the_limits(acceleration, jerk, speed, share):
    ramp = Ramp(acceleration, jerk)
    a = share * min(acceleration, np.sqrt(2.0 * jerk * speed))  # else it is too late to end at rest without reversing
    distances, speeds = ramp.stop(speed, a)
    assert abs(speeds[0] - speed) < 1e-9
    assert speeds[-1] < 1e-6 * (1.0 + speed)
    assert (np.diff(distances) >= -1e-9).all()
    assert (speeds <= speed + 0.5 * a * a / jerk + 1e-9).all()


@settings(deadline=None, max_examples=10)
@given(acceleration=LIMIT, jerk=LIMIT, wanted=st.floats(0.01, 3.0), ahead=st.floats(0.1, 20.0))
def test_it_reaches_what_is_wanted_and_never_passes_what_is_allowed(acceleration, jerk, wanted, ahead):
    ramp, dt = Ramp(acceleration, jerk), 0.01
    v = a = s = 0.0
    for _ in range(250):

        def allowed(d, s=s):
            return np.sqrt(np.maximum(acceleration * (ahead - s - d), 0.0))

        before = a
        a = ramp.next(v, a, wanted, allowed, dt)
        after = max(v + a * dt, 0.0)
        assert abs(a - before) <= jerk * dt * (1.0 + 1e-9)
        s, v = s + v * dt, after
        assert v <= max(wanted, 0.0) + jerk * dt * dt + 1e-9
        assert s <= ahead * 1.01 + acceleration * dt
