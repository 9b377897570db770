/* Twin of control/delay.py and of Delay in force/estimate.py: by how much commands act later than they are given.

       moved(t) = share * commanded(t - delay)        the delay that fits best, over all parts of the motion */

#include "press.h"
#include <string.h>

enum { ACTS, LAG, TOUCHED, WAY, MOVING, BEHIND, MOVED, CAME_ALONG, GAINED };
enum { FIRST, WEIGHTS, TOLD, CAME, LAST, BEFORE };

bool lags(const Delay *delay) { return !isnan(delay->head[LAG]); }

double acts_later(const Delay *delay) { return isnan(delay->head[ACTS]) ? 0.0 : delay->head[ACTS]; }

double arm_late(const Delay *delay, double declared)
{
    return fmax(declared + acts_later(delay), lags(delay) ? delay->head[LAG] : fmax(LAGS, declared));
}

double gain_of(const Delay *delay, double declared, double asked)
{
    double late = acts_later(delay);
    return asked * late > 1.0 ? fmin(asked, DELAY_SHARE / (declared + late)) : asked;
}

/* DelayEstimate.after: the delay beyond the declared one, NaN while none is seen. */
static double echoed(const Delay *delay, int m, double dt, int declared, const double *moved, const double *command)
{
    int rows = delay->rows, best = 0;
    double *head = delay->echo, *product = head + 2, *square = product + rows, *commanded = square + rows;
    double least = INFINITY, told = 0.0, smallest;
    bool any = false;
    head[1] += dot(m, moved, moved);
    for (int i = 0; i < rows; i++) {
        product[i] += dot(m, commanded + i * m, moved);
        square[i] += dot(m, commanded + i * m, commanded + i * m);
    }
    for (int j = 0; j < m; j++)
        any = any || command[j] != 0.0;
    head[0] += head[0] > 0.0 || any;
    memmove(commanded + m, commanded, (size_t)((rows - 1) * m) * sizeof(double));
    memcpy(commanded, command, (size_t)m * sizeof(double));
    double whole = head[1];
    if (whole == 0.0)
        return NAN;
    smallest = ROUNDING_OF_WAYS * whole;
    for (int i = 0; i < rows; i++) {
        double share = between(product[i] / (square[i] > smallest ? square[i] : smallest), LEAST_OF_WAYS, MOST_OF_WAYS);
        double left = whole - share * (2.0 * product[i] - share * square[i]);
        told = i == declared ? left : told;
        if (left < least) {
            least = left;
            best = i;
        }
    }
    bool found = least < UNEXPLAINED * fmin(whole, told) - smallest && best > declared &&
                 head[0] > PASSED * best + MORE_TICKS;
    return found ? (best - declared) * dt : NAN;
}

/* Delay._moved */
static void followed_by(const Delay *delay, int m, double dt, const double *behind, const double *came, const double *last,
                        const double *before, double still)
{
    double *head = delay->head, square = dot(m, last, last), left = exp(-dt / LONGEST_LAG);
    head[BEHIND] = left * head[BEHIND] + dt * dot(m, behind, last);
    head[MOVED] = left * head[MOVED] + square;
    head[CAME_ALONG] = left * head[CAME_ALONG] + dot(m, came, last);
    head[GAINED] = left * head[GAINED] + square - dt * dot(m, before, last);
    head[MOVING] = square > (still * dt) * (still * dt) ? head[MOVING] + dt : 0.0;
    if (head[MOVING] > LONGEST_LAG && fmin(head[CAME_ALONG], head[GAINED]) > FOLLOWS * head[MOVED])
        head[LAG] = fmin(fmax(head[BEHIND] / head[GAINED], 0.0), LONGEST_LAG);
}

/* Delay.after */
void delayed(const Delay *delay, const Loop *loop, const double *q, const double *command, const Row J[6], const double place[3],
             double size, const double *velocity, bool touching)
{
    int m = loop->joints;
    double *head = delay->head, *at[6], dt = loop->dt;
    Row step, came, behind, moved;
    for (int i = 0; i < 6; i++)
        at[i] = head + HEADER + i * m;
    head[TOUCHED] = head[TOUCHED] != 0.0 || touching;
    bool known = head[TOUCHED] != 0.0 && lags(delay);
    if (known && !isnan(head[ACTS]))
        return;
    if (isnan(at[FIRST][0])) {
        double root[6][6];
        Row A[6];
        root_at(place, size, root);
        product_of_rows(6, (const double(*)[6])root, m, J, A);
        for (int j = 0; j < m; j++) {
            double sum = 0.0;
            for (int i = 0; i < 6; i++)
                sum += A[i][j] * A[i][j];
            at[FIRST][j] = q[j];
            at[WEIGHTS][j] = sqrt(sum);
            at[TOLD][j] = at[CAME][j] = at[LAST][j] = 0.0;
            at[BEFORE][j] = velocity == NULL ? 0.0 : at[WEIGHTS][j] * velocity[j];
        }
    }
    for (int j = 0; j < m; j++) {
        step[j] = at[WEIGHTS][j] * (dt * command[j]);
        came[j] = at[WEIGHTS][j] * (q[j] - at[FIRST][j]);
        behind[j] = at[TOLD][j] - came[j];
        moved[j] = came[j] - at[CAME][j];
    }
    if (!known)
        followed_by(delay, m, dt, behind, moved, at[LAST], at[BEFORE], STILL * size);
    for (int j = 0; j < m; j++) {
        at[LAST][j] = step[j];
        at[CAME][j] = came[j];
        at[TOLD][j] += step[j];
    }
    head[WAY] += norm(m, step);
    if (!isnan(head[ACTS]))
        return;
    head[ACTS] = echoed(delay, m, dt, (int)nearbyint(loop->delay / dt), came, at[TOLD]);
    if (isnan(head[ACTS]) && head[WAY] > ENOUGH * size && delay->echo[0] > PASSED * delay->rows)
        head[ACTS] = 0.0;
}
