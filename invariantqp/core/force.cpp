#include "force.hpp"
#include "tolerances.hpp"
#include <algorithm>

namespace iq::force {

Gains gains(double k, double b, double delay)
{
    const double excess = GAIN_MARGIN * CROSSOVER * b / k - delay;
    const double tau = excess > 0 ? delay * (std::sqrt(1 + excess / delay) - 1) : 0;
    double g = CROSSOVER / (k * (delay + tau));
    if (b > 0)
        g = std::min(g, (1 + tau / delay) / (GAIN_MARGIN * b));
    return {g, tau, INTEGRAL_TIME / (g * k)};
}

void ContactTest::update(double press, double limit, double noise, double dt)
{
    if (limit == 0) {  // contact is never lost
        *this = {CERTAIN, 0, true};
        return;
    }
    evidence = updated_evidence(evidence, press, limit, noise);
    const bool certain = evidence == CERTAIN;
    touching = certain || (touching && evidence > -CERTAIN);
    airborne = certain ? 0 : airborne + dt;
}

double updated_evidence(double evidence, double press, double limit, double noise)
{
    const double sigma = std::max({noise, 0.25 * limit, TINY});
    return std::clamp(evidence + 2 * (limit / sigma) * ((press - limit) / sigma), -CERTAIN, CERTAIN);
}

// ---------------------------------------------------------------------------------------------------------------------

void StiffnessEstimate::restart(double stiffness)
{
    const double air = displacement_in_air;
    const auto before = fits;
    *this = {};
    prior = stiffness, bound = 2 * stiffness, displacement_in_air = air;
    for (int i = 0; i < FITS; i++)
        fits[i] = {prior, DAMPING_TIME * prior, prior, DAMPING_TIME * prior, before[i].x};
}
void StiffnessEstimate::in_air(double reading, const std::array<double, FITS>& displacement, bool no_force, const Settings& s)
{
    restart(s.prior_stiffness());
    force = force_mean = reading;
    for (int i = 0; i < FITS; i++) {
        StiffnessRegression& one = fits[i];
        const double before = one.x;
        one.x += s.filter_share * (displacement[i] - one.x);
        one.x_mean = one.x, one.v_mean = (one.x - before) / s.dt;
    }
    if (no_force)
        displacement_in_air = fits[2].x;
}
void StiffnessEstimate::set_prior(double stiffness)
{
    prior = std::clamp(stiffness, MIN_STIFFNESS * DEFAULT_STIFFNESS, DEFAULT_STIFFNESS), bound = 2 * prior;
    is_learning = true, time_learning = 0;
    for (StiffnessRegression& one : fits)
        one.k = one.k_error = prior, one.b = one.b_error = DAMPING_TIME * prior, one.sums = {};
}
// A contact is at most as stiff as its force over the displacement since there was no force.
void StiffnessEstimate::set_prior_from_impact(double noise, const Settings& s)
{
    if (!std::isnan(displacement_in_air))
        set_prior(std::max(force, 3 * noise) / std::max(fits[2].x - displacement_in_air, RESOLUTION * s.size));
}
void StiffnessEstimate::update(double reading, const std::array<double, FITS>& displacement, double missing, double largest, bool is_loaded,
                               double delay, double noise, double speed, const Settings& s)
{
    const double dt = s.dt, window = WINDOW * delay, r = std::min(1.0, dt / window);
    const bool is_impact = time == 0;
    const int side = missing > FORCE_TOLERANCE * largest ? 1 : missing < -FORCE_TOLERANCE * largest ? -1 : 0;
    force = reading, time += dt, time_loaded = is_loaded ? time_loaded + dt : 0, stiffened = false;
    time_off = time_off * side > 0 ? time_off + side * dt : side * dt;
    time_settled = side ? 0 : time_settled + dt;
    if (std::abs(largest - desired) > FORCE_TOLERANCE * desired || std::abs(time_off) > 2 * window)
        is_learning = true, time_learning = 0;
    desired = largest;
    const bool filter_fills = time_loaded <= 3 * s.filter_time + 2 * dt;  // the low-pass still holds readings of the air
    if (!filter_fills) {
        reached = reached || side == 0, time_learning += dt;
        if (time_settled > window || time_learning > 5 * window)
            is_learning = false;
    }
    const bool is_soft = side && (!reached || std::abs(time_off) > window);  // or the law would have changed the force
    if (is_learning && !filter_fills && is_soft)
        prior = std::max(prior * std::exp(-dt / (2 * window)), MIN_STIFFNESS * DEFAULT_STIFFNESS);
    const double above = force - force_mean;
    force_mean += r * above, force_means = filter_fills ? 0 : force_means + r * (above - force_means);
    const double zf = above - force_means;
    if (filter_fills)
        force_mean = force;
    for (int i = 0; i < FITS; i++) {
        StiffnessRegression& one = fits[i];
        const double before = one.x;
        one.x += s.filter_share * (displacement[i] - one.x);
        const double v = (one.x - before) / dt, x_above = one.x - one.x_mean, v_above = v - one.v_mean;
        if (filter_fills) {
            one.x_mean = one.x, one.v_mean = v, one.x_means = one.v_means = 0;
            continue;
        }
        one.x_mean += r * x_above, one.v_mean += r * v_above;
        one.x_means += r * (x_above - one.x_means), one.v_means += r * (v_above - one.v_means);
        const double zx = x_above - one.x_means, zv = v_above - one.v_means;
        if (!is_learning)
            continue;
        const double error = zf - one.k * zx - one.b * zv;
        const double rounding = 0.2 * bound * RESOLUTION * s.size, late = ELECTRONICS_DELAY * bound * zv;
        const double spread = std::max(4 * noise * noise + 0.0025 * zf * zf, 2 * one.residual) + rounding * rounding;
        const double variance = spread + late * late + std::pow(one.k_error * zx, 2) + std::pow(one.b_error * zv, 2);
        const double outlier = 25 * variance, square = error * error;  // five standard deviations
        one.residual += std::min(1.0, dt / 0.1) * (std::min(square, outlier) - one.residual);
        if (i == best && square > outlier && error > 0 && zx > 0)
            stiffened = true;
        if (std::abs(zx) >= 0.6 * RESOLUTION * s.size) {
            const double weight = (s.filter_time > 0 ? std::min(1.0, dt / (2 * s.filter_time)) : 1) / (spread + (square > outlier ? square : 0));
            const double forgetting = 1 - 0.1 * (1 - spread / variance);
            const std::array<double, 5> more{zx * zx, zx * zv, zv * zv, zx * zf, zv * zf};
            for (int j = 0; j < 5; j++)
                one.sums[j] = forgetting * one.sums[j] + weight * more[j];
        }
        // With the prior k = prior +- prior, and b = DAMPING_TIME prior +- as much.
        const double n = prior, m = DAMPING_TIME * prior, a = 1 + n * n * one.sums[0], c = n * m * one.sums[1], d = 1 + m * m * one.sums[2];
        const double p = 1 + n * one.sums[3], q = 1 + m * one.sums[4], determinant = a * d - c * c;
        one.k = n * (d * p - c * q) / determinant, one.b = m * (a * q - c * p) / determinant;
        one.k_error = n * std::sqrt(d / determinant), one.b_error = m * std::sqrt(a / determinant);
    }
    if (is_impact)
        set_prior_from_impact(noise, s);
    // A damper shows while the joints still move inwards; after they have stopped, the force says nothing of one.
    if (time <= dt + s.filter_time + ELECTRONICS_DELAY && !std::isnan(displacement_in_air))
        max_damping = std::max(is_impact ? 0 : max_damping, speed > 0.05 * s.approach_speed ? (force + 3 * noise) / speed : INFINITY);
    if (!is_learning || filter_fills)
        return;
    if (stiffened) {  // another contact behind this one, stiffer
        prior = std::min(10 * prior, std::max(prior, DEFAULT_STIFFNESS));
        bound = std::max(2 * prior, bound), force_mean = force, force_means = 0;
        for (StiffnessRegression& one : fits)
            one.sums = {}, one.x_mean = one.x, one.x_means = one.v_means = 0;
        return;
    }
    for (int i = 0; i < FITS; i++)
        if (fits[i].residual < 0.5 * fits[best].residual)
            best = i;
    // Without a press the bound falls at once: a hinge that is not where it was declared looks soft.
    const double falls = largest == INFINITY ? 1 : std::exp(-dt / 0.03);
    bound = std::max({fit().k + fit().k_error, MIN_STIFFNESS * prior, bound * falls});
}

// ---------------------------------------------------------------------------------------------------------------------

void read(State& state, const Settings& s, const std::array<double, 6>& load, std::array<double, 6>& raw, std::array<double, 6>& filtered)
{
    for (int i = 0; i < 6; i++) {
        state.filtered[i] = state.has_reading ? state.filtered[i] + s.filter_share * (load[i] - state.filtered[i]) : load[i];
        raw[i] = load[i] - state.tare.bias[i], filtered[i] = state.filtered[i] - state.tare.bias[i];
    }
}

namespace {

// The delay of the joints, and the total delay of the loop.
double arm_delay(const State& st, const Settings& s) { return std::max(s.delay, std::isnan(st.arm.lag) ? DEFAULT_LAG : st.arm.lag); }
double total_delay(const State& st, const Settings& s) { return s.dt + s.filter_time + arm_delay(st, s) + ELECTRONICS_DELAY; }

// The terms of a slope: 1 and the speed along the contact, in sizes per 10 s, so that a slope turns round with the motion.
Slope terms_of(const Settings& s, const std::array<double, 6>& along)
{
    Slope terms{1};
    for (int i = 0; i < 6; i++)
        terms[i + 1] = along[i] / (0.1 * s.size);
    return terms;
}
double dot(const Slope& a, const Slope& b)
{
    double sum = 0;
    for (int i = 0; i < SLOPE_TERMS; i++)
        sum += a[i] * b[i];
    return sum;
}
double speed_of(const std::array<double, 6>& along)
{
    return std::sqrt(std::max(along[0] * along[0] + along[1] * along[1] + along[2] * along[2],
                              along[3] * along[3] + along[4] * along[4] + along[5] * along[5]));
}

// The speed of an impact on a contact as stiff as a table; one declared softer allows more, but never an overload.
double impact_speed(const Settings& s, double press, double limit, double delay)
{
    const double table = DEFAULT_STIFFNESS / 2, soft = s.stiffness > 0 ? std::min(s.stiffness, table) : table;
    return std::min(s.approach_speed, std::min(std::max(press, 0.0) / soft, std::max(limit, 0.0) / table) / (delay + DAMPING_TIME));
}

struct LawInputs {
    Gains gains;
    double error, max_inwards, max_outwards, max_integral, max_error;  // max_error: of the integral
    bool integrates;
};
// One step of the law: the rate.
double law(Constraint& c, const LawInputs& in, const Slope& terms, double dt)
{
    const double before = dot(c.slope, terms);
    double integral = before;
    if (in.integrates) {
        Slope slope = c.slope;
        const double step = dt * in.gains.g / in.gains.Ti * std::clamp(in.error, -in.max_error, in.max_error) / dot(terms, terms);
        for (int i = 0; i < SLOPE_TERMS; i++)
            slope[i] += step * terms[i];
        integral = dot(slope, terms);
        if (std::abs(integral) <= in.max_integral || std::abs(integral) < std::abs(before))
            c.slope = slope;
        else
            integral = before;
    }
    integral = std::clamp(integral, -in.max_integral, in.max_integral);
    const double lag = in.gains.tau / dt, start = c.estimate.stiffened ? std::min(c.speed, 0.0) : c.speed;
    c.speed = std::clamp((lag * start + in.gains.g * in.error) / (lag + 1), -in.max_outwards, std::max(in.max_inwards, 0.0));
    return c.speed + integral;
}

// The gains of a press, or of a moment with a press, which moves no faster than the press. Where drives are compliant the plant
// is no integrator below k times their slip, and the integral time is shorter.
Gains gains_of(const Constraint& c, const State& st, const Settings& s, double scale, const StiffnessEstimate* press = nullptr)
{
    const StiffnessEstimate& e = c.estimate;
    const double arm = total_delay(st, s) - s.dt - s.filter_time - ELECTRONICS_DELAY;
    const double delay = s.dt + s.filter_time + ELECTRONICS_DELAY + std::max(LAGS[e.best] * arm, s.delay);
    const double k = press ? std::max(e.bound, press->bound) : e.bound, b = press ? std::max(e.damping(), press->damping()) : e.damping();
    Gains found = gains(k, b, delay + e.late_response() / k);
    if (!e.reached)  // before a response is seen the speed grows no faster than a response would show
        found.tau = std::max(found.tau, 2 * delay);
    found.g *= scale, found.Ti = INTEGRAL_TIME / (found.g * k);
    if (const double droop = e.lower() * c.slip; e.force > 0 && droop > 0)
        found.Ti = std::min(found.Ti, std::max(e.force / droop, delay));
    return found;
}

// The bias is the mean of readings in the air, for which the tool waits. True while a press that was read from the start is
// unloaded, to tell a contact from a bias.
bool update_tare(State& st, const Settings& s, const Inputs& in, const ContactTest& contact, double limit, double noise, double most_desired)
{
    constexpr double REPEAT = 10, UNLOADED = 0.1;  // [s], in sizes
    Tare& tare = st.tare;
    bool in_air = true, touches = false;
    for (int i = 0; i < in.presses; i++)
        in_air = in_air && st.parts[i].contact.evidence == -CERTAIN, touches = touches || st.parts[i].contact.touching;
    // Until the mean is known to half a per cent of the press; half a tick more, so that rounding decides no tie.
    const double sigma = std::max(s.noise, st.noise.sigma);
    const double time = sigma > 0 ? std::clamp(s.dt * (0.5 + std::pow(sigma / (5e-3 * most_desired + TINY), 2)), 0.1, 0.4) : 2 * s.dt;
    const auto add_mean = [&] {
        for (int i = 0; i < 6; i++)
            tare.bias[i] += tare.sum[i] / tare.time;
        tare.age = 0;
    };
    tare.age += s.dt;
    if (!s.tares || in.presses == 0 || limit == 0)
        return false;
    if (tare.is_done && (!in_air || contact.airborne <= std::max(0.2, s.lost_after))) {
        tare.time = 0;
        return false;
    }
    if (tare.time == 0)
        tare.sum = {}, tare.unloaded = 0;
    constexpr double SHORTEST = 0.05;  // [s]
    if (tare.unloaded == 0 && touches && !tare.is_done) {
        if (tare.time > SHORTEST) {  // a touch before the mean is well known
            add_mean();
            tare.is_done = true, tare.time = 0;
            return false;
        }
        tare.unloaded = 1e-12, tare.max_force = in.press[0];  // a press from the start, of a contact or of a bias
    }
    if (tare.unloaded > 0) {
        const double tolerance = 0.5 * FORCE_TOLERANCE * in.desired_press[0];
        const double force = *std::min_element(in.force.begin(), in.force.begin() + in.presses);
        tare.max_force = std::max(tare.max_force, force);
        if (!touches && tare.max_force - force < tolerance)  // noise about the limit
            tare.time = tare.unloaded = 0;
        else if (tare.max_force - force > std::max(tolerance, 4 * noise) || !touches) {
            tare.is_done = true, tare.time = tare.unloaded = 0;  // readings fall: it is a contact
            return false;
        }
    }
    tare.time += s.dt;
    for (int i = 0; i < 6; i++)
        tare.sum[i] += s.dt * (in.load[i] - tare.bias[i]);
    if ((tare.unloaded > 0 ? tare.unloaded > UNLOADED * s.size : !touches) && tare.time >= time) {
        if (!tare.is_done || tare.age > REPEAT)
            add_mean();
        if (tare.unloaded > 0)
            for (Constraint& c : st.parts)
                c.contact = {};
        tare.is_done = true, tare.time = tare.unloaded = 0;
    }
    return tare.unloaded > 0;
}

}  // namespace

void NoiseEstimate::update(const std::array<double, 6>& reading, const std::array<double, 6>& last, double supposed)
{
    double mean = 0;
    bool same = true;
    const double largest = 5 * std::max(supposed, change);
    for (int i = 3; i < 6; i++) {
        const double d = std::abs(reading[i] - last[i]);
        same = same && d == 0, mean += std::min(d, largest) / 3;
    }
    if (same)
        return;
    count++, change += (mean - change) / std::min(count, 200.0);
    const double found = std::sqrt(M_PI) / 2 * change;
    if (count >= 20 && found > 1.5 * supposed)
        sigma = found;
}

void LagEstimate::update(double commanded, double measured, const Settings& s)
{
    const double error = commanded - last, change = measured - last;
    last = measured;
    if (std::abs(commanded) > 2e-3 * s.size * s.dt && change * error >= -1e-3 * error * error)
        missing += error * error, closed += change * error, fastest = std::max(fastest, commanded * commanded);
    if (missing > fastest / 2 && closed > 0 && std::abs(commanded - measured) < 0.2 * std::abs(commanded)) {  // joints that follow
        const double share = std::min(closed / missing, 1.0);
        lag = share < 1 ? std::min(-s.dt / std::log(1 - share), MAX_LAG) : 0;
    }
}

double slope_speed(const Slope& slope, const Settings& s, const std::array<double, 6>& along)
{
    Slope terms = terms_of(s, along);
    terms[0] = 0;
    return dot(slope, terms);
}

Output tick(State& st, const Settings& s, const Inputs& in)
{
    Output out;
    const int n = in.n, presses = in.presses;
    if (n != st.n || presses != st.presses) {
        for (Constraint& c : st.parts) {
            c = {};
            c.estimate.restart(s.prior_stiffness());
        }
        st.n = n, st.presses = presses;
    }
    const double sigma = std::max(s.noise, st.noise.sigma);
    double most_desired = 0;
    for (int i = 0; i < n; i++)
        most_desired = std::max(most_desired, std::abs(in.desired[i]));

    // The tool is in contact where every press is felt.
    TickSignals now{{CERTAIN, 0, true}, 0, sigma, sigma * std::sqrt(s.filter_share / (2 - s.filter_share)) + 2e-3 * most_desired, 0, false};
    ContactTest& contact = now.contact;
    for (int i = 0; i < presses; i++) {
        ContactTest& one = st.parts[i].contact;
        const bool is_default = std::isnan(s.lost_below) || (one.never_touched() && s.lost_below == 0);
        const double limit = is_default ? std::max({0.0, 0.1 * in.desired_press[i], 0.5 * std::min(in.desired_press[i], sigma)}) : s.lost_below;
        one.update(in.press[i], limit, sigma, s.dt);
        contact.evidence = std::min(contact.evidence, one.evidence), contact.touching = contact.touching && one.touching;
        contact.airborne = std::max(contact.airborne, one.airborne), now.limit = std::max(now.limit, limit);
    }
    const double limit = now.limit, noise = now.noise;
    if (st.has_reading && limit > 0 && !contact.touching)
        st.noise.update(in.reading, st.last_reading, std::max(sigma, 0.25 * limit));
    // Where no force bends the arm: along what is held, or in the air.
    if (presses == 0)
        st.arm.update(in.along_commanded, in.along_measured, s);
    else if (contact.never_touched() && !contact.touching)
        st.arm.update(st.parts[0].commanded, in.moved[0], s);
    now.is_taring = update_tare(st, s, in, contact, limit, noise, most_desired);
    const double delay = now.delay = out.delay = total_delay(st, s), arm = delay - s.dt - s.filter_time - ELECTRONICS_DELAY;

    const double speed = speed_of(in.along);
    st.peak_speed = std::max(speed, st.peak_speed * std::exp(-s.dt / (WINDOW * delay)));
    st.time_at_rest = speed > SLOW * s.approach_speed ? 0 : st.time_at_rest + s.dt;
    const Slope terms = terms_of(s, in.along);

    for (int i = 0; i < n; i++) {
        Constraint& c = st.parts[i];
        const bool is_press = i < presses;
        const ContactTest& test = is_press ? c.contact : contact;
        c.displacement[MEASURED] += in.moved[i];
        c.slip += std::min(1.0, s.dt / (WINDOW * delay)) * ((c.commanded - in.moved[i]) / s.dt - c.slip);
        if (st.time_unchanged > 0 && presses)
            continue;
        if ((test.touching || (is_press && test.within(s.lost_after))) && !in.beyond_edge) {
            if (presses == 0)
                c.estimate.time_settled = 0, c.estimate.time_learning = 0, c.estimate.is_learning = true;
            const bool is_loaded = !is_press || (test.touching && in.force[i] > limit);
            c.estimate.update(in.force[i], c.displacement, in.desired[i] - in.force[i], presses ? most_desired : INFINITY, is_loaded, delay, noise,
                              in.moved[i] / s.dt, s);
        } else
            c.estimate.in_air(in.force[i], c.displacement, in.force[i] <= 0.25 * limit && test.evidence == -CERTAIN, s);
    }

    monitor(st, s, in, now, out);
    constexpr double REPEATED = 0.012;  // [s] a reading with noise that repeats for so long is not pressed on
    const bool is_stale = presses > 0 && (!st.has_changed || st.time_unchanged > REPEATED);
    st.last_reading = in.reading, st.has_reading = true;
    if (out.action == Action::hold || out.action == Action::retreat)
        return out;

    // The law.
    const bool in_contact = contact.within(delay), approaches = out.action == Action::approach || (!in_contact && contact.within(s.lost_after));
    const bool integrates = st.law_is_free && in.can_yield && !approaches;
    const double surface = s.slope * st.peak_speed + std::min(s.yields / SURFACE_TIME, s.approach_speed), max_integral = s.approach_speed + surface;
    // At an impact the displacement that a lagging arm has still to do is taken back within a tick; commands in flight are not.
    const double impact_delay = s.dt + 0.5 * (s.delay + std::min(arm - s.delay, s.dt));
    const bool was_in_contact = contact.within(std::max(delay, s.lost_after));  // a shorter loss no law could have reacted to
    out.is_active = was_in_contact && in.can_yield && !now.is_taring;
    const double scale = st.oscillation.gain_scale * in.gain_scale;
    for (int i = 0; i < n; i++) {
        Constraint& c = st.parts[i];
        const StiffnessEstimate& e = c.estimate;
        const bool is_press = i < presses;
        const double error = in.desired[i] - in.force[i], desired = is_press ? in.desired[i] : 0;
        const double impact = is_press ? impact_speed(s, 0.9 * desired, 0.9 * in.limit[0], impact_delay) : 0;
        double& rate = out.rates[i];
        const auto report_gain = [&out, &s](const Gains& g) { out.gain = std::max(out.gain, g.g / (1 + g.tau / s.dt)); };
        if (now.is_taring && is_press) {
            rate = -std::min(impact + 5 * st.tare.unloaded, s.approach_speed);
            st.tare.unloaded += std::max(0.0, -std::min(in.moved[i], c.commanded));
            continue;
        }
        if (in.compliance > 0 || presses == 0) {
            const double least = s.stiffness > 0 ? s.stiffness : 0.1 * DEFAULT_STIFFNESS;
            const double k = in.compliance > 0 ? s.stiffness : std::max(least, e.bound / 4);
            Gains fixed = in.compliance > 0 ? Gains{in.compliance, 0, k > 0 ? INTEGRAL_TIME / (in.compliance * k) : INFINITY} : gains(k, 0, delay - ELECTRONICS_DELAY);
            if (presses == 0)
                fixed.g *= scale, fixed.Ti /= scale;
            const double fastest = (approaches || (!in_contact && was_in_contact)) && is_press ? s.approach_speed : INFINITY;
            rate = law(c, {fixed, error, fastest, INFINITY, INFINITY, INFINITY, integrates && fixed.Ti < INFINITY}, terms, s.dt);
            rate = std::min(rate, fastest), out.is_active = out.is_active && rate < fastest;
            out.gain = std::max(out.gain, fixed.g);
        } else if (!is_press) {
            if (!in_contact) {
                c.speed = 0;
                continue;
            }
            const Gains g = gains_of(c, st, s, scale, &st.parts[0].estimate);
            rate = law(c, {g, error, s.approach_speed, s.approach_speed, max_integral, INFINITY, integrates}, terms, s.dt);
            report_gain(g);
        } else if (!st.tare.is_done && s.tares && c.contact.never_touched() && limit > 0)
            rate = 0;  // waits for the bias
        else if (!c.contact.within(delay)) {  // approaches at impact speed, and follows a surface that moves away
            c.speed = 0;
            if (c.last.is_lost)  // errors since the loss are of the air, or of a faulty sensor
                c.slope = c.last.slope;
            if (!c.contact.within(s.lost_after))
                c.slope[0] = 0;
            const double leaves = std::max(std::min(dot(c.slope, terms), max_integral), surface);
            const double share = c.contact.never_touched() || s.lost_after == 0 ? 1 : std::min(1.0, c.contact.airborne / s.lost_after);
            rate = std::min((impact + (c.contact.never_touched() ? 0 : leaves)) * share, s.approach_speed);
        } else if (e.time <= delay) {  // an impact: no motion inwards, and the displacement in flight is taken back
            const double pending = presses == 1 && !std::isnan(st.arm.lag) ? c.pending[2] : 0, remaining = std::max(error, 0.0) / e.bound;
            const Gains g = gains_of(c, st, s, scale);
            c.speed = 0;
            rate = law(c, {g, error, 0, OVERLOAD * s.approach_speed, max_integral, 0, false}, terms, s.dt);
            rate = std::max(std::min(rate, dot(c.slope, terms) + (remaining - pending) / s.dt), -OVERLOAD * s.approach_speed);
            c.speed = std::min(0.0, c.speed);
        } else {
            const Gains g = gains_of(c, st, s, scale);
            const double margin = std::max(in.limit[0] - in.force[i] - c.check.unexplained_force, desired);
            const double inwards = impact_speed(s, margin, margin, delay) + (e.reached ? 0 : s.slope * st.peak_speed);
            const double fastest = e.reached ? inwards : inwards - std::max(dot(c.slope, terms), 0.0);
            const bool learns = integrates && c.check.unloading.phase == 0 && !c.check.is_unresponsive;
            rate = law(c, {g, error, fastest, OVERLOAD * s.approach_speed, max_integral, (e.reached ? FORCE_TOLERANCE : 0.1) * desired, learns}, terms, s.dt);
            report_gain(g);
            rate = std::min(rate, s.approach_speed + s.slope * st.peak_speed);
            if (c.check.is_unresponsive)  // the learned slope alone
                rate = dot(c.check.usual, terms);
        }
        if (const UnloadingTest& test = c.check.unloading; test.phase > 0) {  // faster than the law leaves anyway, or nothing would be shown
            const double first = FORCE_TOLERANCE * std::max(test.start_force, 4 * noise) / (e.bound * delay);
            out.is_active = false;
            rate = std::min(rate, 0.0) - std::min(first + 5 * test.commanded, std::max(OVERLOAD * impact, s.slope * st.peak_speed));
        }
        if (is_press && c.last.is_lost)
            rate = std::min(rate, c.last.led(slope_speed(c.last.slope, s, in.along), in.across, s.dt, s) / s.dt + std::max(c.last.remaining(c.yields(s)), 0.0) / s.dt);
    }
    if (is_stale || in.beyond_edge)
        out.rates = {}, out.is_active = false;
    return out;
}

void commanded(State& st, const Settings& s, const std::array<double, MAX_CONSTRAINTS>& given, double outwards, bool is_free, bool beyond_edge)
{
    const double arm = total_delay(st, s) - s.dt - s.filter_time - ELECTRONICS_DELAY;
    const auto share_of = [&s](double lag) { return lag > 0 ? 1 - std::exp(-s.dt / lag) : 1; };  // that acts within a tick
    for (int i = 0; i < st.n; i++) {
        Constraint& c = st.parts[i];
        c.commanded = given[i];
        for (int j = 0; j < MEASURED; j++) {
            const double share = share_of(LAGS[j] * arm), pending = c.pending[j] + given[i];
            c.displacement[j] += share * pending, c.pending[j] = pending - share * pending;
        }
    }
    const double pending = st.pending_outwards + outwards;
    st.outwards = share_of(arm) * pending, st.pending_outwards = pending - st.outwards, st.law_is_free = is_free;
    if (st.stop.fault != Fault::none)
        st.stop.retreated += std::max(0.0, outwards);
    else if (beyond_edge)
        for (Constraint& c : st.parts)
            c.check = {}, c.last = {};
    else if (st.n > 0 && st.touching())
        st.pushed = std::max(0.0, st.pushed - outwards);
    else
        st.approached = (st.pushed > 0 ? 0 : st.approached) + std::max(0.0, -outwards), st.pushed = 0;
}

}  // namespace iq::force
