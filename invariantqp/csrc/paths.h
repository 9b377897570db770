/* What the files of paths share. */

#ifndef PATHS_H
#define PATHS_H

#include "boundary.h"
#include <math.h>
#include <string.h>

/* paths/reference.py, paths/time_law.py */
#define CATCH_UP_SHARE 0.7
#define CATCH_UP_SPEED 0.99
#define TRACKING_SHARE 0.1
#define HALVINGS 24
#define EXCESS 1e-9
#define ROUNDING 1e-6
#define IN_PLACE 1e-6
#define SHARE 0.97
#define PLACES 21
#define EASIER 1.3
#define TRIES 12

/* paths/time_law.py: JointLimits */
typedef struct {
    int m;
    double dt;
    const double *lower, *upper, *fastest, *acceleration, *jerk;
} JointLimits;

/* paths/reference.py: what is followed, as `Reference.course` lays it out; arrays row by row. */
enum { JOINT_COUNT, COLUMNS, PIECES, POWERS, TICK, GAIN, KEEPS_SHAPE, STRAY, CLOCK, SPLICE = CLOCK + 6, HEAD = SPLICE + 2 };
typedef struct {
    JointLimits limits;
    int columns, pieces, powers;
    double gain;
    bool shape;
    const double *head, *residual, *knots, *values;
} Course;

/* Position, velocity, acceleration and jerk of joints and, last, of a place. */
typedef double Path[4][MOST + 1];

/* time_law.c */
double needed_share(const JointLimits *limits, int j, double x, double v, double a, double jerk);
double towards(const JointLimits *limits, int j, double velocity, double wanted);
double homing(const JointLimits *limits, int j, double way, double gain);
double catching_up(const JointLimits *limits, int j, double position, double velocity, double there, double speed);
double nearest(const JointLimits *limits, int j, double q, double velocity, double acceleration, double wanted);

/* reference.c */
bool course_of(PyObject *object, Course *course);
void source_at(const Course *course, double time, Path r);
void source_position(const Course *course, double time, double *r);
bool splices(const Course *course, double time, const double *state, double duration, double *found);
void quintic(int m, const double *powers, double u, Path r);
void left_over(const Course *course, double time, Path r);
PyObject *splice(PyObject *module, PyObject *const *arguments, Py_ssize_t count);
PyObject *planned(PyObject *module, PyObject *const *arguments, Py_ssize_t count);

/* follow.c */
PyObject *follow(PyObject *module, PyObject *const *arguments, Py_ssize_t count);

#endif
