"""Random and hostile ticks straight through the compiled core: no crash, no exception, none outside limits.

`PYTHONPATH=tests python -m support.fuzz_core 10000000 [SEED]` runs ten million; what is wrong is printed.
"""

import sys
from collections import Counter

import numpy as np

from support.two_laws import native_answer, random_tick

# Ticks made of one law and demand by changing its numbers.
ALIKE = 250
BAD = (np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-320, 1e-200, 1e200, 1e308, 1.0)
# Rounding of a row or a speed, relative to its own size and that of the velocity.
ROUNDING = 1e-9
# A joint velocity that is zero to rounding twice over, of ones about 1.
STILL = 1e-20


def changed(rng, array, size):
    """(ALIKE, ...) versions of an array: as it is, a little or altogether different, or with a number that is none."""
    many = np.repeat(array[None], ALIKE, axis=0)
    kind = rng.integers(4, size=ALIKE)
    many[kind == 1] *= 1.0 + 1e-7 * rng.normal(size=many[kind == 1].shape)
    many[kind == 2] += size * rng.normal(size=many[kind == 2].shape)
    flat = many.reshape(ALIKE, -1)
    bad = np.flatnonzero(rng.random(ALIKE) < 0.02)
    flat[bad, rng.integers(flat.shape[1], size=len(bad))] = rng.choice(BAD, size=len(bad))
    return many


def fuzz(ticks, seed=0):
    """Counts of what happened, and descriptions of what may not."""
    rng, counts, wrong = np.random.default_rng(seed), Counter(), []
    while counts["ticks"] < ticks:
        law, demand = random_tick(rng)
        J, s = changed(rng, demand.J, np.abs(demand.J).max()), changed(rng, demand.s, np.abs(demand.s).max())
        width = np.where(np.isfinite(demand.upper - demand.lower), demand.upper - demand.lower, 1.0)
        lower = demand.lower - np.abs(changed(rng, 0.1 * width, 0.1)) * rng.integers(-1, 2, (ALIKE, 1))
        upper = demand.upper + np.abs(changed(rng, 0.1 * width, 0.1)) * rng.integers(-1, 2, (ALIKE, 1))
        lower, upper = np.minimum(lower, upper), np.maximum(lower, upper)
        for k in range(ALIKE):
            tick = demand._replace(J=J[k], s=s[k], lower=lower[k], upper=upper[k])
            counts["ticks"] += 1
            try:
                found = native_answer(law, tick)
            except Exception as error:  # noqa: BLE001 (none is expected)
                wrong.append(f"{error!r}: {law} {tick}")
                continue
            if found is None:
                counts["handed back"] += 1
                continue
            counts[found.status] += 1
            x = found.velocity
            if not ((x >= lower[k]) & (x <= upper[k])).all():
                wrong.append(f"outside the box: {law} {tick}")
            rows, cone = tick.rows, tick.cone
            if found.status == "degraded":  # they gave way
                rows, cone = (
                    None if "rows contradict" in found.reason else rows,
                    None if "tool's" in found.reason else cone,
                )
            if rows is not None:
                size = np.linalg.norm(rows.C, axis=1) * max(np.linalg.norm(x), STILL)
                if (np.abs(rows.excess(x)) > ROUNDING * size).any():
                    wrong.append(f"outside the rows by {rows.excess(x)}: {law} {tick}")
            rounding = 0.0 if cone is None else ROUNDING * (cone.limit + np.linalg.norm(cone.J) * np.linalg.norm(x))
            if cone is not None and cone.speed(x) > cone.limit + rounding:
                wrong.append(f"too fast: {law} {tick}")
    return counts, wrong


if __name__ == "__main__":
    found, failures = fuzz(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    print(dict(found), f"{len(failures)} wrong", *failures[:5], sep="\n")
