/* What the files of a tick along a path share. */

#ifndef PATH_H
#define PATH_H

#include "loop.h"

/* given_path.py, path_plan.py and path_pace.py: what is fixed while the tool is driven; arrays lie row by row. */
typedef struct {
    int m, knots, poses;
    double slow, rate, most, jerk, tolerance, braking; /* a rate or jerk of 0 is none */
    double above, up_to;                               /* overrides that the plan is for */
    bool cut;                           /* the plan ends before the path does, or the path's end is out of reach */
    const double *at, *forward, *backward, *off, *ratio, *q, *slopes;
    const double *curve_at, *places, *pose, *cubics;
    int piece, part; /* of plan and curve, about where the tool is: searches begin there */
} Course;

/* path_state.py. Numbers alone, as in a Loop; the tangent is NaN before the first tick. */
typedef struct {
    double place, speed, acceleration, back, ticks, tangent[6];
    Row along, velocity;
} Travel;
#define STATE ((int)(offsetof(Travel, along) / sizeof(double)))

/* What rules a tick where no knot of the plan does: path_compiled.py, from the last on. */
typedef enum {
    THE_RATE = -1,
    THE_OVERRIDE = -2,
    OFF_ITS_PATH = -3,
    SETTLING = -4,
    ENDED = -5,
    THE_START = -6,
    THE_PAUSE = -7,
    THE_TURN = -8
} Ruling;
typedef enum { MOVING, SLOWED, PAUSED, AT_END } PathStatus;

/* path_driver.py: what is asked of a tick */
typedef struct {
    double override;
    bool paused, back;
} Order;

/* path_solution.py: the answer, and the state after it */
typedef struct {
    Solution answer;
    Travel after;
    double place, speed, across;
    int ruling; /* a Ruling, or a knot of the plan */
    PathStatus status;
} Progress;

/* course.c */
int piece_of(int n, const double *knots, double at);
int piece_at(const Course *course, double at);
int nearest(const Course *course, double at);
void curve_pose(const Course *course, double at, Pose *T);
void curve_tangent(const Course *course, double at, double tangent[6]);
double caller_place(const Course *course, double at);
void joints_at(const Course *course, double at, Row q);
void slope_at(const Course *course, double at, Row slope);
double speed_at(const Course *course, double at, double dt, double share, bool back);
double speed_limit_at(const Course *course, double at, bool back, int *piece);

/* asked.c */
Outcome asked(const Loop *loop, const Pose *tool, const Pose *target, const double p[3], const double root[6][6],
              Demand *demand, double V[6][6], int *rows);
void measured_rows(int rows, const double V[6][6], const double root[6][6], double R[6][6]);
void asked_part(int rows, const double V[6][6], const double p[3], const double root[6][6], double length,
                const double x[6], double part[6]);
void own_way(const Demand *demand, const double V[6][6], const double p[3], double length, double error[6]);

/* pace.c */
Outcome paced(const Course *course, double dt, const Travel *state, double at, double near, double override, bool stop,
              double *speed, double *most_now, int *ruling);
double possible_rate(const Loop *loop, const Course *course, const Travel *state, double at, double wanted,
                     double possible);

/* ramp.c */
Outcome ramped(const Course *course, const Travel *state, double at, double wanted, double share, double dt, double *a);

/* path.c */
Outcome drive(const Loop *loop, const Course *course, const Travel *before, const double *q, const Row there, const Order *order,
              Progress *progress);

#define OFF_PATH 1e-5
#define ASIDE 1e-7
#define TICK_SHARE 0.985
#define EASY_SHARE 0.9
#define FULL_SHARE 0.9995
#define RESTING 1e-3
#define SAME_RATE 1e-4
#define PASSES 8
#define AWAY 5e-3
#define AWAY_STOP 4.0
#define JOINT_GAIN 5.0
#define SINGULAR 1e-2
#define REGULAR 3e-2
#define STRAYED 1e-2
#define STANDING 1e-7
#define MISSED 1e-6
#define HELD 0.9
#define ARRIVED 1e-6
#define STOPPED 2e-5
#define SLOW_JOINT 1e-3
#define DISPLACED 0.2
#define SMOOTH_SHARE 0.95
#define SLOWEST_SHARE 0.7
#define CANDIDATES 9
#define SAMPLES 24
#define ROUNDING 1e-9

#endif
