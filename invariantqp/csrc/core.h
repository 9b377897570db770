/* The compiled tick: the law of invariantqp/legacy in C, for what a control loop does in every tick.

   Each file is the twin of one or two Python files, with the same names in the same order; Python is the definition.
   A function returns HAND_BACK where it does not cover a tick, or where a decision is so close that rounding would make
   it: Python then answers. Nothing is allocated, every loop is counted, and no function keeps state. */

#ifndef CORE_H
#define CORE_H

#include "fields.h"
#include <math.h>
#include <stddef.h>
#include <string.h>

/* Limits of joints and rows, and one of a share. */
#define LIMITS (MOST + MOST_LIMITS + 1)

typedef enum { DONE, HAND_BACK } Outcome;

/* velocity/limits.py: |start + J x| <= limit; a limit of 0 is none */
typedef struct {
    double limit, start[3];
    Row J[3];
} Cone;

/* quadratic.c: |start + M e| <= limit, the largest multiplier tried, and the directions that M moves on the last face */
typedef struct {
    double limit, most, start[3];
    Row M[3], V[3];
    double gains[4];
    int rank;
} Slow;

/* legacy/qp.py: lower <= A z <= upper, A the identity for a box; joints first, then rows. A value may be outside by
   `rounding` of what exact rows fix of it. */
typedef struct {
    int count;
    bool box;
    Row A[LIMITS];
    double lower[LIMITS], upper[LIMITS], rounding[LIMITS];
} Polytope;

/* law.py: which part of a twist closes an error, and what may be slowed down for it. */
typedef struct {
    double ahead[6], rows_ahead[MOST_ROWS], slack;
    Row lower, upper;
    bool apart;
} Chase;

/* law.py: the input of a tick. */
typedef struct {
    int m;
    Row J[6];
    double s[6];
    bool has_root, has_point;
    double root[6][6];
    double point[3], length; /* where no root is given: a length of 0 is the reach, no point the arm's own */
    Row lower, upper;
    Row posture; /* zero where there is none */
    bool has_posture, paced;
    Row fastest; /* where the posture is paced: it rests while the task rests */
    bool has_before; /* likewise: from joint velocities of the tick before it sets in by and by, by `change` in each */
    Row before, change;
    bool chased;
    Chase chase;
    double dt, held; /* how long the velocity is held, and how much longer */
    /* exact.py: C x = e, C = D J where D is not zero; row_rank is -1 for all */
    int rows, row_rank;
    bool of_twist;
    Row C[MOST_ROWS];
    double e[MOST_ROWS], D[MOST_ROWS][6];
    Cone cone;
    /* velocity/limits.py: least <= G x <= most */
    int limits;
    Row G[MOST_LIMITS];
    double least[MOST_LIMITS], most[MOST_LIMITS];
    const Law *metric;    /* with T and its inverse; NULL is the identity */
    const Law *form;      /* NULL is least squares */
    bool has_brought;
    double brought[6][6]; /* of a form that is brought, on measured twists */
    /* damping.py: lambda_i = ceiling sigma_max (1 - (r_i / threshold)^2) + fixed, or more where a direction contributes
       more than `speed`, if that is not zero */
    double threshold, ceiling, fixed, speed;
} Demand;

/* regular.c: A = L V and X = L^-1 where nothing is damped; A is NULL of another L */
typedef struct {
    bool holds;
    double largest; /* eigenvalue of AA', 0 where it was not needed yet */
    const Row *A;
    Row L[6], X[6], V[6];
} Regular;

/* objective.py: 1/2 |K (z - z*)|^2, K = diag(sqrt(weights)) V' */
typedef struct {
    int n, rank;
    const Row *V; /* V[i] is direction i, of the spectrum */
    Row weights, optimum, still; /* still: the optimum without the chase */
    double damping, ratio;
    const Regular *regular; /* or NULL: K = L V and T = V'X in the first six directions */
    Regular calmer;
} Objective;

/* spectrum.c: A = U diag(sigma) V', wanted = U'b; U[i] is direction i, where it is asked for.
   regular.c: A = L V, wanted = X b, and no sigma but the largest. V has zeros after the n numbers of a row, for steps. */
typedef struct {
    Row V[MOST];
    Row sigma, wanted, ahead; /* U'b, and U' of what is not chased */
    double largest; /* singular value that all are compared with */
    double U[6][6];
    const Regular *regular; /* or NULL */
} Spectrum;

/* Rows are worked on in steps of STEP numbers, those after the last one zero. */
#define STEP 4
/* spectrum.c: a row and what is rotated with it: entries of b, a direction of joint space, or another row. */
typedef struct {
    Row row;
    double with[MOST + STEP];
} Rotated;

/* legacy/qp.py: 1/2 |e|^2 = 1/2 |K (z - centre)|^2 at z = centre + T e; T[i] is column i. All have zeros after their n
   numbers, for steps. */
typedef struct {
    int n;
    Row K[MOST], T[MOST], centre;
} Quadratic;

/* quadratic.c: the e with N_a e = b_a; at[i] is a limit, N_a' = Q R by orthonormal rows Q[i] and columns R[i], over[i] is
   1 / R[i][i], least and most are those of R[0][0] to R[i][i]; the shortest e is Q'w. */
typedef struct {
    int k, at[MOST];
    Row Q[MOST], R[MOST], over, least, most, w, e;
} Face;

/* quadratic.c: rows A T of limits, each divided by its length, and the face that the last optimum was on; `rows` is 0 where
   they are not made yet */
typedef struct {
    int rows;
    Row N[LIMITS];
    double length[LIMITS];
    Face face;
} Turned;

/* legacy/qp.py: the minimiser and its multipliers, zero where a limit is not active */
typedef struct {
    Row z;
    double multipliers[LIMITS];
    double nu; /* of the speed limit */
    bool met;  /* whether a limit is active */
} Optimum;

/* exact.py: y = share full + start + B z; basis[i] is column i of B */
typedef struct {
    int n;
    Row full, start, basis[MOST];
    double effort, bend, unmet, beyond; /* shares of the demand that no velocity can meet here, and anywhere */
} Reduction;

/* exact.py: the share of the rows' speed, a velocity inside the limits with it, and those that hold it but for the weakest
   of several */
typedef struct {
    double value;
    Row inside;
    Optimum near;
} Share;

/* reasons.py: the codes of what the core has to say, and indices of what is no row of LimitRows */
typedef enum {
    WHY_NO_MOTION = 14,
    WHY_STATES_ARE_OLD,
    WHY_DT_IS_WRONG,
    WHY_NOT_FOLLOWING,
    WHY_OUTSIDE,
    WHY_ACCELERATION,
    WHY_ROWS_CONTRADICT,
    WHY_TOOL_FASTER,
    WHY_ROWS_UNKEPT = 23,
    WHY_ROWS_TOO_MANY,
    WHY_STUCK = 27,
    WHY_ROWS_SLOWED,
    WHY_ROWS_MOVED,
    WHY_CHASE_SLOWED,
    WHY_GUARDED,
    WHY_DAMPED,
    WHY_CALMED,
    WHY_FEW_JOINTS,
    WHY_POSITION_ALONE,
    WHY_MISSED,
    WHY_MOVED,
    WHY_AT_LIMITS
} Code;
#define TOOL_SPEED_ROW (-1)
#define FIRST_EXACT_ROW (-2)

/* legacy/tick.py: how limits that contradict each other give way: rows by how much, above them positive, and at length
   one by what share, to the bounds of which joints; and the tool's speed to which other one, 0 for none */
typedef struct {
    int rows;
    double by[MOST_LIMITS], share[MOST_LIMITS], speed, limit;
    bool to[MOST];
} Yielded;

/* solution.py */
typedef enum { CLOSED_FORM, DAMPED, QP } Method;
typedef struct {
    int m, limits;
    Row velocity;
    double residual[6];
    Method method;
    bool active[MOST];
    bool stuck, limited, slow, met, at_speed, position_alone;
    unsigned char at_limit[LIMITS]; /* limits that are met: 0 for none, rows by rank */
    double scale, pace, damping, blended, ratio, missed, achievable; /* for the reason */
    int rows, row_rank;
    double unmet, beyond; /* of exact rows, 0 where they are met but for rounding */
    double multipliers[LIMITS]; /* of joints, then of rows; what follows is of rows alone */
    Yielded yielded;
    double beside[MOST_ROWS]; /* how far limits move each exact row besides, of `rows` of them, 0 where it is not told */
} Solution;

/* conflicts.c: 1/2 |R z - d|^2, R triangular: a sum of squares whose terms are rotated in one by one */
typedef struct {
    int n;
    Row R[MOST], d;
} Squares;

/* systems/projectors.py: a k-system of freedoms, and 6 - k twists and wrenches beside it */
typedef struct {
    int k;
    double motion[6][6], force[6][6], freedoms[6][6], complement[6][6], constraints[6][6], norm, unit;
} Projectors;

/* A rigid motion. */
typedef struct {
    double R[3][3], p[3];
} Pose;

/* Two numbers that are worked on at once, by compilers that have such a type. */
#if defined(__GNUC__)
typedef double Two __attribute__((vector_size(16)));
static inline Two of_two(const double *p, const double *q)
{
    Two a, b;
    memcpy(&a, p, sizeof a);
    memcpy(&b, q, sizeof b);
    return a * b;
}
#endif

/* Two sums, which do not wait for each other. */
static inline double dot(int n, const double *a, const double *b)
{
    int i = 0;
#if defined(__GNUC__)
    Two sums = {0.0, 0.0};
    for (; i + 1 < n; i += 2)
        sums += of_two(a + i, b + i);
#else
    double sums[2] = {0.0};
    for (; i + 1 < n; i += 2) {
        sums[0] += a[i] * b[i];
        sums[1] += a[i + 1] * b[i + 1];
    }
#endif
    return i < n ? sums[0] + a[i] * b[i] + sums[1] : sums[0] + sums[1];
}

/* In two halves, for which compilers write a few stores; of a whole row they make a loop that is slower. */
static inline void zeroed(Row row)
{
    memset(row, 0, sizeof(Row) / 2);
    memset(row + MOST / 2, 0, sizeof(Row) / 2);
}

/* Rows whose numbers after the last one are zero, in steps of STEP; two of them, which are usual, in one line. */
static inline double dot_in_steps(int n, const double *p, const double *q)
{
#if defined(__GNUC__)
    if (n > STEP && n <= 2 * STEP) {
        Two both = (of_two(p, q) + of_two(p + 4, q + 4)) + (of_two(p + 2, q + 2) + of_two(p + 6, q + 6));
        return both[0] + both[1];
    }
#endif
    double sums[STEP] = {0.0};
    for (; n > 0; n -= STEP, p += STEP, q += STEP)
        for (int j = 0; j < STEP; j++)
            sums[j] += p[j] * q[j];
    return (sums[0] + sums[2]) + (sums[1] + sums[3]);
}

/* y += a x, likewise. */
static inline void add_in_steps(int n, double a, const double *restrict x, double *restrict y)
{
    if (n > STEP && n <= 2 * STEP) {
        for (int j = 0; j < 2 * STEP; j++)
            y[j] += a * x[j];
        return;
    }
    for (; n > 0; n -= STEP, x += STEP, y += STEP)
        for (int j = 0; j < STEP; j++)
            y[j] += a * x[j];
}

/* A row becomes a times as long. */
static inline void scaled(int n, double a, Row row)
{
    for (int j = 0; j < 2 * STEP; j++)
        row[j] *= a;
    for (int j = 2 * STEP; j < n; j++)
        row[j] *= a;
}

static inline double norm(int n, const double *a) { return sqrt(dot(n, a, a)); }

/* The number nearest x that is not below `low` and, before all, not above `high`. */
static inline double between(double x, double low, double high)
{
    x = x > low ? x : low;
    return x < high ? x : high;
}

/* dense.c */
double norm_of_rows(int rows, int n, const Row *A);
bool all_finite(int n, const double *a);
bool usual(int n, const double *a);
bool usual_rows(int rows, int n, const Row *A);
void transformed(int m, const Row *M, const Row x, Row y);
void combined(int n, int rows, const double *a, int step, const Row *A, Row sum);
double left_of(int n, int k, const Row *Q, Row row, Row parts);
void product_of_rows(int rows, const double (*D)[6], int m, const Row J[6], Row *C);
void product_with(int rows, int m, Row *A, const Row *T);
bool factored(int n, Row *H);
void forward(int n, const Row *L, double *x);
void backward(int n, const Row *L, double *x);
void solved(int n, const Row *L, const double *g, double *x);
void inverse_triangle(int n, const Row *L, Row *X);
#define WIDE (6 + MOST_ROWS)
double eliminated(int n, int k, double (*AB)[WIDE]);

/* chain.c */
void pose_from(const double *H, Pose *T);
void place(const Pose *T, const double point[3], double p[3]);
void turned(const Pose *T, const double b[3], double c[3]);
void cross(const double a[3], const double b[3], double c[3]);
void product(const Pose *A, const Pose *B, Pose *C);
void exponential(const double w[3], const double v[3], double q, Pose *T);

/* pseudoinverse.c, projectors.c */
double own_unit(int m, const Row J[6]);
Outcome projectors(int m, const Row columns[6], bool wrenches, double h, int n, const Row given[6], Projectors *found);

/* measure.c */
void root_at(const double p[3], double length, double root[6][6]);
Outcome measured(Demand *demand);
bool is_sliding(int m, const Row J[6], const double point[3], double length);

/* the files by the names of their functions */
Outcome spectrum(int k, int n, const Row *A, const double *b, const double *ahead, Spectrum *found);
Outcome sorted_rows(int rows, int n, int with, Rotated *R, double *sigma);
void completed(int n, int rank, Row *V);
void want(Spectrum *found, const double b[6], const double *ahead);
double led_share(const Demand *demand, const Spectrum *found, int i);
double damped_square(const Demand *demand, double sigma, double wanted, double largest);
Outcome least_squares(const Demand *demand, int n, const Spectrum *found, const Row posture, bool chased,
                      Objective *objective);
Outcome attempted(const Demand *demand, int n, Spectrum *found, const double b[6], double attempt[6]);
Outcome blend(int n, const Row A[6], const double b[6], double mu, const Row x_f, const Row x_W, double fraction, double *t);
void centre(const Objective *objective, Row z);
void quadratic(const Objective *objective, Quadratic *problem);
double speed(const Objective *objective, const Row z);
void calmed(Objective *objective, double mu);
bool is_regular(const Demand *demand, const Row A[6], Regular *regular);
bool regular_velocity(const Demand *demand, const Regular *regular, const Row A[6], const double b[6], Row x);
void regular_spectrum(int n, const Regular *regular, const Row A[6], const double b[6], const double *ahead, Spectrum *found);
double calm(int n, const Row A[6], const double wanted[6], const Row y, const Row slowed, double speed, double dt,
            double factor);
double worth(const Demand *demand, const Row A[6], const double wanted[6]);
double excess_deviation(int n, const Row A[6], const double wanted[6], double speed, double dt);
Outcome minimise(const Quadratic *problem, const Polytope *limits, const Cone *cone, const Row inside, const Optimum *near,
                 Optimum *found);
Outcome minimise_turned(const Quadratic *problem, const Polytope *limits, const Cone *cone, const Row inside, const Optimum *near,
                        Turned *turned, Optimum *found);
bool inside_limits(const Polytope *limits, int n, const Row z);
double tool_speed(const Cone *cone, int n, const Row x);
void cone_on(const Cone *cone, int m, const Row origin, int n, const Row *basis, Cone *result);
void polytope_on(const Polytope *limits, int m, const Row origin, const Row inside, int n, const Row *basis, Polytope *result);
bool allows(const Demand *demand, const Row x);
bool is_met(int n, const Row A[6], const double b[6], const Row x, double tolerance);
Outcome reported(const Demand *demand, const Row A[6], const double wanted[6], const double *possible,
                 const Objective *objective, const Row y, const Share *share, double pace, const Optimum *found,
                 double blended, Solution *solution);
Outcome clipped(const Demand *demand, const Row y, Solution *solution);
void at_limits(const Demand *demand, Solution *solution);
double steady_share(const Demand *demand, const double wanted[6], const double ahead[6]);
double posture_share(const Demand *demand, const Row x);
double slower(const Demand *demand, const Row x);
Outcome over_root(int k, const double (*D)[6], const double root[6][6], double (*M)[6]);
Outcome reduce(const Demand *demand, const Row *C, Reduction *reduction);
void origin(const Reduction *reduction, int m, double share, Row y);
void joint(const Reduction *reduction, int m, const double *z, double share, Row y);
void freed(const Reduction *reduction, int m, const Row y, double share, Row z);
Outcome nearest_to_demand(Reduction *reduction, int m, const Polytope *limits, const Cone *cone, Share *share, Optimum *found);
Outcome fixed_beside(Reduction *reduction, int m, Polytope *limits, Polytope *placed, Cone *cone, const Share *share,
                     const Optimum *found);
double excess_turn(const Reduction *reduction, int m, double held, double share);
Outcome share_of(const Reduction *reduction, int m, const Polytope *limits, const Cone *cone, double dt, double held, Share *share);
void governed(const Law *law, Demand *demand);
Outcome answered(const Demand *demand, const Regular *regular, const Row A[6], const double wanted[6], Solution *solution);
void begun(int n, double weight, const double *centre, Squares *sum);
void add_square(Squares *sum, const Row a, double b);
void solved_by(const Squares *sum, Quadratic *problem);
Outcome relaxed(int m, int k, Polytope *limits, Polytope *placed, Row y, Yielded *yielded);
Outcome slowed_point(int m, const Polytope *limits, Cone *cone, Row y, Yielded *yielded);
Outcome solve(const Demand *demand, Solution *solution);
Outcome solve_measured(const Demand *demand, const Row A[6], Solution *solution);
void kinematics(int m, const Row screws[6], const Pose *home, const double *q, Row J[6], Pose *tool);
Outcome error_twist(const Pose *target, const Pose *tool, double error[6]);
void with_rotation(Pose *T);
#define ROTATION 1e-12
#define ROTATION_TOLERANCE 1e-5
Outcome minimise_from(const Quadratic *problem, const Polytope *limits, const Row inside, Row z);

/* The constants of the twins, by the names of their Python files; a test compares the two. */
typedef struct {
    const char *name;
    double value;
} Constant;
extern const Constant CONSTANTS[];

#define ACCURATE_SHARE 1e-2
#define FORM_THRESHOLD 0.3
#define UNSEEN 1e-7
#define UNTOUCHED 1e-11
#define NULL_RATIO 1e-12
#define NULL_WEIGHT 1e-8
#define EASY 3.0
#define CALM 0.25
#define DEVIATION_SHARE 0.25
#define QP_ROUNDING 1e-9
#define TINY 2.2250738585072014e-308
#define DEPENDENT 1e-12
#define STEPS 10
#define ACTIVE_TOLERANCE 1e-6
#define SLOWEST 1e-6
#define EPSILON 2.220446049250313e-16
#define PRODUCT_ROUNDING 1e-13
#define MISSED_SHARE 0.05
#define FALLING 0.5
#define ENOUGH_ACHIEVED 0.95
#define SPREAD 1e-6
#define GROWING 0.01
#define POSTURE_PACE 0.01
#define PACE_ROUNDING 1e-14
#define PROGRESS_SHARE 2e-4
#define LEAST_WORTH 2e-5
#define WHOLE_SPEED (1.0 - ACTIVE_TOLERANCE)
#define REGULARISATION 1e-9
#define WIDENING 1e-7
#define FASTER 1e-4
#define EXACT_CALM 1.0
#define FAR_SHARE 1e-3
#define WHOLE (1.0 - 1e-8)
#define INTERIOR (0.5 * ACTIVE_TOLERANCE)
#define ROW_ROUNDING 1e-14
#define NEWTON_STEPS 100
#define MOST_SHARE 1e8
#define SMALLEST_SIZE 1e-30
#define LARGEST_SIZE 1e30
#define LENGTH_LIMIT 1000000000000.0
#define WELL_POSED 0.0001 /* det A over its trace cubed: above this the adjugate loses less than four digits */
#define CENTRE_ROUNDING 1e-12
#define TERMS 1e-5
#define PI 3.14159265358979323846
#define HALF_TURN (0.8 * PI)

#endif
