/* Twin of robots/chain.py and geometry/se3.py: tool pose and joint twists from joint screws, and the error twist.

       T(q) = exp(q_1 S_1) ... exp(q_m S_m) home,     J_i = Ad(exp(q_1 S_1) ... exp(q_i-1 S_i-1)) S_i */

#include "core.h"

/* Below this angle [rad] series are exact to rounding, and closed coefficients are not. */
#define SMALL_ANGLE 1e-2
/* From here on [rad], rounding of a pose may turn the axis round. */
static const double UNDECIDED_TURN = PI - 1e-9;

void cross(const double a[3], const double b[3], double c[3])
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

/* R b */
void turned(const Pose *T, const double b[3], double c[3])
{
    for (int i = 0; i < 3; i++)
        c[i] = dot(3, T->R[i], b);
}

/* C may be A. */
void product(const Pose *A, const Pose *B, Pose *C)
{
    for (int i = 0; i < 3; i++) {
        double x = A->R[i][0], y = A->R[i][1], z = A->R[i][2];
        for (int j = 0; j < 3; j++)
            C->R[i][j] = x * B->R[0][j] + y * B->R[1][j] + z * B->R[2][j];
        C->p[i] = x * B->p[0] + y * B->p[1] + z * B->p[2] + A->p[i];
    }
}

/* I + a [w]x + b [w]x^2 applied to x. */
static void series(const double w[3], double a, double b, const double x[3], double y[3])
{
    double wx[3], wwx[3];
    cross(w, x, wx);
    cross(w, wx, wwx);
    for (int i = 0; i < 3; i++)
        y[i] = x[i] + a * wx[i] + b * wwx[i];
}

/* exp(q S) = 1 + t U + (1 - cos t) U^2 + (t - sin t) U^3,   U = S / |omega|,   t = |omega| q;  1 + q S for a slide */
void exponential(const double w[3], const double v[3], double q, Pose *T)
{
    double rate = norm(3, w), share = rate > 0.0 ? 1.0 / rate : 1.0, t = rate * q;
    double n[3] = {share * w[0], share * w[1], share * w[2]}, u[3] = {share * v[0], share * v[1], share * v[2]}, around[3];
    double half = sin(0.5 * t), sine = 2.0 * half * cos(0.5 * t), versine = 2.0 * half * half;
    double along = (t - sine) * dot(3, n, u), straight = rate > 0.0 ? sine : q;
    cross(n, u, around);
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        T->R[i][i] = 1.0 - versine * (n[j] * n[j] + n[k] * n[k]);
        T->R[i][j] = versine * n[i] * n[j] - sine * n[k];
        T->R[i][k] = versine * n[i] * n[k] + sine * n[j];
        T->p[i] = straight * u[i] + versine * around[i] + along * n[i];
    }
}

/* A pose from its (4, 4) matrix, row by row. */
void pose_from(const double *H, Pose *T)
{
    for (int i = 0; i < 3; i++) {
        memcpy(T->R[i], H + 4 * i, 3 * sizeof(double));
        T->p[i] = H[4 * i + 3];
    }
}

/* Where a point of the tool is in the base frame. */
void place(const Pose *T, const double point[3], double p[3])
{
    for (int i = 0; i < 3; i++)
        p[i] = dot(3, T->R[i], point) + T->p[i];
}

void kinematics(int m, const Row screws[6], const Pose *home, const double *q, Row J[6], Pose *tool)
{
    Pose T = {{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}, {0.0, 0.0, 0.0}}, step;
    for (int k = 0; k < m; k++) {
        double w[3] = {screws[0][k], screws[1][k], screws[2][k]}, v[3] = {screws[3][k], screws[4][k], screws[5][k]};
        double omega[3], moved[3], lever[3];
        turned(&T, w, omega);
        turned(&T, v, moved);
        cross(T.p, omega, lever);
        for (int i = 0; i < 3; i++) {
            J[i][k] = omega[i];
            J[3 + i][k] = moved[i] + lever[i];
        }
        exponential(w, v, q[k], &step);
        product(&T, &step, &T);
    }
    product(&T, home, tool);
}

/* R R' */
static void turned_by(const Pose *target, const Pose *tool, double R[3][3])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            R[i][j] = dot(3, target->R[i], tool->R[j]);
}

/* The axis of a rotation times its angle in [0, pi], by the unit quaternion (Shepperd's method). */
static void rotation_vector(const double R[3][3], double w[3])
{
    double diagonal[4] = {R[0][0], R[1][1], R[2][2], R[0][0] + R[1][1] + R[2][2]}, q[4];
    int largest = 3;
    for (int i = 2; i >= 0; i--)
        if (diagonal[i] > diagonal[largest])
            largest = i;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        double odd = R[k][j] - R[j][k];
        if (largest == 3)
            q[i] = odd;
        else if (largest == i) {
            q[i] = 1.0 + R[i][i] - R[j][j] - R[k][k];
            q[3] = odd;
        } else
            q[i] = R[i][largest] + R[largest][i];
    }
    if (largest == 3)
        q[3] = 1.0 + diagonal[3];
    double n = norm(3, q), share = n > 0.0 ? copysign(2.0 * atan2(n, fabs(q[3])) / n, q[3]) : 0.0;
    for (int i = 0; i < 3; i++)
        w[i] = share * q[i];
}

/* How far R R' is from the identity at most, R R' - 1; and whether R is no mirror image, whose R R' is the identity, too. */
static double off_rotation(const Pose *T, double off[3][3], bool *turns)
{
    double worst = 0.0, third[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            off[i][j] = dot(3, T->R[i], T->R[j]) - (i == j);
            worst = fmax(worst, fabs(off[i][j]));
        }
    cross(T->R[0], T->R[1], third);
    *turns = dot(3, third, T->R[2]) > 0.0;
    return worst;
}

/* geometry/arrays.py, with_rotation: the nearest rotation in place of one to few digits, in steps of Newton. */
void with_rotation(Pose *T)
{
    double off[3][3], R[3][3];
    bool turns;
    for (int step = 0; step < 2; step++) {
        double worst = off_rotation(T, off, &turns);
        if (worst <= ROTATION || worst > ROTATION_TOLERANCE)
            return;
        memcpy(R, T->R, sizeof R);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                T->R[i][j] -= 0.5 * (off[i][0] * R[0][j] + off[i][1] * R[1][j] + off[i][2] * R[2][j]);
    }
}

/* The twist that takes the tool to its target in unit time; of half a turn rounding would choose the direction. */
Outcome error_twist(const Pose *target, const Pose *tool, double error[6])
{
    double R[3][3], p[3];
    bool turns;
    if (!(off_rotation(target, R, &turns) <= ROTATION && turns))
        return HAND_BACK;
    turned_by(target, tool, R);
    rotation_vector((const double(*)[3])R, error);
    double theta = norm(3, error), t2 = theta * theta;
    if (!(theta < UNDECIDED_TURN))
        return HAND_BACK;
    double c = theta < SMALL_ANGLE ? (1.0 + t2 / 60.0 * (1.0 + t2 / 42.0)) / 12.0
                                   : (1.0 - 0.5 * theta / tan(0.5 * theta)) / t2;
    for (int i = 0; i < 3; i++)
        p[i] = target->p[i] - dot(3, R[i], tool->p);
    series(error, -0.5, c, p, error + 3);
    return DONE;
}
