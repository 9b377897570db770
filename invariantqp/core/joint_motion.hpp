// Joint motions in time: limits of position, velocity, acceleration and jerk, and polynomials that keep them.
//
//     v = v_before + dt a,    |v| <= V,   |a| <= A,   |a - a_before| <= J dt,    lower <= q <= upper
//     followed(t) = motion(clock(t)) + residual(t)
//
// The residual is a quintic from a jump in position, velocity and acceleration to zero.
#pragma once
#include "matrix.hpp"
#include <array>

namespace iq {

// Limits of m joints, (m,) each, infinite where there is none; and the tick [s].
struct MotionLimits {
    std::vector<double> lower, upper, velocity, acceleration, jerk;
    double dt = 0;

    int joints() const { return static_cast<int>(lower.size()); }
    // The largest share of a limit of joint j that a motion needs; 2 and more where it leaves the range.
    double needed(int j, double x, double v, double a, double jerk) const;
    // The same of all joints, at position, velocity, acceleration and jerk (4, m or more).
    double needed(Mat r) const;
    // The acceleration that brings a velocity to another one soonest, jerk taking it back in time.
    double towards(int j, double velocity, double wanted) const;
    // The speed at which a joint goes a way, and stops at its end: at a gain [1/s] where that is little.
    double approach_speed(int j, double way, double gain) const;
    // The largest speed of a joint that catches up a way from rest to rest, nearly.
    double peak(int j, double way) const;
    // The acceleration that brings a joint soonest to a motion, which is `there` at a speed.
    double catching_up(int j, double position, double velocity, double there, double speed) const;
    // The acceleration of a tick nearest the wanted one, after which the joint can still stop; v, a: of the tick before.
    double within(int j, double q, double v, double a, double wanted) const;
    // The velocity of a tick nearest the wanted one; to rounding that itself.
    double nearest(int j, double q, double v, double a, double wanted) const;
};

// How fast the time of a motion runs: from one rate to another by a cubic, then on at that.
struct Clock {
    double start = 0;     // when the rate begins to change [s]
    double first = 0;     // the motion's time then
    double rate = 1;
    double slope = 0;     // of the rate
    double final = 1;     // the rate in the end
    double duration = 0;  // of the change [s]

    // The motion's time, its rate, the rate's slope, and the slope's slope.
    std::array<double, 4> at(double time) const;
};

// Polynomials of time, piece by piece; at rest before the first and after the last.
struct Motion {
    int columns = 0, powers = 0;
    std::vector<double> knots;         // (n + 1,) [s]
    std::vector<double> coefficients;  // (n, powers, columns) of the time since each piece began, from the constant on
    double eased = -INFINITY;          // until then it is not where it is wanted to be, as joints cannot

    int pieces() const { return static_cast<int>(knots.size()) - 1; }
    // Position, velocity, acceleration and jerk, or the first rows of these, into r (1 to 4, columns).
    void at(double time, Mat r) const;
    void at(double time, const Clock& clock, Mat r) const;
};

// Adds a polynomial (powers, m) of u and its derivatives to r (1 to 4, m or more).
void add_polynomial(Mat powers, double u, Mat r);
// The quintic (6, m) from position, velocity and acceleration (3, m) to zero in a duration.
Mat quintic(Mat jump, double duration);
// The quintic from a state (3, m) at a time over to a motion, in a duration; absent where that leaves the limits.
Mat splice(const Motion& motion, const Clock& clock, const MotionLimits& limits, double time, Mat state, double duration);
// The motion from a state (3, m) at a time that is near points (n, m) at times (n,) after it, with little jerk.
Motion planned(const MotionLimits& limits, Mat state, double now, Vec times, Mat points, double calm, int pieces);
// The clock that goes over from its rate at a time to another one as soon as limits of all columns allow.
Clock turned(const Motion& motion, const Clock& clock, const MotionLimits& limits, double time, double final, Workspace& w);

}  // namespace iq
