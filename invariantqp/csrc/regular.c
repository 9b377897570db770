/* Where the joints can move the tool in all six directions, far from singular, and no limit acts: one Cholesky factor.

       x = x_p + A'(AA')^-1 (b - A x_p),      AA' = LL'
       sigma_min^2 >= 1 / |(AA')^-1|,         sigma_max^2 <= |AA'| */

#include "core.h"

bool regular_velocity(const Demand *demand, const Row A[6], const double b[6], Row x)
{
    int n = demand->m;
    if (n < 6 || demand->speed > 0.0)
        return false;
    Row L[6];
    double y[6], squares = 0.0, inverse_squares = 0.0;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j <= i; j++) {
            double entry = dot(n, A[i], A[j]);
            squares += (i == j ? 1.0 : 2.0) * entry * entry;
            L[i][j] = entry;
        }
    if (!factored(6, L))
        return false;
    /* trace (AA')^-1 = |L^-1|^2 bounds its norm. */
    for (int j = 0; j < 6; j++) {
        double column[6];
        for (int i = j; i < 6; i++) {
            double sum = i == j ? 1.0 : 0.0;
            for (int k = j; k < i; k++)
                sum -= L[i][k] * column[k];
            column[i] = sum / L[i][i];
            inverse_squares += column[i] * column[i];
        }
    }
    double smallest = 1.0 / inverse_squares, largest = sqrt(squares);
    double share = demand->threshold > ACCURATE_SHARE ? demand->threshold : ACCURATE_SHARE;
    if (!(smallest >= share * share * largest))
        return false;
    double pace = demand->has_posture ? 1.0 : 0.0;
    if (demand->has_posture && demand->paced) { /* tick.py, _followed */
        double ahead[6];
        for (int i = 0; i < 6; i++)
            ahead[i] = demand->chased ? dot(6, demand->root[i], demand->chase.ahead) : b[i];
        double share = steady_share(demand, b, ahead);
        for (int i = 0; i < 6; i++)
            y[i] = ahead[i] + share * (b[i] - ahead[i]);
        solved(6, (const Row *)L, y, y);
        for (int j = 0; j < n; j++) {
            x[j] = 0.0;
            for (int i = 0; i < 6; i++)
                x[j] += y[i] * A[i][j];
        }
        pace = posture_share(demand, x);
    }
    for (int i = 0; i < 6; i++)
        y[i] = pace > 0.0 ? b[i] - pace * dot(n, A[i], demand->posture) : b[i];
    solved(6, (const Row *)L, y, y);
    for (int j = 0; j < n; j++) {
        double sum = pace * demand->posture[j];
        for (int i = 0; i < 6; i++)
            sum += y[i] * A[i][j];
        x[j] = sum;
    }
    return all_finite(n, x);
}
