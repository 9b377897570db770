"""Pictures leave the caller's Matplotlib alone."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

import invariantqp as iq
from invariantqp.workbench import picture
from invariantqp.workbench.pictures.figure import figure_file
from invariantqp.workbench.pictures.run import MIN_WIDTH_MM, _curve

ROOT = Path(__file__).parents[3]

# All that knows Matplotlib is imported and drawn once, as a notebook with a backend of its own would do it.
SCRIPT = """
import json, sys
from importlib import import_module
from pathlib import Path
import matplotlib
def look():
    # Reading rcParams["backend"] would select one.
    rest = {key: repr(matplotlib.rcParams[key]) for key in matplotlib.rcParams if key != "backend"}
    return {"backend": matplotlib.get_backend(auto_select=False), **rest}
before = look()
import invariantqp as iq
package = Path(iq.__file__).parent
for file in package.rglob("*.py"):
    if "matplotlib" in file.read_text(encoding="utf-8"):
        import_module(".".join(file.relative_to(package.parent).with_suffix("").parts))
imported = look()
from invariantqp.workbench.compare.report import draw
results, out = json.loads(Path(sys.argv[2]).read_text("utf-8")), Path(sys.argv[1])
motion = iq.load_task("scara")
iq.workbench.picture(iq.run_task(motion, dt=0.02), out / "motion.png")
robot = motion.load_robot()
sys.modules["invariantqp.workbench.pictures.inspection"].SWEEP = 13
iq.workbench.pitch_picture(iq.workbench.inspect(robot, samples=8), robot, out / "pitches.pdf")
draw(results, out / "chart.svg")
drawn = look()
changed = [k for k in before if not before[k] == imported[k] == drawn[k]]
print(json.dumps({"changed": changed, "pyplot": "matplotlib.pyplot" in sys.modules}))
"""


def test_no_import_and_no_picture_changes_matplotlib(tmp_path):
    words = {key: value for key, value in os.environ.items() if key != "MPLBACKEND"}
    results = ROOT / "examples" / "comparison" / "results.json"
    command = [sys.executable, "-c", SCRIPT, str(tmp_path), str(results)]
    done = subprocess.run(command, capture_output=True, text=True, env=words, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["changed"] == []
    assert not found["pyplot"]
    files = [file for file in tmp_path.iterdir() if file.stat().st_size > 1000]
    assert len(files) == 3


def test_an_unknown_format_is_refused(tmp_path):
    for name in ("picture.txt", "picture"):
        with (
            pytest.raises(iq.BadInput, match=r"found the ending .*expected one of .*\.svg"),
            figure_file(tmp_path / name, (4.0, 3.0)),
        ):
            pass
    assert not list(tmp_path.iterdir())


def test_rounding_of_a_tool_that_stays_is_not_magnified():
    axes, rng = Figure().subplots(), np.random.default_rng(0)
    desired, actual = 1e-16 * rng.normal(size=(2, 50, 3))
    contact = SimpleNamespace(normal=np.array([0.0, 0.0, 1.0]), desired=desired, position=actual)
    _curve(axes, SimpleNamespace(counted_from=0), contact)
    assert np.ptp(axes.get_xlim()) >= MIN_WIDTH_MM
    assert any(line.get_marker() == "o" for line in axes.lines)


def test_anything_but_a_trace_is_refused(tmp_path):
    with pytest.raises(iq.BadInput, match="trace: found 3; expected a Trace"):
        picture(3, tmp_path / "picture.svg")


def test_a_file_that_cannot_be_written_is_refused(tmp_path):
    with (
        pytest.raises(iq.BadInput, match="expected a file that can be written"),
        figure_file(tmp_path / "nowhere" / "picture.svg", (4.0, 3.0)),
    ):
        pass


def test_an_error_while_drawing_writes_no_file(tmp_path):
    def draw():
        with figure_file(tmp_path / "picture.svg", (4.0, 3.0), style={"font.size": 30.0}) as figure:
            figure.subplots().plot([1, 2], [1, 2, 3])

    with pytest.raises(ValueError, match="same first dimension"):
        draw()
    assert not list(tmp_path.iterdir())
    assert mpl.rcParams["font.size"] != 30.0
