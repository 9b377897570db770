/* Twin of legacy/exact.py: the velocities that meet exact rows C x = e.

       y = a full + start + B z,   full = C'(CC')^-1 e,   CB = 0,   B'B = I,
       0 <= a <= 1 the share of the demanded speed, start zero where the rows can keep their direction

   Rows that are parts of the twist, C = D J, are first made orthonormal in the measure. */

#include "core.h"

/* ROW_TOLERANCE, but for what rounding makes of it: a singular value above the first share of the largest counts, below the
   second it is zero; between them, Python decides. */
static const double INDEPENDENT = 1.01e-10, DEPENDENT_ROW = 9.9e-11;
/* A decision that rounding may make: within this factor of a tolerance. */
static const double CLOSE = 10.0;

/* D root^-1, for root = [[R, 0], [P, S]] or any other that is invertible. */
Outcome over_root(int k, const double (*D)[6], const double root[6][6], double (*M)[6])
{
    double L[6][WIDE]; /* root' X = D' */
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < 6; j++)
            L[i][j] = root[j][i];
        for (int j = 0; j < k; j++)
            L[i][6 + j] = D[j][i];
    }
    if (eliminated(6, k, L) == 0.0)
        return HAND_BACK;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < k; j++)
            M[j][i] = L[i][6 + j];
    return DONE;
}

/* How many of `rows` singular values, the largest first, count; -1 where that is too close to tell. */
static int counted_values(int rows, const double *sigma)
{
    int rank = 0;
    for (int i = 0; i < rows; i++) {
        if (sigma[i] > INDEPENDENT * sigma[0])
            rank++;
        else if (sigma[i] > DEPENDENT_ROW * sigma[0])
            return -1;
    }
    return rank;
}

/* The rows C on y and their demands; parts of the twist are replaced by orthonormal ones in the measure, and rows beside
   them become as long as all of those. How many rows there are then, and the share of the demands in which parts of one
   twist contradict each other. */
static Outcome whitened(const Demand *demand, const Row *given, Row *C, double *e, int *rows, double *contrary)
{
    int k = demand->rows, m = demand->m, parts = 0, rank;
    double M[MOST_ROWS][6], sigma[MOST_ROWS], square = 0.0, lost = 0.0, whole = 0.0, terms = 0.0;
    Rotated R[MOST_ROWS];
    *contrary = 0.0;
    *rows = 0;
    memset(R, 0, (size_t)k * sizeof *R);
    if (demand->of_twist && over_root(k, demand->D, demand->root, M) == HAND_BACK)
        return HAND_BACK;
    for (int i = 0; i < k && demand->of_twist; i++) {
        if (!(dot(6, demand->D[i], demand->D[i]) > 0.0))
            continue;
        double size = norm(6, M[i]), term = 0.0;
        if (!(size > 0.0))
            return HAND_BACK;
        for (int j = 0; j < 6; j++) {
            R[parts].row[j] = M[i][j] / size;
            term += fabs(demand->D[i][j]) * fabs(demand->s[j]);
        }
        for (int j = 0; j < m; j++)
            R[parts].with[j] = given[i][j] / size;
        R[parts].with[m] = demand->e[i] / size;
        terms += term * term / (size * size);
        parts++;
    }
    if (sorted_rows(parts, 6, m + 1, R, sigma) == HAND_BACK || (rank = counted_values(parts, sigma)) < 0)
        return HAND_BACK;
    for (int i = 0; i < parts; i++) {
        double e_i = R[i].with[m];
        whole += e_i * e_i;
        lost += i >= rank ? e_i * e_i : 0.0;
        if (i >= rank)
            continue;
        for (int j = 0; j < m; j++)
            C[*rows][j] = R[i].with[j] / sigma[i];
        e[*rows] = e_i / sigma[i];
        square += dot(m, C[*rows], C[*rows]);
        ++*rows;
    }
    if (rank < parts)
        *contrary = sqrt(lost) / fmax(fmax(sqrt(whole), TERMS * sqrt(terms)), TINY);
    for (int i = 0; i < k; i++) {
        if (demand->of_twist && dot(6, demand->D[i], demand->D[i]) > 0.0)
            continue;
        double size = parts > 0 ? norm(m, given[i]) : 1.0, scale = parts > 0 && square > 0.0 ? sqrt(square) : 1.0;
        scale /= size > 0.0 ? size : 1.0;
        for (int j = 0; j < m; j++)
            C[*rows][j] = scale * given[i][j];
        e[*rows] = scale * demand->e[i];
        ++*rows;
    }
    return DONE;
}

static bool is_close(double unmet) { return unmet > QP_ROUNDING / CLOSE && unmet < QP_ROUNDING * CLOSE; }

/* `given` is C on y: the rows of the demand, or those rows times T. */
Outcome reduce(const Demand *demand, const Row *given, Reduction *reduction)
{
    int k, m = demand->m, rank;
    Row C[MOST_ROWS];
    double e[MOST_ROWS], sigma[MOST_ROWS], met = 0.0, square = 0.0, sizes = 0.0, here = 0.0, anywhere = 0.0, contrary;
    Rotated R[MOST_ROWS];
    if (whitened(demand, given, C, e, &k, &contrary) == HAND_BACK)
        return HAND_BACK;
    memset(R, 0, (size_t)k * sizeof *R);
    for (int i = 0; i < k; i++) {
        memcpy(R[i].row, C[i], (size_t)m * sizeof(double));
        R[i].with[0] = e[i];
    }
    if (sorted_rows(k, m, 1, R, sigma) == HAND_BACK || (rank = counted_values(k, sigma)) < 0)
        return HAND_BACK;
    int best = demand->row_rank < 0 ? k : demand->row_rank;
    rank = best < rank ? best : rank;
    for (int j = 0; j < m; j++)
        reduction->full[j] = reduction->start[j] = 0.0;
    Row V[MOST];
    memset(V, 0, (size_t)m * sizeof(Row));
    for (int i = 0; i < k; i++) {
        double wanted = R[i].with[0], y;
        sizes += sigma[i] * sigma[i];
        if (i >= rank) {
            *(i < best ? &here : &anywhere) += wanted * wanted;
            continue;
        }
        y = wanted / sigma[i];
        for (int j = 0; j < m; j++) {
            V[i][j] = R[i].row[j] / sigma[i];
            reduction->full[j] += y * V[i][j];
        }
        met += wanted * wanted;
        square += y * y;
    }
    completed(m, rank, V);
    reduction->n = m - rank;
    for (int i = rank; i < m; i++)
        memcpy(reduction->basis[i - rank], V[i], sizeof(Row));
    double all = met + here + anywhere;
    reduction->effort = met > 0.0 ? sqrt(sizes) * sqrt(square) / sqrt(met) : 1.0;
    reduction->bend = rank > 0 ? sqrt(sizes) / sigma[rank - 1] : 1.0;
    reduction->unmet = fmax(all > 0.0 ? sqrt(here / all) : 0.0, contrary);
    reduction->beyond = all > 0.0 ? sqrt(anywhere / all) : 0.0;
    return is_close(reduction->unmet) || is_close(reduction->beyond) ? HAND_BACK : DONE;
}

/* y where z = 0. */
void origin(const Reduction *reduction, int m, double share, Row y)
{
    for (int j = 0; j < m; j++)
        y[j] = share * reduction->full[j] + reduction->start[j];
}

/* y = origin + B z */
void joint(const Reduction *reduction, int m, const double *z, double share, Row y)
{
    origin(reduction, m, share, y);
    for (int i = 0; i < reduction->n; i++)
        for (int j = 0; j < m; j++)
            y[j] += z[i] * reduction->basis[i][j];
}

/* The z of a y with that share. */
void freed(const Reduction *reduction, int m, const Row y, double share, Row z)
{
    Row d;
    origin(reduction, m, share, d);
    for (int j = 0; j < m; j++)
        d[j] = y[j] - d[j];
    for (int i = 0; i < reduction->n; i++)
        z[i] = dot(m, reduction->basis[i], d);
}
