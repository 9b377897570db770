/* Arrays of Python, of any strides, copied into short rows; anything else is refused. */

#include "boundary.h"

/* A TypeError that says how a function is called, unless there is an error already. */
PyObject *refused(const char *use)
{
    if (!PyErr_Occurred())
        PyErr_SetString(PyExc_TypeError, use);
    return NULL;
}

/* None, unless there is an error. */
PyObject *left_to_python(void) { return PyErr_Occurred() ? NULL : Py_NewRef(Py_None); }

/* Whether an object is a float64 array of so many dimensions, whatever its strides; of a subclass, such as a masked
   array, numbers need not be what they seem. */
static bool is_array(PyObject *object, int dimensions)
{
    PyArrayObject *array = (PyArrayObject *)object;
    return PyArray_CheckExact(object) && PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISBEHAVED_RO(array) &&
           PyArray_NDIM(array) == dimensions;
}

static void strided(const char *from, npy_intp down, npy_intp step, int rows, int n, int width, double *into)
{
    if (step == sizeof(double) && down == n * step && n == width) { /* one row */
        n *= rows;
        rows = 1;
    }
    for (int i = 0; i < rows; i++, from += down, into += width)
        if (step == sizeof(double))
            memcpy(into, from, (size_t)n * sizeof(double));
        else
            for (int j = 0; j < n; j++)
                into[j] = *(const double *)(from + j * step);
}

/* Copy a float64 vector of n numbers; false for anything else. */
bool vector(PyObject *object, int n, double *into)
{
    PyArrayObject *array = (PyArrayObject *)object;
    if (!is_array(object, 1) || PyArray_DIM(array, 0) != n)
        return false;
    strided(PyArray_BYTES(array), 0, PyArray_STRIDE(array, 0), 1, n, n, into);
    return true;
}

/* Copy a (rows, n) float64 matrix into rows of `width`; false for anything else. */
bool matrix(PyObject *object, int rows, int n, int width, double *into)
{
    PyArrayObject *array = (PyArrayObject *)object;
    if (!is_array(object, 2) || PyArray_DIM(array, 0) != rows || PyArray_DIM(array, 1) != n)
        return false;
    strided(PyArray_BYTES(array), PyArray_STRIDE(array, 0), PyArray_STRIDE(array, 1), rows, n, width, into);
    return true;
}

bool pose(PyObject *object, Pose *T)
{
    double H[16];
    if (!matrix(object, 4, 4, 4, H) || !all_finite(16, H) || H[12] != 0.0 || H[13] != 0.0 || H[14] != 0.0 ||
        H[15] != 1.0)
        return false;
    pose_from(H, T);
    return true;
}

/* Copy one row of a float64 array (N, n) or (N, rows, n), checked before. */
void copied(PyArrayObject *array, npy_intp row, int rows, int n, int width, double *into)
{
    const char *from = PyArray_BYTES(array) + row * PyArray_STRIDE(array, 0);
    int last = PyArray_NDIM(array) - 1;
    strided(from, last == 2 ? PyArray_STRIDE(array, 1) : 0, PyArray_STRIDE(array, last), rows, n, width, into);
}

PyObject *new_vector(int n, const double *values)
{
    npy_intp size = n;
    PyObject *array = PyArray_SimpleNew(1, &size, NPY_DOUBLE);
    if (array != NULL)
        memcpy(PyArray_DATA((PyArrayObject *)array), values, (size_t)n * sizeof *values);
    return array;
}

/* (rows, n) of rows of `width`. */
PyObject *new_matrix(int rows, int n, int width, const double *values)
{
    npy_intp size[2] = {rows, n};
    PyObject *array = PyArray_SimpleNew(2, size, NPY_DOUBLE);
    for (int i = 0; array != NULL && i < rows; i++)
        memcpy((double *)PyArray_DATA((PyArrayObject *)array) + i * n, values + i * width, (size_t)n * sizeof *values);
    return array;
}
