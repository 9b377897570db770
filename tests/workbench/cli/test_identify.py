"""`invariantqp identify`: a table, numbers, a page, and arguments that are wrong."""

import json
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.command_line import call
from support.recordings import record
from support.views import read


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    for kind, style in (("point", "human"), ("hinge", "human"), ("sphere", "human"), ("peg", "stroke")):
        X, w, _ = record(kind, 3, style, duration=4.0)
        q = Rotation.from_matrix(X[:, :3, :3]).as_quat()
        rows = np.column_stack((np.arange(len(X)) / 100.0, X[:, :3, 3], q, -w[:, 3:], -w[:, :3]))
        header = "time,x,y,z,qx,qy,qz,qw,fx,fy,fz,mx,my,mz"
        np.savetxt(folder / f"{kind}.csv", rows, delimiter=",", header=header, comments="", fmt="%.9g")
    return folder


@pytest.mark.cases(1)
@pytest.mark.parametrize("kind", ["hinge", "point", "sphere"])
def test_a_contact_in_words_numbers_and_on_a_page(monkeypatch, capsys, recordings, tmp_path, kind):
    numbers, page = tmp_path / "a.json", tmp_path / "a.html"
    words = ["identify", recordings / f"{kind}.csv", "--reads", "reaction", "--json", numbers, "--view", page]
    status, out, err = call(monkeypatch, capsys, *words)
    assert (status, err) == (0, "")
    assert f"{kind}.csv, 0.00 to 3.99 s: {kind}" in out
    assert json.loads(numbers.read_text(encoding="utf-8"))["kind"] == kind
    drawn = json.loads(read(page.read_text(encoding="utf-8")).scripts[0])
    assert drawn["recorded"]
    assert drawn["status"][5] == kind
    faces = drawn["arrays"]["faces"]["shape"][0]
    assert (faces > 0) == (kind != "hinge")
    assert (drawn["axis"] is not None) == (kind == "hinge")


def test_what_is_left_open_is_said(monkeypatch, capsys, recordings):
    status, out, _ = call(monkeypatch, capsys, "identify", recordings / "peg.csv", "--reads", "reaction")
    said = " ".join(out.split())
    assert status == 0
    assert "undecided" in said
    assert "never tried: a turn about" in said
    assert re.search(r"\bslide\b.*\bpeg\b", said)


REFUSED = [
    ([], "--reads"),
    (["--reads", "force"], "reads: found 'force'; expected 'reaction' or 'action'"),
    (["--reads", "reaction", "--tool", "tip"], "--tool: found no --robot beside it"),
    (["--reads", "reaction", "--mount", "1,2"], "--mount: found '1,2'"),
    (["--reads", "reaction", "--mount", "0,0,0,1,1,0,0"], "a quaternion of length 1.414"),
    (["--reads", "reaction", "--accuracy", "1"], "--accuracy: found 1; expected two numbers"),
    (["--reads", "reaction", "--kind", "door"], "kinds: found 'door'"),
    (["--reads", "reaction", "--robot", "nobody"], "unknown robot 'nobody'"),
    (["--reads", "reaction", "--view", "a.png"], "with the ending '.png'"),
    (["--reads", "reaction", "--centre", "1,2"], "centre: found shape"),
    (["--reads", "action", "--kind", "point"], "is the sign of the wrenches right?"),
]


@pytest.mark.parametrize(("words", "said"), REFUSED, ids=[said[:40] for _, said in REFUSED])
def test_wrong_arguments_are_refused_by_name(monkeypatch, capsys, recordings, words, said):
    status, out, err = call(monkeypatch, capsys, "identify", recordings / "point.csv", *words)
    assert status == 2
    assert out == ""
    assert said in " ".join(err.split())


def test_what_is_not_read_of_a_file_is_said(monkeypatch, capsys, recordings, tmp_path):
    lines = (recordings / "point.csv").read_text(encoding="utf-8").splitlines()
    file = tmp_path / "point.csv"
    file.write_text("\n".join([f"{lines[0]},gripper", *(f"{line},0.5" for line in lines[1:])]), encoding="utf-8")
    status, out, err = call(monkeypatch, capsys, "identify", file, "--reads", "reaction", "--kind", "point")
    assert (status, err) == (0, "note: not used: gripper\n")
    assert ": point" in out


def test_a_single_sample_is_too_few(monkeypatch, capsys, recordings, tmp_path):
    lines = (recordings / "point.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "one.csv").write_text("\n".join(lines[:2]), encoding="utf-8")
    status, _, err = call(monkeypatch, capsys, "identify", tmp_path / "one.csv", "--reads", "reaction")
    assert status == 2
    assert "1 samples; expected 30 or more" in " ".join(err.split())
    assert "empty slice" not in err


def test_a_file_that_is_none_is_refused(monkeypatch, capsys):
    status, _, err = call(monkeypatch, capsys, "identify", "nowhere.csv", "--reads", "reaction")
    assert status == 2
    assert "nowhere.csv" in err
