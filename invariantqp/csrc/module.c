/* The functions that Python calls. Nothing is computed here. */

#define IMPORTS_NUMPY
#include "boundary.h"

/* How a policy is written in messages. */
#define POLICY "(threshold, ceiling, fixed, speed, (pitch, fraction, Z') or None)"

/* Read a policy; its form, if it has one, goes into `form`. */
static bool policy(PyObject *tuple, Demand *demand, Form *form)
{
    if (!PyTuple_Check(tuple) || PyTuple_Size(tuple) != 5)
        return false;
    demand->threshold = PyFloat_AsDouble(PyTuple_GetItem(tuple, 0));
    demand->ceiling = PyFloat_AsDouble(PyTuple_GetItem(tuple, 1));
    demand->fixed = PyFloat_AsDouble(PyTuple_GetItem(tuple, 2));
    demand->speed = PyFloat_AsDouble(PyTuple_GetItem(tuple, 3));
    demand->form = NULL;
    PyObject *given = PyTuple_GetItem(tuple, 4);
    if (given != Py_None) {
        if (!PyTuple_Check(given) || PyTuple_Size(given) != 3)
            return false;
        PyObject *Z = PyTuple_GetItem(given, 2);
        npy_intp count = PyArray_Check(Z) && PyArray_NDIM((PyArrayObject *)Z) == 2 ? PyArray_DIM((PyArrayObject *)Z, 0) : -1;
        if (count < 0 || count > 6 || !matrix(Z, (int)count, 6, 6, form->Z[0]))
            return false;
        form->pitch = PyFloat_AsDouble(PyTuple_GetItem(given, 0));
        form->fraction = PyFloat_AsDouble(PyTuple_GetItem(given, 1));
        form->count = (double)count;
        demand->form = form;
    }
    return !PyErr_Occurred();
}

/* Read exact rows: (A, b, of_twist or None, how many of them an arm can keep, or None). */
static bool exact(PyObject *tuple, Demand *demand)
{
    if (!PyTuple_Check(tuple) || PyTuple_Size(tuple) != 4)
        return false;
    PyObject *A = PyTuple_GetItem(tuple, 0), *D = PyTuple_GetItem(tuple, 2), *rank = PyTuple_GetItem(tuple, 3);
    bool good = PyArray_Check(A) && PyArray_NDIM((PyArrayObject *)A) == 2;
    npy_intp rows = good ? PyArray_DIM((PyArrayObject *)A, 0) : 0;
    if (rows < 1 || rows > MOST_ROWS)
        return false;
    demand->rows = (int)rows;
    demand->of_twist = D != Py_None;
    demand->row_rank = rank == Py_None ? -1 : (int)PyLong_AsLong(rank);
    return matrix(A, demand->rows, demand->m, MOST, demand->C[0]) &&
           vector(PyTuple_GetItem(tuple, 1), demand->rows, demand->e) &&
           (!demand->of_twist || matrix(D, demand->rows, 6, 6, demand->D[0]));
}

/* Read a speed limit: (J, limit, start). */
static bool cone(PyObject *tuple, Demand *demand)
{
    if (!PyTuple_Check(tuple) || PyTuple_Size(tuple) != 3)
        return false;
    demand->cone.limit = PyFloat_AsDouble(PyTuple_GetItem(tuple, 1));
    return demand->cone.limit > 0.0 && matrix(PyTuple_GetItem(tuple, 0), 3, demand->m, MOST, demand->cone.J[0]) &&
           vector(PyTuple_GetItem(tuple, 2), 3, demand->cone.start);
}

/* Read limits on combinations of joint velocities: (C, lower, upper). */
static bool limits(PyObject *tuple, Demand *demand)
{
    if (!PyTuple_Check(tuple) || PyTuple_Size(tuple) != 3)
        return false;
    PyObject *C = PyTuple_GetItem(tuple, 0);
    bool good = PyArray_Check(C) && PyArray_NDIM((PyArrayObject *)C) == 2;
    npy_intp rows = good ? PyArray_DIM((PyArrayObject *)C, 0) : 0;
    if (rows < 1 || rows > MOST)
        return false;
    demand->limits = (int)rows;
    return matrix(C, demand->limits, demand->m, MOST, demand->G[0]) &&
           vector(PyTuple_GetItem(tuple, 1), demand->limits, demand->least) &&
           vector(PyTuple_GetItem(tuple, 2), demand->limits, demand->most);
}

/* Read a joint metric: (T, its inverse). */
static bool metric(PyObject *tuple, int m, Metric *into)
{
    return PyTuple_Check(tuple) && PyTuple_Size(tuple) == 2 &&
           matrix(PyTuple_GetItem(tuple, 0), m, m, MOST, into->T[0]) &&
           matrix(PyTuple_GetItem(tuple, 1), m, m, MOST, into->inverse[0]);
}

/* How many columns a matrix has; 0 for something else, and for more than the core has room for. */
static int joints_of(PyObject *J)
{
    bool good = PyArray_Check(J) && PyArray_NDIM((PyArrayObject *)J) == 2;
    npy_intp m = good ? PyArray_DIM((PyArrayObject *)J, 1) : 0;
    return m > MOST ? 0 : (int)m;
}

static PyObject *tick(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Demand demand;
    Metric measure;
    Form form;
    demand.rows = demand.limits = 0;
    demand.metric = NULL;
    memset(demand.posture, 0, sizeof demand.posture);
    demand.cone.limit = 0.0;
    if (count != 12 || !policy(arguments[7], &demand, &form)) {
        if (!PyErr_Occurred())
            PyErr_SetString(PyExc_TypeError, "tick(J, s, root, lower, upper, posture, dt, " POLICY ", "
                                             "(A, b, of_twist, rank), (J, limit, start), (C, lower, upper), (T, inverse))");
        return NULL;
    }
    demand.m = joints_of(arguments[0]);
    if (demand.m == 0)
        Py_RETURN_NONE;
    demand.has_posture = arguments[5] != Py_None;
    if (!matrix(arguments[0], 6, demand.m, MOST, demand.J[0]) || !vector(arguments[1], 6, demand.s) ||
        !matrix(arguments[2], 6, 6, 6, demand.root[0]) || !vector(arguments[3], demand.m, demand.lower) ||
        !vector(arguments[4], demand.m, demand.upper) ||
        (demand.has_posture && !vector(arguments[5], demand.m, demand.posture)))
        Py_RETURN_NONE;
    demand.dt = PyFloat_AsDouble(arguments[6]);
    if ((arguments[8] != Py_None && !exact(arguments[8], &demand)) ||
        (arguments[9] != Py_None && !cone(arguments[9], &demand)) ||
        (arguments[10] != Py_None && !limits(arguments[10], &demand)) ||
        (arguments[11] != Py_None && !metric(arguments[11], demand.m, &measure)))
        Py_RETURN_NONE;
    if (arguments[11] != Py_None)
        demand.metric = &measure;
    if (PyErr_Occurred())
        return NULL;
    Solution solution;
    if (solve(&demand, &solution) == HAND_BACK)
        Py_RETURN_NONE;
    return fields(demand.m, &solution);
}

/* cost(J, s, root, POLICY, more): (H, c), or None where Python has to find them. */
static PyObject *cost(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Demand demand;
    Form form;
    if (count != 5 || !policy(arguments[3], &demand, &form)) {
        if (!PyErr_Occurred())
            PyErr_SetString(PyExc_TypeError, "cost(J, s, root, " POLICY ", more)");
        return NULL;
    }
    demand.m = joints_of(arguments[0]);
    double more = PyFloat_AsDouble(arguments[4]);
    if (PyErr_Occurred())
        return NULL;
    if (demand.m == 0)
        Py_RETURN_NONE;
    Row H[MOST], c;
    if (!matrix(arguments[0], 6, demand.m, MOST, demand.J[0]) || !vector(arguments[1], 6, demand.s) ||
        !matrix(arguments[2], 6, 6, 6, demand.root[0]) || frame_cost(&demand, more, H, c) == HAND_BACK)
        Py_RETURN_NONE;
    return Py_BuildValue("(NN)", new_matrix(demand.m, demand.m, MOST, H[0]), new_vector(demand.m, c));
}

/* loop(numbers, ...) with the numbers of a Loop by name, arrays for those of the joints: a float64 array for `step`. */
static PyObject *loop(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    static const char *const USE = "loop((m, dt, gain, length, slowness, has_posture, row_rank, speed_limit, has_braking, "
                                   "k, r, has_metric, 0, carried), point, fast, home, screws, low, high, "
                                   "fastest, middle, pull, position_lower, position_upper, acceleration, "
                                   "(k, 8 + m) exact, C, lower, upper of r rows, T, its inverse, " POLICY ", root)";
    Loop made = {.joints = 0.0};
    Demand read;
    double first[14];
    bool good = count == 21 && vector(arguments[0], 14, first) && first[0] >= 1.0 && first[0] <= MOST &&
                first[9] >= 0.0 && first[9] <= MOST_ROWS && first[10] >= 0.0 && first[10] <= MOST &&
                policy(arguments[19], &read, &made.form) && matrix(arguments[20], 6, 6, 6, made.root[0]);
    if (!good) {
        if (!PyErr_Occurred())
            PyErr_SetString(PyExc_TypeError, USE);
        return NULL;
    }
    int m = (int)first[0], k = (int)first[9];
    memcpy(&made, first, sizeof first);
    made.has_form = read.form != NULL;
    made.threshold = read.threshold;
    made.ceiling = read.ceiling;
    made.fixed = read.fixed;
    made.speed = read.speed;
    if (!vector(arguments[1], 3, made.point) || !vector(arguments[2], 3, made.fast) ||
        !matrix(arguments[3], 4, 4, 4, made.home) || !matrix(arguments[4], 6, m, MOST, made.screws[0]) ||
        !vector(arguments[5], m, made.low) || !vector(arguments[6], m, made.high) ||
        !vector(arguments[7], m, made.fastest) || !vector(arguments[8], m, made.middle) ||
        !vector(arguments[9], m, made.pull) || !vector(arguments[10], m, made.position_lower) ||
        !vector(arguments[11], m, made.position_upper) || !vector(arguments[12], m, made.acceleration) ||
        !matrix(arguments[13], k, 8 + m, 8 + MOST, (double *)made.exact) ||
        !matrix(arguments[14], (int)made.limits, m, MOST, made.G[0]) ||
        !vector(arguments[15], (int)made.limits, made.least) || !vector(arguments[16], (int)made.limits, made.most) ||
        !matrix(arguments[17], m, m, MOST, made.metric.T[0]) || !matrix(arguments[18], m, m, MOST, made.metric.inverse[0])) {
        PyErr_SetString(PyExc_TypeError, USE);
        return NULL;
    }
    return new_vector(sizeof made / sizeof(double), (const double *)&made);
}

/* The numbers that `loop` returned, where they are; NULL for anything else. */
const Loop *loop_of(PyObject *object)
{
    if (!PyArray_Check(object))
        return NULL;
    PyArrayObject *array = (PyArrayObject *)object;
    bool good = PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISCARRAY_RO(array) &&
                PyArray_SIZE(array) == (npy_intp)(sizeof(Loop) / sizeof(double));
    return good ? (const Loop *)PyArray_DATA(array) : NULL;
}

/* Read a Convergence of Python: (promised, achieved, speed, expected, size, ticks). */
static bool convergence(PyObject *tuple, Convergence *watch)
{
    if (!PyTuple_Check(tuple) || PyTuple_Size(tuple) != 6)
        return false;
    watch->promised = PyFloat_AsDouble(PyTuple_GetItem(tuple, 0));
    watch->achieved = PyFloat_AsDouble(PyTuple_GetItem(tuple, 1));
    watch->speed = PyFloat_AsDouble(PyTuple_GetItem(tuple, 2));
    watch->size = PyFloat_AsDouble(PyTuple_GetItem(tuple, 4));
    watch->ticks = PyLong_AsLong(PyTuple_GetItem(tuple, 5));
    PyObject *expected = PyTuple_GetItem(tuple, 3);
    watch->has_expected = expected != Py_None;
    return !PyErr_Occurred() && (!watch->has_expected || vector(expected, 6, watch->expected));
}

static PyObject *controller_step(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    const Loop *fixed = count == 6 ? loop_of(arguments[0]) : NULL;
    if (fixed == NULL) {
        PyErr_SetString(PyExc_TypeError, "step(loop, q, target, feedforward, before, convergence)");
        return NULL;
    }
    int m = (int)fixed->joints;
    Row q, before;
    Pose target;
    double feedforward[6], turn[3];
    bool ahead = arguments[3] != Py_None;
    Convergence watch;
    Solution solution;
    if (!vector(arguments[1], m, q) || !all_finite(m, q) || !pose(arguments[2], &target) ||
        (ahead && (!vector(arguments[3], 6, feedforward) || !all_finite(6, feedforward))) ||
        !vector(arguments[4], m, before) || !all_finite(m, before) || !convergence(arguments[5], &watch) ||
        step(fixed, q, &target, ahead ? feedforward : NULL, before, &watch, turn, &solution) == HAND_BACK) {
        if (PyErr_Occurred())
            return NULL;
        Py_RETURN_NONE;
    }
    return Py_BuildValue("(NNN(dddNdl))", fields(m, &solution), new_vector(m, solution.velocity), new_vector(3, turn),
                         watch.promised, watch.achieved, watch.speed, new_vector(6, watch.expected), watch.size,
                         watch.ticks);
}

/* ticks(J, s, roots, lower, upper, posture, POLICY, (T, its inverse) or None, velocity, residual, told, records): N rows,
   each a tick without dt. Written of each: velocity and residual; whether it is a closed form and no more (PLAIN), more
   than that (RECORDED, and then its record) or Python's (0); method, status, scale, damping, guard. */
#define TOLD 6
#define RECORD ((npy_intp)(sizeof(Solution) / sizeof(double)))
enum { PLAIN = 1, RECORDED = 2 };

static PyObject *ticks(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
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
    if (!good) {
        if (!PyErr_Occurred())
            PyErr_SetString(PyExc_TypeError, "ticks(J, s, roots, lower, upper, posture, " POLICY ", (T, inverse) or None, "
                                             "velocity, residual, told, records)");
        return NULL;
    }
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
        if (solve(&demand, &solution) == HAND_BACK)
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
static PyObject *recorded(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Solution solution;
    if (count != 1 || !vector(arguments[0], (int)RECORD, (double *)&solution) || solution.m < 1 || solution.m > MOST) {
        PyErr_SetString(PyExc_TypeError, "solution(record)");
        return NULL;
    }
    return fields(solution.m, &solution);
}

static PyMethodDef methods[] = {
    {"ticks", (PyCFunction)(void (*)(void))ticks, METH_FASTCALL, "Many ticks at once, without the GIL."},
    {"solution", (PyCFunction)(void (*)(void))recorded, METH_FASTCALL, "The fields of a VelocitySolution from its record."},
    {"loop", (PyCFunction)(void (*)(void))loop, METH_FASTCALL, "The fixed numbers of a controller, for `step`."},
    {"step", (PyCFunction)(void (*)(void))controller_step, METH_FASTCALL,
     "A controller's tick: the fields of a VelocitySolution and of its memory, or None where Python has to answer."},
    {"drive", (PyCFunction)(void (*)(void))path_drive, METH_FASTCALL,
     "A tick along a path, the state after it and what is told of it, or None where Python has to drive."},
    {"sight", (PyCFunction)(void (*)(void))sight, METH_FASTCALL,
     "Joint twists, tool pose and error of an arm, the error None where Python has to find it; or None."},
    {"cost", (PyCFunction)(void (*)(void))cost, METH_FASTCALL, "H and c of a frame task, or None where Python has to find them."},
    {"tick", (PyCFunction)(void (*)(void))tick, METH_FASTCALL,
     "The fields of a VelocitySolution, or None where Python has to answer."},
    {"arm", (PyCFunction)(void (*)(void))search_arm, METH_FASTCALL, "The numbers of an arm, for a pose search."},
    {"descend", (PyCFunction)(void (*)(void))search_descend, METH_FASTCALL,
     "One try at a pose: (q, f, unmet, merit, steps, met, at_rest), or None where Python has to make it."},
    {"misses", (PyCFunction)(void (*)(void))search_misses, METH_FASTCALL, "Distance and angle of a tool from its target."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_native", "The compiled tick; its sources are in csrc/.", -1, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__native(void)
{
    import_array();
    PyObject *module = PyModule_Create(&definition), *constants = PyDict_New();
    if (module == NULL || constants == NULL)
        return NULL;
    for (const Constant *constant = CONSTANTS; constant->name != NULL; constant++) {
        PyObject *value = PyFloat_FromDouble(constant->value);
        if (value == NULL || PyDict_SetItemString(constants, constant->name, value) < 0)
            return NULL;
        Py_DECREF(value);
    }
    if (PyModule_AddIntConstant(module, "MOST_JOINTS", MOST) < 0 || PyModule_AddIntConstant(module, "MOST_ROWS", MOST_ROWS) < 0 ||
        PyModule_AddIntConstant(module, "TOLD", TOLD) < 0 || PyModule_AddIntConstant(module, "RECORD", (long)RECORD) < 0)
        return NULL;
    return PyModule_AddObject(module, "CONSTANTS", constants) < 0 ? NULL : module;
}
