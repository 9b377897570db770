/// The compiled module invariantqp._core: a placeholder that shows that the C++ library is linked.

#include <nanobind/nanobind.h>

#include <numeric>
#include <stdexcept>
#include <vector>

namespace nb = nanobind;

static double add(double a, double b)
{
    const std::vector<double> numbers{a, b};
    const double sum = std::accumulate(numbers.begin(), numbers.end(), 0.0);
    if (sum != sum)
        throw std::invalid_argument("the sum is not a number");
    return sum;
}

NB_MODULE(_core, m)
{
    m.doc() = "The compiled core in C++.";
    m.def("add", &add, nb::arg("a"), nb::arg("b"), "The sum of two numbers.");
}
