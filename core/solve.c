/* Twin of velocity/solve.py and stages.py: one tick inside joint velocity bounds.

       regular    six joints or more, far from singular, no limit active: one Cholesky factor
       free       the optimum without limits, where that is inside them
       minimise   otherwise the optimum inside them
       calm       the optimum once more, with damping that grows with the residual */

#include "core.h"

/* Sizes whose squares neither overflow nor vanish; others are handed back. */
static const double SMALLEST = 1e-70, LARGEST = 1e70;

/* Whether a vector is zero or of such a size; NaN is not. */
static bool usual(int n, const double *a)
{
    double most = 0.0;
    for (int i = 0; i < n; i++) {
        if (!(fabs(a[i]) <= LARGEST))
            return false;
        most = fmax(most, fabs(a[i]));
    }
    return most == 0.0 || most >= SMALLEST;
}

static bool quick(const Demand *demand, const Row A[6], const double b[6], Solution *solution)
{
    Row x;
    int m = demand->m;
    if (!regular_velocity(demand, A, b, x) || !allows(demand, x) || !is_met(m, A, b, x) ||
        excess_deviation(m, A, b, norm(m, x), demand->dt) > 0.0)
        return false;
    for (int j = 0; j < m; j++) {
        solution->velocity[j] = x[j];
        solution->active[j] = false;
    }
    for (int i = 0; i < 6; i++)
        solution->residual[i] = demand->s[i] - dot(m, demand->J[i], x);
    solution->m = m;
    solution->method = CLOSED_FORM;
    solution->stuck = solution->lost = false;
    solution->damping = 0.0;
    return true;
}

/* The optimum inside the box. */
static Outcome minimised(const Demand *demand, const Objective *objective, Optimum *found)
{
    Quadratic problem;
    Polytope limits;
    limits.count = demand->m;
    limits.box = true;
    Row inside;
    for (int j = 0; j < demand->m; j++) {
        limits.lower[j] = demand->lower[j];
        limits.upper[j] = demand->upper[j];
        inside[j] = fmin(fmax(0.0, demand->lower[j]), demand->upper[j]);
    }
    quadratic(objective, &problem);
    return minimise(&problem, &limits, inside, found, found);
}

static Outcome answered(const Demand *demand, const Row A[6], const double wanted[6], Solution *solution)
{
    Objective objective;
    Optimum found;
    found.met = false;
    if (least_squares(demand, A, wanted, &objective) == HAND_BACK)
        return HAND_BACK;
    centre(&objective, found.z);
    if (!all_finite(demand->m, found.z))
        return HAND_BACK;
    if (!allows(demand, found.z) && minimised(demand, &objective, &found) == HAND_BACK)
        return HAND_BACK;
    if (demand->dt > 0.0) {
        double mu = calm(demand->m, A, wanted, found.z, speed(&objective, found.z), demand->dt);
        if (mu > 0.0) {
            calmed(&objective, mu);
            if (minimised(demand, &objective, &found) == HAND_BACK)
                return HAND_BACK;
        }
    }
    reported(demand, A, wanted, &objective, &found, solution);
    return DONE;
}

Outcome solve(const Demand *demand, Solution *solution)
{
    int m = demand->m;
    Row A[6];
    double b[6];
    for (int i = 0; i < 6; i++) {
        b[i] = dot(6, demand->root[i], demand->s);
        for (int j = 0; j < m; j++)
            A[i][j] = 0.0;
        for (int k = 0; k < 6; k++)
            for (int j = 0; j < m; j++)
                A[i][j] += demand->root[i][k] * demand->J[k][j];
    }
    bool plain = usual(6, b) && usual(m, demand->posture);
    for (int i = 0; i < 6; i++)
        plain = plain && usual(m, A[i]);
    if (!plain)
        return HAND_BACK;
    return quick(demand, A, b, solution) ? DONE : answered(demand, A, b, solution);
}
