/* Twin of control/controller.py, measure.py, convergence.py and velocity/limits/box.py: one tick of a controller.

       s = b gain log(T_target T^-1) + feedforward,     velocity = law(J(q), s, box(q)) */

#include "core.h"
#include <string.h>

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

/* measure.py: the root of this tick's measure, at a point of the tool or of a metric carried by a body. */
static void measured_by(const Loop *loop, const Pose *tool, double root[6][6])
{
    double p[3], ad[6][6] = {{0.0}};
    if (loop->carried == 0.0) {
        place(tool, loop->point, p);
        root_at(p, loop->length, root);
        return;
    }
    memcpy(root, loop->root, sizeof loop->root);
    if (loop->carried == 1.0)
        return;
    root_at(tool->p, 1.0, ad); /* [[I, 0], [-[p]x, I]], then turned into the tool's frame */
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            root[i][j] = 0.0;
            for (int k = 0; k < 6; k++)
                for (int l = k / 3 * 3; l < k / 3 * 3 + 3; l++)
                    root[i][j] += loop->root[i][k] * tool->R[l % 3][k % 3] * ad[l][j];
        }
}

/* limits/box.py */
static void box(const Loop *loop, const double *q, Row lower, Row upper)
{
    double rate = 1.0 / loop->dt;
    for (int j = 0; j < (int)loop->joints; j++) {
        double place = q[j] * rate, fastest = loop->fastest[j];
        lower[j] = fmin(fmax(loop->low[j] - place, -fastest), fastest);
        upper[j] = fmax(fmin(loop->high[j] - place, fastest), -fastest);
    }
}

/* convergence.py: seen, then commanded */
static void watched(const Loop *loop, const double error[6], const double change[6], Convergence *watch)
{
    double share = 1.0 / MEMORY, size = norm(6, error);
    if (watch->has_expected) {
        watch->promised = (1.0 - share) * watch->promised + share * (watch->size - norm(6, watch->expected));
        watch->achieved = (1.0 - share) * watch->achieved + share * (watch->size - size);
        watch->ticks++;
    }
    for (int i = 0; i < 6; i++)
        watch->expected[i] = error[i] + change[i];
    watch->speed = (1.0 - share) * watch->speed + share * loop->slowness / loop->dt * norm(6, change);
    watch->size = size;
    watch->has_expected = true;
}

/* limits/toolspeed.py: the velocity v + omega x p of the limited point */
static void limited_point(const Loop *loop, const Pose *tool, Demand *demand)
{
    double p[3], root[6][6];
    place(tool, loop->fast, p);
    root_at(p, 1.0, root);
    for (int i = 0; i < 3; i++)
        demand->cone.start[i] = 0.0;
    product_of_rows(3, root + 3, demand->m, demand->J, demand->cone.J);
}

/* controller.py: the share of the gain that leaves the joints room to brake before the target. */
static Outcome approach(const Loop *loop, const Demand *demand, const double measured[6], double *share)
{
    Row A[6];
    product_of_rows(6, demand->root, demand->m, demand->J, A);
    if (demand->metric != NULL)
        product_with(6, demand->m, A, demand->metric->T);
    return braking_share(loop, (const Row *)A, measured, share);
}

/* controller.py: of a demand what no target decides, for joint twists demand->J. */
Outcome demand_in(const Loop *loop, const double *q, const double *before, const Pose *tool, Demand *demand)
{
    demand->metric = loop->has_metric != 0.0 ? &loop->metric : NULL;
    demand->form = loop->has_form != 0.0 ? &loop->form : NULL;
    demand->limits = (int)loop->limits;
    memcpy(demand->G, loop->G, (size_t)demand->limits * sizeof(Row));
    memcpy(demand->least, loop->least, sizeof(Row));
    memcpy(demand->most, loop->most, sizeof(Row));
    demand->row_rank = (int)loop->row_rank;
    demand->dt = loop->dt;
    demand->threshold = loop->threshold;
    demand->ceiling = loop->ceiling;
    demand->fixed = loop->fixed;
    demand->speed = loop->speed;
    measured_by(loop, tool, demand->root);
    demand->cone.limit = loop->speed_limit;
    if (loop->speed_limit > 0.0)
        limited_point(loop, tool, demand);
    if (loop->has_braking != 0.0)
        return braking_box(loop, q, before, demand->lower, demand->upper);
    box(loop, q, demand->lower, demand->upper);
    return DONE;
}

/* `before` is the joint velocity now, which acceleration limits count from. */
Outcome step(const Loop *loop, const double *q, const Pose *target, const double *feedforward, const double *before,
             Convergence *watch, double turn[3], Solution *solution)
{
    Demand demand;
    Pose tool, home;
    double error[6], measured[6], change[6], square = 0.0, share = 1.0;
    int m = demand.m = (int)loop->joints;
    pose_from(loop->home, &home);
    kinematics(m, loop->screws, &home, q, demand.J, &tool);
    if (error_twist(target, &tool, error) == HAND_BACK || demand_in(loop, q, before, &tool, &demand) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < 6; i++)
        measured[i] = dot(6, demand.root[i], error);
    if (loop->has_braking != 0.0 && approach(loop, &demand, measured, &share) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < 6; i++) {
        demand.s[i] = share * loop->gain * error[i] + (feedforward == NULL ? 0.0 : feedforward[i]);
        square += demand.s[i] * demand.s[i];
    }
    if (!(square < INFINITY))
        return HAND_BACK;
    demand.has_posture = loop->has_posture != 0.0;
    for (int j = 0; j < m; j++)
        demand.posture[j] = demand.has_posture ? (loop->middle[j] - q[j]) * loop->pull[j] : 0.0;
    if (rows_of(loop->exact, (int)loop->wanted, share * loop->gain, &tool, target, feedforward, &demand) == HAND_BACK ||
        solve(&demand, solution) == HAND_BACK)
        return HAND_BACK;
    double moved[6];
    for (int i = 0; i < 6; i++)
        moved[i] = dot(m, demand.J[i], solution->velocity) - (feedforward == NULL ? 0.0 : feedforward[i]);
    for (int i = 0; i < 6; i++)
        change[i] = -loop->dt * dot(6, demand.root[i], moved);
    watched(loop, measured, change, watch);
    for (int i = 0; i < 3; i++)
        turn[i] = error[i];
    return DONE;
}
