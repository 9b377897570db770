"""What every process of the tests starts with: one thread, as each core has a process; bytecode; Ctrl-C."""

import gc
import os
import signal
import sys
from collections import defaultdict

import pytest
from support.repeats import LONG

# NumPy reads this when imported.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# glibc of the workers keeps the memory of large arrays: to ask for it anew is a tenth of the time of a path in contact.
os.environ.setdefault("MALLOC_MMAP_THRESHOLD_", "100000000")
os.environ.setdefault("MALLOC_TRIM_THRESHOLD_", "200000000")

# Where no bytecode is to be kept, every process that a test starts compiles the package anew: a fifth of its time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# A shell starts what is followed by "&" with Ctrl-C ignored, and so would be the commands that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


# Most of what tests make is gone by reference counts: to look for circles less often saves 3 % of their time.
gc.set_threshold(50_000, 20, 20)


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(config, items):
    """Of cases that say the same of other arms, times or draws as many as are marked, the first and last too."""
    result = yield  # what -k and -m leave
    cases = defaultdict(list)
    for item in items:
        if not LONG and item.get_closest_marker("cases"):
            cases[item.nodeid.split("[")[0]].append(item)
    left_out = set()
    for same in cases.values():
        few, last = same[0].get_closest_marker("cases").args[0], len(same) - 1
        if few <= last:
            left_out |= set(same) - {same[round(k * last / max(few - 1, 1))] for k in range(few)}
    if left_out:
        config.hook.pytest_deselected(items=list(left_out))
        items[:] = [item for item in items if item not in left_out]
    return result


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """What is collected stays to the end: to look through it for garbage again and again took a third of this time."""
    gc.disable()
    found = yield
    gc.freeze()
    gc.enable()
    return found


@pytest.fixture(scope="session")
def panda():
    return load_robot("panda")


@pytest.fixture(scope="session")
def ur5():
    return load_robot("ur5")


@pytest.fixture(scope="session")
def so101():
    return load_robot("so101")


def load_robot(name):
    import invariantqp as iq

    return iq.load_robot(name)
