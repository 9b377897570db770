"""Build the compiled core, `invariantqp/_native`: part of `pip install`, left out where it cannot be built.

    python invariantqp/csrc/build.py [--sanitize]      beside the sources, for a checkout that runs in place

Without a compiler, or with one that fails, the package installs as pure Python, which gives the same answers.
"""

from __future__ import annotations

import shutil
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PACKAGE = Path(__file__).resolve().parent.parent
SOURCES = PACKAGE / "csrc"
# The oldest CPython that the stable ABI is asked for: one wheel serves it and every later one.
OLDEST = (3, 10)
# No multiply-add is contracted and nothing is reordered, so that x86-64 and aarch64 round alike.
OPTIONS = ["-std=c11", "-O3", "-g0", "-ffp-contract=off", "-fno-math-errno", "-fno-wrapv", "-fvisibility=hidden"]
MICROSOFT_OPTIONS = ["/std:c11", "/O2", "/fp:precise"]
# With less optimisation: compiled in half the time, and less that is undefined is optimised away before it is seen.
SANITIZERS = ["-O1", "-g", "-fno-omit-frame-pointer", "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined"]


class BuildHook(BuildHookInterface):  # type: ignore[type-arg, misc]
    """What hatchling calls before it packs a wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the compiled core to the wheel; leave a wheel of pure Python where that fails."""
        editable = version == "editable"
        for old in [*PACKAGE.glob("_native*.so"), *PACKAGE.glob("_native*.pyd")] if editable else []:
            old.unlink()
        try:
            if editable:
                built(PACKAGE)
                return
            library = built(Path(tempfile.mkdtemp()))
        except BaseException as failure:  # noqa: BLE001 (setuptools leaves with SystemExit, too)
            self.app.display_warning(f"no compiled core, the package is pure Python: {failure}")
            return
        build_data["force_include"][str(library)] = f"invariantqp/{library.name}"
        build_data["pure_python"] = False
        platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"] = f"cp{OLDEST[0]}{OLDEST[1]}-abi3-{platform}"


def built(folder: Path, *, sanitize: bool = False) -> Path:
    """Compile the core into a folder; the path of the library.

    Raises:
        Exception: there is no compiler, no header, or an error in a source, as setuptools tells it.
    """
    import numpy as np
    from setuptools import Distribution, Extension
    from setuptools.command.build_ext import build_ext

    microsoft = sys.platform == "win32"
    options = MICROSOFT_OPTIONS if microsoft else OPTIONS + (SANITIZERS if sanitize else [])
    extension = Extension(
        "invariantqp._native",
        sorted(str(source) for source in SOURCES.glob("*.c")),
        depends=[str(header) for header in SOURCES.glob("*.h")],
        include_dirs=[np.get_include()],
        define_macros=[
            ("Py_LIMITED_API", f"0x{OLDEST[0]:02X}{OLDEST[1]:02X}0000"),
            ("NPY_NO_DEPRECATED_API", "NPY_1_7_API_VERSION"),
        ],
        py_limited_api=True,
        extra_compile_args=options,
        extra_link_args=SANITIZERS if sanitize and not microsoft else [],
    )
    with tempfile.TemporaryDirectory() as scratch:
        command = build_ext(Distribution({"name": "invariantqp", "ext_modules": [extension]}))
        command.build_lib, command.build_temp, command.force = scratch, scratch, True
        command.ensure_finalized()
        command.run()
        made = Path(command.get_ext_fullpath(extension.name))
        folder.mkdir(parents=True, exist_ok=True)
        place = folder / made.name
        place.unlink(missing_ok=True)  # not written over: a process may have it loaded
        return Path(shutil.move(made, place))


if __name__ == "__main__":
    print(built(PACKAGE, sanitize="--sanitize" in sys.argv[1:]))
