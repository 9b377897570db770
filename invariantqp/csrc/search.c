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
    outcome = descend(arm, &target, goal, turning, patient, &found);
    Py_END_ALLOW_THREADS
    if (outcome == HAND_BACK)
        Py_RETURN_NONE;
    return Py_BuildValue("(NdddlNNN)", new_vector(m, found.q), found.f, found.unmet, found.merit, (long)found.known.steps,
                         PyBool_FromLong(found.met), PyBool_FromLong(found.at_rest),
                         found.going ? new_vector(knows, (const double *)&found.known) : Py_NewRef(Py_None));
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
