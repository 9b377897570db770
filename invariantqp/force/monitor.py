"""What stops a press: checks, each a value whose `update` gives the next one and what it found.

overload    |f| > max_force or |m about the place of contact or the grip| > max_moment; until `reset`. Without a
            max_force what is wanted limits the press, and what is felt across it, each by itself: friction is no part
            of a press. Where less is wanted than before, the limit falls with what is felt
dead        a sensor that has noise reads exactly the same for a tenth of a second
pulls       a contact that can only push is read to pull by half of the wanted press
approach    an approach that meets nothing within approach_distance or approach_time, or in which the tool never comes
            nearer as commanded, stands still until `reset`
answers     readings and way have to agree, `Answers`; what they cannot tell is asked by letting go
settling    the press swings or is not reached; told, and no reason to stop
"""

from __future__ import annotations

from math import copysign, exp, inf, sqrt
from typing import Annotated, NamedTuple

import numpy as np

from invariantqp.errors import written
from invariantqp.force.contact import ROUNDING, TINY, HybridTask
from invariantqp.force.contact_kinds import Contact
from invariantqp.force.estimate import (
    CERTAIN,
    HALF,
    LEAST_WAY,
    MEMORY,
    NOISIER,
    RESOLVED,
    SHORT,
    STEP,
    STIFF,
    SURPRISE,
    UNSHOWN,
    Setting,
    Stiffness,
    Touch,
    weighed,
)
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.solution import Status

# What the controller is to do in a tick.
FOLLOW, SLOW, HOLD, RETREAT = "follow", "slow", "hold", "retreat"

# Overload without another word: a multiple of the wanted force, or this force where none is wanted [N]. Readings of a
# force stay within so many standard deviations of a component. A larger press that was wanted before is still expected
# for PATIENCE, and while it falls.
OVERLOAD = 2.5
NO_FORCE = 20.0
ABOVE_NOISE = 8.0

# For how long a reading with noise may stay the same to the last bit [s], and after which time already the force law
# waits for the next one.
DEAD_AFTER = 0.1
STALE_AFTER = 0.012

# What a user may have told wrong of a sensor, and what an overload before the tool went in may be.
TOLD = "reads=, order=, mass= or bias="
AT_ONCE = f", out of the air: the sensor's {TOLD} is wrong, or something is in the way"

# Over which share of retreat_distance a tool has to follow commands, from which share of that on it is judged, of which
# share it has to come at least, and of which it has moved at all: something holds it.
LED = 0.5
JUDGED = 1.0 - exp(-1.0)
FOLLOWED = 0.2
MOVED = 0.02
# By how much of the way that it was commanded already a release goes on each second [1/s].
LETS_GO = 5.0

# Readings that answer. Unanswered way may be worth so many presses.
PRESSES = 2.0
# A fall by less than so many standard deviations may be noise.
FELL_NOISE = 6.0
# An answer: the way explains so much of the squared force over four variances of noise, four standard errors of k. What
# is longer ago than this [s] counts no more.
CHI = 4.0
SINCE = 2.0
# An answer shows a contact no softer than this share of what was shown before: a sensor that sticks looks soft, too.
SOFTER = 0.5
# So long after readings have answered, or changed, a slope is an excuse [s].
EXCUSED = 0.5

# More turns than these, forgotten with this time constant [s], are swings, each by this share of the wanted press and
# no noise: a surface that moves at 1 Hz turns twice a second, and swings nothing.
TURNS = 5
SWUNG = 2.2
SWING = 0.3
# A press that is SHORT for this long [s] is not reached; the time constant of its average.
PATIENCE = 1.0
AVERAGED = 0.2


class Tick(NamedTuple):
    """What a tick tells the checks.

    Attributes:
        dt: tick [s].
        reading: (6,) as it came.
        press: felt, raw, and wanted [force]; None where the contact cannot be lost. Of several the weakest.
        together: what is felt of all presses, in the unit of that [force].
        force, moment: about the place of contact; where no max_force is declared, the larger part of the force along
            the way out and across it.
        most: force and moment that are an overload of what is wanted now.
        missing: from the wanted wrench, smoothed, its force or its moment, as a share of an overload.
        noise: standard deviation of a force component [force].
        limit: between air and contact [force].
        touch: whether there is contact, after this reading.
        commanded: how far it was commanded nearer, of commands that can have acted [length].
        came: how far the place of contact has come nearer since the last tick, by the joints [length].
        across: (3,) way across since the last tick, by the joints [length].
    """

    dt: float
    reading: Array
    press: tuple[float, float] | None
    together: float
    force: float
    moment: float
    most: tuple[float, float]
    missing: float
    noise: float
    limit: float
    touch: Touch
    commanded: float
    came: float
    across: Array

    @property
    def wanted(self) -> float | None:
        """The press that is wanted [force]; None where the contact cannot be lost."""
        return None if self.press is None else self.press[1]


class Finding(NamedTuple):
    """What a check found: the status until `reset`, why, and how far from the touch the tool retreats.

    `away` None is the task's own retreat.
    """

    status: Status
    reason: str
    away: float | None = None


class Overload(NamedTuple):
    """Force and moment above which it is too much."""

    most: tuple[float, float] = (0.0, 0.0)

    def update(self, task: HybridTask, tick: Tick) -> tuple[Overload, Finding | None]:  # noqa: ARG002
        """The check after a tick."""
        share = exp(-tick.dt / PATIENCE)
        felt = (tick.force, tick.moment)
        force, moment = (
            max(n, min(share * b, OVERLOAD * f)) for b, f, n in zip(self.most, felt, tick.most, strict=True)
        )
        what = f"{written(tick.force)} N of {written(force)}" if tick.force > force else ""
        turn = f"{written(tick.moment)} N m of {written(moment)}" if tick.moment > moment else ""
        found = " and ".join(w for w in (what, turn) if w)
        return Overload((force, moment)), Finding(Status.OVERLOAD, found) if found else None


def overload_of(task: HybridTask, force: float, moment: float, noise: float) -> tuple[float, float]:
    """The force and the moment that are an overload, for the size of the wanted ones.

    Args:
        task: says them, or leaves them to what is wanted.
        force: wanted [N].
        moment: wanted, about the place of contact [N length].
        noise: standard deviation of a force component [N]: readings of the wanted force stay below the limit.
    """
    most, turning = task.max_force, task.max_moment
    if most is None:
        most = max(OVERLOAD * force, force + ABOVE_NOISE * noise) if force > 0.0 else NO_FORCE
    if turning is None:
        turning = max(OVERLOAD * moment, moment + task.size * most)
    return most, turning


class Dead(NamedTuple):
    """For how long the reading has been the same while the tool moves, although the sensor has noise."""

    reading: Annotated[Array, 6] | None = None
    unchanged: float = 0.0
    alive: bool = False

    @property
    def stale(self) -> bool:
        """Whether the reading is too old to press by."""
        return not self.alive or self.unchanged > STALE_AFTER

    def update(self, task: HybridTask, tick: Tick) -> tuple[Dead, Finding | None]:  # noqa: ARG002
        """The check after a tick."""
        same = self.reading is not None and tick.noise > 0.0 and bool((tick.reading == self.reading).all())
        moves = tick.came != 0.0 or bool(tick.across.any())  # readings at rest may be the same
        unchanged = self.unchanged + (tick.dt if moves else 0.0) if same else 0.0
        first = self.reading is None
        alive = self.alive or tick.noise == 0.0 or tick.press is None or not (first or same)
        now = Dead(tick.reading, unchanged, alive)
        if unchanged <= DEAD_AFTER:
            return now, None
        said = f"the reading has not changed for {written(unchanged)} s: a dead sensor (one without noise: noise=0)"
        return now, Finding(Status.FAULT, said)


class Pulls(NamedTuple):
    """Evidence that a contact is read to pull which can only push."""

    pull: float = -CERTAIN

    def update(self, task: HybridTask, tick: Tick, *, close: bool = False) -> tuple[Pulls, Finding | None]:  # noqa: ARG002
        """The check after a tick; `close` where the tool has let go or lost the contact: nothing is to be read."""
        if tick.press is None or tick.press[1] == 0.0:
            return self, None
        felt, wanted = tick.together, tick.press[1]
        pull = weighed(self.pull, -felt, tick.limit if close else max(tick.limit, HALF * wanted), tick.noise)
        if pull < CERTAIN:
            return Pulls(pull), None
        said = f"the reading says that the contact pulls with {written(-felt)} N: the sensor's {TOLD} is wrong"
        return Pulls(pull), Finding(Status.FAULT, said)


class Approach(NamedTuple):
    """How far and how long contact has been looked for, since the start or the last loss.

    Attributes:
        waited: for how long it has not been felt [s].
        led: how far it was commanded nearer since then and how far it came, both with what was longer ago than LED
            forgotten [length].
        way: towards the contact [length].
    """

    waited: float = 0.0
    led: tuple[float, float] = (0.0, 0.0)
    way: float = 0.0

    def update(self, task: HybridTask, tick: Tick) -> tuple[Approach, Finding | None]:  # noqa: PLR0911 (one for each end)
        """The check after a tick."""
        if tick.press is None or tick.touch.touching:
            return Approach(), None
        over = LED * task.retreat_distance
        kept = exp(-abs(tick.commanded) / over)
        led, came = kept * self.led[0] + tick.commanded, kept * self.led[1] + tick.came
        now = Approach(self.waited + tick.dt, (led, came), self.way + max(0.0, tick.commanded))
        airborne = tick.touch.airborne
        before = airborne == inf
        if task.on_loss == "retreat" and not before and airborne > task.lost_after:
            return now, Finding(Status.LOST, f"no contact for {written(airborne)} s")
        if task.on_loss == "continue" and not before:
            return now, None
        if led > JUDGED * over and came < FOLLOWED * led:
            what = f"told to come {written(led, 2)} nearer, the tool came {written(came, 2)}"
            if came > MOVED * led:
                held = f"{what}, and nothing is felt: something holds it, or the sensor is stuck"
                return now, Finding(Status.FAULT, held)
            return now, Finding(Status.LOST, f"{what}: the robot does not follow commands", 0.0)
        if now.way > task.approach_distance:
            said = f"no contact within {written(task.approach_distance)} of approach"
            return now, Finding(Status.LOST, said, 0.0)
        if now.waited > task.approach_time:
            return now, Finding(Status.LOST, f"no contact within {written(task.approach_time)} s of approach", 0.0)
        return now, None


class Evidence(NamedTuple):
    """Whether readings follow the way, from the last answer on: what was before counts for nothing.

        f = k x + an offset,     both from there on

    Attributes:
        began: way and force there; None before the first reading.
        sums: (3, 3) products of way, force and one.
        noise: what of the square of the force is noise.
    """

    began: tuple[float, float] | None = None
    sums: Annotated[Array, 3, 3] = np.zeros((3, 3))
    noise: float = 0.0

    def after(self, known: Stiffness, noise: float, wanted: float, shared: float, dt: float) -> Evidence:
        """The same after one more reading; the arguments as in `Answers.update`."""
        if self.began is None:
            return Evidence((known.way, known.force))
        read = np.array((known.way - self.began[0], known.force - self.began[1], 1.0))
        weight = shared / (4.0 * noise * noise + (0.01 * wanted) ** 2)
        left = exp(-dt / SINCE)
        sums = left * self.sums + weight * np.outer(read, read)
        return self._replace(sums=sums, noise=left * self.noise + weight * noise * noise)

    @property
    def answers(self) -> bool:
        """Whether the force follows the way, or changes, by whatever, by more than noise does: it is not stuck."""
        return self.stiffness > 0.0 or self._beside_offset[2] > NOISIER * NOISIER * self.noise + CHI

    @property
    def stiffness(self) -> float:
        """Of the spring that explains the force by the way; 0 for none."""
        a, b, _ = self._beside_offset
        return b / a if a > 0.0 and b > 0.0 and b * b > CHI * a else 0.0

    @property
    def _beside_offset(self) -> tuple[float, float, float]:
        """Squared way, way times force, squared force, beside what an offset, such as the first noise, explains."""
        s = self.sums
        if s[2, 2] == 0.0:
            return 0.0, 0.0, 0.0
        (a, b), (_, f) = (s[:2, :2] - np.outer(s[:2, 2], s[2, :2]) / s[2, 2]).tolist()
        return a, b, f


class Release(NamedTuple):
    """A press that is let go to see whether its readings fall.

    Attributes:
        depth, force: where it began [length], and what was read there, or noise may be [force].
        most: way that is let go, on a surface that stands: a STEP beyond where nothing was felt last; where they fall
            beyond that, and what it had sunk in to rest; a retreat's where noise would hide a fall [length].
        highest: the most that was read since then, or since readings last fell by more than noise [force].
        across: (3,) since then [length]: no further than a slope of that is the surface from where it was.
        led: how far it was commanded out since then [length].
        fell: depth where the readings had fallen to nothing; None before.
        beyond: whether it has been where nothing should be read: from there on it is asked whether anything is.
    """

    depth: float
    force: float
    most: float
    highest: float
    across: Annotated[Array, 3] = np.zeros(3)
    led: float = 0.0
    fell: float | None = None
    beyond: bool = False

    def bound(self, slope: float, moves: float) -> float:
        """The way that is let go at most before the readings have fallen to nothing [length]."""
        return self.most + moves + slope * _length(self.across)


class Answers(NamedTuple):
    """Whether readings and way agree: one account with a sign, for way that readings do not show and for the reverse.

        since the last answer     |k (way - grade . way across) - change of the force|
        since it has rested       how far the change of the force is outside what k of the way may be

    On a contact readings follow f = k x + b x'. What they have not answered of the way, in or out, is worth at most two
    presses of the stiffest contact that the touch can have shown. That the surface rises where the tool slides is an
    excuse for half a second: then it has to have been answered, `grade`, or a sensor that is stuck would be a slope
    that is followed. Where the force stands, it changes with the way as on a contact between the softest and the
    stiffest that was shown, within SHORT of the press, from nothing on: a bias that drifts or jumps moves the tool, as
    a surface would that moves. A sensor's press that was there from the first reading on, and does not stir, no way has
    shown: in the air it would be a bias.

    What the readings cannot tell the tool asks: it lets go. On a contact they fall, where they have moved the tool to
    nothing, and what made it ask was the surface, which is known to move so far; a sensor that is stuck, off or not
    tared reads something, and that is a fault.

    Attributes:
        stiff: bound of the stiffness as the touch or the last answer showed it [force/length].
        quiet: the commanded way, as it shows, where nothing was felt last, or at the first reading [length]. What an
            arm or its drives give way to a force, no joint measures.
        depth: way in from there [length].
        since: depth and force at the last answer, or at the touch.
        across: (3,) since then [length].
        grade: (3,) how much the surface rises towards the tool for a way across, as answers showed it.
        shown: squared length of the way over which they did, older ones forgotten: over more it says nothing.
        silent: for how long readings have neither answered nor stirred [s].
        evidence: of an answer.
        touched: force at depth 0.
        rested: for how long the force has been near the wanted one [s].
        rest: depth, force and least stiffness, and the wanted force they are of; None before it has rested.
        slid: (3,) across since the touch or since it has rested [length].
        off: for how long the way has not been what the force says [s].
        release: of the press; None where it is not let go.
        moves: how far the surface is known to move, by having asked [length].
        read: evidence that the limit between air and contact is read, and not nothing: then the account ends.
    """

    stiff: float = 0.0
    quiet: float = 0.0
    depth: float = 0.0
    since: tuple[float, float] = (0.0, 0.0)
    across: Annotated[Array, 3] = np.zeros(3)
    grade: Annotated[Array, 3] = np.zeros(3)
    shown: float = 0.0
    silent: float = 0.0
    evidence: Evidence = Evidence()
    touched: float = 0.0
    rested: float = 0.0
    rest: tuple[float, float, float, float] | None = None
    slid: Annotated[Array, 3] = np.zeros(3)
    off: float = 0.0
    release: Release | None = None
    moves: float = 0.0
    read: float = -CERTAIN

    def update(
        self,
        task: HybridTask,
        tick: Tick,
        known: Stiffness,
        press: float,
        wanted: float,
        noise: float,
        shared: float,
    ) -> tuple[Answers, Finding | None]:
        """The check of one press after a tick.

        Args:
            task: slope, size, and how far its surface may move.
            tick: of all checks.
            known: stiffness of this press, with its smoothed force and the commanded way.
            press: measured, smoothed [force].
            wanted: [force].
            noise: of the smoothed press [force].
            shared: how independent one reading is of the last.
        """
        read = weighed(self.read, press, tick.limit / 2.0, tick.noise)
        left = not (tick.touch.touching or self.release) and (self.stiff == 0.0 or read == -CERTAIN)
        if left or wanted <= 0.0:
            return self.begun(), None
        if self.stiff == 0.0:
            stiff = UNSHOWN * (task.stiffness or STIFF) if known.stiff is None else known.stiff
            quiet, touched = (known.way, press) if known.quiet is None else (min(known.quiet, known.way), 0.0)
            depth = known.way - quiet
            first = self._replace(stiff=stiff, quiet=quiet, depth=depth, since=(depth, press), touched=touched)
            return first._replace(read=CERTAIN), None
        now = self._replace(depth=known.way - self.quiet, across=self.across + tick.across, read=read)
        evidence = self.evidence.after(known, noise, wanted, shared, tick.dt)
        now = now._replace(evidence=evidence)
        if self.release is not None:
            across, led = self.release.across + tick.across, self.release.led - tick.commanded
            release = self.release._replace(across=across, led=led)
            if not release.beyond and release.depth - now.depth > release.bound(task.slope, self.moves):
                now, release = now._replace(read=0.0), release._replace(beyond=True)
            return now.released(release, task, known, press, wanted, noise)
        now = now._replace(slid=self.slid + tick.across, silent=self.silent + tick.dt)
        now = now.at_rest(task, tick.dt, press, wanted, noise)
        if evidence.answers:
            now = now.heard(task, known, press, noise)
        begun = tick.noise > 0.0 and self.rest is None and now.rest is not None
        unshown = begun and known.stiff is None and now.silent >= PATIENCE
        if unshown or now.unseen(task, press) > PRESSES * wanted or now.off > AVERAGED:
            most = task.retreat_distance
            if press > FELL_NOISE * noise:  # less would fall unseen, and how far it reached is not known either
                most = min(max(now.depth, 0.0) + STEP * task.size, most)
            release = Release(now.depth, max(press, FELL_NOISE * noise), most, press)
            return now._replace(release=release, evidence=Evidence()), None
        return now, None

    def begun(self) -> Answers:
        """Of a contact that is touched anew."""
        return Answers(moves=self.moves, grade=self.grade, shown=self.shown)

    def heard(self, task: HybridTask, known: Stiffness, press: float, noise: float) -> Answers:
        """The same after readings that have answered or changed: how the surface rises where the tool slid.

        Args:
            task: slope and size.
            known: stiffness.
            press: measured [force].
            noise: of the smoothed press [force]: what it may hide is no rise.
        """
        k, grade, shown, stiff = known.known, self.grade, self.shown, self.evidence.stiffness
        if k is not None:  # where the force changes, too, the way says less of the surface
            sinks = (press - self.since[1]) / k
            rise = self.depth - self.since[0] - sinks - float(grade.dot(self.across))
            rise = copysign(max(abs(rise) - 2.0 * sqrt(2.0) * noise / k, 0.0), rise)
            least = STEP * task.size + abs(sinks) / task.slope
            shown = (1.0 - 1.0 / MEMORY) * shown + float(self.across.dot(self.across))
            grade = grade + rise / (shown + least * least) * self.across
            grade = grade * min(1.0, task.slope / max(_length(grade), TINY))
        return self._replace(
            stiff=max(min(2.0 * stiff, self.stiff), 2.0 * (k or 0.0), SOFTER * self.stiff) if stiff else self.stiff,
            since=(self.depth, press),
            across=np.zeros(3),
            grade=grade,
            shown=shown,
            silent=0.0,
            evidence=Evidence(),
        )

    def unseen(self, task: HybridTask, press: float) -> float:
        """What may be pressed more or less than is read, by way that was not answered [force]."""
        across = _length(self.across)
        share = min(1.0, sqrt(self.shown) / max(across, TINY))  # of the way across, the grade was seen on no more
        way = self.depth - self.since[0] - share * float(self.grade.dot(self.across))
        slope = task.slope * across if self.silent < EXCUSED else 0.0
        room = self.stiff * (task.yields + self.moves + slope)
        return max(0.0, abs(self.stiff * way - (press - self.since[1])) - room)

    def at_rest(self, task: HybridTask, dt: float, press: float, wanted: float, noise: float) -> Answers:
        """The same with what is known of the force that stands."""
        if self.rest is not None and self.rest[3] != wanted:
            return self._replace(rested=0.0, rest=None, off=0.0)
        room = task.slope * _length(self.slid) + task.yields + self.moves + LEAST_WAY * RESOLVED * task.size
        least_felt = max(SHORT * wanted, FELL_NOISE * noise)
        if self.rest is None:
            rested = self.rested + dt if abs(press - wanted) < SHORT * wanted else 0.0
            if rested < PATIENCE:
                return self._replace(rested=rested)
            shown, way = max(press - self.touched, 0.0), max(self.depth, 0.0) + room
            off = inf if shown - self.stiff * way > least_felt else 0.0
            return self._replace(rest=(self.depth, press, shown / way, wanted), slid=np.zeros(3), off=off)
        depth, force, least, _ = self.rest
        way = self.depth - depth
        low = (least if way > room else self.stiff) * (way - room)
        high = (least if way < -room else self.stiff) * (way + room)
        missing = max(low - (press - force), (press - force) - high)
        return self._replace(off=self.off + dt if missing > least_felt else 0.0)

    def released(
        self,
        release: Release,
        task: HybridTask,
        known: Stiffness,
        press: float,
        wanted: float,
        noise: float,
    ) -> tuple[Answers, Finding | None]:
        """The same while the tool lets go: until readings fall, or to nothing where they have rested."""
        rested, gone, size = self.off > AVERAGED, release.depth - self.depth, task.size
        began = self.rest if rested and self.rest is not None else self.since
        moves = max(self.moves, 2.0 * abs(release.depth - began[0]))
        if self.read > -CERTAIN and release.fell is None:
            if not rested and self.evidence.stiffness > 0.0:
                now = self.heard(task, known, press, noise)
                none: Array = np.zeros(3)
                begun = now._replace(rested=0.0, rest=None, slid=none, off=0.0, release=None)
                return begun._replace(moves=moves), None
            release = release._replace(highest=max(release.highest, press))
            if press < release.highest - FELL_NOISE * noise:
                sank = gone if self.rest is None else max(gone, self.rest[0])
                release = release._replace(highest=press, most=max(release.most, sank + STEP * size), beyond=False)
            if release.beyond and self.read == CERTAIN:
                said = f"let go by {written(gone, 2)}, {written(press, 3)} of {written(wanted, 3)} N are still read"
                away = max(0.0, self.depth + 2.0 * STEP * size)
                return self._replace(release=release), Finding(Status.FAULT, f"{said}: {NO_ANSWER}", away)
            return self._replace(release=release), None
        fell = self.depth if release.fell is None else release.fell
        if rested and fell - self.depth < max(0.5 * (release.depth - fell), STEP * size):
            return self._replace(release=release._replace(fell=fell)), None
        return self.begun()._replace(moves=moves), None


# What a reading without an answer may be.
NO_ANSWER = (
    f"the readings do not answer the motion: a sensor that is stuck, drifts, is not tared or told wrong ({TOLD}), a "
    "robot that stands still, or a surface that moves (yields=)"
)


def _length(way: Array) -> float:
    return sqrt(float(way.dot(way)))


class Settling(NamedTuple):
    """What is remembered of the press.

    Attributes:
        press: averaged [force], or what is missing as a share of an overload; None where contact is lost.
        missed: for how long it has been off [s].
        turns: how often the press turned, what is longer ago than SWUNG forgotten.
        rises: whether it has risen since then.
        extreme: the last it reached that way [force].
        wanted: the press that these are about [force].
        swung: how long ago it swung too often [s].
        since, often: how long ago it turned [s], and how often it does, in the mean of the last turns [1/s].
    """

    press: float | None = None
    missed: float = 0.0
    turns: float = 0.0
    rises: bool = True
    extreme: float = 0.0
    wanted: float = 0.0
    swung: float = SWUNG
    since: float = 0.0
    often: float = 0.0

    def after(self, press: tuple[float, float], dt: float, *, lost: bool, noise: float = 0.0) -> Settling:
        """What is remembered after one more tick.

        Args:
            press: felt and wanted [force].
            dt: tick [s].
            lost: whether the contact is told as lost; a shorter time in the air is a press that is not reached.
            noise: standard deviation of the press [force].
        """
        felt, wanted = press
        now = self._turned(felt, wanted, noise, dt)._replace(press=None, missed=0.0)
        if lost:
            return now
        mean = felt if self.press is None else self.press + min(1.0, dt / AVERAGED) * (felt - self.press)
        off = abs(mean - wanted) > SHORT * wanted > 0.0
        return now._replace(press=mean, missed=self.missed + dt if off else 0.0)

    def _turned(self, felt: float, wanted: float, noise: float, dt: float) -> Settling:
        """The same with a turn of the press, where it is one, from its extreme since the last."""
        since = self.since + dt
        now = self._replace(swung=self.swung + dt, since=since, wanted=wanted, turns=0.0, rises=True, extreme=felt)
        if wanted != self.wanted or wanted == 0.0:
            return now
        turns, rises = exp(-dt / SWUNG) * self.turns, self.rises
        back = self.extreme - felt if rises else felt - self.extreme
        if back <= max(SWING * wanted, 2.0 * SURPRISE * noise):
            return now._replace(turns=turns, rises=rises, extreme=felt if back < 0.0 else self.extreme)
        now = now._replace(since=0.0, often=self.often + (1.0 / since - self.often) / TURNS)
        if (self.extreme > wanted) != rises:  # on the way to the wanted press, not about it
            return now._replace(rises=not rises)
        if turns + 1.0 <= TURNS:
            return now._replace(turns=turns + 1.0, rises=not rises)
        return now._replace(swung=0.0, rises=not rises)

    def after_missing(self, missing: float, dt: float) -> Settling:
        """The same where contact cannot be lost: what is missing of force or moment, as a share of an overload."""
        error = missing if self.press is None else self.press + min(1.0, dt / AVERAGED) * (missing - self.press)
        return Settling(press=error, missed=self.missed + dt if error > SHORT else 0.0)

    def unstable(self, late: float) -> bool:
        """Whether a swing too many has just happened, of turns that the law may make, what is late in it [s].

        What turns more often than once in that time would without it, as a tool that chatters along a surface.
        """
        return self.swung == 0.0 and self.often * late <= 1.0

    def trouble(self, wanted: float | None, late: float) -> str:
        """What is wrong, in words, "" for nothing.

        Args:
            wanted: press [force]; None where contact cannot be lost.
            late: sum of tick, delay and low-pass, as the loop was told [s].
        """
        said = []
        if self.swung < SWUNG:
            said.append(
                f"the press swings about {written(self.wanted, 3)} N: readings or commands are later than "
                f"{written(1e3 * late, 2)} ms of tick, filter and delay, or what the tool slides on is rough"
            )
        if self.missed > PATIENCE and self.press is not None:
            long = f"for {written(self.missed, 2)} s"
            if wanted is None:
                off = f"{written(100.0 * self.press, 2)} % of an overload off {long}"
                said.append(f"force or moment is not reached: {off}")
            else:
                said.append(f"the force is not reached: {written(self.press, 3)} of {written(wanted, 3)} N {long}")
        return "; ".join(said)


class Monitor(NamedTuple):
    """All checks of a controller, and what they have found.

    Attributes:
        overload, dead, pulls, approach, answers, settling: the checks.
        found: what stops the tool until `reset`; None for nothing.
        pushed: how far it has gone in since the touch [length].
        approached: way towards the contact in the air [length].
        left: how far it has retreated, and how far it is to [length].
    """

    overload: Overload = Overload()
    dead: Dead = Dead()
    pulls: Pulls = Pulls()
    approach: Approach = Approach()
    answers: Annotated[tuple[Answers, ...], 6] = ()
    settling: Settling = Settling()
    found: Finding | None = None
    pushed: float = 0.0
    approached: float = 0.0
    left: tuple[float, float] = (0.0, 0.0)

    def after(
        self, task: HybridTask, tick: Tick, presses: tuple[tuple[Stiffness, float, float, float], ...], shared: float
    ) -> Monitor:
        """The monitor after a tick.

        Args:
            task: says what is too much.
            tick: of all checks.
            presses: of each press what is known of its stiffness, what is felt (smoothed) and wanted, and the noise
                of that [force].
            shared: how independent one reading is of the last.
        """
        if self.found is not None and self.found.status is not Status.LOST:
            return self
        overload, found = self.overload.update(task, tick)
        if found is not None and (self.dead.reading is None or self.approach.waited > task.lost_after):
            found = found._replace(reason=found.reason + AT_ONCE)
        now = self._replace(overload=overload)
        if found is not None or self.found is not None:
            return now.stopping(task, found) if found is not None else now
        dead, found = self.dead.update(task, tick)
        free = self.asks or 0.0 < tick.touch.airborne < inf
        pulls, pulled = self.pulls.update(task, tick, close=free and tick.limit > 0.0)
        approach, lost = self.approach.update(task, tick)
        found = found or pulled
        answers: list[Answers] = []
        if tick.limit > 0.0 and (tick.press is None or tick.press[1] > 0.0):
            before = self.answers if len(self.answers) == len(presses) else (Answers(),) * len(presses)
            for check, (known, felt, wanted, noise) in zip(before, presses, strict=True):
                if dead.unchanged:  # a late reading cannot have answered yet
                    answers.append(check)
                    continue
                after, wrong = check.update(task, tick, known, felt, wanted, noise, shared)
                answers.append(after)
                found = found or wrong
        settling = self._settled(task, tick)
        now = now._replace(dead=dead, pulls=pulls, approach=approach, answers=tuple(answers), settling=settling)
        return now if found is None and lost is None else now.stopping(task, found or lost)

    def _settled(self, task: HybridTask, tick: Tick) -> Settling:
        if tick.press is None:
            return self.settling.after_missing(tick.missing, tick.dt)
        if tick.limit == 0.0:
            return self.settling
        lost = not tick.touch.lasts(task.lost_after)
        return self.settling.after(tick.press, tick.dt, lost=lost, noise=tick.noise)

    def stopping(self, task: HybridTask, found: Finding | None) -> Monitor:
        """The monitor that leaves: from where it touched; from where it approached if readings are not believed."""
        if found is None:
            return self
        if found.away is not None:
            return self._replace(found=found, left=(0.0, found.away))
        back = self.pushed + (self.approached if found.status is Status.FAULT else 0.0)
        return self._replace(found=found, left=(-min(back, task.approach_distance), task.retreat_distance))

    def unseen(self, task: HybridTask, press: int, read: float) -> float:
        """What a press may be beside what is read [force]."""
        return self.answers[press].unseen(task, read) if press < len(self.answers) else 0.0

    def release(self, slope: float, press: int, setting: Setting, most: float) -> float | None:
        """The rate at which a press is let go to see whether readings fall [length/s]; None where it is not.

        So slowly at first that they fall by a fifth of it before that shows, and faster and faster; no further than
        `Release.bound` until they have fallen, no faster than the way back allows beside what the surface may do.
        Faster by what was commanded, not by how far that led: what leads the tool in meanwhile, an arm's way beside its
        twist in a long tick, is outrun, too.

        Args:
            slope: of the surface at most.
            press: which.
            setting: of this tick.
            most: speed at most on a surface that stands [length/s].
        """
        check = self.answers[press] if press < len(self.answers) else Answers()
        if check.release is None:
            return None
        gone = max(0.0, check.release.depth - check.depth)
        waits = check.release.fell is None and gone > check.release.bound(slope, check.moves)
        first, led = SHORT * check.release.force / (check.stiff * setting.late), max(0.0, check.release.led)
        return 0.0 if waits else min(first + LETS_GO * led, most + setting.slope_speed)

    @property
    def asks(self) -> bool:
        """Whether the tool lets go to see whether readings fall."""
        return any(check.release is not None for check in self.answers)

    def after_motion(self, touch: Touch, out: float, *, beyond: bool) -> Monitor:
        """The monitor after a tick that moved the place of contact outwards by a distance [length], or off an edge."""
        if self.found is not None:
            return self._replace(left=(self.left[0] + max(0.0, out), self.left[1]))
        if beyond:  # where the surface is, is to be found again
            return self._replace(answers=())
        if touch.touching:
            return self._replace(pushed=max(0.0, self.pushed - out))
        approached = (0.0 if self.pushed else self.approached) + max(0.0, -out)
        return self._replace(approached=approached, pushed=0.0)


class Verdict(NamedTuple):
    """What to do in this tick, with which status, and why; None is the velocity law's own status.

    `edge` says that the surface's edge is near, "" that it is not; `beyond` is whether nothing is to be pushed there.
    """

    action: str
    status: Status | None
    reason: str
    edge: str = ""
    beyond: bool = False

    def with_others(self, doubts: tuple[str, ...], status: Status, reason: str) -> tuple[Status, str]:
        """The status and the reason of the tick, with what troubles the force law and what the velocity law says."""
        trouble = [words for words in (self.edge, *doubts) if words]
        law = Status.DEGRADED if trouble and status is not Status.HELD else status
        return self.status or law, "; ".join(words for words in (self.reason, *trouble, reason) if words)


def verdict(monitor: Monitor, touch: Touch, task: HybridTask, contact: Contact) -> Verdict:
    """What to do now, about loss, overload and faults first, and then about the edge of the surface."""
    answer, edge = _without_edge(monitor, touch, task, can_leave=contact.kind.out is not None), contact.edge
    if edge is None or edge >= task.edge_margin or answer.action in (HOLD, RETREAT):
        return answer
    if edge > 0.0:
        return answer._replace(edge=f"{written(edge)} before the edge of the surface")
    return Verdict(FOLLOW, Status.LOST, f"{written(-edge)} beyond the edge of the surface: not pushing", beyond=True)


# What a task does about a loss, where it is not to approach.
LOSS = {"hold": (HOLD, ": standing still"), "continue": (FOLLOW, "")}


def _without_edge(monitor: Monitor, touch: Touch, task: HybridTask, *, can_leave: bool) -> Verdict:
    found = monitor.found
    if found is not None:
        answer = task.on_loss if found.status is Status.LOST else task.on_overload or (RETREAT if can_leave else HOLD)
        left, away = monitor.left
        action = RETREAT if answer == "retreat" and left < (1.0 - ROUNDING) * away else HOLD
        what = {RETREAT: "retreating", HOLD: "standing still until reset"}[action]
        return Verdict(action, found.status, f"{found.reason}: {what}")
    if touch.lasts(task.lost_after):
        if monitor.asks:
            return Verdict(FOLLOW, Status.DEGRADED, ASKS)
        return Verdict(FOLLOW, None, "")
    if touch.airborne == inf:
        return Verdict(SLOW, Status.LOST, "no contact yet: approaching")
    action, what = LOSS.get(task.on_loss, (SLOW, ": approaching"))
    return Verdict(action, Status.LOST, f"no contact for {written(touch.airborne)} s{what}")


# What is said while the tool lets go.
ASKS = "the readings do not say what the way does: letting go to see whether they fall to nothing"
