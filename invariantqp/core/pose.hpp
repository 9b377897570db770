// Joint positions for a pose, inside the joint limits: damped Newton from several starts.
//
//     q = argmin f(q),   lower <= q <= upper,   f = 1/2 |r|^2,   r = F (omega; p_d - p)
//
// omega is the rotation vector from the tool to its target, p and p_d are where a point of the last link is and should
// be. Of a target that leaves something free, r has the turn across the axis, and the point, as far as they are asked for.
// Exact demands, C x = b for a step x, come before f. Units of the arm; everything is in the base frame.
#pragma once
#include "demands.hpp"
#include <chrono>
#include <functional>
#include <optional>

namespace iq {

// What depends on the arm alone; m joints.
struct PoseArm {
    std::function<Pose(const double* q, Mat J)> state;  // tool pose, and joint twists (6, m) where J has memory
    std::vector<double> lower, upper;    // (m,) position limits, infinite where there is none
    std::vector<double> low, high;       // (m,) where searches start: the limits, or a turn where there are none
    std::vector<double> middle, stride;  // (m,) of the range; shares of the range from one start to the next
    std::vector<double> turn;            // (m,) displacement of a whole turn of a hinge, 0 of other joints
    Vec3 point{};                        // the arm's own point, in the tool frame
    double length = 1;                   // the arm's own length: a radian counts as much

    int size() const { return static_cast<int>(lower.size()); }
    // Whether the range of a joint holds a whole turn: every angle then has an equal one inside it.
    bool turns_over(int j) const { return turn[j] > 0 && upper[j] - lower[j] >= turn[j]; }
    // q (m,) shifted by whole turns into the limits; clipped to them where no turn helps.
    void inside(double* q) const;
    // The same pose, with each joint as near a start (m,) as whole turns inside the limits bring it; `slack` [rad] beyond
    // them is at them.
    void near(double* q, const double* start, double slack) const;
};

// What is met before all else: a demand on the tool; or one of the user's own, by its rows.
struct ExactDemand {
    Demand of;
    // Rows C (k, m) and what they miss, b (k,), at q (m,); of a demand of the user's own. Returns k; without memory of C
    // only that.
    std::function<int(const double* q, Mat C, Vec b)> rows;
};

struct PoseTask {
    Pose target;
    std::optional<PartialTarget> part;  // instead: a target that leaves something free
    Vec3 point{};          // p, in the tool frame
    double length = 1;     // F = diag(length I, I)
    Mat root;              // (6, 6) F of another measure; absent for that
    std::vector<ExactDemand> exact;
    double tolerance = 1e-6;
    double least = 1;      // the least singular value of F, at most 1
    int restarts = 0;
    const double* origin = nullptr;  // (m,) shares of the range where the sequence of starts begins
    double time_limit = INFINITY;    // [s]
    // Infinite where q is allowed, else how much room there is; none allows all.
    std::function<double(const double* q)> room;

    int size() const { return !part ? 6 : part->turns() + (part->has_point ? 3 : 0); }
};

enum class PoseOutcome {
    reached,
    closest,       // exact demands are met, and no step brings the rest nearer
    late,          // the time is over
    out_of_reach,
};

struct PoseAnswer {
    std::vector<double> q;
    PoseOutcome outcome = PoseOutcome::out_of_reach;
    double position = 0, orientation = 0;  // of the tool frame, from its target
    double error = 0;                      // |r|
    int iterations = 0, tries = 1;
    bool other_branch = false;             // whether a restart found it, or a joint turned the other way round
    double displacement = 0;               // of the joint that is farthest from the start
};

// Joint positions for a target, from a start (m,) first, or from the middle of the range where it is null.
PoseAnswer solve_pose(const PoseArm& arm, const PoseTask& task, const double* start, Workspace& w);

// One descent from a start (m,) that is replaced by where it ends: whether the target is met, or the exact demands are.
bool descend_to(const PoseArm& arm, const PoseTask& task, double* q, Workspace& w);

}  // namespace iq
