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

/* ticks(law, taken, size, ...): N rows by name, each a tick without dt, by as many threads as call this with the same
   `taken`: how many parts of `size` rows, and how many records. Written of each row: velocity, residual, and `numbers`:
   that of its record, or that it is a closed form and no more (PLAIN), or Python's (LEFT), as a row with a prismatic joint
   and no metric is, which has a metric of its own there; method, status (their places in METHODS and STATUSES), scale,
   damping, guard. */
enum { PLAIN = -1, LEFT = -2 };

PyObject *batch_ticks(PyObject *module, PyObject *const *arguments, Py_ssize_t count, PyObject *names)
{
    (void)module;
    enum { J, TWIST, ROOT, LOWER, UPPER, POSTURE, VELOCITY, RESIDUAL, OUTCOME, RECORDS, STACKS };
    static const Stack STACK[STACKS] = {
        [J] = {"J", 3, OF_JOINTS, false},
        [TWIST] = {"s", 2, 6, false},
        [ROOT] = {"roots", 3, 6, false},
        [LOWER] = {"lower", 2, OF_JOINTS, false},
        [UPPER] = {"upper", 2, OF_JOINTS, false},
        [POSTURE] = {"posture", 2, OF_JOINTS, false},
        [VELOCITY] = {"velocity", 2, OF_JOINTS, true},
        [RESIDUAL] = {"residual", 2, 6, true},
        [OUTCOME] = {"numbers", 2, NUMBERS, true},
        [RECORDS] = {"records", 2, RECORD, true},
    };
    static const char *const USE = "ticks(law, taken, size, J=, s=, roots=, lower=, upper=, posture=, velocity=, residual=, "
                                   "numbers=, records=)";
    Demand shared = {.posture = {0.0}, .chased = false, .paced = false};
    PyArrayObject *arrays[STACKS] = {NULL};
    const Law *law = count == 3 ? described(&TABLE_Law, arguments[0]) : NULL;
    bool good = law != NULL;
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
        good = arrays[i] == NULL ? i == POSTURE : is_as(&STACK[i], arrays[i], n, m);
    good = good && m >= 1 && m <= MOST && (!law->has_metric || law->joints == (int)m);
    PyArrayObject *counts = good ? (PyArrayObject *)arguments[1] : NULL;
    good = good && PyArray_Check(counts) && PyArray_TYPE(counts) == NPY_INT32 && PyArray_ISCARRAY(counts) &&
           PyArray_NDIM(counts) == 1 && PyArray_DIM(counts, 0) == 2;
    npy_intp size = good ? (npy_intp)PyLong_AsSsize_t(arguments[2]) : 0;
    if (size < 1)
        return refused(USE);
    shared.m = (int)m;
    shared.has_posture = arrays[POSTURE] != NULL;
    governed(law, &shared);
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
            copied(arrays[ROOT], row, 6, 6, 6, demand.root[0]);
            copied(arrays[LOWER], row, 1, shared.m, MOST, demand.lower);
            copied(arrays[UPPER], row, 1, shared.m, MOST, demand.upper);
            if (shared.has_posture)
                copied(arrays[POSTURE], row, 1, shared.m, MOST, demand.posture);
            numbers[0] = LEFT;
            if (!is_sound(&demand) || (shared.metric == NULL && is_sliding(shared.m, (const Row *)demand.J, ORIGIN, 1.0)) ||
                solve(&demand, &solution) == HAND_BACK)
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
