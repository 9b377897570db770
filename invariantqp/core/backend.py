"""Build backend of invariantqp: scikit-build-core, with a C++ compiler from PyPI (Zig's) where there is none.

    python invariantqp/core/backend.py [--sanitize]    compiles what has changed, beside the Python files

An editable install compiles to the same place, so that one folder has all of the package.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from base64 import urlsafe_b64encode
from hashlib import sha256
from pathlib import Path
from zipfile import ZipFile

if sys.version_info < (3, 10):  # noqa: UP036 (pip imports this file before it reads requires-python)
    raise SystemExit(f"invariantqp needs Python 3.10 or newer, this is {sys.version_info[0]}.{sys.version_info[1]}")

from scikit_build_core import build as scikit
from scikit_build_core.build import (
    build_sdist,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

Settings = dict[str, list[str] | str]

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "invariantqp"
# What CMake looks for.
COMPILERS = ("c++", "g++", "clang++")
# The first time that Zig links, it compiles its C++ library, 100 s of one core, and once more for each level of
# optimisation. CMake links one file to see which compiler it has, and is content with an object file.
SCRIPT = """#!/bin/sh
case "$*" in *CMakeC*CompilerId.c*) set -- -c "$@" ;; esac
exec "{zig}" {command} {options} "$@"
"""
# Else Zig compiles for the processor of this machine alone.
OPTIONS = dict.fromkeys(("cc", "c++"), "-mcpu=baseline -g0")


def needs_zig() -> bool:
    """Whether the compiler has to come from PyPI: none is here that runs, or `CXX=zig` asks for it.

    On macOS `c++` is always there, and fails until the command line tools are installed.
    """
    if sys.platform == "win32" or "CXX" in os.environ:
        return os.environ.get("CXX") == "zig"
    return not any(map(runs, filter(None, map(shutil.which, COMPILERS))))


def runs(compiler: str) -> bool:
    """Whether a compiler says its version."""
    said = subprocess.run([compiler, "--version"], capture_output=True, check=False)  # noqa: S603 (found on PATH)
    return said.returncode == 0


def use_zig(folder: Path) -> None:
    """Let CMake use Zig, by scripts in a folder: CMake takes programs, not `python -m`."""
    import ziglang

    zig = Path(ziglang.__file__).with_name("zig")
    home = Path(os.path.expanduser("~"))  # noqa: PTH111 (Path.home raises where there is none)
    if not os.access(home, os.W_OK):  # Zig keeps the compiled C++ library in ~/.cache for the next build
        os.environ.setdefault("ZIG_GLOBAL_CACHE_DIR", str(folder / "cache"))
    for variable, command in (("CC", "cc"), ("CXX", "c++"), ("AR", "ar"), ("RANLIB", "ranlib")):
        script = folder / f"zig-{command}"
        script.write_text(SCRIPT.format(zig=zig, command=command, options=OPTIONS.get(command, "")), encoding="utf-8")
        script.chmod(0o755)
        os.environ[variable] = str(script)


def get_requires_for_build_wheel(config_settings: Settings | None = None) -> list[str]:
    """What PyPI has to bring: CMake, Ninja and a compiler where they are missing."""
    return [*scikit.get_requires_for_build_wheel(config_settings), *(["ziglang"] if needs_zig() else [])]


get_requires_for_build_editable = get_requires_for_build_wheel


def build_wheel(
    wheel_directory: str, config_settings: Settings | None = None, metadata_directory: str | None = None
) -> str:
    """Compile, and pack a wheel."""
    with tempfile.TemporaryDirectory(prefix="zig-") as folder:
        settings = {**(config_settings or {})}
        if needs_zig():
            use_zig(Path(folder))
            settings["cmake.define.CMAKE_TRY_COMPILE_TARGET_TYPE"] = "STATIC_LIBRARY"
            settings |= {f"cmake.define.CMAKE_{name}": os.environ[name] for name in ("AR", "RANLIB")}
        return scikit.build_wheel(wheel_directory, settings, metadata_directory)


def build_editable(
    wheel_directory: str, config_settings: Settings | None = None, metadata_directory: str | None = None
) -> str:
    """Compile beside the sources, and pack a wheel that names their folder.

    scikit-build-core's own hides every other folder of that name, a second checkout among them.
    """
    del metadata_directory
    compile_in_place(config_settings)
    with tempfile.TemporaryDirectory() as folder:
        info = Path(folder, prepare_metadata_for_build_editable(folder, config_settings))
        Path(folder, "invariantqp.pth").write_text(f"{ROOT}\n", encoding="utf-8")
        tag = info.joinpath("WHEEL").read_text(encoding="utf-8").partition("\nTag: ")[2].split()[0]
        lines = [f"{info.name}/RECORD,,"]
        with ZipFile(Path(wheel_directory, f"{info.stem}-{tag}.whl"), "w") as wheel:
            for file in filter(Path.is_file, Path(folder).rglob("*")):
                name, content = file.relative_to(folder).as_posix(), file.read_bytes()
                digest = urlsafe_b64encode(sha256(content).digest()).decode().rstrip("=")
                lines.append(f"{name},sha256={digest},{len(content)}")
                wheel.writestr(name, content)
            wheel.writestr(lines[0].removesuffix(",,"), "\n".join([*lines, ""]))
    return Path(wheel.filename or "").name


def compile_in_place(config_settings: Settings | None = None) -> None:
    """Put the compiled modules beside the Python files; those of an earlier build go first."""
    for module in [*PACKAGE.glob("_*.so"), *PACKAGE.glob("_*.pyd")]:
        module.unlink()
    with tempfile.TemporaryDirectory() as folder, ZipFile(Path(folder, build_wheel(folder, config_settings))) as wheel:
        wheel.extractall(ROOT, [name for name in wheel.namelist() if name.endswith((".so", ".pyd"))])


if __name__ == "__main__":
    os.chdir(ROOT)
    sanitize = "--sanitize" in sys.argv[1:]
    settings: Settings = {"cmake.define.INVARIANTQP_SANITIZE": "ON" if sanitize else "OFF"}
    if not needs_zig():  # its scripts are gone after a build, and a build folder would name them
        settings["build-dir"] = f"build/{sys.implementation.cache_tag}{'-sanitized' if sanitize else ''}"
    compile_in_place(settings)
