// The control loop: measured joint positions and a target or a twist in, a joint velocity inside all limits out.
//
//     s = b gain log(T_target T^-1) + feedforward,     velocity = law(J(q), s, limits(q))
//
// b <= 1 lets joints brake before the target within their acceleration limits. target.hpp has the error of targets with
// free degrees of freedom. All poses and twists are in the base frame.
#pragma once
#include "braking.hpp"
#include "clearance.hpp"
#include "demands.hpp"
#include "joints.hpp"
#include <functional>
#include <optional>

namespace iq {

// The measure of twists: a point (3,) of the tool and a length [length/rad], or a root (6, 6) in base or tool coordinates.
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

// The constant settings of a loop; absent arrays are empty.
struct LoopSettings {
    int joints = 0;
    double dt = 0, delay = 0, gain = 0;  // [s], [s], [1/s]
    Measure measure;
    double error_tolerance = 0;  // a measured error that may remain at position limits [length]
    JointLimits limits;
    std::vector<double> plausible_lower, plausible_upper;  // (m,) positions outside are rejected as wrong
    std::vector<double> position_lower, position_upper;  // (m,) of the robot, for the report of rejected positions
    std::vector<double> revolution;  // (m,) a whole turn of continuous joints, else 0
    Vec3 reach_centre{};             // the tool position in the middle of the joint range;
    double reach = INFINITY;         // targets farther away from it are rejected [length]
    ToolSpeed tool_speed;
    RowsOfLimits rows;                  // the same in every tick
    std::vector<Demand> exact;
    int exact_rank = 0;  // of the exact rows away from singularities
    std::vector<double> posture, posture_gain;  // (m,) joint positions, and gains [1/s]
    std::vector<double> metric;         // (m, m)
    FormKind form = FormKind::none;
    double pitch = 0, damping = 0, guard = -1;
    std::vector<double> form_matrix;  // (6, c)
};

// The kinematic state of the arm in a tick.
struct ArmState {
    Mat J;  // (6, m)
    Pose tool;
};
// Overrides of the settings in one tick.
struct TickChanges {
    double speed = 1;  // scale of the whole motion, from 0 to 1
    const JointLimits* limits = nullptr;
    const ToolSpeed* tool_speed = nullptr;
};
// Rows of one limit in one tick; none where C is empty.
struct RowsOfTick {
    Mat C;
    Vec lower, upper;
};
// A limit whose rows change in each tick: a clearance, or user functions.
struct RowLimit {
    ClearanceInLoop* clearance = nullptr;
    // Rows at joint positions and the last velocity; absent if no velocity is known to be safe.
    std::function<std::optional<RowsOfTick>(Vec q, Vec last_velocity)> rows;
    // Further rows if the velocity x violates the limit before the end of the tick. Optional.
    std::function<RowsOfTick(Vec q, Vec x)> after;
};
// User functions; each may be absent.
struct LoopFunctions {
    std::function<ArmState(Vec q, Workspace&)> arm;      // kinematics of a robot that is no Chain
    std::vector<RowLimit> limits;                        // in the order of their rows
    // Sets E, D and E_f to exact rows at a gain [1/s] and the feedforward; `nearest` is the pose nearest to a target with
    // free degrees of freedom, else null.
    std::function<void(Vec q, double gain, Vec feedforward, const Pose* nearest, Tick&)> exact;
    std::function<Answer(const Tick&)> law;  // solves the tick in place of the engine

    // To be called once a tick, with the measured joint positions.
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
    const PartialTarget* part = nullptr; // a target with free degrees of freedom instead
    Vec feedforward;                     // (6,) twist of the target, or the commanded twist; absent is zero
    bool at_base = false;                // a commanded twist is a screw in base coordinates, not the tool point's velocity
    Vec velocity;                        // (m,) measured joint velocity; absent is the last command
    Vec posture;                         // (m,) desired joint velocity in the null space
    bool stand_still = false;
    Mat E, D;                            // additional exact rows, (k, m) and (k, 6)
    Vec E_f;                             // (k,)
    const ArmState* arm = nullptr;       // if it is known already
    Vec measured_at;                     // (3,) replaces the point of the measure
    double acceleration_rise = 0;        // time in which accelerations rise to their limits [s]
    TickChanges changes;
};

// The origin of a row of a tick.
struct RowOrigin {
    int limit;        // which of `LoopFunctions::limits`
    int pair;         // of a clearance: the pair of bodies, -1 for a row that slows a joint
    double distance;  // of that pair [length]
};
struct LoopReport {
    Report report;
    std::vector<RowOrigin> rows;  // of `LoopFunctions::limits`, which follow the constant rows
};
// The feasible joint velocity nearest to a desired one, and the feasible share of the desired one.
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

    // One tick; updates the state. Throws FarTarget, or NoProjector for a form without a guard, and leaves the state.
    LoopReport tick(LoopState& state, const TickInputs& in, const LoopFunctions& functions, Workspace& w) const;
    // At joint positions `in.q` and last velocity `in.velocity`; computes the share only `with_share`.
    NearestVelocity nearest(Vec wanted, bool with_share, const TickInputs& in, const LoopFunctions& functions, Workspace& w) const;
};

}  // namespace iq
