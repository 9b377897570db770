/* Beside velocity/qp.py, where a solver does it: the shortest e on a set of active limits, N_a e = b_a, and their multipliers.

       e + N_a'y = 0,   y > 0 at an upper limit, y < 0 at a lower one */

#include "qp.h"

/* A multiplier of the wrong sign by less than this share of |pull| / |N_i| is rounding. */
static const double WRONG_SIGN = 1e-13;

/* The shortest e with N_a e = b. */
void shortest(const Face *face, int n, const double *b, Row e)
{
    Row w;
    for (int j = 0; j < n; j++)
        e[j] = 0.0;
    for (int i = 0; i < face->k; i++) {
        w[i] = b[i];
        for (int l = 0; l < i; l++)
            w[i] -= face->R[l][i] * w[l];
        w[i] /= face->R[i][i];
        for (int j = 0; j < n; j++)
            e[j] += w[i] * face->Q[i][j];
    }
}

/* A row without its parts along k orthonormal ones, which would move an active limit. */
void along(int n, int k, const Row *Q, Row row)
{
    for (int twice = 0; twice < 2; twice++) /* the first time leaves rounding of the row */
        for (int l = 0; l < k; l++) {
            double share = dot(n, Q[l], row);
            for (int j = 0; j < n; j++)
                row[j] -= share * Q[l][j];
        }
    for (int j = 0; j < n && k == n; j++)
        row[j] = 0.0;
}

/* y with pull + N_a'y = 0 on the active limits, zero for the others. */
void multipliers(const Face *face, const Room *room, const Row pull, double *y)
{
    Row w;
    for (int i = 0; i < room->count; i++)
        y[i] = 0.0;
    for (int i = face->k - 1; i >= 0; i--) {
        w[i] = -dot(room->n, face->Q[i], pull);
        for (int l = i + 1; l < face->k; l++)
            w[i] -= face->R[i][l] * w[l];
        w[i] /= face->R[i][i];
        y[face->at[i]] = w[i];
    }
}

/* Add a limit to a face, e excepted; HAND_BACK where it depends on those before it. */
static Outcome appended(const Room *room, int i, int side, Face *face)
{
    int n = room->n, k = face->k;
    if (k == n)
        return HAND_BACK;
    double *q = face->Q[k];
    for (int j = 0; j < n; j++)
        q[j] = room->N[i][j];
    for (int l = 0; l < k; l++)
        face->R[l][k] = 0.0;
    for (int twice = 0; twice < 2; twice++) /* the first time leaves rounding of N */
        for (int l = 0; l < k; l++) {
            double share = dot(n, face->Q[l], q);
            face->R[l][k] += share;
            for (int j = 0; j < n; j++)
                q[j] -= share * face->Q[l][j];
        }
    double length = face->R[k][k] = norm(n, q);
    face->least = fmin(face->least, length);
    face->most = fmax(face->most, length);
    if (!(face->least > DEPENDENT * face->most))
        return HAND_BACK;
    for (int j = 0; j < n; j++)
        q[j] /= length;
    face->bound[k] = side > 0 ? room->upper[i] : room->lower[i];
    face->at[k] = i;
    face->k++;
    return DONE;
}

/* The face of all active limits; HAND_BACK where they depend on each other. */
Outcome face_of(const Room *room, const int *side, Face *face)
{
    face->k = 0;
    face->least = INFINITY;
    face->most = 0.0;
    for (int i = 0; i < room->count; i++)
        if (side[i] != 0 && appended(room, i, side[i], face) == HAND_BACK)
            return HAND_BACK;
    shortest(face, room->n, face->bound, face->e);
    return DONE;
}

/* The face with one more limit active. */
Outcome joined(const Room *room, int i, int side, Face *face)
{
    if (appended(room, i, side, face) == HAND_BACK)
        return HAND_BACK;
    shortest(face, room->n, face->bound, face->e);
    return DONE;
}

/* The limit whose multiplier has the wrong sign by most; -1 for none. Late in a search the first one is taken (Bland's
   rule), so that no active set repeats. */
int weakest(const Room *room, const Face *face, const Row pull, const int *side, const double *y, bool late)
{
    int found = -1;
    double most = 0.0, size = WRONG_SIGN * norm(room->n, pull);
    for (int k = 0; k < face->k; k++) {
        int i = face->at[k];
        double wrong = -side[i] * y[i];
        if (wrong * room->length[i] > size && (found < 0 || (late ? i < found : wrong > most))) {
            most = wrong;
            found = i;
        }
    }
    return found;
}
