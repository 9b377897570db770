// The monitor of a press. Each check, the fault it finds, the scene that shows it, and the test that fails without it:
//
//     overload      too much force or moment                    a jump of 30 N          test_faults, test_watch
//     dead          a reading that repeats to the last bit      an unplugged sensor     test_faults
//     pulls         a contact that is read to pull              a wrong sign            test_faults
//     approach      no contact, or an arm that does not follow  brakes on, a thin part  test_watch
//     reach         too little read where contact was felt      a cable half out        test_reach
//     unloading     readings that ignore the way, at rest       a stuck or drifting sensor   test_unloading
//     silence       readings that ignore the way, sliding       the same                test_unloading
//     settling      a force that swings or is not reached       an undeclared delay     test_touch
#include "force.hpp"

namespace iq::force {
namespace {

constexpr double STEP = 0.02, DEAD_AFTER = 0.1, SWING = 0.3, SWING_TIME = 2.2, REST = 0.5, USUAL = 0.3;
constexpr int SWINGS = 5;

struct Finding {
    Reason reason = Reason::none;
    std::array<double, 4> numbers{};
    double away = NAN;  // from the touch; NaN is the retreat of the task
};

bool is_loss(Reason reason)
{
    return reason == Reason::not_following || reason == Reason::lost || reason == Reason::no_contact_way || reason == Reason::no_contact_time;
}

Finding overload(State& st, const Settings& s, const Inputs& in)
{
    bool over = false;
    for (int i = 0; i < 2; i++) {  // a press that was wanted before is expected while it falls
        st.most[i] = std::max(in.most[i], std::min(std::exp(-s.dt / PATIENCE) * st.most[i], OVERLOAD * in.felt[i]));
        over = over || in.felt[i] > st.most[i];
    }
    if (!over)
        return {};
    return {Reason::overload, {in.felt[0], st.most[0], in.felt[1], st.most[1]}};
}

Finding dead(State& st, const Settings& s, const Inputs& in, double sigma)
{
    const bool same = st.read && sigma > 0 && st.last == in.reading, moves = in.came != 0 || in.across > 0;
    st.unchanged = same ? st.unchanged + (moves ? s.dt : 0) : 0;
    st.alive = st.alive || sigma == 0 || in.presses == 0 || (st.read && !same);
    if (st.unchanged <= DEAD_AFTER)
        return {};
    return {Reason::dead, {st.unchanged}};
}

Finding pulls(State& st, const Settings& s, const Inputs& in, const Touch& touch, double limit, double sigma)
{
    double wanted = INFINITY;
    bool asks = false;
    for (int i = 0; i < in.presses; i++) {
        if (in.press_wanted[i] > 0)
            wanted = std::min(wanted, in.press_wanted[i]);
        asks = asks || st.parts[i].check.phase > 0;
    }
    if (wanted == INFINITY || (s.tares && limit > 0 && !st.tared))
        return {};
    const bool close = (asks || (touch.airborne > 0 && touch.airborne < INFINITY)) && limit > 0;
    st.pull = weighed(st.pull, -in.together, close ? limit : std::max(limit, 0.5 * wanted), sigma);
    if (st.pull < CERTAIN)
        return {};
    return {Reason::pulls, {-in.together}};
}

Finding approach(State& st, const Settings& s, const Inputs& in, const Touch& touch)
{
    if (in.presses == 0 || touch.touching) {
        st.waited = st.led = st.came = st.way = 0;
        return {};
    }
    constexpr double JUDGED = 0.632, FOLLOWED = 0.2, MOVED = 0.02;
    const double over = 0.5 * s.retreat_distance, nearer = -st.out_shown, kept = std::exp(-std::abs(nearer) / over);
    st.led = kept * st.led + nearer, st.came = kept * st.came + in.came;
    st.waited += s.dt, st.way += std::max(0.0, nearer);
    const bool before = touch.airborne == INFINITY;
    if (s.on_loss == Loss::retreat && !before && touch.airborne > s.lost_after)
        return {Reason::lost, {touch.airborne}};
    if (s.on_loss == Loss::go_on && !before)
        return {};
    if (st.led > JUDGED * over && st.came < FOLLOWED * st.led) {
        if (st.came > MOVED * st.led)
            return {Reason::held_back, {st.led, st.came}};
        return {Reason::not_following, {st.led, st.came}, 0};
    }
    if (st.way > s.approach_distance)
        return {Reason::no_contact_way, {s.approach_distance}, 0};
    if (st.waited > s.approach_time)
        return {Reason::no_contact_time, {s.approach_time}, 0};
    return {};
}

// Follows the place where contact is felt; finds a press that is not read where it was reached before.
Finding reach(Constraint& c, const Settings& s, const Inputs& in, int i)
{
    Reach& r = c.reach;
    const double force = in.force[i], wanted = in.press_wanted[i];
    if (wanted <= 0 || in.beyond) {
        r = {};
        return {};
    }
    const double slope = slope_rate(r.slope, s, in.along), led = r.led(slope, in.across, s.dt, s);
    const bool felt = c.touch.evidence == CERTAIN, reached = felt && force >= (1 - SHORT) * wanted;
    r.done += in.done[i] - led, r.sent += c.given - r.slip * s.dt - led;
    r.known = r.known || (reached && !c.response.learns), r.held = r.known && !reached && (r.held || !felt);
    if (felt && !r.held) {
        const double kept = std::exp(-s.dt / PATIENCE);
        r.done = std::min(kept * r.done, 0.0), r.sent = std::min(kept * r.sent, 0.0);
        r.slip = c.slip, r.wanted = wanted, r.bound = c.response.bound, r.slope = c.check.usual;
        r.judged = r.sloped = false;
    }
    r.falls = reached ? 0 : r.falls + std::max(s.slope * in.across - s.dt * slope, 0.0);
    if (r.held && !r.judged && c.touch.evidence == -CERTAIN) {
        r.judged = true, r.sloped = r.bound * r.falls > (1 - SHORT) * r.wanted;
        if (r.sloped)
            r.done -= r.falls, r.sent -= r.falls;
    }
    r.stands = r.held ? r.stands + (r.used_up(s.yields + c.check.moves) && c.touch.lasts(s.lost_after) ? s.dt : 0) : 0;
    if (r.stands > PATIENCE)
        return {Reason::no_response, {0, force, wanted}};
    return {};
}

void ask(Check& k, double force, const Settings& s, bool surface)
{
    k.phase = 1, k.surface = surface, k.began = k.depth, k.force = k.lowest = force, k.led = 0, k.fell = NAN;
    k.ends = std::max(k.depth, 0.0) + STEP * s.size + s.yields + k.moves;
}

// The unloading test: first a share of the press is let go, then all of it.
Finding unload(Check& k, Constraint& c, const Settings& s, double force, double wanted, double noise)
{
    const double gone = k.began - k.depth, least = std::max(c.response.least(), 0.1 * c.response.bound);
    k.led += std::max(0.0, -c.given);
    if (std::abs(force - k.lowest) > 6 * noise)  // readings change
        k.lowest = force, k.ends = std::max(k.ends, gone + STEP * s.size);
    if (force > k.force + std::max(0.5 * SHORT * k.force, 6 * noise)) {  // it rises as the tool leaves: the surface comes after it
        const double moves = std::max(k.moves, 2 * std::max(gone, 0.0) + STEP * s.size);
        k = {};
        k.moves = moves, k.low = k.high = force, k.usual = c.slope;
        return {};
    }
    const bool falls = force < k.force - std::max(0.5 * SHORT * k.force, 6 * noise);
    if (k.phase == 1) {
        if (falls && !k.surface) {  // it answers
            const Check before = k;
            k = {};
            const double shown = (before.force - force) / std::max({gone, before.led, RESOLVED * s.size});
            if (shown < c.response.bound / 4)
                c.response.show(shown);
            k.depth = before.depth, k.moves = before.moves, k.least = std::min(before.least, shown / 2), k.low = k.high = force, k.usual = before.usual;
        } else if (falls || gone > std::min(2 * SHORT * k.force / least + RESOLVED * s.size, k.ends) || k.led > s.retreat_distance)
            k.phase = 2;
        return {};
    }
    if (c.touch.evidence == -CERTAIN && std::isnan(k.fell) && k.force > SHORT * wanted)  // less was hardly told from the air before
        k.fell = gone;
    if (!std::isnan(k.fell)) {
        if (k.surface && gone - k.fell < std::max(0.5 * k.fell, STEP * s.size) && k.led < k.ends + s.retreat_distance)
            return {};  // a reading that is too low falls below nothing, which `pulls` finds
        // Nothing is read in the air: the sensor is right, the surface has moved.
        const double moves = k.surface ? std::max(k.moves, 2 * std::abs(k.began - k.rest_depth)) : k.moves;
        k = {};
        k.moves = moves;
        return {};
    }
    if (gone > k.ends || k.led > k.ends + s.retreat_distance)
        return {Reason::no_response, {gone, force, wanted}, std::max(0.0, k.depth + 2 * STEP * s.size)};
    return {};
}

// Whether readings answer the way that the joints did.
Finding response(State& st, Constraint& c, const Settings& s, const Inputs& in, int i, double noise, double sigma)
{
    Check& k = c.check;
    const double force = in.force[i], wanted = in.press_wanted[i], done = in.done[i];
    const bool rests = st.still > REST;
    // A press that was held and that flickers with noise about what counts as contact is one; a tool that bounces at the touch is in the air.
    const bool there = c.response.reached ? c.touch.lasts(s.lost_after) : c.touch.touching;
    if (!there && k.phase == 0) {
        const double moves = k.moves;
        k = {};
        k.moves = moves, k.low = k.high = force, k.usual = c.slope;
        return {};
    }
    k.depth += done, k.slid += in.across;
    if (k.phase > 0)
        return unload(k, c, s, force, wanted, noise);

    // Way that was commanded beyond the usual speed, and that the force has not answered. No joint need show it: a servo
    // that stands against a stop presses harder and harder.
    const double usual = k.usual[0] + slope_rate(k.usual, s, in.along);
    for (int j = 0; j < 7; j++)
        k.usual[j] += k.silent ? 0 : std::min(1.0, s.dt / USUAL) * (c.slope[j] - k.usual[j]);
    const bool off = std::abs(force - wanted) > SHORT * wanted;
    const double kept = std::exp(-s.dt / (2 * USUAL));
    const double steepest = c.response.bound * (s.slope * in.across + std::abs(done)) + std::max(0.5 * SHORT * wanted, 8 * sigma);
    k.jumps = std::abs(in.press[i] - k.before) > steepest ? REST : std::max(k.jumps - s.dt, 0.0);
    k.jumped = off && (k.jumped || k.jumps > 0), k.before = in.press[i];
    k.extra += c.given;
    if (off)
        k.across += in.across;
    else
        k.across *= kept, k.extra = kept * (k.extra - std::clamp(usual * s.dt, std::min(c.given, 0.0), std::max(c.given, 0.0)));
    k.low = std::min(k.low, force), k.high = std::max(k.high, force);
    if (k.high - k.low > std::max(0.05 * wanted, 8 * noise))
        k.extra = k.across = 0, k.low = k.high = force, k.silent = false, k.shown = k.least / 2, k.least = 0;
    if (k.least == 0)  // a reading that stands looks soft, too: what was shown before counts
        k.least = std::max({c.response.least(), 0.25 * c.response.bound, k.shown});
    const double least = k.least;
    const double slope = k.jumped || !c.response.reached ? 0 : std::min(s.slope * k.across, OVERLOAD * wanted / least);
    k.unexplained = least * std::max(0.0, std::abs(k.extra) - s.yields - slope);
    k.silent = k.silent || k.unexplained > std::max(wanted, 40 * noise);  // a light press drowns
    if (k.silent && rests)
        ask(k, force, s, false);

    // A force that stands while the way changes: a bias that drifts moves the tool, as a surface that moves would.
    if (!rests || k.rest_wanted != wanted) {
        k.rested = k.off = 0, k.rest_depth = NAN, k.rest_wanted = wanted;
        return {};
    }
    if (std::isnan(k.rest_depth)) {
        k.rested = std::abs(force - wanted) < SHORT * wanted ? k.rested + s.dt : 0;
        if (k.rested >= PATIENCE)
            k.rest_depth = k.depth, k.rest_force = force, k.slid = 0;
        return {};
    }
    const double way = k.depth - k.rest_depth, room = s.slope * k.slid + s.yields + k.moves + RESOLVED * s.size, most = c.response.bound;
    const double low = (way > room ? c.response.least() : most) * (way - room), high = (way < -room ? c.response.least() : most) * (way + room);
    const double missing = std::max(low - (force - k.rest_force), (force - k.rest_force) - high);
    if (k.off == 0)
        k.off_depth = k.depth;
    k.off = missing > std::max(SHORT * wanted, 6 * noise) ? k.off + s.dt : 0;
    if (k.off > SHORT && least * std::abs(k.depth - k.off_depth) > 2.5 * wanted * k.off)  // no bias drifts so fast: the surface moves
        k.moves = std::max(k.moves, 2 * std::abs(way)), k.off = k.rested = 0, k.rest_depth = NAN;
    else if (k.off > SHORT && force >= 12 * noise)  // noise would hide a fall
        ask(k, force, s, true);
    return {};
}

void settle(State& st, const Settings& s, const Inputs& in, bool lost, double sigma, double late)
{
    st.eased = std::min(1.0, st.eased * std::exp(s.dt / 20));
    st.swung += s.dt, st.since_turn += s.dt;
    if (in.presses == 0) {
        st.mean = std::isnan(st.mean) ? in.missing : st.mean + std::min(1.0, s.dt / 0.2) * (in.missing - st.mean);
        st.missed = st.mean > SHORT ? st.missed + s.dt : 0;
        return;
    }
    double felt = in.press[0], wanted = in.press_wanted[0];
    for (int i = 1; i < in.presses; i++)
        if (in.press[i] * wanted < felt * in.press_wanted[i])
            felt = in.press[i], wanted = in.press_wanted[i];
    if (lost || wanted != st.wanted || wanted == 0) {
        st.mean = NAN, st.missed = st.swings = 0, st.rises = true, st.extreme = felt, st.wanted = wanted;
        return;
    }
    st.mean = std::isnan(st.mean) ? felt : st.mean + std::min(1.0, s.dt / 0.2) * (felt - st.mean);
    st.missed = std::abs(st.mean - wanted) > SHORT * wanted ? st.missed + s.dt : 0;
    const double back = st.rises ? st.extreme - felt : felt - st.extreme;
    if (back <= std::max(SWING * wanted, 10 * sigma)) {
        st.extreme = back < 0 ? felt : st.extreme;
        return;
    }
    const double since = st.since_turn;
    // About the wanted press, not on the way to it, and as soon as a loop that is late by so much turns.
    if ((st.extreme > wanted) == st.rises)
        st.swings = (since < std::max(WINDOW * late, 0.4) ? st.swings : 0) + 1;
    st.since_turn = 0, st.rises = !st.rises, st.extreme = felt;
    if (st.swings > SWINGS) {
        st.swung = 0, st.swings--;
        if (since > late)  // what turns sooner would do so without the law
            st.eased = std::max(0.25, 0.5 * st.eased), st.swings = 0;
    }
}

void stop(State& st, const Settings& s, const Finding& finding)
{
    st.found = finding.reason, st.numbers = finding.numbers, st.least = INFINITY;
    if (!std::isnan(finding.away)) {
        st.left = 0, st.away = finding.away;
        return;
    }
    const double back = st.pushed + (is_loss(st.found) || st.found == Reason::overload ? 0 : st.approached);
    st.left = -std::min(back, s.approach_distance), st.away = s.retreat_distance;
}

Finding look(State& st, const Settings& s, const Inputs& in, const Touch& touch, double limit, double sigma, double noise, double late, bool probing)
{
    Finding found = overload(st, s, in);
    if (found.reason != Reason::none || st.found != Reason::none)
        return found;
    found = dead(st, s, in, sigma);
    const Finding pulled = pulls(st, s, in, touch, limit, sigma), lost = probing ? Finding{} : approach(st, s, in, touch);
    if (found.reason == Reason::none)
        found = pulled;
    bool pressed = false;
    for (int i = 0; i < in.presses; i++)
        pressed = pressed || in.press_wanted[i] > 0;
    if (limit > 0 && pressed && !probing)
        for (int i = 0; i < in.presses && st.unchanged == 0; i++)
            if (const Finding silent = response(st, st.parts[i], s, in, i, noise, sigma); silent.reason != Reason::none && found.reason == Reason::none)
                found = silent;
    for (int i = 0; i < in.presses && limit > 0; i++)
        if (const Finding low = reach(st.parts[i], s, in, i); low.reason != Reason::none && found.reason == Reason::none)
            found = low;
    if (in.presses == 0 || limit > 0)
        settle(st, s, in, !touch.lasts(s.lost_after), sigma, late);
    return found.reason != Reason::none ? found : lost;
}

}  // namespace

double slope_rate(const std::array<double, 7>& slope, const Settings& s, const std::array<double, 6>& along)
{
    const std::array<double, 7> phi = base_of(s, along);
    double rate = 0;
    for (int j = 1; j < 7; j++)
        rate += slope[j] * phi[j];
    return rate;
}

void watch(State& st, const Settings& s, const Inputs& in, const Touch& touch, double limit, double sigma, double noise,
           double late, bool probing, Output& out)
{
    if (st.found == Reason::none || is_loss(st.found)) {
        const Finding found = look(st, s, in, touch, limit, sigma, noise, late, probing);
        if (found.reason != Reason::none)
            stop(st, s, found);
    }
    for (int i = 0; i < in.presses; i++) {
        out.doubts |= (st.parts[i].check.phase > 0 ? UNLOADING : 0) | (st.parts[i].check.silent ? UNEXPLAINED : 0);
    }
    out.doubts |= (st.swung < SWING_TIME ? SWINGS_TOLD : 0) | (st.missed > PATIENCE ? NOT_REACHED : 0) | (st.noise > 0 ? NOISY : 0)
                  | (probing ? TARING : 0);
    if (s.tares && in.presses > 0 && touch.touching && s.drift * st.age > 0.3 * in.press_wanted[0])
        out.doubts |= NOT_TARED;
    out.reason = st.found;
    if (st.found != Reason::none) {
        // What comes after the tool is not held against: the retreat goes on while the force rises.
        st.least = std::min(st.least, in.felt[0]);
        if (!is_loss(st.found) && in.felt[0] > st.least + std::max(0.5 * (in.presses ? in.press_wanted[0] : 0.0), 10 * sigma) && in.presses > 0)
            st.away = std::max(st.away, st.left + STEP * s.size);
        const bool retreats = is_loss(st.found) ? s.on_loss == Loss::retreat : s.fault_retreats;
        out.action = retreats && st.left < (1 - 1e-9) * st.away ? Action::retreat : Action::hold;
        return;
    }
    if (touch.lasts(s.lost_after))
        return;
    out.lost = true;
    if (touch.airborne == INFINITY || s.on_loss == Loss::approach || s.on_loss == Loss::retreat)
        out.action = Action::approach;
    else if (s.on_loss == Loss::hold)
        out.action = Action::hold;
    for (int i = 0; i < in.presses; i++)
        if (out.action == Action::approach && st.parts[i].reach.used_up(s.yields + st.parts[i].check.moves))
            out.action = Action::hold;
}

}  // namespace iq::force
