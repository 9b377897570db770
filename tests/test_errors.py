"""Each error class pickles, copies and crosses process pools with its message and attributes."""

import contextlib
import copy
import multiprocessing
import pickle
from importlib import import_module
from pkgutil import walk_packages

import joblib
import numpy as np
import pytest
from joblib.externals.loky import get_reusable_executor
from support.workers import fail

import invariantqp
from invariantqp.errors import LONGEST_EXCERPT, BadInput, InvariantQPError, MissingExtra, excerpt

# Time limit for a worker that dies while it sends its result.
TIMEOUT_S = 60.0
Z = np.arange(6.0)
EXAMPLES = {
    "InvariantQPError": lambda make: make("something"),
    "BadInput": lambda make: make("q", "shape (2,)", "shape (7,)", "Pass seven."),
    "NoPseudoinverse": lambda make: make(0.3, 2, 1, Z, np.array([0.3, 0.7])),
    "NoPolarDecomposition": lambda make: make(0.3, 2, 1, Z, np.array([0.3, 0.7])),
    "NoProjectors": lambda make: make(0.3, "IA", (2, 1), Z, np.array([]), "a complement"),
    "BlindSystem": lambda make: make(np.eye(6)[:, 4:]),
    "NoContactFound": lambda make: make("none explains it", "hinge", 3.2),
    "RobotModelError": lambda make: make("no file at arm.urdf"),
    "UnknownName": lambda make: make("robot", "pandda", ["panda"], ["panda", "ur5"]),
    "TaskFileError": lambda make: make("pen.toml", ["$.path: missing", "$.law: missing"]),
    "MissingExtra": lambda make: make("pin-pink", "pink"),
    "SolverFailure": lambda make: make("daqp", "exit flag -1"),
}
COPIES = {
    "copied": copy.copy,
    "deep-copied": copy.deepcopy,
    **{f"pickled {p}": lambda error, p=p: pickle.loads(pickle.dumps(error, p)) for p in range(6)},
}


def all_classes():
    """Every error class of the package, in any of its files that can be loaded here."""
    for module in walk_packages(invariantqp.__path__, "invariantqp."):
        if not module.name.endswith("__main__"):
            with contextlib.suppress(MissingExtra):
                import_module(module.name)
    found, new = {}, {InvariantQPError}
    while new:
        found.update((kind.__name__, kind) for kind in new)
        new = {kind for parent in new for kind in parent.__subclasses__() if kind.__module__.startswith("invariantqp")}
    return found


@pytest.fixture(scope="module")
def examples():
    classes = all_classes()
    return {name: make(classes[name]) for name, make in EXAMPLES.items()}


def same(a, b):
    if isinstance(a, np.ndarray):
        return np.array_equal(a, b)
    return a == b


def assert_alike(found, error):
    assert type(found) is type(error)
    assert str(found) == str(error)
    assert found.args == error.args
    assert getattr(found, "msg", None) == getattr(error, "msg", None)  # ImportError keeps one of its own
    attributes = {name: value for name, value in vars(error).items() if not name.startswith("__")}
    assert all(same(getattr(found, name), value) for name, value in attributes.items())


def test_every_class_is_tested():
    assert set(all_classes()) == set(EXAMPLES)


@pytest.mark.parametrize("way", COPIES)
def test_errors_are_copied_and_pickled(examples, way):
    travel = COPIES[way]
    for error in examples.values():
        assert_alike(travel(error), error)
        assert_alike(travel(travel(error)), error)


def test_notes_are_pickled():
    error = BadInput("q", "NaN", "numbers")
    error.__notes__ = ["in tick 7"]  # what add_note makes, from Python 3.11 on
    assert pickle.loads(pickle.dumps(error)).__notes__ == ["in tick 7"]


def test_errors_cross_a_multiprocessing_pool(examples):
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        for error in examples.values():
            with pytest.raises(type(error)) as caught:
                pool.map_async(fail, [error]).get(TIMEOUT_S)
            assert_alike(caught.value, error)


def test_errors_cross_an_executor(examples):
    """Joblib's own, as `Parallel` would start new processes after each error."""
    with get_reusable_executor(max_workers=1) as pool:
        for error in examples.values():
            assert_alike(pool.submit(fail, error).exception(TIMEOUT_S), error)


def test_an_error_ends_a_parallel_call(examples):
    error = examples["BadInput"]
    with pytest.raises(type(error)) as caught:
        joblib.Parallel(n_jobs=2)([joblib.delayed(fail)(error)] * 2)
    assert_alike(caught.value, error)


@pytest.mark.parametrize("value", [10**5000, "x" * 10_000, np.eye(300), [[1.0] * 100] * 100], ids=type)
def test_arguments_in_messages_are_short(value):
    assert len(excerpt(value)) <= LONGEST_EXCERPT + 3
    assert "\n" not in excerpt(value)


def test_an_argument_whose_repr_fails_is_named_by_its_type():
    class Broken:
        def __repr__(self):
            raise RuntimeError

    assert "Broken" in excerpt(Broken())
