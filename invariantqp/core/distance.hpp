// Distances and witness points of two convex shapes; exact to rounding, in penetration too.
//
//     d = min |y - x| - r_a - r_b  over x in core a, y in core b       separate cores
//     d = -(penetration depth) - r_a - r_b                             overlapping cores
//
// Between parallel faces the nearest points jump at the slightest rotation, and a limit at them alone chatters. So a
// pair has several witnesses: the nearest points, and the ends and corners of each core against the other one.
#pragma once
#include "chain.hpp"

namespace iq {

constexpr double PARALLEL = 1e-14;  // a sine, or its square, below which lines have no common normal
constexpr double NO_DIRECTION = 1e-12;  // a vector [length], or cross product of unit vectors, without a direction
constexpr int MOST_WITNESSES = 96;      // two boxes: 24 edges, each with 3 points at most, and 16 corners

enum class ShapeCore { segment, box, half_space, mesh };  // geometry/shapes.py

// All points within a radius of a core: a segment along z, a box of half sizes, or the half-space z <= 0.
struct Shape {
    ShapeCore core;
    double radius;
    Vec3 half;
    Pose at;
    double ball = norm(half) + radius;  // radius of its bounding ball

    Vec3 axis(int k) const { return {at.R[0][k], at.R[1][k], at.R[2][k]}; }
    // A direction along its axes.
    Vec3 into(const Vec3& n) const { return n[0] * at.R[0] + n[1] * at.R[1] + n[2] * at.R[2]; }
};

struct Witness {
    double distance;     // negative in penetration
    Vec3 normal, point;  // unit normal from the first shape to the second; point of the first core
};

struct Witnesses {
    int count = 0;
    Witness at[MOST_WITNESSES];

    void add(double distance, const Vec3& normal, const Vec3& point)
    {
        if (count < MOST_WITNESSES)
            at[count++] = {distance, normal, point};
    }
    // From points x of the first and y of the second core; `normal` is used if they coincide.
    void add(const Vec3& x, const Vec3& y, const Vec3& normal)
    {
        const double d = norm(y - x);
        add(d, d > NO_DIRECTION ? (1 / d) * (y - x) : normal, x);
    }
    // Sorts by distance, less the sum of both radii.
    void finish(double radii)
    {
        for (int i = 0; i < count; i++) {
            const Witness witness{at[i].distance - radii, at[i].normal, at[i].point};
            int k = i;
            for (; k > 0 && at[k - 1].distance > witness.distance; k--)
                at[k] = at[k - 1];
            at[k] = witness;
        }
    }
};

inline double clamped(double x, double low, double high) { return std::min(std::max(x, low), high); }
inline Vec3 clamped(const Vec3& y, const Vec3& half)
{
    return {clamped(y[0], -half[0], half[0]), clamped(y[1], -half[1], half[1]), clamped(y[2], -half[2], half[2])};
}

// A unit vector perpendicular to u.
inline Vec3 perpendicular(const Vec3& u)
{
    int k = 0;
    for (int i = 1; i < 3; i++)
        if (std::abs(u[i]) < std::abs(u[k]))
            k = i;
    Vec3 e{0, 0, 0};
    e[k] = 1;
    const Vec3 n = cross(u, e);
    const double size = norm(n);
    return size > 0 ? (1 / size) * n : Vec3{0, 0, 1};
}

// The point of the segment from s along v that is nearest to x.
inline Vec3 foot(const Vec3& x, const Vec3& s, const Vec3& v)
{
    const double vv = dot(v, v);
    return vv > 0 ? s + clamped(dot(x - s, v) / vv, 0, 1) * v : s;
}

// Two segments: the nearest points between their ends, and each end against the other segment.
inline void segments(const Shape& a, const Shape& b, Witnesses& found)
{
    const Vec3 u = 2 * a.half[2] * a.axis(2), v = 2 * b.half[2] * b.axis(2), p = a.at.p - 0.5 * u, s = b.at.p - 0.5 * v;
    const double uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), uw = dot(u, p - s), vw = dot(v, p - s);
    Vec3 normal = cross(u, v);
    const double size = norm(normal), D = uu * vv - uv * uv;
    normal = size > PARALLEL * std::sqrt(uu * vv) ? (1 / size) * normal : perpendicular(uu > vv ? u : v);
    if (D > PARALLEL * uu * vv) {
        const double t = (uv * vw - vv * uw) / D, r = (uv * t + vw) / vv;
        if (t >= 0 && t <= 1 && r >= 0 && r <= 1)
            found.add(p + clamped((uv * r - uw) / uu, 0, 1) * u, s + r * v, normal);
    }
    for (int end = 0; end < (uu > 0 ? 2 : 1); end++) {
        const Vec3 x = p + double(end) * u;
        found.add(x, foot(x, s, v), normal);
    }
    for (int end = 0; end < (vv > 0 ? 2 : 1); end++) {
        const Vec3 y = s + double(end) * v;
        found.add(foot(y, p, u), y, normal);
    }
}

// Overlapping cores: the axis of least penetration among the normals of faces and pairs of edges, with the deepest
// corner of the core that has fewer sides parallel to the plane. `sign` is -1 if a is the second shape.
inline void penetration(const Shape& a, const Shape& b, double sign, Witnesses& found)
{
    double largest = -INFINITY;
    Vec3 best{0, 0, 1};
    for (int axis = 0; axis < 15; axis++) {
        Vec3 n = axis < 3 ? a.axis(axis) : b.axis(axis % 3);
        if (axis >= 6) {
            n = cross(a.axis((axis - 6) / 3), b.axis(axis % 3));
            const double size = norm(n);
            if (!(size > NO_DIRECTION))
                continue;
            n = (1 / size) * n;
        }
        const double offset = dot(n, b.at.p - a.at.p);
        const Vec3 f = a.into(n), g = b.into(n);
        double separation = std::abs(offset);
        for (int k = 0; k < 3; k++)
            separation -= std::abs(f[k]) * a.half[k] + std::abs(g[k]) * b.half[k];
        if (separation > largest)
            largest = separation, best = offset < 0 ? -1 * n : n;
    }
    Vec3 deepest[2];
    int parallel[2] = {0, 0};
    for (int e = 0; e < 2; e++) {
        const Shape& s = e == 0 ? a : b;
        Vec3 corner = s.into(e == 0 ? best : -1 * best);
        for (int k = 0; k < 3; k++) {
            const bool flat = std::abs(corner[k]) <= NO_DIRECTION;
            parallel[e] += flat && s.half[k] > 0;
            corner[k] = flat ? 0 : std::copysign(s.half[k], corner[k]);
        }
        deepest[e] = s.at * corner;
    }
    found.add(largest, sign * best, parallel[0] > parallel[1] ? deepest[1] : deepest[0]);
}

// Point y, in the frame of box b, and the box; `sign` is 1 if the point is of the first shape.
inline void point_and_box(const Vec3& y, const Shape& b, double sign, Witnesses& found)
{
    const Vec3 gap = y - clamped(y, b.half), x = b.at * y, out = b.at.R * gap;
    const double d = norm(gap);
    if (d > NO_DIRECTION)
        found.add(d, (-sign / d) * out, sign > 0 ? x : x - out);
    else
        penetration({ShapeCore::segment, 0, {0, 0, 0}, {b.at.R, x}}, b, sign, found);
}

// t in [0, 1] for which p + t u is nearest to the box |y| <= h: the zero of a monotone, piecewise linear slope.
inline double nearest_to_box(const Vec3& p, const Vec3& u, const Vec3& h)
{
    double t[8] = {0, 1};
    int n = 2;
    for (int k = 0; k < 3; k++)
        for (const double side : {-h[k], h[k]})
            if (const double at = u[k] != 0 ? (side - p[k]) / u[k] : 0; at > 0 && at < 1)
                t[n++] = at;
    std::sort(t, t + n);
    double before = 0;
    for (int i = 0; i < n; i++) {
        const Vec3 y = p + t[i] * u;
        const double slope = dot(y - clamped(y, h), u);
        if (slope >= 0)
            return i == 0 || slope == 0 || !(slope > before) ? t[i]
                                                             : t[i - 1] - before / (slope - before) * (t[i] - t[i - 1]);
        before = slope;
    }
    return 1;
}

// A segment p + t u, in the frame of box b, and the box: the nearest point, the ends of its projection on the nearest
// face, and its own `ends`. False if it penetrates the box.
inline bool segment_and_box(const Vec3& p, const Vec3& u, const Shape& b, double sign, bool ends, Witnesses& found)
{
    const Vec3& h = b.half;
    const double t = nearest_to_box(p, u, h);
    const Vec3 y = p + t * u, gap = y - clamped(y, h);
    if (norm(gap) <= NO_DIRECTION)
        return false;
    point_and_box(y, b, sign, found);
    double from = 0, to = 1;
    for (int k = 0; k < 3; k++)
        if (gap[k] == 0 && u[k] != 0) {
            const double one = (-h[k] - p[k]) / u[k], other = (h[k] - p[k]) / u[k];
            from = std::max(from, std::min(one, other)), to = std::min(to, std::max(one, other));
        }
    const bool over_face = (gap[0] != 0) + (gap[1] != 0) + (gap[2] != 0) == 1 && from < to;
    for (const double at : {from, to})
        if (over_face && at > 0 && at < 1 && at != t)
            point_and_box(p + at * u, b, sign, found);
    for (const double at : {0.0, 1.0})
        if (ends && at != t)
            point_and_box(p + at * u, b, sign, found);
    return true;
}

// Segment or point a and box b.
inline void segment_core_and_box(const Shape& a, const Shape& b, double sign, Witnesses& found)
{
    const Vec3 centre = b.into(a.at.p - b.at.p), u = 2 * a.half[2] * b.into(a.axis(2));
    if (a.half[2] == 0)
        point_and_box(centre, b, sign, found);
    else if (!segment_and_box(centre - 0.5 * u, u, b, sign, true, found))
        penetration(a, b, sign, found);
}

inline Vec3 corner(const Vec3& half, int i)
{
    return {i & 1 ? half[0] : -half[0], i & 2 ? half[1] : -half[1], i & 4 ? half[2] : -half[2]};
}

// Two boxes: the corners and edges of each against the other.
inline void boxes(const Shape& a, const Shape& b, Witnesses& found)
{
    for (const double sign : {1.0, -1.0}) {
        const Shape &one = sign > 0 ? a : b, &other = sign > 0 ? b : a;
        for (int i = 0; i < 8; i++) {
            const Vec3 y = other.into(one.at * corner(one.half, i) - other.at.p);
            point_and_box(y, other, sign, found);
            for (int k = 0; k < 3; k++)
                if (!(i >> k & 1)
                    && !segment_and_box(y, 2 * one.half[k] * other.into(one.axis(k)), other, sign, false, found)) {
                    found.count = 0;
                    return penetration(a, b, 1, found);
                }
        }
    }
}

// The ends or corners of core a against half-space b.
inline void core_and_plane(const Shape& a, const Shape& b, double sign, Witnesses& found)
{
    const Vec3 normal = b.axis(2);
    for (int i = 0; i < 8; i++) {
        if ((a.half[0] == 0 && i & 1) || (a.half[1] == 0 && i & 2) || (a.half[2] == 0 && i & 4))
            continue;  // the same corner
        const Vec3 x = a.at * corner(a.half, i);
        const double height = dot(normal, x - b.at.p);
        found.add(height, -sign * normal, sign > 0 ? x : x - height * normal);
    }
}

// All witnesses of two shapes other than meshes, by distance; none of two half-spaces.
inline Witnesses witnesses(const Shape& a, const Shape& b)
{
    Witnesses found;
    if (a.core == ShapeCore::half_space && b.core == ShapeCore::half_space)
        return found;
    if (b.core == ShapeCore::half_space)
        core_and_plane(a, b, 1, found);
    else if (a.core == ShapeCore::half_space)
        core_and_plane(b, a, -1, found);
    else if (a.core == ShapeCore::segment && b.core == ShapeCore::segment)
        segments(a, b, found);
    else if (a.core == ShapeCore::segment)
        segment_core_and_box(a, b, 1, found);
    else if (b.core == ShapeCore::segment)
        segment_core_and_box(b, a, -1, found);
    else
        boxes(a, b, found);
    found.finish(a.radius + b.radius);
    return found;
}

// A lower bound of the distance of two shapes, from bounding balls.
inline double distance_bound(const Shape& a, const Shape& b)
{
    if (b.core == ShapeCore::half_space)
        return dot(b.axis(2), a.at.p - b.at.p) - a.ball;
    if (a.core == ShapeCore::half_space)
        return distance_bound(b, a);
    return norm(b.at.p - a.at.p) - a.ball - b.ball;
}

}  // namespace iq
