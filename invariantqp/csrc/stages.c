/* Twin of velocity/stages.py and posed.py: one tick, stage by stage, inside bounds and tool speed.

       free       the optimum without limits, where that is inside them; otherwise:
       share      exact rows slow down along their direction where limits require it
       minimise   the optimum inside the limits
       calm       the optimum once more, with damping that grows with the residual */

#include "core.h"

/* A tick as a problem in z: y = share full + B z with exact rows, y = z without. */
typedef struct {
    const Demand *demand;
    const Row *A;
    const double *wanted;
    Reduction reduction;
    double largest; /* singular value of A, where there are exact rows */
} Posed;

static Outcome posed(const Demand *demand, const Row A[6], const double wanted[6], Posed *problem)
{
    problem->demand = demand;
    problem->A = A;
    problem->wanted = wanted;
    problem->largest = 0.0;
    if (demand->rows == 0)
        return DONE;
    Spectrum found;
    if (reduce(demand, &problem->reduction) == HAND_BACK || spectrum(6, demand->m, A, wanted, &found) == HAND_BACK)
        return HAND_BACK;
    problem->largest = found.sigma[0];
    return DONE;
}

/* The objective in z at a share of the speed. */
static Outcome objective(const Posed *problem, double share, Objective *result)
{
    const Demand *demand = problem->demand;
    const Reduction *reduction = &problem->reduction;
    int m = demand->m;
    if (demand->rows == 0)
        return least_squares(demand, m, problem->A, problem->wanted, demand->posture, 0.0, result);
    Row AB[6], posture = {0.0};
    double left[6];
    for (int i = 0; i < 6; i++) {
        left[i] = share * (problem->wanted[i] - dot(m, problem->A[i], reduction->full));
        for (int j = 0; j < reduction->n; j++)
            AB[i][j] = dot(m, problem->A[i], reduction->basis[j]);
    }
    if (demand->has_posture) {
        Row wanted;
        for (int j = 0; j < m; j++)
            wanted[j] = share * demand->posture[j];
        freed(reduction, m, wanted, share, posture);
    }
    return least_squares(demand, reduction->n, (const Row *)AB, left, posture, problem->largest, result);
}

static void joints(const Posed *problem, const Row z, double share, Row y)
{
    int m = problem->demand->m;
    if (problem->demand->rows > 0)
        joint(&problem->reduction, m, z, share, y);
    for (int j = 0; j < m && problem->demand->rows == 0; j++)
        y[j] = z[j];
}

static void free_part(const Posed *problem, const Row y, double share, Row z)
{
    int m = problem->demand->m;
    if (problem->demand->rows > 0)
        freed(&problem->reduction, m, y, share, z);
    for (int j = 0; j < m && problem->demand->rows == 0; j++)
        z[j] = y[j];
}

/* The optimum inside the limits, as y; it begins with the active limits of `found`, which is written over. */
static Outcome minimised(const Posed *problem, const Share *share, const Objective *objective, Optimum *found, Row y)
{
    const Demand *demand = problem->demand;
    int m = demand->m;
    Quadratic cost;
    Polytope limits;
    Cone cone = demand->cone;
    Row inside, origin;
    limits.count = m;
    limits.box = demand->rows == 0;
    for (int j = 0; j < m; j++) {
        origin[j] = limits.box ? 0.0 : share->value * problem->reduction.full[j];
        limits.lower[j] = demand->lower[j] - origin[j];
        limits.upper[j] = demand->upper[j] - origin[j];
        for (int i = 0; !limits.box && i < problem->reduction.n; i++)
            limits.A[j][i] = problem->reduction.basis[i][j];
    }
    if (!limits.box && cone.limit > 0.0)
        cone_on(&demand->cone, m, origin, problem->reduction.n, problem->reduction.basis, &cone);
    quadratic(objective, &cost);
    free_part(problem, share->inside, share->value, inside);
    if (minimise(&cost, &limits, &cone, inside, found, found) == HAND_BACK)
        return HAND_BACK;
    joints(problem, found->z, share->value, y);
    return DONE;
}

static double calming(const Posed *problem, const Share *share, const Objective *objective, const Row y)
{
    Row z;
    const Demand *demand = problem->demand;
    if (demand->dt == 0.0)
        return 0.0;
    free_part(problem, y, share->value, z);
    double factor = demand->rows == 0 ? CALM : CALM * problem->reduction.bend;
    return calm(demand->m, problem->A, problem->wanted, y, speed(objective, z), demand->dt, factor);
}

Outcome answered(const Demand *demand, const Row A[6], const double wanted[6], Solution *solution)
{
    Posed problem;
    Objective cost;
    Optimum found;
    Share share;
    Row y;
    int m = demand->m;
    found.met = share.near.met = share.fast = false;
    share.value = 1.0;
    if (posed(demand, A, wanted, &problem) == HAND_BACK || objective(&problem, 1.0, &cost) == HAND_BACK)
        return HAND_BACK;
    centre(&cost, found.z);
    joints(&problem, found.z, 1.0, y);
    if (!all_finite(m, y))
        return HAND_BACK;
    if (allows(demand, y)) {
        for (int j = 0; j < m; j++)
            share.inside[j] = y[j];
    } else {
        bool still = true;
        for (int j = 0; j < m; j++) {
            share.inside[j] = fmin(fmax(0.0, demand->lower[j]), demand->upper[j]);
            still = still && share.inside[j] == 0.0;
        }
        if (demand->cone.limit > 0.0 && !(tool_speed(&demand->cone, m, share.inside) <= demand->cone.limit))
            return HAND_BACK; /* bounds that force the tool to be faster: Python lets its limit give way */
        /* Exact rows count from standing still; where that is not allowed, Python finds where they count from. */
        if (demand->rows > 0 && (!still || share_of(&problem.reduction, demand, &share) == HAND_BACK ||
                                 objective(&problem, share.value, &cost) == HAND_BACK))
            return HAND_BACK;
        found = share.near;
        if (minimised(&problem, &share, &cost, &found, y) == HAND_BACK)
            return HAND_BACK;
    }
    double mu = calming(&problem, &share, &cost, y);
    if (mu > 0.0) {
        calmed(&cost, mu);
        if (minimised(&problem, &share, &cost, &found, y) == HAND_BACK)
            return HAND_BACK;
    }
    reported(demand, A, wanted, &cost, y, &share, &found, solution);
    return DONE;
}
