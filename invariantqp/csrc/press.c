/* Twin of a tick of force/control.py in which nothing is found and nothing stops: sensor, split, estimate, checks, law, the
   loop's own tick, and what is remembered of them.

       s = P s_motion + sum of unit rates along Z */

#include "boundary.h"
#include "press.h"
#include <limits.h>
#include <string.h>

typedef struct {
    Tick tick;
    double motion[6], force[6], wrench[6], error[6], wanted[6], intensities[MOST_PARTS], way[3], shown[3], felt, asked, bound;
    double kept, room;
    Row J[6];
    bool speaks; /* whether something is to be said of the tick beside its status: Python has the words */
    Touch touch;
    PressTick read;
} Answered;

/* What is measured and wanted, in the frame of the contact. */
typedef struct {
    Pose frame, tool;
    double point[3], out[3], raw[6], inside[6], raw_inside[6], exert[6], error[6], felt[MOST_PARTS], asked[MOST_PARTS];
} Placed;

/* A (v in the contact's frame), for a twist of the base frame: its part along S. */
static void along(const Split *split, const Pose *frame, const double twist[6], double motion[6])
{
    double inside[6], kept[6];
    twist_in(frame, twist, inside);
    rows_times(6, split->motion, inside, kept);
    twist_out(frame, kept, motion);
}

/* The motion along S towards a target and with it, the first part no faster than `slide_speed`. */
static void slid(const Press *press, const Split *split, const Placed *placed, const double chase[6], const double *ahead, double motion[6])
{
    double chased[6], led[6] = {0.0}, share = 1.0;
    along(split, &placed->frame, chase, chased);
    if (ahead != NULL)
        along(split, &placed->frame, ahead, led);
    if (press->slide_speed < INFINITY) {
        double speed = place_speed(chased, placed->point, press->size);
        share = speed <= press->slide_speed ? 1.0 : press->slide_speed / speed;
    }
    for (int i = 0; i < 6; i++)
        motion[i] = led[i] + share * chased[i];
}

/* The motion along S from that of the last tick on. */
static void taken_up(const Press *press, const Split *split, const Placed *placed, double dt, const double last[6], double motion[6])
{
    double before[6], change[6];
    along(split, &placed->frame, last, before);
    for (int i = 0; i < 6; i++)
        change[i] = motion[i] - before[i];
    double size = press->size, fast = fmax(place_speed(before, placed->point, size), place_speed(motion, placed->point, size));
    double most = fmax(press->slide_speed, fast) * dt / TAKES_UP;
    double share = fmin(1.0, most / place_speed(change, placed->point, size));
    for (int i = 0; i < 6; i++)
        motion[i] = before[i] + share * change[i];
}

/* The reading in the frame of the contact; false for a way out that has turned round. */
static bool placed_at(const Press *press, const Split *split, const Hybrid *now, const double reading[6], Pressed *state,
                      Placed *placed, double measured[6])
{
    double out[6], missing[6];
    pose_from(now->contact[0], &placed->frame);
    place(&placed->frame, split->origin, placed->point);
    cleaned(press, reading, &placed->tool, state->smooth, placed->raw, measured);
    memset(placed->out, 0, sizeof placed->out);
    if (split->has_out) {
        twist_out(&placed->frame, split->out, out);
        velocity_at(out, placed->point, placed->out);
        double speed = fmax(norm(3, placed->out), TINY);
        for (int i = 0; i < 3; i++)
            placed->out[i] /= speed;
    }
    memcpy(placed->exert, now->has_exert ? now->exert : split->exert, sizeof placed->exert);
    wrench_in(&placed->frame, measured, placed->inside);
    wrench_in(&placed->frame, placed->raw, placed->raw_inside);
    for (int i = 0; i < 6; i++)
        missing[i] = placed->exert[i] - placed->inside[i];
    rows_times(6, split->force, missing, placed->error);
    rows_times(split->n, split->unit_parts, placed->inside, placed->felt);
    rows_times(split->n, split->unit_parts, placed->exert, placed->asked);
    return !(dot(3, placed->out, state->out) < 0.0);
}

/* The force and the moment that are an overload. */
static void overload_of(const Press *press, const Split *split, const Placed *placed, const double wanted[6], double noise,
                        double most[2])
{
    double load[2];
    load_at(wanted, placed->point, load);
    double force = fmax(split->load_force, load[0]), moment = fmax(split->load_moment, load[1]);
    most[0] = press->max_force;
    most[1] = press->max_moment;
    if (most[0] < 0.0)
        most[0] = force > 0.0 ? fmax(OVERLOAD * force, force + ABOVE_NOISE * noise) : NO_FORCE;
    if (most[1] < 0.0)
        most[1] = fmax(OVERLOAD * moment, moment + press->size * most[0]);
}

/* |f|, and |m| about the place of contact or the grip, where it is less. */
static void load_of(const Press *press, const Placed *placed, const double wrench[6], double load[2])
{
    double grip[3], other[2];
    place(&placed->tool, press->grip, grip);
    load_at(wrench, placed->point, load);
    load_at(wrench, grip, other);
    load[1] = fmin(load[1], other[1]);
}

/* Of a force the larger of its parts along the way out and across that. */
static double larger_part(const double force[3], const double out[3])
{
    double along = dot(3, out, force);
    return fmax(fabs(along), sqrt(fmax(dot(3, force, force) - along * along, 0.0)));
}

/* HybridController._read: what a tick tells the checks, and what is touched after it. */
static void read_tick(const Press *press, const Split *split, const Hybrid *now, double dt, const double reading[6],
                      const Placed *placed, const double wanted[6], const double missing[6], double noise, Pressed *state,
                      PressTick *tick)
{
    Pressing *pressing = &state->pressing;
    int presses = split->presses;
    double load[2], most = 0.0, moved[3], back[3], lever[3];
    weakest(presses, split->intensities, placed->raw_inside, placed->exert, &tick->felt, &tick->wanted,
            &tick->together);
    for (int i = 0; i < presses; i++) {
        Touch *touch = &pressing->touches[i];
        if ((int)pressing->touched != presses)
            touch_begun(touch);
        double asked = dot(6, split->intensities[i], placed->exert);
        double limit = loss_limit(touch->airborne == INFINITY && press->lost_below == 0.0 ? -1.0 : press->lost_below, asked, noise);
        most = fmax(most, limit);
        touched(touch, dot(6, split->intensities[i], placed->raw_inside), limit, noise, dt);
    }
    pressing->touched = presses;
    tick->dt = dt;
    memcpy(tick->reading, reading, sizeof tick->reading);
    tick->noise = noise;
    tick->limit = most;
    tick->touch = weakest_touch(presses, pressing->touches);
    if (most > 0.0 && tick->touch.touching == 0.0) /* in touch the press changes, too */
        noise_after(&state->noise, reading, state->last, fmax(noise, LEAST_NOISE * most));
    for (int i = 0; i < 3; i++)
        moved[i] = 0.0;
    if (!isnan(state->tool[0])) {
        Pose before;
        pose_from(state->tool, &before);
        for (int i = 0; i < 3; i++)
            lever[i] = placed->point[i] - placed->tool.p[i];
        for (int i = 0; i < 3; i++)
            back[i] = placed->tool.R[0][i] * lever[0] + placed->tool.R[1][i] * lever[1] + placed->tool.R[2][i] * lever[2];
        for (int i = 0; i < 3; i++)
            moved[i] = placed->point[i] - (dot(3, before.R[i], back) + before.p[i]);
    }
    tick->came = -dot(3, placed->out, moved);
    tick->commanded = -dot(3, placed->out, now->shows);
    for (int i = 0; i < 3; i++)
        tick->across[i] = moved[i] + tick->came * placed->out[i];
    overload_of(press, split, placed, wanted, noise, tick->most);
    load_of(press, placed, placed->raw, load);
    tick->force = press->max_force < 0.0 ? larger_part(placed->raw + 3, placed->out) : load[0];
    tick->moment = load[1];
    load_of(press, placed, missing, load);
    tick->missing = presses == 0 ? fmax(load[0] / tick->most[0], load[1] / tick->most[1]) : 0.0;
}

/* HybridController._setting */
static void setting_of(const Press *press, const Split *split, double arm, double dt, const Pressing *before,
                       const Monitor *monitor, bool held, const double *asked, double noise, Setting *setting)
{
    double most = 0.0, share = press->share, moves = 0.0;
    for (int i = 0; i < (int)monitor->asked; i++)
        moves = fmax(moves, monitor->answers[i].moves);
    for (int i = 0; i < split->n; i++)
        most = fmax(most, fabs(asked[i]));
    double speed = surface_speed(press, before->along, press->yields + moves);
    *setting = (Setting){.dt = dt,
                         .share = share,
                         .filter_time = press->filter_time,
                         .late = dt + press->filter_time + arm + UNKNOWN_LATE,
                         .noise = noise * sqrt(share / (2.0 - share)) + ROUGH * most,
                         .slope_speed = speed,
                         .steep = held ? 0.0 : before->steep + MAY_BE_STEEP * speed,
                         .begins = press->stiffness > 0.0 ? press->stiffness : STIFF,
                         .resolved = held ? 0.0 : RESOLVED * press->size,
                         .held = held};
}

/* HybridController._known: the stiffness of each constraint after a reading. */
static void known_now(const Press *press, const Split *split, const Placed *placed, bool late, const Setting *setting,
                      const PressTick *tick, Pressing *pressing)
{
    int n = split->n, presses = split->presses;
    double most = 0.0;
    for (int i = 0; (int)pressing->parts != n && i < n; i++)
        unknown_stiffness(setting->begins, &pressing->known[i]);
    for (int i = 0; (int)pressing->went != n && i < n; i++)
        pressing->ways[i] = (Shown){0.0, 0.0};
    pressing->parts = pressing->went = n;
    if (late && presses > 0)
        return;
    for (int i = 0; i < n; i++)
        most = fmax(most, fabs(placed->asked[i]));
    most = most > 0.0 ? most : INFINITY;
    for (int i = 0; i < n; i++) {
        double force = placed->felt[i], wish = placed->asked[i], way = pressing->ways[i].shown;
        const Touch *touch = i < presses ? &pressing->touches[i] : &tick->touch;
        bool there = touch->touching != 0.0 || (i < presses && touch_lasts(touch, press->lost_after));
        int lacks = (wish - force > SHORT * most) - (force - wish > SHORT * most);
        if (there)
            known_after(&pressing->known[i], force, way, setting, lacks, i >= presses || (touch->touching != 0.0 && force > tick->limit));
        else
            in_air(&pressing->known[i], force, way, tick->limit, touch->evidence, setting);
    }
}

/* HybridController._kept_gain: the share of the gain that noise and swings leave, and that of the joints' acceleration noise takes. */
static Outcome kept_now(const Press *press, const Split *split, const Loop *loop, const Row J[6], const Placed *placed,
                        const Setting *setting, double noise, const Pressing *pressing, double *kept, double *trembles)
{
    double eased = pressing->eased, admittance[6][6], share, gain = split->gain;
    *kept = eased;
    *trembles = 0.0;
    if (!loop->has_braking || noise == 0.0)
        return DONE;
    for (int k = 0; k < 6; k++) {
        double rates[MOST_PARTS] = {0.0}, twist[6], column[6];
        for (int i = 0; i < split->n; i++)
            rates[i] = split->unit_parts[i][k];
        rows_times(6, split->twist, rates, twist);
        twist_out(&placed->frame, twist, column);
        for (int i = 0; i < 6; i++)
            admittance[i][k] = column[i];
    }
    if (trembling(loop, J, (const double(*)[6])admittance, placed->point, press->size, noise, press->share, &share) == HAND_BACK)
        return HAND_BACK;
    if (!press->has_compliance) {
        gain = 0.0;
        for (int i = 0; i < split->n; i++) {
            double M, D;
            mass_and_damper(&pressing->known[i], setting, eased, &M, &D);
            gain = fmax(gain, 1.0 / (M / setting->dt + D));
        }
    }
    double left = press->has_compliance ? 1.0 : kept_of(gain, share);
    *kept = left * eased;
    *trembles = gain * left * share;
    return DONE;
}

/* known[0].trouble: whether what was declared disagrees with what is known. */
static bool is_wrong(const Stiffness *known, double declared)
{
    double k = known->found[0], error = 2.0 * known->errors[0];
    return declared > 0.0 && is_known(known) && !(k - error <= STIFFER * declared && k + error >= declared / STIFFER);
}

/* What is remembered of a tick that moved the joints. */
static void remember(const Press *press, const Split *split, const Setting *setting, double lag, const Placed *placed,
                     int m, const Row J[6], const double *velocity, double along_before, bool free, const Drive *drives,
                     Pressed *state, Answered *answer)
{
    Pressing *pressing = &state->pressing;
    double dt = setting->dt, fades = exp(-dt / (SLOWER_PASS * setting->late));
    double lag_before = pressing->lag, shows = 1.0 - exp(-dt / fmax(lag, 1e-9));
    double still = lag_before > 0.0 ? lag / lag_before : 1.0, steep = 0.0;
    double twist[6], led[6], inside[6], done[MOST_PARTS], ways[MOST_PARTS];
    int n = split->n;
    for (int j = 0; j < m; j++) /* of the joints: what was commanded along a contact is no way into it */
        state->coming[j] = still * (state->joints > 0.0 ? state->coming[j] : 0.0) + dt * velocity[j];
    state->joints = m;
    for (int i = 0; i < 6; i++) {
        twist[i] = dot(m, J[i], velocity);
        led[i] = dot(m, J[i], state->coming);
    }
    for (int j = 0; j < m; j++)
        state->coming[j] *= 1.0 - shows;
    velocity_at(twist, placed->point, answer->way);
    velocity_at(led, placed->point, answer->shown);
    for (int i = 0; i < 3; i++) {
        answer->way[i] *= dt;
        answer->shown[i] *= shows;
    }
    twist_in(&placed->frame, twist, inside);
    rows_times(n, split->unit_rates, inside, done);
    twist_in(&placed->frame, led, inside);
    rows_times(n, split->unit_rates, inside, ways);
    for (int i = 0; i < n; i++) {
        pressing->ways[i].shown += shows * ways[i];
        pressing->ways[i].coming = ways[i] - shows * ways[i];
        pressing->drives[i] = (Drive){done[i] - drives[i].slope, drives[i].slope};
        steep = fmax(steep, fabs(drives[i].slope));
    }
    pressing->driven = n;
    pressing->lag = lag;
    pressing->along = fmax(place_speed(answer->motion, placed->point, press->size), along_before * fades);
    pressing->steep = fmax(steep, pressing->steep * fades);
    pressing->free = free;
}

/* A tick; `state` is what is kept before and after it, and no more than half of it where the tick is handed back. */
static Outcome pressing_tick(const Press *press, const Split *split, const Loop *loop, const Hybrid *now, const Row q,
                             const Pose *target, const double reading[6], const double *kept, const Delay *delay, Pressed *state,
                             Answered *answer)
{
    Pose home;
    Placed placed;
    Setting setting;
    Row then_J[6];
    Drive drives[MOST_PARTS];
    Pressing *pressing = &state->pressing;
    double chase[6], dt = loop->dt, along_before = pressing->along, share, trembles, rates[MOST_PARTS] = {0.0}, inside[6], all[6];
    double noise = fmax(press->noise, state->noise.found), arm = arm_late(delay, loop->delay);
    bool yields = can_yield(split, loop->joints), held = split->presses == 0;
    const double *ahead = now->has_feedforward ? now->feedforward : NULL;
    int m = loop->joints, n = split->n, presses = split->presses;
    pose_from(loop->home[0], &home);
    kinematics(m, loop->screws, &home, q, answer->J, &placed.tool);
    if (!yields || is_far(loop, q, target) || error_twist(target, &placed.tool, chase) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < 6; i++)
        chase[i] *= gain_of(delay, loop->delay, loop->gain);
    if (!placed_at(press, split, now, reading, state, &placed, answer->wrench))
        return HAND_BACK;
    slid(press, split, &placed, chase, ahead, answer->motion);
    wrench_out(&placed.frame, placed.error, answer->error);
    wrench_out(&placed.frame, placed.exert, answer->wanted);
    rows_times(n, split->intensities, placed.inside, answer->intensities);

    /* What is known after this reading. */
    PressTick *tick = &answer->read;
    read_tick(press, split, now, dt, reading, &placed, answer->wanted, answer->error, noise, state, tick);
    setting_of(press, split, arm, dt, pressing, &state->monitor, held, placed.asked, noise, &setting);
    if (!loop->has_braking)
        taken_up(press, split, &placed, dt, state->motion, answer->motion);
    memcpy(state->motion, answer->motion, sizeof state->motion);
    known_now(press, split, &placed, state->monitor.dead.unchanged > 0.0, &setting, tick, pressing);
    double shared = press->filter_time > 0.0 ? fmin(1.0, dt / (2.0 * press->filter_time)) : 1.0;
    if (monitored(press, tick, presses, pressing->known, placed.felt, placed.asked, setting.noise, shared, &state->monitor) == HAND_BACK)
        return HAND_BACK;
    bool asks = false;
    if (state->monitor.settling.swung == 0.0 && state->monitor.settling.often * setting.late <= 1.0)
        pressing->eased = fmax(LEAST_EASED, EASES * pressing->eased);
    for (int i = 0; i < (int)state->monitor.asked; i++)
        asks = asks || !isnan(state->monitor.answers[i].release.depth);
    answer->touch = tick->touch;
    bool touching = tick->touch.touching != 0.0, there = touch_lasts(&tick->touch, press->lost_after);
    bool lost = !there && tick->touch.airborne < INFINITY;
    if (lost && press->on_loss == HOLDS)
        return HAND_BACK;
    bool slow = !touch_lasts(&tick->touch, setting.late) && !(lost && press->on_loss == CONTINUES);

    /* The law. */
    const Dead *dead = &state->monitor.dead;
    bool waits = presses > 0 && (dead->alive == 0.0 || dead->unchanged > STALE_AFTER);
    if (kept_now(press, split, loop, (const Row *)answer->J, &placed, &setting, noise, pressing, &share, &trembles) == HAND_BACK)
        return HAND_BACK;
    double sent = loop->delay + acts_later(delay), striking = dt + (1.0 - TAKEN_BACK) * (sent + fmin(arm - sent, dt));
    bool acts = driven(press, split, pressing, &state->monitor, placed.felt, placed.asked, &setting, share, striking, lags(delay),
                       tick->most[0], slow, yields, drives);
    for (int i = 0; i < n; i++)
        rates[i] = drives[i].speed + drives[i].slope;
    rows_times(6, split->twist, rates, inside);
    twist_out(&placed.frame, inside, answer->force);
    if (waits)
        memset(answer->force, 0, sizeof answer->force);
    for (int i = 0; i < 6; i++)
        all[i] = answer->motion[i] + answer->force[i];
    double constraints[MOST_PARTS][6];
    for (int i = 0; i < n; i++)
        wrench_out(&placed.frame, split->constraints[i], constraints[i]);
    Pose then_tool = placed.tool;
    memcpy(then_J, answer->J, sizeof then_J);
    if (now->has_then) /* what is held stays where it is: the arm is looked at where it will be when this command acts */
        kinematics(m, loop->screws, &home, now->then, then_J, &then_tool);
    const Beside beside = {.J = (const Row *)then_J,
                           .tool = &then_tool,
                           .at = press->at_contact ? placed.point : NULL,
                           .posture = now->has_posture ? now->posture : NULL,
                           .rows = press->force_first ? n : 0,
                           .D = (const double(*)[6])constraints,
                           .at_base = true};
    if (step_beside(loop, NULL, &beside, q, NULL, all, now->has_velocity ? now->velocity : NULL, kept, &answer->tick) == HAND_BACK)
        return HAND_BACK;

    /* What is remembered. */
    answer->felt = placed.felt[0];
    answer->asked = placed.asked[0];
    answer->bound = pressing->known[0].bound;
    remember(press, split, &setting, arm, &placed, m, (const Row *)then_J, answer->tick.solution.velocity, along_before,
             acts && answer->tick.solution.scale == 1.0 && !slow && !waits, drives, state, answer);
    after_motion(&tick->touch, dot(3, placed.out, answer->way), &state->monitor);
    bool wrong = presses == 1 && pressing->along <= SLOW_SHARE * press->approach_speed && is_wrong(&pressing->known[0], press->stiffness);
    answer->room = fmax(1.0 - trembles, 1.0 - MOST_TREMBLING);
    for (int i = 0; i < 3; i++)
        state->out[i] = touching ? placed.out[i] : NAN;
    memcpy(state->last, reading, sizeof state->last);
    for (int i = 0; i < 3; i++) {
        memcpy(state->tool + 4 * i, placed.tool.R[i], 3 * sizeof(double));
        state->tool[4 * i + 3] = placed.tool.p[i];
        state->tool[12 + i] = 0.0;
    }
    state->tool[15] = 1.0;
    delayed(delay, loop, q, answer->tick.solution.velocity, (const Row *)answer->J, placed.point, press->size,
            now->has_velocity ? now->velocity : NULL, touching);
    answer->kept = share / pressing->eased;
    const Settling *settling = &state->monitor.settling;
    bool told = there && !asks; /* whether the tick has no status of its own */
    bool unsettled = settling->swung < SWUNG || settling->missed > PATIENT_FOR;
    answer->speaks = state->noise.found != 0.0 || (told && unsettled) ||
                     (answer->kept < LOWERED && touching) || wrong || (there && asks);
    return DONE;
}

static PyObject *bytes_of(const Pressed *state) { return PyBytes_FromStringAndSize((const char *)state, sizeof *state); }

/* The numbers that a Delay remembers, for reading and writing; false for anything else. */
static bool delay_of(PyObject *head, PyObject *echo, int m, Delay *delay)
{
    PyObject *arrays[] = {head, echo};
    double *data[2];
    int size[2];
    for (int i = 0; i < 2; i++) {
        PyArrayObject *array = (PyArrayObject *)arrays[i];
        if (!PyArray_Check(arrays[i]) || PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISCARRAY(array) || PyArray_SIZE(array) > INT_MAX)
            return false;
        data[i] = PyArray_DATA(array);
        size[i] = (int)PyArray_SIZE(array);
    }
    *delay = (Delay){.head = data[0], .echo = data[1], .rows = (size[1] - 2) / (2 + m)};
    return size[0] == HEADER + 6 * m && delay->rows > 0 && size[1] == 2 + (2 + m) * delay->rows;
}

/* press(Press, Split, Loop, memory, Delay, its echo, state, q, target, reading, ...) and the fields of a hybrid tick by name: a VelocitySolution and
   what is to be said of joints beside it; motion, force, wrench, error, intensities, wanted, J; the state after it, way, way that
   shows, (felt, wanted, bound of the stiffness) of the first part, whether it touches and for how long not, whether something
   is to be said, the share of the gain that is left, room; the memory and the Delay's numbers are written. None, and the memory as it was, where Python has to answer. */
PyObject *press(PyObject *module, PyObject *const *arguments, Py_ssize_t count, PyObject *names)
{
    (void)module;
    const Press *fixed = count == 10 ? described(&TABLE_Press, arguments[0]) : NULL;
    const Split *split = fixed == NULL ? NULL : described(&TABLE_Split, arguments[1]);
    const Loop *loop = split == NULL ? NULL : loop_of(arguments[2]);
    double *kept = loop == NULL ? NULL : memory_of(arguments[3], loop);
    Delay delay;
    if (kept == NULL || !delay_of(arguments[4], arguments[5], loop->joints, &delay) || !PyBytes_Check(arguments[6]) ||
        PyBytes_Size(arguments[6]) != (Py_ssize_t)sizeof(Pressed))
        return refused("press(a Press, a Split, a Loop, its memory, a Delay's numbers, its echo's, a state, q, target, reading, ...)");
    Hybrid now;
    Pressed state;
    Answered answer;
    Pose target;
    Row q;
    double given[6], reading[6];
    int m = loop->joints, n = split->n;
    Fit fit = called_by_name(&TABLE_press, arguments + 10, names, &now);
    if (fit == WRONG)
        return NULL;
    memcpy(&state, PyBytes_AsString(arguments[6]), sizeof state);
    if (fit == UNFIT || (now.joints != 0 && now.joints != m) || n == 0 || !vector(arguments[7], m, q) || !all_finite(m, q) ||
        !target_pose(arguments[8], &target) || !vector(arguments[9], 6, given) || !all_finite(6, given) ||
        (now.has_feedforward && !all_finite(6, now.feedforward)) || (now.has_velocity && !all_finite(m, now.velocity)) ||
        (now.has_posture && !all_finite(m, now.posture)))
        Py_RETURN_NONE;
    for (int i = 0; i < 6; i++)
        reading[i] = given[fixed->moment_first ? i : (i + 3) % 6];
    if (pressing_tick(fixed, split, loop, &now, q, &target, reading, kept, &delay, &state, &answer) == HAND_BACK)
        Py_RETURN_NONE;
    PyObject *found[] = {fields(m, &answer.tick.solution, loop, NULL),
                         joint_troubles(loop, &answer.tick),
                         new_vector(6, answer.motion),
                         new_vector(6, answer.force),
                         new_vector(6, answer.wrench),
                         new_vector(6, answer.error),
                         new_vector(n, answer.intensities),
                         new_vector(6, answer.wanted),
                         new_matrix(6, m, MOST, answer.J[0]),
                         bytes_of(&state),
                         new_vector(3, answer.way),
                         new_vector(3, answer.shown),
                         Py_BuildValue("(ddd)", answer.felt, answer.asked, answer.bound),
                         PyBool_FromLong(answer.touch.touching != 0.0),
                         PyFloat_FromDouble(answer.touch.airborne),
                         PyBool_FromLong(answer.speaks),
                         PyFloat_FromDouble(answer.kept),
                         PyFloat_FromDouble(answer.room)};
    if (found[0] != NULL)
        remembered(loop, q, &answer.tick, kept);
    return named(&PyTuple_Type, sizeof found / sizeof *found, found);
}
