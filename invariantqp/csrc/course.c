/* Twin of control/curve.py, given_path.py and path_plan.py: what is looked up at a place of a path.

       P(at) = exp(u c1 + u^2 c2 + u^3 c3) P_i,   u = (at - at_i) / (at_i+1 - at_i)        between knots i and i + 1
       tangent = dP/d(at) P^-1,     v^2 linear between knots, q a cubic */

#include "path.h"

/* The piece between n increasing knots; what is beyond the ends is on the first or the last. */
int piece_of(int n, const double *knots, double at)
{
    int low = 0, high = n - 1;
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if (at < knots[middle])
            high = middle;
        else
            low = middle;
    }
    return low;
}

/* The same, looked for from a piece nearby on. */
static int piece_from(int i, int n, const double *knots, double at)
{
    while (i < n - 2 && knots[i + 1] <= at)
        i++;
    while (i > 0 && at < knots[i])
        i--;
    return i;
}

int piece_at(const Course *course, double at) { return piece_from(course->piece, course->knots, course->at, at); }

int nearest(const Course *course, double at)
{
    int i = piece_at(course, at);
    return at - course->at[i] < course->at[i + 1] - at ? i : i + 1;
}

void curve_pose(const Course *course, double at, Pose *T)
{
    int i = piece_from(course->part, course->poses, course->curve_at, at);
    const double *knots = course->curve_at + i, *c = course->cubics + 18 * i;
    double u = (at - knots[0]) / (knots[1] - knots[0]), twist[6];
    Pose step, start;
    for (int k = 0; k < 6; k++)
        twist[k] = u * c[k] + u * u * c[6 + k] + u * u * u * c[12 + k];
    exponential(twist, twist + 3, 1.0, &step);
    pose_from(course->pose + 16 * i, &start);
    product(&step, &start, T);
}

void curve_tangent(const Course *course, double at, double tangent[6])
{
    int i = piece_from(course->part, course->poses, course->curve_at, at);
    const double *knots = course->curve_at + i, *c = course->cubics + 18 * i;
    double h = knots[1] - knots[0], u = (at - knots[0]) / h, there[6], rate[6], once[6], twice[6], thrice[6];
    for (int k = 0; k < 6; k++) {
        there[k] = u * c[k] + u * u * c[6 + k] + u * u * u * c[12 + k];
        rate[k] = 1.0 / h * c[k] + 2.0 * u / h * c[6 + k] + 3.0 * u * u / h * c[12 + k];
    }
    lie(there, rate, once);
    lie(there, once, twice);
    lie(there, twice, thrice);
    for (int k = 0; k < 6; k++)
        tangent[k] = rate[k] + 0.5 * once[k] + twice[k] / 6.0 + thrice[k] / 24.0;
}

/* The caller's parameter. */
double caller_place(const Course *course, double at)
{
    const double *x = course->curve_at, *y = course->places;
    int n = course->poses, i = piece_from(course->part, n, x, at);
    if (at <= x[i] || at >= x[i + 1])
        return y[at <= x[i] ? i : i + 1];
    return (y[i + 1] - y[i]) / (x[i + 1] - x[i]) * (at - x[i]) + y[i];
}

void joints_at(const Course *course, double at, Row q)
{
    int i = piece_at(course, at), m = course->m;
    const double *x = course->q + m * i, *slope = course->slopes + m * i;
    double h = course->at[i + 1] - course->at[i], u = (at - course->at[i]) / h;
    double a = u * u * (3.0 - 2.0 * u), b = h * u * (1.0 - u) * (1.0 - u), c = h * u * u * (1.0 - u);
    for (int j = 0; j < m; j++)
        q[j] = (1.0 - a) * x[j] + a * x[m + j] + b * slope[j] - c * slope[m + j];
}

void slope_at(const Course *course, double at, Row slope)
{
    int i = piece_at(course, at), m = course->m;
    const double *x = course->q + m * i, *end = course->slopes + m * i;
    double h = course->at[i + 1] - course->at[i], u = (at - course->at[i]) / h;
    double a = 6.0 * u * (1.0 - u) / h, b = (1.0 - u) * (1.0 - 3.0 * u), c = u * (3.0 * u - 2.0);
    for (int j = 0; j < m; j++)
        slope[j] = a * (x[m + j] - x[j]) + b * end[j] + c * end[m + j];
}

/* The largest v^2 at a place, as piece i goes on, and its slope. */
static double square_at(const Course *course, bool back, int i, double at, double *slope)
{
    const double *knots = course->at + i, *squares = (back ? course->backward : course->forward) + i;
    *slope = (squares[1] - squares[0]) / (knots[1] - knots[0]);
    return squares[0] + *slope * (at - knots[0]);
}

/* The largest speed at a place; zero beyond the ends. The piece of a place nearby becomes that of this one. */
double speed_limit_at(const Course *course, double at, bool back, int *piece)
{
    const double *knots = course->at;
    double slope;
    *piece = piece_from(*piece, course->knots, knots, at);
    if (at < knots[0] || at > knots[course->knots - 1])
        return 0.0;
    return sqrt(fmax(square_at(course, back, *piece, at, &slope), 0.0));
}

/* The largest speed for a tick from a place on: what it lands on and its middle allow it. */
double speed_at(const Course *course, double at, double dt, double share, bool back)
{
    const double *knots = course->at, *squares = back ? course->backward : course->forward;
    double sign = back ? -1.0 : 1.0, part = share * share, most = INFINITY, v = 0.0, rate;
    int last = course->knots - 1, i = piece_at(course, at);
    for (int steps = 0; steps <= last; steps++) {
        double here = part * square_at(course, back, i, at, &rate);
        rate *= sign * part;
        double root = rate * rate * dt * dt + 4.0 * here;
        v = fmin(most, root > 0.0 ? 0.5 * (rate * dt + sqrt(root)) : 0.0);
        int j = back ? i : i + 1;
        if (j == 0 || j == last || v * dt <= sign * (knots[j] - at))
            break;
        most = fmin(most, fmax(share * sqrt(squares[j]), sign * (knots[j] - at) / dt));
        i += back ? -1 : 1;
    }
    v = fmax(0.0, fmin(v, sign * (knots[back ? 0 : last] - at) / dt));
    i = piece_at(course, at);
    return fmin(v, share * speed_limit_at(course, at + 0.5 * sign * dt * v, back, &i));
}
