/* Twin of velocity/damping.py, calm: damping that brings a loop to rest where its target is out of reach.

       mu = CALM / 2 dt (|b - A x| + max(0, 1/4 dt |A| |x|^2 - |b|)) |A| */

#include "core.h"

/* What limits slow down on purpose, `slowed`, is no residual. */
double calm(int n, const Row A[6], const double wanted[6], const Row y, const Row slowed, double speed, double dt,
            double factor)
{
    double size = norm_of_rows(6, n, A), left[6];
    for (int i = 0; i < 6; i++)
        left[i] = wanted[i] - dot(n, A[i], y) - dot(n, A[i], slowed);
    double error = norm(6, left) + excess_deviation(n, A, wanted, speed, dt);
    return fmax(0.0, 0.5 * factor * dt * error * size - QUIET_SHARE * size * size);
}

double excess_deviation(int n, const Row A[6], const double wanted[6], double speed, double dt)
{
    double size = norm_of_rows(6, n, A);
    return fmax(0.0, DEVIATION_SHARE * dt * size * speed * speed - norm(6, wanted));
}
