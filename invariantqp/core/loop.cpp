#include "loop.hpp"
#include "measure.hpp"
#include <stdexcept>

namespace iq {
namespace {

// Share of the joints' acceleration that brakes along the distances to the target; they vary along a straight motion.
constexpr double BRAKING_SHARE = 0.5;
// Of the squared size of A: damping of distances, so that near singularities no joint travels far, and of what follows a
// moving target.
constexpr double DAMPED_DISTANCE = 1e-3, DAMPED_PURSUIT = 1e-6;
constexpr double SLACK_GAIN = 10;  // at most, by which an error within the slack becomes a twist that counts as nothing [1/s]
constexpr double OUTSIDE = 1e-3;  // outside of its range a joint is reported [rad, length]; less is encoders' noise
constexpr int AGAIN = 4;          // so often at most an answer is made again that does not keep a limit to its end

Twist twist(Vec s) { return {vec3(s.part(0, 3)), vec3(s.part(3, 6))}; }

// The same displacement turning as in the tick before, where it is nearly half a turn: same axis, same translation along it.
Twist same_turn(const double* before, const Twist& error)
{
    const double ratio = same_way(error.omega, {before[0], before[1], before[2]});
    if (ratio == 1)
        return error;
    const Vec3 axis = (1 / norm(error.omega)) * error.omega;
    const double slide = dot(axis, error.v);
    return {ratio * error.omega, ratio * error.v + ((1 - ratio) * slide) * axis};
}

// The x with least |A x - b|^2 + share |A|^2 |x|^2.
Vec damped(Mat A, Vec b, double share)
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
    TickOfLoop(const Loop& loop, LoopState& kept, const TickInputs& in, const LoopFunctions& functions, Workspace& w)
        : loop(loop), set(loop.settings), kept(kept), state(kept), in(in), functions(functions), w(w), m(set.joints),
          limits(in.changes.limits ? *in.changes.limits : set.limits), brakes(limits.brakes ? limits : set.limits),
          speed(in.changes.speed), there(w, m), before(w, m)
    {
    }

    LoopReport all()
    {
        Report found = report();
        return {std::move(found), std::move(origins)};
    }

    NearestVelocity nearest(Vec wanted, bool with_share)
    {
        there = in.q, before = in.velocity;
        arm = functions.arm ? functions.arm(there, w) : seen();
        tick.J = arm.J;  // for the tool's speed
        bound();
        if (!limit_rows()) {
            tick.root = root(), tick.ahead = tick.error = Vec(w, 6, 0);
            return {{standing(), std::move(origins)}, 0};
        }
        exact(arm.tool, 0, {}, arm.J * wanted);
        tick.D = Mat();  // no parts of what follows, which are joint velocities: twists, each of six joints
        const int size = 6 * ((m + 5) / 6);
        tick.J = Mat(w, size, m, 0), tick.root = Mat::identity(w, size), tick.ahead = Vec(w, size, 0), tick.error = Vec(w, size, 0);
        for (int j = 0; j < m; j++)
            tick.J(j, j) = 1, tick.ahead[j] = wanted[j];
        const Report report = answered();
        double share = 1;
        if (with_share) {
            Tick all = tick;
            all.E = Mat::identity(w, m), all.E_f = wanted, all.E_e = Vec(w, m, 0);
            share = velocity(all, w).share;
        }
        return {{finished(report), std::move(origins)}, share};
    }

  private:
    const Loop& loop;
    const LoopSettings& set;
    LoopState& kept;  // is changed when all is known
    LoopState state;
    const TickInputs& in;
    const LoopFunctions& functions;
    Workspace& w;
    const int m;
    const JointLimits &limits, &brakes;  // of this tick; and by which joints brake, which a follower does itself
    const double speed;
    Vec there, before;
    ArmState arm;
    Tick tick;
    JointBounds bounds;
    std::vector<RowOrigin> origins;

    Report report()
    {
        state.observe(in.q, set.dt, set.turns, set.limits.velocity);
        Vec last(w, m);
        state.predict(in.q, set.dt, there, last);
        before = in.velocity.w ? in.velocity : last;
        const int unknown = not_believed();
        if (unknown >= 0)
            return halted(unknown);
        arm = in.arm ? *in.arm : functions.arm ? functions.arm(there, w) : seen();
        if (norm(place() - set.tip) > set.far)
            throw FarTarget();
        tick.J = arm.J;
        tick.root = root();
        if (in.part)
            count_part();
        tick.before = last;
        tick.metric = set.metric.empty() ? Mat() : view(set.metric, m, m, w);
        tick.form = set.form, tick.pitch = set.pitch, tick.damping = set.damping, tick.guard = set.guard;
        if (!set.form_matrix.empty())
            tick.form_matrix = view(set.form_matrix, 6, static_cast<int>(set.form_matrix.size() / 6), w);
        bound();
        const bool safe = limit_rows(), stands = in.stand || speed == 0 || !safe;
        demand();
        if (stands)
            return standing();
        slow_down();
        return finished(answered());
    }

    // The joint that is farthest outside where positions are believed, -1 where none is.
    int not_believed() const
    {
        int found = -1;
        double most = 0;
        for (int j = 0; j < m; j++)
            if (const double by = std::max(in.q[j] - set.believed_upper[j], set.believed_lower[j] - in.q[j]); by > most)
                most = by, found = j;
        return found;
    }
    ArmState seen() const
    {
        const Mat J(w, 6, m);
        return {J, loop.chain->state(there.p, J)};
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

    // Where the target is to bring the tool; where it does not say, or there is none, the arm's own place.
    Vec3 place() const { return in.target ? in.target->p : in.part && in.part->has_point ? in.part->point : set.tip; }
    bool has_target() const { return in.target || in.part; }
    // A measure of what counts of a twist alone.
    void count_part()
    {
        const bool at_point = set.measure.kind == Measure::Kind::point || set.measure.kind == Measure::Kind::own_point;
        tick.measure = tick.root;
        tick.root = at_point ? in.part->root(arm.tool, set.measure.length, w) : in.part->root_of(tick.measure, arm.tool);
        tick.turns = in.part->turns();
    }

    // Bounds of the joints, and the limit of the tool's speed.
    void bound()
    {
        Vec fastest = view(limits.velocity, w);
        if (in.changes.limits || speed != 1) {
            fastest = fastest.copy();
            for (int j = 0; j < m; j++) {  // no joint has to slow down faster than it can
                const double most = speed > 0 ? speed * fastest[j] : 0;
                const double slowest = limits.brakes ? std::abs(before[j]) - limits.acceleration[j] * limits.dt : 0;
                fastest[j] = std::min(std::max(most, slowest), set.limits.velocity[j]);
            }
        }
        bounds = BoundsOfTick(limits, there, before, fastest).bounds();
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
        double share = 0;  // joints that slow down alike, as fast as they can
        for (int j = 0; j < m; j++) {
            const double size = std::abs(before[j]), over = limits.brakes ? size - limits.acceleration[j] * limits.dt : -1;
            share = over > 0 ? std::max(share, over / size) : share;
        }
        Vec slower = share * before;
        for (int j = 0; j < m; j++)
            slower[j] = std::min(std::max(slower[j], tick.lower[j]), tick.upper[j]);
        tick.speed = std::max(speed * tool.limit, (tick.P * slower).norm());
    }

    // The rows of limits; false where one of them knows no velocity that is safe.
    bool limit_rows()
    {
        const int k = static_cast<int>(set.rows.lower.size());
        const Mat fixed = view(set.rows.C, k, m, w);
        tick.C = fixed, tick.row_lower = view(set.rows.lower, w), tick.row_upper = view(set.rows.upper, w);
        for (const RowLimit& limit : functions.limits) {
            if (limit.clearance)
                add(limit, limit.clearance->rows(there, before));
            else if (const std::optional<RowsOfTick> found = limit.rows(there, before))
                add(limit, *found);
            else {
                tick.C = fixed, tick.row_lower = tick.row_lower.part(0, k), tick.row_upper = tick.row_upper.part(0, k);
                origins.clear();
                return false;
            }
        }
        return true;
    }
    // Whether limits have more rows, because the velocity x does not keep them to the tick's end.
    bool more_rows(Vec x)
    {
        const int before = tick.C.rows;
        for (const RowLimit& limit : functions.limits)
            if (limit.clearance)
                add(limit, limit.clearance->after(there, x));
            else if (limit.after)
                add(limit, limit.after(there, x));
        return tick.C.rows > before;
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

    // What is wanted: the twist, its exact parts, the posture.
    void demand()
    {
        Vec ahead = in.ahead.w ? in.ahead : Vec(w, 6, 0), error(w, 6, 0);
        Pose target = in.target ? *in.target : arm.tool;
        double share = 0;
        Twist turn{};
        if (has_target()) {
            const double* last = state.turn();
            turn = in.part ? in.part->error(arm.tool, {last[0], last[1], last[2]}) : same_turn(last, error_twist(target, arm.tool));
            if (in.part)
                target = in.part->reached(arm.tool, turn);
            std::copy(turn.omega.begin(), turn.omega.end(), state.turn());
            error = vec(turn, w) + (late() * speed) * ahead;  // the target, too, is on by then
            share = brakes.brakes && speed > 0 ? approach(error, speed * ahead) : 1;
        } else if (!in.at_base) {
            ahead = ahead.copy();
            ahead.part(3, 6).add(1, cross(vec(arm.tool.p, w), ahead.part(0, 3)));  // v - omega x p, at the base's origin
        }
        const double gain = share * set.gain;
        tick.slack = has_target() ? set.slack * std::min(set.gain, SLACK_GAIN) * speed : 0;
        tick.apart = set.measure.kind == Measure::Kind::point || set.measure.kind == Measure::Kind::own_point;
        tick.ahead = ahead, tick.error = gain * error;
        exact(target, gain, turn, ahead);
        tick.held = set.dt + set.delay;
        if (!has_target() || tick.C.rows)  // until accelerations let joints have another velocity
            tick.held += 0.5 * (in.rise + braking_time());
        if (in.posture.w)
            tick.posture = in.posture;
        else if (!set.posture.empty()) {
            tick.posture = Vec(w, m), tick.fastest = Vec(w, m);
            for (int j = 0; j < m; j++) {
                const double way = set.posture[j] - there[j], most = set.limits.velocity[j];
                tick.posture[j] = set.pull[j] * (set.turns[j] > 0 ? std::remainder(way, set.turns[j]) : way);
                tick.fastest[j] = most > 0 && std::isfinite(most) ? most : 1;
            }
        }
        tick.missed = state.missed();
    }
    // How long a command takes to act [s].
    double late() const { return (state.whole + state.part) * set.dt; }
    double braking_time() const
    {
        double longest = 0;
        for (int j = 0; brakes.brakes && j < m; j++)
            longest = std::max(longest, std::abs(before[j]) / brakes.acceleration[j]);
        return longest;
    }
    void exact(const Pose& target, double gain, const Twist& error, Vec ahead)
    {
        const double also = gain * late() * speed;  // of the target's twist
        int count = 0;
        for (const Demand& demand : set.exact)
            count += demand.rows();
        if (functions.exact) {
            const Pose* nearest = in.part ? &target : nullptr;
            functions.exact(there, 0, ahead, nearest, tick);
            const Vec still = tick.E_f.copy();
            functions.exact(there, gain, (1 + also) * ahead, nearest, tick);
            tick.E_e = tick.E_f - still, tick.E_f = still;
        } else if (count) {
            DemandRows rows(w, count, m);
            for (const Demand& demand : set.exact)
                rows.add(demand, arm.J, arm.tool, target, gain, error, twist(ahead), also);
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

    // b, the share of the gain from which joints can brake before the target. It also keeps room to brake before the
    // error is least, where the target is out of reach and joints are fast while the tool is not: the bounds of a joint that
    // goes on at c = x_before - x(feedforward) are the speeds from which it brakes within t |c|, t as in `time_to_least`.
    double approach(Vec error, Vec ahead)
    {
        Mat A = tick.root * tick.J;
        const Vec e = tick.root * error, f = tick.root * ahead;
        Mat T;
        if (tick.metric.w)
            T = inverse(cholesky(tick.metric)), A = A * T;
        const auto joints = [&](Vec b, double share) {
            const Vec y = damped(A, b, share);
            return T.w ? T * y : y;
        };
        const Vec distance = joints(e, DAMPED_DISTANCE);
        const Vec follows = f.square() > 0 ? joints(f, DAMPED_PURSUIT) : Vec(w, m, 0), c = before - follows;
        const double gain = speed * set.gain, dt = limits.dt, time = time_to_least(e, c);
        double share = 1;
        for (int j = 0; j < m; j++) {
            const double a = brakes.acceleration[j], braking = BRAKING_SHARE * a, way = std::abs(distance[j]);
            const double knee = braking / (gain * gain), lag = 2 * braking * in.rise;
            if (way > knee)
                share = std::min(share, (std::sqrt(lag * lag + braking * (2 * way - knee)) - lag) / (gain * way));
            const double size = std::abs(c[j]);
            if (size == 0 || tick.C.rows)  // rows may ask joints to go on
                continue;
            const double stops = in.rise > 0 ? std::sqrt(lag * lag + 2 * braking * time * size) - lag : braking_speed(time * size, braking, dt, 1 / dt);
            const double most = std::max(stops, std::max(limits.brakes ? size - dt * a : 0, dt * a));
            if (c[j] < 0)
                tick.lower[j] = std::min(std::max(tick.lower[j], follows[j] - most), tick.upper[j]);
            else
                tick.upper[j] = std::max(std::min(tick.upper[j], follows[j] + most), tick.lower[j]);
        }
        return share;
    }
    // Until the measured error e is least, or greatest, while joints go on at c; infinite where it stays:
    //     t = (|e'A c| + slack |A c|) / (|A c|^2 + max(0, -e'R b)),   b = sum over j < i of c_j c_i [J_j, J_i]
    double time_to_least(Vec e, Vec c) const
    {
        const Vec moved = tick.root * (tick.J * c), bent = tick.root * turning(tick.J, c);
        const double change = moved.square() + std::max(0.0, -e.dot(bent));
        return change > 0 ? (std::abs(e.dot(moved)) + set.slack * moved.norm()) / change : INFINITY;
    }

    // All that is wanted, at a share of its speed; the way is the same.
    void slow_down()
    {
        if (speed == 1)
            return;
        tick.ahead = speed * tick.ahead, tick.error = speed * tick.error, tick.held /= speed;
        if (tick.E.w)
            tick.E_f = speed * tick.E_f, tick.E_e = speed * tick.E_e;
        if (tick.posture.w)
            tick.posture = speed * tick.posture;
        if (tick.fastest.w)
            tick.fastest = speed * tick.fastest;
    }

    Answer solved(const Tick& of) const
    {
        const auto by_law = [&](const Tick& tick) { return functions.law ? functions.law(tick) : velocity(tick, w); };
        Answer found = by_law(of);
        if (found.failure != Failure::no_pseudoinverse)
            return found;
        if (of.guard < 0)
            throw NoProjector();
        Tick plain = of;  // the form serves nothing here, and its guard leaves none of it
        plain.form = FormKind::none;
        found = by_law(plain);
        found.guarded = 0;
        return found;
    }
    Report answered()
    {
        Answer answer = solved(tick);
        Report found = iq::report(tick, answer, w);
        for (int again = 0; again < AGAIN && more_rows(found.velocity); again++) {
            answer = solved(tick);
            found = iq::report(tick, answer, w);
        }
        state.missed() = answer.failure == Failure::none ? answer.missed : 0;
        return found;
    }

    // Standing still or, where limits do not allow that, the least motion back inside them.
    Report standing()
    {
        Tick still = tick;
        still.ahead = still.error = Vec(w, 6, 0), still.E = still.D = Mat(), still.posture = still.fastest = Vec();
        still.before = Vec(w, m, 0), still.missed = 0, still.form = FormKind::none;
        Answer answer = solved(still);
        tick.ahead = tick.ahead + tick.error, tick.error = Vec(w, 6, 0);
        Report found = iq::report(still, answer, w);
        found.reasons.clear();
        if (speed == 0)
            say(found.reasons, Code::stopped);
        if (found.velocity.square() > 0)
            say(found.reasons, Code::moving_back);
        else
            found.method = Method::hold, found.share = 0;
        found.status = Status::held;
        found.residual = tick.ahead - tick.J * found.velocity;
        state.missed() = 0;
        return finished(found);
    }
    // Joint positions that cannot be true: the joints come to rest as fast as their accelerations allow.
    Report halted(int joint)
    {
        Report found;
        found.velocity = Vec(w, m, 0);
        for (int j = 0; limits.brakes && j < m; j++)
            found.velocity[j] = std::copysign(std::max(std::abs(before[j]) - set.dt * limits.acceleration[j], 0.0), before[j]);
        found.residual = in.ahead.w && !has_target() ? in.ahead : Vec(w, 6, 0);
        found.status = Status::held, found.method = Method::hold, found.share = 0;
        const double q = in.q[joint];
        say(found.reasons, Code::not_believed, {joint}, {},
            {q, std::max(q - set.position_upper[joint], set.position_lower[joint] - q)});
        kept = state;
        kept.remember(Vec(w, m, NAN), found.velocity, 0);
        return found;
    }

    // With what of the joints is to be said, the worst first; the state is that of the next tick.
    Report finished(Report found)
    {
        std::vector<double> reasons;
        const double fastest = std::max(set.gain, limits.rate);
        const LoopState::Trouble trouble = state.trouble(set.dt, set.gain, fastest, has_target());
        bool degraded = trouble.code != Code::none;
        if (degraded)
            say(reasons, trouble.code, trouble.joints, {}, trouble.numbers);
        std::vector<std::pair<double, int>> out, fast;
        for (int j = 0; j < m; j++) {
            const bool active = std::find(found.active.begin(), found.active.end(), j) != found.active.end();
            if (const double by = limits.outside(in.q, j); by > OUTSIDE && (limits.brakes || active))
                out.emplace_back(-by, j);
            if (bounds.exceeded[j] > 0)
                fast.emplace_back(-bounds.exceeded[j], j);
        }
        std::stable_sort(out.begin(), out.end()), std::stable_sort(fast.begin(), fast.end());
        for (const auto& [by, j] : out)
            say(reasons, Code::outside, {j}, {}, {-by});
        for (const auto& [by, j] : fast)
            say(reasons, Code::acceleration, {j}, {}, {-by, limits.acceleration[j]});
        degraded = degraded || !fast.empty() || (limits.brakes && !out.empty());
        if (degraded && found.status != Status::held)
            found.status = Status::degraded;
        else if (!out.empty() && found.status == Status::ok)
            found.status = Status::limited;
        reasons.insert(reasons.end(), found.reasons.begin(), found.reasons.end());
        found.reasons = reasons;
        if (in.part)
            found.residual = in.part->part(found.residual, arm.tool);
        kept = state;
        kept.remember(in.q, found.velocity, state.missed());
        return found;
    }
};

}  // namespace

LoopReport Loop::tick(LoopState& state, const TickInputs& in, const LoopFunctions& functions, Workspace& w) const
{
    return TickOfLoop(*this, state, in, functions, w).all();
}

NearestVelocity Loop::nearest(Vec wanted, bool with_share, const TickInputs& in, const LoopFunctions& functions, Workspace& w) const
{
    LoopState none(settings.joints, 0, settings.dt);
    return TickOfLoop(*this, none, in, functions, w).nearest(wanted, with_share);
}

}  // namespace iq
