#include "follower.hpp"

namespace iq {
namespace {

constexpr double IN_PLACE = 1e-6;  // a joint that is off by less is where it is wanted [rad, length]
constexpr double SAME = 1e-9;      // share of a velocity by which one is another
constexpr double PROBING = 0.5;    // of the accelerations, at which joints are asked whether they move again

class TickOfFollower {
  public:
    TickOfFollower(const Follower& follower, FollowerState& state, const Course& course, const Wish& wish, Vec measured,
                   const LoopFunctions& functions, Workspace& w)
        : follower(follower), loop(follower.loop), state(state), course(course), limits(course.limits), wish(wish),
          functions(functions), w(w), m(state.m), dt(limits.dt), measured(measured), position(state.position(), m, &w),
          velocity(state.velocity(), m, &w), acceleration(state.acceleration(), m, &w), command(state.command(), m, &w),
          change(state.change(), m, &w), off(Vec(state.sent(), m, &w) - measured), here(position - off)
    {
    }

    FollowerTick tick()
    {
        Vec v = wanted();
        bool late = state.late();
        along = course.shape && by_course() && !late;
        for (int j = 0; !along && j < m; j++) {
            const double x = limits.nearest(j, position[j], velocity[j], acceleration[j], v[j]);
            late = late || (by_course() && dt * std::abs(x - v[j]) > IN_PLACE);
            v[j] = x;
        }
        const Vec asked = corrected(v), allowed = nearest(asked);
        if (found.held && along && !wish.waited)
            return found;
        found.command = probed(allowed);
        if (!along)
            v = v + found.command - asked;
        state.set_late(late || (found.held && by_course() && !along));
        for (int j = 0; j < m; j++) {  // how hard limits braked is nothing to go on with
            change[j] = found.held ? 0 : (found.command[j] - command[j]) / dt;
            acceleration[j] = found.held ? 0 : (v[j] - velocity[j]) / dt;
            position[j] += dt * v[j];
            velocity[j] = v[j];
            command[j] = found.command[j];
        }
        state.joints.remember(measured, command, 0);
        return found;
    }

  private:
    const Follower& follower;
    const Loop& loop;
    FollowerState& state;
    const Course& course;
    const MotionLimits& limits;
    const Wish& wish;
    const LoopFunctions& functions;
    Workspace& w;
    const int m;
    const double dt;
    const Vec measured, position, velocity, acceleration, command, change;
    const Vec off, here;  // from where the joints are to where they were sent, and where they are on the motion
    bool along = false;   // whether a path's shape is kept, and the joints are on it
    FollowerTick found;

    bool by_course() const { return wish.kind == Wish::Kind::course; }

    Vec wanted()
    {
        if (by_course())
            return towards_motion();
        return going_over(wish.twist.w || wish.target ? by_law() : Vec(w, m, 0));
    }
    Vec by_law()
    {
        TickInputs in;
        in.q = position, in.feedforward = wish.twist, in.at_base = wish.at_base, in.velocity = velocity, in.acceleration_rise = follower.rise;
        in.changes.speed = wish.speed;
        in.target = wish.target ? &*wish.target : nullptr;
        in.changes.limits = &follower.free;
        JointLimits slowed;
        if (limits.velocity != follower.free.velocity) {
            slowed = follower.free, slowed.velocity = limits.velocity;
            in.changes.limits = &slowed;
        }
        std::fill(state.law.positions(), state.law.positions() + m, NAN);  // the joints are not seen to follow the law
        found.report = loop.tick(state.law, in, functions, w);
        return found.report->report.velocity;
    }
    // On the way from the velocity now to another one: dv/dt = min(A / |d|, sqrt(2 J / |d|)) d, d = x - v. All joints
    // change together, so that the direction goes straight from one twist to the next.
    Vec going_over(Vec x) const
    {
        double share = INFINITY;
        for (int j = 0; j < m; j++)
            if (x[j] != velocity[j])
                share = std::min(share, limits.towards(j, velocity[j], x[j]) / (x[j] - velocity[j]));
        return share * dt >= 1 ? x : velocity + (dt * share) * (x - velocity);
    }
    Vec towards_motion()
    {
        const double after = wish.time + dt;
        const Mat there(w, 4, course.motion->columns), now(w, 1, course.motion->columns);
        if (state.late() && wish.ease > 0) {
            Mat from(w, 3, m);  // of the motion through the ends of the last three ticks
            from[0].set(position), from[1].set(velocity + (0.5 * dt) * acceleration), from[2].set(acceleration);
            found.residual = splice(*course.motion, course.clock, limits, wish.time, from, wish.ease);
            state.set_late(!found.residual.w);
        }
        const bool late = state.late();
        if (found.residual.w) {
            course.motion->at(after, course.clock, there);
            add_polynomial(found.residual, dt, there);
        } else if (late && wish.ease > 0)  // no splice is found, and the last one is over
            course.motion->at(after, course.clock, there);
        else
            course.at(after, there);
        course.motion->at(wish.time, course.clock, now);
        found.from = now(0, now.cols - 1), found.to = there(0, there.cols - 1);
        Vec v(w, m);
        for (int j = 0; j < m; j++)
            v[j] = late ? velocity[j] + dt * limits.catching_up(j, position[j] + dt * velocity[j], velocity[j], there(0, j), there(1, j))
                        : (there(0, j) - position[j]) / dt;
        return v;
    }
    // With the way back to where the joints were sent, inside the limits of the joints.
    Vec corrected(Vec v) const
    {
        Vec x(w, m), at(w, m);
        for (int j = 0; j < m; j++) {
            const double back = std::copysign(limits.approach_speed(j, off[j], course.gain), off[j]);
            if (course.shape) {
                x[j] = v[j] + back, at[j] = measured[j];
                continue;
            }
            const double before = command[j] - velocity[j];  // what led back in the last tick
            at[j] = std::min(std::max(here[j], limits.lower[j]), limits.upper[j]);
            x[j] = limits.nearest(j, at[j], command[j], change[j], v[j] + before + dt * limits.towards(j, before, back));
        }
        const JointLimits& of = follower.braked;
        Vec speeds(w, m);
        std::copy(of.velocity.begin(), of.velocity.end(), speeds.begin());
        if (!course.shape && !of.brakes)
            return x;
        const JointBounds box = BoundsOfTick(of, at, command, speeds).bounds();
        for (int j = 0; j < m; j++)
            x[j] = std::min(std::max(x[j], box.lower[j]), box.upper[j]);
        return x;
    }
    // The velocity that all limits allow: argmin |x - c|.
    Vec nearest(Vec c)
    {
        if (!follower.beside)
            return c;
        TickInputs in;
        in.q = here, in.velocity = command, in.changes.limits = &follower.braked;
        const NearestVelocity near = loop.nearest(c, along && !wish.waited, in, functions, w);
        const Report& report = near.found.report;
        double most = 0, size = 0;
        for (int j = 0; j < m; j++)
            most = std::max(most, std::abs(report.velocity[j] - c[j])), size = std::max(size, std::abs(c[j]));
        found.held = most > SAME * size || report.status == Status::degraded || report.status == Status::held;
        if (!found.held)
            return c;
        found.report = near.found, found.share = near.share;
        return report.velocity;
    }
    // Of joints that do not respond, fast enough to show that they move again: the first command from rest is nearly zero
    // where jerk is limited.
    Vec probed(Vec c) const
    {
        const auto stuck = [&](int j) { return state.joints.unresponsive()[j] > 0; };
        double share = 0;
        for (int j = 0; j < m; j++)
            share = stuck(j) ? std::max(share, std::abs(c[j]) / (PROBING * dt * limits.acceleration[j])) : share;
        if (!(share > 0 && share < 1))
            return c;
        Vec x = c.copy();
        for (int j = 0; j < m; j++) {
            if (!stuck(j))
                continue;
            const double low = (limits.lower[j] - measured[j]) / dt, high = (limits.upper[j] - measured[j]) / dt;
            x[j] = std::min(std::max(c[j] / share, std::min(low, c[j])), std::max(high, c[j]));
        }
        return x;
    }
};

}  // namespace

void Course::at(double time, Mat r) const
{
    motion->at(time, clock, r);
    const int m = limits.joints();
    if (const double u = time - joins; u < joining)
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
    std::vector<bool> rested(state.m);
    bool believed = true;
    for (int j = 0; j < state.m; j++) {
        rested[j] = joints.unresponsive()[j] > 0;
        const double seen = joints.positions()[j], way = q[j] - seen;
        if (!std::isnan(seen) && set.revolution[j] > 0)
            q[j] = seen + std::remainder(way, set.revolution[j]);
        believed = believed && q[j] <= set.plausible_upper[j] && q[j] >= set.plausible_lower[j];
    }
    if (moved_by_others || !believed)
        std::fill(joints.positions(), joints.positions() + state.m, NAN);
    joints.observe(q, set.dt, set.revolution, set.limits.velocity);
    std::copy(q.begin(), q.end(), joints.positions());
    for (int j = 0; j < state.m; j++)
        if (rested[j] && !(joints.unresponsive()[j] > 0))  // it begins to respond at the same command as before
            state.acceleration()[j] = state.change()[j] = 0;
    if (!believed)
        std::fill(joints.positions(), joints.positions() + state.m, NAN);
    return believed;
}

FollowerTick Follower::tick(FollowerState& state, const Course& course, const Wish& wish, Vec measured,
                            const LoopFunctions& functions, Workspace& w) const
{
    return TickOfFollower(*this, state, course, wish, measured, functions, w).tick();
}

}  // namespace iq
