// A tick of an arm that follows a joint motion in time, a twist or a joint velocity, inside all limits.
//
//     v = (followed(t + dt) - q) / dt, or towards it where joints are late, or towards what the law makes of a twist
//     command = v and the way back to where the joints were sent, or the nearest velocity that the loop allows
//
// What is followed next, and what is said of it, Python decides (`paths/driver.py`).
#pragma once
#include "joint_motion.hpp"
#include "loop.hpp"
#include <memory>

namespace iq {

// What is followed, and how.
struct Course {
    MotionLimits limits;
    std::shared_ptr<const Motion> motion;
    Clock clock;
    std::vector<double> residual;   // (6, m), what is left of a splice
    double joins = 0, joining = 0;  // from when on, and for how long [s]
    double gain = 0;                // at which joints are led back to where they were sent [1/s]
    bool shape = false;             // whether a path's shape is kept: what limits forbid delays it
    double displaced = 0;           // joints farther from where they were sent have been pushed [rad, length]

    // Position, velocity, acceleration and jerk at a time into r (1 to 4, columns).
    void at(double time, Mat r) const;
};

// A value: copy, compare, pickle.
class FollowerState {
  public:
    LoopState joints;  // what was commanded and measured
    LoopState law;     // of the velocity law, which is asked for twists
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
    double* sent() { return row(ROWS); }  // where the joints were sent to be now, by the commands that show in it
    bool was_sent() { return number(SENT) > 0; }
    bool late() { return number(LATE) > 0; }  // whether joints cannot be where they are wanted, and catch up
    void set_late(bool late) { number(LATE) = late; }

    // The joints are sent to their position in this tick.
    void send() { send_to(position()); }
    // They are at other positions (m,), and were sent nowhere else.
    void begin(Vec at)
    {
        number(SENT) = 0;
        send_to(at.p);
    }

  private:
    static constexpr int ROWS = 5;
    enum { SENT, LATE, NUMBERS };  // how many positions were sent, of the last `ticks`
    double* row(int k) { return numbers.data() + k * m; }
    void send_to(const double* to);
    double& number(int which) { return numbers[numbers.size() - NUMBERS + which]; }
};

// What a follower is asked to do in a tick.
struct Wish {
    enum class Kind { course, twist, target } kind = Kind::course;
    Vec twist;              // (6,) that is wanted, or of the target; absent for zero
    bool at_base = false;   // whether the twist is a screw in base coordinates
    double speed = 1;       // the share of a twist's speed
    std::optional<Pose> target;
    double ease = 0;        // how long a splice takes that late joints look for, 0 where they do not [s]
    double time = 0;        // when the tick begins [s]
    bool waited = false;    // whether a path has waited for the limits already
};

struct FollowerTick {
    Vec command;           // (m,)
    Mat residual;          // (6, m) of a splice that ends being late; absent where there is none
    std::optional<LoopReport> report;  // of the law or, where limits forbid what is wanted, of those
    bool held = false;     // whether limits beside those of joints forbid what is wanted
    double share = 1;      // a path whose shape is kept has to wait: limits allow this share; nothing is commanded yet
    double from = 0, to = 0;  // the motion's last column, a place, before and after the tick
};

class Follower {
  public:
    // rise: in which accelerations rise to their limits [s]; beside: whether limits beside those of joints
    // may forbid a velocity.
    Follower(const Loop& loop, double rise, bool beside) : loop(loop), rise(rise), beside(beside), braked(loop.settings.limits)
    {
        free = braked;
        free.brakes = false;
        braked.rate = 1 / braked.dt;  // the joints are where they are said to be
        for (double& a : free.acceleration)
            a *= 0.5;  // it takes a while to rise
    }
    // Measured positions q (m,), by whole turns near those of the tick before; false where they cannot be true.
    bool observe(FollowerState& state, Vec q, bool moved_by_others) const;
    // A tick from measured joint positions (m,).
    FollowerTick tick(FollowerState& state, const Course& course, const Wish& wish, Vec measured, const LoopFunctions& functions,
                      Workspace& w) const;

    const Loop& loop;
    const double rise;
    const bool beside;
    JointLimits braked, free;  // the loop's; and without those of acceleration, which the follower keeps itself
};

}  // namespace iq
