"""Names of the methods that charts, tables and sentences refer to; a test checks that each is a method's name."""

from __future__ import annotations

OURS = "invariantqp"
UNGUARDED = "invariantqp, no guard"
GRAM = "h, Gram + LDL'"
FACTORED = "h, factored"
PINV = "Moore-Penrose, pinv"
SVD = "Moore-Penrose, SVD"
LU = "Moore-Penrose, LU"
DLS = "DLS"
SDLS = "SDLS"
SNS = "SNS"
LEAST_SQUARES = "least-squares QP"
DAQP = "QP, DAQP"
PINK = "Pink"
PINK_POSTURE = "Pink, posture"
MINK = "mink"
