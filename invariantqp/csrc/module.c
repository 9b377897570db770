/* The functions that Python calls. Nothing is computed here. */

#define IMPORTS_NUMPY
#include "paths.h"

static PyObject *HOMOGENEOUS, *AS_MATRIX; /* made with the module */

/* How many columns a matrix has; 0 for something else, and for more than the core has room for. */
int joints_of(PyObject *J)
{
    bool good = PyArray_Check(J) && PyArray_NDIM((PyArrayObject *)J) == 2;
    npy_intp m = good ? PyArray_DIM((PyArrayObject *)J, 1) : 0;
    return m > MOST ? 0 : (int)m;
}

/* The fields of a tick by name, for a Law or, where some joint has no limit, another one. */
static Fit tick_read(const char *use, PyObject *const *laws, int count, PyObject *const *given, PyObject *names, Demand *demand)
{
    const Law *law = count > 0 ? described(&TABLE_Law, laws[0]) : NULL, *unlimited = law;
    if (law == NULL || (unlimited = described(&TABLE_Law, laws[count - 1])) == NULL) {
        refused(use);
        return WRONG;
    }
    Fit fit = called_by_name(&TABLE_tick, given, names, demand);
    for (int j = 0; j < demand->m && fit == FITS; j++)
        law = isfinite(demand->lower[j]) && isfinite(demand->upper[j]) ? law : unlimited;
    governed(law, demand);
    bool good = fit == FITS && demand->m > 0 && (demand->has_root || measured(demand) == DONE) &&
                !(law->has_metric && law->joints != demand->m) && !(law->form == BROUGHT && !demand->has_brought);
    return fit == FITS && !good ? UNFIT : fit;
}

/* tick(law, unlimited, ...) with the fields of a tick by name: a VelocitySolution, or None where Python has to answer. */
static PyObject *tick(PyObject *module, PyObject *const *arguments, Py_ssize_t count, PyObject *names)
{
    (void)module;
    Demand demand;
    Solution solution;
    Fit fit = tick_read("tick(a Law, another one where some joint has no limit, and the fields of a tick by name)", arguments,
                        count <= 2 ? (int)count : 0, arguments + count, names, &demand);
    if (fit == WRONG)
        return NULL;
    return fit == UNFIT || solve(&demand, &solution) == HAND_BACK ? Py_NewRef(Py_None) : fields(demand.m, &solution, NULL, NULL);
}

/* The values of a Loop; NULL for anything else. */
const Loop *loop_of(PyObject *object) { return described(&TABLE_Loop, object); }

/* The numbers of a loop's memory, for reading and writing; NULL for anything else. */
double *memory_of(PyObject *object, const Loop *loop)
{
    PyArrayObject *array = (PyArrayObject *)object;
    bool good = PyArray_Check(object) && PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISCARRAY(array) &&
                PyArray_SIZE(array) == KEPT + (1 + commands_of(loop)) * loop->joints + states_of(loop->joints);
    return good ? PyArray_DATA(array) : NULL;
}

/* The pose of a target, its rotation to all digits: (4, 4) numbers, or what has one as `homogeneous`, or gives one by
   `as_matrix()`. */
bool target_pose(PyObject *object, Pose *T)
{
    bool numbers = PyArray_Check(object) || PyList_CheckExact(object) || PyTuple_CheckExact(object);
    PyObject *array = numbers ? Py_NewRef(object) : PyObject_GetAttr(object, HOMOGENEOUS);
    if (array == NULL) {
        PyErr_Clear();
        array = PyObject_CallMethodObjArgs(object, AS_MATRIX, NULL);
    }
    bool good = array != NULL && pose(array, T);
    if (good)
        with_rotation(T);
    Py_XDECREF(array);
    PyErr_Clear(); /* Python says what is wrong */
    return good;
}

/* step(loop, memory, q, target, feedforward, velocity, ...): a VelocitySolution, and what of joints is to be said beside
   its reasons, None for nothing; the memory is written. Without a target (None), `Controller.follow` for the twist `feedforward`. By name, what is other in
   this tick. None, and the memory as it was, where Python has to answer, or to say what is wrong. */
static PyObject *controller_step(PyObject *module, PyObject *const *arguments, Py_ssize_t count, PyObject *names)
{
    (void)module;
    const Loop *fixed = count == 6 ? loop_of(arguments[0]) : NULL;
    double *kept = fixed == NULL ? NULL : memory_of(arguments[1], fixed);
    if (kept == NULL)
        return refused("step(loop, memory, q, target, feedforward, velocity)");
    Now other, *now = names == NULL ? NULL : &other;
    Fit fit = now == NULL ? FITS : called_by_name(&TABLE_now, arguments + count, names, now);
    if (fit == WRONG)
        return NULL;
    if (fit == UNFIT || (now != NULL && now->has_posture && !all_finite(fixed->joints, now->posture)) ||
        (now != NULL && now->joints != 0 && now->joints != fixed->joints) ||
        (fixed->law.form == BROUGHT && !(now != NULL && now->has_brought)))
        Py_RETURN_NONE;
    int m = fixed->joints;
    Beside beside = {.posture = now != NULL && now->has_posture ? now->posture : NULL};
    Row q, before;
    Pose target;
    double feedforward[6];
    bool ahead = arguments[4] != Py_None, towards = arguments[3] != Py_None, given = arguments[5] != Py_None;
    Tick tick;
    if ((given && (!vector(arguments[5], m, before) || !all_finite(m, before))) ||
        !vector(arguments[2], m, q) || !all_finite(m, q) || (towards && !target_pose(arguments[3], &target)) ||
        (ahead && (!vector(arguments[4], 6, feedforward) || !all_finite(6, feedforward))) || (!towards && !ahead))
        Py_RETURN_NONE;
    Outcome outcome = step_beside(fixed, now, &beside, q, towards ? &target : NULL, ahead ? feedforward : NULL, given ? before : NULL, kept, &tick);
    if (outcome == HAND_BACK)
        Py_RETURN_NONE;
    PyObject *rows = now != NULL && now->limits > 0 ? Py_NewRef(now->row_names) : NULL; /* where they are not called as the loop says */
    PyObject *found[] = {fields(m, &tick.solution, fixed, rows), joint_troubles(fixed, &tick)};
    if (found[0] != NULL)
        remembered(fixed, q, &tick, kept);
    return named(&PyTuple_Type, 2, found);
}

/* acts_at(loop, memory, q): joint positions when the command of this tick acts, and joint velocities before; None where q cannot be true, or Python has to
   say what is wrong with it. */
static PyObject *acts_at(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    const Loop *loop = count == 3 ? loop_of(arguments[0]) : NULL;
    const double *kept = loop == NULL ? NULL : memory_of(arguments[1], loop);
    Row q, there, before;
    double states[MOST_JOINT_STATES];
    if (kept == NULL)
        return refused("acts_at(loop, memory, q)");
    if (!vector(arguments[2], loop->joints, q) || !all_finite(loop->joints, q) || is_far(loop, q, NULL))
        Py_RETURN_NONE;
    joint_states(loop, q, kept, states);
    predicted(loop, kept, states, q, there, before);
    return Py_BuildValue("(NN)", new_vector(loop->joints, there), new_vector(loop->joints, before));
}

#define CALLED(name, function, does) {name, (PyCFunction)(void (*)(void))function, METH_FASTCALL, does}
#define CALLED_BY_NAME(name, function, does) \
    {name, (PyCFunction)(void (*)(void))function, METH_FASTCALL | METH_KEYWORDS, does}
static PyMethodDef methods[] = {
    CALLED("answer_as", answer_as, "Make every answer a VelocitySolution, this type, its status a member of this enum."),
    CALLED_BY_NAME("step", controller_step,
           "A controller's tick: a VelocitySolution, and what is to be said of joints beside it; None where Python has to answer."),
    CALLED("acts_at", acts_at, "Joint positions when the command of a tick acts and joint velocities before it, or None where Python has to find them."),
    CALLED("follow", follow, "A tick of a follower in which nothing new comes, or None where Python has to answer."),
    CALLED("splice", splice, "The residual of a splice, or None where it leaves the limits."),
    CALLED("planned", planned, "Coefficients of the motion from a state that is near points with little jerk."),
    CALLED("sight", sight,
           "Joint twists, tool pose and error of an arm, the error None where Python has to find it; or None."),
    CALLED_BY_NAME("tick", tick, "A VelocitySolution, or None where Python has to answer."),
    CALLED("pseudoinverse", pseudoinverse, "J^{+h}, or None where Python has to find it."),
    CALLED("projectors", dual_projectors, "The fields of DualProjectors in order, or None where Python has to find them."),
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_native", "The compiled tick; its sources are in csrc/.", -1, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__native(void)
{
    import_array();
    PyObject *module = PyModule_Create(&definition), *constants = PyDict_New();
    HOMOGENEOUS = PyUnicode_InternFromString("homogeneous");
    AS_MATRIX = PyUnicode_InternFromString("as_matrix");
    if (module == NULL || constants == NULL || HOMOGENEOUS == NULL || AS_MATRIX == NULL || !words_made(module) ||
        !types_made(module))
        return NULL;
    for (const Constant *constant = CONSTANTS; constant->name != NULL; constant++) {
        PyObject *value = PyFloat_FromDouble(constant->value);
        if (value == NULL || PyDict_SetItemString(constants, constant->name, value) < 0)
            return NULL;
        Py_DECREF(value);
    }
    if (PyModule_AddIntConstant(module, "MOST_JOINTS", MOST) < 0 || PyModule_AddIntConstant(module, "MOST_ROWS", MOST_ROWS) < 0 ||
        PyModule_AddIntConstant(module, "MOST_LIMITS", MOST_LIMITS) < 0)
        return NULL;
    return PyModule_AddObject(module, "CONSTANTS", constants) < 0 ? NULL : module;
}
