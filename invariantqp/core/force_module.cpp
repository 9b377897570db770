// The force law for Python.
#include "bound.hpp"
#include "force.hpp"
#include <nanobind/stl/tuple.h>

namespace iq {
namespace {

std::tuple<double, double, double> gains_of(double k, double b, double late)
{
    const force::Gains law = force::gains(k, b, late);
    return {law.g, law.tau, law.Ti};
}
std::tuple<double, double, double> margins_of(double g, double tau, double Ti, double k, double b, double late)
{
    const force::Margins found = force::margins({g, tau, Ti}, k, b, late);
    return {found.gain, found.phase, found.sensitivity};
}

}  // namespace

void bind_force(nb::module_& m)
{
    m.def("force_gains", gains_of, "k"_a, "b"_a, "late"_a, "g, tau, Ti of the force law.");
    m.def("force_margins", margins_of, "g"_a, "tau"_a, "Ti"_a, "k"_a, "b"_a, "late"_a,
          "Gain margin, phase margin [rad], largest sensitivity.");
}

}  // namespace iq
