// Joint motions in time: limits of position, velocity, acceleration and jerk, and polynomials that keep them.
//
//     v = v_before + dt a,    |v| <= V,   |a| <= A,   |a - a_before| <= J dt,    lower <= q <= upper
//     followed(t) = motion(clock(t)) + residual(t)
//
// The residual is a quintic from the jump in position, velocity and acceleration at a splice to zero.
#pragma once
#include "matrix.hpp"
#include <array>

namespace iq {

// Limits of m joints, (m,) each, infinite where there is none; and the tick [s].
struct MotionLimits {
    std::vector<double> lower, upper, velocity, acceleration, jerk;
    double dt = 0;

    int joints() const { return static_cast<int>(lower.size()); }
    // The largest share of its limits that joint j uses; 2 and more where it leaves the range.
    double utilisation(int j, double x, double v, double a, double jerk) const;
    // The same of all joints, at position, velocity, acceleration and jerk (4, m or more).
    double utilisation(Mat r) const;
    // The acceleration that brings a velocity to another one in least time, inside the jerk limit.
    double acceleration_towards(int j, double velocity, double wanted) const;
    // The speed of a joint that stops after a distance: at a gain [1/s] where that is small.
    double approach_speed(int j, double distance, double gain) const;
    // The largest speed of a joint that moves a distance from rest to rest, nearly.
    double peak_speed(int j, double distance) const;
    // The acceleration that brings a joint in least time to a motion, which is `there` at a speed.
    double catch_up_acceleration(int j, double position, double velocity, double there, double speed) const;
    // The acceleration of a tick nearest the wanted one, after which the joint can still stop; v, a: of the tick before.
    double admissible_acceleration(int j, double q, double v, double a, double wanted) const;
    // The velocity of a tick nearest the wanted one; to rounding that itself.
    double admissible_velocity(int j, double q, double v, double a, double wanted) const;
};

// Time scaling of a motion: its rate changes to another one by a cubic, and stays there.
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
    double late_until = -INFINITY;          // until then it is off its points, which the joints cannot reach in time

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
// The motion from a state (3, m) at a time near points (n, m) at times (n,) after it, with little jerk.
Motion smoothed_motion(const MotionLimits& limits, Mat state, double now, Vec times, Mat points, double smoothing_time, int pieces);
// The clock that changes its rate at a time to another one in the least time that limits of all columns allow.
Clock rate_change(const Motion& motion, const Clock& clock, const MotionLimits& limits, double time, double final, Workspace& w);

}  // namespace iq
