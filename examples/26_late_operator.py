"""An operator whose device is 100 ms away slides a tool against a wall, and hands it over to the robot while it moves.

The operator moves the tool in a plane, the robot keeps its height and attitude. What the operator feels comes 100 ms
late, and so does what the hand does; the arm is late, too, by 16 ms. A `LinkEnd` at the robot and one at the device let
out no more energy than came in at the other end, and say when they hold something back. The one at the robot is told
how late the arm is and how hard the wall may be, and in each tick what the tool did.

Run: python examples/26_late_operator.py
"""

from collections import deque

import numpy as np

import invariantqp as iq

DT, LATE, ARM, WALL, GAIN = 0.004, 25, 4, 1e4, 20.0  # [s], [ticks] each way, [ticks] of the arm, [N/m], [1/s]
STORE = 10.0**2 / (2.0 * WALL)  # [J] that 10 N take before the hand feels them
HANDED, FADE = 4.0, 0.3  # [s] when y is handed over, and how long that takes
READY = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])  # [rad]
X, Y, Z = (iq.se3.prismatic(axis) for axis in np.eye(3))
TURNS = [iq.revolute(axis) for axis in np.eye(3)]
BEFORE = iq.control.SharedTask(np.column_stack([Z, *TURNS]), np.column_stack([X, Y]))
AFTER = iq.control.SharedTask(np.column_stack([Y, Z, *TURNS]), X[:, None])  # y is the robot's, too


def run(robot, *, told, fade, linked=True):
    """Largest force on the wall [N], jump of the tool's velocity at the hand-over [m/s], what was said."""
    at_robot = iq.control.LinkEnd(dt=DT, passes="twist", store=STORE, **told)
    at_device = iq.control.LinkEnd(dt=DT, passes="wrench", store=STORE)
    loop, q, before, start = iq.Controller(robot, dt=DT), READY, READY, robot.pose(READY)
    hand, speed, said, forces, jumps, last = np.zeros(2), np.zeros(2), [], [], [], np.zeros(3)
    there, back = (deque([(np.zeros(6), 0.0)] * LATE, maxlen=LATE) for _ in range(2))
    coming = deque([np.zeros(7)] * ARM)
    for k in range(round(6.0 / DT)):
        t, tool = k * DT, robot.pose(q)
        to_tool = iq.adjoint(iq.transform(translation=-tool[:3, 3]))  # twists, from the base's origin to the tool point
        wanted = np.array([0.02 * (1.0 - np.cos(np.pi * min(t, 1.0))), 0.02 * np.sin(2.0 * t)])  # the arm's will

        (felt, told_by_robot), (asked, told_by_hand) = back[0], there[0]
        moved = np.array([0.0, 0.0, 0.0, *speed, 0.0])
        if linked:
            felt = at_device.step(moved, felt, told_by_robot).passed
        speed = speed + DT * (felt[3:5] + 250.0 * (wanted - hand) - 10.0 * speed) / 0.5  # a hand of 250 N/m and 0.5 kg
        hand = hand + DT * speed

        share = np.clip((t - HANDED) / fade, 0.0, 1.0) if fade else float(t >= HANDED)
        mine = (1.0 - share) * BEFORE.robot_projector + share * AFTER.robot_projector
        yours = (1.0 - share) * BEFORE.operator_projector + share * AFTER.operator_projector
        push = np.array([0.0, 0.0, 0.0, WALL * max(0.0, tool[0, 3] - start[0, 3] - 0.01), 0.0, 0.0])  # at the tool
        done = to_tool @ robot.jacobian(q) @ (q - before) / DT
        asked = yours @ asked
        if linked:
            tick = at_robot.step(asked, push, told_by_hand, done=yours @ done if told else None)
            asked = tick.passed
            said.append(tick.reason)
        there.append((moved, at_device.came_in))
        back.append((-push, at_robot.came_in))

        kept = start.copy()
        kept[:2, 3] = tool[:2, 3]
        own = to_tool @ (GAIN * iq.log(kept @ iq.inverse(tool)))
        coming.append(loop.follow(q, mine @ own + asked).velocity)
        before, q = q, q + DT * coming.popleft()
        velocity = (robot.pose(q)[:3, 3] - tool[:3, 3]) / DT
        if HANDED - 0.1 < t < HANDED + 1.0:
            jumps.append(np.linalg.norm(velocity - last))
        last = velocity
        forces.append(push[3])
        if forces[-1] > 1e3:
            break  # the wall would not stand it
    return max(forces), max(jumps, default=np.nan), [reason for reason in said if reason]


robot = iq.load_robot("panda")
force, _, _ = run(robot, told={}, fade=FADE, linked=False)
print(f"without the ends of a link: {force:.0f} N on the wall")
force, _, _ = run(robot, told={}, fade=FADE)
print(f"with them, and an arm that is thought to be at once: {force:.0f} N")
told = {"delay": DT * ARM, "stiffness": WALL}
force, jump, reasons = run(robot, told=told, fade=FADE)
print(f"told how late it is: {force:.1f} N; {len(reasons)} ticks said: {reasons[0]}")
_, hard, _ = run(robot, told=told, fade=0.0)
print(
    f"handed over at once, the tool's velocity jumps by {1e3 * hard:.0f} mm/s; over {FADE} s by {1e3 * jump:.1f} mm/s"
)
