/* Twin of control/beside.py, path_drive.py, path_report.py and the tick of path_driver.py: a tick on the path.

       s = P'(sigma) v + gain e_across,     v <= what the joints can do here and can still brake from before what comes

   An arm that is far off is handed back, and where the path is left or ends short. */

#include "path.h"
#include <string.h>

/* beside.py; J and asked as in the beginning of the tick */
typedef struct {
    Row J[6], joints;
    int rows;
    double asked[6][6], place, across[6], off;
} Beside;

/* beside.py */
static Outcome look(const Loop *loop, const Course *course, const Travel *state, const double *q, Demand *demand,
                    Beside *here)
{
    Pose tool, home, target;
    double p[3], root[6][6], V[6][6], error[6], tangent[6], ahead[6], behind[6], expected = state->place;
    int m = course->m, i = piece_at(course, expected);
    if (fmax(course->off[i], course->off[i + 1]) > ASIDE * loop->length)
        return HAND_BACK;
    if (isnan(state->tangent[0]))
        curve_tangent(course, expected, tangent);
    else
        memcpy(tangent, state->tangent, sizeof tangent);
    curve_pose(course, expected, &target);
    pose_from(loop->home[0], &home);
    kinematics(m, loop->screws, &home, q, here->J, &tool);
    if (error_twist(&target, &tool, error) == HAND_BACK)
        return HAND_BACK;
    place(&tool, loop->point, p);
    root_at(p, loop->length, root);
    memcpy(demand->J, here->J, sizeof here->J);
    if (asked(loop, &tool, &target, p, (const double(*)[6])root, demand, V, &here->rows) == HAND_BACK)
        return HAND_BACK;
    if (loop->wanted > 0.0)
        own_way(demand, (const double(*)[6])V, p, loop->length, error);
    measured_rows(here->rows, (const double(*)[6])V, (const double(*)[6])root, here->asked);
    for (int k = 0; k < here->rows; k++) {
        ahead[k] = dot(6, here->asked[k], tangent);
        behind[k] = dot(6, here->asked[k], error);
    }
    double end = course->curve_at[course->poses - 1], apart = dot(here->rows, behind, behind) / (end * end);
    double shift = dot(here->rows, ahead, behind) / (dot(here->rows, ahead, ahead) + course->slow * course->slow + apart);
    here->place = between(expected - shift, course->at[0], course->at[course->knots - 1]);
    shift = expected - here->place;
    for (int k = 0; k < here->rows; k++)
        behind[k] -= shift * ahead[k];
    for (int k = 0; k < 6; k++)
        here->across[k] = error[k] - shift * tangent[k];
    here->off = norm(here->rows, behind);
    joints_at(course, here->place, here->joints);
    return DONE;
}

/* path_drive.py: the twist of a tick and its posture, with the arm in the middle of it. */
static Outcome twist_of(const Loop *loop, const Course *course, const Beside *here, const double *q, double rate,
                        double strayed, const Row slope, const double tangent[6], Pose *tool, Demand *demand)
{
    int m = course->m, i = piece_at(course, here->place), rows;
    double turning[6], home[6], along[6], across[6], carry[6], p[3], root[6][6], V[6][6], differ[6], part[6];
    double half = 0.5 * loop->dt * rate, ratio = fmin(course->ratio[i], course->ratio[i + 1]);
    double regular = (ratio - SINGULAR) / (REGULAR - SINGULAR);
    double own = fmin(fmax(fmax(regular, strayed), 0.0), 1.0);
    Row middle, astray;
    Pose end;
    for (int j = 0; j < m; j++) {
        middle[j] = q[j] + half * slope[j];
        astray[j] = here->joints[j] - q[j];
        demand->posture[j] = rate * slope[j] + JOINT_GAIN * astray[j];
    }
    demand->has_posture = true;
    demand->paced = demand->chased = false;
    pose_from(loop->home[0], &end);
    kinematics(m, loop->screws, &end, middle, demand->J, tool);
    for (int k = 0; k < 6; k++) {
        turning[k] = dot(m, demand->J[k], slope);
        home[k] = dot(m, demand->J[k], astray);
        along[k] = own == 1.0 ? tangent[k] : (1.0 - own) * turning[k] + own * tangent[k];
        carry[k] = half * turning[k];
    }
    lie(carry, here->across, across);
    for (int k = 0; k < 6; k++)
        across[k] += here->across[k];
    if (loop->wanted > 0.0) {
        place(tool, loop->point, p);
        root_at(p, loop->length, root);
        if (asked(loop, tool, tool, p, (const double(*)[6])root, demand, V, &rows) == HAND_BACK)
            return HAND_BACK;
        for (int k = 0; k < 6; k++)
            differ[k] = along[k] - turning[k];
        asked_part(rows, (const double(*)[6])V, p, (const double(*)[6])root, loop->length, differ, part);
        for (int k = 0; k < 6; k++) {
            along[k] = turning[k] + part[k];
            differ[k] = across[k] - home[k];
        }
        asked_part(rows, (const double(*)[6])V, p, (const double(*)[6])root, loop->length, differ, part);
        for (int k = 0; k < 6; k++)
            across[k] = home[k] + part[k];
    } else if (m < 6) {
        memcpy(along, turning, sizeof along);
        memcpy(across, home, sizeof across);
    }
    double gain = loop->has_braking != 0.0 ? loop->gain * share_within(loop, loop->gain, astray) : loop->gain;
    for (int k = 0; k < 6; k++)
        demand->s[k] = rate * along[k] + gain * across[k];
    return DONE;
}

/* Where limits would take the tool off its path: the same with exact rows, which slow down. */
static Outcome slower(const Loop *loop, const Beside *here, Demand *demand, Solution *answer, double *kept)
{
    double missed[6], largest = MISSED * loop->length;
    bool active = false;
    for (int j = 0; j < demand->m; j++)
        active = active || answer->active[j];
    for (int k = 0; k < here->rows && active; k++)
        missed[k] = dot(6, here->asked[k], answer->residual);
    if (!active || !(norm(here->rows, missed) * loop->dt > largest))
        return DONE;
    Solution exact;
    demand->rows = here->rows;
    demand->row_rank = -1;
    demand->of_twist = true;
    memcpy(demand->D, here->asked, sizeof here->asked);
    for (int k = 0; k < here->rows; k++)
        demand->e[k] = dot(6, here->asked[k], demand->s);
    product_of_rows(here->rows, (const double(*)[6])here->asked, demand->m, (const Row *)demand->J, demand->C);
    if (solve(demand, &exact) == HAND_BACK)
        return HAND_BACK;
    if ((exact.limited && !exact.slow) || exact.scale <= PROGRESS_SHARE)
        return DONE;
    *answer = exact;
    *kept = exact.scale;
    return DONE;
}

/* path_report.py: whether joints count as at rest. */
static bool stands(const Loop *loop, const Row velocity)
{
    for (int j = 0; j < (int)loop->joints; j++)
        if (!(fabs(velocity[j]) <= SLOW_JOINT * (isfinite(loop->fastest[j]) ? loop->fastest[j] : 1.0)))
            return false;
    return true;
}

/* path_report.py; `stop` is whether the tool was to come to rest. */
static Outcome told(const Loop *loop, const Course *course, const Beside *here, const Order *order, bool stop,
                    Progress *progress)
{
    double dt = loop->dt, end = course->at[course->knots - 1], path = course->curve_at[course->poses - 1];
    double moved[6], fast[6];
    double near = (course->cut ? STOPPED : ARRIVED) * path;
    bool still = !stop && stands(loop, progress->answer.velocity);
    bool close = !stop && end - progress->after.place <= near, arrived = close && still;
    progress->place = caller_place(course, progress->after.place);
    progress->speed = (progress->place - caller_place(course, here->place)) / dt;
    progress->across = here->off;
    progress->status = MOVING;
    if ((arrived && course->cut) || course->off[nearest(course, here->place)] > OFF_PATH * loop->length)
        return HAND_BACK;
    for (int k = 0; k < 6 && arrived; k++)
        moved[k] = dot(course->m, here->J[k], progress->answer.velocity);
    for (int k = 0; k < here->rows && arrived; k++)
        fast[k] = dot(6, here->asked[k], moved);
    if (arrived && here->off + dt * norm(here->rows, fast) <= course->tolerance) {
        progress->status = AT_END;
        progress->ruling = ENDED;
    } else if (order->paused && progress->after.speed * dt <= STANDING * path)
        progress->status = PAUSED;
    else if (still && progress->after.back != 0.0 && progress->after.place - course->at[0] <= near) {
        progress->status = PAUSED;
        progress->ruling = THE_START;
    } else if (close)
        progress->ruling = SETTLING;
    else if (progress->ruling != THE_RATE)
        progress->status = SLOWED;
    return DONE;
}

/* path_drive.py and path_driver.py; `before` has the joint velocity now. */
Outcome drive(const Loop *loop, const Course *course, const Travel *before, const double *q, const Row there,
              const Order *order, Progress *progress)
{
    Beside here;
    Demand demand;
    Pose tool;
    Row slope;
    double dt = loop->dt, length = loop->length, most = 0.0, speed, possible, kept = 1.0;
    int m = demand.m = course->m;
    bool back = before->back != 0.0, turning = order->back != back, stop = order->paused || turning;
    if (is_far(loop, q) || look(loop, course, before, q, &demand, &here) == HAND_BACK)
        return HAND_BACK;
    for (int j = 0; j < m; j++)
        most = fmax(most, fabs(here.joints[j] - q[j]));
    if (!(here.off <= AWAY * AWAY_STOP * length) || !(most <= DISPLACED)) /* pushed */
        return HAND_BACK;
    double away = fmax(here.off / (AWAY * length), 1.0), strayed = most / STRAYED;
    double near = fmin(fmax(0.0, (AWAY_STOP - away) / (AWAY_STOP - 1.0)), 1.0 / fmax(strayed, 1.0));
    if (paced(course, dt, before, here.place, near, order->override, stop, &speed, &possible, &progress->ruling) ==
        HAND_BACK)
        return HAND_BACK;
    if (progress->ruling == THE_PAUSE && !order->paused)
        progress->ruling = THE_TURN;
    double rate = possible_rate(loop, course, before, here.place, back ? -speed : speed, possible);
    Travel *after = &progress->after;
    double middle = between(here.place + 0.5 * dt * rate, course->at[0], course->at[course->knots - 1]);
    slope_at(course, middle, slope);
    curve_tangent(course, middle, after->tangent);
    if (twist_of(loop, course, &here, q, rate, strayed, slope, after->tangent, &tool, &demand) == HAND_BACK ||
        demand_in(loop, there, before->velocity, &tool, &demand) == HAND_BACK)
        return HAND_BACK;
    if (demand.form != NULL && demand.form->form == BROUGHT)
        return HAND_BACK;
    demand.dt = 0.0; /* not calm, and hardly damped: the joint motion is planned */
    demand.threshold = loop->planned_threshold;
    demand.ceiling = loop->planned_ceiling;
    if (rows_of(loop->exact, (int)loop->wanted, 0.0, &tool, &tool, demand.s, &demand) == HAND_BACK ||
        solve(&demand, &progress->answer) == HAND_BACK)
        return HAND_BACK;
    if (loop->wanted > 0.0 && progress->answer.scale < HELD)
        return HAND_BACK; /* the planned motion instead */
    if (loop->wanted > 0.0)
        kept = progress->answer.scale;
    else if (loop->has_braking == 0.0 && rate != 0.0 &&
             slower(loop, &here, &demand, &progress->answer, &kept) == HAND_BACK)
        return HAND_BACK;
    double low = fmin(kept * rate, rate), high = fmax(kept * rate, rate), went = rate;
    double squares = dot(m, slope, slope);
    if (low < high && squares > 0.0)
        went = between(dot(m, slope, progress->answer.velocity) / squares, low, high);
    rate *= kept;
    bool turned_round = turning && fabs(rate) * dt <= STANDING * course->at[course->knots - 1];
    after->place = here.place + dt * rate;
    after->speed = turned_round ? 0.0 : fabs(rate);
    after->acceleration = turned_round ? 0.0 : (after->speed - before->speed) / dt;
    after->back = turned_round ? order->back : back;
    after->ticks = before->ticks + 1.0;
    for (int j = 0; j < m; j++)
        after->along[j] = went * slope[j];
    memcpy(after->velocity, progress->answer.velocity, sizeof after->velocity);
    return told(loop, course, &here, order, order->paused || (turning && !turned_round), progress);
}
