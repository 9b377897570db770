"""How often a random check is repeated. Set INVARIANTQP_LONG=1 for as often as a release is checked."""

import os

LONG = os.environ.get("INVARIANTQP_LONG", "0") != "0"


def repeats(long, short):
    """One of two numbers of repetitions."""
    return long if LONG else short
