/* Twin of velocity/exact.py: the velocities that meet exact rows C x = e.

       y = start + a (full - start) + B z,   full = C'(CC')^-1 e,   CB = 0,   B'B = I,
       0 <= a <= 1 the share of the demanded speed, start zero where standing still is allowed

   Rows that are parts of the twist, C = D J, are first made orthonormal in the measure. Rows that depend on each other
   or that the joints cannot meet are handed back. */

#include "core.h"
#include <string.h>

/* Rows whose smallest singular value is below this share of the largest are handed back: Python decides on them. */
static const double DEPENDENT_ROWS = 1e-3;

/* D root^-1, for root = [[R, 0], [P, S]] or any other that is invertible; by elimination with pivots. */
Outcome over_root(int k, const double (*D)[6], const double root[6][6], double (*M)[6])
{
    double L[6][6 + MOST_ROWS]; /* root' X = D' */
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < 6; j++)
            L[i][j] = root[j][i];
        for (int j = 0; j < k; j++)
            L[i][6 + j] = D[j][i];
    }
    for (int c = 0; c < 6; c++) {
        int pivot = c;
        for (int i = c + 1; i < 6; i++)
            if (fabs(L[i][c]) > fabs(L[pivot][c]))
                pivot = i;
        if (L[pivot][c] == 0.0)
            return HAND_BACK;
        for (int j = c; j < 6 + k; j++) {
            double swap = L[c][j];
            L[c][j] = L[pivot][j];
            L[pivot][j] = swap;
        }
        for (int i = 0; i < 6; i++) {
            double factor = i == c ? 0.0 : L[i][c] / L[c][c];
            for (int j = c; j < 6 + k && factor != 0.0; j++)
                L[i][j] -= factor * L[c][j];
        }
    }
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < k; j++)
            M[j][i] = L[i][6 + j] / L[i][i];
    return DONE;
}

/* The rows C on y and their demands, combined so that parts of the twist are orthonormal in the measure, by the Cholesky
   factor of their Gram matrix: the same singular values as Python's. Rows beside them become as long as all of those. */
static Outcome whitened(const Demand *demand, const Row *given, Row *C, double *e)
{
    int k = demand->rows, m = demand->m;
    double M[MOST_ROWS][6], L[MOST_ROWS][MOST_ROWS], square = 0.0;
    bool twist[MOST_ROWS], any = false;
    memcpy(C, given, (size_t)k * sizeof(Row));
    memcpy(e, demand->e, (size_t)k * sizeof(double));
    for (int i = 0; i < k && demand->of_twist; i++)
        any = (twist[i] = dot(6, demand->D[i], demand->D[i]) > 0.0) || any;
    if (!any)
        return DONE;
    if (over_root(k, demand->D, demand->root, M) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < k; i++) {
        double size = twist[i] ? norm(6, M[i]) : norm(m, C[i]);
        if (!(size > 0.0))
            return HAND_BACK;
        for (int j = 0; j < 6; j++)
            M[i][j] /= size;
        for (int j = 0; j < m; j++)
            C[i][j] /= size;
        e[i] /= size;
        for (int j = 0; j <= i; j++)
            L[i][j] = dot(6, M[i], M[j]);
        for (int j = 0; j < i && twist[i]; j++)
            L[i][j] = twist[j] ? (L[i][j] - dot(j, L[i], L[j])) / L[j][j] : 0.0;
        if (!twist[i])
            continue;
        double pivot = L[i][i] - dot(i, L[i], L[i]);
        if (!(pivot > DEPENDENT_ROWS * DEPENDENT_ROWS))
            return HAND_BACK;
        L[i][i] = sqrt(pivot);
        for (int l = 0; l < i; l++) {
            for (int j = 0; j < m; j++)
                C[i][j] -= L[i][l] * C[l][j];
            e[i] -= L[i][l] * e[l];
        }
        for (int j = 0; j < m; j++)
            C[i][j] /= L[i][i];
        e[i] /= L[i][i];
        square += dot(m, C[i], C[i]);
    }
    for (int i = 0; i < k && square > 0.0; i++) {
        double length = twist[i] ? 1.0 : sqrt(square);
        for (int j = 0; j < m; j++)
            C[i][j] *= length;
        e[i] *= length;
    }
    return DONE;
}

/* `given` is C on y: the rows of the demand, or those rows times T. */
Outcome reduce(const Demand *demand, const Row *given, Reduction *reduction)
{
    int k = demand->rows, m = demand->m;
    Row C[MOST_ROWS];
    double e[MOST_ROWS], met = 0.0, square = 0.0, sizes = 0.0;
    Spectrum found;
    /* Fewer rows than joints: some directions are left, and none of the rows is too much. */
    if (k >= m || (demand->row_rank >= 0 && demand->row_rank < k) || whitened(demand, given, C, e) == HAND_BACK ||
        spectrum(k, m, (const Row *)C, e, NULL, &found) == HAND_BACK)
        return HAND_BACK;
    if (!(found.sigma[k - 1] > DEPENDENT_ROWS * found.sigma[0]))
        return HAND_BACK;
    for (int j = 0; j < m; j++)
        reduction->full[j] = reduction->start[j] = 0.0;
    for (int i = 0; i < k; i++) {
        double y = found.wanted[i] / found.sigma[i];
        for (int j = 0; j < m; j++)
            reduction->full[j] += y * found.V[i][j];
        met += found.wanted[i] * found.wanted[i];
        square += y * y;
        sizes += found.sigma[i] * found.sigma[i];
    }
    reduction->n = m - k;
    for (int i = 0; i < m; i++)
        memcpy(i < k ? reduction->span[i] : reduction->basis[i - k], found.V[i], (size_t)m * sizeof(double));
    reduction->effort = met > 0.0 ? sqrt(sizes) * sqrt(square) / sqrt(met) : 1.0;
    reduction->bend = sqrt(sizes) / found.sigma[k - 1];
    return DONE;
}

/* y where z = 0. */
void origin(const Reduction *reduction, int m, double share, Row y)
{
    for (int j = 0; j < m; j++)
        y[j] = reduction->start[j] + share * (reduction->full[j] - reduction->start[j]);
}

/* y = origin + B z */
void joint(const Reduction *reduction, int m, const double *z, double share, Row y)
{
    origin(reduction, m, share, y);
    for (int i = 0; i < reduction->n; i++)
        for (int j = 0; j < m; j++)
            y[j] += z[i] * reduction->basis[i][j];
}

/* The z of a y with that share. */
void freed(const Reduction *reduction, int m, const Row y, double share, Row z)
{
    Row d;
    origin(reduction, m, share, d);
    for (int j = 0; j < m; j++)
        d[j] = y[j] - d[j];
    for (int i = 0; i < reduction->n; i++)
        z[i] = dot(m, reduction->basis[i], d);
}
