// Joint bounds of a tick. Inside its range a joint can always stop before the end; outside, it moves back.
//
//     |x| <= v_max,  |x - x_before| <= a dt,  D(x) = dt (x + (x - a dt) + (x - 2 a dt) + ...) + y / rate <= room
//
// D is the stopping distance of a joint that moves at x in this tick, then brakes at a until its velocity y is so low that
// it can approach the limit at the rate. velocity/limits.py has the same for planners.
#pragma once
#include "matrix.hpp"
#include "tolerances.hpp"

namespace iq {

// The largest x >= 0 with D(x) <= room.
inline double braking_speed(double room, double acceleration, double dt, double rate)
{
    if (std::isinf(room))
        return room > 0 ? INFINITY : 0;
    const double a = std::min(acceleration, LARGEST), k = 1 / (rate * dt);
    const double r = std::clamp(room, 0.0, LARGEST) / (a * dt * dt);
    const double n = std::max(std::ceil(std::sqrt(std::max(2 * r - k * k + k + 0.25, 0.0)) - k - 0.5), 0.0);
    return a * dt * (r + n * (0.5 * (n - 1) + k)) / (n + k);
}
// The next velocity under the smallest constant deceleration that stops within the room.
inline double late_braking(double room, double before, double dt)
{
    if (!(before > 0))
        return 0;
    const double d = 1 + std::clamp(room, 0.0, LARGEST) / (before * dt), n = std::max(std::ceil(2 * d - 1), 1.0);
    return n > 1 ? before * (1 - 2 * (n - d) / std::max(n * (n - 1), 1.0)) : 0;
}

// Limits of the joints, (m,) each; infinite where there is none.
struct JointLimits {
    std::vector<double> position_lower, position_upper, velocity, acceleration;
    double dt = 0, rate = 0;  // of the tick [s]; at which position limits are approached where nothing brakes [1/s]
    bool brakes = false;      // whether some acceleration is limited; where it is not, positions still leave room to stop

    // How far joint j is outside its range, negative inside.
    double outside(Vec q, int j) const { return std::max(q[j] - position_upper[j], position_lower[j] - q[j]); }
};
// (m,) each: bounds of the joint velocity, those from position limits alone, and the acceleration of joints that have to
// exceed their limit, else 0.
struct JointBounds {
    Vec lower, upper, position_lower, position_upper, exceeded;
};

class BoundsOfTick {
  public:
    // q: where the joints are; before: their velocity; speeds: their largest in this tick, at most the limits'.
    BoundsOfTick(const JointLimits& limits, Vec q, Vec before, Vec speeds)
        : limits(limits), q(q), before(before), speeds(speeds), w(*q.w)
    {
    }
    JointBounds bounds() const
    {
        const int m = q.n;
        JointBounds found{Vec(w, m), Vec(w, m), Vec(w, m), Vec(w, m), Vec(w, m, 0)};
        for (int j = 0; j < m; j++) {
            limits.brakes ? braking(j, found) : boxed(j, found);
            if (limits.velocity[j] == 0)  // a joint that is locked has one position
                found.position_lower[j] = found.position_upper[j] = 0;
        }
        return found;
    }

  private:
    const JointLimits& limits;
    const Vec q, before, speeds;
    Workspace& w;

    void boxed(int j, JointBounds& to) const
    {
        const double most = speeds[j], low = -stopping(q[j] - limits.position_lower[j], limits.acceleration[j]);
        const double high = stopping(limits.position_upper[j] - q[j], limits.acceleration[j]);
        to.lower[j] = std::min(std::max(low, -most), most), to.upper[j] = std::max(std::min(high, most), -most);
        to.position_lower[j] = std::min(low, most), to.position_upper[j] = std::max(high, -most);
    }
    // Towards a position limit, or back inside where the room is below zero.
    double stopping(double room, double a) const
    {
        return a < INFINITY && room > 0 ? braked(room, a) : limits.rate * room;
    }
    double braked(double room, double a) const { return braking_speed(room, a, limits.dt, limits.rate); }
    // The least and the largest velocity towards a limit `room` away, `behind` from the opposite one.
    std::pair<double, double> towards(double room, double behind, double now, double a) const
    {
        const double slowest = now - a * limits.dt;
        double most;
        if (room >= 0) {
            most = braked(room, a);
            if (most < slowest)
                most = std::min(late_braking(room, now, limits.dt), slowest);
        } else
            most = std::min(std::max(-std::min(braked(-room, a), braked(behind, a)), slowest), 0.0);
        return {std::min(slowest, most), most};
    }
    void braking(int j, JointBounds& to) const
    {
        const double a = limits.acceleration[j], step = a * limits.dt, most = speeds[j];
        const double ahead = limits.position_upper[j] - q[j], behind = q[j] - limits.position_lower[j];
        const auto up = towards(ahead, behind, before[j], a), down = towards(behind, ahead, -before[j], a);
        const double low = to.lower[j] = std::min(std::max(std::max(up.first, -down.second), -most), most);
        const double high = std::max(std::min(up.second, -down.first), -most);
        to.upper[j] = std::max(std::min(high, most), low);
        to.position_lower[j] = std::min(low, -braked(behind, a));
        to.position_upper[j] = std::max(to.upper[j], braked(ahead, a));
        const double rounding = ROUNDING * (1 + std::abs(before[j]) + (std::isfinite(step) ? step : 0));
        const double change = std::max(low - before[j], before[j] - to.upper[j]);
        to.exceeded[j] = change - step > rounding ? change / limits.dt : 0;
    }
};

}  // namespace iq
