"""The same tick by the compiled core and by Python, and how far rounding may part the two."""

import re
from unittest import mock

import numpy as np

import invariantqp as iq
from invariantqp.velocity import solve as python
from invariantqp.velocity.compiled import compiled
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.posed import posed

# The answers agree to this, relative, wherever they are well determined.
AGREE = 1e-10
# An optimum inside limits is determined to rounding times the condition of the Hessian, relative to its distance from
# z*; near a singularity every direction that is damped is, relative to the velocity.
ROUNDING = 64 * np.finfo(float).eps
NUMBER = re.compile(r"\d\.\d+e[+-]\d+|\d+\.\d+")
SIZES = (1e-60, 1e-6, 1e-3, 1.0, 1.0, 1.0, 1e3, 1e60)
DAMPINGS = (
    iq.velocity.Adaptive(),
    iq.velocity.Adaptive(1e-2, 1e-2),
    iq.velocity.Fixed(0.0),
    iq.velocity.Fixed(1e-3),
    iq.velocity.Selective(),
)


def random_tick(rng):
    """A law and a demand of any kind that the core has, hostile ones among them."""
    m = int(rng.integers(1, 13))
    size = SIZES[rng.integers(len(SIZES))] if rng.random() < 0.3 else 1.0
    J = rng.normal(size=(6, m)) if rng.random() < 0.7 else rng.integers(-2, 3, size=(6, m)).astype(float)
    for _ in range(int(rng.integers(3)) if rng.random() < 0.4 else 0):
        i, j = rng.integers(m, size=2)
        J[:, i] = (J[:, j], -J[:, j], 0.0 * J[:, j], 1e-6 * J[:, i], J[:, j] + 1e-7 * J[:, i])[rng.integers(5)]
    if not J.any():
        J[:, 0] = 1.0
    s = rng.normal(size=6) * 10.0 ** rng.uniform(-4, 2)
    s = (s, s, s, s, J @ rng.normal(size=m), 0.0 * s)[rng.integers(6)]
    speed = 10.0 ** rng.uniform(-3, 2)
    lower, upper = -speed * rng.uniform(0, 1, m), speed * rng.uniform(0, 1, m)
    for i in range(m) if rng.random() < 0.4 else ():
        kind = rng.integers(8)
        if kind == 0:
            lower[i] = upper[i] = (0.0, speed, -speed)[rng.integers(3)]
        elif kind == 1:
            lower[i], upper[i] = 0.5 * upper[i], upper[i]
        elif kind == 2:
            lower[i] = -np.inf
        elif kind == 3:
            upper[i] = np.inf
        elif kind == 4:
            lower[i], upper[i] = -np.inf, np.inf
    posture = rng.normal(size=m) * 10.0 ** rng.uniform(-2, 1) if rng.random() < 0.5 else None
    root = np.eye(6)
    root[3:, :3] = np.cross(np.eye(3), rng.normal(size=3))
    law = VelocityLaw(damping=DAMPINGS[rng.integers(len(DAMPINGS))], dt=(0.0, 0.002, 0.1)[rng.integers(3)])
    return law, Demand(size * J, size * s, root, lower, upper, posture=posture)


def python_answer(law, demand):
    with mock.patch.object(python, "core", None):
        return python.solve(law, demand)


def native_answer(law, demand):
    """None where it is handed back."""
    return compiled(law, demand)


def disagreements(law, demand, native, answer):
    """What differs beyond rounding, in words."""
    objective = posed(law, demand, law.damping).objective(1.0)
    largest = objective.weights.max()
    sizes = [native.velocity, answer.velocity, np.zeros(1) if demand.posture is None else demand.posture]
    size = max(float(np.abs(x).max()) for x in sizes)
    far = np.linalg.norm(answer.velocity - objective.centre())
    condition = 1.0 if answer.method == "closed-form" else largest / objective.weights.min()
    spread = AGREE * size + ROUNDING * condition * (far + size)
    found = []
    if not np.abs(native.velocity - answer.velocity).max() <= spread:
        found.append(f"velocity {native.velocity} {answer.velocity}")
    for name in ("method", "status", "active"):
        told = getattr(native, name), getattr(answer, name)
        found += [f"{name} {told}"] if told[0] != told[1] else []
    if NUMBER.sub("#", native.reason) != NUMBER.sub("#", answer.reason):
        found.append(f"reason {native.reason!r} {answer.reason!r}")
    numbers = [np.array([float(n) for n in NUMBER.findall(solution.reason)]) for solution in (native, answer)]
    if len(numbers[0]) == len(numbers[1]) and not np.allclose(*numbers, rtol=0.06, atol=1e-9):  # two digits are told
        found.append(f"reason {native.reason!r} {answer.reason!r}")
    if not np.isclose(native.damping, answer.damping, rtol=1e-6, atol=0.0):
        found.append(f"damping {native.damping} {answer.damping}")
    if (native.multipliers is None) != (answer.multipliers is None):
        found.append(f"multipliers {native.multipliers} {answer.multipliers}")
    elif answer.multipliers is not None:
        gradient = AGREE * largest * far + largest * spread
        if not np.abs(native.multipliers - answer.multipliers).max() <= gradient:
            found.append(f"multipliers {native.multipliers} {answer.multipliers}")
    return found
