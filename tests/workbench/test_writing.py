"""A file is written completely, or it is what it was."""

import pytest

from invariantqp.workbench.pictures.figure import figure_file
from invariantqp.workbench.writing import complete_file, require_room, write_text


def test_after_an_error_the_file_is_what_it_was(tmp_path):
    file = tmp_path / "a.txt"
    write_text(file, "before")
    with pytest.raises(ZeroDivisionError), complete_file(file) as part:
        part.write_text(f"half {1 / 0}", encoding="utf-8")
    assert file.read_text("utf-8") == "before"
    write_text(file, "after")
    assert file.read_text("utf-8") == "after"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_a_picture_that_fails_leaves_nothing(tmp_path):
    with pytest.raises(ZeroDivisionError), figure_file(tmp_path / "a.png", (1.0, 1.0)):
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())
    with figure_file(tmp_path / "a.png", (1.0, 1.0)):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "file")
    write_text(tmp_path / "link", "text")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_text("utf-8") == "text"


def test_what_is_no_ordinary_file_is_written_directly():
    write_text("/dev/null", "text")


def test_room_is_taken_and_given_back(tmp_path):
    require_room(tmp_path)
    assert not list(tmp_path.iterdir())
