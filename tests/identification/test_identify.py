"""Identification of simulated recordings with known contacts, and of wrong ones."""

import json
from functools import cache

import numpy as np
import pytest
from support.recordings import KINDS, NOISE, carried, errors, inverted, noisy, random_frame, record
from support.repeats import repeats

import invariantqp as iq
from invariantqp.contacts import identify
from invariantqp.errors import NoContactFound

TOUCHING = [kind for kind in KINDS if kind != "free"]
# Largest errors: degrees, millimetres, per cent.
MOST = {"normal": 0.5, "axis": 0.5, "edge": 0.5, "tip": 2.0, "place": 2.0, "centre": 2.0, "radius": 2.0, "pitch": 2.0}
SEED = 1000
KNOWN = ("point", "line", "face", "hinge")  # fewer kinds, to save time


@cache
def identified(kind):
    """A recording of five seconds, shared by several tests, and its identification."""
    X, w, truth = record(kind, SEED, duration=5.0)
    return X, w, truth, identify(X, w)


def named(found):
    return [(c.kind, c.fixed_to) for c in found.candidates]


@pytest.mark.parametrize("kind", TOUCHING)
def test_a_persons_motion_determines_kind_and_geometry(kind):
    X, _, truth, found = identified(kind)
    assert found.kind == truth.kind, found.reason
    assert found.fixed_to == truth.fixed_to
    off = errors(found, truth)
    assert {name: value for name, value in off.items() if not value < MOST[name]} == {}
    assert found.segments == (found,)
    assert found.start == 0 or found.stop == len(X)
    assert set(found.refuted) | {c.kind for c in found.candidates}
    pitches = {"hinge": 0.0, "slide": np.inf}
    assert found.pitch == pitches.get(kind, found.pitch)


@pytest.mark.cases(5)
@pytest.mark.parametrize("kind", TOUCHING)
def test_deviations_are_those_of_the_errors(kind):
    """The root mean square of error over deviation is near one: of two recordings below three."""
    ratios = []
    for seed in range(SEED, SEED + 2):
        X, w, truth = record(kind, seed, duration=5.0)
        found = identify(X, w, kinds=[truth.kind])
        best = next(c for c in found.candidates if c.fixed_to == truth.fixed_to)
        deviations, off = best.deviations, errors(best, truth)
        for name, value in off.items():
            key = {"tip": "point", "place": "point", "centre": "point", "edge": "axis"}.get(name, name)
            if kind in ("face", "line", "line on tool") and key == "point":
                continue  # where a face is pressed, and along an edge, is the mean of what was felt
            unit = np.rad2deg(1.0) if key in ("normal", "axis") else 1e3
            if key in ("radius", "pitch"):
                unit = 100.0 / abs(truth.radius or truth.pitch)
            ratios.append(value / (unit * deviations[key]))
    assert np.sqrt(np.mean(np.square(ratios))) < 3.0, ratios


@pytest.mark.cases(1)
@pytest.mark.parametrize("kind", ["point on tool", "line", "peg"])
def test_a_straight_stroke_without_rotation_leaves_the_kind_open(kind):
    X, w, truth = record(kind, SEED, "stroke", duration=5.0)
    found = identify(X, w)
    assert found.kind is None
    assert (truth.kind, truth.fixed_to) in named(found)
    assert len(found.candidates) > 1
    assert found.unexcited.shape[1] >= 1
    assert "neither moved along nor pushed against" in found.reason
    assert found.point is found.normal is found.axis is found.pitch is found.radius is found.fixed_to is None
    with pytest.raises(NoContactFound, match="does not determine"):
        found.contact(X[0])
    with pytest.raises(NoContactFound, match="does not determine"):
        found.task(5.0)
    if truth.kind == "point":
        assert found.candidates[-1].contact(X[0]).freedoms.shape == (6, 5)


def test_unexcited_twists_are_reported():
    """A peg that slides and never turns: the turn about its axis is the one twist that is not known."""
    X, w, truth = record("peg", SEED, "stroke", duration=5.0)
    found = identify(X, w)
    assert found.unexcited.shape == (6, 1)
    turn = iq.revolute(truth.base[:3, 2], truth.base[:3, 3])
    free = np.column_stack((turn, iq.se3.prismatic(truth.base[:3, 2])))
    t = found.unexcited[:, 0]
    rest = t - free @ np.linalg.lstsq(free, t, rcond=None)[0]
    assert np.linalg.norm(rest) < 0.02
    assert np.linalg.norm(t[:3]) > 0.5


@pytest.mark.parametrize("kind", TOUCHING)
def test_freedoms_and_constraints_are_those_of_the_truth(kind):
    X, _, _, found = identified(kind)
    contact = found.contact(X[50])
    assert np.abs(contact.constraints.T @ contact.freedoms).max() < 1e-9
    clean, _, _ = record(kind, SEED, duration=5.0, share=0.0)
    step = iq.se3.log(clean[51] @ iq.inverse(clean[50]))
    S = contact.freedoms
    size = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])[:, None] ** -1
    off = size * (step[:, None] - S @ np.linalg.lstsq(size * S, size[:, 0] * step, rcond=None)[0][:, None])
    assert np.linalg.norm(off) < 0.05 * np.linalg.norm(size[:, 0] * step)


@pytest.mark.cases(3)
@pytest.mark.parametrize("kind", TOUCHING[::2])
def test_frames_and_units_do_not_matter(kind):
    X, w, _, one = identified(kind)
    metre, newton, rng = 1e3, 0.2248, np.random.default_rng(3)
    A, B = random_frame(rng, 2.0), random_frame(rng, 0.5)
    Y, u = A @ X @ B, carried(inverted(B), w) * np.repeat([metre * newton, newton], 3)
    Y[:, :3, 3] *= metre
    two = identify(Y, u)
    assert (one.kind, named(one)) == (two.kind, named(two))
    assert two.best.misfit == pytest.approx(one.best.misfit, abs=1e-3)
    first, second = one.contact(X[7]), two.contact(Y[7])
    scale = np.repeat([1.0, metre], 3)[:, None]
    moved = scale * (iq.adjoint(A) @ first.freedoms)
    size = np.repeat([1.0, 1.0 / metre], 3)[:, None]
    off = size * (moved - second.freedoms @ np.linalg.lstsq(size * second.freedoms, size * moved, rcond=None)[0])
    assert np.abs(off).max() < 2e-4


def test_wrenches_on_the_tool_have_the_opposite_sign():
    X, w, _, usual = identified("point")
    felt = identify(X, -w, exerts=False)
    assert named(felt) == named(usual)
    np.testing.assert_array_equal(felt.normal, usual.normal)


def test_wrenches_by_name_and_readings_of_a_sensor():
    X, w, _, usual = identified("point")
    by_name = identify(X, [iq.Wrench(moment=a[:3], force=a[3:]) for a in w], kinds=KNOWN)
    np.testing.assert_array_equal(by_name.point, usual.point)
    mount = iq.exp([0.3, -0.2, 0.5, 0.05, 0.02, -0.1])
    sensor = iq.WrenchSensor(mount, order="force first", reads="reaction", mass=0.7, centre=[0.01, 0.02, 0.05])
    bare = iq.WrenchSensor(mount, order="force first", reads="reaction")
    loads = carried(inverted(mount), w)
    readings = np.array([sensor.tare(T) for T in X]) - loads[:, [3, 4, 5, 0, 1, 2]]
    found = identify(X, readings, sensor=sensor, kinds=KNOWN)
    assert np.linalg.norm(found.point - usual.point) < 1e-4
    with pytest.raises(NoContactFound):  # the weight is left among the readings: told wrong, not found wrong
        identify(X, readings, sensor=bare, kinds=KNOWN)


def test_a_wrong_sign_is_detected_by_friction():
    X, w, _ = record("point", SEED, duration=4.0)
    with pytest.raises(NoContactFound, match="sign"):
        identify(X, -w)


@pytest.mark.cases(2)
@pytest.mark.parametrize("is_given", [True, False])
@pytest.mark.parametrize("kind", ["point", "hinge"])
def test_smooth_errors_need_a_given_noise(kind, is_given):
    X, w, truth = record(kind, SEED, duration=5.0, smooth=0.2)
    if is_given:
        assert identify(X, w, noise=NOISE).kind == truth.kind
        assert identify(X, w, noise=tuple(np.diag(n**2) for n in NOISE)).kind == truth.kind
        return
    with pytest.raises(NoContactFound, match="pass noise= or accuracy=") as caught:
        identify(X, w, kinds=repeats(None, KNOWN))
    assert caught.value.misfit > 2.0
    assert caught.value.nearest


def test_accuracy_allows_for_an_imperfect_contact():
    X, w, _ = record("hinge", SEED, duration=5.0)
    rng = np.random.default_rng(0)
    X[:, :3, 3] += 3e-3 * np.sin(np.arange(len(X)) / 15.0)[:, None] * rng.normal(size=3)
    with pytest.raises(NoContactFound):
        identify(X, w, kinds=["hinge", "slide"])
    assert identify(X, w, accuracy=(2e-3, 3e-3)).kind == "hinge"


@pytest.mark.parametrize("kind", ["hinge", "ball"])
def test_compliance_does_not_bias_the_geometry(kind):
    """A millimetre of bending under 8 N: without a compliance a hinge is 0.4 mm off, a ball joint 1.7 mm."""
    X, w, truth = record(kind, SEED, duration=5.0)
    bent = np.array([T @ iq.exp(g) for T, g in zip(X, w * np.repeat([2e-3, 1e-4], 3), strict=True)])
    found = identify(bent, w, kinds=[kind], accuracy=(2e-3, 1e-3))
    assert errors(found, truth)["place" if kind == "hinge" else "centre"] < 0.1


def test_two_contacts_in_sequence_are_separated():
    (X, w, one), (Y, u, two) = record("hinge", SEED, duration=4.0), record("point", SEED, duration=4.0)
    air, nothing, _ = record("free", SEED, duration=1.0)
    found = identify(np.concatenate((X, air, Y)), np.concatenate((w, nothing, u)))
    assert found.kind is None
    assert found.candidates == ()
    assert "2 contacts" in found.reason
    first, second = found.segments
    assert (first.kind, second.kind) == ("hinge", "point")
    assert abs(first.stop - len(X)) < 15
    assert abs(second.start - len(X) - len(air)) < 15
    assert all(v < MOST[n] for part, truth in ((first, one), (second, two)) for n, v in errors(part, truth).items())


def test_a_face_turned_onto_its_edge_is_two_contacts():
    (X, w, _), (Y, u, _) = record("face", SEED, duration=4.0), record("line", SEED + 1, duration=4.0)
    found = identify(np.concatenate((X, X[-1] @ iq.inverse(Y[0]) @ Y)), np.concatenate((w, u)), kinds=KNOWN)
    assert [part.kind for part in found.segments] == ["face", "line"]
    assert abs(found.segments[0].stop - len(X)) < 15


def test_the_same_contact_again_is_one():
    X, w, truth = record("point", SEED, duration=6.0)
    air, nothing, _ = record("free", SEED, duration=1.0)
    found = identify(np.concatenate((X[:300], air, X[300:])), np.concatenate((w[:300], nothing, w[300:])))
    assert found.kind == "point"
    assert errors(found, truth)["tip"] < MOST["tip"]
    assert (found.start, found.stop) == (0, 700)
    few = 60  # a part that alone leaves the kind open
    assert identify(X[:few], w[:few]).kind is None
    found = identify(np.concatenate((X[:few], air, X)), np.concatenate((w[:few], nothing, w)))
    assert (found.kind, len(found.segments)) == (truth.kind, 1)


def test_a_tool_in_the_air_has_no_contact():
    X, w, _ = record("free", SEED, duration=4.0)
    with pytest.raises(NoContactFound, match="nothing is touched"):
        identify(X, w)


@cache
def hostile():
    X, w, _ = record("point", SEED, duration=1.2)
    rng = np.random.default_rng(1)
    n = len(X)
    still = np.tile(X[:1], (n, 1, 1))
    drift = w + np.linspace(0.0, 1.0, n)[:, None] * np.repeat([0.3, 6.0], 3) * rng.normal(size=6)
    lost = w.copy()
    lost[n // 2 :] = rng.normal(size=(n - n // 2, 6)) * NOISE[1]
    hover = X.copy()
    hover[n // 2 :, 2, 3] += 0.05
    fast = np.sort(rng.choice(n, n // 2, replace=False))
    force = -5.0 * X[:, 2, :3]
    weight = w + np.concatenate((np.cross([0.0, 0.0, 0.05], force), force), axis=1)
    return {
        "a still tool": (*noisy(rng, still, w, 1.0),),
        "a drifting bias": (X, drift),
        "contact lost in the middle": (hover, lost),
        "samples left out": (X[fast], w[fast]),
        "its weight among the wrenches": (X, weight),
        "poses inverted": (inverted(X), w),
        "wrenches in the base frame": (X, carried(X, w)),
        "forces first": (X, w[:, [3, 4, 5, 0, 1, 2]]),
        "noise alone": (X, rng.normal(size=w.shape) * 3.0),
    }


@pytest.mark.parametrize("case", hostile())
def test_a_wrong_recording_never_gives_a_wrong_kind_alone(case):
    poses, wrenches = hostile()[case]
    try:
        found = identify(poses, wrenches, kinds=repeats(None, KNOWN))
    except NoContactFound:
        return
    for part in found.segments:
        wrong = part.kind is not None and len(part.candidates) == 1 and part.candidates[0].kind != "point"
        assert not wrong, (case, part.kind)
    if case == "a still tool":
        assert found.kind is None


X, W, _ = record("point", SEED, duration=1.0)
NAN = X.copy()
NAN[7, 0, 3] = np.nan
SHEARED = X.copy()
SHEARED[3, 0, 0] += 0.1
NAN_WRENCH = W.copy()
NAN_WRENCH[9, 2] = np.inf
QUIET = np.tile(np.eye(4), (100, 1, 1))
REFUSED = [
    ((NAN, W), {}, "poses: found NaN or infinity in sample 7"),
    ((SHEARED, W), {}, r"poses\[3\]: found an upper-left block that is not a rotation"),
    ((X, NAN_WRENCH), {}, r"wrenches\[9\]"),
    ((X[:5], W[:5]), {}, "poses: found 5 samples; expected 30"),
    ((X, W[:-1]), {}, "wrenches: found 99; expected 100"),
    ((X, W[:, :5]), {}, r"wrenches\[0\]"),
    ((X[:, :3], W), {}, "poses: found shape"),
    ((X, W), {"kinds": ["door"]}, "kinds: found 'door'"),
    ((X, W), {"kinds": "hinge"}, "kinds: found 'hinge'"),
    ((X, W), {"kinds": []}, "kinds: found none"),
    ((X, W), {"noise": (1.0,)}, "noise: found"),
    ((X, W), {"noise": (np.zeros(6), np.ones(6))}, r"noise\[0\]: found smallest eigenvalue 0"),
    ((X, W), {"accuracy": (1e-3,)}, "accuracy: found"),
    ((X, W), {"accuracy": (1e-3, 0.0)}, "accuracy: found"),
    ((X, W), {"exerts": "yes"}, "exerts: found 'yes'"),
    ((X, W), {"sensor": 3}, "sensor: found 3"),
    ((QUIET, W), {}, "poses: found no noise in some direction"),
    ((X, np.ones((100, 6))), {}, "wrenches: found no noise in some direction"),
]


@pytest.mark.parametrize(("given", "options", "said"), REFUSED, ids=[said[:40] for _, _, said in REFUSED])
def test_invalid_arguments_are_named(given, options, said):
    with pytest.raises(iq.BadInput, match=said):
        identify(*given, **options)


def test_a_short_contact_is_refused():
    X, w, _ = record("free", SEED, duration=4.0)
    w[100:120, 5] += 20.0
    with pytest.raises(iq.BadInput, match=r"samples in contact; expected 30"):
        identify(X, w)


@pytest.mark.parametrize("kind", TOUCHING)
def test_a_candidate_makes_a_task(kind):
    X, w, _, found = identified(kind)
    best = found.best
    press = 5.0 if best.contact_kind.presses else 0.0
    task = best.task(press, max_force=30.0)
    assert isinstance(task, iq.HybridTask)
    assert task.max_force == 30.0
    contact = task.contact_at(X[20])
    assert contact.kind == best.contact_kind
    if best.contact_kind.presses:  # z is the way that the tool pressed
        pushed = np.mean([T[:3, :3] @ a[3:] @ task.contact_at(T).pose[:3, 2] for T, a in zip(X, w, strict=True)])
        assert pushed > 1.0
    else:
        with pytest.raises(iq.BadInput, match="holds both ways"):
            best.task(5.0)


def test_a_ball_joint_transmits_every_force():
    contact = iq.contacts.ball_joint([0.1, 0.2, 0.3])
    turns = np.column_stack([iq.revolute(a, [0.1, 0.2, 0.3]) for a in np.eye(3)])
    assert np.linalg.matrix_rank(np.column_stack((contact.freedoms, turns))) == 3
    assert contact.kind.presses == 0
    np.testing.assert_allclose(contact.point, [0.1, 0.2, 0.3])


def test_an_identification_is_written_as_json():
    said = json.loads(json.dumps(identified("hinge")[-1].as_json()))
    assert said["kind"] == "hinge"
    assert said["contacts"][0]["candidates"][0]["deviations"]["axis"] < 1e-2


def test_a_short_unexplained_contact_does_not_hide_another():
    X, w, truth = record("point", SEED, duration=2.0)
    air = record("free", SEED, duration=1.0)
    rng = np.random.default_rng(0)
    for samples, is_short in ((45, True), (150, False)):
        off = X[:samples].copy()
        off[:, :3, 3] += 0.02 * np.cumsum(rng.normal(size=(samples, 3)), axis=0) / np.sqrt(samples)  # on nothing flat
        Y, u = np.concatenate((off, air[0], X)), np.concatenate((w[:samples], air[1], w))
        if not is_short:
            with pytest.raises(NoContactFound):
                identify(Y, u, kinds=KNOWN)
            continue
        found = identify(Y, u, kinds=KNOWN)
        assert found.kind == truth.kind
        assert found.start > samples
