/* Twin of paths/time_law.py: what a joint may do in time.

       v = v_before + dt a,    |v| <= V,   |a| <= A,   |a - a_before| <= J dt,    lower <= q <= upper */

#include "paths.h"

/* The largest share of a limit that a motion needs; 2 and more where it leaves the range. */
double needed_share(const JointLimits *limits, int j, double x, double v, double a, double jerk)
{
    double needs = fmax(fmax(fabs(v) / limits->fastest[j], fabs(a) / limits->acceleration[j]), fabs(jerk) / limits->jerk[j]);
    double out = fmax(x - limits->upper[j], limits->lower[j] - x);
    return out > IN_PLACE ? fmax(needs, 2.0 + out) : needs;
}

/* The acceleration that brings a velocity to the wanted one soonest, jerk taking it back in time. */
double towards(const JointLimits *limits, int j, double velocity, double wanted)
{
    double d = wanted - velocity, J = limits->jerk[j], h = 0.5 * J * limits->dt, twice = 2.0 * J * fabs(d);
    double most = fmin(twice / (sqrt(h * h + twice) + h), limits->acceleration[j]);
    return between(d / limits->dt, -most, most);
}

/* The speed at which a joint goes a way, and stops at its end: at a gain where that is little. */
double homing(const JointLimits *limits, int j, double way, double gain)
{
    double A = CATCH_UP_SHARE * limits->acceleration[j], lag = 2.0 * A * A / limits->jerk[j];
    return fmin(sqrt(lag * lag + 2.0 * A * fabs(way)) - lag, gain * fabs(way));
}

/* The acceleration that brings a joint soonest to a motion. */
double catching_up(const JointLimits *limits, int j, double position, double velocity, double there, double speed)
{
    double x = there - position, fastest = CATCH_UP_SPEED * limits->fastest[j];
    double w = homing(limits, j, x, TRACKING_SHARE / limits->dt);
    return towards(limits, j, velocity, between(speed + copysign(w, x), -fastest, fastest));
}

/* The way upward in a tick at acceleration a and in stopping after it. */
static double needed(double velocity, double a, double A, double J, double dt)
{
    double v = velocity + dt * a, p = sqrt(fmax(J * v + 0.5 * a * a, 0.0)), hold = 0.0;
    bool full = p > A;
    p = fmin(p, A);
    double t = fmax((a + p) / J, 0.0), v1 = v + a * t - 0.5 * J * t * t;
    if (full)
        hold = fmax(v1 - p * p / (2.0 * J), 0.0) / p;
    double way = v * t + 0.5 * a * t * t - J * t * t * t / 6.0 + v1 * hold - 0.5 * p * hold * hold + p * p * p / (6.0 * J * J);
    if (a < 0.0 && v > 0.0 && J * v <= 0.5 * a * a) {
        double s = (-a - sqrt(fmax(a * a - 2.0 * J * fmax(v, 0.0), 0.0))) / J;
        way = v * s + 0.5 * a * s * s + J * s * s * s / 6.0;
    }
    way = v <= 0.0 && a <= 0.0 ? 0.0 : fmax(way, 0.0) + dt * fmax(v, 0.0);
    return dt * fmax(v, 0.0) + way;
}

/* The largest acceleration, up to the wanted one, after which a joint still stops in its room upward. */
static double most_upward(const JointLimits *limits, int j, double room, double velocity, double low, double wanted)
{
    double A = limits->acceleration[j], J = limits->jerk[j], dt = limits->dt, left = limits->fastest[j] - velocity;
    double fastest = left > 0.0 ? sqrt(J * J * dt * dt + 2.0 * J * left) - J * dt : left / dt;
    double a = fmax(fmin(wanted, fastest), low), high = a;
    if (needed(velocity, a, A, J, dt) <= room)
        return a;
    for (int i = 0; i < HALVINGS; i++) {
        double middle = 0.5 * (low + high);
        if (needed(velocity, middle, A, J, dt) <= room)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* The acceleration of a tick nearest the wanted one, after which the joint can still stop. */
static double within_limits(const JointLimits *limits, int j, double q, double velocity, double before, double wanted)
{
    double A = limits->acceleration[j], step = limits->jerk[j] * limits->dt;
    double low = fmin(fmax(-A, before - step), A), high = fmax(fmin(A, before + step), -A);
    double chosen = fmin(fmax(wanted, low), high);
    double up = most_upward(limits, j, fmax(limits->upper[j] - q, 0.0), velocity, low, chosen);
    double down = -most_upward(limits, j, fmax(q - limits->lower[j], 0.0), -velocity, -high, -chosen);
    return up < chosen ? up : down > chosen ? down : chosen;
}

/* The velocity of a tick nearest the wanted one; to rounding that itself. */
double nearest(const JointLimits *limits, int j, double q, double velocity, double acceleration, double wanted)
{
    double a = (wanted - velocity) / limits->dt, allowed = within_limits(limits, j, q, velocity, acceleration, a);
    return fabs(allowed - a) > ROUNDING * limits->jerk[j] * limits->dt ? velocity + limits->dt * allowed : wanted;
}
