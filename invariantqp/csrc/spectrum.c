/* Singular values and directions of the measured joint twists, by one-sided Jacobi rotations.

       A = U diag(sigma) V',   wanted = U'b

   The k rows of A (or its n columns, if there are fewer) are rotated in pairs until all are orthogonal; their lengths
   are then the singular values. Rows of A become sigma_i v_i, and b, rotated with them, becomes U'b; without a b, the
   identity is, and becomes U'. */

#include "core.h"

/* Two rows with a cosine below this are orthogonal. */
static const double ORTHOGONAL = 4e-16;
/* A row shorter than this share of |A| moves nothing, and its direction is rounding; longer ones have to be told from it
   (NULL_RATIO is above it). */
static const double NOTHING = 1e-16;
/* Sweeps over all pairs, at most; fewer than ten are usual. */
#define SWEEPS 40

static inline void rotate(int n, double *restrict p, double *restrict q, double c, double s)
{
    for (; n > 0; n -= STEP, p += STEP, q += STEP)
        for (int j = 0; j < STEP; j++) {
            double a = p[j], b = q[j];
            p[j] = c * a - s * b;
            q[j] = s * a + c * b;
        }
}

/* Rotate all pairs until the rows are orthogonal; squares of lengths are carried along in a sweep. Pairs come as in a
   tournament: each row is in one of a turn, so that their rotations do not wait for each other. */
static Outcome orthogonalised(int rows, int n, int with, Rotated *R, double least)
{
    int last = rows - 1 + rows % 2;
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        bool rotated = false;
        double square[MOST];
        for (int i = 0; i < rows; i++)
            square[i] = dot_in_steps(n, R[i].row, R[i].row);
        for (int turn = 0; turn < last; turn++)
            for (int k = 0; 2 * k < last; k++) {
                int i = k == 0 ? last : turn + k - (turn + k < last ? 0 : last), j = turn - k + (turn < k ? last : 0);
                if (i >= rows)
                    continue;
                double *p = R[i].row, *q = R[j].row;
                double pp = square[i], qq = square[j], pq = dot_in_steps(n, p, q);
                if (pq * pq <= ORTHOGONAL * ORTHOGONAL * pp * qq || pp <= least || qq <= least)
                    continue;
                double zeta = 0.5 * (qq - pp) / pq, cotangent = fabs(zeta) + sqrt(1.0 + zeta * zeta);
                double s = (zeta < 0.0 ? -1.0 : 1.0) / sqrt(1.0 + cotangent * cotangent), c = fabs(s) * cotangent;
                double t = (zeta < 0.0 ? -1.0 : 1.0) / cotangent, left = pp - t * pq;
                square[i] = left > 0.0 ? left : 0.0;
                square[j] = qq + t * pq;
                rotate(n, p, q, c, s);
                rotate(with, R[i].with, R[j].with, c, s);
                rotated = true;
            }
        if (!rotated)
            return DONE;
    }
    return HAND_BACK;
}

/* Rows made orthogonal, the longest first: what was rotated with them is U' of it. */
Outcome sorted_rows(int rows, int n, int with, Rotated *R, double *sigma)
{
    double size = 0.0;
    for (int i = 0; i < rows; i++)
        size += dot(n, R[i].row, R[i].row);
    if (orthogonalised(rows, n, with, R, NOTHING * NOTHING * size) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < rows; i++) {
        Rotated moved = R[i];
        double length = norm(n, moved.row);
        int at = i;
        for (; at > 0 && sigma[at - 1] < length; at--) {
            sigma[at] = sigma[at - 1];
            R[at] = R[at - 1];
        }
        sigma[at] = length;
        R[at] = moved;
    }
    return DONE;
}

/* Complete V[0..rank), zero after their n numbers, to an orthonormal basis of n dimensions. Each new direction is what is
   left of the axis that is farthest from those before: of its square 1/n at least is left. A second time takes what is left
   because those given are not quite orthonormal. */
void completed(int n, int rank, Row *V)
{
    Row left;
    if (rank == n)
        return;
    for (int axis = 0; axis < n; axis++)
        left[axis] = 1.0;
    for (int i = 0; i < rank; i++)
        for (int axis = 0; axis < n; axis++)
            left[axis] -= V[i][axis] * V[i][axis];
    for (int k = rank; k < n; k++) {
        int best = 0;
        for (int axis = 1; axis < n; axis++)
            best = left[axis] > left[best] ? axis : best;
        Row parts;
        for (int i = 0; i < k; i++)
            parts[i] = -V[i][best];
        combined(n, k, parts, 1, (const Row *)V, V[k]);
        V[k][best] += 1.0;
        double over = 1.0 / left_of(n, k, (const Row *)V, V[k], parts);
        for (int j = 0; j < n; j++) {
            V[k][j] *= over;
            left[j] -= V[k][j] * V[k][j];
        }
    }
}

/* wanted = U'b or L^-1 b, and the same of what is not chased */
void want(Spectrum *found, const double b[6], const double *ahead)
{
    static const double NONE[6] = {0.0};
    const double *from[] = {b, ahead == NULL ? NONE : ahead};
    double *into[] = {found->wanted, found->ahead};
    for (int k = 0; k < 2; k++) {
        for (int i = 0; i < 6; i++)
            into[k][i] = dot(6, found->regular ? found->regular->X[i] : found->U[i], from[k]);
    }
}

/* Without a b (NULL) it finds U instead; `ahead` is another b, or NULL. */
Outcome spectrum(int k, int n, const Row *A, const double *b, const double *ahead, Spectrum *found)
{
    bool wide = n >= k;
    int rows = wide ? k : n, length = wide ? n : k, with = !wide ? n : b == NULL ? k : 2;
    Rotated R[MOST];
    memset(R, 0, (size_t)rows * sizeof *R);
    for (int i = 0; i < rows; i++) {
        for (int j = 0; j < length; j++)
            R[i].row[j] = wide ? A[i][j] : A[j][i];
        for (int j = 0; j < with; j++)
            R[i].with[j] = !wide || b == NULL ? i == j : j == 0 ? b[i] : ahead != NULL ? ahead[i] : 0.0;
    }
    double size = norm_of_rows(k, n, A);
    zeroed(found->sigma);
    if (sorted_rows(rows, length, with, R, found->sigma) == HAND_BACK)
        return HAND_BACK;
    found->regular = NULL;
    zeroed(found->wanted);
    zeroed(found->ahead);
    memset(found->V, 0, (size_t)n * sizeof(Row));
    if (b == NULL)
        memset(found->U, 0, sizeof found->U);
    int rank = 0;
    found->largest = found->sigma[0];
    for (int i = 0; i < rows; i++) {
        const Rotated *r = &R[i];
        double value = found->sigma[i];
        bool moving = value > NULL_RATIO * found->sigma[0];
        for (int j = 0; j < k && b == NULL; j++)
            found->U[i][j] = wide ? r->with[j] : value > NOTHING * size ? r->row[j] / value : 0.0;
        if (wide) {
            found->wanted[i] = r->with[0];
            found->ahead[i] = r->with[1];
            for (int j = 0; j < n && moving; j++)
                found->V[i][j] = r->row[j] / value;
        } else {
            found->wanted[i] = value > 0.0 && b != NULL ? dot(k, r->row, b) / value : 0.0;
            found->ahead[i] = value > 0.0 && ahead != NULL ? dot(k, r->row, ahead) / value : 0.0;
            for (int j = 0; j < n; j++)
                found->V[i][j] = r->with[j];
        }
        rank += moving;
    }
    if (wide)
        completed(n, rank, found->V);
    return DONE;
}
