/* What a path follower calls from Python. Nothing is computed here. */

#include "boundary.h"
#include "path.h"

/* Read a course: joints, knots of the plan, knots of the curve, and so on, then the arrays one by one. */
static bool course_of(PyObject *object, Course *course)
{
    enum { FIRST = 10, MOST_KNOTS = 1000000 };
    if (!PyArray_Check(object))
        return false;
    PyArrayObject *array = (PyArrayObject *)object;
    npy_intp size = PyArray_SIZE(array);
    if (PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISCARRAY_RO(array) || size < FIRST)
        return false;
    const double *numbers = PyArray_DATA(array);
    for (int i = 0; i < 3; i++)
        if (!(numbers[i] >= (i == 0 ? 1.0 : 2.0) && numbers[i] <= (i == 0 ? MOST : MOST_KNOTS)))
            return false;
    npy_intp m = course->m = (int)numbers[0], n = course->knots = (int)numbers[1], k = course->poses = (int)numbers[2];
    course->slow = numbers[3];
    course->rate = numbers[4];
    course->most = numbers[5];
    course->jerk = numbers[6];
    course->tolerance = numbers[7];
    course->braking = numbers[8];
    course->cut = numbers[9] != 0.0;
    course->at = numbers + FIRST;
    course->forward = course->at + n;
    course->backward = course->forward + n;
    course->off = course->backward + n;
    course->ratio = course->off + n;
    course->q = course->ratio + n;
    course->slopes = course->q + n * m;
    course->curve_at = course->slopes + n * m;
    course->places = course->curve_at + k;
    course->pose = course->places + k;
    course->cubics = course->pose + 16 * k;
    return size == FIRST + n * (5 + 2 * m) + k * 18 + (k - 1) * 18;
}

/* Read a PathState of Python: (place, speed, acceleration, back, along, velocity, tangent or None, ticks). */
static bool state_of(PyObject *tuple, int m, Travel *state)
{
    if (!PyTuple_Check(tuple) || PyTuple_Size(tuple) != 8)
        return false;
    state->place = PyFloat_AsDouble(PyTuple_GetItem(tuple, 0));
    state->speed = PyFloat_AsDouble(PyTuple_GetItem(tuple, 1));
    state->acceleration = PyFloat_AsDouble(PyTuple_GetItem(tuple, 2));
    state->back = PyTuple_GetItem(tuple, 3) == Py_True;
    PyObject *tangent = PyTuple_GetItem(tuple, 6);
    state->has_tangent = tangent != Py_None;
    return !PyErr_Occurred() && isfinite(state->place) && vector(PyTuple_GetItem(tuple, 4), m, state->along) &&
           vector(PyTuple_GetItem(tuple, 5), m, state->velocity) &&
           (!state->has_tangent || vector(tangent, 6, state->tangent));
}

/* drive(loop, memory, course, q, state, velocity or None, override, paused, back): (VelocitySolution, PathState after it,
   place, speed, across, ruling, status, whether Python has words to add), the velocity kept in the memory, or None where
   Python has to drive. */
PyObject *path_drive(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Course course;
    Travel before;
    Progress progress;
    Row q;
    const Loop *loop = count == 9 ? loop_of(arguments[0]) : NULL;
    double *kept = loop == NULL ? NULL : memory_of(arguments[1], (int)loop->joints);
    if (kept == NULL || !course_of(arguments[2], &course) || course.m != (int)loop->joints)
        return refused("drive(loop, memory, course, q, state, velocity, override, paused, back)");
    int m = course.m;
    PyObject *state = arguments[4];
    bool number = PyFloat_Check(arguments[6]) || PyLong_CheckExact(arguments[6]);
    Order order = {.override = number ? PyFloat_AsDouble(arguments[6]) : -1.0,
                   .paused = arguments[7] == Py_True,
                   .back = arguments[8] == Py_True};
    bool good = order.override >= 0.0 && order.override <= FASTEST && vector(arguments[3], m, q) && all_finite(m, q) &&
                state_of(state, m, &before) && (arguments[5] == Py_None || vector(arguments[5], m, before.velocity)) &&
                all_finite(m, before.velocity);
    long ticks = good ? PyLong_AsLong(PyTuple_GetItem(state, 7)) : 0;
    if (PyErr_Occurred()) {
        PyErr_Clear(); /* Python says what is wrong */
        good = false;
    }
    if (!good || drive(loop, &course, &before, q, &order, &progress) == HAND_BACK)
        Py_RETURN_NONE;
    const Travel *after = &progress.after;
    PyObject *fields_after[] = {
        PyFloat_FromDouble(after->place), PyFloat_FromDouble(after->speed), PyFloat_FromDouble(after->acceleration),
        PyBool_FromLong(after->back),     new_vector(m, after->along),      new_vector(m, after->velocity),
        new_vector(6, after->tangent),    PyLong_FromLong(ticks + 1),
    };
    PyObject *found[] = {
        fields(m, &progress.answer),
        named(Py_TYPE(state), sizeof fields_after / sizeof *fields_after, fields_after),
        PyFloat_FromDouble(progress.place),
        PyFloat_FromDouble(progress.speed),
        PyFloat_FromDouble(progress.across),
        PyLong_FromLong(progress.ruling),
        PyUnicode_InternFromString(progress.status),
        PyBool_FromLong(is_outside(loop, q, &progress.answer)),
    };
    PyObject *answer = named(&PyTuple_Type, sizeof found / sizeof *found, found);
    if (answer != NULL)
        memcpy(kept + KEPT, after->velocity, (size_t)m * sizeof(double));
    return answer;
}
