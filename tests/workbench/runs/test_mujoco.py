"""MuJoCo's model of an arm and a contact, against Pinocchio, a spring's law and statics."""

import mujoco
import numpy as np
import pytest

import invariantqp as iq
from invariantqp.robots.load import EXAMPLE_ROBOTS, urdf_of
from invariantqp.workbench.runs.contactspec import Physics
from invariantqp.workbench.runs.mujoco import MujocoPlant
from invariantqp.workbench.runs.plant import HingeSprings, Plane, SimulatedSensor, SurfaceSprings

READY = np.array([0.0, 0.1, 0.0, -2.2, 0.0, 2.3, 0.785])
SILENT = Physics(force_noise=0.0, moment_noise=0.0)
DT = 0.002
FACE = np.array([[-0.03, -0.02, 0.0], [0.03, -0.02, 0.0], [0.03, 0.02, 0.0], [-0.03, 0.02, 0.0]])


def panda(touch=None, wrist=None, physics=SILENT):
    robot = iq.load_robot("panda")
    return robot, MujocoPlant(urdf_of("panda"), robot, READY, DT, touch, wrist, physics)


@pytest.mark.parametrize("name", EXAMPLE_ROBOTS)
def test_kinematics_agree_with_mujocos(name):
    robot = iq.load_robot(name)
    rng = np.random.default_rng(0)
    q = rng.uniform(np.maximum(robot.position_lower, -2.0), np.minimum(robot.position_upper, 2.0))
    plant = MujocoPlant(urdf_of(name), robot, q, DT, None)
    np.testing.assert_allclose(plant.state().pose, robot.pose(q), atol=1e-12)
    linear, angular = np.zeros((2, 3, plant.model.nv))
    mujoco.mj_jac(plant.model, plant.data, linear, angular, np.zeros(3), plant.model.body(robot.tool).id)
    dofs = [plant.model.joint(joint).dofadr[0] for joint in robot.names]
    np.testing.assert_allclose(np.vstack((angular, linear))[:, dofs], robot.jacobian(q), atol=1e-12)


def test_a_joint_held_at_a_limit_that_is_not_zero():
    joints = [f"panda_joint{i}" for i in (1, 2, 3, 5, 6, 7)]  # the fourth is held at -0.0698, its upper limit
    robot = iq.load_robot("panda", joints=joints)
    q = np.delete(READY, 3)
    plant = MujocoPlant(urdf_of("panda"), robot, q, DT, None)
    np.testing.assert_allclose(plant.state().pose, robot.pose(q), atol=1e-12)


def touches(T):
    """Each kind of contact half a millimetre into what the tool at pose T touches."""
    into = T[:3, 3] + [0.0, 0.0, 0.0005]
    up = np.array([0.0, 0.0, 1.0])
    strained = T.copy()
    strained[:3, 3] += [0.0004, 0.0, 0.0003]
    return {
        "point": SurfaceSprings(np.zeros((1, 3)), Plane(into, up), 2e4),
        "edge": SurfaceSprings(FACE[:2] - FACE[:2].mean(axis=0), Plane(into, up), 2e4),
        "face": SurfaceSprings(FACE, Plane(into, up), 1e4),
        "hinge": HingeSprings(FACE, strained, iq.revolute([0.0, 0.0, 1.0], T[:3, 3] + [0.4, 0.0, 0.0]), 2e4),
    }


@pytest.mark.parametrize("kind", ["point", "edge", "face", "hinge"])
def test_at_rest_contact_and_sensor_agree_with_the_springs(kind):
    robot = iq.load_robot("panda")
    touch = touches(robot.pose(READY))[kind]
    wrist = SimulatedSensor(iq.transform(translation=[0.02, 0.0, -0.12]), 0.3, (0.01, 0.0, 0.05))
    _, plant = panda(touch, wrist, SILENT.model_copy(update={"friction": 0.0, "hinge_friction": 0.0}))
    for _ in range(400):
        plant.command(np.zeros(7))
    now = plant.state()
    spring = touch.wrench(now.pose, touch.angle(now.pose, 0.0)) if kind == "hinge" else touch.wrench(now.pose)
    assert np.linalg.norm(spring[3:]) > 2.0
    np.testing.assert_allclose(now.wrench, spring, atol=2e-3)
    felt = iq.coadjoint(now.pose @ wrist.mount) @ plant.measure().wrench
    weight = np.array([0.0, 0.0, -0.3 * 9.80665])
    at = (now.pose @ wrist.mount @ [0.01, 0.0, 0.05, 1.0])[:3]
    np.testing.assert_allclose(felt, now.wrench + np.concatenate((np.cross(at, weight), weight)), atol=2e-3)


def test_velocity_loops_have_the_lag_and_carry_their_load():
    robot, plant = panda(physics=SILENT.model_copy(update={"lag": 0.02}))
    speed = 0.2
    travelled = []
    for _ in range(100):
        plant.command(np.full(7, speed))
        travelled.append(plant.state().q - READY)
    t = DT * np.arange(1, 101)
    first_order = speed * (t - 0.02 * (1.0 - np.exp(-t / 0.02)))
    np.testing.assert_allclose(np.array(travelled), np.tile(first_order[:, None], 7), atol=1.2 * speed * 1e-3)
    assert robot.names == tuple(mujoco.mj_id2name(plant.model, mujoco.mjtObj.mjOBJ_ACTUATOR, i) for i in range(7))


def test_sliding_has_coulomb_friction():
    robot = iq.load_robot("panda")
    T = robot.pose(READY)
    touch = touches(T)["point"]
    _, plant = panda(touch, physics=SILENT.model_copy(update={"friction": 0.3}))
    sideways = np.linalg.pinv(robot.jacobian(READY)) @ [*np.cross(T[:3, 3], [0.0, 0.02, 0.0]), 0.0, 0.02, 0.0]
    for _ in range(250):
        plant.command(sideways)
    force = plant.state().wrench[3:]
    assert force[2] > 2.0
    np.testing.assert_allclose(force[1], -0.3 * force[2], rtol=0.02)  # against the motion, at the cone's edge


def test_a_nut_goes_along_its_thread():
    """A tool turned about a screw's axis and moved along it by the pitch feels friction's power alone."""
    robot, pitch = iq.load_robot("panda"), 0.02
    T = robot.pose(READY)
    screw = iq.se3.helical([0.0, 0.0, 1.0], T[:3, 3], pitch)
    _, plant = panda(HingeSprings(FACE, T, screw, 1e4))
    forces = []
    for _ in range(500):
        now = plant.state()
        plant.command(np.linalg.pinv(robot.jacobian(now.q)) @ (0.5 * screw))
        forces.append(now.wrench)
    turned, risen = plant.data.joint("hinge").qpos[0], plant.data.joint("lead").qpos[0]
    assert 0.45 < turned < 0.5  # motors lag, the grip gives
    assert risen == pytest.approx(pitch * turned, rel=1e-3)
    powers = np.array(forces)[250:] @ screw
    assert powers.mean() == pytest.approx(-SILENT.hinge_friction, rel=0.02)


def test_commands_act_after_the_dead_time():
    moved = []
    for delay in (0.0, 3 * DT):
        _, plant = panda(physics=SILENT.model_copy(update={"delay": delay}))
        for _ in range(10):
            plant.command(np.full(7, 0.2))
        moved.append(plant.state().q)
        for _ in range(round(delay / DT)):
            plant.command(np.zeros(7))
    np.testing.assert_array_less(moved[1], moved[0])
    np.testing.assert_allclose(plant.state().q, moved[0], atol=1e-12)


def test_noise_has_its_deviation_and_seed():
    def readings(seed):
        _, plant = panda(physics=Physics(force_noise=1.0, moment_noise=0.1, seed=seed))
        return np.array([plant.measure().wrench for _ in range(2000)])

    once = readings(3)
    np.testing.assert_allclose(once.std(axis=0), [0.1, 0.1, 0.1, 1.0, 1.0, 1.0], rtol=0.1)
    np.testing.assert_array_equal(once, readings(3))
    assert not np.array_equal(once, readings(4))


def test_unsupported_contacts_and_robots_are_refused():
    robot = iq.load_robot("panda")
    T = robot.pose(READY)
    slanted = Plane(T[:3, 3], np.array([0.0, 0.0, 1.0]), (np.array([0.1, 0.0, 0.0]), np.array([0.1, 0.1, 0.0])))
    with pytest.raises(iq.BadInput, match=r"contact\.edges: found edges at another angle"):
        panda(SurfaceSprings(np.zeros((1, 3)), slanted, 1e4))
    task = iq.load_task("arm_3r")
    with pytest.raises(iq.BadInput, match="found a robot from joint screws"):
        iq.run_task(task, physics="mujoco")
    with pytest.raises(iq.BadInput, match='expected "ideal" or "mujoco"'):
        iq.run_task(task, physics="bullet")
