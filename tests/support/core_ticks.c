/* Random ticks of the compiled core without Python, for aarch64.sh: a tick a line, all digits of its velocity. */

#include "core.h"
#include <stdio.h>
#include <string.h>

#define TICKS 20000

/* From -1 to 1 (Marsaglia's xorshift). */
static double uniform(void)
{
    static unsigned long long state = 88172645463325252ull;
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (double)(state >> 11) / 9007199254740992.0 * 2.0 - 1.0;
}

/* 3 to 8 joints, free or at their limits; every fourth has a row of limits, every fifth exact rows. */
static void drawn(int k, Demand *demand)
{
    memset(demand, 0, sizeof *demand);
    int m = demand->m = 3 + k % 6;
    double width = k % 3 == 0 ? 10.0 : 0.3;
    demand->row_rank = -1;
    demand->dt = 0.01;
    demand->threshold = 2e-2;
    demand->ceiling = 1e-3;
    for (int i = 0; i < 6; i++) {
        demand->s[i] = uniform();
        demand->root[i][i] = 1.0;
        for (int j = 0; j < m; j++)
            demand->J[i][j] = uniform();
    }
    demand->limits = k % 4 == 1;
    demand->least[0] = -0.2;
    demand->most[0] = 0.2;
    for (int j = 0; j < m; j++) {
        demand->lower[j] = -width;
        demand->upper[j] = width;
        demand->G[0][j] = uniform();
    }
    demand->rows = k % 5 == 2 ? 2 : 0;
    demand->of_twist = true;
    for (int i = 0; i < demand->rows; i++) {
        demand->D[i][3 + i] = 1.0;
        memcpy(demand->C[i], demand->J[3 + i], sizeof(Row));
        demand->e[i] = demand->s[3 + i];
    }
}

int main(void)
{
    int back = 0, outside = 0;
    for (int k = 0; k < TICKS; k++) {
        Demand demand;
        Solution solution;
        drawn(k, &demand);
        if (solve(&demand, &solution) == HAND_BACK) {
            back++;
            continue;
        }
        printf("%d %d", k, (int)solution.method);
        for (int j = 0; j < demand.m; j++) {
            double x = solution.velocity[j];
            printf(" %.17g", x);
            outside += !(x >= demand.lower[j] && x <= demand.upper[j]);
        }
        printf("\n");
    }
    printf("%d ticks, %d handed back, %d outside limits\n", TICKS, back, outside);
    return outside > 0;
}
