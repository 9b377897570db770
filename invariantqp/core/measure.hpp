// The size of a twist, |root s|^2 = L^2 |omega|^2 + |v at a point|^2: velocity/measure.py and systems/points.py say why.
#pragma once
#include "matrix.hpp"
#include "tolerances.hpp"

namespace iq {

constexpr double LENGTH_LIMIT = 1 / TERM_ROUNDING;  // a larger length is rounding [units of the caller]
constexpr double FAR = 1e6;                         // a point this many lengths away is rounding of a twist

inline Vec three(Workspace& w, double x, double y, double z)
{
    Vec v(w, 3);
    v[0] = x, v[1] = y, v[2] = z;
    return v;
}
inline Vec cross(Vec a, Vec b)
{
    return three(*a.w, a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]);
}
// v + omega x p
inline Vec velocity_at(Vec s, Vec p) { return s.part(3, 6) + cross(s.part(0, 3), p); }

// (6,) the derivative of a chain's twist J c at constant joint velocity c: sum over j < i of c_j c_i [J_j, J_i].
inline Vec twist_change(Mat J, Vec c)
{
    Workspace& w = *c.w;
    Vec moved(w, 6, 0), change(w, 6, 0), column(w, 6);
    for (int j = 0; j < c.n; j++) {
        for (int i = 0; i < 6; i++)
            column[i] = c[j] * J(i, j);
        change.part(0, 3).add(1, cross(moved.part(0, 3), column.part(0, 3)));
        change.part(3, 6).add(1, cross(moved.part(0, 3), column.part(3, 6)));
        change.part(3, 6).add(1, cross(moved.part(3, 6), column.part(0, 3)));
        moved.add(1, column);
    }
    return change;
}

inline Mat root_at(Vec p, double length)
{
    Mat root(*p.w, 6, 6, 0);
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        root(i, i) = length, root(i + 3, i + 3) = 1;
        root(i + 3, j) = p[k], root(i + 3, k) = -p[j];
    }
    return root;
}

// |v_p| / |omega| of the rows of S; 0 where either is zero, to rounding.
inline double ratio(Mat S, Vec p)
{
    double turning = 0, moving = 0, moment = 0;
    for (int i = 0; i < S.rows; i++) {
        turning += S[i].part(0, 3).square(), moment += S[i].part(3, 6).square();
        moving += velocity_at(S[i], p).square();
    }
    const double rate = std::sqrt(turning), speed = std::sqrt(moving);
    const double most = std::max(std::sqrt(moment), rate * p.norm());
    return speed <= TERM_ROUNDING * most || rate * LENGTH_LIMIT <= speed ? 0 : speed / rate;
}

// The point that joint twists, rows of S, move least; where it is free, the twist s settles it.
inline Vec own_point(Mat S, Vec s)
{
    Workspace& w = *S.w;
    Mat W(w, S.rows, 3);
    double moving = 0;
    Vec moment(w, 3, 0), p(w, 3, 0);
    for (int i = 0; i < S.rows; i++) {
        W[i].set(S[i].part(0, 3));
        moving += S[i].part(3, 6).square();
        moment.add(1, cross(S[i].part(0, 3), S[i].part(3, 6)));
    }
    const double turning = W.all().square();
    Vec along;
    double length = 0;
    if (moving > turning * LENGTH_LIMIT * LENGTH_LIMIT || turning == 0) {
        const double rate = s.part(0, 3).square();
        along = rate > 0 ? (-1 / rate) * cross(s.part(0, 3), s.part(3, 6)) : Vec(w, 3, 0);
    } else {
        const SymmetricEigen spread(t(W) * W);
        int free = -1;
        double most = 0;
        for (int i = 0; i < 3; i++)
            most = std::max(most, turning - spread.values[i]);
        for (int i = 0; i < 3; i++) {
            const double stiffness = turning - spread.values[i];
            if (stiffness > TERM_ROUNDING * most)
                p.add(spread.V[i].dot(moment) / stiffness, spread.V[i]);
            else
                free = i;
        }
        if (free < 0)
            return p;
        double moved = 0;
        for (int i = 0; i < S.rows; i++)
            moved += velocity_at(S[i], p).square();
        if (moved * LENGTH_LIMIT * LENGTH_LIMIT > std::max(moving, turning))
            length = std::sqrt(moved / turning);
        const Vec across = cross(s.part(0, 3), spread.V[free]);
        const double square = across.square();
        const bool turns = square > TERM_ROUNDING * TERM_ROUNDING * s.part(0, 3).square();
        along = (turns ? across.dot(velocity_at(s, p)) / square : 0) * spread.V[free];
    }
    return along.norm() <= FAR * (length > 0 ? length : 1) ? p - along : p;
}

// The broken line from a point to its feet on the turning axes, the last one first.
inline double reach(Mat S, Vec point)
{
    double length = 0, size = point.norm();
    Vec foot = point.copy();
    for (int i = S.rows - 1; i >= 0; i--) {
        const double rate = S[i].part(0, 3).norm(), moment = S[i].part(3, 6).norm();
        if (rate * LENGTH_LIMIT <= moment)
            continue;
        const Vec leg = cross(S[i].part(0, 3) / rate, velocity_at(S[i] / rate, foot));
        foot.add(1, leg);
        length += leg.norm();
        size = std::max(size, moment / rate);
    }
    return length > TERM_ROUNDING * size ? length : 0;
}

inline double length_at(Mat S, Vec p, Vec s)
{
    const double of_twist = ratio(Mat(s.p, 1, 6, s.w), p);
    double far = reach(S, p);
    if (far <= TERM_ROUNDING * of_twist) {
        Mat turning(*S.w, S.rows, 6);
        int count = 0;
        for (int i = 0; i < S.rows; i++)
            if (S[i].part(0, 3).square() * LENGTH_LIMIT * LENGTH_LIMIT > S[i].part(3, 6).square())
                turning[count++].set(S[i]);
        far = ratio(turning.rows_from(0, count), p);
    }
    return far > TERM_ROUNDING * of_twist ? far : of_twist > 0 ? of_twist : 1;
}

// Which joints only slide: each counts 1 / L^2 in the joint metric. Absent where none does.
inline Mat sliding_metric(Mat S, Vec p, double length)
{
    Mat metric;
    for (int i = 0; i < S.rows; i++) {
        const double moving = velocity_at(S[i], p).norm();
        if (S[i].part(0, 3).norm() * length <= ROUNDING * moving && moving > 0) {
            metric = metric.w ? metric : Mat::identity(*S.w, S.rows);
            metric(i, i) = 1 / (length * length);
        }
    }
    return metric;
}

}  // namespace iq
