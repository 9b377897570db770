#include "force.hpp"
#include <algorithm>
#include <complex>

namespace iq::force {

constexpr double PI = 3.14159265358979323846;

Gains gains(double k, double b, double late)
{
    const double excess = GAIN_MARGIN * CROSSOVER * b / k - late;
    const double tau = excess > 0 ? late * (std::sqrt(1 + excess / late) - 1) : 0;
    double g = CROSSOVER / (k * (late + tau));
    if (b > 0)
        g = std::min(g, (1 + tau / late) / (GAIN_MARGIN * b));
    return {g, tau, INTEGRAL / (g * k)};
}

Margins margins(const Gains& law, double k, double b, double late)
{
    constexpr int POINTS = 20000;  // of a logarithmic grid from 1e-4 to 1e3 in units of 1/late
    constexpr double LOW = 1e-4, HIGH = 1e3;
    Margins found{INFINITY, INFINITY, 0};
    double size_before = 0, phase_before = 0;
    for (int i = 0; i < POINTS; i++) {
        const double w = LOW / late * std::pow(HIGH / LOW, i / (POINTS - 1.0));
        // The phase is written out: an arctangent of L would leave out whole turns of the delay.
        const double phase = -PI - w * late + std::atan(w * law.Ti) - std::atan(w * law.tau) + std::atan2(b * w, k);
        const double size = law.g * std::hypot(1, 1 / (w * law.Ti)) / std::hypot(1, w * law.tau) * std::hypot(k, b * w) / w;
        if (i > 0) {
            const double turns = std::ceil((phase_before + PI) / (2 * PI)) - 1;  // the next crossing below
            const double crossing = -PI + 2 * PI * turns;
            if (phase < crossing && phase_before > crossing) {
                const double share = (phase_before - crossing) / (phase_before - phase);
                found.gain = std::min(found.gain, 1 / (size_before * std::pow(size / size_before, share)));
            }
            if ((size - 1) * (size_before - 1) <= 0 && size != size_before) {
                const double share = std::log(size_before) / std::log(size_before / size);
                const double there = phase_before + share * (phase - phase_before);
                found.phase = std::min(found.phase, std::abs(std::remainder(there + PI, 2 * PI)));
            }
        }
        found.sensitivity = std::max(found.sensitivity, 1 / std::abs(1.0 + std::polar(size, phase)));
        size_before = size, phase_before = phase;
    }
    return found;
}

// ---------------------------------------------------------------------------------------------------------------------

void Touch::update(double press, double limit, double noise, double dt)
{
    if (limit == 0) {  // contact is never lost
        *this = {CERTAIN, 0, true};
        return;
    }
    evidence = weighed(evidence, press, limit, noise);
    const bool certain = evidence == CERTAIN;
    touching = certain || (touching && evidence > -CERTAIN);
    airborne = certain ? 0 : airborne + dt;
}

double weighed(double evidence, double press, double limit, double noise)
{
    const double sigma = std::max({noise, 0.25 * limit, 1e-300});
    return std::clamp(evidence + 2 * (limit / sigma) * ((press - limit) / sigma), -CERTAIN, CERTAIN);
}

// ---------------------------------------------------------------------------------------------------------------------

void Response::start(double stiffness)
{
    begins = stiffness, bound = 2 * stiffness;
    for (Fit& one : fits) {
        const double x = one.x;
        one = {begins, DAMPED * begins, begins, DAMPED * begins, x};
    }
    most_damping = INFINITY, best = 2, f_mean = f_means = time = lasted = lacked = calm = window = 0;
    reached = rose = false, learns = true;
}
void Response::in_air(double force, const std::array<double, FITS>& ways, bool quiet_now, const Settings& s, double stiffness)
{
    start(stiffness);
    f = f_mean = force;
    for (int i = 0; i < FITS; i++) {
        Fit& one = fits[i];
        const double before = one.x;
        one.x += s.filter_share * (ways[i] - one.x);
        one.x_mean = one.x, one.v_mean = (one.x - before) / s.dt;
    }
    if (quiet_now)
        quiet = fits[2].x;
}
// A contact is at most so stiff as its rise over its way since nothing was felt.
void Response::touched(double noise, const Settings& s)
{
    if (std::isnan(quiet))
        return;
    show(std::max(f, 3 * noise) / std::max(fits[2].x - quiet, RESOLVED * s.size));
}
void Response::show(double stiffness)
{
    begins = std::clamp(stiffness, SOFTEST * STIFF, STIFF), bound = 2 * begins, learns = true, window = 0;
    for (Fit& one : fits)
        one.k = one.k_error = begins, one.b = one.b_error = DAMPED * begins, one.sums = {};
}
void Response::update(double force, const std::array<double, FITS>& ways, double missing, double most, bool felt, double late, double noise,
                      double moves, const Settings& s)
{
    const double dt = s.dt, over = WINDOW * late, r = std::min(1.0, dt / over);
    const bool first = time == 0;
    const int side = missing > SHORT * most ? 1 : missing < -SHORT * most ? -1 : 0;
    f = force, time += dt, lasted = felt ? lasted + dt : 0, rose = false;
    lacked = lacked * side > 0 ? lacked + side * dt : side * dt;
    calm = side ? 0 : calm + dt;
    if (std::abs(most - wanted) > SHORT * wanted || std::abs(lacked) > 2 * over)
        learns = true, window = 0;
    wanted = most;
    const bool fills = lasted <= 3 * s.filter_time + 2 * dt;  // the low-pass still holds the air
    if (!fills) {
        reached = reached || side == 0, window += dt;
        if (calm > over || window > 5 * over)
            learns = false;
    }
    const bool soft = side && (!reached || std::abs(lacked) > over);  // or the law would have changed it
    if (learns && !fills && soft)
        begins = std::max(begins * std::exp(-dt / (2 * over)), SOFTEST * STIFF);
    const double above = force - f_mean;
    f_mean += r * above, f_means = fills ? 0 : f_means + r * (above - f_means);
    const double af = above - f_means;
    if (fills)
        f_mean = force;
    for (int i = 0; i < FITS; i++) {
        Fit& one = fits[i];
        const double before = one.x;
        one.x += s.filter_share * (ways[i] - one.x);
        const double v = (one.x - before) / dt, x_above = one.x - one.x_mean, v_above = v - one.v_mean;
        if (fills) {
            one.x_mean = one.x, one.v_mean = v, one.x_means = one.v_means = 0;
            continue;
        }
        one.x_mean += r * x_above, one.v_mean += r * v_above;
        one.x_means += r * (x_above - one.x_means), one.v_means += r * (v_above - one.v_means);
        const double zx = x_above - one.x_means, zv = v_above - one.v_means;
        if (!learns)
            continue;
        const double rest = af - one.k * zx - one.b * zv, rounding = 0.2 * bound * RESOLVED * s.size, unknown = UNKNOWN * bound * zv;
        const double spread = std::max(4 * noise * noise + 0.0025 * af * af, 2 * one.residual) + rounding * rounding;
        const double variance = spread + unknown * unknown + std::pow(one.k_error * zx, 2) + std::pow(one.b_error * zv, 2);
        const double surprise = 25 * variance, square = rest * rest;
        one.residual += std::min(1.0, dt / 0.1) * (std::min(square, surprise) - one.residual);
        if (i == best && square > surprise && rest > 0 && zx > 0)
            rose = true;
        if (std::abs(zx) >= 0.6 * RESOLVED * s.size) {
            const double w = (s.filter_time > 0 ? std::min(1.0, dt / (2 * s.filter_time)) : 1) / (spread + (square > surprise ? square : 0));
            const double left = 1 - 0.1 * (1 - spread / variance);
            const std::array<double, 5> more{zx * zx, zx * zv, zv * zv, zx * af, zv * af};
            for (int j = 0; j < 5; j++)
                one.sums[j] = left * one.sums[j] + w * more[j];
        }
        // Beside what is assumed: begins +- begins, and DAMPED begins +- as much.
        const double n = begins, m = DAMPED * begins, a = 1 + n * n * one.sums[0], c = n * m * one.sums[1], d = 1 + m * m * one.sums[2];
        const double p = 1 + n * one.sums[3], q = 1 + m * one.sums[4], whole = a * d - c * c;
        one.k = n * (d * p - c * q) / whole, one.b = m * (a * q - c * p) / whole;
        one.k_error = n * std::sqrt(d / whole), one.b_error = m * std::sqrt(a / whole);
    }
    if (first)
        touched(noise, s);
    // A damper shows at once, while the joints still move in; where these have stopped the force says nothing of one.
    if (time <= dt + s.filter_time + UNKNOWN && !std::isnan(quiet))
        most_damping = std::max(first ? 0 : most_damping, moves > 0.05 * s.approach_speed ? (force + 3 * noise) / moves : INFINITY);
    if (!learns || fills)
        return;
    if (rose) {  // another contact behind this one, stiffer
        begins = std::min(10 * begins, std::max(begins, STIFF));
        bound = std::max(2 * begins, bound), f_mean = force, f_means = 0;
        for (Fit& one : fits)
            one.sums = {}, one.x_mean = one.x, one.x_means = one.v_means = 0;
        return;
    }
    for (int i = 0; i < FITS; i++)
        if (fits[i].residual < 0.5 * fits[best].residual)
            best = i;
    // What is held may be declared where it is not: that looks soft.
    const double falls = most == INFINITY ? 1 : std::exp(-dt / 0.03);
    bound = std::max({fit().k + fit().k_error, SOFTEST * begins, bound * falls});
}

// ---------------------------------------------------------------------------------------------------------------------

double lateness(const State& state, const Settings& s)
{
    const double arm = std::max(s.delay, std::isnan(state.lag) ? LAG : state.lag);
    return s.dt + s.filter_time + arm + UNKNOWN;
}

void read(State& state, const Settings& s, const std::array<double, 6>& load, std::array<double, 6>& raw, std::array<double, 6>& smooth)
{
    for (int i = 0; i < 6; i++) {
        state.smooth[i] = state.read ? state.smooth[i] + s.filter_share * (load[i] - state.smooth[i]) : load[i];
        raw[i] = load[i] - state.bias[i], smooth[i] = state.smooth[i] - state.bias[i];
    }
}

std::array<double, 7> base_of(const Settings& s, const std::array<double, 6>& along)
{
    std::array<double, 7> phi{1};
    for (int i = 0; i < 6; i++)
        phi[i + 1] = along[i] / (0.1 * s.size);
    return phi;
}

namespace {

// The speed at which a contact as stiff as a table is struck; one declared softer takes more, never an overload.
double touch_speed(const Settings& s, double press, double most, double late)
{
    const double table = STIFF / 2, soft = s.stiffness > 0 ? std::min(s.stiffness, table) : table;
    return std::min(s.approach_speed, std::min(std::max(press, 0.0) / soft, std::max(most, 0.0) / table) / (late + DAMPED));
}

double dot(const std::array<double, 7>& a, const std::array<double, 7>& b)
{
    double sum = 0;
    for (int i = 0; i < 7; i++)
        sum += a[i] * b[i];
    return sum;
}
double length(const std::array<double, 6>& along)
{
    return std::sqrt(std::max(along[0] * along[0] + along[1] * along[1] + along[2] * along[2],
                              along[3] * along[3] + along[4] * along[4] + along[5] * along[5]));
}

struct LawInputs {
    Gains gains;
    double error, most_inwards, most_outwards, cap, counts, share;  // counts: errors count in the integral up to this
    bool grows;
};
// One step of the law; the rate.
double law(Constraint& c, const LawInputs& in, const std::array<double, 7>& phi, double dt)
{
    const double before = dot(c.slope, phi);
    double integral = before;
    if (in.grows) {
        std::array<double, 7> slope = c.slope;
        const double step = dt * in.gains.g / in.gains.Ti * std::clamp(in.error, -in.counts, in.counts) / dot(phi, phi);
        for (int i = 0; i < 7; i++)
            slope[i] += step * phi[i];
        integral = dot(slope, phi);
        if (std::abs(integral) <= in.cap || std::abs(integral) < std::abs(before))
            c.slope = slope;
        else
            integral = before;
    }
    integral = std::clamp(integral, -in.cap, in.cap);
    const double lag = in.gains.tau / dt, start = c.response.rose ? std::min(c.speed, 0.0) : c.speed;
    c.speed = std::clamp((lag * start + in.gains.g * in.error) / (lag + 1), -in.most_outwards, std::max(in.most_inwards, 0.0));
    return c.speed + integral;
}

// The gains of a press, or of a moment beside one, which is levelled no faster than that presses. Where motors give way
// the plant is no integrator below k times their slip, and the integral need not wait.
Gains gains_of(const Constraint& c, const State& st, const Settings& s, double eased, const Response* beside = nullptr)
{
    const Response& r = c.response;
    const double arm = lateness(st, s) - s.dt - s.filter_time - UNKNOWN, late = s.dt + s.filter_time + UNKNOWN + std::max(LAGS[r.best] * arm, s.delay);
    const double k = beside ? std::max(r.bound, beside->bound) : r.bound, b = beside ? std::max(r.damping(), beside->damping()) : r.damping();
    Gains found = gains(k, b, late + r.behind() / k);
    if (!r.reached)  // until a response was seen the speed grows no faster than that shows
        found.tau = std::max(found.tau, 2 * late);
    found.g *= eased, found.Ti = INTEGRAL / (found.g * k);
    if (const double droop = r.least() * c.slip; r.f > 0 && droop > 0)
        found.Ti = std::min(found.Ti, std::max(r.f / droop, late));
    return found;
}

void measure_noise(State& st, const Inputs& in, double supposed)
{
    double change = 0;
    bool same = true;
    const double most = 5 * std::max(supposed, st.change);
    for (int i = 3; i < 6; i++) {
        const double d = std::abs(in.reading[i] - st.last[i]);
        same = same && d == 0, change += std::min(d, most) / 3;
    }
    if (same)
        return;
    st.readings++, st.change += (change - st.change) / std::min(st.readings, 200.0);
    const double sigma = std::sqrt(PI) / 2 * st.change;
    if (st.readings >= 20 && sigma > 1.5 * supposed)
        st.noise = sigma;
}

// The lag of the joints, in the air or along what is held, where no force bends the arm: speeds close a share of what is
// missing in a tick.
void measure_lag(State& st, const Settings& s, double given, double done)
{
    const double missing = given - st.done, change = done - st.done;
    st.done = done;
    if (std::abs(given) > 2e-3 * s.size * s.dt && change * missing >= -1e-3 * missing * missing)
        st.missing += missing * missing, st.closed += change * missing, st.fastest = std::max(st.fastest, given * given);
    if (st.missing > st.fastest / 2 && st.closed > 0 && std::abs(given - done) < 0.2 * std::abs(given)) {  // joints that follow
        const double share = std::min(st.closed / st.missing, 1.0);
        st.lag = share < 1 ? std::min(-s.dt / std::log(1 - share), LONGEST_LAG) : 0;
    }
}

double most_of(const Inputs& in)
{
    double most = 0;
    for (int i = 0; i < in.n; i++)
        most = std::max(most, std::abs(in.wanted[i]));
    return most;
}

// The bias from readings in the air, where the tool waits for it. Whether a press that is read from the start is probed.
bool tare(State& st, const Settings& s, const Inputs& in, const Touch& touch, double limit, double noise)
{
    bool air = true, felt = false;
    for (int i = 0; i < in.presses; i++)
        air = air && st.parts[i].touch.evidence == -CERTAIN, felt = felt || st.parts[i].touch.touching;
    constexpr double AGAIN = 10, WAY = 0.1;  // [s], in sizes
    // Until its mean is known to half a per cent of the press; half a tick more, so that rounding, which a frame changes, decides no tie.
    const double sigma = std::max(s.noise, st.noise), time = sigma > 0 ? std::clamp(s.dt * (0.5 + std::pow(sigma / (5e-3 * most_of(in) + 1e-300), 2)), 0.1, 0.4) : 2 * s.dt;
    st.age += s.dt;
    if (!s.tares || in.presses == 0 || limit == 0)
        return false;
    const double press = in.press[0], wanted = in.press_wanted[0];
    if (st.tared && (!air || touch.airborne <= std::max(0.2, s.lost_after))) {
        st.batch = 0;
        return false;
    }
    if (st.batch == 0)
        st.sum = {}, st.probe = 0;
    constexpr double ENOUGH = 0.05;  // [s]
    if (st.probe == 0 && felt && !st.tared && st.batch > ENOUGH) {  // a touch before the mean is well known
        for (int i = 0; i < 6; i++)
            st.bias[i] += st.sum[i] / st.batch;
        st.tared = true, st.age = st.batch = 0;
        return false;
    }
    if (st.probe == 0 && felt && !st.tared)  // a press that is read from the start, of a contact or of a bias
        st.probe = 1e-12, st.probe_force = press;
    if (st.probe > 0) {
        double force = INFINITY;
        for (int i = 0; i < in.presses; i++)
            force = std::min(force, in.force[i]);
        st.probe_force = std::max(st.probe_force, force);
        if (!felt && st.probe_force - force < 0.5 * SHORT * wanted)  // noise about the limit
            st.batch = st.probe = 0;
        else if (st.probe_force - force > std::max(0.5 * SHORT * wanted, 4 * noise) || !felt) {
            st.tared = st.in_contact = true, st.batch = st.probe = 0;  // readings fall: it is a contact
            return false;
        }
    }
    st.batch += s.dt;
    for (int i = 0; i < 6; i++)
        st.sum[i] += s.dt * (in.load[i] - st.bias[i]);
    const bool in_air = st.probe > 0 ? st.probe > WAY * s.size : !felt;
    if (in_air && st.batch >= time) {
        if (!st.tared || st.age > AGAIN)
            for (int i = 0; i < 6; i++)
                st.bias[i] += st.sum[i] / st.batch;
        if (!st.tared || st.age > AGAIN)
            st.age = 0;
        if (st.probe > 0)
            for (Constraint& c : st.parts)
                c.touch = {};
        st.tared = true, st.batch = st.probe = 0;
    }
    return st.probe > 0;
}

}  // namespace

Output tick(State& st, const Settings& s, const Inputs& in)
{
    Output out;
    const int n = in.n, presses = in.presses;
    if (n != st.n || presses != st.presses) {
        for (Constraint& c : st.parts) {
            c = {};
            c.response.start(s.stiffness > 0 ? s.stiffness : STIFF);
        }
        st.n = n, st.presses = presses;
    }
    const double begins = s.stiffness > 0 ? s.stiffness : STIFF, sigma = std::max(s.noise, st.noise);
    double most_wanted = 0, limit = 0;
    for (int i = 0; i < n; i++)
        most_wanted = std::max(most_wanted, std::abs(in.wanted[i]));
    const double noise = sigma * std::sqrt(s.filter_share / (2 - s.filter_share)) + 2e-3 * most_wanted;

    // Contact: there is where every press is felt.
    Touch touch{CERTAIN, 0, true};
    std::array<double, MOST> limits{};
    for (int i = 0; i < presses; i++) {
        Touch& one = st.parts[i].touch;
        const bool usual = std::isnan(s.lost_below) || (one.airborne == INFINITY && s.lost_below == 0);
        limits[i] = usual ? std::max({0.0, 0.1 * in.press_wanted[i], 0.5 * std::min(in.press_wanted[i], sigma)}) : s.lost_below;
        one.update(in.press[i], limits[i], sigma, s.dt);
        touch.evidence = std::min(touch.evidence, one.evidence), touch.touching = touch.touching && one.touching;
        touch.airborne = std::max(touch.airborne, one.airborne), limit = std::max(limit, limits[i]);
    }
    if (st.read && limit > 0 && !touch.touching)
        measure_noise(st, in, std::max(sigma, 0.25 * limit));
    if (presses == 0)
        measure_lag(st, s, in.along_given, in.along_done);
    else if (touch.airborne == INFINITY && !touch.touching)
        measure_lag(st, s, st.parts[0].given, in.done[0]);
    const bool probing = tare(st, s, in, touch, limit, noise);
    const double late = lateness(st, s), arm = late - s.dt - s.filter_time - UNKNOWN;
    out.late = late;

    const double speed = length(in.along);
    st.along = std::max(speed, st.along * std::exp(-s.dt / (WINDOW * late)));
    st.still = speed > 0.1 * s.approach_speed ? 0 : st.still + s.dt;
    const std::array<double, 7> phi = base_of(s, in.along);

    for (int i = 0; i < n; i++) {
        Constraint& c = st.parts[i];
        const bool press = i < presses;
        const Touch& its = press ? c.touch : touch;
        const bool near = its.touching || (press && its.lasts(s.lost_after));
        c.shown[3] += in.done[i];
        c.slip += std::min(1.0, s.dt / (WINDOW * late)) * ((c.given - in.done[i]) / s.dt - c.slip);
        if (st.unchanged > 0 && presses)
            continue;
        const std::array<double, FITS>& ways = c.shown;
        if (near && !in.beyond) {
            if (presses == 0)
                c.response.calm = 0, c.response.window = 0, c.response.learns = true;
            const bool felt = !press || (its.touching && in.force[i] > limit);
            c.response.update(in.force[i], ways, in.wanted[i] - in.force[i], presses ? most_wanted : INFINITY, felt, late, noise, in.done[i] / s.dt, s);
        } else
            c.response.in_air(in.force[i], ways, in.force[i] <= 0.25 * limit && its.evidence == -CERTAIN, s, begins);
    }

    watch(st, s, in, touch, limit, sigma, noise, late, probing, out);
    const bool dead = presses > 0 && (!st.alive || st.unchanged > STALE);
    st.last = in.reading, st.read = true;
    if (out.action == Action::hold || out.action == Action::retreat)
        return out;

    // The law.
    const bool there = touch.lasts(late), approach = out.action == Action::approach || (!there && touch.lasts(s.lost_after));
    const bool grows = st.free && in.yields && !approach;
    const double surface = s.slope * st.along + std::min(s.yields / MOVES_IN, s.approach_speed), cap = s.approach_speed + surface;
    // What a lagging arm has not done yet is taken back at a touch within a tick; what is sent late is not.
    const double striking = s.dt + 0.5 * (s.delay + std::min(arm - s.delay, s.dt));
    const bool near = touch.lasts(std::max(late, s.lost_after));  // what is lost for moments no law could have acted on
    out.acts = near && in.yields && !probing;
    const double kept = st.eased * in.noise_share;
    for (int i = 0; i < n; i++) {
        Constraint& c = st.parts[i];
        const Response& r = c.response;
        const bool press = i < presses;
        const double error = in.wanted[i] - in.force[i], wanted = press ? in.wanted[i] : 0;
        const double gentle = press ? touch_speed(s, 0.9 * wanted, 0.9 * in.most[0], striking) : 0;
        double& rate = out.rates[i];
        if (probing && press) {
            rate = -std::min(gentle + 5 * st.probe, s.approach_speed);
            st.probe += std::max(0.0, -std::min(in.done[i], c.given));
            continue;
        }
        if (in.compliance > 0 || presses == 0) {
            const double least = s.stiffness > 0 ? s.stiffness : 0.1 * STIFF;
            const double k = in.compliance > 0 ? s.stiffness : std::max(least, r.bound / 4);
            Gains fixed = in.compliance > 0 ? Gains{in.compliance, 0, k > 0 ? INTEGRAL / (in.compliance * k) : INFINITY} : gains(k, 0, late - UNKNOWN);
            if (presses == 0)
                fixed.g *= kept, fixed.Ti /= kept;
            const double top = (approach || (!there && near)) && press ? s.approach_speed : INFINITY;
            rate = law(c, {fixed, error, top, INFINITY, INFINITY, INFINITY, 1, grows && fixed.Ti < INFINITY}, phi, s.dt);
            rate = std::min(rate, top), out.acts = out.acts && rate < top;
            out.gain = std::max(out.gain, fixed.g);
        } else if (!press) {
            if (!there) {
                c.speed = 0;
                continue;
            }
            const Gains g = gains_of(c, st, s, kept, &st.parts[0].response);
            rate = law(c, {g, error, s.approach_speed, s.approach_speed, cap, INFINITY, 1, grows}, phi, s.dt);
            out.gain = std::max(out.gain, g.g / (1 + g.tau / s.dt));
        } else if (!st.tared && s.tares && c.touch.airborne == INFINITY && limit > 0)
            rate = 0;  // waits for the bias
        else if (!c.touch.lasts(late)) {  // as fast as is gentle, and as a surface leaves as was seen
            c.speed = 0;
            if (c.reach.held)  // errors since then are of the air, or of a sensor that fails
                c.slope = c.reach.slope;
            if (!c.touch.lasts(s.lost_after))
                c.slope[0] = 0;
            const double leaves = std::max(std::min(dot(c.slope, phi), cap), surface);
            const double part = c.touch.airborne == INFINITY || s.lost_after == 0 ? 1 : std::min(1.0, c.touch.airborne / s.lost_after);
            rate = std::min((gentle + (c.touch.airborne == INFINITY ? 0 : leaves)) * part, s.approach_speed);
        } else if (r.time <= late) {  // a touch: nothing is pushed in, and what the arm has not done yet is taken back
            const double coming = presses == 1 && !std::isnan(st.lag) ? c.coming[2] : 0, room = std::max(error, 0.0) / r.bound;
            const Gains g = gains_of(c, st, s, kept);
            c.speed = 0;
            rate = law(c, {g, error, 0, OVERLOAD * s.approach_speed, cap, 0, 1, false}, phi, s.dt);
            rate = std::max(std::min(rate, dot(c.slope, phi) + (room - coming) / s.dt), -OVERLOAD * s.approach_speed);
            c.speed = std::min(0.0, c.speed);
        } else {
            const Gains g = gains_of(c, st, s, kept);
            const double room = std::max(in.most[0] - in.force[i] - c.check.unexplained, wanted);
            const double inwards = touch_speed(s, room, room, late) + (r.reached ? 0 : s.slope * st.along);
            const double fastest = r.reached ? inwards : inwards - std::max(dot(c.slope, phi), 0.0);
            rate = law(c, {g, error, fastest, OVERLOAD * s.approach_speed, cap, (r.reached ? SHORT : 0.1) * wanted, 1, grows && c.check.phase == 0 && !c.check.silent}, phi, s.dt);
            out.gain = std::max(out.gain, g.g / (1 + g.tau / s.dt));
            rate = std::min(rate, s.approach_speed + s.slope * st.along);
            if (c.check.silent)  // the force does not answer: the remembered slope alone
                rate = dot(c.check.usual, phi);
        }
        if (c.check.phase > 0) {  // beside what the law does anyway, or nothing would be asked
            const double first = SHORT * std::max(c.check.force, 4 * noise) / (r.bound * late);
            out.acts = false;
            rate = std::min(rate, 0.0) - std::min(first + 5 * c.check.led, std::max(OVERLOAD * gentle, s.slope * st.along));
        }
        if (press && c.reach.held)
            rate = std::min(rate, c.reach.led(slope_rate(c.reach.slope, s, in.along), in.across, s.dt, s) / s.dt + std::max(c.reach.left(s.yields + c.check.moves), 0.0) / s.dt);
    }
    if (dead || in.beyond)
        out.rates = {}, out.acts = false;
    return out;
}

void commanded(State& st, const Settings& s, const std::array<double, MOST>& given, double outwards, bool free, bool beyond)
{
    const double arm = lateness(st, s) - s.dt - s.filter_time - UNKNOWN, shows = arm > 0 ? 1 - std::exp(-s.dt / arm) : 1;
    for (int i = 0; i < st.n; i++) {
        Constraint& c = st.parts[i];
        c.given = given[i];
        for (int j = 0; j < FITS - 1; j++) {
            const double lag = LAGS[j] * arm, part = lag > 0 ? 1 - std::exp(-s.dt / lag) : 1, coming = c.coming[j] + given[i];
            c.shown[j] += part * coming, c.coming[j] = coming - part * coming;
        }
    }
    const double coming = st.out_coming + outwards;
    st.out_shown = shows * coming, st.out_coming = coming - st.out_shown, st.free = free;
    if (st.found != Reason::none) {
        st.left += std::max(0.0, outwards);
        return;
    }
    if (beyond) {
        for (Constraint& c : st.parts)
            c.check = {}, c.reach = {};
        return;
    }
    if (st.n > 0 && st.touching())
        st.pushed = std::max(0.0, st.pushed - outwards);
    else
        st.approached = (st.pushed > 0 ? 0 : st.approached) + std::max(0.0, -outwards), st.pushed = 0;
}

}  // namespace iq::force
