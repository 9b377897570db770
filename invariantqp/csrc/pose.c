/* Twin of pose/newton.py, error.py and arm.py: one try at a pose, by damped Newton steps inside joint limits;
   exact_pose.c has the steps with exact demands.

       f(q) = 1/2 |r|^2,   r = (L omega; p_d - p),   A = -dr/dq
       x = argmin 1/2 |r - A x|^2 + 1/2 mu |x|^2   over   q_min <= q + x <= q_max,      mu = lambda |r|^2 */

#include "pose.h"
#include <string.h>

static void placed(const Arm *arm, const double *q, Row J[6], Pose *tool)
{
    Pose home;
    pose_from(arm->home[0], &home);
    kinematics((int)arm->joints, arm->screws, &home, q, J, tool);
}

static Outcome linearised(const Arm *arm, const Pose *target, const double *q, Linearization *state)
{
    Pose tool;
    double here[3], there[3], omega[3];
    placed(arm, q, state->A, &tool);
    state->rows = 0;
    if (arm->wanted > 0.0) {
        Demand demand;
        demand.m = (int)arm->joints;
        memcpy(demand.J, state->A, sizeof demand.J);
        if (rows_of(arm->exact, (int)arm->wanted, 1.0, &tool, target, NULL, &demand) == HAND_BACK)
            return HAND_BACK;
        state->rows = demand.rows;
        memcpy(state->C, demand.C, sizeof state->C);
        memcpy(state->b, demand.e, sizeof state->b);
    }
    turn_to(target, &tool, omega);
    place(&tool, arm->point, here);
    place(target, arm->point, there);
    for (int j = 0; j < (int)arm->joints; j++) {
        double w[3] = {state->A[0][j], state->A[1][j], state->A[2][j]};
        for (int i = 0; i < 3; i++) {
            int a = (i + 1) % 3, b = (i + 2) % 3;
            state->A[3 + i][j] += w[a] * here[b] - w[b] * here[a];
            state->A[i][j] = arm->length * w[i];
        }
    }
    for (int i = 0; i < 3; i++) {
        state->r[i] = arm->length * omega[i];
        state->r[3 + i] = there[i] - here[i];
    }
    state->f = 0.5 * dot(6, state->r, state->r);
    return DONE;
}

/* -grad f, A'r */
static void descent(int m, const Linearization *state, Row g)
{
    for (int j = 0; j < m; j++) {
        g[j] = 0.0;
        for (int i = 0; i < 6; i++)
            g[j] += state->r[i] * state->A[i][j];
    }
}

/* The second derivative of f by differences of its gradient, with the absolute values of its eigenvalues: H = U S V' is
   symmetric, so that these are S, and V has the eigenvectors. */
static Outcome curvature(const Arm *arm, const Pose *target, const double *q, const Linearization *state, Row *H)
{
    int m = (int)arm->joints;
    Row here, there, moved, D[MOST], still = {0.0};
    Linearization beside;
    Spectrum found;
    descent(m, state, here);
    for (int i = 0; i < m; i++) {
        double h = q[i] + DIFFERENCE > arm->upper[i] ? -DIFFERENCE : DIFFERENCE;
        memcpy(moved, q, sizeof(Row));
        moved[i] += h;
        if (linearised(arm, target, moved, &beside) == HAND_BACK)
            return HAND_BACK;
        descent(m, &beside, there);
        for (int j = 0; j < m; j++)
            D[i][j] = (here[j] - there[j]) / h;
    }
    for (int i = 0; i < m; i++)
        for (int j = 0; j <= i; j++)
            D[i][j] = D[j][i] = 0.5 * (D[i][j] + D[j][i]);
    if (spectrum(m, m, (const Row *)D, still, NULL, &found) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < m; i++)
        for (int j = 0; j < m; j++) {
            H[i][j] = 0.0;
            for (int k = 0; k < m; k++)
                H[i][j] += found.sigma[k] * found.V[k][i] * found.V[k][j];
        }
    return DONE;
}

bool is_inside(int n, const double *x, const double *lower, const double *upper)
{
    for (int j = 0; j < n; j++)
        if (!(x[j] >= lower[j] && x[j] <= upper[j]))
            return false;
    return true;
}

/* 1/2 x'Hx - g'x by the factor of H */
void quadratic_of(int n, const Row *L, const Row g, Quadratic *problem)
{
    memset(problem, 0, sizeof *problem);
    problem->n = n;
    Row X[MOST];
    solved(n, L, g, problem->centre);
    inverse_triangle(n, L, X);
    for (int i = 0; i < n; i++)
        for (int k = i; k < n; k++) {
            problem->K[i][k] = L[k][i];
            problem->T[k][i] = X[k][i];
        }
}

/* The minimiser of 1/2 x'Hx - g'x in the box, from the factor of H; a gradient step where there is none. */
static void box_minimum(int n, const Row *L, const Row g, double unit, const Row lower, const Row upper, Row x)
{
    Quadratic problem;
    quadratic_of(n, L, g, &problem);
    if (minimise_in_box(&problem, lower, upper, x) == DONE)
        return;
    for (int j = 0; j < n; j++)
        x[j] = between(unit * g[j], lower[j], upper[j]);
}

/* newton.py: the step inside the box, by the second derivative H or, where there is none, A'A. */
static void step_of(int m, const Linearization *state, Row *H, double mu, const Row lower, const Row upper, Row x)
{
    const Row *A = state->A;
    double size = 0.0;
    Row own[MOST], g;
    for (int i = 0; i < 6; i++)
        size += dot(m, A[i], A[i]);
    if (H == NULL && m >= 6) {
        Row S[6];
        double y[6];
        for (int i = 0; i < 6; i++)
            for (int j = 0; j <= i; j++)
                S[i][j] = dot(m, A[i], A[j]) + (i == j ? mu + FLOOR * size : 0.0);
        if (factored(6, S)) {
            solved(6, (const Row *)S, state->r, y);
            for (int j = 0; j < m; j++) {
                x[j] = 0.0;
                for (int i = 0; i < 6; i++)
                    x[j] += y[i] * A[i][j];
            }
            if (is_inside(m, x, lower, upper))
                return;
        }
    }
    if (H == NULL) {
        H = own;
        for (int i = 0; i < m; i++)
            for (int j = 0; j <= i; j++) {
                H[i][j] = 0.0;
                for (int k = 0; k < 6; k++)
                    H[i][j] += A[k][i] * A[k][j];
            }
    }
    descent(m, state, g);
    for (int j = 0; j < m; j++)
        H[j][j] += fmax(mu, QP_FLOOR * size);
    if (factored(m, H)) {
        solved(m, (const Row *)H, g, x);
        if (!is_inside(m, x, lower, upper))
            box_minimum(m, (const Row *)H, g, 1.0 / size, lower, upper, x);
        return;
    }
    for (int j = 0; j < m; j++)
        x[j] = between(g[j] / size, lower[j], upper[j]);
}

/* arm.py: the least and the largest step; with `turning`, half a turn for a hinge that can turn over. */
static void steps_from(const Arm *arm, const double *q, bool turning, Row lower, Row upper)
{
    for (int j = 0; j < (int)arm->joints; j++) {
        bool open = turning && arm->whole[j] != 0.0;
        lower[j] = open ? -0.5 * arm->turn[j] : arm->lower[j] - q[j];
        upper[j] = open ? 0.5 * arm->turn[j] : arm->upper[j] - q[j];
    }
}

/* arm.py: q shifted by whole turns into the limits; clipped to them where no turn helps. */
static void inside(const Arm *arm, double *q)
{
    for (int j = 0; j < (int)arm->joints; j++) {
        double low = arm->lower[j], high = arm->upper[j];
        if (arm->whole[j] != 0.0)
            q[j] += (fmax(ceil((low - q[j]) / arm->turn[j]), 0.0) - fmax(ceil((q[j] - high) / arm->turn[j]), 0.0)) *
                    arm->turn[j];
        q[j] = between(q[j], low, high);
    }
}

void misses(const Arm *arm, const Pose *target, const double *q, double *position, double *orientation)
{
    Row J[6];
    Pose tool;
    double omega[3], d[3];
    placed(arm, q, J, &tool);
    turn_to(target, &tool, omega);
    for (int i = 0; i < 3; i++)
        d[i] = target->p[i] - tool.p[i];
    *position = norm(3, d);
    *orientation = norm(3, omega);
}

/* Steps from found->q, inside the limits, until the goal is met or no step gains anything, AT_A_TIME of them; it is given up
   where so many, a window, have not halved the error. */
Outcome descend(const Arm *arm, const Pose *target, double goal, bool turning, bool patient, int window, Try *found)
{
    int m = (int)arm->joints, longest = patient ? PATIENCE : LONGEST;
    long steps = (long)found->known.steps, until = steps + AT_A_TIME;
    double damping = found->known.damping, penalty = found->known.penalty, least = patient ? 0.0 : LEAST, price;
    double *past = found->known.past;
    Linearization state, seen;
    Row lower, upper, x, next, H[MOST];
    if (linearised(arm, target, found->q, &state) == HAND_BACK)
        return HAND_BACK;
    found->met = found->at_rest = found->going = false;
    for (; steps < longest; steps++) {
        double before = INFINITY;
        found->known.steps = (double)steps;
        found->f = state.f;
        found->unmet = norm(state.rows, state.b);
        double merit = found->merit = state.f + penalty * found->unmet;
        if (!isfinite(merit))
            return HAND_BACK;
        if (steps == until) {
            found->known.damping = damping;
            found->known.penalty = penalty;
            found->going = true;
            return DONE;
        }
        if (steps > window)
            before = past[(steps - window) % (STALLED + 1)];
        past[steps % (STALLED + 1)] = merit;
        if (sqrt(2.0 * state.f) + found->unmet <= goal) {
            found->met = true;
            return DONE;
        }
        if (!patient && merit > 0.5 * before)
            return DONE;
        if (damping > STIFFEST || before - merit <= AT_REST * merit) {
            found->at_rest = true;
            return DONE;
        }
        steps_from(arm, found->q, turning, lower, upper);
        if (state.rows > 0) {
            if (exact_step(m, &state, damping, lower, upper, x, &price) == HAND_BACK)
                return HAND_BACK;
            penalty = fmax(penalty, PENALTY_MARGIN * price);
        } else {
            if (patient && curvature(arm, target, found->q, &state, H) == HAND_BACK)
                return HAND_BACK;
            step_of(m, &state, patient ? H : NULL, 2.0 * damping * merit, lower, upper, x);
        }
        for (int j = 0; j < m; j++)
            next[j] = found->q[j] + x[j];
        inside(arm, next);
        if (linearised(arm, target, next, &seen) == HAND_BACK)
            return HAND_BACK;
        if (seen.f + penalty * norm(seen.rows, seen.b) < state.f + penalty * found->unmet) {
            memcpy(found->q, next, sizeof(Row));
            state = seen;
            damping = fmax(EASED * damping, least);
        } else
            damping *= STIFFENED;
    }
    found->known.steps = (double)longest;
    found->f = state.f;
    found->unmet = norm(state.rows, state.b);
    found->merit = state.f + penalty * found->unmet;
    found->at_rest = true;
    return DONE;
}
