/* Twin of legacy/damping.py, calm: damping that brings a loop to rest where its target is out of reach.

       mu = CALM / 2 dt (|b - A x| + max(0, 1/4 dt |A| |x|^2 - |b|)) |A| / worth */

#include "core.h"

/* What limits slow down on purpose, `slowed`, is no residual. */
double calm(int n, const Row A[6], const double wanted[6], const Row y, const Row slowed, double speed, double dt,
            double factor)
{
    double size = norm_of_rows(6, n, A), left[6];
    for (int i = 0; i < 6; i++)
        left[i] = wanted[i] - dot(n, A[i], y) - dot(n, A[i], slowed);
    double error = norm(6, left) + excess_deviation(n, A, wanted, speed, dt);
    return fmax(0.0, 0.5 * factor * dt * error * size - QP_ROUNDING * size * size);
}

/* Whether it is worth it to move the joints for a target, for joint twists on x. */
double worth(const Demand *demand, const Row A[6], const double wanted[6])
{
    double nearer = 0.0, sum = 0.0;
    for (int j = 0; j < demand->m && demand->chased && demand->paced; j++) {
        double pull = 0.0, square = 0.0, fastest = demand->fastest[j];
        for (int i = 0; i < 6; i++) {
            pull += wanted[i] * A[i][j];
            square += A[i][j] * A[i][j];
        }
        nearer += fmax(pull * fmax(demand->chase.lower[j], -fastest), pull * fmin(demand->chase.upper[j], fastest));
        sum += sqrt(square) * fastest;
    }
    double least = PROGRESS_SHARE * norm(6, wanted) * sum;
    if (nearer > least)
        return fmax(1.0 - least / nearer * (least / nearer), LEAST_WORTH);
    return least == 0.0 ? 1.0 : LEAST_WORTH;
}

double excess_deviation(int n, const Row A[6], const double wanted[6], double speed, double dt)
{
    double size = norm_of_rows(6, n, A);
    return fmax(0.0, DEVIATION_SHARE * dt * size * speed * speed - norm(6, wanted));
}
