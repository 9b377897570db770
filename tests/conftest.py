"""Set before NumPy is imported: one thread for each process, because pytest-xdist already gives every core a process."""

import os

for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
