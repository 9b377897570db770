// The feasible set of joint velocities, and the minimiser of a quadratic over it.
#pragma once
#include "qp.hpp"
#include <optional>

namespace iq {

// Weight of singular direction i in the null-space projector: 1 in the null space, 0 outside, between them in rounding.
inline double null_weight(const SVD& svd, int i)
{
    const double sigma = i < svd.sigma.n ? svd.sigma[i] : 0;
    return std::clamp(2 - 2 * sigma / (ROUNDING * std::max(svd.sigma[0], TINY)), 0.0, 1.0);
}

// The y with lower <= C y <= upper and |P y + start| <= speed.
struct FeasibleSet {
    Mat C;
    Vec lower, upper;
    Mat P;
    Vec start;
    double speed = INFINITY;

    bool contains(Vec y) const
    {
        return within(lower, C * y, upper) && (!P.w || (start + P * y).norm() <= speed);
    }
    // y or, if it is outside by more than rounding, the last feasible point on the segment from a feasible one to y.
    Vec last_feasible(Vec from, Vec y) const
    {
        const Vec step = y - from, value = C * y, change = C * step;
        double share = 1;
        for (int i = 0; i < C.rows; i++) {
            const double over = std::max(value[i] - upper[i], lower[i] - value[i]) - ROUNDING * C[i].norm() * y.norm();
            if (over > 0)
                share = std::min(share, 1 - over / std::abs(change[i]));
        }
        const double most = speed * (1 + ROOT_ROUNDING);
        if (P.w && (start + P * y).norm() > most) {
            const Vec a = start + P * from, b = P * step;
            const double half = a.dot(b), left = std::max(0.0, most * most - a.square());
            share = std::min(share, (std::sqrt(half * half + b.square() * left) - half) / b.square());
        }
        return share < 1 ? from + std::max(share, 0.0) * step : y;
    }
    // The set of z with y = origin + basis z; an absent basis is the identity.
    FeasibleSet in_coordinates(Vec origin, Mat basis) const
    {
        const Vec value = C * origin;
        FeasibleSet set{basis.w ? C * basis : C, lower - value, upper - value, P, start, speed};
        if (P.w) {
            set.P = basis.w ? P * basis : P;
            set.start = start + P * origin;
            for (int j = 0; basis.w && j < basis.cols; j++) {  // directions that move the point by rounding alone
                double moved = 0, length = 0;
                for (int i = 0; i < 3; i++)
                    moved += set.P(i, j) * set.P(i, j);
                for (int i = 0; i < basis.rows; i++)
                    length += basis(i, j) * basis(i, j);
                for (int i = 0; moved <= ROUNDING * ROUNDING * length * P.all().square() && i < 3; i++)
                    set.P(i, j) = 0;
            }
        }
        return set;
    }
    // With bounds on the last variable.
    FeasibleSet with_last_bounded(double least, double most) const
    {
        FeasibleSet set = *this;
        Workspace& w = *C.w;
        Mat last(w, 1, C.cols, 0);
        last(0, C.cols - 1) = 1;
        set.C = stacked(C, last);
        set.lower = joined(lower, Vec(w, 1, least)), set.upper = joined(upper, Vec(w, 1, most));
        return set;
    }
};

// 1/2 |T^-1 (y - centre)|^2
struct Quadratic {
    Mat T;
    Vec centre;
};

struct Optimum {
    Vec y, multipliers;  // multipliers of the rows; absent where neither a row nor the speed is active
};

// Minimises a quadratic over the rows of a feasible set; absent where these are infeasible.
inline std::optional<Optimum> polytope_optimum(const Quadratic& of, const FeasibleSet& feasible)
{
    const Vec value = feasible.C * of.centre;
    if (within(feasible.lower, value, feasible.upper))
        return Optimum{of.centre, {}};
    Mat N = feasible.C * of.T;
    Vec low = feasible.lower - value, high = feasible.upper - value, size(*N.w, N.rows);
    const double least = TERM_ROUNDING * of.T.all().norm();
    for (int i = 0; i < N.rows; i++) {
        size[i] = N[i].norm();
        if (size[i] <= least) {  // a row that no variable changes
            if (std::max(low[i], -high[i]) > ROOT_ROUNDING)
                return {};
            N[i].fill(0);
            size[i] = 1, low[i] = -INFINITY, high[i] = INFINITY;
        }
        N[i].scale(1 / size[i]);
        low[i] /= size[i], high[i] /= size[i];
    }
    ActiveSet set(N, low, high);
    const NearestPoint nearest = set.nearest();
    if (!nearest.found)
        return {};
    Optimum found{of.centre + of.T * nearest.x, nearest.multipliers};
    for (int twice = 0; twice < 2; twice++) {  // iterative refinement: a distant centre costs digits of the active rows
        Vec left = feasible.C * found.y;
        for (int i = 0; i < left.n; i++)
            left[i] = set.side(i) ? ((set.side(i) > 0 ? feasible.upper[i] : feasible.lower[i]) - left[i]) / size[i] : 0;
        found.y.add(1, of.T * set.correction(left));
    }
    for (int i = 0; i < N.rows; i++)
        nearest.multipliers[i] /= size[i];
    return found;
}

// Minimises a quadratic over a feasible set. The speed limit is enforced by its multiplier k: 1/2 k |start + P y|^2 is added.
inline std::optional<Optimum> minimise(const Quadratic& of, const FeasibleSet& feasible)
{
    std::optional<Optimum> found = polytope_optimum(of, feasible);
    if (!found || !feasible.P.w)
        return found;
    const auto speed = [&](Vec y) { return (feasible.start + feasible.P * y).norm(); };
    const double first = speed(found->y);
    if (first <= feasible.speed)
        return found;
    const double margin = ROOT_ROUNDING * (feasible.speed + first);
    const Mat M = feasible.P * of.T;
    if (M.all().square() == 0)
        return first <= feasible.speed + margin ? found : std::nullopt;
    // In e, y = centre + T e: least |e|^2 + k |start + M e|^2, which is diagonal along the singular directions of M.
    const SVD svd(M);
    const Mat T = of.T * t(svd.V);
    const Vec start = svd.U * (feasible.start + feasible.P * of.centre);
    const auto at = [&](double k) {
        Mat root = T.copy();
        Vec e(*M.w, M.cols, 0);
        for (int i = 0; i < svd.sigma.n; i++) {
            const double s = svd.sigma[i], weight = 1 + k * s * s;
            e[i] = -k * s * start[i] / weight;
            for (int j = 0; j < root.rows; j++)
                root(j, i) /= std::sqrt(weight);
        }
        std::optional<Optimum> found = polytope_optimum({root, of.centre + T * e}, feasible);
        if (found && !found->multipliers.w)
            found->multipliers = Vec(*M.w, feasible.C.rows, 0);
        return found;
    };
    // 1 / speed grows almost in proportion to k while the active limits stay.
    constexpr double MOST_MULTIPLIER = 1e22, GROWTH = 30;  // of the bracket of k
    constexpr int MOST_STEPS = 200;
    const double unit = 1 / M.all().square();
    double below = 0, above = INFINITY, k = unit, slow_below = 1 / first, slow_above = 0;
    for (int count = 0; count < MOST_STEPS; count++) {
        std::optional<Optimum> next = at(k);
        if (!next)
            return {};
        const double now = speed(next->y);
        found = next;
        if (std::abs(now - feasible.speed) <= PRODUCT_ROUNDING * feasible.speed || (now <= feasible.speed && k <= ROUNDING * unit))
            return found;
        (now > feasible.speed ? below : above) = k;
        (now > feasible.speed ? slow_below : slow_above) = 1 / now;
        if (above == INFINITY) {
            if (k > MOST_MULTIPLIER * unit)
                return now <= feasible.speed + margin ? found : std::nullopt;
            k *= GROWTH;
            continue;
        }
        if (above - below <= UNIT_ROUNDING * above)
            return at(above);
        const double share = (1 / feasible.speed - slow_below) / (slow_above - slow_below);
        const double middle = count % 3 == 2 || !(share > 0 && share < 1) ? 0.5 : share;
        k = below + middle * (above - below);
    }
    return found;
}

}  // namespace iq
