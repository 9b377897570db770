"""Lazy imports of public names (PEP 562), so that importing a namespace loads nothing else.

    if TYPE_CHECKING or not loaded_on_use(__name__):
        from invariantqp.systems.subspaces import reciprocal as reciprocal

Type checkers, editors and the import contract read these imports as usual; `loaded_on_use` reads them as text.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import Any


def loaded_on_use(module: str) -> bool:
    """Define `__getattr__`, `__dir__`, `__all__` and a table of contents from the `import x as x` lines of a module.

    A name imported from the module itself is a submodule, and not in `__all__`. No file of a package may have the name
    of one of its public names, since its import would replace that attribute.

    Returns:
        False if there is no source, as in a frozen program: the imports are then made at once.
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
    """The table of contents of a namespace for `help`: a line for each file, with its names."""
    by_home: dict[str, list[str]] = {}
    for name, home in home_of.items():
        by_home.setdefault(home, []).append(name)
    lines = [f"    {home}: {', '.join(names)}" for home, names in by_home.items()]
    return "\n".join(["Names, by file:", "", *lines])
