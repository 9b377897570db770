/* Twin of legacy/objective.py and damping.py: what a tick minimises, in the coordinates of V.

       1/2 |A z - b|^2 + 1/2 sum of lambda_i^2 (v_i'(z - z_p))^2  =  1/2 |K (z - z*)|^2 + constant
       weights = sigma^2 + lambda^2,   V'z* = (sigma U'b + lambda^2 V'z_p) / weights

   Where A = L V and nothing is damped, K = L V and V'z* = L^-1 b. */

#include "core.h"

/* Weights further apart than this make the optimum inside limits too sensitive to rounding. */
static const double LEAST_WEIGHT = 1e-10;

/* Whether a direction moves anything; it fades in, so that the law has no jump. */
static double moves(double sigma, double largest)
{
    return between(sigma / (NULL_RATIO * largest) - 1.0, 0.0, 1.0);
}

/* 1 at a singularity, 0 from the threshold of the damping on */
static double weakness(const Demand *demand, double sigma, double largest)
{
    double share = fmin(sigma / (demand->threshold * largest), 1.0);
    return 1.0 - share * share;
}

/* lambda_i^2 */
double damped_square(const Demand *demand, double sigma, double wanted, double largest)
{
    double left = demand->fixed;
    if (demand->ceiling > 0.0)
        left = demand->ceiling * largest * weakness(demand, sigma, largest);
    left *= left;
    return demand->speed > 0.0 ? fmax(left, sigma * (fabs(wanted) / demand->speed - sigma)) : left;
}

/* objective.py, Spectrum.led: the share of a posture that direction i follows, whatever twist is wanted */
double led_share(const Demand *demand, const Spectrum *found, int i)
{
    if (found->regular && i < 6)
        return 0.0;
    double moving = moves(found->sigma[i], found->largest), sigma = moving * found->sigma[i];
    double squared = damped_square(demand, sigma, 0.0, found->largest), total = sigma * sigma + squared;
    return total > 0.0 ? squared / total : 1.0;
}

/* By the spectrum of A (6, n), for a twist that has a chase or none. */
Outcome least_squares(const Demand *demand, int n, const Spectrum *found, const Row posture, bool chased,
                      Objective *objective)
{
    int k = n < 6 ? n : 6, regular = found->regular ? 6 : 0;
    double largest = found->largest, most = 0.0, least = INFINITY, damped = 0.0;
    if (!(largest > 0.0))
        return HAND_BACK;
    objective->n = n;
    objective->rank = 0;
    objective->regular = found->regular;
    objective->V = (const Row *)found->V;
    bool eased = chased && !found->regular && demand->ceiling > 0.0 && demand->speed == 0.0;
    double needed = 0.0, weak = SLOWEST * largest * SLOWEST * largest; /* squares; damping.py, asked_share */
    Row moving, towards;
    for (int i = regular; i < n; i++) {
        moving[i] = moves(found->sigma[i], largest);
        towards[i] = dot(n, found->V[i], posture);
    }
    for (int i = 0; i < k && eased; i++) {
        double sigma = moving[i] * found->sigma[i];
        double left = moving[i] * (found->wanted[i] - sigma * towards[i]);
        needed += left * left;
        weak += weakness(demand, sigma, largest) * left * left;
    }
    for (int i = 0; i < n; i++) {
        double sigma = found->sigma[i], wanted = found->wanted[i];
        if (i < regular) { /* nothing is damped */
            objective->rank++;
            objective->optimum[i] = wanted;
            objective->still[i] = found->ahead[i];
            continue;
        }
        sigma *= moving[i];
        bool null = moving[i] == 0.0;
        double squared = damped_square(demand, sigma, wanted, largest);
        double easy = EASY * sigma / largest;
        if (eased)
            squared *= weak / (weak + needed * easy * easy);
        if (null && squared == 0.0)
            squared = NULL_WEIGHT * largest * largest;
        double weight = sigma * sigma + squared;
        if (!null) {
            damped = fmax(damped, squared);
            objective->rank++;
        }
        objective->weights[i] = weight;
        objective->optimum[i] = (sigma * wanted + squared * towards[i]) / weight;
        objective->still[i] = (sigma * found->ahead[i] + squared * towards[i]) / weight;
        most = fmax(most, weight);
        least = fmin(least, weight);
    }
    if (!found->regular && !(least >= LEAST_WEIGHT * most))
        return HAND_BACK;
    objective->damping = sqrt(damped);
    objective->ratio = k == 0 ? 1.0 : found->sigma[k - 1] > NULL_RATIO * largest ? found->sigma[k - 1] / largest : 0.0;
    return DONE;
}

void centre(const Objective *objective, Row z)
{
    combined(objective->n, objective->n, objective->optimum, 1, objective->V, z);
}

void quadratic(const Objective *objective, Quadratic *problem)
{
    int n = problem->n = objective->n, regular = objective->regular ? 6 : 0;
    const Row *V = objective->V;
    centre(objective, problem->centre);
    for (int i = 0; i < n; i++) {
        double root = i < regular ? 1.0 : sqrt(objective->weights[i]), over = 1.0 / root;
        const double *row = i < regular ? objective->regular->L[i] : &root, *column = i < regular ? &objective->regular->X[i][i] : &over;
        if (i < regular && objective->regular->A != NULL)
            memcpy(problem->K[i], objective->regular->A[i], sizeof(Row));
        else
            combined(n, i < regular ? i + 1 : 1, row, 1, i < regular ? V : V + i, problem->K[i]);
        combined(n, i < regular ? 6 - i : 1, column, MOST, V + i, problem->T[i]);
    }
}

double speed(const Objective *objective, const Row z)
{
    double sum = 0.0;
    for (int i = 0; i < objective->rank; i++) {
        double along = dot(objective->n, z, objective->V[i]);
        sum += along * along;
    }
    return sqrt(sum);
}

/* Of L'L + mu a factor is found from its last entry to its first: so it is a lower triangle again. */
void calmed(Objective *objective, double mu)
{
    int regular = objective->regular ? 6 : 0;
    const Row *L = regular > 0 ? objective->regular->L : NULL;
    Regular *calmer = &objective->calmer;
    Row H[6];
    double pull[6];
    for (int i = 0; i < regular; i++) {
        pull[i] = 0.0;
        for (int j = 0; j < 6; j++) {
            double entry = 0.0;
            for (int k = i > j ? i : j; k < 6; k++)
                entry += L[k][i] * L[k][j];
            pull[i] += entry * objective->optimum[j];
            H[5 - i][5 - j] = entry + (i == j ? mu : 0.0);
        }
    }
    if (regular > 0) {
        double turned[6];
        for (int i = 0; i < 6; i++)
            turned[i] = pull[5 - i];
        factored(6, H);
        solved(6, (const Row *)H, turned, turned);
        for (int i = 0; i < 6; i++) {
            objective->optimum[i] = turned[5 - i];
            for (int k = i; k < 6; k++)
                calmer->L[k][i] = H[5 - i][5 - k];
        }
        inverse_triangle(6, (const Row *)calmer->L, calmer->X);
        calmer->A = NULL;
        objective->regular = calmer;
    }
    for (int i = regular; i < objective->n; i++) {
        double weight = objective->weights[i] + mu;
        objective->optimum[i] *= objective->weights[i] / weight;
        objective->weights[i] = weight;
    }
}
