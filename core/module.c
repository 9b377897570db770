/* The boundary with Python: arrays in, the fields of a VelocitySolution out. Nothing is computed here. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <numpy/arrayobject.h>

#include "core.h"

/* "near a singularity: ...", "at the limits of joints 0, 2": as velocity/report.py words them. */
#define WORDS 512

/* Copy a float64 vector of n numbers, whatever its strides; false for anything else. */
static bool vector(PyObject *object, int n, double *into)
{
    if (!PyArray_Check(object))
        return false;
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISBEHAVED_RO(array) || PyArray_NDIM(array) != 1 ||
        PyArray_DIM(array, 0) != n)
        return false;
    const char *from = PyArray_BYTES(array);
    npy_intp step = PyArray_STRIDE(array, 0);
    for (int i = 0; i < n; i++)
        into[i] = *(const double *)(from + i * step);
    return true;
}

/* Copy a (rows, n) float64 matrix into rows of `width`. */
static bool matrix(PyObject *object, int rows, int n, int width, double *into)
{
    if (!PyArray_Check(object))
        return false;
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISBEHAVED_RO(array) || PyArray_NDIM(array) != 2 ||
        PyArray_DIM(array, 0) != rows || PyArray_DIM(array, 1) != n)
        return false;
    const char *from = PyArray_BYTES(array);
    npy_intp down = PyArray_STRIDE(array, 0), step = PyArray_STRIDE(array, 1);
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < n; j++)
            into[i * width + j] = *(const double *)(from + i * down + j * step);
    return true;
}

static PyObject *new_vector(int n, const double *values)
{
    npy_intp size = n;
    PyObject *array = PyArray_SimpleNew(1, &size, NPY_DOUBLE);
    if (array != NULL)
        memcpy(PyArray_DATA((PyArrayObject *)array), values, (size_t)n * sizeof *values);
    return array;
}

/* Write text and a number at the end of words: `code` and `digits` as in a format of Python, whatever the locale. */
static bool add(char *words, const char *text, double number, char code, int digits)
{
    char *written = PyOS_double_to_string(number, code, digits, 0, NULL);
    if (written == NULL)
        return false;
    size_t used = strlen(words);
    PyOS_snprintf(words + used, WORDS - used, "%s%s", text, written);
    PyMem_Free(written);
    return true;
}

static void say(char *words, const char *text)
{
    size_t used = strlen(words);
    PyOS_snprintf(words + used, WORDS - used, "%s%s", used > 0 ? "; " : "", text);
}

static PyObject *reason(int m, const Solution *solution, int active)
{
    char words[WORDS] = "";
    if (solution->stuck)
        say(words, "no velocity reduces the error: it is the least that these joints and limits allow");
    if (solution->damping > 0.0) {
        say(words, "near a singularity: the smallest singular value is ");
        if (!add(words, "", solution->ratio, 'e', 1))
            return NULL;
        size_t used = strlen(words);
        PyOS_snprintf(words + used, WORDS - used, " of the largest; damped");
        if (solution->lost && solution->lost_share == 0.0)
            PyOS_snprintf(words + strlen(words), WORDS - strlen(words), ": part of the motion is given up");
        else if (solution->lost) {
            if (!add(words, ": ", solution->lost_share, 'g', 2))
                return NULL;
            PyOS_snprintf(words + strlen(words), WORDS - strlen(words), " of the twist is given up");
        }
    }
    if (active > 0) {
        say(words, active > 1 ? "at the limits of joints" : "at the limits of joint");
        const char *before = " ";
        for (int j = 0; j < m; j++)
            if (solution->active[j]) {
                PyOS_snprintf(words + strlen(words), WORDS - strlen(words), "%s%d", before, j);
                before = ", ";
            }
    }
    return PyUnicode_FromString(words);
}

static PyObject *joints(int m, const bool *active, int count)
{
    PyObject *tuple = PyTuple_New(count);
    for (int j = 0, k = 0; tuple != NULL && j < m; j++) {
        if (!active[j])
            continue;
        PyObject *index = PyLong_FromLong(j);
        if (index == NULL || PyTuple_SetItem(tuple, k++, index) < 0)
            Py_CLEAR(tuple);
    }
    return tuple;
}

/* The fields of a VelocitySolution, in its order. */
static PyObject *fields(int m, const Solution *solution)
{
    static const char *const METHODS[] = {"closed-form", "damped", "qp"};
    int active = 0;
    for (int j = 0; j < m; j++)
        active += solution->active[j];
    bool met = solution->method == QP;
    return Py_BuildValue("(NssNNNdddsNO)", new_vector(m, solution->velocity), METHODS[solution->method],
                         solution->stuck || solution->lost ? "degraded" : "ok", reason(m, solution, active),
                         joints(m, solution->active, active), new_vector(6, solution->residual), 1.0,
                         solution->damping, 0.0, met ? "native" : "",
                         met ? new_vector(m, solution->multipliers) : Py_NewRef(Py_None), Py_None);
}

static PyObject *tick(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    if (count != 8 || !PyTuple_Check(arguments[7]) || PyTuple_Size(arguments[7]) != 3) {
        PyErr_SetString(PyExc_TypeError, "tick(J, s, root, lower, upper, posture, dt, (threshold, ceiling, fixed))");
        return NULL;
    }
    Demand demand = {.posture = {0.0}};
    npy_intp m = PyArray_Check(arguments[0]) && PyArray_NDIM((PyArrayObject *)arguments[0]) == 2
                     ? PyArray_DIM((PyArrayObject *)arguments[0], 1)
                     : 0;
    if (m < 1 || m > MOST)
        Py_RETURN_NONE;
    demand.m = (int)m;
    demand.has_posture = arguments[5] != Py_None;
    if (!matrix(arguments[0], 6, demand.m, MOST, demand.J[0]) || !vector(arguments[1], 6, demand.s) ||
        !matrix(arguments[2], 6, 6, 6, demand.root[0]) || !vector(arguments[3], demand.m, demand.lower) ||
        !vector(arguments[4], demand.m, demand.upper) ||
        (demand.has_posture && !vector(arguments[5], demand.m, demand.posture)))
        Py_RETURN_NONE;
    demand.dt = PyFloat_AsDouble(arguments[6]);
    demand.threshold = PyFloat_AsDouble(PyTuple_GetItem(arguments[7], 0));
    demand.ceiling = PyFloat_AsDouble(PyTuple_GetItem(arguments[7], 1));
    demand.fixed = PyFloat_AsDouble(PyTuple_GetItem(arguments[7], 2));
    if (PyErr_Occurred())
        return NULL;
    Solution solution;
    if (solve(&demand, &solution) == HAND_BACK)
        Py_RETURN_NONE;
    return fields(demand.m, &solution);
}

/* loop(numbers) with the numbers of a Loop by name, arrays for those of the joints: a float64 array for `step`. */
static PyObject *loop(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    static const char *const USE = "loop((m, dt, gain, length, slowness, has_posture, threshold, ceiling, fixed), "
                                   "point, home, screws, low, high, fastest, middle, pull)";
    Loop made = {.joints = 0.0};
    double first[9];
    if (count != 9 || !vector(arguments[0], 9, first) || !(first[0] >= 1.0 && first[0] <= MOST)) {
        PyErr_SetString(PyExc_TypeError, USE);
        return NULL;
    }
    int m = (int)first[0];
    memcpy(&made, first, sizeof first);
    if (!vector(arguments[1], 3, made.point) || !matrix(arguments[2], 4, 4, 4, made.home) ||
        !matrix(arguments[3], 6, m, MOST, made.screws[0]) || !vector(arguments[4], m, made.low) ||
        !vector(arguments[5], m, made.high) || !vector(arguments[6], m, made.fastest) ||
        !vector(arguments[7], m, made.middle) || !vector(arguments[8], m, made.pull)) {
        PyErr_SetString(PyExc_TypeError, USE);
        return NULL;
    }
    return new_vector(sizeof made / sizeof(double), (const double *)&made);
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

static bool pose(PyObject *object, Pose *T)
{
    double H[16];
    if (!matrix(object, 4, 4, 4, H) || !all_finite(16, H) || H[12] != 0.0 || H[13] != 0.0 || H[14] != 0.0 ||
        H[15] != 1.0)
        return false;
    for (int i = 0; i < 3; i++) {
        memcpy(T->R[i], H + 4 * i, 3 * sizeof(double));
        T->p[i] = H[4 * i + 3];
    }
    return true;
}

static PyObject *controller_step(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Loop fixed;
    if (count != 5 || !vector(arguments[0], sizeof fixed / sizeof(double), (double *)&fixed)) {
        PyErr_SetString(PyExc_TypeError, "step(loop, q, target, feedforward, convergence)");
        return NULL;
    }
    int m = (int)fixed.joints;
    Row q;
    Pose target;
    double feedforward[6], turn[3];
    bool ahead = arguments[3] != Py_None;
    Convergence watch;
    Solution solution;
    if (!vector(arguments[1], m, q) || !all_finite(m, q) || !pose(arguments[2], &target) ||
        (ahead && (!vector(arguments[3], 6, feedforward) || !all_finite(6, feedforward))) ||
        !convergence(arguments[4], &watch) ||
        step(&fixed, q, &target, ahead ? feedforward : NULL, &watch, turn, &solution) == HAND_BACK) {
        if (PyErr_Occurred())
            return NULL;
        Py_RETURN_NONE;
    }
    return Py_BuildValue("(NNN(dddNdl))", fields(m, &solution), new_vector(m, solution.velocity), new_vector(3, turn),
                         watch.promised, watch.achieved, watch.speed, new_vector(6, watch.expected), watch.size,
                         watch.ticks);
}

static PyMethodDef methods[] = {
    {"loop", (PyCFunction)(void (*)(void))loop, METH_FASTCALL, "The fixed numbers of a controller, for `step`."},
    {"step", (PyCFunction)(void (*)(void))controller_step, METH_FASTCALL,
     "A controller's tick: the fields of a VelocitySolution and of its memory, or None where Python has to answer."},
    {"tick", (PyCFunction)(void (*)(void))tick, METH_FASTCALL,
     "The fields of a VelocitySolution, or None where Python has to answer."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_native", "The compiled tick; its sources are in core/.", -1, methods, NULL, NULL, NULL, NULL};

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
    if (PyModule_AddIntConstant(module, "MOST_JOINTS", MOST) < 0)
        return NULL;
    return PyModule_AddObject(module, "CONSTANTS", constants) < 0 ? NULL : module;
}
