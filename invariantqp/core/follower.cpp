#include "follower.hpp"

namespace iq {
namespace {

constexpr double ON_MOTION = 1e-6;  // a joint within this of the motion is on it [rad, length]
constexpr double SAME = 1e-9;       // relative difference of equal velocities
constexpr double PROBING = 0.5;     // share of the accelerations at which unresponsive joints are probed

class TickOfFollower {
  public:
    TickOfFollower(const Follower& follower, FollowerState& state, const TrackedMotion& tracked, const TickGoal& goal, Vec measured,
                   const LoopFunctions& functions, Workspace& w)
        : follower(follower), loop(follower.loop), state(state), tracked(tracked), limits(tracked.limits), goal(goal),
          functions(functions), w(w), m(state.m), dt(limits.dt), measured(measured), position(state.position(), m, &w),
          velocity(state.velocity(), m, &w), acceleration(state.acceleration(), m, &w), command(state.command(), m, &w),
          change(state.change(), m, &w), error(Vec(state.sent(), m, &w) - measured), here(position - error)
    {
    }

    FollowerTick tick()
    {
        Vec v = desired_velocity();
        bool late = state.late();
        on_path = tracked.keeps_shape && by_motion() && !late;
        for (int j = 0; !on_path && j < m; j++) {
            const double x = limits.admissible_velocity(j, position[j], velocity[j], acceleration[j], v[j]);
            late = late || (by_motion() && dt * std::abs(x - v[j]) > ON_MOTION);
            v[j] = x;
        }
        const Vec desired = corrected(v), allowed = nearest(desired);
        if (result.is_limited && on_path && !goal.has_waited)
            return result;
        result.command = with_probe(allowed);
        if (!on_path)
            v = v + result.command - desired;
        state.set_late(late || (result.is_limited && by_motion() && !on_path));
        for (int j = 0; j < m; j++) {  // a braking imposed by limits is not extrapolated
            change[j] = result.is_limited ? 0 : (result.command[j] - command[j]) / dt;
            acceleration[j] = result.is_limited ? 0 : (v[j] - velocity[j]) / dt;
            position[j] += dt * v[j];
            velocity[j] = v[j];
            command[j] = result.command[j];
        }
        state.joints.remember(measured, command, 0);
        return result;
    }

  private:
    const Follower& follower;
    const Loop& loop;
    FollowerState& state;
    const TrackedMotion& tracked;
    const MotionLimits& limits;
    const TickGoal& goal;
    const LoopFunctions& functions;
    Workspace& w;
    const int m;
    const double dt;
    const Vec measured, position, velocity, acceleration, command, change;
    const Vec error, here;  // tracking error; the motion's position less that
    bool on_path = false;   // whether a path's shape is kept, and the joints are on it
    FollowerTick result;

    bool by_motion() const { return goal.kind == TickGoal::Kind::motion; }

    Vec desired_velocity()
    {
        if (by_motion())
            return towards_motion();
        return rate_limited(goal.twist.w || goal.target ? by_law() : Vec(w, m, 0));
    }
    Vec by_law()
    {
        TickInputs in;
        in.q = position, in.feedforward = goal.twist, in.at_base = goal.at_base, in.velocity = velocity, in.acceleration_rise = follower.rise;
        in.changes.speed = goal.speed;
        in.target = goal.target ? &*goal.target : nullptr;
        in.changes.limits = &follower.free;
        JointLimits slowed;
        if (limits.velocity != follower.free.velocity) {
            slowed = follower.free, slowed.velocity = limits.velocity;
            in.changes.limits = &slowed;
        }
        std::fill(state.law.positions(), state.law.positions() + m, NAN);  // the joints do not respond to the law's commands
        result.report = loop.tick(state.law, in, functions, w);
        return result.report->report.velocity;
    }
    // Towards another velocity, rate limited: dv/dt = min(A / |d|, sqrt(2 J / |d|)) d, d = x - v. All joints
    // change together, so that the direction goes straight from one twist to the next.
    Vec rate_limited(Vec x) const
    {
        double share = INFINITY;
        for (int j = 0; j < m; j++)
            if (x[j] != velocity[j])
                share = std::min(share, limits.acceleration_towards(j, velocity[j], x[j]) / (x[j] - velocity[j]));
        return share * dt >= 1 ? x : velocity + (dt * share) * (x - velocity);
    }
    Vec towards_motion()
    {
        const double after = goal.time + dt;
        const Mat there(w, 4, tracked.motion->columns), now(w, 1, tracked.motion->columns);
        if (state.late() && goal.splice_time > 0) {
            Mat from(w, 3, m);  // of the motion through the ends of the last three ticks
            from[0].set(position), from[1].set(velocity + (0.5 * dt) * acceleration), from[2].set(acceleration);
            result.residual = splice(*tracked.motion, tracked.clock, limits, goal.time, from, goal.splice_time);
            state.set_late(!result.residual.w);
        }
        const bool late = state.late();
        if (result.residual.w) {
            tracked.motion->at(after, tracked.clock, there);
            add_polynomial(result.residual, dt, there);
        } else if (late && goal.splice_time > 0)  // no splice is found, and the last one is over
            tracked.motion->at(after, tracked.clock, there);
        else
            tracked.at(after, there);
        tracked.motion->at(goal.time, tracked.clock, now);
        result.place_before = now(0, now.cols - 1), result.place_after = there(0, there.cols - 1);
        Vec v(w, m);
        for (int j = 0; j < m; j++)
            v[j] = late ? velocity[j] + dt * limits.catch_up_acceleration(j, position[j] + dt * velocity[j], velocity[j], there(0, j), there(1, j))
                        : (there(0, j) - position[j]) / dt;
        return v;
    }
    // With the correction of the tracking error, inside the limits of the joints.
    Vec corrected(Vec v) const
    {
        Vec x(w, m), at(w, m);
        for (int j = 0; j < m; j++) {
            const double back = std::copysign(limits.approach_speed(j, error[j], tracked.gain), error[j]);
            if (tracked.keeps_shape) {
                x[j] = v[j] + back, at[j] = measured[j];
                continue;
            }
            const double before = command[j] - velocity[j];  // the correction in the last tick
            at[j] = std::min(std::max(here[j], limits.lower[j]), limits.upper[j]);
            x[j] = limits.admissible_velocity(j, at[j], command[j], change[j], v[j] + before + dt * limits.acceleration_towards(j, before, back));
        }
        const JointLimits& of = follower.braked;
        Vec speeds(w, m);
        std::copy(of.velocity.begin(), of.velocity.end(), speeds.begin());
        if (!tracked.keeps_shape && !of.brakes)
            return x;
        const JointBounds box = BoundsOfTick(of, at, command, speeds).bounds();
        for (int j = 0; j < m; j++)
            x[j] = std::min(std::max(x[j], box.lower[j]), box.upper[j]);
        return x;
    }
    // The velocity that all limits allow: argmin |x - c|.
    Vec nearest(Vec c)
    {
        if (!follower.has_other_limits)
            return c;
        TickInputs in;
        in.q = here, in.velocity = command, in.changes.limits = &follower.braked;
        const NearestVelocity near = loop.nearest(c, on_path && !goal.has_waited, in, functions, w);
        const Report& report = near.found.report;
        double most = 0, size = 0;
        for (int j = 0; j < m; j++)
            most = std::max(most, std::abs(report.velocity[j] - c[j])), size = std::max(size, std::abs(c[j]));
        result.is_limited = most > SAME * size || report.status == Status::degraded || report.status == Status::held;
        if (!result.is_limited)
            return c;
        result.report = near.found, result.allowed_share = near.share;
        return report.velocity;
    }
    // Unresponsive joints are commanded fast enough to show that they move again: the first command from rest is nearly
    // zero where jerk is limited.
    Vec with_probe(Vec c) const
    {
        const auto is_unresponsive = [&](int j) { return state.joints.unresponsive()[j] > 0; };
        double share = 0;
        for (int j = 0; j < m; j++)
            share = is_unresponsive(j) ? std::max(share, std::abs(c[j]) / (PROBING * dt * limits.acceleration[j])) : share;
        if (!(share > 0 && share < 1))
            return c;
        Vec x = c.copy();
        for (int j = 0; j < m; j++) {
            if (!is_unresponsive(j))
                continue;
            const double low = (limits.lower[j] - measured[j]) / dt, high = (limits.upper[j] - measured[j]) / dt;
            x[j] = std::min(std::max(c[j] / share, std::min(low, c[j])), std::max(high, c[j]));
        }
        return x;
    }
};

}  // namespace

void TrackedMotion::at(double time, Mat r) const
{
    motion->at(time, clock, r);
    const int m = limits.joints();
    if (const double u = time - splice_start; u < splice_duration)
        add_polynomial({const_cast<double*>(residual.data()), 6, m, r.w}, std::max(u, 0.0), r);
}

void FollowerState::send_to(const double* to)
{
    const int kept = std::min(static_cast<int>(number(SENT)), ticks - 1), first = static_cast<int>(number(SENT)) - kept;
    std::copy(row(ROWS + first), row(ROWS + first + kept), row(ROWS));
    std::copy(to, to + m, row(ROWS + kept));
    number(SENT) = kept + 1;
}

bool Follower::observe(FollowerState& state, Vec q, bool moved_by_others) const
{
    const LoopSettings& set = loop.settings;
    LoopState& joints = state.joints;
    std::vector<bool> was_unresponsive(state.m);
    bool plausible = true;
    for (int j = 0; j < state.m; j++) {
        was_unresponsive[j] = joints.unresponsive()[j] > 0;
        const double seen = joints.positions()[j], way = q[j] - seen;
        if (!std::isnan(seen) && set.revolution[j] > 0)
            q[j] = seen + std::remainder(way, set.revolution[j]);
        plausible = plausible && q[j] <= set.plausible_upper[j] && q[j] >= set.plausible_lower[j];
    }
    if (moved_by_others || !plausible)
        std::fill(joints.positions(), joints.positions() + state.m, NAN);
    joints.observe(q, set.dt, set.revolution, set.limits.velocity);
    std::copy(q.begin(), q.end(), joints.positions());
    for (int j = 0; j < state.m; j++)
        if (was_unresponsive[j] && !(joints.unresponsive()[j] > 0))  // it responds to the same command as before
            state.acceleration()[j] = state.change()[j] = 0;
    if (!plausible)
        std::fill(joints.positions(), joints.positions() + state.m, NAN);
    return plausible;
}

FollowerTick Follower::tick(FollowerState& state, const TrackedMotion& tracked, const TickGoal& goal, Vec measured,
                            const LoopFunctions& functions, Workspace& w) const
{
    return TickOfFollower(*this, state, tracked, goal, measured, functions, w).tick();
}

}  // namespace iq
