/* Twin of a tick of force/estimate.py: whether the tool touches, stiffness and damping of what it touches, noise. */

#include "press.h"
#include <string.h>

/* E after one more reading. */
double weighed(double evidence, double press, double limit, double noise)
{
    double sigma = fmax(fmax(noise, LEAST_NOISE * limit), TINY);
    return fmin(fmax(evidence + 2.0 * (limit / sigma) * ((press - limit) / sigma), -CERTAIN), CERTAIN);
}

bool certain(double evidence) { return evidence >= CERTAIN; }

/* Touch */
void touch_begun(Touch *touch) { *touch = (Touch){-CERTAIN, 0.0, INFINITY}; }

void touched(Touch *touch, double press, double limit, double noise, double dt)
{
    double evidence = limit == 0.0 ? CERTAIN : weighed(touch->evidence, press, limit, noise);
    if (evidence == CERTAIN) {
        *touch = (Touch){CERTAIN, 1.0, 0.0};
        return;
    }
    touch->evidence = evidence;
    touch->touching = touch->touching != 0.0 && evidence > -CERTAIN;
    touch->airborne += dt;
}

bool touch_lasts(const Touch *touch, double lost_after) { return touch->touching != 0.0 || touch->airborne <= lost_after; }

/* control.py: of several presses, there is contact where all are felt. */
Touch weakest_touch(int n, const Touch *touches)
{
    Touch found = {n > 0 ? touches[0].evidence : -CERTAIN, 1.0, 0.0};
    for (int i = 0; i < n; i++) {
        found.evidence = fmin(found.evidence, touches[i].evidence);
        found.touching = found.touching != 0.0 && touches[i].touching != 0.0;
        found.airborne = fmax(found.airborne, touches[i].airborne);
    }
    return found;
}

/* The press between air and contact; -1 is what nobody says. */
double loss_limit(double lost_below, double wanted, double noise)
{
    return lost_below < 0.0 ? fmax(0.0, fmax(LOST_SHARE * wanted, HALF * fmin(wanted, noise))) : lost_below;
}

/* Nothing is known but where it begins. */
void unknown_stiffness(double begins, Stiffness *known)
{
    *known = (Stiffness){.found = {begins, begins * DAMPED_BY, 0.0},
                         .errors = {begins, begins * DAMPED_BY, begins},
                         .bound = 2.0 * begins,
                         .begins = begins,
                         .quiet = NAN,
                         .stiff = NAN};
}

/* Whether k is known to two standard errors. */
bool is_known(const Stiffness *known)
{
    return known->seen[0][0] > 0.0 && known->found[0] > 2.0 * known->errors[0];
}

void in_air(Stiffness *known, double force, double way, double limit, double evidence, const Setting *setting)
{
    double x = known->way + setting->share * (way - known->way), v = (x - known->way) / setting->dt;
    double quiet = force <= LEAST_NOISE * limit && evidence == -CERTAIN ? x : known->quiet;
    unknown_stiffness(setting->begins, known);
    known->way = x;
    known->force = force;
    known->mean[0] = x;
    known->mean[1] = v;
    known->mean[3] = force;
    known->quiet = quiet;
}

/* What a touch shows before anything else. */
static void landed(Stiffness *known, const Setting *setting)
{
    Stiffness fresh;
    if (isnan(known->quiet))
        return;
    double rise = fmax(known->force, 3.0 * setting->noise);
    double stiff = rise / fmax(known->way - known->quiet, LEAST_WAY * setting->resolved);
    unknown_stiffness(fmin(fmax(stiff, SOFTEST * STIFF), STIFF), &fresh);
    fresh.way = known->way;
    fresh.force = known->force;
    memcpy(fresh.mean, known->mean, sizeof fresh.mean);
    fresh.time = known->time;
    fresh.lasted = known->lasted;
    fresh.quiet = known->quiet;
    fresh.stiff = fmin(STIFFER * stiff, 2.0 * STIFF);
    *known = fresh;
}

/* k, b and c, and their standard errors. */
static void posterior(Stiffness *known)
{
    double n = known->begins, m = DAMPED_BY * n, (*s)[3] = known->seen, *sums = known->sums;
    double a = 1.0 + n * n * s[0][0], b = n * m * s[0][1], c = n * n * s[0][2];
    double d = 1.0 + m * m * s[1][1], e = m * n * s[1][2], f = 1.0 + n * n * s[2][2];
    double x = 1.0 + n * sums[0], y = 1.0 + m * sums[1], z = n * sums[2];
    double A = d * f - e * e, B = c * e - b * f, C = b * e - c * d, D = a * f - c * c, E = b * c - a * e, F = a * d - b * b;
    double whole = a * A + b * B + c * C;
    known->found[0] = n * (A * x + B * y + C * z) / whole;
    known->found[1] = m * (B * x + D * y + E * z) / whole;
    known->found[2] = n * (C * x + E * y + F * z) / whole;
    known->errors[0] = n * sqrt(fmax(A / whole, 0.0));
    known->errors[1] = m * sqrt(fmax(D / whole, 0.0));
    known->errors[2] = n * sqrt(fmax(F / whole, 0.0));
}

/* Stiffness.after */
void known_after(Stiffness *known, double force, double way, const Setting *setting, int lacks, bool felt)
{
    double dt = setting->dt, x = known->way + setting->share * (way - known->way), v = (x - known->way) / dt;
    double time = known->time + dt, z[4];
    known->lacked = known->lacked * lacks > 0.0 ? known->lacked + lacks * dt : lacks * dt;
    known->lasted = felt ? known->lasted + dt : 0.0;
    if (known->lasted <= 3.0 * setting->filter_time + 2.0 * dt) { /* the filters still hold the air */
        const double mean[4] = {x, v, known->gone, force};
        bool first = known->time == 0.0;
        known->way = x;
        known->force = force;
        memcpy(known->mean, mean, sizeof mean);
        memset(known->means, 0, sizeof known->means);
        known->time = time;
        if (first)
            landed(known, setting);
        return;
    }
    double over = SLOWER_PASS * setting->late, r = fmin(1.0, dt / over);
    double gone = known->gone + dt * setting->slope_speed;
    const double read[4] = {x, v, gone, force};
    for (int i = 0; i < 4; i++) {
        z[i] = read[i] - known->mean[i];
        known->mean[i] += r * z[i];
        z[i] -= known->means[i];
        known->means[i] += r * z[i];
    }
    double af = z[3], bent = setting->held ? 0.0 : fabs(z[2]) + setting->steep * CURVED * over * over;
    double rounding = known->bound * (setting->resolved + bent), noise = setting->noise, softest = SOFTEST * known->begins;
    double spread = fmax(4.0 * noise * noise + 0.0025 * af * af, 2.0 * known->residual) + rounding * rounding;
    spread += softest * softest * (z[0] * z[0] + DAMPED_BY * DAMPED_BY * z[1] * z[1]);
    double rest = af - (z[0] * known->found[0] + z[1] * known->found[1] + z[2] * known->found[2]);
    double late = UNKNOWN_LATE * known->bound * z[1], variance = spread + late * late;
    for (int i = 0; i < 3; i++)
        variance += (known->errors[i] * z[i]) * (known->errors[i] * z[i]);
    double square = rest * rest, most = SURPRISE * SURPRISE * variance;
    bool surprised = square > most;
    known->residual += fmin(1.0, dt / SETTLES) * (fmin(square, most) - known->residual);
    double begins = known->begins;
    if (surprised) {
        begins = fmin(10.0 * begins, fmax(begins, STIFF));
        known->bound = fmax(2.0 * begins, known->bound);
        memset(known->seen, 0, sizeof known->seen);
        memset(known->sums, 0, sizeof known->sums);
        memcpy(known->mean, read, sizeof known->mean);
        memset(known->means, 0, sizeof known->means);
    } else {
        bool soft = lacks != 0 && (known->reached == 0.0 || fabs(known->lacked) > SLOWER_PASS * setting->late);
        if (soft)
            begins = fmax(begins * exp(-dt / (SOFTENS * setting->late)), SOFTEST * setting->begins);
        if (spread > 0.0 && fabs(z[0]) >= 3.0 * setting->resolved) {
            double w = (setting->filter_time > 0.0 ? fmin(1.0, dt / (2.0 * setting->filter_time)) : 1.0) / spread;
            double left = 1.0 - FORGOTTEN * (1.0 - spread / variance);
            for (int i = 0; i < 3; i++) {
                for (int j = 0; j < 3; j++)
                    known->seen[i][j] = left * known->seen[i][j] + w * (z[i] * z[j]);
                known->sums[i] = left * known->sums[i] + w * af * z[i];
            }
        }
    }
    known->begins = begins;
    posterior(known);
    known->bound = fmax(fmax(known->found[0], SOFTEST * begins), known->bound * exp(-dt / SETTLES));
    known->way = x;
    known->force = force;
    known->gone = gone;
    known->rose = surprised && rest > 0.0;
    known->time = time;
    known->reached = known->reached != 0.0 || lacks == 0;
}

/* Noise */
void noise_after(Noise *noise, const double reading[6], const double last[6], double supposed)
{
    double most = SURPRISE * fmax(supposed, noise->change), sum = 0.0, change;
    bool any = false;
    for (int i = 3; i < 6; i++) {
        change = fabs(reading[i] - last[i]);
        any = any || change > 0.0;
        sum += fmin(change, most);
    }
    if (isnan(last[0]) || !any)
        return;
    noise->readings++;
    noise->change += (sum / 3.0 - noise->change) / fmin(noise->readings, AVERAGED_READINGS);
    double sigma = sqrt(PI) / 2.0 * noise->change;
    if (noise->readings >= FEWEST && sigma > NOISIER * supposed)
        noise->found = sigma;
}
