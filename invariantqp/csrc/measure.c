/* Twin of velocity/measure.py, systems/points.py and geometry/sizes.py, for a single problem: its sizes, the arm's own point
   and its reach to a point.

       p = argmin |J_v(p)|,     root = [[L I, 0], [-[p]x, I]] */

#include "core.h"

/* A decision that rounding may make: within this factor of a tolerance. */
static const double CLOSE = 10.0;

/* measure.py: [[L I, 0], [-[p]x, I]] */
void root_at(const double p[3], double length, double root[6][6])
{
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++)
            root[i][j] = i != j ? 0.0 : i < 3 ? length : 1.0;
    root[3][1] = p[2];
    root[3][2] = -p[1];
    root[4][0] = -p[2];
    root[4][2] = p[0];
    root[5][0] = p[1];
    root[5][1] = -p[0];
}

/* v + omega x p of a twist */
static double speed_at(const double w[3], const double v[3], const double p[3])
{
    double moved[3];
    cross(w, p, moved);
    for (int i = 0; i < 3; i++)
        moved[i] += v[i];
    return norm(3, moved);
}

/* systems/points.py, resting_point, by an adjugate where that loses few digits; others are handed back. */
static Outcome own_point(int m, const Row J[6], double p[3])
{
    double S[3][3], b[3], slides = 0.0, C[3][3];
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        b[i] = dot(m, J[j], J[3 + k]) - dot(m, J[k], J[3 + j]);
        slides += dot(m, J[3 + i], J[3 + i]);
        for (int l = 0; l < 3; l++)
            S[i][l] = -dot(m, J[i], J[l]);
    }
    double trace = -(S[0][0] + S[1][1] + S[2][2]);
    for (int i = 0; i < 3; i++)
        S[i][i] += trace;
    for (int i = 0; i < 3; i++)
        for (int l = 0; l < 3; l++) {
            int j = (i + 1) % 3, k = (i + 2) % 3, n = (l + 1) % 3, o = (l + 2) % 3;
            C[i][l] = S[j][n] * S[k][o] - S[j][o] * S[k][n];
        }
    double determinant = dot(3, S[0], C[0]), size = 2.0 * trace;
    if (slides * CLOSE > trace * LENGTH_LIMIT * LENGTH_LIMIT || !(determinant > CLOSE * WELL_POSED * size * size * size))
        return HAND_BACK;
    for (int i = 0; i < 3; i++)
        p[i] = dot(3, C[i], b) / determinant;
    return DONE;
}

/* systems/points.py, reach: the broken line from a point to its foot on each turning axis, the last one first. */
static Outcome reach(int m, const Row J[6], const double p[3], double *length)
{
    double here[3] = {p[0], p[1], p[2]}, size = norm(3, p);
    *length = 0.0;
    for (int k = m - 1; k >= 0; k--) {
        double w[3] = {J[0][k], J[1][k], J[2][k]}, v[3] = {J[3][k], J[4][k], J[5][k]}, e[3], leg[3];
        double rate = norm(3, w), moment = norm(3, v);
        if (rate * LENGTH_LIMIT <= moment)
            continue;
        for (int i = 0; i < 3; i++)
            w[i] /= rate;
        cross(w, here, e);
        for (int i = 0; i < 3; i++)
            e[i] += v[i] / rate;
        cross(w, e, leg);
        for (int i = 0; i < 3; i++)
            here[i] += leg[i];
        *length += norm(3, leg);
        size = fmax(size, moment / rate);
    }
    return *length > CLOSE * CENTRE_ROUNDING * size ? DONE : HAND_BACK;
}

/* Check sizes, and set the root of a demand for its point and length; what Python refuses, or decides, is handed back. */
Outcome measured(Demand *demand)
{
    int m = demand->m;
    double square = 0.0, p[3], length = demand->length, moment, speed, rate;
    const Row *J = (const Row *)demand->J;
    for (int i = 0; i < 6; i++) {
        square += dot(m, J[i], J[i]);
        if (!(fabs(demand->s[i]) <= LENGTH_LIMIT))
            return HAND_BACK;
    }
    if (!(square >= SMALLEST_SIZE * SMALLEST_SIZE && square <= LARGEST_SIZE * LARGEST_SIZE))
        return HAND_BACK;
    for (int i = 0; i < 3 && demand->has_point; i++) {
        p[i] = demand->point[i];
        if (!(fabs(p[i]) <= LARGEST_SIZE))
            return HAND_BACK;
    }
    if (!demand->has_point && own_point(m, J, p) == HAND_BACK)
        return HAND_BACK;
    if (length == 0.0) { /* measure.py, length_at */
        if (reach(m, J, p, &length) == HAND_BACK)
            return HAND_BACK;
        rate = norm(3, demand->s);
        speed = speed_at(demand->s, demand->s + 3, p);
        moment = fmax(norm(3, demand->s + 3), rate * norm(3, p));
        double asked = speed <= CENTRE_ROUNDING * moment || rate * LENGTH_LIMIT <= speed ? 0.0 : speed / rate;
        if (!(length > CLOSE * CENTRE_ROUNDING * asked))
            return HAND_BACK;
    }
    if (!(length >= SMALLEST_SIZE && length <= LARGEST_SIZE) || is_sliding(m, J, p, length))
        return HAND_BACK;
    root_at(p, length, demand->root);
    return DONE;
}

/* velocity/arguments.py, prismatic: whether a joint only slides. */
bool is_sliding(int m, const Row J[6], const double point[3], double length)
{
    double least = QP_ROUNDING / length;
    bool slides = false;
    for (int j = 0; j < m; j++) {
        double x = J[0][j], y = J[1][j], z = J[2][j], turning = x * x + y * y + z * z;
        double a = J[3][j] + y * point[2] - z * point[1], b = J[4][j] + z * point[0] - x * point[2];
        double c = J[5][j] + x * point[1] - y * point[0], moving = a * a + b * b + c * c;
        slides = slides || (turning <= least * least * moving && moving > 0.0);
    }
    return slides;
}
