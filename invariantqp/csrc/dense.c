/* Sums over short vectors, products and factors of small matrices. */

#include "core.h"

/* |A|, the root of the sum of squares. */
double norm_of_rows(int rows, int n, const Row *A)
{
    double sum = 0.0;
    for (int i = 0; i < rows; i++)
        sum += dot(n, A[i], A[i]);
    return sqrt(sum);
}

bool all_finite(int n, const double *a)
{
    for (int i = 0; i < n; i++)
        if (!isfinite(a[i]))
            return false;
    return true;
}

/* Sizes whose squares neither overflow nor vanish. */
static const double SMALLEST = 1e-70, LARGEST = 1e70;

/* Whether a vector is zero or of such a size; NaN is not. */
bool usual(int n, const double *a)
{
    double most = 0.0, square = dot(n, a, a);
    if (square >= MOST * SMALLEST * SMALLEST && square <= LARGEST * LARGEST)
        return true;
    for (int i = 0; i < n; i++) {
        double size = fabs(a[i]);
        if (!(size <= LARGEST))
            return false;
        most = size > most ? size : most;
    }
    return most == 0.0 || most >= SMALLEST;
}

bool usual_rows(int rows, int n, const Row *A)
{
    bool good = true;
    for (int i = 0; i < rows; i++)
        good = good && usual(n, A[i]);
    return good;
}

/* a[0] A[0] + a[step] A[1] + ..., of so many rows; they and the sum have zeros after their n numbers. */
void combined(int n, int rows, const double *a, int step, const Row *A, Row sum)
{
    double few[2 * STEP] = {0.0};
    if (n > 2 * STEP) {
        zeroed(sum);
        for (int k = 0; k < rows; k++)
            add_in_steps(n, a[k * step], A[k], sum);
        return;
    }
    for (int k = 0; k < rows; k++)
        add_in_steps(2 * STEP, a[k * step], A[k], few);
    memcpy(sum, few, sizeof few);
}

/* What k orthonormal rows Q leave of a row, and its parts along them; its length. All have zeros after their n numbers. */
double left_of(int n, int k, const Row *Q, Row row, Row parts)
{
    double few[2 * STEP];
    memcpy(few, row, sizeof few);
    for (int l = 0; l < k; l++)
        parts[l] = dot_in_steps(n, Q[l], row);
    for (int l = 0; l < k && n <= 2 * STEP; l++)
        add_in_steps(2 * STEP, -parts[l], Q[l], few);
    memcpy(row, few, sizeof few);
    for (int l = 0; l < k && n > 2 * STEP; l++)
        add_in_steps(n, -parts[l], Q[l], row);
    return sqrt(dot_in_steps(n, row, row));
}

/* D J, with zeros after its m numbers */
void product_of_rows(int rows, const double (*D)[6], int m, const Row J[6], Row *C)
{
    for (int i = 0; i < rows; i++) {
        Row sum;
        zeroed(sum);
        for (int k = 0; k < 6; k++) {
            double d = D[i][k];
            if (d == 0.0) /* as half of a measure's root is */
                continue;
            for (int j = 0; j < m; j++)
                sum[j] += d * J[k][j];
        }
        memcpy(C[i], sum, sizeof sum);
    }
}

/* A becomes A T, T (m, m). */
void product_with(int rows, int m, Row *A, const Row *T)
{
    for (int i = 0; i < rows; i++) {
        Row sum;
        zeroed(sum);
        for (int k = 0; k < m; k++)
            for (int j = 0; j < m; j++)
                sum[j] += A[i][k] * T[k][j];
        for (int j = 0; j < m; j++)
            A[i][j] = sum[j];
    }
}

/* y = M x, (m, m); both may be the same row. */
void transformed(int m, const Row *M, const Row x, Row y)
{
    Row from;
    memcpy(from, x, (size_t)m * sizeof(double));
    for (int i = 0; i < m; i++)
        y[i] = dot(m, M[i], from);
}

/* H = L L', in its lower half; false where H is not positive definite. */
bool factored(int n, Row *H)
{
    for (int j = 0; j < n; j++) {
        double pivot = H[j][j] - dot(j, H[j], H[j]);
        if (!(pivot > 0.0))
            return false;
        H[j][j] = sqrt(pivot);
        double over = 1.0 / H[j][j];
        for (int i = j + 1; i < n; i++)
            H[i][j] = (H[i][j] - dot(j, H[i], H[j])) * over;
    }
    return true;
}

/* x becomes L^-1 x. */
void forward(int n, const Row *L, double *x)
{
    for (int i = 0; i < n; i++)
        x[i] = (x[i] - dot(i, L[i], x)) / L[i][i];
}

/* x becomes L'^-1 x. */
void backward(int n, const Row *L, double *x)
{
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            x[i] -= L[k][i] * x[k];
        x[i] /= L[i][i];
    }
}

/* H^-1 g by the factor of H. */
void solved(int n, const Row *L, const double *g, double *x)
{
    memmove(x, g, (size_t)n * sizeof(double));
    forward(n, L, x);
    backward(n, L, x);
}

/* X = L^-1, in its lower half; zero above. */
void inverse_triangle(int n, const Row *L, Row *X)
{
    for (int i = 0; i < n; i++) {
        double over = 1.0 / L[i][i];
        zeroed(X[i]);
        X[i][i] = over;
        for (int k = 0; k < i; k++)
            add_in_steps(n, -over * L[i][k], X[k], X[i]);
    }
}

/* A X = B, A (n, n) and B (n, k) side by side, by Gauss and Jordan with pivots in each column: B becomes X. The least pivot;
   where it is zero there is no X. */
double eliminated(int n, int k, double (*AB)[WIDE])
{
    double least = INFINITY;
    for (int c = 0; c < n && least > 0.0; c++) {
        int pivot = c;
        for (int i = c + 1; i < n; i++)
            pivot = fabs(AB[i][c]) > fabs(AB[pivot][c]) ? i : pivot;
        least = fmin(least, fabs(AB[pivot][c]));
        for (int j = c; j < n + k; j++) {
            double swap = AB[c][j];
            AB[c][j] = AB[pivot][j];
            AB[pivot][j] = swap;
        }
        for (int i = 0; i < n; i++) {
            double factor = i == c ? 0.0 : AB[i][c] / AB[c][c];
            for (int j = c; j < n + k && factor != 0.0; j++)
                AB[i][j] -= factor * AB[c][j];
        }
    }
    for (int i = 0; i < n; i++)
        for (int j = n; j < n + k; j++)
            AB[i][j] /= AB[i][i];
    return least;
}
