"""Libraries that are installed on request: required before any work is done with them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from invariantqp.errors import MissingExtra


def require(extra: str, *packages: str) -> None:
    """Refuse, with `MissingExtra`, to begin what needs packages of an extra that are not installed."""
    for package in packages:
        if not is_installed(package):
            raise MissingExtra(package, extra)


@contextmanager
def optional(extra: str, what: str) -> Iterator[None]:
    """A block that imports what an extra brings, under the name `what`.

    Raises:
        MissingExtra: it is not installed, or cannot be loaded: that error is its cause.
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
    except (ModuleNotFoundError, ValueError):  # ValueError: a module that hides where it comes from
        return False
