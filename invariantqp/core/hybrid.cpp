#include "hybrid.hpp"
#include "measure.hpp"

namespace iq {
namespace {

constexpr double TINY = 2.2250738585072014e-308;
// Where joints have no acceleration limits, motion along a contact reaches its speed within this time [s]: by default
// 1 m/s^2, as arms are usually moved.
constexpr double TAKES_UP = 0.1;
// Changes of a noisy force count up to ABOVE standard deviations, and may take MOST of the joints' acceleration; a gain below
// LOWERED of itself is reported. A joint without an acceleration limit has FREE times the largest of the others; below SINGULAR
// of the largest singular value joints are not asked for a motion.
constexpr double ABOVE = 1.5, MOST = 0.5, LOWERED = 0.5, FREE = 10, SINGULAR = 1e-2;
// A normal is estimated while the press is within force::SHORT of the desired one, by pieces of a STEP of the contact's size: a
// millimetre of 50.
constexpr double STEP = 0.02, MEMORY = 10;
// Where nothing is declared an overload is this multiple of the desired force, or this force where none is desired [N]; readings
// of a force stay within so many standard deviations of a component.
constexpr double OVERLOAD = 2.5, NO_FORCE = 20, ABOVE_NOISE = 8;
// Few joints cannot follow a contact where more than UNREACHABLE of the motion presses on it and the motion is faster than
// SLOW of the approach speed: slower ones are corrections.
constexpr double UNREACHABLE = 1e-3, SLOW = 0.1;
// The largest gain times delay, as in control/tracking.py.
constexpr double DELAY_SHARE = 0.25;

using Six = std::array<double, 6>;
Six six(Vec v)
{
    Six found;
    std::copy(v.begin(), v.end(), found.begin());
    return found;
}
Vec vec(const Six& a, Workspace& w)
{
    Vec v(w, 6);
    std::copy(a.begin(), a.end(), v.p);
    return v;
}

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
// |f| of a wrench, and |m| about that of the places where it is least: a handle is held far from its hinge.
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
        : set(set), task(set.press), before(state), state(state), loop(loop), split(split), in(in), functions(functions), w(w),
          m(loop.settings.joints), n(split.n), P(view(split.motion, 6, 6, w)), unit_rates(view(split.unit_rates, n, 6, w)),
          unit_parts(view(split.unit_parts, n, 6, w)), intensities(view(split.intensities, n, 6, w))
    {
    }

    HybridTick all(HybridState& kept, LoopState& joints)
    {
        const ArmState arm = at(in.q);
        found.J = arm.J, tool = arm.tool;
        for (int j = 0; j < m; j++)
            found.believed = found.believed && loop.settings.plausible_lower[j] <= in.q[j] && in.q[j] <= loop.settings.plausible_upper[j];
        if (!found.believed) {
            found.found = loop.tick(joints, rest(arm), functions, w);
            return found;
        }
        if (norm(in.target.p - loop.settings.reach_centre) > loop.settings.reach)
            throw FarTarget();
        place();
        if (before.touches && dot(out, before.out) < 0) {
            found.turned = std::acos(std::max(-1.0, dot(out, before.out)));
            return found;
        }
        measure();
        const double share = noise_share();
        const bool compliant = split.compliance > 0;
        found.gain_scale = !compliant && before.gain * share > MOST ? MOST / (before.gain * share) : 1;
        move_along();
        act();
        const bool beyond = at_edge && (found.press.action == force::Action::follow || found.press.action == force::Action::approach);
        follow(arm, joints, beyond);
        remember(beyond, share);
        found.reports = reports(), found.lowered = lowered();
        kept = state;
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
    Vec3 point{}, grip{};   // the place of contact, where the tool is held
    Vec3 out{}, declared{}; // the way out, and that of the declared normal
    Vec3 moved{};           // how far the tool's point at the place of contact has come since the last tick
    Six load{};             // of the sensor's frame, with the bias
    Vec raw, W_raw, W, W_d; // wrenches: not smoothed, in the base frame; in the frame of the contact
    Mat J;                  // where the command acts
    bool at_edge = false;

    ArmState at(Vec q) const
    {
        if (functions.arm)
            return functions.arm(q, w);
        const Mat J(w, 6, m);
        return {J, loop.chain->state(q.p, J)};
    }
    TickInputs rest(const ArmState& arm) const
    {
        TickInputs still;
        still.q = in.q, still.velocity = in.velocity, still.stand_still = true, still.arm = &arm;
        return still;
    }
    Vec along_contact(Vec twist) const { return A * (P * (t(B) * twist)); }
    double noise() const { return std::max(task.noise, state.press.noise); }
    // The speed of the place of contact, turning counted by the size of the contact.
    double speed_of(Vec twist) const
    {
        return std::max({norm(velocity(twist)), task.size * twist.part(0, 3).norm(), TINY});
    }
    Vec3 velocity(Vec twist) const { return vec3(velocity_at(twist, vec(point, w))); }
    bool can_yield() const { return m >= 6 || n <= m - 2; }

    // The contact, with the estimated normal.
    void place()
    {
        found.contact = in.contact, point = in.contact * split.origin;
        set_frames();
        declared = out;
        const Vec3 axis = cross(declared, state.normal.tilt);
        if (const double sine = norm(axis); set.normal_within > 0 && sine > TINY) {
            const Mat3 turn = rotation((std::atan(sine) / sine) * axis);
            found.contact = {turn * in.contact.R, point + turn * (in.contact.p - point)};
            set_frames();
        }
        grip = tool * set.grip;
        at_edge = in.edge <= 0;
        if (!before.began)
            return;
        const Vec3 local = transposed(tool.R) * (point - tool.p);
        moved = point - before.tool * local;
    }
    void set_frames()
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
            to_base = coadjoint(tool * set.sensor->mount, w), load = without_weight(tool.R * set.sensor->mount.R);
        Six unsmoothed, smooth;
        force::read(state.press, task, load, unsmoothed, smooth);
        raw = to_base * vec(unsmoothed, w), found.wrench = to_base * vec(set.sensor ? deadband(smooth) : smooth, w);
        W = t(A) * found.wrench, W_raw = t(A) * raw;
        W_d = in.wrench.w ? in.wrench : view(split.wrench, w);
        found.error = B * (view(split.force, 6, 6, w) * (W_d - W)), found.wanted = B * W_d;
        found.intensities = intensities * W;
    }
    // The wrench that the tool exerts, in the sensor's frame at a rotation R: the reading without bias and weight.
    Six without_weight(const Mat3& R) const
    {
        const WrenchSensor& s = *set.sensor;
        const Vec3 f = s.mass * (transposed(R) * s.gravity), moment = cross(s.centre, f);
        Six found;
        for (int i = 0; i < 6; i++) {
            const double weight = i < 3 ? moment[i] : f[i - 3], rest = in.reading[i] - s.bias[i];
            found[i] = s.reaction ? weight - rest : rest + weight;
        }
        return found;
    }
    Six deadband(const Six& wrench) const
    {
        const WrenchSensor& s = *set.sensor;
        if (s.force_deadband == 0 && s.moment_deadband == 0)
            return wrench;
        const auto shortened = [](const Vec3& v, double by) {
            const double length = norm(v);
            return (length > by ? 1 - by / length : 0.0) * v;
        };
        const Vec3 f{wrench[3], wrench[4], wrench[5]}, m = Vec3{wrench[0], wrench[1], wrench[2]} - cross(s.origin, f);
        const Vec3 force = shortened(f, s.force_deadband), moment = shortened(m, s.moment_deadband) + cross(s.origin, force);
        return {moment[0], moment[1], moment[2], force[0], force[1], force[2]};
    }

    // The share of the joints' acceleration that noise takes through the force law, for each unit of its gain:
    //     max over joints j of   ABOVE sigma |x_j| / (a_j dt),     J x = A Z unit_rates-of-a-force
    // sigma is that of the change of a smoothed force component in a tick. What is left, the motion along the contact has:
    // where both ask for more than there is, the force is exact and the tool leaves its path.
    double noise_share() const
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
                M(i, j) *= std::isfinite(limits.acceleration[j]) ? limits.acceleration[j] : FREE * largest;
        const Mat asked = transposed(root * (A * (view(split.twist, 6, n, w) * unit_parts)));
        const RQ rq(m >= 6 ? M : transposed(M));
        const bool regular = m >= 6 && rq.regular(SINGULAR);
        std::optional<SVD> svd;
        if (!regular)
            svd.emplace(M);
        Vec squares(w, m, 0);
        for (int i = 3; i < 6; i++) {  // of each component of the force
            const Vec x = regular ? rq.least(asked[i]) : svd->least(asked[i], svd->rank(SINGULAR));
            for (int j = 0; j < m; j++)
                squares[j] += x[j] * x[j];
        }
        const double change = noise() * task.filter_share * std::sqrt(2 / (2 - task.filter_share));
        return ABOVE * change / task.dt * std::sqrt(*std::max_element(squares.begin(), squares.end()));
    }

    // The motion along the contact: the error no faster than `slide_speed`, and no jump for arms without acceleration limits.
    void move_along()
    {
        const double lag = std::isnan(state.press.lag) ? 0 : state.press.lag, gain = loop.settings.gain;
        found.motion_gain = gain * (lag - task.delay) > 1 ? std::min(gain, DELAY_SHARE / lag) : gain;
        const Vec chase = along_contact(found.motion_gain * vec(error_twist(in.target, tool), w));
        const Vec ahead = in.feedforward.w ? along_contact(in.feedforward) : Vec(w, 6, 0);
        found.motion = ahead + std::min(1.0, set.slide_speed / speed_of(chase)) * chase;
        if (state.press.silent())  // it stops sliding, and is then unloaded to see whether the sensor answers
            found.motion = Vec(w, 6, 0);
        if (loop.settings.limits.brakes)
            return;
        const Vec last = along_contact(vec(before.motion, w)), change = found.motion - last;
        const double fast = std::max({set.slide_speed, speed_of(last), speed_of(found.motion)});
        found.motion = last + std::min(1.0, fast * task.dt / TAKES_UP / speed_of(change)) * change;
    }

    // A tick of the force law and its monitor.
    void act()
    {
        const int presses = split.presses;
        force::Inputs now{n, presses};
        const auto to = [](auto& array, Vec v) { std::copy(v.begin(), v.end(), array.begin()); };
        to(now.wanted, unit_parts * W_d), to(now.force, unit_parts * W);
        to(now.press_wanted, intensities.rows_from(0, presses) * W_d), to(now.press, intensities.rows_from(0, presses) * W_raw);
        now.reading = six(in.reading), now.load = load;
        const Vec3 slides = velocity(found.motion);
        for (int i = 0; i < 3; i++)
            now.along[i] = task.size * found.motion[i], now.along[3 + i] = slides[i];
        if (before.began)
            displacements(now);
        limits(now);
        now.together = together(now);
        now.noise_share = found.gain_scale, now.came = -dot(out, moved), now.across = norm(moved + now.came * out);
        now.compliance = split.compliance, now.beyond = at_edge, now.yields = can_yield();
        const bool first = !before.began || before.press.waited > task.lost_after;
        found.press = force::tick(state.press, task, now);
        if (state.press.numbers != before.press.numbers)
            state.at_once = first;
        found.desired = n ? now.wanted[0] : 0;
    }
    // What the joints did since the last tick; along what is held, beside what was commanded.
    void displacements(force::Inputs& now) const
    {
        const Vec done = vec(log(tool * inverse(before.tool)), w), rates = unit_rates * (t(B) * done);
        std::copy(rates.begin(), rates.end(), now.done.begin());
        if (split.presses)
            return;
        const Mat root = root_at(vec(grip, w), task.size);
        const Vec given = task.dt * (root * vec(before.motion, w));
        now.along_given = given.norm();
        now.along_done = now.along_given > 0 ? given.dot(root * along_contact(done)) / now.along_given : 0;
    }
    // What is felt, and what is an overload: readings of the desired force stay below it.
    void limits(force::Inputs& now) const
    {
        const Load desired = load_at(found.wanted, {point});
        const double f = std::max(split.load[0], desired.force), moment = std::max(split.load[1], desired.moment);
        const double usual = f > 0 ? std::max(OVERLOAD * f, f + ABOVE_NOISE * noise()) : NO_FORCE;
        now.most[0] = std::isnan(set.max_force) ? usual : set.max_force;
        now.most[1] = std::isnan(set.max_moment) ? std::max(OVERLOAD * moment, moment + task.size * now.most[0]) : set.max_moment;
        const Load felt = load_at(raw, {point, grip});
        const Vec3 force = vec3(raw.part(3, 6));
        const double press = dot(out, force);
        now.felt = {std::isnan(set.max_force) ? std::max(std::abs(press), norm(force - press * out)) : felt.force, felt.moment};
        if (split.presses == 0) {
            const Load off = load_at(found.error, {point, grip});
            now.missing = std::max(off.force / now.most[0], off.moment / now.most[1]);
        }
    }
    // What is felt of all presses together, in the unit of the smallest: one of several may read what rubs at another.
    double together(const force::Inputs& now) const
    {
        double felt = 0, wanted = 0, least = INFINITY, all = 0;
        for (int i = 0; i < split.presses; i++) {
            all += now.press[i];
            if (now.press_wanted[i] > 0)
                felt += now.press[i], wanted += now.press_wanted[i], least = std::min(least, now.press_wanted[i]);
        }
        return split.presses > 1 && wanted > 0 ? least * felt / wanted : all;
    }

    // The twist, and the velocity that the loop makes of it.
    void follow(const ArmState& arm, LoopState& joints, bool beyond)
    {
        const force::Action action = found.press.action;
        found.force = Vec(w, 6, 0);
        if (action == force::Action::retreat || action == force::Action::hold)
            found.motion = Vec(w, 6, 0);
        if (action == force::Action::retreat)
            found.force = std::min(set.retreat_speed, (state.press.away - state.press.left) / task.dt) * (A * view(split.out, w));
        else if (beyond)
            found.force = over_the_edge();
        else if (action != force::Action::hold)
            found.force = A * (view(split.twist, 6, n, w) * Vec(found.press.rates.data(), n, &w));
        // What is held stays where it is: the arm is looked at where it will be when this command acts.
        ArmState then = arm;
        if (!split.presses && joints.whole + joints.part > 0) {
            Vec there(w, m), last(w, m);
            LoopState expected = joints;
            expected.observe(in.q, task.dt, loop.settings.revolution, loop.settings.limits.velocity);
            expected.predict(in.q, task.dt, there, last);
            then = at(there);
        }
        J = then.J;
        TickInputs next = rest(arm);
        const Vec twist = found.motion + found.force;
        if (action != force::Action::hold) {
            next.stand_still = false, next.feedforward = twist, next.at_base = true, next.arm = &then, next.posture = in.posture;
            if (set.measured_at_contact)
                next.measured_at = vec(point, w);
            if (set.force_first && n && can_yield())
                next.D = view(split.constraints, n, 6, w) * t(B), next.E = next.D * J, next.E_f = next.D * twist;
        }
        found.found = loop.tick(joints, next, functions, w);
        found.unreachable = can_yield() ? 0 : unreachable();
    }
    // Beyond the edge of a surface the tool rises by the slope times the distance from where it left the surface, so that it
    // comes back above the surface; down no faster than contact is looked for.
    Vec over_the_edge() const
    {
        if (!state.beyond_edge || split.out.empty())
            return Vec(w, 6, 0);
        const Vec leaves = A * view(split.out, w);
        const double lift = task.slope * norm(point - state.left) - state.lift;
        return std::max(lift / task.dt, -task.approach_speed) / speed_of(leaves) * leaves;
    }
    // The share of the motion along the contact that fewer than six joints turn into a press.
    double unreachable() const
    {
        const Mat root = root_at(vec(grip, w), task.size);
        const Vec asked = root * found.motion;
        const double speed = asked.norm();
        if (speed < SLOW * task.approach_speed)
            return 0;
        const SVD svd(root * found.J);
        const Vec off = found.J * svd.least(asked, svd.rank(6 * 2.2e-16)) - found.motion;
        const double share = (root * (off - along_contact(off))).norm() / speed;
        return share < UNREACHABLE ? 0 : share;
    }

    // What the next tick needs to know.
    void remember(bool beyond, double share)
    {
        const Report& said = found.found.report;
        const bool unresponsive = said.status == Status::degraded && has(said.reasons, Code::no_motion);
        state.gain = found.press.gain;
        state.room = std::max(1 - std::min(share * state.gain * found.gain_scale, 1.0), 1 - MOST);
        if (unresponsive && !state.press.touching()) {  // readings of an arm that ignores its commands show nothing
            const double room = state.room;
            const bool at_once = state.at_once;
            state = before, state.room = room, state.at_once = at_once;
            return;
        }
        const Vec twist = J * said.velocity;
        const double outwards = task.dt * dot(out, velocity(twist));
        std::array<double, force::MOST> given{};
        const Vec rates = task.dt * (unit_rates * (t(B) * twist));
        std::copy(rates.begin(), rates.end(), given.begin());
        const bool free = found.press.acts && said.scale > 0.9 && found.press.action == force::Action::follow && !beyond;
        force::commanded(state.press, task, given, outwards, free, beyond);
        state.began = true, state.tool = tool, state.touches = state.press.touching(), state.out = state.touches ? out : Vec3{};
        state.motion = six(found.motion);
        if (!beyond)
            state.beyond_edge = false, state.lift = 0;
        else if (!state.beyond_edge)
            state.beyond_edge = true, state.left = point, state.lift = 0;
        else
            state.lift += outwards;
        estimate_normal();
    }
    // The estimate after one more tick in touch; in the air what was estimated is forgotten.
    void estimate_normal()
    {
        if (set.normal_within == 0 || split.presses == 0 || !state.press.touching()) {
            state.normal = {};
            return;
        }
        NormalEstimate& e = state.normal;
        const double felt = (unit_parts * W)[0], wanted = found.desired, step = STEP * task.size;
        const double k = task.stiffness > 0 ? task.stiffness : state.press.parts[0].response.bound;
        if (std::isnan(e.press) && std::abs(felt - wanted) > force::SHORT * wanted)
            return;  // while a touch rises by much, what the stiffness is off by would look like a slope
        e.press = std::isnan(e.press) ? felt : e.press, e.displacement = e.displacement + moved;
        const double height = dot(declared, e.displacement), rise = height + (felt - e.press) / k;
        const Vec3 along = e.displacement - height * declared;
        if (dot(along, along) < step * step)
            return;
        const double kept = std::exp(-1 / MEMORY);
        for (int i = 0; i < 3; i++)
            e.squares[i] = kept * e.squares[i] + along[i] * along;
        e.rises = kept * e.rises + rise * along;
        // Where the declared normal turns, older displacements have a part along it: it is left out.
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
        e.displacement = {}, e.press = felt;
    }

    // The force gain's scale where it is so low that it is reported, else 1.
    double lowered() const { return found.gain_scale < LOWERED && state.press.touching() ? found.gain_scale : 1; }
    bool reports() const
    {
        const force::Output& press = found.press;
        return press.reason != force::Reason::none || press.lost || press.doubts || in.edge < std::max(set.edge_margin, TINY)
               || lowered() < 1 || found.unreachable > 0 || state.normal.bound > 0
               || found.motion_gain < loop.settings.gain;
    }
};

}  // namespace

HybridTick Hybrid::tick(HybridState& state, const Loop& loop, LoopState& joints, const ContactSplit& split, const HybridInputs& in,
                        const LoopFunctions& functions, Workspace& w) const
{
    return TickInContact(settings, HybridState(state), loop, split, in, functions, w).all(state, joints);
}

}  // namespace iq
