/* The fields of a VelocitySolution: numbers, joints at a limit, and the reason as velocity/report.py words it. */

#include "boundary.h"

/* Longer than any reason. */
#define WORDS 1024

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

/* Write "joint 3" or "joints 0, 2", after `between`; how many they are. */
static int name(char *words, const char *between, const char *what, int n, const bool *which)
{
    int count = 0, told = 0;
    for (int j = 0; j < n; j++)
        count += which[j];
    if (count > 0)
        PyOS_snprintf(words + strlen(words), WORDS - strlen(words), "%s%s%s ", between, what, count > 1 ? "s" : "");
    for (int j = 0; j < n; j++)
        if (which[j])
            PyOS_snprintf(words + strlen(words), WORDS - strlen(words), "%s%d", told++ > 0 ? ", " : "", j);
    return count;
}

static PyObject *reason(int m, const Solution *solution)
{
    char words[WORDS] = "";
    if (solution->stuck)
        say(words, "no velocity reduces the error: it is the least that these joints and limits allow");
    if (solution->slow) {
        say(words, "limits allow ");
        if (!add(words, "", solution->scale, 'g', 3))
            return NULL;
        PyOS_snprintf(words + strlen(words), WORDS - strlen(words), " of the exact rows' speed");
        int held = name(words, " (held by ", "joint", m, solution->held_by);
        held += name(words, held > 0 ? " and " : " (held by ", "row", solution->limits, solution->held_by + m);
        if (solution->fast)
            PyOS_snprintf(words + strlen(words), WORDS - strlen(words), "%sthe tool's speed", held ? " and " : " (held by ");
        PyOS_snprintf(words + strlen(words), WORDS - strlen(words), "%s", held || solution->fast ? ")" : "");
        for (int i = 0, told = 0; i < solution->rows; i++) {
            if (solution->beside[i] == 0.0)
                continue;
            PyOS_snprintf(words + strlen(words), WORDS - strlen(words), "%sexact row %d",
                          told++ > 0 ? ", " : "; limits require motion beside it: ", i);
            if (!add(words, " is off by ", solution->beside[i], 'g', 3))
                return NULL;
        }
    }
    if (solution->blended > 0.0) {
        say(words, "descent guard: ");
        if (!add(words, "", solution->blended, 'g', 3))
            return NULL;
        PyOS_snprintf(words + strlen(words), WORDS - strlen(words), " of least squares blended in");
    }
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
    name(words, words[0] != 0 ? "; at the limits of " : "at the limits of ", "joint", m, solution->active);
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

Status status(const Solution *solution)
{
    if (solution->stuck || solution->lost)
        return DEGRADED;
    return solution->slow ? SCALED : solution->blended > 0.0 ? GUARDED : OK;
}

/* The fields of a VelocitySolution, in its order. */
PyObject *fields(int m, const Solution *solution)
{
    static const char *const METHODS[] = {"closed-form", "damped", "qp"}; /* in the order of Method and Status */
    static const char *const STATUSES[] = {"ok", "scaled", "guarded", "degraded"};
    int active = 0;
    for (int j = 0; j < m; j++)
        active += solution->active[j];
    return Py_BuildValue("(NssNNNdddsNN)", new_vector(m, solution->velocity), METHODS[solution->method],
                         STATUSES[status(solution)], reason(m, solution),
                         joints(m, solution->active, active), new_vector(6, solution->residual), solution->scale,
                         solution->damping, solution->blended, solution->met ? "native" : "",
                         solution->met ? new_vector(m, solution->multipliers) : Py_NewRef(Py_None),
                         solution->met && solution->limits > 0 ? new_vector(solution->limits, solution->multipliers + m)
                                                               : Py_NewRef(Py_None));
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
