/* Many ticks at once, and what is told of each. */

#include "boundary.h"

/* velocity/problem.py: whether a joint only slides. */
static bool is_prismatic(int m, const Row J[6])
{
    Row turning = {0.0}, moving = {0.0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < m; j++) {
            turning[j] += J[i][j] * J[i][j];
            moving[j] += J[3 + i][j] * J[3 + i][j];
        }
    for (int j = 0; j < m; j++)
        if (sqrt(turning[j]) <= SLIDING * sqrt(moving[j]) && moving[j] > 0.0)
            return true;
    return false;
}

/* ticks(J, s, roots, lower, upper, posture, POLICY, (T, its inverse) or None, velocity, residual, told, records): N rows,
   each a tick without dt. Written of each: velocity and residual; whether it is a closed form and no more (PLAIN), more
   than that (RECORDED, and then its record) or Python's (0), as a row with a prismatic joint and no metric is, which has
   a metric of its own there; method, status, scale, damping, guard. */
enum { PLAIN = 1, RECORDED = 2 };

PyObject *batch_ticks(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    enum { J, TWIST, ROOT, LOWER, UPPER, POSTURE, OF_LAW, METRIC, VELOCITY, RESIDUAL, TOLD_ROWS, RECORDS, COUNT };
    static const int DIMENSIONS[COUNT] = {3, 2, 3, 2, 2, 2, 0, 0, 2, 2, 2, 2};
    Demand shared = {.posture = {0.0}};
    Form form;
    Metric measure;
    PyArrayObject *arrays[COUNT];
    bool good = count == COUNT && policy(arguments[OF_LAW], &shared, &form);
    npy_intp n = 0, m = 0;
    for (int i = 0; good && i < COUNT; i++) {
        arrays[i] = NULL;
        if (i == OF_LAW || i == METRIC || (i == POSTURE && arguments[i] == Py_None))
            continue;
        good = PyArray_Check(arguments[i]);
        arrays[i] = (PyArrayObject *)arguments[i];
        good = good && PyArray_TYPE(arrays[i]) == NPY_DOUBLE && PyArray_NDIM(arrays[i]) == DIMENSIONS[i] &&
               (i < VELOCITY ? PyArray_ISBEHAVED_RO(arrays[i]) : PyArray_ISCARRAY(arrays[i]));
        if (good && i == J) {
            n = PyArray_DIM(arrays[J], 0);
            m = PyArray_DIM(arrays[J], 2);
        }
        npy_intp width = i == TWIST || i == ROOT || i == RESIDUAL ? 6 : i == TOLD_ROWS ? TOLD : i == RECORDS ? RECORD : m;
        good = good && PyArray_DIM(arrays[i], 0) == n && PyArray_DIM(arrays[i], DIMENSIONS[i] - 1) == width &&
               (DIMENSIONS[i] == 2 || PyArray_DIM(arrays[i], 1) == 6);
    }
    good = good && m >= 1 && m <= MOST && (arguments[METRIC] == Py_None || metric(arguments[METRIC], (int)m, &measure));
    if (!good)
        return refused("ticks(J, s, roots, lower, upper, posture, " POLICY ", (T, inverse) or None, velocity, residual, "
                       "told, records)");
    shared.m = (int)m;
    shared.has_posture = arrays[POSTURE] != NULL;
    shared.metric = arguments[METRIC] != Py_None ? &measure : NULL;
    Py_BEGIN_ALLOW_THREADS
    Demand demand = shared;
    Solution solution;
    for (npy_intp row = 0; row < n; row++) {
        double *told = (double *)PyArray_DATA(arrays[TOLD_ROWS]) + row * TOLD;
        copied(arrays[J], row, 6, shared.m, MOST, demand.J[0]);
        copied(arrays[TWIST], row, 1, 6, 6, demand.s);
        copied(arrays[ROOT], row, 6, 6, 6, demand.root[0]);
        copied(arrays[LOWER], row, 1, shared.m, MOST, demand.lower);
        copied(arrays[UPPER], row, 1, shared.m, MOST, demand.upper);
        if (shared.has_posture)
            copied(arrays[POSTURE], row, 1, shared.m, MOST, demand.posture);
        told[0] = 0.0;
        if ((shared.metric == NULL && is_prismatic(shared.m, (const Row *)demand.J)) ||
            solve(&demand, &solution) == HAND_BACK)
            continue;
        memcpy((double *)PyArray_DATA(arrays[VELOCITY]) + row * m, solution.velocity, (size_t)m * sizeof(double));
        memcpy((double *)PyArray_DATA(arrays[RESIDUAL]) + row * 6, solution.residual, 6 * sizeof(double));
        told[0] = is_plain(&solution) ? PLAIN : RECORDED;
        told[1] = solution.method;
        told[2] = status(&solution);
        told[3] = solution.scale;
        told[4] = solution.damping;
        told[5] = solution.blended;
        if (told[0] == RECORDED)
            memcpy((double *)PyArray_DATA(arrays[RECORDS]) + row * RECORD, &solution, sizeof solution);
    }
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

/* solution(record): the fields of a VelocitySolution that `ticks` recorded. */
PyObject *batch_solution(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Solution solution;
    if (count != 1 || !vector(arguments[0], (int)RECORD, (double *)&solution) || !within(solution.m, 1, MOST) ||
        !within(solution.limits, 0, MOST) || !within((int)solution.method, CLOSED_FORM, QP))
        return refused("solution(record)");
    return fields(solution.m, &solution);
}
