#include "loop.hpp"
#include "measure.hpp"
#include <stdexcept>

namespace iq {
namespace {

// Share of the acceleration limits used to brake before the target; the rest is margin for the changing Jacobian.
constexpr double BRAKING_SHARE = 0.5;
// Damping of joint distances to the target and of joint velocities for the feedforward, relative to |A|^2.
constexpr double DISTANCE_DAMPING = 1e-3, FEEDFORWARD_DAMPING = DISTANCE_DAMPING * DISTANCE_DAMPING;
constexpr double TOLERANCE_GAIN = 10;      // largest gain by which the tolerated error becomes a tolerated twist [1/s]
constexpr double ENCODER_TOLERANCE = 1e-3; // a joint farther outside its range is reported [rad, length]
constexpr int MOST_RESOLVES = 4;           // a tick is solved again while its velocity violates a limit before its end

Twist twist(Vec s) { return {vec3(s.part(0, 3)), vec3(s.part(3, 6))}; }

// The error twist with the sense of rotation of the last tick, if it is nearly half a turn.
Twist same_sense(const double* last, const Twist& error)
{
    const double ratio = sense_factor(error.omega, {last[0], last[1], last[2]});
    if (ratio == 1)
        return error;
    const Vec3 axis = (1 / norm(error.omega)) * error.omega;
    const double slide = dot(axis, error.v);
    return {ratio * error.omega, ratio * error.v + ((1 - ratio) * slide) * axis};
}

// Minimises |A x - b|^2 + share |A|^2 |x|^2.
Vec damped_least_squares(Mat A, Vec b, double share)
{
    Mat S = A * t(A);
    const double least = share * A.all().square();
    for (int i = 0; i < S.rows; i++)
        S(i, i) += least > 0 ? least : 1;
    const Mat U = cholesky(S);
    return t(A) * solved(U, solved(t(U), b));
}

class TickOfLoop {
  public:
    TickOfLoop(const Loop& loop, LoopState& saved, const TickInputs& in, const LoopFunctions& functions, Workspace& w)
        : loop(loop), set(loop.settings), saved(saved), state(saved), in(in), functions(functions), w(w), m(set.joints),
          limits(in.changes.limits ? *in.changes.limits : set.limits), brakes(limits.brakes ? limits : set.limits),
          speed(in.changes.speed), q(w, m), last_velocity(w, m)
    {
    }

    LoopReport solve()
    {
        Report found = report();
        return {std::move(found), std::move(origins)};
    }

    NearestVelocity nearest(Vec desired, bool with_share)
    {
        q = in.q, last_velocity = in.velocity;
        arm = functions.arm ? functions.arm(q, w) : arm_state();
        tick.J = arm.J;  // for the tool's speed
        set_bounds();
        if (!set_limit_rows()) {
            tick.root = root(), tick.feedforward = tick.error = Vec(w, 6, 0);
            return {{stand_still(), std::move(origins)}, 0};
        }
        set_exact(arm.tool, 0, {}, arm.J * desired);
        tick.D = Mat();  // below, joint velocities take the place of twists, six joints a body
        const int size = 6 * ((m - 1) / 6 + 1);
        tick.J = Mat(w, size, m, 0), tick.root = Mat::identity(w, size), tick.feedforward = Vec(w, size, 0), tick.error = Vec(w, size, 0);
        for (int j = 0; j < m; j++)
            tick.J(j, j) = 1, tick.feedforward[j] = desired[j];
        const Report report = solve_tick();
        double share = 1;
        if (with_share) {
            Tick all = tick;
            all.E = Mat::identity(w, m), all.E_f = desired, all.E_e = Vec(w, m, 0);
            share = velocity(all, w).scale;
        }
        return {{finished(report), std::move(origins)}, share};
    }

  private:
    const Loop& loop;
    const LoopSettings& set;
    LoopState& saved;  // is written at the end
    LoopState state;
    const TickInputs& in;
    const LoopFunctions& functions;
    Workspace& w;
    const int m;
    const JointLimits &limits, &brakes;  // of this tick; those with the accelerations for braking
    const double speed;
    Vec q, last_velocity;  // when the command acts
    ArmState arm;
    Tick tick;
    JointBounds bounds;
    std::vector<RowOrigin> origins;

    Report report()
    {
        state.observe(in.q, set.dt, set.revolution, set.limits.velocity);
        Vec command(w, m);
        state.predict(in.q, set.dt, q, command);
        last_velocity = in.velocity.w ? in.velocity : command;
        const int joint = implausible_joint();
        if (joint >= 0)
            return stopped(joint);
        arm = in.arm ? *in.arm : functions.arm ? functions.arm(q, w) : arm_state();
        if (norm(target_position() - set.reach_centre) > set.reach)
            throw FarTarget();
        tick.J = arm.J;
        tick.root = root();
        if (in.part)
            measure_part();
        tick.last_velocity = command;
        tick.metric = set.metric.empty() ? Mat() : view(set.metric, m, m, w);
        tick.form = set.form, tick.pitch = set.pitch, tick.damping = set.damping, tick.guard = set.guard;
        if (!set.form_matrix.empty())
            tick.form_matrix = view(set.form_matrix, 6, static_cast<int>(set.form_matrix.size() / 6), w);
        set_bounds();
        const bool safe = set_limit_rows(), stands = in.stand_still || speed == 0 || !safe;
        set_demand();
        if (stands)
            return stand_still();
        scale_demand();
        return finished(solve_tick());
    }

    // The joint with the most implausible position, -1 for none.
    int implausible_joint() const
    {
        int found = -1;
        double most = 0;
        for (int j = 0; j < m; j++)
            if (const double by = std::max(in.q[j] - set.plausible_upper[j], set.plausible_lower[j] - in.q[j]); by > most)
                most = by, found = j;
        return found;
    }
    ArmState arm_state() const
    {
        const Mat J(w, 6, m);
        return {J, loop.chain->state(q.p, J)};
    }
    Mat root() const
    {
        const Measure& by = set.measure;
        if (by.kind == Measure::Kind::point || by.kind == Measure::Kind::own_point) {
            const Vec at = in.measured_at.w ? in.measured_at
                           : by.kind == Measure::Kind::point ? vec(arm.tool * by.point, w)
                                                             : own_point(transposed(arm.J), Vec(w, 6, 0));
            return root_at(at, by.length);
        }
        const Mat R = view(by.root, 6, 6, w);
        if (by.kind == Measure::Kind::base)
            return R;
        Mat into(w, 6, 6, 0);  // from base to tool coordinates, [[R', 0], [0, R']] [[I, 0], [-[p]x, I]]
        for (int k = 0; k < 2; k++)
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++)
                    into(3 * k + i, 3 * k + j) = arm.tool.R[j][i];
        return R * (into * root_at(vec(arm.tool.p, w), 1));
    }

    // The desired tool position, or the centre of the reach if the target has none.
    Vec3 target_position() const { return in.target ? in.target->p : in.part && in.part->has_point ? in.part->point : set.reach_centre; }
    bool has_target() const { return in.target || in.part; }
    // The measure of the constrained part of the error.
    void measure_part()
    {
        const bool at_point = set.measure.kind == Measure::Kind::point || set.measure.kind == Measure::Kind::own_point;
        tick.measure = tick.root;
        tick.root = at_point ? in.part->root(arm.tool, set.measure.length, w) : in.part->root_of(tick.measure, arm.tool);
        tick.orientation_rows = in.part->turns();
    }

    // Sets the joint bounds and the limit of the tool speed.
    void set_bounds()
    {
        Vec fastest = view(limits.velocity, w);
        if (in.changes.limits || speed != 1) {
            fastest = fastest.copy();
            for (int j = 0; j < m; j++) {  // joints slow down within their accelerations
                const double most = speed > 0 ? speed * fastest[j] : 0;
                const double slowest = limits.brakes ? std::abs(last_velocity[j]) - limits.acceleration[j] * limits.dt : 0;
                fastest[j] = std::min(std::max(most, slowest), set.limits.velocity[j]);
            }
        }
        bounds = BoundsOfTick(limits, q, last_velocity, fastest).bounds();
        tick.lower = bounds.lower, tick.upper = bounds.upper;
        tick.position_lower = bounds.position_lower, tick.position_upper = bounds.position_upper;
        const ToolSpeed& tool = in.changes.tool_speed ? *in.changes.tool_speed : set.tool_speed;
        if (tool.limit == INFINITY)
            return;
        const Vec p = vec(arm.tool * tool.point, w);
        const Mat S = transposed(arm.J);
        Mat moved(w, m, 3);
        for (int j = 0; j < m; j++)
            moved[j].set(velocity_at(S[j], p));
        tick.P = transposed(moved);
        tick.speed = tool.limit;
        if (!in.changes.tool_speed && speed == 1)
            return;
        double share = 0;  // all joints slow down alike, within their accelerations
        for (int j = 0; j < m; j++) {
            const double size = std::abs(last_velocity[j]), over = limits.brakes ? size - limits.acceleration[j] * limits.dt : -1;
            share = over > 0 ? std::max(share, over / size) : share;
        }
        Vec slower = share * last_velocity;
        for (int j = 0; j < m; j++)
            slower[j] = std::min(std::max(slower[j], tick.lower[j]), tick.upper[j]);
        tick.speed = std::max(speed * tool.limit, (tick.P * slower).norm());
    }

    // Sets the limit rows. False if some limit has no safe velocity.
    bool set_limit_rows()
    {
        const int k = static_cast<int>(set.rows.lower.size());
        const Mat fixed = view(set.rows.C, k, m, w);
        tick.C = fixed, tick.row_lower = view(set.rows.lower, w), tick.row_upper = view(set.rows.upper, w);
        for (const RowLimit& limit : functions.limits) {
            if (limit.clearance)
                add(limit, limit.clearance->rows(q, last_velocity));
            else if (const std::optional<RowsOfTick> found = limit.rows(q, last_velocity))
                add(limit, *found);
            else {
                tick.C = fixed, tick.row_lower = tick.row_lower.part(0, k), tick.row_upper = tick.row_upper.part(0, k);
                origins.clear();
                return false;
            }
        }
        return true;
    }
    // Adds rows of limits that the velocity x violates before the end of the tick; whether there are any.
    bool add_violated(Vec x)
    {
        const int count = tick.C.rows;
        for (const RowLimit& limit : functions.limits)
            if (limit.clearance)
                add(limit, limit.clearance->after(q, x));
            else if (limit.after)
                add(limit, limit.after(q, x));
        return tick.C.rows > count;
    }
    void add(const RowLimit& limit, const RowsOfTick& more)
    {
        if (more.C.rows == 0)
            return;
        const int k = tick.C.rows;
        if (k + more.C.rows > MOST_ROWS)
            throw std::length_error("there are more than 256 rows of limits");
        tick.C = k ? stacked(tick.C, more.C) : more.C;
        tick.row_lower = k ? joined(tick.row_lower, more.lower) : more.lower;
        tick.row_upper = k ? joined(tick.row_upper, more.upper) : more.upper;
        origins.resize(origins.size() + more.C.rows, {static_cast<int>(&limit - functions.limits.data()), -1, 0});
    }
    void add(const RowLimit& limit, const ClearanceRows& more)
    {
        const int k = more.C.rows;
        for (const double x : more.C.all())
            if (!std::isfinite(x))
                throw std::domain_error("rows of a clearance have NaN or infinity");
        for (int i = 0; i < k; i++)
            if (!(more.lower[i] <= more.upper[i] && std::abs(more.lower[i]) < INFINITY))
                throw std::domain_error("bounds of a clearance have NaN or infinity");
        add(limit, RowsOfTick{more.C, more.lower, more.upper});
        for (int i = 0; i < k; i++) {
            RowOrigin& origin = origins[origins.size() - k + i];
            origin.pair = more.pair[i], origin.distance = more.pair[i] < 0 ? 0 : limit.clearance->clearance->last_distances()[more.pair[i]];
        }
    }

    // Sets the twist, the exact rows and the posture.
    void set_demand()
    {
        Vec feedforward = in.feedforward.w ? in.feedforward : Vec(w, 6, 0), error(w, 6, 0);
        Pose target = in.target ? *in.target : arm.tool;
        double share = 0;
        Twist turn{};
        if (has_target()) {
            const double* last = state.turn();
            turn = in.part ? in.part->error(arm.tool, {last[0], last[1], last[2]}) : same_sense(last, error_twist(target, arm.tool));
            if (in.part)
                target = in.part->reached(arm.tool, turn);
            std::copy(turn.omega.begin(), turn.omega.end(), state.turn());
            error = vec(turn, w) + (delay() * speed) * feedforward;  // the target moves on during the delay
            share = brakes.brakes && speed > 0 ? approach(error, speed * feedforward) : 1;
        } else if (!in.at_base) {
            feedforward = feedforward.copy();
            feedforward.part(3, 6).add(1, cross(vec(arm.tool.p, w), feedforward.part(0, 3)));  // v - omega x p, at the base's origin
        }
        const double gain = share * set.gain;
        tick.error_tolerance = has_target() ? set.error_tolerance * std::min(set.gain, TOLERANCE_GAIN) * speed : 0;
        tick.separates_orientation = set.measure.kind == Measure::Kind::point || set.measure.kind == Measure::Kind::own_point;
        tick.feedforward = feedforward, tick.error = gain * error;
        set_exact(target, gain, turn, feedforward);
        tick.hold_time = set.dt + set.delay;
        if (!has_target() || tick.C.rows)  // velocities cannot change faster than accelerations allow
            tick.hold_time += 0.5 * (in.acceleration_rise + braking_time());
        if (in.posture.w)
            tick.posture = in.posture;
        else if (!set.posture.empty()) {
            tick.posture = Vec(w, m), tick.velocity_limit = Vec(w, m);
            for (int j = 0; j < m; j++) {
                const double displacement = set.posture[j] - q[j], most = set.limits.velocity[j];
                tick.posture[j] = set.posture_gain[j] * (set.revolution[j] > 0 ? std::remainder(displacement, set.revolution[j]) : displacement);
                tick.velocity_limit[j] = most > 0 && std::isfinite(most) ? most : 1;
            }
        }
        tick.last_residual = state.last_residual();
    }
    // Until a command acts [s].
    double delay() const { return (state.whole + state.part) * set.dt; }
    double braking_time() const
    {
        double longest = 0;
        for (int j = 0; brakes.brakes && j < m; j++)
            longest = std::max(longest, std::abs(last_velocity[j]) / brakes.acceleration[j]);
        return longest;
    }
    void set_exact(const Pose& target, double gain, const Twist& error, Vec feedforward)
    {
        const double also = gain * delay() * speed;  // share of the feedforward
        int count = 0;
        for (const Demand& demand : set.exact)
            count += demand.rows();
        if (functions.exact) {
            const Pose* nearest = in.part ? &target : nullptr;
            functions.exact(q, 0, feedforward, nearest, tick);
            const Vec still = tick.E_f.copy();
            functions.exact(q, gain, (1 + also) * feedforward, nearest, tick);
            tick.E_e = tick.E_f - still, tick.E_f = still;
        } else if (count) {
            DemandRows rows(w, count, m);
            for (const Demand& demand : set.exact)
                rows.add(demand, arm.J, arm.tool, target, gain, error, twist(feedforward), also);
            tick.E = rows.E, tick.D = rows.D, tick.E_f = rows.E_f, tick.E_e = rows.E_e;
        }
        tick.exact_rank = in.E.w ? 0 : set.exact_rank;
        if (!in.E.w)
            return;
        const Mat none(w, in.E.rows, 6, 0), D = in.D.w ? in.D : none;
        const Vec zero(w, in.E.rows, 0);
        tick.D = tick.E.w ? stacked(tick.D, D) : D;
        tick.E_f = tick.E.w ? joined(tick.E_f, in.E_f) : in.E_f, tick.E_e = tick.E.w ? joined(tick.E_e, zero) : zero;
        tick.E = tick.E.w ? stacked(tick.E, in.E) : in.E;
    }

    // b, the largest share of the gain at which the joints can brake before the target. Also bounds the joint velocities so
    // that joints can brake before the error is least, for targets out of reach: a joint at c = x_before - x(feedforward)
    // must be able to brake within t |c|, t = time_to_least.
    double approach(Vec error, Vec feedforward)
    {
        Mat A = tick.root * tick.J;
        const Vec e = tick.root * error, f = tick.root * feedforward;
        Mat T;
        if (tick.metric.w)
            T = inverse(cholesky(tick.metric)), A = A * T;
        const auto joints = [&](Vec b, double share) {
            const Vec y = damped_least_squares(A, b, share);
            return T.w ? T * y : y;
        };
        const Vec distance = joints(e, DISTANCE_DAMPING);
        const Vec follows = f.square() > 0 ? joints(f, FEEDFORWARD_DAMPING) : Vec(w, m, 0), c = last_velocity - follows;
        const double gain = speed * set.gain, dt = limits.dt, time = time_to_least(e, c);
        double share = 1;
        for (int j = 0; j < m; j++) {
            const double a = brakes.acceleration[j], braking = BRAKING_SHARE * a, displacement = std::abs(distance[j]);
            const double knee = braking / (gain * gain), lag = 2 * braking * in.acceleration_rise;
            if (displacement > knee)
                share = std::min(share, (std::sqrt(lag * lag + braking * (2 * displacement - knee)) - lag) / (gain * displacement));
            const double size = std::abs(c[j]);
            if (size == 0 || tick.C.rows)  // rows may require motion
                continue;
            const double stops = in.acceleration_rise > 0 ? std::sqrt(lag * lag + 2 * braking * time * size) - lag : braking_speed(time * size, braking, dt, 1 / dt);
            const double most = std::max(stops, std::max(limits.brakes ? size - dt * a : 0, dt * a));
            if (c[j] < 0)
                tick.lower[j] = std::min(std::max(tick.lower[j], follows[j] - most), tick.upper[j]);
            else
                tick.upper[j] = std::max(std::min(tick.upper[j], follows[j] + most), tick.lower[j]);
        }
        return share;
    }
    // Until the measured error e is least, or greatest, at constant joint velocity c; infinite if it does not change:
    //     t = (|e'A c| + tolerance |A c|) / (|A c|^2 + max(0, -e'R b)),   b = sum over j < i of c_j c_i [J_j, J_i]
    double time_to_least(Vec e, Vec c) const
    {
        const Vec moved = tick.root * (tick.J * c), bent = tick.root * twist_change(tick.J, c);
        const double change = moved.square() + std::max(0.0, -e.dot(bent));
        return change > 0 ? (std::abs(e.dot(moved)) + set.error_tolerance * moved.norm()) / change : INFINITY;
    }

    // Scales the whole demand by the speed.
    void scale_demand()
    {
        if (speed == 1)
            return;
        tick.feedforward = speed * tick.feedforward, tick.error = speed * tick.error, tick.hold_time /= speed;
        if (tick.E.w)
            tick.E_f = speed * tick.E_f, tick.E_e = speed * tick.E_e;
        if (tick.posture.w)
            tick.posture = speed * tick.posture;
        if (tick.velocity_limit.w)
            tick.velocity_limit = speed * tick.velocity_limit;
    }

    Answer solve_law(const Tick& of) const
    {
        const auto by_law = [&](const Tick& tick) { return functions.law ? functions.law(tick) : velocity(tick, w); };
        Answer found = by_law(of);
        if (found.failure != Failure::no_pseudoinverse)
            return found;
        if (of.guard < 0)
            throw NoProjector();
        Tick plain = of;  // the form has no projector here: least squares, as a full guard
        plain.form = FormKind::none;
        found = by_law(plain);
        found.form_share = 0;
        return found;
    }
    Report solve_tick()
    {
        Answer answer = solve_law(tick);
        Report found = iq::report(tick, answer, w);
        for (int again = 0; again < MOST_RESOLVES && add_violated(found.velocity); again++) {
            answer = solve_law(tick);
            found = iq::report(tick, answer, w);
        }
        state.last_residual() = answer.failure == Failure::none ? answer.residual : 0;
        return found;
    }

    // Zero velocity or, if the limits forbid it, the least motion back inside them.
    Report stand_still()
    {
        Tick still = tick;
        still.feedforward = still.error = Vec(w, 6, 0), still.E = still.D = Mat(), still.posture = still.velocity_limit = Vec();
        still.last_velocity = Vec(w, m, 0), still.last_residual = 0, still.form = FormKind::none;
        Answer answer = solve_law(still);
        tick.feedforward = tick.feedforward + tick.error, tick.error = Vec(w, 6, 0);
        Report found = iq::report(still, answer, w);
        found.reasons.clear();
        if (speed == 0)
            add_reason(found.reasons, Code::speed_zero);
        if (found.velocity.square() > 0)
            add_reason(found.reasons, Code::moving_back);
        else
            found.method = Method::hold, found.scale = 0;
        found.status = Status::held;
        found.residual = tick.feedforward - tick.J * found.velocity;
        state.last_residual() = 0;
        return finished(found);
    }
    // Implausible joint positions: the joints brake to rest at their acceleration limits.
    Report stopped(int joint)
    {
        Report found;
        found.velocity = Vec(w, m, 0);
        for (int j = 0; limits.brakes && j < m; j++)
            found.velocity[j] = std::copysign(std::max(std::abs(last_velocity[j]) - set.dt * limits.acceleration[j], 0.0), last_velocity[j]);
        found.residual = in.feedforward.w && !has_target() ? in.feedforward : Vec(w, 6, 0);
        found.status = Status::held, found.method = Method::hold, found.scale = 0;
        const double position = in.q[joint];
        add_reason(found.reasons, Code::implausible_position, {joint}, {},
            {position, std::max(position - set.position_upper[joint], set.position_lower[joint] - position)});
        saved = state;
        saved.remember(Vec(w, m, NAN), found.velocity, 0);
        return found;
    }

    // Adds the reasons about the joints, the most severe first, and updates the state.
    Report finished(Report found)
    {
        std::vector<double> reasons;
        const double fastest = std::max(set.gain, limits.rate);
        const LoopState::Trouble trouble = state.trouble(set.dt, set.gain, fastest, has_target());
        bool degraded = trouble.code != Code::none;
        if (degraded)
            add_reason(reasons, trouble.code, trouble.joints, {}, trouble.numbers);
        std::vector<std::pair<double, int>> out, fast;
        for (int j = 0; j < m; j++) {
            const bool active = std::find(found.active.begin(), found.active.end(), j) != found.active.end();
            if (const double by = limits.outside(in.q, j); by > ENCODER_TOLERANCE && (limits.brakes || active))
                out.emplace_back(-by, j);
            if (bounds.exceeded[j] > 0)
                fast.emplace_back(-bounds.exceeded[j], j);
        }
        std::stable_sort(out.begin(), out.end()), std::stable_sort(fast.begin(), fast.end());
        for (const auto& [by, j] : out)
            add_reason(reasons, Code::outside_position_limits, {j}, {}, {-by});
        for (const auto& [by, j] : fast)
            add_reason(reasons, Code::acceleration_exceeded, {j}, {}, {-by, limits.acceleration[j]});
        degraded = degraded || !fast.empty() || (limits.brakes && !out.empty());
        if (degraded && found.status != Status::held)
            found.status = Status::degraded;
        else if (!out.empty() && found.status == Status::ok)
            found.status = Status::limited;
        reasons.insert(reasons.end(), found.reasons.begin(), found.reasons.end());
        found.reasons = reasons;
        if (in.part)
            found.residual = in.part->part(found.residual, arm.tool);
        saved = state;
        saved.remember(in.q, found.velocity, state.last_residual());
        return found;
    }
};

}  // namespace

LoopReport Loop::tick(LoopState& state, const TickInputs& in, const LoopFunctions& functions, Workspace& w) const
{
    return TickOfLoop(*this, state, in, functions, w).solve();
}

NearestVelocity Loop::nearest(Vec desired, bool with_share, const TickInputs& in, const LoopFunctions& functions, Workspace& w) const
{
    LoopState none(settings.joints, 0, settings.dt);
    return TickOfLoop(*this, none, in, functions, w).nearest(desired, with_share);
}

}  // namespace iq
