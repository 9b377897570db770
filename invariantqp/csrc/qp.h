/* What the files of the quadratic program share. */

#ifndef QP_H
#define QP_H

#include "core.h"

/* Centred: lower <= N e <= upper. */
typedef struct {
    int n, count;
    Row N[LIMITS];
    double lower[LIMITS], upper[LIMITS], length[LIMITS];
} Room;

/* The e with N_a e = b_a; at[i] is a limit and bound[i] its b, N_a' = Q R by orthonormal rows Q[i], and the shortest and
   longest part that a limit added to those before it. */
typedef struct {
    int k, at[MOST];
    Row Q[MOST], R[MOST], bound, e;
    double least, most;
} Face;

/* active.c, primal.c */
void shortest(const Face *face, int n, const double *b, Row e);
void multipliers(const Face *face, const Room *room, const Row pull, double *y);
Outcome face_of(const Room *room, const int *side, Face *face);
Outcome joined(const Room *room, int i, int side, Face *face);
int weakest(const Room *room, const Face *face, const Row pull, const int *side, const double *y, bool late);
Outcome on_face(const Slow *slow, int n, Face *face, Row pull, double *nu);
Outcome from_inside(const Room *room, const Slow *slow, int *side, Row e, Face *face, double *y, double *nu);

#endif
