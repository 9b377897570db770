"""Libraries that are installed on request: asked for before any work is done with them."""

from __future__ import annotations

from importlib.util import find_spec

from invariantqp.errors import MissingExtra


def require(extra: str, *packages: str) -> None:
    """Refuse to begin what cannot be finished without these packages, which an extra of this one installs.

    Raises:
        MissingExtra: one of them is not installed.
    """
    for package in packages:
        if not is_installed(package):
            raise MissingExtra(package, extra)


def is_installed(package: str) -> bool:
    """Whether a package can be found, without importing it."""
    try:
        return find_spec(package) is not None
    except (ModuleNotFoundError, ValueError):  # ValueError: a module that hides where it comes from
        return False
