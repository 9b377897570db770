// The force law: from a force error to a speed along each constraint of a contact.
//
//     tau v' + v = g (e + integral)              e = wanted - measured force
//     L(s) = g (1 + 1/(Ti s)) / (1 + tau s) * (k + b s)/s * exp(-T s)
//
// k and b are upper bounds of the contact's stiffness and damping as commands meet them, T is everything late in the loop:
//
//     g = min( G/(k (T + tau)), (1 + tau/T)/(GM b) ),     Ti = 8/(g k),     tau where both are equal, else 0
//
// G = 1/2 leaves a phase margin of 61 degrees to a spring without the integral. GM is the gain margin where a damper,
// whose gain does not fall with frequency, rules. With the integral, and with true k down to a quarter of the bound and b
// down to zero: gain margin 2.15, phase margin 54 degrees, largest sensitivity 1.87 (`margins`).
// Reference: Skogestad 2003 (half rule, integral time); Villani and De Schutter 2016, force control.
#pragma once
#include <array>
#include <cmath>

namespace iq::force {

// G: crossover frequency times what is late. GM: gain margin against a damper. Integral time in 1/(g k).
constexpr double CROSSOVER = 0.5, GAIN_MARGIN = 2.5, INTEGRAL = 8;

struct Gains {
    double g = 0;    // [length/s per force]
    double tau = 0;  // lag of the law [s]
    double Ti = 0;   // integral time [s]
};
// The gains for upper bounds of stiffness k [force/length] and damping b [force s/length] and lateness [s].
Gains gains(double k, double b, double late);

struct Margins {
    double gain, phase, sensitivity;  // ratio, [rad], largest |1/(1 + L)|
};
// The margins of the loop with a true stiffness and damping.
Margins margins(const Gains& law, double k, double b, double late);

}  // namespace iq::force
