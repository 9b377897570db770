// The force law: from a force error to a speed along each constraint of a contact.
//
//     tau v' + v = g (e + integral)              e = wanted - measured force
//     L(s) = g (1 + 1/(Ti s)) / (1 + tau s) * (k + b s)/s * exp(-T s)
//
// k and b are upper bounds of the contact's stiffness and damping as commands meet them, T is everything late in the loop:
//
//     g = min( G/(k (T + tau)), (1 + tau/T)/(GM b) ),     Ti = 8/(g k),     tau where both are equal, else 0
//
// G = 1/2 leaves a phase margin of 61 degrees to a spring without the integral. GM is the gain margin where a damper,
// whose gain does not fall with frequency, rules. With the integral, and with true k down to a quarter of the bound and b
// down to zero: gain margin 2.15, phase margin 54 degrees, largest sensitivity 1.87 (`margins`).
// Reference: Skogestad 2003 (half rule, integral time); Villani and De Schutter 2016, force control.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>

namespace iq::force {

// G: crossover frequency times what is late. GM: gain margin against a damper. Integral time in 1/(g k).
constexpr double CROSSOVER = 0.5, GAIN_MARGIN = 2.5, INTEGRAL = 8;

struct Gains {
    double g = 0;    // [length/s per force]
    double tau = 0;  // lag of the law [s]
    double Ti = 0;   // integral time [s]
};
// The gains for upper bounds of stiffness k [force/length] and damping b [force s/length] and lateness [s].
Gains gains(double k, double b, double late);

struct Margins {
    double gain, phase, sensitivity;  // ratio, [rad], largest |1/(1 + L)|
};
// The margins of the loop with a true stiffness and damping.
Margins margins(const Gains& law, double k, double b, double late);

// ---------------------------------------------------------------------------------------------------------------------
// A press in a loop: readings in, rates along the constraints out. Forces and ways are unit parts and unit rates of
// force/contact.py, presses first; a way inwards is positive. Everything that a loop remembers is one value, `State`.

constexpr int MOST = 6;                    // constraints
constexpr double CERTAIN = 13.815510558;   // log(1e6): at most one wrong decision in a million ticks
constexpr double STIFF = 2e5;              // [N/m] a table behind an arm; what is assumed where nothing is known
constexpr double DAMPED = 0.01;            // [s] damping over stiffness that is assumed beside it
constexpr double SOFTEST = 1e-3;           // the softest contact, as a share of where an estimate begins
constexpr double STIFFER = 3;              // a touch shows a contact at most so many times as stiff as its rise over its way
constexpr double UNKNOWN = 0.003;          // [s] late in electronics, bus and driver, declared by nobody
constexpr double LAG = 0.02;               // [s] of joints before it is measured,
constexpr double LONGEST_LAG = 0.1;        // and at most
constexpr double SHORT = 0.2;              // a force within this share of the wanted one is reached
constexpr double WINDOW = 10;              // what an estimate looks back, in lateness
constexpr double RESOLVED = 1e-4;          // ways below this share of the contact's size are noise of the joints
constexpr double OVERLOAD = 2.5;           // fastest speed outwards, in approach speeds
constexpr double MOVES_IN = 0.3;           // [s] what a surface may move it may move within this time
constexpr double PATIENCE = 1;             // [s] until a force counts as standing, or as not reached

enum class Loss { approach, hold, retreat, go_on };
enum class Action { follow, approach, hold, retreat };
enum class Reason {
    none, overload, dead, pulls, no_response, held_back, not_following, lost, no_contact_way, no_contact_time
};
enum Doubt { SWINGS_TOLD = 1, NOT_REACHED = 2, NOISY = 4, UNEXPLAINED = 8, UNLOADING = 16, TARING = 32, NOT_TARED = 64 };

struct Settings {
    double dt, noise, delay, filter_share, filter_time;  // [s]; noise of a force component
    double size, slope, yields, stiffness;               // stiffness 0: not declared
    double lost_below, lost_after, approach_speed, approach_distance, approach_time, retreat_distance;
    double drift;       // of the sensor [force/s]
    Loss on_loss;
    bool tares, fault_retreats;
};

// Whether the tool touches: a sequential test of a noisy press against the air (Page 1954, Wald 1945).
struct Touch {
    double evidence = -CERTAIN, airborne = INFINITY;
    bool touching = false;
    void update(double press, double limit, double noise, double dt);
    bool lasts(double time) const { return touching || airborne <= time; }
};

// How the force responds: f = k x + b x', by least squares on what a high-pass leaves of a way x and of f.
struct Fit {
    double k = 0, b = 0, k_error = 0, b_error = 0;
    double x = 0, x_mean = 0, x_means = 0, v_mean = 0, v_means = 0;
    std::array<double, 5> sums{};  // xx, xv, vv, xf, vf
    double residual = 0;
};
// Which way explains the force is not known: the commanded one, later by none, half or all of the lag that joints have in
// the air, or the measured one, where motors give way. The fit with the least residual counts, and its lag.
// It learns while the force is brought to the wanted one, when commands cause what is measured, and at no other time:
// while a tool slides, readings change by what it slides on, and commands answer them.
constexpr int FITS = 4;
constexpr std::array<double, FITS> LAGS{0, 0.5, 1, 1};

struct Response {
    std::array<Fit, FITS> fits{};
    int best = 2;
    double bound = 0, begins = 0, f = 0, f_mean = 0, f_means = 0;
    double time = 0, lasted = 0, lacked = 0, calm = 0, window = 0, wanted = 0, quiet = NAN, most_damping = INFINITY;
    bool reached = false, rose = false, learns = true;

    void start(double stiffness);
    void show(double stiffness);  // a stiffness that a touch or an unloading has shown
    void in_air(double force, const std::array<double, FITS>& ways, bool quiet_now, const Settings& s, double stiffness);
    void update(double force, const std::array<double, FITS>& ways, double missing, double most, bool felt, double late, double noise,
                double moves, const Settings& s);
    const Fit& fit() const { return fits[best]; }
    double least() const { return fit().sums[0] > 0 ? std::max(fit().k - 2 * fit().k_error, 0.0) : 0; }  // 0: nothing is known
    double known() const { return fit().sums[0] > 0 && fit().k > 2 * fit().k_error ? fit().k : NAN; }
    double damping() const { return std::min(std::max(fit().b, 0.0) + fit().b_error, most_damping); }
    double behind() const { return std::max(-fit().b - fit().b_error, 0.0); }  // a force that comes late, times k

  private:
    void touched(double noise, const Settings& s);
};

// Whether readings and measured ways agree, and the unloading test that asks at rest.
struct Check {
    double depth = 0, rested = 0, rest_depth = NAN, rest_force = 0, rest_wanted = 0, slid = 0, off = 0, off_depth = 0;
    double extra = 0, low = 0, high = 0;        // way beyond the usual speed, and the range of the force meanwhile
    double across = 0;                          // way along the surface meanwhile, while the force is off
    double before = NAN, jumps = 0;             // the reading of the last tick; for how long a jump of it counts [s]
    bool jumped = false;                        // whether the force went off faster than the steepest slope lets it
    double least = 0, shown = 0;                // of the stiffness, as shown when the force changed last
    double unexplained = 0;                     // what that way is worth [force]
    bool silent = false;                        // the force does not answer it
    std::array<double, 7> usual{};              // the integral of the last second
    double moves = 0;                           // how far the surface is known to have moved
    int phase = 0;                              // of the unloading test: 0 none, 1 a share of the press, 2 all of it
    double began = 0, force = 0, lowest = 0, led = 0, ends = 0, fell = NAN;
    bool surface = false;                       // whether the way, not the silence, is what made it ask
};
// Where contact was felt last: the deepest place of the last second, as joints moved and as they were commanded. Readings
// that then fall may be those of the air or of a sensor that fails, so nothing is approached more than half a press deeper.
// The place moves along by the slope that is remembered; by the steepest one, too, if readings fell no faster than it lets them.
struct Reach {
    bool known = false, held = false;       // held: contact was lost, and the press has not been reached since
    double done = 0, sent = 0;              // beyond that place, less the slope that is remembered
    double slip = 0, wanted = 0, bound = 0;  // there: speed that motors lose to the press, press, stiffness,
    std::array<double, 7> slope{};          // and slope
    double falls = 0;                       // how much more the steepest slope would have led, since the press was reached
    bool judged = false, sloped = false;    // whether it is known what made the readings fall, whether a slope may have
    double stands = 0;                      // for how long too little has been felt there [s]
    double left(double room) const { return room + 0.5 * wanted / bound - std::max(done, sent); }
    double led(double slope, double across, double dt, const Settings& s) const
    {
        return sloped ? std::max(dt * slope, s.slope * across) : dt * slope;
    }
    bool used_up(double room) const { return held && left(room) < 0.1 * 0.5 * wanted / bound; }
};
struct Constraint {
    Touch touch;
    Response response;
    Check check;
    Reach reach;
    double speed = 0, given = 0, slip = 0;        // slip: commanded less measured speed, averaged
    std::array<double, FITS> shown{}, coming{};  // ways as commanded, and what of them is to come, for each fit
    std::array<double, 7> slope{};              // integral in the base (1, speed along)
};
struct State {
    std::array<Constraint, MOST> parts{};
    int n = 0, presses = -1;
    // sensor: low-pass, bias, noise
    std::array<double, 6> smooth{}, bias{}, sum{}, last{};
    bool read = false, tared = false, in_contact = false;
    double batch = 0, age = 0, probe = 0, probe_force = 0;
    double readings = 0, change = 0, noise = 0;
    // arm: squares of the speed that is missing, and what the next tick closes of it
    double done = 0, missing = 0, closed = 0, fastest = 0, lag = NAN;
    // monitor
    double unchanged = 0, pull = -CERTAIN, waited = 0, led = 0, came = 0, way = 0;
    bool alive = false;
    std::array<double, 2> most{};
    double mean = NAN, missed = 0, swings = 0, since_turn = INFINITY, swung = INFINITY, extreme = 0, eased = 1, wanted = 0;
    bool rises = true, free = true;
    double along = 0, still = 0;
    Reason found = Reason::none;
    std::array<double, 4> numbers{};
    // Whether every press is felt, after a tick; whether a force does not answer the motion.
    bool touching() const
    {
        const auto felt = [](const Constraint& c) { return c.touch.touching; };
        return presses >= 0 && std::all_of(parts.begin(), parts.begin() + presses, felt);
    }
    bool silent() const
    {
        const auto one = [](const Constraint& c) { return c.check.silent; };
        return std::any_of(parts.begin(), parts.begin() + std::max(presses, 0), one);
    }
    double left = 0, away = 0, pushed = 0, approached = 0, out_coming = 0, out_shown = 0, least = INFINITY;  // least: force since the stop
};

struct Inputs {
    int n, presses;
    std::array<double, MOST> wanted{}, force{}, press_wanted{}, press{};  // unit parts, smoothed; presses, raw
    std::array<double, MOST> done{};                                     // unit ways that the joints did since the last tick
    std::array<double, 6> reading{}, load{}, along{};                    // load in the sensor's frame; motion [length/s]
    std::array<double, 2> felt{}, most{};                                // force and moment, and what is an overload
    double together = 0, missing = 0, noise_share = 0, came = 0, across = 0, compliance = 0;
    double along_given = 0, along_done = 0;  // ways along the contact, commanded and done in the last tick
    bool beyond = false, yields = true;
};
struct Output {
    std::array<double, MOST> rates{};
    Action action = Action::follow;
    Reason reason = Reason::none;
    bool lost = false, acts = true;
    int doubts = 0;
    double late = 0, gain = 0;
};

// The load without the bias, raw and smoothed, both (6,) in the sensor's frame.
void read(State& state, const Settings& s, const std::array<double, 6>& load, std::array<double, 6>& raw, std::array<double, 6>& smooth);
Output tick(State& state, const Settings& s, const Inputs& in);
// What was commanded: unit ways, the way out of the place of contact; whether the law acted in full.
void commanded(State& state, const Settings& s, const std::array<double, MOST>& given, double out, bool free, bool beyond);
double lateness(const State& state, const Settings& s);

constexpr double STALE = 0.012;  // [s] a reading with noise that repeats for so long is not pressed by
// The log of how much likelier contact is than air, after one more reading.
double weighed(double evidence, double press, double limit, double noise);
// The base of the integral, 1 and the speed along, in sizes per 10 s; a slope turns round with the motion.
std::array<double, 7> base_of(const Settings& s, const std::array<double, 6>& along);
// The rate of the slope that a motion along the contact is remembered to have.
double slope_rate(const std::array<double, 7>& slope, const Settings& s, const std::array<double, 6>& along);
// The monitor: what stops the tool, what is doubted, and what to do (`out`).
void watch(State& state, const Settings& s, const Inputs& in, const Touch& touch, double limit, double sigma, double noise,
           double late, bool probing, Output& out);

}  // namespace iq::force
