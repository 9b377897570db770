// The velocity law: one tick of invariantqp/velocity/definition.py, which states it on a page and explains each symbol.
#pragma once
#include "matrix.hpp"

namespace iq {

constexpr int MOST_ROWS = 256;  // of limits in a tick

enum class FormKind { none, pitch, complement, definite };

// Units SI, all twists in one frame; m joints, n bodies. What may be absent has no memory: Vec{}, Mat{}.
struct Tick {
    Mat J;                               // (6n, m) joint twists
    Mat root;                            // (6n, 6n) R, the measure; (k, 6) of a target that leaves something free
    Mat measure;                         // (6, 6) the whole measure then, by which exact rows are compared; else absent
    Vec ahead, error;                    // (6n,) the target's own twist; gain times the error twist
    Vec lower, upper;                    // (m,) velocity limits
    Vec position_lower, position_upper;  // (m,) of these the ones from position limits
    Mat C;                               // (k, m) rows, row_lower <= C x <= row_upper
    Vec row_lower, row_upper;            // (k,)
    Mat P;                               // (3, m) joint velocities to the velocity of a point of the tool
    double speed = INFINITY;             // |P x| <= speed
    Mat E;                               // (j, m) exact rows E x = a (E_f + E_e)
    Vec E_f, E_e;                        // (j,)
    int exact_rank = 0;                  // how many of them the joints can keep; next to where they lose one, a is small
    Mat D;                               // (j, 6) parts of the twist, E = D J, zero for a row that is none
    Vec posture;                         // (m,) x_p
    Vec fastest;                         // (m,) full speeds of the joints
    Mat metric;                          // (m, m) joint metric
    double held = 0;                     // how long the velocity is held [s]
    Vec before;                          // (m,) x_before; absent in a call by itself
    double missed = 0;                   // r_before
    FormKind form = FormKind::none;
    double pitch = 0;                    // of a pitch form [m/rad]
    Mat form_matrix;                     // (6, c) twists of a complement, or (6, 6) a definite form on twists
    double damping = 0;                  // lambda of a form, or of a call by itself
    double guard = -1;                   // eta; negative does not ask
    // For the report alone: a measured twist towards a target that counts as nothing, 0 for a twist by itself; and whether
    // the measure tells positions and angles apart, as a point's does.
    double slack = 0;
    bool apart = true;
    int turns = 3;  // rows of the measure that measure turning, of each body, where it tells them apart
};

enum class Failure { none, infeasible, no_pseudoinverse, no_numbers };

struct Answer {
    Vec velocity;         // (m,)
    double pace = 1;      // p
    double share = 1;     // a
    double missed = 0;    // r, to be remembered
    double guarded = 1;   // the share of the way from least squares to x_h that the guard leaves
    Vec relaxed;          // (k,) by how much rows were relaxed; absent where none was
    double faster = 0;    // by how much the tool's speed was relaxed
    Vec multipliers;      // (m + k,) of joints and rows at the answer; absent where no limit is active
    bool limited = false; // whether limits had a part in the answer
    bool beside = false;  // whether no share of the exact rows is inside the limits
    double unmet = 0;     // of the exact rows' demand, the share that contradicts itself
    Failure failure = Failure::none;
};

// The joint velocity of a tick. Its memory is the workspace's.
Answer velocity(const Tick& tick, Workspace& w);

// Of several levels, the first before the second and so on, each inside its own limits.
Answer prioritised(const std::vector<Tick>& levels, Workspace& w);

}  // namespace iq
