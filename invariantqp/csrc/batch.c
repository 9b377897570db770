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
        square += dot_in_steps(demand->m, demand->J[i], demand->J[i]); /* of zeros after them */
        sound = sound && fabs(demand->s[i]) <= LENGTH_LIMIT;
    }
    for (int j = 0; j < demand->m; j++)
        sound = sound && demand->lower[j] <= demand->upper[j] && demand->lower[j] < INFINITY && demand->upper[j] > -INFINITY;
    return sound && square >= SMALLEST_SIZE * SMALLEST_SIZE && square <= LARGEST_SIZE * LARGEST_SIZE;
}

/* An array of an argument of `ticks`, one entry of its first side a row. */
typedef struct {
    const char *name;
    int dimensions, width; /* of the last side; OF_JOINTS is as many as J has */
    bool written;
} Stack;
enum { OF_JOINTS = 0, NUMBERS = 6 };

static bool is_as(const Stack *stack, PyArrayObject *array, npy_intp n, npy_intp m)
{
    return PyArray_Check(array) && PyArray_TYPE(array) == NPY_DOUBLE && PyArray_NDIM(array) == stack->dimensions &&
           (stack->written ? PyArray_ISCARRAY(array) : PyArray_ISBEHAVED_RO(array)) && PyArray_DIM(array, 0) == n &&
           PyArray_DIM(array, stack->dimensions - 1) == (stack->width == OF_JOINTS ? m : stack->width) &&
           (stack->dimensions == 2 || PyArray_DIM(array, 1) == 6);
}

/* ticks(law, unlimited, taken, size, ...): N rows by name, each a tick without dt, by the first law, or the second where a
   joint has no bound, by as many threads as call this with the same `taken`: how many parts of `size` rows, and how many
   records. A row without a root is measured at its point, the arm's own where there are none, with its length, by default
   the reach. Written of each row: velocity, residual, and `numbers`: that of its record, or that it is a closed form and no
   more (PLAIN), or Python's (LEFT), as a row with a prismatic joint and no metric is, which has a metric of its own there;
   method, status (their places in METHODS and STATUSES), scale, damping, guard. */
enum { PLAIN = -1, LEFT = -2 };

PyObject *batch_ticks(PyObject *module, PyObject *const *arguments, Py_ssize_t count, PyObject *names)
{
    (void)module;
    enum { J, TWIST, LOWER, UPPER, VELOCITY, RESIDUAL, OUTCOME, RECORDS, POSTURE, ROOT, POINT, LENGTH, STACKS };
    static const Stack STACK[STACKS] = {
        [J] = {"J", 3, OF_JOINTS, false},
        [TWIST] = {"s", 2, 6, false},
        [LOWER] = {"lower", 2, OF_JOINTS, false},
        [UPPER] = {"upper", 2, OF_JOINTS, false},
        [VELOCITY] = {"velocity", 2, OF_JOINTS, true},
        [RESIDUAL] = {"residual", 2, 6, true},
        [OUTCOME] = {"numbers", 2, NUMBERS, true},
        [RECORDS] = {"records", 2, RECORD, true},
        [POSTURE] = {"posture", 2, OF_JOINTS, false},
        [ROOT] = {"roots", 3, 6, false},
        [POINT] = {"points", 2, 3, false},
        [LENGTH] = {"lengths", 2, 1, false},
    };
    static const char *const USE = "ticks(law, unlimited, taken, size, J=, s=, lower=, upper=, velocity=, residual=, numbers=, records=, "
                                   "posture=, roots=, points=, lengths=)";
    Demand shared = {.posture = {0.0}, .chased = false, .paced = false};
    PyArrayObject *arrays[STACKS] = {NULL};
    const Law *laws[2] = {NULL};
    for (int i = 0; i < 2 && count == 4; i++)
        laws[i] = described(&TABLE_Law, arguments[i]);
    bool good = laws[0] != NULL && laws[1] != NULL;
    for (Py_ssize_t k = 0; good && k < (names == NULL ? 0 : PyTuple_Size(names)); k++) {
        int i = 0;
        for (; i < STACKS && PyUnicode_CompareWithASCIIString(PyTuple_GetItem(names, k), STACK[i].name) != 0; i++)
            ;
        good = i < STACKS;
        if (good && arguments[count + k] != Py_None)
            arrays[i] = (PyArrayObject *)arguments[count + k];
    }
    good = good && arrays[J] != NULL && PyArray_Check(arrays[J]) && PyArray_NDIM(arrays[J]) == 3;
    npy_intp n = good ? PyArray_DIM(arrays[J], 0) : 0, m = good ? PyArray_DIM(arrays[J], 2) : 0;
    for (int i = 0; good && i < STACKS; i++)
        good = arrays[i] == NULL ? i >= POSTURE : is_as(&STACK[i], arrays[i], n, m);
    good = good && m >= 1 && m <= MOST;
    for (int i = 0; good && i < 2; i++)
        good = !laws[i]->has_metric || laws[i]->joints == (int)m;
    PyArrayObject *counts = good ? (PyArrayObject *)arguments[2] : NULL;
    good = good && PyArray_Check(counts) && PyArray_TYPE(counts) == NPY_INT32 && PyArray_ISCARRAY(counts) &&
           PyArray_NDIM(counts) == 1 && PyArray_DIM(counts, 0) == 2;
    npy_intp size = good ? (npy_intp)PyLong_AsSsize_t(arguments[3]) : 0;
    if (size < 1)
        return refused(USE);
    shared.m = (int)m;
    shared.has_posture = arrays[POSTURE] != NULL;
    shared.has_point = arrays[POINT] != NULL;
    static const double ORIGIN[3] = {0.0};
    npy_int32 *taken = (npy_int32 *)PyArray_DATA(counts);
    Py_BEGIN_ALLOW_THREADS
    Demand demand = shared;
    Solution solution;
    for (npy_intp begin = another(taken) * size; begin < n; begin = another(taken) * size)
        for (npy_intp row = begin; row < n && row < begin + size; row++) {
            double *numbers = (double *)PyArray_DATA(arrays[OUTCOME]) + row * NUMBERS;
            copied(arrays[J], row, 6, shared.m, MOST, demand.J[0]);
            copied(arrays[TWIST], row, 1, 6, 6, demand.s);
            copied(arrays[LOWER], row, 1, shared.m, MOST, demand.lower);
            copied(arrays[UPPER], row, 1, shared.m, MOST, demand.upper);
            if (shared.has_posture)
                copied(arrays[POSTURE], row, 1, shared.m, MOST, demand.posture);
            if (arrays[ROOT] != NULL)
                copied(arrays[ROOT], row, 6, 6, 6, demand.root[0]);
            if (arrays[POINT] != NULL)
                copied(arrays[POINT], row, 1, 3, 3, demand.point);
            if (arrays[LENGTH] != NULL)
                copied(arrays[LENGTH], row, 1, 1, 1, &demand.length);
            governed(laws[!(all_finite(shared.m, demand.lower) && all_finite(shared.m, demand.upper))], &demand);
            numbers[0] = LEFT;
            if (!is_sound(&demand) || (demand.metric == NULL && is_sliding(shared.m, (const Row *)demand.J, ORIGIN, 1.0)) ||
                (arrays[ROOT] == NULL && measured(&demand) == HAND_BACK) || solve(&demand, &solution) == HAND_BACK)
                continue;
            memcpy((double *)PyArray_DATA(arrays[VELOCITY]) + row * m, solution.velocity, (size_t)m * sizeof(double));
            memcpy((double *)PyArray_DATA(arrays[RESIDUAL]) + row * 6, solution.residual, 6 * sizeof(double));
            npy_int32 record = is_plain(&solution) ? PLAIN : another(taken + 1);
            double outcome[NUMBERS] = {record,         solution.method,  status(&solution),
                                       solution.scale, solution.damping, solution.blended};
            memcpy(numbers, outcome, sizeof outcome);
            if (record >= 0 && record < n)
                memcpy((double *)PyArray_DATA(arrays[RECORDS]) + record * RECORD, &solution, RECORD * sizeof(double));
        }
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

/* solution(record): the fields of a VelocitySolution that `ticks` recorded. */
PyObject *batch_solution(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Solution solution = {.m = 0};
    if (count != 1 || !vector(arguments[0], (int)RECORD, (double *)&solution) || !within(solution.m, 1, MOST) ||
        solution.limits != 0 || !within((int)solution.method, CLOSED_FORM, QP))
        return refused("solution(record)");
    return fields(solution.m, &solution, NULL, NULL);
}
