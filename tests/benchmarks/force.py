"""Presses that are healthy, for many minutes, and sensors that fail: what is told, how hard, how far off.

    python tests/benchmarks/force.py healthy --minutes 100 [--tick 0.004] [--seed 1] [--arms panda z1] [--kinds hold slide]
    python tests/benchmarks/force.py faults --each 8 [--tick 0.002] [--seed 1] [--kinds drift untared]
    ... healthy --rival 0.25       by v = c (f_d - f), c = 0.25/(k T) of the true stiffness and of all that is late

The plant is made here and knows nothing of the law: an arm whose motors lag and are commanded late, a tip on springs,
dampers, foam over a plate, slopes, waves, surfaces that move, with friction, and a sensor behind a lever that is late,
noisy, drifts by as much as its data sheet allows and carries a weight. Of half of the scenes delays and moves are told. `--only slide:17`
runs one scene, `--trace 50` prints every 50th of its ticks.
"""

# ruff: noqa: E501, C901 (figures are printed in long lines; the plant is one loop)
from __future__ import annotations

from argparse import ArgumentParser
from collections import Counter
from dataclasses import dataclass
from math import cos, exp, inf, log10, pi, sin
from time import process_time
from types import SimpleNamespace

import numpy as np

import invariantqp as iq
from invariantqp.control.tracking import tracking_twist
from invariantqp.geometry.se3 import velocity_at

ARMS = {
    "panda": [0.0, -0.5, 0.0, -2.2, 0.0, 1.7, 0.8],
    "ur5": [0.0, -1.2, 1.8, -2.2, -1.57, 0.0],
    "xarm7": [0.0, -0.3, 0.0, 1.0, 0.0, 1.3, 0.0],
    "iiwa7": [0.0, 0.5, 0.0, -1.4, 0.0, 1.2, 0.0],
    "ur10": [0.0, -1.2, 1.8, -2.2, -1.57, 0.0],
    "gen3": [0.0, 0.4, 0.0, 1.6, 0.0, 1.1, 0.0],
    "z1": [0.0, 1.5, -1.5, 0.0, 0.0, 0.0],  # by name alone: scenes of a seed take turns on the six above
}
LEVER, MASS, CENTRE = 0.1, 0.3, 0.04  # of the tip before the sensor [m]; what it carries [kg], where [m]
PUSHED, HANGING = (np.vstack((np.eye(3), [[0.0, -z, 0.0], [z, 0.0, 0.0], [0.0, 0.0, 0.0]])) for z in (LEVER, CENTRE))
CUTOFF = 50.0  # of the sensor's low-pass [Hz]
WAY, RAMP = 0.075, 0.2  # straight slides go to and fro, so far each way [m]; a slide begins within this time [s]
SUBSTEP = 5e-4  # [s]
OVERLOAD = 2.5  # of the wanted press, as in HybridTask


@dataclass(frozen=True)
class Scene:
    """A contact, an arm's and a sensor's weaknesses, and what is asked of them; forces [N], lengths [m], times [s]."""

    arm: str
    seed: int
    stiffness: float = 2e4
    damper: float = 0.0  # b/k
    series: float = inf  # stiffness of the arm
    lag: float = 0.005
    dead: float = 0.004
    late: float = 0.0  # of readings
    told: bool = True
    resonance: float = 0.0  # [Hz]
    noise: float = 0.2
    drift: float = 0.0  # [N/s]
    press: float = 10.0
    steps: bool = False  # of the wanted press
    friction: float = 0.0
    speed: float = 0.0
    circle: float = 0.0
    slope: float = 0.0
    wave: tuple = (0.0, 0.05)  # height, length
    moves: tuple = (0.0, 1.0)  # height, frequency [Hz]
    foam: tuple = (0.0, 0.0, 0.0, 0.05)  # its stiffness, thickness, by how much that varies, over which length
    gap: float = 0.004
    slides_from: float = 3.0
    fault: str = ""
    since: float = inf
    value: float = 0.0


def healthy(kind, dt, arm, random):
    """A scene of a kind: what the arm, the contact and the sensor may be, drawn at random."""
    pick, between = random.choice, random.uniform
    k = 10.0 ** between(3.0, log10(4e5))
    given = {
        "arm": arm,
        "seed": int(random.integers(1 << 31)),
        "told": bool(random.integers(2)),
        "noise": float(pick([0.02, 0.1, 0.2, 0.5])),
        "drift": between(-0.2, 0.2) / 60.0,
        "press": float(pick([5.0, 10.0, 20.0])),
        "friction": between(0.0, 1.0),
        "gap": between(0.002, 0.008),
        "lag": float(pick([0.005, 0.01])),
        "dead": float(pick([0.002, 0.004])),
    }
    damper = float(pick([0.0, 5e-4, 3e-3, 0.01, 0.02, 0.04, 0.06, 0.1]))
    if kind in ("hold", "steps"):
        given |= {
            "press": float(pick([2.0, 5.0, 10.0, 20.0, 50.0])),
            "series": float(pick([inf, inf, 3e4, 1e5])),
            "lag": float(pick([0.0, 0.005, 0.01, 0.03])),
            "dead": float(pick([0.0, 0.002, 0.004, 0.01])),
            "late": float(pick([0.0, 0.0, 0.0, 0.002, 0.01, 0.02])),
            "steps": kind == "steps",
        }
    elif kind == "slide":
        given |= {"late": float(pick([0.0, 0.0, 0.002, 0.01])), "speed": between(0.005, 0.1)}
        surface, slope = int(random.integers(4)), between(-0.1, 0.1)
        if surface < 2:
            given |= {"slope": slope, "circle": surface * between(0.01, 0.05)}
        elif surface == 2:
            length = between(0.03, 0.1)
            given |= {"wave": (slope * length / (2.0 * pi), length)}
        # A speed at which what is late, and the damper, press by a fifth of the press: beyond, it is the path's fault.
        late = dt + given["dead"] + given["lag"] + given["late"] + 1.0 / (2.0 * pi * CUTOFF)
        most = 0.2 * given["press"] / ((late * k + min(damper * k, 2e3)) * abs(slope))
        given["speed"] = given["speed"] if surface == 3 else min(given["speed"], most)
    elif kind == "foam":
        soft = float(pick([500.0, 1000.0, 2000.0]))
        thick, length = between(0.3, 1.3) * given["press"] / soft, between(0.02, 0.06)
        varies = float(random.integers(2))
        given["foam"] = soft, thick, varies * min(0.5 * thick, 0.1 * length / (2.0 * pi)), length
        given |= {"speed": varies * between(0.01, 0.03), "lag": float(pick([0.005, 0.03]))}
        k, damper = 1e5, min(damper, 0.01)
    elif kind == "moving":
        given["moves"] = float(pick([5e-4, 1e-3, 3e-3])), between(0.2, 1.0)
        k = 10.0 ** between(3.0, 4.7)
    elif kind == "resonant":
        given["resonance"] = 6.0
        k, damper = 10.0 ** between(3.0, 5.0), min(damper, 0.01)
    else:
        k = 10.0 ** between(log10(300.0), 3.0)
    return Scene(stiffness=k, damper=min(damper, 2e3 / k), **given)


KINDS = ("hold", "slide", "steps", "foam", "soft", "moving", "resonant")
# Kinds of faults, and the ranges of what they change: a share of the press, or N, or N/s.
FAULTS = {
    "stuck above": (1.02, 1.9),
    "stuck above, sliding": (1.02, 1.9),
    "stuck below": (0.1, 0.95),
    "stuck in noise, sliding": (1.0, 1.0),
    "stuck in the touch": (0.1, 0.9),
    "drift": (0.05, 0.5),
    "jump": (5.0, 5.0),
    "untared": (0.3, 1.2),
    "wrong sign": (0.0, 0.5),
    "dead": (0.0, 0.0),
    "dead in the air": (0.0, 0.0),
    "moment first": (0.0, 0.0),
    "pushed": (3.0, 6.0),
    "nothing there": (0.0, 0.0),
    "arm stands": (0.0, 0.0),
    "held in the air": (0.0, 0.0),
    "late untold": (0.05, 0.15),
    "noisier than told": (5.0, 10.0),
    "drift, sliding": (0.05, 0.5),
}
# Which of them begin before the touch, at a time; the others about a second after it, and after the slide began.
BEGIN = dict.fromkeys(("dead in the air", "nothing there", "arm stands", "held in the air"), 0.2) | dict.fromkeys(
    ("untared", "wrong sign", "moment first", "stuck in the touch", "late untold", "noisier than told"), 0.0
)


def failing(kind, arm, random):
    """A scene in which something fails, about three seconds after the start."""
    pick, between = random.choice, random.uniform
    slides = "sliding" in kind
    return Scene(
        arm=arm,
        seed=int(random.integers(1 << 31)),
        stiffness=10.0 ** between(log10(5e3), 5.0),
        damper=float(pick([5e-4, 5e-3, 0.02])),
        noise=float(pick([0.05, 0.2])),
        press=float(pick([5.0, 10.0, 20.0])),
        told=bool(random.integers(2)),
        lag=float(pick([0.005, 0.01])),
        since=BEGIN.get(kind, between(2.8, 3.5)),
        speed=slides * between(0.02, 0.06),
        circle=slides * float(pick([0.0, 0.02])),
        slides_from=2.0,
        fault=kind,
        value=between(*FAULTS[kind]) * (float(pick([-1.0, 1.0])) if "drift" in kind else 1.0),
    )


@dataclass
class Told:
    """What came of a scene."""

    seconds: float = 0.0
    since: float = inf  # when the fault began
    stopped: float = inf
    status: str = ""
    reason: str = ""
    last: str = ""
    touch: float = inf
    most: float = 0.0  # press, over the wanted one
    after: float = 0.0  # since the fault
    away: float = 0.0  # from the surface after the touch [m]
    held: float = np.nan  # rms of the force, over the wanted one
    asked: int = 0
    statuses: Counter | None = None
    words: Counter | None = None


ROBOTS: dict = {}


class OneLine:
    """The rival: v = c (f_d - f) along the normal beside the target's motion, by `Controller.follow`. It checks nothing."""

    def __init__(self, robot, task, c, sensor, **options):
        self.robot, self.task, self.c, self.sensor = robot, task, c, sensor
        self.loop, self.felt = iq.Controller(robot, **options), None
        self.share = 1.0 - np.exp(-2.0 * np.pi * sensor.cutoff * options["dt"])  # of the low-pass

    def step(self, q, target, reading, ahead, wanted=None):
        tool = self.robot.pose(q)
        felt = self.sensor.wrench(reading, tool)
        self.felt = felt if self.felt is None else self.felt + self.share * (felt - self.felt)
        twist = tracking_twist(self.robot.state(q, target).error, self.loop.gain) + ahead
        at = tool[:3, 3]
        press = (self.task.wrench if wanted is None else wanted)[0]
        down = velocity_at(twist, at)[2] + self.c * (press + self.felt[5])
        twist[5] -= down
        solution = self.loop.follow(q, twist, at="base", measured_at=at)
        return SimpleNamespace(velocity=solution.velocity, J=self.robot.jacobian(q), status="ok", reason="")


def run(scene, dt, seconds, trace=0, *, c=None):
    """The scene for some seconds, or until it was stopped for .3 s; or with the rival's gain c."""
    robot = ROBOTS.setdefault(scene.arm, iq.load_robot(scene.arm))
    q, random, up = np.array(ARMS[scene.arm]), np.random.default_rng(scene.seed), np.array([0.0, 0.0, 1.0])
    home = robot.pose(q)
    p0, n, fault = home[:3, 3].copy(), len(q), scene.fault
    mount = iq.transform(translation=[0.0, 0.0, -LEVER])
    noise = scene.noise * (scene.value if fault == "noisier than told" else 1.0)
    carries = {"mass": MASS, "centre": [0.0, 0.0, CENTRE]}
    sensor = iq.WrenchSensor(mount, order="force first", reads="reaction", cutoff=CUTOFF, noise=scene.noise, **carries)
    yields = 2.0 * scene.moves[0] * scene.told
    task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], up), [scene.press], yields=yields)
    loop = iq.HybridController(robot, task, dt=dt, sensor=sensor, delay=scene.told * (scene.dead + scene.lag))
    if c is not None:
        loop = OneLine(robot, task, c, sensor, dt=dt, delay=scene.told * (scene.dead + scene.lag))
    steps = max(1, round(dt / (SUBSTEP if dt < 0.02 else 1e-3)))
    h, ticks = dt / steps, round(2.0 * seconds / dt)
    dead = round((scene.dead + (scene.value if fault == "late untold" else 0.0)) / h)
    late = round(scene.late / h)
    decay = exp(-h / scene.lag) if scene.lag > 0.0 else 0.0
    commands, forces = [np.zeros(n)] * (dead // steps + 2), [0.0] * (late + 1)
    speed, told, k, b = np.zeros(n), Told(statuses=Counter(), words=Counter()), scene.stiffness, scene.damper
    behind, swings, swing_speed, before = dead % steps, -scene.gap, 0.0, min(0.0, -scene.gap)
    omega, phase, stuck, last = 2.0 * pi * scene.resonance, random.uniform(0.0, 2.0 * pi), None, None
    soft, thick, varies, length = scene.foam
    errors, squares, force = 0, 0.0, 0.0
    wanted, settles = scene.press, inf
    # What is to begin after the touch waits for it: a reading that sticks in the air is another fault.
    waits = bool(fault) and fault not in BEGIN
    later = 0.0
    pace = min(0.02, scene.press / 1e5 / 0.012)

    def way(t):
        t = max(0.0, t - later - scene.slides_from)
        arc = scene.speed * (t - RAMP * (1.0 - exp(-t / RAMP)))
        if scene.circle > 0.0:
            angle = arc / scene.circle
            return scene.circle * np.array([sin(angle), 1.0 - cos(angle), 0.0])
        return np.array([0.0, WAY * sin(arc / WAY), 0.0])

    for i in range(ticks):
        t, tool = i * dt, robot.pose(q)
        if t >= seconds + later:
            break
        if waits and told.touch == inf:
            later = max(0.0, t - scene.slides_from)
        begins = scene.since + later
        on, told.since = t >= begins, begins
        depth = p0[2] - scene.gap - tool[2, 3]
        if i % 1000 == 0:
            block = random.normal(0.0, noise, (1000, 6)) * [1.0, 1.0, 1.0, 0.03, 0.03, 0.03]
        read, shake = forces[-1 - late] + scene.drift * t, block[i % 1000]
        if on and fault:
            if "above" in fault or "below" in fault:
                read = scene.value * scene.press
            elif fault in ("stuck in noise, sliding", "stuck in the touch"):
                if stuck is None and (fault != "stuck in the touch" or read > scene.value * scene.press):
                    stuck = read + shake[2] * (fault != "stuck in the touch")
                read = read if stuck is None else stuck
            elif "drift" in fault:
                read += scene.value * (t - begins)
            elif fault == "jump":
                read += scene.value
            elif fault == "untared":
                read += scene.value * scene.press
            elif fault == "wrong sign":
                read = scene.value * scene.press - read
        R = tool[:3, :3]
        at, then = way(t), way(t + dt)
        moves = (then - at) / dt
        along = moves / max(np.linalg.norm(moves), 1e-9)
        push = read * up - scene.friction * read * along
        reading = PUSHED @ (R.T @ push) + HANGING @ (-9.80665 * MASS * R[2]) + shake
        if on and fault == "moment first":
            reading = np.roll(reading, 3)
        if on and fault.startswith("dead"):
            reading = last
        last = reading
        target, ahead = home.copy(), np.zeros(6)
        target[:3, 3], ahead[3:] = p0 + at, moves
        if scene.steps and i % round(5.0 / dt) == 0 and t > 5.0:
            wanted, settles = scene.press * random.uniform(0.3, 1.0), t
        solution = loop.step(q, target, reading, ahead, wanted=[wanted] if scene.steps else None)
        status = str(solution.status)
        told.statuses[status] += 1
        if "unloading" in solution.reason:
            told.asked += 1
        elif status == "degraded":
            told.words[solution.reason.split(":")[0][:60]] += 1
        if told.stopped == inf and (status in ("fault", "overload") or "until reset" in solution.reason):
            told.stopped, told.status, told.reason = t, status, solution.reason
        if trace and i % trace == 0:
            known = loop.state.law.bounds()
            print(
                f"{t:8.3f} press {force:8.3f} read {read:8.3f} depth um {1e6 * depth:9.1f} k {known[0]:8.2g} {status:9s} {solution.reason[:110]}"
            )
        told.last = status
        commands = [*commands[1:], solution.velocity]
        J, p = solution.J, tool[:3, 3]
        down = -(J[5] + J[0] * p[1] - J[1] * p[0])
        # Of this tick the first `behind` steps still have the command of the tick before.
        sent = commands[-2 - dead // steps], commands[-1 - dead // steps]
        fell, moved, axis = depth, np.zeros(n), 0 if scene.circle > 0.0 else 1
        lines = [float(down @ u) for u in sent]
        v_down = float(down @ speed)
        for j in range(steps):
            u = lines[j >= behind]
            v_down = u + decay * (v_down - u)
            if fault == "arm stands" and on:
                v_down = 0.0
            elif fault == "held in the air" and on:
                v_down *= 0.1
            fell += h * v_down
            if omega:
                swing_speed += h * (omega * omega * (fell - swings) + 0.1 * omega * (v_down - swing_speed))
                swings += h * swing_speed
            else:
                swings = fell
            s = t + j * h
            x = p[axis] - p0[axis] + moves[axis] * j * h
            surface = (
                scene.slope * x
                + scene.wave[0] * (sin(2.0 * pi * x / scene.wave[1] + phase) - sin(phase))
                + scene.moves[0] * sin(2.0 * pi * scene.moves[1] * s)
            )
            if fault == "nothing there":
                surface = 1.0
            if fault == "pushed" and on:
                surface -= scene.value * scene.press / k * min(1.0, (t - begins) / 0.1)
            d = swings - surface
            if scene.series < inf:
                d = min(d, (scene.series * d + b * k / h * max(before, 0.0)) / (scene.series + k + b * k / h))
            rate, before = (d - before) / h, d
            if d <= 0.0:
                force = 0.0
            elif scene.series < inf:
                force = max(0.0, scene.series * (swings - surface - d))
            elif soft:
                edge = thick + varies * sin(2.0 * pi * x / length + phase)
                here = soft if d < edge else k
                force = max(0.0, soft * min(d, edge) + k * max(0.0, d - edge) + b * here * rate)
            else:
                force = max(0.0, k * d + b * k * rate)
            forces.append(force)
        for u, many in ((sent[0], behind), (sent[1], steps - behind)):
            for _ in range(many):
                speed = u + decay * (speed - u)
                moved += h * speed
        if on and fault == "arm stands":
            moved, speed = 0.0 * moved, 0.0 * speed
        elif on and fault == "held in the air":
            moved = 0.1 * moved
        q, forces = q + moved, forces[-late - 1 :]
        if told.touch == inf and force > 0.0:
            told.touch = t
            settles = t + 1.0 + scene.press / ((soft or min(k, scene.series)) * pace)
        told.most = max(told.most, force / scene.press)
        if on:
            told.after = max(told.after, force / scene.press)
        if told.touch < inf and told.stopped == inf:
            told.away = max(told.away, -before)
        if t > max(settles, scene.slides_from + 1.0 if scene.speed else 0.0) + 1.0 * scene.steps:
            errors, squares = errors + 1, squares + (force - wanted) ** 2
        told.seconds = t + dt
        if t > told.stopped + 0.3:
            break
    told.held = np.sqrt(squares / errors) / scene.press if errors else np.nan
    return told


def scenes(maker, kinds, each, dt, seed, arms):
    """(name, scene) of each kind in turn, as many as asked for; without end where that is infinite."""
    j = 0
    while j < each:
        for kind in kinds:
            random = np.random.default_rng([seed, j, *kind.encode()])
            scene = (
                maker(kind, dt, arms[j % len(arms)], random)
                if maker is healthy
                else maker(kind, arms[j % len(arms)], random)
            )
            yield f"{kind}:{j}", scene
        j += 1


def healthy_minutes(a):
    """Scenes until the minutes are over; each that was stopped is printed."""
    sums: dict = {kind: [0, 0.0, Counter(), Counter(), Counter(), []] for kind in a.kinds}
    began, minutes = process_time(), 0.0
    for name, scene in scenes(healthy, a.kinds, a.each or inf, a.tick, a.seed, a.arms):
        if a.only and name != a.only:
            continue
        late = a.tick + scene.dead + scene.lag + scene.late + 1.0 / (2.0 * pi * CUTOFF)
        c = a.rival / (min(scene.stiffness, scene.series) * late) if a.rival else None
        told = run(scene, a.tick, a.seconds, a.trace, c=c)
        told.status = "overload" if c and told.most > OVERLOAD else told.status
        minutes += told.seconds / 60.0
        kind = sums[name.split(":")[0]]
        kind[0], kind[1] = kind[0] + 1, kind[1] + told.seconds / 60.0
        kind[2].update([told.status] if told.status else [])
        kind[3].update(told.statuses)
        kind[4].update(told.words)
        kind[5].append(
            (
                told.held,
                told.most,
                told.held <= (0.03 if a.tick < 0.02 else 0.1) + 0.3 * scene.noise / scene.press,
                told.asked,
            )
        )
        if told.status:
            print(
                f"  {name} {told.status} after {told.stopped:.2f} s, {told.most:.2f} presses: {told.reason[:150]}\n      {scene}",
                flush=True,
            )
        if a.only or minutes >= a.minutes:
            break
    print(
        f"{'kind':9s} {'runs':>5s} {'min':>6s} {'fault':>5s} {'over':>5s} {'lost':>5s} {'ok %':>6s} {'degr %':>6s} {'held %':>6s} {'rms med':>8s} {'rms 95':>7s} {'peak 95':>7s} {'let go':>6s}   degraded for"
    )
    for kind, (runs, mins, stops, ticks, words, held) in sums.items():
        if not runs:
            continue
        rms, most, good, asked = (np.array(x) for x in zip(*held, strict=True))
        rms = rms[np.isfinite(rms)] if np.isfinite(rms).any() else rms[:1]
        total = sum(ticks.values()) / 100.0
        print(
            f"{kind:9s} {runs:5d} {mins:6.1f} {stops['fault']:5d} {stops['overload']:5d} {stops['lost']:5d} {ticks['ok'] / total:6.1f} {ticks['degraded'] / total:6.1f} {100 * good.mean():6.1f} {np.median(rms):8.4f} {np.percentile(rms, 95):7.3f} {np.percentile(most, 95):7.2f} {np.count_nonzero(asked):6d}   {words.most_common(3)}"
        )
    print(
        f"{minutes:.1f} minutes, tick {1e3 * a.tick:g} ms, seed {a.seed}, {process_time() - began:.0f} s of processor, {', '.join(a.arms)}: {sum(s[2]['fault'] for s in sums.values())} faults, {sum(s[2]['overload'] for s in sums.values())} overloads, {sum(s[2]['lost'] for s in sums.values())} lost until reset",
        flush=True,
    )


def fault_table(a):
    """For each fault what is told at the end, how hard the tool pressed since, and how far away it was."""
    for kind in a.kinds:
        told = []
        for name, scene in scenes(failing, [kind], a.each, a.tick, a.seed, a.arms):
            if a.only and name != a.only:
                continue
            # A drift is run until it is worth one and a half presses.
            seconds = scene.since + 1.5 * scene.press / abs(scene.value) if "drift" in kind else a.seconds
            told.append(run(scene, a.tick, seconds, a.trace))
            if a.verbose:
                print(
                    f"    {name} {scene}\n      {told[-1].stopped - told[-1].since:.2f} s, {told[-1].last}, {told[-1].after:.2f} presses, {1e3 * told[-1].away:.2f} mm away: {told[-1].reason[:140]} {dict(told[-1].words)}",
                    flush=True,
                )
        if not told:
            continue
        last, words = Counter(x.last for x in told), Counter(w for x in told for w in x.words)
        print(
            f"{kind:24s} stopped {sum(x.stopped < inf for x in told):2d} of {len(told):2d}, last {dict(last)}, presses median {np.median([x.after for x in told]):6.2f} most {max(x.after for x in told):7.2f}, away mm {1e3 * max(x.away for x in told):7.2f}, said {words.most_common(2)}",
            flush=True,
        )


def main():
    """See the module."""
    p = ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("what", choices=("healthy", "faults"))
    p.add_argument("--minutes", type=float, default=10.0)
    p.add_argument("--seconds", type=float, default=None, help="of a scene")
    p.add_argument("--each", type=int, default=0)
    p.add_argument("--tick", type=float, default=0.004)
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--trace", type=int, default=0)
    p.add_argument("--only", default="")
    p.add_argument("--verbose", action="store_true")
    p.add_argument("--arms", nargs="+", default=list(ARMS)[:6])
    p.add_argument("--kinds", nargs="+", default=None)
    p.add_argument("--rival", type=float, default=0.0)
    a = p.parse_args()
    a.kinds = a.kinds or list(KINDS if a.what == "healthy" else FAULTS)
    a.seconds = a.seconds or (60.0 if a.what == "healthy" else 20.0)
    if a.what == "healthy":
        healthy_minutes(a)
    else:
        a.each = a.each or 4
        fault_table(a)


if __name__ == "__main__":
    main()
