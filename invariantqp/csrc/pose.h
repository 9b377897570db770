/* What the files of a pose search share. */

#ifndef POSE_H
#define POSE_H

#include "loop.h"

#define STALLED 6
/* pose/newton.py: where one try is; one that is `going` goes on from what it knows */
typedef struct {
    Row q;
    double f, unmet, merit;
    struct {
        double steps, damping, penalty, past[STALLED + 1];
    } known;
    bool met, at_rest, going;
} Try;

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
void misses(const Arm *arm, const Pose *target, const double *q, double *position, double *orientation);
Outcome descend(const Arm *arm, const Pose *target, double goal, bool turning, bool patient, int window, Try *found);

#define DAMPING 0.1
#define EASED 0.5
#define STIFFENED 4.0
#define LEAST 1e-3
#define FLOOR 1e-13
#define QP_FLOOR 1e-8
#define FINISHED 3
#define LONGEST 100
#define PATIENCE 1000
/* Steps between two looks at the clock: a search with 7 joints was late by 1 ms at most, 14 by 2.4. */
#define AT_A_TIME 25
#define STIFFEST 1e8
#define AT_REST 1e-12
#define DIFFERENCE 1e-7
#define EXACT_ROW_TOLERANCE 1e-10
#define ROW_FLOOR 1e-9
#define AT_LIMIT 1e-9
#define DEAREST 10.0
#define PENALTY_MARGIN 2.0

#endif
