"""The law of `Controller`, `HybridController`, followers, and tasks for Pink and mink, until `velocity/` replaces it.

It imports from `velocity/`, `systems/` and below. In `velocity/` only `problem`, `batch` and `tasks` import it.
"""
