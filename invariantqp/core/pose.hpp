// Joint positions for a pose, inside the joint limits: damped Newton from several starts.
//
//     q = argmin f(q),   lower <= q <= upper,   f = 1/2 |r|^2,   r = F (omega; p_d - p)
//
// omega is the rotation vector from the tool to its target, p and p_d are the current and the desired position of a
// point of the last link. For a partial target r has the constrained components alone. Exact demands, C x = b for a step x,
// have priority over f. Units of the arm; everything is in the base frame.
#pragma once
#include "demands.hpp"
#include <chrono>
#include <functional>
#include <optional>

namespace iq {

// The properties of the arm that a search needs; m joints.
struct PoseArm {
    std::function<Pose(const double* q, Mat J)> state;  // tool pose, and joint twists (6, m) if J has memory
    std::vector<double> lower, upper;                   // (m,) position limits, infinite if there is none
    std::vector<double> start_lower, start_upper;       // (m,) range of starts: the limits, or a turn without them
    std::vector<double> middle, start_stride;           // (m,) of the range; shares of it from one start to the next
    std::vector<double> full_turn;                      // (m,) displacement of a turn of a hinge, 0 for other joints
    Vec3 point{};                                       // the arm's own point, in the tool frame
    double length = 1;                                  // the arm's own length, which scales a radian

    int size() const { return static_cast<int>(lower.size()); }
    // Whether the range of a joint holds a whole turn, so that it has an equal angle for every one.
    bool can_turn_over(int j) const { return full_turn[j] > 0 && upper[j] - lower[j] >= full_turn[j]; }
    // Shifts q (m,) by whole turns into the limits, and clips it.
    void wrap_into_limits(double* q) const;
    // Shifts each joint by whole turns as near to a start (m,) as the limits allow, with a slack [rad], and clips it.
    void wrap_near(double* q, const double* start, double slack) const;
};

// A demand with priority: on the tool, or one of the user's own by its rows.
struct ExactDemand {
    Demand of;
    // Rows C (k, m) and errors b (k,) of a user's demand at q (m,); returns k, and that alone if C has no memory.
    std::function<int(const double* q, Mat C, Vec b)> rows;
};

struct PoseTask {
    Pose target;
    std::optional<PartialTarget> partial_target;  // replaces the target
    Vec3 point{};                         // p, in the tool frame
    double length = 1;                    // F = diag(length I, I)
    Mat root;                             // (6, 6) F of another metric; without memory: that of the length
    std::vector<ExactDemand> exact;
    double tolerance = 1e-6;
    double min_singular_value = 1;        // of F, at most 1
    int restarts = 0;
    const double* start_origin = nullptr; // (m,) shares of the range where the sequence of starts begins
    double time_limit = INFINITY;         // [s]
    std::function<double(const double* q)> clearance;  // infinite if q keeps the clearance, else the distance; or none

    int size() const { return !partial_target ? 6 : partial_target->turns() + (partial_target->has_point ? 3 : 0); }
};

enum class PoseOutcome {
    reached,
    exact_reached,  // exact demands are met, and the rest has converged
    timed_out,
    out_of_reach,
};

struct PoseResult {
    std::vector<double> q;
    PoseOutcome outcome = PoseOutcome::out_of_reach;
    double position = 0, orientation = 0;  // errors of the tool frame [length, rad]
    double error = 0;                      // |r|
    int iterations = 0, tries = 1;
    bool other_branch = false;             // from a restart, or a joint turned the other way round
    double displacement = 0;               // largest displacement of a joint from the start
};

// Joint positions for a target, from a start (m,) first, or from the middle of the range if it is null.
PoseResult solve_pose(const PoseArm& arm, const PoseTask& task, const double* start, Workspace& w);

// One descent from a start (m,), which is replaced by its end: whether the target, or the exact demands, are met.
bool descend_to(const PoseArm& arm, const PoseTask& task, double* q, Workspace& w);

}  // namespace iq
