"""What an arm looks like: its parts are where Pinocchio places its meshes, and few enough to send."""

import os
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from support.views import TASK

import invariantqp as iq
from invariantqp.errors import install_command
from invariantqp.robots.load import urdf_of
from invariantqp.workbench.runs.taskfile import task_from
from invariantqp.workbench.view import appearance, meshes
from invariantqp.workbench.view.appearance import TRIANGLES, Appearance, appearance_of

WHEELED = """<robot name="r"><material name="red"><color rgba="1 0 0 1"/></material>
<link name="base"><visual><origin xyz="0 0 0.1"/><geometry><box size="0.2 0.4 0.2"/></geometry></visual></link>
<link name="arm"><visual><origin xyz="0.5 0 0" rpy="0 1.5707963267948966 0"/>
<geometry><cylinder radius="0.1" length="1"/></geometry><material name="red"/></visual></link>
<link name="tip"><visual><geometry><sphere radius="0.05"/></geometry></visual></link>
<link name="far"><visual><geometry>{far}</geometry></visual></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.2"/>
<axis xyz="0 0 1"/><limit velocity="1"/></joint>
<joint name="slide" type="prismatic"><parent link="arm"/><child link="tip"/><origin xyz="1 0 0"/><axis xyz="1 0 0"/>
<limit lower="0.1" upper="0.5" velocity="1"/></joint>
<joint name="end" type="fixed"><parent link="tip"/><child link="far"/><origin xyz="0.2 0 0"/></joint></robot>"""


def task_of(source, n, **robot):
    path = {"kind": "joints", "duration": 0.1, "waypoints": [[0.2] * n]}
    return task_from({**TASK, "robot": {"source": source, "start": [0.2] * n, **robot}, "path": path}, "one")


def look(task):
    return appearance_of(task.load_robot(), task.urdf)


def box(vertices):
    return np.array([vertices.min(axis=0), vertices.max(axis=0)])


def written(tmp_path, far="<sphere radius='0.1'/>"):
    file = tmp_path / "arm.urdf"
    file.write_text(WHEELED.format(far=far))
    return file


def test_parts_are_where_pinocchio_places_the_meshes():
    name = "ur5"
    robot = iq.load_robot(name)
    file = urdf_of(name)
    found = look(task_of(name, len(robot.names)))
    assert 0.5 * TRIANGLES < sum(len(part.faces) for part in found.parts) < 1.2 * TRIANGLES
    model = pin.buildModelFromUrdf(str(file))
    shapes = pin.buildGeomFromUrdf(model, str(file), pin.GeometryType.VISUAL, None, str(file.parents[4]))
    q = np.random.default_rng(2).uniform(-1.0, 1.0, len(robot.names))
    full = np.clip(pin.neutral(model), model.lowerPositionLimit, model.upperPositionLimit)
    for joint, x in zip(robot.names, q, strict=True):
        full[model.joints[model.getJointId(joint)].idx_q] = x
    data, seen = model.createData(), shapes.createData()
    pin.updateGeometryPlacements(model, data, shapes, seen, full)
    corners = []
    for shape, place in zip(shapes.geometryObjects, seen.oMg, strict=True):
        found_there = meshes.read_meshes(Path(shape.meshPath))
        corners += [m.vertices * shape.meshScale @ place.rotation.T + place.translation for m in found_there]
    moved = robot.motions(q)
    parts = [part.vertices @ moved[part.joint][:3, :3].T + moved[part.joint][:3, 3] for part in found.parts]
    np.testing.assert_allclose(box(np.vstack(parts)), box(np.vstack(corners)), atol=0.006)


def test_plain_shapes_are_as_the_urdf_says(tmp_path):
    found = look(task_of(str(written(tmp_path)), 2))
    at = {(part.joint, part.colour): box(part.vertices) for part in found.parts}
    np.testing.assert_allclose(at[0, appearance.GREY], [[-0.1, -0.2, 0.0], [0.1, 0.2, 0.2]], atol=1e-9)
    np.testing.assert_allclose(at[1, (255, 0, 0)], [[0.0, -0.1, 0.1], [1.0, 0.1, 0.3]], atol=2e-3)
    np.testing.assert_allclose(at[2, appearance.GREY], [[0.95, -0.1, 0.1], [1.3, 0.1, 0.3]], atol=5e-3)


def test_a_joint_that_is_held_stands_where_the_arm_holds_it(tmp_path):
    file = written(tmp_path)
    robot = iq.load_robot(file, "tip", ["turn"])
    found = look(task_of(str(file), 1, tool="tip", joints=["turn"]))
    assert {part.joint for part in found.parts} == {0, 1}
    assert max(part.vertices[:, 0].max() for part in found.parts) == pytest.approx(
        robot.pose([0.0])[0, 3] + 0.3, abs=5e-3
    )


def test_without_all_meshes_there_is_no_look(tmp_path, monkeypatch):
    for gone in ("<mesh filename='none.stl'/>", "<mesh filename='package://none/none.stl'/>"):
        assert look(task_of(str(written(tmp_path, gone)), 2)).missing.startswith("drawn by its joints: ")
    assert look(task_of("ur5e", 6)) == Appearance()
    monkeypatch.setitem(sys.modules, "fast_simplification", None)
    monkeypatch.delitem(sys.modules, "invariantqp.workbench.view.meshes")
    said = look(task_of(str(written(tmp_path, "<sphere radius='0.11'/>")), 2))  # read by no other test
    assert said == Appearance(missing=f"{install_command('meshes')} draws its meshes")


def test_a_shape_that_cannot_be_read_is_told(tmp_path):
    for broken, why in (("<box size='1 2'/>", "size='1 2'; expected 3 finite numbers"), ("<cone/>", "'cone'")):
        found = look(task_of(str(written(tmp_path, broken)), 2))
        assert not found.parts
        assert found.missing.startswith("drawn by its joints: ")
        assert why in found.missing


@pytest.mark.parametrize(
    ("kind", "size"), [("capsule", (0.2, 1.0)), ("cylinder", (0.2, 1.4)), ("box", (0.4, 0.4, 1.4))]
)
def test_plain_shapes_lie_about_the_origin_along_z(kind, size):
    bounds = box(meshes.plain(kind, size).vertices)
    np.testing.assert_allclose(bounds, [[-0.2, -0.2, -0.7], [0.2, 0.2, 0.7]], atol=2e-3)


@pytest.mark.filterwarnings("error")
def test_a_shape_without_a_surface_does_not_take_the_others_along(tmp_path):
    found = look(task_of(str(written(tmp_path, "<sphere radius='0'/>")), 2))
    assert [part.joint for part in found.parts] == [0, 1, 2]


def test_a_mirrored_mesh_is_seen_from_outside(tmp_path):
    mirrored = "<mesh filename='box.stl' scale='1 -1 1'/></geometry><material name='blue'><color rgba='0 0 inf 1'/>"
    mirrored += "</material><geometry>"
    trimesh.creation.box().export(tmp_path / "box.stl")
    found = look(task_of(str(written(tmp_path, mirrored)), 2))
    part = next(part for part in found.parts if part.colour == (0, 0, 255))
    assert trimesh.Trimesh(part.vertices, part.faces).volume == pytest.approx(1.0)


def test_a_file_without_triangles_is_no_mesh(tmp_path):
    (tmp_path / "empty.obj").write_text("v 0 0 0")
    said = look(task_of(str(written(tmp_path, "<mesh filename='empty.obj'/>")), 2))
    assert said == Appearance(missing="drawn by its joints: empty.obj has no triangles")


def test_a_mesh_is_read_once_and_again_when_it_has_changed(tmp_path, monkeypatch):
    reads, read = [], meshes.read_meshes
    monkeypatch.setattr(meshes, "read_meshes", lambda file: (reads.append(file), read(file))[1])
    mesh = tmp_path / "box.stl"
    trimesh.creation.box().export(mesh)
    twice = "<mesh filename='box.stl'/></geometry></visual><visual><geometry><mesh filename='box.stl'/>"
    task = task_of(str(written(tmp_path, twice)), 2)
    first = look(task)
    assert look(task) is first
    assert reads == [mesh]
    trimesh.creation.box([3.0, 3.0, 3.0]).export(mesh)
    os.utime(mesh, (0, 0))
    assert max(part.vertices[:, 1].max() for part in look(task).parts) == pytest.approx(1.5)
    assert reads == [mesh, mesh]
