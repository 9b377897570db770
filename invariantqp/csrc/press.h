/* What the files of a hybrid tick share: what a press keeps from tick to tick, and what its stages tell each other.

   All that is kept is doubles, in the order of the fields of Python's values (force/compiled.py makes one of the other):
   a bool is 0 or 1, None is NaN, and what there are several of is a count and room for the most. */

#ifndef PRESS_H
#define PRESS_H

#include "loop.h"

/* Constraints of a contact. */
#define MOST_PARTS 6

/* estimate.py */
typedef struct {
    double evidence, touching, airborne;
} Touch;

typedef struct {
    double found[3], errors[3], bound, way, force, mean[4], means[4], gone, seen[3][3], sums[3], residual;
    double rose, begins, time, quiet, stiff, reached, lacked, lasted;
} Stiffness;

typedef struct {
    double readings, change, found;
} Noise;

/* What estimate and law of a tick have in common. */
typedef struct {
    double dt, share, filter_time, late, noise, slope_speed, steep, begins, resolved;
    bool held;
} Setting;

/* law.py */
typedef struct {
    double speed, slope;
} Drive;

/* control.py: unit way that shows, and that does not yet. */
typedef struct {
    double shown, coming;
} Shown;

typedef struct {
    double touched;
    Touch touches[MOST_PARTS];
    double parts;
    Stiffness known[MOST_PARTS];
    double driven;
    Drive drives[MOST_PARTS];
    double went;
    Shown ways[MOST_PARTS];
    double lag, along, steep, eased, free;
} Pressing;

/* monitor.py */
typedef struct {
    double reading[6], unchanged, alive;
} Dead;

typedef struct {
    double pull;
} Pulls;

typedef struct {
    double waited, led[2], way;
} Approach;

typedef struct {
    double began[2], sums[3][3], noise;
} Evidence;

typedef struct {
    double depth, force, most, highest, across[3], led, fell, beyond;
} Release;

typedef struct {
    double stiff, quiet, depth, since[2], across[3], grade[3], shown, silent;
    Evidence evidence;
    double touched, rested, rest[4], slid[3], off;
    Release release;
    double moves, read;
} Answers;

typedef struct {
    double press, missed, turns, rises, extreme, wanted, swung, since, often;
} Settling;

typedef struct {
    double overload[2];
    Dead dead;
    Pulls pulls;
    Approach approach;
    double asked;
    Answers answers[MOST_PARTS];
    Settling settling;
    double pushed, approached, left[2];
} Monitor;

/* What a tick tells the checks; a press of NaN is one that cannot be lost. */
typedef struct {
    double dt, reading[6], felt, wanted, together, force, moment, most[2], missing, noise, limit;
    Touch touch;
    double commanded, came, across[3];
} PressTick;

/* control.py: all that is kept. */
typedef struct {
    Pressing pressing;
    Monitor monitor;
    Noise noise;
    double tool[16], out[3], last[6], joints, coming[MOST], smooth[6], motion[6];
} Pressed;

/* A wrench or a twist of the contact's frame in the base frame, and back. */
void wrench_out(const Pose *frame, const double w[6], double out[6]);
void wrench_in(const Pose *frame, const double w[6], double in[6]);
void twist_out(const Pose *frame, const double t[6], double out[6]);
void twist_in(const Pose *frame, const double t[6], double in[6]);
void rows_times(int rows, const double (*A)[6], const double x[6], double *y);
void velocity_at(const double twist[6], const double p[3], double v[3]);

/* sensor.c */
void cleaned(const Press *press, const double reading[6], const Pose *tool, double smooth[6], double raw[6], double measured[6]);

/* contact.c */
void load_at(const double wrench[6], const double place[3], double load[2]);
void weakest(int n, const double (*parts)[6], const double felt[6], const double exert[6], double *here, double *wanted,
             double *together);
double place_speed(const double twist[6], const double place[3], double size);
bool can_yield(const Split *split, int joints);

/* estimate.c */
double weighed(double evidence, double press, double limit, double noise);
bool certain(double evidence);
void touch_begun(Touch *touch);
void touched(Touch *touch, double press, double limit, double noise, double dt);
bool touch_lasts(const Touch *touch, double lost_after);
Touch weakest_touch(int n, const Touch *touches);
double loss_limit(double lost_below, double wanted, double noise);
void unknown_stiffness(double begins, Stiffness *known);
bool is_known(const Stiffness *known);
void in_air(Stiffness *known, double force, double way, double limit, double evidence, const Setting *setting);
void known_after(Stiffness *known, double force, double way, const Setting *setting, int lacks, bool felt);
void noise_after(Noise *noise, const double reading[6], const double last[6], double supposed);

/* delay.c */
typedef struct {
    double *head, *echo;
    int rows;
} Delay;
bool lags(const Delay *delay);
double acts_later(const Delay *delay);
double arm_late(const Delay *delay, double declared);
double gain_of(const Delay *delay, double declared, double asked);
void delayed(const Delay *delay, const Loop *loop, const double *q, const double *command, const Row J[6], const double place[3],
             double size, const double *velocity, bool touching);

/* force_law.c */
void mass_and_damper(const Stiffness *known, const Setting *setting, double eased, double *M, double *D);
bool driven(const Press *press, const Split *split, const Pressing *now, const Monitor *monitor, const double *felt,
            const double *asked, const Setting *setting, double eased, double striking, bool lag_known, double most_force, bool slow,
            bool yields, Drive *drives);
Outcome trembling(const Loop *loop, const Row J[6], const double (*admittance)[6], const double place[3], double size,
                  double noise, double passed, double *share);
double surface_speed(const Press *press, double along, double moves);
double kept_of(double gain, double share);

/* monitor.c */
Outcome monitored(const Press *press, const PressTick *tick, int presses, const Stiffness *known, const double *felt,
                  const double *asked, double noise, double shared, Monitor *monitor);
double unseen(const Press *press, const Answers *check, double felt);
void after_motion(const Touch *touch, double out, Monitor *monitor);

/* force/contact.py */
#define SLOPE 0.1
#define SLOW_SHARE 0.1
/* force/estimate.py */
#define CERTAIN 13.815510557964274 /* log(1e6) */
#define LOST_SHARE 0.1
#define HALF 0.5
#define LEAST_NOISE 0.25
#define UNSHOWN 0.1
#define STIFF 2e5
#define STIFFER 3.0
#define LEAST_WAY 5.0
#define DAMPED_BY 0.01
#define SOFTEST 1e-3
#define RESOLVED 2e-5
#define ROUGH 2e-3
#define SURPRISE 5.0
#define SHORT 0.2
#define SOFTENS 20.0
#define SLOWER_PASS 10.0
#define SETTLES 0.1
#define FORGOTTEN 0.1
#define CURVED 3.0
#define NOISIER 1.5
#define FEWEST 20
#define AVERAGED_READINGS 200
#define LAGS 0.02
#define LONGEST_LAG 0.1
#define FOLLOWS 0.8
#define STILL 2e-3
#define ENOUGH 2.0
#define HEADER 9
#define STEP_SHARE 0.02
/* control/delay.py, control/tracking.py */
#define LEAST_OF_WAYS 0.5
#define MOST_OF_WAYS 1.2
#define UNEXPLAINED 0.1
#define PASSED 2
#define MORE_TICKS 10
#define ROUNDING_OF_WAYS 1e-12
#define DELAY_SHARE 0.25
/* force/law.py */
#define UNKNOWN_LATE 0.003
#define INTEGRAL 4.0
#define INTEGRATED 0.1
#define UNSURE 0.25
#define SURE 2.0
#define APPROACHED 0.5
#define OVERDAMPED 5.0
#define TAKES_UP 0.1
#define TREMBLES 1.5
#define MOST_TREMBLING 0.5
#define LOWERED 0.5
#define FREE_ACCELERATION 10.0
#define SINGULAR 1e-2
/* force/monitor.py */
#define OVERLOAD 2.5
#define GRADED_BY 10.0
#define NO_FORCE 20.0
#define ABOVE_NOISE 8.0
#define DEAD_AFTER 0.1
#define STALE_AFTER 0.012
#define LED 0.5
#define FOLLOWED 0.2
#define PRESSES 2.0
#define FELL_NOISE 6.0
#define CHI 4.0
#define SOFTER 0.5
#define SINCE 2.0
#define EXCUSED 0.5
#define TURNS 5
#define SWUNG 2.2
#define SWING 0.3
#define PATIENT_FOR 1.0
#define AVERAGED_FOR 0.2
/* force/contact_kinds.py */
#define SIX_DIGITS 1e-6
/* force/control.py */
#define QUICKER 2.0
#define MOVES_IN 0.3
#define MAY_BE_STEEP 0.1
#define TAKEN_BACK 0.5
#define EASES 0.5
#define LEAST_EASED 0.25

#endif
