/* Twin of control/controller.py, measure.py, memory.py and velocity/limits.py (JointBox): one tick of a loop.

       s = b gain log(T_target T^-1) + feedforward,     velocity = law(J(q), s, box(q)) */

#include "loop.h"
#include <string.h>

/* measure.py: the root of this tick's measure, at a point of the tool or of a metric carried by a body. */
static void measured_by(const Loop *loop, const Pose *tool, double root[6][6])
{
    double p[3], ad[6][6] = {{0.0}};
    if (loop->carried == AT_A_POINT) {
        place(tool, loop->point, p);
        root_at(p, loop->length, root);
        return;
    }
    memcpy(root, loop->root, sizeof loop->root);
    if (loop->carried == BY_THE_BASE)
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

/* velocity/limits.py, JointBox */
static void box(const Loop *loop, const double *q, const double *speeds, Demand *demand)
{
    for (int j = 0; j < loop->joints; j++) {
        double fastest = speeds[j], low = loop->rate * (loop->position_lower[j] - q[j]), high = loop->rate * (loop->position_upper[j] - q[j]);
        demand->lower[j] = between(low, -fastest, fastest);
        demand->upper[j] = between(high, -fastest, fastest);
        demand->chase.lower[j] = fmin(low, fastest);
        demand->chase.upper[j] = fmax(high, -fastest);
    }
}

/* memory.py, ticks_late: a delay in whole ticks, and the share of one more */
static int ticks_late(const Loop *loop, double *part)
{
    double late = loop->delay / loop->dt;
    int whole = (int)(late + WHOLE_TICKS);
    *part = fmax(0.0, late - whole);
    return whole;
}

/* memory.py: how many of the last commands are kept. */
int commands_of(const Loop *loop)
{
    double part;
    return ticks_late(loop, &part) + 2;
}

/* robots/kinematics.py, joint_displacement: of a continuous joint the shortest. */
double displacement(const Loop *loop, int j, double start, double end)
{
    return loop->turns[j] > 0.0 ? remainder(end - start, loop->turns[j]) : end - start;
}

/* memory.py: where the states of the joints begin, and how many numbers they are. */
static int states_at(const Loop *loop) { return KEPT + (1 + commands_of(loop)) * loop->joints; }

int states_of(int joints) { return STATE_ROWS * joints + RATIO_NUMBERS; }

/* Whether a joint is unresponsive. */
bool any_unresponsive(const double *states, int joints)
{
    for (int j = 0; j < joints; j++)
        if (states[UNRESPONSIVE_ROW * joints + j] > 0.0)
            return true;
    return false;
}

/* response.py, after: a tick in which joints were commanded to move, and moved, by displacements (m,). */
static void respond(const Loop *loop, const double *commanded, const double *moved, double *response)
{
    int m = loop->joints;
    double left = fmax(1.0 - loop->dt / RESPONSE_MEMORY, 0.0);
    bool some = false, resumes = false, before[MOST], alone[MOST], beside[MOST], stays[MOST];
    for (int j = 0; j < m; j++) {
        double *r = response + j, unit = loop->fastest[j] > 0.0 ? fmin(loop->fastest[j], FULL_SPEED) : FULL_SPEED;
        double step = moved[j] / unit, order = commanded[j] / unit;
        before[j] = r[UNRESPONSIVE_ROW * m] > 0.0;
        double scatter = r[SCATTER_ROW * m] = left * r[SCATTER_ROW * m] + (1.0 - left) * step * step;
        double rest = r[REST_ROW * m] = left * r[REST_ROW * m] + (1.0 - left) * (step - order) * (step - order);
        double told = r[COMMANDED_ROW * m] = left * r[COMMANDED_ROW * m] + order;
        double done = r[MOVED_ROW * m] = (before[j] ? 1.0 : left) * r[MOVED_ROW * m] + step;
        bool enough = fabs(done) >= RESPONSE_SHARE * fabs(told), responds = enough && !before[j];
        double silent = r[SILENT_ROW * m] = responds ? 0.0 : r[SILENT_ROW * m] + loop->dt;
        double unanswered = r[UNANSWERED_ROW * m] = responds ? 0.0 : r[UNANSWERED_ROW * m] + order;
        bool scatters = (!enough || done * done <= SCATTER * fmin(scatter, rest)) && rest >= EXPLAINED * scatter;
        stays[j] = scatters && fmax(fabs(told), fabs(order) * (RESPONSE_MEMORY / loop->dt)) > COMMANDED_REST;
        resumes = resumes || (r[UNRESPONSIVE_ROW * m] == 1.0 && !scatters);
        alone[j] = silent > RESPONSE_TIME && fabs(unanswered) > LEAST_COMMANDED;
        beside[j] = silent > 0.0;
    }
    for (int j = 0; j < m; j++) {
        if (before[j]) {
            beside[j] = stays[j] && !resumes;
            alone[j] = beside[j] && (alone[j] || response[UNRESPONSIVE_ROW * m + j] == 1.0);
        }
        some = some || alone[j];
    }
    for (int j = 0; j < m; j++) {
        double *r = response + j, now = r[UNRESPONSIVE_ROW * m] = alone[j] ? 1.0 : beside[j] && some ? 0.5 : 0.0;
        if (before[j] && now == 0.0)
            r[SILENT_ROW * m] = r[UNANSWERED_ROW * m] = 0.0;
        if (now > 0.0 && !before[j])
            r[MOVED_ROW * m] = 0.0; /* since then */
    }
}

/* motion_ratio.py, at_first */
static void reset_ratio(int m, double *pending)
{
    memset(pending, 0, (size_t)(m + RATIO_NUMBERS) * sizeof(double));
    pending[m + FINEST] = INFINITY;
}

/* motion_ratio.py, after */
static void update_ratio(const Loop *loop, const double *commanded, const double *moved, bool responds, double *pending, double *ratio)
{
    int m = loop->joints;
    bool known = responds && !isnan(pending[0]);
    double moved2 = 0.0, pending2 = 0.0, product = 0.0, commanded2 = 0.0, finest = INFINITY;
    for (int j = 0; j < m; j++) {
        double step = moved[j];
        pending[j] = known ? pending[j] + commanded[j] : NAN;
        commanded2 += commanded[j] * commanded[j];
        pending2 += known ? pending[j] * pending[j] : 0.0;
        product += known ? pending[j] * step : 0.0;
        moved2 += step * step;
        finest = step != 0.0 ? fmin(finest, fabs(step)) : finest;
    }
    double interval = ratio[WAITING] + 1.0;
    if (fmax(moved2, commanded2) <= COMMANDED_REST * COMMANDED_REST || interval * loop->dt > LONGEST_INTERVAL) {
        reset_ratio(m, pending);
        return;
    }
    if (moved2 == 0.0) {
        ratio[WAITING]++;
        return;
    }
    double kept = fmax(1.0 - interval * loop->dt / RESPONSE_TIME, 1.0 - 1.0 / FEWEST_UPDATES);
    double expected = ratio[RATIO_COMMANDED] > 0.0 ? ratio[RATIO_PRODUCT] / ratio[RATIO_COMMANDED] : 0.0;
    if (moved2 > 4.0 * fmax(ratio[LARGEST], expected * expected * pending2)) /* another motion */
        kept = ratio[INTERVAL] = ratio[RATIO_TIME] = 0.0;
    double largest = fmax(fmax(moved2, pending2), kept * ratio[LARGEST]);
    memset(pending, 0, (size_t)m * sizeof(double));
    ratio[RATIO_COMMANDED] = kept * ratio[RATIO_COMMANDED] + pending2;
    ratio[RATIO_PRODUCT] = kept * ratio[RATIO_PRODUCT] + product;
    ratio[RATIO_MOVED] = kept * ratio[RATIO_MOVED] + moved2;
    ratio[UPDATES] = kept * ratio[UPDATES] + 1.0;
    ratio[RATIO_TIME] = ratio[RATIO_TIME] * fmin(ratio[LARGEST] / largest, 1.0) + interval * loop->dt;
    ratio[LARGEST] = largest;
    ratio[WAITING] = 0.0;
    ratio[INTERVAL_BEFORE] = ratio[INTERVAL];
    ratio[INTERVAL] = interval;
    ratio[FINEST] = fmin(ratio[FINEST], finest);
}

/* memory.py, JointStates.after: a tick in which joints were commanded to move, and moved, by displacements (m,). */
void update_states(const Loop *loop, const double *commanded, const double *moved, double *states)
{
    int m = loop->joints;
    double *pending = states + PENDING_ROW * m;
    respond(loop, commanded, moved, states);
    update_ratio(loop, commanded, moved, !any_unresponsive(states, m), pending, states + STATE_ROWS * m);
}

/* motion_ratio.py, trouble; unresponsive joints are told before. */
JointTrouble joint_trouble(int m, double dt, double gain, double fastest_gain, bool chases, const double *states)
{
    const double *numbers = states + STATE_ROWS * m;
    double commanded = numbers[RATIO_COMMANDED], moved = numbers[RATIO_MOVED], product = numbers[RATIO_PRODUCT];
    double ratio = commanded > 0.0 ? product / commanded : 0.0, updates = numbers[UPDATES];
    double ticks = fmin(numbers[INTERVAL], numbers[INTERVAL_BEFORE]), farthest = -1.0;
    double counts = MOST_COUNTS * numbers[FINEST];
    bool large = fmax(commanded, moved) >= LEAST_MOVED * LEAST_MOVED * updates;
    bool fine = ratio < 1.0 || moved >= counts * counts * updates, many = fine && m * updates >= MANY_MOVED;
    bool lagging = ratio > MOST_RATIO && moved >= LARGE_OSCILLATION * LARGE_OSCILLATION * updates;
    double share = lagging ? OSCILLATES : PROPORTIONAL;
    bool proportional = ratio > 0.0 && product * product >= share * commanded * moved;
    bool measured = ticks > 0.0 && (large || many) && proportional, lasts = numbers[RATIO_TIME] > RESPONSE_TIME;
    if (ticks > 1.0 && ticks * fastest_gain * dt > OVERSHOOT && (large || measured))
        return (JointTrouble){WHY_STATES_ARE_OLD, 0, {ticks, 1e3 * ticks * dt, 1e3 * dt}};
    bool too_far = ratio > MOST_RATIO || ratio * ticks * fastest_gain * dt > OVERSHOOT;
    if (measured && (too_far || (ratio < LEAST_RATIO && lasts)))
        return (JointTrouble){WHY_DT_IS_WRONG, 0, {ratio, 1e3 * ratio * dt, 1e3 * dt}};
    JointTrouble found = {0};
    double slow = LEAST_SPEED * dt, near = LEAST_OSCILLATION * gain * dt, progress = product - 0.5 * gain * dt * moved;
    bool follows = ratio >= KEPT_SHARE || commanded <= slow * slow * updates;
    bool oscillates = commanded >= near * near * updates && progress < KEPT_SHARE * commanded;
    if (!(chases && (oscillates || !follows) && lasts))
        return found;
    found.code = WHY_NOT_FOLLOWING;
    for (int j = 0; j < m; j++) { /* response.py, farthest */
        double off = fabs(states[COMMANDED_ROW * m + j] - states[MOVED_ROW * m + j]);
        found.joint = off > farthest ? j : found.joint;
        farthest = fmax(farthest, off);
    }
    return found;
}

/* memory.py, observed: the states of the joints at measured positions q (m,). */
void joint_states(const Loop *loop, const double *q, const double *kept, double *states)
{
    int m = loop->joints, whole;
    double part;
    Row commanded, moved;
    const double *positions = kept + KEPT, *commands = positions + m;
    whole = ticks_late(loop, &part);
    if (isnan(positions[0])) {
        memset(states, 0, (size_t)states_of(m) * sizeof(double));
        reset_ratio(m, states + PENDING_ROW * m);
        return;
    }
    memcpy(states, kept + states_at(loop), (size_t)states_of(m) * sizeof(double));
    for (int j = 0; j < m; j++) {
        commanded[j] = loop->dt * ((1.0 - part) * commands[whole * m + j] + part * commands[(whole + 1) * m + j]);
        moved[j] = displacement(loop, j, positions[j], q[j]);
    }
    update_states(loop, commanded, moved, states);
}

/* memory.py, in_flight and now: where the joints are when the command of this tick acts, and how fast before it. */
void predicted(const Loop *loop, const double *kept, const double *states, const double *q, Row there, Row before)
{
    int m = loop->joints;
    double part;
    int whole = ticks_late(loop, &part);
    const double *commands = kept + KEPT + m;
    for (int j = 0; j < m; j++) {
        double sum = 0.0;
        bool rests = states[UNRESPONSIVE_ROW * m + j] > 0.0;
        for (int i = 0; i < whole; i++)
            sum += commands[i * m + j];
        there[j] = rests ? q[j] : q[j] + loop->dt * (sum + part * commands[whole * m + j]);
        before[j] = rests ? 0.0 : commands[j];
    }
}

/* memory.py, after: a tick at q that gave a command. */
void remembered(const Loop *loop, const double *q, const Tick *tick, double *kept)
{
    int m = loop->joints, count = commands_of(loop);
    double *commands = kept + KEPT + m;
    memcpy(kept, tick->turn, sizeof tick->turn);
    memcpy(kept + KEPT, q, (size_t)m * sizeof(double));
    memmove(commands + m, commands, (size_t)((count - 1) * m) * sizeof(double));
    memcpy(commands, tick->solution.velocity, (size_t)m * sizeof(double));
    memcpy(kept + states_at(loop), tick->states, (size_t)states_of(m) * sizeof(double));
}

/* velocity/limits.py: how far a joint is outside its range, negative inside. */
double outside_by(const Loop *loop, const double *q, int j)
{
    return fmax(q[j] - loop->position_upper[j], loop->position_lower[j] - q[j]);
}

/* control/limits.py: whether joint positions or a target, where there is one, may not be true; Python decides. */
bool is_far(const Loop *loop, const double *q, const Pose *target)
{
    double way[3] = {0.0};
    for (int i = 0; i < 3 && target != NULL; i++)
        way[i] = target->p[i] - loop->tip[i];
    if (norm(3, way) > loop->far)
        return true;
    for (int j = 0; j < loop->joints; j++)
        if (outside_by(loop, q, j) > loop->beyond[j])
            return true;
    return false;
}

/* velocity/limits.py: the velocity v + omega x p of the limited point */
static void limited_point(const Loop *loop, const Pose *tool, Demand *demand)
{
    double p[3], root[6][6];
    place(tool, loop->fast, p);
    root_at(p, 1.0, root);
    for (int i = 0; i < 3; i++)
        demand->cone.start[i] = 0.0;
    product_of_rows(3, root + 3, demand->m, demand->J, demand->cone.J);
}

/* control/limits.py: joint speeds of this tick; no joint has to slow down faster than it can. */
static void joint_speeds(const Loop *loop, const Now *now, const double *before, Row speeds)
{
    for (int j = 0; j < loop->joints; j++) {
        double limit = now->speed * fmin(loop->fastest[j], now->velocity_limit[j]);
        if (loop->has_braking)
            limit = fmin(fmax(limit, fabs(before[j]) - loop->acceleration[j] * loop->dt), loop->fastest[j]);
        speeds[j] = limit;
    }
}

/* control/limits.py: the limit of the tool's speed in this tick, at least what the joints make of it that slow down alike. */
static void tool_speed_now(const Loop *loop, const Now *now, const double *before, const Pose *tool, Demand *demand)
{
    double limit = fmin(loop->speed_limit > 0.0 ? loop->speed_limit : INFINITY, now->tool_speed), share = 0.0;
    Row slower;
    if (limit == INFINITY)
        return;
    limited_point(loop, tool, demand);
    for (int j = 0; j < loop->joints; j++) {
        double size = fabs(before[j]), over = size - (loop->has_braking ? loop->acceleration[j] * loop->dt : INFINITY);
        share = over > 0.0 ? fmax(share, over / size) : share;
    }
    for (int j = 0; j < loop->joints; j++)
        slower[j] = between(share * before[j], demand->lower[j], demand->upper[j]);
    demand->cone.limit = fmax(limit * now->speed, tool_speed(&demand->cone, loop->joints, slower));
}

/* controller.py: of a demand what no target decides, for joint twists demand->J; `now` may be NULL. Whether no limits
   contradict each other. */
static bool demand_now(const Loop *loop, const Now *now, const double *q, const double *before, const Pose *tool,
                       Demand *demand, Tick *tick)
{
    bool rows = now != NULL && now->limits > 0, changed = now != NULL && now->has_velocity_limit, good = true;
    Row speeds;
    governed(&loop->law, demand);
    demand->limits = rows ? now->limits : loop->limits;
    memcpy(demand->G, rows ? now->G : loop->G, (size_t)demand->limits * sizeof(Row));
    memcpy(demand->least, rows ? now->least : loop->least, (size_t)demand->limits * sizeof(double));
    memcpy(demand->most, rows ? now->most : loop->most, (size_t)demand->limits * sizeof(double));
    demand->row_rank = loop->row_rank;
    measured_by(loop, tool, demand->root);
    demand->cone.limit = loop->speed_limit;
    if (loop->speed_limit > 0.0)
        limited_point(loop, tool, demand);
    if (changed)
        joint_speeds(loop, now, before, speeds);
    const double *fastest = changed ? speeds : loop->fastest;
    if (!loop->has_braking)
        box(loop, q, fastest, demand);
    else
        good = braking_box(loop, q, before, fastest, demand, tick);
    if (changed)
        tool_speed_now(loop, now, before, tool, demand);
    return good;
}

/* law.py: all that is asked for, at a share of its speed and as calm as at the whole; the limits are as they were. */
static void slowed(Demand *demand, double share)
{
    demand->dt /= share;
    demand->held /= share;
    demand->chase.slack *= share;
    for (int i = 0; i < 6; i++) {
        demand->s[i] *= share;
        demand->chase.ahead[i] *= share;
    }
    for (int i = 0; i < demand->rows; i++) {
        demand->e[i] *= share;
        demand->chase.rows_ahead[i] *= share;
    }
    for (int j = 0; j < demand->m; j++) {
        demand->posture[j] *= share;
        demand->fastest[j] *= share;
        demand->change[j] *= share;
    }
}

/* exact.py, ExactRows.of: more rows, parts of the twist. */
static Outcome with_rows(int rows, const double (*D)[6], const double twist[6], Demand *demand)
{
    int first = demand->rows;
    if (first + rows > MOST_ROWS)
        return HAND_BACK;
    memcpy(demand->D + first, D, (size_t)rows * sizeof *D);
    product_of_rows(rows, D, demand->m, (const Row *)demand->J, demand->C + first);
    for (int i = 0; i < rows; i++)
        demand->e[first + i] = dot(6, D[i], twist);
    demand->rows = first + rows;
    demand->of_twist = true;
    demand->row_rank = -1;
    return DONE;
}

/* tracking.py: the logarithm of a displacement that turns as it did in the tick before. */
static void same_turn(const double before[3], double error[6])
{
    double angle = norm(3, error), ratio = (angle - 2.0 * PI) / angle, slide = 0.0;
    if (angle < HALF_TURN || !(dot(3, before, error) < 0.0))
        return;
    for (int i = 0; i < 3; i++)
        slide += error[i] * error[3 + i] / angle;
    for (int i = 0; i < 3; i++) { /* same axis, same translation along it */
        error[3 + i] = ratio * error[3 + i] + (1.0 - ratio) * slide * (error[i] / angle);
        error[i] *= ratio;
    }
}

/* The tick towards a target and, without one (NULL), `Controller.follow` for the twist `feedforward`. `before` is the
   joint velocity now, which acceleration limits count from, or NULL for the last command, zero of a joint that stands; `kept` is what the loop keeps;
   `now` is what is other in this tick, or NULL; `beside` what `Controller.follow` may be given beside a twist. */
Outcome step_beside(const Loop *loop, const Now *now, const Beside *beside, const double *q, const Pose *target,
                    const double *feedforward, const double *before, const double *kept, Tick *tick)
{
    Demand demand;
    Pose tool, home;
    double speed = now != NULL ? now->speed : 1.0, error[6] = {0.0}, measured[6], ahead[6] = {0.0}, along[6], led[6], most = 0.0, square = 0.0, gain = 0.0;
    Row there, A[6], on[6], last;
    Braking braking = {.share = 1.0};
    int m = demand.m = loop->joints;
    demand.chased = target != NULL;
    memcpy(tick->turn, kept, sizeof tick->turn);
    joint_states(loop, q, kept, tick->states);
    predicted(loop, kept, tick->states, q, there, last);
    before = before == NULL ? last : before;
    if (beside->J != NULL) {
        memcpy(demand.J, beside->J, sizeof demand.J);
        tool = *beside->tool;
    } else {
        pose_from(loop->home[0], &home);
        kinematics(m, loop->screws, &home, there, demand.J, &tool);
    }
    if (is_far(loop, q, target) || (demand.chased && error_twist(target, &tool, error) == HAND_BACK))
        return HAND_BACK;
    demand_now(loop, now, there, before, &tool, &demand, tick);
    if (beside->at != NULL && loop->carried == AT_A_POINT)
        root_at(beside->at, loop->length, demand.root);
    if (demand.chased) {
        same_turn(tick->turn, error);
        memcpy(tick->turn, error, sizeof tick->turn);
    }
    bool at_tool = !demand.chased && !beside->at_base && !(now != NULL && now->at_base);
    for (int i = 0; i < 3 && at_tool; i++) /* v - omega x p, the velocity at the base's origin */
        ahead[3 + i] = tool.p[(i + 1) % 3] * feedforward[(i + 2) % 3] - tool.p[(i + 2) % 3] * feedforward[(i + 1) % 3];
    for (int i = 0; i < 6 && feedforward != NULL; i++) {
        ahead[i] += feedforward[i];
        error[i] += demand.chased ? loop->delay * speed * feedforward[i] : 0.0; /* the target, too, is on by then */
    }
    for (int i = 0; i < 6; i++)
        measured[i] = dot(6, demand.root[i], error);
    product_of_rows(6, demand.root, m, demand.J, A);
    if (demand.chased && loop->has_braking) {
        for (int i = 0; i < 6; i++)
            led[i] = speed * dot(6, demand.root[i], ahead);
        memcpy(on, A, sizeof on);
        if (loop->law.has_metric)
            product_with(6, m, on, loop->law.T);
        if (approach(loop, speed * loop->gain, &demand, (const Row *)on, measured, led, before, &braking) == HAND_BACK)
            return HAND_BACK;
    }
    gain = demand.chased ? braking.share * loop->gain : 0.0;
    for (int i = 0; i < 6; i++) {
        demand.s[i] = gain * error[i] + ahead[i];
        along[i] = demand.chased ? (1.0 + gain * loop->delay * speed) * ahead[i] : ahead[i];
        most = fmax(most, fabs(demand.s[i]));
        square += demand.s[i] * demand.s[i];
    }
    if (!(square < INFINITY) || (!demand.chased && most > LENGTH_LIMIT))
        return HAND_BACK;
    demand.held = 0.0;
    for (int j = 0; j < m && demand.dt > 0.0; j++)
        demand.held = fmax(demand.held, loop->rise + 0.5 * fabs(before[j] / loop->brakes[j]));
    demand.has_posture = loop->has_posture || beside->posture != NULL;
    demand.paced = demand.has_before = beside->posture == NULL;
    for (int j = 0; j < m; j++) {
        demand.posture[j] = !demand.paced ? beside->posture[j] : loop->has_posture ? displacement(loop, j, there[j], loop->posture[j]) * loop->pull[j] : 0.0;
        demand.fastest[j] = loop->fastest[j] > 0.0 && isfinite(loop->fastest[j]) ? loop->fastest[j] : 1.0;
        demand.before[j] = kept[KEPT + m + j];
        demand.change[j] = loop->change[j];
    }
    const Pose *wanted = demand.chased ? target : &tool;
    if (demand.chased) {
        memcpy(demand.chase.ahead, ahead, sizeof ahead);
        demand.chase.slack = loop->slack;
        demand.chase.apart = loop->carried == AT_A_POINT;
        if (loop->wanted > 0) {
            if (rows_of(loop->exact, loop->wanted, 0.0, &tool, wanted, ahead, &demand) == HAND_BACK)
                return HAND_BACK;
            memcpy(demand.chase.rows_ahead, demand.e, sizeof demand.chase.rows_ahead);
        }
    }
    if (rows_of(loop->exact, loop->wanted, gain, &tool, wanted, along, &demand) == HAND_BACK)
        return HAND_BACK;
    if (beside->rows > 0 && with_rows(beside->rows, beside->D, ahead, &demand) == HAND_BACK)
        return HAND_BACK;
    if (speed != 1.0)
        slowed(&demand, speed);
    if (now != NULL && now->has_brought)
        memcpy(demand.brought, now->brought, sizeof demand.brought);
    if (demand.chased && demand.limits == 0)
        demand.held = 0.0; /* controller.py, _held */
    if (demand.chased && loop->has_braking)
        braked(&braking, &demand);
    if (solve_measured(&demand, (const Row *)A, &tick->solution) == HAND_BACK)
        return HAND_BACK;
    for (int j = 0; j < m && !loop->has_braking; j++) {
        double outside = tick->solution.active[j] ? outside_by(loop, q, j) : 0.0;
        tick->outside[j] = outside > OUTSIDE ? outside : 0.0;
        tick->acceleration[j] = 0.0;
    }
    tick->chased = demand.chased;
    return DONE;
}
