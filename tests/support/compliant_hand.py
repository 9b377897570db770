"""A compliant hand, 1500 N/m and 15 N m/rad, drags a tool in MuJoCo; the sensor sits between hand and tool."""

import mujoco
import numpy as np

from support.recordings import Truth, frames, noisy, turned, wander

STEP, EVERY = 5e-4, 20
GEOM = {
    "point": '<geom type="sphere" size=".002" pos=".02 -.01 -.1"/>',
    "sphere": '<geom type="sphere" size=".002" pos=".02 -.01 -.1"/>',
    "line": '<geom type="capsule" size=".002" fromto="-.05 0 -.1 .07 0 -.1"/>',
    "face": '<geom type="box" size=".06 .06 .01" pos=".01 0 -.1"/>',
}
JOINT = {
    "hinge": '<joint type="hinge" axis="0 .2 1" pos=".3 .1 0" frictionloss=".02"/>',
    "slide": '<joint type="slide" axis="1 .3 0" frictionloss=".5"/>',
    "ball": '<joint type="ball" pos="0 .02 -.12" frictionloss=".01"/>',
    "peg": '<joint type="slide" axis=".1 0 1" frictionloss=".5"/>'
    '<joint type="hinge" axis=".1 0 1" pos=".01 .01 0" frictionloss=".02"/>',
}
HEIGHT = {"face": 0.11, "point": 0.102, "line": 0.102, "sphere": 0.102}
KINDS = (*GEOM, *JOINT)
TIP = np.array([0.02, -0.01, -0.1])


def model(kind):
    ground = (
        '<geom type="sphere" size=".15" pos=".02 -.01 -.15"/>'
        if kind == "sphere"
        else '<geom type="plane" size="1 1 .1"/>'
    )
    ground = ground if kind in GEOM else ""
    return f"""<mujoco>
    <option timestep="{STEP}" gravity="0 0 0" cone="elliptic" impratio="20" integrator="implicitfast"/>
    <default><geom friction=".3 .0001 .0001" condim="4" solref=".003 1" solimp=".95 .99 .0005"/></default>
    <worldbody>{ground}<body name="tool" pos="0 0 {HEIGHT.get(kind, 0.1)}">{JOINT.get(kind, "<freejoint/>")}
    <inertial pos="0 0 -.03" mass=".3" diaginertia="5e-4 5e-4 5e-4"/>{GEOM.get(kind, "")}</body></worldbody></mujoco>"""


def truth(kind):
    base, tool, z = np.eye(4), np.eye(4), HEIGHT.get(kind, 0.1)
    if kind in GEOM:
        tool[:3, 3] = [0.0, 0.0, -0.1] if kind == "line" else TIP
    if kind in ("hinge", "peg", "slide"):
        axis = {"hinge": [0, 0.2, 1], "peg": [0.1, 0, 1], "slide": [1, 0.3, 0]}[kind]
        base[:3, 2] = np.array(axis) / np.linalg.norm(axis)
        base[:3, 3] = {"hinge": [0.3, 0.1, z], "peg": [0.01, 0.01, z], "slide": [0, 0, z]}[kind]
    if kind == "ball":
        base[:3, 3] = [0.0, 0.02, z - 0.12]
    side = "base" if kind in ("point", "line", "sphere") else "both"
    return Truth(kind, side, base, tool, radius=0.152)


def drag(kind, seed, duration=6.0, tilted=None):
    """(n, 4, 4) poses, (n, 6) wrenches at 100 Hz, and the truth.

    With `tilted`, a share of the time, a face is turned about one of its edges there, and stays on it.
    """
    rng = np.random.default_rng([seed, KINDS.index(kind), 3])
    m = mujoco.MjModel.from_xml_string(model(kind))
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    b = m.body("tool").id
    x0, R0 = d.xpos[b].copy(), d.xmat[b].reshape(3, 3).copy()
    t = np.arange(int(duration / STEP)) * STEP
    ramp = np.minimum(1.0, t / 0.5)[:, None]
    big, down = 0.01 if kind == "ball" else 0.05, 0.006 if kind in GEOM else 0.0
    lift = wander(rng, t, big if kind in ("hinge", "slide", "peg") else 0.001) - down
    pos = np.stack((wander(rng, t, big), wander(rng, t, big), lift), axis=1) * ramp
    rot = np.stack((wander(rng, t, 0.2), wander(rng, t, 0.2), wander(rng, t, 0.3)), axis=1) * ramp
    if kind == "hinge":
        pos[:, 1] += 0.12 * np.sin(3.0 * np.pi * t / duration) * ramp[:, 0]
        rot = 0.3 * rot
    if kind in ("face", "line"):
        rot[:, 1] *= 0.02
    if kind == "face":
        rot[:, 0] *= 0.02
    if kind == "sphere":
        pos[:, 2] -= (pos[:, 0] ** 2 + pos[:, 1] ** 2) / 0.3
    if tilted is not None:
        lean = 0.3 * np.clip((t - tilted * duration) / 0.5, 0.0, 1.0)
        rot[:, 0] = np.where(t > tilted * duration, lean + 0.05 * np.sin(5.0 * t) * (lean > 0.29), rot[:, 0])
        rot[:, 2] *= np.where(t > tilted * duration, 0.3, 1.0)
        pos[:, 2] += HEIGHT["face"] * (np.cos(rot[:, 0]) - 1.0) + 0.06 * np.sin(lean)
    goal = R0 @ turned(rot * [0, 0, 1]) @ turned(rot * [1, 1, 0])  # about the normal first: an edge stays on its plane
    X, w, v = [], [], np.zeros(6)
    for k in range(len(t)):
        R, x = d.xmat[b].reshape(3, 3), d.xpos[b]
        mujoco.mj_objectVelocity(m, d, mujoco.mjtObj.mjOBJ_XBODY, b, v, 0)
        f = 1500.0 * (x0 + pos[k] - x) - 25.0 * v[3:]
        E = goal[k] @ R.T
        small = np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]]) / 2.0
        moment = 15.0 * small - 0.15 * v[:3]
        if k % EVERY == 0:
            X.append(frames(R.copy(), x.copy()))
            w.append(np.concatenate((R.T @ moment, R.T @ f)))
        d.xfrc_applied[b, :3], d.xfrc_applied[b, 3:] = f, moment + np.cross(x - d.xipos[b], f)
        mujoco.mj_step(m, d)
    X, w = noisy(rng, np.array(X)[60:], np.array(w)[60:])
    return X, w, truth(kind)
