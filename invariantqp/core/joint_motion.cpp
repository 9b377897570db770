#include "joint_motion.hpp"
#include "tolerances.hpp"

namespace iq {
namespace {

// Joints catch up at these shares of acceleration and velocity: what they follow needs some, too.
constexpr double CATCH_UP_SHARE = 0.7, CATCH_UP_SPEED = 0.99;
constexpr double TRACKING_SHARE = 0.1;  // of an error, in a tick, as of a tracking gain
constexpr double AT_LIMIT = 1e-6;       // a joint this far beyond its range is at its limit [rad, length]
// Accelerations are equal that differ by less than this share of the change by jerk in a tick.
constexpr double SAME = 1e-6;
constexpr int HALVINGS = 24;  // of the search for the largest acceleration after which a joint can stop
// Splices and plans keep this share of the limits; the motion is checked at so many places.
constexpr double SHARE = 0.97;
constexpr int PLACES = 21;
// The time in which points that a joint cannot reach in time weigh less grows by this factor at each try, at most so
// often: errors were at most 3 % above those of a QP inside the limits (five runs).
constexpr double DELAY_GROWTH = 1.3;
constexpr int TRIES = 12;
// A clock's change of rate takes from so many ticks to so long [s], is chosen among so many durations, and may wait so
// long for joints that brake [s].
constexpr double SHORTEST_TURN = 4, LONGEST_TURN = 4, TURN_SHARE = 0.999;
constexpr int TURNS = 64;
constexpr double WAITS[] = {0, 0.02, 0.05, 0.1, 0.2};

// The distance upward in a tick at acceleration a, from a velocity, and in stopping after it.
double stopping_distance(double velocity, double a, double A, double J, double dt)
{
    const double v = velocity + dt * a;
    double p = std::sqrt(std::max(J * v + 0.5 * a * a, 0.0)), hold = 0;
    const bool full = p > A;
    p = std::min(p, A);
    const double t = std::max((a + p) / J, 0.0), v1 = v + a * t - 0.5 * J * t * t;
    if (full)
        hold = std::max(v1 - p * p / (2 * J), 0.0) / p;
    double way = v * t + 0.5 * a * t * t - J * t * t * t / 6 + v1 * hold - 0.5 * p * hold * hold + p * p * p / (6 * J * J);
    if (a < 0 && v > 0 && J * v <= 0.5 * a * a) {  // braking harder than the stop needs: it ends while a still rises
        const double s = (-a - std::sqrt(std::max(a * a - 2 * J * v, 0.0))) / J;
        way = v * s + 0.5 * a * s * s + J * s * s * s / 6;
    }
    // One tick more: the discrete motion is ahead of the continuous one.
    way = v <= 0 && a <= 0 ? 0 : std::max(way, 0.0) + dt * std::max(v, 0.0);
    return dt * std::max(v, 0.0) + way;
}

// The largest acceleration from `low` up to the wanted one after which a joint can still stop below its upper limit.
double largest_acceleration(const MotionLimits& limits, int j, double room, double velocity, double low, double wanted)
{
    const double A = limits.acceleration[j], J = limits.jerk[j], dt = limits.dt, left = limits.velocity[j] - velocity;
    // v + dt a + a^2 / 2 J <= V; where braking has to begin at once, a falls as fast as it may.
    const double fastest = left > 0 ? std::sqrt(J * J * dt * dt + 2 * J * left) - J * dt : left / dt;
    const double a = std::max(std::min(wanted, fastest), low);
    if (stopping_distance(velocity, a, A, J, dt) <= room)
        return a;
    double high = a;
    for (int i = 0; i < HALVINGS; i++) {
        const double middle = 0.5 * (low + high);
        (stopping_distance(velocity, middle, A, J, dt) <= room ? low : high) = middle;
    }
    return low;
}

// The shares that the four coefficients of a piece of a cubic B-spline have, u of it over.
std::array<double, 4> spline_weights(double u)
{
    const double left = 1 - u;
    return {left * left * left / 6, (4 + u * u * (3 * u - 6)) / 6, (1 + u * (3 + u * (3 - 3 * u))) / 6, u * u * u / 6};
}

// A plan of one joint: a cubic B-spline of n even pieces with n + 3 coefficients c, the last three the same.
//
//     argmin sum w_i |r(t_i) - p_i|^2 + smoothing_time^6 integral |r'''|^2,     w_i: the time between points
class JointPlan {
  public:
    JointPlan(const MotionLimits& limits, int joint, Vec times, Mat points, double smoothing_time, int n, Workspace& w)
        : c(w, n + 3), limits(limits), joint(joint), times(times), points(points), smoothing_time(smoothing_time), h(times[times.n - 1] / n), n(n),
          bands(w, n + 1, 4), right(w, n + 1)
    {
    }
    Vec c;

    // From position, velocity and acceleration; until when points weigh less, because the joint cannot be there.
    double solve(double x, double v, double a)
    {
        v *= h, a *= h * h;
        c[0] = x - v + a / 3, c[1] = x - a / 6, c[2] = x + v + a / 3;
        double late_until = 0;
        for (int i = 0; i < TRIES; i++) {
            fit(late_until);
            const double share = utilisation();
            if (share <= SHARE)
                break;
            late_until = std::max(late_until, 2 * smoothing_time) * std::max(share, DELAY_GROWTH);
        }
        return late_until;
    }

  private:
    const MotionLimits& limits;
    const int joint;
    const Vec times;
    const Mat points;
    const double smoothing_time, h;
    const int n;
    Mat bands;  // upper bands of the normal equations, from the diagonal on
    Vec right;

    // A row of the least squares on the coefficients from `first` on, those from n on the same, the first three known.
    void add(int first, const std::array<double, 4>& row, double wanted, double weight)
    {
        for (int i = 0; i < 4 && first + i < 3; i++)
            wanted -= row[i] * c[first + i];
        for (int i = 0; i < 4; i++) {
            const int a = std::min(first + i, n);
            right[a] += weight * row[i] * wanted;
            for (int k = 0; k < 4; k++)
                if (const int b = std::min(first + k, n); b >= a)
                    bands(a, b - a) += weight * row[i] * row[k];
        }
    }
    void fit(double late_until)
    {
        bands.all().fill(0), right.fill(0);
        for (int i = 0; i < times.n; i++) {
            const double late = std::min(times[i] / std::max(late_until, times[0]), 1.0), apart = times[i] - (i > 0 ? times[i - 1] : 0);
            const int piece = static_cast<int>(std::min(times[i] / h, n - 1.0));
            add(piece, spline_weights(times[i] / h - piece), points(i, joint), apart * late * late);
        }
        for (int i = 0; i < n; i++)
            add(i, {-1, 3, -3, 1}, 0, h * std::pow(smoothing_time / h, 6));
        for (int i = 3; i <= n; i++) {  // L diag L' in the bands, and L right = right
            for (int k = 1; k < 4 && i + k <= n; k++) {
                const double share = bands(i, k) / bands(i, 0);
                for (int l = k; l < 4 && i + l <= n; l++)
                    bands(i + k, l - k) -= share * bands(i, l);
                right[i + k] -= share * right[i];
            }
        }
        for (int i = n; i >= 3; i--) {
            double x = right[i];
            for (int k = 1; k < 4 && i + k <= n; k++)
                x -= bands(i, k) * c[i + k];
            c[i] = x / bands(i, 0);
        }
        c[n + 1] = c[n + 2] = c[n];
    }
    double utilisation() const
    {
        double share = 0;
        for (int i = 0; i <= n; i++) {
            const double* k = c.p + i;
            const double jerk = i < n ? k[3] - 3 * k[2] + 3 * k[1] - k[0] : 0;
            share = std::max(share, limits.utilisation(joint, (k[0] + 4 * k[1] + k[2]) / 6, (k[2] - k[0]) / (2 * h),
                                                  (k[0] - 2 * k[1] + k[2]) / (h * h), jerk / (h * h * h)));
        }
        return share;
    }
};

// The duration of a clock's change of rate and its utilisation of the limits: the shortest inside them, or else the one
// that exceeds them least.
std::pair<double, double> change_of_rate(const Motion& motion, Clock clock, const MotionLimits& limits, Workspace& w)
{
    const double shortest = SHORTEST_TURN * limits.dt, ratio = LONGEST_TURN / shortest;
    const Mat r(w, 4, motion.columns);
    Vec durations(w, TURNS), worst(w, TURNS, 0);
    for (int i = 0; i < TURNS; i++) {
        clock.duration = durations[i] = shortest * std::pow(ratio, i / (TURNS - 1.0));
        for (int k = 0; k < 2 * PLACES - 1; k++) {
            motion.at(clock.start + clock.duration * k / (2 * PLACES - 2), clock, r);
            worst[i] = std::max(worst[i], limits.utilisation(r));
        }
        if (worst[i] <= TURN_SHARE)
            return {durations[i], worst[i]};
    }
    const double least = 1.0001 * *std::min_element(worst.begin(), worst.end());
    int i = 0;
    while (worst[i] > least)
        i++;
    return {durations[i], worst[i]};
}

}  // namespace

double MotionLimits::utilisation(int j, double x, double v, double a, double da) const
{
    const double needs = std::max(std::max(std::abs(v) / velocity[j], std::abs(a) / acceleration[j]), std::abs(da) / jerk[j]);
    const double out = std::max(x - upper[j], lower[j] - x);
    return out > AT_LIMIT ? std::max(needs, 2 + out) : needs;
}
double MotionLimits::utilisation(Mat r) const
{
    double most = 0;
    for (int j = 0; j < joints(); j++)
        if (const double needs = utilisation(j, r(0, j), r(1, j), r(2, j), r(3, j)); !(needs <= most))
            most = std::isnan(needs) ? INFINITY : needs;
    return most;
}

double MotionLimits::acceleration_towards(int j, double v, double wanted) const
{
    // In ticks: what an acceleration a that falls by J dt a tick still adds is a^2 / 2 J - a dt / 2.
    const double d = wanted - v, J = jerk[j], h = 0.5 * J * dt, twice = 2 * J * std::abs(d);
    const double most = std::min(twice / (std::sqrt(h * h + twice) + h), acceleration[j]);
    return std::clamp(d / dt, -most, most);
}

double MotionLimits::approach_speed(int j, double distance, double gain) const
{
    // The distance to stop from w is w^2 / 2 A and w 2 A / J: the time in which braking begins and ends.
    const double A = CATCH_UP_SHARE * acceleration[j], lag = 2 * A * A / jerk[j];
    return std::min(std::sqrt(lag * lag + 2 * A * std::abs(distance)) - lag, gain * std::abs(distance));
}

double MotionLimits::peak_speed(int j, double distance) const
{
    // The distance from rest to v and back: v^2 / 2 A and v A / 2 J, then as in `approach_speed`, at first v / gain.
    const double A = acceleration[j], d = std::abs(distance), slow = dt / TRACKING_SHARE;
    const double a = 0.5 * (1 + 1 / CATCH_UP_SHARE) / A, b = (0.5 + 2 * CATCH_UP_SHARE) * A / jerk[j];
    const double jerky = 2 * d / (b + std::sqrt(b * b + 4 * a * d)), tracked = 2 * d / (slow + std::sqrt(slow * slow + 2 * d / A));
    return std::min(std::min(jerky, tracked), velocity[j]);
}

double MotionLimits::catch_up_acceleration(int j, double position, double v, double there, double speed) const
{
    const double way = there - position, fastest = CATCH_UP_SPEED * velocity[j];
    const double w = std::copysign(approach_speed(j, way, TRACKING_SHARE / dt), way);
    return acceleration_towards(j, v, std::clamp(speed + w, -fastest, fastest));
}

double MotionLimits::admissible_acceleration(int j, double q, double v, double a, double wanted) const
{
    const double A = acceleration[j], step = jerk[j] * dt;
    const double low = std::min(std::max(-A, a - step), A), high = std::max(std::min(A, a + step), -A);
    const double chosen = std::min(std::max(wanted, low), high);
    const double up = largest_acceleration(*this, j, std::max(upper[j] - q, 0.0), v, low, chosen);
    const double down = -largest_acceleration(*this, j, std::max(q - lower[j], 0.0), -v, -high, -chosen);
    return up < chosen ? up : down > chosen ? down : chosen;
}

double MotionLimits::admissible_velocity(int j, double q, double v, double before, double wanted) const
{
    const double a = (wanted - v) / dt, allowed = admissible_acceleration(j, q, v, before, a);
    return std::abs(allowed - a) > SAME * jerk[j] * dt ? v + dt * allowed : wanted;
}

std::array<double, 4> Clock::at(double time) const
{
    const double D = std::max(duration, TINY), d = final - rate;
    const double b = (3 * d / D - 2 * slope) / D, c = (slope - 2 * d / D) / D / D;
    const double u = std::clamp(time - start, 0.0, duration), place = first + rate * std::min(time - start, 0.0)
                     + u * (rate + u * (0.5 * slope + u * (b / 3 + u * 0.25 * c))) + final * std::max(time - start - duration, 0.0);
    if (time - start >= duration)
        return {place, final, 0, 0};
    return {place, rate + u * (slope + u * (b + u * c)), slope + u * (2 * b + 3 * u * c), 2 * b + 6 * u * c};
}

void Motion::at(double time, Mat r) const
{
    const auto after = std::upper_bound(knots.begin() + 1, knots.end() - 1, time);
    const std::size_t piece = static_cast<std::size_t>(after - knots.begin()) - 1;
    r.all().fill(0);
    const Mat c(const_cast<double*>(coefficients.data()) + piece * powers * columns, powers, columns, r.w);
    add_polynomial(c, std::clamp(time, knots.front(), knots.back()) - knots[piece], r);
    if (!(time >= knots.front() && time < knots.back()))
        r.rows_from(1, r.rows).all().fill(0);
}

void Motion::at(double time, const Clock& clock, Mat r) const
{
    const auto [place, rate, slope, bend] = clock.at(time);
    at(place, r);
    for (int j = 0; r.rows == 4 && j < r.cols; j++) {
        const double v = r(1, j), a = r(2, j), jerk = r(3, j);
        r(1, j) = rate * v;
        r(2, j) = rate * rate * a + slope * v;
        r(3, j) = rate * rate * rate * jerk + 3 * rate * slope * a + bend * v;
    }
}

void add_polynomial(Mat powers, double u, Mat r)
{
    for (int j = 0; j < powers.cols; j++) {
        double x = 0, v = 0, a = 0, jerk = 0;
        for (int k = powers.rows - 1; k >= 0; k--) {
            jerk = jerk * u + 3 * a;
            a = a * u + 2 * v;
            v = v * u + x;
            x = x * u + powers(k, j);
        }
        const double found[] = {x, v, a, jerk};
        for (int i = 0; i < r.rows; i++)
            r(i, j) += found[i];
    }
}

Mat quintic(Mat jump, double D)
{
    Mat c(*jump.w, 6, jump.cols);
    for (int j = 0; j < jump.cols; j++) {
        const double x = jump(0, j), v = jump(1, j), a = jump(2, j);
        c(0, j) = x, c(1, j) = v, c(2, j) = 0.5 * a;
        c(3, j) = -(20 * x + 12 * v * D + 3 * a * D * D) / (2 * D * D * D);
        c(4, j) = (30 * x + 16 * v * D + 3 * a * D * D) / (2 * D * D * D * D);
        c(5, j) = -(12 * x + 6 * v * D + a * D * D) / (2 * D * D * D * D * D);
    }
    return c;
}

Mat splice(const Motion& motion, const Clock& clock, const MotionLimits& limits, double time, Mat state, double duration)
{
    Workspace& w = *state.w;
    const Mat r(w, 4, motion.columns), jump(w, 3, state.cols);
    motion.at(time, clock, r);
    for (int k = 0; k < 3; k++)
        jump[k].set(state[k] - r[k].part(0, state.cols));
    const Mat residual = quintic(jump, duration);
    for (int i = 0; i < PLACES; i++) {
        const double u = i * (duration / (PLACES - 1));
        motion.at(time + u, clock, r);
        add_polynomial(residual, u, r);
        if (!(limits.utilisation(r) <= SHARE))
            return {};
    }
    return residual;
}

Motion smoothed_motion(const MotionLimits& limits, Mat state, double now, Vec times, Mat points, double smoothing_time, int n)
{
    Workspace& w = *state.w;
    const int m = state.cols;
    const double h = times[times.n - 1] / n;
    Motion found;
    found.columns = m, found.powers = 4;
    found.coefficients.resize(static_cast<std::size_t>(n) * 4 * m);
    for (int i = 0; i <= n; i++)
        found.knots.push_back(now + i * h);
    double late_until = 0;
    for (int j = 0; j < m; j++) {
        const Workspace::Frame frame(w);
        JointPlan plan(limits, j, times, points, smoothing_time, n, w);
        late_until = std::max(late_until, plan.solve(state(0, j), state(1, j), state(2, j)));
        for (int i = 0; i < n; i++) {
            const double* c = plan.c.p + i;
            double* to = &found.coefficients[static_cast<std::size_t>(i) * 4 * m + j];
            to[0] = (c[0] + 4 * c[1] + c[2]) / 6, to[m] = (c[2] - c[0]) / (2 * h);
            to[2 * m] = (c[0] - 2 * c[1] + c[2]) / (2 * h * h), to[3 * m] = (c[3] - 3 * c[2] + 3 * c[1] - c[0]) / (6 * h * h * h);
        }
    }
    found.late_until = now + late_until;
    return found;
}

Clock rate_change(const Motion& motion, const Clock& clock, const MotionLimits& limits, double time, double final, Workspace& w)
{
    const auto [place, rate, slope, bend] = clock.at(time);
    Clock best;
    double soonest = INFINITY;
    bool found = false;
    for (const double wait : WAITS) {  // joints that brake at their limit already cannot stop sooner
        if (wait >= soonest || (wait > 0 && slope != 0))
            break;
        Clock next{time + wait, place + rate * wait, rate, slope, final, 0};
        const auto [duration, worst] = change_of_rate(motion, next, limits, w);
        next.duration = duration;
        const bool fits = worst <= TURN_SHARE;
        if (!found || (fits && wait + duration < soonest)) {
            best = next, found = true;
            soonest = fits ? wait + duration : INFINITY;
        }
    }
    return best;
}

}  // namespace iq
