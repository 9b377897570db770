"""What becomes of the robot files of PyPI packages: loaded and compared, or refused, and what the message says.

    python tests/benchmarks/robot_files.py [--refused] [FOLDER ...]

Without folders: the files of example-robot-data, robosuite, gymnasium-robotics, pybullet, gym-aloha, rtb-data and
airo-models, of those that are installed (pip install --no-deps PACKAGE is enough). Each URDF, xacro and MJCF is loaded
as a user would load it, without further arguments; tool pose and position limits in random states are compared with
Pinocchio's reading of a URDF, mimic joints included, and MuJoCo's of an MJCF. Objects that only look like robots, such
as the 900 shapes of pybullet's `random_urdfs`, are counted apart. Takes three minutes; exits with 1 where a reading
differs or an exception is no error of this library.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import Counter
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import pinocchio as pin

import invariantqp as iq
from invariantqp.errors import InvariantQPError
from invariantqp.robots.load import _example_data_folder

PACKAGES = ("robosuite", "gymnasium_robotics", "pybullet_data", "gym_aloha", "rtbdata", "airo_models")
OBJECTS = ("random_urdfs", "objects", "/object/")
# What is said of files that are none of a robot with joints.
NO_ROBOT = ("a single body", "the manifest", "a launch file", "SDF", "no joint moves", "a mesh", "a world;")
ENOUGH = 1e-9
STATES = 5


class Outcome(NamedTuple):
    """Of one file."""

    kind: str  # "loaded", "refused", "differs", "no robot", "crashed"
    what: str = ""  # the message, or how far the reading is off


def folders() -> Iterator[Path]:
    """Of the packages that are installed."""
    yield _example_data_folder()
    for package in PACKAGES:
        found = find_spec(package)
        if found is not None:
            yield from map(Path, found.submodule_search_locations or ())


def files(folder: Path) -> list[Path]:
    """Of robots, by their names."""
    return sorted(p for p in folder.rglob("*") if p.suffix in (".urdf", ".xacro", ".xml", ".mjcf") and p.is_file())


def outcome(path: Path) -> Outcome:
    """What becomes of a file."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            robot = iq.load_robot(path)
    except InvariantQPError as error:
        said = str(error)
        return Outcome("no robot" if any(words in said for words in NO_ROBOT) else "refused", said)
    except Exception as error:  # noqa: BLE001 - that is what is looked for
        return Outcome("crashed", f"{type(error).__name__}: {error}")
    try:
        off = by_mujoco(path, robot) if is_mjcf(path) else by_pinocchio(path, robot)
    except (ValueError, RuntimeError) as error:
        return Outcome("loaded", f"not compared: {str(error)[:80]}")
    return Outcome("loaded" if off < ENOUGH else "differs", f"{off:.1e}")


def is_mjcf(path: Path) -> bool:
    """Whether it is a model of MuJoCo's."""
    return "<mujoco" in path.read_text(errors="replace")[:4000]


def by_pinocchio(path: Path, robot: iq.robots.Chain) -> float:
    """How far poses and limits are from Pinocchio's."""
    text = path.read_text()
    model = pin.buildModelFromXML(text, mimic=True)
    data, rng, off = model.createData(), np.random.default_rng(0), 0.0
    ids = [model.getJointId(name) for name in robot.names]
    for i, low, high in zip(ids, robot.position_lower, robot.position_upper, strict=True):
        if model.nqs[i] == 1:
            at = model.idx_qs[i]
            for ours, theirs in ((low, model.lowerPositionLimit[at]), (high, model.upperPositionLimit[at])):
                if np.isfinite(ours) and theirs < 1e9 and robot.coupled is None:
                    off = max(off, abs(ours - theirs))
    frame = model.getFrameId(robot.tool)
    for _ in range(STATES):
        q = rng.uniform(-1.0, 1.0, len(robot.names))
        v, whole = np.zeros(model.nv), np.clip(pin.neutral(model), model.lowerPositionLimit, model.upperPositionLimit)
        for i, x in zip(ids, q, strict=True):
            whole[model.idx_qs[i] :][: model.nqs[i]] = pin.neutral(model)[model.idx_qs[i] :][: model.nqs[i]]
            v[model.idx_vs[i]] = x
        pin.framesForwardKinematics(model, data, pin.integrate(model, whole, v))
        off = max(off, float(np.abs(data.oMf[frame].homogeneous - robot.pose(q)).max()))
    return off


def by_mujoco(path: Path, robot: iq.robots.Chain) -> float:
    """How far poses and limits are from MuJoCo's."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, rng, off = mujoco.MjData(model), np.random.default_rng(0), 0.0
    held = {model.joint(i).name for i in range(model.njnt)} - set(robot.names)
    for name, low, high in zip(robot.names, robot.position_lower, robot.position_upper, strict=True):
        limited = model.jnt_limited[model.joint(name).id] and robot.coupled is None
        if limited and np.abs(model.joint(name).range - (low, high)).max() > ENOUGH:
            return float(np.abs(model.joint(name).range - (low, high)).max())
    for _ in range(STATES):
        q = rng.uniform(-1.0, 1.0, len(robot.names))
        data.qpos[:] = model.qpos0
        for name in held:
            joint = model.joint(name)
            if joint.type[0] in (2, 3):
                low, high = joint.range if model.jnt_limited[joint.id] else (0.0, 0.0)
                data.qpos[joint.qposadr[0]] = np.clip(0.0, low, high)
        for name, x in zip(robot.names, q, strict=True):
            data.qpos[model.joint(name).qposadr[0]] = x
        mujoco.mj_kinematics(model, data)
        place = data.site(robot.tool) if mujoco.mj_name2id(model, 6, robot.tool) >= 0 else data.body(robot.tool)
        there = np.eye(4)
        there[:3, :3], there[:3, 3] = place.xmat.reshape(3, 3), place.xpos
        off = max(off, float(np.abs(there - robot.pose(q)).max()))
    return off


def main() -> int:
    """The table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--refused", action="store_true", help="each file that is refused, with the message")
    given = parser.parse_args()
    kinds, total, bad = ("loaded", "refused", "no robot", "differs", "crashed"), Counter[str](), False
    print(f"{'package':24}" + "".join(f"{kind:>10}" for kind in (*kinds, "objects")))
    for folder in given.folders or folders():
        found: Counter[str] = Counter()
        for path in files(folder):
            if any(name in str(path) for name in OBJECTS):
                found["objects"] += 1
                continue
            one = outcome(path)
            found[one.kind] += 1
            bad = bad or one.kind in ("differs", "crashed")
            if one.kind in ("differs", "crashed") or (given.refused and one.kind == "refused"):
                print(f"  {one.kind}: {path.relative_to(folder)}: {one.what[:300]}")
        total += found
        print(f"{folder.name:24}" + "".join(f"{found[kind]:10}" for kind in (*kinds, "objects")), flush=True)
    print(f"{'all':24}" + "".join(f"{total[kind]:10}" for kind in (*kinds, "objects")))
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
