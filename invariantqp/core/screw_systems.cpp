#include "screw_systems.hpp"

namespace iq {
namespace {

// Well conditioned: singular values and columns after orthogonalisation above LEAST_RATIO of the largest; (U'Q_h U) above
// LEAST_PIVOT, K'U above LEAST_SINE; metrics symmetric up to SYMMETRIC; pitches up to LARGEST_PITCH units of length, and
// units up to LARGEST_UNIT.
constexpr double LEAST_RATIO = 1e-5, LEAST_PIVOT = 1e-4, LEAST_SINE = 1e-3, SYMMETRIC = 1e-13;
constexpr double LARGEST_PITCH = 1e2, LARGEST_UNIT = 1e6;

// The power of two nearest |J_v| / |J_omega|, 1 if either vanishes, 0 if it nearly does.
double own_unit(Mat J)
{
    const double w = J.rows_from(0, 3).all().norm(), v = J.rows_from(3, 6).all().norm();
    if (w == 0 || v == 0)
        return 1;
    return w * LARGEST_UNIT >= v && v * LARGEST_UNIT >= w ? std::exp2(std::nearbyint(std::log2(v) - std::log2(w))) : 0;
}
// J with lengths in a unit.
Mat in_unit(Mat J, double unit)
{
    Mat A = J.copy();
    A.rows_from(3, 6).all().scale(1 / unit);
    return A;
}
// Q_h u for unit u, h in the same unit.
Vec reciprocal(Vec u, double h)
{
    const Vec w = u.part(0, 3), v = u.part(3, 6);
    return joined(v - (2 * h) * w, w);
}

// Rows: an orthonormal basis of the columns (6, m), then of their orthogonal complement; the rank in `rank`, -1 if it is ill
// conditioned.
Mat basis(Mat columns, double unit, int& rank)
{
    Workspace& w = *columns.w;
    Mat U(w, 6, 6, 0);
    rank = std::min(columns.cols, 6);
    if (rank > 0) {
        const SVD svd(in_unit(columns, unit));
        if (!(svd.sigma[rank - 1] > LEAST_RATIO * svd.sigma[0]))
            rank = -1;
        else
            U.rows_from(0, rank).set(svd.U.rows_from(0, rank));
    }
    if (rank > 0)
        complete(U, rank);
    else if (rank == 0)
        U.set(Mat::identity(w, 6));
    return U;
}

bool is_definite(Mat M)
{
    bool good = true;
    for (int i = 0; i < 6; i++) {
        good = good && M(i, i) > 0;
        for (int j = 0; j < i; j++)
            good = good && std::abs(M(i, j) - M(j, i)) <= SYMMETRIC * std::sqrt(std::abs(M(i, i) * M(j, j)));
    }
    if (!good)
        return false;
    const Mat L = cholesky(M, &good);
    for (int i = 0; i < 6 && good; i++)
        good = L(i, i) > LEAST_RATIO * std::sqrt(M(i, i));
    return good;
}

// Gram-Schmidt with reorthogonalisation of the rows; false if they are nearly dependent.
bool orthonormalise(Mat Z)
{
    for (int a = 0; a < Z.rows; a++)
        for (int again = 0; again < 3; again++) {
            const double length = Z[a].norm();
            if (!(length > (again == 1 ? LEAST_RATIO : 0)))
                return false;
            Z[a].scale(1 / length);
            for (int b = 0; b < a && again < 2; b++)
                Z[a].add(-Z[a].dot(Z[b]), Z[b]);
        }
    return true;
}

}  // namespace

std::optional<Mat> pseudoinverse(Mat J, double h)
{
    Workspace& w = *J.w;
    const int m = J.cols, r = std::min(m, 6);
    const double unit = own_unit(J);
    if (unit == 0 || !(std::abs(h) <= LARGEST_PITCH * unit))
        return {};
    Mat A = in_unit(J, unit);
    Vec lengths(w, m, 1);  // independent columns are scaled to unit size
    for (int j = 0; j < m && m <= 6; j++) {
        double square = 0;
        for (int i = 0; i < 6; i++)
            square += A(i, j) * A(i, j);
        if (!((lengths[j] = std::sqrt(square)) > 0))
            return {};
        for (int i = 0; i < 6; i++)
            A(i, j) /= lengths[j];
    }
    const SVD svd(A);
    if (!(svd.sigma[r - 1] > LEAST_RATIO * svd.sigma[0]))
        return {};
    const Mat U = svd.U.rows_from(0, r);
    Mat R = U;
    if (r < 6) {
        Mat K(w, r, 6);
        for (int k = 0; k < r; k++)
            K[k].set(reciprocal(U[k], h / unit));
        const Mat M = K * t(U);
        if (!(SVD(M).sigma[r - 1] > LEAST_PIVOT))
            return {};
        R = RQ(M).inverse() * K;
    }
    Mat X(w, m, 6, 0);
    for (int j = 0; j < m; j++)
        for (int k = 0; k < r; k++)
            X[j].add(svd.V(k, j) / (svd.sigma[k] * lengths[j]), R[k]);
    for (int j = 0; j < m; j++)
        X[j].part(3, 6).scale(1 / unit);
    return X;
}

std::optional<Projectors> projectors(Mat columns, bool wrenches, const ComplementRule& rule)
{
    Workspace& w = *columns.w;
    double unit = columns.cols > 0 ? own_unit(columns) : 1;
    int k = -1;
    Mat U = unit > 0 ? basis(columns, unit, k) : Mat();
    if (k < 0)
        return {};
    if (wrenches) {  // their orthogonal complement, in the unit of the columns and then in its own
        Mat rest = transposed(U.rows_from(k, 6));
        for (int i = 3; i < 6; i++)
            rest[i].scale(1 / unit);
        k = 6 - k;
        unit = k > 0 ? own_unit(rest) : 1;
        int rank = -1;
        U = unit > 0 ? basis(rest, unit, rank) : Mat();
        if (rank != k)
            return {};
    }
    Vec scale(w, 6, 1);
    scale.part(3, 6).fill(unit);
    Mat Z(w, 6, 6, 0);  // rows: Z*, then Z
    if (rule.kind == ComplementRule::Kind::columns) {
        int n = -1;
        const Mat rest = basis(rule.matrix, unit, n);
        if (n != 6 - k || rule.matrix.cols != n)
            return {};
        Z.rows_from(0, k).set(rest.rows_from(n, 6)), Z.rows_from(k, 6).set(rest.rows_from(0, n));
    } else {
        const bool by_pitch = rule.kind == ComplementRule::Kind::pitch;
        const double h = by_pitch ? rule.pitch / unit : 0;
        if (by_pitch ? !(std::abs(h) <= LARGEST_PITCH) : !is_definite(rule.matrix))
            return {};
        for (int a = 0; a < k; a++) {  // Z* is Q_h S or M S
            if (by_pitch) {
                Z[a].set(reciprocal(U[a], h));
                continue;
            }
            for (int i = 0; i < 6; i++)
                for (int j = 0; j < 6; j++)
                    Z(a, i) += rule.matrix(i, j) * scale[i] * scale[j] * U(a, j);
        }
        if (!orthonormalise(Z.rows_from(0, k)))
            return {};
        if (k > 0)
            complete(Z, k);
        else
            Z.set(Mat::identity(w, 6));
    }
    Mat P = Mat::identity(w, 6);
    Projectors result;
    if (k > 0) {
        const Mat K = Z.rows_from(0, k), G = K * t(U.rows_from(0, k));
        const double sine = SVD(G).sigma[k - 1];
        if (!(sine > LEAST_SINE))
            return {};
        result.norm = 1 / sine;
        if (k < 6)
            P = transposed(U.rows_from(0, k)) * (RQ(G).inverse() * K);
    } else
        P.all().fill(0);
    result.unit = unit;
    result.motion = Mat(w, 6, 6), result.force = Mat(w, 6, 6);
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            result.motion(i, j) = P(i, j) * scale[i] / scale[j];
            result.force(j, i) = ((i == j) - P(i, j)) / scale[j] * scale[i];
        }
    result.freedoms = transposed(U.rows_from(0, k)), result.constraints = transposed(U.rows_from(k, 6));
    result.complement = transposed(Z.rows_from(k, 6));
    for (int i = 0; i < 6; i++)
        result.freedoms[i].scale(scale[i]), result.complement[i].scale(scale[i]), result.constraints[i].scale(1 / scale[i]);
    return result;
}

}  // namespace iq
