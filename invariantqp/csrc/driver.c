/* What a path follower calls from Python. Nothing is computed here. */

#include "boundary.h"
#include "path.h"

/* The type of answers, and the words of a Progress in their order; made once. */
static PyTypeObject *ANSWER;
static PyObject *STATUSES[4], *NOTHING;

/* tell_as(type, statuses): PathSolution and Status. */
PyObject *tell_as(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    static const char *const STATUS[] = {"moving", "slowed", "paused", "done"};
    if (NOTHING == NULL && (NOTHING = PyUnicode_InternFromString("")) == NULL)
        return NULL;
    return taken_as("tell_as(a named tuple, the enum of its statuses)", arguments, count, STATUS, 4, &ANSWER, STATUSES) ? Py_NewRef(Py_None) : NULL;
}

/* Read a course: joints, knots of the plan, knots of the curve, and so on, then the arrays one by one. */
static bool course_of(PyObject *object, Course *course)
{
    enum { FIRST = 12, MOST_KNOTS = 1000000 };
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
    course->above = numbers[10];
    course->up_to = numbers[11];
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

/* The numbers of a PathState, for reading and writing: STATE of them, then `along` and `velocity` (m,). */
static double *state_of(PyObject *object, int m)
{
    PyArrayObject *array = (PyArrayObject *)object;
    bool good = PyArray_Check(object) && PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISCARRAY(array) &&
                PyArray_SIZE(array) == STATE + 2 * m;
    return good ? PyArray_DATA(array) : NULL;
}

/* What rules, in words: of a knot, or from the end on. */
static PyObject *ruling(PyObject *words, int i)
{
    PyObject *word = PyTuple_GetItem(words, i < 0 ? PyTuple_Size(words) + i : i);
    return word == NULL ? NULL : Py_NewRef(word);
}

/* A PathSolution, its fields in their order. */
static PyObject *told(const Loop *loop, const Course *course, const Progress *progress, PyObject *words)
{
    PyObject *answer = ANSWER == NULL ? refused("tell_as(PathSolution) comes first") : fields(course->m, &progress->answer);
    if (answer == NULL)
        return NULL;
    double lag = course->rate > 0.0 ? progress->after.ticks * loop->dt - progress->place / course->rate : 0.0;
    PyObject *values[] = {
        Py_NewRef(PyTuple_GetItem(answer, 0)), /* velocity */
        Py_NewRef(STATUSES[progress->status]),
        Py_NewRef(progress->status == AT_END ? NOTHING : PyTuple_GetItem(answer, 3)), /* reasons */
        PyFloat_FromDouble(progress->place),
        PyFloat_FromDouble(progress->speed),
        ruling(words, progress->ruling),
        course->rate > 0.0 ? PyFloat_FromDouble(lag) : Py_NewRef(Py_None),
        PyFloat_FromDouble(progress->across),
        answer,
    };
    return named(ANSWER, sizeof values / sizeof *values, values);
}

/* drive((loop, memory, state, numbers, rulings), q, velocity or None, override, paused, back): a PathSolution, and whether
   Python has words to add; state and memory are written. None, and both as they were, where Python has to drive. */
PyObject *path_drive(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    static const char *const USE = "drive((loop, memory, state, numbers, rulings), q, velocity, override, paused, back)";
    Course course;
    Travel before;
    Progress progress;
    Row q;
    PyObject *given = count == 6 && PyTuple_Check(arguments[0]) && PyTuple_Size(arguments[0]) == 5 ? arguments[0] : NULL;
    const Loop *loop = given == NULL ? NULL : loop_of(PyTuple_GetItem(given, 0));
    int m = loop == NULL ? 0 : (int)loop->joints;
    double *kept = m == 0 ? NULL : memory_of(PyTuple_GetItem(given, 1), loop);
    double *state = m == 0 ? NULL : state_of(PyTuple_GetItem(given, 2), m);
    PyObject *words = m == 0 ? NULL : PyTuple_GetItem(given, 4);
    if (kept == NULL || state == NULL || !course_of(PyTuple_GetItem(given, 3), &course) || course.m != m ||
        !PyTuple_Check(words) || PyTuple_Size(words) != course.knots - THE_TURN)
        return refused(USE);
    size_t joints = (size_t)m * sizeof(double), head = offsetof(Travel, along);
    memcpy(&before, state, head);
    course.piece = piece_of(course.knots, course.at, before.place);
    course.part = piece_of(course.poses, course.curve_at, before.place);
    memcpy(before.along, state + STATE, joints);
    memcpy(before.velocity, state + STATE + m, joints);
    bool number = PyFloat_Check(arguments[3]) || PyLong_CheckExact(arguments[3]);
    Order order = {.override = number ? PyFloat_AsDouble(arguments[3]) : -1.0,
                   .paused = arguments[4] == Py_True,
                   .back = arguments[5] == Py_True};
    bool good = order.override >= 0.0 && order.override > course.above && order.override <= course.up_to &&
                vector(arguments[1], m, q) && all_finite(m, q) && isfinite(before.place) &&
                (arguments[2] == Py_None || vector(arguments[2], m, before.velocity)) && all_finite(m, before.velocity);
    if (PyErr_Occurred()) {
        PyErr_Clear(); /* Python says what is wrong */
        good = false;
    }
    Row there;
    if (good)
        predicted(loop, kept, q, there);
    if (!good || drive(loop, &course, &before, q, there, &order, &progress) == HAND_BACK)
        Py_RETURN_NONE;
    PyObject *found[] = {told(loop, &course, &progress, words), NULL};
    if (found[0] == NULL)
        return NULL;
    memcpy(state, &progress.after, head);
    memcpy(state + STATE, progress.after.along, joints);
    memcpy(state + STATE + m, progress.after.velocity, joints);
    remembered(loop, q, progress.after.velocity, kept);
    found[1] = PyBool_FromLong(is_outside(loop, q, &progress.answer));
    return named(&PyTuple_Type, 2, found);
}
