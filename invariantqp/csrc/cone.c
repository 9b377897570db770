/* Twin of Cone in velocity/qp.py: a speed limit |start + J x| <= limit. */

#include "core.h"

double tool_speed(const Cone *cone, int n, const Row x)
{
    double v[3];
    for (int i = 0; i < 3; i++)
        v[i] = cone->start[i] + dot(n, cone->J[i], x);
    return norm(3, v);
}

/* The same on z, x = origin + basis z; basis[i] is column i of n. */
void cone_on(const Cone *cone, int m, const Row origin, int n, const Row *basis, Cone *result)
{
    double most = 0.0, widest = 0.0;
    result->limit = cone->limit;
    for (int i = 0; i < 3; i++) {
        result->start[i] = cone->start[i] + dot(m, cone->J[i], origin);
        for (int j = 0; j < m; j++)
            most = fmax(most, fabs(cone->J[i][j]));
    }
    for (int l = 0; l < n; l++)
        for (int j = 0; j < m; j++)
            widest = fmax(widest, fabs(basis[l][j]));
    /* Where exact rows fix the point's velocity, J is zero; rounding must not make it look otherwise. */
    for (int i = 0; i < 3; i++)
        for (int l = 0; l < n; l++) {
            double entry = dot(m, cone->J[i], basis[l]);
            result->J[i][l] = fabs(entry) <= FIXED_TOLERANCE * most * widest ? 0.0 : entry;
        }
}
