/* Twin of velocity/stages.py and posed.py: one tick, stage by stage, inside all of its limits.

       free       the optimum without limits, where that is inside them; otherwise:
       share      exact rows slow down along their direction where limits require it
       minimise   the optimum inside the limits
       calm       the optimum once more, with damping that grows with the residual
       guard      with a form: least squares inside the same limits is blended in where the form does not descend */

#include "core.h"
#include <string.h>

/* A tick as a problem in z: y = origin + B z with exact rows, y = z without; x = T y. */
typedef struct {
    const Demand *demand;
    const Row *A; /* on y, as all that follows */
    const double *wanted, *attempt; /* the same array where no form changes anything */
    Row posture;
    Polytope limits;
    Cone cone;
    Reduction reduction;
    Spectrum spectrum; /* of A, or of A B where there are exact rows */
    double largest;    /* singular value of A, where there are exact rows */
    double instead[6]; /* of `wanted`: what a form attempts */
    Row product[6];    /* A T */
} Posed;

/* posed.py, limits_of */
static void limits_of(const Demand *demand, Polytope *limits)
{
    int m = demand->m;
    const Metric *metric = demand->metric;
    limits->count = m + demand->limits;
    limits->box = metric == NULL && demand->limits == 0;
    memcpy(limits->lower, demand->lower, (size_t)m * sizeof(double));
    memcpy(limits->upper, demand->upper, (size_t)m * sizeof(double));
    for (int j = 0; j < m && !limits->box; j++)
        for (int l = 0; l < m; l++)
            limits->A[j][l] = metric != NULL ? metric->T[j][l] : j == l ? 1.0 : 0.0;
    for (int i = 0; i < demand->limits; i++) {
        memcpy(limits->A[m + i], demand->G[i], sizeof(Row));
        limits->lower[m + i] = demand->least[i];
        limits->upper[m + i] = demand->most[i];
    }
    if (demand->limits > 0 && metric != NULL)
        product_with(demand->limits, m, limits->A + m, metric->T);
}

static Outcome posed(const Demand *demand, const Row A[6], const double wanted[6], Posed *problem)
{
    int m = demand->m;
    const Metric *metric = demand->metric;
    Row C[MOST_ROWS], still = {0.0};
    problem->demand = demand;
    problem->A = A;
    problem->wanted = problem->attempt = wanted;
    problem->largest = 0.0;
    problem->cone = demand->cone;
    memcpy(problem->posture, demand->posture, sizeof(Row));
    memcpy(C, demand->C, (size_t)demand->rows * sizeof(Row));
    limits_of(demand, &problem->limits);
    if (metric != NULL) {
        memcpy(problem->product, A, sizeof problem->product);
        product_with(6, m, problem->product, metric->T);
        product_with(demand->rows, m, C, metric->T);
        transformed(m, metric->inverse, demand->posture, problem->posture);
        if (demand->cone.limit > 0.0) {
            Row columns[MOST];
            for (int i = 0; i < m; i++)
                for (int j = 0; j < m; j++)
                    columns[i][j] = metric->T[j][i];
            cone_on(&demand->cone, m, still, m, (const Row *)columns, &problem->cone);
        }
        problem->A = (const Row *)problem->product;
        for (int i = 0; i < 6; i++)
            if (!usual(m, problem->product[i]))
                return HAND_BACK;
        for (int i = 0; i < demand->rows; i++)
            if (!usual(m, C[i]))
                return HAND_BACK;
    }
    bool formed = demand->form != NULL;
    Spectrum *found = &problem->spectrum;
    if ((demand->rows > 0 && reduce(demand, (const Row *)C, &problem->reduction) == HAND_BACK) ||
        spectrum(6, m, problem->A, formed ? NULL : wanted, found) == HAND_BACK)
        return HAND_BACK;
    if (formed) {
        if (attempted(demand, m, found, wanted, problem->instead) == HAND_BACK)
            return HAND_BACK;
        if (memcmp(problem->instead, wanted, sizeof problem->instead) != 0)
            problem->attempt = problem->instead;
    }
    if (demand->rows == 0)
        return DONE;
    problem->largest = found->sigma[0];
    Row AB[6];
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < problem->reduction.n; j++)
            AB[i][j] = dot(m, problem->A[i], problem->reduction.basis[j]);
    return spectrum(6, problem->reduction.n, (const Row *)AB, NULL, found);
}

/* The objective in z at a share of the speed. */
static Outcome objective(Posed *problem, const double *attempt, double share, Objective *result)
{
    const Demand *demand = problem->demand;
    const Reduction *reduction = &problem->reduction;
    int m = demand->m;
    if (demand->rows == 0) {
        if (demand->form != NULL)
            want(&problem->spectrum, attempt);
        return least_squares(demand, m, &problem->spectrum, problem->posture, 0.0, result);
    }
    Row posture = {0.0}, start;
    double left[6];
    origin(reduction, m, share, start);
    for (int i = 0; i < 6; i++)
        left[i] = share * attempt[i] - dot(m, problem->A[i], start);
    want(&problem->spectrum, left);
    if (demand->has_posture) {
        Row wanted;
        for (int j = 0; j < m; j++)
            wanted[j] = share * problem->posture[j];
        freed(reduction, m, wanted, share, posture);
    }
    return least_squares(demand, reduction->n, &problem->spectrum, posture, problem->largest, result);
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

/* x = T y */
static void moved(const Demand *demand, const Row y, Row x)
{
    if (demand->metric != NULL)
        transformed(demand->m, demand->metric->T, y, x);
    else
        memcpy(x, y, (size_t)demand->m * sizeof(double));
}

/* The optimum inside the limits, as y; it begins with the active limits of `found`, which is written over. */
static Outcome minimised(const Posed *problem, const Share *share, const Objective *objective, Optimum *found, Row y)
{
    int m = problem->demand->m;
    Quadratic cost;
    Row inside;
    Outcome outcome;
    quadratic(objective, &cost);
    free_part(problem, share->inside, share->value, inside);
    if (problem->demand->rows == 0)
        outcome = minimise(&cost, &problem->limits, &problem->cone, inside, found, found);
    else {
        const Reduction *reduction = &problem->reduction;
        Polytope limits;
        Cone cone = problem->cone;
        Row start;
        origin(reduction, m, share->value, start);
        polytope_on(&problem->limits, m, start, reduction->n, reduction->basis, &limits);
        if (cone.limit > 0.0)
            cone_on(&problem->cone, m, start, reduction->n, reduction->basis, &cone);
        outcome = minimise(&cost, &limits, &cone, inside, found, found);
    }
    if (outcome == DONE)
        joints(problem, found->z, share->value, y);
    return outcome;
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

/* y, with as much least squares blended in as descent requires; `near` has the limits that hold the rows. */
static Outcome guarded(Posed *problem, const Share *share, double mu, Row y, double *blended)
{
    const Demand *demand = problem->demand;
    Objective plain;
    Optimum best = share->near;
    Row least;
    double wanted[6];
    *blended = 0.0;
    if (problem->attempt == problem->wanted || demand->form->fraction < 0.0)
        return DONE;
    if (demand->cone.limit > 0.0 && share->value < 1.0) /* a share that is told loosely */
        return HAND_BACK;
    if (objective(problem, problem->wanted, share->value, &plain) == HAND_BACK)
        return HAND_BACK;
    calmed(&plain, mu);
    if (minimised(problem, share, &plain, &best, least) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < 6; i++)
        wanted[i] = share->value * problem->wanted[i];
    if (blend(demand->m, problem->A, wanted, mu, y, least, demand->form->fraction, blended) == HAND_BACK)
        return HAND_BACK;
    for (int j = 0; j < demand->m; j++)
        y[j] = (1.0 - *blended) * y[j] + *blended * least[j];
    return DONE;
}

/* A velocity inside the limits, and the share of the exact rows' speed that they allow; limits that contradict each
   other are handed back. */
static Outcome roomy(Posed *problem, Share *share)
{
    const Demand *demand = problem->demand;
    int m = demand->m;
    bool still = true;
    for (int j = 0; j < m; j++) {
        share->inside[j] = between(0.0, demand->lower[j], demand->upper[j]);
        still = still && share->inside[j] == 0.0;
    }
    if (!allows(demand, share->inside))
        return HAND_BACK;
    if (demand->metric != NULL)
        transformed(m, demand->metric->inverse, share->inside, share->inside);
    if (demand->rows == 0)
        return DONE;
    if (!still && counted(&problem->reduction, m, &problem->limits, &problem->cone, share->inside) == HAND_BACK)
        return HAND_BACK;
    return share_of(&problem->reduction, m, &problem->limits, &problem->cone, demand->dt, share);
}

/* How far a motion that limits require takes each exact row off its share of the speed. */
static void beside(const Posed *problem, const Share *share, Solution *solution)
{
    const Demand *demand = problem->demand;
    int m = demand->m;
    Row start, x;
    solution->rows = share->value < 1.0 ? demand->rows : 0; /* share->inside is told only below 1 */
    if (solution->rows == 0)
        return;
    moved(demand, problem->reduction.start, start);
    moved(demand, share->inside, x);
    for (int i = 0; i < demand->rows; i++) {
        double off = fabs((1.0 - share->value) * dot(m, demand->C[i], start));
        bool told = off > BESIDE_TOLERANCE * norm(m, demand->C[i]) * norm(m, x);
        solution->beside[i] = told ? off : 0.0;
    }
}

Outcome answered(const Demand *demand, const Row A[6], const double wanted[6], Solution *solution)
{
    Posed problem;
    Objective cost;
    Optimum found;
    Share share;
    Row x, y;
    int m = demand->m;
    found.met = share.near.met = share.fast = false;
    share.value = 1.0;
    double blended;
    if (posed(demand, A, wanted, &problem) == HAND_BACK || objective(&problem, problem.attempt, 1.0, &cost) == HAND_BACK)
        return HAND_BACK;
    centre(&cost, found.z);
    joints(&problem, found.z, 1.0, y);
    moved(demand, y, x);
    if (!all_finite(m, x))
        return HAND_BACK;
    if (allows(demand, x))
        memcpy(share.inside, y, (size_t)m * sizeof(double));
    else {
        if (roomy(&problem, &share) == HAND_BACK ||
            (demand->rows > 0 && objective(&problem, problem.attempt, share.value, &cost) == HAND_BACK))
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
    if (guarded(&problem, &share, mu, y, &blended) == HAND_BACK)
        return HAND_BACK;
    moved(demand, y, x);
    reported(demand, A, wanted, &cost, x, &share, &found, blended, solution);
    beside(&problem, &share, solution);
    return DONE;
}
