// The joint velocity that a form attempts for a twist, in place of least squares.
#pragma once
#include "law.hpp"
#include "feasible_set.hpp"

namespace iq {

struct Formed {
    Mat root;      // (k, m) of its size on y, G = root'root
    Vec x_f, x_e;  // (m,) x_h for the feedforward and for the error
    double form_share = 1;
};

inline Mat pitch_form(double h, Workspace& w)
{
    Mat Q(w, 6, 6, 0);
    for (int i = 0; i < 3; i++)
        Q(i, i) = -2 * h, Q(i, i + 3) = Q(i + 3, i) = 1;
    return Q;
}

// J'Q_h J of joint twists (6, m). Of more than six joints, J = R M with orthonormal rows M, and R'Q_h R has all that is not
// zero.
inline SymmetricEigen gram(Mat J, double h, Workspace& w)
{
    const Mat Q = pitch_form(h, w);
    if (J.cols <= 6)
        return SymmetricEigen(t(J) * (Q * J));
    const RQ rq(J);
    const SymmetricEigen small(t(rq.R) * (Q * rq.R));
    const Mat V = rq.basis(), M = V.rows_from(rq.free, J.cols);
    M.set(small.V * M);
    return {V, joined(Vec(w, rq.free, 0), small.values)};
}

// The root of V' diag(sqrt(mu_i^2 + lambda^2)) V
inline Mat weighted(const SymmetricEigen& eigen, double damping)
{
    Mat rows = eigen.V.copy();
    for (int i = 0; i < rows.rows; i++)
        rows[i].scale(std::sqrt(std::hypot(eigen.values[i], damping)));
    return rows;
}

// For measured joint twists B = R J (6, m) on y and their singular values. Absent where the form has no projector.
inline std::optional<Formed> formed(const Tick& tick, Mat J, Mat B, const SVD& svd, Vec f, Vec e, Workspace& w)
{
    Formed found;
    const int r = svd.rank(PRODUCT_ROUNDING);
    if (tick.form == FormKind::pitch && tick.damping > 0) {
        const Mat QJ = pitch_form(tick.pitch, w) * J;
        const SymmetricEigen eigen = gram(J, tick.pitch, w);
        const auto damped = [&](Vec s) {
            Vec u = eigen.V * (t(QJ) * s);
            for (int i = 0; i < u.n; i++) {
                const double gain = 1 / std::hypot(eigen.values[i], tick.damping);
                u[i] *= gain * (eigen.values[i] * gain);
            }
            return t(eigen.V) * u;
        };
        found = {weighted(eigen, tick.damping), damped(tick.feedforward), damped(tick.error)};
    } else {
        // P = Z (K'Z)^-1 K': rows K' are zero on what the form gives up. No unit is mixed with another in Z.
        Mat across = svd.V.rows_from(0, r).copy(), rule, both;
        for (int i = 0; i < r; i++)
            across[i].scale(1 / svd.sigma[i]);
        const Mat Z = J * t(across);  // (6, r) in the frame of J, orthonormal in the measure
        Vec u_f, u_e;
        double most = 1;
        if (tick.form == FormKind::complement) {
            const int c = tick.form_matrix.cols;
            if (c + r != 6)
                return {};
            rule = SVD(transposed(tick.root * tick.form_matrix)).V.rows_from(c, 6);
            both = rule * (tick.root * Z), u_f = rule * f, u_e = rule * e;
        } else {
            rule = t(Z) * (tick.form == FormKind::pitch ? pitch_form(tick.pitch, w) : tick.form_matrix);
            both = rule * Z, u_f = rule * tick.feedforward, u_e = rule * tick.error;
            double angular = 0, linear = 0, length = 0;
            for (int i = 0; i < 6; i++)
                length += tick.root[i].part(0, 3).square() / 3;
            for (int i = 0; i < r; i++)
                angular += rule[i].part(0, 3).square(), linear += rule[i].part(3, 6).square();
            most = std::sqrt(angular / (length + TINY) + linear);
        }
        const SVD split(both);
        if (r && !(split.sigma[r - 1] > TERM_ROUNDING * most))
            return {};
        const auto attempted = [&](Vec u) { return t(across) * split.least(u, r); };
        found = {B, attempted(u_f), attempted(u_e)};
        if (tick.form == FormKind::pitch)
            found.root = weighted(gram(J, tick.pitch, w), 0);
    }
    if (tick.guard >= 0) {
        const int few = svd.rank(ROUNDING);
        const Vec least_f = svd.least(f, few), least_e = svd.least(e, few), step = found.x_f + found.x_e - least_f - least_e;
        const double most = (B * (least_f + least_e)).norm();
        found.form_share = std::min(1.0, std::sqrt(1 - tick.guard) * most / std::max((B * step).norm(), TINY));
        found.x_f = least_f + found.form_share * (found.x_f - least_f);
        found.x_e = least_e + found.form_share * (found.x_e - least_e);
    }
    return found;
}

}  // namespace iq
