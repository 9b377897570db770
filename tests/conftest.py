"""One thread for each process, as pytest-xdist already gives every core a process. NumPy reads this when imported."""

import os

for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
