/* Twin of control/frame_cost.py: the quadratic that a frame task of Pink or mink minimises, 1/2 x'Hx + c'x. */

#include "core.h"

/* H (m, m) and c (m,) where a length costs 1; `more` is Pink's damping of every joint. */
Outcome frame_cost(const Demand *demand, double more, Row *H, Row c)
{
    static const Row STILL = {0.0};
    Objective objective;
    Spectrum found;
    Row A[6];
    double b[6], attempt[6], most = 0.0;
    int m = demand->m;
    for (int i = 0; i < 6; i++)
        b[i] = dot(6, demand->root[i], demand->s);
    product_of_rows(6, demand->root, m, demand->J, A);
    bool plain = usual(6, b);
    for (int i = 0; i < 6; i++)
        plain = plain && usual(m, A[i]);
    if (!plain || spectrum(6, m, (const Row *)A, demand->form == NULL ? b : NULL, NULL, &found) == HAND_BACK)
        return HAND_BACK;
    if (demand->form != NULL) {
        if (attempted(demand, m, &found, b, attempt) == HAND_BACK)
            return HAND_BACK;
        want(&found, attempt, NULL);
    }
    if (least_squares(demand, m, &found, STILL, 0.0, &objective) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < m; i++)
        most = fmax(most, objective.weights[i]);
    for (int j = 0; j < m; j++) {
        c[j] = 0.0;
        for (int l = 0; l < m; l++)
            H[j][l] = 0.0;
    }
    for (int i = 0; i < m; i++) {
        const double *v = objective.V[i], pull = objective.weights[i] * objective.optimum[i];
        double weight = (i < objective.rank ? objective.weights[i] : FREE_WEIGHT * most) + more;
        for (int j = 0; j < m; j++) {
            c[j] -= pull * v[j];
            for (int l = 0; l < m; l++)
                H[j][l] += weight * v[j] * v[l];
        }
    }
    return DONE;
}
