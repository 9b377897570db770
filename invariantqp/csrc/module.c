/* The functions that Python calls. Nothing is computed here. */

#define IMPORTS_NUMPY
#include "boundary.h"

static PyObject *HOMOGENEOUS; /* made with the module */

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
    if (count != 14 || !policy(arguments[7], &demand, &form))
        return refused("tick(J, s, root, lower, upper, posture, dt, " POLICY ", (A, b, of_twist, rank), (J, limit, start), "
                       "(C, lower, upper), (T, inverse), (ahead, rows_ahead, lower, upper, slack, apart), fastest)");
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
        return left_to_python();
    if (arguments[11] != Py_None)
        demand.metric = &measure;
    demand.chased = arguments[12] != Py_None;
    demand.paced = arguments[13] != Py_None;
    if ((demand.chased && !chase(arguments[12], &demand)) ||
        (demand.paced && !vector(arguments[13], demand.m, demand.fastest)))
        return left_to_python();
    Solution solution;
    if (PyErr_Occurred() || solve(&demand, &solution) == HAND_BACK)
        return left_to_python();
    return fields(demand.m, &solution);
}

/* cost(J, s, root, POLICY, more): (H, c), or None where Python has to find them. */
static PyObject *cost(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Demand demand;
    Form form;
    if (count != 5 || !policy(arguments[3], &demand, &form))
        return refused("cost(J, s, root, " POLICY ", more)");
    demand.m = joints_of(arguments[0]);
    double more = PyFloat_AsDouble(arguments[4]);
    Row H[MOST], c;
    if (PyErr_Occurred() || demand.m == 0 || !matrix(arguments[0], 6, demand.m, MOST, demand.J[0]) ||
        !vector(arguments[1], 6, demand.s) || !matrix(arguments[2], 6, 6, 6, demand.root[0]) ||
        frame_cost(&demand, more, H, c) == HAND_BACK)
        return left_to_python();
    return Py_BuildValue("(NN)", new_matrix(demand.m, demand.m, MOST, H[0]), new_vector(demand.m, c));
}

/* loop(numbers, ...) with the numbers of a Loop by name, arrays for those of the joints: a float64 array for `step`. */
static PyObject *loop(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    static const char *const USE = "loop((m, dt, gain, length, slowness, has_posture, row_rank, speed_limit, has_braking, "
                                   "k, r, has_metric, 0, carried, delay, slack, planned threshold and "
                                   "ceiling), point, fast, home, screws, low, high, fastest, posture, pull, "
                                   "position_lower, position_upper, acceleration, "
                                   "(k, 8 + m) exact, C, lower, upper of r rows, T, its inverse, " POLICY ", root)";
    Loop made = {.joints = 0.0};
    Demand read;
    double first[18];
    bool good = count == 21 && vector(arguments[0], 18, first) && first[0] >= 1.0 && first[0] <= MOST &&
                first[9] >= 0.0 && first[9] <= MOST_ROWS && first[10] >= 0.0 && first[10] <= MOST &&
                policy(arguments[19], &read, &made.form) && matrix(arguments[20], 6, 6, 6, made.root[0]);
    if (!good)
        return refused(USE);
    int m = (int)first[0], k = (int)first[9];
    memcpy(&made, first, 15 * sizeof(double));
    made.slack = first[15];
    made.planned_threshold = first[16];
    made.planned_ceiling = first[17];
    made.has_form = read.form != NULL;
    made.threshold = read.threshold;
    made.ceiling = read.ceiling;
    made.fixed = read.fixed;
    made.speed = read.speed;
    if (!vector(arguments[1], 3, made.point) || !vector(arguments[2], 3, made.fast) ||
        !matrix(arguments[3], 4, 4, 4, made.home) || !matrix(arguments[4], 6, m, MOST, made.screws[0]) ||
        !vector(arguments[5], m, made.low) || !vector(arguments[6], m, made.high) ||
        !vector(arguments[7], m, made.fastest) || !vector(arguments[8], m, made.posture) ||
        !vector(arguments[9], m, made.pull) || !vector(arguments[10], m, made.position_lower) ||
        !vector(arguments[11], m, made.position_upper) || !vector(arguments[12], m, made.acceleration) ||
        !matrix(arguments[13], k, 8 + m, 8 + MOST, (double *)made.exact) ||
        !matrix(arguments[14], (int)made.limits, m, MOST, made.G[0]) ||
        !vector(arguments[15], (int)made.limits, made.least) || !vector(arguments[16], (int)made.limits, made.most) ||
        !matrix(arguments[17], m, m, MOST, made.metric.T[0]) || !matrix(arguments[18], m, m, MOST, made.metric.inverse[0]))
        return refused(USE);
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
    if (!good)
        return NULL;
    const Loop *loop = PyArray_DATA(array);
    bool fits = within(loop->joints, 1, MOST) && within(loop->wanted, 0, MOST_ROWS) && within(loop->limits, 0, MOST) &&
                within(loop->delay / loop->dt, 0, MOST_LATE) && within(loop->form.count, 0, 6) && within(loop->row_rank, -1, MOST_ROWS * 3);
    return fits ? loop : NULL;
}

/* The numbers of a loop's memory, for reading and writing; NULL for anything else. */
double *memory_of(PyObject *object, const Loop *loop)
{
    PyArrayObject *array = (PyArrayObject *)object;
    bool good = PyArray_Check(object) && PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISCARRAY(array) &&
                PyArray_SIZE(array) == KEPT + (1 + commands_of(loop)) * (npy_intp)loop->joints;
    return good ? PyArray_DATA(array) : NULL;
}

/* The pose of a target: a (4, 4) array, or what has one as `homogeneous`. */
static bool target_pose(PyObject *object, Pose *T)
{
    if (PyArray_Check(object))
        return pose(object, T);
    PyObject *array = PyObject_GetAttr(object, HOMOGENEOUS);
    bool good = array != NULL && pose(array, T);
    Py_XDECREF(array);
    PyErr_Clear(); /* Python says what is wrong */
    return good;
}

/* step(loop, memory, q, target, feedforward, velocity): a VelocitySolution, and whether Python has words to add; the
   memory is written. Without a target (None), `Controller.follow` for the twist `feedforward`. None, and the memory as it
   was, where Python has to answer, or to say what is wrong. */
static PyObject *controller_step(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    const Loop *fixed = count == 6 ? loop_of(arguments[0]) : NULL;
    double *kept = fixed == NULL ? NULL : memory_of(arguments[1], fixed);
    if (kept == NULL)
        return refused("step(loop, memory, q, target, feedforward, velocity)");
    int m = (int)fixed->joints;
    Row q, before;
    Pose target;
    double feedforward[6];
    bool ahead = arguments[4] != Py_None, towards = arguments[3] != Py_None;
    Memory memory;
    Solution solution;
    if (arguments[5] == Py_None)
        memcpy(before, kept + KEPT + m, (size_t)m * sizeof(double));
    if ((arguments[5] != Py_None && (!vector(arguments[5], m, before) || !all_finite(m, before))) ||
        !vector(arguments[2], m, q) || !all_finite(m, q) || (towards && !target_pose(arguments[3], &target)) ||
        (ahead && (!vector(arguments[4], 6, feedforward) || !all_finite(6, feedforward))) || (!towards && !ahead) ||
        step(fixed, q, towards ? &target : NULL, ahead ? feedforward : NULL, before, kept, &memory, &solution) == HAND_BACK)
        Py_RETURN_NONE;
    PyObject *found[] = {fields(m, &solution), NULL};
    if (found[0] == NULL)
        return NULL;
    memcpy(kept, &memory, sizeof memory);
    remembered(fixed, q, solution.velocity, kept);
    found[1] = PyBool_FromLong((towards && has_trouble(&memory)) || is_outside(fixed, q, &solution));
    return named(&PyTuple_Type, 2, found);
}

/* optimum(K, T, centre, A or None, lower, upper, (J, limit, start) or None, inside): (z, multipliers, nu) of the quadratic
   1/2 |K (z - centre)|^2, T = K^-1, inside the limits, of which `inside` is one point; or None. */
static PyObject *optimum(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Quadratic problem;
    Polytope room;
    Demand slow = {.m = 0};
    Optimum found;
    Row inside;
    npy_intp rows = count == 8 && PyArray_Check(arguments[4]) ? PyArray_SIZE((PyArrayObject *)arguments[4]) : -1;
    if (rows < 0)
        return refused("optimum(K, T, centre, A or None, lower, upper, (J, limit, start) or None, inside)");
    int n = slow.m = problem.n = joints_of(arguments[0]);
    room.count = (int)rows;
    room.box = arguments[3] == Py_None;
    if (n == 0 || rows > LIMITS || !matrix(arguments[0], n, n, MOST, problem.K[0]) ||
        !matrix(arguments[1], n, n, MOST, problem.T[0]) || !vector(arguments[2], n, problem.centre) ||
        (room.box ? rows != n : !matrix(arguments[3], (int)rows, n, MOST, room.A[0])) ||
        !vector(arguments[4], (int)rows, room.lower) || !vector(arguments[5], (int)rows, room.upper) ||
        (arguments[6] != Py_None && !cone(arguments[6], &slow)) || !vector(arguments[7], n, inside) ||
        minimise(&problem, &room, &slow.cone, inside, NULL, &found) == HAND_BACK)
        return left_to_python();
    return Py_BuildValue("(NNd)", new_vector(n, found.z), new_vector((int)rows, found.multipliers), found.nu);
}

#define CALLED(name, function, does) {name, (PyCFunction)(void (*)(void))function, METH_FASTCALL, does}
static PyMethodDef methods[] = {
    CALLED("answer_as", answer_as, "Make every answer a VelocitySolution, this type, its status a member of this enum."),
    CALLED("ticks", batch_ticks, "Many ticks at once, without the GIL."),
    CALLED("solution", batch_solution, "A VelocitySolution from its record."),
    CALLED("loop", loop, "The fixed numbers of a controller, for `step`."),
    CALLED("step", controller_step,
           "A controller's tick: a VelocitySolution, and whether Python has words to add; None where Python has to answer."),
    CALLED("tell_as", tell_as, "Make every answer along a path a PathSolution, this type, its status a member of this enum."),
    CALLED("drive", path_drive,
           "A tick along a path: a PathSolution, and whether Python has words to add; None where Python has to drive."),
    CALLED("clearance", clearance, "Rows that keep distances of shapes, and the distances."),
    CALLED("sight", sight,
           "Joint twists, tool pose and error of an arm, the error None where Python has to find it; or None."),
    CALLED("cost", cost, "H and c of a frame task, or None where Python has to find them."),
    CALLED("tick", tick, "A VelocitySolution, or None where Python has to answer."),
    CALLED("optimum", optimum, "The optimum of a quadratic inside limits, its multipliers and the speed limit's; or None."),
    CALLED("arm", search_arm, "The numbers of an arm, for a pose search."),
    CALLED("descend", search_descend,
           "One try at a pose: (q, f, unmet, merit, steps, met, at_rest), or None where Python has to make it."),
    CALLED("misses", search_misses, "Distance and angle of a tool from its target."),
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_native", "The compiled tick; its sources are in csrc/.", -1, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__native(void)
{
    import_array();
    PyObject *module = PyModule_Create(&definition), *constants = PyDict_New();
    HOMOGENEOUS = PyUnicode_InternFromString("homogeneous");
    if (module == NULL || constants == NULL || HOMOGENEOUS == NULL || !words_made())
        return NULL;
    for (const Constant *constant = CONSTANTS; constant->name != NULL; constant++) {
        PyObject *value = PyFloat_FromDouble(constant->value);
        if (value == NULL || PyDict_SetItemString(constants, constant->name, value) < 0)
            return NULL;
        Py_DECREF(value);
    }
    if (PyModule_AddIntConstant(module, "MOST_JOINTS", MOST) < 0 || PyModule_AddIntConstant(module, "MOST_ROWS", MOST_ROWS) < 0 ||
        PyModule_AddIntConstant(module, "RECORD", (long)RECORD) < 0)
        return NULL;
    return PyModule_AddObject(module, "CONSTANTS", constants) < 0 ? NULL : module;
}
