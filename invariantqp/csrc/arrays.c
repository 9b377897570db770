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

/* A number of Python or NumPy, real and no truth value. */
static bool number_in(PyObject *object, double *into)
{
    bool whole = PyLong_Check(object) && !PyBool_Check(object);
    if (!whole && !PyFloat_Check(object) && !PyArray_IsScalar(object, Floating) && !PyArray_IsScalar(object, Integer))
        return false;
    *into = PyFloat_AsDouble(object);
    bool good = !PyErr_Occurred();
    PyErr_Clear(); /* Python says what is wrong */
    return good;
}

/* The items of a list or a tuple of so many, borrowed; false for anything else. */
static bool item_of(PyObject *object, int n, int i, PyObject **item)
{
    if (PyList_Check(object) && PyList_Size(object) == n)
        *item = PyList_GetItem(object, i);
    else if (PyTuple_Check(object) && PyTuple_Size(object) == n)
        *item = PyTuple_GetItem(object, i);
    else
        return false;
    return *item != NULL;
}

/* An array of other numbers, float32 or whole, as float64, new; NULL for anything else. */
static PyObject *as_doubles(PyObject *object)
{
    if (!PyArray_CheckExact(object))
        return NULL;
    int type = PyArray_TYPE((PyArrayObject *)object);
    if (!PyTypeNum_ISFLOAT(type) && !PyTypeNum_ISINTEGER(type))
        return NULL;
    PyObject *array = PyArray_FROM_OTF(object, NPY_DOUBLE, NPY_ARRAY_CARRAY_RO | NPY_ARRAY_NOTSWAPPED);
    PyErr_Clear(); /* Python says what is wrong */
    return array;
}

/* Copy a vector of n numbers, an array, a list or a tuple; false for anything else. */
bool vector(PyObject *object, int n, double *into)
{
    PyArrayObject *array = (PyArrayObject *)object;
    if (is_array(object, 1)) {
        if (PyArray_DIM(array, 0) != n)
            return false;
        strided(PyArray_BYTES(array), 0, PyArray_STRIDE(array, 0), 1, n, n, into);
        return true;
    }
    PyObject *other = as_doubles(object), *item;
    bool good = other != NULL && is_array(other, 1) && vector(other, n, into);
    Py_XDECREF(other);
    if (PyArray_Check(object))
        return good;
    for (int i = 0; i < n; i++)
        if (!item_of(object, n, i, &item) || !number_in(item, into + i))
            return false;
    return n > 0;
}

/* Copy a (rows, n) matrix into rows of `width`, an array, or a list or tuple of rows; false for anything else. */
bool matrix(PyObject *object, int rows, int n, int width, double *into)
{
    PyArrayObject *array = (PyArrayObject *)object;
    if (is_array(object, 2)) {
        if (PyArray_DIM(array, 0) != rows || PyArray_DIM(array, 1) != n)
            return false;
        strided(PyArray_BYTES(array), PyArray_STRIDE(array, 0), PyArray_STRIDE(array, 1), rows, n, width, into);
        return true;
    }
    PyObject *other = as_doubles(object), *item;
    bool good = other != NULL && is_array(other, 2) && matrix(other, rows, n, width, into);
    Py_XDECREF(other);
    if (PyArray_Check(object))
        return good;
    for (int i = 0; i < rows; i++)
        if (!item_of(object, rows, i, &item) || !vector(item, n, into + i * width))
            return false;
    return rows > 0;
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
