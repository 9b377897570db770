// The h-pseudoinverse and the dual projectors of a screw system, if they are well conditioned.
//
//     J = U diag(sigma) V',   J^{+h} = V diag(1/sigma) (U'Q_h U)^-1 U'Q_h,   which is V diag(1/sigma) U' for rank 6
//     P = U (K'U)^-1 K',      U, K orthonormal bases of S and of Z* = the orthogonal complement of Z
//
// Lengths are in a unit of the system. Ill-conditioned systems are left to systems/pseudoinverses.py and
// systems/projectors.py, which compute a condition number. Reference: [DS] Theorem 2.2, Sect. 6.1.
#pragma once
#include "matrix.hpp"
#include <optional>

namespace iq {

// J^{+h} (m, 6) of twists J (6, m).
std::optional<Mat> pseudoinverse(Mat J, double h);

// P on S along Z and P* on wrenches, (6, 6); bases of S (6, k), of Z and of S* (6, 6 - k); the norm of P and its unit of
// length.
struct Projectors {
    Mat motion, force, freedoms, complement, constraints;
    double norm = 0, unit = 1;
};
// Z is h-reciprocal to S for a pitch, orthogonal to S in a metric (6, 6), or spanned by columns (6, n).
struct ComplementRule {
    enum class Kind { pitch, metric, columns } kind;
    double pitch;
    Mat matrix;
};
// The projectors of twists (6, m) that span S, or of wrenches (6, m) that do no work on it.
std::optional<Projectors> projectors(Mat columns, bool wrenches, const ComplementRule& rule);

}  // namespace iq
