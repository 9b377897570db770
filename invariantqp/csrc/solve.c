/* Twin of legacy/solve.py: one tick of the law.

       six joints or more, far from singular, no limit active    one triangular factor (regular.c)
       otherwise                                                 stage by stage (stages.c) */

#include "core.h"

/* Whether the exact rows hold, to rounding. */
static bool achieves(const Demand *demand, const Row x)
{
    for (int i = 0; i < demand->rows; i++) {
        double size = fabs(demand->e[i]);
        for (int j = 0; j < demand->m; j++)
            size += fabs(demand->C[i][j] * x[j]);
        if (!(fabs(dot(demand->m, demand->C[i], x) - demand->e[i]) <= ROW_ROUNDING * size))
            return false;
    }
    return true;
}

/* Whether the exact rows ask for what the twist without its chase does, for a posture that is paced by it. */
static bool agrees(const Demand *demand)
{
    for (int i = 0; i < demand->rows && demand->has_posture && demand->paced && demand->chased; i++) {
        double told = demand->of_twist ? dot(6, demand->D[i], demand->chase.ahead) : 0.0, size = fabs(told);
        double asked = demand->chase.rows_ahead[i];
        if (!(fabs(told - asked) <= ROW_ROUNDING * fmax(size, fabs(asked))))
            return false;
    }
    return true;
}

/* A twist missed by less is met by joints far from singular: a hundred times this share of their velocity. A posture that is
   far larger than what the twist needs leaves more. */
static const double REGULAR = 1e-11;

static bool quick(const Demand *demand, const Regular *regular, const Row A[6], const double b[6], Solution *solution)
{
    Row x;
    int m = demand->m;
    if (demand->metric != NULL || !agrees(demand) || !regular_velocity(demand, regular, A, b, x) || !allows(demand, x) || !achieves(demand, x) || !is_met(m, A, b, x, REGULAR) ||
        excess_deviation(m, A, b, norm(m, x), demand->dt + demand->held) > 0.0)
        return false;
    solution->rows = solution->yielded.rows = 0;
    solution->yielded.speed = solution->unmet = solution->beyond = 0.0;
    if (clipped(demand, x, solution) == HAND_BACK)
        return false;
    solution->m = m;
    solution->method = CLOSED_FORM;
    solution->stuck = solution->limited = solution->slow = solution->met = false;
    solution->scale = solution->pace = 1.0;
    solution->damping = solution->blended = 0.0;
    at_limits(demand, solution);
    return true;
}

/* What of a demand the law decides. */
void governed(const Law *law, Demand *demand)
{
    demand->metric = law->has_metric ? law : NULL;
    demand->form = law->form != LEAST_SQUARES ? law : NULL;
    demand->threshold = law->threshold;
    demand->ceiling = law->ceiling;
    demand->fixed = law->fixed;
    demand->speed = law->speed;
    demand->dt = law->dt;
}

/* Whether there is a number between two limits; NaN is none. */
static bool is_between(double lower, double upper) { return lower <= upper && lower < INFINITY && upper > -INFINITY; }

Outcome solve(const Demand *demand, Solution *solution)
{
    Row A[6];
    product_of_rows(6, demand->root, demand->m, demand->J, A);
    return solve_measured(demand, (const Row *)A, solution);
}

/* The same where A = root J is known. */
Outcome solve_measured(const Demand *demand, const Row A[6], Solution *solution)
{
    int m = demand->m;
    double b[6];
    for (int i = 0; i < 6; i++)
        b[i] = dot(6, demand->root[i], demand->s);
    const Law *metric = demand->metric;
    const Cone *cone = &demand->cone;
    bool plain = usual(6, b) && (!demand->has_posture || usual(m, demand->posture)) && usual_rows(6, m, A) && usual_rows(demand->rows, m, demand->C) &&
                 usual(demand->rows, demand->e) && usual_rows(demand->limits, m, demand->G) && usual(1, &cone->limit) &&
                 usual_rows(cone->limit > 0.0 ? 3 : 0, m, cone->J) &&
                 (metric == NULL || (usual_rows(m, m, metric->T) && usual_rows(m, m, metric->inverse)));
    for (int j = 0; j < m && demand->paced; j++)
        plain = plain && demand->fastest[j] > 0.0;
    for (int j = 0; j < m; j++)
        plain = plain && is_between(demand->lower[j], demand->upper[j]) &&
                (!demand->chased || is_between(demand->chase.lower[j], demand->chase.upper[j]));
    for (int i = 0; i < demand->limits; i++)
        plain = plain && is_between(demand->least[i], demand->most[i]);
    if (!plain)
        return HAND_BACK;
    Regular regular;
    is_regular(demand, A, &regular);
    return quick(demand, &regular, A, b, solution) ? DONE : answered(demand, &regular, A, b, solution);
}
