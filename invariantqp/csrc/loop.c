/* Twin of control/controller.py, measure.py, memory.py, convergence.py and velocity/limits/box.py: one tick of a loop.

       s = b gain log(T_target T^-1) + feedforward,     velocity = law(J(q), s, box(q)) */

#include "loop.h"
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
static void box(const Loop *loop, const double *q, Demand *demand)
{
    double rate = 1.0 / loop->time;
    for (int j = 0; j < (int)loop->joints; j++) {
        double place = q[j] * rate, fastest = loop->fastest[j], low = loop->low[j] - place, high = loop->high[j] - place;
        demand->lower[j] = between(low, -fastest, fastest);
        demand->upper[j] = between(high, -fastest, fastest);
        demand->chase.lower[j] = fmin(low, fastest);
        demand->chase.upper[j] = fmax(high, -fastest);
    }
}

/* convergence.py: seen, then commanded */
static void watched(const Loop *loop, const double error[6], const double change[6], Memory *memory)
{
    double share = 1.0 / MEMORY, size = norm(6, error);
    if (!isnan(memory->expected)) {
        memory->promised = (1.0 - share) * memory->promised + share * (memory->size - memory->expected);
        memory->achieved = (1.0 - share) * memory->achieved + share * (memory->size - size);
        memory->ticks++;
    }
    double after[6];
    for (int i = 0; i < 6; i++)
        after[i] = error[i] + change[i];
    memory->expected = norm(6, after);
    memory->speed = (1.0 - share) * memory->speed + share * loop->slowness / loop->dt * norm(6, change);
    memory->size = size;
}

/* convergence.py: whether the loop does not converge; Python has the words for it. */
bool has_trouble(const Memory *memory)
{
    return memory->ticks >= MEMORY && memory->speed >= FAST_SHARE && memory->promised > 0.0 &&
           memory->achieved < KEPT_SHARE * memory->promised;
}

/* limits/box.py: whether a joint at a limit is outside its range, where Python has words for it. */
bool is_outside(const Loop *loop, const double *q, const Solution *solution)
{
    for (int j = 0; j < solution->m && loop->has_braking == 0.0; j++)
        if (solution->active[j] && fmax(q[j] - loop->position_upper[j], loop->position_lower[j] - q[j]) > OUTSIDE)
            return true;
    return false;
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
    for (int j = 0; j < (int)loop->joints; j++)
        if (fmax(q[j] - loop->position_upper[j], loop->position_lower[j] - q[j]) > FAR_OUTSIDE)
            return HAND_BACK; /* Python decides whether that can be true */
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
        return braking_box(loop, q, before, demand);
    box(loop, q, demand);
    return DONE;
}

/* The tick towards a target and, without one (NULL), `Controller.follow` for the twist `feedforward`. `before` is the
   joint velocity now, which acceleration limits count from. */
Outcome step(const Loop *loop, const double *q, const Pose *target, const double *feedforward, const double *before,
             Memory *memory, Solution *solution)
{
    Demand demand;
    Pose tool, home;
    double error[6] = {0.0}, measured[6], change[6], most = 0.0, square = 0.0, share = target == NULL ? 0.0 : 1.0;
    int m = demand.m = (int)loop->joints;
    pose_from(loop->home, &home);
    kinematics(m, loop->screws, &home, q, demand.J, &tool);
    if ((target != NULL && error_twist(target, &tool, error) == HAND_BACK) ||
        demand_in(loop, q, before, &tool, &demand) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < 6; i++)
        measured[i] = dot(6, demand.root[i], error);
    if (target != NULL && loop->has_braking != 0.0 && approach(loop, &demand, measured, &share) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < 6; i++) {
        demand.s[i] = share * loop->gain * error[i] + (feedforward == NULL ? 0.0 : feedforward[i]);
        most = fmax(most, fabs(demand.s[i]));
        square += demand.s[i] * demand.s[i];
    }
    if (!(square < INFINITY) || (target == NULL && most > LARGEST_SPEED))
        return HAND_BACK;
    demand.has_posture = loop->has_posture != 0.0;
    demand.paced = true;
    for (int j = 0; j < m; j++) {
        demand.posture[j] = demand.has_posture ? (loop->posture[j] - q[j]) * loop->pull[j] : 0.0;
        demand.fastest[j] = isfinite(loop->fastest[j]) ? loop->fastest[j] : 1.0;
    }
    const Pose *wanted = target == NULL ? &tool : target;
    demand.chased = target != NULL;
    if (demand.chased) {
        for (int i = 0; i < 6; i++)
            demand.chase.ahead[i] = feedforward == NULL ? 0.0 : feedforward[i];
        demand.chase.slack = loop->slack;
        demand.chase.apart = loop->carried == 0.0;
        if (loop->wanted > 0.0) {
            if (rows_of(loop->exact, (int)loop->wanted, 0.0, &tool, wanted, feedforward, &demand) == HAND_BACK)
                return HAND_BACK;
            memcpy(demand.chase.rows_ahead, demand.e, sizeof demand.chase.rows_ahead);
        }
    }
    if (rows_of(loop->exact, (int)loop->wanted, share * loop->gain, &tool, wanted, feedforward, &demand) == HAND_BACK ||
        solve(&demand, solution) == HAND_BACK)
        return HAND_BACK;
    memcpy(memory->velocity, solution->velocity, (size_t)m * sizeof(double));
    if (target == NULL)
        return DONE;
    double moved[6];
    for (int i = 0; i < 6; i++)
        moved[i] = dot(m, demand.J[i], solution->velocity) - (feedforward == NULL ? 0.0 : feedforward[i]);
    for (int i = 0; i < 6; i++)
        change[i] = -loop->dt * dot(6, demand.root[i], moved);
    watched(loop, measured, change, memory);
    memcpy(memory->turn, error, sizeof memory->turn);
    return DONE;
}
