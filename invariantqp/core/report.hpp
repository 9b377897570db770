// The report of a tick: the velocity to command, its status and the reasons for it.
#pragma once
#include "law.hpp"

namespace iq {

// In the order of STATUSES and METHODS in velocity/problem.py.
enum class Status { ok, limited, guarded, scaled, degraded, held };
enum class Method { closed_form, damped, qp, hold };

// Codes of velocity/reasons.py, in its order; it has the sentences.
enum class Code {
    none, implausible_position, text, speed_zero, limit_failed, limit_nan, limit_infeasible, no_solution,
    numerical_failure, moving_back, no_motion, stale_joint_states, wrong_dt, not_following,
    outside_position_limits, acceleration_exceeded, limits_conflict, tool_speed_exceeded,
    exact_rows_inconsistent, no_progress, exact_rows_scaled, exact_rows_violated, approach_scaled, guarded,
    few_joints, position_only, twist_missed, moved_by_limits, at_limits,
};

struct Report {
    Vec velocity;  // (m,)
    Vec residual;  // (6n,) s - J x
    Status status = Status::ok;
    Method method = Method::closed_form;
    std::vector<int> active;      // joints at a bound
    std::vector<double> reasons;  // each: code; numbers of joints, rows and values; and these; the most severe first
    double scale = 1, damping = 0, guard = 0;
    Vec multipliers;  // (m,) of the joints' bounds, absent where no limit is active
    Vec row_multipliers;  // (k,) of rows, likewise
};

// Appends a reason.
void add_reason(std::vector<double>& to, Code code, const std::vector<int>& joints = {}, const std::vector<double>& rows = {},
         const std::vector<double>& numbers = {});
// Whether reasons have a code.
bool has(const std::vector<double>& reasons, Code code);

Report report(const Tick& tick, const Answer& answer, Workspace& w);

}  // namespace iq
