/* Twin of legacy/tick.py: one tick, stage by stage, inside all of its limits.

       free       the optimum without limits, where that is inside them; otherwise:
       share      exact rows slow down along their direction where limits require it
       minimise   the optimum inside the limits
       calm       the optimum once more, with damping that grows with the residual
       guard      with a form: least squares inside the same limits is blended in where the form does not descend */

#include "core.h"

/* A tick as a problem in z: y = origin + B z with exact rows, y = z without; x = T y. */
typedef struct {
    const Demand *demand;
    const Row *twists; /* A on x */
    const Row *A; /* on y, as all that follows */
    const double *wanted, *attempt; /* the same array where no form changes anything */
    double ahead[6], unchased[6];   /* of `wanted` and of `attempt`, without the chase */
    Row posture;
    Regular own; /* where there is a joint metric */
    Polytope limits, placed; /* placed: without the limits of velocity and acceleration */
    Cone cone;
    Reduction reduction;
    Spectrum spectrum; /* of A, or of A B where there are exact rows */
    double instead[6]; /* of `wanted`: what a form attempts */
    Row product[6];    /* A T */
} Posed;

/* What is left to minimise over at a share of the exact rows' speed: the limits on z, and a z inside them. */
typedef struct {
    const Share *share;
    const Polytope *limits, *placed; /* those of the problem, or these beside exact rows */
    Polytope on[2];
    Cone cone;
    Row inside;
} Room;

/* tick.py, limits_of */
static void limits_of(const Demand *demand, const Row lower, const Row upper, Polytope *limits)
{
    int m = demand->m;
    const Law *metric = demand->metric;
    limits->count = m + demand->limits;
    limits->box = metric == NULL && demand->limits == 0;
    memset(limits->rounding, 0, (size_t)limits->count * sizeof(double));
    memcpy(limits->lower, lower, (size_t)m * sizeof(double));
    memcpy(limits->upper, upper, (size_t)m * sizeof(double));
    for (int j = 0; j < m && !limits->box; j++)
        for (int l = 0; l < m; l++)
            limits->A[j][l] = metric != NULL ? metric->T[j][l] : j == l ? 1.0 : 0.0;
    for (int i = 0; i < demand->limits; i++) {
        memcpy(limits->A[m + i], demand->G[i], sizeof(Row));
        limits->lower[m + i] = demand->least[i];
        limits->upper[m + i] = demand->most[i];
    }
    if (demand->limits > 0 && metric != NULL)
        product_with(demand->limits, m, limits->A + m, metric->T);
}

/* x = T y */
static void moved(const Demand *demand, const Row y, Row x)
{
    if (demand->metric != NULL)
        transformed(demand->m, demand->metric->T, y, x);
    else
        memcpy(x, y, sizeof(Row));
}

/* tick.py, _followed: the share of the posture that is followed, by the joint speed that the task needs. */
static Outcome pace(Posed *problem, double *share)
{
    const Demand *demand = problem->demand;
    const Chase *chase = &demand->chase;
    int m = demand->m, n = demand->rows > 0 ? problem->reduction.n : m;
    static const Row STILL = {0.0};
    double b[6], steady = steady_share(demand, problem->wanted, problem->ahead);
    Spectrum *found = &problem->spectrum;
    Spectrum needed = *found;
    Objective task;
    Row z, y = {0.0}, x;
    if (demand->rows > 0) {
        Demand rows = *demand;
        Reduction reduction;
        Row C[MOST_ROWS];
        for (int i = 0; i < 6; i++)
            rows.s[i] = demand->chased ? chase->ahead[i] + steady * (demand->s[i] - chase->ahead[i]) : demand->s[i];
        for (int i = 0; i < demand->rows && demand->chased; i++)
            rows.e[i] = chase->rows_ahead[i] + steady * (demand->e[i] - chase->rows_ahead[i]);
        memcpy(C, demand->C, (size_t)demand->rows * sizeof(Row));
        if (demand->metric != NULL)
            product_with(demand->rows, m, C, demand->metric->T);
        if (reduce(&rows, (const Row *)C, &reduction) == HAND_BACK)
            return HAND_BACK;
        memcpy(y, reduction.full, sizeof(Row));
        for (int i = 0; i < 6; i++)
            b[i] = problem->ahead[i] + steady * (problem->wanted[i] - problem->ahead[i]) - dot(m, problem->A[i], y);
        want(&needed, b, NULL);
    } else if (demand->form != NULL || m < 6) {
        for (int i = 0; i < 6; i++)
            b[i] = problem->ahead[i] + steady * (problem->wanted[i] - problem->ahead[i]);
        want(&needed, b, NULL);
    } else
        for (int i = 0; i < 6; i++)
            needed.wanted[i] = found->ahead[i] + steady * (found->wanted[i] - found->ahead[i]);
    if (least_squares(demand, n, &needed, STILL, false, &task) == HAND_BACK)
        return HAND_BACK;
    centre(&task, z);
    if (demand->rows > 0)
        for (int j = 0; j < m; j++)
            for (int i = 0; i < n; i++)
                y[j] += problem->reduction.basis[i][j] * z[i];
    else
        memcpy(y, z, sizeof(Row));
    moved(demand, y, x);
    *share = posture_share(demand, x);
    return DONE;
}

/* tick.py, _unhurried: what the joints follow of a posture changes what they do by at most `change` */
static void unhurried(Posed *problem)
{
    const Demand *demand = problem->demand;
    const Reduction *reduction = &problem->reduction;
    const Spectrum *found = &problem->spectrum;
    int m = demand->m, n = demand->rows > 0 ? reduction->n : m;
    Row before, way, d = {0.0}, x;
    if (demand->metric != NULL)
        transformed(m, demand->metric->inverse, demand->before, before);
    else
        memcpy(before, demand->before, sizeof before);
    for (int j = 0; j < m; j++)
        way[j] = problem->posture[j] - before[j];
    for (int i = 0; i < n; i++) {
        Row freed = {0.0};
        double led = led_share(demand, found, i);
        if (led == 0.0)
            continue;
        for (int j = 0; j < m && demand->rows > 0; j++)
            for (int k = 0; k < n; k++)
                freed[j] += reduction->basis[k][j] * found->V[i][k];
        const double *direction = demand->rows > 0 ? freed : found->V[i];
        double along = led * dot(m, direction, way);
        for (int j = 0; j < m; j++)
            d[j] += along * direction[j];
    }
    moved(demand, d, x);
    double share = slower(demand, x);
    for (int j = 0; j < m; j++)
        problem->posture[j] = before[j] + share * way[j];
}

/* The spectrum of the velocities that exact rows leave free, compared with that of all. */
static Outcome free_spectrum(Posed *problem)
{
    const Reduction *reduction = &problem->reduction;
    double largest = problem->spectrum.largest;
    Row AB[6];
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < reduction->n; j++)
            AB[i][j] = dot(problem->demand->m, problem->A[i], reduction->basis[j]);
    if (spectrum(6, reduction->n, (const Row *)AB, NULL, NULL, &problem->spectrum) == HAND_BACK)
        return HAND_BACK;
    problem->spectrum.largest = largest;
    return DONE;
}

static Outcome posed(const Demand *demand, const Regular *regular, const Row A[6], const double wanted[6], Posed *problem)
{
    int m = demand->m;
    const Law *metric = demand->metric;
    static const Row STILL = {0.0};
    Row C[MOST_ROWS];
    problem->demand = demand;
    problem->twists = problem->A = A;
    problem->wanted = problem->attempt = wanted;
    problem->cone.limit = demand->cone.limit;
    if (demand->cone.limit > 0.0)
        problem->cone = demand->cone;
    memcpy(problem->posture, demand->posture, sizeof(Row));
    memcpy(C, demand->C, (size_t)demand->rows * sizeof(Row));
    for (int i = 0; i < 6; i++) /* all of a twist by itself */
        problem->ahead[i] = demand->chased ? dot(6, demand->root[i], demand->chase.ahead) : wanted[i];
    memcpy(problem->unchased, problem->ahead, sizeof problem->unchased);
    limits_of(demand, demand->lower, demand->upper, &problem->limits);
    if (demand->chased)
        limits_of(demand, demand->chase.lower, demand->chase.upper, &problem->placed);
    if (metric != NULL) {
        memcpy(problem->product, A, sizeof problem->product);
        product_with(6, m, problem->product, metric->T);
        product_with(demand->rows, m, C, metric->T);
        transformed(m, metric->inverse, demand->posture, problem->posture);
        if (demand->cone.limit > 0.0) {
            Row columns[MOST];
            for (int i = 0; i < m; i++)
                for (int j = 0; j < m; j++)
                    columns[i][j] = metric->T[j][i];
            cone_on(&demand->cone, m, STILL, m, (const Row *)columns, &problem->cone);
        }
        problem->A = (const Row *)problem->product;
        is_regular(demand, problem->A, &problem->own);
        regular = &problem->own;
        if (!usual_rows(6, m, problem->A) || !usual_rows(demand->rows, m, (const Row *)C))
            return HAND_BACK;
    }
    bool directions = demand->form != NULL || m < 6; /* whether U is needed */
    Spectrum *found = &problem->spectrum;
    if (demand->rows > 0 && reduce(demand, (const Row *)C, &problem->reduction) == HAND_BACK)
        return HAND_BACK;
    if (demand->rows == 0 && regular->holds)
        regular_spectrum(m, regular, problem->A, wanted, problem->ahead, found);
    else if (spectrum(6, m, problem->A, directions ? NULL : wanted, directions ? NULL : problem->ahead, found) == HAND_BACK)
        return HAND_BACK;
    if (demand->form != NULL && !found->regular) { /* far from singular the joints can do all of it */
        if (attempted(demand, m, found, wanted, problem->instead) == HAND_BACK ||
            (demand->chased && attempted(demand, m, found, problem->ahead, problem->unchased) == HAND_BACK))
            return HAND_BACK;
        if (memcmp(problem->instead, wanted, sizeof problem->instead) != 0)
            problem->attempt = problem->instead;
    }
    if (demand->rows > 0 && free_spectrum(problem) == HAND_BACK)
        return HAND_BACK;
    double share = 1.0;
    if (demand->has_posture && demand->paced && pace(problem, &share) == HAND_BACK)
        return HAND_BACK;
    for (int j = 0; j < m; j++)
        problem->posture[j] *= share;
    if (demand->has_posture && demand->has_before)
        unhurried(problem);
    return DONE;
}

/* The objective in z at a share of the speed, for an attempt and its part that is not chased. */
static Outcome objective(Posed *problem, const double *attempt, const double *unchased, double share, Objective *result)
{
    const Demand *demand = problem->demand;
    const Reduction *reduction = &problem->reduction;
    int m = demand->m;
    if (demand->rows == 0) {
        if (demand->form != NULL || m < 6)
            want(&problem->spectrum, attempt, unchased);
        return least_squares(demand, m, &problem->spectrum, problem->posture, demand->chased, result);
    }
    Row posture = {0.0}, start;
    double left[6], still[6];
    origin(reduction, m, share, start);
    for (int i = 0; i < 6; i++) {
        double fixed = dot(m, problem->A[i], start);
        left[i] = share * attempt[i] - fixed;
        still[i] = share * unchased[i] - fixed;
    }
    want(&problem->spectrum, left, still);
    if (demand->has_posture) {
        Row wanted;
        for (int j = 0; j < m; j++)
            wanted[j] = share * problem->posture[j];
        freed(reduction, m, wanted, share, posture);
    }
    return least_squares(demand, reduction->n, &problem->spectrum, posture, demand->chased, result);
}

static void joints(const Posed *problem, const Row z, double share, Row y)
{
    int m = problem->demand->m;
    if (problem->demand->rows > 0)
        joint(&problem->reduction, m, z, share, y);
    for (int j = 0; j < m && problem->demand->rows == 0; j++)
        y[j] = z[j];
}

static void free_part(const Posed *problem, const Row y, double share, Row z)
{
    int m = problem->demand->m;
    if (problem->demand->rows > 0)
        freed(&problem->reduction, m, y, share, z);
    for (int j = 0; j < m && problem->demand->rows == 0; j++)
        z[j] = y[j];
}

/* The limits on z at a share of the exact rows' speed. */
static void room_at(const Posed *problem, const Share *share, Room *room)
{
    const Reduction *reduction = &problem->reduction;
    const Demand *demand = problem->demand;
    int m = demand->m;
    room->share = share;
    room->cone.limit = problem->cone.limit;
    if (problem->cone.limit > 0.0)
        room->cone = problem->cone;
    free_part(problem, share->inside, share->value, room->inside);
    room->limits = demand->rows == 0 ? &problem->limits : &room->on[0];
    room->placed = demand->rows == 0 ? &problem->placed : &room->on[1];
    if (demand->rows == 0)
        return;
    Row start;
    origin(reduction, m, share->value, start);
    polytope_on(&problem->limits, m, start, share->inside, reduction->n, reduction->basis, &room->on[0]);
    if (demand->chased)
        polytope_on(&problem->placed, m, start, share->inside, reduction->n, reduction->basis, &room->on[1]);
    if (room->cone.limit > 0.0)
        cone_on(&problem->cone, m, start, reduction->n, reduction->basis, &room->cone);
}

/* Whether z is inside all limits, but for rounding. */
static bool is_allowed(const Room *room, int n, const Row z)
{
    return inside_limits(room->limits, n, z) &&
           (room->cone.limit == 0.0 || tool_speed(&room->cone, n, z) <= room->cone.limit * (1.0 + QP_ROUNDING));
}

/* The chase from z0 by `way`, whose direction is u in the objective; what limits take away of it at the pace that was tried
   last, and how that rises with the pace as far as the one tried before it tells. */
typedef struct {
    const Room *room;
    Quadratic *cost;
    Turned *turned;
    Optimum *found;
    Row z0, way, u;
    double pace, by, rise;
} Slowed;

static Outcome missed(Slowed *slowed, double pace)
{
    Quadratic *cost = slowed->cost;
    Row apart;
    int n = cost->n;
    double by = slowed->by, step = pace - slowed->pace;
    for (int j = 0; j < n; j++)
        cost->centre[j] = slowed->z0[j] + pace * slowed->way[j];
    if (minimise_turned(cost, slowed->room->limits, &slowed->room->cone, slowed->room->inside, slowed->found, slowed->turned,
                        slowed->found) == HAND_BACK)
        return HAND_BACK;
    slowed->by = 0.0;
    for (int j = 0; j < n; j++)
        apart[j] = cost->centre[j] - slowed->found->z[j];
    for (int i = 0; i < n; i++)
        slowed->by += slowed->u[i] * dot(n, cost->K[i], apart);
    slowed->rise = step != 0.0 ? (slowed->by - by) / step : 0.0;
    slowed->pace = pace;
    return DONE;
}

/* How much more is missed at a larger pace, while the active limits stay: |u'Q|^2 for their normals Q R. */
static double slope(const Slowed *slowed)
{
    const Face *face = &slowed->turned->face;
    double sum = 0.0;
    for (int k = 0; k < face->k; k++) {
        double along = dot(slowed->cost->n, face->Q[k], slowed->u);
        sum += along * along;
    }
    return sum;
}

/* To the largest pace up to the one tried last at which no more than delta is missed, or 0. What is missed does not fall and
   is linear as long as the active limits stay: each step goes to where those of the last one would have it or, beside a speed
   limit, to where the last two, and then the secant, have it, an end that stays being weighed down; or else it halves. */
static Outcome largest(Slowed *slowed, double length, double delta)
{
    double low = 0.0, high = slowed->pace, at = slowed->by - delta, under = 0.0, over = at;
    bool first = true;
    int side = 0;
    if (at <= 0.0)
        return DONE;
    while (high - low > PACE_ROUNDING) {
        bool secant = slowed->found->nu > 0.0;
        double rise = secant ? slowed->rise : length * slope(slowed), next = rise > 0.0 ? slowed->pace - at / rise : low;
        if ((secant || rise == 0.0) && under < 0.0)
            next = low + (high - low) * under / (under - over);
        if (!(next > low && next < high))
            next = first && next <= low ? low : 0.5 * (low + high);
        if (next == slowed->pace)
            break;
        if (missed(slowed, next) == HAND_BACK)
            return HAND_BACK;
        at = slowed->by - delta;
        if (next == 0.0) {
            first = false;
            if (at >= -NULL_RATIO * length)
                return DONE;
        } else if (fabs(at) <= PACE_ROUNDING * length)
            break;
        if (at > 0.0) {
            high = next;
            over = at;
            under *= side > 0 ? 0.5 : 1.0;
            side = 1;
        } else {
            low = next;
            under = at;
            over *= side < 0 ? 0.5 : 1.0;
            side = -1;
        }
    }
    return DONE;
}

/* tick.py, _calm: damping for what a velocity y, and what is slowed on purpose, leave of the twist. */
static double calming(const Posed *problem, const Row y, const Row slowed, double speed)
{
    const Demand *demand = problem->demand;
    if (demand->dt == 0.0)
        return 0.0;
    double factor = (demand->rows == 0 ? CALM : CALM * problem->reduction.bend) / worth(demand, problem->twists, problem->wanted);
    return calm(demand->m, problem->A, problem->wanted, y, slowed, speed, demand->dt + demand->held, factor);
}

/* The velocity inside the limits, as y: position limits bend the chase of a target, all others slow it down first.
   `found` begins with limits that are likely to be active; `slowed` is what of the chase is slowed down. */
static Outcome within(const Posed *problem, const Room *room, const Objective *objective, Optimum *found, Row y,
                      Row slowed, double *pace)
{
    const Demand *demand = problem->demand;
    int n = objective->n, m = demand->m;
    static const Cone NONE = {.limit = 0.0};
    double length = 0.0, size = 0.0;
    Turned turned; /* limits of both rooms have the same rows */
    Quadratic cost, calmer, *chase = &cost;
    Row z1, unchased, whole, start, part;
    *pace = 1.0;
    turned.rows = 0;
    zeroed(slowed);
    quadratic(objective, &cost);
    memcpy(whole, cost.centre, sizeof whole);
    double mu = 0.0;
    if (demand->chased) {
        combined(n, n, objective->still, 1, objective->V, unchased);
        memcpy(start, unchased, sizeof start);
        joints(problem, whole, room->share->value, y);
        mu = calming(problem, y, slowed, 0.0);
        if (mu > 0.0) {
            Objective other = *objective;
            memcpy(other.optimum, objective->still, sizeof other.optimum);
            calmed(&other, mu);
            centre(&other, start);
            other = *objective;
            calmed(&other, mu);
            quadratic(&other, chase = &calmer);
        }
        if (minimise_turned(chase, room->placed, &NONE, room->inside, found, &turned, found) == HAND_BACK)
            return HAND_BACK;
    }
    bool allowed = demand->chased && is_allowed(room, n, found->z);
    if (allowed && mu == 0.0) {
        joints(problem, found->z, room->share->value, y);
        return DONE;
    }
    if (demand->chased && !allowed) {
        memcpy(z1, found->z, sizeof z1);
        Optimum still;
        Slowed way = {.room = room, .cost = chase, .turned = &turned, .found = found, .pace = 1.0};
        memcpy(chase->centre, start, sizeof start);
        if (minimise_turned(chase, room->placed, &NONE, room->inside, NULL, &turned, &still) == HAND_BACK)
            return HAND_BACK;
        memcpy(way.z0, still.z, sizeof way.z0);
        for (int j = 0; j < n; j++)
            way.way[j] = z1[j] - way.z0[j];
        for (int i = 0; i < n; i++) {
            way.u[i] = dot(n, chase->K[i], way.way);
            part[i] = dot(n, chase->K[i], z1);
        }
        length = norm(n, way.u);
        size = norm(n, part);
        if (length > NULL_RATIO * size) {
            for (int i = 0; i < n; i++)
                way.u[i] /= length;
            double ahead = room->share->value * norm(6, problem->ahead);
            if (missed(&way, 1.0) == HAND_BACK)
                return HAND_BACK;
            for (int twice = 0; twice < 2 && way.pace > 0.0 && (twice == 0 || way.pace < 1.0); twice++)
                if (largest(&way, length, ahead + way.pace * demand->chase.slack) == HAND_BACK)
                    return HAND_BACK;
            *pace = way.pace;
        }
        for (int j = 0; j < n; j++) {
            part[j] = (1.0 - *pace) * (whole[j] - unchased[j]);
            cost.centre[j] = whole[j] - part[j];
        }
        for (int j = 0; j < m && demand->rows > 0; j++)
            for (int i = 0; i < n; i++)
                slowed[j] += problem->reduction.basis[i][j] * part[i];
        if (demand->rows == 0)
            memcpy(slowed, part, sizeof(Row));
    }
    if (mu > 0.0)
        turned.rows = 0;
    if (minimise_turned(&cost, room->limits, &room->cone, room->inside, found, &turned, found) == HAND_BACK)
        return HAND_BACK;
    joints(problem, found->z, room->share->value, y);
    return DONE;
}

/* The answer once more, at its pace, with 1/2 mu |z|^2 added. */
static Outcome again(const Posed *problem, const Room *room, Objective *objective, double pace, double mu, Optimum *found,
                     Row y)
{
    Quadratic cost;
    for (int i = 0; i < objective->n && problem->demand->chased; i++)
        objective->optimum[i] = objective->still[i] + pace * (objective->optimum[i] - objective->still[i]);
    calmed(objective, mu);
    quadratic(objective, &cost);
    if (minimise(&cost, room->limits, &room->cone, room->inside, found, found) == HAND_BACK)
        return HAND_BACK;
    joints(problem, found->z, room->share->value, y);
    return DONE;
}

/* y, with as much least squares blended in as descent requires; `near` has the limits that hold the rows. */
static Outcome guarded(Posed *problem, const Room *room, double mu, Row y, double *blended)
{
    const Demand *demand = problem->demand;
    const Share *share = room->share;
    Objective plain;
    Optimum best = share->near;
    Row least, slowed;
    double wanted[6], pace;
    *blended = 0.0;
    if (problem->attempt == problem->wanted || demand->form->fraction < 0.0)
        return DONE;
    if (objective(problem, problem->wanted, problem->ahead, share->value, &plain) == HAND_BACK)
        return HAND_BACK;
    if (within(problem, room, &plain, &best, least, slowed, &pace) == HAND_BACK ||
        (mu > 0.0 && again(problem, room, &plain, pace, mu, &best, least) == HAND_BACK))
        return HAND_BACK;
    for (int i = 0; i < 6; i++)
        wanted[i] = share->value * problem->wanted[i];
    if (blend(demand->m, problem->A, wanted, mu, y, least, demand->form->fraction, blended) == HAND_BACK)
        return HAND_BACK;
    for (int j = 0; j < demand->m; j++)
        y[j] = (1.0 - *blended) * y[j] + *blended * least[j];
    return DONE;
}

/* A velocity inside the limits, after those that contradict others gave way, and the share of the exact rows' speed that
   they allow. */
static Outcome roomy(Posed *problem, Share *share, Yielded *yielded)
{
    const Demand *demand = problem->demand;
    int m = demand->m;
    bool still = true, kept = true;
    for (int j = 0; j < m; j++)
        share->inside[j] = between(0.0, demand->lower[j], demand->upper[j]);
    for (int i = 0; i < demand->limits; i++) {
        double value = dot(m, demand->G[i], share->inside);
        kept = kept && value >= demand->least[i] && value <= demand->most[i];
    }
    if (demand->metric != NULL)
        transformed(m, demand->metric->inverse, share->inside, share->inside);
    if (!kept && relaxed(m, demand->limits, &problem->limits, &problem->placed, share->inside, yielded) == HAND_BACK)
        return HAND_BACK;
    if (problem->cone.limit > 0.0 && !(tool_speed(&problem->cone, m, share->inside) <= problem->cone.limit) &&
        slowed_point(m, &problem->limits, &problem->cone, share->inside, yielded) == HAND_BACK)
        return HAND_BACK;
    for (int j = 0; j < m; j++)
        still = still && share->inside[j] == 0.0;
    if (demand->rows == 0)
        return DONE;
    share->near.met = false;
    Reduction *reduction = &problem->reduction;
    Optimum nearest;
    if (!still && nearest_to_demand(reduction, m, &problem->limits, &problem->cone, share, &nearest) == HAND_BACK)
        return HAND_BACK;
    if (norm(m, reduction->start) > 0.0)
        return fixed_beside(reduction, m, &problem->limits, &problem->placed, &problem->cone, share, &nearest) == HAND_BACK
                   ? HAND_BACK
                   : free_spectrum(problem);
    if (reduction->unmet > QP_ROUNDING) { /* the share tends to zero as the joints lose a direction */
        share->value = 0.0;
        return DONE;
    }
    return share_of(reduction, m, &problem->limits, &problem->cone, demand->dt, demand->held, share);
}

/* How far a motion that limits require moves each exact row beside its share of the speed; solution->rows of them are told. */
static void beside(const Posed *problem, const Share *share, Solution *solution)
{
    const Demand *demand = problem->demand;
    int m = demand->m;
    Row start, x;
    solution->rows = 0;
    if (demand->rows == 0 || norm(m, problem->reduction.start) == 0.0)
        return;
    moved(demand, problem->reduction.start, start);
    moved(demand, share->inside, x);
    for (int i = 0; i < demand->rows; i++) {
        double off = fabs(dot(m, demand->C[i], start));
        bool told = off > ACTIVE_TOLERANCE * norm(m, demand->C[i]) * fmax(SLOWEST, norm(m, x));
        solution->beside[i] = told ? off : 0.0;
        solution->rows = told ? demand->rows : solution->rows;
    }
}

/* report.py: the measured twist that joints can do at all, where they are fewer than six or rows come first. */
static const double *possible(const Posed *problem, double done[6])
{
    const Demand *demand = problem->demand;
    const Spectrum *found = &problem->spectrum;
    int m = demand->m, n = demand->rows > 0 ? problem->reduction.n : m;
    double rest[6];
    if (demand->rows == 0 && m >= 6)
        return problem->wanted;
    for (int i = 0; i < 6; i++) {
        done[i] = demand->rows > 0 ? dot(m, problem->A[i], problem->reduction.full) : 0.0;
        rest[i] = problem->wanted[i] - done[i];
    }
    for (int k = 0; k < (n < 6 ? n : 6); k++) {
        if (!(found->sigma[k] > NULL_RATIO * found->largest))
            continue;
        double along = dot(6, found->U[k], rest);
        for (int i = 0; i < 6; i++)
            done[i] += along * found->U[k][i];
    }
    return done;
}

Outcome answered(const Demand *demand, const Regular *regular, const Row A[6], const double wanted[6], Solution *solution)
{
    Posed problem;
    Objective cost;
    Optimum found;
    Share share;
    Room room;
    Row x, y, z, slowed;
    int m = demand->m;
    zeroed(slowed);
    found.met = share.near.met = false;
    solution->yielded.rows = 0;
    solution->yielded.speed = 0.0;
    share.value = 1.0;
    double blended, pace = 1.0, done[6];
    if (posed(demand, regular, A, wanted, &problem) == HAND_BACK ||
        objective(&problem, problem.attempt, problem.unchased, 1.0, &cost) == HAND_BACK)
        return HAND_BACK;
    centre(&cost, found.z);
    joints(&problem, found.z, 1.0, y);
    moved(demand, y, x);
    if (!all_finite(m, x))
        return HAND_BACK;
    const double *reachable = possible(&problem, done);
    bool blocked = demand->rows > 0 && problem.reduction.unmet > QP_ROUNDING;
    bool turns = demand->rows > 0 && excess_turn(&problem.reduction, m, demand->held, 1.0) > 0.0;
    bool free = !blocked && !turns && allows(demand, x);
    if (free)
        memcpy(share.inside, y, sizeof(Row));
    else if (roomy(&problem, &share, &solution->yielded) == HAND_BACK ||
             (demand->rows > 0 && objective(&problem, problem.attempt, problem.unchased, share.value, &cost) == HAND_BACK))
        return HAND_BACK;
    double mu = free ? calming(&problem, y, slowed, speed(&cost, found.z)) : 0.0;
    if (!free || mu > 0.0 || demand->form != NULL)
        room_at(&problem, &share, &room);
    if (!free) {
        if (share.near.met)
            found = share.near;
        if (within(&problem, &room, &cost, &found, y, slowed, &pace) == HAND_BACK)
            return HAND_BACK;
        free_part(&problem, y, share.value, z);
        mu = calming(&problem, y, slowed, speed(&cost, z));
    }
    if (mu > 0.0 && again(&problem, &room, &cost, pace, mu, &found, y) == HAND_BACK)
        return HAND_BACK;
    if (demand->form != NULL && guarded(&problem, &room, mu, y, &blended) == HAND_BACK)
        return HAND_BACK;
    solution->unmet = blocked ? problem.reduction.unmet : 0.0;
    solution->beyond = demand->rows > 0 && problem.reduction.beyond > QP_ROUNDING ? problem.reduction.beyond : 0.0;
    solution->row_rank = demand->row_rank;
    moved(demand, y, x);
    found.met = found.met || pace < 1.0;
    beside(&problem, &share, solution);
    return reported(demand, A, wanted, reachable, &cost, x, &share, pace, &found, demand->form == NULL ? 0.0 : blended, solution);
}
