/* What a tick is given in Python, read into a Demand; false for what is not as it has to be. */

#include "boundary.h"

/* Read a policy; its form, if it has one, goes into `form`. */
bool policy(PyObject *tuple, Demand *demand, Form *form)
{
    if (!PyTuple_Check(tuple) || PyTuple_Size(tuple) != 5)
        return false;
    demand->threshold = PyFloat_AsDouble(PyTuple_GetItem(tuple, 0));
    demand->ceiling = PyFloat_AsDouble(PyTuple_GetItem(tuple, 1));
    demand->fixed = PyFloat_AsDouble(PyTuple_GetItem(tuple, 2));
    demand->speed = PyFloat_AsDouble(PyTuple_GetItem(tuple, 3));
    demand->form = NULL;
    PyObject *given = PyTuple_GetItem(tuple, 4);
    if (given != Py_None) {
        if (!PyTuple_Check(given) || PyTuple_Size(given) != 3)
            return false;
        PyObject *Z = PyTuple_GetItem(given, 2);
        npy_intp count = PyArray_Check(Z) && PyArray_NDIM((PyArrayObject *)Z) == 2 ? PyArray_DIM((PyArrayObject *)Z, 0) : -1;
        if (count < 0 || count > 6 || !matrix(Z, (int)count, 6, 6, form->Z[0]))
            return false;
        form->pitch = PyFloat_AsDouble(PyTuple_GetItem(given, 0));
        form->fraction = PyFloat_AsDouble(PyTuple_GetItem(given, 1));
        form->count = (double)count;
        demand->form = form;
    }
    return !PyErr_Occurred();
}

/* Read exact rows: (A, b, of_twist or None, how many of them an arm can keep, or None). */
bool exact(PyObject *tuple, Demand *demand)
{
    if (!PyTuple_Check(tuple) || PyTuple_Size(tuple) != 4)
        return false;
    PyObject *A = PyTuple_GetItem(tuple, 0), *D = PyTuple_GetItem(tuple, 2), *rank = PyTuple_GetItem(tuple, 3);
    bool good = PyArray_Check(A) && PyArray_NDIM((PyArrayObject *)A) == 2;
    npy_intp rows = good ? PyArray_DIM((PyArrayObject *)A, 0) : 0;
    if (rows < 1 || rows > MOST_ROWS)
        return false;
    demand->rows = (int)rows;
    demand->of_twist = D != Py_None;
    demand->row_rank = rank == Py_None ? -1 : (int)PyLong_AsLong(rank);
    return matrix(A, demand->rows, demand->m, MOST, demand->C[0]) &&
           vector(PyTuple_GetItem(tuple, 1), demand->rows, demand->e) &&
           (!demand->of_twist || matrix(D, demand->rows, 6, 6, demand->D[0]));
}

/* Read a speed limit: (J, limit, start). */
bool cone(PyObject *tuple, Demand *demand)
{
    if (!PyTuple_Check(tuple) || PyTuple_Size(tuple) != 3)
        return false;
    demand->cone.limit = PyFloat_AsDouble(PyTuple_GetItem(tuple, 1));
    return demand->cone.limit > 0.0 && matrix(PyTuple_GetItem(tuple, 0), 3, demand->m, MOST, demand->cone.J[0]) &&
           vector(PyTuple_GetItem(tuple, 2), 3, demand->cone.start);
}

/* Read limits on combinations of joint velocities: (C, lower, upper). */
bool limits(PyObject *tuple, Demand *demand)
{
    if (!PyTuple_Check(tuple) || PyTuple_Size(tuple) != 3)
        return false;
    PyObject *C = PyTuple_GetItem(tuple, 0);
    bool good = PyArray_Check(C) && PyArray_NDIM((PyArrayObject *)C) == 2;
    npy_intp rows = good ? PyArray_DIM((PyArrayObject *)C, 0) : 0;
    if (rows < 1 || rows > MOST)
        return false;
    demand->limits = (int)rows;
    return matrix(C, demand->limits, demand->m, MOST, demand->G[0]) &&
           vector(PyTuple_GetItem(tuple, 1), demand->limits, demand->least) &&
           vector(PyTuple_GetItem(tuple, 2), demand->limits, demand->most);
}

/* Read a joint metric: (T, its inverse). */
bool metric(PyObject *tuple, int m, Metric *into)
{
    return PyTuple_Check(tuple) && PyTuple_Size(tuple) == 2 &&
           matrix(PyTuple_GetItem(tuple, 0), m, m, MOST, into->T[0]) &&
           matrix(PyTuple_GetItem(tuple, 1), m, m, MOST, into->inverse[0]);
}

/* Read a chase: (ahead, what exact rows demand for it or None, lower, upper, slack, apart); after `exact`. */
bool chase(PyObject *tuple, Demand *demand)
{
    if (!PyTuple_Check(tuple) || PyTuple_Size(tuple) != 6)
        return false;
    Chase *into = &demand->chase;
    into->slack = PyFloat_AsDouble(PyTuple_GetItem(tuple, 4));
    into->apart = PyObject_IsTrue(PyTuple_GetItem(tuple, 5)) == 1;
    return !PyErr_Occurred() && vector(PyTuple_GetItem(tuple, 0), 6, into->ahead) &&
           (demand->rows == 0 || vector(PyTuple_GetItem(tuple, 1), demand->rows, into->rows_ahead)) &&
           vector(PyTuple_GetItem(tuple, 2), demand->m, into->lower) &&
           vector(PyTuple_GetItem(tuple, 3), demand->m, into->upper);
}

/* How many columns a matrix has; 0 for something else, and for more than the core has room for. */
int joints_of(PyObject *J)
{
    bool good = PyArray_Check(J) && PyArray_NDIM((PyArrayObject *)J) == 2;
    npy_intp m = good ? PyArray_DIM((PyArrayObject *)J, 1) : 0;
    return m > MOST ? 0 : (int)m;
}
