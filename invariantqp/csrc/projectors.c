/* Twin of systems/projectors.py where it is well conditioned: P on twists in S along Z, P* = (I - P)' on wrenches.

       P = U (K'U)^-1 K',   U, K orthonormal bases of S and of Z* = the orthogonal complement of Z, lengths in S's own unit

   What is less well conditioned, or is to be refused, is Python's. */

#include "boundary.h"

/* The least ratio of singular values of given columns, the least sine between S and Z, the least share of a length that is
   left beside those before it, how far a metric may be from symmetric; |h| may be so many units. */
static const double LEAST_SIGMA = 1e-5, LEAST_SINE = 1e-3, LEAST_LEFT = 1e-5, SYMMETRIC = 1e-13, LONGEST_PITCH = 1e2;

/* Rows of U become an orthonormal basis of (6, m) columns, lengths in `unit`, and of what is orthogonal to them; the rank,
   or -1 where rounding would decide it. */
static int basis(int m, const Row *columns, double unit, Row U[6])
{
    Row A[6];
    Spectrum found;
    int rank = m < 6 ? m : 6;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < m; j++)
            A[i][j] = columns[i][j] / (i < 3 ? 1.0 : unit);
    if (m > 0 && (spectrum(6, m, (const Row *)A, NULL, NULL, &found) == HAND_BACK ||
                  !(found.sigma[rank - 1] > LEAST_SIGMA * found.sigma[0])))
        return -1;
    memset(U, 0, 6 * sizeof(Row));
    for (int k = 0; k < rank; k++)
        memcpy(U[k], found.U[k], sizeof found.U[k]);
    completed(6, rank, U);
    return rank;
}

/* Whether M is symmetric and positive definite, by more than rounding. */
static bool is_definite(const Row M[6])
{
    Row L[6];
    memcpy(L, M, sizeof L);
    bool good = true;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < i; j++)
            good = good && fabs(M[i][j] - M[j][i]) <= SYMMETRIC * sqrt(fabs(M[i][i] * M[j][j]));
    good = good && factored(6, L);
    for (int i = 0; good && i < 6; i++)
        good = L[i][i] > LEAST_LEFT * sqrt(M[i][i]);
    return good;
}

/* Z by a pitch h, or where h is NAN by what is `given`: a (6, 6) metric, or where n is not -1 (6, n) columns of Z. The
   columns are wrenches that leave S free, or span S. */
Outcome projectors(int m, const Row columns[6], bool wrenches, double h, int n, const Row given[6], Projectors *found)
{
    Row U[6], Z[6] = {{0.0}}, rest[6], G[6];
    double unit = m > 0 ? own_unit(m, columns) : 1.0, GK[6][WIDE];
    int k = unit > 0.0 ? basis(m, columns, unit, U) : -1;
    if (k < 0)
        return HAND_BACK;
    if (wrenches) { /* what is orthogonal to them, in metres, and then in a unit of its own */
        for (int i = 0; i < 6; i++)
            for (int j = k; j < 6; j++)
                rest[i][j - k] = U[j][i] / (i < 3 ? 1.0 : unit);
        k = 6 - k;
        unit = k > 0 ? own_unit(k, (const Row *)rest) : 1.0;
        if (!(unit > 0.0) || basis(k, (const Row *)rest, unit, U) != k)
            return HAND_BACK;
    }
    double scale[6] = {1.0, 1.0, 1.0, unit, unit, unit};
    if (n >= 0) {
        if (n != 6 - k || basis(n, given, unit, rest) != n)
            return HAND_BACK;
        for (int i = 0; i < 6; i++) /* Z* first */
            memcpy(Z[i], rest[(i + n) % 6], sizeof Z[i]);
    } else {
        h /= unit;
        if (isnan(h) ? !is_definite(given) : !(fabs(h) <= LONGEST_PITCH))
            return HAND_BACK;
        for (int a = 0; a < k; a++) { /* Z* is Q_h S or M S */
            for (int i = 0; i < 6; i++) {
                double sum = 0.0;
                for (int j = 0; j < 6 && isnan(h); j++)
                    sum += given[i][j] * scale[i] * scale[j] * U[a][j];
                Z[a][i] = isnan(h) ? sum : i < 3 ? U[a][3 + i] - 2.0 * h * U[a][i] : U[a][i - 3];
            }
            for (int again = 0; again < 3; again++) {
                double length = norm(6, Z[a]);
                if (!(length > (again == 1 ? LEAST_LEFT : TINY)))
                    return HAND_BACK;
                for (int i = 0; i < 6; i++)
                    Z[a][i] /= length;
                for (int b = 0; b < a && again < 2; b++) {
                    double share = dot(6, Z[a], Z[b]);
                    for (int i = 0; i < 6; i++)
                        Z[a][i] -= share * Z[b][i];
                }
            }
        }
        completed(6, k, Z);
    }
    for (int a = 0; a < k; a++) {
        for (int b = 0; b < k; b++)
            GK[a][b] = G[a][b] = dot(6, Z[a], U[b]);
        memcpy(GK[a] + k, Z[a], 6 * sizeof(double));
    }
    Spectrum sines;
    static const double NONE[6] = {0.0};
    if (k > 0 && (spectrum(k, k, (const Row *)G, NONE, NULL, &sines) == HAND_BACK || !(sines.sigma[k - 1] > LEAST_SINE) ||
                  !(eliminated(k, 6, GK) > 0.0)))
        return HAND_BACK;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            double sum = k == 6 && i == j ? 1.0 : 0.0;
            for (int a = 0; a < k && k < 6; a++)
                sum += U[a][i] * GK[a][k + j];
            found->motion[i][j] = sum * scale[i] / scale[j];
            found->force[j][i] = ((i == j) - sum) / scale[j] * scale[i];
        }
    for (int i = 0; i < 6; i++)
        for (int a = 0; a < 6; a++)
            if (a < k)
                found->freedoms[i][a] = U[a][i] * scale[i];
            else {
                found->complement[i][a - k] = Z[a][i] * scale[i];
                found->constraints[i][a - k] = U[a][i] / scale[i];
            }
    found->k = k;
    found->norm = k > 0 ? 1.0 / sines.sigma[k - 1] : 0.0;
    found->unit = unit;
    return DONE;
}

/* projectors(S, wrenches, h, complement, metric), one of the first two and one of the others not None: the fields of
   DualProjectors in order, or None where Python has to find them. */
PyObject *dual_projectors(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    if (count != 5)
        return refused("projectors(S, wrenches, h, complement, metric)");
    PyObject *S = arguments[0], *wrenches = arguments[1], *pitch = arguments[2], *complement = arguments[3];
    PyObject *columns = S == Py_None ? wrenches : S;
    Row A[6], given[6] = {{0.0}};
    Projectors found;
    double h = NAN, diagonal[6];
    int m = joints_of(columns), n = -1;
    bool good = (m > 0 || S != Py_None) && matrix(columns, 6, m, MOST, A[0]);
    if (pitch != Py_None) {
        good = good && PyFloat_Check(pitch) && isfinite(h = PyFloat_AsDouble(pitch));
    } else if (complement != Py_None) {
        n = joints_of(complement);
        good = good && matrix(complement, 6, n, MOST, given[0]);
    } else if (vector(arguments[4], 6, diagonal)) {
        for (int i = 0; i < 6; i++)
            given[i][i] = diagonal[i];
    } else {
        good = good && matrix(arguments[4], 6, 6, MOST, given[0]);
    }
    for (int i = 0; i < 6 && good; i++)
        good = usual(m, A[i]) && usual(n < 0 ? 6 : n, given[i]);
    if (!good || projectors(m, (const Row *)A, S == Py_None, h, n, (const Row *)given, &found) == HAND_BACK)
        return left_to_python();
    int k = found.k;
    return Py_BuildValue("(NNNNNdd)", new_matrix(6, 6, 6, found.motion[0]), new_matrix(6, 6, 6, found.force[0]),
                         new_matrix(6, k, 6, found.freedoms[0]), new_matrix(6, 6 - k, 6, found.complement[0]),
                         new_matrix(6, 6 - k, 6, found.constraints[0]), found.norm, found.unit);
}
