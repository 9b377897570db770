/* A VelocitySolution: numbers, joints at a limit, and the reason as velocity/report.py words it. */

#include "boundary.h"
#include <stdarg.h>

typedef enum { OK, LIMITED, SCALED, GUARDED, DEGRADED } Status;
/* In the order of Method and Status. */
static const char *const METHOD[] = {"closed-form", "damped", "qp"};
static const char *const STATUS[] = {"ok", "limited", "scaled", "guarded", "degraded"};

/* The type of answers, and what many of them share; made once. */
static PyTypeObject *ANSWER;
static PyObject *METHODS[3], *STATUSES[5], *NATIVE, *NOTHING, *NONE_ACTIVE, *ZERO, *ONE;

bool words_made(void)
{
    bool good = true;
    for (int i = 0; i < 3; i++)
        good = (METHODS[i] = PyUnicode_InternFromString(METHOD[i])) != NULL && good;
    NATIVE = PyUnicode_InternFromString("native");
    NOTHING = PyUnicode_InternFromString("");
    NONE_ACTIVE = PyTuple_New(0);
    ZERO = PyFloat_FromDouble(0.0);
    ONE = PyFloat_FromDouble(1.0);
    return good && NATIVE != NULL && NOTHING != NULL && NONE_ACTIVE != NULL && ZERO != NULL && ONE != NULL;
}

/* Take the type of answers, a named tuple, and the members of their enum of statuses, by their words; false with an
   error where they are something else. Both are kept. */
bool taken_as(const char *use, PyObject *const *arguments, Py_ssize_t count, const char *const *words, int n,
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

/* Longer than any reason. */
#define WORDS 2048

/* Write at the end of words. */
static void put(char *words, const char *format, ...)
{
    size_t used = strlen(words);
    va_list rest;
    va_start(rest, format);
    PyOS_vsnprintf(words + used, WORDS - used, format, rest);
    va_end(rest);
}

/* Write text and a number: `code` and `digits` as in a format of Python, whatever the locale. */
static bool add(char *words, const char *text, double number, char code, int digits)
{
    char *written = PyOS_double_to_string(number, code, digits, 0, NULL);
    if (written == NULL)
        return false;
    put(words, "%s%s", text, written);
    PyMem_Free(written);
    return true;
}

/* Begin another part of the reason. */
static void say(char *words, const char *text) { put(words, "%s%s", words[0] != 0 ? "; " : "", text); }

/* Write "joint 3" or "joints 0, 2", after `lead`; how many they are. */
static int name(char *words, const char *lead, const char *what, int n, const bool *which)
{
    int count = 0, told = 0;
    for (int j = 0; j < n; j++)
        count += which[j];
    if (count > 0)
        put(words, "%s%s%s ", lead, what, count > 1 ? "s" : "");
    for (int j = 0; j < n; j++)
        if (which[j])
            put(words, "%s%d", told++ > 0 ? ", " : "", j);
    return count;
}

static Status status(const Solution *solution)
{
    if (solution->yielded.rows > 0 || solution->yielded.speed > 0.0 || solution->unmet > 0.0 || solution->beyond > 0.0)
        return DEGRADED;
    return solution->slow ? SCALED : solution->blended > 0.0 ? GUARDED : solution->limited ? LIMITED : OK;
}

static PyObject *reason(int m, const Solution *solution)
{
    static const char *const HELD = " (held by ";
    char words[WORDS];
    bool good = true;
    words[0] = 0;
    const Yielded *yielded = &solution->yielded;
    if (yielded->rows > 0) {
        say(words, "rows contradict ");
        if (name(words, "the bounds of ", "joint", m, yielded->to) == 0)
            put(words, "each other");
        for (int i = 0, told = 0; i < yielded->rows; i++) {
            if (yielded->by[i] == 0.0)
                continue;
            put(words, "%srow %d", told++ > 0 ? ", " : ": exceeded at ", i);
            good = add(words, " by ", fabs(yielded->by[i]), 'g', 3) && good;
        }
    }
    if (yielded->speed > 0.0) {
        say(words, "the tool's speed is ");
        good = add(words, "", yielded->speed, 'g', 3) && good;
        good = add(words, ", not ", yielded->limit, 'g', 3) && good;
        put(words, ": other limits require it");
    }
    if (solution->unmet > 0.0) {
        say(words, "the joints cannot keep the direction of the exact rows: ");
        good = add(words, "", solution->unmet, 'e', 1) && good;
        put(words, " of the demand is unmet");
    }
    if (solution->beyond > 0.0) {
        say(words, "this arm can keep ");
        put(words, "%d of the exact rows: ", solution->row_rank);
        good = add(words, "", solution->beyond, 'e', 1) && good;
        put(words, " of the demand is unmet");
    }
    if (solution->stuck)
        say(words, "no velocity reduces the error: it is the least that these joints and limits allow");
    if (solution->slow) {
        say(words, "limits allow ");
        good = add(words, "", solution->scale, 'g', 3) && good;
        put(words, " of the exact rows' speed");
        int held = name(words, HELD, "joint", m, solution->held_by);
        held += name(words, held > 0 ? " and " : HELD, "row", solution->limits, solution->held_by + m);
        if (solution->fast)
            put(words, "%sthe tool's speed", held > 0 ? " and " : HELD);
        put(words, held > 0 || solution->fast ? ")" : "");
        for (int i = 0, told = 0; i < solution->rows; i++) {
            if (solution->beside[i] == 0.0)
                continue;
            put(words, "%sexact row %d", told++ > 0 ? ", " : "; limits require motion beside it: ", i);
            good = add(words, " is off by ", solution->beside[i], 'g', 3) && good;
        }
    }
    if (solution->pace < WHOLE_SPEED) {
        say(words, "limits allow ");
        good = add(words, "", solution->pace, 'g', 3) && good;
        put(words, " of the approach's speed");
    }
    if (solution->blended > 0.0) {
        say(words, "descent guard: ");
        good = add(words, "", solution->blended, 'g', 3) && good;
        put(words, " of least squares blended in");
    }
    if (solution->damping > 0.0) {
        say(words, "near a singularity: the smallest singular value is ");
        good = add(words, "", solution->ratio, 'e', 1) && good;
        put(words, " of the largest; damped");
    }
    if (status(solution) == LIMITED && !solution->stuck && solution->pace >= WHOLE_SPEED) {
        say(words, "");
        good = add(words, "", solution->missed, 'g', 2) && good;
        put(words, " of the twist is missed");
    }
    name(words, words[0] != 0 ? "; at the limits of " : "at the limits of ", "joint", m, solution->active);
    return !good ? NULL : words[0] != 0 ? PyUnicode_FromString(words) : Py_NewRef(NOTHING);
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

const char *method_word(const Solution *solution) { return METHOD[solution->method]; }

const char *status_word(const Solution *solution) { return STATUS[status(solution)]; }

/* A VelocitySolution, its fields in their order. */
PyObject *fields(int m, const Solution *solution)
{
    if (ANSWER == NULL) return refused("answer_as(VelocitySolution) comes first");
    bool met = solution->met, rows = met && solution->limits > 0;
    PyObject *values[] = {
        new_vector(m, solution->velocity),
        Py_NewRef(METHODS[solution->method]),
        Py_NewRef(STATUSES[status(solution)]),
        reason(m, solution),
        joints(m, solution->active),
        new_vector(6, solution->residual),
        number(solution->scale),
        number(solution->damping),
        number(solution->blended),
        Py_NewRef(met ? NATIVE : NOTHING),
        met ? new_vector(m, solution->multipliers) : Py_NewRef(Py_None),
        rows ? new_vector(solution->limits, solution->multipliers + m) : Py_NewRef(Py_None),
    };
    return named(ANSWER, sizeof values / sizeof *values, values);
}

/* Whether a velocity and a residual are all there is to say. */
bool is_plain(const Solution *solution)
{
    if (solution->method != CLOSED_FORM || status(solution) != OK)
        return false;
    for (int j = 0; j < solution->m; j++)
        if (solution->active[j])
            return false;
    return true;
}
