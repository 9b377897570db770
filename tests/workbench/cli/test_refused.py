"""What `invariantqp` refuses: status 2 and one message. Messages of task files are tested with the task files."""

import pytest
from support.command_line import call

REFUSED = [
    (["rnu", "arm_3r"], "No such command"),
    (["run"], "Missing argument"),
    (["run", "panda_pth"], "unknown task 'panda_pth'"),
    (["run", "{typo}"], "$.law.gian: extra inputs are not permitted (did you mean 'gain'?)"),
    (["run", "arm_3r", "--backend", "dapq"], "unknown QP back end 'dapq'; did you mean daqp"),
    (["run", "arm_3r", "--physics", "bullet"], "physics: found 'bullet'"),
    (["run", "arm_3r", "--json", "no/f.json"], "a folder that does not exist"),
    (["run", "arm_3r", "--json", "."], ", a folder; expected the name of a file"),
    (["run", "arm_3r", "--plot", "f.xyz"], "f.xyz, with the ending '.xyz'; expected one of .png, .svg, .pdf"),
    (["run", "arm_3r", "--plot", "plot"], "with the ending ''; expected one of"),
    (["run", "arm_3r", "--view", "seen.gif"], "seen.gif, with the ending '.gif'; expected one of .html"),
    (["run", "arm_3r", "--view", "{folder}"], "folder.html, a folder; expected the name of a file"),
    (["run", "arm_3r", "--view", "no/seen.html"], "a folder that does not exist"),
    (["run", "arm_3r", "--jsn", "f"], "No such option"),
    (["run", "arm_3r", "--check-frame", "--seed", "-1"], "--seed"),
    (["run", "arm_3r", "--seed", "0"], "--seed: found no --check-frame beside it"),
    (["run", "arm_3r", "--check-frame", "--quiet"], "--check-frame: found --quiet too"),
    (["compare", ""], "unknown task ''"),
    (["compare", "--arms", "zzz"], "unknown arm 'zzz'; known: panda, ur5e, so101, xarm7, random4"),
    (["compare", "arm_3r", "--arms", "panda"], "TASK: found --arms or --kinds too; expected TASK alone"),
    (["compare", "nobody"], "unknown task 'nobody'"),
    (["compare", "arm_3r", "--methods", "zzz"], "unknown method 'zzz'"),
    (["compare", "--kinds", "zzz"], "unknown kind 'zzz'; known: free, no feedforward,"),
    (
        ["compare", "pen_on_paper"],
        "TASK: found pen_on_paper, in contact; expected a task without this, which other methods do not have",
    ),
    (["compare", "ur5_elastic"], "TASK: found ur5_elastic, with elastic timing; expected"),
    (["compare", "--jobs", "-3"], "--jobs: found -3"),
    (["compare", "--jobs", "0"], "--jobs: found 0; expected a number of tasks at a time, or -1 for one a core"),
    (["compare", "--out", "{file}"], "--out: found {file}, a file; expected a folder"),
    (["compare", "--out", "{file}/below"], "--out: found {file}, a file; expected a folder"),
    (["compare", "--seed", "-1"], "--seed"),
    (["inspect", "nobody"], "unknown robot 'nobody'"),
    (["inspect", "so10"], "error: unknown robot 'so10'; did you mean so101"),
    (["inspect", "so101", "--tool", "gripper_frame"], "unknown frame 'gripper_frame'; did you mean gripper_frame_link"),
    (["inspect", "scara", "--tool", "tool0"], "tool: found 'tool0'; expected none with joint screws"),
    (["inspect", "planar_3r", "--q", "0.1,0.2"], "q: found shape (2,)"),
    (["inspect", "planar_3r", "--q", "0.1,nan,0.2"], "q: found NaN"),
    (["inspect", "planar_3r", "--q", "a"], "--q: found 'a'; expected numbers"),
    (
        ["inspect", "panda", "--q", "11,-28,5,-114,5,97,34"],
        "-114 rad is 110.9 outside its position range; are these deg",
    ),
    (["inspect", "planar_3r", "--q", "0,1,0", "--samples", "9"], "--q: found --samples too"),
    (["inspect", "planar_3r", "--samples", "0"], "--samples"),
    (["inspect", "planar_3r", "--json", "/nowhere/at/all.json"], "in a folder that does not exist"),
    (["inspect", "planar_3r", "--plot", "/nowhere/at/all.png"], "in a folder that does not exist"),
    (["inspect", "planar_3r", "--plot", "picture.xyz"], "with the ending '.xyz'; expected one of .png, .svg, .pdf"),
    (["inspect"], "Missing argument"),
]


@pytest.mark.parametrize(("words", "said"), REFUSED, ids=[" ".join(words) for words, _ in REFUSED])
def test_bad_input_is_status_2_and_one_message_before_any_work(monkeypatch, capsys, tmp_path, words, said):
    monkeypatch.setenv("COLUMNS", "300")
    monkeypatch.setattr("invariantqp.workbench.runs.controllers.Controller.step", lambda *a, **k: pytest.fail("it ran"))
    files = {"typo": tmp_path / "typo.toml", "file": tmp_path / "file", "folder": tmp_path / "folder.html"}
    files["typo"].write_text("[law]\ngian = 1", encoding="utf-8")
    files["file"].write_text("no results", encoding="utf-8")
    files["folder"].mkdir()
    monkeypatch.chdir(tmp_path)
    status, out, err = call(monkeypatch, capsys, *(word.format(**files) for word in words))
    assert (status, out) == (2, "")
    assert said.format(**files) in " ".join(err.split())
    assert "Traceback" not in err
    assert set(tmp_path.iterdir()) == set(files.values())
