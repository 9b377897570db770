"""The rows of a tick that keep bodies apart: the definition of csrc/clearance.c.

    C x >= -alpha (d - d_min) - n'v_obstacle        C = w'J on the joints between two bodies,  w = (p x n; n)

for each place where a pair is near (`geometry/distance.py`), in each of the states that an arm with brakes passes as it
comes to rest; `clearance.py` says why.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, inf
from typing import NamedTuple

import numpy as np

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import Place, Placed, Solid, places
from invariantqp.geometry.shapes import Core
from invariantqp.robots.chain import Chain
from invariantqp.velocity.limits import braking_speed

# Rows of a tick, at most: more than an arm has joints several times over.
MOST_ROWS = 16
# Rows that differ by less than this share of their length are one row.
EQUAL = 1e-9
# A joint that moves a place along its normal by less than this share of what its terms sum up to does not move it.
UNMOVED = 1e-12
# Nor does one that turns about the normal, but for this angle [rad] and this share of how fast the place goes: pi/2
# written as 1.5708 is off by 4e-6. Left out is less than 10 micrometres for each metre that the place goes.
ASKEW = 1e-5
# Of the ticks until one state those until the next nearer one: with a half, an arm that passes a corner at full speed
# sees it late in one of 2000 ticks.
NEARER = 0.7
# States that are ticks away keep this times the distance: what is linear in x - y is off by less.
AHEAD = 1.01
# Joints without a velocity limit count as this fast where pairs are ranked and led apart [rad/s, length/s].
USUAL_SPEED = 1.0
# Numbers of a shape for the compiled core: body, core, radius, half sizes, rotation, place.
OF_SHAPE = 18


class Rate(NamedTuple):
    """What decides how fast bodies may come nearer."""

    limits: Array  # (4, m) of speed, acceleration (inf where joints stop at once) and position, the lower and the upper
    settings: Array  # d_min [length], alpha [1/s], ESCAPE, a tick [s], BRAKING, ticks to look ahead at least
    delay: float  # of the robot [s]

    def for_others(self, stops: float) -> tuple[Array, Array]:
        """Limits and settings that look ahead until others have stopped, too [s]."""
        if not stops > 0.0 or not self.settings[3] > 0.0:
            return self.limits, self.settings
        return self.limits, np.append(self.settings[:5], np.ceil(stops / self.settings[3]))

    def braked(self, before: Array, share: float) -> Array:
        """(m,) how fast joints still are after a tick of braking a velocity (m,), at a share of what rows brake by."""
        b = self.settings[4] * self.limits[1]
        slower = np.abs(before) - self.settings[3] * np.where(np.isfinite(b), share * b, b)
        return np.asarray(np.maximum(slower, 0.0))


class Found(NamedTuple):
    """The rows of a tick, and distances."""

    C: Array  # (r, m)
    lower: Array  # (r,)
    pair: Array  # (r,) which pair each row is of
    distances: Array  # (k,) of the pairs at q [length]


class States(NamedTuple):
    """The states in which distances are looked at: the arm's own first, and those that it passes as it brakes."""

    positions: Array  # (s, m) of the joints
    weights: Array  # (s, m) how they change with the velocity, in ticks
    times: Array  # (s,) from now [s]
    y: Array  # (m,) the velocity braked for a tick
    reach: Array  # (m,) how far another one can be from it
    sure: Array  # (m,) and certainly

    @classmethod
    def ahead(cls, q: Array, before: Array, limits: Array, settings: Array) -> States:
        """From joint positions q (m,), after a velocity `before` (m,); limits and settings are as in `Rate`."""
        m = len(q)
        speed, a, low, high = limits
        if np.isinf(a).all():
            return cls(q[None], np.ones((1, m)), np.zeros(1), np.zeros(m), speed, np.full(m, inf))
        dt, share, horizon = settings[3:].tolist()
        b = share * a
        y = np.sign(before) * np.maximum(np.abs(before) - b * dt, 0.0)
        y = np.clip(y, -braking_speed(q - low, a, dt), braking_speed(high - q, a, dt))
        ticks = np.floor(np.abs(y) / (b * dt))  # that y takes to stop, but for a rest
        n = [0.0, *moments(max(float(ticks.max()), horizon))]
        own = np.minimum(np.array(n)[:, None], ticks)
        with np.errstate(invalid="ignore"):  # infinitely strong brakes stop in no tick
            lost = np.where(own > 0.0, 0.5 * b * dt * own * (own + 1.0), 0.0)
        free = q + dt * ((own + 1.0) * y - np.sign(y) * lost)
        states = np.clip(free, np.minimum(low, q), np.maximum(high, q))
        weights = np.where(states == free, own + 1.0, 1.0)
        reach, sure = np.minimum(2.0 * a * dt, speed + np.abs(y)), (1.0 - share) * a * dt
        times = dt * np.array([0.0, *n])
        return cls(np.vstack((q, states)), np.vstack((np.ones(m), weights)), times, y, reach, sure)


def moments(ticks: float) -> list[float]:
    """A number of ticks, NEARER of it, of that, ... down to one, whole ones."""
    found = []
    while ticks > 0.0:
        found.append(ticks)
        ticks = floor(NEARER * ticks) if ticks > 1.0 else 0.0
    return found


def rows_of(
    robot: Chain,
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
        robot: whose joints move the bodies.
        q: (m,) joint positions.
        before: (m,) joint velocity.
        shapes: (n, 18) body, core, radius, half sizes (3), rotation (9) and place (3) at q = 0, in the base frame.
        twists: (n, 7) of shapes by themselves, and after how long each has stopped [s], inf where it goes on.
        pairs: (k, 3) two shapes, and the share of the room that this arm may take.
        limits: as in `Rate`.
        settings: as in `Rate`.
        solids: (n,) what tells distances of meshes, None of other shapes.

    Returns:
        Found; the core leaves those distances infinite that are neither the least nor near enough for a row, unless
        alpha is 0.
    """
    states = States.ahead(q, before, limits, settings)
    kept: list[tuple[float, float, int, Array]] = []  # urgency, lower limit, pair, row
    distances = np.full(len(pairs), inf)
    for s, (at, weight, time) in enumerate(zip(*states[:2], states.times.tolist(), strict=True)):
        J, motions, leaving = robot.jacobian(at), robot.motions(at), s == 0 and len(states.times) > 1
        going = [_going(time, float(stops)) for stops in twists[:, 6]]
        own = [se3.exp(t * twist[:6], check=False) for (t, _), twist in zip(going, twists, strict=True)]
        placed = placed_at(shapes, motions, own, solids)
        by_itself = np.array([left for _, left in going])[:, None] * twists[:, :6]
        for k, (i, j, share) in enumerate(pairs.tolist()):
            one, other = int(i), int(j)
            bodies = int(shapes[one, 0]), int(shapes[other, 0])
            between = slice(min(bodies), max(bodies))
            sides = by_itself[other] - by_itself[one], weight[between] * (1.0 if bodies[0] < bodies[1] else -1.0)
            wanted = min(settings[0] * (AHEAD if s > 1 else 1.0), distances[k] if s > 0 else inf)
            found = places(placed[one], placed[other])
            moved = [(place, C) for place in found if (C := _row(place, J, between, sides[1])).any()]
            if s == 0:
                distances[k] = min((place.distance for place, _ in moved), default=inf)
            for place, C in moved:
                drift = float(_wrench(place).dot(sides[0]))
                out = float(place.normal.dot(moved[0][0].normal))
                room = place.distance - wanted
                approach = min(room, share * room), out, drift
                lower, urgency = _asked_of(C, approach, states, limits[0], settings, leaving=leaving)
                if lower > -inf:
                    _keep(kept, (urgency - (place is not found[0]), lower, k, C))
    C_kept = np.array([row[3] for row in kept]).reshape(-1, len(q))
    return Found(C_kept, np.array([row[1] for row in kept]), np.array([float(row[2]) for row in kept]), distances)


def _going(time: float, stops: float) -> tuple[float, float]:
    """How long a body that slows down until it stops would go at its speed of now, and at which share of it goes on."""
    if stops == inf:
        return time, 1.0
    return (time - 0.5 * time * time / stops, 1.0 - time / stops) if time < stops else (0.5 * stops, 0.0)


def _wrench(place: Place) -> Array:
    return np.concatenate((se3.cross(place.point, place.normal), place.normal))


def _row(place: Place, J: Array, between: slice, weights: Array) -> Array:
    """(m,) how fast a distance grows with joint velocities, weighed; zero where it is rounding, of sums or of axes."""
    parts = _wrench(place)[:, None] * J[:, between]
    total, C = parts.sum(axis=0), np.zeros(J.shape[1])
    turn, speed = J[:3, between], J[3:, between] + np.cross(J[:3, between], place.point, axis=0)
    across, turning, going = (np.linalg.norm(x, axis=0) for x in (np.cross(turn, place.normal, axis=0), turn, speed))
    about = (across <= ASKEW * turning) & (np.abs(total) <= ASKEW * going)
    moved = (np.abs(total) > UNMOVED * np.abs(parts).sum(axis=0)) & ~about
    C[between] = weights * np.where(moved, total, 0.0)
    return C


def _asked_of(
    C: Array, approach: tuple[float, float, float], states: States, speed: Array, settings: Array, *, leaving: bool
) -> tuple[float, float]:
    """The lower limit of a row, -inf where every velocity keeps it, and how urgent it is.

    `approach` has the room that the arm may take, the part of the way out that the row's direction is, and how fast
    the distance grows by itself. In the state that an arm with brakes is `leaving`, rows lead out of what is too near;
    out of what stands still no faster than brakes certainly can, so that no such row contradicts them.
    """
    (room, out, drift), (alpha, escape) = approach, settings[1:3].tolist()
    scaled = np.abs(C) * np.where(np.isfinite(speed), speed, USUAL_SPEED)
    moved = C != 0.0
    braked = float(C[moved].dot(states.y[moved]))
    if leaving and room >= 0.0:
        return -inf, 0.0
    if room >= 0.0:
        wish = -alpha * room
    else:
        wish = max(0.0, out) * min(-alpha * room, escape * float(scaled.dot(scaled)) / float(scaled.max()))
    lower = (0.0 if leaving else braked) + wish - drift
    if leaving or (room < 0.0 and drift == 0.0):
        lower = min(lower, braked + float(np.abs(C[moved]).dot(states.sure[moved])))
    if not lower > braked - float(np.abs(C[moved]).dot(states.reach[moved])):
        return -inf, 0.0
    return lower, (lower - braked) / float(scaled.sum())


def _keep(kept: list[tuple[float, float, int, Array]], row: tuple[float, float, int, Array]) -> None:
    """Keep a row among the most urgent; of equal ones the one that asks for more."""
    size = se3.norm(row[3])
    same = next((i for i, old in enumerate(kept) if np.abs(old[3] - row[3]).max() <= EQUAL * size), None)
    if same is not None:
        if kept[same][1] < row[1]:
            kept[same] = row
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


def levers_of(robot: Chain, shapes: Array) -> Array:
    """(n, m) how far any point of a shape (n, 18) ever moves, at most, for a radian or length of each joint before it.

    From the middle of a shape to a point of the axis before it, from there to one of the next, and so on: turning about
    these axes changes none of these distances, and sliding changes them by how far a joint slides.
    """
    levers = np.zeros((len(shapes), len(robot.names)))
    for lever, numbers in zip(levers, shapes, strict=True):
        if int(numbers[1]) == Core.HALF_SPACE:
            lever[: int(numbers[0])] = inf
            continue
        x, reach = numbers[15:], se3.norm(numbers[3:6]) + float(numbers[2])
        for k in reversed(range(int(numbers[0]))):
            turn, slide = robot.screws[:3, k], robot.screws[3:, k]
            rate = se3.norm(turn)
            if rate > 0.0:
                axis, on_axis = turn / rate, se3.cross(turn, slide) / rate**2
                foot = on_axis + axis * float(axis.dot(x - on_axis))
                reach += se3.norm(x - foot)
                x, slide = foot, axis * float(axis.dot(slide))
            along = se3.norm(slide)
            lever[k] = rate * reach + along
            if along > UNMOVED * lever[k]:
                low, high = float(robot.position_lower[k]), float(robot.position_upper[k])
                reach += along * (high - low + max(abs(low), abs(high)))
    return levers
