/* Twin of a tick of force/contact.py and of a Contact in force/contact_kinds.py: wrenches and twists in the frame of a contact,
   and what of them presses. */

#include "boundary.h"
#include "press.h"
#include <string.h>

/* Ad* w: f = R f', m = R m' + p x f */
void wrench_out(const Pose *frame, const double w[6], double out[6])
{
    double lever[3];
    turned(frame, w + 3, out + 3);
    turned(frame, w, out);
    cross(frame->p, out + 3, lever);
    for (int i = 0; i < 3; i++)
        out[i] += lever[i];
}

/* R'b */
static void turned_back(const Pose *frame, const double b[3], double c[3])
{
    for (int i = 0; i < 3; i++)
        c[i] = frame->R[0][i] * b[0] + frame->R[1][i] * b[1] + frame->R[2][i] * b[2];
}

void wrench_in(const Pose *frame, const double w[6], double in[6])
{
    double lever[3], m[3];
    cross(frame->p, w + 3, lever);
    for (int i = 0; i < 3; i++)
        m[i] = w[i] - lever[i];
    turned_back(frame, m, in);
    turned_back(frame, w + 3, in + 3);
}

/* Ad t: the angular part R w', the linear one R v' + p x w */
void twist_out(const Pose *frame, const double t[6], double out[6])
{
    double lever[3];
    turned(frame, t, out);
    turned(frame, t + 3, out + 3);
    cross(frame->p, out, lever);
    for (int i = 0; i < 3; i++)
        out[3 + i] += lever[i];
}

void twist_in(const Pose *frame, const double t[6], double in[6])
{
    double v[3];
    velocity_at(t, frame->p, v);
    turned_back(frame, t, in);
    turned_back(frame, v, in + 3);
}

/* v + omega x p */
void velocity_at(const double twist[6], const double p[3], double v[3])
{
    cross(twist, p, v);
    for (int i = 0; i < 3; i++)
        v[i] += twist[3 + i];
}

/* y = A x */
void rows_times(int rows, const double (*A)[6], const double x[6], double *y)
{
    for (int i = 0; i < rows; i++)
        y[i] = dot(6, A[i], x);
}

/* |f|, and |m| about a place. */
void load_at(const double wrench[6], const double place[3], double load[2])
{
    double lever[3];
    cross(place, wrench + 3, lever);
    for (int i = 0; i < 3; i++)
        lever[i] = wrench[i] - lever[i];
    load[0] = norm(3, wrench + 3);
    load[1] = norm(3, lever);
}

/* The press that is felt and wanted, of several the one of which least is felt, and of all together; NaN for none. */
void weakest(int n, const double (*parts)[6], const double felt[6], const double exert[6], double *here, double *wanted,
             double *together)
{
    double is[MOST_PARTS], asked[MOST_PARTS], share = INFINITY, sum = 0.0, whole = 0.0;
    *here = *wanted = n > 0 ? INFINITY : NAN;
    *together = 0.0;
    for (int i = 0; i < n; i++) {
        is[i] = dot(6, parts[i], felt);
        asked[i] = dot(6, parts[i], exert);
        if (n > 1 && !(asked[i] > 0.0))
            continue;
        *wanted = fmin(*wanted, asked[i]);
        share = fmin(share, is[i] / asked[i]);
        sum += is[i];
        whole += asked[i];
    }
    if (n == 1) {
        *here = *together = is[0];
        *wanted = asked[0];
    } else if (n > 1 && *wanted < INFINITY) {
        *here = *wanted * share;
        *together = *wanted * (sum / whole);
    } else if (n > 1) {
        *wanted = 0.0;
        for (int i = 0; i < n; i++)
            *here = fmin(*here, is[i]);
    }
}

/* How fast a twist moves the place of contact, turning counted by the contact's size. */
double place_speed(const double twist[6], const double place[3], double size)
{
    double v[3];
    velocity_at(twist, place, v);
    return fmax(fmax(norm(3, v), size * norm(3, twist)), TINY);
}

bool can_yield(const Split *split, int joints) { return joints >= 6 || split->n <= joints - 2; }

/* Three numbers: an array, or a list or tuple of numbers that are Python's; false for anything else. */
static bool three(PyObject *object, double into[3])
{
    bool listed = PyList_CheckExact(object);
    if (!listed && !PyTuple_CheckExact(object))
        return vector(object, 3, into) && all_finite(3, into);
    if ((listed ? PyList_Size(object) : PyTuple_Size(object)) != 3)
        return false;
    for (int i = 0; i < 3; i++) {
        PyObject *number = listed ? PyList_GetItem(object, i) : PyTuple_GetItem(object, i);
        if (!PyFloat_Check(number) && !PyLong_CheckExact(number))
            return false;
        into[i] = PyFloat_AsDouble(number);
    }
    if (PyErr_Occurred() == NULL)
        return all_finite(3, into);
    PyErr_Clear(); /* an integer beyond any float */
    return false;
}

/* contact_frame(point, normal, tangent), as in force/contact_kinds.py, or None where Python has to find it, or what is wrong. */
PyObject *contact_frame(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    double p[3], z[3], x[3] = {0.0}, y[3];
    (void)module;
    if (count != 3)
        return refused("contact_frame(point, normal, tangent)");
    bool turns = arguments[2] == Py_None;
    if (!three(arguments[0], p) || !three(arguments[1], z) || !(turns || three(arguments[2], x)) || !usual(3, z) || !usual(3, x))
        Py_RETURN_NONE;
    double length = -norm(3, z), along = norm(3, x);
    if (length == 0.0 || (!turns && along == 0.0))
        Py_RETURN_NONE;
    for (int i = 0; i < 3; i++) {
        z[i] /= length;
        x[i] /= turns ? 1.0 : along;
    }
    if (turns)
        x[fabs(z[0]) <= fmin(fabs(z[1]), fabs(z[2])) ? 0 : fabs(z[1]) <= fabs(z[2]) ? 1 : 2] = 1.0;
    double share = dot(3, z, x);
    for (int i = 0; i < 3; i++)
        x[i] -= share * z[i];
    if ((length = norm(3, x)) < SIX_DIGITS)
        Py_RETURN_NONE;
    for (int i = 0; i < 3; i++)
        x[i] /= length;
    cross(z, x, y);
    const double frame[4][4] = {{x[0], y[0], z[0], p[0]}, {x[1], y[1], z[1], p[1]}, {x[2], y[2], z[2], p[2]}, {0.0, 0.0, 0.0, 1.0}};
    return new_matrix(4, 4, 4, frame[0]);
}
