import json

import pytest
from support.command_line import call

from invariantqp.workbench.pictures import inspection as pictured

FAR = "in the middle of the joint range"


def test_an_arm_in_words_numbers_and_a_picture(monkeypatch, capsys, tmp_path):
    numbers, picture = tmp_path / "a.json", tmp_path / "a.png"
    monkeypatch.setattr(pictured, "SWEEP", 13)  # lines of few points
    status, out, err = call(monkeypatch, capsys, "inspect", "so101", "--json", str(numbers), "--plot", str(picture))
    assert (status, err) == (0, "")
    for said in (
        "so101, 5 joints to gripper_frame_link",
        FAR,
        "64 states",
        "recommended: no form, and no pitch for splits",
    ):
        assert said in out
    assert "0 % of those with the last axis parallel to the first" in " ".join(out.split())
    found = json.loads(numbers.read_text(encoding="utf-8"))
    assert (found["rank"], found["gibson_hunt"], found["recommended"]["h"]) == (5, "h", None)
    assert len(found["recommended"]["unseen"]["q"]) == 5
    assert found["principal_pitches"] == [pytest.approx(0.0, abs=1e-12)]
    assert picture.stat().st_size > 20_000


def test_bodies_and_how_near_they_are(monkeypatch, capsys, tmp_path):
    numbers, picture = tmp_path / "a.json", tmp_path / "a.png"
    options = ["--clearance", "--q", "0,0,0,-1.5,0,1.8,0", "--json", str(numbers), "--plot", str(picture)]
    status, out, err = call(monkeypatch, capsys, "inspect", "panda", *options)
    assert (status, err) == (0, "")
    found = json.loads(numbers.read_text(encoding="utf-8"))["clearance"]
    one, other = found["nearest"]["bodies"]
    assert f"nearest where the arm is: {one} and {other}, {1e3 * found['nearest']['distance']:.1f} mm" in out
    assert "panda_link5: 1 x capsule" in out
    assert found["bodies"]["panda_link5"] == 1
    assert [one, other] in found["pairs"]
    assert picture.stat().st_size > 20_000


def test_an_arm_without_a_pitch(monkeypatch, capsys):
    status, out, _ = call(monkeypatch, capsys, "inspect", "scara", "--samples", "30")
    assert status == 0
    for said in ("No pitch h works", "(1, 0, 0)", "Complement(Z)", "30 states", "no pitch for splits", "At q = ("):
        assert said in " ".join(out.split())


@pytest.mark.parametrize("q", [["--q", "-0.1,1.2,-3e-1"], ["--q=-0.1,1.2,-0.3"], ["--q", "-0.1 1.2 -0.3"]])
def test_a_state_in_every_spelling(monkeypatch, capsys, q):
    status, out, _ = call(monkeypatch, capsys, "inspect", *q, "planar_3r")
    assert status == 0
    assert "at the joint positions given, q = (-0.1, 1.2, -0.3)" in out
    assert FAR not in out


def test_an_arm_with_every_pitch(monkeypatch, capsys):
    status, out, err = call(monkeypatch, capsys, "inspect", "panda")
    assert (status, err) == (0, "")
    assert "no form; for splits the pitch h = 1" in " ".join(out.split())
