// The memory of a loop between ticks, and whether the joints follow their commands.
//
// A command shows in the measured positions one tick and the loop's delay later. `respond` asks whether a joint moves at
// all when it is commanded to: not where the robot is stopped, paused or blocked. `compare` asks how far the joints move
// between two changes of their measured positions, beside what they were commanded:
//
//     ratio = sum of commanded . moved / sum of |commanded|^2        over the last changes, fading
//
// It is 1 where ticks last dt, and 33 where they last 33 dt. Positions that change every 33 ticks only are old by as
// much: feedback overshoots where its gain times that interval is above one. The ratio is near zero where the loop
// oscillates because of a delay, or the robot does not execute its commands.
#pragma once
#include "report.hpp"
#include "tolerances.hpp"

namespace iq {

// The time over which displacements are compared, and after which a joint without a response is unresponsive [s].
constexpr double RESPONSE_MEMORY = 0.05, RESPONSE_TIME = 0.125;
constexpr double RESPONSE_SHARE = 0.19;  // of the commanded displacement, which is a response
// A smaller commanded displacement, in seconds of full speed, may be lost in friction or the play of gears, and one
// smaller than the second is rest; a joint's speed counts up to half a turn, or three lengths, in a second.
constexpr double LEAST_COMMANDED = 0.005, COMMANDED_REST = 1e-6, FULL_SPEED = 3.1;
// A displacement is more than noise where its square is so many times the mean square of those of a tick; commands explain
// displacements where they leave less than the second share of that mean square.
constexpr double NOISE = 30, EXPLAINED = 0.5;
// Displacements are compared over so many changes of the measured positions, which rest where they keep for this time [s].
constexpr double FEWEST_UPDATES = 50, LONGEST_INTERVAL = 0.5;
// Motion is in proportion to the commands where these explain so much of its square; where drives lag by 50 ms and an arm
// oscillates, the second share is left, in displacements too large for noise [rad].
constexpr double PROPORTIONAL = 0.95, OSCILLATES = 0.15, LARGE_OSCILLATION = 0.03;
// A displacement that is more than noise and the counts of encoders of 12 bits [rad, length]; smaller ones count after so
// many of single joints, a ratio above one if they are so many times the smallest, which may be a count.
constexpr double LEAST_MOVED = 8e-3, MANY_MOVED = 12, MOST_COUNTS = 4;
constexpr double MOST_RATIO = 2, LEAST_RATIO = 0.5, OVERSHOOT = 1.2;  // reported; the last is gain times interval
// Joints do not follow below this ratio where commands are on average above this speed [rad/s, length/s]; nor where so
// little of the ratio is left without what comes from going to and fro, at this mean distance from the middle.
constexpr double KEPT_SHARE = 0.2, LEAST_SPEED = 0.015, LEAST_OSCILLATION = 0.02;

// A value: numbers in one row, which copy, compare and pickle as they are.
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

    double* turn() { return numbers.data(); }                                        // (3,) of the error, the tick before
    double* positions() { return turn() + 3; }                                       // (m,) measured
    double* command(int ticks_ago) { return positions() + joints * (1 + ticks_ago); }  // (m,)
    // (m,) of each joint; displacements are in seconds of its full speed
    double* silence() { return command(whole + 2); }          // time without a response [s]
    double* unanswered() { return silence() + joints; }       // commanded in that time
    double* unresponsive() { return unanswered() + joints; }  // 1 by itself, 0.5 beside another, else 0
    double* moved_square() { return unresponsive() + joints; }  // mean square of the displacement in a tick
    double* unexplained() { return moved_square() + joints; }   // of what commands leave of it
    double* commanded() { return unexplained() + joints; }      // sum, fading
    double* moved() { return commanded() + joints; }
    double* pending() { return moved() + joints; }  // commanded since positions changed; NaN where not answered
    double& last_residual() { return *(pending() + joints); }  // r_before of the law

    bool any_unresponsive()
    {
        return std::any_of(unresponsive(), unresponsive() + joints, [](double x) { return x > 0; });
    }
    // Where the joints are when the command of this tick acts, and how fast before it, at measured q.
    void predict(Vec q, double dt, Vec there, Vec before)
    {
        for (int j = 0; j < joints; j++) {
            const bool rests = unresponsive()[j] > 0;
            double sum = part * command(whole)[j];
            for (int i = 0; i < whole; i++)
                sum += command(i)[j];
            there[j] = rests ? q[j] : q[j] + dt * sum;
            before[j] = rests ? 0 : command(0)[j];
        }
    }
    // A tick begins at measured q; turns (m,): whole turns of continuous joints, whose positions are compared modulo these.
    void observe(Vec q, double dt, const std::vector<double>& turns, const std::vector<double>& speeds)
    {
        Workspace& w = *q.w;
        Vec ordered(w, joints), came(w, joints);
        for (int j = 0; j < joints; j++) {
            const double step = q[j] - positions()[j];
            came[j] = turns[j] > 0 ? std::remainder(step, turns[j]) : step;
            ordered[j] = dt * ((1 - part) * command(whole)[j] + part * command(whole + 1)[j]);
        }
        if (std::isnan(came.square())) {
            std::fill(silence(), &last_residual(), 0.0);
            restart();
            return;
        }
        respond(ordered, came, dt, speeds);
        compare(ordered, came, dt);
    }
    // A tick at measured q, NaN where that is not known, gave a command.
    void remember(Vec q, Vec x, double left)
    {
        std::copy(q.begin(), q.end(), positions());
        std::copy_backward(command(0), command(whole + 1), command(whole + 2));
        std::copy(x.begin(), x.end(), command(0));
        last_residual() = left;
    }

    // What is wrong with the joints, as a code with joints and numbers; Code::none where nothing is known to be.
    struct Trouble {
        Code code = Code::none;
        std::vector<int> joints;
        std::vector<double> numbers;
    };
    // gain: of targets; fastest: the larger of it and that of position limits [1/s]; follows: whether there is a target,
    // without which joints are not said to fail to follow.
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
    static constexpr int ROWS = 8;  // of the joints
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

    // A joint responds if it has moved by a fifth of what was commanded, in either direction. It is unresponsive after an
    // eighth of a second without, if more was commanded than friction and play may hide; so are joints beside it that do
    // not respond. It responds again when it has moved by a fifth and by more than noise, when commands explain what it
    // moved better than rest does, or when it is commanded to rest. When one responds, all are judged again.
    void respond(Vec ordered, Vec came, double dt, const std::vector<double>& speeds)
    {
        const double left = std::max(1 - dt / RESPONSE_MEMORY, 0.0);
        std::vector<char> before(joints), alone(joints), beside(joints), stays(joints);
        bool some = false, resumes = false;
        const auto fade = [left](double& mean, double x) { mean = left * mean + (1 - left) * x * x; };
        for (int j = 0; j < joints; j++) {
            const double unit = speeds[j] > 0 ? std::min(speeds[j], FULL_SPEED) : FULL_SPEED;
            const double step = came[j] / unit, order = ordered[j] / unit;
            before[j] = unresponsive()[j] > 0;
            fade(moved_square()[j], step), fade(unexplained()[j], step - order);
            const double asked = commanded()[j] = left * commanded()[j] + order;
            const double done = moved()[j] = (before[j] ? 1 : left) * moved()[j] + step;
            const bool enough = std::abs(done) >= RESPONSE_SHARE * std::abs(asked), responds = enough && !before[j];
            silence()[j] = responds ? 0 : silence()[j] + dt;
            unanswered()[j] = responds ? 0 : unanswered()[j] + order;
            const bool noise = !enough || done * done <= NOISE * std::min(moved_square()[j], unexplained()[j]);
            const bool scatters = noise && unexplained()[j] >= EXPLAINED * moved_square()[j];
            stays[j] = scatters && std::max(std::abs(asked), std::abs(order) * (RESPONSE_MEMORY / dt)) > COMMANDED_REST;
            resumes = resumes || (unresponsive()[j] == 1 && !scatters);
            alone[j] = silence()[j] > RESPONSE_TIME && std::abs(unanswered()[j]) > LEAST_COMMANDED;
            beside[j] = silence()[j] > 0;
        }
        for (int j = 0; j < joints; j++) {
            if (before[j]) {
                beside[j] = stays[j] && !resumes;
                alone[j] = beside[j] && (alone[j] || unresponsive()[j] == 1);
            }
            some = some || alone[j];
        }
        for (int j = 0; j < joints; j++) {
            const double now = unresponsive()[j] = alone[j] ? 1 : beside[j] && some ? 0.5 : 0;
            if (before[j] && now == 0)
                silence()[j] = unanswered()[j] = 0;
            if (now > 0 && !before[j])
                moved()[j] = 0;  // since then
        }
    }

    void compare(Vec ordered, Vec came, double dt)
    {
        const bool known = !any_unresponsive() && !std::isnan(pending()[0]);
        Vec due(*came.w, joints, 0);
        double finest = INFINITY;
        for (int j = 0; j < joints; j++) {
            pending()[j] = known ? pending()[j] + ordered[j] : NAN;
            due[j] = known ? pending()[j] : 0;
            finest = came[j] != 0 ? std::min(finest, std::abs(came[j])) : finest;
        }
        const double moved2 = came.square(), due2 = due.square(), interval = sum(WAITING) + 1;
        const bool rests = std::max(moved2, ordered.square()) <= COMMANDED_REST * COMMANDED_REST;
        if (rests || interval * dt > LONGEST_INTERVAL)
            return restart();
        if (moved2 == 0) {
            sum(WAITING)++;
            return;
        }
        double kept = std::max(1 - interval * dt / RESPONSE_TIME, 1 - 1 / FEWEST_UPDATES);
        const double expected = sum(COMMANDED) > 0 ? sum(PRODUCT) / sum(COMMANDED) : 0;
        if (moved2 > 4 * std::max(sum(LARGEST), expected * expected * due2))  // twice as far as lately: another motion
            kept = sum(INTERVAL) = sum(TIME) = 0;
        const double largest = std::max(std::max(moved2, due2), kept * sum(LARGEST));
        std::fill(pending(), &last_residual(), 0.0);
        sum(COMMANDED) = kept * sum(COMMANDED) + due2;
        sum(PRODUCT) = kept * sum(PRODUCT) + due.dot(came);
        sum(MOVED) = kept * sum(MOVED) + moved2;
        sum(UPDATES) = kept * sum(UPDATES) + 1;
        sum(TIME) = sum(TIME) * std::min(sum(LARGEST) / largest, 1.0) + interval * dt;
        sum(LARGEST) = largest, sum(WAITING) = 0;
        sum(INTERVAL_BEFORE) = sum(INTERVAL), sum(INTERVAL) = interval;
        sum(FINEST) = std::min(sum(FINEST), finest);
    }
};

}  // namespace iq
