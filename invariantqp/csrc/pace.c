/* Twin of control/path_pace.py and path_rate.py: the speed along a path that is asked for in a tick, and what rules it.

       v = what was asked for, what limits allow here and ahead, or less: off the path, before a pause or a turn */

#include "path.h"

/* path_pace.py: the speed of this tick, what limits allow, and what rules it. */
Outcome paced(const Course *course, double dt, const Travel *state, double at, double near, double override,
              bool stop, double *speed, double *most_now, int *ruling)
{
    bool back = state->back != 0.0;
    double part = course->rate > 0.0 ? 1.0 : fmin(1.0, override), timed = course->rate * override, a;
    *most_now = speed_at(course, at, dt, 1.0, back);
    double possible = part == 1.0 ? *most_now : speed_at(course, at, dt, part, back), wanted = possible;
    *ruling = nearest(course, at);
    if (course->rate > 0.0 && timed <= wanted) {
        wanted = timed;
        *ruling = THE_RATE;
    } else if (part < 1.0)
        *ruling = THE_OVERRIDE;
    if (near < 1.0) {
        wanted *= near;
        *ruling = OFF_ITS_PATH;
    }
    if (stop) {
        wanted = 0.0;
        *ruling = THE_PAUSE; /* or the turn */
    }
    if (course->jerk == 0.0) {
        double most = state->speed + course->most * dt;
        double least = wanted < possible ? fmax(state->speed - course->most * dt, 0.0) : 0.0;
        *speed = fmax(fmin(wanted, most), fmin(least, possible));
        return DONE;
    }
    if (ramped(course, state, at, fmin(wanted, SMOOTH_SHARE * possible), SMOOTH_SHARE * part, dt, &a) == HAND_BACK)
        return HAND_BACK;
    double v = fmax(state->speed + a * dt, 0.0), left = back ? at - course->at[0] : course->at[course->knots - 1] - at;
    double crawl = 0.5 * course->jerk * dt * dt;
    if (fmax(v, state->speed) <= RESTING * crawl)
        v = fmin(fmin(left / dt, wanted), crawl);
    *speed = fmin(v, possible);
    return DONE;
}

/* path_rate.py */
static double rate_inside(int m, const Row slope, double rate, double possible, const Row before,
                          const Row acceleration, const Row fastest, double dt)
{
    static const double SHARES[] = {EASY_SHARE, TICK_SHARE};
    double sum = 0.0, weight = 0.0, most = INFINITY;
    for (int j = 0; j < m; j++)
        if (slope[j] != 0.0)
            most = fmin(most, fastest[j] / fabs(slope[j]));
    rate = between(rate, -FULL_SHARE * most, FULL_SHARE * most);
    for (int easy = 0; easy < 2; easy++) {
        double low = -INFINITY, high = INFINITY;
        for (int j = 0; j < m; j++)
            if (slope[j] != 0.0) {
                double middle = before[j] / slope[j], width = SHARES[easy] * (dt * acceleration[j] / fabs(slope[j]));
                low = fmax(low, middle - width);
                high = fmin(high, middle + width);
            }
        double found = between(rate, low, high);
        if (low == -INFINITY && high == INFINITY)
            return rate;
        if (low <= high && (easy == 1 || (fabs(found) <= possible && possible > fabs(rate))))
            return found;
    }
    for (int j = 0; j < m; j++) {
        double width = slope[j] != 0.0 ? dt * acceleration[j] / fabs(slope[j]) : INFINITY, k = 1.0 / (width * width);
        weight += k;
        sum += width < INFINITY ? k * (before[j] / slope[j]) : 0.0;
    }
    return sum / weight;
}

static bool within_step(int m, const Row slope, double rate, const Row before, const Row acceleration, double dt)
{
    for (int j = 0; j < m; j++)
        if (!(fabs(rate * slope[j] - before[j]) <= dt * acceleration[j]))
            return false;
    return true;
}

/* The rate within the limits of acceleration and the ends of the plan, never the other way. */
double possible_rate(const Loop *loop, const Course *course, const Travel *state, double at, double wanted,
                     double possible)
{
    double dt = loop->dt, rate = wanted, kept = 0.0;
    Row slope;
    bool same = loop->has_braking == 0.0;
    for (int pass = 0; pass < PASSES && !same; pass++) {
        double before = rate;
        slope_at(course, at + 0.5 * dt * rate, slope);
        rate = rate_inside(course->m, slope, wanted, possible, state->along, loop->acceleration, loop->fastest, dt);
        same = fabs(rate - before) <= SAME_RATE * fabs(rate);
        if (!same && within_step(course->m, slope, before, state->along, loop->acceleration, dt))
            kept = before;
    }
    rate = same ? rate : kept;
    if (loop->has_braking != 0.0)
        rate = state->back != 0.0 ? fmin(rate, 0.0) : fmax(rate, 0.0);
    return between(rate, (course->at[0] - at) / dt, (course->at[course->knots - 1] - at) / dt);
}
