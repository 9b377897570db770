"""Exact answers to the problems that the methods solve."""

from __future__ import annotations

from invariantqp.errors import InvariantQPError


class ReferenceFailure(InvariantQPError):
    """An exact answer cannot be computed: no error can be measured against it."""


class NoReference(ReferenceFailure):
    """The problem has no unique answer in this state, for example because the pitch form is blind to a direction."""
