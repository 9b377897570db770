#include "hybrid.hpp"
#include "measure.hpp"

namespace iq {
namespace {

// [s] Joints without acceleration limits reach a speed along the contact in this time: by default 1 m/s^2, as arms usually move.
constexpr double ACCELERATION_TIME = 0.1;
// Changes of a noisy force count up to NOISE_SIGMAS standard deviations and may take NOISE_SHARE of the joints' acceleration; a gain
// lowered below that share is reported. A joint without an acceleration limit has FREE_JOINT times the largest of the others; below
// SINGULAR of the largest singular value no motion is requested of the joints.
constexpr double NOISE_SIGMAS = 1.5, NOISE_SHARE = 0.5, FREE_JOINT = 10, SINGULAR = 1e-2;
// The normal is estimated from the last MEMORY pieces of a force::STEP.
constexpr double MEMORY = 10;
// If nothing is declared, an overload is force::OVERLOAD times the desired force, or DEFAULT_OVERLOAD [N] if none is desired; readings
// of a force stay within NOISE_PEAK standard deviations of a component.
constexpr double DEFAULT_OVERLOAD = 20, NOISE_PEAK = 8;
// Fewer than six joints cannot follow a contact if more than UNREACHABLE of the motion presses on it, unless it is a slow correction.
constexpr double UNREACHABLE = 1e-3;
// The largest gain times delay, as in control/tracking.py.
constexpr double DELAY_SHARE = 0.25;

// From twists in a frame to the base.
Mat adjoint(const Pose& T, Workspace& w)
{
    Mat A(w, 6, 6, 0);
    for (int j = 0; j < 3; j++) {
        const Vec3 column{T.R[0][j], T.R[1][j], T.R[2][j]}, moved = cross(T.p, column);
        for (int i = 0; i < 3; i++)
            A(i, j) = A(3 + i, 3 + j) = column[i], A(3 + i, j) = moved[i];
    }
    return A;
}
// From wrenches in a frame to the base.
Mat coadjoint(const Pose& T, Workspace& w)
{
    const Mat A = adjoint(T, w), B = A.copy();
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            std::swap(B(i, 3 + j), B(3 + i, j));
    return B;
}
struct Load {
    double force, moment;
};
// |f| of a wrench, and the smallest |m| about the places: a handle is far from its hinge.
Load load_at(Vec wrench, std::initializer_list<Vec3> places)
{
    const Vec3 m = vec3(wrench.part(0, 3)), f = vec3(wrench.part(3, 6));
    double least = INFINITY;
    for (const Vec3& p : places)
        least = std::min(least, norm(m - cross(p, f)));
    return {norm(f), least};
}

class TickInContact {
  public:
    TickInContact(const HybridSettings& set, const HybridState& state, const Loop& loop, const ContactSplit& split, const HybridInputs& in,
                  const LoopFunctions& functions, Workspace& w)
        : set(set), task(set.law), before(state), state(state), loop(loop), split(split), in(in), functions(functions), w(w),
          m(loop.settings.joints), n(split.n), P(view(split.motion, 6, 6, w)), unit_rates(view(split.unit_rates, n, 6, w)),
          unit_parts(view(split.unit_parts, n, 6, w)), intensities(view(split.intensities, n, 6, w))
    {
    }

    HybridTick run(HybridState& next, LoopState& joints)
    {
        const ArmState arm = at(in.q);
        found.J = arm.J, tool = arm.tool;
        for (int j = 0; j < m; j++)
            found.is_plausible = found.is_plausible && loop.settings.plausible_lower[j] <= in.q[j] && in.q[j] <= loop.settings.plausible_upper[j];
        if (!found.is_plausible) {
            found.loop = loop.tick(joints, stationary(arm), functions, w);
            return found;
        }
        if (norm(in.target.p - loop.settings.reach_centre) > loop.settings.reach)
            throw FarTarget();
        locate_contact();
        if (before.was_touching && dot(out, before.outward) < 0) {
            found.normal_turned = std::acos(std::max(-1.0, dot(out, before.outward)));
            return found;
        }
        measure();
        const double share = noise_acceleration();
        const bool compliant = split.compliance > 0;
        found.gain_scale = !compliant && before.gain * share > NOISE_SHARE ? NOISE_SHARE / (before.gain * share) : 1;
        move_along();
        run_force_law();
        const bool beyond = at_edge && (found.law.action == force::Action::follow || found.law.action == force::Action::approach);
        follow_twist(arm, joints, beyond);
        remember(beyond, share);
        found.has_report = has_report(), found.reported_scale = reported_scale();
        next = state;
        return found;
    }

  private:
    const HybridSettings& set;
    const force::Settings& task;
    const HybridState& before;
    HybridState state;
    const Loop& loop;
    const ContactSplit& split;
    const HybridInputs& in;
    const LoopFunctions& functions;
    Workspace& w;
    const int m, n;
    const Mat P, unit_rates, unit_parts, intensities;
    HybridTick found;
    Pose tool;
    Mat A, B;               // from the frame of the contact to the base: twists, wrenches
    Vec3 point{}, grip{};   // the place of contact, of the grip
    Vec3 out{}, declared{}; // outward directions of the estimated and of the declared normal
    Vec3 moved{};           // displacement of the tool's point at the place of contact since the last tick
    Six load{};             // of the sensor's frame, with the bias
    Vec raw, W_raw, W, W_d; // wrenches: unfiltered, in the base frame; in the frame of the contact
    Mat J;                  // where the command acts
    bool at_edge = false;

    ArmState at(Vec q) const
    {
        if (functions.arm)
            return functions.arm(q, w);
        const Mat J(w, 6, m);
        return {J, loop.chain->state(q.p, J)};
    }
    TickInputs stationary(const ArmState& arm) const
    {
        TickInputs still;
        still.q = in.q, still.velocity = in.velocity, still.stand_still = true, still.arm = &arm;
        return still;
    }
    Vec along_contact(Vec twist) const { return A * (P * (t(B) * twist)); }
    double noise() const { return std::max(task.noise, state.law.noise.sigma); }
    // The speed of the place of contact, turning counted by the size of the contact.
    double speed_of(Vec twist) const
    {
        return std::max({norm(velocity(twist)), task.size * twist.part(0, 3).norm(), TINY});
    }
    Vec3 velocity(Vec twist) const { return vec3(velocity_at(twist, vec(point, w))); }
    bool can_yield() const { return m >= 6 || n <= m - 2; }

    // The contact, with the estimated normal.
    void locate_contact()
    {
        found.contact = in.contact, point = in.contact * split.origin;
        update_frames();
        declared = out;
        const Vec3 axis = cross(declared, state.normal.tilt);
        if (const double sine = norm(axis); set.normal_within > 0 && sine > TINY) {
            const Mat3 turn = rotation((std::atan(sine) / sine) * axis);
            found.contact = {turn * in.contact.R, point + turn * (in.contact.p - point)};
            update_frames();
        }
        grip = tool * set.grip;
        at_edge = in.edge <= 0;
        if (!before.has_ticked)
            return;
        const Vec3 local = transposed(tool.R) * (point - tool.p);
        moved = point - before.tool * local;
    }
    void update_frames()
    {
        A = adjoint(found.contact, w), B = coadjoint(found.contact, w);
        if (split.out.empty())
            return;
        out = velocity(A * view(split.out, w));
        out = (1 / std::max(norm(out), TINY)) * out;
    }

    void measure()
    {
        load = six(in.reading);
        Mat to_base = Mat::identity(w, 6);
        if (set.sensor)
            to_base = coadjoint(tool * set.sensor->mount, w), load = set.sensor->load(load, tool.R * set.sensor->mount.R);
        Six unfiltered, filtered;
        force::read(state.law, task, load, unfiltered, filtered);
        raw = to_base * vec(unfiltered, w), found.wrench = to_base * vec(set.sensor ? set.sensor->deadband(filtered) : filtered, w);
        W = t(A) * found.wrench, W_raw = t(A) * raw;
        W_d = in.wrench.w ? in.wrench : view(split.wrench, w);
        found.error = B * (view(split.force, 6, 6, w) * (W_d - W)), found.W_d = B * W_d;
        found.intensities = intensities * W;
    }
    // The share of the joints' acceleration that noise takes through the force law, per unit of its gain:
    //     max over joints j of   NOISE_SIGMAS sigma |x_j| / (a_j dt),     J x = A Z unit_rates-of-a-force
    // sigma is that of the change of a filtered force component in a tick. The motion along the contact has the rest: if both need
    // more than the limits allow, the force is exact and the tool leaves its path.
    double noise_acceleration() const
    {
        const JointLimits& limits = loop.settings.limits;
        if (!limits.brakes || noise() == 0)
            return 0;
        double largest = 0;
        for (const double a : limits.acceleration)
            largest = std::isfinite(a) ? std::max(largest, a) : largest;
        const Mat root = root_at(vec(point, w), task.size), M = root * found.J;
        for (int i = 0; i < 6; i++)
            for (int j = 0; j < m; j++)
                M(i, j) *= std::isfinite(limits.acceleration[j]) ? limits.acceleration[j] : FREE_JOINT * largest;
        const Mat twists = transposed(root * (A * (view(split.twist, 6, n, w) * unit_parts)));
        const RQ rq(m >= 6 ? M : transposed(M));
        const bool regular = m >= 6 && rq.regular(SINGULAR);
        std::optional<SVD> svd;
        if (!regular)
            svd.emplace(M);
        Vec squares(w, m, 0);
        for (int i = 3; i < 6; i++) {  // of each component of the force
            const Vec x = regular ? rq.least(twists[i]) : svd->least(twists[i], svd->rank(SINGULAR));
            for (int j = 0; j < m; j++)
                squares[j] += x[j] * x[j];
        }
        const double change = noise() * task.filter_share * std::sqrt(2 / (2 - task.filter_share));
        return NOISE_SIGMAS * change / task.dt * std::sqrt(*std::max_element(squares.begin(), squares.end()));
    }

    // The motion along the contact: at most `slide_speed` for the error, and rate limited for arms without acceleration limits.
    void move_along()
    {
        const double lag = std::isnan(state.law.arm.lag) ? 0 : state.law.arm.lag, gain = loop.settings.gain;
        found.motion_gain = gain * (lag - task.delay) > 1 ? std::min(gain, DELAY_SHARE / lag) : gain;
        const Vec chase = along_contact(found.motion_gain * vec(error_twist(in.target, tool), w));
        const Vec ahead = in.feedforward.w ? along_contact(in.feedforward) : Vec(w, 6, 0);
        found.motion = ahead + std::min(1.0, set.slide_speed / speed_of(chase)) * chase;
        if (state.law.is_unresponsive())  // it stops sliding, and is then unloaded to test the sensor
            found.motion = Vec(w, 6, 0);
        if (loop.settings.limits.brakes)
            return;
        const Vec last = along_contact(vec(before.motion, w)), change = found.motion - last;
        const double fast = std::max({set.slide_speed, speed_of(last), speed_of(found.motion)});
        found.motion = last + std::min(1.0, fast * task.dt / ACCELERATION_TIME / speed_of(change)) * change;
    }

    void run_force_law()
    {
        const int presses = split.presses;
        force::Inputs now{n, presses};
        const auto to = [](auto& array, Vec v) { std::copy(v.begin(), v.end(), array.begin()); };
        to(now.desired, unit_parts * W_d), to(now.force, unit_parts * W);
        to(now.desired_press, intensities.rows_from(0, presses) * W_d), to(now.press, intensities.rows_from(0, presses) * W_raw);
        now.reading = six(in.reading), now.load = load;
        const Vec3 slides = velocity(found.motion);
        for (int i = 0; i < 3; i++)
            now.along[i] = task.size * found.motion[i], now.along[3 + i] = slides[i];
        if (before.has_ticked)
            displacements(now);
        limits(now);
        now.total_press = total_press(now);
        now.gain_scale = found.gain_scale, now.came = -dot(out, moved), now.across = norm(moved + now.came * out);
        now.compliance = split.compliance, now.beyond_edge = at_edge, now.can_yield = can_yield();
        const bool first = !before.has_ticked || before.law.approach.time > task.lost_after;
        found.law = force::tick(state.law, task, now);
        if (state.law.stop.numbers != before.law.stop.numbers)
            state.fault_in_air = first;
        found.desired = n ? now.desired[0] : 0;
    }
    // Displacements since the last tick: measured; without a press, also along the contact, commanded and measured.
    void displacements(force::Inputs& now) const
    {
        const Vec done = vec(log(tool * inverse(before.tool)), w), rates = unit_rates * (t(B) * done);
        std::copy(rates.begin(), rates.end(), now.moved.begin());
        if (split.presses)
            return;
        const Mat root = root_at(vec(grip, w), task.size);
        const Vec given = task.dt * (root * vec(before.motion, w));
        now.along_commanded = given.norm();
        now.along_measured = now.along_commanded > 0 ? given.dot(root * along_contact(done)) / now.along_commanded : 0;
    }
    // The measured load, and the limits of an overload, which noise on the desired force stays below.
    void limits(force::Inputs& now) const
    {
        const Load desired = load_at(found.W_d, {point}), declared_load = load_at(view(split.wrench, w), {split.origin});
        const double f = std::max(declared_load.force, desired.force), moment = std::max(declared_load.moment, desired.moment);
        const double usual = f > 0 ? std::max(force::OVERLOAD * f, f + NOISE_PEAK * noise()) : DEFAULT_OVERLOAD;
        now.limit[0] = std::isnan(set.max_force) ? usual : set.max_force;
        now.limit[1] = std::isnan(set.max_moment) ? std::max(force::OVERLOAD * moment, moment + task.size * now.limit[0]) : set.max_moment;
        const Load measured = load_at(raw, {point, grip});
        const Vec3 force = vec3(raw.part(3, 6));
        const double press = dot(out, force);
        now.measured = {std::isnan(set.max_force) ? std::max(std::abs(press), norm(force - press * out)) : measured.force, measured.moment};
        if (split.presses == 0) {
            const Load off = load_at(found.error, {point, grip});
            now.missing = std::max(off.force / now.limit[0], off.moment / now.limit[1]);
        }
    }
    // The sum of all presses, in the unit of the smallest: one press may read the friction at another.
    double total_press(const force::Inputs& now) const
    {
        double press = 0, desired = 0, least = INFINITY, all = 0;
        for (int i = 0; i < split.presses; i++) {
            all += now.press[i];
            if (now.desired_press[i] > 0)
                press += now.press[i], desired += now.desired_press[i], least = std::min(least, now.desired_press[i]);
        }
        return split.presses > 1 && desired > 0 ? least * press / desired : all;
    }

    // The twist, and the joint velocity that follows it.
    void follow_twist(const ArmState& arm, LoopState& joints, bool beyond)
    {
        const force::Action action = found.law.action;
        found.force = Vec(w, 6, 0);
        if (action == force::Action::retreat || action == force::Action::hold)
            found.motion = Vec(w, 6, 0);
        if (action == force::Action::retreat)
            found.force = std::min(set.retreat_speed, (state.law.stop.distance - state.law.stop.retreated) / task.dt) * (A * view(split.out, w));
        else if (beyond)
            found.force = over_the_edge();
        else if (action != force::Action::hold)
            found.force = A * (view(split.twist, 6, n, w) * Vec(found.law.rates.data(), n, &w));
        // Without a press the contact stays in place: the Jacobian is that of the configuration in which this command acts.
        ArmState then = arm;
        if (!split.presses && joints.whole + joints.part > 0) {
            Vec there(w, m), last(w, m);
            LoopState expected = joints;
            expected.observe(in.q, task.dt, loop.settings.revolution, loop.settings.limits.velocity);
            expected.predict(in.q, task.dt, there, last);
            then = at(there);
        }
        J = then.J;
        TickInputs next = stationary(arm);
        const Vec twist = found.motion + found.force;
        if (action != force::Action::hold) {
            next.stand_still = false, next.feedforward = twist, next.at_base = true, next.arm = &then, next.posture = in.posture;
            if (set.measured_at_contact)
                next.measured_at = vec(point, w);
            if (set.force_first && n && can_yield())
                next.D = view(split.constraints, n, 6, w) * t(B), next.E = next.D * J, next.E_f = next.D * twist;
        }
        found.loop = loop.tick(joints, next, functions, w);
        found.unreachable = can_yield() ? 0 : unreachable();
    }
    // Beyond the edge of a surface the tool rises by the slope times the distance from the edge, so that it comes back above the
    // surface; it goes down no faster than it approaches.
    Vec over_the_edge() const
    {
        if (!state.is_beyond_edge || split.out.empty())
            return Vec(w, 6, 0);
        const Vec leaves = A * view(split.out, w);
        const double lift = task.slope * norm(point - state.edge_point) - state.lift;
        return std::max(lift / task.dt, -task.approach_speed) / speed_of(leaves) * leaves;
    }
    // The share of the motion along the contact that fewer than six joints turn into a press.
    double unreachable() const
    {
        const Mat root = root_at(vec(grip, w), task.size);
        const Vec motion = root * found.motion;
        const double speed = motion.norm();
        if (speed < force::SLOW * task.approach_speed)
            return 0;
        const SVD svd(root * found.J);
        const Vec off = found.J * svd.least(motion, svd.rank(6 * 2.2e-16)) - found.motion;
        const double share = (root * (off - along_contact(off))).norm() / speed;
        return share < UNREACHABLE ? 0 : share;
    }

    // The state for the next tick.
    void remember(bool beyond, double share)
    {
        const Report& report = found.loop.report;
        const bool arm_is_still = report.status == Status::degraded && has(report.reasons, Code::no_motion);
        state.gain = found.law.gain;
        state.acceleration_share = std::max(1 - std::min(share * state.gain * found.gain_scale, 1.0), 1 - NOISE_SHARE);
        if (arm_is_still && !state.law.touching()) {  // displacements of an arm that ignores its commands mean nothing
            const HybridState now = state;
            state = before, state.acceleration_share = now.acceleration_share, state.fault_in_air = now.fault_in_air;
            return;
        }
        const Vec twist = J * report.velocity;
        const double outwards = task.dt * dot(out, velocity(twist));
        std::array<double, force::MAX_CONSTRAINTS> given{};
        const Vec rates = task.dt * (unit_rates * (t(B) * twist));
        std::copy(rates.begin(), rates.end(), given.begin());
        const bool free = found.law.is_active && report.scale > 0.9 && found.law.action == force::Action::follow && !beyond;
        force::commanded(state.law, task, given, outwards, free, beyond);
        state.has_ticked = true, state.tool = tool, state.was_touching = state.law.touching(), state.outward = state.was_touching ? out : Vec3{};
        state.motion = six(found.motion);
        if (!beyond)
            state.is_beyond_edge = false, state.lift = 0;
        else if (!state.is_beyond_edge)
            state.is_beyond_edge = true, state.edge_point = point, state.lift = 0;
        else
            state.lift += outwards;
        estimate_normal();
    }
    // One more tick of the estimate, which is reset out of contact.
    void estimate_normal()
    {
        if (set.normal_within == 0 || split.presses == 0 || !state.law.touching()) {
            state.normal = {};
            return;
        }
        NormalEstimate& e = state.normal;
        const double press = (unit_parts * W)[0], desired = found.desired, step = force::STEP * task.size;
        const double k = task.stiffness > 0 ? task.stiffness : state.law.parts[0].estimate.bound;
        if (std::isnan(e.press) && std::abs(press - desired) > force::FORCE_TOLERANCE * desired)
            return;  // while the force of an impact rises, an error of the stiffness would look like a slope
        e.press = std::isnan(e.press) ? press : e.press, e.displacement = e.displacement + moved;
        const double height = dot(declared, e.displacement), rise = height + (press - e.press) / k;
        const Vec3 along = e.displacement - height * declared;
        if (dot(along, along) < step * step)
            return;
        const double kept = std::exp(-1 / MEMORY);
        for (int i = 0; i < 3; i++)
            e.squares[i] = kept * e.squares[i] + along[i] * along;
        e.rises = kept * e.rises + rise * along;
        // The part of older displacements along the declared normal, which may have turned, is left out.
        const auto across = [&](const Vec3& v) { return v - dot(declared, v) * declared; };
        Mat H(w, 3, 3);
        for (int j = 0; j < 3; j++) {
            Vec3 unit{};
            unit[j] = 1;
            const Vec3 column = across(e.squares * across(unit));
            for (int i = 0; i < 3; i++)
                H(i, j) = column[i] + (i == j ? 0.25 * step * step : 0);
        }
        const Mat U = cholesky(H);
        e.tilt = -1 * across(vec3(solved(U, solved(t(U), vec(across(e.rises), w)))));
        const double length = norm(e.tilt), most = std::tan(set.normal_within);
        e.bound = length > most ? set.normal_within : 0;
        if (length > most)
            e.tilt = (most / length) * e.tilt;
        e.displacement = {}, e.press = press;
    }

    // The scale of the force gain if it is low enough to be reported, else 1.
    double reported_scale() const { return found.gain_scale < NOISE_SHARE && state.law.touching() ? found.gain_scale : 1; }
    bool has_report() const
    {
        const force::Output& law = found.law;
        return law.fault != force::Fault::none || law.lost || law.warnings || in.edge < std::max(set.edge_margin, TINY)
               || reported_scale() < 1 || found.unreachable > 0 || state.normal.bound > 0
               || found.motion_gain < loop.settings.gain;
    }
};

}  // namespace

Six WrenchSensor::load(const Six& reading, const Mat3& R) const
{
    const Vec3 f = mass * (transposed(R) * gravity), moment = cross(centre, f);
    Six found;
    for (int i = 0; i < 6; i++) {
        const double weight = i < 3 ? moment[i] : f[i - 3], rest = reading[i] - bias[i];
        found[i] = is_reaction ? weight - rest : rest + weight;
    }
    return found;
}
Six WrenchSensor::deadband(const Six& wrench) const
{
    if (force_deadband == 0 && moment_deadband == 0)
        return wrench;
    const auto shortened = [](const Vec3& v, double by) {
        const double length = norm(v);
        return (length > by ? 1 - by / length : 0.0) * v;
    };
    const Vec3 f{wrench[3], wrench[4], wrench[5]}, m = Vec3{wrench[0], wrench[1], wrench[2]} - cross(origin, f);
    const Vec3 force = shortened(f, force_deadband), moment = shortened(m, moment_deadband) + cross(origin, force);
    return {moment[0], moment[1], moment[2], force[0], force[1], force[2]};
}

HybridTick Hybrid::tick(HybridState& state, const Loop& loop, LoopState& joints, const ContactSplit& split, const HybridInputs& in,
                        const LoopFunctions& functions, Workspace& w) const
{
    return TickInContact(settings, HybridState(state), loop, split, in, functions, w).run(state, joints);
}

}  // namespace iq
