/* Twin of Chain.sight in robots/chain.py, for callers that need no more of a tick: joint twists, tool pose, error. */

#include "boundary.h"

PyObject *sight(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    if (count != 4)
        return refused("sight(screws, home, q, target or None)");
    npy_intp m = PyArray_Check(arguments[2]) ? PyArray_SIZE((PyArrayObject *)arguments[2]) : 0;
    Row screws[6], J[6], q;
    Pose home, tool, target;
    double error[6];
    if (m < 1 || m > MOST || !matrix(arguments[0], 6, (int)m, MOST, screws[0]) || !pose(arguments[1], &home) ||
        !vector(arguments[2], (int)m, q) || !all_finite((int)m, q))
        Py_RETURN_NONE;
    kinematics((int)m, (const Row *)screws, &home, q, J, &tool);
    bool known = arguments[3] != Py_None && pose(arguments[3], &target) && error_twist(&target, &tool, error) == DONE;
    double T[16] = {[15] = 1.0};
    for (int i = 0; i < 3; i++) {
        memcpy(T + 4 * i, tool.R[i], 3 * sizeof(double));
        T[4 * i + 3] = tool.p[i];
    }
    return Py_BuildValue("(NNN)", new_matrix(6, (int)m, MOST, J[0]), new_matrix(4, 4, 4, T),
                         known ? new_vector(6, error) : Py_NewRef(Py_None));
}
