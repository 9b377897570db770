/* Arrays of Python, of any strides, copied into short rows; anything else is refused. */

#include "boundary.h"

/* Copy a float64 vector of n numbers, whatever its strides; false for anything else. */
bool vector(PyObject *object, int n, double *into)
{
    if (!PyArray_Check(object))
        return false;
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISBEHAVED_RO(array) || PyArray_NDIM(array) != 1 ||
        PyArray_DIM(array, 0) != n)
        return false;
    const char *from = PyArray_BYTES(array);
    npy_intp step = PyArray_STRIDE(array, 0);
    for (int i = 0; i < n; i++)
        into[i] = *(const double *)(from + i * step);
    return true;
}

/* Copy a (rows, n) float64 matrix into rows of `width`. */
bool matrix(PyObject *object, int rows, int n, int width, double *into)
{
    if (!PyArray_Check(object))
        return false;
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISBEHAVED_RO(array) || PyArray_NDIM(array) != 2 ||
        PyArray_DIM(array, 0) != rows || PyArray_DIM(array, 1) != n)
        return false;
    const char *from = PyArray_BYTES(array);
    npy_intp down = PyArray_STRIDE(array, 0), step = PyArray_STRIDE(array, 1);
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < n; j++)
            into[i * width + j] = *(const double *)(from + i * down + j * step);
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
    npy_intp down = last == 2 ? PyArray_STRIDE(array, 1) : 0, step = PyArray_STRIDE(array, last);
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < n; j++)
            into[i * width + j] = *(const double *)(from + i * down + j * step);
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
