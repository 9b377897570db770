"""The rows of a tick that keep bodies apart: the definition of csrc/clearance.c.

    C x >= -alpha (d - d_min) - n'v_obstacle        C = w'J on the joints between two bodies,  w = (p x n; n)

for each place where a pair is near (`geometry/distance.py`), in each of the states that an arm with brakes passes as it
comes to rest; `clearance.py` says why. Joints are those of the arm and, after them, of the arms around it; shapes of an
arm around have the number of that joint which moves them.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, inf, sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import NEGLIGIBLE, ROUNDING, Array
from invariantqp.geometry.distance import Place, Placed, Solid, places
from invariantqp.geometry.shapes import Core
from invariantqp.robots.chain import Chain
from invariantqp.velocity.limits import braking_speed, late_braking

# Rows of a tick, at most: more than an arm has joints several times over.
MOST_ROWS = 16
# Of the ticks until one state those until the next nearer one: with a half, an arm that passes a corner at full speed
# sees it late in one of 2000 ticks.
NEARER = 0.7
# Joints without a velocity limit count as this fast where pairs are ranked and led apart [rad/s, length/s].
USUAL_SPEED = 1.0
# Less than this share of the distance is what curvature takes of it in a tick; deeper, an arm began inside.
DEEP = 0.05
# Ways that turn within a tick take this share of the distance at most: an answer that takes more is made again. Beside
# what moves itself, rows that cannot all be kept ask for less where no more is given up by it than that.
CURVED = 0.005
# So often rows that ask for more than braking on are tried one after the other; one that is missed is passed by as
# much: that ends inside of all of them, where projections only come nearer (Motzkin and Schoenberg 1954).
SWEEPS, PASSED = 20, 2.0
# Numbers of a shape for the compiled core: body, core, radius, half sizes, rotation, place.
OF_SHAPE = 18


class Rate(NamedTuple):
    """What decides how fast bodies may come nearer."""

    limits: Array  # (4, m) of speed, acceleration (inf where joints stop at once) and position, the lower and the upper
    settings: Array  # d_min [length], alpha [1/s], ESCAPE, a tick [s], BRAKING, the rate of joint limits [1/s]
    delay: float  # of the robot [s]

    def braked(self, before: Array, share: float) -> Array:
        """(m,) how fast joints still are after a tick of braking a velocity (m,), at a share of what rows brake by."""
        b = self.settings[4] * self.settings[3] * self.limits[1]
        return np.asarray(np.abs(before) * np.where(np.isfinite(b), 1.0 - share / max(1.0, ticks_of(before / b)), 0.0))


def ticks_of(alone: Array) -> float:
    """How many ticks the joints of an arm take to stop together, each alone taking (m,).

    By the 8-norm: nearly the most, and smooth, so that no joint's brakes decide alone.
    """
    squares = alone * alone
    fourth = squares * squares
    return sqrt(sqrt(sqrt(float((fourth * fourth).sum()))))


class Found(NamedTuple):
    """The rows of a tick, and distances."""

    C: Array  # (r, m)
    lower: Array  # (r,)
    pair: Array  # (r,) which pair each row is of
    distances: Array  # (k,) of the pairs at q [length]


class States(NamedTuple):
    """The states in which distances are looked at: the arms' own first, and those that they pass as they brake."""

    positions: Array  # (s, M) of the joints
    weights: Array  # (s, M) how they change with the velocity, in ticks, as many ticks being taken to stop
    longer: Array  # (s, M) and with those ticks, in shares of them
    going: Array  # (s, M) velocities of others that go on from there
    times: Array  # (s,) from now [s]
    grows: Array  # (M,) by which share the ticks grow with the velocity
    y: Array  # (M,) the velocity braked for a tick
    free: Array  # (2, M) how far another one can be below it and above
    sure: Array  # (2, M) and certainly: by what braking leaves of its acceleration
    led: Array  # (2, M) and where it is led apart: as fast as it was, and faster by that

    @classmethod
    def ahead(cls, starts: Array, q: Array, before: Array, limits: Array, settings: Array) -> States:
        """From positions q (M,) of own joints and others, after a velocity `before` (M,).

        `starts` is as in `starts_of`, the rest as in `Rate`; another arm that does not brake has accelerations of zero.
        """
        (_, a, low, high), (dt, share, rate) = limits, settings[3:].tolist()
        own_joints, still = starts[1:] == 0, np.zeros((1, len(q)))
        others = np.where(own_joints, 0.0, before)
        if np.isinf(a[own_joints]).all():
            free = cls._free(q, before, still[0], limits, dt, rate)
            return cls(q[None], still + 1.0, still, others[None], np.zeros(1), still[0], still[0], free, free, free)
        fast, on = np.abs(before), a == 0.0
        with np.errstate(invalid="ignore", divide="ignore"):  # infinitely strong brakes, and none
            room = np.where(before > 0.0, high - q, q - low)
            late = (fast - np.minimum(late_braking(room, fast, dt), braking_speed(room, a, dt, rate))) / dt
            step = share * a * dt  # of a velocity in a tick, each joint alone
            alone, of_arms = np.where(on, 0.0, fast / step), [starts[1:] == arm for arm in starts[1:]]
            together = [max(1.0, ticks_of(alone[arm])) for arm in of_arms]  # ticks that each arm takes
            for_range = ~on & np.isfinite(a) & (late > fast / (np.array(together) * dt))  # by itself, to its end
            ticks = np.array([max(1.0, ticks_of(alone[arm & ~for_range])) for arm in of_arms])
            b = np.where(on, 0.0, np.where(np.isinf(a), a, np.where(for_range, late, fast / (ticks * dt))))
            y = np.maximum(fast - b * dt, 0.0)
            whole = np.where(y > 0.0, np.floor(y / (b * dt) + NEGLIGIBLE), 0.0)  # ticks that y goes on, but for a rest
            n = [*moments(float(whole[~on].max(initial=0.0))), 0.0]
            own = np.minimum(np.array(n)[:, None], whole)
            lost = np.where(own > 0.0, own * b * dt / y, 0.0)  # of y, by then
            harder = np.where(np.isinf(a), a, np.maximum(a * dt - b * dt, 0.0))
            grows = np.where(
                (whole > 0.0) & ~on & ~for_range, (y / (step * (ticks - 1.0))) ** 7 / (step * (ticks - 1.0)), 0.0
            )
        y = np.sign(before) * y
        states = q + dt * (own + np.where(on, 0.0, 1.0)) * (1.0 - 0.5 * lost) * y
        weights = np.vstack((still + 1.0, (own + 1.0) * (1.0 - np.where(for_range, 1.0, 0.5) * lost)))
        longer = np.vstack((still, (own + 1.0) * np.where(for_range, 0.0, 0.5) * lost * y))
        going = np.vstack((others, np.where(on, others, 0.0) * np.ones((len(n), 1))))
        times = dt * np.array([0.0, *n])
        free = cls._free(q, before, y, limits, dt, rate)
        as_fast = np.maximum((-before, before), 0.0) - np.maximum((-y, y), 0.0)
        sure, led = np.minimum(free, harder), np.minimum(free, as_fast + harder)
        grows = np.sign(before) * grows
        return cls(np.vstack((q, states)), weights, longer, going, times, grows, y, free, sure, led)

    @staticmethod
    def _free(q: Array, before: Array, y: Array, limits: Array, dt: float, rate: float) -> Array:
        """(2, M) how far joint limits let a velocity be below y and above."""
        speed, a, low, high = limits
        if not dt > 0.0:
            return np.array((speed, speed))
        with np.errstate(invalid="ignore", divide="ignore"):  # others without brakes
            ends = [braking_speed(room, a, dt, rate) for room in (q - low, high - q)]
        most = np.minimum(np.minimum(speed, ends), np.array((-before, before)) + a * dt)
        return np.asarray(np.maximum(most + np.array((y, -y)), 0.0))


def moments(ticks: float) -> list[float]:
    """A number of ticks, NEARER of it, of that, ... down to one, whole ones."""
    found = []
    while ticks > 0.0:
        found.append(ticks)
        ticks = floor(NEARER * ticks) if ticks > 1.0 else 0.0
    return found


def rows_of(
    robots: Sequence[Chain],
    q: Array,
    before: Array,
    shapes: Array,
    twists: Array,
    pairs: Array,
    limits: Array,
    settings: Array,
    solids: Sequence[Solid | None] = (),
) -> Found:
    """The rows of a tick: what `core.clearance` computes, in NumPy.

    Args:
        robots: the arm whose joints the rows are on, and those around it.
        q: (M,) positions of all their joints.
        before: (M,) joint velocity.
        shapes: (n, 18) body, core, radius, half sizes (3), rotation (9) and place (3) at q = 0, in the base frame.
        twists: (n, 6) of shapes by themselves.
        pairs: (k, 4) two shapes, the share of the room that this arm may take, 0 where they are not kept apart now, and
            the distance that is kept [length].
        limits: as in `Rate`, of all joints.
        settings: as in `Rate`.
        solids: (n,) what tells distances of meshes, None of other shapes.

    Returns:
        Found; the core leaves those distances infinite that are neither the least nor near enough for a row, unless
        alpha is 0.
    """
    m, starts = len(robots[0].names), starts_of(robots)
    states = States.ahead(starts, q, before, limits, settings)
    last = len(states.times) - 1
    kept: list[tuple[float, float, int, Array]] = []  # urgency, lower limit, pair, row
    valid = still = True  # no deeper inside than curvature takes an arm, and nothing moves itself
    distances, leaves = np.full(len(pairs), inf), np.full(len(pairs), inf)
    recedes = np.zeros(len(pairs), dtype=bool)
    for s, (at, weight, longer, going, time) in enumerate(zip(*states[:4], states.times.tolist(), strict=True)):
        J, motions = moved_by(robots, at)
        placed = placed_at(shapes, motions, [se3.exp(time * twist, check=False) for twist in twists], solids)
        for k, (one, other) in enumerate(pairs[:, :2].astype(int).tolist()):
            share, kept_distance = pairs[k, 2:].tolist()
            if not share > 0.0 or recedes[k]:
                continue
            signs = between(starts, int(shapes[one, 0]), int(shapes[other, 0]))
            found = places(placed[one], placed[other])
            ways = _ways(found, signs * J, twists[other] - twists[one], limits[:2, :m])
            wanted = min(kept_distance, distances[k] if s > 0 else inf)
            if s == 0:
                distances[k] = min((way.place.distance for way in ways), default=inf)
                goes = len(ways) > 0 and float(ways[0].row[:m].dot(before[:m])) >= 0.0
                recedes[k] = last > 0 and goes and ways[0].strong > 0.0
            over = 0.0  # by how much the nearest place could come nearer faster than states ahead leave room for
            for way in ways:
                room, row = way.place.distance - wanted, way.row[:m]
                drift = way.grows + float(way.row[m:].dot(going[m:]))
                nearer, slower = _nearer(way, room, share, drift, settings)
                if way is ways[0] and 0 < s < last:
                    leaves[k] = min(leaves[k], max(nearer, 0.0) / (time / settings[3] + 1.0))
                elif way is ways[0] and s == last:
                    over = max(nearer - leaves[k], 0.0)
                C = weight[:m] * row + longer[:m].dot(row) * states.grows[:m]
                approach = room, nearer - over, slower, float(way.place.normal.dot(ways[0].place.normal)), drift
                leaving = s == 0 < last and not recedes[k]
                lower, urgency = _asked_of(C, approach, states, limits[0, :m], settings, leaving=leaving, now=s == 0)
                if lower > -inf:
                    still = still and drift == 0.0
                    valid = valid and (s > 0 or room >= -DEEP * settings[0])
                    _keep(kept, (urgency - (way.place is not found[0]), lower, k, C))
    C_kept, kept_lower = np.array([row[3] for row in kept]).reshape(-1, m), np.array([row[1] for row in kept])
    if valid:
        braked = C_kept.dot(states.y[:m])
        most = inf if still else float(settings[1] * CURVED * settings[0])
        kept_lower = braked + _possible(C_kept, kept_lower - braked, states.free[:, :m], most)
    return Found(C_kept, kept_lower, np.array([float(row[2]) for row in kept]), distances)


def _possible(C: Array, asked: Array, free: Array, most: float) -> Array:
    """What rows C z >= asked (r,) may ask for together, z being inside joint limits `free` (2, m) about zero.

    Rows that ask for something lead back what curvature took of the distance: for as much as is found to be possible
    beside all others, by one velocity that keeps them all. z = 0 keeps what asks for nothing. They ask for as much as
    before where one would give up more than `most`.
    """
    z, wanted, sizes = np.zeros(C.shape[1]), asked > 0.0, (C * C).sum(axis=1)
    for _ in range(SWEEPS if wanted.any() else 0):
        for row, least, size in zip(C, asked, sizes, strict=True):
            z = np.clip(z + PASSED * max(least - row.dot(z), 0.0) / size * row, -free[0], free[1])
    got, least = C.dot(z), np.minimum(asked, 0.0)
    over = got < least
    share = float((least[over] / got[over]).min(initial=1.0))
    found = np.asarray(np.where(wanted, np.minimum(asked, share * got), asked))
    return found if (asked - found).max(initial=0.0) <= most else asked


def starts_of(robots: Sequence[Chain]) -> Array:
    """(M + 1,) at which joint the arm of each body begins, the world's first."""
    counts = [len(robot.names) for robot in robots]
    return np.concatenate(([0], np.repeat(np.cumsum([0, *counts])[:-1], counts)))


def between(starts: Array, one: int, other: int) -> Array:
    """(M,) of each joint +1 where it moves the second of two bodies alone, -1 the first alone, 0 neither or both."""
    signs = np.zeros(len(starts) - 1)
    signs[starts[other] : other] += 1.0
    signs[starts[one] : one] -= 1.0
    return signs


def moved_by(robots: Sequence[Chain], q: Array) -> tuple[Array, list[Array]]:
    """Joint twists (6, M), and the (4, 4) motions of the world and all bodies, at positions q (M,)."""
    J, motions, at = [], [np.eye(4)], 0
    for robot in robots:
        own = q[at : (at := at + len(robot.names))]
        J.append(robot.jacobian(own))
        motions += list(robot.motions(own)[1:])
    return np.hstack(J), motions


class Way(NamedTuple):
    """A place at which joints move two bodies."""

    place: Place
    row: Array  # (M,) how fast the distance grows with joint velocities; zero where that is rounding
    grows: float  # and by itself
    strong: float  # how hard the arm can make way, `_coming`


def _ways(found: Sequence[Place], J: Array, twist: Array, limits: Array) -> list[Way]:
    """Those of some places that the arm's own joints move.

    J (6, M) is how the second body moves beside the first, its `twist` (6,) how by itself; limits are as in `_coming`.
    """
    ways, m = [], limits.shape[1]
    for place in found:
        wrench = np.concatenate((se3.cross(place.point, place.normal), place.normal))
        parts = wrench[:, None] * J
        total = parts.sum(axis=0)
        row = np.where(np.abs(total) > ROUNDING * np.abs(parts).sum(axis=0), total, 0.0)
        if row[:m].any():
            grows = float(wrench.dot(twist))
            ways.append(Way(place, row, grows, _coming(row[:m], -grows, limits)))
    return ways


def _nearer(way: Way, room: float, share: float, drift: float, settings: Array) -> tuple[float, float]:
    """How fast bodies may come nearer in a room of which this arm may take a share, and where its joints take time."""
    mine = settings[1] * min(room, share * room)  # of what another one leaves that may take a share, too
    nearer = mine + drift if share == 1.0 or room < 0.0 else min(mine, settings[1] * room + drift)
    return nearer, _made_way(share * room, way.strong, settings) + drift


def _coming(row: Array, falls: float, limits: Array) -> float:
    """How hard an arm can make way by a row (m,) of a distance that `falls` by itself, 0 where it does not or faster.

    `limits` (2, m) of speed and acceleration.
    """
    if not falls > 0.0:
        return 0.0
    own = np.flatnonzero(row)
    fast, strong = np.abs(row[own]).dot(limits[:, own].T).tolist()
    return float(strong) if falls < fast else 0.0


def _made_way(room: float, strong: float, settings: Array) -> float:
    """How much faster what comes may be, for an arm that gets away from it so hard; inf where joints stop at once."""
    if not (0.0 < strong < inf and room > 0.0):
        return inf
    alpha, dt = float(settings[1]), float(settings[3])
    return float(braking_speed(np.array([room]), np.array([settings[4] * strong]), dt, alpha)[0])


def _asked_of(
    C: Array,
    approach: tuple[float, float, float, float, float],
    states: States,
    speed: Array,
    settings: Array,
    *,
    leaving: bool,
    now: bool,
) -> tuple[float, float]:
    """The lower limit of a row, -inf where every velocity keeps it, and how urgent it is.

    `approach` has the room, how much faster than as it brakes the arm may come nearer, and where its joints take time
    to make way, the part of the way out that the row's direction is, and how fast the distance grows by itself. In the
    state that an arm with brakes is `leaving`, rows lead out of what is too near, faster from tick to tick by what
    joints certainly can, so that no such row contradicts their accelerations; nor does one that makes way in time.
    In the state of `now` rows are on the velocity itself, not on what it is more than braking.
    """
    (room, nearer, slower, out, drift), (alpha, escape), m = approach, settings[1:3].tolist(), len(C)
    scaled = np.abs(C) * np.where(np.isfinite(speed), speed, USUAL_SPEED)
    if leaving and room >= 0.0:
        return -inf, 0.0
    moved, size = C != 0.0, np.abs(C)
    braked = float(C[moved].dot(states.y[:m][moved]))
    sure = states.led if leaving else states.sure
    ways = states.free, states.free[::-1], sure[::-1]
    below, above, surely = (np.where(C > 0.0, *way[:, :m])[moved] for way in ways)
    if room < 0.0:
        led = min(-alpha * room, escape * float(scaled.dot(scaled)) / float(scaled.max()))
        nearer = drift - max(0.0, out) * led
    y = 0.0 if now else braked
    lower = max(y - nearer, min(y - slower, braked + float(size[moved].dot(above))))
    if leaving or (room < 0.0 and drift == 0.0):
        lower = min(lower, braked + float(size[moved].dot(surely)))
    if not lower > braked - float(size[moved].dot(below)):
        return -inf, 0.0
    return lower, (lower - braked) / float(scaled.sum())


def _keep(kept: list[tuple[float, float, int, Array]], row: tuple[float, float, int, Array]) -> None:
    """Keep a row among the most urgent; equal ones are one, as urgent as any of them, that asks for the most."""
    size = se3.norm(row[3])
    same = next((i for i, old in enumerate(kept) if np.abs(old[3] - row[3]).max() <= NEGLIGIBLE * size), None)
    if same is not None:
        kept[same] = (max(kept[same][0], row[0]), *max(kept[same][1:], row[1:], key=lambda asks: asks[0]))
    elif len(kept) < MOST_ROWS:
        kept.append(row)
    else:
        last = min(range(len(kept)), key=lambda i: kept[i][0])
        if kept[last][0] < row[0]:
            kept[last] = row


def placed_at(
    shapes: Array, motions: Sequence[Array], own: Sequence[Array] = (), solids: Sequence[Solid | None] = ()
) -> list[Placed]:
    """Shapes (n, 18) in the base frame, by the motions of the bodies and those of their own; `solids` are of meshes."""
    made = []
    for i, numbers in enumerate(shapes):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = numbers[6:15].reshape(3, 3), numbers[15:]
        T = motions[int(numbers[0])].dot(T)
        solid = solids[i] if solids else None
        made.append(Placed(Core(int(numbers[1])), float(numbers[2]), numbers[3:6], own[i].dot(T) if own else T, solid))
    return made


def levers_of(robots: Sequence[Chain], shapes: Array) -> Array:
    """(n, M) how far any point of a shape (n, 18) ever moves, at most, for a radian or length of each joint before it.

    From the middle of a shape to a point of the axis before it, from there to one of the next, and so on: turning about
    these axes changes none of these distances, and sliding changes them by how far a joint slides.
    """
    starts, screws = starts_of(robots), np.hstack([robot.screws for robot in robots])
    ranges = [np.concatenate([getattr(r, end) for r in robots]) for end in ("position_lower", "position_upper")]
    levers = np.zeros((len(shapes), screws.shape[1]))
    for lever, numbers in zip(levers, shapes, strict=True):
        body = int(numbers[0])
        if int(numbers[1]) == Core.HALF_SPACE:
            lever[starts[body] : body] = inf
            continue
        x, reach = numbers[15:], se3.norm(numbers[3:6]) + float(numbers[2])
        for k in reversed(range(starts[body], body)):
            turn, slide = screws[:3, k], screws[3:, k]
            rate = se3.norm(turn)
            if rate > 0.0:
                axis, on_axis = turn / rate, se3.cross(turn, slide) / rate**2
                foot = on_axis + axis * float(axis.dot(x - on_axis))
                reach += se3.norm(x - foot)
                x, slide = foot, axis * float(axis.dot(slide))
            along = se3.norm(slide)
            lever[k] = rate * reach + along
            if along > ROUNDING * lever[k]:
                low, high = float(ranges[0][k]), float(ranges[1][k])
                reach += along * (high - low + max(abs(low), abs(high)))
    return levers
