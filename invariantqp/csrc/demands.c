/* Twin of control/demands.py: exact demands as rows on the joint velocity, C x = e with C = D J for parts of the twist.

       POINT    v + omega x p = gain (p_d - p) + v_d(p_d)              a point of the tool
       AXIS     omega without its part about the axis a                a direction of the tool
       PLANE    n.(v + omega x p) = gain n.(p_d - p) + n.v_d(p_d)      a point and the normal of its plane
       JOINTS   one row as it is */

#include "loop.h"
#include <string.h>

/* Directions that are nearly opposite: which way to turn is decided by rounding, or by Python's choice of an axis. */
static const double OPPOSITE = 0.1;

/* The velocity of a point of the tool, v + omega x here, as rows D, and what is wanted of it. */
static void point_rows(double gain, const Pose *tool, const Pose *target, const double *feedforward, const double point[3],
                       double D[3][6], double e[3])
{
    double here[3], there[3], root[6][6];
    place(tool, point, here);
    place(target, point, there);
    root_at(here, 1.0, root);
    memcpy(D, root + 3, 3 * sizeof *D);
    root_at(there, 1.0, root);
    for (int i = 0; i < 3; i++)
        e[i] = gain * (there[i] - here[i]) + (feedforward == NULL ? 0.0 : dot(6, root[3 + i], feedforward));
}

/* The angular velocity across an axis of the tool: two rows, along any two directions across. */
static Outcome axis_rows(double gain, const Pose *tool, const Pose *target, const double *feedforward, const double axis[3],
                         double D[2][6], double e[2])
{
    double here[3], there[3], turn[3], across[2][3], rest[3] = {0.0};
    int least = 0;
    turned(tool, axis, here);
    turned(target, axis, there);
    cross(here, there, turn);
    double sine = norm(3, turn), cosine = dot(3, here, there), angle = sine > 0.0 ? atan2(sine, cosine) / sine : 1.0;
    if (cosine < 0.0 && sine < OPPOSITE)
        return HAND_BACK;
    for (int i = 0; i < 3; i++) {
        turn[i] = gain * angle * turn[i] + (feedforward == NULL ? 0.0 : feedforward[i]);
        least = fabs(here[i]) < fabs(here[least]) ? i : least;
    }
    rest[least] = 1.0;
    cross(here, rest, across[0]);
    cross(here, across[0], across[1]);
    for (int k = 0; k < 2; k++) {
        double length = norm(3, across[k]);
        for (int i = 0; i < 3; i++) {
            D[k][i] = across[k][i] / length;
            D[k][3 + i] = 0.0;
        }
        e[k] = dot(3, D[k], turn);
    }
    return DONE;
}

/* The rows of some demands for joint twists demand->J. */
Outcome rows_of(const Wanted *exact, int count, double gain, const Pose *tool, const Pose *target,
                const double *feedforward, Demand *demand)
{
    static const int ROWS[] = {3, 2, 1, 1};
    demand->rows = 0;
    demand->of_twist = false;
    for (int k = 0; k < count; k++) {
        const Wanted *wanted = &exact[k];
        if (!(wanted->kind >= POINT && wanted->kind <= JOINTS))
            return HAND_BACK;
        Kind kind = (Kind)wanted->kind;
        double(*D)[6] = demand->D + demand->rows, *e = demand->e + demand->rows, Dp[3][6], ep[3];
        Row *C = demand->C + demand->rows;
        if (demand->rows + ROWS[kind] > MOST_ROWS)
            return HAND_BACK;
        demand->rows += ROWS[kind];
        demand->of_twist = demand->of_twist || kind != JOINTS;
        if (kind == JOINTS) {
            memset(D, 0, sizeof *D);
            memcpy(C, wanted->row, sizeof(Row));
            e[0] = wanted->speed;
            continue;
        }
        if (kind == POINT)
            point_rows(gain, tool, target, feedforward, wanted->point, D, e);
        else if (kind == PLANE) {
            point_rows(gain, tool, target, feedforward, wanted->point, Dp, ep);
            e[0] = dot(3, wanted->direction, ep);
            for (int i = 0; i < 6; i++)
                D[0][i] = wanted->direction[0] * Dp[0][i] + wanted->direction[1] * Dp[1][i] + wanted->direction[2] * Dp[2][i];
        } else if (axis_rows(gain, tool, target, feedforward, wanted->direction, D, e) == HAND_BACK)
            return HAND_BACK;
        product_of_rows(ROWS[kind], (const double(*)[6])D, demand->m, (const Row *)demand->J, C);
    }
    return DONE;
}
