"""What worker processes run; they find it by this module's name."""


def fail(error):
    """Raise what was sent."""
    raise error


def give(value):
    """Return what was sent."""
    return value
