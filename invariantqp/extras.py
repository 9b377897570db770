"""Checks for the optional dependencies of the package's extras."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from invariantqp.errors import MissingExtra


def require(extra: str, *packages: str) -> None:
    """Raise `MissingExtra` if one of these packages of an extra is not installed."""
    for package in packages:
        if not is_installed(package):
            raise MissingExtra(package, extra)


@contextmanager
def optional(extra: str, what: str) -> Iterator[None]:
    """A block that imports the package `what` of an extra.

    Raises:
        MissingExtra: the package is not installed, or cannot be loaded; that error is then its cause.
    """
    try:
        yield
    except ModuleNotFoundError:
        raise MissingExtra(what, extra) from None
    except ImportError as error:
        raise MissingExtra(what, extra) from error


def is_installed(package: str) -> bool:
    """Whether a package can be found, without importing it."""
    try:
        return find_spec(package) is not None
    except (ModuleNotFoundError, ValueError):  # ValueError: a loaded module without __spec__
        return False
