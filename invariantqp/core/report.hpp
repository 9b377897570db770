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
    moving_back = 13,
    no_motion = 14,
    states_are_old = 15,
    dt_is_wrong = 16,
    not_following = 17,
    outside = 18,
    acceleration = 19,
    rows_contradict = 20,
    tool_faster = 21,
    rows_unkept = 23,
    stuck = 27,
    rows_slowed = 28,
    rows_moved = 29,
    approach_slowed = 30,
    guarded = 31,
    few_joints = 34,
    position_alone = 35,
    missed = 36,
    moved = 37,
    at_limits = 38,
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

Report report(const Tick& tick, const Answer& answer, Workspace& w);

}  // namespace iq
