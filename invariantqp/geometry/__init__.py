"""Rigid motions, twists, wrenches and the invariant forms on them: numpy alone, pure functions on plain arrays."""
