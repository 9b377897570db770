"""Decoded task files that tests change key by key."""


def content(**changes):
    """A task that decodes, with keys changed by dotted path; None removes one."""
    task = {
        "name": "t",
        "robot": {"source": "panda", "start": [0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8]},
        "path": {"kind": "line", "duration": 0.05, "move": [0.001, 0.0, 0.0]},
        "law": {"dt": 0.002},
        "accept": {"position_error_mm": 0.1},
    }
    for key, value in changes.items():
        *parents, last = key.split("__")
        place = task
        for name in parents:
            place = place[name]
        if value is None:
            del place[last]
        else:
            place[last] = value
    return task


PEN = {"contact": {"kind": "point"}, "force": {"press": 5.0}}


def pen(**changes):
    """What makes a task one in contact, with keys changed by section."""
    return {name: {**PEN.get(name, {}), **changes.get(name, {})} for name in {**PEN, **changes}}
