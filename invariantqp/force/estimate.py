"""What is estimated while a tool presses: contact, stiffness and damping, delay, the normal, noise. Always on.

contact     a sequential test of the noisy press, `Touch`
stiffness   f = k x + b x' by recursive least squares on way and force, both high-passed twice, `Stiffness`; what is
            declared is where it begins
delay       (commanded way - measured way) / speed of the joints, and what their answers show, `Delay`
normal      from how the tool moves while it presses, `NormalEstimate`
noise       from what readings in the air change by, `Noise`
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import atan, exp, inf, isnan, log, nan, pi, sqrt, tan
from typing import Annotated, NamedTuple

import numpy as np

from invariantqp.control.delay import PASSED, DelayEstimate
from invariantqp.control.tracking import DELAY_SHARE
from invariantqp.errors import written
from invariantqp.force.contact import TINY, HybridTask
from invariantqp.force.contact_kinds import Contact
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.measure import root_at

# Contact. Evidence at which it is decided: at most one wrong decision in a million ticks.
CERTAIN = log(1e6)
# Share of the wanted press below which contact counts as lost: above the noise of a sensor in the air.
LOST_SHARE = 0.1
# The limit lies half a standard deviation above zero at least, but at most at half of the wanted press.
HALF = 0.5
# Noise is taken to be at least this share of the limit, and what is less for nothing: one tick then decides without it.
LEAST_NOISE = 0.25

# Stiffness. Where nothing is declared it is looked for as of 2e5 +- 2e5 N/m: no table behind an arm is much stiffer.
STIFF = 2e5
# ... and for this share of that where no touch shows it: what is held, or was there from the first reading on.
UNSHOWN = 0.1
# A touch shows a contact at most so many times as stiff as its jump over its way, and no stiffer than an estimate's
# first bound (a damper jumps, too); a way is so many times what is resolved at least. A stiffness declared is wrong
# where another is known by more than that factor.
STIFFER = 3.0
LEAST_WAY = 5.0
# Damping over stiffness that goes with that [s], and the softest contact, as a share of the stiffness it begins with.
DAMPED = 0.01
SOFTEST = 1e-3
# Ways below this share of the contact's size are noise of the joints: a micrometre of 50 mm.
RESOLVED = 2e-5
# Noise of a press beside the sensor's, as a share of the wanted one: rounding, and what no spring explains.
ROUGH = 2e-3
# A residual above so many standard deviations is a surprise: another contact, of which nothing is known yet.
SURPRISE = 5.0
# Until a force is within this share of what is wanted, what nothing is known of is taken for softer and softer, with
# this time constant in units of the loop's.
SHORT = 0.2
# ... and later where it has been off for as long as the high-pass looks back, to one side: no swing.
SOFTENS = 20.0
# Time constants: of the high-pass in units of the loop's; of the mean square residual, and of a bound that comes down
# to what is known [s].
SLOWER, SETTLES = 10.0, 0.1
# Share of a residual's variance that the estimate forgets with each reading that tells it something.
FORGOTTEN = 0.1
# A slope that changes explains so many times its speed, times the high-pass squared.
CURVED = 3.0

# Noise above this multiple of what was reckoned with is told: so many readings at least and at most are in the mean, in
# which a change counts as no surprise at most. Of 20 000 sensors told rightly one was doubted.
NOISIER = 1.5
FEWEST = 20
AVERAGED = 200

# What is late and nobody says: in the sensor's electronics, in a bus, in a driver [s].
UNKNOWN = 0.003
# Delay. Where nothing is known yet an arm is taken to lag this much [s]; the longest lag, and known after as long [s].
LAGS = 0.02
LONGEST = 0.1
# ... of joints that do at least this share of what they are told.
FOLLOWS = 0.8
# Joints that move the place of contact by less than this a second, in sizes of the contact, stand.
STILL = 2e-3
# It is looked for in the joints until the place of contact was told to go this way, in sizes of the contact.
ENOUGH = 2.0
# A delay is told where what is late in all is this multiple of what was declared.
LATE = 2.0
HEADER = 9

# A piece of way, as a share of the contact's size: a millimetre of 50. Of such pieces a normal is made.
STEP = 0.02
# For how many pieces they are remembered, and for how many answers a slope that these showed.
MEMORY = 10.0


class Touch(NamedTuple):
    """Whether the tool touches, decided from noisy readings of the press by a sequential test.

        E <- min(max(E + (2 l / sigma^2) (press - l), -E0), E0)     touching from E = E0 on, in the air from E = -E0 on

    E is the log of how much likelier a press of 2 l is than none, for white noise with standard deviation sigma. With
    E0 = log(1e6) a wrong decision is taken once in a million ticks or less often. A press of 5 N with 0.2 N of noise is
    decided in one or two ticks, one as small as the noise in about fifty.

    Reference: Page 1954 (cumulative sums), Wald 1945.

    Attributes:
        evidence: E.
        touching: what was decided last.
        airborne: for how long contact has not been certain [s]; inf before the first touch.
    """

    evidence: float = -CERTAIN
    touching: bool = False
    airborne: float = inf

    def after(self, press: float, limit: float, noise: float, dt: float) -> Touch:
        """What is known after one more reading.

        Args:
            press: felt [force].
            limit: between air and contact [force]; 0 is contact always.
            noise: standard deviation of the press [force].
            dt: tick [s].
        """
        if limit == 0.0:
            return Touch(CERTAIN, True, 0.0)
        evidence = weighed(self.evidence, press, limit, noise)
        if evidence == CERTAIN:
            return Touch(evidence, True, 0.0)
        return Touch(evidence, self.touching and evidence > -CERTAIN, self.airborne + dt)

    def lasts(self, lost_after: float) -> bool:
        """Whether there is contact, or was less than a time ago [s]."""
        return self.touching or self.airborne <= lost_after


def weighed(evidence: float, press: float, limit: float, noise: float) -> float:
    """E after one more reading."""
    sigma = max(noise, LEAST_NOISE * limit, TINY)
    more = evidence + 2.0 * (limit / sigma) * ((press - limit) / sigma)  # the square of a tiny sigma is zero
    return min(max(more, -CERTAIN), CERTAIN)


def weakest_touch(touches: Sequence[Touch]) -> Touch:
    """Of several presses: there is contact where all are felt; without a press there always is."""
    if not touches:
        return Touch(touching=True, airborne=0.0)
    return Touch(
        min(touch.evidence for touch in touches),
        all(touch.touching for touch in touches),
        max(touch.airborne for touch in touches),
    )


def loss_limit(lost_below: float | None, wanted: float, noise: float) -> float:
    """The press [force] between air and contact: a tenth of the wanted one, more where noise would hide that."""
    if lost_below is not None:
        return lost_below
    return max(0.0, LOST_SHARE * wanted, HALF * min(wanted, noise))


class Setting(NamedTuple):
    """What the estimate of one constraint and its law have in common in a tick.

    Attributes:
        dt: tick [s].
        share: of a step that the low-pass passes on in a tick.
        filter_time: time constant of the low-pass [s].
        late: T, sum of tick, low-pass, delay and what nobody knows of it [s].
        noise: standard deviation of the smoothed part [force].
        slope_speed: how fast the surface may come or go along the press [length/s].
        steep: how fast it did, and a share of how fast it may [length/s].
        begins: the stiffness that the estimate begins with [force/length].
        resolved: ways below this are noise [length].
        held: whether it is held from both sides: what is told wrong of it goes evenly, and c tells it apart.
    """

    dt: float
    share: float
    filter_time: float
    late: float
    noise: float
    slope_speed: float
    steep: float
    begins: float
    resolved: float
    held: bool = False


class Stiffness(NamedTuple):
    """Stiffness k and damping b of one constraint; a value, `after` makes the next.

        f = k x + b x' + c s        x the way in, s how far the surface may have come or gone at most, |c| about k

    By least squares, all high-passed twice, with a prior: without c a slope that the tool slides on would pass for
    stiffness. k = b = 0 is a standard error away at first, and so is c = k.

    Attributes:
        found: (3,) k, b and c [force/length, force s/length, force/length].
        errors: (3,) their standard errors.
        bound: an upper bound of k that comes down from twice the beginning as more is known.
        way, force: smoothed alike [length], [force].
        mean, means: (4,) of way, speed, what the surface may have gone and force, and of what is above the first.
        gone: how far the surface may have come or gone at most [length].
        seen, sums: (3, 3) and (3,) weighed products of the first three with themselves and with the force, as they are
            above both means.
        residual: mean square of what is not explained.
        rose: whether the last reading was a surprise, and upwards.
        begins: the stiffness that it began with.
        time: since the touch [s].
        quiet: smoothed way where nothing was felt last, certainly [length]; None before that.
        stiff: bound of the stiffness by the touch; None where none was seen.
        reached: whether the force has been near the wanted one since then.
        lacked: for how long too little (or, negative, too much) has been felt [s].
        lasted: for how long it has been felt without a break [s].
    """

    found: Annotated[Array, 3]
    errors: Annotated[Array, 3]
    bound: float
    way: float = 0.0
    force: float = 0.0
    mean: Annotated[Array, 4] = np.zeros(4)
    means: Annotated[Array, 4] = np.zeros(4)
    gone: float = 0.0
    seen: Annotated[Array, 3, 3] = np.zeros((3, 3))
    sums: Annotated[Array, 3] = np.zeros(3)
    residual: float = 0.0
    rose: bool = False
    begins: float = STIFF
    time: float = 0.0
    quiet: float | None = None
    stiff: float | None = None
    reached: bool = False
    lacked: float = 0.0
    lasted: float = 0.0

    @classmethod
    def of(cls, begins: float) -> Stiffness:
        """Nothing is known but where it begins."""
        found = begins * np.array((1.0, DAMPED, 0.0))
        return cls(found, begins * np.array((1.0, DAMPED, 1.0)), 2.0 * begins, begins=begins)

    @property
    def k(self) -> float:
        """Stiffness [force/length]."""
        return float(self.found[0])

    @property
    def known(self) -> float | None:
        """k where it is known to two standard errors, else None."""
        return self.k if self.seen[0, 0] > 0.0 and self.k > 2.0 * float(self.errors[0]) else None

    @property
    def sure(self) -> float:
        """How much of the bound is known to be there, from 0 to 1."""
        return max(float(self.found[0] - self.errors[0]), 0.0) / self.bound

    @property
    def damping(self) -> tuple[float, float]:
        """Bounds of b, the upper and the lower one."""
        b, error = max(float(self.found[1]), 0.0), float(self.errors[1])
        return b + error, max(b - error, 0.0)

    @property
    def behind(self) -> float:
        """What is late in the readings, times k: a force that comes late is as one damped by less than zero."""
        return max(-float(self.found[1]) - float(self.errors[1]), 0.0)

    def in_air(self, force: float, way: float, limit: float, touch: Touch, setting: Setting) -> Stiffness:
        """The filters go on, and what was known is forgotten.

        Args:
            force: unit part that is felt, smoothed [force].
            way: unit way that was commanded, as it shows now, not smoothed [length].
            limit: between air and contact [force].
            touch: where it is not certain that nothing is touched, a quiet reading may be noise.
            setting: of this tick.
        """
        x = self.way + setting.share * (way - self.way)
        quiet = x if force <= LEAST_NOISE * limit and touch.evidence == -CERTAIN else self.quiet
        v = (x - self.way) / setting.dt
        return Stiffness.of(setting.begins)._replace(way=x, force=force, mean=np.array((x, v, 0.0, force)), quiet=quiet)

    def landed(self, setting: Setting) -> Stiffness:
        """What a touch shows, whatever is declared: it is at most so stiff as its jump over its way says."""
        if self.quiet is None:
            return self
        rise = max(self.force, 3.0 * setting.noise)
        stiff = rise / max(self.way - self.quiet, LEAST_WAY * setting.resolved)
        begins = min(max(stiff, SOFTEST * STIFF), STIFF)
        fresh = Stiffness.of(begins)
        return fresh._replace(
            way=self.way,
            force=self.force,
            mean=self.mean,
            time=self.time,
            lasted=self.lasted,
            quiet=self.quiet,
            stiff=min(STIFFER * stiff, Stiffness.of(STIFF).bound),
        )

    def after(self, force: float, way: float, setting: Setting, short: int = 0, *, felt: bool = True) -> Stiffness:
        """The estimate after one more reading in contact.

        Args:
            force: unit part that is felt, smoothed [force].
            way: unit way that was commanded, as it shows now, not smoothed [length].
            setting: of this tick.
            short: 1 where a good share of the force is missing, -1 where it is too much, else 0: where that lasts the
                contact is softer than it is taken to be where nothing is known of it, or the law would have changed it.
            felt: whether the contact is: a way through the air shows no stiffness.
        """
        dt = setting.dt
        x = self.way + setting.share * (way - self.way)
        v, time = (x - self.way) / dt, self.time + dt
        lacked = self.lacked + short * dt if self.lacked * short > 0.0 else short * dt
        lasted = self.lasted + dt if felt else 0.0
        if lasted <= 3.0 * setting.filter_time + 2.0 * dt:  # the filters still hold the air
            mean, means = np.array((x, v, self.gone, force)), np.zeros(4)
            now = self._replace(way=x, force=force, mean=mean, means=means, time=time, lasted=lasted, lacked=lacked)
            return now.landed(setting) if self.time == 0.0 else now
        over = SLOWER * setting.late
        r = min(1.0, dt / over)
        gone = self.gone + dt * setting.slope_speed
        read = np.array((x, v, gone, force))
        above = read - self.mean
        mean = self.mean + r * above
        above = above - self.means
        means = self.means + r * above
        z, af = above[:3], float(above[3])
        # What the surface may have gone beside the tool is told apart by c as long as it goes evenly, and not surely.
        bent = 0.0 if setting.held else abs(float(z[2])) + setting.steep * CURVED * over * over
        rounding = self.bound * (setting.resolved + bent)
        noise = setting.noise
        softest = SOFTEST * self.begins  # a softer contact is not looked for
        spread = max(4.0 * noise * noise + 0.0025 * af * af, 2.0 * self.residual) + rounding * rounding
        spread += softest * softest * float(z[0] * z[0] + DAMPED * DAMPED * z[1] * z[1])
        # Errors of k, b and c are taken as independent here: what they share makes a surprise rarer still. A way that
        # shows a little later or sooner than thought is as a damper of so much of k, which no reading tells apart.
        rest = af - float(z.dot(self.found))
        late = UNKNOWN * self.bound * float(z[1])
        variance = spread + late * late + float(((self.errors * z) ** 2).sum())
        square = rest * rest
        surprised = square > SURPRISE * SURPRISE * variance
        most = SURPRISE * SURPRISE * variance
        residual = self.residual + min(1.0, dt / SETTLES) * (min(square, most) - self.residual)
        begins, bound, seen, sums = self.begins, self.bound, self.seen, self.sums
        if surprised:
            begins = min(10.0 * begins, max(begins, STIFF))
            bound, seen, sums = max(2.0 * begins, bound), np.zeros((3, 3)), np.zeros(3)
            mean, means = read, np.zeros(4)  # they hold the other contact
        else:
            soft = short != 0 and (not self.reached or abs(lacked) > SLOWER * setting.late)
            begins = max(begins * exp(-dt / (SOFTENS * setting.late)), SOFTEST * setting.begins) if soft else begins
        if not surprised and spread > 0.0 and abs(float(z[0])) >= 3.0 * setting.resolved:
            w = (min(1.0, dt / (2.0 * setting.filter_time)) if setting.filter_time > 0.0 else 1.0) / spread
            left = 1.0 - FORGOTTEN * (1.0 - spread / variance)
            seen, sums = left * seen + w * np.outer(z, z), left * sums + w * af * z
        found, errors = _posterior(begins, seen, sums)
        bound = max(float(found[0]), SOFTEST * begins, bound * exp(-dt / SETTLES))
        return Stiffness(
            found,
            errors,
            bound,
            x,
            force,
            mean,
            means,
            gone,
            seen,
            sums,
            residual,
            surprised and rest > 0.0,
            begins,
            time,
            self.quiet,
            self.stiff,
            self.reached or short == 0,
            lacked,
            lasted,
        )

    def trouble(self, declared: float | None) -> str:
        """How what was declared disagrees with what is known, in words, "" for not at all."""
        k = self.known
        if declared is None or k is None:
            return ""
        error = 2.0 * float(self.errors[0])
        if k - error <= STIFFER * declared and k + error >= declared / STIFFER:
            return ""
        return (
            f"the press rises by {written(k, 2)} N/m where {written(declared, 2)} are declared: the stiffness (of "
            "contact and arm in series), the sensor's scale or the delay is wrong"
        )


def _posterior(begins: float, seen: Array, sums: Array) -> tuple[Array, Array]:
    """(3,) k, b and c, and their standard errors, of begins +- begins, DAMPED begins +- as much, and 0 +- begins."""
    # In units of the prior's spread, in which it is 1 +- 1 and 0 +- 1; the inverse by cofactors.
    n, m = begins, DAMPED * begins
    (a, b, c), (_, d, e), (_, _, f) = seen.tolist()
    x, y, z = sums.tolist()
    a, b, c, d, e, f = 1.0 + n * n * a, n * m * b, n * n * c, 1.0 + m * m * d, m * n * e, 1.0 + n * n * f
    x, y, z = 1.0 + n * x, 1.0 + m * y, n * z
    A, B, C, D, E, F = d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b
    whole = a * A + b * B + c * C
    found = (n * (A * x + B * y + C * z), m * (B * x + D * y + E * z), n * (C * x + E * y + F * z))
    errors = (n * sqrt(max(A / whole, 0.0)), m * sqrt(max(D / whole, 0.0)), n * sqrt(max(F / whole, 0.0)))
    return np.array(found) / whole, np.array(errors)


class Delay:
    """By how much commands act later than they are given: what is declared, measured and found.

    q(t) - q(0) = share * (way commanded until t - late)        the lateness that fits best, over all joints

    Joints are behind their commands by speed times lag, which shows within a tenth of a second of an approach, or of
    a motion along a surface; how much of it is dead time their answers show. What is late in the readings cannot be
    seen so.

    Attributes:
        declared: [s].
        kept: (9 + 6 m,) what it remembers, but for the answers: by how much later than declared commands act and the
            lag of the arm [s], NaN before they are known; whether there was contact; the way of the place of contact
            until now and for how long it has moved; four sums. Of the joints, once there was a tick: where they began,
            weights, the ways commanded and done until now, the last step, and the one before the first.
        echo: of the joints' answers; None before the first tick.
    """

    def __init__(self, dt: float, delay: float, cutoff: float) -> None:
        """Nothing yet, for ticks of dt [s], a declared delay [s] and the cut-off of the sensor [Hz]."""
        self.whole: float = dt + delay + 1.0 / (2.0 * pi * cutoff)
        self.declared, self._dt = delay, dt
        self.kept: Array = np.zeros(HEADER)
        self.kept[:2] = nan
        self.echo: DelayEstimate | None = None

    @property
    def late(self) -> float | None:
        """By how much later than declared commands act, as the joints show it [s]; None before that is known."""
        late = float(self.kept[0])
        return None if isnan(late) else late

    @property
    def lag(self) -> float | None:
        """Of the arm, as an approach shows it [s]; None before."""
        lag = float(self.kept[1])
        return None if isnan(lag) else lag

    def ready(self, joints: int) -> tuple[Array, Array]:
        """What is remembered, with room for so many joints; twice, for `echo`, too."""
        if self.echo is None:
            self.kept = np.concatenate((self.kept, np.full(6 * joints, nan)))
            self.echo = DelayEstimate(self._dt, self.declared, joints)
        return self.kept, self.echo.kept

    @property
    def arm(self) -> float:
        """What the law reckons with [s]."""
        lag = max(LAGS, self.declared) if self.lag is None else self.lag
        return max(self.declared + (self.late or 0.0), lag)

    def after(
        self,
        q: Array,
        way: Array,
        J: Array,
        place: Array,
        size: float,
        velocity: Array | None = None,
        *,
        touching: bool = False,
    ) -> None:
        """After a tick with joint positions q (m,) at its beginning and a commanded way (m,).

        Args:
            q: [rad, length].
            way: likewise.
            J: (6, m) joint twists.
            place: (3,) of contact, base frame [length].
            size: of the contact [length]: a turn by an angle counts as so much times the angle.
            velocity: (m,) of the joints at the first tick, where it is measured; None is at rest.
            touching: whether there is contact: what is known of the lag then stays, since a force bends the arm, too,
                and its joints are behind by that after it is let go.
        """
        head, m = self.ready(len(q))[0][:HEADER], len(q)
        first, weights, led, came, last, before = self.kept[HEADER:].reshape(6, m)
        head[2] = head[2] or touching
        touched, lags, echo = bool(head[2]), self.lag is not None, self.echo
        if echo is None or (touched and lags and self.late is not None):
            return
        if isnan(first[0]):
            moved = root_at(place, size).dot(J)
            first[:], weights[:] = q, np.sqrt((moved * moved).sum(axis=0))
            led[:] = came[:] = last[:] = 0.0
            before[:] = 0.0 if velocity is None else weights * velocity
        step, came_now = weights * way, weights * (q - first)
        if not (touched and lags):
            self._moved(led - came_now, came_now - came, last, before, STILL * size)
        last[:], came[:] = step, came_now
        led += step
        head[3] += float(np.sqrt(step.dot(step)))
        if self.late is None:
            found = echo.after(came_now, led)
            looked = head[3] > ENOUGH * size and echo.ticks > PASSED * echo.rows
            head[0] = found if found is not None else 0.0 if looked else nan

    def _moved(self, behind: Array, came: Array, step: Array, before: Array, still: float) -> None:
        """How far the joints are behind their commands, over how much faster they go than at first, if they follow.

        Args:
            behind: (m,) by how much, in ways of the place of contact [length].
            came: (m,) what they did in the last tick.
            step: (m,) and what they were told then.
            before: (m,) and before the first tick.
            still: a slower motion is none [length/s].
        """
        dt, square, head = self._dt, float(step.dot(step)), self.kept[:HEADER]
        left, (late, moved, followed, gained) = exp(-dt / LONGEST), head[5:].tolist()
        late, moved = left * late + dt * float(behind.dot(step)), left * moved + square
        followed = left * followed + float(came.dot(step))
        gained = left * gained + square - dt * float(before.dot(step))
        moving = float(head[4]) + dt if square > (still * dt) ** 2 else 0.0
        head[4:] = moving, late, moved, followed, gained
        if moving > LONGEST and min(followed, gained) > FOLLOWS * moved:
            head[1] = min(max(late / gained, 0.0), LONGEST)

    def gain(self, asked: float) -> float:
        """The motion's gain [1/s]: the one asked for, or less where with the delay found the tool goes to and fro."""
        late = self.late or 0.0  # from a gain of one over it on
        return min(asked, DELAY_SHARE / (self.declared + late)) if asked * late > 1.0 else asked

    def trouble(self, asked: float) -> str:
        """What is wrong, in words, "" for nothing; with the motion's gain that was asked for [1/s]."""
        gain = self.gain(asked)
        if not self.late or (gain == asked and self.late <= LATE * self.whole):
            return ""
        slower = f", the motion's gain is {written(gain, 3)} instead of {written(asked, 3)} 1/s" if gain < asked else ""
        return f"commands act {written(1e3 * self.late, 3)} ms later than declared: give delay={slower}"


class Ways:
    """The last commands' ways, oldest first: the oldest shows in this tick's measurements.

    Attributes:
        joints: (m,) ways of the joints that do not show yet, or () before any.
        place: (3,) ways of the place of contact, base frame [length].
    """

    def __init__(self, delay: float, dt: float) -> None:
        """No ways yet, for a declared delay and ticks of dt [s]."""
        self._time = delay, dt
        ticks = 1 + round(delay / dt)
        self.joints: deque[Array] = deque(maxlen=ticks - 1)
        self.place: deque[Array] = deque([np.zeros(3)] * ticks, maxlen=ticks)

    def add(self, joints: Array, place: Array, later: float) -> None:
        """One more command's ways; they show later than was declared [s]."""
        delay, dt = self._time
        ticks = 1 + round((delay + later) / dt)
        if ticks > len(self.place):
            self.place = deque([*[np.zeros(3)] * (ticks - len(self.place)), *self.place], maxlen=ticks)
            self.joints = deque(self.joints, maxlen=ticks - 1)
        self.joints.append(joints)
        self.place.append(place)

    def coming(self, q: Array) -> Array:
        """(m,) where the joints will be when the next command acts, from where they are measured."""
        return np.asarray(sum(self.joints, start=q))


class NormalEstimate(NamedTuple):
    """The normal of a surface, found from how the tool moves while it presses.

        n . w = -(change of the press) / k          for every way w along a surface with normal n and stiffness k
        t = argmin sum (n0 . w + t . w + change / k)^2 + STEP^2/4 |t|^2,     t . n0 = 0,     n = (n0 + t) / |n0 + t|

    n0 is the normal as told. A tilt across the ways is not seen, and stays as told. The direction of the force is not
    used: friction turns it. Ways are cut into pieces, each a STEP along the surface, and the last MEMORY of them count,
    so that ticks at rest forget nothing. Everything is in the base frame: no frame of tool, sensor or contact matters.

    Reference: Yoshikawa & Sudou 1993, who estimate a constraint surface from positions likewise.

    Attributes:
        tilt: (3,) t, how the normal found differs from the told one; not longer than the bound allows.
        way: (3,) of this piece [length].
        press: at its start [force]; None before the first piece.
        squares: (3, 3) sum of w w'.
        rises: (3,) sum of w (n0 . w + change / k).
        held: the bound that holds t back [rad]; 0 where none does.
    """

    tilt: Array = np.zeros(3)
    way: Array = np.zeros(3)
    press: float | None = None
    squares: Array = np.zeros((3, 3))
    rises: Array = np.zeros(3)
    held: float = 0.0

    def applied(self, contact: Contact, normal: Array) -> Contact:
        """The told contact turned about its place, so that its (3,) normal becomes the one found."""
        axis = se3.cross(normal, self.tilt)
        sine = sqrt(axis.dot(axis))
        if sine < TINY:
            return contact
        turn = atan(sine) / sine * axis
        twist = np.concatenate((turn, se3.cross(contact.point, turn)))
        return contact.moved(se3.exp(twist))

    def after(
        self, normal: Array, way: Array, press: tuple[float, float], stiffness: float, size: float, bound: float
    ) -> NormalEstimate:
        """The estimate after one more tick in touch.

        Args:
            normal: (3,) as told, outwards.
            way: (3,) of the place of contact in the tick [length].
            press: felt and wanted [force].
            stiffness: k [force/length]: without it the rise of a touch would pass for a slope.
            size: of the contact [length].
            bound: the largest angle between the told normal and the one found [rad].
        """
        felt, wanted = press
        if self.press is None and abs(felt - wanted) > SHORT * wanted:
            return self  # while a touch rises by much, what the stiffness is off by would pass for a slope
        start = felt if self.press is None else self.press
        w, step = self.way + way, STEP * size
        rise = float(normal.dot(w))
        along = w - rise * normal
        if along.dot(along) < step * step:
            return self._replace(way=w, press=start)
        rise += (felt - start) / stiffness
        kept = exp(-1.0 / MEMORY)
        squares = kept * self.squares + np.outer(along, along)
        rises = kept * self.rises + rise * along
        # Where the told normal turns, older ways have a part along it: it is left out.
        across = np.eye(3) - np.outer(normal, normal)
        H = across.dot(squares).dot(across) + step * step / 4.0 * np.eye(3)
        t = -across.dot(np.linalg.solve(H, across.dot(rises)))
        length, most = sqrt(t.dot(t)), tan(bound)
        if length > most:
            return NormalEstimate(most / length * t, np.zeros(3), felt, squares, rises, bound)
        return NormalEstimate(t, np.zeros(3), felt, squares, rises)

    def found(
        self,
        task: HybridTask,
        normal: Array,
        way: Array,
        press: tuple[float, float] | None,
        stiffness: float | None,
        *,
        touching: bool,
    ) -> NormalEstimate:
        """As `after`, where the task asks for it and enough is known; in the air what was found is forgotten."""
        if task.normal_within is None or stiffness is None or press is None or not touching:
            return NormalEstimate()
        return self.after(normal, way, press, stiffness, task.size, task.normal_within)

    def trouble(self) -> str:
        """What is wrong, in words, "" for nothing."""
        if not self.held:
            return ""
        degrees = written(self.held * 180.0 / pi, 3)
        return f"the normal is {degrees} deg off the told one, the most that normal_within allows"


class Noise(NamedTuple):
    """How noisy a wrench sensor is, from what its readings in the air change by from one to the next.

        sigma = sqrt(pi)/2 mean |change of a force component|       white noise; a rise that is slow leaves it as it is

    A noise above the told one is reckoned with: a sensor told too quiet would read a touch in the air, and a fault.

    Attributes:
        readings: how many.
        change: mean of |change| of a force component [force].
        found: standard deviation of a force component where it is larger than told, else 0 [force].
    """

    readings: int = 0
    change: float = 0.0
    found: float = 0.0

    def after(self, reading: Array, last: Array | None, supposed: float) -> Noise:
        """What is remembered after one more reading.

        Args:
            reading: (6,) (m; f) as it came, and the one before; None before the first.
            last: likewise.
            supposed: the standard deviation that is reckoned with [force].
        """
        if last is None or not (change := np.abs(reading - last)[3:]).any():  # none, or the last one repeated
            return self
        count, most = self.readings + 1, SURPRISE * max(supposed, self.change)
        mean = self.change + (float(np.minimum(change, most).mean()) - self.change) / min(count, AVERAGED)
        sigma = sqrt(pi) / 2.0 * mean
        return Noise(count, mean, sigma if count >= FEWEST and sigma > NOISIER * supposed else self.found)

    def trouble(self, told: float) -> str:
        """What is wrong with the noise that was told [force], in words, "" for nothing."""
        if not self.found:
            return ""
        return f"readings have {written(self.found, 2)} N of noise, {written(told, 2)} are told (noise=)"
