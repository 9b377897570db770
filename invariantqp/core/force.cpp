#include "force.hpp"
#include <algorithm>
#include <complex>

namespace iq::force {

constexpr double PI = 3.14159265358979323846;

Gains gains(double k, double b, double late)
{
    const double excess = GAIN_MARGIN * CROSSOVER * b / k - late;
    const double tau = excess > 0 ? late * (std::sqrt(1 + excess / late) - 1) : 0;
    double g = CROSSOVER / (k * (late + tau));
    if (b > 0)
        g = std::min(g, (1 + tau / late) / (GAIN_MARGIN * b));
    return {g, tau, INTEGRAL / (g * k)};
}

Margins margins(const Gains& law, double k, double b, double late)
{
    constexpr int POINTS = 20000;  // of a logarithmic grid from 1e-4 to 1e3 in units of 1/late
    constexpr double LOW = 1e-4, HIGH = 1e3;
    Margins found{INFINITY, INFINITY, 0};
    double size_before = 0, phase_before = 0;
    for (int i = 0; i < POINTS; i++) {
        const double w = LOW / late * std::pow(HIGH / LOW, i / (POINTS - 1.0));
        // The phase is written out: an arctangent of L would leave out whole turns of the delay.
        const double phase = -PI - w * late + std::atan(w * law.Ti) - std::atan(w * law.tau) + std::atan2(b * w, k);
        const double size = law.g * std::hypot(1, 1 / (w * law.Ti)) / std::hypot(1, w * law.tau) * std::hypot(k, b * w) / w;
        if (i > 0) {
            const double turns = std::ceil((phase_before + PI) / (2 * PI)) - 1;  // the next crossing below
            const double crossing = -PI + 2 * PI * turns;
            if (phase < crossing && phase_before > crossing) {
                const double share = (phase_before - crossing) / (phase_before - phase);
                found.gain = std::min(found.gain, 1 / (size_before * std::pow(size / size_before, share)));
            }
            if ((size - 1) * (size_before - 1) <= 0 && size != size_before) {
                const double share = std::log(size_before) / std::log(size_before / size);
                const double there = phase_before + share * (phase - phase_before);
                found.phase = std::min(found.phase, std::abs(std::remainder(there + PI, 2 * PI)));
            }
        }
        found.sensitivity = std::max(found.sensitivity, 1 / std::abs(1.0 + std::polar(size, phase)));
        size_before = size, phase_before = phase;
    }
    return found;
}

}  // namespace iq::force
