import os

from support.fuzz_ticks import fuzz

# About 4 s on one core; INVARIANTQP_FUZZ_TICKS=1000000 for the full count.
TICKS = int(os.environ.get("INVARIANTQP_FUZZ_TICKS", "4000"))


def test_random_ticks_stay_finite_and_inside_limits_and_refuse_bad_input_alone():
    counts, failures = fuzz(TICKS)
    assert not failures, f"{len(failures)} of {TICKS}: {failures[:5]}"
    assert {"ok", "guarded", "scaled", "refused"} <= set(counts)
