"""Reasons as data: one table of sentences, the worst first, the same from both engines and after every journey."""

import copy
import pickle
from array import array

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.velocity import Code, Reason, reasons
from invariantqp.velocity.solution import VelocitySolution, with_trouble

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
    "as delay=), a gain too high for the robot, or a robot that does not do what it is told"
)
STATES_ARE_OLD = (
    "the measured joint positions change once in 33 ticks (33 ms; dt is 1 ms), too rarely for this gain: read them "
    "more often, or run the loop with dt= their period"
)
DT_IS_WRONG = (
    "the joints moved 33.3 times as far as commanded, as in ticks of 33.3 ms; dt is 1 ms: check that dt= is the "
    "period of the loop, and that the driver does not scale velocities"
)
# Every code, with joints, rows, numbers and words as they come, and its sentence.
TABLE = {
    Code.NOT_BELIEVED: (Reason(Code.NOT_BELIEVED, (2,), (), (57.296, 54.16), names=("elbow",)), DEGREES),
    Code.TOLD: (Reason(Code.TOLD, words="the door is open"), "the door is open"),
    Code.STOPPED: (Reason(Code.STOPPED), "speed is 0"),
    Code.ROWS_REFUSED: (Reason(Code.ROWS_REFUSED, rows=("wall",), words="q: found NaN"), "wall: q: found NaN"),
    Code.ROWS_ARE_NAN: (Reason(Code.ROWS_ARE_NAN, rows=("wall",)), "wall gives NaN here"),
    Code.ROWS_ALLOW_NOTHING: (Reason(Code.ROWS_ALLOW_NOTHING, rows=("wall",)), "wall allows no velocity at all here"),
    Code.NO_VELOCITY: (Reason(Code.NO_VELOCITY, words="daqp: exit flag -1"), "no velocity found: daqp: exit flag -1"),
    Code.NO_NUMBERS: (
        Reason(Code.NO_NUMBERS, words="overflow"),
        "the numbers are too large or too small to compute with: overflow",
    ),
    Code.MOVING_BACK: (Reason(Code.MOVING_BACK), "moving back inside the limits"),
    Code.NO_MOTION: (Reason(Code.NO_MOTION, (0, 1, 2, 4), names=("base", "shoulder", "elbow", "wrist")), NO_MOTION),
    Code.STATES_ARE_OLD: (Reason(Code.STATES_ARE_OLD, numbers=(33.0, 33.0, 1.0)), STATES_ARE_OLD),
    Code.DT_IS_WRONG: (Reason(Code.DT_IS_WRONG, numbers=(33.333, 33.333, 1.0)), DT_IS_WRONG),
    Code.NOT_FOLLOWING: (Reason(Code.NOT_FOLLOWING, (2,), names=("elbow",)), DELAY),
    Code.OUTSIDE: (
        Reason(Code.OUTSIDE, (2,), (), (0.1,), names=("elbow",)),
        "joint 2 (elbow): 0.1 outside its position range",
    ),
    Code.ACCELERATION: (
        Reason(Code.ACCELERATION, (2,), (), (12.345, 8.0), names=("elbow",)),
        "joint 2 (elbow): acceleration 12.3, above its limit 8",
    ),
    Code.ROWS_CONTRADICT: (
        Reason(Code.ROWS_CONTRADICT, (0, 3), ("wall", "row 3"), (0.5, -0.25)),
        "rows contradict the bounds of joints 0, 3: exceeded at wall by 0.5, row 3 by 0.25",
    ),
    Code.TOOL_FASTER: (
        Reason(Code.TOOL_FASTER, numbers=(0.3, 0.25)),
        "the tool's speed is 0.3, not 0.25: other limits require it",
    ),
    Code.ROWS_UNKEPT: (
        Reason(Code.ROWS_UNKEPT, numbers=(0.0123,)),
        "the joints cannot keep the direction of the exact rows: 1.2e-02 of the demand is unmet",
    ),
    Code.STUCK: (
        Reason(Code.STUCK),
        "no velocity reduces the error: it is the least that these joints and limits allow",
    ),
    Code.ROWS_SLOWED: (Reason(Code.ROWS_SLOWED, numbers=(0.5,)), "limits allow 0.5 of the exact rows' speed"),
    Code.ROWS_MOVED: (
        Reason(Code.ROWS_MOVED, rows=("exact row 0", "exact row 2"), numbers=(0.1, 0.02)),
        "limits require motion beside the exact rows: exact row 0 is off by 0.1, exact row 2 is off by 0.02",
    ),
    Code.CHASE_SLOWED: (Reason(Code.CHASE_SLOWED, numbers=(0.2468,)), "limits allow 0.247 of the approach's speed"),
    Code.GUARDED: (Reason(Code.GUARDED, numbers=(0.25,)), "descent guard: 0.25 of least squares blended in"),
    Code.FEW_JOINTS: (
        Reason(Code.FEW_JOINTS, numbers=(4.0, 0.2)),
        "fewer than six joints (4) can achieve 20% of this twist",
    ),
    Code.POSITION_ALONE: (
        Reason(Code.POSITION_ALONE),
        'exact="position" (in solve_velocity, ExactRows) keeps the velocity of the tool point',
    ),
    Code.MISSED: (Reason(Code.MISSED, numbers=(0.0678,)), "7% of the twist is missed"),
    Code.MOVED: (Reason(Code.MOVED), "limits move the tool where nothing is to move"),
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
    assert str(Reason(Code.NO_NUMBERS)) == "the numbers are too large or too small to compute with"
    assert str(Reason(Code.ROWS_SLOWED, numbers=(0.5,))) == "limits allow 0.5 of the exact rows' speed"
    contradiction = Reason(Code.ROWS_CONTRADICT, rows=("row 0", "row 1"), numbers=(1.0, 2.0))
    assert str(contradiction) == "rows contradict each other: exceeded at row 0 by 1, row 1 by 2"
    assert reasons.sentences(()) == ""
    assert reasons.sentences([Reason(Code.TOLD), Reason(Code.STUCK)]) == str(Reason(Code.STUCK))


def test_a_crowd_of_rows_is_counted():
    rows = [f"hand and post {i}" for i in range(17)]
    assert reasons.named((3,), rows) == (
        "joint 3 and hand and post 0 and hand and post 1 and hand and post 2 and 14 more"
    )
    assert reasons.named((), ["hand and post", "hand and post", "row 2"]) == "hand and post and row 2"
    crowd = Reason(Code.ROWS_CONTRADICT, rows=tuple(rows), numbers=tuple(range(17, 0, -1)))
    assert str(crowd).endswith(
        "exceeded at hand and post 0 by 17, hand and post 1 by 16, hand and post 2 by 15, 14 more"
    )


def test_what_the_core_writes_is_read():
    numbers = [Code.AT_LIMITS, 2, 3, 0, 1, 4, -1, 2, 0, Code.ROWS_MOVED, 0, 1, 1, -4, 0.25, Code.STUCK, 0, 0, 0]
    found = reasons.read(array("d", numbers).tobytes(), ("wall", "", ""))
    assert found == (
        Reason(Code.AT_LIMITS, (1, 4), ("the tool's speed", "row 2", "wall")),
        Reason(Code.ROWS_MOVED, rows=("exact row 2",), numbers=(0.25,)),
        Reason(Code.STUCK),
    )
    assert reasons.read(b"") == ()


def solution(why, **more):
    return VelocitySolution(np.zeros(2), "qp", iq.Status.OK, why, (), np.zeros(6), 1.0, 0.0, 0.0, "", **more)


WRITTEN = array("d", [Code.CHASE_SLOWED, 0, 0, 1, 0.5, Code.AT_LIMITS, 0, 1, 0, 1]).tobytes()
READ = (Reason(Code.CHASE_SLOWED, numbers=(0.5,)), Reason(Code.AT_LIMITS, rows=("wall",)))


@pytest.mark.parametrize(
    "journey", [lambda s: s, copy.copy, copy.deepcopy, lambda s: pickle.loads(pickle.dumps(s)), lambda s: s._replace()]
)
@pytest.mark.parametrize("why", [WRITTEN, READ])
def test_a_solution_has_the_same_reasons_however_it_was_made(journey, why):
    names = ("", "wall")
    found = journey(solution(why, row_names=names))
    assert found.reasons == READ
    assert found.reason == "limits allow 0.5 of the approach's speed; at the limits of wall"
    assert found == solution(READ, row_names=names)
    assert hash(found) == hash(solution(READ, row_names=names))
    assert found != solution(READ[:1], row_names=names)
    assert "CHASE_SLOWED" in repr(found)


def test_a_text_is_a_reason_too():
    found = solution("the door is open")
    assert found.reasons == (Reason(Code.TOLD, words="the door is open"),)
    assert found.reason == "the door is open"
    assert solution("").reasons == ()
    worse = with_trouble(found, (Reason(Code.NOT_FOLLOWING),))
    assert [r.code for r in worse.reasons] == [Code.NOT_FOLLOWING, Code.TOLD]
    assert worse.status == "degraded"
    assert with_trouble(found, "no pose").reason == "no pose; the door is open"
    assert found._replace(reasons=READ).reasons == READ


def test_joints_have_the_names_that_a_solution_is_given():
    written = array("d", [Code.AT_LIMITS, 2, 0, 0, 0, 1]).tobytes()
    for why in (written, (Reason(Code.AT_LIMITS, (0, 1)),)):
        assert solution(why).reason == "at the limits of joints 0, 1"
        found = solution(why, joint_names=("base", "elbow"))
        assert found.reason == "at the limits of joints 0 (base), 1 (elbow)"
        assert [r.names for r in found.reasons] == [("base", "elbow")]
