"""Reasons: every code has its sentence; encoded, decoded and copied reasons are the same."""

import copy
import pickle
from array import array

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.velocity import Code, Reason, reasons
from invariantqp.velocity.solution import VelocitySolution, degraded

DEGREES = (
    'joint 2 (elbow): 57.3 rad is 54.16 outside its position range; are these degrees? Give far_outside="return" to '
    "move back from there"
)
NO_MOTION = (
    "no motion measured of joints 0 (base), 1 (shoulder), 2 (elbow) and 1 more although it is commanded: the robot is "
    "stopped, paused or blocked, or its joint states are old; the motion starts from rest when the robot moves again"
)
DELAY = (
    "not converging: the joints do not follow their commands, joint 2 (elbow) least; the cause may be a delay (give it "
    "as delay=), a gain too high for the robot, or a robot that does not execute its commands"
)
STALE = (
    "the measured joint positions change once in 33 ticks (33 ms; dt is 1 ms), too rarely for this gain: read them "
    "more often, or run the loop with dt= their period"
)
PERIOD = (
    "the joints moved 33.3 times as far as commanded, as in ticks of 33.3 ms; dt is 1 ms: check that dt= is the "
    "period of the loop, and that the driver does not scale velocities"
)
# Every code, with joints, rows, numbers and words as they come, and its sentence.
TABLE = {
    Code.IMPLAUSIBLE_POSITION: (
        Reason(Code.IMPLAUSIBLE_POSITION, (2,), (), (57.296, 54.16), names=("elbow",)),
        DEGREES,
    ),
    Code.TEXT: (Reason(Code.TEXT, words="the door is open"), "the door is open"),
    Code.SPEED_ZERO: (Reason(Code.SPEED_ZERO), "speed is 0"),
    Code.LIMIT_FAILED: (Reason(Code.LIMIT_FAILED, rows=("wall",), words="q: found NaN"), "wall: q: found NaN"),
    Code.LIMIT_NAN: (Reason(Code.LIMIT_NAN, rows=("wall",)), "wall gives NaN here"),
    Code.LIMIT_INFEASIBLE: (Reason(Code.LIMIT_INFEASIBLE, rows=("wall",)), "wall allows no velocity at all here"),
    Code.NO_SOLUTION: (Reason(Code.NO_SOLUTION, words="daqp: exit flag -1"), "no velocity found: daqp: exit flag -1"),
    Code.NUMERICAL_FAILURE: (
        Reason(Code.NUMERICAL_FAILURE, words="overflow"),
        "the numbers are too large or too small to compute with: overflow",
    ),
    Code.MOVING_BACK: (Reason(Code.MOVING_BACK), "moving back inside the limits"),
    Code.NO_MOTION: (Reason(Code.NO_MOTION, (0, 1, 2, 4), names=("base", "shoulder", "elbow", "wrist")), NO_MOTION),
    Code.STALE_JOINT_STATES: (Reason(Code.STALE_JOINT_STATES, numbers=(33.0, 33.0, 1.0)), STALE),
    Code.WRONG_DT: (Reason(Code.WRONG_DT, numbers=(33.333, 33.333, 1.0)), PERIOD),
    Code.NOT_FOLLOWING: (Reason(Code.NOT_FOLLOWING, (2,), names=("elbow",)), DELAY),
    Code.OUTSIDE_POSITION_LIMITS: (
        Reason(Code.OUTSIDE_POSITION_LIMITS, (2,), (), (0.1,), names=("elbow",)),
        "joint 2 (elbow): 0.1 outside its position range",
    ),
    Code.ACCELERATION_EXCEEDED: (
        Reason(Code.ACCELERATION_EXCEEDED, (2,), (), (12.345, 8.0), names=("elbow",)),
        "joint 2 (elbow): acceleration 12.3, above its limit 8",
    ),
    Code.LIMITS_CONFLICT: (
        Reason(Code.LIMITS_CONFLICT, (0, 3), ("wall", "row 3"), (0.5, -0.25)),
        "limit rows conflict with the bounds of joints 0, 3: exceeded at wall by 0.5, row 3 by 0.25",
    ),
    Code.TOOL_SPEED_EXCEEDED: (
        Reason(Code.TOOL_SPEED_EXCEEDED, numbers=(0.3, 0.25)),
        "the tool's speed is 0.3, not 0.25: other limits require it",
    ),
    Code.EXACT_ROWS_INCONSISTENT: (
        Reason(Code.EXACT_ROWS_INCONSISTENT, numbers=(0.0123,)),
        "the joints cannot keep the direction of the exact rows: 1.2e-02 of the demand is unmet",
    ),
    Code.NO_PROGRESS: (
        Reason(Code.NO_PROGRESS),
        "no velocity reduces the error: it is the least that these joints and limits allow",
    ),
    Code.EXACT_ROWS_SCALED: (
        Reason(Code.EXACT_ROWS_SCALED, numbers=(0.5,)),
        "limits allow 0.5 of the exact rows' speed",
    ),
    Code.EXACT_ROWS_VIOLATED: (
        Reason(Code.EXACT_ROWS_VIOLATED, rows=("exact row 0", "exact row 2"), numbers=(0.1, 0.02)),
        "limits violate the exact rows: exact row 0 is off by 0.1, exact row 2 is off by 0.02",
    ),
    Code.APPROACH_SCALED: (
        Reason(Code.APPROACH_SCALED, numbers=(0.2468,)),
        "limits allow 0.247 of the approach's speed",
    ),
    Code.GUARDED: (Reason(Code.GUARDED, numbers=(0.25,)), "descent guard: 0.25 of least squares blended in"),
    Code.FEW_JOINTS: (
        Reason(Code.FEW_JOINTS, numbers=(4.0, 0.2)),
        "fewer than six joints (4) can achieve 20% of this twist",
    ),
    Code.POSITION_ONLY: (
        Reason(Code.POSITION_ONLY),
        'exact="position" (in solve_velocity, ExactRows) keeps the velocity of the tool point',
    ),
    Code.TWIST_MISSED: (Reason(Code.TWIST_MISSED, numbers=(0.0678,)), "7% of the twist is missed"),
    Code.MOVED_BY_LIMITS: (Reason(Code.MOVED_BY_LIMITS), "limits force a motion although the commanded twist is zero"),
    Code.AT_LIMITS: (
        Reason(Code.AT_LIMITS, (0, 2), ("wall", "row 1", "row 4"), names=("base", "elbow")),
        "at the limits of joints 0 (base), 2 (elbow) and rows 1, 4 and wall",
    ),
}


@pytest.mark.parametrize("code", Code)
def test_every_code_has_its_sentence(code):
    reason, sentence = TABLE[code]
    assert reason.code is code
    assert str(reason) == sentence


def test_sentences_without_what_may_be_missing():
    assert str(Reason(Code.NUMERICAL_FAILURE)) == "the numbers are too large or too small to compute with"
    assert str(Reason(Code.EXACT_ROWS_SCALED, numbers=(0.5,))) == "limits allow 0.5 of the exact rows' speed"
    contradiction = Reason(Code.LIMITS_CONFLICT, rows=("row 0", "row 1"), numbers=(1.0, 2.0))
    assert str(contradiction) == "limit rows conflict with each other: exceeded at row 0 by 1, row 1 by 2"
    assert reasons.sentences(()) == ""
    assert reasons.sentences([Reason(Code.TEXT), Reason(Code.NO_PROGRESS)]) == str(Reason(Code.NO_PROGRESS))


def test_further_rows_are_counted():
    rows = [f"hand and post {i}" for i in range(17)]
    assert reasons.named((3,), rows) == (
        "joint 3 and hand and post 0 and hand and post 1 and hand and post 2 and 14 more"
    )
    assert reasons.named((), ["hand and post", "hand and post", "row 2"]) == "hand and post and row 2"
    many = Reason(Code.LIMITS_CONFLICT, rows=tuple(rows), numbers=tuple(range(17, 0, -1)))
    assert str(many).endswith(
        "exceeded at hand and post 0 by 17, hand and post 1 by 16, hand and post 2 by 15, 14 more"
    )


def test_reasons_of_the_engine_are_decoded():
    numbers = [Code.AT_LIMITS, 2, 3, 0, 1, 4, -1, 2, 0]
    numbers += [Code.EXACT_ROWS_VIOLATED, 0, 1, 1, -4, 0.25]
    numbers += [Code.NO_PROGRESS, 0, 0, 0]
    found = reasons.decoded(array("d", numbers).tobytes(), ("wall", "", ""))
    assert found == (
        Reason(Code.AT_LIMITS, (1, 4), ("the tool's speed", "row 2", "wall")),
        Reason(Code.EXACT_ROWS_VIOLATED, rows=("exact row 2",), numbers=(0.25,)),
        Reason(Code.NO_PROGRESS),
    )
    assert reasons.decoded(b"") == ()


def solution(why, **more):
    return VelocitySolution(np.zeros(2), "qp", iq.Status.OK, why, (), np.zeros(6), 1.0, 0.0, 0.0, "", **more)


ENCODED = array("d", [Code.APPROACH_SCALED, 0, 0, 1, 0.5, Code.AT_LIMITS, 0, 1, 0, 1]).tobytes()
DECODED = (Reason(Code.APPROACH_SCALED, numbers=(0.5,)), Reason(Code.AT_LIMITS, rows=("wall",)))


@pytest.mark.parametrize(
    "copied", [lambda s: s, copy.copy, copy.deepcopy, lambda s: pickle.loads(pickle.dumps(s)), lambda s: s._replace()]
)
@pytest.mark.parametrize("why", [ENCODED, DECODED])
def test_copies_of_a_solution_have_its_reasons(copied, why):
    names = ("", "wall")
    found = copied(solution(why, row_names=names))
    assert found.reasons == DECODED
    assert found.reason == "limits allow 0.5 of the approach's speed; at the limits of wall"
    assert found == solution(DECODED, row_names=names)
    assert hash(found) == hash(solution(DECODED, row_names=names))
    assert found != solution(DECODED[:1], row_names=names)
    assert not found != solution(DECODED, row_names=names)  # noqa: SIM202 (a tuple has a != of its own)
    assert found != tuple(found)
    assert "APPROACH_SCALED" in repr(found)


def test_a_text_becomes_a_reason():
    found = solution("the door is open")
    assert found.reasons == (Reason(Code.TEXT, words="the door is open"),)
    assert found.reason == "the door is open"
    assert solution("").reasons == ()
    worse = degraded(found, (Reason(Code.NOT_FOLLOWING),))
    assert [r.code for r in worse.reasons] == [Code.NOT_FOLLOWING, Code.TEXT]
    assert worse.status == "degraded"
    assert degraded(found, "no pose").reason == "no pose; the door is open"
    assert found._replace(reasons=DECODED).reasons == DECODED


def test_joints_have_the_names_that_a_solution_is_given():
    encoded = array("d", [Code.AT_LIMITS, 2, 0, 0, 0, 1]).tobytes()
    for why in (encoded, (Reason(Code.AT_LIMITS, (0, 1)),)):
        assert solution(why).reason == "at the limits of joints 0, 1"
        found = solution(why, joint_names=("base", "elbow"))
        assert found.reason == "at the limits of joints 0 (base), 1 (elbow)"
        assert [r.names for r in found.reasons] == [("base", "elbow")]
