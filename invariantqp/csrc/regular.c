/* Where the joints can move the tool in all six directions, far from singular, and no limit acts: one Cholesky factor.

       x = x_p + A'(AA')^-1 (b - A x_p),      AA' = LL'
       sigma_min^2 >= 1 / |(AA')^-1|,         sigma_max^2 <= |AA'| */

#include "core.h"
#include <string.h>

bool is_regular(const Demand *demand, const Row A[6], Regular *regular)
{
    Row *L = regular->L;
    double squares = 0.0, inverse_squares = 0.0;
    regular->holds = false;
    if (demand->m < 6 || demand->speed > 0.0)
        return false;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j <= i; j++) {
            double entry = dot(demand->m, A[i], A[j]);
            squares += (i == j ? 1.0 : 2.0) * entry * entry;
            L[i][j] = regular->S[i][j] = entry;
        }
    if (!factored(6, L))
        return false;
    /* trace (AA')^-1 = |L^-1|^2 bounds its norm. */
    for (int j = 0; j < 6; j++) {
        double column[6];
        inverse_column(6, (const Row *)L, j, column);
        inverse_squares += dot(6 - j, column + j, column + j);
    }
    double smallest = 1.0 / inverse_squares, largest = sqrt(squares);
    double share = demand->threshold > ACCURATE_SHARE ? demand->threshold : ACCURATE_SHARE;
    return regular->holds = smallest >= share * share * largest;
}

/* After a step of less than this share the next one is smaller than its third power. */
static const double LAST_STEP = 1e-3;

/* The largest eigenvalue of S by Laguerre's steps from |S|, which is above it:

       x - 6 / (g + sqrt(5 (6 h - g^2))),   g = tr (x - S)^-1,   h = tr (x - S)^-2 */
static double largest_eigenvalue(const Row S[6])
{
    double x = 0.0, step = INFINITY;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j <= i; j++)
            x += (i == j ? 1.0 : 2.0) * S[i][j] * S[i][j];
    x = sqrt(x);
    while (step > LAST_STEP * x) {
        Row L[6], inverse[6];
        double g = 0.0, h = 0.0;
        for (int i = 0; i < 6; i++)
            for (int j = 0; j <= i; j++)
                L[i][j] = (i == j ? x : 0.0) - S[i][j];
        if (!factored(6, L)) /* rounding: it is the eigenvalue */
            break;
        for (int j = 0; j < 6; j++)
            inverse_column(6, (const Row *)L, j, inverse[j]);
        for (int j = 0; j < 6; j++)
            for (int k = 0; k <= j; k++) {
                double entry = dot(6 - j, inverse[j] + j, inverse[k] + j);
                g += j == k ? entry : 0.0;
                h += (j == k ? 1.0 : 2.0) * entry * entry;
            }
        step = 6.0 / (g + sqrt(fmax(5.0 * (6.0 * h - g * g), 0.0)));
        x -= step;
    }
    return x;
}

/* In place of `spectrum`: A = L V. */
void regular_spectrum(int n, const Regular *regular, const Row A[6], const double b[6], const double *ahead, Spectrum *found)
{
    memset(found->sigma, 0, sizeof found->sigma);
    memset(found->wanted, 0, sizeof found->wanted);
    memset(found->ahead, 0, sizeof found->ahead);
    memcpy(found->L, regular->L, sizeof found->L);
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < n; j++) {
            double left = A[i][j];
            for (int k = 0; k < i; k++)
                left -= found->L[i][k] * found->V[k][j];
            found->V[i][j] = left / found->L[i][i];
        }
    completed(n, 6, found->V);
    found->regular = true;
    found->largest = n > 6 ? sqrt(largest_eigenvalue(regular->S)) : 1.0; /* for what moves nothing alone */
    want(found, b, ahead);
}

/* Where no limit is met; false where there is none. */
bool regular_velocity(const Demand *demand, const Regular *regular, const Row A[6], const double b[6], Row x)
{
    int n = demand->m;
    const Row *L = regular->L;
    double y[6];
    if (!regular->holds)
        return false;
    double pace = demand->has_posture ? 1.0 : 0.0;
    if (demand->has_posture && demand->paced) { /* tick.py, _followed */
        double ahead[6];
        for (int i = 0; i < 6; i++)
            ahead[i] = demand->chased ? dot(6, demand->root[i], demand->chase.ahead) : b[i];
        double share = steady_share(demand, b, ahead);
        for (int i = 0; i < 6; i++)
            y[i] = ahead[i] + share * (b[i] - ahead[i]);
        solved(6, L, y, y);
        for (int j = 0; j < n; j++) {
            x[j] = 0.0;
            for (int i = 0; i < 6; i++)
                x[j] += y[i] * A[i][j];
        }
        pace = posture_share(demand, x);
    }
    for (int i = 0; i < 6; i++)
        y[i] = pace > 0.0 ? b[i] - pace * dot(n, A[i], demand->posture) : b[i];
    solved(6, L, y, y);
    for (int j = 0; j < n; j++) {
        double sum = pace * demand->posture[j];
        for (int i = 0; i < 6; i++)
            sum += y[i] * A[i][j];
        x[j] = sum;
    }
    return all_finite(n, x);
}
