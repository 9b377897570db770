/* Beside the search for nu in velocity/qp.py: a speed limit on a face, |start + M e| <= limit, by its one multiplier.

       minimise 1/2 |e|^2 + 1/2 nu |v|^2,  v = start + M e,  on the face,   nu >= 0 such that |v| = limit
       U S V' = M on the face:   U'v(nu) = (I + nu S S')^-1 U'v(0),   nu the root of one scalar equation */

#include "core.h"

static double velocity(const Slow *slow, int n, const Row e, double v[3])
{
    for (int i = 0; i < 3; i++)
        v[i] = slow->start[i] + dot(n, slow->M[i], e);
    return norm(3, v);
}

bool slow_enough(const Slow *slow, int n, const Row e, double tolerance)
{
    double v[3];
    return velocity(slow, n, e, v) <= slow->limit * (1.0 + tolerance);
}

/* nu with sum of squares / (1 + nu gain)^2 = limit^2, or `most` where that is larger. */
static double multiplier(const double gains[3], const double squares[3], double limit, double most)
{
    double nu = 0.0, wanted = limit * limit;
    for (int step = 0; step < NEWTON_STEPS; step++) {
        double square = 0.0, slope = 0.0;
        for (int i = 0; i < 3; i++) {
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

/* The optimum on the face of k orthonormal rows Q whose shortest e is too fast: e, and the gradient e + nu M'v there. */
Outcome slowed_on(const Slow *slow, int n, int k, const Row *Q, Row e, Row pull, double *nu)
{
    Row M[3];
    double v[3], gains[3], squares[3];
    Spectrum found;
    if (n < 3)
        return HAND_BACK;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < n; j++)
            M[i][j] = slow->M[i][j];
        along(n, k, Q, M[i]);
    }
    velocity(slow, n, e, v);
    if (spectrum(3, n, (const Row *)M, v, NULL, &found) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < 3; i++) {
        gains[i] = found.sigma[i] * found.sigma[i];
        squares[i] = found.wanted[i] * found.wanted[i];
    }
    *nu = multiplier(gains, squares, slow->limit, slow->most);
    for (int i = 0; i < 3; i++) {
        double step = *nu * found.sigma[i] * found.wanted[i] / (1.0 + *nu * gains[i]);
        for (int j = 0; j < n; j++)
            e[j] -= step * found.V[i][j];
    }
    velocity(slow, n, e, v);
    for (int j = 0; j < n; j++) {
        pull[j] = e[j];
        for (int i = 0; i < 3; i++)
            pull[j] += *nu * v[i] * slow->M[i][j];
    }
    return DONE;
}
