/* What a pose search calls from Python. Nothing is computed here. */

#include "boundary.h"
#include "pose.h"

/* descend(arm, target, start, goal, turning, patient, known): (q, f, unmet, merit, steps, met, at_rest, known), or None
   where Python has to. `known` is None at the start of a try and at its end; else the try goes on from q with it. */
PyObject *search_descend(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    const Arm *arm = count > 0 ? described(&TABLE_Arm, arguments[0]) : NULL;
    Pose target;
    Try found = {.known = {.damping = DAMPING}};
    const int knows = sizeof found.known / sizeof(double);
    if (count != 7 || arm == NULL ||
        (arguments[6] != Py_None && !vector(arguments[6], knows, (double *)&found.known)) ||
        !within(found.known.steps, 0, PATIENCE))
        return refused("descend(arm, target, start, goal, turning, patient, known)");
    int m = arm->joints;
    double goal = PyFloat_AsDouble(arguments[3]);
    int turning = PyObject_IsTrue(arguments[4]), patient = PyObject_IsTrue(arguments[5]);
    if (PyErr_Occurred())
        return NULL;
    if (!pose(arguments[1], &target) || !vector(arguments[2], m, found.q))
        Py_RETURN_NONE;
    Outcome outcome;
    Py_BEGIN_ALLOW_THREADS
    outcome = descend(arm, &target, goal, turning, patient, patient ? FINISHED : STALLED, &found);
    Py_END_ALLOW_THREADS
    if (outcome == HAND_BACK)
        Py_RETURN_NONE;
    return Py_BuildValue("(NdddlNNN)", new_vector(m, found.q), found.f, found.unmet, found.merit, (long)found.known.steps,
                         PyBool_FromLong(found.met), PyBool_FromLong(found.at_rest),
                         found.going ? new_vector(knows, (const double *)&found.known) : Py_NewRef(Py_None));
}

/* descents(arm, targets, start, goal, turning, fastest, steps): joint positions (k, m) for the first k of several poses, each
   from the one before, k the first that is not met (beside exact demands: they are not), or not near enough to be reached at
   speeds `fastest` in a step [s]; all where there is none such. Beside exact demands, the rest begins where it ended before. */
PyObject *search_along(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    const Arm *arm = count > 0 ? described(&TABLE_Arm, arguments[0]) : NULL;
    PyArrayObject *targets = count == 7 ? (PyArrayObject *)arguments[1] : NULL;
    Row q, fastest;
    static const char *const USE = "descents(arm, targets, start, goal, turning, fastest, steps)";
    if (arm == NULL || targets == NULL || !PyArray_Check(arguments[1]) || PyArray_TYPE(targets) != NPY_DOUBLE ||
        !PyArray_ISCARRAY_RO(targets) || PyArray_NDIM(targets) != 3 || PyArray_DIM(targets, 1) != 4 || PyArray_DIM(targets, 2) != 4)
        return refused(USE);
    int m = arm->joints, n = (int)PyArray_DIM(targets, 0), met = 0;
    double goal = PyFloat_AsDouble(arguments[3]);
    int turning = PyObject_IsTrue(arguments[4]);
    npy_intp sizes[2] = {n, m};
    PyObject *steps = PyArray_SimpleNew(1, sizes, NPY_DOUBLE), *found = PyArray_SimpleNew(2, sizes, NPY_DOUBLE);
    if (steps == NULL || found == NULL || PyErr_Occurred() || !vector(arguments[2], m, q) || !vector(arguments[5], m, fastest) ||
        !vector(arguments[6], n, PyArray_DATA((PyArrayObject *)steps))) {
        Py_XDECREF(steps);
        Py_XDECREF(found);
        return refused(USE);
    }
    const double *poses = PyArray_DATA(targets), *step = PyArray_DATA((PyArrayObject *)steps);
    double *rows = PyArray_DATA((PyArrayObject *)found);
    Py_BEGIN_ALLOW_THREADS
    for (bool near = true; met < n && near; met += near) {
        Try one = {.known = {.damping = DAMPING}};
        Pose target;
        pose_from(poses + 16 * met, &target);
        memcpy(one.q, q, sizeof q);
        near = descend(arm, &target, goal, turning, false, arm->wanted > 0.0 ? FINISHED : STALLED, &one) == DONE &&
               (one.met || (arm->wanted > 0.0 && !one.going && one.unmet <= goal));
        for (int j = 0; j < m && near; j++)
            near = fabs(one.q[j] - q[j]) <= fastest[j] * step[met];
        if (near) {
            memcpy(q, one.q, sizeof q);
            memcpy(rows + met * m, q, (size_t)m * sizeof *q);
        }
    }
    Py_END_ALLOW_THREADS
    Py_DECREF(steps);
    return Py_BuildValue("(Ni)", found, met);
}

/* misses(arm, target, q): distance and angle of the tool from its target. */
PyObject *search_misses(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    const Arm *arm = count > 0 ? described(&TABLE_Arm, arguments[0]) : NULL;
    Pose target;
    Row q;
    double position, orientation;
    if (count != 3 || arm == NULL)
        return refused("misses(arm, target, q)");
    if (!pose(arguments[1], &target) || !vector(arguments[2], arm->joints, q))
        Py_RETURN_NONE;
    misses(arm, &target, q, &position, &orientation);
    return Py_BuildValue("(dd)", position, orientation);
}
