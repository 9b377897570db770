/* Where the joints can move the tool in all six directions, far from singular, and no limit acts: one Cholesky factor.

       x = x_p + A'(AA')^-1 (b - A x_p),      AA' = LL'
       sigma_min^2 >= 1 / |(AA')^-1|,         sigma_max^2 <= |AA'| */

#include "core.h"

bool is_regular(const Demand *demand, const Row A[6], Regular *regular)
{
    Row *L = regular->L;
    double squares = 0.0, inverse_squares = 0.0;
    regular->holds = false;
    regular->A = A;
    if (demand->m < 6 || demand->speed > 0.0)
        return false;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j <= i; j++) {
            double entry = dot_in_steps(demand->m, A[i], A[j]);
            squares += (i == j ? 1.0 : 2.0) * entry * entry;
            L[i][j] = regular->S[i][j] = entry;
        }
    if (!factored(6, L))
        return false;
    /* trace (AA')^-1 = |L^-1|^2 bounds its norm. */
    inverse_triangle(6, (const Row *)L, regular->X);
    for (int i = 0; i < 6; i++)
        inverse_squares += dot_in_steps(6, regular->X[i], regular->X[i]);
    double smallest = 1.0 / inverse_squares, largest = sqrt(squares);
    double share = demand->threshold > ACCURATE_SHARE ? demand->threshold : ACCURATE_SHARE;
    return regular->holds = smallest >= share * share * largest;
}

/* A step of less than this share is the last one: the next would be as its third power. */
static const double LAST_STEP = 1e-4;

/* S becomes tridiagonal by reflections, its diagonal d and the squares e of what is beside that. */
static void tridiagonal(Row S[6], double d[6], double e[5])
{
    for (int k = 0; k < 5; k++) {
        double v[6] = {0.0}, p[6] = {0.0}, length, square, along = 0.0;
        for (int i = k + 1; i < 6; i++)
            v[i] = S[i][k];
        d[k] = S[k][k];
        e[k] = dot(6, v, v);
        length = copysign(sqrt(e[k]), v[k + 1]);
        square = e[k] + length * v[k + 1]; /* half of v.v, after the next line */
        v[k + 1] += length;
        if (k == 4 || !(square > 0.0))
            continue;
        double over = 1.0 / square;
        for (int i = k + 1; i < 6; i++) {
            p[i] = dot(6, S[i], v) * over;
            along += 0.5 * p[i] * v[i] * over;
        }
        for (int i = k + 1; i < 6; i++)
            p[i] -= along * v[i];
        for (int i = k + 1; i < 6; i++)
            for (int j = k + 1; j < 6; j++)
                S[i][j] -= v[i] * p[j] + p[i] * v[j];
    }
    d[5] = S[5][5];
}

/* The largest eigenvalue of S by Laguerre's steps, the first of which is from infinity: with q_i the pivots of x - S,

       x - 6 / (g + sqrt(5 (6 h - g^2))),   g = sum of q_i'/q_i,   h = -g' */
static double largest_eigenvalue(const Row lower[6])
{
    Row S[6];
    double d[6], e[5], x, trace = 0.0, squares = 0.0, step = INFINITY;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            S[i][j] = lower[i > j ? i : j][i > j ? j : i];
            squares += S[i][j] * S[i][j];
        }
    for (int i = 0; i < 6; i++)
        trace += S[i][i];
    x = (trace + sqrt(fmax(5.0 * (6.0 * squares - trace * trace), 0.0))) / 6.0;
    tridiagonal(S, d, e);
    while (step > LAST_STEP * x) {
        double over = 0.0, slope = 0.0, bend = 0.0, g = 0.0, h = 0.0;
        for (int i = 0; i < 6; i++) { /* over: 1 / q, and its pivots' derivatives over q */
            double t = i > 0 ? e[i - 1] * over : 0.0, q = x - d[i] - t;
            if (!(q > 0.0)) /* rounding: it is the eigenvalue */
                return x;
            over = 1.0 / q;
            bend = t * (bend - 2.0 * slope * slope) * over;
            slope = (1.0 + t * slope) * over;
            g += slope;
            h += slope * slope - bend;
        }
        step = 6.0 / (g + sqrt(fmax(5.0 * (6.0 * h - g * g), 0.0)));
        x -= step;
    }
    return x;
}

/* In place of `spectrum`: A = L V, V orthonormal but for rounding times the condition of S. */
void regular_spectrum(int n, const Regular *regular, const Row A[6], const double b[6], const double *ahead, Spectrum *found)
{
    zeroed(found->sigma);
    zeroed(found->wanted);
    zeroed(found->ahead);
    for (int i = 0; i < 6; i++)
        combined(n, i + 1, regular->X[i], 1, A, found->V[i]);
    completed(n, 6, found->V);
    found->regular = regular;
    found->largest = n > 6 ? sqrt(largest_eigenvalue(regular->S)) : 1.0; /* for what moves nothing alone */
    want(found, b, ahead);
}

/* (AA')^-1 y */
static void over_square(const Regular *regular, Row y)
{
    Row parts;
    for (int i = 0; i < 6; i++)
        parts[i] = dot(i + 1, regular->X[i], y);
    combined(6, 6, parts, 1, regular->X, y);
}

/* Where no limit is met; false where there is none. */
bool regular_velocity(const Demand *demand, const Regular *regular, const Row A[6], const double b[6], Row x)
{
    int n = demand->m;
    Row y;
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
        over_square(regular, y);
        combined(n, 6, y, 1, A, x);
        pace = posture_share(demand, x);
    }
    for (int i = 0; i < 6; i++)
        y[i] = pace > 0.0 ? b[i] - pace * dot(n, A[i], demand->posture) : b[i];
    over_square(regular, y);
    combined(n, 6, y, 1, A, x);
    for (int j = 0; j < n && pace > 0.0; j++)
        x[j] += pace * demand->posture[j];
    return all_finite(n, x);
}
