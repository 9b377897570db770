/* Where the joints can move the tool in all six directions, far from singular: A = L V by Gram and Schmidt.

       x = x_p + V'L^-1 (b - A x_p), the answer where no limit acts
       sigma_min^2 >= 1 / |L^-1|^2,         sigma_max^2 <= |A|^2 <= 6 sigma_max^2 */

#include "core.h"

/* A step of less than this share is the last one: the next would be as its third power. */
static const double LAST_STEP = 1e-4;

/* S becomes tridiagonal by reflections, its diagonal d and the squares e of what is before that. */
static void tridiagonal(double S[6][6], double d[6], double e[6])
{
    for (int k = 0; k < 5; k++) {
        double v[6] = {0.0}, p[6] = {0.0}, length, square, along = 0.0;
        for (int i = k + 1; i < 6; i++)
            v[i] = S[i][k];
        d[k] = S[k][k];
        e[k + 1] = dot(6, v, v);
        length = copysign(sqrt(e[k + 1]), v[k + 1]);
        square = e[k + 1] + length * v[k + 1]; /* half of v.v, after the next line */
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
            for (int j = 0; j < 6; j++) /* of which v and p have zeros: a loop of known length */
                S[i][j] -= v[i] * p[j] + p[i] * v[j];
    }
    d[5] = S[5][5];
}

/* The largest eigenvalue of S = AA' by Laguerre's steps, the first of which is from infinity, with p = det(x - S):

       x - 6 p / (p' + sqrt(5 (5 p'^2 - 6 p p''))) */
static double largest_eigenvalue(int n, const Row A[6])
{
    double S[6][6], d[6], e[6] = {0.0}, x = 1.0, trace = 0.0, squares = 0.0, step = INFINITY;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j <= i; j++) {
            double entry = S[i][j] = S[j][i] = dot_in_steps(n, A[i], A[j]);
            squares += (i == j ? 1.0 : 2.0) * entry * entry;
            trace += i == j ? entry : 0.0;
        }
    double first = (trace + sqrt(fmax(5.0 * (6.0 * squares - trace * trace), 0.0))) / 6.0, over = 1.0 / first;
    tridiagonal(S, d, e);
    for (int i = 0; i < 6; i++) {
        d[i] *= over;
        e[i] *= over * over;
    }
    while (step > LAST_STEP * x) { /* in units of the first */
        double p[7] = {1.0}, slope[7] = {0.0}, bend[7] = {0.0}; /* determinants of so many rows, p' and p''/2 */
        for (int i = 0; i < 6; i++) {
            p[i + 1] = (x - d[i]) * p[i];
            slope[i + 1] = p[i] + (x - d[i]) * slope[i];
            bend[i + 1] = slope[i] + (x - d[i]) * bend[i];
            if (i == 0)
                continue;
            p[i + 1] -= e[i] * p[i - 1];
            slope[i + 1] -= e[i] * slope[i - 1];
            bend[i + 1] -= e[i] * bend[i - 1];
        }
        if (!(p[6] > 0.0)) /* rounding: it is the eigenvalue */
            break;
        step = 6.0 * p[6] / (slope[6] + sqrt(fmax(5.0 * (5.0 * slope[6] * slope[6] - 12.0 * p[6] * bend[6]), 0.0)));
        x -= step;
    }
    return first * x;
}

bool is_regular(const Demand *demand, const Row A[6], Regular *regular)
{
    double square = 0.0, inverse_square = 0.0, share = fmax(demand->threshold, ACCURATE_SHARE), smallest;
    int n = demand->m;
    regular->holds = false;
    regular->A = A;
    if (n < 6 || demand->speed > 0.0)
        return false;
    for (int i = 0; i < 6; i++) {
        double *v = regular->V[i];
        memcpy(v, A[i], sizeof(Row));
        double length = regular->L[i][i] = left_of(n, i, (const Row *)regular->V, v, regular->L[i]);
        if (!(length > 0.0))
            return false;
        scaled(n, 1.0 / length, v);
        square += dot_in_steps(n, A[i], A[i]);
    }
    inverse_triangle(6, (const Row *)regular->L, regular->X);
    for (int i = 0; i < 6; i++)
        inverse_square += dot_in_steps(6, regular->X[i], regular->X[i]);
    smallest = 1.0 / (share * share * inverse_square);
    regular->largest = smallest < square && 6.0 * smallest >= square ? largest_eigenvalue(n, A) : 0.0;
    return regular->holds = smallest >= square || (regular->largest > 0.0 && smallest >= regular->largest);
}

/* In place of `spectrum`: A = L V, V orthonormal but for rounding times the condition of AA'. */
void regular_spectrum(int n, const Regular *regular, const Row A[6], const double b[6], const double *ahead, Spectrum *found)
{
    zeroed(found->sigma);
    zeroed(found->wanted);
    zeroed(found->ahead);
    memcpy(found->V, regular->V, sizeof regular->V);
    completed(n, 6, found->V);
    found->regular = regular;
    found->largest = 1.0;
    if (n > 6) /* for what moves nothing alone */
        found->largest = sqrt(regular->largest > 0.0 ? regular->largest : largest_eigenvalue(n, A));
    want(found, b, ahead);
}

/* The shortest x with A x = b */
static void shortest(int n, const Regular *regular, const double b[6], Row x)
{
    double y[6];
    for (int i = 0; i < 6; i++)
        y[i] = dot(i + 1, regular->X[i], b);
    combined(n, 6, y, 1, regular->V, x);
}

/* Where no limit is met; false where there is none. */
bool regular_velocity(const Demand *demand, const Regular *regular, const Row A[6], const double b[6], Row x)
{
    int n = demand->m;
    Row y, posture, d;
    if (!regular->holds)
        return false;
    bool led = demand->has_posture && n > 6; /* six joints are told by the twist alone */
    double pace = led ? 1.0 : 0.0;
    if (led && demand->paced) { /* tick.py, _followed */
        double ahead[6];
        for (int i = 0; i < 6; i++)
            ahead[i] = demand->chased ? dot(6, demand->root[i], demand->chase.ahead) : b[i];
        double share = steady_share(demand, b, ahead);
        for (int i = 0; i < 6; i++)
            y[i] = ahead[i] + share * (b[i] - ahead[i]);
        shortest(n, regular, y, x);
        pace = posture_share(demand, x);
    }
    for (int j = 0; j < n && led; j++)
        posture[j] = pace * demand->posture[j];
    if (led && demand->has_before) { /* tick.py, _unhurried */
        Row way;
        for (int j = 0; j < n; j++)
            way[j] = posture[j] - demand->before[j];
        for (int i = 0; i < 6; i++)
            y[i] = dot(n, A[i], way);
        shortest(n, regular, y, d);
        for (int j = 0; j < n; j++)
            d[j] = way[j] - d[j];
        double share = slower(demand, d);
        for (int j = 0; j < n; j++)
            posture[j] = demand->before[j] + share * way[j];
    }
    for (int i = 0; i < 6; i++)
        y[i] = led ? b[i] - dot(n, A[i], posture) : b[i];
    shortest(n, regular, y, x);
    for (int j = 0; j < n && led; j++)
        x[j] += posture[j];
    return all_finite(n, x);
}
