/* Twin of control/frame_cost.py: the quadratic that a frame task of Pink or mink minimises, 1/2 x'Hx + c'x. */

#include "core.h"

/* H (m, m) and c (m,). */
Outcome frame_cost(const Law *law, const FrameError *error, Row *H, Row c)
{
    Demand told, *demand = &told;
    static const Row STILL = {0.0};
    Objective objective;
    Spectrum found;
    Row A[6];
    double b[6], attempt[6], most = 0.0;
    int m = told.m = error->m;
    double unit = error->unit * error->unit;
    governed(law, demand);
    memcpy(told.root, error->root, sizeof told.root);
    for (int i = 0; i < 6; i++) {
        int from = error->of_error ? (i + 3) % 6 : i;
        double sign = error->of_error ? -1.0 : 1.0;
        told.s[i] = error->gain * error->s[from];
        for (int j = 0; j < m; j++)
            told.J[i][j] = sign * error->J[from][j];
    }
    for (int i = 0; i < 6; i++)
        b[i] = dot(6, demand->root[i], demand->s);
    product_of_rows(6, demand->root, m, demand->J, A);
    if (!usual(6, b) || !usual_rows(6, m, (const Row *)A) ||
        spectrum(6, m, (const Row *)A, demand->form == NULL ? b : NULL, NULL, &found) == HAND_BACK)
        return HAND_BACK;
    if (demand->form != NULL) {
        if (attempted(demand, m, &found, b, attempt) == HAND_BACK)
            return HAND_BACK;
        want(&found, attempt, NULL);
    }
    if (least_squares(demand, m, &found, STILL, false, &objective) == HAND_BACK)
        return HAND_BACK;
    double more = error->more + error->lm_damping * dot(6, b, b);
    for (int i = 0; i < m; i++)
        most = fmax(most, objective.weights[i]);
    for (int j = 0; j < m; j++) {
        c[j] = 0.0;
        for (int l = 0; l < m; l++)
            H[j][l] = 0.0;
    }
    for (int i = 0; i < m; i++) {
        const double *v = objective.V[i], pull = unit * objective.weights[i] * objective.optimum[i];
        double weight = unit * ((i < objective.rank ? objective.weights[i] : FREE_WEIGHT * most) + more);
        for (int j = 0; j < m; j++) {
            c[j] -= pull * v[j];
            for (int l = 0; l < m; l++)
                H[j][l] += weight * v[j] * v[l];
        }
    }
    return DONE;
}
