"""Rigid motions, twists, wrenches, invariant forms, shapes and their distances: pure functions on plain arrays.

In come arguments of public functions, out come checked float64 arrays (arrays, sizes), frozen values (fields), poses
and adjoints (se3), joint twists and axes (screws), pitch forms (forms), shapes (shapes, coal) and distances (distance).
Nothing here knows robots, tasks or control loops.
"""
