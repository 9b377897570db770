// Arrays of Python. In: what numpy.asarray(x, float) takes, of the expected shape and finite. Out: new arrays.
#pragma once
#include "matrix.hpp"
#include <cstring>
#include <nanobind/nanobind.h>
#include <string>
#define NPY_NO_DEPRECATED_API NPY_1_7_API_VERSION
#define PY_ARRAY_UNIQUE_SYMBOL invariantqp_core_numpy  // one table of NumPy's functions, filled by module.cpp
#ifndef IQ_FILLS_NUMPY
#define NO_IMPORT_ARRAY
#endif
#include <numpy/arrayobject.h>

namespace iq {

namespace nb = nanobind;

// Whether infinite numbers are allowed; NaN never is.
enum class Numbers { finite, any };

[[noreturn]] inline void refuse(const std::string& what) { throw nb::value_error(what.c_str()); }

inline std::string text(int ndim, const npy_intp* shape)
{
    std::string found = "(";
    for (int i = 0; i < ndim; i++)
        found += (i ? ", " : "") + (shape[i] < 0 ? std::string("any") : std::to_string(shape[i]));
    return found + (ndim == 1 ? ",)" : ")");
}

// Reads arguments into a workspace, whatever their strides.
class Reader {
  public:
    explicit Reader(Workspace& w) : w(w) {}

    // (n,) numbers; n = -1 takes any length.
    Vec vector(nb::handle value, const char* name, int n, Numbers numbers = Numbers::finite)
    {
        npy_intp shape[1] = {n};
        double* p = read(value, name, 1, shape, numbers);
        return {p, static_cast<int>(shape[0]), &w};
    }
    // (rows, cols) numbers; -1 takes any length.
    Mat matrix(nb::handle value, const char* name, int rows, int cols, Numbers numbers = Numbers::finite)
    {
        npy_intp shape[2] = {rows, cols};
        double* p = read(value, name, 2, shape, numbers);
        return {p, static_cast<int>(shape[0]), static_cast<int>(shape[1]), &w};
    }
    double* read(nb::handle value, const char* name, int ndim, npy_intp* shape, Numbers numbers)
    {
        nb::object owner;
        PyArrayObject* a = checked(value, name, ndim, shape, owner);
        npy_intp count = 1;
        for (int i = 0; i < ndim; i++)
            count *= shape[i];
        double *p = w.take(static_cast<std::size_t>(count)), *end = p;
        copy(PyArray_BYTES(a), a, 0, end);
        if (const char* wrong = not_numbers(p, count, numbers))
            refuse(std::string(name) + wrong);
        return p;
    }
    // The array itself, to be read row by row; `owner` keeps a converted one alive.
    static PyArrayObject* checked(nb::handle value, const char* name, int ndim, npy_intp* shape, nb::object& owner)
    {
        PyArrayObject* a = reinterpret_cast<PyArrayObject*>(value.ptr());
        if (!PyArray_CheckExact(value.ptr()) || PyArray_TYPE(a) != NPY_DOUBLE || !PyArray_ISBEHAVED_RO(a)) {
            owner = converted(value, name);
            a = reinterpret_cast<PyArrayObject*>(owner.ptr());
        }
        bool fits = PyArray_NDIM(a) == ndim;
        for (int i = 0; fits && i < ndim; i++)
            fits = shape[i] < 0 ? PyArray_DIM(a, i) < 1 << 24 : PyArray_DIM(a, i) == shape[i];
        if (!fits)
            refuse(std::string(name) + " has shape " + text(PyArray_NDIM(a), PyArray_DIMS(a)) + ", expected "
                   + text(ndim, shape));
        for (int i = 0; i < ndim; i++)
            shape[i] = PyArray_DIM(a, i);
        return a;
    }
    static const char* not_numbers(const double* p, npy_intp count, Numbers numbers)
    {
        for (npy_intp i = 0; i < count; i++) {
            if (numbers == Numbers::finite && !std::isfinite(p[i]))
                return " has NaN or infinity, expected finite numbers";
            if (std::isnan(p[i]))
                return " has NaN, expected numbers or infinity";
        }
        return nullptr;
    }
    static void copy(const char* from, PyArrayObject* a, int axis, double*& to)
    {
        const npy_intp n = PyArray_DIM(a, axis), stride = PyArray_STRIDE(a, axis);
        for (npy_intp i = 0; i < n; i++, from += stride)
            if (axis + 1 < PyArray_NDIM(a))
                copy(from, a, axis + 1, to);
            else
                *to++ = *reinterpret_cast<const double*>(from);
    }

  private:
    Workspace& w;

    // Lists, and arrays of other real numbers; no truth values, complex numbers, texts or masked arrays.
    static nb::object converted(nb::handle value, const char* name)
    {
        PyObject* any = PyArray_Check(value.ptr()) && !PyArray_CheckExact(value.ptr())
                            ? nullptr
                            : PyArray_FROM_O(value.ptr());
        if (!any && PyErr_Occurred())
            PyErr_Clear();
        const nb::object found = nb::steal(any);
        const int type = any ? PyArray_TYPE(reinterpret_cast<PyArrayObject*>(any)) : NPY_OBJECT;
        if (!any || !(PyTypeNum_ISFLOAT(type) || PyTypeNum_ISINTEGER(type)))
            refuse(std::string(name) + " is no array of real numbers");
        return nb::steal(PyArray_FROM_OTF(any, NPY_DOUBLE, NPY_ARRAY_CARRAY_RO | NPY_ARRAY_NOTSWAPPED));
    }
};

inline nb::object new_array(int ndim, const npy_intp* shape)
{
    PyObject* array = PyArray_SimpleNew(ndim, const_cast<npy_intp*>(shape), NPY_DOUBLE);
    if (!array)
        throw nb::python_error();
    return nb::steal(array);
}
inline double* data_of(nb::handle array)
{
    return static_cast<double*>(PyArray_DATA(reinterpret_cast<PyArrayObject*>(array.ptr())));
}
inline nb::object array_of(Vec x)
{
    const npy_intp shape = x.n;
    nb::object array = new_array(1, &shape);
    std::copy(x.begin(), x.end(), data_of(array));
    return array;
}
inline nb::object array_or_none(Vec x) { return x.w ? array_of(x) : nb::none(); }
inline nb::object matrix_or_none(Mat A)
{
    if (!A.w)
        return nb::none();
    const npy_intp shape[2] = {A.rows, A.cols};
    nb::object array = new_array(2, shape);
    std::copy(A.all().begin(), A.all().end(), data_of(array));
    return array;
}

}  // namespace iq
