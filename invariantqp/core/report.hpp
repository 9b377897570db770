// What a tick reports: the velocity as it may be commanded, its status, and the reasons, as numbers.
#pragma once
#include "law.hpp"

namespace iq {

// In the order of velocity/solution.py, gravest last but for "scaled" and "guarded".
enum class Status { ok, limited, guarded, scaled, degraded, held };
enum class Method { closed_form, damped, qp, hold };

// Codes of velocity/reasons.py, which has the sentences; a test compares their numbers.
enum class Code {
    none = 0,
    not_believed = 1,
    stopped = 3,
    no_velocity = 7,
    no_numbers = 8,
    moving_back = 9,
    no_motion = 10,
    states_are_old = 11,
    dt_is_wrong = 12,
    not_following = 13,
    outside = 14,
    acceleration = 15,
    rows_contradict = 16,
    tool_faster = 17,
    rows_unkept = 18,
    stuck = 19,
    rows_slowed = 20,
    rows_moved = 21,
    approach_slowed = 22,
    guarded = 23,
    few_joints = 24,
    position_alone = 25,
    missed = 26,
    moved = 27,
    at_limits = 28,
};

constexpr Code ALL_CODES[] = {
    Code::not_believed,    Code::stopped,      Code::no_velocity,   Code::no_numbers,  Code::moving_back,
    Code::no_motion,       Code::states_are_old, Code::dt_is_wrong, Code::not_following, Code::outside,
    Code::acceleration,    Code::rows_contradict, Code::tool_faster, Code::rows_unkept, Code::stuck,
    Code::rows_slowed,     Code::rows_moved,   Code::approach_slowed, Code::guarded,   Code::few_joints,
    Code::position_alone,  Code::missed,       Code::moved,         Code::at_limits};

struct Report {
    Vec velocity;  // (m,)
    Vec residual;  // (6n,) s - J x
    Status status = Status::ok;
    Method method = Method::closed_form;
    std::vector<int> active;      // joints at a bound
    std::vector<double> reasons;  // of each: its code; how many joints, rows and numbers; and these, the worst first
    double share = 1, damping = 0, guard = 0;
    Vec multipliers;  // (m,) of the joints' bounds, absent where no limit is active
    Vec row_multipliers;  // (k,) of rows, likewise
};

// Writes a reason at the end of others.
void say(std::vector<double>& to, Code code, const std::vector<int>& joints = {}, const std::vector<double>& rows = {},
         const std::vector<double>& numbers = {});
// Whether reasons have a code.
bool has(const std::vector<double>& reasons, Code code);

Report report(const Tick& tick, const Answer& answer, Workspace& w);

}  // namespace iq
