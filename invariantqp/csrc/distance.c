/* Twin of geometry/distance.py: distances of convex shapes, and where they are near. */

#include "distance.h"

/* Below these shares, lines are parallel, and a normal has no direction. */
static const double PARALLEL_LINES = 1e-14, NO_DIRECTION = 1e-12;

static void minus(const double a[3], const double b[3], double w[3])
{
    for (int i = 0; i < 3; i++)
        w[i] = a[i] - b[i];
}

/* Its length; it becomes 1 where it is above `least`. */
static double made_unit(double n[3], double least)
{
    double size = norm(3, n);
    for (int i = 0; i < 3 && size > least; i++)
        n[i] /= size;
    return size;
}

static void on_line(const double p[3], double t, const double u[3], double x[3])
{
    for (int i = 0; i < 3; i++)
        x[i] = p[i] + t * u[i];
}

static void column(const Shape *s, int k, double size, double u[3])
{
    for (int i = 0; i < 3; i++)
        u[i] = size * s->R[i][k];
}

/* Coordinates in the shape's frame, of a point or of a direction; and back. */
static void into(const Shape *s, const double x[3], bool point, double y[3])
{
    static const double ORIGIN[3] = {0.0, 0.0, 0.0};
    double from[3];
    minus(x, point ? s->p : ORIGIN, from);
    for (int k = 0; k < 3; k++)
        y[k] = s->R[0][k] * from[0] + s->R[1][k] * from[1] + s->R[2][k] * from[2];
}

static void out_of(const Shape *s, const double y[3], bool point, double x[3])
{
    for (int i = 0; i < 3; i++)
        x[i] = dot(3, s->R[i], y) + (point ? s->p[i] : 0.0);
}

/* Axis z of a core that has no direction of its own: some unit vector across u. */
static void some_across(const double u[3], double n[3])
{
    int k = 0;
    for (int i = 1; i < 3; i++)
        if (fabs(u[i]) < fabs(u[k]))
            k = i;
    double e[3] = {k == 0, k == 1, k == 2};
    cross(u, e, n);
    if (!(made_unit(n, 0.0) > 0.0)) {
        n[0] = n[1] = 0.0;
        n[2] = 1.0;
    }
}

/* A place at distance d of a point x, `sign` n from the first core to the second. */
static void add_known(Places *found, double d, const double n[3], double sign, const double x[3])
{
    if (found->count >= MOST_PLACES)
        return;
    Near *near = &found->at[found->count++];
    near->d = d;
    for (int i = 0; i < 3; i++) {
        near->n[i] = sign * n[i];
        near->x[i] = x[i];
    }
}

/* A place from a point x of the first core to y of the second, `across` the direction where they meet. */
static void add(Places *found, const double x[3], const double y[3], const double across[3])
{
    double n[3];
    minus(y, x, n);
    double d = made_unit(n, NO_DIRECTION);
    add_known(found, d, d > NO_DIRECTION ? n : across, 1.0, x);
}

static double foot(const double x[3], const double s[3], const double v[3])
{
    double w[3], vv = dot(3, v, v);
    minus(x, s, w);
    return vv > 0.0 ? between(dot(3, w, v) / vv, 0.0, 1.0) : 0.0;
}

/* Two capsules' cores: where both are nearest inside, and each end against the other. */
static void round_round(const Shape *a, const Shape *b, Places *found)
{
    double u[3], v[3], w[3], p[3], s[3], x[3], y[3], across[3];
    column(a, 2, 2.0 * a->half[2], u);
    column(b, 2, 2.0 * b->half[2], v);
    on_line(a->p, -0.5, u, p);
    on_line(b->p, -0.5, v, s);
    minus(p, s, w);
    double uu = dot(3, u, u), uv = dot(3, u, v), vv = dot(3, v, v), uw = dot(3, u, w), vw = dot(3, v, w);
    double D = uu * vv - uv * uv;
    cross(u, v, across);
    double parallel = PARALLEL_LINES * sqrt(uu * vv);
    if (!(made_unit(across, parallel) > parallel))
        some_across(uu > vv ? u : v, across);
    if (D > PARALLEL_LINES * uu * vv) {
        double t = (uv * vw - vv * uw) / D, r = (uv * t + vw) / vv;
        if (t >= 0.0 && t <= 1.0 && r >= 0.0 && r <= 1.0) {
            t = between((uv * r - uw) / uu, 0.0, 1.0);
            on_line(p, t, u, x);
            on_line(s, r, v, y);
            add(found, x, y, across);
        }
    }
    for (int e = 0; e < (uu > 0.0 ? 2 : 1); e++) {
        on_line(p, e, u, x);
        on_line(s, foot(x, s, v), v, y);
        add(found, x, y, across);
    }
    for (int e = 0; e < (vv > 0.0 ? 2 : 1); e++) {
        on_line(s, e, v, y);
        on_line(p, foot(y, p, u), u, x);
        add(found, x, y, across);
    }
}

/* Parameter of the point of p + t u, t in [0, 1], nearest to the box |y| <= h: where a monotone slope meets zero. */
static double nearest_to_box(const double p[3], const double u[3], const double h[3])
{
    double t[8] = {0.0, 1.0};
    int n = 2;
    for (int k = 0; k < 3; k++)
        for (int side = -1; side <= 1; side += 2) {
            double at = u[k] != 0.0 ? (side * h[k] - p[k]) / u[k] : 0.0;
            if (!(at > 0.0 && at < 1.0))
                continue;
            int i = n++;
            for (; i > 0 && t[i - 1] > at; i--)
                t[i] = t[i - 1];
            t[i] = at;
        }
    double before = 0.0, slope = 0.0;
    for (int i = 0; i < n; i++) {
        slope = 0.0;
        for (int k = 0; k < 3; k++) {
            double y = p[k] + t[i] * u[k];
            slope += (y - between(y, -h[k], h[k])) * u[k];
        }
        if (slope >= 0.0)
            return i == 0 || slope == 0.0 || !(slope > before) ? t[i]
                                                               : t[i - 1] - before / (slope - before) * (t[i] - t[i - 1]);
        before = slope;
    }
    return 1.0;
}

/* Two cores that go into each other: the largest separation among faces and pairs of edges, at the deepest corner of that
   one of which less is level there, in the middle of what is. */
static void way_apart(const Shape *a, const Shape *b, double sign, Places *found)
{
    double most = -INFINITY, best[3] = {0.0, 0.0, 1.0}, w[3], x[2][3];
    int level[2] = {0, 0};
    minus(b->p, a->p, w);
    for (int axis = 0; axis < 15; axis++) {
        double n[3], f[3], g[3];
        if (axis < 6)
            column(axis < 3 ? a : b, axis % 3, 1.0, n);
        else {
            column(a, (axis - 6) / 3, 1.0, f);
            column(b, (axis - 6) % 3, 1.0, g);
            cross(f, g, n);
            if (!(made_unit(n, NO_DIRECTION) > NO_DIRECTION))
                continue;
        }
        double towards = dot(3, n, w), s = fabs(towards);
        into(a, n, false, f);
        into(b, n, false, g);
        for (int k = 0; k < 3; k++)
            s -= fabs(f[k]) * a->half[k] + fabs(g[k]) * b->half[k];
        if (s > most) {
            most = s;
            for (int i = 0; i < 3; i++)
                best[i] = towards < 0.0 ? -n[i] : n[i];
        }
    }
    for (int e = 0; e < 2; e++) {
        const Shape *s = e == 0 ? a : b;
        double g[3];
        into(s, best, false, g);
        for (int k = 0; k < 3; k++) {
            bool flat = fabs(g[k]) <= NO_DIRECTION;
            level[e] += flat && s->half[k] > 0.0;
            g[k] = flat ? 0.0 : (g[k] > 0.0) == (e == 0) ? s->half[k] : -s->half[k];
        }
        out_of(s, g, true, x[e]);
    }
    add_known(found, most, best, sign, x[level[0] > level[1]]);
}

/* A place of the point y, in the frame of box b, against it; the first core is the point's where `sign` is 1. */
static void point_box(const Shape *b, const double y[3], double sign, Places *found)
{
    double n[3], x[3];
    Shape point = *b;
    for (int k = 0; k < 3; k++) {
        n[k] = y[k] - between(y[k], -b->half[k], b->half[k]);
        point.half[k] = 0.0;
    }
    double d = made_unit(n, NO_DIRECTION);
    out_of(b, y, true, point.p);
    if (!(d > NO_DIRECTION)) {
        way_apart(&point, b, sign, found);
        return;
    }
    out_of(b, n, false, x);
    add_known(found, d, x, -sign, point.p);
}

/* A segment, p + t u in the frame of box b, against it; `ends` too, and where its shadow on the nearest face begins and
   ends. False where it goes into the box. */
static bool segment_box(const Shape *b, const double p[3], const double u[3], double sign, bool ends, Places *found)
{
    const double *h = b->half;
    double t = nearest_to_box(p, u, h), y[3], from = 0.0, to = 1.0;
    on_line(p, t, u, y);
    int beyond = 0;
    double d = 0.0;
    for (int k = 0; k < 3; k++) {
        double gap = y[k] - between(y[k], -h[k], h[k]);
        d += gap * gap;
        beyond += gap != 0.0;
    }
    if (sqrt(d) <= NO_DIRECTION)
        return false;
    point_box(b, y, sign, found);
    for (int k = 0; k < 3; k++) {
        if (fabs(y[k]) > h[k] || u[k] == 0.0)
            continue;
        double one = (-h[k] - p[k]) / u[k], other = (h[k] - p[k]) / u[k];
        from = fmax(from, fmin(one, other));
        to = fmin(to, fmax(one, other));
    }
    double places[4] = {from, to, 0.0, 1.0};
    for (int i = 0; i < 4; i++) {
        if (places[i] == t || (i < 2 ? (beyond != 1 || !(from < to) || places[i] <= 0.0 || places[i] >= 1.0) : !ends))
            continue;
        on_line(p, places[i], u, y);
        point_box(b, y, sign, found);
    }
    return true;
}

/* The core of a capsule, a, against box b; `sign` is -1 where the capsule is the second of the pair. */
static void round_box(const Shape *a, const Shape *b, double sign, Places *found)
{
    double u[3], v[3], c[3], p[3];
    column(a, 2, 2.0 * a->half[2], u);
    into(b, u, false, v);
    into(b, a->p, true, c);
    on_line(c, -0.5, v, p);
    if (a->half[2] == 0.0)
        point_box(b, c, sign, found);
    else if (!segment_box(b, p, v, sign, true, found))
        way_apart(a, b, sign, found);
}

static void corner(const double h[3], int i, double c[3])
{
    for (int k = 0; k < 3; k++)
        c[k] = (i >> k & 1) ? h[k] : -h[k];
}

/* Two boxes: the edges of each against the other, and corners. */
static void box_box(const Shape *a, const Shape *b, Places *found)
{
    bool apart = true;
    for (int turn = 0; turn < 2 && apart; turn++) {
        const Shape *one = turn == 0 ? a : b, *other = turn == 0 ? b : a;
        double sign = turn == 0 ? 1.0 : -1.0;
        for (int i = 0; i < 8 && apart; i++) {
            double c[3], x[3], y[3];
            corner(one->half, i, c);
            out_of(one, c, true, x);
            into(other, x, true, y);
            point_box(other, y, sign, found);
            for (int k = 0; k < 3 && apart; k++) {
                double step[3], u[3];
                if (i >> k & 1)
                    continue;
                column(one, k, 2.0 * one->half[k], step);
                into(other, step, false, u);
                apart = segment_box(other, y, u, sign, false, found);
            }
        }
    }
    if (apart)
        return;
    found->count = 0;
    way_apart(a, b, 1.0, found);
}

/* A core a against a half-space b: its corners; `sign` is -1 where the half-space is the first of the pair. */
static void core_plane(const Shape *a, const Shape *b, double sign, Places *found)
{
    double normal[3], c[3], x[3];
    column(b, 2, 1.0, normal);
    for (int i = 0; i < 8; i++) {
        bool twice = false;
        for (int k = 0; k < 3; k++)
            twice = twice || (a->half[k] == 0.0 && (i >> k & 1));
        if (twice)
            continue;
        corner(a->half, i, c);
        out_of(a, c, true, x);
        double w[3];
        minus(x, b->p, w);
        add_known(found, dot(3, normal, w), normal, -sign, x);
    }
}

/* All places of two shapes, by their distance. */
void near_places(const Shape *a, const Shape *b, Places *found)
{
    found->count = 0;
    if (a->kind == FREE_SIDE && b->kind == FREE_SIDE)
        return;
    if (b->kind == FREE_SIDE)
        core_plane(a, b, 1.0, found);
    else if (a->kind == FREE_SIDE)
        core_plane(b, a, -1.0, found);
    else if (a->kind == ROUND && b->kind == ROUND)
        round_round(a, b, found);
    else if (a->kind == ROUND)
        round_box(a, b, 1.0, found);
    else if (b->kind == ROUND)
        round_box(b, a, -1.0, found);
    else
        box_box(a, b, found);
    for (int i = 0; i < found->count; i++) {
        Near near = found->at[i];
        near.d -= a->radius + b->radius;
        int at = i;
        for (; at > 0 && found->at[at - 1].d > near.d; at--)
            found->at[at] = found->at[at - 1];
        found->at[at] = near;
    }
}

/* Distances of two shapes are at least this: those of balls about them. */
double at_least(const Shape *a, const Shape *b)
{
    const Shape *plane = b->kind == FREE_SIDE ? b : a->kind == FREE_SIDE ? a : NULL, *other = plane == a ? b : a;
    double w[3], normal[3];
    minus(other->p, (plane != NULL ? plane : b)->p, w);
    if (plane == NULL)
        return norm(3, w) - a->ball - b->ball;
    column(plane, 2, 1.0, normal);
    return dot(3, normal, w) - other->ball;
}
