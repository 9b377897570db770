// A tick of an arm that tracks a joint motion in time, a twist or a target, inside all limits.
//
//     v = (motion(t + dt) - q) / dt, or towards it where joints are late, or towards the law's velocity of a twist
//     command = v and a correction of the tracking error, or the nearest velocity that the loop's limits allow
//
// Python decides what is tracked next and reports the tick (`paths/follower.py`).
#pragma once
#include "joint_motion.hpp"
#include "loop.hpp"
#include <memory>

namespace iq {

// A joint motion, the splice to it, and how it is tracked.
struct TrackedMotion {
    MotionLimits limits;
    std::shared_ptr<const Motion> motion;
    Clock clock;
    std::vector<double> residual;                  // (6, m) of the splice
    double splice_start = 0, splice_duration = 0;  // [s]
    double gain = 0;                               // of the tracking error [1/s]
    bool keeps_shape = false;                      // whether it is delayed where limits forbid it
    double pushed_beyond = 0;                      // tracking error of joints that have been pushed [rad, length]

    // Position, velocity, acceleration and jerk at a time into r (1 to 4, columns).
    void at(double time, Mat r) const;
};

// The state of the joints between ticks; a value: copy, compare, pickle.
class FollowerState {
  public:
    LoopState joints;  // commanded and measured
    LoopState law;     // of the velocity law of twists
    int m, ticks;      // joints; commands take so many ticks to show in positions
    std::vector<double> numbers;

    FollowerState(int m, double delay, double dt)
        : joints(m, delay, dt), law(m, 0, dt), m(m), ticks(static_cast<int>(std::lround(delay / dt)) + 1),
          numbers(static_cast<std::size_t>(m) * (ROWS + ticks) + NUMBERS, 0)
    {
    }
    // (m,) of the motion, when the next tick begins
    double* position() { return row(0); }
    double* velocity() { return row(1); }
    double* acceleration() { return row(2); }
    double* command() { return row(3); }  // in the last tick
    double* change() { return row(4); }   // of the command, in the last tick, over the tick
    double* sent() { return row(ROWS); }  // where the joints should be now, by the commands that show in it
    bool was_sent() { return number(SENT) > 0; }
    bool late() { return number(LATE) > 0; }  // whether joints catch up with the motion
    void set_late(bool late) { number(LATE) = late; }

    // The joints are sent to their position in this tick.
    void send() { send_to(position()); }
    // The joints are at other positions (m,); earlier commands no longer count.
    void begin(Vec at)
    {
        number(SENT) = 0;
        send_to(at.p);
    }

  private:
    static constexpr int ROWS = 5;
    enum { SENT, LATE, NUMBERS };  // how many of the last `ticks` positions were sent
    double* row(int k) { return numbers.data() + k * m; }
    void send_to(const double* to);
    double& number(int which) { return numbers[numbers.size() - NUMBERS + which]; }
};

// The goal of a tick.
struct TickGoal {
    enum class Kind { motion, twist, target } kind = Kind::motion;
    Vec twist;                // (6,) wanted, or of the target; absent for zero
    bool at_base = false;     // whether the twist is a screw in base coordinates
    double speed = 1;         // the share of a twist's speed
    std::optional<Pose> target;
    double splice_time = 0;   // of a splice that late joints look for, 0 for none [s]
    double time = 0;          // when the tick begins [s]
    bool has_waited = false;  // whether a path has waited for the limits already
};

struct FollowerTick {
    Vec command;                               // (m,)
    Mat residual;                              // (6, m) of a splice that late joints take; absent for none
    std::optional<LoopReport> report;          // of the law or, where limits forbid the goal, of those
    bool is_limited = false;                   // whether limits beside those of joints forbid the goal
    double allowed_share = 1;                  // of the tick, by the limits, where a path has to wait: there is no command
    double place_before = 0, place_after = 0;  // the motion's last column before and after the tick
};

class Follower {
  public:
    // rise: in which accelerations rise to their limits [s]; has_other_limits: whether limits beside those of joints
    // may forbid a velocity.
    Follower(const Loop& loop, double rise, bool has_other_limits)
        : loop(loop), rise(rise), has_other_limits(has_other_limits), braked(loop.settings.limits)
    {
        free = braked;
        free.brakes = false;
        braked.rate = 1 / braked.dt;  // the measured positions are exact
        for (double& a : free.acceleration)
            a *= 0.5;  // it takes a while to rise
    }
    // Measured positions q (m,), by whole turns near those of the tick before; false where they are implausible.
    bool observe(FollowerState& state, Vec q, bool moved_by_others) const;
    // A tick from measured joint positions (m,).
    FollowerTick tick(FollowerState& state, const TrackedMotion& tracked, const TickGoal& goal, Vec measured,
                      const LoopFunctions& functions, Workspace& w) const;

    const Loop& loop;
    const double rise;
    const bool has_other_limits;
    JointLimits braked, free;  // the loop's; and without those of acceleration, which the follower keeps itself
};

}  // namespace iq
