/* Twin of legacy/tick.py, blend: where limits are active, a form need not reduce the error; least squares is blended in.

       f(x) = 1/2 |b|^2 - 1/2 |b - A x|^2 - 1/2 mu |x|^2
       keep x_f where f(x_f) >= eta f(x_W);   else x = (1 - t) x_f + t x_W, the smallest t that reaches eta f(x_W) */

#include "core.h"

/* Rounding of t, as a share of the velocity, beyond which Python might blend otherwise. */
static const double UNDECIDED = 1e-10;
/* Rounding of a decrease, as a share of |b|^2 or |A x|^2, and of products of it. */
static const double DECREASE_ROUNDING = 1e-15;

static double decrease(int n, const Row A[6], const double b[6], double mu, const Row x)
{
    double square = 0.0;
    for (int i = 0; i < 6; i++) {
        double r = b[i] - dot(n, A[i], x);
        square += r * r;
    }
    return 0.5 * (dot(6, b, b) - square - mu * dot(n, x, x));
}

/* The smallest t in [0, 1] at which (1 - t) x_f + t x_W decreases the error enough. */
Outcome blend(int n, const Row A[6], const double b[6], double mu, const Row x_f, const Row x_W, double fraction, double *t)
{
    double best = decrease(n, A, b, mu, x_W), have = decrease(n, A, b, mu, x_f);
    double size, achieved[6];
    for (int i = 0; i < 6; i++)
        achieved[i] = dot(n, A[i], x_f);
    size = fmax(dot(6, b, b), dot(6, achieved, achieved));
    double rounding_of_x = PRODUCT_ROUNDING * sqrt(size) * fmax(sqrt(size), norm_of_rows(6, n, A) * norm(n, x_f));
    double missing = (best > 0.0 ? fraction * best : (2.0 - fraction) * best) - have;
    *t = 0.0;
    if (missing <= 0.1 * rounding_of_x)
        return DONE;
    if (missing <= 10.0 * rounding_of_x)
        return HAND_BACK;
    Row d;
    double slope = 0.0, curvature = 0.0;
    for (int j = 0; j < n; j++) {
        d[j] = x_W[j] - x_f[j];
        slope -= mu * x_f[j] * d[j];
    }
    for (int i = 0; i < 6; i++) {
        double step = dot(n, A[i], d);
        slope += step * (b[i] - achieved[i]);
        curvature += step * step;
    }
    curvature += mu * dot(n, d, d);
    double discriminant = slope * slope - 2.0 * curvature * missing;
    double root = sqrt(fmax(discriminant, 0.0)), rounding = slope * slope + 2.0 * curvature * (missing + size);
    *t = slope + root > 0.0 ? fmin(2.0 * missing / (slope + root), 1.0) : 1.0;
    double loose = DECREASE_ROUNDING * rounding * *t * norm(n, d), tight = UNDECIDED * fmax(norm(n, x_f), norm(n, x_W));
    return loose <= tight * root * (slope + root) ? DONE : HAND_BACK;
}
