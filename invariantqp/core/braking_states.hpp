// The states that arms pass while they brake to rest, and how these change with the velocity.
//
//     q_n(x) = q + dt (x + (1 - 1/N) x + (1 - 2/N) x + ...)           n ticks of braking; all joints of an arm stop in N
//     q_n(x) = q_n(y) + dt (weight (x - y) + longer grows'(x - y))     y the last velocity, braked for a tick
//
// N(x) is such that no joint brakes at more than BRAKING of its limit, but for one that reaches the end of its range.
#pragma once
#include "braking.hpp"

namespace iq {

// Share of the accelerations by which rows brake; the rest is margin for the change of their directions within a tick and
// between the states.
constexpr double BRAKING = 0.7;
// Ratio of the times of neighbouring states; at 0.5 an arm that passes a corner at full speed detects it late in one of 2000
// ticks.
constexpr double TIME_RATIO = BRAKING;
constexpr int MOST_STATES = 40;       // more than those of a million ticks

// The joints of an arm and, after them, of those around it. (M,), units SI.
struct BrakingJoints {
    std::vector<int> arm;  // which arm each is of; 0 the arm itself
    Vec speed, acceleration;  // limits; acceleration inf where a joint stops at once, 0 where it never brakes
    Vec lower, upper;
    int own;  // how many are of the arm itself
};

struct BrakingState {
    double time;  // from now [s]
    Vec q;        // (M,)
    Vec weight;   // (M,) how q changes with the velocity, in ticks
    Vec longer;   // (M,) how q changes with the share by which the ticks to a stop grow
    Vec going;    // (M,) velocities of other arms that never brake
};

struct BrakingStates {
    std::vector<BrakingState> at;  // now, then at rest and at ever earlier times until the next tick
    Vec y, grows;  // (M,) the velocity braked for a tick; by which share the ticks to a stop grow with the velocity
    Vec free[2];   // (M,) how far joint limits let another velocity be below y [0], and above it [1]
    Vec sure[2];   // (M,) the same, less what braking takes of the accelerations: certain in any state
    Vec led[2];    // (M,) the same for a row that leads out of what is too near: up to the last velocity too

    BrakingStates(const BrakingJoints& joints, Vec q, Vec before, double dt, double rate)
    {
        Workspace& w = *q.w;
        const Vec none(w, q.n, 0), others = before.copy();
        others.part(0, joints.own).fill(0);
        y = Vec(w, q.n, 0), grows = Vec(w, q.n, 0);
        at.push_back({0, q, Vec(w, q.n, 1), none, others});
        for (int up = 0; up < 2; up++)
            sure[up] = Vec(w, q.n, INFINITY), led[up] = Vec(w, q.n, INFINITY), free[up] = Vec(w, q.n, INFINITY);
        const Vec own = joints.acceleration.part(0, joints.own);
        if (std::any_of(own.begin(), own.end(), [](double a) { return std::isfinite(a); }))
            brake(joints, q, before, dt, rate);
        for (int j = 0; j < joints.own; j++)
            for (int up = 0; up < 2; up++) {
                const double sign = up ? 1 : -1, room = up ? joints.upper[j] - q[j] : q[j] - joints.lower[j];
                double most = joints.speed[j];
                if (dt > 0)
                    most = std::min({most, braking_speed(room, joints.acceleration[j], dt, rate),
                                     sign * before[j] + joints.acceleration[j] * dt});
                free[up][j] = std::max(most - sign * y[j], 0.0);
                sure[up][j] = std::min(free[up][j], sure[up][j]), led[up][j] = std::min(free[up][j], led[up][j]);
            }
    }

  private:
    // In how many ticks the joints of each arm stop together, those that do not brake by themselves: by the 8-norm,
    // nearly the most and smooth, so that no joint's brakes decide alone.
    static Vec ticks_together(const BrakingJoints& joints, Vec before, double dt, const std::vector<bool>& alone)
    {
        Vec ticks(*before.w, before.n), of_arm(*before.w, before.n, 0);
        for (int j = 0; j < before.n; j++) {
            const double a = joints.acceleration[j],
                         n = a > 0 && !alone[j] ? std::abs(before[j]) / (BRAKING * dt * a) : 0;
            of_arm[joints.arm[j]] += n * n * n * n * (n * n * n * n);
        }
        for (int j = 0; j < before.n; j++)
            ticks[j] = std::max(1.0, std::sqrt(std::sqrt(std::sqrt(of_arm[joints.arm[j]]))));
        return ticks;
    }
    void brake(const BrakingJoints& joints, Vec q, Vec before, double dt, double rate)
    {
        Workspace& w = *q.w;
        const Vec &a = joints.acceleration, whole(w, q.n), b(w, q.n), on = at[0].going.copy();
        std::vector<bool> by_range(q.n, false);  // whether a joint brakes by itself, its way ends where its range does
        Vec ticks = ticks_together(joints, before, dt, by_range);
        const auto late = [&](int j) {
            const double fast = std::abs(before[j]),
                         room = before[j] > 0 ? joints.upper[j] - q[j] : q[j] - joints.lower[j];
            return (fast - std::min(late_braking(room, fast, dt), braking_speed(room, a[j], dt, rate))) / dt;
        };
        for (int j = 0; j < q.n; j++)
            by_range[j] = a[j] > 0 && std::isfinite(a[j]) && late(j) > std::abs(before[j]) / (ticks[j] * dt);
        ticks = ticks_together(joints, before, dt, by_range);
        double most = 0;
        for (int j = 0; j < q.n; j++) {
            const double fast = std::abs(before[j]);
            const bool goes_on = a[j] == 0;
            b[j] = goes_on ? 0 : std::isinf(a[j]) ? INFINITY : by_range[j] ? late(j) : fast / (ticks[j] * dt);
            const double left = std::isinf(a[j]) ? 0 : std::max(fast - b[j] * dt, 0.0);
            whole[j] = left > 0 ? std::floor(left / (b[j] * dt) + ROUNDING) : 0;  // that y goes on, but for a rest
            y[j] = std::copysign(left, before[j]);
            if (whole[j] > 0 && !goes_on && !by_range[j]) {
                const double unit = BRAKING * a[j] * dt * (ticks[j] - 1);
                grows[j] = std::copysign(std::pow(left / unit, 7) / unit, before[j]);
            }
            if (!goes_on)
                most = std::max(most, whole[j]), on[j] = 0;
            for (int up = 0; up < 2; up++) {
                sure[up][j] = std::isinf(a[j]) ? INFINITY : std::max(a[j] * dt - b[j] * dt, 0.0);
                led[up][j] = sure[up][j] + ((up ? before[j] > 0 : before[j] < 0) ? fast - left : 0);
            }
        }
        for (double n = most; static_cast<int>(at.size()) < MOST_STATES; n = n > 1 ? std::floor(TIME_RATIO * n) : 0) {
            BrakingState state{n * dt, Vec(w, q.n), Vec(w, q.n), Vec(w, q.n), on};
            for (int j = 0; j < q.n; j++) {
                const double own = std::min(n, whole[j]),
                             lost = own > 0 ? own * b[j] * dt / std::abs(y[j]) : 0;  // of y, by then
                state.q[j] = q[j] + dt * (own + (a[j] == 0 ? 0 : 1)) * (1 - 0.5 * lost) * y[j];
                state.weight[j] = (own + 1) * (1 - (by_range[j] ? 1 : 0.5) * lost);
                state.longer[j] = (own + 1) * (by_range[j] ? 0 : 0.5) * lost * y[j];
            }
            at.push_back(state);
            if (n == 0)
                break;
        }
    }
};

}  // namespace iq
