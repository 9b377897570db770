/* Twin of velocity/share.py: how much of the exact rows' speed the limits allow, from standing still.

       minimise 1/2 (1 - a)^2 |y0|^2 + 1/2 nu |y|^2   over a in [0, 1] and z,   y = a y0 + B z inside the limits
       nu = EXACT_CALM / 2 dt (1 - a_max) |y0| effort */

#include "core.h"

/* The optimum for nu, from the active limits of `found`, which is written over. */
static Outcome best(const Polytope *room, const Cone *slow, int n, double length, double nu, Optimum *found)
{
    static const Row STILL = {0.0};
    Quadratic problem = {.n = n};
    for (int i = 0; i < n; i++) {
        double weight = REGULARISATION + nu + (i == 0 ? 1.0 : 0.0), root = sqrt(weight);
        problem.K[i][i] = root;
        problem.T[i][i] = 1.0 / root;
        problem.centre[i] = i == 0 ? length / weight : 0.0;
    }
    return minimise(&problem, room, slow, STILL, found, found);
}

static double within(double share) { return fmin(fmax(share, 0.0), 1.0); }

Outcome share_of(const Reduction *reduction, const Demand *demand, Share *share)
{
    int m = demand->m, n = reduction->n + 1;
    double length = norm(m, reduction->full);
    Polytope room = {.count = m + 1};
    Optimum found = {.met = false};
    share->value = 1.0;
    share->fast = false;
    share->near.met = false;
    for (int j = 0; j < m; j++)
        share->inside[j] = 0.0;
    if (length == 0.0)
        return DONE;
    for (int j = 0; j < m; j++) {
        room.A[j][0] = reduction->full[j] / length;
        for (int i = 0; i < reduction->n; i++)
            room.A[j][i + 1] = reduction->basis[i][j];
        room.lower[j] = demand->lower[j];
        room.upper[j] = demand->upper[j];
    }
    Cone slow = {.limit = 0.0};
    if (demand->cone.limit > 0.0) {
        Row basis[MOST], origin = {0.0};
        for (int j = 0; j < m; j++) {
            basis[0][j] = reduction->full[j] / length;
            for (int i = 0; i < reduction->n; i++)
                basis[i + 1][j] = reduction->basis[i][j];
        }
        cone_on(&demand->cone, m, origin, n, (const Row *)basis, &slow);
    }
    for (int i = 0; i < n; i++)
        room.A[m][i] = i == 0 ? 1.0 : 0.0;
    room.lower[m] = 0.0;
    room.upper[m] = INFINITY; /* a > 1 is never the optimum: a share 1 / a of it costs less, and is inside */
    if (best(&room, &slow, n, length, 0.0, &found) == HAND_BACK)
        return HAND_BACK;
    double possible = within(found.z[0] / length);
    double nu = 0.5 * EXACT_CALM * demand->dt * (1.0 - possible) * length * reduction->effort;
    if (nu > REGULARISATION && best(&room, &slow, n, length, nu, &found) == HAND_BACK)
        return HAND_BACK;
    double value = within(found.z[0] / length);
    joint(reduction, m, found.z + 1, found.z[0] / length, share->inside);
    if (value >= WHOLE)
        return DONE;
    share->fast = slow.limit > 0.0 && tool_speed(&slow, n, found.z) >= slow.limit * (1.0 - ACTIVE_TOLERANCE);
    double given = 1.0 - INTERIOR * (1.0 - value);
    share->value = value * given;
    for (int j = 0; j < m; j++) {
        share->inside[j] *= given;
        share->near.multipliers[j] = found.multipliers[j];
        share->near.met = share->near.met || found.multipliers[j] != 0.0;
    }
    return DONE;
}
