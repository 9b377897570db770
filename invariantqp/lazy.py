"""Public names that are loaded when first used (PEP 562), so that importing a namespace costs nothing.

    if TYPE_CHECKING or not loaded_on_use(__name__):
        from invariantqp.systems.subspaces import reciprocal as reciprocal

Type checkers, editors and the import contract read these imports as any other; `loaded_on_use` reads them as text.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import Any


def loaded_on_use(module: str) -> bool:
    """Give a module the names that its source imports as themselves: `__getattr__`, `__dir__`, `__all__`, and contents.

    A name that is imported from the module itself is a module below it, and not in `__all__`. No file of a package may
    be called as one of its names: whoever imports the file makes it an attribute of the package.

    Returns:
        False where there is no source to read, in a program that was frozen: then the imports have to be made at once.
    """
    namespace = vars(sys.modules[module])
    try:
        source = namespace["__loader__"].get_data(namespace["__file__"].removesuffix("c")).decode()
    except OSError:
        return False
    imports = (line.split() for line in source.splitlines() if " as " in line)
    home_of = {words[5]: words[1] for words in imports if words[0] == "from" and words[3] == words[-1]}

    def load(name: str) -> Any:
        home = home_of.get(name)
        if home is None:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        if home == module:
            return import_module(f"{module}.{name}")
        namespace[name] = value = getattr(import_module(home), name)
        return value

    namespace["__getattr__"] = load
    namespace["__dir__"] = lambda: sorted(home_of)
    namespace["__all__"] = [name for name, home in home_of.items() if home != module]
    namespace["__doc__"] = f"{(namespace['__doc__'] or '').rstrip()}\n\n{contents(home_of)}"
    return True


def contents(home_of: dict[str, str]) -> str:
    """What a namespace has, for `help`: a line for each file, with the names that are in it."""
    by_home: dict[str, list[str]] = {}
    for name, home in home_of.items():
        by_home.setdefault(home, []).append(name)
    lines = [f"    {home}: {', '.join(names)}" for home, names in by_home.items()]
    return "\n".join(["Its names, by where they are:", "", *lines])
