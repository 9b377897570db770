/* Twin of paths/reference.py: sources in stamp time, splices from one to the other, plans along points.

       r(t) = source(clock(t)) + residual(t),     residual: a quintic from the jump in position, velocity, acceleration */

#include "paths.h"

bool course_of(PyObject *object, Course *course)
{
    PyArrayObject *array = (PyArrayObject *)object;
    if (!PyArray_Check(object) || PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISCARRAY_RO(array) || PyArray_SIZE(array) < HEAD)
        return false;
    const double *x = course->head = PyArray_DATA(array);
    for (int i = JOINT_COUNT; i <= POWERS; i++)
        if (!within(x[i], 1, i == JOINT_COUNT ? MOST : 1000000))
            return false;
    JointLimits *limits = &course->limits;
    npy_intp m = limits->m = (int)x[JOINT_COUNT], c = course->columns = (int)x[COLUMNS], n = course->pieces = (int)x[PIECES];
    npy_intp k = course->powers = (int)x[POWERS];
    limits->dt = x[TICK];
    course->gain = x[GAIN];
    course->shape = x[KEEPS_SHAPE] != 0.0;
    course->residual = x + HEAD;
    limits->lower = course->residual + 6 * m;
    limits->upper = limits->lower + m;
    limits->fastest = limits->upper + m;
    limits->acceleration = limits->fastest + m;
    limits->jerk = limits->acceleration + m;
    course->knots = limits->jerk + m;
    course->values = course->knots + n + 1;
    return c >= m && c <= MOST + 1 && PyArray_SIZE(array) == HEAD + 11 * m + n + 1 + n * k * c;
}

/* Clock.at: the source's time, its rate, slope and the slope's slope. */
static void clock_at(const Course *course, double time, double now[4])
{
    const double *c = course->head + CLOCK;
    double start = c[0], rate = c[2], slope = c[3], final = c[4], D = fmax(c[5], 1e-300), d = final - rate;
    double b = (3.0 * d / D - 2.0 * slope) / D, e = (slope - 2.0 * d / D) / D / D, u = between(time - start, 0.0, c[5]);
    bool on = time - start < c[5];
    now[0] = c[1] + rate * fmin(time - start, 0.0) + u * (rate + u * (0.5 * slope + u * (b / 3.0 + u * 0.25 * e))) +
             final * fmax(time - start - c[5], 0.0);
    now[1] = on ? rate + u * (slope + u * (b + u * e)) : final;
    now[2] = on ? slope + u * (2.0 * b + 3.0 * u * e) : 0.0;
    now[3] = on ? 2.0 * b + 6.0 * u * e : 0.0;
}

/* Motion.at */
static void motion_at(const Course *course, double time, int derivatives, Path r)
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
    bool moves = time >= knots[0] && time < knots[n];
    const double *powers = course->values + (size_t)low * course->powers * c;
    for (int j = 0; j < c; j++) {
        double x = 0.0, v = 0.0, a = 0.0, jerk = 0.0;
        for (int k = course->powers - 1; k >= 0; k--) {
            if (derivatives > 0) {
                jerk = jerk * u + 3.0 * a;
                a = a * u + 2.0 * v;
                v = v * u + x;
            }
            x = x * u + powers[k * c + j];
        }
        r[0][j] = x;
        r[1][j] = moves ? v : 0.0;
        r[2][j] = moves ? a : 0.0;
        r[3][j] = moves ? jerk : 0.0;
    }
}

/* Source.at, by its clock. */
void source_at(const Course *course, double time, Path r)
{
    double now[4];
    clock_at(course, time, now);
    motion_at(course, now[0], 3, r);
    for (int j = 0; j < course->columns; j++) {
        double v = r[1][j], a = r[2][j], jerk = r[3][j];
        r[1][j] = now[1] * v;
        r[2][j] = now[1] * now[1] * a + now[2] * v;
        r[3][j] = now[1] * now[1] * now[1] * jerk + 3.0 * now[1] * now[2] * a + now[3] * v;
    }
}

void source_position(const Course *course, double time, double *r)
{
    double now[4];
    Path all;
    clock_at(course, time, now);
    motion_at(course, now[0], 0, all);
    memcpy(r, all[0], (size_t)course->columns * sizeof *r);
}

/* A polynomial of five powers more than its constant, (6, m), and its derivatives, added. */
void quintic(int m, const double *powers, double u, Path r)
{
    for (int j = 0; j < m; j++) {
        double x = 0.0, v = 0.0, a = 0.0, jerk = 0.0;
        for (int k = 5; k >= 0; k--) {
            jerk = jerk * u + 3.0 * a;
            a = a * u + 2.0 * v;
            v = v * u + x;
            x = x * u + powers[k * m + j];
        }
        r[0][j] += x;
        r[1][j] += v;
        r[2][j] += a;
        r[3][j] += jerk;
    }
}

/* What is left of the last splice, added. */
void left_over(const Course *course, double time, Path r)
{
    double u = time - course->head[SPLICE], D = course->head[SPLICE + 1];
    if (u < D)
        quintic(course->limits.m, course->residual, fmax(u, 0.0), r);
}

/* _residuals: the quintic from position, velocity and acceleration (3, m) to zero in D. */
static void residual_of(int m, const double *e, double D, double *powers)
{
    for (int j = 0; j < m; j++) {
        double x = e[j], v = e[m + j], a = e[2 * m + j];
        powers[j] = x;
        powers[m + j] = v;
        powers[2 * m + j] = 0.5 * a;
        powers[3 * m + j] = -(20.0 * x + 12.0 * v * D + 3.0 * a * D * D) / (2.0 * D * D * D);
        powers[4 * m + j] = (30.0 * x + 16.0 * v * D + 3.0 * a * D * D) / (2.0 * D * D * D * D);
        powers[5 * m + j] = -(12.0 * x + 6.0 * v * D + a * D * D) / (2.0 * D * D * D * D * D);
    }
}

/* Whether an array has so many numbers in a row, and they. */
static const double *numbers(PyObject *object, npy_intp size)
{
    PyArrayObject *array = (PyArrayObject *)object;
    bool good = PyArray_Check(object) && PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISCARRAY_RO(array) && PyArray_SIZE(array) == size;
    return good ? PyArray_DATA(array) : NULL;
}

/* Limits (5, m). */
static bool limits_of(PyObject *object, JointLimits *limits)
{
    PyArrayObject *array = (PyArrayObject *)object;
    npy_intp m = PyArray_Check(object) && PyArray_NDIM(array) == 2 ? PyArray_DIM(array, 1) : 0;
    const double *x = m > 0 && m <= MOST ? numbers(object, 5 * m) : NULL;
    limits->m = (int)m;
    limits->dt = NAN;
    limits->lower = x;
    limits->upper = x + m;
    limits->fastest = x + 2 * m;
    limits->acceleration = x + 3 * m;
    limits->jerk = x + 4 * m;
    return x != NULL && !PyErr_Occurred();
}

/* Reference.splice: the residual (6, m) from a state (3, m) in a duration; whether that keeps the limits. */
bool splices(const Course *course, double time, const double *state, double duration, double *found)
{
    int m = course->limits.m;
    Path r;
    double e[3 * MOST];
    source_at(course, time, r);
    for (int k = 0; k < 3; k++)
        for (int j = 0; j < m; j++)
            e[k * m + j] = state[k * m + j] - r[k][j];
    residual_of(m, e, duration, found);
    for (int i = 0; i < PLACES; i++) {
        double u = i * (duration / (PLACES - 1));
        source_at(course, time + u, r);
        quintic(m, found, u, r);
        for (int j = 0; j < m; j++)
            if (!(needed_share(&course->limits, j, r[0][j], r[1][j], r[2][j], r[3][j]) <= SHARE))
                return false;
    }
    return true;
}

/* splice(course, time, state, duration): the residual (6, m) to the course's source; None where it leaves the limits. */
PyObject *splice(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Course course;
    static const char *const USE = "splice(course, time, state, duration)";
    if (count != 4 || !course_of(arguments[0], &course))
        return refused(USE);
    double time = PyFloat_AsDouble(arguments[1]), duration = PyFloat_AsDouble(arguments[3]), found[6 * MOST];
    const double *state = numbers(arguments[2], 3 * course.limits.m);
    if (PyErr_Occurred() || state == NULL)
        return refused(USE);
    if (!splices(&course, time, state, duration, found))
        Py_RETURN_NONE;
    return new_matrix(6, course.limits.m, course.limits.m, found);
}

/* The shares that the four coefficients of a piece of a cubic B-spline have, u of it over. */
static void shares_at(double u, double share[4])
{
    double left = 1.0 - u;
    share[0] = left * left * left / 6.0;
    share[1] = (4.0 + u * u * (3.0 * u - 6.0)) / 6.0;
    share[2] = (1.0 + u * (3.0 + u * (3.0 - 3.0 * u))) / 6.0;
    share[3] = u * u * u / 6.0;
}

/* A row of least squares on the coefficients from `first` on, those from n on the same, and c of the first three known:
   into the upper bands, from the diagonal on, and the right-hand side, both (n + 1). */
static void add_row(int n, int first, const double row[4], double wanted, double weight, const double *c, double (*bands)[4], double *right)
{
    for (int i = 0; i < 4 && first + i < 3; i++)
        wanted -= row[i] * c[first + i];
    for (int i = 0; i < 4; i++) {
        int a = first + i < n ? first + i : n;
        right[a] += weight * row[i] * wanted;
        for (int k = 0; k < 4; k++) {
            int b = first + k < n ? first + k : n;
            if (b >= a)
                bands[a][b - a] += weight * row[i] * row[k];
        }
    }
}

/* _eased: the coefficients (n + 3) of a plan for joint j, `c` with those of the state, and until when points weigh less; `work`
   has room for 5 (n + 1). */
static double eased(const JointLimits *limits, int j, int count, const double *times, const double *wanted, double calm, int n, double *c,
                  double *work)
{
    static const double JERK[4] = {-1.0, 3.0, -3.0, 1.0};
    int m = limits->m;
    double h = times[count - 1] / n, smooth = h * pow(calm / h, 6.0), later = 0.0, *right = work + 4 * (n + 1), (*bands)[4] = (double(*)[4])work;
    for (int try = 0; try < TRIES; try++) {
        memset(work, 0, (size_t)(5 * (n + 1)) * sizeof *work);
        for (int i = 0; i < count; i++) {
            double row[4], reached = fmin(times[i] / fmax(later, times[0]), 1.0);
            int piece = (int)fmin(times[i] / h, n - 1.0);
            shares_at(times[i] / h - piece, row);
            add_row(n, piece, row, wanted[i * m + j], (times[i] - (i > 0 ? times[i - 1] : 0.0)) * reached * reached, c, bands, right);
        }
        for (int i = 0; i < n; i++)
            add_row(n, i, JERK, 0.0, smooth, c, bands, right);
        for (int i = 3; i <= n; i++) { /* L diag L', in the bands; L right = right */
            double pivot = bands[i][0];
            for (int k = 1; k < 4 && i + k <= n; k++) {
                double share = bands[i][k] / pivot;
                for (int l = k; l < 4 && i + l <= n; l++)
                    bands[i + k][l - k] -= share * bands[i][l];
                right[i + k] -= share * right[i];
            }
        }
        for (int i = n; i >= 3; i--) {
            double x = right[i];
            for (int k = 1; k < 4 && i + k <= n; k++)
                x -= bands[i][k] * c[i + k];
            c[i] = x / bands[i][0];
        }
        c[n + 1] = c[n + 2] = c[n];
        double share = 0.0;
        for (int i = 0; i <= n; i++) {
            const double *k = c + i;
            double jerk = i < n ? k[3] - 3.0 * k[2] + 3.0 * k[1] - k[0] : 0.0;
            share = fmax(share, needed_share(limits, j, (k[0] + 4.0 * k[1] + k[2]) / 6.0, (k[2] - k[0]) / (2.0 * h),
                                             (k[0] - 2.0 * k[1] + k[2]) / (h * h), jerk / (h * h * h)));
        }
        if (share <= SHARE)
            break;
        later = fmax(later, 2.0 * calm) * fmax(share, EASIER);
    }
    return later;
}

/* planned(limits, state, times, wanted, calm, pieces): powers (pieces, 4, m) of the motion from a state (3, m) that is near
   what is wanted (n, m) at times (n,) from now, with little jerk. */
PyObject *planned(PyObject *module, PyObject *const *arguments, Py_ssize_t given)
{
    (void)module;
    JointLimits limits;
    static const char *const USE = "planned(limits, state, times, wanted, calm, pieces)";
    if (given != 6 || !limits_of(arguments[0], &limits) || !PyArray_Check(arguments[2]))
        return refused(USE);
    npy_intp count = PyArray_SIZE((PyArrayObject *)arguments[2]), m = limits.m;
    const double *state = numbers(arguments[1], 3 * m), *times = numbers(arguments[2], count), *wanted = numbers(arguments[3], count * m);
    double calm = PyFloat_AsDouble(arguments[4]);
    long n = PyLong_AsLong(arguments[5]);
    if (PyErr_Occurred() || state == NULL || times == NULL || wanted == NULL || count < 1 || n < 4 || n > 1000000 || !(times[0] > 0.0))
        return refused(USE);
    npy_intp sizes[3] = {n, 4, m};
    double *work = PyMem_Malloc((size_t)(6 * n + 8) * sizeof *work), h = times[count - 1] / n, later = 0.0;
    PyObject *found = work == NULL ? PyErr_NoMemory() : PyArray_SimpleNew(3, sizes, NPY_DOUBLE);
    for (int j = 0; j < m && found != NULL; j++) {
        double x = state[j], v = h * state[m + j], a = h * h * state[2 * m + j], *c = work + 5 * (n + 1);
        c[0] = x - v + a / 3.0;
        c[1] = x - a / 6.0;
        c[2] = x + v + a / 3.0;
        later = fmax(later, eased(&limits, j, (int)count, times, wanted, calm, (int)n, c, work));
        double *powers = (double *)PyArray_DATA((PyArrayObject *)found) + j;
        for (int i = 0; i < n; i++, c++, powers += 4 * m) { /* PIECE */
            powers[0] = (c[0] + 4.0 * c[1] + c[2]) / 6.0;
            powers[m] = (c[2] - c[0]) / (2.0 * h);
            powers[2 * m] = (c[0] - 2.0 * c[1] + c[2]) / (2.0 * h * h);
            powers[3 * m] = (c[3] - 3.0 * c[2] + 3.0 * c[1] - c[0]) / (6.0 * h * h * h);
        }
    }
    PyMem_Free(work);
    return found == NULL ? NULL : Py_BuildValue("(Nd)", found, later);
}
