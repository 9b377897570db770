"""Force control beside its rivals at equal rate: robosuite's Wipe with four arms, and PyBullet with an iiwa.

    python tests/benchmarks/equal_rate.py wipe   [--seeds 91 92] [--arms Panda IIWA UR5e XArm7] [--laws ours line ...]
    python tests/benchmarks/equal_rate.py bullet [--seeds 91 92] [--scenes level tilted ...] [--contacts rigid ...]
    ... --json FILE               the results as JSON, too: examples/comparison/wipe.json and bullet.json are from it
    ... --tune [--seeds 1]        the grids that chose SETTINGS, for each arm in Wipe and each contact in PyBullet

Every law has the same readings and ticks of 2 ms, the rivals at most 20 mm/s along the press:

    ours        HybridController, without stiffness or delay declared
    line        v = c (f_d - f)
    admittance  M v' + D v = f_d - f, with c = 1/D and tau = M/D
    osc         operational space control, whose goal moves along the press by v = c (f_d - f): robosuite's own in Wipe,
                the same formula in PyBullet. It commands torques, so velocity motors cannot have it.

The first three command joint velocities, to the servo of `invariantqp.robosuite` in Wipe and a computed-torque servo in
PyBullet; line and admittance have their motion from `Controller.follow`. A cell has the force error [N rms], the largest
force [N], the share wiped (Wipe), the path error [mm rms] and the share of the time without contact: means over
seeds, and the largest force of all.
"""

# ruff: noqa: E501 (figures and simulators' arguments are long lines)
from __future__ import annotations

import json
import logging
import sys
import tempfile
import xml.etree.ElementTree as ET
from argparse import ArgumentParser
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import invariantqp as iq

# [s], along the press [m/s], of the pose [1/s], of its error [m/s].
DT, FASTEST, GAIN, CATCH_UP = 0.002, 0.02, 10.0, 0.1
INWARDS, NO_CONTACT = np.array([0.0, 0.0, -1.0]), 0.05  # below this share of the press there is no contact
LAWS = ("ours", "line", "admittance", "osc")

# A setting is c [m/s/N] and tau [s], for OSC c and kp [1/s^2].
GRIDS = {
    "wipe": {
        "line": [(c, 0.0) for c in (4e-4, 8e-4, 1.2e-3, 1.6e-3, 2.4e-3)],
        "admittance": list(product((8e-4, 1.6e-3, 2.4e-3, 4e-3), (0.01, 0.04))),
        "osc": list(product((4e-3, 8e-3, 1.6e-2, 3.2e-2), (150.0, 300.0))),
    },
    "bullet": {
        "line": [(c, 0.0) for c in (4e-4, 8e-4, 1.6e-3, 3.2e-3, 6.4e-3, 1.28e-2, 2.56e-2)],
        "admittance": [(c, 0.005) for c in (1.6e-3, 3.2e-3, 6.4e-3, 1.28e-2, 2.56e-2)],
        "osc": list(product((4e-3, 1.6e-2, 3.2e-2), (300.0, 1000.0))),
    },
}
# Those with the least force error on seed 1 (xArm7 on seed 2). On a rigid plate velocity motors fail with all of the grid.
SETTINGS = {
    ("Panda", "line"): (1.6e-3, 0.0),
    ("Panda", "admittance"): (4e-3, 0.01),
    ("Panda", "osc"): (3.2e-2, 150.0),
    ("IIWA", "line"): (1.6e-3, 0.0),
    ("IIWA", "admittance"): (4e-3, 0.01),
    ("IIWA", "osc"): (1.6e-2, 150.0),
    ("UR5e", "line"): (1.6e-3, 0.0),
    ("UR5e", "admittance"): (4e-3, 0.01),
    ("UR5e", "osc"): (3.2e-2, 300.0),
    ("XArm7", "line"): (2.4e-3, 0.0),
    ("XArm7", "admittance"): (4e-3, 0.01),
    ("XArm7", "osc"): (3.2e-2, 150.0),
    ("1e4 N/m", "line"): (2.56e-2, 0.0),
    ("1e4 N/m", "admittance"): (2.56e-2, 0.005),
    ("1e4 N/m", "osc"): (3.2e-2, 300.0),
    ("1e5 N/m", "line"): (6.4e-3, 0.0),
    ("1e5 N/m", "admittance"): (2.56e-2, 0.005),
    ("1e5 N/m", "osc"): (3.2e-2, 300.0),
    ("rigid", "line"): (8e-4, 0.0),
    ("rigid", "admittance"): (3.2e-3, 0.005),
    ("rigid", "osc"): (3.2e-2, 300.0),
    ("velocity motors, 1e4 N/m", "line"): (8e-4, 0.0),
    ("velocity motors, 1e4 N/m", "admittance"): (1.6e-3, 0.005),
    ("velocity motors, 1e5 N/m", "line"): (4e-4, 0.0),
    ("velocity motors, 1e5 N/m", "admittance"): (1.6e-3, 0.005),
    ("velocity motors, rigid", "line"): (4e-4, 0.0),
    ("velocity motors, rigid", "admittance"): (1.6e-3, 0.005),
}


def across(vector):
    return vector - INWARDS * (INWARDS @ vector)


def turn_to(target, tool):
    return iq.log(iq.transform(target[:3, :3] @ tool[:3, :3].T, np.zeros(3)))[:3]


def speed_of(error, c):
    return float(np.clip(c * error, -FASTEST, FASTEST))


class Rival:
    """One line (tau = 0) or an admittance, in place of a `HybridController`."""

    def __init__(self, loop, sensor, press, setting):
        self.loop, self.sensor, self.press, (self.c, self.tau), self.speed = loop, sensor, press, setting, 0.0

    def reset(self):
        self.speed = 0.0

    def step(self, q, target, reading, ahead, velocity=None, **_):
        robot = self.loop.robot
        tool = robot.pose(q)
        wrench = self.sensor.wrench(reading, tool)
        force = INWARDS @ wrench[3:]
        self.speed += (self.c * (self.press - force) - self.speed) * DT / (self.tau + DT)
        self.speed = speed_of(self.speed, 1.0)
        error = GAIN * across(target[:3, 3] - tool[:3, 3])
        error *= min(1.0, CATCH_UP / max(np.linalg.norm(error), 1e-12))
        twist = np.concatenate((GAIN * turn_to(target, tool), error + across(ahead[3:]) + self.speed * INWARDS))
        solution = self.loop.follow(q, twist, velocity)
        given = {"velocity": solution.velocity, "status": solution.status, "reason": solution.reason}
        return SimpleNamespace(**given, intensities=[force], J=robot.jacobian(q), wrench=wrench)


def figures(force, off, press, every_force):
    return {
        "rms": np.sqrt(np.mean((force - press) ** 2)),
        "largest": every_force.max(),
        "path": 1e3 * np.sqrt(np.mean(np.sum(off**2, axis=1))),
        "lost": 100.0 * np.mean(force < NO_CONTACT * press),
    }


# robosuite -------------------------------------------------------------------------------------------------------------

ARMS = ("Panda", "IIWA", "UR5e", "XArm7")
WIPE_PRESS, WIPE_SPEED, SPEED_THERE = 20.0, 0.1, 0.4  # [N], [m/s], [m/s]
HOVER, STRIP, POLICY = 0.02, 0.1, 20  # [m], [m], [Hz]


def wipe_environment(arm, law, setting, seed):
    import robosuite
    from robosuite.controllers import load_composite_controller_config
    from robosuite.environments.manipulation.wipe import DEFAULT_WIPE_CONFIG

    from invariantqp.robosuite import controller_config

    logging.disable(logging.WARNING)
    if law == "osc":
        config = load_composite_controller_config(robot=arm)
        osc = {"type": "OSC_POSE", "input_type": "absolute", "input_ref_frame": "world", "kp": setting[1]}
        config["body_parts"]["right"] |= osc
    else:
        config = controller_config(arm, press={"max_force": 60.0}, position_margin=0.12)
    task = {**DEFAULT_WIPE_CONFIG, "use_condensed_obj_obs": True, "use_robot_obs": False, "use_contact_obs": False}
    silent = {"has_renderer": False, "has_offscreen_renderer": False, "use_camera_obs": False, "use_object_obs": False}
    rate = {"control_freq": POLICY, "horizon": 60 * POLICY, "hard_reset": False}
    env = robosuite.make("Wipe", robots=arm, controller_configs=config, task_config=task, seed=seed, **rate, **silent)
    env.reset()
    return env


class Lines:
    """Straight lines at constant speed."""

    def __init__(self, points, speed):
        self.points = np.array(points, dtype=float)
        self.times = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1) / speed))
        self.ends = self.times[-1]

    def at(self, t):
        if t >= self.ends:
            return self.points[-1], np.zeros(3)
        k = np.searchsorted(self.times, t, side="right") - 1
        speed = (self.points[k + 1] - self.points[k]) / (self.times[k + 1] - self.times[k])
        return self.points[k] + (t - self.times[k]) * speed, speed


def raster(marks, top):
    """To and fro along x over all marks; the pad is wide along y."""
    (left, near), (right, far) = marks.min(axis=0), marks.max(axis=0)
    count = max(1, int(np.ceil((far - near) / STRIP)))
    strips = []
    for k in range(count):
        ends = [[x, near + (far - near) * (k + 0.5) / count, top] for x in (left - 0.02, right + 0.02)]
        strips += ends[:: 1 if k % 2 == 0 else -1]
    return strips


class Wipe:
    """An episode: a scripted policy at 20 Hz, the law and the record at 500 Hz."""

    def __init__(self, arm, law, setting, seed):
        self.env = env = wipe_environment(arm, law, setting, seed)
        env._update_observables = lambda force=False: None  # nobody looks at them
        self.part, self.law, self.setting = env.robots[0].part_controllers["right"], law, setting
        model, self.data = env.sim.model._model, env.sim.data
        self.tool, self.wrist = env.robots[0].eef_site_id["right"], model.site("gripper0_right_ft_frame").id
        self.weight = 9.81 * model.body_subtreemass[model.site_bodyid[self.wrist]]
        self.target, self.speed, self.pressing, self.rows = self.pose[:3, 3], np.zeros(3), False, []
        self.pre_action, env._pre_action = env._pre_action, self.record
        if law == "osc":
            self.run_controller, self.part.run_controller = self.part.run_controller, self.run_osc
        elif law != "ours":
            self.part.hybrid = Rival(self.part.free, self.part.hybrid.sensor, WIPE_PRESS, setting)

    @property
    def pose(self):
        return iq.transform(self.data.site_xmat[self.tool].reshape(3, 3), self.data.site_xpos[self.tool])

    @property
    def press(self):
        """What the tool exerts downwards: the sensor's reading without the weight behind it."""
        return self.weight - (self.data.site_xmat[self.wrist].reshape(3, 3) @ self.env.robots[0].ee_force["right"])[2]

    def record(self, action, policy_step):
        self.pre_action(action, policy_step)
        self.target = self.target + (0.0 if policy_step else DT) * self.speed
        self.rows.append((self.press, *(self.data.site_xpos[self.tool] - self.target)[:2]))

    def run_osc(self):
        """The goal is the target, and along the press what the force makes of it."""
        c, goal, z = self.setting[0], self.target.copy(), self.data.site_xpos[self.tool][2]
        if self.pressing:
            self.goal_z = np.clip(self.goal_z - DT * speed_of(WIPE_PRESS - self.press, c), z - 0.05, z + 0.05)
            goal[2] = self.goal_z
        self.part.goal_pos = goal
        return self.run_controller()

    def step(self, place, turn, speed, press):
        if press and not self.pressing:
            self.goal_z = self.data.site_xpos[self.tool][2]
        self.target, self.speed, self.pressing = place.copy(), speed, press > 0.0
        action = [*place, *iq.log(iq.transform(turn, np.zeros(3)))[:3]]
        action += [*speed, press] if self.law != "osc" else []
        return self.env.step(np.array(action))[2]

    def run(self, seconds):
        env, start, dt, still = self.env, self.pose, 1.0 / POLICY, np.zeros(3)
        bodies = [env.sim.model.body_name2id(mark.root_body) for mark in env.model.mujoco_arena.markers]
        marks = np.array([self.data.body_xpos[body] for body in bodies])
        either = [np.array([[0, s, 0], [s, 0, 0], [0, 0, -1.0]]) for s in (1, -1)]
        flat = max(either, key=lambda R: np.trace(R.T @ start[:3, :3]))
        path, turn = (
            Lines(raster(marks[:, :2], marks[:, 2].mean()), WIPE_SPEED),
            turn_to(iq.transform(flat, still), start),
        )
        above = path.points[0] + [0.0, 0.0, HOVER]
        high = max(start[2, 3], above[2])
        there = Lines([start[:3, 3], [*start[:2, 3], high], [*above[:2], high], above], SPEED_THERE)
        for t in np.arange(0.0, there.ends + 1.0, dt):
            place, speed = there.at(t)
            turned = iq.exp(np.append(min(1.0, t / there.ends) * turn, still))[:3, :3] @ start[:3, :3]
            self.step(place, turned, speed, 0.0)
        first, felt = len(self.rows), 0.0
        while felt < 0.25 and len(self.rows) - first < 12.0 / DT:
            self.step(path.points[0], flat, still, WIPE_PRESS)
            felt = felt + dt if self.press > 0.5 * WIPE_PRESS else 0.0
        begins, done, t = len(self.rows), felt < 0.25, 0.0
        while not done and t < min(path.ends + 0.5, seconds):
            place, speed = path.at(t)
            done, t = self.step(place, flat, speed, WIPE_PRESS), t + dt
        rows = np.array(self.rows)
        if felt < 0.25:  # no touch that lasts
            return {"rms": np.inf, "largest": rows[first:, 0].max(), "path": np.inf, "lost": 100.0, "wiped": 0.0}
        wiped = 100.0 * len(env.wiped_markers) / env.num_markers
        return {**figures(rows[begins:, 0], rows[begins:, 1:], WIPE_PRESS, rows[first:, 0]), "wiped": wiped}


# PyBullet --------------------------------------------------------------------------------------------------------------

HOME, RADIUS, GAP = [0.0, 0.5, 0.0, -1.4, 0.0, 1.2, 0.0], 0.01, 0.004  # [rad], [m], [m]
CUTOFF, NOISE = 50.0, 0.1 * np.array([1, 1, 1, 0.03, 0.03, 0.03])  # [Hz], [N; N m]
SUBSTEP, BANDWIDTH, PRESS = 1e-3, 150.0, 10.0  # [s], [rad/s], [N]
SLIDE, STROKE, RISE = 0.04, 0.06, 0.2  # [m/s], [m], [s]
TOUCH, SETTLES, LASTS, HEIGHT, FREQUENCY = 9.0, 1.0, 2.0, 0.005, 0.5  # [s], [s], [s]; of the plate that moves [m], [Hz]
CONTACTS = {
    "1e4 N/m": {"contactStiffness": 1e4, "contactDamping": 100.0},
    "1e5 N/m": {"contactStiffness": 1e5, "contactDamping": 500.0},
    "rigid": {},
}
SCENES, TILTS = ("level", "tilted", "moving", "velocity motors"), (1.0, 3.0, 5.0)  # [deg], rising along the path


def iiwa():
    """PyBullet's own, without meshes, with a ball at its flange."""
    import pybullet_data

    root = ET.parse(Path(pybullet_data.getDataPath()) / "kuka_iiwa" / "model.urdf").getroot()
    for link in root.iter("link"):
        for entry in [e for e in link if e.tag in ("visual", "collision")]:
            link.remove(entry)
    inertia = '<inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>'
    ball = f'<collision><geometry><sphere radius="{RADIUS}"/></geometry></collision>'
    root.append(ET.fromstring(f'<link name="tip"><inertial><mass value="0.2"/>{inertia}</inertial>{ball}</link>'))
    place = '<origin xyz="0 0 0.15"/><parent link="lbr_iiwa_link_7"/><child link="tip"/>'
    root.append(ET.fromstring(f'<joint name="tip_joint" type="fixed">{place}</joint>'))
    path = Path(tempfile.mkdtemp()) / "iiwa.urdf"
    ET.ElementTree(root).write(path)
    return path


class Bullet:
    """An iiwa over a plate. A seed draws where it stands, friction and noise."""

    def __init__(self, urdf, robot, contact, scene, tilt, seed):
        import pybullet as p

        self.p, self.robot, self.scene, self.random = p, robot, scene, np.random.default_rng(seed)
        p.resetSimulation()
        p.setTimeStep(SUBSTEP)
        p.setGravity(0, 0, -9.81)
        self.body = p.loadURDF(str(urdf), useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE)
        numbers = {p.getJointInfo(self.body, i)[1].decode(): i for i in range(p.getNumJoints(self.body))}
        self.joints, self.tip, n = [numbers[name] for name in robot.names], numbers["tip_joint"], len(HOME)
        self.home = np.array(HOME) + self.random.uniform(-0.1, 0.1, n)
        for i, q in zip(self.joints, self.home, strict=True):
            p.resetJointState(self.body, i, q)
        for i in range(p.getNumJoints(self.body)):
            p.changeDynamics(self.body, i, linearDamping=0, angularDamping=0, jointDamping=0)
        if scene != "velocity motors":
            p.setJointMotorControlArray(self.body, self.joints, p.VELOCITY_CONTROL, forces=[0.0] * n)
        self.start, self.commanded = robot.pose(self.home), self.home.copy()
        self.plate, friction = self.make_plate(np.radians(tilt)), self.random.uniform(0.1, 0.5)
        for link in range(-1, p.getNumJoints(self.plate)):
            p.changeDynamics(self.plate, link, lateralFriction=friction, **CONTACTS[contact])
        p.changeDynamics(self.body, self.tip, lateralFriction=1.0, **CONTACTS[contact])

    def make_plate(self, tilt):
        p, top = self.p, self.start[:3, 3] - [0.0, 0.0, RADIUS + GAP]
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.3, 0.3, 0.02])
        if self.scene != "moving":
            centre = top - 0.02 * np.array([0.0, -np.sin(tilt), np.cos(tilt)])
            return p.createMultiBody(0, box, -1, centre, p.getQuaternionFromEuler([tilt, 0, 0]))
        base = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.01] * 3)
        rail = {"linkMasses": [50], "linkCollisionShapeIndices": [box], "linkVisualShapeIndices": [-1]}
        rail |= {"linkParentIndices": [0], "linkJointTypes": [p.JOINT_PRISMATIC]}
        rail |= {"linkPositions": [[0, 0, 0.28]], "linkOrientations": [[0, 0, 0, 1]], "linkJointAxis": [[0, 0, 1]]}
        rail |= {"linkInertialFramePositions": [[0, 0, 0]], "linkInertialFrameOrientations": [[0, 0, 0, 1]]}
        return p.createMultiBody(0, base, -1, top - [0, 0, 0.3], **rail)

    def state(self):
        states = self.p.getJointStates(self.body, self.joints)
        return np.array([s[0] for s in states]), np.array([s[1] for s in states])

    def tick(self, command, since):
        """Of a joint velocity, or of the goal and kp of OSC: the mean force on the tip, and its part along the normal."""
        p, force, normal = self.p, np.zeros(3), 0.0
        for _ in range(round(DT / SUBSTEP)):
            if self.scene == "velocity motors":
                speeds = {"targetVelocities": command, "forces": [300.0] * len(command)}
                p.setJointMotorControlArray(self.body, self.joints, p.VELOCITY_CONTROL, **speeds)
            else:
                torque = self.osc(*command) if isinstance(command, tuple) else self.servo(command)
                p.setJointMotorControlArray(self.body, self.joints, p.TORQUE_CONTROL, forces=torque)
            if self.scene == "moving":
                phase = 2.0 * np.pi * FREQUENCY * max(0.0, since - SETTLES)
                z, rate = HEIGHT * (1.0 - np.cos(phase)), HEIGHT * 2.0 * np.pi * FREQUENCY * np.sin(phase)
                drive = {"force": 1e5, "positionGain": 0.5, "velocityGain": 1.0}
                p.setJointMotorControl2(self.plate, 0, p.POSITION_CONTROL, z, rate, **drive)
            p.stepSimulation()
            for c in p.getContactPoints(bodyA=self.body, linkIndexA=self.tip):
                force += c[9] * np.array(c[7]) + c[10] * np.array(c[11]) + c[12] * np.array(c[13])
                normal += c[9]
        return force * SUBSTEP / DT, normal * SUBSTEP / DT

    def dynamics(self):
        q, speed = self.state()
        bias = self.p.calculateInverseDynamics(self.body, list(q), list(speed), [0.0] * len(q))
        return q, speed, np.array(self.p.calculateMassMatrix(self.body, list(q))), np.array(bias)

    def servo(self, velocity):
        """Computed torque, to the integral of the commanded velocity; implicit in time."""
        q, speed, mass, bias = self.dynamics()
        self.commanded = self.commanded + SUBSTEP * velocity
        w, h = BANDWIDTH, SUBSTEP
        wanted = w * w * (self.commanded - q - h * speed) + 2.0 * w * (velocity - speed)
        return mass @ wanted / (1.0 + w * h) ** 2 + bias

    def osc(self, goal, kp):
        """robosuite's: position and orientation uncoupled, critically damped, the posture in the null space."""
        q, speed, mass, bias = self.dynamics()
        J, tool = self.robot.jacobian(q), self.robot.pose(q)
        J = np.vstack((J[:3], J[3:] + np.cross(J[:3], tool[:3, 3], axis=0)))
        wanted = kp * np.append(turn_to(goal, tool), goal[:3, 3] - tool[:3, 3]) - 2.0 * np.sqrt(kp) * J @ speed
        turns, moves, both = (np.linalg.inv(j @ np.linalg.solve(mass, j.T)) for j in (J[:3], J[3:], J))
        posture = mass @ (10.0 * (self.home - q) - 2.0 * np.sqrt(10.0) * speed)
        posture -= J.T @ both @ J @ np.linalg.solve(mass, posture)
        return J[:3].T @ turns @ wanted[:3] + J[3:].T @ moves @ wanted[3:] + posture + bias

    def path(self, s):
        """How far the target is along y, s after it set out, and its speed: to and fro."""
        arc = SLIDE / STROKE * (s - RISE * (1.0 - np.exp(-s / RISE)))
        return STROKE * np.sin(arc), SLIDE * (1.0 - np.exp(-s / RISE)) * np.cos(arc)

    def run(self, law, setting):
        sensor = iq.WrenchSensor(np.eye(4), order="force first", reads="reaction", noise=NOISE[0], cutoff=CUTOFF)
        task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], -INWARDS), [PRESS])
        if law == "ours":
            loop = iq.HybridController(self.robot, task, dt=DT, sensor=sensor, gain=GAIN)
        elif law != "osc":
            loop = Rival(iq.Controller(self.robot, dt=DT, gain=GAIN), sensor, PRESS, setting)
        t, touch, force, z, rows = 0.0, np.inf, np.zeros(3), self.start[2, 3], []
        while t < (touch + SETTLES + LASTS if touch < np.inf else TOUCH):
            y, speed = self.path(max(0.0, t - touch - SETTLES) if self.scene != "moving" else 0.0)
            target, ahead = self.start.copy(), np.array([0, 0, 0, 0, speed, 0])
            target[1, 3] += y
            q = self.state()[0]
            tool = self.robot.pose(q)
            off = tool[:2, 3] - target[:2, 3]
            reading = np.append(tool[:3, :3].T @ force, np.zeros(3)) + self.random.normal(0.0, NOISE)
            if law == "osc":
                pressed = -INWARDS @ tool[:3, :3] @ reading[:3]
                z = np.clip(z - DT * speed_of(PRESS - pressed, setting[0]), tool[2, 3] - 0.05, tool[2, 3] + 0.05)
                target[2, 3] = z
                command = target, setting[1]
            else:
                command = loop.step(q, target, reading, ahead).velocity
            force, normal = self.tick(command, t - touch)
            touch, t = min(touch, t) if normal > 0.5 else touch, t + DT
            rows.append((t, normal, *off))
        rows = np.array(rows)
        settled = rows[rows[:, 0] > touch + SETTLES]
        if touch == np.inf:
            return {"rms": PRESS, "largest": 0.0, "path": np.inf, "lost": 100.0}
        return figures(settled[:, 1], settled[:, 2:], PRESS, rows[:, 1])


# Tables ----------------------------------------------------------------------------------------------------------------


def tuned_for(row):
    """The arm, or the contact; velocity motors are tuned for themselves."""
    scene, _, contact = row.partition(", ")
    return row if not contact or scene == "velocity motors" else contact


def mean_of(runs):
    return {key: float((np.max if key == "largest" else np.mean)([run[key] for run in runs])) for key in runs[0]}


def cell(runs):
    mean = mean_of(runs)
    wiped = f", {mean['wiped']:.0f} %" if "wiped" in mean else ""
    return f"{mean['rms']:.2f}, {mean['largest']:.0f}{wiped}, {mean['path']:.1f}, {mean['lost']:.1f} %"


def runner(asked):
    """The rows, and what runs (row, law, setting, seed)."""
    if asked.where == "wipe":
        return asked.arms, lambda arm, *case: Wipe(arm, *case).run(4.0 if asked.tune else 60.0)
    import pybullet

    pybullet.connect(pybullet.DIRECT)
    urdf = iiwa()
    robot = iq.load_robot(str(urdf), tool="tip")

    def run(row, law, setting, seed):
        scene, _, contact = row.partition(", ")
        tilts = (0.0,) if scene != "tilted" else TILTS[1:2] if asked.tune else TILTS
        return mean_of([Bullet(urdf, robot, contact, scene, tilt, seed).run(law, setting) for tilt in tilts])

    scenes = [scene for scene in asked.scenes if not asked.tune or scene != "level"]
    return [f"{scene}, {contact}" for scene in scenes for contact in asked.contacts], run


def main():
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("where", choices=("wipe", "bullet"))
    parser.add_argument("--seeds", type=int, nargs="+")
    parser.add_argument("--tune", action="store_true")
    parser.add_argument("--json", type=Path)
    for name, choices in {"arms": ARMS, "scenes": SCENES, "contacts": CONTACTS, "laws": LAWS}.items():
        parser.add_argument(f"--{name}", nargs="+", default=list(choices), choices=list(choices))
    asked = parser.parse_args()
    (rows, run), found = runner(asked), {}
    for row, law, seed in product(rows, asked.laws, asked.seeds or ([1] if asked.tune else [91, 92])):
        key = tuned_for(row), law
        if law == "osc" and "velocity motors" in row:
            continue
        for setting in GRIDS[asked.where].get(law, []) if asked.tune else [SETTINGS.get(key)]:
            result = run(row, law, setting, seed)
            found.setdefault((*key, setting) if asked.tune else (row, law), []).append(result)
            shown = {name: round(float(number), 2) for name, number in result.items()}
            print(row, law, setting, seed, shown, file=sys.stderr, flush=True)
    if asked.tune:
        for key in dict.fromkeys(key[:2] for key in found):
            best = min((one for one in found if one[:2] == key), key=lambda one: mean_of(found[one])["rms"])
            print(f"    {key}: {best[2]},")
        return
    print("| | ", " | ".join(asked.laws), " |\n|", "---|" * (1 + len(asked.laws)), sep="")
    cells = {row: [cell(found[row, law]) if (row, law) in found else "-" for law in asked.laws] for row in rows}
    for row, cells_of_row in cells.items():
        print(f"| {row} |", " | ".join(cells_of_row), "|")
    if asked.json:
        asked.json.write_text(json.dumps({"laws": asked.laws, "rows": cells}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
