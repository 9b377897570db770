/* Twin of velocity/qp/quadratic.py, active.py and primal.py for a box: the optimum on an active set, from the root.

       minimise 1/2 |K (z - z*)|^2   over   lower <= z <= upper
       K'K d + y = 0,  d = z - z*,   y > 0 at an upper limit, y < 0 at a lower one

   Python asks a solver for the active set first; here it begins with the limits that z* exceeds. Both then correct it
   until the optimum on it is inside the other limits, with multipliers of the right sign: the problem is strictly
   convex, so both find the same. */

#include "core.h"

/* Corrections of the active set for each limit, at most, before the primal method takes over. */
#define CORRECTIONS 3
/* An optimum this close to a limit that is not active, relative to it, might be taken for active by Python. */
static const double UNDECIDED = 1e-7;
/* A multiplier of the wrong sign by less than this share of |K_j| |K d| is rounding of their product. */
static const double WRONG_SIGN = 1e-14;

/* Columns of K, each of length n. */
typedef struct {
    int n;
    Row column[MOST];
} Root;

/* The z of least |K z - wanted| for f columns of K, by Householder reflections of both; HAND_BACK at rank below f. */
static Outcome least(int n, int f, Row *column, double *wanted, double *z)
{
    double diagonal[MOST];
    for (int k = 0; k < f; k++) {
        double *v = column[k], length = norm(n - k, v + k);
        if (!(length > 0.0))
            return HAND_BACK;
        double alpha = v[k] > 0.0 ? -length : length;
        v[k] -= alpha;
        double scale = -1.0 / (alpha * v[k]);
        for (int j = k + 1; j <= f; j++) {
            double *c = j < f ? column[j] : wanted;
            double share = scale * dot(n - k, v + k, c + k);
            for (int i = k; i < n; i++)
                c[i] -= share * v[i];
        }
        diagonal[k] = alpha;
    }
    for (int k = f - 1; k >= 0; k--) {
        z[k] = wanted[k];
        for (int j = k + 1; j < f; j++)
            z[k] -= column[j][k] * z[j];
        z[k] /= diagonal[k];
    }
    return DONE;
}

/* The d of least |K d| on the active limits, and the multipliers. */
static Outcome on_active(const Root *K, const Row lower, const Row upper, const int *side, Row d, Row y)
{
    int n = K->n, f = 0, free[MOST];
    Row columns[MOST], wanted = {0.0}, found;
    for (int j = 0; j < n; j++) {
        y[j] = 0.0;
        if (side[j] == 0) {
            for (int i = 0; i < n; i++)
                columns[f][i] = K->column[j][i];
            free[f++] = j;
            continue;
        }
        d[j] = side[j] > 0 ? upper[j] : lower[j];
        for (int i = 0; i < n; i++)
            wanted[i] -= K->column[j][i] * d[j];
    }
    if (f > 0 && least(n, f, columns, wanted, found) == HAND_BACK)
        return HAND_BACK;
    for (int k = 0; k < f; k++)
        d[free[k]] = found[k];
    if (f == n)
        return DONE;
    Row left = {0.0};
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++)
            left[i] += K->column[j][i] * d[j];
    for (int j = 0; j < n; j++)
        if (side[j] != 0)
            y[j] = -dot(n, K->column[j], left);
    return DONE;
}

/* The limit whose multiplier has the wrong sign by most; -1 for none. Late in a search the first one is taken (Bland's
   rule), so that no active set repeats. */
static int weakest(const Root *K, const int *side, const Row d, const Row y, bool late)
{
    int n = K->n, found = -1;
    Row left = {0.0};
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++)
            left[i] += K->column[j][i] * d[j];
    double most = 0.0, size = norm(n, left);
    for (int j = 0; j < n; j++) {
        double wrong = -side[j] * y[j] - WRONG_SIGN * norm(n, K->column[j]) * size;
        if (wrong > most && (found < 0 || !late)) {
            most = wrong;
            found = j;
        }
    }
    return found;
}

/* The optimum d and its multipliers, after correcting the active set; HAND_BACK where that does not end. */
static Outcome checked(const Root *K, const Row lower, const Row upper, int *side, Row d, Row y)
{
    int n = K->n;
    for (int count = 0; count < CORRECTIONS * n; count++) {
        if (on_active(K, lower, upper, side, d, y) == HAND_BACK)
            return HAND_BACK;
        int worst = -1;
        double outside = 0.0;
        for (int j = 0; j < n; j++) {
            double edge = FEASIBLE * (1.0 + fmin(fabs(lower[j]), fabs(upper[j])));
            double by = fmax(d[j] - upper[j], lower[j] - d[j]) - edge;
            if (side[j] == 0 && by > outside) {
                outside = by;
                worst = j;
            }
        }
        if (worst >= 0) {
            side[worst] = d[worst] > upper[worst] ? 1 : -1;
            continue;
        }
        int wrong = weakest(K, side, d, y, false);
        if (wrong < 0)
            return DONE;
        side[wrong] = 0;
    }
    return HAND_BACK;
}

/* The same by steps that stay inside, from a d that is inside: every step lowers the objective or changes the set. */
static Outcome from_inside(const Root *K, const Row lower, const Row upper, int *side, Row d, Row y)
{
    int n = K->n;
    Row best, step;
    for (int j = 0; j < n; j++)
        side[j] = 0;
    for (int count = 0; count < STEPS * n; count++) {
        if (on_active(K, lower, upper, side, best, y) == HAND_BACK)
            return HAND_BACK;
        for (int j = 0; j < n; j++)
            step[j] = best[j] - d[j];
        double first = 1.0, length = norm(n, step);
        int meets = -1;
        for (int j = 0; j < n; j++) {
            if (side[j] != 0 || fabs(step[j]) <= PARALLEL * length)
                continue;
            double share = ((step[j] > 0.0 ? upper[j] : lower[j]) - d[j]) / step[j];
            if (share < first) {
                first = share;
                meets = j;
            }
        }
        if (meets >= 0) {
            for (int j = 0; j < n; j++)
                d[j] += fmax(0.0, first) * step[j];
            side[meets] = step[meets] > 0.0 ? 1 : -1;
            continue;
        }
        for (int j = 0; j < n; j++)
            d[j] = best[j];
        int wrong = weakest(K, side, d, y, count > 2 * n);
        if (wrong < 0)
            return DONE;
        side[wrong] = 0;
    }
    return HAND_BACK;
}

Outcome minimise(const Objective *objective, const Row lower, const Row upper, Optimum *found)
{
    int n = objective->n, side[MOST];
    bool inside = true;
    Root K = {.n = n};
    Row z, low, high, d;
    centre(objective, z);
    found->met = false;
    for (int j = 0; j < n; j++) {
        low[j] = lower[j] - z[j];
        high[j] = upper[j] - z[j];
        side[j] = high[j] < 0.0 ? 1 : low[j] > 0.0 ? -1 : 0;
        inside = inside && side[j] == 0;
        found->z[j] = z[j];
        found->multipliers[j] = 0.0;
    }
    if (inside)
        return DONE;
    for (int i = 0; i < n; i++) {
        double root = sqrt(objective->weights[i]);
        for (int j = 0; j < n; j++)
            K.column[j][i] = root * objective->V[i][j];
    }
    if (checked(&K, low, high, side, d, found->multipliers) == HAND_BACK) {
        for (int j = 0; j < n; j++)
            d[j] = fmin(fmax(0.0, lower[j]), upper[j]) - z[j];
        if (from_inside(&K, low, high, side, d, found->multipliers) == HAND_BACK)
            return HAND_BACK;
    }
    for (int j = 0; j < n; j++) {
        double room = fmin(high[j] - d[j], d[j] - low[j]);
        if (side[j] == 0 && isfinite(room) && room <= UNDECIDED * (1.0 + fmin(fabs(low[j]), fabs(high[j]))))
            return HAND_BACK;
        found->met = found->met || found->multipliers[j] != 0.0;
        found->z[j] = z[j] + d[j];
    }
    return all_finite(n, found->z) ? DONE : HAND_BACK;
}
