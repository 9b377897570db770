/* Twin of legacy/qp.py: a convex quadratic inside limits.

       minimise 1/2 |e|^2   over   lower <= A z <= upper,   z = z* + T e
       on a set of active limits: the shortest e on it
       a speed limit beside them: first without it, then with it from the active set found

   T is the inverse of a root of the Hessian, so this is the point of a polytope nearest to e = 0. Python asks a solver
   for the active set first, here it begins with none; both then correct it until the shortest e on it is inside the
   other limits, with multipliers of the right sign. The problem is strictly convex, so both find the same. */

#include "core.h"
#include <stdlib.h>

/* Centred: lower <= N e <= upper. Rows of N and of a Face are zero after their n numbers, for steps. */
typedef struct {
    int n, count;
    const Row *N;
    const double *length;
    double lower[LIMITS], upper[LIMITS];
} Room;

/* Twin of Cone in velocity/limits.py: a speed limit |start + J x| <= limit. */

double tool_speed(const Cone *cone, int n, const Row x)
{
    double v[3];
    for (int i = 0; i < 3; i++)
        v[i] = cone->start[i] + dot(n, cone->J[i], x);
    return norm(3, v);
}

/* Twin of `product` in legacy/qp.py: what is only rounding of a row of T = (columns of these lengths, the longest of them apart) becomes zero. */
static void without_rounding(int n, double length, double longest, const Row columns, Row row)
{
    Row cosine;
    double least = INFINITY;
    for (int j = 0; j < n; j++)
        least = fabs(row[j]) < least ? fabs(row[j]) : least;
    if (least >= 2.0 * PRODUCT_ROUNDING * length * longest)
        return;
    for (int j = 0; j < n; j++)
        cosine[j] = row[j] / (length * columns[j] + TINY);
    for (int j = 0; j < n; j++) {
        double square = 0.0;
        for (int l = 0; l < n; l++)
            if (fabs(columns[l] - columns[j]) <= QP_ROUNDING * columns[j])
                square += cosine[l] * cosine[l];
        row[j] *= between(sqrt(square) / PRODUCT_ROUNDING - 1.0, 0.0, 1.0);
    }
}

/* Those lengths, and the longest. */
static double lengths_of(int m, int n, const Row *basis, Row lengths)
{
    double longest = 0.0;
    for (int l = 0; l < n; l++) {
        lengths[l] = norm(m, basis[l]);
        longest = lengths[l] > longest ? lengths[l] : longest;
    }
    return longest;
}

/* The same on z, x = origin + basis z; basis[i] is column i of n. */
void cone_on(const Cone *cone, int m, const Row origin, int n, const Row *basis, Cone *result)
{
    Row lengths;
    double longest = lengths_of(m, n, basis, lengths);
    result->limit = cone->limit;
    for (int i = 0; i < 3; i++) {
        Row row;
        for (int l = 0; l < n; l++)
            row[l] = dot(m, cone->J[i], basis[l]);
        without_rounding(n, norm(m, cone->J[i]), longest, lengths, row);
        result->start[i] = cone->start[i] + dot(m, cone->J[i], origin);
        memcpy(result->J[i], row, (size_t)n * sizeof(double));
    }
}

/* Beside the search for nu in Python: a speed limit on a face, |start + M e| <= limit, by its one multiplier.

       minimise 1/2 |e|^2 + 1/2 nu |v|^2,  v = start + M e,  on the face,   nu >= 0 such that |v| = limit
       U S V' = M on the face:   U'v(nu) = (I + nu S S')^-1 U'v(0),   nu the root of one scalar equation */

static double velocity(const Slow *slow, int n, const Row e, double v[3])
{
    for (int i = 0; i < 3; i++)
        v[i] = slow->start[i] + dot(n, slow->M[i], e);
    return norm(3, v);
}

static bool slow_enough(const Slow *slow, int n, const Row e, double tolerance)
{
    double v[3];
    return velocity(slow, n, e, v) <= slow->limit * (1.0 + tolerance);
}

/* A row without its parts along k orthonormal ones, which would move an active limit. */
static void along(int n, int k, const Row *Q, Row row)
{
    for (int twice = 0; twice < 2; twice++) /* the first time leaves rounding of the row */
        for (int l = 0; l < k; l++) {
            double share = dot(n, Q[l], row);
            for (int j = 0; j < n; j++)
                row[j] -= share * Q[l][j];
        }
    for (int j = 0; j < n && k == n; j++)
        row[j] = 0.0;
}

/* nu with sum of squares / (1 + nu gain)^2 = limit^2, or `most` where that is larger. */
static double multiplier(const double gains[4], const double squares[4], double limit, double most)
{
    double nu = 0.0, wanted = limit * limit;
    for (int step = 0; step < NEWTON_STEPS; step++) {
        double square = 0.0, slope = 0.0;
        for (int i = 0; i < 4; i++) {
            double shrink = 1.0 + nu * gains[i], shrunk = squares[i] / (shrink * shrink);
            square += shrunk;
            slope += shrunk * gains[i] / shrink;
        }
        if (square <= wanted)
            break;
        if (slope <= 0.0)
            return most;
        double ahead = square / slope * (sqrt(square) / limit - 1.0); /* Newton on 1 / |v|: it never overshoots */
        nu += ahead;
        if (!(nu <= most))
            return most;
        if (ahead <= 2.220446049250313e-16 * nu)
            break;
    }
    return nu;
}

/* The optimum on the face of k orthonormal rows Q whose shortest e is too fast: e, and the gradient e + nu M'v there along
   each of them. */
static Outcome slowed_on(Slow *slow, int n, int k, const Row *Q, Row e, Row pull, double *nu)
{
    Row M[3], gradient;
    double v[3], left[3], along_u[3], *gains = slow->gains, squares[4] = {0.0};
    int rank = 0;
    Spectrum found;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < n; j++)
            M[i][j] = slow->M[i][j];
        along(n, k, Q, M[i]);
    }
    velocity(slow, n, e, v);
    if (spectrum(3, n, (const Row *)M, NULL, NULL, &found) == HAND_BACK)
        return HAND_BACK;
    memcpy(left, v, sizeof left); /* by U: what no direction changes is small beside |v|, and the difference of squares rounding */
    for (; rank < 3 && rank < n && found.sigma[rank] > NULL_RATIO * found.sigma[0]; rank++) {
        along(n, k, Q, found.V[rank]); /* the weakest is told to rounding of the strongest */
        along_u[rank] = dot(3, found.U[rank], v);
        gains[rank] = found.sigma[rank] * found.sigma[rank];
        squares[rank] = along_u[rank] * along_u[rank];
        for (int i = 0; i < 3; i++)
            left[i] -= along_u[rank] * found.U[rank][i];
    }
    squares[rank] = rank < 3 ? dot(3, left, left) : 0.0;
    for (int i = rank; i < 4; i++)
        gains[i] = 0.0;
    memcpy(slow->V, found.V, sizeof slow->V);
    slow->rank = rank;
    *nu = multiplier(gains, squares, slow->limit, slow->most);
    for (int i = 0; i < rank; i++) {
        double step = *nu * found.sigma[i] * along_u[i] / (1.0 + *nu * gains[i]);
        for (int j = 0; j < n; j++)
            e[j] -= step * found.V[i][j];
    }
    velocity(slow, n, e, v);
    for (int j = 0; j < n; j++) {
        gradient[j] = e[j];
        for (int i = 0; i < 3; i++)
            gradient[j] += *nu * v[i] * slow->M[i][j];
    }
    for (int l = 0; l < k; l++)
        pull[l] = dot(n, Q[l], gradient);
    return DONE;
}

/* Where Python asks a solver: the shortest e on a set of active limits, N_a e = b_a, and their multipliers.

       e + N_a'y = 0,   y > 0 at an upper limit, y < 0 at a lower one */

/* A multiplier of the wrong sign by less than this share of |pull| is rounding. */
static const double WRONG_SIGN = 1e-13;
/* A row that others leave so much of is orthogonal to them to a few roundings (Kahan's criterion). */
static const double NEARLY_WHOLE = 0.1;
/* A limit exceeded by less than this share of the terms of its row, and of itself, is rounding. */
static const double EXCEEDED = 1e-13;
/* Those terms are at most so many |e|, but for what the limit is exceeded by. */
static const double SURELY = 4.0;

/* The shortest e with N_a e = b. */
static void shortest(const Face *face, int n, const double *b, Row e)
{
    Row w;
    for (int i = 0; i < face->k; i++)
        w[i] = (b[i] - dot(i, face->R[i], w)) * face->over[i];
    combined(n, face->k, w, 1, (const Row *)face->Q, e);
}

/* w becomes R^-1 w. */
static inline void upwards(const Face *face, Row w)
{
    for (int i = face->k - 1; i >= 0; i--) {
        w[i] *= face->over[i];
        for (int l = 0; l < i; l++)
            w[l] -= face->R[i][l] * w[i];
    }
}

/* y with Q'pull + Q'N_a'y = 0 on the active limits, zero for the others. */
static void multipliers(const Face *face, const Room *room, const Row pull, double *y)
{
    Row w;
    for (int i = 0; i < room->count; i++)
        y[i] = 0.0;
    for (int i = 0; i < face->k; i++)
        w[i] = -pull[i];
    upwards(face, w);
    for (int i = 0; i < face->k; i++)
        y[face->at[i]] = w[i];
}

/* The part of a limit's row beyond a face, of length one, as its next row; how long it was, 0 where the row depends on those
   before it. */
static double beyond(const Room *room, int i, Face *face)
{
    int k = face->k, n = room->n;
    if (k == n)
        return 0.0;
    const Row *Q = (const Row *)face->Q;
    Row rest;
    double *parts = face->R[k], *q = face->Q[k];
    memcpy(q, room->N[i], sizeof(Row));
    double length = k == 0 ? 1.0 : left_of(n, k, Q, q, parts);
    if (length <= NEARLY_WHOLE) {
        length = left_of(n, k, Q, q, rest);
        for (int l = 0; l < k; l++)
            parts[l] += rest[l];
    }
    face->least[k] = k > 0 && face->least[k - 1] < length ? face->least[k - 1] : length;
    face->most[k] = k > 0 && face->most[k - 1] > length ? face->most[k - 1] : length;
    if (!(face->least[k] > DEPENDENT * face->most[k]))
        return 0.0;
    double over = face->over[k] = 1.0 / length;
    parts[k] = length;
    scaled(n, over, q);
    return length;
}

/* A face with its next row, of limit i. */
static void with_next(const Room *room, int i, int side, Face *face)
{
    int k = face->k++;
    double bound = side > 0 ? room->upper[i] : room->lower[i];
    face->at[k] = i;
    face->w[k] = (bound - dot(k, face->R[k], face->w)) * face->over[k];
    add_in_steps(room->n, face->w[k], face->Q[k], face->e);
}

/* The face of all active limits, from another one, which stays as far as the same limits are active. Limits that depend on
   those before them are active no more; whether there are none. */
static bool face_of(const Room *room, int *side, Face *face)
{
    int k = face->k;
    bool on[LIMITS] = {false}, all = true;
    face->k = 0;
    zeroed(face->e);
    for (int l = 0; l < k && side[face->at[l]] != 0; l++) {
        on[face->at[l]] = true;
        with_next(room, face->at[l], side[face->at[l]], face);
    }
    for (int i = 0; i < room->count; i++) {
        if (side[i] == 0 || on[i])
            continue;
        if (beyond(room, i, face) > 0.0)
            with_next(room, i, side[i], face);
        else
            side[i] = all = 0;
    }
    return all;
}

/* The limit whose multiplier has the wrong sign by most; -1 for none. Late in a search the first one is taken (Bland's
   rule), so that no active set repeats. */
static int weakest(const Face *face, const Row pull, const int *side, const double *y, bool late)
{
    int found = -1;
    double most = 0.0, size = WRONG_SIGN * norm(face->k, pull);
    for (int k = 0; k < face->k; k++) {
        int i = face->at[k];
        double wrong = -side[i] * y[i];
        if (wrong > size && (found < 0 || (late ? i < found : wrong > most))) {
            most = wrong;
            found = i;
        }
    }
    return found;
}

/* The optimum on a face, with the speed limit where there is one, the gradient there along Q, and the limit's multiplier. */
static Outcome on_face(Slow *slow, int n, Face *face, Row pull, double *nu)
{
    *nu = 0.0;
    memcpy(pull, face->w, sizeof(Row));
    if (slow == NULL)
        return DONE;
    combined(n, face->k, face->w, 1, (const Row *)face->Q, face->e);
    if (slow_enough(slow, n, face->e, 0.0))
        return DONE;
    return slowed_on(slow, n, face->k, (const Row *)face->Q, face->e, pull, nu);
}

/* Where Python asks a solver: the shortest e inside limits, from one that is inside. */

/* Every step stays inside, and shortens e or changes the set of active limits; face->e is the answer. */
static Outcome from_inside(const Room *room, Slow *slow, int *side, Row e, Face *face, double *y, double *nu)
{
    int n = room->n;
    Row pull;
    for (int i = 0; i < room->count; i++)
        side[i] = 0;
    for (int count = 0; count < STEPS * room->count; count++) {
        if (!face_of(room, side, face) || on_face(slow, n, face, pull, nu) == HAND_BACK)
            return HAND_BACK;
        Row step;
        for (int j = 0; j < n; j++)
            step[j] = face->e[j] - e[j];
        along(n, face->k, (const Row *)face->Q, step); /* the rest is rounding, and would meet rows that depend on these */
        double first = 1.0; /* how much the active rows leave of each other tells how well their step is known */
        double least = face->k > 0 ? face->least[face->k - 1] : 1.0;
        double rounding = fmax(QP_ROUNDING, PRODUCT_ROUNDING / least) * norm(n, step);
        int meets = 0;
        for (int i = 0; i < room->count; i++) {
            double change = dot(n, room->N[i], step), value = dot(n, room->N[i], e);
            if (side[i] != 0 || fabs(change) <= rounding)
                continue;
            double share = ((change > 0.0 ? room->upper[i] : room->lower[i]) - value) / change;
            if (share < first) {
                first = share;
                meets = change > 0.0 ? i + 1 : -i - 1;
            }
        }
        if (meets != 0) {
            for (int j = 0; j < n; j++)
                e[j] += fmax(0.0, first) * step[j];
            side[abs(meets) - 1] = meets > 0 ? 1 : -1;
            continue;
        }
        multipliers(face, room, pull, y);
        int wrong = weakest(face, pull, side, y, count > 2 * room->count);
        if (wrong < 0)
            return slow == NULL || slow_enough(slow, n, face->e, QP_ROUNDING) ? DONE : HAND_BACK;
        for (int j = 0; j < n; j++)
            e[j] = face->e[j];
        side[wrong] = 0;
    }
    return HAND_BACK;
}

/* The optimum, from a guess at the active set. */

/* Corrections of the active set for each limit, at most, before the primal method takes over. */
#define CORRECTIONS 3

/* What of a limit's excess at e is rounding. */
static double rounding_of(const Room *room, int i, const Row e)
{
    double terms = fmin(fabs(room->lower[i]), fabs(room->upper[i]));
    for (int j = 0; j < room->n; j++)
        terms += fabs(room->N[i][j] * e[j]);
    return EXCEEDED * terms;
}

/* The limit that z is farthest outside of, and e by how much: i + 1 above its upper one, -(i + 1) below the lower one, 0 for
   none. n is that of the rows, or more. */
static inline int farthest(int n, const Room *room, const int *side, const Row e, double *outside)
{
    double size = sqrt(dot_in_steps(n, e, e)), most = 0.0;
    int worst = 0;
    for (int i = 0; i < room->count; i++) {
        if (side[i] != 0)
            continue;
        double value = dot_in_steps(n, room->N[i], e);
        double over = value - room->upper[i], under = room->lower[i] - value, by = over > under ? over : under;
        if (room->length[i] * by > most && (by > SURELY * EXCEEDED * size || by > rounding_of(room, i, e))) {
            most = room->length[i] * by;
            *outside = by;
            worst = over > under ? i + 1 : -i - 1;
        }
    }
    return worst;
}

/* A limit that is exceeded `by` so much becomes active, others leave as their multipliers y reach zero on the way, which y
   follows (Goldfarb and Idnani 1983); HAND_BACK where all of them together leave nothing inside. */
static Outcome entered(const Room *room, int i, int sign, double by, int *side, Face *face, double *y)
{
    for (;;) {
        double length = beyond(room, i, face), first = length > 0.0 ? by / (length * length) : INFINITY;
        int k = face->k, leaves = -1;
        Row r;
        for (int l = 0; l < k; l++) /* N_i = r'N_a + what is beyond */
            r[l] = k < room->n ? face->R[k][l] : dot(room->n, face->Q[l], room->N[i]);
        upwards(face, r);
        for (int l = 0; l < k; l++) {
            double rate = sign * r[l], price = y[face->at[l]];
            if (side[face->at[l]] * rate > 0.0 && side[face->at[l]] * (price - first * rate) < 0.0) {
                double share = price / rate;
                first = share > 0.0 ? share : 0.0;
                leaves = l;
            }
        }
        if (leaves < 0 && !(length > 0.0))
            return HAND_BACK;
        for (int l = 0; l < k; l++)
            y[face->at[l]] -= first * sign * r[l];
        y[i] += first * sign;
        if (leaves < 0) {
            side[i] = sign;
            with_next(room, i, sign, face);
            return DONE;
        }
        by -= first * length * length;
        side[face->at[leaves]] = 0;
        y[face->at[leaves]] = 0.0;
        face_of(room, side, face);
    }
}

/* The shortest e inside, from a guess at its active set that is corrected; HAND_BACK where that does not end. */
static Outcome corrected(const Room *room, Slow *slow, int *side, Face *face, double *y, double *nu)
{
    Row pull;
    face_of(room, side, face);
    for (int i = 0; i < room->count; i++)
        y[i] = 0.0;
    /* Whether y was only followed from the last face, where all had the right sign; at first from none. */
    bool inside = false, followed = slow == NULL && face->k == 0;
    for (int tried = 0; tried < CORRECTIONS * room->count; tried++) {
        if (!followed) {
            if (on_face(slow, room->n, face, pull, nu) == HAND_BACK)
                return HAND_BACK;
            multipliers(face, room, pull, y);
            int wrong = weakest(face, pull, side, y, false);
            if (wrong >= 0) {
                side[wrong] = 0;
                face_of(room, side, face);
                inside = false;
                continue;
            }
            if (inside)
                return DONE;
        }
        double outside;
        int worst = room->n <= 2 * STEP ? farthest(2 * STEP, room, side, face->e, &outside) : farthest(MOST, room, side, face->e, &outside);
        if (worst == 0 && !followed)
            return slow == NULL || slow_enough(slow, room->n, face->e, QP_ROUNDING) ? DONE : HAND_BACK;
        int i = abs(worst) - 1;
        if (worst != 0 && entered(room, i, worst > 0 ? 1 : -1, outside, side, face, y) == HAND_BACK)
            return HAND_BACK;
        inside = worst == 0;
        followed = !inside && slow == NULL;
    }
    return HAND_BACK;
}

/* The rows of limits on e, which do not depend on the centre. */
static void turned_by(const Quadratic *problem, const Polytope *limits, Turned *turned)
{
    int n = problem->n;
    Row columns;
    double longest = lengths_of(n, n, problem->T, columns);
    turned->rows = limits->count;
    turned->face.k = 0;
    for (int i = 0; i < limits->count; i++)
        zeroed(turned->N[i]);
    for (int i = 0; i < limits->count; i++) {
        double *row = turned->N[i];
        if (limits->box)
            for (int j = 0; j < n; j++)
                row[j] = problem->T[j][i];
        else
            for (int j = 0; j < n; j++)
                row[j] = dot(n, limits->A[i], problem->T[j]);
        without_rounding(n, limits->box ? 1.0 : norm(n, limits->A[i]), longest, columns, row);
        double length = turned->length[i] = sqrt(dot_in_steps(n, row, row)), over = length > 0.0 ? 1.0 / length : 0.0;
        scaled(n, over, row);
    }
}

/* The limits on e; rows that no e moves limit nothing, HAND_BACK where one of those is exceeded. */
static Outcome centred(const Quadratic *problem, const Polytope *limits, const Turned *turned, Room *room)
{
    room->n = problem->n;
    room->count = limits->count;
    room->N = (const Row *)turned->N;
    room->length = turned->length;
    for (int i = 0; i < limits->count; i++) {
        double value = limits->box ? problem->centre[i] : dot(problem->n, limits->A[i], problem->centre);
        double lower = limits->lower[i] - value, upper = limits->upper[i] - value, over = 1.0 / turned->length[i];
        bool still = !(turned->length[i] > 0.0);
        if (still && fmax(lower, -upper) > limits->rounding[i])
            return HAND_BACK;
        room->lower[i] = still ? -INFINITY : lower * over;
        room->upper[i] = still ? INFINITY : upper * over;
    }
    return DONE;
}

/* Polytope.on of legacy/qp.py: the same limits on z, x = origin + basis z; basis[i] is column i of n. */
void polytope_on(const Polytope *limits, int m, const Row origin, const Row inside, int n, const Row *basis, Polytope *result)
{
    double size = QP_ROUNDING * norm(m, inside);
    Row lengths;
    double longest = lengths_of(m, n, basis, lengths);
    result->count = limits->count;
    result->box = false;
    for (int i = 0; i < limits->count; i++) {
        double start = limits->box ? origin[i] : dot(m, limits->A[i], origin);
        for (int l = 0; l < n; l++)
            result->A[i][l] = limits->box ? basis[l][i] : dot(m, limits->A[i], basis[l]);
        double length = limits->box ? 1.0 : norm(m, limits->A[i]);
        without_rounding(n, length, longest, lengths, result->A[i]);
        result->lower[i] = limits->lower[i] - start;
        result->upper[i] = limits->upper[i] - start;
        result->rounding[i] = limits->rounding[i] + size * length;
    }
}

/* z of the e on a face, on its active limits to rounding in z, whatever the condition of T. */
static void precise(const Quadratic *problem, const Polytope *limits, const Room *room, const int *side, const Face *face,
                    Row z)
{
    int n = problem->n;
    Row missing, e, more;
    combined(n, n, face->e, 1, problem->T, z);
    add_in_steps(n, 1.0, problem->centre, z);
    for (int k = 0; k < face->k; k++) {
        int i = face->at[k];
        double value = limits->box ? z[i] : dot(n, limits->A[i], z);
        missing[k] = ((side[face->at[k]] > 0 ? limits->upper[i] : limits->lower[i]) - value) / room->length[face->at[k]];
    }
    shortest(face, n, missing, e);
    combined(n, n, e, 1, problem->T, more);
    add_in_steps(n, 1.0, more, z);
}

/* legacy/qp.py, minimise: the same at an active speed limit. The speed and the pull of z have digits that those of e have
   lost, so a step of Newton's finds z, its multiplier, and the gradient along Q once more. */
static void refined(const Quadratic *problem, const Cone *cone, const Slow *slow, const Face *face, Row z, Row pull, double *nu)
{
    int n = problem->n;
    const Row *Q = (const Row *)face->Q;
    Row d, left[2]; /* what is left of the gradient on the face, and how the speed limit pulls there */
    double v[3], part[2];
    for (int twice = 0; twice < 2; twice++) {
        for (int i = 0; i < 3; i++)
            v[i] = cone->start[i] + dot(n, cone->J[i], z);
        for (int j = 0; j < n; j++)
            d[j] = z[j] - problem->centre[j];
        for (int j = 0; j < n; j++) {
            left[1][j] = v[0] * slow->M[0][j] + v[1] * slow->M[1][j] + v[2] * slow->M[2][j];
            left[0][j] = dot(n, problem->K[j], d) + *nu * left[1][j];
        }
        for (int l = 0; l < face->k; l++)
            pull[l] = dot(n, Q[l], left[0]);
        for (int i = 0; i < 2; i++)
            along(n, face->k, Q, left[i]);
        memcpy(d, left[1], sizeof d);
        for (int i = 0; i < 2; i++) {
            for (int l = 0; l < slow->rank; l++) {
                double share = *nu * slow->gains[l] / (1.0 + *nu * slow->gains[l]) * dot(n, slow->V[l], left[i]);
                for (int j = 0; j < n; j++)
                    left[i][j] -= share * slow->V[l][j];
            }
            part[i] = dot(n, d, left[i]);
        }
        double speed = norm(3, v), more = part[1] > 0.0 ? (speed * (speed - cone->limit) - part[0]) / part[1] : 0.0;
        if (twice == 0)
            *nu += more;
        for (int j = 0; j < n; j++)
            add_in_steps(n, -left[0][j] - more * left[1][j], problem->T[j], z);
    }
}

/* Whether z is inside all limits but for rounding of what exact rows fix, and of terms of this size of which z is the sum. */
static bool inside_but(const Polytope *limits, int n, double size, const Row z)
{
    for (int i = 0; i < limits->count; i++) {
        double value = limits->box ? z[i] : dot(n, limits->A[i], z), length = limits->box ? 1.0 : norm(n, limits->A[i]);
        double margin = QP_ROUNDING * length * size + limits->rounding[i];
        if (!(value >= limits->lower[i] - margin && value <= limits->upper[i] + margin))
            return false;
    }
    return true;
}

bool inside_limits(const Polytope *limits, int n, const Row z) { return inside_but(limits, n, norm(n, z), z); }

/* legacy/qp.py, _kept: the z found or, where rounding has it outside, the last one inside on the way there from one that is. */
static Outcome kept(const Quadratic *problem, const Polytope *limits, const Row inside, Row z)
{
    int n = problem->n;
    if (inside_limits(limits, n, z))
        return DONE;
    if (!inside_but(limits, n, norm(n, z) + norm(n, problem->centre), z))
        return HAND_BACK;
    for (int twice = 0; twice < 2 && !inside_limits(limits, n, z); twice++) { /* the first cut may make z much shorter */
        Row way;
        double size = norm(n, z), part = 1.0;
        for (int j = 0; j < n; j++)
            way[j] = z[j] - inside[j];
        for (int i = 0; i < limits->count; i++) {
            double on = limits->box ? way[i] : dot(n, limits->A[i], way), value = limits->box ? z[i] : dot(n, limits->A[i], z);
            double margin = QP_ROUNDING * (limits->box ? 1.0 : norm(n, limits->A[i])) * size + limits->rounding[i];
            double over = value - limits->upper[i], under = limits->lower[i] - value;
            if (over > margin || under > margin)
                part = fmin(part, on != 0.0 ? between(1.0 - (fmax(over, under) - 0.5 * margin) / fabs(on), 0.0, 1.0) : 0.0);
        }
        for (int j = 0; j < n; j++)
            z[j] = inside[j] + part * way[j];
    }
    return DONE;
}

/* legacy/qp.py: the speed limit on e, and the largest multiplier tried. */
static void slow_on(const Quadratic *problem, const Cone *cone, Slow *slow)
{
    int n = problem->n;
    Row columns;
    double size = 0.0, longest = lengths_of(n, n, problem->T, columns);
    slow->limit = cone->limit;
    for (int i = 0; i < 3; i++) {
        slow->start[i] = cone->start[i] + dot(n, cone->J[i], problem->centre);
        size += dot(n, cone->J[i], cone->J[i]);
        for (int j = 0; j < n; j++)
            slow->M[i][j] = dot(n, cone->J[i], problem->T[j]);
        without_rounding(n, norm(n, cone->J[i]), longest, columns, slow->M[i]);
    }
    double whole = norm_of_rows(n, n, problem->K);
    slow->most = size > 0.0 ? MOST_SHARE * whole * whole / size : 0.0;
}

/* The optimum by way of points inside the limits, from z = inside. */
static Outcome searched(const Quadratic *problem, const double *inside, const Room *room, Slow *slow, int *side,
                        Face *face, double *y, double *nu)
{
    Row d, e;
    for (int j = 0; j < problem->n; j++)
        d[j] = inside[j] - problem->centre[j];
    for (int i = 0; i < problem->n; i++)
        e[i] = dot(problem->n, problem->K[i], d);
    return from_inside(room, slow, side, e, face, y, nu);
}

/* The minimiser inside limits and its multipliers; `near` has limits that are likely to be active, `inside` is one point. */
Outcome minimise(const Quadratic *problem, const Polytope *limits, const Cone *cone, const Row inside, const Optimum *near,
                 Optimum *found)
{
    Turned turned;
    turned.rows = 0;
    return minimise_turned(problem, limits, cone, inside, near, &turned, found);
}

/* The same where `turned` is of another centre and other bounds, or of no rows yet. */
Outcome minimise_turned(const Quadratic *problem, const Polytope *limits, const Cone *cone, const Row inside, const Optimum *near,
                        Turned *turned, Optimum *found)
{
    Slow slow;
    int n = problem->n, side[LIMITS];
    Room room;
    Face *face = &turned->face;
    double y[LIMITS], guess[LIMITS];
    bool limited = cone->limit > 0.0, within = !limited || tool_speed(cone, n, problem->centre) <= cone->limit * (1.0 + QP_ROUNDING);
    for (int i = 0; i < limits->count; i++) {
        double value = limits->box ? problem->centre[i] : dot(n, limits->A[i], problem->centre);
        within = within && value >= limits->lower[i] && value <= limits->upper[i];
        guess[i] = near != NULL && near->met ? near->multipliers[i] : 0.0; /* near may be found itself */
        found->multipliers[i] = 0.0;
    }
    found->met = false;
    found->nu = 0.0;
    if (within) {
        memcpy(found->z, problem->centre, (size_t)n * sizeof(double));
        face->k = 0;
        return DONE;
    }
    if (limited)
        slow_on(problem, cone, &slow);
    if (turned->rows == 0)
        turned_by(problem, limits, turned);
    if (centred(problem, limits, turned, &room) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < room.count; i++)
        side[i] = room.length[i] > 0.0 ? (guess[i] > 0.0) - (guess[i] < 0.0) : 0;
    double nu = 0.0;
    if (corrected(&room, NULL, side, face, y, &nu) == HAND_BACK &&
        searched(problem, inside, &room, NULL, side, face, y, &nu) == HAND_BACK)
        return HAND_BACK;
    if (limited && !slow_enough(&slow, n, face->e, QP_ROUNDING) &&
        corrected(&room, &slow, side, face, y, &nu) == HAND_BACK &&
        searched(problem, inside, &room, &slow, side, face, y, &nu) == HAND_BACK)
        return HAND_BACK;
    precise(problem, limits, &room, side, face, found->z);
    if (nu > 0.0) {
        Row pull;
        refined(problem, cone, &slow, face, found->z, pull, &nu);
        multipliers(face, &room, pull, y);
    }
    found->nu = nu;
    found->met = nu > 0.0;
    for (int i = 0; i < room.count; i++) {
        found->multipliers[i] = y[i] != 0.0 ? y[i] / room.length[i] : 0.0;
        found->met = found->met || y[i] != 0.0;
    }
    return kept(problem, limits, inside, found->z);
}

/* The same without a speed limit and without multipliers. */
Outcome minimise_from(const Quadratic *problem, const Polytope *limits, const Row inside, Row z)
{
    static const Cone NONE = {.limit = 0.0};
    Optimum found;
    if (minimise(problem, limits, &NONE, inside, NULL, &found) == HAND_BACK)
        return HAND_BACK;
    memcpy(z, found.z, (size_t)problem->n * sizeof(double));
    return DONE;
}
