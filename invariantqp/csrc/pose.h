/* What the files of a pose search share. */

#ifndef POSE_H
#define POSE_H

#include "core.h"

/* pose/error.py: the error in one state, to first order; a joint step x changes r to r - A x and b to b - C x. */
typedef struct {
    int rows;
    Row A[6], C[MOST_ROWS];
    double r[6], b[MOST_ROWS], f;
} Linearization;

/* pose.c, exact_pose.c */
bool is_inside(int n, const double *x, const double *lower, const double *upper);
void quadratic_of(int n, const Row *L, const Row g, Quadratic *problem);
Outcome exact_step(int m, const Linearization *state, double damping, const Row lower, const Row upper, Row x,
                   double *price);

#endif
