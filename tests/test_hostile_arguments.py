"""With any argument a public function succeeds, or raises an error of this package that names it."""

import inspect
import warnings

import numpy as np
import pytest
from support.calls_algebra import ALGEBRA
from support.calls_control import CONTROL
from support.hostile import HOSTILE
from support.public_names import public_names

import invariantqp as iq


def words(table):
    return {word for words in table.values() for word in words.split()}


CALLS = {**ALGEBRA, **CONTROL}
# Every public name, of the package and of its namespaces.
PUBLIC = {name: value for names in public_names().values() for name, value in names.items()}
PROTOCOLS = "Backend Controls Exact Form Limit Robot"
# Public names that are not called here, and why.
NOT_CALLED = {
    "a result: the library makes it": "Candidate Code DualProjectors FollowerSolution GibsonHunt HybridSolution "
    "Identification Inspection Involution Loop Margins NullPlane PoseSolution Reason RobotState Status SystemReport "
    "Trace VelocitySolution VelocitySolutions View",
    "an error or a warning: the library raises it": "BadInput BlindSystem InvariantQPError MissingExtra "
    "NoContactFound NoPolarDecomposition NoProjectors NoPseudoinverse RobotModelError SolverFailure TaskFileError "
    "UnknownName",
    "what a back end is given, and protocols": f"BoxQP {PROTOCOLS}",
    "decoded from a file by pydantic, which has errors of its own": "LawSpec Task",
    "takes what load_task, run_task and inspect return; runs or draws for seconds": "run_task frame_check "
    "picture pitch_picture animation",
}
# Public methods that are not called here, and why.
INNER = {
    "called in a tick, with arguments that were checked before": "CarriedMetric.root "
    "LimitRows.excess "
    "Clearance.in_loop Clearance.require Clearance.rows_at Clearance.rows_after "
    "Clearance.engine_in_loop Clearance.row_name Clearance.too_near "
    "OtherArm.checked_positions BoxQP.of Chain.motions LimitRows.trusted Candidate.frame "
    "ExactRows.on LimitRows.renamed "
    "Chain.state Chain.points "
    "InvariantFrameTask.compute_qp_objective",
    "of this package's own files, with arguments of their making": "ScrewSystem.with_tolerance ScrewSystem.derived "
    "ScrewSystem.form ScrewSystem.joint_velocities",
}
# An argument that messages call by another name: the one that a controller's user knows.
ALSO_CALLED = {
    ("Chain.target", "pose"): "target",
    ("InvariantFrameTask.set_target", "transform_target_to_world"): "target",
    ("InvariantFrameTask.set_target, mink", "transform_target_to_world"): "target",
}
# Arguments that may be functions; what a function of the user's raises is the user's.
FUNCTIONS = {"path", "damping", "normal", "implicit", "extent", "contact", "rows"}

# Where NaN, an axis more or an entry less is no mistake, and why.
ROWS = (
    "exps.twists logs.poses adjoints.poses velocities.J velocities.twist velocities.point kinematics.q "
    "DifferentialIK.compute.jacobian"
)
NOT_USED = "ExactJoints.moved.offset HybridTask.contact_at.tool"
TAKES_NAN = words(
    {
        "NaN stays in its row": f"{ROWS} DifferentialIK.set_command.command DifferentialIK.compute.ee_pos "
        "DifferentialIK.compute.ee_quat DifferentialIK.compute.joint_pos",
        "changes nothing there": NOT_USED,
    }
)
TAKES_MORE = words({"rows of rows": ROWS, "changes nothing there": NOT_USED, "one for each target": "solve_poses.q0"})
TAKES_LESS = words(
    {
        "one for each joint of any arm": "JointLimits.position_upper AccelerationLimit.limit JointTask.velocity",
        "any number of angles": "Cylindroid.at.angles",
        "any number of rows": "ExactJoints.A DifferentialIK.compute.jacobian solve_poses.targets",
        "changes nothing there": NOT_USED,
    }
)
# The argument that is blamed where two of them have to fit each other.
BESIDE = {
    "form_adjoint.A": "codomain",
    "leg_wrenches.base": "platform",
    "Bounds.lower": "upper",
    "ExactRows.A": "of_twist",
    "ExactRows.of.D": "b",
    "LimitRows.C": "lower",
    "LimitRows.lower": "upper",
    "solve_velocities.J": "twist",
    "Follower.follow.points": "stamps",
    "identify.poses": "wrenches",
    "WrenchSensor.check.readings": "poses",
}


def numbers(value):
    """An argument as an array, None where it is none or has no number."""
    if value is None or isinstance(value, (bool, int, str)) or callable(value):
        return None
    try:
        found = np.array(value, dtype=float)
    except (TypeError, ValueError):
        return None
    return found if found.size else None


def refused(name, argument, value):
    """The arguments that an error may blame."""
    function, good = CALLS[name]()
    with pytest.raises(iq.BadInput) as caught:
        function(**{**good, argument: value})
    return caught.value.argument.split("[")[0]


def test_nan_and_wrong_shapes_are_refused():
    for name, argument, value in ((name, *one) for name, call in CALLS.items() for one in call()[1].items()):
        given = numbers(value)
        if given is None:
            continue
        where = f"{name}.{argument}"
        known = ALSO_CALLED.get((name, argument), argument)
        if where not in TAKES_NAN:
            wrong = given.copy()
            wrong.flat[-1] = np.nan
            assert refused(name, argument, wrong if wrong.ndim else float("nan")) == known, where
        if given.ndim and where not in TAKES_MORE:
            assert refused(name, argument, given[None]) == known, where
        if given.ndim and where not in TAKES_LESS:
            assert refused(name, argument, given[:-1]) in {known, BESIDE.get(where)}, where


def failure(function, arguments, names=()):
    """What is wrong with the answer to a call, "" where nothing is."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", r"(dt|delay)=\S+ is \S+ s: ")  # a large tick is questioned, and taken
        warnings.filterwarnings("ignore", "clearance: nothing is kept")  # so is one without a pair
        warnings.filterwarnings("ignore", r"tool_speed: \S+ \[length/s\]")  # and a large speed
        try:
            function(**arguments)
        except iq.BadInput as error:
            name = error.argument.split("[")[0]
            return "" if name in {*arguments, *names} else f"blames {error.argument!r}"
        except iq.InvariantQPError:
            return ""
        except Exception as error:  # noqa: BLE001 (whatever it is, it is reported)
            return f"raises {type(error).__name__}: {str(error)[:100]}"
    return ""


@pytest.mark.parametrize("name", CALLS)
def test_every_argument_of_the_wrong_kind_is_named(name):
    function, good = CALLS[name]()
    function(**good)
    wrong = {}
    for argument in good:
        for kind, value in HOSTILE.items():
            if callable(value) and argument in FUNCTIONS:
                continue
            names = [ALSO_CALLED.get((name, argument), argument)]
            if said := failure(function, {**good, argument: value}, names):
                wrong.setdefault(f"{name}({argument})", {})[kind] = said
    assert wrong == {}


def test_every_argument_is_tried():
    for name, call in CALLS.items():
        function, good = call()
        parameters = inspect.signature(function).parameters.values()
        named = {p.name for p in parameters if p.kind is not p.VAR_KEYWORD}
        assert named <= set(good), name
        assert named == set(good) or any(p.kind is p.VAR_KEYWORD for p in parameters), name


def test_every_public_name_is_tried():
    public = {name for name, value in PUBLIC.items() if callable(value)}
    tried = {name.split(",")[0].split(".")[0] for name in CALLS}
    assert public - tried - words(NOT_CALLED) == set()
    assert words(NOT_CALLED) - public == set()


def called_in_a_tick(kind, name):
    """Whether a controller calls the method in a tick, of a limit, an exact demand or a form."""
    return any(
        hasattr(protocol, name)
        and all(hasattr(kind, method) for method in vars(protocol) if not method.startswith("_"))
        for protocol in (iq.limits.Limit, iq.control.Exact, iq.forms.Form)
    )


def methods(kind):
    """Public methods that take arguments, other than those a tuple or a pydantic model brings."""
    for name, member in inspect.getmembers(kind, callable):
        made_here = (getattr(member, "__module__", None) or "").startswith("invariantqp")
        if (
            not name.startswith("_")
            and not called_in_a_tick(kind, name)
            and made_here
            and len(inspect.signature(member).parameters) > 1
        ):
            yield name


def test_every_public_method_is_tried():
    kinds = {name: value for name, value in PUBLIC.items() if inspect.isclass(value)}
    skipped = {"Robot", "Task", *words({"": PROTOCOLS})}
    found = {f"{name}.{m}" for name, kind in kinds.items() if name not in skipped for m in methods(kind)}
    assert found - set(CALLS) - words(INNER) == set()
    assert words(INNER) - found == set()
