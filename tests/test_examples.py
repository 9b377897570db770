"""Every example runs headless to its end."""

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.repeats import LONG

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
SAYS = {
    "01_pseudoinverse": "no 0-pseudoinverse",
    "02_five_joint_arm": "invariantqp ",
    "03_limits": "slowed down, not bent",
    "04_hybrid_pen": "touched after",
    "05_shared_control": "the operator slid the tool",
    "06_inside_pink": "the tool is 50.00 mm down",
    "07_speed_and_accuracy": "to do so again: invariantqp compare",
    "08_custom_form_and_limit": "my own osqp  went 20.000 mm",
    "09_hybrid_wipe": "a pitch is refused: a 3-system of type IIC",
    "11_which_pitch": "h = 4 L",
    "12_tool_speed": "fastest tool 2",
    "13_pose_ik": "along a path of 50 poses",
    "14_defaults": "posture_gain [1/s]; 2 tasks",
    "15_elastic_paths": "within 0.05 mm and 0.01 deg to the end: 1 of 1 tasks",
    "29_clearance": "at the limits of clearance: panda_hand and ball, 20.0 mm",
    "25_pink_scripts": "ours settles later in 0, and is then farther off in 0",
    "16_out_of_reach": "the same calls, invariantqp: a target held out of reach moves joints at 0.0 deg/s",
    "17_teleoperation": "ours: 0 steps above the limit",
    "18_servo_ros": "moving, no twist",
    "19_force_servo": "true press 10.0",
    "22_contact_scenes": "bar of 100 mm",
    "26_late_operator": "the tool's velocity jumps by",
    "20_stewart_platform": "",
    "21_paper": "7 differ, each by an erratum",
    "23_conventions": "conventions.svg",
    "24_gallery": "tasks and",
    "27_rail_and_two_arms": "m of the 2 m, the arm does the rest",
    "31_streams": "conveyor: on the part after",
    "32_from_mink": "Controller, 40 rad/s^2",
    "33_hand_guiding": "ur5    on a level alone",
    "34_move_until_contact": "ur5    along an arc",
    "35_insertion": "panda  1 of 1 in",
    "36_tare_and_weigh": "force first, reaction, 0.4",
    "37_force_profile": "['ok']",
    "38_force_ros": "no contact yet: approaching",
    "39_look_at": "at five times the gain",
    "40_origin_and_unit": "Moore-Penrose 2.382 rad/s",
    "41_gram_over_pitch": "type IA1: principal pitches",
    "42_cylindroid": "type IA: principal pitches",
    "43_pitch_field": "lies on the quadric of its pitch",
    "44_five_joints": "With the pitch h = 0.3 m/rad it changes by rounding only",
    "45_force_margins": "100 ms        1.00     0.00            5.24         55.4 deg     1.48",
}
# What makes a long one short.
ONE = ("--tasks", "1", "--jobs", "1")
SHORTER = {
    "11_which_pitch": ("20",),
    "13_pose_ik": ("1",),
    "14_defaults": (*ONE, "--only", "posture_gain"),
    "15_elastic_paths": ONE,
    "25_pink_scripts": ("--short",),
    "22_contact_scenes": ("so101", "--physics", "mujoco", "--seconds", "0.3", "--scene", "bar"),
    "24_gallery": ("gallery", "23_conventions"),
    "33_hand_guiding": ("ur5",),
    "35_insertion": ("1", "0.1", "panda"),
    "37_force_profile": ("panda",),
    "16_out_of_reach": ("film.gif", "1"),
}

# Numbers in a script that make it short where not all is asked for: longer ticks, fewer of them.
FEWER = {
    "06_inside_pink": {"STATES = 200": "STATES = 40"},
    "08_custom_form_and_limit": {"DT = 0.005": "DT = 0.01", "range(220)": "range(110)"},
    "09_hybrid_wipe": {"range(1000)": "range(600)"},
    "12_tool_speed": {"range(60)": "range(12)"},
    "15_elastic_paths": {"DT = 0.001": "DT = 0.002"},
    "17_teleoperation": {"FRAMES, RATE = 300": "FRAMES, RATE = 120", "0.01, 8.0": "0.01, 3.0"},
    "19_force_servo": {"TURN = 0.002": "TURN = 0.004", "= 3.0, 3.5, 8.0": "= 1.0, 1.2, 2.4", "3.0 / DT": "0.6 / DT"},
    "26_late_operator": {"HANDED, FADE = 4.0": "HANDED, FADE = 1.5", "6.0 / DT": "2.6 / DT"},
    "29_clearance": {"DT = 0.002": "DT = 0.004", "700, each": "350, each", "(500)": "(250)", "[200:]": "[100:]"},
    "32_from_mink": {"DT, GAIN, FASTEST, ACCELERATION = 0.002": "DT, GAIN, FASTEST, ACCELERATION = 0.008"},
    "34_move_until_contact": {"SPEED, TOUCH = 0.03": "SPEED, TOUCH = 0.01"},
    "35_insertion": {"DEPTH = 0.010, 1e-4, 0.02": "DEPTH = 0.010, 1e-4, 0.006"},
    "37_force_profile": {"= 9.0, 10.0, 12.0": "= 6.5, 7.0, 7.5"},
}


def test_every_example_is_listed():
    assert {e.stem for e in EXAMPLES} >= set(SAYS)


@pytest.mark.parametrize("example", EXAMPLES, ids=[e.stem for e in EXAMPLES])
def test_an_example_runs(example, tmp_path, monkeypatch, capfd):
    """In this process, where a warning is an error: starting one for each takes longer than most examples."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(example.parent)  # as for a script
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setattr(sys, "argv", [str(example), *SHORTER.get(example.stem, ())])
    script = example
    if example.stem in FEWER and not LONG:
        text = example.read_text(encoding="utf-8")
        for number, other in FEWER[example.stem].items():
            assert number in text
            text = text.replace(number, other)
        script = tmp_path / example.name
        script.write_text(text, encoding="utf-8")
    runpy.run_path(str(script), run_name="__main__")
    said, complained = capfd.readouterr()
    assert SAYS.get(example.stem, "") in said
    assert said
    assert not complained


def test_an_example_runs_in_a_process_of_its_own(tmp_path):
    command = [sys.executable, "-W", "error", EXAMPLES[0]]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")


def test_the_first_examples_are_short_enough_to_read():
    first = [e for e in EXAMPLES if e.stem < "10"]
    assert [e.stem for e in first if len(e.read_text(encoding="utf-8").splitlines()) >= 80] == []


def test_the_study_of_defaults_says_which_choice_is_dominated(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "examples")
    study = runpy.run_path(str(ROOT / "examples" / "14_defaults.py"))
    usual = [1.0, 1.0, 10.0, 1.0, 2.0, 1.0, 1.0]  # mm, deg, rad/s^2, s, moved [deg]; random; stays
    worse, other = [2.0, *usual[1:]], [0.5, 1.0, 20.0, *usual[3:]]
    table = study["table_of"](["usual", "worse", "other"], np.array([[usual, worse, other]]))
    cells = [list(column.cells) for column in table.columns]
    assert cells[2] == ["2.00  1.00  1.00  1.00", "4.00  1.00  1.00  1.00", "1.00  1.00  2.00  1.00"]
    assert cells[4] == ["0.0%", "100.0%", "0.0%"]
    assert cells[5] == ["2.000", "2.000", "2.000"]
