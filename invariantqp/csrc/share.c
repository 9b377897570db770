/* Twin of legacy/exact.py: the velocity whose exact rows are nearest to a share of their demand, and how much of their
   speed the limits allow where they can keep their direction.

       minimise 1/2 (1 - a)^2 |y0|^2 + 1/2 nu |y|^2   over a in [0, 1] and z,   y = a y0 + B z inside the limits
       nu = EXACT_CALM / 2 dt (1 - a_max + max(0, 1/4 held a_max^2 |y0| effort - 1)) |y0| effort */

#include "core.h"

/* A decision that rounding may make: within this factor of QP_ROUNDING of the velocity. */
static const double CLOSE = 10.0;

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

static bool undecided(double size, double velocity)
{
    return size > QP_ROUNDING / CLOSE * velocity && size < QP_ROUNDING * CLOSE * velocity;
}

/* The velocity inside the limits that is nearest to `to` times direction n of `way`, but for the first directions, which are
   loose; from one that is inside and the active limits of `found`. */
static Outcome drawn(Objective *way, int loose, int n, double to, const Polytope *limits, const Cone *cone, Row inside,
                     Optimum *found)
{
    Quadratic cost;
    for (int i = 0; i < way->n; i++) {
        way->weights[i] = REGULARISATION + (i < loose ? 0.0 : 1.0);
        way->optimum[i] = i == n ? to : 0.0;
    }
    quadratic(way, &cost);
    for (int pass = 0; pass < 2; pass++) {
        if (minimise(&cost, limits, cone, inside, found, found) == HAND_BACK)
            return HAND_BACK;
        memcpy(inside, found->z, (size_t)way->n * sizeof(double));
        for (int i = 0; i < way->n; i++) {
            double along = dot(way->n, way->V[i], inside), wanted = i == n ? to : 0.0;
            way->optimum[i] = i < loose ? along : wanted + REGULARISATION * (along - wanted);
        }
        centre(way, cost.centre);
    }
    return DONE;
}

/* How far the directions of `way` from the first one on are off along a velocity. */
static double across(const Objective *way, int first, const Row inside)
{
    double square = 0.0;
    for (int i = first; i < way->n; i++) {
        double along = dot(way->n, way->V[i], inside);
        square += along * along;
    }
    return sqrt(square);
}

/* exact.py: the velocity inside the limits whose rows are nearest to a share of their demand, from share->inside; what of it
   is beside that share is reduction->start. `found` is the optimum. */
Outcome nearest_to_demand(Reduction *reduction, int m, const Polytope *limits, const Cone *cone, Share *share, Optimum *found)
{
    int n = reduction->n;
    double length = reduction->unmet > QP_ROUNDING ? 0.0 : norm(m, reduction->full), *inside = share->inside;
    Row V[MOST];
    Objective way = {.n = m, .V = (const Row *)V, .regular = NULL};
    if (undecided(length, norm(m, inside)))
        return HAND_BACK;
    length = length > QP_ROUNDING * norm(m, inside) ? length : 0.0;
    int line = length > 0.0 ? n + 1 : n;
    memset(V, 0, sizeof V);
    for (int i = 0; i < n; i++)
        memcpy(V[i], reduction->basis[i], sizeof(Row));
    for (int j = 0; j < m && line > n; j++)
        V[n][j] = reduction->full[j] / length;
    completed(m, line, V);
    found->met = true;
    for (int i = 0; i < limits->count; i++) /* active at first: limits that do not allow standing still */
        found->multipliers[i] = (limits->upper[i] < 0.0) - (limits->lower[i] > 0.0);
    if (drawn(&way, line, n, 0.0, limits, cone, inside, found) == HAND_BACK)
        return HAND_BACK;
    double p = line > n ? dot(m, way.V[n], inside) : 0.0, size = norm(m, inside), off = across(&way, line, inside);
    if (undecided(-p, size) || undecided(p - length, size) || undecided(off, size))
        return HAND_BACK;
    if (p < -QP_ROUNDING * size || p > length + QP_ROUNDING * size) { /* before the beginning, or behind the end */
        if (drawn(&way, n, n, p < 0.0 ? 0.0 : length, limits, cone, inside, found) == HAND_BACK)
            return HAND_BACK;
    } else if (line > n && off > QP_ROUNDING * size && drawn(&way, line, n, length, limits, cone, inside, found) == HAND_BACK)
        return HAND_BACK;
    p = line > n ? between(dot(m, way.V[n], inside), 0.0, length) : 0.0;
    share->value = line > n ? p / length : 0.0;
    memcpy(reduction->start, inside, (size_t)m * sizeof(double));
    for (int i = 0; i < line; i++) {
        double along = i == n ? p : dot(m, way.V[i], inside);
        for (int j = 0; j < m; j++)
            reduction->start[j] -= along * way.V[i][j];
    }
    off = norm(m, reduction->start);
    size = norm(m, inside);
    for (int j = 0; j < m && off <= QP_ROUNDING * size; j++) /* the rows can keep their direction */
        reduction->start[j] = 0.0;
    return undecided(off, size) ? HAND_BACK : DONE;
}

/* Add a row of length one, of `length` on y. */
static void add_held(Squares *held, const Row row, double length)
{
    Row unit;
    for (int j = 0; j < held->n; j++)
        unit[j] = length > 0.0 ? row[j] / length : 0.0;
    add_square(held, unit, 0.0);
}

/* exact.py: of the velocities whose rows are as near to their demand as those of share->inside, what the limits that keep them
   there leave free; these limits have no bounds any more. `found` is of `nearest_to_demand`. */
Outcome fixed_beside(Reduction *reduction, int m, Polytope *limits, Polytope *placed, Cone *cone, const Share *share,
                     const Optimum *found)
{
    static const Row NONE = {0.0};
    int n = reduction->n, held = 0;
    const double *inside = share->inside;
    double least = QP_ROUNDING * norm(m, reduction->start);
    Row pull = {0.0}, basis[MOST];
    Polytope room;
    Squares all;
    Spectrum of;
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
    Row left;
    for (int j = 0; j < m; j++)
        left[j] = reduction->start[j] = inside[j] - share->value * reduction->full[j];
    for (int i = 0; i < reduction->n; i++) {
        double along = dot(m, basis[i], left);
        for (int j = 0; j < m; j++)
            reduction->start[j] -= along * basis[i][j];
    }
    return DONE;
}

/* Reduction.excess: by how much more than themselves the rows turn while a share of their velocity is held so long. */
double excess_turn(const Reduction *reduction, int m, double held, double share)
{
    return fmax(0.0, DEVIATION_SHARE * held * share * share * reduction->effort * norm(m, reduction->full) - 1.0);
}

/* From a velocity share->inside whose rows have a share of their speed. `limits` and `cone` are on y, dt is the tick, `held`
   how much longer the velocity is held. */
Outcome share_of(const Reduction *reduction, int m, const Polytope *limits, const Cone *cone, double dt, double held, Share *share)
{
    static const Row STILL = {0.0};
    int n = reduction->n + 1, last = limits->count;
    Row basis[MOST], first, velocity;
    double length = norm(m, reduction->full), size = norm(m, share->inside);
    Polytope room;
    Optimum found = {.met = false};
    share->value = 1.0;
    share->near.met = false;
    if (undecided(length, size))
        return HAND_BACK;
    if (length <= QP_ROUNDING * size)
        return DONE;
    for (int j = 0; j < m; j++) {
        basis[0][j] = reduction->full[j] / length;
        for (int i = 0; i < reduction->n; i++)
            basis[i + 1][j] = reduction->basis[i][j];
    }
    for (int i = 0; i < n; i++)
        first[i] = dot(m, share->inside, basis[i]);
    polytope_on(limits, m, STILL, share->inside, n, (const Row *)basis, &room);
    Cone slow = {.limit = 0.0};
    if (cone->limit > 0.0)
        cone_on(cone, m, STILL, n, (const Row *)basis, &slow);
    room.count = last + 1;
    for (int i = 0; i < n; i++)
        room.A[last][i] = i == 0 ? 1.0 : 0.0;
    room.lower[last] = room.rounding[last] = 0.0;
    /* From standing still a > 1 is never the optimum: a share 1 / a of it costs less, and is inside. */
    room.upper[last] = size > 0.0 ? length : INFINITY;
    if (best(&room, &slow, first, n, length, 0.0, &found) == HAND_BACK)
        return HAND_BACK;
    double possible = within(found.z[0] / length);
    double missed = 1.0 - possible + excess_turn(reduction, m, held, possible);
    double nu = 0.5 * EXACT_CALM * (dt + held) * missed * length * reduction->effort;
    bool calmed = nu > REGULARISATION;
    if ((calmed || possible < FAR_SHARE) &&
        best(&room, &slow, first, n, calmed ? length : fmax(found.z[0], 0.0) / FAR_SHARE, calmed ? nu : 0.0, &found) == HAND_BACK)
        return HAND_BACK;
    double value = within(found.z[0] / length), known = first[0] > QP_ROUNDING * size ? within(first[0] / length) : 0.0;
    if (undecided(first[0], size))
        return HAND_BACK;
    if (value < FAR_SHARE && found.nu > 0.0 && size > 0.0) /* told by weights 1e-9 apart */
        return HAND_BACK;
    if (value < EPSILON || value * length <= ACTIVE_TOLERANCE * size) {
        share->value = known;
        return DONE;
    }
    joint(reduction, m, found.z + 1, found.z[0] / length, velocity);
    double given = value >= WHOLE ? 1.0 : 1.0 - INTERIOR * (1.0 - value);
    for (int j = 0; j < m; j++)
        share->inside[j] += given * (velocity[j] - share->inside[j]);
    if (value >= WHOLE)
        return DONE;
    share->value = known + given * (value - known);
    int tight = 0, weakest = 0;
    for (int i = 0; i < last; i++) {
        double pull = share->near.multipliers[i] = found.multipliers[i];
        if (pull != 0.0 && (tight++ == 0 || fabs(pull) < fabs(found.multipliers[weakest])))
            weakest = i;
    }
    share->near.met = tight > 0;
    if (tight > 1)
        share->near.multipliers[weakest] = 0.0;
    return DONE;
}
