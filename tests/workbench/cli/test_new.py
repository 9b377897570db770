from support.command_line import call

import invariantqp as iq


def test_a_new_task_is_a_file_that_can_be_loaded(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    status, out, err = call(monkeypatch, capsys, "new", "mine", "--robot", "ur5e")
    assert (status, out) == (0, "")
    assert err == "written: mine.toml. Change it, then: invariantqp run mine.toml\n"
    assert iq.load_task("mine.toml").robot.source == "ur5e"
    status, _, err = call(monkeypatch, capsys, "new", "mine")
    assert (status, err.split(";")[0]) == (2, "error: TASK: found mine.toml, which exists")
    status, _, err = call(monkeypatch, capsys, "new", "other.toml", "--robot", "ur5e")
    assert (status, err) == (0, "written: other.toml. Change it, then: invariantqp run other.toml\n")
    assert iq.load_task("other.toml").name == "other"
    assert call(monkeypatch, capsys, "new", "x", "--out", "a.json")[0] == 2
    assert call(monkeypatch, capsys, "new", "x", "--contact", "ball")[0] == 2
    assert not (tmp_path / "x.toml").exists()
