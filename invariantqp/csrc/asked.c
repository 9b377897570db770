/* Twin of control/asked.py: what of a twist is asked of an arm: exact rows, or what its joints can do, or all of it.

       R = V root, V orthonormal rows in the measure; |R s| is the size of the part of a twist s that the arm is to do

   The way to a target is a screw, but for what exact demands ask of it: their own error. Rows that nearly depend on each
   other are handed back. */

#include "path.h"
#include <string.h>

/* Less than this share of a direction left over by the others: Python decides whether it is one of its own. */
static const double INDEPENDENT = 1e-5;

/* R of `rows` orthonormal rows, one more for a direction. */
static Outcome with_direction(const double direction[6], double R[6][6], int *rows)
{
    double rest[6], size = norm(6, direction);
    memcpy(rest, direction, sizeof rest);
    for (int again = 0; again < 2; again++)
        for (int i = 0; i < *rows; i++) {
            double along = dot(6, R[i], rest);
            for (int k = 0; k < 6; k++)
                rest[k] -= along * R[i][k];
        }
    double left = norm(6, rest);
    if (*rows == 6 || !(left > INDEPENDENT * size))
        return HAND_BACK;
    for (int k = 0; k < 6; k++)
        R[*rows][k] = rest[k] / left;
    ++*rows;
    return DONE;
}

/* x root^-1 for the root at p */
static void unmeasured(const double p[3], double length, const double x[6], double y[6])
{
    double turn[3];
    cross(x + 3, p, turn);
    for (int i = 0; i < 3; i++) {
        y[i] = (x[i] + turn[i]) / length;
        y[3 + i] = x[3 + i];
    }
}

/* root^-1 x for the root at p */
static void as_twist(const double p[3], double length, const double x[6], double twist[6])
{
    double lever[3];
    for (int k = 0; k < 3; k++)
        twist[k] = x[k] / length;
    cross(p, twist, lever);
    for (int k = 0; k < 3; k++)
        twist[3 + k] = x[3 + k] + lever[k];
}

/* asked.py: orthonormal rows V in the measure, for joint twists demand->J; the rows of what is asked are V root. What
   exact demands ask of the way to the target is left in `demand`. */
Outcome asked(const Loop *loop, const Pose *tool, const Pose *target, const double p[3], const double root[6][6],
              Demand *demand, double V[6][6], int *rows)
{
    int m = demand->m;
    *rows = 0;
    if (loop->wanted > 0.0) {
        if (rows_of(loop->exact, (int)loop->wanted, 1.0, tool, target, NULL, demand) == HAND_BACK)
            return HAND_BACK;
        for (int i = 0; i < demand->rows; i++) {
            double direction[6];
            unmeasured(p, loop->length, demand->D[i], direction);
            if (norm(6, direction) > 0.0 && with_direction(direction, V, rows) == HAND_BACK)
                return HAND_BACK;
        }
        return DONE;
    }
    for (int j = 0; m < 6 && j < m; j++) {
        double twist[6], direction[6];
        for (int k = 0; k < 6; k++)
            twist[k] = demand->J[k][j];
        for (int k = 0; k < 6; k++)
            direction[k] = dot(6, root[k], twist);
        if (with_direction(direction, V, rows) == HAND_BACK)
            return HAND_BACK;
    }
    for (int i = 0; m >= 6 && i < 6; i++)
        for (int k = 0; k < 6; k++)
            V[i][k] = i == k;
    *rows = m < 6 ? *rows : 6;
    return DONE;
}

/* V root; six rows ask for all of it, as the root does. */
void measured_rows(int rows, const double V[6][6], const double root[6][6], double R[6][6])
{
    if (rows == 6)
        memcpy(R, root, 6 * sizeof *R);
    for (int i = 0; i < rows && rows < 6; i++)
        for (int k = 0; k < 6; k++) {
            R[i][k] = 0.0;
            for (int l = 0; l < 6; l++)
                R[i][k] += V[i][l] * root[l][k];
        }
}

/* asked.py: root^-1 V' V root x, the part of a twist that is asked for. */
void asked_part(int rows, const double V[6][6], const double p[3], const double root[6][6], double length,
                const double x[6], double part[6])
{
    double measured[6], kept[6] = {0.0};
    for (int k = 0; k < 6; k++)
        measured[k] = dot(6, root[k], x);
    for (int i = 0; i < rows; i++) {
        double share = dot(6, V[i], measured);
        for (int k = 0; k < 6; k++)
            kept[k] += share * V[i][k];
    }
    as_twist(p, length, kept, part);
}

/* asked.py: the way to the target, from the screw, and exact demands and V as `asked` left them. */
void own_way(const Demand *demand, const double V[6][6], const double p[3], double length, double error[6])
{
    double share[6], missing[6] = {0.0}, direction[6], more[6];
    for (int i = 0, k = 0; i < demand->rows; i++) {
        unmeasured(p, length, demand->D[i], direction);
        if (!(norm(6, direction) > 0.0))
            continue;
        share[k] = demand->e[i] - dot(6, demand->D[i], error);
        for (int l = 0; l < k; l++)
            share[k] -= share[l] * dot(6, V[l], direction);
        share[k] /= dot(6, V[k], direction);
        for (int l = 0; l < 6; l++)
            missing[l] += share[k] * V[k][l];
        k++;
    }
    as_twist(p, length, missing, more);
    for (int k = 0; k < 6; k++)
        error[k] += more[k];
}
