/* Twin of paths/reference.py: sources in stamp time, stops, splices from one to the other, curves through points.

       r(t) = source(clock(t)) + residual(t),     residual: a quintic from the jump in position, velocity, acceleration */

#include "paths.h"

bool course_of(PyObject *object, Course *course)
{
    PyArrayObject *array = (PyArrayObject *)object;
    if (!PyArray_Check(object) || PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISCARRAY_RO(array) || PyArray_SIZE(array) < HEAD)
        return false;
    const double *x = course->head = PyArray_DATA(array);
    for (int i = JOINT_COUNT; i <= POWERS; i++)
        if (!within(x[i], i == PIECES || i == POWERS ? 0 : 1, i == JOINT_COUNT ? MOST : 1000000))
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
    course->values = course->knots + (n > 0 ? n + 1 : k);
    return c >= m && c <= MOST + 1 && PyArray_SIZE(array) == HEAD + 11 * m + (n > 0 ? n + 1 + n * k * c : k + k * c);
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

/* Window.position */
static void window_at(const Course *course, double time, double *r)
{
    int n = course->powers, m = course->limits.m;
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

/* Window.at: derivatives are differences over ticks. */
static void window_motion(const Course *course, double time, Path r)
{
    double h = course->limits.dt, p[5][MOST + 1];
    for (int i = 0; i < 5; i++)
        window_at(course, time + (i - 2) * h, p[i]);
    for (int j = 0; j < course->limits.m; j++) {
        r[0][j] = p[2][j];
        r[1][j] = (p[3][j] - p[1][j]) / (2.0 * h);
        r[2][j] = (p[3][j] - 2.0 * p[2][j] + p[1][j]) / (h * h);
        r[3][j] = (p[4][j] - 2.0 * p[3][j] + 2.0 * p[1][j] - p[0][j]) / (2.0 * h * h * h);
    }
}

/* Source.at, by its clock. */
void source_at(const Course *course, double time, Path r)
{
    double now[4];
    clock_at(course, time, now);
    if (course->pieces == 0)
        window_motion(course, now[0], r);
    else
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
    if (course->pieces == 0) {
        window_at(course, now[0], r);
        return;
    }
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

/* Reference.at */
void reference_at(const Course *course, double time, Path r)
{
    source_at(course, time, r);
    left_over(course, time, r);
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

/* The i-th of `count` numbers from first to last, each by the same factor more. */
static double spaced(double first, double last, int i, int count)
{
    return i == count - 1 ? last : i == 0 ? first : first * pow(last / first, (double)i / (count - 1));
}

/* Whether a splice keeps the limits together with the source. */
static bool fits(const Course *course, double time, const Path here, const double *powers, double D)
{
    int m = course->limits.m;
    Path r;
    for (int i = 0; i < PLACES; i++) {
        double u = i * (D / (PLACES - 1));
        if (course->pieces == 0) { /* a hand is taken to go on as it does */
            memset(r, 0, sizeof r);
            memcpy(r[0], here[0], sizeof r[0]);
            memcpy(r[1], here[1], sizeof r[1]);
        } else
            source_at(course, time + u, r);
        quintic(m, powers, u, r);
        for (int j = 0; j < m; j++)
            if (!(needed_share(&course->limits, j, r[0][j], r[1][j], r[2][j], r[3][j]) <= SHARE))
                return false;
    }
    return true;
}

/* Whether an array has so many numbers in a row, and they. */
static const double *numbers(PyObject *object, npy_intp size)
{
    PyArrayObject *array = (PyArrayObject *)object;
    bool good = PyArray_Check(object) && PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISCARRAY_RO(array) && PyArray_SIZE(array) == size;
    return good ? PyArray_DATA(array) : NULL;
}

/* Limits (5, m) and a tick. */
static bool limits_of(PyObject *object, PyObject *dt, JointLimits *limits)
{
    PyArrayObject *array = (PyArrayObject *)object;
    npy_intp m = PyArray_Check(object) && PyArray_NDIM(array) == 2 ? PyArray_DIM(array, 1) : 0;
    const double *x = m > 0 && m <= MOST ? numbers(object, 5 * m) : NULL;
    limits->m = (int)m;
    limits->dt = PyFloat_AsDouble(dt);
    limits->lower = x;
    limits->upper = x + m;
    limits->fastest = x + 2 * m;
    limits->acceleration = x + 3 * m;
    limits->jerk = x + 4 * m;
    return x != NULL && !PyErr_Occurred();
}

/* motion(course, time): (4, columns) position, velocity, acceleration and jerk. */
PyObject *motion(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Course course;
    Path r;
    double time = count == 2 ? PyFloat_AsDouble(arguments[1]) : NAN;
    if (PyErr_Occurred() || count != 2 || !course_of(arguments[0], &course) || course.powers == 0)
        return refused("motion(course, time)");
    reference_at(&course, time, r);
    return new_matrix(4, course.columns, MOST + 1, r[0]);
}

/* What a splice at a time has to take to zero: a state (3, m), less the source's. */
static void jump_at(const Course *course, double time, const double *state, Path here, double *e)
{
    int m = course->limits.m;
    source_at(course, time, here);
    for (int k = 0; k < 3; k++)
        for (int j = 0; j < m; j++)
            e[k * m + j] = state[k * m + j] - here[k][j];
}

/* Reference.splice: the residual (6, m) from a state (3, m) in a duration; whether that keeps the limits. */
bool splices(const Course *course, double time, const double *state, double duration, double *found)
{
    Path here;
    double e[3 * MOST];
    jump_at(course, time, state, here, e);
    residual_of(course->limits.m, e, duration, found);
    return fits(course, time, (const double(*)[MOST + 1])here, found, duration);
}

/* splice(course, time, state, duration): the residual (6, m) to the course's source; None where it leaves the limits. */
PyObject *splice(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Course course;
    static const char *const USE = "splice(course, time, state, duration)";
    if (count != 4 || !course_of(arguments[0], &course) || course.powers == 0)
        return refused(USE);
    double time = PyFloat_AsDouble(arguments[1]), duration = PyFloat_AsDouble(arguments[3]), found[6 * MOST];
    const double *state = numbers(arguments[2], 3 * course.limits.m);
    if (PyErr_Occurred() || state == NULL)
        return refused(USE);
    if (!splices(&course, time, state, duration, found))
        Py_RETURN_NONE;
    return new_matrix(6, course.limits.m, course.limits.m, found);
}

/* The powers (5, m) of a stop from position, velocity and acceleration (3, m). */
static void stop_powers(int m, const double *state, double D, double *powers)
{
    for (int j = 0; j < m; j++) {
        double v = state[m + j], a = state[2 * m + j];
        powers[j] = state[j];
        powers[m + j] = v;
        powers[2 * m + j] = 0.5 * a;
        powers[3 * m + j] = D > 0.0 ? (-3.0 * v / (D * D) - 2.0 * a / D) / 3.0 : 0.0;
        powers[4 * m + j] = D > 0.0 ? 0.25 * (2.0 * v / (D * D * D) + a / (D * D)) : 0.0;
    }
}

/* The largest share of a limit that a stop needs, looked at up to a share of that size. */
static double stop_share(const JointLimits *limits, const double *state, double D, double enough)
{
    double worst = 0.0;
    int m = limits->m;
    for (int i = 0; i < PLACES && worst <= enough; i++) {
        double u = i * (D / (PLACES - 1));
        for (int j = 0; j < m; j++) {
            double x = state[j], v = state[m + j], a = state[2 * m + j];
            double b = -3.0 * v / (D * D) - 2.0 * a / D, c = 2.0 * v / (D * D * D) + a / (D * D);
            worst = fmax(worst, needed_share(limits, j, x + u * (v + u * (0.5 * a + u * (b / 3.0 + 0.25 * u * c))),
                                             v + u * (a + u * (b + u * c)), a + u * (2.0 * b + 3.0 * u * c), 2.0 * b + 6.0 * u * c));
        }
    }
    return worst;
}

/* stopping: how long the quickest stop takes, at least `shortest`. */
static double stop_duration(const JointLimits *limits, const double *state, double shortest)
{
    double first = fmax(SHORTEST_STOP * limits->dt, shortest), last = LONGEST_STOP, moves = 0.0;
    for (int j = 0; j < 2 * limits->m; j++)
        moves = fmax(moves, fabs(state[limits->m + j]));
    if (moves == 0.0)
        return 0.0;
    for (int round = 0; round < 2; round++) {
        double least = INFINITY, begin = first, end = last;
        int chosen = -1;
        for (int i = 0; i < STOPS && chosen < 0; i++)
            if (stop_share(limits, state, spaced(begin, end, i, STOPS), SHARE) <= SHARE)
                chosen = i;
        for (int i = 0; i < STOPS && chosen < 0; i++)
            least = fmin(least, stop_share(limits, state, spaced(begin, end, i, STOPS), INFINITY));
        for (int i = 0; i < STOPS && chosen < 0; i++) /* where the state is at a limit already, it is not to be worse */
            if (stop_share(limits, state, spaced(begin, end, i, STOPS), INFINITY) <= 1.0001 * least)
                chosen = i;
        first = spaced(begin, end, chosen > 0 ? chosen - 1 : 0, STOPS);
        last = spaced(begin, end, chosen > 0 ? chosen : 0, STOPS);
    }
    return last;
}

/* smoothed: (I + strength D'D) x = y in place, D the second differences; `work` has room for 3 n. */
static void smooth(int n, int m, const double *stamps, double strength, double *y, double *work)
{
    double *d = work, *e = work + n, *f = work + 2 * n; /* diagonal, next to it, beyond */
    for (int i = 0; i < n; i++) {
        d[i] = 1.0;
        e[i] = f[i] = 0.0;
    }
    for (int i = 0; i + 2 < n; i++) {
        double near = stamps[i + 1] - stamps[i], far = stamps[i + 2] - stamps[i + 1], scale = 2.0 / (near + far);
        double D[3] = {scale / near, -scale * (1.0 / near + 1.0 / far), scale / far};
        for (int k = 0; k < 3; k++)
            d[i + k] += strength * D[k] * D[k];
        e[i] += strength * D[0] * D[1];
        e[i + 1] += strength * D[1] * D[2];
        f[i] += strength * D[0] * D[2];
    }
    for (int i = 0; i < n; i++) { /* L diag(d) L', the columns of L in e and f */
        double ei = e[i], fi = f[i];
        if (i + 1 < n) {
            d[i + 1] -= ei * ei / d[i];
            e[i + 1] -= i + 2 < n ? ei * fi / d[i] : 0.0;
            e[i] = ei / d[i];
        }
        if (i + 2 < n) {
            d[i + 2] -= fi * fi / d[i];
            f[i] = fi / d[i];
        }
    }
    for (int j = 0; j < m; j++) {
        for (int i = 0; i < n; i++)
            y[i * m + j] -= (i > 0 ? e[i - 1] * y[(i - 1) * m + j] : 0.0) + (i > 1 ? f[i - 2] * y[(i - 2) * m + j] : 0.0);
        for (int i = n - 1; i >= 0; i--)
            y[i * m + j] = y[i * m + j] / d[i] - (i + 1 < n ? e[i] * y[(i + 1) * m + j] : 0.0) -
                           (i + 2 < n ? f[i] * y[(i + 2) * m + j] : 0.0);
    }
}

/* The cubics (n - 1, 5, m) of a natural spline; `work` has room for n (m + 1). */
static void natural_spline(int n, int m, const double *stamps, const double *y, double *powers, double *work)
{
    double *M = work + n, *below = work; /* second derivatives; how the elimination scales the row after */
    memset(M, 0, (size_t)(n * m) * sizeof *M);
    for (int i = 1; i + 1 < n; i++) {
        double h = stamps[i] - stamps[i - 1], next = stamps[i + 1] - stamps[i], pivot = 2.0 * (h + next);
        pivot -= i > 1 ? h * below[i - 1] : 0.0;
        below[i] = next / pivot;
        for (int j = 0; j < m; j++) {
            double bend = 6.0 * ((y[(i + 1) * m + j] - y[i * m + j]) / next - (y[i * m + j] - y[(i - 1) * m + j]) / h);
            M[i * m + j] = (bend - (i > 1 ? h * M[(i - 1) * m + j] : 0.0)) / pivot;
        }
    }
    for (int i = n - 3; i >= 1; i--)
        for (int j = 0; j < m; j++)
            M[i * m + j] -= below[i] * M[(i + 1) * m + j];
    for (int i = 0; i + 1 < n; i++) {
        double h = stamps[i + 1] - stamps[i], *piece = powers + (size_t)i * 5 * m;
        for (int j = 0; j < m; j++) {
            double a = M[i * m + j], b = M[(i + 1) * m + j];
            piece[j] = y[i * m + j];
            piece[m + j] = (y[(i + 1) * m + j] - y[i * m + j]) / h - h * (2.0 * a + b) / 6.0;
            piece[2 * m + j] = 0.5 * a;
            piece[3 * m + j] = (b - a) / (6.0 * h);
            piece[4 * m + j] = 0.0;
        }
    }
}

/* The state (3, m) of powers (5, m) at u. */
static void state_at(int m, const double *powers, double u, double *state)
{
    for (int j = 0; j < m; j++) {
        double x = 0.0, v = 0.0, a = 0.0;
        for (int k = 4; k >= 0; k--) {
            a = a * u + 2.0 * v;
            v = v * u + x;
            x = x * u + powers[k * m + j];
        }
        state[j] = x;
        state[m + j] = v;
        state[2 * m + j] = a;
    }
}

/* through(limits, dt, stamps, positions, strength, ease): knots and powers of a curve through smoothed positions (n, m),
   n > 1, with a way in from rest and out to rest. */
PyObject *through(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    static const int BINOMIALS[5][5] = {{1, 1, 1, 1, 1}, {0, 1, 2, 3, 4}, {0, 0, 1, 3, 6}, {0, 0, 0, 1, 4}, {0, 0, 0, 0, 1}};
    JointLimits limits;
    static const char *const USE = "through(limits, dt, stamps, positions, strength, ease)";
    if (count != 6 || !limits_of(arguments[0], arguments[1], &limits) || !PyArray_Check(arguments[2]))
        return refused(USE);
    npy_intp n = PyArray_SIZE((PyArrayObject *)arguments[2]), m = limits.m;
    const double *stamps = numbers(arguments[2], n), *given = numbers(arguments[3], n * m);
    double strength = PyFloat_AsDouble(arguments[4]), ease = PyFloat_AsDouble(arguments[5]), first[3 * MOST], last[3 * MOST], in[5 * MOST];
    if (PyErr_Occurred() || stamps == NULL || given == NULL || n < 2 || n > 1000000)
        return refused(USE);
    double *work = PyMem_Malloc((size_t)(n * (m + 3 + m) + n * 5 * m) * sizeof *work);
    if (work == NULL)
        return PyErr_NoMemory();
    double *y = work, *room = y + n * m, *powers = room + n * (m + 3);
    memcpy(y, given, (size_t)(n * m) * sizeof *y);
    if (n > 2 && strength > 0.0)
        smooth((int)n, (int)m, stamps, strength, y, room);
    for (npy_intp i = 0; i < n * m; i++)
        y[i] = between(y[i], limits.lower[i % m], limits.upper[i % m]);
    natural_spline((int)n, (int)m, stamps, y, powers, room);
    state_at((int)m, powers, 0.0, first);
    for (int j = 0; j < m; j++)
        first[m + j] = -first[m + j]; /* run backward */
    state_at((int)m, powers + (n - 2) * 5 * m, stamps[n - 1] - stamps[n - 2], last);
    double before = stop_duration(&limits, first, ease), after = stop_duration(&limits, last, ease);
    npy_intp ways[2] = {before > 0.0, after > 0.0}, pieces = n - 1 + ways[0] + ways[1], sizes[3] = {pieces, 5, m}, count_of_knots = pieces + 1;
    PyObject *knots = PyArray_SimpleNew(1, &count_of_knots, NPY_DOUBLE), *coefficients = PyArray_SimpleNew(3, sizes, NPY_DOUBLE);
    if (knots != NULL && coefficients != NULL) {
        double *t = PyArray_DATA((PyArrayObject *)knots), *c = PyArray_DATA((PyArrayObject *)coefficients);
        if (ways[0]) { /* the stop from the first point, from its end back */
            stop_powers((int)m, first, before, in);
            *t++ = stamps[0] - before;
            for (int k = 0; k < 5; k++)
                for (int j = 0; j < m; j++) {
                    double x = 0.0;
                    for (int l = 4; l >= k; l--)
                        x = x * before + BINOMIALS[k][l] * in[l * m + j];
                    *c++ = k % 2 ? -x : x;
                }
        }
        memcpy(t, stamps, (size_t)n * sizeof *t);
        memcpy(c, powers, (size_t)((n - 1) * 5 * m) * sizeof *c);
        if (ways[1]) {
            t[n] = stamps[n - 1] + after;
            stop_powers((int)m, last, after, c + (n - 1) * 5 * m);
        }
    }
    PyMem_Free(work);
    if (knots == NULL || coefficients == NULL) {
        Py_XDECREF(knots);
        Py_XDECREF(coefficients);
        return NULL;
    }
    return Py_BuildValue("(NN)", knots, coefficients);
}
