// Vectors and matrices whose sizes are known at run time, in memory of a workspace.
//
// Vec and Mat are views, as NumPy arrays are: a copy of one is the same numbers. Operators return new numbers, which
// live until the frame of the workspace ends in which they were made. Matrices are stored row by row.
//
//     A * x,  A * B,  A * t(B),  t(A) * x,  t(A) * B        products; zeros of the left factor of A * B cost nothing
//     A[i]  row i        A.rows_from(i, j)  rows i to j-1        x.part(i, j)  elements i to j-1
#pragma once
#include "tolerances.hpp"
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#ifdef IQ_CHECKED  // with the sanitizers
#include <cstdlib>
#define IQ_ASSERT(claim) ((claim) ? void() : std::abort())
#else
#define IQ_ASSERT(claim) void()
#endif

namespace iq {

// Memory that is taken piece by piece and given back at once.
class Workspace {
  public:
    double* take(std::size_t count)
    {
        count += count & 1;  // 16 bytes apart
        while (block == blocks.size() || used + count > blocks[block].size) {
            if (block < blocks.size())
                block++;
            if (block == blocks.size()) {
                const std::size_t size = std::max<std::size_t>(count, 8192);
                blocks.push_back({std::unique_ptr<double[]>(new double[size]), size});
            }
            used = 0;
        }
        double* found = blocks[block].memory.get() + used;
        used += count;
        return found;
    }

    // Returns memory taken in its lifetime.
    class Frame {
      public:
        explicit Frame(Workspace& w) : w(w), block(w.block), used(w.used) {}
        ~Frame() { w.block = block, w.used = used; }
        Frame(const Frame&) = delete;
        Frame& operator=(const Frame&) = delete;

      private:
        Workspace& w;
        std::size_t block, used;
    };

  private:
    struct Block {
        std::unique_ptr<double[]> memory;
        std::size_t size;
    };
    std::vector<Block> blocks;
    std::size_t block = 0, used = 0;
};

struct Vec {
    double* p = nullptr;
    int n = 0;
    Workspace* w = nullptr;

    Vec() = default;
    Vec(double* p, int n, Workspace* w) : p(p), n(n), w(w) {}
    Vec(Workspace& w, int n) : p(w.take(n)), n(n), w(&w) {}
    Vec(Workspace& w, int n, double value) : Vec(w, n) { fill(value); }
    double& operator[](int i) const
    {
        IQ_ASSERT(0 <= i && i < n);
        return p[i];
    }
    double* begin() const { return p; }
    double* end() const { return p + n; }
    Vec part(int from, int to) const
    {
        IQ_ASSERT(0 <= from && from <= to && to <= n);
        return {p + from, to - from, w};
    }
    Vec copy() const
    {
        Vec c(*w, n);
        c.set(*this);
        return c;
    }
    void fill(double value) const { std::fill(begin(), end(), value); }
    void set(Vec b) const
    {
        IQ_ASSERT(b.n == n);
        std::copy(b.begin(), b.end(), p);
    }
    // this += a b
    void add(double a, Vec b) const
    {
        IQ_ASSERT(b.n == n);
        double* __restrict y = p;
        const double* __restrict x = b.p;
        for (int i = 0; i < n; i++)
            y[i] += a * x[i];
    }
    void scale(double a) const
    {
        for (double& x : *this)
            x *= a;
    }
    double dot(Vec b) const
    {
        IQ_ASSERT(b.n == n);
        double even = 0, odd = 0;
        int i = 0;
        for (; i + 1 < n; i += 2) {
            even += p[i] * b.p[i];
            odd += p[i + 1] * b.p[i + 1];
        }
        return i < n ? even + odd + p[i] * b.p[i] : even + odd;
    }
    double square() const { return dot(*this); }
    double norm() const { return std::sqrt(square()); }
};

inline Vec unit(Workspace& w, int n, int i)
{
    Vec e(w, n, 0);
    e[i] = 1;
    return e;
}
template <class F> Vec each(Vec a, F f)
{
    Vec c(*a.w, a.n);
    for (int i = 0; i < a.n; i++)
        c.p[i] = f(a.p[i]);
    return c;
}
inline Vec operator+(Vec a, Vec b)
{
    Vec c = a.copy();
    c.add(1, b);
    return c;
}
inline Vec operator-(Vec a, Vec b)
{
    Vec c = a.copy();
    c.add(-1, b);
    return c;
}
inline Vec operator*(double s, Vec a)
{
    return each(a, [s](double x) { return s * x; });
}
inline Vec operator/(Vec a, double s)
{
    return each(a, [s](double x) { return x / s; });
}
inline Vec joined(Vec a, Vec b)
{
    Vec c(*(a.w ? a.w : b.w), a.n + b.n);
    c.part(0, a.n).set(a);
    c.part(a.n, c.n).set(b);
    return c;
}
inline bool within(Vec lower, Vec x, Vec upper)
{
    for (int i = 0; i < x.n; i++)
        if (!(lower[i] <= x[i] && x[i] <= upper[i]))
            return false;
    return true;
}

struct Mat {
    double* p = nullptr;
    int rows = 0, cols = 0;
    Workspace* w = nullptr;

    Mat() = default;
    Mat(double* p, int rows, int cols, Workspace* w) : p(p), rows(rows), cols(cols), w(w) {}
    Mat(Workspace& w, int rows, int cols)
        : p(w.take(static_cast<std::size_t>(rows) * cols)), rows(rows), cols(cols), w(&w)
    {
    }
    Mat(Workspace& w, int rows, int cols, double value) : Mat(w, rows, cols) { all().fill(value); }
    static Mat identity(Workspace& w, int n, double size = 1)
    {
        Mat I(w, n, n, 0);
        for (int i = 0; i < n; i++)
            I(i, i) = size;
        return I;
    }
    double& operator()(int i, int j) const
    {
        IQ_ASSERT(0 <= i && i < rows && 0 <= j && j < cols);
        return p[static_cast<std::size_t>(i) * cols + j];
    }
    Vec operator[](int i) const
    {
        IQ_ASSERT(0 <= i && i < rows);
        return {p + static_cast<std::size_t>(i) * cols, cols, w};
    }
    Vec all() const { return {p, rows * cols, w}; }
    Mat rows_from(int from, int to) const
    {
        IQ_ASSERT(0 <= from && from <= to && to <= rows);
        return {p + static_cast<std::size_t>(from) * cols, to - from, cols, w};
    }
    Mat copy() const { return {all().copy().p, rows, cols, w}; }
    void set(Mat b) const
    {
        IQ_ASSERT(b.rows == rows && b.cols == cols);
        all().set(b.all());
    }
};

// The numbers of a vector, which are not copied.
inline Vec view(const std::vector<double>& v, Workspace& w) { return {const_cast<double*>(v.data()), static_cast<int>(v.size()), &w}; }
inline Mat view(const std::vector<double>& v, int rows, int cols, Workspace& w)
{
    return {const_cast<double*>(v.data()), rows, cols, &w};
}

constexpr int MANY = 16;  // columns from which products take four rows at a time

struct Transposed {
    Mat of;
};
inline Transposed t(Mat A) { return {A}; }

inline Mat transposed(Mat A)
{
    Mat B(*A.w, A.cols, A.rows);
    for (int i = 0; i < A.rows; i++)
        for (int j = 0; j < A.cols; j++)
            B(j, i) = A(i, j);
    return B;
}
inline Vec operator*(Mat A, Vec x)
{
    Vec y(*A.w, A.rows);
    for (int i = 0; i < A.rows; i++)
        y[i] = A[i].dot(x);
    return y;
}
inline Vec operator*(Transposed A, Vec x)
{
    Vec y(*A.of.w, A.of.cols, 0);
    for (int i = 0; i < A.of.rows; i++)
        y.add(x[i], A.of[i]);
    return y;
}
// y += A'a, four rows of A at a time where none of their factors is zero.
inline void add_rows(Vec y, Vec a, Mat A)
{
    IQ_ASSERT(y.n == A.cols && a.n == A.rows);
    double* __restrict to = y.p;
    int k = 0;
    for (; k + 3 < a.n; k += 4) {
        const double f = a[k], g = a[k + 1], h = a[k + 2], i = a[k + 3];
        const double *p = A[k].p, *q = A[k + 1].p, *r = A[k + 2].p, *s = A[k + 3].p;
        if (f != 0 && g != 0 && h != 0 && i != 0)
            for (int j = 0; j < y.n; j++)
                to[j] = (((to[j] + f * p[j]) + g * q[j]) + h * r[j]) + i * s[j];
        else
            for (int l = k; l < k + 4; l++)
                if (a[l] != 0)
                    y.add(a[l], A[l]);
    }
    for (; k < a.n; k++)
        y.add(a[k], A[k]);
}
inline Mat operator*(Mat A, Mat B)
{
    IQ_ASSERT(A.cols == B.rows);
    Mat P(*A.w, A.rows, B.cols, 0);
    for (int i = 0; i < A.rows; i++)
        if (A.cols >= MANY)
            add_rows(P[i], A[i], B);
        else
            for (int k = 0; k < A.cols; k++)
                if (const double a = A(i, k); a != 0)
                    P[i].add(a, B[k]);
    return P;
}
inline Mat operator*(Mat A, Transposed B)
{
    Mat P(*A.w, A.rows, B.of.rows);
    for (int i = 0; i < A.rows; i++)
        for (int j = 0; j < P.cols; j++)
            P(i, j) = A[i].dot(B.of[j]);
    return P;
}
inline Mat operator*(Transposed A, Mat B)
{
    Mat P(*B.w, A.of.cols, B.cols, 0);
    for (int k = 0; k < B.rows; k++)
        for (int i = 0; i < P.rows; i++)
            if (const double a = A.of(k, i); a != 0)
                P[i].add(a, B[k]);
    return P;
}
// Rows of A, then those of B.
inline Mat stacked(Mat A, Mat B)
{
    Mat C(*(A.w ? A.w : B.w), A.rows + B.rows, A.w ? A.cols : B.cols);
    C.all().part(0, A.rows * C.cols).set(A.all());
    C.all().part(A.rows * C.cols, C.rows * C.cols).set(B.all());
    return C;
}

// U, upper triangular, with U'U = H. False in `positive` where H is not positive definite.
inline Mat cholesky(Mat H, bool* positive = nullptr)
{
    Mat U = H.copy();
    for (int i = 0; i < U.rows; i++) {
        if (!(U(i, i) > 0) && positive)
            *positive = false;
        const Vec row = U[i].part(i, U.cols);
        row.scale(1 / std::sqrt(row[0]));
        for (int k = i + 1; k < U.rows; k++)
            U[k].part(k, U.cols).add(-U(i, k), U[i].part(k, U.cols));
        U[i].part(0, i).fill(0);
    }
    return U;
}
// U^-1 x and U'^-1 x of an upper triangular U.
inline Vec solved(Mat U, Vec x)
{
    Vec y = x.copy();
    for (int i = y.n - 1; i >= 0; i--)
        y[i] = (y[i] - U[i].part(i + 1, y.n).dot(y.part(i + 1, y.n))) / U(i, i);
    return y;
}
inline Vec solved(Transposed U, Vec x)
{
    Vec y = x.copy();
    for (int i = 0; i < y.n; i++) {
        y[i] /= U.of(i, i);
        y.part(i + 1, y.n).add(-y[i], U.of[i].part(i + 1, y.n));
    }
    return y;
}
// U^-1 of an upper triangular U.
inline Mat inverse(Mat U)
{
    Mat X = Mat::identity(*U.w, U.rows);
    for (int i = U.rows - 1; i >= 0; i--) {
        for (int k = i + 1; k < U.rows; k++)
            X[i].part(k, U.cols).add(-U(i, k), X[k].part(k, U.cols));
        X[i].part(i, U.cols).scale(1 / U(i, i));
    }
    return X;
}

// A = [0 R] Q' of an A with no more rows than columns, by Householder's reflections; R is upper triangular.
struct RQ {
    Mat R;  // (r, r)
    int free;  // columns of A beyond its rows

    explicit RQ(Mat A)
        : R(*A.w, A.rows, A.rows, 0), free(A.cols - A.rows), V(A.copy()), beta(*A.w, A.rows)
    {
        for (int i = V.rows - 1; i >= 0; i--) {
            const int last = free + i;
            const Vec v = V[i].part(0, last + 1);
            const double size = v.norm(), pivot = v[last] < 0 ? size : -size;
            R[i].part(i + 1, R.cols).set(V[i].part(last + 1, V.cols));
            R(i, i) = pivot;
            v[last] -= pivot;
            beta[i] = size > 0 ? 1 / (pivot * v[last]) : 0;
            for (int k = 0; k < i; k++)
                reflect(i, V[k]);
        }
    }
    // Q'x and Q x, in place.
    void turn(Vec x) const
    {
        for (int i = V.rows - 1; i >= 0; i--)
            reflect(i, x);
    }
    void turn_back(Vec x) const
    {
        for (int i = 0; i < V.rows; i++)
            reflect(i, x);
    }
    // The least x with A x = b.
    Vec least(Vec b) const
    {
        Vec x(*V.w, V.cols, 0);
        x.part(free, x.n).set(solved(R, b));
        turn_back(x);
        return x;
    }
    // The x with least |A'x - b|.
    Vec least_squares(Vec b) const
    {
        Vec turned = b.copy();
        turn(turned);
        return solved(t(R), turned.part(free, turned.n));
    }
    // A^-1 of a square A.
    Mat inverse() const
    {
        Mat rows(*V.w, V.cols, V.cols);
        for (int j = 0; j < V.cols; j++)
            rows[j].set(least(unit(*V.w, V.cols, j)));
        return transposed(rows);
    }
    // Q', (n, n).
    Mat basis() const
    {
        Mat Q = Mat::identity(*V.w, V.cols);
        for (int i = 0; i < Q.rows; i++)
            turn_back(Q[i]);
        return Q;
    }
    // Whether no singular value can be below a share of the largest. The product of all of them is that of the diagonal.
    bool regular(double share) const
    {
        const double most = R.all().norm();
        double least = most;
        for (int i = 0; i < R.rows; i++)
            least *= std::abs(R(i, i)) / most;
        return least > share * most || (least > 0 && 1 > share * most * iq::inverse(R).all().norm());
    }

  private:
    Mat V;  // row i is reflection i, up to element free + i
    Vec beta;

    void reflect(int i, Vec x) const
    {
        const Vec v = V[i].part(0, free + i + 1), y = x.part(0, v.n);
        y.add(beta[i] * v.dot(y), v);
    }
};

// U, upper triangular, with U'U = A'A for an A with no fewer rows than columns; no digits are lost by squaring.
inline Mat upper_root(Mat A)
{
    const int n = A.cols;
    Mat reversed(*A.w, n, A.rows), U(*A.w, n, n);
    for (int i = 0; i < n; i++)
        for (int k = 0; k < A.rows; k++)
            reversed(i, k) = A(k, n - 1 - i);
    const RQ rq(reversed);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            U(i, j) = rq.R(n - 1 - j, n - 1 - i);
    return U;
}

constexpr int MOST_SWEEPS = 60;  // of Jacobi's rotations; ten are usual

// The rotation that makes [[a, b], [b, c]] diagonal.
struct Rotation {
    double c, s;

    Rotation(double a, double b, double d)
    {
        const double zeta = 0.5 * (d - a) / b;
        const double tangent = (zeta < 0 ? -1 : 1) / (std::abs(zeta) + std::sqrt(1 + zeta * zeta));
        c = 1 / std::sqrt(1 + tangent * tangent), s = tangent * c;
    }
    void pair(double& x, double& y) const
    {
        const double first = c * x - s * y;
        y = s * x + c * y, x = first;
    }
    void rows(Mat A, int i, int j) const
    {
        for (int k = 0; k < A.cols; k++)
            pair(A(i, k), A(j, k));
    }
};

// Turns the rows of W until they are orthogonal, and the rows of B with them (Jacobi's rotations from one side).
inline void orthogonalise(Mat W, Mat B)
{
    const double least = 1e-32 * W.all().square();
    bool rotated = true;
    for (int sweep = 0; rotated && sweep < MOST_SWEEPS; sweep++) {
        rotated = false;
        for (int i = 0; i < W.rows; i++)
            for (int j = i + 1; j < W.rows; j++) {
                const double aa = W[i].square(), bb = W[j].square(), ab = W[i].dot(W[j]);
                if (ab * ab <= 1.6e-31 * aa * bb || aa <= least || bb <= least)
                    continue;
                const Rotation turn(aa, ab, bb);
                turn.rows(W, i, j), turn.rows(B, i, j);
                rotated = true;
            }
    }
}

// Fills the rows of V from `rank` on, so that all of them are orthonormal.
inline void complete(Mat V, int rank)
{
    if (rank < V.rows)
        V.rows_from(rank, V.rows).set(RQ(V.rows_from(0, rank)).basis().rows_from(0, V.rows - rank));
}

// A = U' diag(sigma) V, sigma in falling order; U has min(r, m) rows of length r, V is (m, m) orthonormal.
struct SVD {
    Mat U, V;
    Vec sigma;  // (min(r, m),)

    int rank(double share) const
    {
        int r = 0;
        while (r < sigma.n && sigma[r] > share * sigma[0])
            r++;
        return r;
    }
    // The x of the first r singular values with A x nearest to b.
    Vec least(Vec b, int r, double least = 0) const
    {
        Vec u = U.rows_from(0, r) * b;
        for (int i = 0; i < r; i++)
            u[i] /= std::max(sigma[i], least * sigma[0]);
        return t(V.rows_from(0, r)) * u;
    }

    explicit SVD(Mat A)
    {
        const int k = std::min(A.rows, A.cols);
        const bool wide = A.rows <= A.cols;
        Mat W = wide ? A.copy() : transposed(A), B = Mat::identity(*A.w, k);
        orthogonalise(W, B);
        std::vector<int> order(k);
        Vec size(*A.w, k);
        for (int i = 0; i < k; i++)
            order[i] = i, size[i] = W[i].norm();
        std::stable_sort(order.begin(), order.end(), [&](int i, int j) { return size[i] > size[j]; });
        Mat sorted(*A.w, std::max(k, wide ? A.cols : k), W.cols, 0), turned(*A.w, k, k);
        sigma = Vec(*A.w, k);
        int rank = 0;
        for (int i = 0; i < k; i++) {
            sigma[i] = size[order[i]];
            turned[i].set(B[order[i]]);
            if (sigma[i] > UNIT_ROUNDING * sigma[0])
                sorted[rank++].set(W[order[i]] / sigma[i]);
        }
        complete(sorted, rank);
        U = wide ? turned : sorted;
        V = wide ? sorted : turned;
    }
};

// S = V' diag(values) V of a symmetric S, by Jacobi's rotations; rows of V are the eigenvectors.
struct SymmetricEigen {
    Mat V;
    Vec values;

    SymmetricEigen(Mat V, Vec values) : V(V), values(values) {}
    explicit SymmetricEigen(Mat S) : V(Mat::identity(*S.w, S.rows)), values(*S.w, S.rows)
    {
        const int n = S.rows;
        Mat M = S.copy();
        const double least = 1e-36 * M.all().square();
        bool rotated = true;
        for (int sweep = 0; rotated && sweep < MOST_SWEEPS; sweep++) {
            rotated = false;
            for (int i = 0; i < n; i++)
                for (int j = i + 1; j < n; j++) {
                    if (M(i, j) * M(i, j) <= least)
                        continue;
                    const Rotation turn(M(i, i), M(i, j), M(j, j));
                    for (int k = 0; k < n; k++)
                        turn.pair(M(k, i), M(k, j));
                    turn.rows(M, i, j), turn.rows(V, i, j);
                    rotated = true;
                }
        }
        for (int i = 0; i < n; i++)
            values[i] = M(i, i);
    }
};

}  // namespace iq
