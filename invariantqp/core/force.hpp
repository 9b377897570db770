// The force law and its monitor: from forces along the constraints of a contact to a speed along each of them.
//
//     tau v' + v = g (e + integral)              e = desired - measured force
//     L(s) = g (1 + 1/(Ti s)) / (1 + tau s) * (k + b s)/s * exp(-T s)
//
// k and b are upper bounds of the contact's stiffness and damping as commands meet them, T is the total delay of the loop:
//
//     g = min( G/(k (T + tau)), (1 + tau/T)/(GM b) ),     Ti = 8/(g k),     tau where both are equal, else 0
//
// G = 1/2 leaves a phase margin of 61 degrees to a spring without the integral. GM is the gain margin where a damper,
// whose gain does not fall with frequency, limits the gain. With the integral, and with true k down to a quarter of the bound
// and b down to zero: gain margin 2.15, phase margin 54 degrees, largest sensitivity 1.87 (force/loop_margins.py).
// Reference: Skogestad 2003 (half rule, integral time); Villani and De Schutter 2016, force control.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>

namespace iq::force {

// G: crossover frequency times the delay. GM: gain margin against a damper. Integral time in 1/(g k).
constexpr double CROSSOVER = 0.5, GAIN_MARGIN = 2.5, INTEGRAL_TIME = 8;

struct Gains {
    double g = 0;    // [length/s per force]
    double tau = 0;  // lag of the law [s]
    double Ti = 0;   // integral time [s]
};
// The gains for upper bounds of stiffness k [force/length] and damping b [force s/length] and a delay [s].
Gains gains(double k, double b, double delay);

// ---------------------------------------------------------------------------------------------------------------------
// A tick of the law. Forces and displacements are unit parts and unit rates of force/contact.py, presses first; a displacement
// inwards is positive. `State` holds everything that a loop remembers.

constexpr int MAX_CONSTRAINTS = 6;
constexpr int SLOPE_TERMS = 7;             // 1 and the six components of the motion along the contact
constexpr double CERTAIN = 13.815510558;   // log(1e6): at most one wrong decision in a million ticks
constexpr double DEFAULT_STIFFNESS = 2e5;  // [N/m] of a table behind an arm
constexpr double DAMPING_TIME = 0.01;      // [s] damping over stiffness, before it is estimated
constexpr double MIN_STIFFNESS = 1e-3;     // the softest contact, as a share of the prior
constexpr double ELECTRONICS_DELAY = 0.003;  // [s] of electronics, bus and driver, which nobody declares
constexpr double DEFAULT_LAG = 0.02;       // [s] of joints before it is measured,
constexpr double MAX_LAG = 0.1;            // and at most
constexpr double FORCE_TOLERANCE = 0.2;    // a force within this share of the desired one is reached
constexpr double WINDOW = 10;              // of the estimates, in delays
constexpr double RESOLUTION = 1e-4;        // displacements below this share of the contact's size are noise of the joints
constexpr double OVERLOAD = 2.5;           // an overload, in desired forces; fastest speed outwards, in approach speeds
constexpr double SURFACE_TIME = 0.3;       // [s] a surface that may move by `yields` moves by it in this time
constexpr double SETTLING_TIME = 1;        // [s] until a force counts as steady, or as not reached
constexpr double STEP = 0.02;              // a displacement that shows something, in sizes of the contact: a millimetre of 50
constexpr double SLOW = 0.1;               // motion slower than this share of the approach speed is at rest

using Slope = std::array<double, SLOPE_TERMS>;

enum class OnLoss { approach, hold, retreat, go_on };
enum class Action { follow, approach, hold, retreat };
enum class Fault {
    none, overload, stale_sensor, tension, no_response, blocked, not_following, lost, no_contact_distance, no_contact_time
};
enum Warning { OSCILLATES = 1, NOT_REACHED = 2, NOISY = 4, UNRESPONSIVE = 8, UNLOADING = 16, TARING = 32, TARE_IS_OLD = 64 };

struct Settings {
    double dt, noise, delay, filter_share, filter_time;  // [s]; noise of a force component
    double size, slope, yields, stiffness;               // stiffness 0: not declared
    double lost_below, lost_after, approach_speed, approach_distance, approach_time, retreat_distance;
    double drift;       // of the sensor [force/s]
    OnLoss on_loss;
    bool tares, fault_retreats;
    double prior_stiffness() const { return stiffness > 0 ? stiffness : DEFAULT_STIFFNESS; }
};

// Whether the tool is in contact: a sequential test of a noisy press against no contact (Page 1954, Wald 1945).
struct ContactTest {
    double evidence = -CERTAIN, airborne = INFINITY;  // log likelihood ratio; [s] since contact was certain
    bool touching = false;
    void update(double press, double limit, double noise, double dt);
    bool within(double time) const { return touching || airborne <= time; }
    bool never_touched() const { return airborne == INFINITY; }
};

// f = k x + b x' by least squares on the high-pass filtered displacement x and force f.
struct StiffnessRegression {
    double k = 0, b = 0, k_error = 0, b_error = 0;
    double x = 0, x_mean = 0, x_means = 0, v_mean = 0, v_means = 0;  // filtered once and twice
    std::array<double, 5> sums{};                                   // xx, xv, vv, xf, vf
    double residual = 0;
};
// One regression for each displacement that may explain the force: the commanded one, later by none, half or all of the lag
// that joints have in the air, or the measured one, where drives are compliant. The one with the least residual counts.
constexpr int FITS = 4, MEASURED = 3;
constexpr std::array<double, FITS> LAGS{0, 0.5, 1, 1};

// Stiffness and damping of a contact. They are estimated only while the force approaches the desired one, when commands cause
// the change of the readings: of a sliding tool the surface changes the readings, and the commands follow them.
struct StiffnessEstimate {
    std::array<StiffnessRegression, FITS> fits{};
    int best = 2;
    double bound = 0, prior = 0, force = 0, force_mean = 0, force_means = 0;
    double time = 0, time_loaded = 0, time_off = 0, time_settled = 0, time_learning = 0;  // [s] time_off: signed
    double desired = 0, displacement_in_air = NAN, max_damping = INFINITY;
    bool reached = false, stiffened = false, is_learning = true;

    void restart(double stiffness);
    void set_prior(double stiffness);  // a stiffness that an impact or an unloading has shown
    void in_air(double reading, const std::array<double, FITS>& displacement, bool no_force, const Settings& s);
    void update(double reading, const std::array<double, FITS>& displacement, double missing, double largest, bool is_loaded, double delay,
                double noise, double speed, const Settings& s);
    const StiffnessRegression& fit() const { return fits[best]; }
    bool has_data() const { return fit().sums[0] > 0; }
    double lower() const { return has_data() ? std::max(fit().k - 2 * fit().k_error, 0.0) : 0; }  // 0: not known
    double known() const { return has_data() && fit().k > 2 * fit().k_error ? fit().k : NAN; }
    double damping() const { return std::min(std::max(fit().b, 0.0) + fit().b_error, max_damping); }
    double late_response() const { return std::max(-fit().b - fit().b_error, 0.0); }  // extra delay of the force, times k

  private:
    void set_prior_from_impact(double noise, const Settings& s);
};

// Unloads the press to see whether the readings fall: in phase 1 by a share, in phase 2 fully.
struct UnloadingTest {
    int phase = 0;  // 0: not active
    double start_depth = 0, start_force = 0, extreme_force = 0, commanded = 0, max_distance = 0, distance_at_zero = NAN;
    bool is_static = false;  // started by a displacement at rest, not by an unresponsive force
};
// Whether readings and displacements agree, sliding and at rest.
struct ConsistencyCheck {
    double depth = 0;
    double time_at_rest = 0, rest_depth = NAN, rest_force = 0, rest_desired = 0, slid_at_rest = 0, time_off = 0, off_depth = 0;
    double extra = 0, min_force = 0, max_force = 0;  // displacement beyond the usual slope, and the force meanwhile
    double slid_while_off = 0;
    double last_press = NAN, jump_time = 0;  // [s] for how long a jump of the reading still counts
    bool has_jumped = false;                 // the force left its range faster than the steepest slope explains
    double stiffness = 0, last_stiffness = 0;  // lower bounds, now and when the force changed last
    double unexplained_force = 0;
    bool is_unresponsive = false;
    Slope usual{};                           // the mean slope of the last second
    double surface_motion = 0;               // how far the surface is known to move
    UnloadingTest unloading;
    void start_unloading(double force, const Settings& s, bool is_static);
    void restart(double force, const Slope& slope, double motion);  // forgets all but the motion of the surface
};
// The deepest place of the last second at which contact was felt, as measured and as commanded. Readings that then fall may be
// those of the air or of a faulty sensor, so the tool goes at most half a press deeper. The place moves along with the slope
// that was learned; and with the steepest one if readings fell no faster than that slope explains.
struct LastContact {
    bool is_known = false, is_lost = false;         // lost: and the press was not reached since
    double measured = 0, commanded = 0;             // displacement beyond that place, less the learned slope
    double slip = 0, desired = 0, stiffness = 0;    // there
    Slope slope{};
    double steepest = 0;                            // how much more the steepest slope would have led, since the press was reached
    bool is_classified = false, is_slope = false;   // whether the reason is known why readings fell, whether a slope may be it
    double time_without_response = 0;               // [s]
    double tolerance() const { return 0.5 * desired / stiffness; }
    double remaining(double yields) const { return yields + tolerance() - std::max(measured, commanded); }
    bool is_used_up(double yields) const { return is_lost && remaining(yields) < 0.1 * tolerance(); }
    double led(double slope_speed, double across, double dt, const Settings& s) const
    {
        return is_slope ? std::max(dt * slope_speed, s.slope * across) : dt * slope_speed;
    }
};
struct Constraint {
    ContactTest contact;
    StiffnessEstimate estimate;
    ConsistencyCheck check;
    LastContact last;
    double speed = 0, commanded = 0, slip = 0;         // slip: commanded less measured speed, averaged
    std::array<double, FITS> displacement{}, pending{};  // for each regression; of the commands that are still to act
    Slope slope{};                                     // integral term, coefficients of 1 and of the speed along the contact
    double yields(const Settings& s) const { return s.yields + check.surface_motion; }
};

struct Tare {
    std::array<double, 6> bias{}, sum{};  // sum: integral of the load
    bool is_done = false;
    double time = 0, age = 0;            // [s] of the mean, since the last one
    double unloaded = 0, max_force = 0;  // distance of a press that is unloaded to tell a contact from a bias
};
struct NoiseEstimate {
    double count = 0, change = 0, sigma = 0;  // mean change of a reading; 0: not more than declared
    void update(const std::array<double, 6>& reading, const std::array<double, 6>& last, double supposed);
};
// The lag of the joints: their speed closes a share of its error in a tick.
struct LagEstimate {
    double last = 0, missing = 0, closed = 0, fastest = 0, lag = NAN;  // squares of displacements in a tick; [s]
    void update(double commanded, double measured, const Settings& s);
};
struct ApproachCheck {
    double time = 0, distance = 0, commanded = 0, measured = 0;  // the last two fade over half the retreat
};
struct OscillationMonitor {
    double mean = NAN, time_off = 0, reversals = 0, since_reversal = INFINITY, since_oscillation = INFINITY, extreme = 0, desired = 0;
    double gain_scale = 1;
    bool is_rising = true;
};
struct Stop {
    Fault fault = Fault::none;
    std::array<double, 4> numbers{};
    double retreated = 0, distance = 0, min_force = INFINITY;  // min_force: since the stop
};
struct State {
    std::array<Constraint, MAX_CONSTRAINTS> parts{};
    int n = 0, presses = -1;
    std::array<double, 6> filtered{}, last_reading{};
    bool has_reading = false;
    Tare tare;
    NoiseEstimate noise;
    LagEstimate arm;
    double time_unchanged = 0;           // StaleSensorCheck: [s] that a reading has repeated while the tool moves
    bool has_changed = false;
    double tension_evidence = -CERTAIN;  // TensionCheck: log likelihood ratio of a pull
    ApproachCheck approach;
    std::array<double, 2> overload{};    // limits of force and moment
    OscillationMonitor oscillation;
    Stop stop;
    double peak_speed = 0, time_at_rest = 0;  // along the contact
    bool law_is_free = true;             // no limit changed the last command
    double pushed = 0, approached = 0, pending_outwards = 0, outwards = 0;

    bool touching() const  // in all presses
    {
        return presses >= 0 && std::all_of(parts.begin(), parts.begin() + presses, [](const Constraint& c) { return c.contact.touching; });
    }
    bool is_unresponsive() const
    {
        return std::any_of(parts.begin(), parts.begin() + std::max(presses, 0), [](const Constraint& c) { return c.check.is_unresponsive; });
    }
};

struct Inputs {
    int n, presses;
    std::array<double, MAX_CONSTRAINTS> desired{}, force{}, desired_press{}, press{};  // unit parts, filtered; presses, raw
    std::array<double, MAX_CONSTRAINTS> moved{};             // unit displacements since the last tick, measured
    std::array<double, 6> reading{}, load{}, along{};        // load in the sensor's frame; motion [length/s]
    std::array<double, 2> measured{}, limit{};                   // force and moment, and what is an overload
    double total_press = 0, missing = 0, gain_scale = 1, came = 0, across = 0, compliance = 0;
    double along_commanded = 0, along_measured = 0;          // displacements along the contact in the last tick
    bool beyond_edge = false, can_yield = true;
};
struct Output {
    std::array<double, MAX_CONSTRAINTS> rates{};
    Action action = Action::follow;
    Fault fault = Fault::none;
    bool lost = false, is_active = true;
    int warnings = 0;
    double delay = 0, gain = 0;
};

// The load without the bias, raw and filtered, both (6,) in the sensor's frame.
void read(State& state, const Settings& s, const std::array<double, 6>& load, std::array<double, 6>& raw, std::array<double, 6>& filtered);
Output tick(State& state, const Settings& s, const Inputs& in);
// Records the command: unit displacements, the displacement outwards; whether no limit changed it.
void commanded(State& state, const Settings& s, const std::array<double, MAX_CONSTRAINTS>& given, double outwards, bool is_free, bool beyond_edge);

// The contact of all presses together, and what the checks of a tick share.
struct TickSignals {
    ContactTest contact;
    double limit, sigma, noise, delay;  // press that counts as contact; noise of a reading, of a filtered one; [s]
    bool is_taring;
};
// The log likelihood ratio of contact after one more reading.
double updated_evidence(double evidence, double press, double limit, double noise);
// The speed along a constraint that a slope gives to a motion along the contact.
double slope_speed(const Slope& slope, const Settings& s, const std::array<double, 6>& along);
// The monitor: faults, warnings and what to do (`out`).
void monitor(State& state, const Settings& s, const Inputs& in, const TickSignals& now, Output& out);

}  // namespace iq::force
