/* Twin of a tick of paths/driver.py in which nothing new comes, with paths/reference.py and paths/time_law.py.

       r(t) = source(clock(t)) + residual(t),     v = (r(t + dt) - q) / dt,     command = v + the way back to q

   A tick that limits change, and joints that are not where they were sent, are handed back. */

#include "boundary.h"
#include <math.h>
#include <string.h>

/* As Python lays them out; arrays row by row. */
enum { JOINT_COUNT, COLUMNS, PIECES, POWERS, TICK, GAIN, KEEPS_SHAPE, STRAY, CLOCK, SPLICE = CLOCK + 6, WINDOW = SPLICE + 2, HEAD = WINDOW + 2 };
typedef struct {
    int m, columns, pieces, powers; /* no pieces: a window over samples, `powers` of them */
    double dt, gain;
    bool shape;
    const double *head, *residual, *lower, *upper, *fastest, *acceleration, *jerk, *knots, *values;
} Course;

static bool course_of(PyObject *object, Course *course)
{
    PyArrayObject *array = (PyArrayObject *)object;
    if (!PyArray_Check(object) || PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISCARRAY_RO(array) || PyArray_SIZE(array) < HEAD)
        return false;
    const double *x = course->head = PyArray_DATA(array);
    for (int i = JOINT_COUNT; i <= POWERS; i++)
        if (!within(x[i], i == PIECES ? 0 : 1, i == JOINT_COUNT ? MOST : 1000000))
            return false;
    npy_intp m = course->m = (int)x[JOINT_COUNT], c = course->columns = (int)x[COLUMNS], n = course->pieces = (int)x[PIECES];
    npy_intp k = course->powers = (int)x[POWERS];
    course->dt = x[TICK];
    course->gain = x[GAIN];
    course->shape = x[KEEPS_SHAPE] != 0.0;
    course->residual = x + HEAD;
    course->lower = course->residual + 6 * m;
    course->upper = course->lower + m;
    course->fastest = course->upper + m;
    course->acceleration = course->fastest + m;
    course->jerk = course->acceleration + m;
    course->knots = course->jerk + m;
    course->values = course->knots + (n > 0 ? n + 1 : k);
    return c >= m && c <= MOST + 1 && PyArray_SIZE(array) == HEAD + 11 * m + (n > 0 ? n + 1 + n * k * c : k + k * c);
}

/* Clock.at: the source's time. */
static double clock_at(const Course *course, double time)
{
    const double *c = course->head + CLOCK;
    double start = c[0], rate = c[2], slope = c[3], final = c[4], D = fmax(c[5], 1e-300), d = final - rate;
    double b = (3.0 * d / D - 2.0 * slope) / D, e = (slope - 2.0 * d / D) / D / D, u = between(time - start, 0.0, c[5]);
    return c[1] + u * (rate + u * (0.5 * slope + u * (b / 3.0 + u * 0.25 * e))) + final * fmax(time - start - c[5], 0.0);
}

/* Motion.at: positions. */
static void motion_at(const Course *course, double time, double *r)
{
    int n = course->pieces, c = course->columns, low = 0, high = n;
    const double *knots = course->knots;
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if (time < knots[middle])
            high = middle;
        else
            low = middle;
    }
    double u = between(time, knots[0], knots[n]) - knots[low];
    const double *powers = course->values + (size_t)low * course->powers * c;
    for (int j = 0; j < c; j++) {
        r[j] = 0.0;
        for (int k = course->powers - 1; k >= 0; k--)
            r[j] = r[j] * u + powers[k * c + j];
    }
}

/* Window.position. */
static void window_at(const Course *course, double time, double *r)
{
    int n = course->powers, m = course->m;
    double half = course->head[WINDOW], read = time - course->head[WINDOW + 1], spread = 0.0, total = 0.0, middle = 0.0;
    double centre = between(read, course->knots[0], course->knots[n - 1]);
    Row slope = {0.0};
    memset(r, 0, (size_t)m * sizeof *r);
    for (int pass = 0; pass < 2; pass++) {
        for (int i = 0; i < n; i++) {
            double u = (course->knots[i] - centre) / half, w = fmax(1.0 - u * u, 0.0), away;
            if (!(w > 0.0))
                continue;
            w = w * w * w * w;
            away = (course->knots[i] - middle) / half;
            total += pass ? 0.0 : w;
            middle += pass ? 0.0 : w * course->knots[i];
            spread += pass ? w * away * away : 0.0;
            for (int j = 0; j < m; j++) {
                r[j] += pass ? 0.0 : w * course->values[i * m + j];
                slope[j] += pass ? w * away * course->values[i * m + j] : 0.0;
            }
        }
        middle = pass ? middle : middle / total;
    }
    for (int j = 0; j < m; j++)
        r[j] = r[j] / total + slope[j] / total / (spread / total + SPREAD * SPREAD * SPREAD) * ((read - middle) / half);
}

/* JointLimits._needed: the way upward in a tick at acceleration a and in stopping after it. */
static double needed(double velocity, double a, double A, double J, double dt)
{
    double v = velocity + dt * a, p = sqrt(fmax(J * v + 0.5 * a * a, 0.0)), hold = 0.0;
    bool full = p > A;
    p = fmin(p, A);
    double t = fmax((a + p) / J, 0.0), v1 = v + a * t - 0.5 * J * t * t;
    if (full)
        hold = fmax(v1 - p * p / (2.0 * J), 0.0) / p;
    double way = v * t + 0.5 * a * t * t - J * t * t * t / 6.0 + v1 * hold - 0.5 * p * hold * hold + p * p * p / (6.0 * J * J);
    if (a < 0.0 && v > 0.0 && J * v <= 0.5 * a * a) {
        double s = (-a - sqrt(fmax(a * a - 2.0 * J * fmax(v, 0.0), 0.0))) / J;
        way = v * s + 0.5 * a * s * s + J * s * s * s / 6.0;
    }
    way = v <= 0.0 && a <= 0.0 ? 0.0 : fmax(way, 0.0) + dt * fmax(v, 0.0);
    return dt * fmax(v, 0.0) + way;
}

/* JointLimits.within: whether an acceleration is allowed. */
static bool allowed(const Course *course, int j, double q, double v, double before, double a)
{
    double A = course->acceleration[j], J = course->jerk[j], V = course->fastest[j], dt = course->dt;
    if (!(fabs(a) <= A) || !(fabs(a - before) <= J * dt))
        return false;
    for (int sign = 1; sign >= -1; sign -= 2) {
        double room = sign > 0 ? course->upper[j] - q : q - course->lower[j], left = V - sign * v;
        double most = left > 0.0 ? sqrt(J * J * dt * dt + 2.0 * J * left) - J * dt : left / dt;
        if (!(sign * a <= most) || !(needed(sign * v, sign * a, A, J, dt) <= room))
            return false;
    }
    return true;
}

/* Follower._corrected: whether the command is one that nothing changes. */
static bool commanded(const Course *course, int j, double q, double off, double v, double before, double *command)
{
    double A = course->acceleration[j], V = course->fastest[j], dt = course->dt, lag, way, B = CATCH_UP_SHARE * A;
    double lower = (course->lower[j] - q) / dt, upper = (course->upper[j] - q) / dt;
    *command = v + course->gain * off;
    if (course->shape) {
        lag = 2.0 * B * B / course->jerk[j];
        way = fmin(sqrt(lag * lag + 2.0 * B * fabs(off)) - lag, course->gain * fabs(off));
        *command = v + copysign(way, off);
        double room = *command > 0.0 ? course->upper[j] - q : q - course->lower[j];
        return fabs(*command - before) <= A * dt && fabs(*command) <= V && fabs(*command) <= braking_speed(room, A, dt);
    }
    return *command >= lower && *command <= upper && fabs(*command) <= V;
}

/* follow(course, time, q, sent, position, velocity, acceleration, command before): position, velocity, acceleration and
   command after the tick, q as an array, and the source's last column before and after; or None where
   Python has to answer, or to say what is wrong with q. */
PyObject *follow(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Course course;
    Row q, sent, position, velocity, acceleration, command;
    double now[MOST + 1], then[MOST + 1];
    if (count != 8 || !course_of(arguments[0], &course))
        return refused("follow(course, time, q, sent, position, velocity, acceleration, command)");
    int m = course.m;
    double time = PyFloat_AsDouble(arguments[1]), dt = course.dt, after = time + dt;
    bool good = !PyErr_Occurred() && vector(arguments[2], m, q) && vector(arguments[3], m, sent) &&
                vector(arguments[4], m, position) && vector(arguments[5], m, velocity) &&
                vector(arguments[6], m, acceleration) && vector(arguments[7], m, command);
    PyErr_Clear(); /* Python says what is wrong */
    for (int j = 0; j < m && good; j++)
        good = fabs(sent[j] - q[j]) <= course.head[STRAY];
    if (!good)
        Py_RETURN_NONE;
    double at = clock_at(&course, after);
    now[m] = then[m] = 0.0;
    if (course.pieces == 0)
        window_at(&course, at, then);
    else {
        if (course.columns > m)
            motion_at(&course, clock_at(&course, time), now);
        motion_at(&course, at, then);
    }
    double u = after - course.head[SPLICE], last[2] = {now[m], then[m]};
    for (int j = 0; j < m; j++) {
        double left = 0.0;
        for (int k = 5; k >= 0 && u < course.head[SPLICE + 1]; k--)
            left = left * u + course.residual[k * m + j];
        double v = (then[j] + left - position[j]) / dt, a = (v - velocity[j]) / dt;
        if ((!course.shape && !allowed(&course, j, position[j], velocity[j], acceleration[j], a)) ||
            !commanded(&course, j, q[j], sent[j] - q[j], v, command[j], &command[j]))
            Py_RETURN_NONE;
        position[j] += dt * v;
        velocity[j] = v;
        acceleration[j] = a;
    }
    return Py_BuildValue("(NNNNNdd)", new_vector(m, position), new_vector(m, velocity), new_vector(m, acceleration),
                         new_vector(m, command), new_vector(m, q), last[0], last[1]);
}
