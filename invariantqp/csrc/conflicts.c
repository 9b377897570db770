/* Twin of legacy/tick.py (_given_way): limits that contradict each other, which of them give way, by the least amount.

       rows against the box        minimise |t|^2 with lower <= N y - t <= upper, x = T y in the box; then |y|^2
       tool speed against both     the least speed of the point that they leave

   t follows from y: how far each row is outside. What is minimised over y is piecewise quadratic, so each step finds the
   optimum for the rows that are outside now, and goes towards it as far as that gains. */

#include "core.h"

/* Steps, at most, and one for each row. */
#define PASSES_MORE 8
/* A decision that rounding may make: within this factor of a tolerance. */
static const double CLOSE = 10.0;
/* Rows that give way by less than this share of the velocity are Python's to tell from rows that meet. */
static const double MEETING = 1e-13, APART = 1e-7;

void begun(int n, double weight, const double *centre, Squares *sum)
{
    sum->n = n;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++)
            sum->R[i][j] = i == j ? weight : 0.0;
        sum->d[i] = centre != NULL ? weight * centre[i] : 0.0;
    }
}

/* Add 1/2 (a'z - b)^2. */
void add_square(Squares *sum, const Row a, double b)
{
    Row row;
    memcpy(row, a, (size_t)sum->n * sizeof(double));
    for (int i = 0; i < sum->n; i++) {
        double size = hypot(sum->R[i][i], row[i]);
        if (size == 0.0)
            continue;
        double c = sum->R[i][i] / size, s = row[i] / size, kept = sum->d[i];
        for (int j = i; j < sum->n; j++) {
            double above = sum->R[i][j];
            sum->R[i][j] = c * above + s * row[j];
            row[j] = c * row[j] - s * above;
        }
        sum->d[i] = c * kept + s * b;
        b = c * b - s * kept;
    }
}

void solved_by(const Squares *sum, Quadratic *problem)
{
    int n = problem->n = sum->n;
    zeroed(problem->centre);
    for (int j = 0; j < n; j++) {
        double *t = problem->T[j];
        zeroed(problem->K[j]);
        memcpy(problem->K[j], sum->R[j], (size_t)n * sizeof(double));
        zeroed(t);
        for (int i = j; i >= 0; i--)
            t[i] = ((i == j ? 1.0 : 0.0) - dot(j - i, sum->R[i] + i + 1, t + i + 1)) / sum->R[i][i];
        add_in_steps(n, sum->d[j], t, problem->centre);
    }
}

/* Rows of length one. */
typedef struct {
    int m, k;
    Row N[MOST_LIMITS];
    double lower[MOST_LIMITS], upper[MOST_LIMITS], length[MOST_LIMITS];
} Rows;

/* How far y is outside each row, above it positive. */
static void outside(const Rows *rows, const Row y, double *t)
{
    for (int i = 0; i < rows->k; i++) {
        double value = dot(rows->m, rows->N[i], y);
        t[i] = fmax(value - rows->upper[i], 0.0) + fmin(value - rows->lower[i], 0.0);
    }
}

/* The slope of 1/2 |t|^2 + 1/2 weight^2 |y - centre|^2 at from + share step, along the step. */
static double slope(const Rows *rows, double weight, const double *centre, const Row from, const Row step, double share)
{
    double sum = 0.0, t[MOST_LIMITS];
    Row y;
    for (int j = 0; j < rows->m; j++) {
        y[j] = from[j] + share * step[j];
        sum += weight * weight * step[j] * (y[j] - (centre != NULL ? centre[j] : 0.0));
    }
    outside(rows, y, t);
    for (int i = 0; i < rows->k; i++)
        sum += t[i] * dot(rows->m, rows->N[i], step);
    return sum;
}

/* The share of a step, up to 1, that gains most: the slope is linear between places where a row is met. */
static double best_share(const Rows *rows, double weight, const double *centre, const Row from, const Row step)
{
    double low = 0.0, high = 1.0, at_low = slope(rows, weight, centre, from, step, 0.0);
    double at_high = slope(rows, weight, centre, from, step, 1.0);
    if (at_high <= 0.0)
        return 1.0;
    for (int i = 0; i < rows->k; i++) {
        double change = dot(rows->m, rows->N[i], step), value = dot(rows->m, rows->N[i], from);
        for (int upper = 0; upper < 2 && change != 0.0; upper++) {
            double place = ((upper ? rows->upper[i] : rows->lower[i]) - value) / change;
            if (!(place > low && place < high))
                continue;
            double at = slope(rows, weight, centre, from, step, place);
            if (at <= 0.0) {
                low = place;
                at_low = at;
            } else {
                high = place;
                at_high = at;
            }
        }
    }
    return at_high > at_low ? low + (high - low) * at_low / (at_low - at_high) : low;
}

/* The y in the box with the least 1/2 |t|^2 + 1/2 weight^2 |y - centre|^2, from one that is in it. */
static Outcome least_violation(const Rows *rows, const Polytope *box, double weight, const double *centre, Row y, double *t,
                               Optimum *found)
{
    static const Cone NONE = {.limit = 0.0};
    int m = rows->m;
    Row step;
    Quadratic problem;
    for (int pass = 0; pass < rows->k + PASSES_MORE; pass++) {
        double after[MOST_LIMITS];
        bool same = true;
        Squares sum;
        outside(rows, y, t);
        begun(m, weight, centre, &sum);
        for (int i = 0; i < rows->k; i++)
            if (t[i] != 0.0)
                add_square(&sum, rows->N[i], t[i] > 0.0 ? rows->upper[i] : rows->lower[i]);
        solved_by(&sum, &problem);
        if (minimise(&problem, box, &NONE, y, pass > 0 ? found : NULL, found) == HAND_BACK)
            return HAND_BACK;
        outside(rows, found->z, after);
        double rounding = MEETING * norm(m, found->z);
        for (int i = 0; i < rows->k; i++)
            same = same && (((t[i] > 0.0) == (after[i] > 0.0) && (t[i] < 0.0) == (after[i] < 0.0)) ||
                            fmax(fabs(t[i]), fabs(after[i])) <= rounding);
        for (int j = 0; j < m; j++)
            step[j] = found->z[j] - y[j];
        double share = same ? 1.0 : best_share(rows, weight, centre, y, step);
        for (int j = 0; j < m; j++)
            y[j] += share * step[j];
        if (same) {
            memcpy(t, after, sizeof after);
            return DONE;
        }
    }
    return HAND_BACK;
}

/* The shortest y inside, from one that is. */
static Outcome shortest_inside(int m, const Polytope *limits, Row y)
{
    Squares sum;
    Quadratic problem;
    begun(m, 1.0, NULL, &sum);
    solved_by(&sum, &problem);
    return minimise_from(&problem, limits, y, y);
}

/* Whether y meets rows m, m + 1, ...: then none of them gives way. */
static bool meets(int m, int k, const Polytope *limits, const Row y)
{
    double size = MEETING * norm(m, y);
    for (int i = m; i < m + k; i++) {
        double value = dot(m, limits->A[i], y), rounding = size * norm(m, limits->A[i]);
        if (!(value >= limits->lower[i] - rounding && value <= limits->upper[i] + rounding))
            return false;
    }
    return inside_limits(limits, m, y);
}

/* Rows are limits m, m + 1, ... of both; they are moved, and `yielded` says by how much. `y` is in the box, then inside all. */
Outcome relaxed(int m, int k, Polytope *limits, Polytope *placed, Row y, Yielded *yielded)
{
    Rows rows = {.m = m, .k = k};
    Polytope box = {.count = m, .box = true};
    double t[MOST_LIMITS], most = 0.0, size = 0.0;
    Optimum found;
    Row first;
    memcpy(first, y, sizeof first);
    if (shortest_inside(m, limits, first) == DONE && meets(m, k, limits, first)) {
        memcpy(y, first, sizeof first);
        return DONE;
    }
    for (int j = 0; j < m; j++)
        for (int l = 0; l < m; l++) {
            box.A[j][l] = limits->box ? (j == l) : limits->A[j][l];
            box.box = box.box && box.A[j][l] == (j == l ? 1.0 : 0.0);
        }
    memcpy(box.lower, limits->lower, (size_t)m * sizeof(double));
    memcpy(box.upper, limits->upper, (size_t)m * sizeof(double));
    for (int i = 0; i < k; i++) {
        double length = norm(m, limits->A[m + i]);
        length = rows.length[i] = length > 0.0 ? length : 1.0;
        for (int j = 0; j < m; j++)
            rows.N[i][j] = limits->A[m + i][j] / length;
        rows.lower[i] = limits->lower[m + i] / length;
        rows.upper[i] = limits->upper[m + i] / length;
    }
    double weight = sqrt(REGULARISATION);
    if (least_violation(&rows, &box, weight, NULL, y, t, &found) == HAND_BACK)
        return HAND_BACK;
    memcpy(first, y, sizeof first);
    if (least_violation(&rows, &box, weight, first, y, t, &found) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < k; i++) {
        most = fmax(most, fabs(t[i]));
        size += t[i] * t[i];
    }
    size = sqrt(size + dot(m, y, y));
    if (most > MEETING * size && most < APART * size)
        return HAND_BACK;
    if (most <= MEETING * size)
        return shortest_inside(m, limits, y);
    yielded->rows = k;
    memset(yielded->by, 0, sizeof yielded->by);
    for (int i = 0; i < k; i++) {
        double by = fabs(t[i]);
        if (by * CLOSE > QP_ROUNDING * size && by < CLOSE * QP_ROUNDING * size)
            return HAND_BACK;
        if (by <= QP_ROUNDING * size)
            continue;
        double wider = rows.length[i] * (t[i] + copysign(WIDENING * most, t[i]));
        yielded->by[i] = rows.length[i] * t[i];
        yielded->share[i] = t[i];
        for (Polytope *moved = limits; moved != NULL; moved = moved == limits ? placed : NULL) {
            moved->lower[m + i] += fmin(wider, 0.0);
            moved->upper[m + i] += fmax(wider, 0.0);
        }
    }
    for (int j = 0; j < m; j++) {
        double pull = fabs(found.multipliers[j]) * norm(m, box.A[j]);
        if (pull * CLOSE > QP_ROUNDING * most && pull < CLOSE * QP_ROUNDING * most)
            return HAND_BACK;
        yielded->to[j] = pull > QP_ROUNDING * most;
    }
    return shortest_inside(m, limits, y);
}

/* The limit of the cone, raised to the least speed inside the other limits where that is above its own; y is inside them,
   then the slowest. */
Outcome slowed_point(int m, const Polytope *limits, Cone *cone, Row y, Yielded *yielded)
{
    double square = 0.0, least;
    Squares sum;
    Quadratic problem;
    for (int i = 0; i < 3; i++)
        square += dot(m, cone->J[i], cone->J[i]);
    begun(m, sqrt(REGULARISATION) * (square > 0.0 ? sqrt(square) : 1.0), NULL, &sum);
    for (int i = 0; i < 3; i++)
        add_square(&sum, cone->J[i], -cone->start[i]);
    solved_by(&sum, &problem);
    if (minimise_from(&problem, limits, y, y) == HAND_BACK)
        return HAND_BACK;
    least = tool_speed(cone, m, y);
    if (fabs(least - cone->limit) <= APART * cone->limit)
        return HAND_BACK;
    if (least > cone->limit) {
        yielded->limit = cone->limit;
        yielded->speed = least;
        cone->limit = least * (1.0 + FASTER);
    }
    return DONE;
}
