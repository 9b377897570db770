/* Twin of systems/pseudoinverses.py where it is well conditioned: J^{+h} for (6, m) twists of rank m or 6.

       J = U diag(sigma) V',   J^{+h} = V diag(1/sigma) (U'Q_h U)^-1 U'Q_h,   which is V diag(1/sigma) U' for rank 6

   Columns of a system of rank m have length one first, and lengths are measured in a unit of the twists' own. What is
   less well conditioned than this is Python's, which says how many digits are correct. */

#include "boundary.h"

/* The least singular value, and the least pivot of U'Q_h U, that are answered here; |h| may be so many units. */
static const double LEAST_SIGMA = 1e-5, LEAST_PIVOT = 1e-4, LONGEST_PITCH = 1e2;

/* The power of two nearest |J_v| / |J_omega|, 1 where either vanishes, 0 where it nearly does. */
double own_unit(int m, const Row J[6])
{
    double w = norm_of_rows(3, m, J), v = norm_of_rows(3, m, J + 3);
    if (w == 0.0 || v == 0.0)
        return 1.0;
    if (!(w * 1e6 >= v && v * 1e6 >= w))
        return 0.0;
    return exp2(nearbyint(log2(v) - log2(w)));
}

static Outcome inverse_of(int m, Row J[6], double h, double X[MOST][6])
{
    Spectrum found;
    Row lengths;
    double unit = own_unit(m, (const Row *)J), MR[6][WIDE];
    int r = m < 6 ? m : 6;
    if (unit == 0.0 || !(fabs(h) <= LONGEST_PITCH * unit))
        return HAND_BACK;
    for (int j = 0; j < m; j++)
        lengths[j] = 0.0;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < m; j++) {
            J[i][j] /= i < 3 ? 1.0 : unit;
            lengths[j] += J[i][j] * J[i][j];
        }
    for (int j = 0; j < m; j++) {
        lengths[j] = m <= 6 ? sqrt(lengths[j]) : 1.0;
        if (!(lengths[j] > 0.0))
            return HAND_BACK;
        for (int i = 0; i < 6; i++)
            J[i][j] /= lengths[j];
    }
    if (spectrum(6, m, (const Row *)J, NULL, NULL, &found) == HAND_BACK || !(found.sigma[r - 1] > LEAST_SIGMA * found.sigma[0]))
        return HAND_BACK;
    h /= unit;
    for (int k = 0; k < r; k++) { /* U'Q_h U beside U'Q_h, or U' alone */
        double *R = MR[k] + (r == 6 ? 0 : r);
        for (int i = 0; i < 3; i++) {
            const double *u = found.U[k];
            R[i] = r == 6 ? u[i] : u[3 + i] - 2.0 * h * u[i];
            R[3 + i] = r == 6 ? u[3 + i] : u[i];
        }
        for (int l = 0; l < r && r < 6; l++)
            MR[k][l] = dot(6, R, found.U[l]);
    }
    if (r < 6 && !(eliminated(r, 6, MR) > LEAST_PIVOT))
        return HAND_BACK;
    for (int j = 0; j < m; j++)
        for (int i = 0; i < 6; i++) {
            double sum = 0.0;
            for (int k = 0; k < r; k++)
                sum += found.V[k][j] / found.sigma[k] * MR[k][i + (r == 6 ? 0 : r)];
            X[j][i] = sum / lengths[j] / (i < 3 ? 1.0 : unit);
        }
    return DONE;
}

/* pseudoinverse(J, h): (m, 6), or None where Python has to find it. */
PyObject *pseudoinverse(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    if (count != 2)
        return refused("pseudoinverse(J, h)");
    int m = joints_of(arguments[0]);
    double h = PyFloat_AsDouble(arguments[1]), X[MOST][6];
    Row J[6];
    bool good = !PyErr_Occurred() && m > 0 && matrix(arguments[0], 6, m, MOST, J[0]);
    for (int i = 0; i < 6 && good; i++)
        good = usual(m, J[i]);
    if (!good || inverse_of(m, J, h, X) == HAND_BACK)
        return left_to_python();
    return new_matrix(m, 6, 6, X[0]);
}
