"""The command line, called in this process."""

import sys

import pytest

from invariantqp.workbench import cli


def call(monkeypatch, capsys, *words):
    """(exit status, standard output, standard error) of a command line."""
    monkeypatch.setattr(sys, "argv", ["invariantqp", *map(str, words)])
    with pytest.raises(SystemExit) as leaving:
        cli.main()
    printed = capsys.readouterr()
    return leaving.value.code or 0, printed.out, printed.err
