// A loop: measured joint positions and a target, or a twist, in; a joint velocity inside all limits out.
//
//     s = b gain log(T_target T^-1) + feedforward,     velocity = law(J(q), s, limits(q))
//
// For a target that leaves something free, target.hpp has the displacement, and only the part that counts is measured.
// b slows the approach down where acceleration limits need room to brake. All poses and twists are in the base frame.
#pragma once
#include "braking.hpp"
#include "clearance.hpp"
#include "demands.hpp"
#include "joints.hpp"
#include <functional>
#include <optional>

namespace iq {

// How twists are measured: at a point (3,) of the tool with a length [length/rad]; or by a root (6, 6) that the base or
// the tool carries.
struct Measure {
    enum class Kind { point, own_point, base, tool } kind = Kind::point;
    Vec3 point{};
    double length = 1;
    std::vector<double> root;
};

struct ToolSpeed {
    double limit = INFINITY;  // [length/s]
    Vec3 point{};             // in the tool frame
};

// Rows of limits, lower <= C x <= upper; C has (k, m) numbers.
struct RowsOfLimits {
    std::vector<double> C, lower, upper;
};

// What never changes in a loop. Absent of arrays: empty.
struct LoopSettings {
    int joints = 0;
    double dt = 0, delay = 0, gain = 0;  // [s], [s], [1/s]
    Measure measure;
    double slack = 0;          // a measured error that may stay beside position limits [length]
    JointLimits limits;
    std::vector<double> believed_lower, believed_upper;  // (m,) positions beyond these are no measurements
    std::vector<double> position_lower, position_upper;  // (m,) of the robot, which they are reported beside
    std::vector<double> turns;                           // (m,) whole turns of continuous joints, else 0
    Vec3 tip{};                                          // where the tool is in the middle of the joint range,
    double far = INFINITY;                               // and how far from there a target is believed [length]
    ToolSpeed tool_speed;
    RowsOfLimits rows;                  // the same in every tick
    std::vector<Demand> exact;
    int exact_rank = 0;  // of exact rows, in the arm's best state
    std::vector<double> posture, pull;  // (m,) joint positions, and gains [1/s]
    std::vector<double> metric;         // (m, m)
    FormKind form = FormKind::none;
    double pitch = 0, damping = 0, guard = -1;
    std::vector<double> form_matrix;  // (6, c)
};

// What a tick reads of the arm.
struct ArmState {
    Mat J;  // (6, m)
    Pose tool;
};
// What is other in one tick.
struct TickChanges {
    double speed = 1;  // share of the motion's speed, from 0 to 1
    const JointLimits* limits = nullptr;
    const ToolSpeed* tool_speed = nullptr;
};
// Rows of one limit in one tick; none where C is empty.
struct RowsOfTick {
    Mat C;
    Vec lower, upper;
};
// A limit that has other rows in each tick: a clearance, or functions of the user's.
struct RowLimit {
    ClearanceInLoop* clearance = nullptr;
    // Rows where the joints are, coming from a velocity; absent where no velocity is known to be safe.
    std::function<std::optional<RowsOfTick>(Vec there, Vec before)> rows;
    // More rows, where the velocity x does not keep the limit to the tick's end. May be missing.
    std::function<RowsOfTick(Vec there, Vec x)> after;
};
// What the user's own functions answer. Those that are missing are not asked.
struct LoopFunctions {
    std::function<ArmState(Vec there, Workspace&)> arm;  // of a robot that is no Chain
    std::vector<RowLimit> limits;                        // in the order of their rows
    // Exact rows at a gain [1/s] for a target that moves, set in E, D and E_f; with the pose that is nearest to a target
    // that leaves something free, else null.
    std::function<void(Vec there, double gain, Vec ahead, const Pose* nearest, Tick&)> exact;
    std::function<Answer(const Tick&)> law;  // another solver

    // A tick begins at measured joint positions.
    void begin(Vec q) const
    {
        for (const RowLimit& limit : limits)
            if (limit.clearance)
                limit.clearance->begin(q);
    }
};
struct TickInputs {
    Vec q;                               // (m,) measured
    const Pose* target = nullptr;        // absent for a twist
    const PartialTarget* part = nullptr; // instead: a target that leaves something free
    Vec ahead;                           // (6,) the target's own twist, or the twist; absent is none
    bool at_base = false;                // whether a twist has its linear part at the base's origin, not at the tool's
    Vec velocity;                        // (m,) joint velocity now; absent is the last command
    Vec posture;                         // (m,) joint velocity wanted where a twist leaves joints free
    bool stand = false;                  // whether to stand still
    Mat E, D;                            // more exact rows of a twist, (k, m) and (k, 6)
    Vec E_f;                             // (k,)
    const ArmState* arm = nullptr;       // as it was seen in this tick
    Vec measured_at;                     // (3,) where to measure instead
    double rise = 0;                     // in which accelerations rise to their limits [s]
    TickChanges changes;
};

// Where a row of a tick comes from.
struct RowOrigin {
    int limit;        // which of `LoopFunctions::limits`
    int pair;         // of a clearance: which pair of bodies, -1 where the row slows a joint
    double distance;  // of that pair [length]
};
struct LoopReport {
    Report report;
    std::vector<RowOrigin> rows;  // those of `LoopFunctions::limits`, which follow the rows that never change
};
// The joint velocity nearest to a wanted one that the limits allow; and the share of the wanted one that they allow.
struct NearestVelocity {
    LoopReport found;
    double share = 1;
};

class FarTarget : public std::exception {};
class NoProjector : public std::exception {};

class Loop {
  public:
    LoopSettings settings;
    std::optional<Chain> chain;

    // One tick; the state is that of the next. Throws FarTarget, or NoProjector of a form without a guard; the state is then
    // as it was.
    LoopReport tick(LoopState& state, const TickInputs& in, const LoopFunctions& functions, Workspace& w) const;
    // From joint positions `in.q` after the velocity `in.velocity`; `with_share` asks for the share, too.
    NearestVelocity nearest(Vec wanted, bool with_share, const TickInputs& in, const LoopFunctions& functions, Workspace& w) const;
};

}  // namespace iq
