/* What the files of a controller's loop share. */

#ifndef LOOP_H
#define LOOP_H

#include "core.h"

/* control/memory.py: what a loop keeps from tick to tick: the turn of the error (3,) and positions (m,), NaN before the first,
   the last commands (k, m), the latest first, and the states of the joints. */
#define KEPT 3 /* before the positions */

/* control/memory.py, JointStates: the rows (m,) of a Response and of a MotionRatio, and the other numbers of that */
enum { SILENT_ROW, UNANSWERED_ROW, UNRESPONSIVE_ROW, SCATTER_ROW, REST_ROW, COMMANDED_ROW, MOVED_ROW, PENDING_ROW, STATE_ROWS };
enum { RATIO_COMMANDED, RATIO_PRODUCT, RATIO_MOVED, UPDATES, RATIO_TIME, LARGEST, WAITING, INTERVAL, INTERVAL_BEFORE, FINEST, RATIO_NUMBERS };
#define MOST_JOINT_STATES (STATE_ROWS * MOST + RATIO_NUMBERS)

/* What a tick leads to; how far each joint is outside its range, and its acceleration where it is above its limit, where
   these are to be told, or 0. */
typedef struct {
    Solution solution;
    Row outside, acceleration;
    double turn[KEPT], states[MOST_JOINT_STATES]; /* for the next tick */
    bool chased;
} Tick;

/* control/motion_ratio.py: what is wrong with the joints, if anything: the code of a reason, its joint, or its numbers */
typedef struct {
    int code, joint;
    double numbers[3];
} JointTrouble;

#define AGAIN 4 /* control/controller.py */
/* control/controller.py, follow: joint twists and tool pose as the arm was seen, the point to measure at, a posture, each of
   which may be NULL, more exact rows, parts D of the twist, and whether that is a screw in base coordinates. */
typedef struct {
    const Row *J;
    const Pose *tool;
    const double *at, *posture;
    int rows;
    const double (*D)[6];
    bool at_base;
} Beside;

/* control/tracking.py: how fast a loop with acceleration limits approaches its target: the share of the gain, joint velocities
   from which joints brake before the error is least */
typedef struct {
    double share;
    Row lower, upper;
} Braking;

/* braking.c, demands.c, loop.c */
Outcome rows_of(const Wanted *exact, int count, double gain, const Pose *tool, const Pose *target,
                const double *feedforward, Demand *demand);
bool braking_box(const Loop *loop, const double *q, const double *before, const double *speeds, Demand *demand, Tick *tick);
double braking_speed(double room, double acceleration, double dt, double rate);
double late_braking(double room, double before, double dt);
Outcome approach(const Loop *loop, double gain, const Demand *demand, const Row A[6], const double error[6],
                 const double feedforward[6], const double *before, Braking *found);
void braked(const Braking *braking, Demand *demand);
int commands_of(const Loop *loop);
int states_of(int joints);
void joint_states(const Loop *loop, const double *q, const double *kept, double *states);
void predicted(const Loop *loop, const double *kept, const double *states, const double *q, Row there, Row before);
double displacement(const Loop *loop, int j, double start, double end);
bool any_unresponsive(const double *states, int joints);
void update_states(const Loop *loop, const double *commanded, const double *moved, double *states);
JointTrouble joint_trouble(int joints, double dt, double gain, double fastest_gain, bool chases, const double *states);
void remembered(const Loop *loop, const double *q, const Tick *tick, double *kept);
Outcome step_beside(const Loop *loop, const Now *now, const Beside *beside, const double *q, const Pose *target,
                    const double *feedforward, const double *before, const double *kept, Tick *tick);
double outside_by(const Loop *loop, const double *q, int j);
bool is_far(const Loop *loop, const double *q, const Pose *target);

#define WHOLE_TICKS 1e-9
#define MOST_LATE 10000
#define KEPT_SHARE 0.2
#define FEWEST_UPDATES 50
#define PROPORTIONAL 0.95
#define OSCILLATES 0.15
#define LARGE_OSCILLATION 0.03
#define LONGEST_INTERVAL 0.5
#define LEAST_MOVED 8e-3
#define MOST_COUNTS 4.0
#define MANY_MOVED 12
#define MOST_RATIO 2.0
#define LEAST_RATIO 0.5
#define OVERSHOOT 1.2
#define RESPONSE_MEMORY 0.05
#define RESPONSE_TIME 0.125
#define RESPONSE_SHARE 0.19
#define LEAST_COMMANDED 0.005
#define FULL_SPEED 3.1
#define COMMANDED_REST 1e-6
#define SCATTER 30.0
#define EXPLAINED 0.5
#define LEAST_SPEED 0.015
#define LEAST_OSCILLATION 0.02
#define OUTSIDE 1e-3
#define BOUNDLESS 1e30
#define BRAKING_SHARE 0.5
#define SLACK_GAIN 10.0

#endif
