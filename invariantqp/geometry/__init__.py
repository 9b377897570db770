"""Rigid motions, twists, wrenches and the invariant forms on them: pure functions on plain arrays. numpy and attrs."""
