// The memory of a loop between ticks, and whether the joints follow their commands.
//
// A command acts on the measured positions one tick and the delay later. `check_response` detects joints that do not move
// although commanded: the robot is stopped, paused or blocked. `compare` relates displacements between two changes of the
// measured positions to the commanded ones:
//
//     ratio = sum of commanded . moved / sum of |commanded|^2        exponentially weighted
//
// It is 1 where ticks last dt, and 33 where they last 33 dt. Positions that change only every 33 ticks are stale: feedback
// overshoots where gain times that interval is above one. The ratio is near zero where the loop oscillates because of a
// delay, or the robot does not execute its commands.
#pragma once
#include "report.hpp"
#include "tolerances.hpp"

namespace iq {

// Time constant of the comparison, and time after which a joint without a response is unresponsive [s].
constexpr double RESPONSE_MEMORY = 0.05, RESPONSE_TIME = 0.125;
constexpr double RESPONSE_SHARE = 0.19;  // of the commanded displacement counts as a response
// Commanded displacements, in seconds of full speed, that friction or backlash may absorb, and that count as rest; cap of
// the full speed [rad/s, length/s].
constexpr double LEAST_COMMANDED = 0.005, COMMANDED_REST = ACTIVE_TOLERANCE, FULL_SPEED = 3.1;
// A displacement is no noise if its square is NOISE times the mean square in a tick; commands explain displacements if
// they leave less than EXPLAINED of that mean square.
constexpr double NOISE = 30, EXPLAINED = 0.5;
// Number of changes of the measured positions in the comparison; positions that keep longer are at rest [s].
constexpr double FEWEST_UPDATES = 50, LONGEST_INTERVAL = 0.5;
// Motion is proportional to the commands if these explain this share of its square; OSCILLATES for drives with a lag of
// 50 ms, if the displacements are larger than LARGE_OSCILLATION [rad].
constexpr double PROPORTIONAL = 0.95, OSCILLATES = 0.15, LARGE_OSCILLATION = 0.03;
// Displacement above noise and the resolution of 12-bit encoders [rad, length]; smaller ones count after MANY_MOVED of
// single joints and, for a ratio above one, if they are MOST_COUNTS times the smallest, which may be one count.
constexpr double LEAST_MOVED = 8e-3, MANY_MOVED = 12, MOST_COUNTS = 4;
constexpr double MOST_RATIO = 2, LEAST_RATIO = 0.5, OVERSHOOT = 1.2;  // reported; the last is gain times interval
// Joints do not follow below this ratio for commands above LEAST_SPEED [rad/s, length/s], or if oscillation about a point
// at LEAST_OSCILLATION explains the rest of the ratio.
constexpr double KEPT_SHARE = 0.2, LEAST_SPEED = 0.015, LEAST_OSCILLATION = 0.02;

// A value: one row of numbers to copy, compare and pickle.
class LoopState {
  public:
    int joints, whole;  // whole ticks of the delay
    double part;        // and the share of one more
    std::vector<double> numbers;

    LoopState(int joints, double delay, double dt)
        : joints(joints), whole(static_cast<int>(delay / dt + ROUNDING)), part(std::max(0.0, delay / dt - whole)),
          numbers(size(), 0)
    {
        std::fill(turn(), positions() + joints, NAN);
        numbers[numbers.size() - 1 - FINEST] = INFINITY;
    }
    std::size_t size() const { return 3 + static_cast<std::size_t>(joints) * (1 + whole + 2 + ROWS) + NUMBERS; }

    double* turn() { return numbers.data(); }                                        // (3,) rotation of the last error
    double* positions() { return turn() + 3; }                                       // (m,) measured
    double* command(int ticks_ago) { return positions() + joints * (1 + ticks_ago); }  // (m,)
    // (m,) each; displacements are in seconds of full speed
    double* time_without_response() { return row(TIME_WITHOUT_RESPONSE); }  // [s]
    double* commanded_without_response() { return row(COMMANDED_WITHOUT_RESPONSE); }
    double* unresponsive() { return row(UNRESPONSIVE); }  // 1; 0.5 as a consequence of another joint; else 0
    double* moved_square() { return row(MOVED_SQUARE); }  // mean square of the displacement in a tick
    double* unexplained() { return row(UNEXPLAINED); }    // mean square of what the commands leave of it
    double* commanded() { return row(COMMANDED_SUM); }    // exponentially weighted sums
    double* moved() { return row(MOVED_SUM); }
    double* pending() { return row(PENDING); }      // commanded since positions changed; NaN while a joint is unresponsive
    double& last_residual() { return *row(ROWS); }  // r_before of the law

    bool any_unresponsive()
    {
        return std::any_of(unresponsive(), unresponsive() + joints, [](double x) { return x > 0; });
    }
    // Joint positions when the command of this tick acts, and the velocity before it, at measured q.
    void predict(Vec q, double dt, Vec predicted, Vec velocity)
    {
        for (int j = 0; j < joints; j++) {
            const bool rests = unresponsive()[j] > 0;
            double sum = part * command(whole)[j];
            for (int i = 0; i < whole; i++)
                sum += command(i)[j];
            predicted[j] = rests ? q[j] : q[j] + dt * sum;
            velocity[j] = rests ? 0 : command(0)[j];
        }
    }
    // To be called once a tick with measured q; revolution (m,): a whole turn of continuous joints, else 0.
    void observe(Vec q, double dt, const std::vector<double>& revolution, const std::vector<double>& speeds)
    {
        Workspace& w = *q.w;
        Vec commanded_now(w, joints), moved_now(w, joints);
        for (int j = 0; j < joints; j++) {
            const double step = q[j] - positions()[j];
            moved_now[j] = revolution[j] > 0 ? std::remainder(step, revolution[j]) : step;
            commanded_now[j] = dt * ((1 - part) * command(whole)[j] + part * command(whole + 1)[j]);
        }
        if (std::isnan(moved_now.square())) {
            std::fill(time_without_response(), &last_residual(), 0.0);
            restart();
            return;
        }
        check_response(commanded_now, moved_now, dt, speeds);
        compare(commanded_now, moved_now, dt);
    }
    // Stores measured q, NaN if unknown, the command x and the residual of a tick.
    void remember(Vec q, Vec x, double residual)
    {
        std::copy(q.begin(), q.end(), positions());
        std::copy_backward(command(0), command(whole + 1), command(whole + 2));
        std::copy(x.begin(), x.end(), command(0));
        last_residual() = residual;
    }

    // A detected fault of the joints or of dt; Code::none for none.
    struct Trouble {
        Code code = Code::none;
        std::vector<int> joints;
        std::vector<double> numbers;
    };
    // gain: of targets; fastest: the larger of it and the rate of position limits [1/s]; follows_target: only then
    // not_following is reported.
    Trouble trouble(double dt, double gain, double fastest, bool follows_target)
    {
        Trouble found;
        for (int j = 0; j < joints; j++)
            if (unresponsive()[j] > 0)
                found.code = Code::no_motion, found.joints.push_back(j);
        if (found.code != Code::none)
            return found;
        const double commanded2 = sum(COMMANDED), moved2 = sum(MOVED), product = sum(PRODUCT), updates = sum(UPDATES);
        const double ratio = commanded2 > 0 ? product / commanded2 : 0, time = sum(TIME);
        const double ticks = std::min(sum(INTERVAL), sum(INTERVAL_BEFORE));
        const double milliseconds = 1e3 * dt;
        const auto mean = [&](double size) { return size * size * updates; };
        const bool large = std::max(commanded2, moved2) >= mean(LEAST_MOVED);
        const bool fine = ratio < 1 || moved2 >= mean(MOST_COUNTS * sum(FINEST));
        const bool lagging = ratio > MOST_RATIO && moved2 >= mean(LARGE_OSCILLATION);
        const bool proportional = ratio > 0 && product * product >= (lagging ? OSCILLATES : PROPORTIONAL) * commanded2 * moved2;
        const bool measured = ticks > 0 && (large || (fine && joints * updates >= MANY_MOVED)) && proportional;
        if (ticks > 1 && ticks * fastest * dt > OVERSHOOT && (large || measured))
            return {Code::stale_joint_states, {}, {ticks, ticks * milliseconds, milliseconds}};
        const bool too_far = ratio > MOST_RATIO || ratio * ticks * fastest * dt > OVERSHOOT;
        if (measured && (too_far || (ratio < LEAST_RATIO && time > RESPONSE_TIME)))
            return {Code::wrong_dt, {}, {ratio, ratio * milliseconds, milliseconds}};
        const bool follows = ratio >= KEPT_SHARE || commanded2 <= mean(LEAST_SPEED * dt);
        const double progress = product - 0.5 * gain * dt * moved2;
        const bool oscillates = commanded2 >= mean(LEAST_OSCILLATION * gain * dt) && progress < KEPT_SHARE * commanded2;
        if (!(follows_target && (oscillates || !follows) && time > RESPONSE_TIME))
            return found;
        int farthest = 0;
        const auto off = [&](int j) { return std::abs(commanded()[j] - moved()[j]); };
        for (int j = 1; j < joints; j++)
            farthest = off(j) > off(farthest) ? j : farthest;
        return {Code::not_following, {farthest}, {}};
    }

  private:
    enum Row { TIME_WITHOUT_RESPONSE, COMMANDED_WITHOUT_RESPONSE, UNRESPONSIVE, MOVED_SQUARE, UNEXPLAINED, COMMANDED_SUM,
               MOVED_SUM, PENDING, ROWS };
    double* row(int i) { return command(whole + 2 + i); }
    // The last numbers, counted from the end: of the ratio sums that fade; the time since the largest displacement became
    // as large, of which growth leaves a third [s]; its square; ticks since positions changed, between the last two
    // changes and the two before; the smallest displacement of a joint.
    enum { COMMANDED, PRODUCT, MOVED, UPDATES, TIME, LARGEST, WAITING, INTERVAL, INTERVAL_BEFORE, FINEST, NUMBERS_OF_RATIO };
    static constexpr int NUMBERS = NUMBERS_OF_RATIO + 1;

    double& sum(int which) { return numbers[numbers.size() - 1 - which]; }
    void restart()
    {
        std::fill(pending(), &last_residual(), 0.0);
        std::fill(&last_residual() + 1, numbers.data() + numbers.size(), 0.0);
        sum(FINEST) = INFINITY;
    }

    // A joint responds if it moves by RESPONSE_SHARE of the commanded displacement, in either direction. It is unresponsive
    // after RESPONSE_TIME without a response, if more than LEAST_COMMANDED was commanded; so are the other joints that do
    // not respond then. It responds again if it moves by RESPONSE_SHARE and more than noise, if commands explain its motion
    // better than rest does, or if it is commanded to rest; all joints are then judged again.
    void check_response(Vec commanded_now, Vec moved_now, double dt, const std::vector<double>& speeds)
    {
        const double left = std::max(1 - dt / RESPONSE_MEMORY, 0.0);
        std::vector<char> before(joints), alone(joints), along(joints), stays(joints);
        bool some = false, resumes = false;
        const auto fade = [left](double& mean, double x) { mean = left * mean + (1 - left) * x * x; };
        for (int j = 0; j < joints; j++) {
            const double unit = speeds[j] > 0 ? std::min(speeds[j], FULL_SPEED) : FULL_SPEED;
            const double step = moved_now[j] / unit, order = commanded_now[j] / unit;
            before[j] = unresponsive()[j] > 0;
            fade(moved_square()[j], step), fade(unexplained()[j], step - order);
            const double expected = commanded()[j] = left * commanded()[j] + order;
            const double done = moved()[j] = (before[j] ? 1 : left) * moved()[j] + step;
            const bool enough = std::abs(done) >= RESPONSE_SHARE * std::abs(expected), responds = enough && !before[j];
            time_without_response()[j] = responds ? 0 : time_without_response()[j] + dt;
            commanded_without_response()[j] = responds ? 0 : commanded_without_response()[j] + order;
            const bool noise = !enough || done * done <= NOISE * std::min(moved_square()[j], unexplained()[j]);
            const bool scatters = noise && unexplained()[j] >= EXPLAINED * moved_square()[j];
            stays[j] = scatters && std::max(std::abs(expected), std::abs(order) * (RESPONSE_MEMORY / dt)) > COMMANDED_REST;
            resumes = resumes || (unresponsive()[j] == 1 && !scatters);
            alone[j] = time_without_response()[j] > RESPONSE_TIME && std::abs(commanded_without_response()[j]) > LEAST_COMMANDED;
            along[j] = time_without_response()[j] > 0;
        }
        for (int j = 0; j < joints; j++) {
            if (before[j]) {
                along[j] = stays[j] && !resumes;
                alone[j] = along[j] && (alone[j] || unresponsive()[j] == 1);
            }
            some = some || alone[j];
        }
        for (int j = 0; j < joints; j++) {
            const double now = unresponsive()[j] = alone[j] ? 1 : along[j] && some ? 0.5 : 0;
            if (before[j] && now == 0)
                time_without_response()[j] = commanded_without_response()[j] = 0;
            if (now > 0 && !before[j])
                moved()[j] = 0;  // since then
        }
    }

    void compare(Vec commanded_now, Vec moved_now, double dt)
    {
        const bool known = !any_unresponsive() && !std::isnan(pending()[0]);
        Vec due(*moved_now.w, joints, 0);
        double finest = INFINITY;
        for (int j = 0; j < joints; j++) {
            pending()[j] = known ? pending()[j] + commanded_now[j] : NAN;
            due[j] = known ? pending()[j] : 0;
            finest = moved_now[j] != 0 ? std::min(finest, std::abs(moved_now[j])) : finest;
        }
        const double moved2 = moved_now.square(), due2 = due.square(), interval = sum(WAITING) + 1;
        const bool rests = std::max(moved2, commanded_now.square()) <= COMMANDED_REST * COMMANDED_REST;
        if (rests || interval * dt > LONGEST_INTERVAL)
            return restart();
        if (moved2 == 0) {
            sum(WAITING)++;
            return;
        }
        double weight = std::max(1 - interval * dt / RESPONSE_TIME, 1 - 1 / FEWEST_UPDATES);
        const double expected = sum(COMMANDED) > 0 ? sum(PRODUCT) / sum(COMMANDED) : 0;
        if (moved2 > 4 * std::max(sum(LARGEST), expected * expected * due2))  // twice the recent displacement: another motion
            weight = sum(INTERVAL) = sum(TIME) = 0;
        const double largest = std::max(std::max(moved2, due2), weight * sum(LARGEST));
        std::fill(pending(), &last_residual(), 0.0);
        sum(COMMANDED) = weight * sum(COMMANDED) + due2;
        sum(PRODUCT) = weight * sum(PRODUCT) + due.dot(moved_now);
        sum(MOVED) = weight * sum(MOVED) + moved2;
        sum(UPDATES) = weight * sum(UPDATES) + 1;
        sum(TIME) = sum(TIME) * std::min(sum(LARGEST) / largest, 1.0) + interval * dt;
        sum(LARGEST) = largest, sum(WAITING) = 0;
        sum(INTERVAL_BEFORE) = sum(INTERVAL), sum(INTERVAL) = interval;
        sum(FINEST) = std::min(sum(FINEST), finest);
    }
};

}  // namespace iq
