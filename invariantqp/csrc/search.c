/* What a pose search calls from Python. Nothing is computed here. */

#include "boundary.h"
#include "pose.h"

static bool arm_of(PyObject *object, Arm *arm)
{
    return vector(object, sizeof *arm / sizeof(double), (double *)arm) && within(arm->joints, 1, MOST) &&
           within(arm->wanted, 0, MOST_ROWS);
}

/* arm((m, length, k), point, home, screws, lower, upper, turn, whole, (k, 8 + m) exact): a float64 array for `descend` and `misses`. */
PyObject *search_arm(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Arm made = {.joints = 0.0};
    double first[3];
    bool good = count == 9 && vector(arguments[0], 3, first) && first[0] >= 1.0 && first[0] <= MOST && first[2] >= 0.0 &&
                first[2] <= MOST_ROWS;
    int m = good ? (int)first[0] : 0;
    memcpy(&made, first, good ? sizeof first : 0);
    if (!good || !vector(arguments[1], 3, made.point) || !matrix(arguments[2], 4, 4, 4, made.home) ||
        !matrix(arguments[3], 6, m, MOST, made.screws[0]) || !vector(arguments[4], m, made.lower) ||
        !vector(arguments[5], m, made.upper) || !vector(arguments[6], m, made.turn) ||
        !vector(arguments[7], m, made.whole) ||
        !matrix(arguments[8], (int)made.wanted, 8 + m, 8 + MOST, (double *)made.exact))
        return refused("arm((m, length, k), point, home, screws, lower, upper, turn, whole, exact)");
    return new_vector(sizeof made / sizeof(double), (const double *)&made);
}

/* descend(arm, target, start, goal, turning, patient, known): (q, f, unmet, merit, steps, met, at_rest, known), or None
   where Python has to. `known` is None at the start of a try and at its end; else the try goes on from q with it. */
PyObject *search_descend(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Arm arm;
    Pose target;
    Try found = {.known = {.damping = DAMPING}};
    const int knows = sizeof found.known / sizeof(double);
    if (count != 7 || !arm_of(arguments[0], &arm) ||
        (arguments[6] != Py_None && !vector(arguments[6], knows, (double *)&found.known)) ||
        !within(found.known.steps, 0, PATIENCE))
        return refused("descend(arm, target, start, goal, turning, patient, known)");
    int m = (int)arm.joints;
    double goal = PyFloat_AsDouble(arguments[3]);
    int turning = PyObject_IsTrue(arguments[4]), patient = PyObject_IsTrue(arguments[5]);
    if (PyErr_Occurred())
        return NULL;
    if (!pose(arguments[1], &target) || !vector(arguments[2], m, found.q))
        Py_RETURN_NONE;
    Outcome outcome;
    Py_BEGIN_ALLOW_THREADS
    outcome = descend(&arm, &target, goal, turning, patient, &found);
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
    Arm arm;
    Pose target;
    Row q;
    double position, orientation;
    if (count != 3 || !arm_of(arguments[0], &arm))
        return refused("misses(arm, target, q)");
    if (!pose(arguments[1], &target) || !vector(arguments[2], (int)arm.joints, q))
        Py_RETURN_NONE;
    misses(&arm, &target, q, &position, &orientation);
    return Py_BuildValue("(dd)", position, orientation);
}
