// Limits on y, and what minimises a quadratic inside them.
#pragma once
#include "qp.hpp"
#include <optional>

namespace iq {

constexpr double ROUNDING = 1e-9, ROOT_ROUNDING = 3.1622776601683795e-05;  // definition.py says of what; and its root
constexpr double TINY = 2.2250738585072014e-308;

// 1 for a direction of joint velocities that moves nothing, 0 for one that does; rounding is between them.
inline double still(const SVD& svd, int i)
{
    const double sigma = i < svd.sigma.n ? svd.sigma[i] : 0;
    return std::clamp(2 - 2 * sigma / (ROUNDING * std::max(svd.sigma[0], TINY)), 0.0, 1.0);
}

// lower <= C y <= upper, and |P y + start| <= speed.
struct Room {
    Mat C;
    Vec lower, upper;
    Mat P;
    Vec start;
    double speed = INFINITY;

    bool allows(Vec y) const
    {
        return within(lower, C * y, upper) && (!P.w || (start + P * y).norm() <= speed);
    }
    // The last point inside, but for rounding, on the way from one inside to y.
    Vec last_inside(Vec from, Vec y) const
    {
        const Vec way = y - from, value = C * y, change = C * way;
        double share = 1;
        for (int i = 0; i < C.rows; i++) {
            const double over = std::max(value[i] - upper[i], lower[i] - value[i]) - ROUNDING * C[i].norm() * y.norm();
            if (over > 0)
                share = std::min(share, 1 - over / std::abs(change[i]));
        }
        const double most = speed * (1 + ROOT_ROUNDING);
        if (P.w && (start + P * y).norm() > most) {
            const Vec a = start + P * from, b = P * way;
            const double half = a.dot(b), left = std::max(0.0, most * most - a.square());
            share = std::min(share, (std::sqrt(half * half + b.square() * left) - half) / b.square());
        }
        return share < 1 ? from + std::max(share, 0.0) * way : y;
    }
    // The same for y = origin + basis z; no memory of a basis is the identity.
    Room on(Vec origin, Mat basis) const
    {
        const Vec value = C * origin;
        Room room{basis.w ? C * basis : C, lower - value, upper - value, P, start, speed};
        if (P.w) {
            room.P = basis.w ? P * basis : P;
            room.start = start + P * origin;
            for (int j = 0; basis.w && j < basis.cols; j++) {  // directions that leave the point at rest, but for rounding
                double moved = 0, length = 0;
                for (int i = 0; i < 3; i++)
                    moved += room.P(i, j) * room.P(i, j);
                for (int i = 0; i < basis.rows; i++)
                    length += basis(i, j) * basis(i, j);
                for (int i = 0; moved <= ROUNDING * ROUNDING * length * P.all().square() && i < 3; i++)
                    room.P(i, j) = 0;
            }
        }
        return room;
    }
    // With bounds on the last of the variables.
    Room with_row(double least, double most) const
    {
        Room room = *this;
        Workspace& w = *C.w;
        Mat last(w, 1, C.cols, 0);
        last(0, C.cols - 1) = 1;
        room.C = stacked(C, last);
        room.lower = joined(lower, Vec(w, 1, least)), room.upper = joined(upper, Vec(w, 1, most));
        return room;
    }
};

// 1/2 |T^-1 (y - centre)|^2
struct Quadratic {
    Mat T;
    Vec centre;
};

struct Optimum {
    Vec y, multipliers;  // multipliers of the room's rows; absent where neither a row nor the speed is active
};

// argmin of a quadratic over the rows of a room.
inline std::optional<Optimum> polytope_optimum(const Quadratic& of, const Room& room)
{
    const Vec value = room.C * of.centre;
    if (within(room.lower, value, room.upper))
        return Optimum{of.centre, {}};
    Mat N = room.C * of.T;
    Vec low = room.lower - value, high = room.upper - value, size(*N.w, N.rows);
    const double least = 1e-12 * of.T.all().norm();
    for (int i = 0; i < N.rows; i++) {
        size[i] = N[i].norm();
        if (size[i] <= least) {  // a row that nothing moves
            if (std::max(low[i], -high[i]) > ROOT_ROUNDING)
                return {};
            N[i].fill(0);
            size[i] = 1, low[i] = -INFINITY, high[i] = INFINITY;
        }
        N[i].scale(1 / size[i]);
        low[i] /= size[i], high[i] /= size[i];
    }
    ActiveSet set(N, low, high);
    const Nearest nearest = set.nearest();
    if (!nearest.found)
        return {};
    Optimum found{of.centre + of.T * nearest.x, nearest.multipliers};
    for (int twice = 0; twice < 2; twice++) {  // digits of active rows that a centre far away takes
        Vec left = room.C * found.y;
        for (int i = 0; i < left.n; i++)
            left[i] = set.side(i) ? ((set.side(i) > 0 ? room.upper[i] : room.lower[i]) - left[i]) / size[i] : 0;
        found.y.add(1, of.T * set.correction(left));
    }
    for (int i = 0; i < N.rows; i++)
        nearest.multipliers[i] /= size[i];
    return found;
}

// argmin of a quadratic inside a room. The tool's speed is kept by its multiplier k: 1/2 k |start + P y|^2 is added.
inline std::optional<Optimum> minimise(const Quadratic& of, const Room& room)
{
    std::optional<Optimum> found = polytope_optimum(of, room);
    if (!found || !room.P.w)
        return found;
    const auto speed = [&](Vec y) { return (room.start + room.P * y).norm(); };
    const double first = speed(found->y);
    if (first <= room.speed)
        return found;
    const double margin = ROOT_ROUNDING * (room.speed + first);
    const Mat M = room.P * of.T;
    if (M.all().square() == 0)
        return first <= room.speed + margin ? found : std::nullopt;
    // In e, y = centre + T e: least |e|^2 + k |start + M e|^2, which is diagonal along the singular directions of M.
    const SVD svd(M);
    const Mat T = of.T * t(svd.V);
    const Vec start = svd.U * (room.start + room.P * of.centre);
    const auto at = [&](double k) {
        Mat root = T.copy();
        Vec e(*M.w, M.cols, 0);
        for (int i = 0; i < svd.sigma.n; i++) {
            const double s = svd.sigma[i], weight = 1 + k * s * s;
            e[i] = -k * s * start[i] / weight;
            for (int j = 0; j < root.rows; j++)
                root(j, i) /= std::sqrt(weight);
        }
        std::optional<Optimum> found = polytope_optimum({root, of.centre + T * e}, room);
        if (found && !found->multipliers.w)
            found->multipliers = Vec(*M.w, room.C.rows, 0);
        return found;
    };
    // 1 / speed grows almost in proportion to k while the active limits stay.
    const double unit = 1 / M.all().square();
    double below = 0, above = INFINITY, k = unit, slow_below = 1 / first, slow_above = 0;
    for (int count = 0; count < 200; count++) {
        std::optional<Optimum> next = at(k);
        if (!next)
            return {};
        const double now = speed(next->y);
        found = next;
        if (std::abs(now - room.speed) <= 1e-13 * room.speed || (now <= room.speed && k <= 1e-9 * unit))
            return found;
        (now > room.speed ? below : above) = k;
        (now > room.speed ? slow_below : slow_above) = 1 / now;
        if (above == INFINITY) {
            if (k > 1e22 * unit)
                return now <= room.speed + margin ? found : std::nullopt;
            k *= 30;
            continue;
        }
        if (above - below <= 1e-15 * above)
            return at(above);
        const double share = (1 / room.speed - slow_below) / (slow_above - slow_below);
        const double middle = count % 3 == 2 || !(share > 0 && share < 1) ? 0.5 : share;
        k = below + middle * (above - below);
    }
    return found;
}

}  // namespace iq
