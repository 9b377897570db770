import ast
import json
import re
import shlex
import subprocess
import sys
from importlib import import_module, metadata
from pathlib import Path
from pkgutil import iter_modules
from py_compile import compile as compile_file

import cloudpickle
import numpy as np
import pytest
from packaging.requirements import Requirement
from support.public_names import namespaces

import invariantqp as iq
from invariantqp.errors import install_command
from invariantqp.extras import optional
from invariantqp.workbench.runs.taskfile import tomllib

PACKAGE = Path(iq.__file__).parent
ELSEWHERE = PACKAGE.parent  # where the package is found that is tested, and not sources that were not compiled
PROJECT = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
FOREIGN = ["pinocchio", "daqp", "osqp", "qpsolvers", "cvxpy", "scipy", "matplotlib", "pydantic", "typer", "rich"]


def loaded_by(code):
    """Which foreign packages are loaded after the code has run in a fresh interpreter."""
    script = f"import sys, json\n{code}\nprint(json.dumps([m for m in {FOREIGN} if m in sys.modules]))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ELSEWHERE)
    return json.loads(done.stdout.splitlines()[-1])


NAMED = [f"invariantqp.{name}" for name in namespaces()]
# All but four, which are files of their own.
NAMESPACES = ["invariantqp", *(name for name in NAMED if "__getattr__" in vars(import_module(name)))]


# Modules below a namespace that are names of it.
BELOW = {"invariantqp": namespaces(), "invariantqp.velocity": ["definition"]}


@pytest.mark.parametrize("name", NAMESPACES)
def test_names_of_a_namespace_resolve_and_are_those_of_type_checkers_and_of_help(name):
    namespace = import_module(name)
    assert len(namespace.__all__) == len(set(namespace.__all__))
    assert all(getattr(namespace, public) is not None for public in namespace.__all__)
    assert set(dir(namespace)) == {*namespace.__all__, *BELOW.get(name, [])}
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute 'pseudo_inverse'"):
        namespace.pseudo_inverse  # noqa: B018
    tree = ast.parse(Path(namespace.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    names = [alias for node in block.body for alias in node.names]
    assert all(alias.asname == alias.name for alias in names)  # what makes them public for a checker
    assert {alias.name for alias in names} == set(dir(namespace))
    listed = re.findall(r"^    invariantqp\S*: (.*)$", namespace.__doc__, re.MULTILINE)
    assert sorted(", ".join(listed).split(", ")) == dir(namespace)
    # Who imports a file of a public name would put it where the name is.
    files = {module.name for module in iter_modules(getattr(namespace, "__path__", []))}
    assert files.isdisjoint(namespace.__all__)


def test_a_frozen_program_loads_its_names_at_once(tmp_path):
    """Compiled files without their sources."""
    (tmp_path / "facade.py").write_text(
        "from typing import TYPE_CHECKING\nfrom invariantqp.lazy import loaded_on_use\n"
        "if TYPE_CHECKING or not loaded_on_use(__name__):\n    from fractions import Fraction as Fraction\n"
    )
    code = f"import sys\nsys.path.insert(0, {str(tmp_path)!r})\nimport facade, fractions\n"
    later = "assert 'Fraction' not in vars(facade)\nassert facade.Fraction is fractions.Fraction\n"
    assert loaded_by(f"{code}{later}assert facade.__all__ == dir(facade) == ['Fraction']") == []
    compile_file(str(tmp_path / "facade.py"), cfile=str(tmp_path / "facade.pyc"))
    (tmp_path / "facade.py").unlink()
    assert loaded_by(f"{code}assert vars(facade)['Fraction'] is fractions.Fraction") == []


def test_namespaces_import_nothing_algebra_numpy_alone_and_a_loop_no_extra():
    """One after the other in one process: what is loaded stays."""
    said = f"print([m for m in {FOREIGN} if m in sys.modules])\n"
    algebra = (
        "import numpy as np, invariantqp as iq\n"
        "J = np.random.default_rng(0).normal(size=(6, 3))\n"
        "iq.pseudoinverse(J, 0.3), iq.principal_pitches(J), iq.adjoint(iq.exp(J[:, 0])), iq.gibson_hunt(J)\n"
    )
    loop = (
        "robot = iq.load_robot('panda')\n"
        "loop = iq.Controller(robot, dt=0.01, exact='position', tool_speed=0.1, acceleration_limit=1.0)\n"
        "loop.step(np.zeros(7), robot.pose(np.ones(7)))\n"
        "iq.solve_pose(robot, robot.pose(np.ones(7))), iq.load_task('scara')\n"
    )
    script = "import sys\n" + "".join(f"import {name}\n" for name in NAMESPACES) + said + algebra + said + loop + said
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ELSEWHERE)
    found = [set(ast.literal_eval(line)) for line in done.stdout.splitlines()]
    assert len(found) == 3
    for loads, may in zip(found, (set(), {"scipy"}, {"scipy", "daqp", "pydantic"}), strict=True):
        assert loads <= may


def test_namespaces_are_attributes_of_the_package():
    for name in NAMED:
        assert getattr(iq, name.removeprefix("invariantqp.")) is import_module(name)
    assert set(NAMED) - set(NAMESPACES) == {f"invariantqp.{name}" for name in ("errors", "lerobot", "mink", "pink")}


@pytest.mark.parametrize("module", [iq, iq.velocity], ids=lambda m: m.__name__)
def test_a_namespace_crosses_processes_by_its_name(module):
    """As joblib and Dask send functions of a script that uses it."""
    sent = cloudpickle.dumps(module)
    assert len(sent) < 200
    assert cloudpickle.loads(sent) is module


def test_no_assert_and_a_first_line_in_every_file():
    texts = {file: file.read_text(encoding="utf-8") for file in PACKAGE.rglob("*.py")}
    may = {file: ast.walk(ast.parse(text)) for file, text in texts.items() if "assert " in text}  # parsing takes long
    asserts = [file for file, nodes in may.items() if any(isinstance(node, ast.Assert) for node in nodes)]
    assert (asserts, [file for file, text in texts.items() if not text.startswith('"""')]) == ([], [])


def test_errors_have_one_base():
    for name in iq.errors.__all__:
        assert issubclass(getattr(iq.errors, name), iq.InvariantQPError)
    assert issubclass(iq.errors.UnknownName, iq.errors.RobotModelError)
    error = iq.errors.MissingExtra("osqp", "solvers")
    assert str(error) == f"osqp is not installed. Run: {error.install}"
    assert isinstance(error, ImportError)


def listed(extra):
    """What pyproject.toml lists for an extra, and for the extras that it names."""
    for requirement in PROJECT["optional-dependencies"][extra]:
        named = re.fullmatch(r"invariantqp\[(.+)\]", requirement)
        for name in named[1].split(",") if named else ():
            yield from listed(name)
        if not named:
            yield requirement


def test_the_install_command_lists_the_packages_of_the_extra():
    """No name of this package is in it: a checkout, or an address, is not where pip would look for one."""
    for extra in PROJECT["optional-dependencies"]:
        pip, install, *names = shlex.split(iq.errors.MissingExtra("a package", extra).install)
        assert (pip, install) == ("pip", "install")
        assert {Requirement(name) for name in names} == {Requirement(name) for name in listed(extra)}


def test_uninstalled_sources_name_the_extra(monkeypatch):
    def nowhere(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "requires", nowhere)
    assert iq.errors.MissingExtra("trimesh", "view").install == "pip install '.[view]'"


# What a user does first with each extra, and the packages that are not there.
EXTRAS = {
    "robots": ("iq.load_robot('panda')", ["example-robot-data"]),
    "pin": ("iq.load_robot(np.eye(6), np.eye(4)).model", ["pinocchio"]),
    "solvers": ("iq.Controller(iq.load_robot(np.eye(6), np.eye(4)), dt=0.01, backend='osqp')", ["osqp"]),
    "pictures": ("iq.workbench.picture", ["matplotlib"]),
    "pink": ("from invariantqp.pink import InvariantFrameTask", ["pink"]),
    "mink": ("from invariantqp.mink import InvariantFrameTask", ["mink"]),
    "sim": ("iq.run_task(iq.load_task('pen_on_paper'), physics='mujoco')", ["mujoco"]),
}
ABSENT = """
import sys
from importlib import abc, metadata
absent = {absent}
class Nowhere(abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.split(".")[0] in absent:
            raise ModuleNotFoundError(name)
def without(name, found=metadata.distribution):
    if name in absent:
        raise metadata.PackageNotFoundError(name)
    return found(name)
sys.meta_path.insert(0, Nowhere())
metadata.distribution = without
import invariantqp as iq
import numpy as np
{use}
"""
# One after another in one process: what is absent for one of them has not been loaded by those before.
USE_ALL = """import json
found = {{}}
for name, (use, missing) in {extras}.items():
    absent[:] = missing
    loaded = [package for package in missing if package in sys.modules]
    try:
        exec(use)
    except iq.errors.MissingExtra as error:
        chained = error.__cause__ or (error.__context__ and not error.__suppress_context__)
        found[name] = [str(error), loaded, bool(chained)]
print(json.dumps(found))"""


def test_without_an_extra_its_first_use_names_the_install_command():
    script = ABSENT.format(absent=[], use=USE_ALL.format(extras=EXTRAS))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=ELSEWHERE)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert list(found) == list(EXTRAS)
    for extra, (said, loaded, chained) in found.items():
        assert said.endswith(f" is not installed. Run: {install_command(extra)}")
        assert (loaded, chained) == ([], False)


def test_a_package_that_cannot_be_loaded_is_the_cause():
    with pytest.raises(iq.errors.MissingExtra, match="Pinocchio") as caught, optional("pin", "Pinocchio"):
        raise ImportError("libpinocchio.so: no such file")
    assert str(caught.value.__cause__) == "libpinocchio.so: no such file"


# Every command that an extra is missing for, what is missing, and which extra is named.
COMMANDS = {
    "no command line": (["tasks"], "typer", "cli"),
    "no help": (["--help"], "typer", "cli"),
    "run --plot": (["run", "scara", "--plot", "out.png"], "matplotlib", "pictures"),
    "run --view": (["run", "scara", "--view", "out.html"], "jinja2", "pictures"),
    "run --backend": (["run", "scara", "--backend", "osqp"], "osqp", "solvers"),
    "run --physics": (["run", "so101_pen", "--physics", "mujoco"], "mujoco", "sim"),
    "run a robot": (["run", "panda_path"], "example-robot-data", "robots"),
    "inspect --plot": (["inspect", "scara", "--plot", "out.png"], "matplotlib", "pictures"),
    "compare": (["compare", "scara"], "matplotlib", "pictures"),
}


RUN_ALL = """import contextlib, io, json
from invariantqp.__main__ import main
found = {{}}
for name, words in {commands}.items():
    sys.argv[1:] = words
    streams = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(streams[0]), contextlib.redirect_stderr(streams[1]):
        try:
            main()
        except SystemExit as left:
            found[name] = [left.code, *(stream.getvalue() for stream in streams)]
print(json.dumps(found))"""


@pytest.mark.parametrize("command_line", [False, True])
def test_every_command_names_a_missing_package_before_it_works(command_line, tmp_path):
    cases = {name: case for name, case in COMMANDS.items() if (case[1] != "typer") == command_line}
    use = RUN_ALL.format(commands={name: words for name, (words, _, _) in cases.items()})
    script = ABSENT.format(absent=[absent for _, absent, _ in cases.values()], use=use)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=tmp_path)
    for name, (status, out, err) in json.loads(done.stdout).items():
        _, absent, extra = COMMANDS[name]
        said = f"error: {absent} is not installed. Run: {install_command(extra)}\n"
        assert (status, out, err) == (2, "", said), name
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("m", [1, 3, 6, 7])
def test_documented_shapes_are_returned(m):
    rng = np.random.default_rng(m)
    J, s = rng.normal(size=(6, m)), rng.normal(size=6)
    T = iq.exp(s)
    solution = iq.solve_velocity(J.tolist(), s.tolist(), form=0.4)
    point, length = iq.systems.centre(J)
    direction, foot = iq.se3.axis(s)
    shapes = {
        "pitch_form": (iq.pitch_form(0.4), (6, 6)),
        "pitch_form_inverse": (iq.pitch_form_inverse(0.4), (6, 6)),
        "adjoint": (iq.adjoint(T.tolist()), (6, 6)),
        "coadjoint": (iq.coadjoint(T.tolist()), (6, 6)),
        "exp": (T, (4, 4)),
        "log": (iq.log(T), (6,)),
        "bracket": (iq.se3.bracket(s, s), (6,)),
        "inverse": (iq.inverse(T), (4, 4)),
        "revolute": (iq.revolute((0, 0, 1)), (6,)),
        "axis": (np.stack((direction, foot)), (2, 3)),
        "centre": (point, (3,)),
        "gram_matrix": (iq.systems.gram_matrix(J, 0.4), (m, m)),
        "pseudoinverse": (iq.pseudoinverse(J.tolist(), 0.4), (m, 6)),
        "principal_pitches": (iq.principal_pitches(J), ({1: 1, 3: 3, 6: 0, 7: 0}[m],)),
        "reciprocal": (iq.reciprocal(J), (6, max(0, 6 - m))),
        "velocity": (solution.velocity, (m,)),
        "residual": (solution.residual, (6,)),
    }
    for name, (value, shape) in shapes.items():
        assert value.shape == shape, name
        assert value.dtype == np.float64, name
    assert isinstance(length, float)
    assert isinstance(iq.has_pseudoinverse(J, 0.4), bool)
    assert isinstance(iq.se3.pitch(s), float)
    assert isinstance(solution.scale, float)
    assert isinstance(solution.active, tuple)
