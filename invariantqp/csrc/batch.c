/* Many ticks at once, and what is told of each. */

#include "boundary.h"
#if defined(_MSC_VER)
#include <intrin.h>
#endif

/* A number that no other thread has yet. */
static npy_int32 another(npy_int32 *taken)
{
#if defined(_MSC_VER)
    return _InterlockedExchangeAdd((long volatile *)taken, 1);
#else
    return __atomic_fetch_add(taken, 1, __ATOMIC_RELAXED);
#endif
}

/* velocity/batch.py, check: whether it has nothing to refuse of a row; `solve` looks at the posture. */
static bool is_sound(const Demand *demand)
{
    double square = 0.0;
    bool sound = true;
    for (int i = 0; i < 6; i++) {
        square += dot(demand->m, demand->J[i], demand->J[i]);
        sound = sound && fabs(demand->s[i]) <= LARGEST_SPEED;
    }
    for (int j = 0; j < demand->m; j++)
        sound = sound && demand->lower[j] <= demand->upper[j] && demand->lower[j] < INFINITY && demand->upper[j] > -INFINITY;
    return sound && square >= SMALLEST_SIZE * SMALLEST_SIZE && square <= LARGEST_SIZE * LARGEST_SIZE;
}

/* A word into one row of an array of NumPy's text. */
static void spell(PyArrayObject *texts, npy_intp row, int letters, const char *word)
{
    npy_ucs4 *into = (npy_ucs4 *)PyArray_DATA(texts) + row * letters;
    int i = 0;
    for (; word[i] != 0; i++)
        into[i] = (npy_ucs4)word[i];
    for (; i < letters; i++)
        into[i] = 0;
}

/* What a row of an argument is. */
typedef struct {
    int type, dimensions;
    enum { SIX, OF_JOINTS, THREE, WHOLE_RECORD, LETTERS } width; /* of the last dimension, (N,) has none */
    int letters;
} Expected;

static bool is_as(const Expected *expected, PyArrayObject *array, npy_intp n, npy_intp m, bool written)
{
    static const npy_intp WIDTHS[] = {[SIX] = 6, [THREE] = 3, [WHOLE_RECORD] = RECORD};
    if (!PyArray_Check(array) || PyArray_TYPE(array) != expected->type || PyArray_NDIM(array) != expected->dimensions ||
        !(written ? PyArray_ISCARRAY(array) : PyArray_ISBEHAVED_RO(array)) || PyArray_DIM(array, 0) != n)
        return false;
    if (expected->dimensions == 1)
        return expected->letters == 0 || PyArray_ITEMSIZE(array) == expected->letters * (int)sizeof(npy_ucs4);
    return PyArray_DIM(array, expected->dimensions - 1) == (expected->width == OF_JOINTS ? m : WIDTHS[expected->width]) &&
           (expected->dimensions == 2 || PyArray_DIM(array, 1) == 6);
}

/* ticks(J, s, roots, lower, upper, posture, velocity, residual, record, method, status, numbers, records, law,
   taken, size): N rows, each a tick without dt, by as many threads as call this with the same `taken`:
   how many parts of `size` rows, and how many records. Written of each row: velocity and residual; the number of its
   record, or that it is a closed form and no more (PLAIN), or Python's (LEFT), as a row with a prismatic joint and no
   metric is, which has a metric of its own there; method and status in words; scale, damping, guard. */
enum { PLAIN = -1, LEFT = -2 };

PyObject *batch_ticks(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    enum { J, TWIST, ROOT, LOWER, UPPER, POSTURE, VELOCITY, RESIDUAL, NUMBER, METHOD, STATUS, NUMBERS, RECORDS, ARRAYS };
    enum { OF_LAW = ARRAYS, TAKEN, SIZE, COUNT };
    static const Expected EXPECTED[ARRAYS] = {
        [J] = {NPY_DOUBLE, 3, OF_JOINTS, 0},        [TWIST] = {NPY_DOUBLE, 2, SIX, 0},
        [ROOT] = {NPY_DOUBLE, 3, SIX, 0},           [LOWER] = {NPY_DOUBLE, 2, OF_JOINTS, 0},
        [UPPER] = {NPY_DOUBLE, 2, OF_JOINTS, 0},    [POSTURE] = {NPY_DOUBLE, 2, OF_JOINTS, 0},
        [VELOCITY] = {NPY_DOUBLE, 2, OF_JOINTS, 0}, [RESIDUAL] = {NPY_DOUBLE, 2, SIX, 0},
        [NUMBER] = {NPY_INT32, 1, LETTERS, 0},      [METHOD] = {NPY_UNICODE, 1, LETTERS, METHOD_LETTERS},
        [NUMBERS] = {NPY_DOUBLE, 2, THREE, 0},      [STATUS] = {NPY_UNICODE, 1, LETTERS, STATUS_LETTERS},
        [RECORDS] = {NPY_DOUBLE, 2, WHOLE_RECORD, 0},
    };
    Demand shared = {.posture = {0.0}, .chased = false, .paced = false};
    PyArrayObject *arrays[ARRAYS] = {NULL}, *first = count == COUNT ? (PyArrayObject *)arguments[J] : NULL;
    bool good = first != NULL && PyArray_Check(first) && PyArray_NDIM(first) == 3;
    const Law *law = good ? described(&TABLE_Law, arguments[OF_LAW]) : NULL;
    good = law != NULL;
    npy_intp n = good ? PyArray_DIM(first, 0) : 0, m = good ? PyArray_DIM(first, 2) : 0;
    for (int i = 0; good && i < ARRAYS; i++)
        if (i != POSTURE || arguments[i] != Py_None) {
            arrays[i] = (PyArrayObject *)arguments[i];
            good = is_as(&EXPECTED[i], arrays[i], n, m, i >= VELOCITY);
        }
    good = good && m >= 1 && m <= MOST && (!law->has_metric || law->joints == (int)m);
    PyArrayObject *counts = good ? (PyArrayObject *)arguments[TAKEN] : NULL;
    good = good && PyArray_Check(counts) && PyArray_TYPE(counts) == NPY_INT32 && PyArray_ISCARRAY(counts) &&
           PyArray_NDIM(counts) == 1 && PyArray_DIM(counts, 0) == 2;
    npy_intp size = good ? (npy_intp)PyLong_AsSsize_t(arguments[SIZE]) : 0;
    if (size < 1)
        return refused("ticks(J, s, roots, lower, upper, posture, velocity, residual, record, method, status, "
                       "numbers, records, law, taken, size)");
    shared.m = (int)m;
    shared.has_posture = arrays[POSTURE] != NULL;
    governed(law, &shared);
    static const double ORIGIN[3] = {0.0};
    npy_int32 *taken = (npy_int32 *)PyArray_DATA(counts), *record = (npy_int32 *)PyArray_DATA(arrays[NUMBER]);
    Py_BEGIN_ALLOW_THREADS
    Demand demand = shared;
    Solution solution;
    for (npy_intp begin = another(taken) * size; begin < n; begin = another(taken) * size)
        for (npy_intp row = begin; row < n && row < begin + size; row++) {
            double *numbers = (double *)PyArray_DATA(arrays[NUMBERS]) + row * 3;
            copied(arrays[J], row, 6, shared.m, MOST, demand.J[0]);
            copied(arrays[TWIST], row, 1, 6, 6, demand.s);
            copied(arrays[ROOT], row, 6, 6, 6, demand.root[0]);
            copied(arrays[LOWER], row, 1, shared.m, MOST, demand.lower);
            copied(arrays[UPPER], row, 1, shared.m, MOST, demand.upper);
            if (shared.has_posture)
                copied(arrays[POSTURE], row, 1, shared.m, MOST, demand.posture);
            record[row] = LEFT;
            if (!is_sound(&demand) || (shared.metric == NULL && is_sliding(shared.m, (const Row *)demand.J, ORIGIN, 1.0)) ||
                solve(&demand, &solution) == HAND_BACK)
                continue;
            memcpy((double *)PyArray_DATA(arrays[VELOCITY]) + row * m, solution.velocity, (size_t)m * sizeof(double));
            memcpy((double *)PyArray_DATA(arrays[RESIDUAL]) + row * 6, solution.residual, 6 * sizeof(double));
            spell(arrays[METHOD], row, METHOD_LETTERS, method_word(&solution));
            spell(arrays[STATUS], row, STATUS_LETTERS, status_word(&solution));
            numbers[0] = solution.scale;
            numbers[1] = solution.damping;
            numbers[2] = solution.blended;
            record[row] = is_plain(&solution) ? PLAIN : another(taken + 1);
            if (record[row] >= 0 && record[row] < n)
                memcpy((double *)PyArray_DATA(arrays[RECORDS]) + record[row] * RECORD, &solution, sizeof solution);
        }
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

/* solution(record): the fields of a VelocitySolution that `ticks` recorded. */
PyObject *batch_solution(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Solution solution;
    if (count != 1 || !vector(arguments[0], (int)RECORD, (double *)&solution) || !within(solution.m, 1, MOST) ||
        !within(solution.limits, 0, MOST_LIMITS) || !within((int)solution.method, CLOSED_FORM, QP))
        return refused("solution(record)");
    return fields(solution.m, &solution);
}
