/* Twin of velocity/limits.py (BrakingBox) and control/tracking.py: a joint is never faster than it can still brake in the room
   it has left, nor the tool faster than its joints can brake before the target.

       |x - x_before| <= a dt,     D(x) = dt (x + (x - a dt) + (x - 2 a dt) + ...) + y / rate <= room */

#include "loop.h"
#include <string.h>

/* tracking.py: both numbers of its Adaptive */
#define DISTANCE_DAMPING 0.1

/* The largest x >= 0 with D(x) <= room; the rest is covered at a rate. */
double braking_speed(double room, double acceleration, double dt, double rate)
{
    double a = fmin(acceleration, BOUNDLESS), r = between(room, 0.0, BOUNDLESS) / (a * dt * dt), k = 1.0 / (rate * dt);
    double n = fmax(ceil(sqrt(fmax(2.0 * r - k * k + k + 0.25, 0.0)) - k - 0.5), 0.0);
    return isinf(room) ? INFINITY : a * dt * (r + n * (0.5 * (n - 1.0) + k)) / (n + k);
}

/* The next velocity under the smallest constant deceleration that stops within the room. */
double late_braking(double room, double before, double dt)
{
    if (!(before > 0.0))
        return 0.0;
    double d = 1.0 + between(room, 0.0, BOUNDLESS) / (before * dt), n = fmax(ceil(2.0 * d - 1.0), 1.0);
    double share = n > 1.0 ? 2.0 * (n - d) / fmax(n * (n - 1.0), 1.0) : 1.0;
    return before * (1.0 - share);
}

/* The least and the largest velocity of a joint towards a limit `room` away, `behind` from the opposite one. */
static void one_way(const Loop *loop, int j, double room, double behind, double before, double *least, double *most)
{
    double a = loop->acceleration[j], slowest = before - a * loop->dt;
    if (room >= 0.0) {
        *most = braking_speed(room, a, loop->dt, loop->rate);
        if (*most < slowest)
            *most = fmin(late_braking(room, before, loop->dt), slowest);
    } else {
        double back = fmin(braking_speed(-room, a, loop->dt, loop->rate), braking_speed(behind, a, loop->dt, loop->rate));
        *most = fmin(fmax(-back, slowest), 0.0);
    }
    *least = fmin(slowest, *most);
}

/* Whether no limits contradict each other; `tick` tells of those that do. */
bool braking_box(const Loop *loop, const double *q, const double *before, const double *speeds, Demand *demand, Tick *tick)
{
    double dt = loop->dt, *lower = demand->lower, *upper = demand->upper;
    bool good = true;
    for (int j = 0; j < loop->joints; j++) {
        double ahead = loop->position_upper[j] - q[j], behind = q[j] - loop->position_lower[j];
        double fastest = speeds[j], step = loop->acceleration[j] * dt, least, most, least_back, most_back;
        one_way(loop, j, ahead, behind, before[j], &least, &most);
        one_way(loop, j, behind, ahead, -before[j], &least_back, &most_back);
        lower[j] = fmin(fmax(fmax(least, -most_back), -fastest), fastest);
        upper[j] = fmax(fmin(fmax(fmin(most, -least_back), -fastest), fastest), lower[j]);
        demand->chase.lower[j] = fmin(lower[j], -braking_speed(behind, loop->acceleration[j], dt, loop->rate));
        demand->chase.upper[j] = fmax(upper[j], braking_speed(ahead, loop->acceleration[j], dt, loop->rate));
        double allowance = QP_ROUNDING * (1.0 + fabs(before[j]) + (isfinite(step) ? step : 0.0));
        double change = fmax(lower[j] - before[j], before[j] - upper[j]), outside = outside_by(loop, q, j);
        tick->acceleration[j] = change - step > allowance ? change / dt : 0.0;
        tick->outside[j] = outside > OUTSIDE ? outside : 0.0;
        good = good && tick->acceleration[j] == 0.0 && tick->outside[j] == 0.0;
    }
    return good;
}

/* The share of the gain from which the joints can still brake within a distance each. */
static double share_within(const Loop *loop, double gain, const Row distance)
{
    double share = 1.0;
    for (int j = 0; j < loop->joints; j++) {
        double d = fabs(distance[j]), a = BRAKING_SHARE * loop->acceleration[j], knee = a / (gain * gain);
        if (d > knee)
            share = fmin(share, sqrt(a * (2.0 * d - knee)) / (gain * d));
    }
    return share;
}

/* tracking.py, time_to_least: until the measured error is least, or greatest, while joints go on at c. */
static double time_to_least(const Demand *demand, double slack, const double error[6], const Row c)
{
    double twist[6] = {0.0}, bend[6] = {0.0}, along = 0.0, square = 0.0, curve = 0.0;
    for (int j = 0; j < demand->m; j++) {
        double column[6], turned[6], slid[3];
        for (int i = 0; i < 6; i++)
            column[i] = demand->J[i][j] * c[j];
        cross(twist, column, turned);
        cross(twist, column + 3, turned + 3);
        cross(twist + 3, column, slid);
        for (int i = 0; i < 6; i++) {
            bend[i] += turned[i] + (i < 3 ? 0.0 : slid[i - 3]);
            twist[i] += column[i];
        }
    }
    for (int i = 0; i < 6; i++) {
        double moved = dot(6, demand->root[i], twist);
        along += error[i] * moved;
        square += moved * moved;
        curve += error[i] * dot(6, demand->root[i], bend);
    }
    double change = square + fmax(0.0, -curve);
    return change > 0.0 ? (fabs(along) + slack * sqrt(square)) / change : INFINITY;
}

/* The same before the target, and on the way to where the error is least; error and feedforward are measured, as A is;
   A is on y where there is a joint metric. */
Outcome approach(const Loop *loop, double gain, const Demand *demand, const Row A[6], const double error[6],
                 const double feedforward[6], const double *before, Braking *found)
{
    static const Row STILL = {0.0};
    Demand damped = {.threshold = DISTANCE_DAMPING, .ceiling = DISTANCE_DAMPING};
    Objective objective;
    Spectrum of;
    Row distance, follows, c;
    int m = loop->joints;
    if (spectrum(6, m, A, error, feedforward, &of) == HAND_BACK || least_squares(&damped, m, &of, STILL, false, &objective) == HAND_BACK)
        return HAND_BACK;
    centre(&objective, distance);
    memcpy(of.wanted, of.ahead, sizeof of.wanted);
    if (least_squares(demand, m, &of, STILL, false, &objective) == HAND_BACK)
        return HAND_BACK;
    centre(&objective, follows);
    if (loop->law.has_metric) {
        transformed(m, loop->law.T, distance, distance);
        transformed(m, loop->law.T, follows, follows);
    }
    found->share = share_within(loop, gain, distance);
    for (int j = 0; j < m; j++)
        c[j] = before[j] - follows[j];
    double time = time_to_least(demand, loop->slack / fmin(loop->gain, SLACK_GAIN), error, c);
    for (int j = 0; j < m; j++) {
        double size = fabs(c[j]), step = loop->dt * loop->acceleration[j], slower = fmax(size - step, step);
        double most = size > 0.0 ? fmax(braking_speed(time * size, BRAKING_SHARE * loop->acceleration[j], loop->dt, 1.0 / loop->dt), slower) : INFINITY;
        found->lower[j] = c[j] < 0.0 ? follows[j] - most : -INFINITY;
        found->upper[j] = c[j] > 0.0 ? follows[j] + most : INFINITY;
    }
    return DONE;
}

/* tracking.py, Approach.within: a demand with these bounds; beside rows of limits, which may ask joints to go on, as it is. */
void braked(const Braking *braking, Demand *demand)
{
    for (int j = 0; j < demand->m && demand->limits == 0; j++) {
        double lower = demand->lower[j], upper = demand->upper[j];
        demand->lower[j] = between(lower, braking->lower[j], upper);
        demand->upper[j] = fmax(fmin(upper, braking->upper[j]), lower);
    }
}
