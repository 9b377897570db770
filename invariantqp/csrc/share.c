/* Twin of velocity/exact.py, share_of: how much of the exact rows' speed the limits allow. y0 and y count from the
   velocity that moves the rows least, which is standing still where limits allow that.

       minimise 1/2 (1 - a)^2 |y0|^2 + 1/2 nu |y|^2   over a in [0, 1] and z,   y = a y0 + B z inside the limits
       nu = EXACT_CALM / 2 dt (1 - a_max) |y0| effort */

#include "core.h"

/* Beside the tool's speed limit a smaller share is told by weights 1e-9 apart where standing still is not allowed. */
static const double LOOSE = 1e-3;
/* Where the least motion of the rows is this near what they ask for, it is that, or Python decides. */
static const double NOTHING = 1e-11, UNDECIDED = 1e-8;

/* The optimum for nu, from `first` or the active limits of `found`, which is written over. */
static Outcome best(const Polytope *room, const Cone *slow, const Row first, int n, double length, double nu, Optimum *found)
{
    Quadratic problem = {.n = n};
    for (int i = 0; i < n; i++) {
        double weight = REGULARISATION + nu + (i == 0 ? 1.0 : 0.0), root = sqrt(weight);
        problem.K[i][i] = root;
        problem.T[i][i] = 1.0 / root;
        problem.centre[i] = (REGULARISATION * first[i] + (i == 0 ? length : 0.0)) / weight;
    }
    return minimise(&problem, room, slow, first, found, found);
}

static double within(double share) { return between(share, 0.0, 1.0); }

/* exact.py, counted_from_least: the velocity inside the limits that moves the rows least, from one that is inside; the rows
   count from its part that they fix. `found` is the optimum. */
Outcome counted(Reduction *reduction, int m, const Polytope *limits, const Cone *cone, Row inside, Optimum *found)
{
    Objective still;
    Quadratic cost;
    found->met = true;
    int k = m - reduction->n;
    still.n = m;
    still.regular = NULL;
    zeroed(still.optimum);
    for (int i = 0; i < m; i++) {
        memcpy(still.V[i], i < k ? reduction->span[i] : reduction->basis[i - k], sizeof(Row));
        still.weights[i] = REGULARISATION + (i < k ? 1.0 : 0.0);
    }
    quadratic(&still, &cost);
    for (int i = 0; i < limits->count; i++) /* active at first: limits that do not allow standing still */
        found->multipliers[i] = (limits->upper[i] < 0.0) - (limits->lower[i] > 0.0);
    for (int pass = 0; pass < 2; pass++) {
        if (minimise(&cost, limits, cone, inside, found, found) == HAND_BACK)
            return HAND_BACK;
        memcpy(inside, found->z, (size_t)m * sizeof(double));
        for (int i = 0; i < m; i++)
            still.optimum[i] = (i < k ? REGULARISATION : 1.0) * dot(m, still.V[i], inside);
        centre(&still, cost.centre);
    }
    for (int i = 0; i < k; i++) {
        double along = dot(m, reduction->span[i], inside);
        for (int j = 0; j < m; j++)
            reduction->start[j] += along * reduction->span[i][j];
    }
    Row d;
    for (int j = 0; j < m; j++)
        d[j] = reduction->full[j] - reduction->start[j];
    double left = norm(m, d), size = fmax(norm(m, reduction->full), norm(m, inside));
    if (left <= NOTHING * size)
        memcpy(reduction->start, reduction->full, (size_t)m * sizeof(double));
    return left <= NOTHING * size || left > UNDECIDED * size ? DONE : HAND_BACK;
}

/* Add a row of length one, of `length` on y. */
static void add_held(Squares *held, const Row row, double length)
{
    Row unit;
    for (int j = 0; j < held->n; j++)
        unit[j] = length > 0.0 ? row[j] / length : 0.0;
    add_square(held, unit, 0.0);
}

/* exact.py, at_least_share: of the velocities at share 0, among them one `inside`, those that what holds the rows there leaves
   free; these limits have no bounds any more. `found` is of `counted`. */
Outcome at_least_share(Reduction *reduction, int m, Polytope *limits, Polytope *placed, Cone *cone, const Row inside,
                       const Optimum *found)
{
    static const Row NONE = {0.0};
    int n = reduction->n, held = 0;
    double size = norm(m, reduction->start), least = QP_ROUNDING * size;
    Row pull = {0.0}, basis[MOST];
    Polytope room;
    Squares all;
    Spectrum of;
    if (size <= QP_ROUNDING * norm(m, inside)) /* the rows can stand still */
        return DONE;
    begun(n, 0.0, NULL, &all);
    polytope_on(limits, m, inside, inside, n, (const Row *)reduction->basis, &room);
    for (int i = 0; i < limits->count; i++) {
        double length = limits->box ? 1.0 : norm(m, limits->A[i]);
        if (!(fabs(found->multipliers[i]) * length > least))
            continue;
        add_held(&all, room.A[i], length);
        limits->lower[i] = placed->lower[i] = -INFINITY;
        limits->upper[i] = placed->upper[i] = INFINITY;
    }
    if (cone->limit > 0.0 && found->nu > 0.0) {
        Cone slow;
        cone_on(cone, m, inside, n, (const Row *)reduction->basis, &slow);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < m; j++)
                pull[j] += slow.start[i] * cone->J[i][j];
        bool slowed = found->nu * norm(m, pull) > least;
        for (int i = 0; i < 3 && slowed; i++)
            add_held(&all, slow.J[i], norm(m, cone->J[i]));
        cone->limit = slowed ? 0.0 : cone->limit;
    }
    if (spectrum(n, n, (const Row *)all.R, NONE, NULL, &of) == HAND_BACK)
        return HAND_BACK;
    while (held < n && of.sigma[held] > QP_ROUNDING)
        held++;
    memset(basis, 0, sizeof basis);
    for (int k = held; k < n; k++)
        for (int j = 0; j < m; j++)
            for (int i = 0; i < n; i++)
                basis[k - held][j] += of.V[k][i] * reduction->basis[i][j];
    reduction->n = n - held;
    memcpy(reduction->basis, basis, sizeof basis);
    memcpy(reduction->start, inside, (size_t)m * sizeof(double));
    for (int i = 0; i < reduction->n; i++) {
        double along = dot(m, basis[i], inside);
        for (int j = 0; j < m; j++)
            reduction->start[j] -= along * basis[i][j];
    }
    return DONE;
}

/* From a velocity share->inside that moves the rows least. `limits` and `cone` are on y, dt is the tick. */
Outcome share_of(const Reduction *reduction, int m, const Polytope *limits, const Cone *cone, double dt, Share *share)
{
    int n = reduction->n + 1, last = limits->count;
    Row basis[MOST], d, first, velocity;
    for (int j = 0; j < m; j++)
        d[j] = reduction->full[j] - reduction->start[j];
    double length = norm(m, d);
    Polytope room;
    Optimum found = {.met = false};
    share->value = 1.0;
    share->near.met = false;
    if (length == 0.0)
        return DONE;
    if (dot(m, reduction->start, d) < -QP_ROUNDING * length * norm(m, share->inside)) { /* as limits lead away */
        share->value = 0.0;
        return DONE;
    }
    for (int j = 0; j < m; j++) {
        basis[0][j] = d[j] / length;
        for (int i = 0; i < reduction->n; i++)
            basis[i + 1][j] = reduction->basis[i][j];
    }
    for (int j = 0; j < m; j++)
        d[j] = share->inside[j] - reduction->start[j];
    for (int i = 0; i < n; i++)
        first[i] = dot(m, d, basis[i]);
    polytope_on(limits, m, reduction->start, share->inside, n, (const Row *)basis, &room);
    Cone slow = {.limit = 0.0};
    if (cone->limit > 0.0)
        cone_on(cone, m, reduction->start, n, (const Row *)basis, &slow);
    room.count = last + 1;
    for (int i = 0; i < n; i++)
        room.A[last][i] = i == 0 ? 1.0 : 0.0;
    room.lower[last] = room.rounding[last] = 0.0;
    /* From standing still a > 1 is never the optimum: a share 1 / a of it costs less, and is inside. */
    room.upper[last] = norm(m, reduction->start) > 0.0 ? length : INFINITY;
    if (best(&room, &slow, first, n, length, 0.0, &found) == HAND_BACK)
        return HAND_BACK;
    double possible = within(found.z[0] / length);
    double nu = 0.5 * EXACT_CALM * dt * (1.0 - possible) * length * reduction->effort;
    if (nu > REGULARISATION && best(&room, &slow, first, n, length, nu, &found) == HAND_BACK)
        return HAND_BACK;
    double value = within(found.z[0] / length);
    if (value < LOOSE && found.nu > 0.0 && norm(m, reduction->start) > 0.0)
        return HAND_BACK;
    if (value < LEAST_SHARE || value * length <= ACTIVE_TOLERANCE * norm(m, share->inside)) {
        share->value = 0.0;
        return DONE;
    }
    joint(reduction, m, found.z + 1, found.z[0] / length, velocity);
    double given = value >= WHOLE ? 1.0 : 1.0 - INTERIOR * (1.0 - value);
    for (int j = 0; j < m; j++)
        share->inside[j] += given * (velocity[j] - share->inside[j]);
    if (value >= WHOLE)
        return DONE;
    share->value = value * given;
    int held = 0, weakest = 0;
    for (int i = 0; i < last; i++) {
        double pull = share->near.multipliers[i] = found.multipliers[i];
        if (pull != 0.0 && (held++ == 0 || fabs(pull) < fabs(found.multipliers[weakest])))
            weakest = i;
    }
    share->near.met = held > 0;
    if (held > 1)
        share->near.multipliers[weakest] = 0.0;
    return DONE;
}
