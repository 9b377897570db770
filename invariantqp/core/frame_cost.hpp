// The cost of a frame's error for programs that solve their own QP: of the law, F_p of a twist by itself.
#pragma once
#include "forms.hpp"

namespace iq {

// The cost of joint velocities that do not move the frame, as a share of |A|^2. Enough for a QP solver where no other task
// decides them; a posture task with Pink's usual cost of 1e-3 has ten thousand times that.
constexpr double FREE = 1e-10;

// 1/2 x'Hx + c'x, and 1/2 damping |x|^2 of all joints, also of those that do not move the frame.
struct Cost {
    Mat H;  // (m, m)
    Vec c;  // (m,)
    double damping = 0;
};

// Rows M with P = I - M'M, the projector on joint velocities that move nothing.
inline Mat moving_rows(Mat A, Workspace& w)
{
    const int m = A.cols;
    const RQ rq(A.rows <= m ? A : transposed(A));
    if (rq.regular(ROUNDING)) {
        Mat M = Mat::identity(w, m).rows_from(std::max(0, m - A.rows), m);
        for (int i = 0; A.rows < m && i < M.rows; i++)
            rq.turn_back(M[i]);
        return M;
    }
    const SVD svd(A);
    Mat M = svd.V.rows_from(0, svd.sigma.n);
    for (int i = 0; i < M.rows; i++)
        M[i].scale(std::sqrt(1 - null_weight(svd, i)));
    return M;
}

// For the desired twist tick.feedforward: H = A'A, c = -A'b, or with a form H = G, c = -G x_h. Absent if the form has no projector.
inline std::optional<Cost> frame_cost(const Tick& tick, double lm_damping, Workspace& w)
{
    const int m = tick.J.cols;
    const Mat A = tick.root * tick.J, M = moving_rows(A, w);
    const Vec b = tick.root * tick.feedforward;
    const double size = A.all().square();
    Cost cost{t(A) * A, -1 * (t(A) * b), lm_damping * b.square()};
    double more = tick.damping * tick.damping;
    if (tick.form != FormKind::none) {
        const std::optional<Formed> form = formed(tick, tick.J, A, SVD(A), b, tick.root * tick.error, w);
        if (!form)
            return {};
        const Mat K = form->root.copy();
        K.all().scale(std::sqrt(size / std::max(K.all().square(), TINY)));  // a form has another unit than A'A
        cost.H = t(K) * K, cost.c = -1 * (t(K) * (K * form->x_f)), more = 0;
    }
    const double free = FREE * (size > 0 ? size : 1);
    for (int i = 0; i < m; i++)
        cost.H(i, i) += more + free;
    for (int k = 0; k < M.rows; k++)
        for (int i = 0; i < m; i++)
            cost.H[i].add(-free * M(k, i), M[k]);
    return cost;
}

}  // namespace iq
