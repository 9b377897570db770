// The point of a polytope nearest to the origin, by a dual active set method (Goldfarb and Idnani 1983).
//
//     minimise 1/2 |x|^2   over   lower <= N x <= upper,   rows of N of length one
//
// The active rows are N_a = L Q, Q orthonormal: a row is added by Gram and Schmidt, and taken out by Givens rotations.
#pragma once
#include "matrix.hpp"
#include "tolerances.hpp"
#include <cstdint>

namespace iq {

struct NearestPoint {
    Vec x;
    Vec multipliers;  // of each row: positive at its upper bound, negative at its lower one
    bool found = false;
};

class ActiveSet {
  public:
    ActiveSet(Mat N, Vec lower, Vec upper)
        : N(N), lower(lower), upper(upper), Q(*N.w, N.cols, N.cols), L(*N.w, N.cols, N.cols), x(*N.w, N.cols, 0),
          w(*N.w, N.cols), d(*N.w, N.cols), z(*N.w, N.cols), r(*N.w, N.cols), dual(*N.w, N.cols), value(*N.w, N.rows, 0),
          active(N.rows, 0), at(N.cols)
    {
        for (int i = 0; i < N.rows; i++)
            scale = std::max({scale, lower[i], -upper[i]});
    }

    NearestPoint nearest()
    {
        NearestPoint found{x, Vec(*N.w, N.rows, 0)};
        const int most = 50 + 10 * (N.rows + N.cols);
        int steps = 0;
        for (int row = most_violated(); row >= 0; row = most_violated())
            if (!activate(row, steps, most))
                return found;
        for (int j = 0; j < k; j++)
            found.multipliers[at[j]] = active[at[j]] * dual[j];
        found.found = true;
        return found;
    }
    // 1 where a row is active at its upper bound, -1 at its lower one.
    int side(int row) const { return active[row] == 2 ? 0 : active[row]; }
    // The least change of x that moves the active rows by what of `left` is theirs.
    Vec correction(Vec left) const
    {
        Vec dx(*N.w, N.cols, 0), by(*N.w, k);
        for (int j = 0; j < k; j++) {
            by[j] = (active[at[j]] * left[at[j]] - L[j].part(0, j).dot(by.part(0, j))) / L(j, j);
            dx.add(by[j], Q[j]);
        }
        return dx;
    }

  private:
    static constexpr double DEPENDENT = 1e-11;  // a row whose part outside the span of the active rows is shorter depends on them

    Mat N;
    Vec lower, upper;
    Mat Q, L;
    Vec x, w, d, z, r, dual, value;  // w: x = w Q;  dual: the multipliers, not negative
    std::vector<std::int8_t> active;  // of each row: 1 at its upper bound, -1 at its lower one, 2 where it is redundant
    std::vector<int> at;
    int k = 0, placed = 0;  // how many rows are active; how many of them x includes
    double scale = 0;

    double excess(int row, int& side) const
    {
        const double above = value[row] - upper[row], below = lower[row] - value[row];
        side = above >= below ? 1 : -1;
        return std::max(above, below);
    }
    // The inactive row with the largest violation, or -1.
    int most_violated()
    {
        int found = -1, side;
        double most = PRODUCT_ROUNDING * scale;
        for (int i = 0; i < N.rows; i++) {
            if (active[i])
                continue;
            value[i] = N[i].dot(x);
            if (const double by = excess(i, side); by > most)
                most = by, found = i;
        }
        return found;
    }
    // Moves x until a row is active; rows whose multiplier becomes zero leave the active set.
    bool activate(int row, int& steps, int most)
    {
        int side;
        double by = excess(row, side), added = 0;
        while (true) {
            if (++steps > most)
                return false;
            const double left = project(row, side);
            directions();
            int leaving = -1;
            double dual_step = INFINITY;
            for (int j = 0; j < k; j++)
                if (r[j] > 10 * UNIT_ROUNDING && dual[j] < dual_step * r[j])
                    dual_step = dual[j] / r[j], leaving = j;
            const bool moves = left > DEPENDENT;
            if (!moves && leaving < 0) {
                if (by > ROUNDING * scale)
                    return false;
                active[row] = 2;
                return true;
            }
            const double primal = moves ? by / (left * left) : INFINITY, step = std::min(primal, dual_step);
            for (int j = 0; j < k; j++)
                dual[j] = std::max(0.0, dual[j] - step * r[j]);
            added += step;
            if (primal <= dual_step) {
                add(row, side, left, added);
                return true;
            }
            if (moves) {
                x.add(-step, z);
                by -= step * left * left;
            }
            remove(leaving);
        }
    }
    // d, z of the row's outward normal n = d Q + z; the length of z.
    double project(int row, int side)
    {
        z.set(N[row]);
        z.scale(side);
        for (int j = 0; j < k; j++) {
            d[j] = Q[j].dot(z);
            z.add(-d[j], Q[j]);
        }
        for (int j = 0; j < k; j++) {
            const double again = Q[j].dot(z);
            d[j] += again;
            z.add(-again, Q[j]);
        }
        return z.norm();
    }
    // r, with d Q = sum of r_j times the active normals.
    void directions()
    {
        r.part(0, k).set(d.part(0, k));
        for (int j = k - 1; j >= 0; j--) {
            r[j] /= L(j, j);
            r.part(0, j).add(-r[j], L[j].part(0, j));
        }
    }
    double bound(int row, int side) const { return side > 0 ? upper[row] : -lower[row]; }
    void add(int row, int side, double left, double multiplier)
    {
        L[k].part(0, k).set(d.part(0, k));
        L(k, k) = left;
        Q[k].set(z);
        Q[k].scale(1 / left);
        w[k] = (bound(row, side) - d.part(0, k).dot(w.part(0, k))) / left;
        active[row] = static_cast<std::int8_t>(side), at[k] = row, dual[k] = multiplier;
        k++;
        place();
    }
    // x = w Q, the point of the active rows that is nearest to the origin, and its multipliers -w = dual L.
    void place()
    {
        if (placed == 0)
            x.fill(0);
        for (; placed < k; placed++)
            x.add(w[placed], Q[placed]);
        for (int j = 0; j < k; j++)
            dual[j] = -w[j];
        for (int j = k - 1; j >= 0; j--) {
            dual[j] = std::max(0.0, dual[j] / L(j, j));
            dual.part(0, j).add(-dual[j], L[j].part(0, j));
        }
    }
    void remove(int j)
    {
        active[at[j]] = 0, placed = 0;
        for (int i = j + 1; i < k; i++) {
            at[i - 1] = at[i], dual[i - 1] = dual[i];
            L[i - 1].part(0, i + 1).set(L[i].part(0, i + 1));
        }
        k--;
        for (int i = j; i < k; i++) {  // row i has an element too many
            const double a = L(i, i), b = L(i, i + 1), size = std::hypot(a, b), c = a / size, s = b / size;
            for (int l = i; l < k; l++) {
                const double p = L(l, i), q = L(l, i + 1);
                L(l, i) = c * p + s * q, L(l, i + 1) = c * q - s * p;
            }
            for (int l = 0; l < Q.cols; l++) {
                const double p = Q(i, l), q = Q(i + 1, l);
                Q(i, l) = c * p + s * q, Q(i + 1, l) = c * q - s * p;
            }
        }
        for (int i = j; i < k; i++)
            w[i] = (bound(at[i], active[at[i]]) - L[i].part(0, i).dot(w.part(0, i))) / L(i, i);
        for (int i = 0; i < N.rows; i++)
            if (active[i] == 2)
                active[i] = 0;
    }
};

}  // namespace iq
