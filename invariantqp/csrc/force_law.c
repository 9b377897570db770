/* Twin of a tick of force/law.py and of the choice between its laws in force/control.py.

       M v' + D v = e,     D = k T / G,     M = b T / G,     rate = v + slope */

#include "press.h"
#include <string.h>

void mass_and_damper(const Stiffness *known, const Setting *setting, double eased, double *M, double *D)
{
    double late = setting->late / (DELAY_SHARE * eased), b = fmax(known->found[1], 0.0), error = known->errors[1];
    double least = fmax(b - error, 0.0), behind = fmax(-known->found[1] - error, 0.0);
    *M = late * (b + error);
    *D = fmax(late * known->bound + behind / (DELAY_SHARE * eased), sqrt(2.0 * known->bound * *M) - least);
}

/* How much of the bound is known to be there. */
static double sure(const Stiffness *known) { return fmax(known->found[0] - known->errors[0], 0.0) / known->bound; }

static Drive pressed(const Drive *drive, double error, double wanted, const Stiffness *known, const Setting *setting,
                     double inwards, double outwards, double eased, bool grows, const Stiffness *beside)
{
    bool rose = known->rose != 0.0, rises = wanted > 0.0 && known->reached == 0.0;
    double M, D, before = rose ? fmin(drive->speed, 0.0) : drive->speed, slope = rose ? fmin(drive->slope, 0.0) : drive->slope;
    double bound = setting->slope_speed;
    mass_and_damper(known, setting, eased, &M, &D);
    if (beside != NULL) { /* a moment is levelled no faster than the press presses */
        double m, d;
        mass_and_damper(beside, setting, eased, &m, &d);
        M = fmax(M, m);
        D = fmax(D, d);
    }
    double per_tick = M / setting->dt;
    if (grows) {
        double share = wanted > 0.0 ? fmin(fmax(SURE * sure(known), UNSURE), 1.0) : 1.0;
        double counts = rises ? INTEGRATED * wanted : INFINITY;
        slope += setting->dt * share * fmin(fmax(error, -counts), counts) * known->bound / (INTEGRAL * D * D);
    }
    slope = fmin(fmax(slope, -bound), rises ? fmin(bound, inwards) : bound);
    double fastest = rises ? inwards - fmax(slope, 0.0) : inwards;
    return (Drive){fmin(fmax((per_tick * before + error) / (per_tick + D), -outwards), fastest), slope};
}

/* In a touch, outwards alone. */
static Drive struck(const Drive *drive, double coming, double error, const Stiffness *known, const Setting *setting,
                    double most, double eased)
{
    const Drive still = {0.0, drive->slope};
    Drive law = pressed(&still, error, 0.0, known, setting, 0.0, most, eased, false, NULL);
    double wanted = fmax(error, 0.0) / fmax(known->bound, known->stiff);
    law.speed = fmax(fmin(law.speed, (wanted - coming) / setting->dt), -most);
    return law;
}

double surface_speed(const Press *press, double along, double moves)
{
    return press->slope * along + fmin(moves / MOVES_IN, press->approach_speed);
}

/* In the air. */
static Drive sought(const Drive *drive, double gentle, double leaves, const Setting *setting, const Touch *touch,
                    const Press *press)
{
    double bound = fmax(leaves, drive->slope), slope = 0.0;
    if (touch->airborne == INFINITY)
        return (Drive){gentle, 0.0};
    double part = press->lost_after > 0.0 ? fmin(1.0, touch->airborne / press->lost_after) : 1.0;
    double rate = fmin((gentle + bound) * part, press->approach_speed);
    if (touch->airborne < press->lost_after) {
        double grown = drive->slope + setting->dt * UNSURE * DELAY_SHARE / (INTEGRAL * setting->late) * (rate - drive->slope);
        slope = fmin(fmax(grown, -setting->slope_speed), bound);
    }
    return (Drive){rate - slope, slope};
}

/* With a given compliance. */
static Drive fixed(const Drive *drive, double error, double gain, double stiffness, double dt, double most, bool grows)
{
    double slope = stiffness > 0.0 ? drive->slope : 0.0;
    if (grows && stiffness > 0.0)
        slope += dt * gain * gain * stiffness / OVERDAMPED * error;
    return (Drive){fmin(gain * error, fmax(most - slope, 0.0)), slope};
}

static double touch_speed(const Press *press, double force, double most, double late)
{
    double table = APPROACHED * STIFF, soft = press->stiffness > 0.0 ? fmin(press->stiffness, table) : table;
    return fmin(press->approach_speed, fmin(fmax(force, 0.0) / soft, fmax(most, 0.0) / table) / (late + DAMPED_BY));
}

/* HybridController._driven: the law of each constraint; whether it acts in full. */
bool driven(const Press *press, const Split *split, const Pressing *now, const Monitor *monitor, const double *felt,
            const double *asked, const Setting *setting, double eased, double striking, bool lag_known, double most_force, bool slow,
            bool yields, Drive *drives)
{
    int n = split->n, presses = split->presses;
    bool there = true, acts;
    double fastest = press->approach_speed, leaves = surface_speed(press, now->along, press->yields);
    for (int i = 0; i < presses; i++)
        there = there && touch_lasts(&now->touches[i], setting->late);
    acts = there && yields;
    bool grows = now->free != 0.0 && yields && !slow;
    for (int i = 0; i < n; i++) {
        const Drive none = {0.0, 0.0}, *drive = now->driven == n ? &now->drives[i] : &none;
        const Stiffness *known = &now->known[i];
        const Answers *check = i < presses && i < (int)monitor->asked ? &monitor->answers[i] : NULL;
        double error = asked[i] - felt[i], wished = i < presses ? asked[i] : 0.0;
        double gentle = i < presses ? touch_speed(press, (1.0 - LOST_SHARE) * asked[i], (1.0 - LOST_SHARE) * most_force, striking) : 0.0;
        if (press->has_compliance) {
            double top = slow && i < presses ? fastest : INFINITY;
            drives[i] = fixed(drive, error, split->gain, press->stiffness, setting->dt, top, grows);
            acts = acts && drives[i].speed + drives[i].slope < top;
        } else if (presses == 0) {
            double k = fmin(press->stiffness > 0.0 ? press->stiffness : STIFF, UNSHOWN * STIFF);
            for (int j = 0; j < n; j++)
                k = fmax(k, (is_known(&now->known[j]) ? now->known[j].found[0] : 0.0) / QUICKER);
            double gain = eased * DELAY_SHARE / ((setting->late - UNKNOWN_LATE) * k);
            drives[i] = fixed(drive, error, gain, k, setting->dt, INFINITY, grows);
        } else if (i >= presses) {
            drives[i] = there ? pressed(drive, error, 0.0, known, setting, fastest, fastest, eased, grows, &now->known[0])
                                 : none;
        } else if (!touch_lasts(&now->touches[i], setting->late)) {
            drives[i] = sought(drive, gentle, leaves, setting, &now->touches[i], press);
        } else if (known->time <= setting->late) { /* the filters still hold the air */
            double coming = presses == 1 && lag_known && now->went == n ? now->ways[i].coming : 0.0;
            drives[i] = struck(drive, coming, error, known, setting, OVERLOAD * fastest, eased);
        } else {
            double room = fmax(most_force - felt[i] - (check == NULL ? 0.0 : unseen(press, check, felt[i])), wished);
            double inwards = touch_speed(press, room, room, setting->late)
                           + (known->reached != 0.0 ? 0.0 : press->slope * now->along);
            drives[i] = pressed(drive, error, wished, known, setting, inwards, OVERLOAD * fastest, eased, grows, NULL);
        }
    }
    return acts;
}

/* The share of the joints' acceleration that noise takes through the force law, for each unit of its gain. */
Outcome trembling(const Loop *loop, const Row J[6], const double (*admittance)[6], const double place[3], double size,
                  double noise, double passed, double *share)
{
    int m = loop->joints, any = 0;
    double largest = 0.0, most = 0.0, root[6][6], sigma[6];
    Rotated R[6] = {{{0.0}, {0.0}}};
    Row A[6];
    for (int j = 0; loop->has_braking && j < m; j++)
        if (isfinite(loop->acceleration[j])) {
            largest = fmax(largest, loop->acceleration[j]);
            any = 1;
        }
    *share = 0.0;
    if (noise == 0.0 || !any)
        return DONE;
    root_at(place, size, root);
    product_of_rows(6, (const double(*)[6])root, m, J, A);
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < m; j++) {
            double a = loop->acceleration[j];
            R[i].row[j] = A[i][j] * (isfinite(a) ? a : FREE_ACCELERATION * largest);
        }
        for (int k = 0; k < 3; k++)
            for (int l = 0; l < 6; l++)
                R[i].with[k] += root[i][l] * admittance[l][3 + k];
    }
    if (sorted_rows(6, m, 3, R, sigma) == HAND_BACK)
        return HAND_BACK;
    for (int j = 0; j < m; j++) { /* x = V diag(1 / sigma) U'b, a row for each joint */
        double x[3] = {0.0};
        for (int i = 0; i < 6; i++)
            for (int k = 0; k < 3 && sigma[i] > SINGULAR * sigma[0]; k++)
                x[k] += R[i].row[j] * R[i].with[k] / (sigma[i] * sigma[i]);
        most = fmax(most, dot(3, x, x));
    }
    double change = noise * passed * sqrt(2.0 / (2.0 - passed));
    *share = TREMBLES * change / loop->dt * sqrt(most);
    return DONE;
}

double kept_of(double gain, double share) { return gain * share > MOST_TREMBLING ? MOST_TREMBLING / (gain * share) : 1.0; }
