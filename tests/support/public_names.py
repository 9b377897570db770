"""What the package exports, at the top and in each namespace."""

from importlib import import_module

import invariantqp as iq


def namespaces():
    """The names of the modules below the top."""
    return sorted(set(dir(iq)) - set(iq.__all__))


def public_names():
    """Names and values by namespace; "" is the top."""
    found = {"": {name: getattr(iq, name) for name in iq.__all__}}
    for namespace in namespaces():
        module = import_module(f"invariantqp.{namespace}")
        found[namespace] = {name: getattr(module, name) for name in module.__all__}
    return found
