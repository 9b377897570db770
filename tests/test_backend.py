"""The build backend: which Python it refuses, and when it takes a compiler from PyPI."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

SOURCE = Path(__file__).parent.parent / "invariantqp" / "core" / "backend.py"


def backend():
    spec = spec_from_file_location("backend", SOURCE)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_an_older_python_is_refused_by_name(monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 9, 18))
    with pytest.raises(SystemExit, match=r"^invariantqp needs Python 3\.10 or newer, this is 3\.9$"):
        backend()


@pytest.mark.skipif(sys.platform == "win32", reason="there CMake looks for Visual Studio")
def test_zig_is_for_machines_without_a_compiler_that_runs(monkeypatch, tmp_path):
    pytest.importorskip("scikit_build_core")
    build = backend()
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CXX", raising=False)
    compiler = tmp_path / "c++"
    for status, needed in ((None, True), (1, True), (0, False)):
        if status is not None:
            compiler.write_text(f"#!/bin/sh\nexit {status}\n")
            compiler.chmod(0o755)
        assert build.needs_zig() is needed
    for chosen in ("zig", "g++"):
        monkeypatch.setenv("CXX", chosen)
        assert build.needs_zig() == (chosen == "zig")
