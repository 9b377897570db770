"""The law of `Controller`, `HybridController` and followers, until `velocity/` replaces it.

It imports from `velocity/`, `systems/` and below. In `velocity/` only `problem`, `batch` and `tasks` import it.
"""
