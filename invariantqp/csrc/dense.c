/* Sums over short vectors. */

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
