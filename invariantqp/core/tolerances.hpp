// Tolerances that several files share, named by what they tolerate, and the range of numbers.
#pragma once
#include <cmath>
#include <limits>

namespace iq {

// Relative to the largest number of its kind.
constexpr double ROUNDING = 1e-9;  // of a solution; singular values below it count as zero
inline const double ROOT_ROUNDING = std::sqrt(ROUNDING);
constexpr double TERM_ROUNDING = 1e-12;                   // of a sum, beside its largest term
constexpr double PRODUCT_ROUNDING = 1e-13;                // of matrix products; of the rank of a screw system
constexpr double SOLVED = 10 * ROUNDING;                  // a scale or residual this close is exact
constexpr double UNIT_ROUNDING = 1e-15;                   // of a few operations
constexpr double ACTIVE_TOLERANCE = 1e-6;  // a limit this close is active; slower joints are compared at this speed

constexpr double TINY = std::numeric_limits<double>::min();  // keeps a quotient finite where its divisor is zero
constexpr double LARGEST = 1e30, SMALLEST = 1 / LARGEST;     // of arguments, as in geometry/sizes.py
constexpr double LARGEST_TO_SQUARE = 1e150;                  // its square is finite, too
constexpr double LARGEST_NUMBER = LARGEST_TO_SQUARE * LARGEST_TO_SQUARE;

}  // namespace iq
