"""A loop in MuJoCo, written with mink and with a Controller on the same MJCF: a jump, a circle, out of reach and back.

Both are told limits of positions and velocities and the same gain; a Controller may be told acceleration limits too.
mink's row has Levenberg and Marquardt's damping of 1, with which it rests where a target is out of reach.

Run: python examples/32_from_mink.py [MJCF SITE]     a UR5e unless told
"""

import sys
from functools import partial
from time import perf_counter

import mink
import mujoco
import numpy as np

import invariantqp as iq

UR5E = """
<mujoco model="ur5e"><compiler angle="radian" autolimits="true"/><worldbody><body name="base" quat="0 0 0 -1">
 <body name="shoulder" pos="0 0 .163"><joint name="pan" axis="0 0 1" range="-6.28 6.28"/><geom size=".06"/>
  <body name="upper" pos="0 .138 0" quat="1 0 1 0"><joint name="lift" axis="0 1 0" range="-6.28 6.28"/>
   <geom size=".06"/><body name="forearm" pos="0 -.131 .425"><joint name="elbow" axis="0 1 0" range="-3.14 3.14"/>
    <geom size=".05"/>
    <body name="wrist 1" pos="0 0 .392" quat="1 0 1 0"><joint name="w1" axis="0 1 0" range="-6.28 6.28"/>
     <geom size=".04"/><body name="wrist 2" pos="0 .127 0"><joint name="w2" axis="0 0 1" range="-6.28 6.28"/>
      <geom size=".04"/><body name="wrist 3" pos="0 0 .1"><joint name="w3" axis="0 1 0" range="-6.28 6.28"/>
       <geom size=".04"/><site name="tool" pos="0 .1 0"/></body></body></body></body></body></body></body></worldbody>
</mujoco>"""
HOME = np.array([-1.57, -1.57, 1.57, -1.57, -1.57, 0.0])
DT, GAIN, FASTEST, ACCELERATION = 0.002, 10.0, np.pi, 40.0  # [s, 1/s, rad/s, rad/s^2]


def jump(start, t):
    """0.2 m sideways at once."""
    pose = start.copy()
    pose[0, 3] += 0.2 * (t > 0.1)
    return pose


def circle(start, t):
    """Ten centimetres about, every two seconds."""
    pose = start.copy()
    pose[:2, 3] += 0.1 * np.array([np.sin(np.pi * t), np.cos(np.pi * t) - 1.0])
    return pose


def away(start, t):
    """A metre beyond where it is, and back after two seconds."""
    pose = start.copy()
    pose[1, 3] += np.sign(start[1, 3] or 1.0) * (0.1 < t < 2.0)
    return pose


def with_mink(model, site):
    """A step by mink."""
    arm, task = mink.Configuration(model), mink.FrameTask(site, "site", 1.0, 1.0, gain=GAIN * DT, lm_damping=1.0)
    joints = [model.joint(i).name for i in range(model.njnt)]
    limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, dict.fromkeys(joints, FASTEST))]

    def step(q, target):
        arm.update(q)
        task.set_target(mink.SE3.from_matrix(target))
        return mink.solve_ik(arm, [task], DT, solver="daqp", limits=limits)

    return step


def with_controller(model, site, **options):
    """A step by a Controller on the same model."""
    robot = iq.load_robot(model, tool=site, velocity_limit=FASTEST)
    controller = iq.Controller(robot, dt=DT, gain=GAIN, **options)
    return lambda q, target: controller.step(q, target).velocity


def run(step, robot, motion, seconds=4.0):
    """Microseconds a step, largest joint acceleration [rad/s^2], millimetres at the end, joint speed there [rad/s]."""
    q, times, speeds, start = HOME.copy(), [], [np.zeros(len(HOME))], robot.pose(HOME)
    for i in range(round(seconds / DT)):
        target, before = motion(start, i * DT), perf_counter()
        v = step(q, target)
        times.append(perf_counter() - before)
        speeds.append(np.array(v))
        q = q + DT * speeds[-1]
    off = np.linalg.norm(robot.pose(q)[:3, 3] - target[:3, 3])
    accelerations = np.diff(speeds, axis=0) / DT
    return 1e6 * np.median(times), np.abs(accelerations).max(), 1e3 * off, np.abs(speeds[-1]).max()


def main(description=UR5E, site="tool"):
    """Print the table."""
    text = description.lstrip().startswith("<")
    model = (mujoco.MjModel.from_xml_string if text else mujoco.MjModel.from_xml_path)(description)
    robot = iq.load_robot(model, tool=site, velocity_limit=FASTEST)
    loops = {  # made anew for each motion: a controller with acceleration limits knows what it commanded last
        "mink": with_mink,
        "Controller": with_controller,
        f"Controller, {ACCELERATION:g} rad/s^2": partial(with_controller, acceleration_limit=ACCELERATION),
    }
    print(f"{'':8s}{'':24s}{'us a step':>10s}{'rad/s^2':>10s}{'mm at the end':>15s}{'rad/s there':>13s}")
    for motion in (jump, circle, away):
        for name, made in loops.items():
            us, acceleration, mm, speed = run(made(model, site), robot, motion)
            print(f"{motion.__name__:8s}{name:24s}{us:10.1f}{acceleration:10.1f}{mm:15.4f}{speed:13.4f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
