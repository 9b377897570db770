/* Twin of force/monitor.py as long as nothing is found: what a check finds is handed back, and Python says what it is. */

#include "press.h"
#include <string.h>

#define JUDGED (1.0 - exp(-1.0))

static bool overloaded(const PressTick *tick, double most[2])
{
    double share = exp(-tick->dt / PATIENT_FOR);
    most[0] = fmax(tick->most[0], fmin(share * most[0], OVERLOAD * tick->force));
    most[1] = fmax(tick->most[1], fmin(share * most[1], OVERLOAD * tick->moment));
    return tick->force > most[0] || tick->moment > most[1];
}

static bool is_dead(const PressTick *tick, Dead *dead)
{
    bool moves = tick->came != 0.0 || norm(3, tick->across) > 0.0; /* readings at rest may be the same */
    bool first = isnan(dead->reading[0]), same = !first && tick->noise > 0.0;
    for (int i = 0; i < 6; i++)
        same = same && tick->reading[i] == dead->reading[i];
    dead->unchanged = !same ? 0.0 : moves ? dead->unchanged + tick->dt : dead->unchanged;
    dead->alive = dead->alive != 0.0 || tick->noise == 0.0 || isnan(tick->felt) || !(first || same);
    memcpy(dead->reading, tick->reading, sizeof dead->reading);
    return dead->unchanged > DEAD_AFTER;
}

static bool is_pulled(const PressTick *tick, Pulls *pulls)
{
    if (isnan(tick->felt) || tick->wanted == 0.0)
        return false;
    bool close = 0.0 < tick->touch.airborne && tick->touch.airborne < INFINITY && tick->limit > 0.0;
    double least = close ? tick->limit : fmax(tick->limit, HALF * tick->wanted);
    pulls->pull = weighed(pulls->pull, -tick->together, least, tick->noise);
    return certain(pulls->pull);
}

static bool is_astray(const Press *press, const PressTick *tick, Approach *approach)
{
    if (isnan(tick->felt) || tick->touch.touching != 0.0) {
        *approach = (Approach){0.0, {0.0, 0.0}, 0.0};
        return false;
    }
    double over = LED * press->retreat_distance, kept = exp(-fabs(tick->commanded) / over), airborne = tick->touch.airborne;
    bool before = airborne == INFINITY;
    approach->waited += tick->dt;
    approach->led[0] = kept * approach->led[0] + tick->commanded;
    approach->led[1] = kept * approach->led[1] + tick->came;
    approach->way += fmax(0.0, tick->commanded);
    if (press->on_loss == RETREATS && !before && airborne > press->lost_after)
        return true;
    if (press->on_loss == CONTINUES && !before)
        return false;
    return (approach->led[0] > JUDGED * over && approach->led[1] < FOLLOWED * approach->led[0]) ||
           approach->way > press->approach_distance || approach->waited > press->approach_time;
}

/* Evidence.after */
static void followed(const Stiffness *known, double noise, double wanted, double shared, double dt, Evidence *evidence)
{
    if (isnan(evidence->began[0])) {
        *evidence = (Evidence){{known->way, known->force}, {{0.0}}, 0.0};
        return;
    }
    const double read[3] = {known->way - evidence->began[0], known->force - evidence->began[1], 1.0};
    double weight = shared / (4.0 * noise * noise + (0.01 * wanted) * (0.01 * wanted)), left = exp(-dt / SINCE);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            evidence->sums[i][j] = left * evidence->sums[i][j] + weight * (read[i] * read[j]);
    evidence->noise = left * evidence->noise + weight * noise * noise;
}

/* Evidence.answers, and Evidence.stiffness */
static bool answering(const Evidence *evidence, double *stiffness)
{
    const double(*s)[3] = evidence->sums;
    *stiffness = 0.0;
    if (s[2][2] == 0.0)
        return false;
    double a = s[0][0] - s[0][2] * s[2][0] / s[2][2], b = s[0][1] - s[0][2] * s[2][1] / s[2][2];
    double f = s[1][1] - s[1][2] * s[2][1] / s[2][2];
    if (a > 0.0 && b > 0.0 && b * b > CHI * a)
        *stiffness = b / a;
    return *stiffness > 0.0 || f > NOISIER * NOISIER * evidence->noise + CHI;
}

/* Answers.begun, of what was known before or of nothing */
static void answers_begun(const Answers *before, Answers *check)
{
    Answers none = {0};
    const Answers *known = before == NULL ? &none : before;
    Answers begun = {.evidence = {.began = {NAN, NAN}},
                     .rest = {NAN, NAN, NAN, NAN},
                     .release = {NAN, NAN, NAN, NAN, {NAN, NAN, NAN}, NAN, NAN, NAN},
                     .shown = known->shown,
                     .moves = known->moves,
                     .read = -CERTAIN};
    memcpy(begun.grade, known->grade, sizeof begun.grade);
    *check = begun;
}

/* What may be pressed more or less than is read. */
double unseen(const Press *press, const Answers *check, double felt)
{
    double across = norm(3, check->across), share = fmin(1.0, sqrt(check->shown) / fmax(across, TINY));
    double way = check->depth - check->since[0] - share * dot(3, check->grade, check->across);
    double slope = check->silent < EXCUSED ? press->slope * across : 0.0;
    double room = check->stiff * (press->yields + check->moves + slope);
    return fmax(0.0, fabs(check->stiff * way - (felt - check->since[1])) - room);
}

/* Answers.heard */
static void heard(const Press *press, const Stiffness *known, double felt, double shown, double noise, Answers *check)
{
    double k = is_known(known) ? known->found[0] : 0.0;
    if (k > 0.0) {
        double sinks = (felt - check->since[1]) / k, least = STEP_SHARE * press->size + fabs(sinks) / press->slope;
        double rise = check->depth - check->since[0] - sinks - dot(3, check->grade, check->across);
        rise = copysign(fmax(fabs(rise) - 2.0 * sqrt(2.0) * noise / k, 0.0), rise);
        check->shown = (1.0 - 1.0 / GRADED_BY) * check->shown + dot(3, check->across, check->across);
        double share = rise / (check->shown + least * least);
        for (int i = 0; i < 3; i++)
            check->grade[i] += share * check->across[i];
        share = fmin(1.0, press->slope / fmax(norm(3, check->grade), TINY));
        for (int i = 0; i < 3; i++)
            check->grade[i] *= share;
    }
    if (shown > 0.0)
        check->stiff = fmax(fmax(fmin(2.0 * shown, check->stiff), 2.0 * k), SOFTER * check->stiff);
    check->since[0] = check->depth;
    check->since[1] = felt;
    check->across[0] = check->across[1] = check->across[2] = 0.0;
    check->silent = 0.0;
    check->evidence = (Evidence){.began = {NAN, NAN}};
}

/* Answers.at_rest */
static void rests(const Press *press, double dt, double felt, double wanted, double noise, Answers *check)
{
    double room = press->slope * norm(3, check->slid) + press->yields + check->moves + LEAST_WAY * RESOLVED * press->size;
    double least_felt = fmax(SHORT * wanted, FELL_NOISE * noise);
    if (!isnan(check->rest[0]) && check->rest[3] != wanted) {
        check->rested = check->off = 0.0;
        check->rest[0] = check->rest[1] = check->rest[2] = check->rest[3] = NAN;
    } else if (isnan(check->rest[0])) {
        double rested = fabs(felt - wanted) < SHORT * wanted ? check->rested + dt : 0.0;
        if (rested < PATIENT_FOR) {
            check->rested = rested;
            return;
        }
        double shown = fmax(felt - check->touched, 0.0), way = fmax(check->depth, 0.0) + room;
        const double rest[4] = {check->depth, felt, shown / way, wanted};
        check->off = shown - check->stiff * way > least_felt ? INFINITY : 0.0;
        memcpy(check->rest, rest, sizeof rest);
        check->slid[0] = check->slid[1] = check->slid[2] = 0.0;
    } else {
        double least = check->rest[2], way = check->depth - check->rest[0], rise = felt - check->rest[1];
        double low = (way > room ? least : check->stiff) * (way - room);
        double high = (way < -room ? least : check->stiff) * (way + room);
        check->off = fmax(low - rise, rise - high) > least_felt ? check->off + dt : 0.0;
    }
}

/* Answers.update; whether the tool is to let go, which is Python's. */
static bool unanswered(const Press *press, const PressTick *tick, const Stiffness *known, double felt, double wanted, double noise,
                       double shared, Answers *check)
{
    double dt = tick->dt, stiff = press->stiffness > 0.0 ? press->stiffness : STIFF;
    check->read = weighed(check->read, felt, tick->limit / 2.0, tick->noise);
    bool left = tick->touch.touching == 0.0 && (check->stiff == 0.0 || check->read == -CERTAIN);
    if (left || wanted <= 0.0) {
        answers_begun(check, check);
        return false;
    }
    if (check->stiff == 0.0) {
        check->stiff = isnan(known->stiff) ? UNSHOWN * stiff : known->stiff;
        check->quiet = isnan(known->quiet) ? known->way : fmin(known->quiet, known->way);
        check->depth = known->way - check->quiet;
        check->touched = isnan(known->quiet) ? felt : 0.0;
        check->since[0] = check->depth;
        check->since[1] = felt;
        check->read = CERTAIN;
        return false;
    }
    check->depth = known->way - check->quiet;
    for (int i = 0; i < 3; i++) {
        check->across[i] += tick->across[i];
        check->slid[i] += tick->across[i];
    }
    check->silent += dt;
    followed(known, noise, wanted, shared, dt, &check->evidence);
    bool rested = !isnan(check->rest[0]);
    rests(press, dt, felt, wanted, noise, check);
    double k;
    if (answering(&check->evidence, &k))
        heard(press, known, felt, k, noise, check);
    bool begun = tick->noise > 0.0 && !rested && !isnan(check->rest[0]);
    bool unshown = begun && isnan(known->stiff) && check->silent >= PATIENT_FOR;
    return unshown || unseen(press, check, felt) > PRESSES * wanted || check->off > AVERAGED_FOR;
}

/* Settling._turned */
static void turns(double felt, double wanted, double noise, double dt, Settling *settling)
{
    bool same = wanted == settling->wanted && wanted != 0.0, rises = settling->rises != 0.0;
    double extreme = settling->extreme, back = rises ? extreme - felt : felt - extreme;
    double turned = same ? exp(-dt / SWUNG) * settling->turns : 0.0;
    settling->swung += dt;
    settling->since += dt;
    settling->wanted = wanted;
    settling->extreme = felt;
    settling->rises = 1.0;
    settling->turns = turned;
    if (!same)
        return;
    if (back <= fmax(SWING * wanted, 2.0 * SURPRISE * noise)) {
        settling->rises = rises;
        settling->extreme = back < 0.0 ? felt : extreme;
        return;
    }
    bool about = (extreme > wanted) == rises, swings = about && turned + 1.0 > TURNS;
    settling->often += (1.0 / settling->since - settling->often) / TURNS;
    settling->since = 0.0;
    settling->rises = !rises;
    settling->turns = about && !swings ? turned + 1.0 : 0.0;
    settling->swung = swings ? 0.0 : settling->swung;
}

/* Settling.after */
static void settled(const PressTick *tick, bool lost, Settling *settling)
{
    double felt = tick->felt, wanted = tick->wanted, dt = tick->dt;
    turns(felt, wanted, tick->noise, dt, settling);
    if (lost) {
        settling->press = NAN;
        settling->missed = 0.0;
        return;
    }
    settling->press = isnan(settling->press) ? felt : settling->press + fmin(1.0, dt / AVERAGED_FOR) * (felt - settling->press);
    bool off = fabs(settling->press - wanted) > SHORT * wanted && SHORT * wanted > 0.0;
    settling->missed = off ? settling->missed + dt : 0.0;
}

/* Settling.after_missing */
static void missed(const PressTick *tick, Settling *settling)
{
    double before = settling->press, error = tick->missing, dt = tick->dt, for_long = settling->missed;
    if (!isnan(before))
        error = before + fmin(1.0, dt / AVERAGED_FOR) * (tick->missing - before);
    *settling = (Settling){.press = error, .missed = error > SHORT ? for_long + dt : 0.0, .rises = 1.0, .swung = SWUNG};
}

/* Monitor.after */
Outcome monitored(const Press *press, const PressTick *tick, int presses, const Stiffness *known, const double *felt,
                  const double *asked, double noise, double shared, Monitor *monitor)
{
    bool pressing = tick->limit > 0.0 && (isnan(tick->felt) || tick->wanted > 0.0);
    for (int i = 0; i < (int)monitor->asked; i++)
        if (!isnan(monitor->answers[i].release.depth)) /* while the tool lets go Python says what is found */
            return HAND_BACK;
    if (overloaded(tick, monitor->overload) || is_dead(tick, &monitor->dead) || is_pulled(tick, &monitor->pulls) ||
        is_astray(press, tick, &monitor->approach))
        return HAND_BACK;
    for (int i = 0; pressing && (int)monitor->asked != presses && i < presses; i++)
        answers_begun(NULL, &monitor->answers[i]);
    monitor->asked = pressing ? presses : 0;
    for (int i = 0; pressing && i < presses; i++) /* a late reading cannot have answered yet */
        if (monitor->dead.unchanged == 0.0 &&
            unanswered(press, tick, &known[i], felt[i], asked[i], noise, shared, &monitor->answers[i]))
            return HAND_BACK;
    if (isnan(tick->felt))
        missed(tick, &monitor->settling);
    else if (tick->limit != 0.0)
        settled(tick, !touch_lasts(&tick->touch, press->lost_after), &monitor->settling);
    return DONE;
}

/* Monitor.after_motion, on a surface. */
void after_motion(const Touch *touch, double out, Monitor *monitor)
{
    if (touch->touching != 0.0) {
        monitor->pushed = fmax(0.0, monitor->pushed - out);
        return;
    }
    monitor->approached = (monitor->pushed != 0.0 ? 0.0 : monitor->approached) + fmax(0.0, -out);
    monitor->pushed = 0.0;
}
