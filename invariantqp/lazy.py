"""Public names that are loaded when first used, so that importing a namespace costs nothing.

    load_lazily(__name__, {"invariantqp.systems.subspaces": ("reciprocal", ...), ...})

Beside the call a namespace imports the same names under `TYPE_CHECKING`, for type checkers and editors. A test compares
the two lists.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Collection, Mapping
from importlib import import_module
from types import ModuleType
from typing import Any


class LazyModule(ModuleType):
    """A module whose public names live in other modules, as PEP 562 allows with functions.

    Attributes:
        __all__: the names.
        _MODULE_OF: where each lives.
        _NAMESPACES: modules below this one that `module.name` loads too.
        _MOVED: the module that has a name which was here once.
    """

    __all__: list[str]
    _MODULE_OF: dict[str, str]
    _NAMESPACES: tuple[str, ...]
    _MOVED: dict[str, str]

    def __getattr__(self, name: str) -> Any:
        if name in self._MODULE_OF:
            value = getattr(import_module(self._MODULE_OF[name]), name)
            self.__dict__[name] = value
            return value
        if name in self._NAMESPACES:
            return import_module(f"{self.__name__}.{name}")
        if name in self._MOVED:
            home = self._MOVED[name]
            warnings.warn(f"{self.__name__}.{name} is now {home}.{name}", DeprecationWarning, stacklevel=2)
            return getattr(import_module(home), name)
        raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")

    def __setattr__(self, name: str, value: Any) -> None:
        # Importing a file makes it an attribute of its package. Where a name is spelled as the file that it lives in
        # (systems.involution), the package's attribute is the name.
        if not (isinstance(value, ModuleType) and name in self._MODULE_OF):
            super().__setattr__(name, value)

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return import_module, (self.__name__,)  # by name, as cloudpickle does with other modules: for joblib and Dask

    def __dir__(self) -> list[str]:
        return sorted((*self.__all__, *self._NAMESPACES))


def load_lazily(
    module: str,
    names: Mapping[str, Collection[str]],
    *,
    namespaces: str = "",
    own: Collection[str] = (),
    moved: Mapping[str, str] | None = None,
) -> None:
    """Give a module public names that are loaded when first used.

    Args:
        module: its `__name__`.
        names: public names by the modules that they live in.
        namespaces: modules below it to load in the same way, in one text.
        own: public names that it has already.
        moved: names that it had once, in one text for each of the modules that have them now; they still work, with a
            DeprecationWarning.
    """
    module_of = {name: home for home, inside in names.items() for name in inside}
    lazy = sys.modules[module]
    lazy.__dict__.update(
        _MODULE_OF=module_of,
        _NAMESPACES=tuple(namespaces.split()),
        _MOVED={name: home for home, inside in (moved or {}).items() for name in inside.split()},
        __all__=[*module_of, *own],
    )
    lazy.__class__ = LazyModule
