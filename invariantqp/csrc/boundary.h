/* What of Python's the files at the boundary share: arrays in, a VelocitySolution out. */

#ifndef BOUNDARY_H
#define BOUNDARY_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#define PY_ARRAY_UNIQUE_SYMBOL invariantqp_arrays
#ifndef IMPORTS_NUMPY
#define NO_IMPORT_ARRAY
#endif
#include <numpy/arrayobject.h>

#include "loop.h"

/* arrays.c */
PyObject *refused(const char *use);
PyObject *left_to_python(void);
bool vector(PyObject *object, int n, double *into);
bool matrix(PyObject *object, int rows, int n, int width, double *into);
bool pose(PyObject *object, Pose *T);
PyObject *new_vector(int n, const double *values);
PyObject *new_matrix(int rows, int n, int width, const double *values);

/* Whether a number that a count is made of is one. */
static inline bool within(double x, int least, int most) { return x >= least && x <= most; }

/* fields.c */
typedef struct Table Table;
typedef enum { FITS, UNFIT, WRONG } Fit;
extern Table TABLE_Law, TABLE_Wanted, TABLE_Loop, TABLE_now, TABLE_tick;
const void *described(const Table *table, PyObject *object);
Fit called_by_name(Table *table, PyObject *const *given, PyObject *names, void *into);
bool types_made(PyObject *module);

/* module.c */
const Loop *loop_of(PyObject *object);
double *memory_of(PyObject *object, const Loop *loop);
bool target_pose(PyObject *object, Pose *T);
int joints_of(PyObject *J);

/* answer.c */
typedef enum { OK, LIMITED, SCALED, GUARDED, DEGRADED } Status;
bool words_made(PyObject *module);
Status status(const Solution *solution);
PyObject *answer_as(PyObject *module, PyObject *const *arguments, Py_ssize_t count);
PyObject *named(PyTypeObject *type, int n, PyObject *const *values);
PyObject *fields(int m, const Solution *solution, const Loop *loop, PyObject *row_names);
PyObject *joint_troubles(const Loop *loop, const Tick *tick);
PyObject *state_troubles(int joints, double dt, double gain, const double *states);

/* pseudoinverse.c, projectors.c */
PyObject *pseudoinverse(PyObject *module, PyObject *const *arguments, Py_ssize_t count);
PyObject *dual_projectors(PyObject *module, PyObject *const *arguments, Py_ssize_t count);

/* sight.c */
PyObject *sight(PyObject *module, PyObject *const *arguments, Py_ssize_t count);

#endif
