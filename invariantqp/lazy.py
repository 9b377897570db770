"""Public names that are loaded when first used, so that importing a namespace costs nothing.

    with lazily(__name__):
        from invariantqp.systems.subspaces import reciprocal as reciprocal

Type checkers and editors read these imports as any other. When they run they only note where each name lives.
"""

from __future__ import annotations

import builtins
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from threading import Lock
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


class _Later:
    """What `from module import name` takes its names from until the module is loaded."""

    def __getattr__(self, name: str) -> None:
        return None


_ONE_AT_A_TIME = Lock()  # threads that load two namespaces at once


@contextmanager
def lazily(module: str, *, moved: Mapping[str, str] | None = None) -> Iterator[None]:
    """Give a module the names that are imported in the block; each is loaded when first used.

    Imports of other modules, in other threads meanwhile, are made as ever.

    Args:
        module: its `__name__`. Names that the block imports from itself are modules below it.
        moved: names that it had once, in one text for each of the modules that have them now; they still work, with a
            DeprecationWarning.
    """
    lazy = sys.modules[module]
    home_of: dict[str, str] = {}

    def note(home: str, *arguments: Any, **named: Any) -> Any:
        if not (arguments and arguments[0] is vars(lazy)):
            return load(home, *arguments, **named)
        home_of.update(dict.fromkeys(arguments[2], home))
        return _Later()

    with _ONE_AT_A_TIME:
        load, builtins.__import__ = builtins.__import__, note  # type: ignore[assignment]
        try:
            yield
        finally:
            builtins.__import__ = load
    for name in home_of:
        del vars(lazy)[name]
    names = {name: home for name, home in home_of.items() if home != module}
    vars(lazy).update(
        _MODULE_OF=names,
        _NAMESPACES=tuple(name for name in home_of if name not in names),
        _MOVED={name: home for home, inside in (moved or {}).items() for name in inside.split()},
        __all__=[*names],
    )
    lazy.__class__ = LazyModule
