"""How long a tick takes: the engine, its definition, a hand-written Pinocchio + DAQP loop, Pink, mink and placo.

    python tests/benchmarks/table.py [TICKS OF EACH HARD STREAM, 1000000]

Medians and 99th percentiles in microseconds, and the ratio of each median to that of the hand-written loop or, without
one, to that of the engine. All take turns at every tick, so that a busy machine slows them down alike. A tick is
pose, Jacobian, law and limits, of a controller that remembers what it did before. The hand-written loop is damped least
squares in metres and radians inside the same joint limits, with rows for an exact position, and nothing is allocated
twice; it has no posture, no status and no tool speed. Pink, mink and placo are called as `invariantqp compare` calls
them, Pink and mink with DAQP; targets in their own form are made before. placo brings a Pinocchio of its own: its
column is filled where the environment has it (pip install placo '.[robots,pink,mink]'). A tick of a
`PathFollower` or of a `HybridController` drives the arm, and is compared with an ordinary tick in
the same states, where limits may be met that the follower keeps away from.

Tails are of hard streams, by the processor's time: a tick that took more than FIVE medians is repeated from the same
state, and counts where its least time is still more. So neither other programs nor the garbage collector do.
"""

from __future__ import annotations

import sys
from functools import partial
from time import perf_counter_ns, thread_time_ns

import daqp
import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from support.arms import ready

import invariantqp as iq
from invariantqp.velocity import batch
from invariantqp.workbench.compare.libraries import Mink, Pink, Placo
from invariantqp.workbench.compare.tasks import spec_of

OURS, PYTHON, HAND = "engine", "definition", "hand-written"
COLUMNS = (OURS, PYTHON, HAND, "Pink", "mink", "placo")
COUPLED = iq.limits.LimitRows(np.eye(7)[:1] + np.eye(7)[1:2], [-0.02], [0.02])
MANY = iq.limits.LimitRows(np.random.default_rng(0).normal(size=(32, 7)), -np.ones(32), np.ones(32))
CONTRARY = iq.limits.LimitRows(np.eye(7)[:2], [3.0, -9.0], [9.0, 9.0])
POINT, AXIS = iq.control.ExactPoint(), iq.control.ExactAxis([0.0, 0.0, 1.0])
ROUNDS = 40
PRESSED = 3000
SELDOM = 10  # of these the definition in Python takes part in one
POSES = 50
TICKS = 100
ROWS = 4096
FIVE = 5.0
AGAIN = 20  # times that a slow tick is repeated
# A tick along a path, or pressing, beside an ordinary tick in the same states.
ALONG = ((OURS, "engine, ordinary"),)


class HandWritten:
    """One tick of damped least squares by DAQP, as fast as a user can write it: one model, arrays allocated once."""

    def __init__(self, robot, dt, gain, exact):
        self.model, self.rate, self.gain = robot.model, 1.0 / dt, gain
        self.data, self.frame = robot.model.createData(), robot.model.getFrameId(robot.tool)
        m, k = robot.model.nv, 3 if exact else 0
        self.H, self.rows, self.solver = np.empty((m, m)), np.zeros((k, m)), daqp.Model()
        self.diagonal, self.sense = self.H.ravel()[:: m + 1], np.array([0] * m + [5] * k, dtype=np.int32)
        self.lower, self.upper = np.empty((2, m + k))
        fastest = robot.model.velocityLimit
        self.sides = (
            (self.upper[:m], robot.model.upperPositionLimit.copy(), fastest, np.minimum),
            (self.lower[:m], robot.model.lowerPositionLimit.copy(), -fastest, np.maximum),
        )
        self.exact = (self.lower[m:], self.upper[m:]) if exact else ()
        self.fill = self.solver.setup

    def step(self, q, target, ahead):
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        pose = pin.updateFramePlacement(model, data, self.frame)
        J = pin.getFrameJacobian(model, data, self.frame, pin.LOCAL)
        s = self.gain * pin.log6(pose.actInv(target)).vector
        s += pose.actInv(pin.Motion(ahead[3:], ahead[:3])).vector
        np.dot(J.T, J, out=self.H)
        self.diagonal += 1e-6
        for speeds, position, fastest, nearer in self.sides:
            np.subtract(position, q, out=speeds)
            np.multiply(speeds, self.rate, out=speeds)
            nearer(speeds, fastest, out=speeds)
        if self.exact:
            self.rows[:] = J[:3]
            for side in self.exact:
                side[:] = s[:3]
        self.fill(self.H, -J.T.dot(s), self.rows, self.upper, self.lower, self.sense)
        self.fill = self.solver.update
        self.rows = self.rows if self.exact else None  # which `update` takes for unchanged, and none for an error
        return self.solver.solve()[0]


def ticks_of(task, wanted, **options):
    """A controller, up to TICKS ticks of the task's path that are as wanted, and its memory before each."""
    robot = task.load_robot()
    controller = iq.Controller(robot, dt=task.law.dt, **options)
    pose, dt, q, found, kept = task.path.along(robot, task.start()), task.law.dt, task.start(), [], []
    for k in range(int(task.path.duration / dt)):
        target, ahead = pin.SE3(pose(k * dt)), iq.log(pose((k + 1) * dt) @ iq.inverse(pose(k * dt))) / dt
        before, solution = controller.state, controller.step(q, target, ahead)
        if wanted(solution):
            found.append((q, target, ahead))
            kept.append(before)
        q = q + dt * solution.velocity
    some = max(1, len(found) // TICKS)
    return controller, found[::some], kept[::some]


def times(calls, ticks, loops=(), kept=()):
    """Microseconds of each contender, who take turns; `loops` have what they keep set to `kept` before each tick."""
    took = {name: [] for name in calls}
    for k in range(ROUNDS):
        for i, tick in enumerate(ticks):
            for name, call in tuple(calls.items())[:: (-1) ** k]:  # what runs after Python finds its caches cold
                if name.startswith(PYTHON) and k % SELDOM:
                    continue
                for loop in loops:
                    loop.state = kept[i]
                took[name].append(timed(call, tick))
    return took


def timed(call, arguments):
    start = perf_counter_ns()
    call(*arguments)
    return 1e-3 * (perf_counter_ns() - start)


def cell(took, base):
    """A median, a 99th percentile, and the ratio of medians."""
    median = float(np.median(took))
    return f"{median:.1f} ({np.quantile(took, 0.99):.0f}) {median / float(np.median(base)):.2f}"


def line(title, took):
    """One row of the table."""
    base = took.get(HAND, took[OURS])
    cells = [cell(took[name], base) if name in took else "-" for name in COLUMNS]
    print(f"| {title} | {' | '.join(cells)} |", flush=True)


def line_along(title, took):
    """One row of the table of ticks along a path."""
    cells = [cell(took[name], took[pair[1]]) for pair in ALONG for name in pair]
    print(f"| {title} | {' | '.join(cells)} |", flush=True)


def peers(task, robot, ticks):
    """Pink's, mink's and placo's ticks, where they are installed and find an answer to each."""
    found = {}
    for name, library in (("Pink", Pink), ("mink", Mink), ("placo", Placo)):
        try:
            step = tick_of(library(spec_of(robot, task.law)), ticks)
            for tick in ticks:
                step(*tick)
            found[name] = step
        except ModuleNotFoundError:
            print(f"{name} is not installed")
        except Exception as failure:  # noqa: BLE001 (whatever a library raises)
            print(f"{name}: {failure}")
    return found


def tick_of(loop, ticks):
    """A library's tick, called as ours is."""
    targets = {id(target): loop.target(target.homogeneous, ahead) for _, target, ahead in ticks}
    still = np.zeros(len(loop.spec.names))

    def step(q, target, ahead):
        return loop.step(q, targets[id(target)], ahead, still)

    return step


def in_turn(took, calls, k):
    """One more time [us] of each call, of (name, function, arguments), the last one first in every second tick; what
    they return."""
    answers = {}
    for name, call, arguments in calls[:: (-1) ** k]:
        start = perf_counter_ns()
        answers[name] = call(*arguments)
        took.setdefault(name, []).append(1e-3 * (perf_counter_ns() - start))
    return answers


def pressed(arm, contact, **options):
    """Times in a loop that presses with 5 N on a spring along a circle, beside an ordinary tick."""
    robot, dt, took = iq.load_robot(arm), 0.002, {}
    first = ready(arm.removesuffix("e"))
    start, task = robot.pose(first), iq.HybridTask(contact(robot.pose(first)), [5.0])
    sensor = iq.WrenchSensor(np.eye(4), order="force first", reads="reaction", cutoff=50.0)
    for on, off in ALONG:
        loop = iq.HybridController(robot, task, dt=dt, sensor=sensor, **options)
        plain, random, q = iq.Controller(robot, dt=dt, **options), np.random.default_rng(0), first
        for k in range(PRESSED):
            T, turn = start.copy(), 2.0 * np.pi / 3.0
            T[:2, 3] += 0.03 * (np.cos(turn * dt * k) - 1.0), 0.03 * np.sin(turn * dt * k)
            ahead = np.zeros(6)
            ahead[3:5] = 0.03 * turn * -np.sin(turn * dt * k), 0.03 * turn * np.cos(turn * dt * k)
            push = 2e4 * max(0.0, start[2, 3] - 1e-3 - robot.pose(q)[2, 3])
            reading = np.concatenate((robot.pose(q)[:3, :3].T[:, 2] * push, np.zeros(3)))
            reading[:3] += 0.2 * random.normal(size=3)
            calls = (off, plain.step, (q, T, ahead)), (on, loop.step, (q, T, reading, ahead))
            q = q + dt * in_turn(took, calls, k)[on].velocity
    return took


def along_path(name, rate, **options):
    """Times along a smooth path of a random joint motion, beside an ordinary tick."""
    robot, rng, dt, took = iq.load_robot(name), np.random.default_rng(3), 0.002, {}
    low, high = np.maximum(robot.position_lower, -3.0), np.minimum(robot.position_upper, 3.0)
    joints = CubicSpline([0.0, 0.5, 1.0], 0.5 * (low + high) + rng.uniform(-0.25, 0.25, (3, len(low))) * (high - low))
    for on, off in ALONG:
        loop, plain = (iq.Controller(robot, dt=dt, **options) for _ in range(2))
        follower, q = iq.PathFollower(loop, lambda u: robot.pose(joints(u)), rate=rate), joints(0.0)
        follower.prepare(q)
        place, speed, velocity, status = 0.0, 0.0, np.zeros(len(q)), ""
        while status != "done":
            T, then = follower.pose(place), follower.pose(place + dt * speed)
            ordinary = q, pin.SE3(T), iq.log(then @ iq.inverse(T)) / dt, velocity
            calls = (off, plain.step, ordinary), (on, follower.step, (q,))
            found = in_turn(took, calls, len(took.get(on, ())))[on]
            place, speed, velocity, status = found.place, found.speed, found.velocity, found.status
            q = q + dt * velocity
    return took


def tails(name, count, **options):
    """Of a stream of targets that jump, in and out of reach: median and 99.9th percentile [us], how many ticks took
    more than FIVE medians, how many do however often they are repeated, and the slowest of these, repeated, in medians.
    """
    robot, rng, dt, block = iq.load_robot(name), np.random.default_rng(7), 0.002, 10_000
    loop = iq.Controller(robot, dt=dt, **options)
    low, high = np.maximum(robot.position_lower, -3.0), np.minimum(robot.position_upper, 3.0)
    q, took, slow, target = 0.5 * (low + high), [], [], None
    for begin in range(0, count, block):
        ticks, spent = [], []
        for k in range(min(block, count - begin)):
            if k % 100 == 0:
                target = robot.pose(rng.uniform(low, high)) @ iq.transform(translation=rng.normal(scale=0.2, size=3))
            ticks.append((loop.state, q))
            start = thread_time_ns()
            solution = loop.step(q, target)
            spent.append(1e-3 * (thread_time_ns() - start))
            ticks[-1] += (target,)
            q = q + dt * solution.velocity
        took += spent
        after, usual = loop.state, float(np.median(spent))
        for (kept, then, there), time in zip(ticks, spent, strict=True):
            if time > FIVE * usual:
                slow.append(min(repeated(loop, kept, then, there) for _ in range(AGAIN)) / usual)
        loop.state = after
    slower = [share for share in slow if share > FIVE]
    return float(np.median(took)), float(np.quantile(took, 0.999)), len(slow), len(slower), max(slow, default=0.0)


def repeated(loop, kept, q, target):
    """The processor's time of a tick from what a loop kept [us]."""
    loop.state = kept
    start = thread_time_ns()
    loop.step(q, target)
    return 1e-3 * (thread_time_ns() - start)


def hard_streams(count):
    """The table of tails."""
    print(f"\n| {count:,} ticks of a hard stream | median | p99.9 | above {FIVE:g} medians | repeated | slowest |")
    print("|---|---|---|---|---|---|")
    for title, name, options in (
        ("Panda", "panda", {}),
        ("Panda, acceleration limits", "panda", {"acceleration_limit": 10.0}),
        ("UR5", "ur5", {}),
        ("SO-101, exact position", "so101", {"exact": "position"}),
    ):
        median, most, slow, slower, slowest = tails(name, count, **options)
        print(
            f"| {title} | {median:.1f} | {most / median:.1f} medians | {slow} | {slower} | {slowest:.1f} |", flush=True
        )
    pressing()


def pressing():
    presses = (
        ("UR5e presses with 5 N, the contact a function of the pose", "ur5e", lambda _: at_the_tip, {}),
        ("likewise, the contact stands still", "ur5e", at_the_tip, {}),
        ("Panda, accelerations limited", "panda", lambda _: at_the_tip, {"acceleration_limit": 10.0}),
    )
    for title, name, contact, options in presses:
        line_along(title, pressed(name, contact, **options))


def at_the_tip(tool):
    return iq.point_contact(tool[:3, 3], [0.0, 0.0, 1.0])


def poses(name):
    """Random targets of an arm, in reach."""
    robot, rng = iq.load_robot(name), np.random.default_rng(0)
    low, high = robot.position_lower, robot.position_upper
    return robot, [(robot.pose(q), start) for q, start in rng.uniform(low, high, (POSES, 2, len(low)))]


def rows_a_second(width):
    """Rows a second: `solve_velocities` on all cores and on one; and a loop of DAQP, for which the Hessians of all rows
    are made at once. A kept `daqp.Model` is no faster there.
    """
    robot, rng = iq.load_robot("panda"), np.random.default_rng(0)
    J = np.array([robot.jacobian(q) for q in rng.uniform(robot.position_lower, robot.position_upper, (ROWS, 7))])
    s, limit = 0.1 * rng.normal(size=(ROWS, 6)), width * np.ones(7)
    sense, none, damping, least = np.zeros(7, dtype=np.int32), np.zeros((0, 7)), 1e-6 * np.eye(7), -limit
    found = np.empty((ROWS, 7))

    def solve():
        iq.solve_velocities(J, s, bounds=iq.Bounds(-limit, limit), point=np.zeros(3), length=1.0)

    def loop():
        hessians, gradients = J.transpose(0, 2, 1) @ J + damping, -(s[:, None] @ J)[:, 0]
        for i, (H, f) in enumerate(zip(hessians, gradients, strict=True)):
            found[i] = daqp.solve(H, f, none, limit, least, sense)[0]

    def spent(calls, clock):
        """The least seconds of each of some calls, in turn: the machine's speed changes from one to the next."""
        took = [[] for _ in calls]
        for _ in range(5):
            for call, all_of_it in zip(calls, took, strict=True):
                start = clock()
                call()
                all_of_it.append(1e-9 * (clock() - start))
        return map(min, took)

    (both,), cores = spent([solve], perf_counter_ns), batch.cpu_count
    batch.cpu_count = lambda: 1
    one, looped = spent([solve, loop], thread_time_ns)
    batch.cpu_count = cores
    return ROWS / both, ROWS / one, ROWS / looped


def single_calls():
    """One call of the library beside numpy's, DAQP's or Pink's for the same arrays, as (ours, theirs) contenders."""
    robot, rng = iq.load_robot("panda"), np.random.default_rng(0)
    states = rng.uniform(robot.position_lower, robot.position_upper, (POSES, 7))
    problems = [(robot.jacobian(q), 0.1 * rng.normal(size=6)) for q in states]
    width, sense, none = np.full(7, 0.05), np.zeros(7, dtype=np.int32), np.zeros((0, 7))
    bounds, damping = iq.Bounds(-width, width), 1e-6 * np.eye(7)
    yield (
        "solve_velocity, numpy's lstsq",
        (iq.solve_velocity, lambda J, s: np.linalg.lstsq(J, s, rcond=None)),
        problems,
    )
    bounded = partial(iq.solve_velocity, bounds=bounds)
    yield (
        "solve_velocity with bounds, DAQP",
        (bounded, lambda J, s: daqp.solve(J.T @ J + damping, -J.T @ s, none, width, -width, sense)),
        problems,
    )
    for m in (5, 7):
        few = [(J[:, :m],) for J, _ in problems]
        yield f"pseudoinverse of {m} twists, numpy's pinv", (lambda J: iq.pseudoinverse(J, 0.3), np.linalg.pinv), few
    try:
        import pink

        from invariantqp.pink import InvariantFrameTask
    except ImportError:
        return
    configuration = pink.Configuration(robot.model, robot.model.createData(), states[0])
    tasks = InvariantFrameTask(robot.tool, 1.0, 1.0), pink.FrameTask(robot.tool, 1.0, 1.0)
    for task in tasks:
        task.set_target(pin.SE3(robot.pose(states[1])))
    yield "objective in Pink, Pink's own", [task.compute_qp_objective for task in tasks], [(configuration,)] * POSES


def main():
    if not iq.native:
        raise SystemExit("this installation has no compiled core")
    print(f"| tick | {' | '.join(COLUMNS)} |")
    print("|---" * (1 + len(COLUMNS)) + "|")
    cases = (
        ("Panda, free", "compare/panda_limits", lambda s: not s.active, {}),
        ("Panda, limits met", "compare/panda_limits", lambda s: s.active, {}),
        ("UR5, limits met", "compare/ur5_limits", lambda s: s.active, {}),
        ("UR5, near a singularity", "ur5_wrist", lambda _: True, {}),
        ("SO-101, exact position", "so101_line", lambda s: not s.active, {"exact": "position"}),
        ("SO-101, exact position, limits met", "stability/limit_all_along", lambda s: s.active, {"exact": "position"}),
        ("Panda, exact position, limits met", "compare/panda_limits", lambda s: s.active, {"exact": "position"}),
        ("Panda, tool speed met", "compare/panda_limits", lambda s: s.method == "qp", {"tool_speed": 0.1}),
        ("Panda, acceleration limits", "compare/panda_limits", lambda _: True, {"acceleration_limit": 10.0}),
        (
            "Panda, joint metric, limits met",
            "compare/panda_limits",
            lambda s: s.active,
            {"joint_metric": np.arange(1.0, 8.0)},
        ),
        ("Panda, a coupling of joints met", "compare/panda_limits", lambda s: s.method == "qp", {"rows": COUPLED}),
        ("Panda, exact point and axis", "compare/panda_limits", lambda s: not s.active, {"exact": [POINT, AXIS]}),
        (
            "Panda, the coupling by a function",
            "compare/panda_limits",
            lambda s: s.method == "qp",
            {"rows": lambda _: COUPLED},
        ),
        ("Panda, 32 rows of limits", "compare/panda_limits", lambda _: True, {"rows": MANY}),
        (
            "Panda, rows against joint limits",
            "compare/panda_limits",
            lambda s: s.status == "degraded",
            {"rows": CONTRARY},
        ),
        ("Panda, an exact point told twice", "compare/panda_limits", lambda _: True, {"exact": [POINT, POINT]}),
    )
    for title, name, wanted, options in cases:
        task = iq.load_task(name)
        controller, ticks, kept = ticks_of(task, wanted, **options)
        python = iq.Controller(controller.robot, dt=controller.dt, backend="daqp", **options)
        calls = {OURS: controller.step, PYTHON: python.step}
        if not options.keys() - {"exact"} and options.get("exact", "position") == "position":
            calls[HAND] = HandWritten(controller.robot, controller.dt, controller.gain, "exact" in options).step
        if not options:
            calls |= peers(task, controller.robot, ticks)
        if ticks:
            line(title, times(calls, ticks, (controller, python), kept))
    for name, exact in (("panda", None), ("so101", None), ("so101", "position")):
        robot, targets = poses(name)
        took = times({OURS: partial(solve_pose, robot, exact)}, targets)
        line(f"{name}, a pose{', exact position' if exact else ''}", took)
    print("\n| call | ours | theirs |\n|---|---|---|")
    for title, (ours, theirs), arguments in single_calls():
        took = times({"ours": ours, "theirs": theirs}, arguments)
        print(
            f"| {title} | {cell(took['ours'], took['theirs'])} | {cell(took['theirs'], took['theirs'])} |", flush=True
        )
    for name, width in (("free", 10.0), ("tight box", 0.05)):
        both, one, loop = rows_a_second(width)
        print(f"\nbatch of {ROWS} Panda rows, {name}: {both:,.0f} rows/s compiled, {one:,.0f} on one core, ", end="")
        print(f"{loop:,.0f} by a loop of DAQP: {one / loop:.2f} on one core", end="")
    print(f"\n\n| tick along a path | {' | '.join(name for pair in ALONG for name in pair)} |\n|---|---|---|---|---|")
    paths = (
        ("Panda", "panda", 0.2, {}),
        ("Panda, as fast as limits allow", "panda", None, {}),
        ("Panda, acceleration limits", "panda", 0.2, {"acceleration_limit": 10.0}),
        ("Panda, as fast as acceleration limits allow", "panda", None, {"acceleration_limit": 10.0}),
        ("UR5", "ur5", 0.2, {}),
        ("SO-101, exact position", "so101", 0.2, {"exact": "position"}),
    )
    for title, name, rate, options in paths:
        line_along(title, along_path(name, rate, **options))
    hard_streams(int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000)


def solve_pose(robot, exact, target, start):
    iq.solve_pose(robot, target, q0=start, exact=exact)


if __name__ == "__main__":
    main()
