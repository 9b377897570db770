/* Twin of velocity/qp/quadratic.py, active.py and primal.py: a convex quadratic inside limits.

       minimise 1/2 |e|^2   over   lower <= A z <= upper,   z = z* + T e
       on a set of active limits: the shortest e with N_a e = b_a,   N = A T,   e + N_a'y = 0
       a speed limit beside them (slow.c): first without it, then with it from the active set found

   T is the inverse of a root of the Hessian, so this is the point of a polytope nearest to e = 0. Python asks a solver
   for the active set first, here it begins with none; both then correct it until the shortest e on it is inside the
   other limits, with multipliers of the right sign. The problem is strictly convex, so both find the same. */

#include "core.h"
#include <stdlib.h>

/* Corrections of the active set for each limit, at most, before the primal method takes over. */
#define CORRECTIONS 3
/* A multiplier of the wrong sign by less than this share of |pull| / |N_i| is rounding. */
static const double WRONG_SIGN = 1e-13;
/* Where a limit is closer than this to the optimum without being active, or its multiplier beside a speed limit is a
   smaller share of the largest, Python might decide otherwise. */
static const double UNDECIDED = 1e-9;

/* Centred: lower <= N e <= upper. */
typedef struct {
    int n, count;
    Row N[LIMITS];
    double lower[LIMITS], upper[LIMITS], length[LIMITS];
} Room;

/* The e with N_a e = b_a; at[i] is a limit, N_a' = Q R by orthonormal rows Q[i]. */
typedef struct {
    int k, at[MOST];
    Row Q[MOST], R[MOST], e;
} Face;

/* The shortest e with N_a e = b. */
static void shortest(const Face *face, int n, const double *b, Row e)
{
    Row w;
    for (int j = 0; j < n; j++)
        e[j] = 0.0;
    for (int i = 0; i < face->k; i++) {
        w[i] = b[i];
        for (int l = 0; l < i; l++)
            w[i] -= face->R[l][i] * w[l];
        w[i] /= face->R[i][i];
        for (int j = 0; j < n; j++)
            e[j] += w[i] * face->Q[i][j];
    }
}

/* y with pull + N_a'y = 0 on the active limits, zero for the others. */
static void multipliers(const Face *face, const Room *room, const Row pull, double *y)
{
    Row w;
    for (int i = 0; i < room->count; i++)
        y[i] = 0.0;
    for (int i = face->k - 1; i >= 0; i--) {
        w[i] = -dot(room->n, face->Q[i], pull);
        for (int l = i + 1; l < face->k; l++)
            w[i] -= face->R[i][l] * w[l];
        w[i] /= face->R[i][i];
        y[face->at[i]] = w[i];
    }
}

/* HAND_BACK where the active rows depend on each other. */
static Outcome face_of(const Room *room, const int *side, Face *face)
{
    int n = room->n;
    Row bound;
    double least = INFINITY, most = 0.0;
    face->k = 0;
    for (int i = 0; i < room->count; i++) {
        if (side[i] == 0)
            continue;
        int k = face->k;
        if (k == n)
            return HAND_BACK;
        double *q = face->Q[k];
        for (int j = 0; j < n; j++)
            q[j] = room->N[i][j];
        for (int l = 0; l < k; l++)
            face->R[l][k] = 0.0;
        for (int twice = 0; twice < 2; twice++) /* the first time leaves rounding of N */
            for (int l = 0; l < k; l++) {
                double share = dot(n, face->Q[l], q);
                face->R[l][k] += share;
                for (int j = 0; j < n; j++)
                    q[j] -= share * face->Q[l][j];
            }
        double length = face->R[k][k] = norm(n, q);
        least = fmin(least, length);
        most = fmax(most, length);
        if (!(least > DEPENDENT * most))
            return HAND_BACK;
        for (int j = 0; j < n; j++)
            q[j] /= length;
        bound[k] = side[i] > 0 ? room->upper[i] : room->lower[i];
        face->at[k] = i;
        face->k++;
    }
    shortest(face, n, bound, face->e);
    return DONE;
}

/* The limit whose multiplier has the wrong sign by most; -1 for none. Late in a search the first one is taken (Bland's
   rule), so that no active set repeats. */
static int weakest(const Room *room, const Face *face, const Row pull, const int *side, const double *y, bool late)
{
    int found = -1;
    double most = 0.0, size = WRONG_SIGN * norm(room->n, pull);
    for (int k = 0; k < face->k; k++) {
        int i = face->at[k];
        double wrong = -side[i] * y[i];
        if (wrong * room->length[i] > size && wrong > most && (found < 0 || !late)) {
            most = wrong;
            found = i;
        }
    }
    return found;
}

/* The shortest e inside, from a guess at its active set that is corrected; HAND_BACK where that does not end. */
static Outcome corrected(const Room *room, const Slow *slow, int *side, Face *face, double *y, double *nu)
{
    Row pull;
    for (int tried = 0; tried < CORRECTIONS * room->count; tried++) {
        if (face_of(room, side, face) == HAND_BACK)
            return HAND_BACK;
        *nu = 0.0;
        for (int j = 0; j < room->n; j++)
            pull[j] = face->e[j];
        if (slow != NULL && !slow_enough(slow, room->n, face->e, 0.0) &&
            slowed_on(slow, room->n, face->k, (const Row *)face->Q, face->e, pull, nu) == HAND_BACK)
            return HAND_BACK;
        int worst = -1;
        double outside = 0.0;
        bool above = false;
        for (int i = 0; i < room->count; i++) {
            if (side[i] != 0)
                continue;
            double value = dot(room->n, room->N[i], face->e), lower = room->lower[i], upper = room->upper[i];
            double by = fmax(value - upper, lower - value) - FEASIBLE * (1.0 + fmin(fabs(lower), fabs(upper)));
            if (by > outside) {
                outside = by;
                worst = i;
                above = value > upper;
            }
        }
        if (worst >= 0) {
            side[worst] = above ? 1 : -1;
            continue;
        }
        multipliers(face, room, pull, y);
        int wrong = weakest(room, face, pull, side, y, false);
        if (wrong < 0)
            return slow == NULL || slow_enough(slow, room->n, face->e, FEASIBLE) ? DONE : HAND_BACK;
        side[wrong] = 0;
    }
    return HAND_BACK;
}

/* The same by steps that stay inside, from an e that is inside: every step shortens e or changes the set. */
static Outcome from_inside(const Room *room, int *side, Row e, Face *face, double *y)
{
    int n = room->n;
    for (int i = 0; i < room->count; i++)
        side[i] = 0;
    for (int count = 0; count < STEPS * room->count; count++) {
        if (face_of(room, side, face) == HAND_BACK)
            return HAND_BACK;
        Row step;
        for (int j = 0; j < n; j++)
            step[j] = face->e[j] - e[j];
        double first = 1.0, length = norm(n, step);
        int meets = 0;
        for (int i = 0; i < room->count; i++) {
            double change = dot(n, room->N[i], step), value = dot(n, room->N[i], e);
            if (side[i] != 0 || fabs(change) <= PARALLEL * room->length[i] * length)
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
        multipliers(face, room, face->e, y);
        int wrong = weakest(room, face, face->e, side, y, count > 2 * room->count);
        if (wrong < 0)
            return DONE;
        for (int j = 0; j < n; j++)
            e[j] = face->e[j];
        side[wrong] = 0;
    }
    return HAND_BACK;
}

/* The limits on e; rows that no e moves are left out, HAND_BACK where one of those is exceeded. */
static Outcome centred(const Quadratic *problem, const Polytope *limits, Room *room, int *of)
{
    int n = problem->n;
    double longest = 0.0, length[LIMITS];
    for (int i = 0; i < limits->count; i++) {
        length[i] = limits->box ? 1.0 : norm(n, limits->A[i]);
        longest = fmax(longest, length[i]);
    }
    room->n = n;
    room->count = 0;
    for (int i = 0; i < limits->count; i++) {
        double value = limits->box ? problem->centre[i] : dot(n, limits->A[i], problem->centre);
        double lower = limits->lower[i] - value, upper = limits->upper[i] - value;
        if (!(length[i] > ROW_TOLERANCE * longest)) {
            double size = (isfinite(lower) ? fabs(lower) : 0.0) + (isfinite(upper) ? fabs(upper) : 0.0);
            if (fmax(lower, -upper) > FEASIBLE * (1.0 + size))
                return HAND_BACK;
            continue;
        }
        int k = room->count++;
        of[k] = i;
        room->lower[k] = lower;
        room->upper[k] = upper;
        for (int j = 0; j < n; j++) {
            double sum = limits->box ? problem->T[i][j] : 0.0;
            for (int l = 0; l < n && !limits->box; l++)
                sum += limits->A[i][l] * problem->T[l][j];
            room->N[k][j] = sum;
        }
        room->length[k] = norm(n, room->N[k]);
    }
    return DONE;
}

/* z of the e on a face, on its active limits to rounding in z, whatever the condition of T. */
static void precise(const Quadratic *problem, const Polytope *limits, const int *of, const int *side,
                    const Face *face, Row z)
{
    int n = problem->n;
    Row missing = {0.0}, e;
    for (int j = 0; j < n; j++)
        z[j] = problem->centre[j] + dot(n, problem->T[j], face->e);
    for (int k = 0; k < face->k; k++) {
        int i = of[face->at[k]];
        double value = limits->box ? z[i] : dot(n, limits->A[i], z);
        missing[k] = (side[face->at[k]] > 0 ? limits->upper[i] : limits->lower[i]) - value;
    }
    shortest(face, n, missing, e);
    for (int j = 0; j < n; j++)
        z[j] += dot(n, problem->T[j], e);
}

/* cone.py: the speed limit on e, and the largest multiplier tried. */
static void slow_on(const Quadratic *problem, const Cone *cone, Slow *slow)
{
    int n = problem->n;
    double size = 0.0;
    slow->limit = cone->limit;
    for (int i = 0; i < 3; i++) {
        slow->start[i] = cone->start[i] + dot(n, cone->J[i], problem->centre);
        size += dot(n, cone->J[i], cone->J[i]);
        for (int j = 0; j < n; j++) {
            slow->M[i][j] = 0.0;
            for (int l = 0; l < n; l++)
                slow->M[i][j] += cone->J[i][l] * problem->T[l][j];
        }
    }
    double whole = norm_of_rows(n, n, problem->K);
    slow->most = size > 0.0 ? MOST_SHARE * whole * whole / size : 0.0;
}

Outcome minimise(const Quadratic *problem, const Polytope *limits, const Cone *cone, const Row inside, const Optimum *near,
                 Optimum *found)
{
    Slow slow;
    int n = problem->n, of[LIMITS], side[LIMITS];
    Room room;
    Face face;
    double y[LIMITS], guess[LIMITS];
    bool within = true;
    for (int i = 0; i < limits->count; i++) {
        guess[i] = near != NULL && near->met ? near->multipliers[i] : 0.0; /* near may be found itself */
        found->multipliers[i] = 0.0;
    }
    found->met = false;
    found->nu = 0.0;
    bool limited = cone->limit > 0.0;
    if (limited)
        slow_on(problem, cone, &slow);
    if (centred(problem, limits, &room, of) == HAND_BACK)
        return HAND_BACK;
    for (int k = 0; k < room.count; k++) {
        within = within && room.lower[k] <= 0.0 && room.upper[k] >= 0.0;
        side[k] = (guess[of[k]] > 0.0) - (guess[of[k]] < 0.0);
    }
    if (within) {
        for (int j = 0; j < n; j++)
            found->z[j] = problem->centre[j];
        if (!limited || tool_speed(cone, n, found->z) <= cone->limit * (1.0 + CONE_TOLERANCE))
            return DONE;
    }
    double nu = 0.0;
    if (corrected(&room, NULL, side, &face, y, &nu) == HAND_BACK) {
        Row e, d;
        for (int j = 0; j < n; j++)
            d[j] = inside[j] - problem->centre[j];
        for (int j = 0; j < n; j++)
            e[j] = dot(n, problem->K[j], d);
        if (from_inside(&room, side, e, &face, y) == HAND_BACK)
            return HAND_BACK;
    }
    if (limited && !slow_enough(&slow, n, face.e, CONE_TOLERANCE) &&
        corrected(&room, &slow, side, &face, y, &nu) == HAND_BACK) {
        for (int k = 0; k < room.count; k++)
            side[k] = 0;
        if (corrected(&room, &slow, side, &face, y, &nu) == HAND_BACK)
            return HAND_BACK;
    }
    double most = 0.0;
    for (int k = 0; k < room.count; k++)
        most = fmax(most, fabs(y[k]));
    found->nu = nu;
    found->met = nu > 0.0;
    for (int k = 0; k < room.count; k++) {
        double value = dot(n, room.N[k], face.e), least = fmin(room.upper[k] - value, value - room.lower[k]);
        double edge = UNDECIDED * (1.0 + fmin(fabs(room.lower[k]), fabs(room.upper[k])));
        if (side[k] == 0 && isfinite(least) && least <= edge)
            return HAND_BACK;
        if (nu > 0.0 && side[k] != 0 && fabs(y[k]) <= UNDECIDED * most)
            return HAND_BACK;
        found->multipliers[of[k]] = y[k];
        found->met = found->met || y[k] != 0.0;
    }
    precise(problem, limits, of, side, &face, found->z);
    return all_finite(n, found->z) ? DONE : HAND_BACK;
}
