/* Twin of pose/newton.py, _exact_step: the step that meets exact demands first, C x = b.

       x_1 = argmin 1/2 |b - C x|^2 + 1/2 lambda |b|^2 |x|^2
       x   = argmin 1/2 |r - A x|^2 + 1/2 mu |x|^2   over   C x = C x_1,  x = x_1 + B z           both inside the limits */

#include "pose.h"
#include <string.h>

/* A singular value within this factor of the tolerance might be on its other side in Python. */
static const double CLOSE = 10.0;

/* y += M'z for n rows of M */
static void added(int n, int m, const Row *M, const double *z, Row y)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j < m; j++)
            y[j] += z[i] * M[i][j];
}

/* B'A'(r - A x), B' with n rows */
static void pull(int m, const Linearization *state, const Row x, int n, const Row *B, double *g)
{
    Row gradient = {0.0};
    double left[6];
    for (int i = 0; i < 6; i++)
        left[i] = state->r[i] - dot(m, state->A[i], x);
    added(6, m, state->A, left, gradient);
    for (int i = 0; i < n; i++)
        g[i] = dot(m, B[i], gradient);
}

/* The size of the multiplier y of the rows: C'y is what is left of the gradient where no limit holds a joint. `whole` is the
   spectrum of the rows of all joints. */
static Outcome multiplier(int m, const Linearization *state, const Row lower, const Row upper, const Row x, const Spectrum *whole,
                          double *size)
{
    int n = 0;
    Row C[MOST_ROWS], each[MOST], all, gradient;
    double none[MOST_ROWS] = {0.0};
    Spectrum free;
    for (int j = 0; j < m; j++) {
        memset(each[j], 0, sizeof(Row));
        each[j][j] = 1.0;
    }
    pull(m, state, x, m, (const Row *)each, all);
    for (int j = 0; j < m; j++) {
        double margin = AT_LIMIT * (1.0 + fabs(x[j]));
        if (!(x[j] > lower[j] + margin && x[j] < upper[j] - margin))
            continue;
        for (int i = 0; i < state->rows; i++)
            C[i][n] = state->C[i][j];
        gradient[n++] = all[j];
    }
    *size = 0.0;
    if (n == 0)
        return DONE;
    if (n < m && spectrum(state->rows, n, (const Row *)C, none, NULL, &free) == HAND_BACK)
        return HAND_BACK;
    const Spectrum *found = n < m ? &free : whole;
    for (int i = 0; i < n && i < state->rows; i++) {
        if (!(found->sigma[i] > EXACT_ROW_TOLERANCE * found->sigma[0]))
            break;
        double y = dot(n, found->V[i], gradient) / found->sigma[i];
        *size += y * y;
    }
    *size = sqrt(*size);
    return DONE;
}

/* The step inside the box, and the multiplier of the rows. */
Outcome exact_step(int m, const Linearization *state, double damping, const Row lower, const Row upper, Row x,
                   double *price)
{
    int k = state->rows, rank = 0;
    double size = 0.0, square = 0.0, missed = dot(k, state->b, state->b);
    Spectrum found;
    Objective rows;
    Row first, H[MOST], g, z;
    if (spectrum(k, m, state->C, state->b, NULL, &found) == HAND_BACK || !(found.sigma[0] > 0.0))
        return HAND_BACK;
    for (int i = 0; i < 6; i++)
        size += dot(m, state->A[i], state->A[i]);
    for (int i = 0; i < k; i++) {
        double share = found.sigma[i] / found.sigma[0];
        if (i < m && share * CLOSE > EXACT_ROW_TOLERANCE && share < CLOSE * EXACT_ROW_TOLERANCE)
            return HAND_BACK;
        rank += i < m && share > EXACT_ROW_TOLERANCE;
        square += dot(m, state->C[i], state->C[i]);
    }
    double least = fmax(damping * missed, ROW_FLOOR * found.sigma[0] * found.sigma[0]);
    rows.n = m;
    rows.regular = NULL;
    rows.V = (const Row *)found.V;
    for (int i = 0; i < m; i++) {
        double sigma = i < rank ? found.sigma[i] : 0.0;
        rows.weights[i] = sigma * sigma + least;
        rows.optimum[i] = i < rank ? sigma * found.wanted[i] / rows.weights[i] : 0.0;
    }
    centre(&rows, first);
    const Row *B = (const Row *)found.V + rank;
    int n = m - rank;
    Row AB[MOST]; /* column by column */
    for (int l = 0; l < n; l++)
        for (int i = 0; i < 6; i++)
            AB[l][i] = dot(m, state->A[i], B[l]);
    for (int l = 0; l < n; l++)
        for (int i = 0; i <= l; i++)
            H[l][i] = dot(6, AB[l], AB[i]) + (i == l ? fmax(2.0 * damping * state->f, QP_FLOOR * size) : 0.0);
    if (!factored(n, H))
        return HAND_BACK;
    pull(m, state, first, n, B, g);
    solved(n, (const Row *)H, g, z);
    memcpy(x, first, sizeof(Row));
    added(n, m, B, z, x);
    if (!is_inside(m, x, lower, upper)) {
        Quadratic problem;
        Polytope box = {.count = m, .box = true}, limits;
        Row still = {0.0};
        quadratic(&rows, &problem);
        if (!is_inside(m, first, lower, upper) && minimise_in_box(&problem, lower, upper, first) == HAND_BACK)
            return HAND_BACK;
        memset(z, 0, sizeof(Row));
        if (n > 0) {
            pull(m, state, first, n, B, g);
            quadratic_of(n, (const Row *)H, g, &problem);
            memcpy(box.lower, lower, (size_t)m * sizeof(double));
            memcpy(box.upper, upper, (size_t)m * sizeof(double));
            polytope_on(&box, m, first, first, n, B, &limits);
            if (minimise_from(&problem, &limits, still, z) == HAND_BACK)
                return HAND_BACK;
        }
        memcpy(x, first, sizeof(Row));
        added(n, m, B, z, x);
        for (int j = 0; j < m; j++)
            x[j] = between(x[j], lower[j], upper[j]);
    }
    if (multiplier(m, state, lower, upper, x, &found, price) == HAND_BACK)
        return HAND_BACK;
    *price = fmin(*price, DEAREST * sqrt(2.0 * size * state->f / square));
    return DONE;
}
