// The pseudoinverse and the dual projectors of a system of twists, where they are well conditioned.
//
//     J = U diag(sigma) V',   J^{+h} = V diag(1/sigma) (U'Q_h U)^-1 U'Q_h,   which is V diag(1/sigma) U' for rank 6
//     P = U (K'U)^-1 K',      U, K orthonormal bases of S and of Z* = the orthogonal complement of Z
//
// Lengths are measured in a unit of the system's own. What is less well conditioned, systems/pseudoinverses.py and
// systems/projectors.py answer, which say how many digits are correct. Reference: [DS] Theorem 2.2, Sect. 6.1.
#pragma once
#include "matrix.hpp"
#include <optional>

namespace iq {

// J^{+h} (m, 6) of twists J (6, m).
std::optional<Mat> pseudoinverse(Mat J, double h);

// P on twists in S along Z and P* on wrenches, (6, 6); bases of S (6, k), of Z and of S* (6, 6 - k); the size of P, and the
// unit of length in which it was found.
struct Projectors {
    Mat motion, force, freedoms, complement, constraints;
    double norm = 0, unit = 1;
};
// The rule that Z follows: reciprocal to S by a pitch, orthogonal to S in a metric (6, 6), or spanned by columns (6, n).
struct ComplementRule {
    enum class Kind { pitch, metric, columns } kind;
    double pitch;
    Mat matrix;
};
// Columns (6, m) are twists that span S, or wrenches that leave it free.
std::optional<Projectors> projectors(Mat columns, bool wrenches, const ComplementRule& rule);

}  // namespace iq
