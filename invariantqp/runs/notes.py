"""What a person should know after a run, in sentences: damped and limited ticks, a pitch near a principal one."""

from __future__ import annotations

from collections.abc import Sequence

from invariantqp.errors import BlindSystem
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.systems.gram import principal_pitches
from invariantqp.velocity.forms import Form, PitchForm
from invariantqp.velocity.solution import VelocitySolution

# An h that comes this close to a principal pitch, relative to h, is worth a note.
NEAR_PITCH = 0.1
# States at which principal pitches are looked at: a path is smooth, and every tick would cost time.
PITCH_SAMPLES = 200


def notes(robot: Robot, form: Form | None, q: Array, solutions: Sequence[VelocitySolution]) -> list[str]:
    """Sentences about a run with joint positions q (n + 1, m), under a law with this form."""
    n = len(solutions)
    damped = sum(getattr(s, "damping", 0.0) > 0.0 for s in solutions)  # laws compared with ours need not say
    said = [f"{damped} of {n} ticks were damped, near a singularity or a principal pitch"] if damped else []
    for status in ("limited", "guarded", "scaled", "degraded", "held"):
        hits = [s for s in solutions if s.status == status]
        if hits:
            said.append(f"{len(hits)} of {n} ticks were {status}; the first: {hits[0].reason}")
    if isinstance(form, PitchForm) and len(robot.names) < 6:
        said += _about_pitches(robot, form.h, q)
    return said


def _about_pitches(robot: Robot, h: float, q: Array) -> list[str]:
    """Whether h works for this arm along the way."""
    pitches: list[float] = []
    for state in q[:: max(1, len(q) // PITCH_SAMPLES)]:
        try:
            pitches += principal_pitches(robot.jacobian(state)).tolist()
        except BlindSystem as blind:
            return [f"no pitch form sees all of this arm: {blind}"]
    nearest = min(pitches, key=lambda p: abs(p - h), default=None)
    if nearest is None or abs(nearest - h) > NEAR_PITCH * abs(h):
        return []
    return [f"h = {h:.4g} m comes near the principal pitch {nearest:.4g} m on this path"]
