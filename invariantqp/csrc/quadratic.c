/* Twin of velocity/qp.py: a convex quadratic inside limits.

       minimise 1/2 |e|^2   over   lower <= A z <= upper,   z = z* + T e
       on a set of active limits: the shortest e on it (active.c)
       a speed limit beside them (slow.c): first without it, then with it from the active set found

   T is the inverse of a root of the Hessian, so this is the point of a polytope nearest to e = 0. Python asks a solver
   for the active set first, here it begins with none; both then correct it until the shortest e on it is inside the
   other limits, with multipliers of the right sign. The problem is strictly convex, so both find the same. */

#include "qp.h"
#include <stdlib.h>
#include <string.h>

/* Corrections of the active set for each limit, at most, before the primal method takes over. */
#define CORRECTIONS 3
/* Where a limit is closer than this to the optimum without being active, or its multiplier beside a speed limit is a
   smaller share of the largest, Python might decide otherwise. */
static const double UNDECIDED = 1e-8;

/* The optimum on a face, with the speed limit where there is one, and the gradient and the limit's multiplier there. */
Outcome on_face(const Slow *slow, int n, Face *face, Row pull, double *nu)
{
    *nu = 0.0;
    for (int j = 0; j < n; j++)
        pull[j] = face->e[j];
    if (slow == NULL || slow_enough(slow, n, face->e, 0.0))
        return DONE;
    return slowed_on(slow, n, face->k, (const Row *)face->Q, face->e, pull, nu);
}

/* The shortest e inside, from a guess at its active set that is corrected; HAND_BACK where that does not end. */
static Outcome corrected(const Room *room, const Slow *slow, int *side, Face *face, double *y, double *nu)
{
    Row pull;
    if (face_of(room, side, face) == HAND_BACK)
        return HAND_BACK;
    for (int tried = 0; tried < CORRECTIONS * room->count; tried++) {
        if (on_face(slow, room->n, face, pull, nu) == HAND_BACK)
            return HAND_BACK;
        int worst = 0; /* i + 1 above its upper limit, -(i + 1) below the lower one */
        double outside = 0.0;
        for (int i = 0; i < room->count; i++) {
            if (side[i] != 0)
                continue;
            double value = dot(room->n, room->N[i], face->e), lower = room->lower[i], upper = room->upper[i];
            double by = value > upper ? value - upper : lower - value;
            if (by > outside && by - FEASIBLE * (1.0 + fmin(fabs(lower), fabs(upper))) > outside) {
                outside = by - FEASIBLE * (1.0 + fmin(fabs(lower), fabs(upper)));
                worst = value > upper ? i + 1 : -i - 1;
            }
        }
        if (worst != 0) {
            int i = abs(worst) - 1;
            side[i] = worst > 0 ? 1 : -1;
            if (joined(room, i, side[i], face) == HAND_BACK)
                return HAND_BACK;
            continue;
        }
        multipliers(face, room, pull, y);
        int wrong = weakest(room, face, pull, side, y, false);
        if (wrong < 0)
            return slow == NULL || slow_enough(slow, room->n, face->e, FEASIBLE) ? DONE : HAND_BACK;
        side[wrong] = 0;
        if (face_of(room, side, face) == HAND_BACK)
            return HAND_BACK;
    }
    return HAND_BACK;
}

/* The limits on e; rows that no e moves are left out, HAND_BACK where one of those is exceeded. */
static Outcome centred(const Quadratic *problem, const Polytope *limits, Room *room, int *of)
{
    int n = problem->n;
    double longest = 0.0, length[LIMITS];
    Row column = {0.0};
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            column[j] += problem->T[i][j] * problem->T[i][j];
    for (int j = 0; j < n; j++)
        column[j] = COSINE_ROUNDING * sqrt(column[j]);
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
            double rounding = length[i] * column[j], over = fabs(sum) - rounding;
            room->N[k][j] = over >= rounding ? sum : over > 0.0 ? over / rounding * sum : 0.0;
        }
        room->length[k] = norm(n, room->N[k]);
    }
    return DONE;
}

/* Polytope.on of velocity/qp.py: the same limits on z, x = origin + basis z; basis[i] is column i of n. */
void polytope_on(const Polytope *limits, int m, const Row origin, int n, const Row *basis, Polytope *result)
{
    result->count = limits->count;
    result->box = false;
    for (int i = 0; i < limits->count; i++) {
        double start = limits->box ? origin[i] : dot(m, limits->A[i], origin);
        for (int l = 0; l < n; l++)
            result->A[i][l] = limits->box ? basis[l][i] : dot(m, limits->A[i], basis[l]);
        result->lower[i] = limits->lower[i] - start;
        result->upper[i] = limits->upper[i] - start;
    }
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

/* The optimum by way of points inside the limits, from z = inside. */
static Outcome searched(const Quadratic *problem, const double *inside, const Room *room, const Slow *slow, int *side,
                        Face *face, double *y, double *nu)
{
    Row d, e;
    for (int j = 0; j < problem->n; j++)
        d[j] = inside[j] - problem->centre[j];
    for (int i = 0; i < problem->n; i++)
        e[i] = dot(problem->n, problem->K[i], d);
    return from_inside(room, slow, side, e, face, y, nu);
}

Outcome optimum_of(const Quadratic *problem, const Polytope *limits, const Cone *cone, const Row inside, const Optimum *near,
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
    found->met = found->undecided = false;
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
    if (corrected(&room, NULL, side, &face, y, &nu) == HAND_BACK &&
        searched(problem, inside, &room, NULL, side, &face, y, &nu) == HAND_BACK)
        return HAND_BACK;
    if (limited && !slow_enough(&slow, n, face.e, CONE_TOLERANCE) &&
        corrected(&room, &slow, side, &face, y, &nu) == HAND_BACK &&
        searched(problem, inside, &room, &slow, side, &face, y, &nu) == HAND_BACK)
        return HAND_BACK;
    double most = 0.0;
    for (int k = 0; k < room.count; k++)
        most = fmax(most, fabs(y[k]));
    found->nu = nu;
    found->met = nu > 0.0;
    for (int k = 0; k < room.count; k++) {
        double value = dot(n, room.N[k], face.e), least = fmin(room.upper[k] - value, value - room.lower[k]);
        double edge = UNDECIDED * (1.0 + fmin(fabs(room.lower[k]), fabs(room.upper[k])));
        found->undecided = found->undecided || (side[k] == 0 && isfinite(least) && least <= edge) ||
                           (nu > 0.0 && side[k] != 0 && fabs(y[k]) <= UNDECIDED * most);
        found->multipliers[of[k]] = y[k];
        found->met = found->met || y[k] != 0.0;
    }
    precise(problem, limits, of, side, &face, found->z);
    return all_finite(n, found->z) ? DONE : HAND_BACK;
}

/* The same; an optimum that Python might decide on otherwise is handed back. */
Outcome minimise(const Quadratic *problem, const Polytope *limits, const Cone *cone, const Row inside, const Optimum *near,
                 Optimum *found)
{
    Outcome outcome = optimum_of(problem, limits, cone, inside, near, found);
    return outcome == DONE && found->undecided ? HAND_BACK : outcome;
}

/* The minimiser inside limits; without the marks of `Optimum`, and so without Python's decisions on them. */
Outcome minimise_from(const Quadratic *problem, const Polytope *limits, const Row inside, Row z)
{
    int of[LIMITS], side[LIMITS] = {0};
    Room room;
    Face face;
    double y[LIMITS], nu;
    if (centred(problem, limits, &room, of) == HAND_BACK)
        return HAND_BACK;
    if (corrected(&room, NULL, side, &face, y, &nu) == HAND_BACK &&
        searched(problem, inside, &room, NULL, side, &face, y, &nu) == HAND_BACK)
        return HAND_BACK;
    precise(problem, limits, of, side, &face, z);
    return all_finite(problem->n, z) ? DONE : HAND_BACK;
}

/* The same in a box, which zero is in. */
Outcome minimise_in_box(const Quadratic *problem, const double *lower, const double *upper, Row z)
{
    static const Row STILL = {0.0};
    Polytope limits = {.count = problem->n, .box = true};
    memcpy(limits.lower, lower, (size_t)problem->n * sizeof(double));
    memcpy(limits.upper, upper, (size_t)problem->n * sizeof(double));
    if (minimise_from(problem, &limits, STILL, z) == HAND_BACK)
        return HAND_BACK;
    for (int j = 0; j < problem->n; j++)
        z[j] = between(z[j], lower[j], upper[j]);
    return DONE;
}
