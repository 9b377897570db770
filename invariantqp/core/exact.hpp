// Exact rows in a form whose rank does not depend on frame, unit or choice of rows.
#pragma once
#include "law.hpp"
#include "feasible_set.hpp"

namespace iq {

// Demands are compared with at least this share of the terms they sum, as in velocity/exact.py.
constexpr double LEAST_DEMAND = 1e-5;

struct ExactRows {
    Mat E, D;
    Vec f, e;
    double inconsistency = 0;  // of the demands of dependent rows, relative
};

// Replaces rows that are parts of the twist, E = D J, by orthonormal ones in the measure of the first body, and scales the
// others to the norm of all of these together.
inline ExactRows whitened(const Tick& tick, Workspace& w)
{
    ExactRows rows{tick.E, tick.D, tick.E_f, tick.E_e};
    if (!tick.D.w || tick.D.all().square() == 0)
        return rows;
    std::vector<int> parts, others;
    for (int i = 0; i < tick.D.rows; i++)
        (tick.D[i].square() > 0 ? parts : others).push_back(i);
    const int k = static_cast<int>(parts.size());
    Mat measured(w, k, 6), D(w, k, 6), E(w, k, tick.E.cols), root(w, 6, 6);
    Vec f(w, k), e(w, k), terms(w, k, 0);
    const Mat& measure = tick.measure.w ? tick.measure : tick.root;
    for (int i = 0; i < 6; i++)
        root[i].set(measure[i].part(0, 6));
    const Mat back = RQ(root).inverse();
    for (int i = 0; i < k; i++) {
        const Vec row = t(back) * tick.D[parts[i]];
        const double size = row.norm();
        measured[i].set(row / size), D[i].set(tick.D[parts[i]] / size), E[i].set(tick.E[parts[i]] / size);
        f[i] = tick.E_f[parts[i]] / size, e[i] = tick.E_e[parts[i]] / size;
        for (int j = 0; j < 6; j++)
            terms[i] += std::abs(tick.D(parts[i], j) * (tick.feedforward[j] + tick.error[j])) / size;
    }
    const SVD svd(measured);
    Mat M = svd.U.rows_from(0, svd.rank(ROUNDING));
    const Vec demand = f + e;
    if (const double most = std::max(demand.norm(), LEAST_DEMAND * terms.norm()); most > 0)
        rows.inconsistency = (demand - t(M) * (M * demand)).norm() / most;
    rows.inconsistency = rows.inconsistency > SOLVED ? rows.inconsistency : 0;
    for (int i = 0; i < M.rows; i++)
        M[i].scale(1 / svd.sigma[i]);
    rows.E = M * E, rows.D = M * D, rows.f = M * f, rows.e = M * e;
    const double size = rows.E.all().norm();
    for (const int i : others) {
        const double scale = (size > 0 ? size : 1) / (tick.E[i].norm() + TINY);
        rows.E = stacked(rows.E, Mat((scale * tick.E[i]).p, 1, E.cols, &w));
        rows.D = stacked(rows.D, Mat(w, 1, 6, 0));
        rows.f = joined(rows.f, Vec(w, 1, scale * tick.E_f[i]));
        rows.e = joined(rows.e, Vec(w, 1, scale * tick.E_e[i]));
    }
    return rows;
}

}  // namespace iq
