/* Twin of legacy/report.py and solution.py: the velocity as it may be commanded, its status, and what the reason says. */

#include "core.h"

bool allows(const Demand *demand, const Row x)
{
    if (demand->cone.limit > 0.0 && !(tool_speed(&demand->cone, demand->m, x) <= demand->cone.limit))
        return false;
    for (int j = 0; j < demand->m; j++)
        if (!(x[j] >= demand->lower[j] && x[j] <= demand->upper[j]))
            return false;
    for (int i = 0; i < demand->limits; i++) {
        double value = dot(demand->m, demand->G[i], x);
        if (!(value >= demand->least[i] && value <= demand->most[i]))
            return false;
    }
    return true;
}

/* A x, and the square of what is rounding of it, or done by joints slower than what counts as being at a limit */
static double done_by(int n, const Row A[6], const Row x, double done[6])
{
    double size = 0.0, rounding = PRODUCT_ROUNDING * PRODUCT_ROUNDING * dot(n, x, x), still = ACTIVE_TOLERANCE * SLOWEST;
    for (int i = 0; i < 6; i++) {
        done[i] = dot(n, A[i], x);
        size += dot_in_steps(n, A[i], A[i]);
    }
    return size * fmax(rounding, still * still);
}

/* Whether that is b but for rounding, or a tolerance. */
static bool is_done(const double b[6], const double done[6], double rounding, double tolerance)
{
    double square = 0.0;
    for (int i = 0; i < 6; i++)
        square += (b[i] - done[i]) * (b[i] - done[i]);
    return square <= tolerance * tolerance * dot(6, b, b) || square <= rounding;
}

/* Whether A x = b but for rounding, or a tolerance. */
bool is_met(int n, const Row A[6], const double b[6], const Row x, double tolerance)
{
    double done[6], rounding = done_by(n, A, x, done);
    return is_done(b, done, rounding, tolerance);
}

/* A measured twist up to which nothing is to move, as an error of a pose that may stay. */
static double nothing(const Demand *demand)
{
    return demand->chased ? GROWING * demand->chase.slack : 0.0;
}

/* Whether nothing moves towards a twist or along the exact rows, short of both. */
static bool is_little(const Demand *demand, const double wanted[6], const double done[6], double rounding, double share)
{
    double square = dot(6, wanted, wanted);
    return !(demand->rows > 0 && share > PROGRESS_SHARE) && square > nothing(demand) * nothing(demand) &&
           dot(6, wanted, done) < PROGRESS_SHARE * square && !is_done(wanted, done, rounding, QP_ROUNDING);
}

/* Whether joints move the tool, each by itself, by no more than nothing. */
static bool rests(const Demand *demand, const Row A[6], const Row x)
{
    double moved = 0.0;
    for (int j = 0; j < demand->m; j++) {
        double square = 0.0;
        for (int i = 0; i < 6; i++)
            square += A[i][j] * A[i][j];
        moved += sqrt(square) * fabs(x[j]);
    }
    return moved <= nothing(demand);
}

/* The share of a velocity that a limit above zero allows where only rounding exceeds it; 1 where more does: it gave way. */
static double rounded(double value, double limit)
{
    double share = limit > 0.0 && value > limit ? limit / value : 1.0;
    return share > 1.0 - ACTIVE_TOLERANCE ? share : 1.0;
}

/* The velocity shortened until rows and tool speed hold exactly, where only rounding exceeds them; not where standing still
   is outside a row or the box, which a shorter one would be too. */
static void shortened(const Demand *demand, const Row y, Row x)
{
    double limit = demand->cone.limit, share = limit > 0.0 ? rounded(tool_speed(&demand->cone, demand->m, y), limit) : 1.0;
    memcpy(x, y, sizeof(Row));
    for (int j = 0; j < demand->m; j++)
        if (demand->lower[j] > 0.0 || demand->upper[j] < 0.0)
            return;
    for (int i = 0; i < demand->limits; i++) {
        double value = dot(demand->m, demand->G[i], y);
        if (demand->least[i] > 0.0 || demand->most[i] < 0.0)
            return;
        share = fmin(share, fmin(rounded(value, demand->most[i]), rounded(-value, -demand->least[i])));
    }
    for (int j = 0; j < demand->m; j++)
        x[j] *= share;
}

/* Whether rows and tool speed are exceeded by no more than rounding of the velocity; not asked of those that gave way. */
static bool holds(const Demand *demand, const Yielded *yielded, const Row x)
{
    int m = demand->m;
    double size = norm(m, x), limit = demand->cone.limit;
    for (int i = 0; i < demand->limits; i++) {
        double value = dot(m, demand->G[i], x), margin = QP_ROUNDING * norm(m, demand->G[i]) * size;
        bool gave_way = yielded->rows > 0 && yielded->by[i] != 0.0;
        if (!gave_way && !(value >= demand->least[i] - margin && value <= demand->most[i] + margin))
            return false;
    }
    if (!(limit > 0.0) || yielded->speed > 0.0)
        return true;
    return tool_speed(&demand->cone, m, x) <= limit + QP_ROUNDING * (limit + norm_of_rows(3, m, demand->cone.J) * size);
}

/* The velocity without rounding past its limits, the joints at them, and the residual; handed back where it exceeds them. */
Outcome clipped(const Demand *demand, const Row y, Solution *solution)
{
    Row x;
    shortened(demand, y, x);
    for (int j = 0; j < demand->m; j++) {
        double lower = demand->lower[j], upper = demand->upper[j], value = between(x[j], lower, upper);
        double size = fabs(value), margin = ACTIVE_TOLERANCE * (size > SLOWEST ? size : SLOWEST);
        solution->velocity[j] = value;
        solution->active[j] = value <= lower + margin || value >= upper - margin;
    }
    for (int i = 0; i < 6; i++)
        solution->residual[i] = demand->s[i] - dot(demand->m, demand->J[i], solution->velocity);
    return holds(demand, &solution->yielded, solution->velocity) ? DONE : HAND_BACK;
}

/* Whether the errors of position and angle each fall at FALLING of the rate asked for; those within slack do
   not grow by more than GROWING of it, nor does any by what moves beside it. */
static bool falls(const Demand *demand, const Row x)
{
    double asked[6], done[6], twist[6], left[6], growing = nothing(demand);
    if (!demand->chased)
        return false;
    for (int i = 0; i < 6; i++)
        twist[i] = demand->s[i] - demand->chase.ahead[i];
    for (int i = 0; i < 6; i++)
        asked[i] = dot(6, demand->root[i], twist);
    for (int i = 0; i < 6; i++)
        twist[i] = dot(demand->m, demand->J[i], x) - demand->chase.ahead[i];
    for (int i = 0; i < 6; i++)
        left[i] = asked[i] - (done[i] = dot(6, demand->root[i], twist));
    int size = demand->chase.apart ? 3 : 6;
    for (int i = 0; i < 6; i += size) {
        double rate = norm(size, asked + i);
        double least = fmax(FALLING * rate - demand->chase.slack, -growing);
        if (!(dot(size, asked + i, done + i) >= rate * least && norm(size, left + i) <= rate + growing))
            return false;
    }
    return true;
}

/* The share of the measured twist that is missed, or of what is possible of it; 0 where it is done but for rounding. */
static double missed_share(const Demand *demand, const double wanted[6], const double *possible, const double done[6],
                           double rounding)
{
    double left[6], size = norm(6, possible);
    if (is_done(wanted, done, rounding, QP_ROUNDING) || (possible != wanted && is_done(possible, done, rounding, QP_ROUNDING)))
        return 0.0;
    for (int i = 0; i < 6; i++)
        left[i] = possible[i] - done[i];
    return size > nothing(demand) ? norm(6, left) / size : INFINITY;
}

/* tick.py, _followed: how much of a chase counts as motion of the task */
double steady_share(const Demand *demand, const double wanted[6], const double ahead[6])
{
    double chase[6], size;
    if (!demand->chased)
        return 1.0;
    for (int i = 0; i < 6; i++)
        chase[i] = wanted[i] - ahead[i];
    size = norm(6, chase);
    return size <= demand->chase.slack ? 0.0 : 1.0 - demand->chase.slack * demand->chase.slack / (size * size);
}

/* tick.py, _followed: by the joint velocity x that the task needs */
double posture_share(const Demand *demand, const Row x)
{
    double t = 0.0;
    for (int j = 0; j < demand->m; j++)
        t = fmax(t, fabs(x[j]) / demand->fastest[j]);
    return t * t / (t * t + POSTURE_PACE * POSTURE_PACE);
}

/* tick.py, _unhurried: which share of a change x of the joint velocity a posture may make in a tick */
double slower(const Demand *demand, const Row x)
{
    double most = 1.0;
    for (int j = 0; j < demand->m; j++)
        most = fmax(most, fabs(x[j]) / demand->change[j]);
    return 1.0 / most;
}

/* Of limits that hold, joints as 1 and rows by their rank, the one that pulls hardest first. */
static void ranked(const Demand *demand, const bool *holds, const double *multipliers, unsigned char *ranks)
{
    int m = demand->m, k = demand->limits;
    double pulls[MOST_LIMITS];
    for (int j = 0; j < m; j++)
        ranks[j] = holds[j];
    for (int i = 0; i < k; i++)
        pulls[i] = norm(m, demand->G[i]) * fabs(multipliers[m + i]);
    for (int i = 0; i < k; i++) {
        ranks[m + i] = holds[m + i];
        for (int h = 0; h < k && holds[m + i]; h++)
            ranks[m + i] += holds[m + h] && (pulls[h] > pulls[i] || (pulls[h] == pulls[i] && h < i));
    }
}

/* The limits that a velocity is at. */
void at_limits(const Demand *demand, Solution *solution)
{
    const double *x = solution->velocity, limit = demand->cone.limit;
    static const double NONE[LIMITS] = {0.0};
    bool at[LIMITS];
    solution->limits = demand->limits;
    for (int j = 0; j < demand->m; j++)
        at[j] = solution->active[j];
    for (int i = 0; i < demand->limits; i++) {
        double size = norm(demand->m, demand->G[i]), value = dot(demand->m, demand->G[i], x);
        double margin = ACTIVE_TOLERANCE * size * fmax(SLOWEST, norm(demand->m, x));
        at[demand->m + i] = size > 0.0 && (value <= demand->least[i] + margin || value >= demand->most[i] - margin);
    }
    ranked(demand, at, solution->met ? solution->multipliers : NONE, solution->at_limit);
    solution->at_speed = limit > 0.0 && tool_speed(&demand->cone, demand->m, x) >= limit * (1.0 - ACTIVE_TOLERANCE);
}

/* report.py, _position_alone: whether joints move the point in all directions. */
static bool moves_anywhere(int m, const Row A[6])
{
    double square[3][3], c[3], trace = 0.0;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            square[i][j] = dot(m, A[3 + i], A[3 + j]);
        trace += square[i][i];
    }
    cross(square[0], square[1], c);
    return dot(3, c, square[2]) > SPREAD * trace * trace * trace;
}

Outcome reported(const Demand *demand, const Row A[6], const double wanted[6], const double *possible,
                 const Objective *objective, const Row y, const Share *share, double pace, const Optimum *found,
                 double blended, Solution *solution)
{
    if (clipped(demand, y, solution) == HAND_BACK)
        return HAND_BACK;
    double done[6], rounding = done_by(demand->m, A, solution->velocity, done);
    solution->scale = share->value;
    solution->pace = pace;
    solution->slow = share->value < WHOLE_SPEED;
    solution->m = demand->m;
    bool little = is_little(demand, wanted, done, rounding, share->value);
    solution->missed = missed_share(demand, wanted, demand->rows > 0 ? possible : wanted, done, rounding);
    double size = norm(6, wanted);
    solution->achievable = 1.0;
    if (demand->rows == 0 && possible != wanted && size > nothing(demand)) { /* report.py, _achievable */
        double achieved = dot(6, wanted, possible) / (size * size);
        solution->achievable = achieved < ENOUGH_ACHIEVED ? achieved : 1.0;
    }
    solution->position_alone = solution->achievable < 1.0 && demand->m >= 3 && moves_anywhere(demand->m, A);
    solution->beyond = size > nothing(demand) ? solution->beyond : 0.0;
    solution->limited = little || solution->rows > 0 || (solution->missed > MISSED_SHARE && !falls(demand, solution->velocity));
    solution->stuck = (little && !demand->chased) ||
                      ((little || (solution->limited && isinf(solution->missed))) && rests(demand, A, solution->velocity));
    solution->damping = solution->missed > 0.0 ? objective->damping : 0.0;
    solution->method = solution->slow || found->met ? QP : solution->damping > 0.0 ? DAMPED : CLOSED_FORM;
    solution->blended = blended;
    solution->ratio = objective->ratio;
    solution->met = found->met;
    for (int i = 0; i < demand->m + demand->limits; i++)
        solution->multipliers[i] = found->met ? found->multipliers[i] : 0.0;
    at_limits(demand, solution);
    return DONE;
}
