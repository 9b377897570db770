"""Names of the methods that charts, tables and sentences refer to; a test checks that each is a method's name."""

from __future__ import annotations

OURS = "invariantqp"
OURS_PYTHON = "invariantqp (Python)"
HAND_WRITTEN = "hand-written loop"
PENROSE = "Moore-Penrose"
DLS = "DLS"
LEAST_SQUARES = "least-squares QP"
TOLD_LEAST_SQUARES = "QP with length and LM"
PINK = "Pink"
MINK = "mink"
