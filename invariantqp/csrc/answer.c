/* A VelocitySolution: numbers, joints at a limit, and reasons as velocity/reasons.py reads them. */

#include "boundary.h"

/* In the order of Method and Status. */
static const char *const METHOD[] = {"closed-form", "damped", "qp"};
static const char *const STATUS[] = {"ok", "limited", "scaled", "guarded", "degraded"};

/* The type of answers, and what many of them share; made once. */
static PyTypeObject *ANSWER;
static PyObject *METHODS[3], *STATUSES[5], *NATIVE, *NOTHING, *NONE_ACTIVE, *ZERO, *ONE;

bool words_made(PyObject *module)
{
    bool good = true;
    for (int i = 0; i < 3; i++)
        good = (METHODS[i] = PyUnicode_InternFromString(METHOD[i])) != NULL && good;
    NATIVE = PyUnicode_InternFromString("native");
    NOTHING = PyUnicode_InternFromString("");
    NONE_ACTIVE = PyTuple_New(0);
    ZERO = PyFloat_FromDouble(0.0);
    ONE = PyFloat_FromDouble(1.0);
    PyObject *methods = Py_BuildValue("(sss)", METHOD[0], METHOD[1], METHOD[2]);
    PyObject *statuses = Py_BuildValue("(sssss)", STATUS[0], STATUS[1], STATUS[2], STATUS[3], STATUS[4]);
    good = PyModule_AddObject(module, "METHODS", methods) == 0 && PyModule_AddObject(module, "STATUSES", statuses) == 0 && good;
    return good && NATIVE != NULL && NOTHING != NULL && NONE_ACTIVE != NULL && ZERO != NULL && ONE != NULL;
}

/* Take the type of answers, a named tuple, and the members of their enum of statuses, by their words; false with an
   error where they are something else. Both are kept. */
static bool taken_as(const char *use, PyObject *const *arguments, Py_ssize_t count, const char *const *words, int n,
              PyTypeObject **answer, PyObject **statuses)
{
    if (count != 2 || !PyType_Check(arguments[0]) ||
        !PyType_IsSubtype((PyTypeObject *)arguments[0], &PyTuple_Type)) {
        refused(use);
        return false;
    }
    for (int i = 0; i < n; i++) {
        PyObject *status = PyObject_CallFunction(arguments[1], "s", words[i]);
        if (status == NULL)
            return false;
        Py_XDECREF(statuses[i]);
        statuses[i] = status;
    }
    Py_XDECREF(*answer);
    *answer = (PyTypeObject *)Py_NewRef(arguments[0]);
    return true;
}

/* answer_as(type, statuses): VelocitySolution and Status. */
PyObject *answer_as(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    return taken_as("answer_as(a named tuple, the enum of its statuses)", arguments, count, STATUS, 5, &ANSWER, STATUSES) ? Py_NewRef(Py_None) : NULL;
}

/* A tuple of some type with these values, which it takes over; NULL where one of them is. */
PyObject *named(PyTypeObject *type, int n, PyObject *const *values)
{
    bool good = true;
    for (int i = 0; i < n; i++)
        good = good && values[i] != NULL;
    PyObject *tuple = NULL;
    if (good)
        tuple = type == &PyTuple_Type ? PyTuple_New(n) : ((allocfunc)PyType_GetSlot(type, Py_tp_alloc))(type, n);
    for (int i = 0; i < n; i++)
        if (tuple == NULL)
            Py_XDECREF(values[i]);
        else
            PyTuple_SetItem(tuple, i, values[i]);
    return tuple;
}

/* Most numbers of an answer are 0 or 1. */
static PyObject *number(double x)
{
    return x == 0.0 ? Py_NewRef(ZERO) : x == 1.0 ? Py_NewRef(ONE) : PyFloat_FromDouble(x);
}

Status status(const Solution *solution)
{
    if (solution->yielded.rows > 0 || solution->yielded.speed > 0.0 || solution->unmet > 0.0 || solution->beyond > 0.0)
        return DEGRADED;
    return solution->slow ? SCALED : solution->blended > 0.0 ? GUARDED : solution->limited ? LIMITED : OK;
}

/* Reasons as velocity/reasons.py reads them, one after another: a code, how many joints, rows and numbers, and these. */
typedef struct {
    int last, count;
    double at[512];
} Reasons;
enum { JOINT = 1, LIMIT, NUMBER };

/* Begin a reason. */
static void say(Reasons *reasons, Code code)
{
    reasons->last = reasons->count;
    reasons->count += 4;
    for (int i = 0; i < 4; i++)
        reasons->at[reasons->last + i] = i == 0 ? code : 0.0;
}

/* Add to the reason begun last: its joints first, then its rows, then its numbers. */
static void add(Reasons *reasons, int kind, double x)
{
    reasons->at[reasons->last + kind] += 1.0;
    reasons->at[reasons->count++] = x;
}

/* Add limits by their ranks: joints in their order, the tool's speed, then rows, the one that pulls hardest first. */
static void add_limits(Reasons *reasons, int m, int rows, const unsigned char *ranks, bool fast)
{
    for (int j = 0; j < m; j++)
        if (ranks[j] > 0)
            add(reasons, JOINT, j);
    if (fast)
        add(reasons, LIMIT, TOOL_SPEED_ROW);
    for (int rank = 1; rank <= rows; rank++)
        for (int i = 0; i < rows; i++)
            if (ranks[m + i] == rank)
                add(reasons, LIMIT, i);
}

/* Add the rows that gave way, the one that is exceeded most first, then by how much. */
static void add_yielded(Reasons *reasons, int m, const Yielded *yielded)
{
    int order[MOST_LIMITS], count = 0;
    for (int i = 0; i < yielded->rows; i++) {
        int at = count;
        if (yielded->by[i] == 0.0)
            continue;
        for (; at > 0 && fabs(yielded->share[order[at - 1]]) < fabs(yielded->share[i]); at--)
            order[at] = order[at - 1];
        order[at] = i;
        count++;
    }
    for (int j = 0; j < m; j++)
        if (yielded->to[j])
            add(reasons, JOINT, j);
    for (int i = 0; i < count; i++)
        add(reasons, LIMIT, order[i]);
    for (int i = 0; i < count; i++)
        add(reasons, NUMBER, fabs(yielded->by[order[i]]));
}

/* The bytes that Python reads; `nothing` for none. */
static PyObject *written(const Reasons *reasons, PyObject *nothing)
{
    return reasons->count == 0 ? Py_NewRef(nothing)
                               : PyBytes_FromStringAndSize((const char *)reasons->at, reasons->count * (Py_ssize_t)sizeof(double));
}

/* What is said of the states of joints: those that stand or, of joints that move, how they do. */
static void add_joint_trouble(Reasons *found, int joints, double dt, double gain, double fastest_gain, bool chases, const double *states)
{
    if (any_unresponsive(states, joints)) {
        say(found, WHY_NO_MOTION);
        for (int j = 0; j < joints; j++)
            if (states[UNRESPONSIVE_ROW * joints + j] > 0.0)
                add(found, JOINT, j);
        return;
    }
    JointTrouble trouble = joint_trouble(joints, dt, gain, fastest_gain, chases, states);
    if (trouble.code == 0)
        return;
    say(found, trouble.code);
    if (trouble.code == WHY_NOT_FOLLOWING)
        add(found, JOINT, trouble.joint);
    for (int i = 0; i < 3 && trouble.code != WHY_NOT_FOLLOWING; i++)
        add(found, NUMBER, trouble.numbers[i]);
}

/* The same alone; None for nothing. */
PyObject *state_troubles(int joints, double dt, double gain, const double *states)
{
    Reasons found = {.count = 0};
    add_joint_trouble(&found, joints, dt, gain, gain, false, states);
    return written(&found, Py_None);
}

/* What of a loop's joints is to be said beside the reasons of a solution; None for nothing. */
PyObject *joint_troubles(const Loop *loop, const Tick *tick)
{
    Reasons found = {.count = 0};
    add_joint_trouble(&found, loop->joints, loop->dt, loop->gain, fmax(loop->gain, loop->rate), tick->chased, tick->states);
    for (int j = 0; j < loop->joints; j++)
        if (tick->outside[j] > 0.0) {
            say(&found, WHY_OUTSIDE);
            add(&found, JOINT, j);
            add(&found, NUMBER, tick->outside[j]);
        }
    for (int j = 0; j < loop->joints; j++)
        if (tick->acceleration[j] > 0.0) {
            say(&found, WHY_ACCELERATION);
            add(&found, JOINT, j);
            add(&found, NUMBER, tick->acceleration[j]);
            add(&found, NUMBER, loop->acceleration[j]);
        }
    return written(&found, Py_None);
}

/* The reasons of a solution; those of most ticks are none. */
static PyObject *reasons(int m, const Solution *solution)
{
    Reasons found = {.count = 0};
    const Yielded *yielded = &solution->yielded;
    if (yielded->rows > 0) {
        say(&found, WHY_ROWS_CONTRADICT);
        add_yielded(&found, m, yielded);
    }
    if (yielded->speed > 0.0) {
        say(&found, WHY_TOOL_FASTER);
        add(&found, NUMBER, yielded->speed);
        add(&found, NUMBER, yielded->limit);
    }
    if (solution->unmet > 0.0) {
        say(&found, WHY_ROWS_UNKEPT);
        add(&found, NUMBER, solution->unmet);
    }
    if (solution->beyond > 0.0) {
        say(&found, WHY_ROWS_TOO_MANY);
        add(&found, NUMBER, solution->row_rank);
        add(&found, NUMBER, solution->beyond);
    }
    if (solution->stuck)
        say(&found, WHY_STUCK);
    if (solution->slow) {
        say(&found, WHY_ROWS_SLOWED);
        add(&found, NUMBER, solution->scale);
    }
    if (solution->rows > 0)
        say(&found, WHY_ROWS_MOVED);
    for (int i = 0; i < solution->rows; i++)
        if (solution->beside[i] != 0.0)
            add(&found, LIMIT, FIRST_EXACT_ROW - i);
    for (int i = 0; i < solution->rows; i++)
        if (solution->beside[i] != 0.0)
            add(&found, NUMBER, solution->beside[i]);
    if (solution->pace < WHOLE_SPEED) {
        say(&found, WHY_CHASE_SLOWED);
        add(&found, NUMBER, solution->pace);
    }
    if (solution->blended > 0.0) {
        say(&found, WHY_GUARDED);
        add(&found, NUMBER, solution->blended);
    }
    if (solution->damping > 0.0) {
        say(&found, WHY_DAMPED);
        add(&found, NUMBER, solution->ratio);
    }
    bool limited = status(solution) == LIMITED, few = limited && solution->achievable < 1.0;
    double explained = few ? sqrt(1.0 - solution->achievable) + MISSED_SHARE : 0.0;
    bool more = limited && !solution->stuck && solution->rows == 0 && solution->pace >= WHOLE_SPEED && solution->missed >= explained;
    if (more && isfinite(solution->missed) && solution->method == CLOSED_FORM)
        say(&found, WHY_CALMED);
    if (few) {
        say(&found, WHY_FEW_JOINTS);
        add(&found, NUMBER, solution->m);
        add(&found, NUMBER, solution->achievable);
    }
    if (few && solution->position_alone)
        say(&found, WHY_POSITION_ALONE);
    if (more) {
        say(&found, isfinite(solution->missed) ? WHY_MISSED : WHY_MOVED);
        if (isfinite(solution->missed))
            add(&found, NUMBER, solution->missed);
    }
    bool at_limits = solution->at_speed;
    for (int i = 0; i < m + solution->limits; i++)
        at_limits = at_limits || solution->at_limit[i] > 0;
    if (at_limits) {
        say(&found, WHY_AT_LIMITS);
        add_limits(&found, m, solution->limits, solution->at_limit, solution->at_speed);
    }
    return written(&found, NONE_ACTIVE);
}

/* Those that are active. */
static PyObject *joints(int m, const bool *active)
{
    int count = 0;
    for (int j = 0; j < m; j++)
        count += active[j];
    if (count == 0)
        return Py_NewRef(NONE_ACTIVE);
    PyObject *found[MOST];
    for (int j = 0, k = 0; j < m; j++)
        if (active[j])
            found[k++] = PyLong_FromLong(j);
    return named(&PyTuple_Type, count, found);
}

/* A VelocitySolution, its fields in their order, of a tick of a loop or of none (NULL). Its rows are called as the loop says,
   unless there is another tuple, which this takes over. */
PyObject *fields(int m, const Solution *solution, const Loop *loop, PyObject *row_names)
{
    if (ANSWER == NULL) return refused("answer_as(VelocitySolution) comes first");
    bool met = solution->met, rows = met && solution->limits > 0;
    PyObject *values[] = {
        new_vector(m, solution->velocity),
        Py_NewRef(METHODS[solution->method]),
        Py_NewRef(STATUSES[status(solution)]),
        reasons(m, solution),
        joints(m, solution->active),
        new_vector(6, solution->residual),
        number(solution->scale),
        number(solution->damping),
        number(solution->blended),
        Py_NewRef(met ? NATIVE : NOTHING),
        met ? new_vector(m, solution->multipliers) : Py_NewRef(Py_None),
        rows ? new_vector(solution->limits, solution->multipliers + m) : Py_NewRef(Py_None),
        row_names != NULL ? row_names : Py_NewRef(loop != NULL ? loop->row_names : NONE_ACTIVE),
        Py_NewRef(loop != NULL ? loop->joint_names : NONE_ACTIVE),
    };
    return named(ANSWER, sizeof values / sizeof *values, values);
}
