/* Twin of legacy/attempted.py: the measured twist to attempt with a form.

       A = U diag(sigma) V',   r = b - U U'b:     U'M (U y - r) = 0,     attempt U (U'b + y)
       N = V'MV,  B = |MV| = LL',  C = L^-1 N L^-T,   y = V L^-T f(C) L^-1 V'Mr,   f(mu) = mu / (mu^2 + filter)

   V is U with each direction as far as damping leaves it. f is odd, so f(C) = C g(C'C) by the singular values of C. */

#include "core.h"

/* A singular value within this factor of NULL_RATIO might be on its other side in Python. */
static const double CLOSE = 10.0;
/* Rounding enlarged by one over this share of |M| decides on a direction of V that M hardly sees, but for one that it leaves
   to itself (UNTOUCHED); damping of more than DAMPED_SHARE does not let it count. */
static const double DISTINCT = 1e-3, DAMPED_SHARE = 0.999;
/* A vector shorter than this share of itself before it was made orthogonal depends on the others. */
static const double DEPENDENT_TWIST = 1e-8;

/* Q_h on measured twists, root^-T Q_h root^-1. */
static Outcome pitch_form(double h, const double root[6][6], double M[6][6])
{
    double Q[6][6] = {{0.0}}, right[6][6], turned[6][6];
    for (int i = 0; i < 3; i++) {
        Q[i][i] = -2.0 * h;
        Q[i][3 + i] = Q[3 + i][i] = 1.0;
    }
    if (over_root(6, (const double(*)[6])Q, root, right) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++)
            turned[i][j] = right[j][i];
    return over_root(6, (const double(*)[6])turned, root, M);
}

/* I - KK', K an orthonormal basis of root Z. */
static Outcome complement(const Law *form, const double root[6][6], double M[6][6])
{
    int count = form->twists;
    double K[6][6];
    if (count == 6) /* nothing is left, and M is rounding */
        return HAND_BACK;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++)
            M[i][j] = i == j ? 1.0 : 0.0;
    for (int k = 0; k < count; k++) {
        double whole, *z = K[k];
        for (int i = 0; i < 6; i++)
            z[i] = dot(6, root[i], form->Z[k]);
        whole = norm(6, z);
        for (int twice = 0; twice < 2; twice++) /* the first time leaves rounding */
            for (int l = 0; l < k; l++) {
                double share = dot(6, K[l], z);
                for (int i = 0; i < 6; i++)
                    z[i] -= share * K[l][i];
            }
        double length = norm(6, z);
        if (!(length > DEPENDENT_TWIST * whole))
            return HAND_BACK;
        for (int i = 0; i < 6; i++)
            z[i] /= length;
        for (int i = 0; i < 6; i++)
            for (int j = 0; j < 6; j++)
                M[i][j] -= z[i] * z[j];
    }
    return DONE;
}

/* f(C) p */
static Outcome filtered(int k, const Row *C, const double *p, double *y)
{
    Spectrum found;
    Row part = {0.0};
    if (spectrum(k, k, C, p, NULL, &found) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < k; i++) {
        double mu = found.sigma[i], ratio = mu / FORM_THRESHOLD, filter = FORM_THRESHOLD * fmax(0.0, 1.0 - ratio * ratio);
        double along = dot(k, found.V[i], p) / (mu * mu + filter * filter);
        for (int j = 0; j < k; j++)
            part[j] += along * found.V[i][j];
    }
    for (int i = 0; i < k; i++)
        y[i] = dot(k, C[i], part);
    return DONE;
}

/* `found` is the spectrum of A (6, n), with its U. `attempt` is b itself, to the bit, where the joints can do all of it. */
Outcome attempted(const Demand *demand, int n, Spectrum *found, const double b[6], double attempt[6])
{
    int k = n < 6 ? n : 6;
    const Law *form = demand->form;
    double largest = found->largest, share[6], r[6], done[6] = {0.0}, M[6][6], V[6][6], W[6][6] = {{0.0}}, square = 0.0;
    Row MV[6], L[6], C[6], y, counts;
    Spectrum own;
    bool whole = k == 6;
    memcpy(attempt, b, 6 * sizeof(double));
    if (largest == 0.0)
        return DONE;
    want(found, b, NULL);
    for (int i = 0; i < k; i++) {
        double sigma = found->sigma[i], damped = damped_square(demand, sigma, found->wanted[i], largest);
        if (damped == 0.0 && !(sigma > CLOSE * NULL_RATIO * largest))
            return HAND_BACK;
        share[i] = sigma * sigma / (sigma * sigma + damped);
        whole = whole && damped == 0.0;
        for (int j = 0; j < 6; j++)
            done[j] += share[i] * found->wanted[i] * found->U[i][j];
    }
    if (whole)
        return DONE;
    if (form->form == BROUGHT)
        memcpy(M, demand->brought, sizeof M);
    else if ((form->form == PITCH ? pitch_form(form->pitch, demand->root, M) : complement(form, demand->root, M)) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < 6; i++) {
        r[i] = b[i] - done[i];
        square += dot(6, M[i], M[i]);
    }
    for (int i = 0; i < k; i++)
        for (int j = 0; j < 6; j++)
            V[i][j] = sqrt(share[i]) * found->U[i][j];
    for (int i = 0; i < k; i++)
        for (int j = 0; j < 6; j++)
            MV[j][i] = dot(6, M[j], V[i]);
    if (spectrum(6, k, (const Row *)MV, NULL, NULL, &own) == HAND_BACK) /* |MV| = V sigma V' */
        return HAND_BACK;
    double size = sqrt(square);
    for (int l = 0; l < k; l++) {
        double damped = 0.0;
        for (int i = 0; i < k; i++) {
            damped += (1.0 - share[i]) * own.V[l][i] * own.V[l][i];
            for (int j = 0; j < 6; j++)
                W[l][j] += own.V[l][i] * V[i][j];
        }
        if (damped < DAMPED_SHARE && own.sigma[l] > UNTOUCHED * size / CLOSE && own.sigma[l] < DISTINCT * size)
            return HAND_BACK;
        counts[l] = between(own.sigma[l] / (UNTOUCHED * size) - 1.0, 0.0, 1.0);
        for (int h = 0; h <= l; h++) {
            L[l][h] = h < l ? 0.0 : own.sigma[l] + (UNSEEN + 1.0 - counts[l]) * size;
            for (int i = 0; i < k; i++)
                L[l][h] += own.V[l][i] * own.V[h][i] * (1.0 - share[i]) * size;
        }
        own.sigma[l] *= counts[l];
        y[l] = own.sigma[l] * dot(6, own.U[l], r);
    }
    if (!factored(k, L))
        return HAND_BACK;
    for (int i = 0; i < k; i++) { /* columns of N, and rows of L^-1 N */
        Row column;
        for (int j = 0; j < k; j++)
            column[j] = counts[j] * own.sigma[i] * dot(6, own.U[i], W[j]);
        forward(k, (const Row *)L, column);
        for (int j = 0; j < k; j++)
            C[j][i] = column[j];
    }
    for (int i = 0; i < k; i++)
        forward(k, (const Row *)L, C[i]);
    forward(k, (const Row *)L, y);
    if (filtered(k, (const Row *)C, y, y) == HAND_BACK)
        return HAND_BACK;
    backward(k, (const Row *)L, y);
    double step[6] = {0.0}, shortened = 1.0;
    for (int i = 0; i < k; i++)
        for (int j = 0; j < 6; j++)
            step[j] += y[i] * W[i][j];
    if (form->fraction >= 0.0) {
        double most = sqrt((1.0 - form->fraction) * dot(6, done, done)), length = norm(6, step);
        shortened = length > 0.0 ? most / fmax(most, length) : 1.0;
    }
    for (int j = 0; j < 6; j++) {
        attempt[j] = shortened * step[j];
        for (int i = 0; i < k; i++)
            attempt[j] += found->wanted[i] * found->U[i][j];
    }
    return DONE;
}
