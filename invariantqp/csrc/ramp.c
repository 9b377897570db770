/* Twin of control/time_law.py: the speed along a path from tick to tick, with limited acceleration and jerk.

       dv/dt = a,   |da/dt| <= jerk,   -braking <= a <= acceleration */

#include "path.h"

#define LAST_SAMPLE (SAMPLES - 1)
/* Speeds that differ by less than this share: rounding decides which is larger. */
static const double CLOSE = 1e-13;

typedef struct {
    const Course *course;
    const Travel *state;
    double at, share, acceleration, jerk;
} Ramp;

typedef enum { YES, NO, UNSURE } Answer;

/* Whether a speed is allowed at a distance ahead; the piece of the plan is that of a place nearby. */
static Answer allows_speed(const Ramp *ramp, double speed, double ahead, int *piece)
{
    bool back = ramp->state->back != 0.0;
    double place = ramp->at + (back ? -1.0 : 1.0) * ahead;
    double most = ramp->share * speed_limit_at(ramp->course, place, back, piece) * (1.0 + ROUNDING) + ROUNDING;
    return fabs(speed - most) <= CLOSE * (speed + most) ? UNSURE : speed <= most ? YES : NO;
}

/* The shortest stop within the limits: distances and speeds on the way. */
static void stop(const Ramp *ramp, double v, double a, double *distance, double *speed)
{
    double J = ramp->jerk, B = ramp->acceleration, peak = sqrt(fmax(0.5 * a * a + J * v, 0.0)), hold = 0.0;
    if (peak > B) {
        peak = B;
        hold = fmax((v + (0.5 * a * a - B * B) / J) / B, 0.0);
    }
    double t1 = fmax((a + peak) / J, 0.0), t3 = peak / J, end = t1 + hold + t3;
    double v1 = v + a * t1 - 0.5 * J * t1 * t1, a1 = a - J * t1, v2 = v1 + a1 * hold;
    for (int i = 0; i < SAMPLES; i++) {
        double t = i == LAST_SAMPLE ? end : i * (end / LAST_SAMPLE);
        double first = fmin(t, t1), second = between(t - t1, 0.0, hold);
        double third = fmin(fmax(t - (t1 + hold), 0.0), t3);
        speed[i] = v + a * first - 0.5 * J * first * first + a1 * second + a1 * third + 0.5 * J * third * third;
        speed[i] = fmax(speed[i], 0.0);
        distance[i] = v * first + 0.5 * a * first * first - J * first * first * first / 6.0;
        distance[i] += v1 * second + 0.5 * a1 * second * second;
        distance[i] += v2 * third + 0.5 * a1 * third * third + J * third * third * third / 6.0;
    }
}

/* Whether a stop from v and a on is below what is allowed, at the knots on the way too; `before` is driven first. */
static Answer stops(const Ramp *ramp, double before, double v, double a)
{
    const Course *course = ramp->course;
    double distance[SAMPLES], speed[SAMPLES];
    int sign = ramp->state->back != 0.0 ? -1 : 1, first = piece_at(course, ramp->at), piece = first;
    stop(ramp, v, a, distance, speed);
    for (int i = 0; i < SAMPLES; i++) {
        Answer answer = allows_speed(ramp, speed[i], distance[i] += before, &piece);
        if (answer != YES)
            return answer;
    }
    piece = first;
    for (int knot = first + (sign > 0), i = 0; knot >= 0 && knot < course->knots; knot += sign) {
        double ahead = sign * (course->at[knot] - ramp->at);
        if (!(ahead < distance[LAST_SAMPLE]))
            break;
        if (!(ahead > distance[0]))
            continue;
        while (i < LAST_SAMPLE - 1 && distance[i + 1] <= ahead)
            i++;
        double here = speed[i] * speed[i], there = speed[i + 1] * speed[i + 1];
        double square = (there - here) / (distance[i + 1] - distance[i]) * (ahead - distance[i]) + here;
        Answer answer = allows_speed(ramp, sqrt(square), ahead, &piece);
        if (answer != YES)
            return answer;
    }
    return YES;
}

/* Ramp.next, with the limits of path_pace.py: the largest acceleration of the next tick from which the speed ends at or
   below the wanted one, and can be brought to zero. */
Outcome ramped(const Course *course, const Travel *state, double at, double wanted, double share, double dt, double *a)
{
    Ramp ramp = {course, state, at, share, fmin(course->most, SLOWEST_SHARE * course->braking), course->jerk};
    double v = state->speed, was = state->acceleration;
    double least = fmax(was - ramp.jerk * dt, -ramp.acceleration), most = fmin(was + ramp.jerk * dt, ramp.acceleration);
    if (least > most)
        least = most = between(was, least, most);
    *a = least;
    for (int i = 0; i < CANDIDATES; i++) {
        double next = i == CANDIDATES - 1 ? least : most + i * ((least - most) / (CANDIDATES - 1));
        double after = v + next * dt, change = 0.5 * next * fabs(next) / ramp.jerk;
        double settled = after + change, allowed = wanted * (1.0 + ROUNDING);
        if (after < 0.0)
            continue;
        if (settled != allowed && fabs(settled - allowed) <= CLOSE * (after + fabs(change) + allowed))
            return HAND_BACK;
        if (!(settled <= allowed))
            continue;
        Answer answer = stops(&ramp, v * dt, after, next);
        if (answer == UNSURE)
            return HAND_BACK;
        if (answer == YES) {
            *a = next;
            return DONE;
        }
    }
    return DONE;
}
