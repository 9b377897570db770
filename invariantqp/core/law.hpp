// The velocity law: one tick of invariantqp/velocity/definition.py, which states it on a page and explains each symbol.
#pragma once
#include "matrix.hpp"

namespace iq {

constexpr int MOST_ROWS = 256;  // limit rows of a tick

enum class FormKind { none, pitch, complement, definite };

// Units SI, all twists in one frame; m joints, n bodies. What may be absent has no memory: Vec{}, Mat{}.
struct Tick {
    Mat J;                               // (6n, m) joint twists
    Mat root;                            // (6n, 6n) R, the measure; (k, 6) of a target that leaves something free
    Mat measure;                         // (6, 6) the whole measure then, by which exact rows are compared; else absent
    Vec feedforward, error;              // (6n,) twist of the target; gain times the error twist
    Vec lower, upper;                    // (m,) velocity limits
    Vec position_lower, position_upper;  // (m,) those of them that come from position limits
    Mat C;                               // (k, m) rows, row_lower <= C x <= row_upper
    Vec row_lower, row_upper;            // (k,)
    Mat P;                               // (3, m) joint velocities to the velocity of a point of the tool
    double speed = INFINITY;             // |P x| <= speed
    Mat E;                               // (j, m) exact rows E x = a (E_f + E_e)
    Vec E_f, E_e;                        // (j,)
    int exact_rank = 0;                  // their rank away from singularities; at a singularity a is small
    Mat D;                               // (j, 6) E = D J, zero for a row that is no part of the twist
    Vec posture;                         // (m,) x_p
    Vec velocity_limit;                  // (m,) of the robot; scales the posture motion
    Mat metric;                          // (m, m) joint metric
    double hold_time = 0;                // how long the velocity is held [s]
    Vec last_velocity;                   // (m,) x_before; absent in a single call
    double last_residual = 0;            // r_before
    FormKind form = FormKind::none;
    double pitch = 0;                    // of a pitch form [m/rad]
    Mat form_matrix;                     // (6, c) twists of a complement, or (6, 6) a definite form on twists
    double damping = 0;                  // lambda of a form, or of a single call
    double guard = -1;                   // eta; negative for no guard
    // For the report alone.
    double error_tolerance = 0;        // measured error twist that counts as zero, 0 for a twist without target
    bool separates_orientation = true; // whether orientation and position have rows of their own in the measure
    int orientation_rows = 3;          // how many rows of each body are those of orientation, where they are separate
};

enum class Failure { none, infeasible, no_pseudoinverse, no_numbers };

struct Answer {
    Vec velocity;         // (m,)
    double approach_scale = 1;  // p
    double scale = 1;           // a
    double residual = 0;        // r, kept for the next tick
    double form_share = 1;      // of the step from least squares to x_h, what the guard leaves
    Vec relaxed;                // (k,) by how much rows were relaxed; absent where none was
    double speed_excess = 0;    // by how much the tool's speed limit was relaxed
    Vec multipliers;            // (m + k,) of joints and rows; absent where no limit is active
    bool limits_active = false;
    bool exact_infeasible = false;  // whether the exact rows are outside the limits at every scale
    double inconsistency = 0;       // share of the exact rows' demand that linearly dependent rows contradict
    Failure failure = Failure::none;
};

// The joint velocity of a tick, in the workspace's memory.
Answer velocity(const Tick& tick, Workspace& w);

// The joint velocity of prioritised levels, highest first; the rest of the answer is that of the first level.
Answer prioritised(const std::vector<Tick>& levels, Workspace& w);

}  // namespace iq
