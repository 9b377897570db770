"""What `invariantqp compare` refuses; what it measures is tested with the comparison."""

import pytest
from support.command_line import call

REFUSED = [
    ([""], "unknown task ''"),
    (["--arms", "zzz"], "unknown arm 'zzz'; known: panda, ur5e, so101, xarm7, random4"),
    (["arm_3r", "--arms", "panda"], "TASK: found --arms or --kinds too; expected TASK alone"),
    (["nobody"], "unknown task 'nobody'"),
    (["arm_3r", "--methods", "zzz"], "unknown method 'zzz'"),
    (["--kinds", "zzz"], "unknown kind 'zzz'; known: free, no feedforward,"),
    (
        ["pen_on_paper"],
        "TASK: found pen_on_paper, in contact; expected a task without this, which other methods do not have",
    ),
    (["ur5_elastic"], "TASK: found ur5_elastic, with elastic timing; expected"),
    (["--jobs", "-3"], "--jobs: found -3"),
    (["--jobs", "0"], "--jobs: found 0; expected a number of tasks at a time, or -1 for one a core"),
    (["--out", "{file}"], "--out: found {file}, a file; expected a folder"),
    (["--out", "{file}/below"], "--out: found {file}, a file; expected a folder"),
    (["--seed", "-1"], "--seed"),
]


@pytest.mark.parametrize(("words", "said"), REFUSED, ids=[" ".join(words) for words, _ in REFUSED])
def test_bad_input_is_one_message_and_status_2(monkeypatch, capsys, tmp_path, words, said):
    file = tmp_path / "file"
    file.write_text("no results", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    status, out, err = call(monkeypatch, capsys, "compare", *(word.format(file=file) for word in words))
    assert (status, out) == (2, "")
    assert said.format(file=file) in " ".join(err.split())
    assert "Traceback" not in err
    assert [one.name for one in tmp_path.iterdir()] == ["file"]  # nothing is made for work that is not begun
