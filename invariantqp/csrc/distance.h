/* Convex shapes and the places where two of them are near. */

#ifndef DISTANCE_H
#define DISTANCE_H

#include "core.h"

enum { ROUND, BLOCK, FREE_SIDE, MESH }; /* kinds of core */
/* Edge pairs of two boxes, twice, each with its shadow, and all corners. */
#define MOST_PLACES 96

typedef struct {
    int body, kind;
    double radius, half[3], R[3][3], p[3], ball; /* R: columns are the shape's axes; ball: radius of one about it */
} Shape;

/* A place where two shapes are near: how far, the direction from the first to the second, a point of that line. */
typedef struct {
    double d, n[3], x[3];
} Near;

typedef struct {
    int count;
    Near at[MOST_PLACES];
} Places;

/* distance.c; the places come by their distance, and two shapes are at least so far apart */
void near_places(const Shape *a, const Shape *b, Places *found);
double at_least(const Shape *a, const Shape *b);

#endif
