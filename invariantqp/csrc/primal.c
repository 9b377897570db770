/* Beside velocity/qp.py, where a solver does it: the shortest e inside limits, from one that is inside. */

#include "qp.h"
#include <stdlib.h>

/* Every step stays inside, and shortens e or changes the set of active limits; face->e is the answer. */
Outcome from_inside(const Room *room, const Slow *slow, int *side, Row e, Face *face, double *y, double *nu)
{
    int n = room->n;
    Row pull;
    for (int i = 0; i < room->count; i++)
        side[i] = 0;
    for (int count = 0; count < STEPS * room->count; count++) {
        if (face_of(room, side, face) == HAND_BACK)
            return HAND_BACK;
        if (on_face(slow, n, face, pull, nu) == HAND_BACK)
            return HAND_BACK;
        Row step;
        for (int j = 0; j < n; j++)
            step[j] = face->e[j] - e[j];
        along(n, face->k, (const Row *)face->Q, step); /* the rest is rounding, and would meet rows that depend on these */
        double first = 1.0, length = norm(n, step);
        int meets = 0;
        for (int i = 0; i < room->count; i++) {
            double change = dot(n, room->N[i], step), value = dot(n, room->N[i], e);
            if (side[i] != 0 || fabs(change) <= PARALLEL * room->length[i] * length)
                continue;
            double share = ((change > 0.0 ? room->upper[i] : room->lower[i]) - value) / change;
            if (share < first) {
                first = share;
                meets = change > 0.0 ? i + 1 : -i - 1;
            }
        }
        if (meets != 0) {
            for (int j = 0; j < n; j++)
                e[j] += fmax(0.0, first) * step[j];
            side[abs(meets) - 1] = meets > 0 ? 1 : -1;
            continue;
        }
        multipliers(face, room, pull, y);
        int wrong = weakest(room, face, pull, side, y, count > 2 * room->count);
        if (wrong < 0)
            return slow == NULL || slow_enough(slow, n, face->e, FEASIBLE) ? DONE : HAND_BACK;
        for (int j = 0; j < n; j++)
            e[j] = face->e[j];
        side[wrong] = 0;
    }
    return HAND_BACK;
}
