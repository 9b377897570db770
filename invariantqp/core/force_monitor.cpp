// The monitor of a press. Each check, the fault it finds, an example, and the test that fails without it:
//
//     overload           too much force or moment                     a jump of 30 N             test_faults, test_monitor
//     stale sensor       a reading that repeats to the last bit       an unplugged sensor        test_faults
//     tension            a contact that seems to pull                 a wrong sign               test_faults
//     approach           no contact, or an arm that does not follow   brakes on, a thin part     test_monitor
//     last contact       too little force where contact was felt      a sensor that fails        test_last_contact
//     consistency        readings that contradict the displacement    a stuck or drifting sensor test_unloading
//     oscillation        a force that oscillates or is not reached    an undeclared delay        test_impact
#include "force.hpp"

namespace iq::force {
namespace {

constexpr double RECENT = 0.3, AT_REST = 0.5;  // [s]

struct FaultDecision {
    Fault fault = Fault::none;
    std::array<double, 4> numbers{};
    double distance = NAN;  // of the retreat from here; NaN: the task's, from the touch
    explicit operator bool() const { return fault != Fault::none; }
};

bool is_loss(Fault fault)
{
    return fault == Fault::not_following || fault == Fault::lost || fault == Fault::no_contact_distance || fault == Fault::no_contact_time;
}

FaultDecision check_overload(State& st, const Settings& s, const Inputs& in)
{
    bool over = false;
    for (int i = 0; i < 2; i++) {  // after the desired force was lowered, the limit falls with the force
        st.overload[i] = std::max(in.limit[i], std::min(std::exp(-s.dt / SETTLING_TIME) * st.overload[i], OVERLOAD * in.measured[i]));
        over = over || in.measured[i] > st.overload[i];
    }
    if (!over)
        return {};
    return {Fault::overload, {in.measured[0], st.overload[0], in.measured[1], st.overload[1]}};
}

FaultDecision check_stale_sensor(State& st, const Settings& s, const Inputs& in, double sigma)
{
    constexpr double STALE_AFTER = 0.1;  // [s]
    const bool repeats = st.has_reading && sigma > 0 && st.last_reading == in.reading, moves = in.came != 0 || in.across > 0;
    st.time_unchanged = repeats ? st.time_unchanged + (moves ? s.dt : 0) : 0;
    st.has_changed = st.has_changed || sigma == 0 || in.presses == 0 || (st.has_reading && !repeats);
    if (st.time_unchanged <= STALE_AFTER)
        return {};
    return {Fault::stale_sensor, {st.time_unchanged}};
}

FaultDecision check_tension(State& st, const Settings& s, const Inputs& in, const TickSignals& now)
{
    double desired = INFINITY;
    bool unloads = false;
    for (int i = 0; i < in.presses; i++) {
        if (in.desired_press[i] > 0)
            desired = std::min(desired, in.desired_press[i]);
        unloads = unloads || st.parts[i].check.unloading.phase > 0;
    }
    if (desired == INFINITY || (s.tares && now.limit > 0 && !st.tare.is_done))
        return {};
    const bool is_sensitive = (unloads || (now.contact.airborne > 0 && !now.contact.never_touched())) && now.limit > 0;
    st.tension_evidence = updated_evidence(st.tension_evidence, -in.total_press, is_sensitive ? now.limit : std::max(now.limit, 0.5 * desired), now.sigma);
    if (st.tension_evidence < CERTAIN)
        return {};
    return {Fault::tension, {-in.total_press}};
}

FaultDecision check_approach(State& st, const Settings& s, const Inputs& in, const ContactTest& contact)
{
    ApproachCheck& a = st.approach;
    if (in.presses == 0 || contact.touching) {
        a = {};
        return {};
    }
    constexpr double DECIDED = 0.632, FOLLOWS = 0.2, MOVES = 0.02;  // 1 - 1/e of the window; shares of the commanded displacement
    const double window = 0.5 * s.retreat_distance, nearer = -st.outwards, kept = std::exp(-std::abs(nearer) / window);
    a.commanded = kept * a.commanded + nearer, a.measured = kept * a.measured + in.came;
    a.time += s.dt, a.distance += std::max(0.0, nearer);
    if (!contact.never_touched()) {
        if (s.on_loss == OnLoss::retreat && contact.airborne > s.lost_after)
            return {Fault::lost, {contact.airborne}};
        if (s.on_loss == OnLoss::go_on)
            return {};
    }
    if (a.commanded > DECIDED * window && a.measured < FOLLOWS * a.commanded) {
        if (a.measured > MOVES * a.commanded)
            return {Fault::blocked, {a.commanded, a.measured}};
        return {Fault::not_following, {a.commanded, a.measured}, 0};
    }
    if (a.distance > s.approach_distance)
        return {Fault::no_contact_distance, {s.approach_distance}, 0};
    if (a.time > s.approach_time)
        return {Fault::no_contact_time, {s.approach_time}, 0};
    return {};
}

// Tracks the place where contact was felt last, and finds a press that is not read there any more.
FaultDecision check_last_contact(Constraint& c, const Settings& s, const Inputs& in, int i)
{
    LastContact& last = c.last;
    const double force = in.force[i], desired = in.desired_press[i];
    if (desired <= 0 || in.beyond_edge) {
        last = {};
        return {};
    }
    const double speed = slope_speed(last.slope, s, in.along), led = last.led(speed, in.across, s.dt, s);
    const bool felt = c.contact.evidence == CERTAIN, reached = felt && force >= (1 - FORCE_TOLERANCE) * desired;
    last.measured += in.moved[i] - led, last.commanded += c.commanded - last.slip * s.dt - led;
    last.is_known = last.is_known || (reached && !c.estimate.is_learning), last.is_lost = last.is_known && !reached && (last.is_lost || !felt);
    if (felt && !last.is_lost) {
        const double kept = std::exp(-s.dt / SETTLING_TIME);
        last.measured = std::min(kept * last.measured, 0.0), last.commanded = std::min(kept * last.commanded, 0.0);
        last.slip = c.slip, last.desired = desired, last.stiffness = c.estimate.bound, last.slope = c.check.usual;
        last.is_classified = last.is_slope = false;
    }
    last.steepest = reached ? 0 : last.steepest + std::max(s.slope * in.across - s.dt * speed, 0.0);
    if (last.is_lost && !last.is_classified && c.contact.evidence == -CERTAIN) {
        last.is_classified = true, last.is_slope = last.stiffness * last.steepest > (1 - FORCE_TOLERANCE) * last.desired;
        if (last.is_slope)
            last.measured -= last.steepest, last.commanded -= last.steepest;
    }
    const bool is_unread = last.is_used_up(c.yields(s)) && c.contact.within(s.lost_after);
    last.time_without_response = last.is_lost ? last.time_without_response + (is_unread ? s.dt : 0) : 0;
    if (last.time_without_response > SETTLING_TIME)
        return {Fault::no_response, {0, force, desired}};
    return {};
}

FaultDecision unload(Constraint& c, const Settings& s, double force, double desired, double noise)
{
    ConsistencyCheck& check = c.check;
    UnloadingTest& test = check.unloading;
    const double unloaded = test.start_depth - check.depth, least = std::max(c.estimate.lower(), 0.1 * c.estimate.bound);
    const double change = std::max(0.5 * FORCE_TOLERANCE * test.start_force, 6 * noise);
    test.commanded += std::max(0.0, -c.commanded);
    if (std::abs(force - test.extreme_force) > 6 * noise)  // readings change: go on
        test.extreme_force = force, test.max_distance = std::max(test.max_distance, unloaded + STEP * s.size);
    if (force > test.start_force + change) {  // it rises as the tool leaves: the surface follows the tool
        check.restart(force, c.slope, std::max(check.surface_motion, 2 * std::max(unloaded, 0.0) + STEP * s.size));
        return {};
    }
    const bool falls = force < test.start_force - change;
    if (test.phase == 1) {
        if (falls && !test.is_static) {  // the readings respond
            const ConsistencyCheck before = check;
            check.restart(force, before.usual, before.surface_motion);
            const double shown = (before.unloading.start_force - force) / std::max({unloaded, before.unloading.commanded, RESOLUTION * s.size});
            if (shown < c.estimate.bound / 4)
                c.estimate.set_prior(shown);
            check.depth = before.depth, check.stiffness = std::min(before.stiffness, shown / 2);
        } else if (falls || unloaded > std::min(2 * FORCE_TOLERANCE * test.start_force / least + RESOLUTION * s.size, test.max_distance)
                   || test.commanded > s.retreat_distance)
            test.phase = 2;
        return {};
    }
    if (c.contact.evidence == -CERTAIN && std::isnan(test.distance_at_zero) && test.start_force > FORCE_TOLERANCE * desired)  // a smaller force is hardly above the noise
        test.distance_at_zero = unloaded;
    if (!std::isnan(test.distance_at_zero)) {
        if (test.is_static && unloaded - test.distance_at_zero < std::max(0.5 * test.distance_at_zero, STEP * s.size)
            && test.commanded < test.max_distance + s.retreat_distance)
            return {};  // a reading that is too low falls below zero, which `check_tension` finds
        // Nothing is read in the air: the sensor is right, and the surface has moved.
        const double motion = test.is_static ? std::max(check.surface_motion, 2 * std::abs(test.start_depth - check.rest_depth)) : check.surface_motion;
        check = {};
        check.surface_motion = motion;
        return {};
    }
    if (unloaded > test.max_distance || test.commanded > test.max_distance + s.retreat_distance)
        return {Fault::no_response, {unloaded, force, desired}, std::max(0.0, check.depth + 2 * STEP * s.size)};
    return {};
}

FaultDecision check_consistency(State& st, Constraint& c, const Settings& s, const Inputs& in, int i, const TickSignals& now)
{
    ConsistencyCheck& check = c.check;
    const double force = in.force[i], desired = in.desired_press[i], moved = in.moved[i], tolerance = FORCE_TOLERANCE * desired;
    const bool rests = st.time_at_rest > AT_REST;
    // A press that was held and that noise takes below what counts as contact is one; a tool that bounces at the impact is in the air.
    const bool in_contact = c.estimate.reached ? c.contact.within(s.lost_after) : c.contact.touching;
    if (!in_contact && check.unloading.phase == 0) {
        check.restart(force, c.slope, check.surface_motion);
        return {};
    }
    check.depth += moved, check.slid_at_rest += in.across;
    if (check.unloading.phase > 0)
        return unload(c, s, force, desired, now.noise);

    // A displacement commanded beyond the usual slope that the force does not answer. The joints need not show it: a servo that
    // stands against a stop presses harder and harder.
    const double usual = check.usual[0] + slope_speed(check.usual, s, in.along);
    for (int j = 0; j < SLOPE_TERMS; j++)
        check.usual[j] += check.is_unresponsive ? 0 : std::min(1.0, s.dt / RECENT) * (c.slope[j] - check.usual[j]);
    const bool is_off = std::abs(force - desired) > tolerance;
    const double kept = std::exp(-s.dt / (2 * RECENT));
    const double steepest = c.estimate.bound * (s.slope * in.across + std::abs(moved)) + std::max(0.5 * tolerance, 8 * now.sigma);
    check.jump_time = std::abs(in.press[i] - check.last_press) > steepest ? AT_REST : std::max(check.jump_time - s.dt, 0.0);
    check.has_jumped = is_off && (check.has_jumped || check.jump_time > 0), check.last_press = in.press[i];
    check.extra += c.commanded;
    if (is_off)
        check.slid_while_off += in.across;
    else
        check.slid_while_off *= kept, check.extra = kept * (check.extra - std::clamp(usual * s.dt, std::min(c.commanded, 0.0), std::max(c.commanded, 0.0)));
    check.min_force = std::min(check.min_force, force), check.max_force = std::max(check.max_force, force);
    if (check.max_force - check.min_force > std::max(0.05 * desired, 8 * now.noise)) {  // the force changes
        check.extra = check.slid_while_off = 0, check.min_force = check.max_force = force, check.is_unresponsive = false;
        check.last_stiffness = check.stiffness / 2, check.stiffness = 0;
    }
    if (check.stiffness == 0)  // a constant reading looks soft, too: the last change counts
        check.stiffness = std::max({c.estimate.lower(), 0.25 * c.estimate.bound, check.last_stiffness});
    const double sloped = check.has_jumped || !c.estimate.reached ? 0 : std::min(s.slope * check.slid_while_off, OVERLOAD * desired / check.stiffness);
    check.unexplained_force = check.stiffness * std::max(0.0, std::abs(check.extra) - s.yields - sloped);
    check.is_unresponsive = check.is_unresponsive || check.unexplained_force > std::max(desired, 40 * now.noise);  // noise hides a light press
    if (check.is_unresponsive && rests)
        check.start_unloading(force, s, false);

    // A constant force while the tool moves: a bias that drifts moves the tool, as a surface that moves would.
    if (!rests || check.rest_desired != desired) {
        check.time_at_rest = check.time_off = 0, check.rest_depth = NAN, check.rest_desired = desired;
        return {};
    }
    if (std::isnan(check.rest_depth)) {
        check.time_at_rest = std::abs(force - desired) < tolerance ? check.time_at_rest + s.dt : 0;
        if (check.time_at_rest >= SETTLING_TIME)
            check.rest_depth = check.depth, check.rest_force = force, check.slid_at_rest = 0;
        return {};
    }
    const double moved_at_rest = check.depth - check.rest_depth, change = force - check.rest_force, upper = c.estimate.bound;
    const double free = s.slope * check.slid_at_rest + s.yields + check.surface_motion + RESOLUTION * s.size;  // displacement without a change of force
    const double low = (moved_at_rest > free ? c.estimate.lower() : upper) * (moved_at_rest - free);
    const double high = (moved_at_rest < -free ? c.estimate.lower() : upper) * (moved_at_rest + free);
    if (check.time_off == 0)
        check.off_depth = check.depth;
    check.time_off = std::max(low - change, change - high) > std::max(tolerance, 6 * now.noise) ? check.time_off + s.dt : 0;
    constexpr double DECIDED = 0.2;  // [s]
    if (check.time_off > DECIDED && check.stiffness * std::abs(check.depth - check.off_depth) > 2.5 * desired * check.time_off)  // no bias drifts so fast
        check.surface_motion = std::max(check.surface_motion, 2 * std::abs(moved_at_rest)), check.time_off = check.time_at_rest = 0, check.rest_depth = NAN;
    else if (check.time_off > DECIDED && force >= 12 * now.noise)  // noise would hide a fall
        check.start_unloading(force, s, true);
    return {};
}

void monitor_oscillation(State& st, const Settings& s, const Inputs& in, const TickSignals& now)
{
    constexpr double AVERAGED = 0.2, AMPLITUDE = 0.3, RECOVERY = 20;  // [s], of the desired press, [s]
    constexpr int REVERSALS = 5;
    OscillationMonitor& o = st.oscillation;
    o.gain_scale = std::min(1.0, o.gain_scale * std::exp(s.dt / RECOVERY));
    o.since_oscillation += s.dt, o.since_reversal += s.dt;
    const auto average = [&](double value) { o.mean = std::isnan(o.mean) ? value : o.mean + std::min(1.0, s.dt / AVERAGED) * (value - o.mean); };
    if (in.presses == 0) {
        average(in.missing);
        o.time_off = o.mean > FORCE_TOLERANCE ? o.time_off + s.dt : 0;
        return;
    }
    double press = in.press[0], desired = in.desired_press[0];
    for (int i = 1; i < in.presses; i++)
        if (in.press[i] * desired < press * in.desired_press[i])
            press = in.press[i], desired = in.desired_press[i];
    if (!now.contact.within(s.lost_after) || desired != o.desired || desired == 0) {
        o.mean = NAN, o.time_off = o.reversals = 0, o.is_rising = true, o.extreme = press, o.desired = desired;
        return;
    }
    average(press);
    o.time_off = std::abs(o.mean - desired) > FORCE_TOLERANCE * desired ? o.time_off + s.dt : 0;
    const double back = o.is_rising ? o.extreme - press : press - o.extreme;
    if (back <= std::max(AMPLITUDE * desired, 10 * now.sigma)) {
        o.extreme = back < 0 ? press : o.extreme;
        return;
    }
    const double since = o.since_reversal;
    // About the desired press, not on the way to it, and as soon as a loop with this delay oscillates.
    if ((o.extreme > desired) == o.is_rising)
        o.reversals = (since < std::max(WINDOW * now.delay, 0.4) ? o.reversals : 0) + 1;
    o.since_reversal = 0, o.is_rising = !o.is_rising, o.extreme = press;
    if (o.reversals > REVERSALS) {
        o.since_oscillation = 0, o.reversals--;
        if (since > now.delay)  // a faster oscillation is not the law's
            o.gain_scale = std::max(0.25, 0.5 * o.gain_scale), o.reversals = 0;
    }
}

void stop(State& st, const Settings& s, const FaultDecision& decision)
{
    st.stop = {decision.fault, decision.numbers, 0, decision.distance};
    if (!std::isnan(decision.distance))
        return;
    const double back = st.pushed + (is_loss(decision.fault) || decision.fault == Fault::overload ? 0 : st.approached);
    st.stop.retreated = -std::min(back, s.approach_distance), st.stop.distance = s.retreat_distance;
}

FaultDecision decide(State& st, const Settings& s, const Inputs& in, const TickSignals& now)
{
    FaultDecision found = check_overload(st, s, in);
    if (found || st.stop.fault != Fault::none)
        return found;
    const auto add = [&found](const FaultDecision& next) { found = found ? found : next; };
    add(check_stale_sensor(st, s, in, now.sigma));
    add(check_tension(st, s, in, now));
    const FaultDecision lost = now.is_taring ? FaultDecision{} : check_approach(st, s, in, now.contact);
    const bool pressed = std::any_of(in.desired_press.begin(), in.desired_press.begin() + in.presses, [](double press) { return press > 0; });
    if (now.limit > 0 && pressed && !now.is_taring)
        for (int i = 0; i < in.presses && st.time_unchanged == 0; i++)
            add(check_consistency(st, st.parts[i], s, in, i, now));
    for (int i = 0; i < in.presses && now.limit > 0; i++)
        add(check_last_contact(st.parts[i], s, in, i));
    if (in.presses == 0 || now.limit > 0)
        monitor_oscillation(st, s, in, now);
    add(lost);
    return found;
}

}  // namespace

void ConsistencyCheck::restart(double force, const Slope& slope, double motion)
{
    *this = {};
    surface_motion = motion, min_force = max_force = force, usual = slope;
}

void ConsistencyCheck::start_unloading(double force, const Settings& s, bool is_static)
{
    unloading = {1, depth, force, force, 0, std::max(depth, 0.0) + STEP * s.size + s.yields + surface_motion, NAN, is_static};
}

void monitor(State& st, const Settings& s, const Inputs& in, const TickSignals& now, Output& out)
{
    Stop& stopped = st.stop;
    if (stopped.fault == Fault::none || is_loss(stopped.fault))
        if (const FaultDecision found = decide(st, s, in, now))
            stop(st, s, found);
    constexpr double REPORTED = 2.2, BIAS = 0.3;  // [s] after an oscillation; of the press that a drift may reach
    for (int i = 0; i < in.presses; i++)
        out.warnings |= (st.parts[i].check.unloading.phase > 0 ? UNLOADING : 0) | (st.parts[i].check.is_unresponsive ? UNRESPONSIVE : 0);
    out.warnings |= (st.oscillation.since_oscillation < REPORTED ? OSCILLATES : 0) | (st.oscillation.time_off > SETTLING_TIME ? NOT_REACHED : 0)
                    | (st.noise.sigma > 0 ? NOISY : 0) | (now.is_taring ? TARING : 0);
    if (s.tares && in.presses > 0 && now.contact.touching && s.drift * st.tare.age > BIAS * in.desired_press[0])
        out.warnings |= TARE_IS_OLD;
    out.fault = stopped.fault;
    if (stopped.fault != Fault::none) {
        // A surface that follows the tool makes the retreat longer: it goes on while the force rises.
        stopped.min_force = std::min(stopped.min_force, in.measured[0]);
        if (in.presses > 0 && !is_loss(stopped.fault) && in.measured[0] > stopped.min_force + std::max(0.5 * in.desired_press[0], 10 * now.sigma))
            stopped.distance = std::max(stopped.distance, stopped.retreated + STEP * s.size);
        const bool retreats = is_loss(stopped.fault) ? s.on_loss == OnLoss::retreat : s.fault_retreats;
        out.action = retreats && stopped.retreated < (1 - 1e-9) * stopped.distance ? Action::retreat : Action::hold;
        return;
    }
    if (now.contact.within(s.lost_after))
        return;
    out.lost = true;
    if (now.contact.never_touched() || s.on_loss == OnLoss::approach || s.on_loss == OnLoss::retreat)
        out.action = Action::approach;
    else if (s.on_loss == OnLoss::hold)
        out.action = Action::hold;
    for (int i = 0; i < in.presses; i++)
        if (out.action == Action::approach && st.parts[i].last.is_used_up(st.parts[i].yields(s)))
            out.action = Action::hold;
}

}  // namespace iq::force
