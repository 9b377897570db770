// State of a clearance between ticks: obstacles, pairs and the distances that they keep; see control/clearance.py.
#include "clearance_rows.hpp"
#include <stdexcept>

namespace iq {

namespace {

// Shares of the joints' velocity limits at which a pair that is too near is led apart, and at which joints are limited
// meanwhile: an arm in an obstacle comes out within three seconds, without a jerk.
constexpr double ESCAPE_SPEED = 0.06, ESCAPE_LIMIT = 0.09;
constexpr double ACTIVE = 1e-6;         // tolerance of a distance, as in velocity/solution.py
constexpr double SINGULAR_STEP = 1e-7;  // at full speed, to a state beside a singular one [s]
constexpr int MOST_CELLS = 2000;  // of joint positions, to prove that a pair is always near

Twist twist_of(const std::vector<double>& s) { return {{s[0], s[1], s[2]}, {s[3], s[4], s[5]}}; }

// The speed of a joint after a tick in which all joints brake together, at a share of their braking.
double speed_after_braking(const ClearanceRate& rate, Vec before, int joint, double share)
{
    double sum = 0;
    for (int j = 0; j < before.n; j++) {
        const double alone = before[j] / (BRAKING * rate.dt * rate.acceleration[j]), square = alone * alone;
        sum += std::isfinite(rate.acceleration[j]) ? square * square * (square * square) : 0;
    }
    const double ticks = std::max(1.0, std::pow(sum, 0.125));
    return std::isfinite(rate.acceleration[joint]) ? std::abs(before[joint]) * (1 - share / ticks) : 0;
}

// The joints of all arms, those of the arm itself with the limits of a loop.
BrakingJoints joints_of(const ClearanceScene& scene, const std::vector<int>& arm_of, const ClearanceRate& rate, int m,
                        Workspace& w)
{
    const int all = static_cast<int>(arm_of.size());
    BrakingJoints joints{arm_of, Vec(w, all), Vec(w, all), Vec(w, all), Vec(w, all), m};
    const Vec of[] = {joints.speed, joints.acceleration, joints.lower, joints.upper};
    for (int a = 0, at = 0; a < static_cast<int>(scene.arms.size()); a++) {
        const ClearanceArm& arm = scene.arms[a];
        const std::vector<double>* numbers[] = {&rate.speed, &rate.acceleration, &rate.lower, &rate.upper};
        const std::vector<double>* others[] = {&arm.speed, &arm.acceleration, &arm.lower, &arm.upper};
        for (int i = 0; i < 4; i++) {
            const std::vector<double>& x = *(a == 0 ? numbers : others)[i];
            std::copy(x.begin(), x.end(), of[i].p + at);
        }
        at += arm.size();
    }
    return joints;
}

Workspace& workspace_of_thread()
{
    thread_local Workspace w;
    return w;
}

}  // namespace

Clearance::Clearance(ClearanceScene given) : scene(std::move(given)), m(scene.arms[0].size())
{
    for (int a = 0; a < static_cast<int>(scene.arms.size()); a++) {
        first_of.push_back(all), first_joint.push_back(static_cast<int>(coordinate.size()));
        for (const int c : scene.arms[a].coordinates)
            coordinate.push_back(all + c);
        all += scene.arms[a].size();
        arm_of.resize(all, a);
    }
    Workspace& w = workspace_of_thread();
    const Workspace::Frame frame(w);
    const std::vector<Twist> screws = Kinematics(scene.arms, coordinate, first_joint, Vec(w, all, 0)).J;
    const std::size_t n = scene.shapes.size(), k = scene.pairs.size();
    levers.assign(n * coordinate.size(), 0), place.resize(n), twists.assign(n, Twist{{0, 0, 0}, {0, 0, 0}});
    for (std::size_t i = 0; i < n; i++) {
        set_levers(static_cast<int>(i), screws);
        place[i] = scene.shapes[i].shape.at;
    }
    for (const ClearancePair& pair : scene.pairs) {
        Between alone;
        for (int e = 0; e < 2; e++) {
            const int body = scene.shapes[pair.of[e]].body;
            alone.to[e] = body, alone.from[e] = body > 0 ? first_joint[arm_of[coordinate[body - 1]]] : 0;
        }
        if (alone.from[0] == alone.from[1])  // joints that move both do not count
            alone.from[0] = alone.from[1] = std::min(alone.to[0], alone.to[1]);
        between.push_back(alone);
    }
    memo.kept.assign(k, scene.distance), memo.distances.assign(k, INFINITY);
    memo.always_near.assign(k, 0), memo.tested.assign(k, 0);
    memo.movers.resize(scene.obstacles + scene.arms.size() - 1), shift.resize(scene.obstacles);
    for (std::size_t i = 0; i < memo.movers.size(); i++) {
        Mover& mover = memo.movers[i];
        const int arm = static_cast<int>(i) - scene.obstacles + 1;
        mover.declared.assign(arm > 0 ? scene.arms[arm].size() : 6, 0);
        mover.position.assign(arm > 0 ? mover.declared.size() : POSE_NUMBERS, 0);
        if (arm <= 0)
            Pose().write(mover.position.data());
        mover.last = mover.position, mover.estimated = mover.declared;
    }
}

void Clearance::start()
{
    for (Mover& mover : memo.movers)
        mover.last = mover.position, mover.estimated = mover.declared, mover.has_moved = false;
    predict_obstacles(0);
    drop_always_near(std::vector<double>(pairs(), -INFINITY));
}

// The length of a broken line from the middle of a shape to its foot on each axis before it: rotations do not change
// its parts, and slides change them by the joint's displacement.
void Clearance::set_levers(int i, const std::vector<Twist>& screws)
{
    const int body = scene.shapes[i].body;
    if (body == 0)
        return;
    const int first = first_joint[arm_of[coordinate[body - 1]]];
    const ClearanceArm& arm = scene.arms[arm_of[coordinate[body - 1]]];
    const Shape& shape = scene.shapes[i].shape;
    Vec3 x = shape.at.p;
    double reach = shape.core == ShapeCore::half_space ? INFINITY : shape.ball;
    for (int j = body - 1; j >= first; j--) {
        const double rate = norm(screws[j].omega);
        Vec3 slide = screws[j].v;
        if (rate > 0) {
            const Vec3 axis = (1 / rate) * screws[j].omega,
                       on_axis = (1 / (rate * rate)) * cross(screws[j].omega, slide);
            const Vec3 foot = on_axis + dot(axis, x - on_axis) * axis;
            reach += norm(x - foot);
            x = foot, slide = dot(axis, slide) * axis;
        }
        const double along = norm(slide), lever = rate > 0 ? rate * reach + along : along;
        levers[static_cast<std::size_t>(i) * coordinate.size() + j] = std::min(lever, LARGEST);
        if (along > CANCELLATION * lever) {
            const int c = arm.coordinates[j - first];
            const double low = arm.lower[c], high = arm.upper[c];
            reach += along * (high - low + std::max(std::abs(low), std::abs(high)));
        }
    }
}

// Upper bound of the approach of a pair for displacements (M,) of the coordinates.
double Clearance::approach_bound(int k, Vec turned) const
{
    double most = 0;
    for (int e = 0; e < 2; e++)
        for (int j = between[k].from[e]; j < between[k].to[e]; j++)
            most += lever(scene.pairs[k].of[e])[j] * turned[coordinate[j]];
    return most;
}

void Clearance::move(int obstacle, const Pose& pose, const double* twist)
{
    Mover& mover = memo.movers[obstacle];
    pose.write(mover.position.data());
    mover.has_velocity = twist != nullptr, mover.has_moved = true;
    if (twist)
        mover.declared.assign(twist, twist + 6);
    retest(obstacle);
}

void Clearance::move_arm(int arm, const double* q, const double* velocity)
{
    Mover& mover = memo.movers[scene.obstacles + arm];
    const std::size_t n = mover.declared.size();
    mover.position.assign(q, q + n);
    mover.has_velocity = velocity != nullptr, mover.has_moved = true;
    if (velocity)
        mover.declared.assign(velocity, velocity + n);
    retest(scene.obstacles + arm);
}

Twist Clearance::twist(int obstacle) const { return twist_of(memo.movers[obstacle].velocity()); }

// Pairs with a mover that was moved are checked again, until they are tested.
void Clearance::retest(int mover)
{
    for (int k = 0; k < pairs(); k++)
        if (scene.shapes[scene.pairs[k].of[1]].mover == mover)
            memo.always_near[k] = memo.tested[k] = false;
}

// The velocity from the last two positions, filtered at the rate alpha so that noise in positions acts no more by it
// than by the margin; held for twice the time between the positions.
void Clearance::Mover::estimate(double now, double alpha, const std::vector<double>& turns)
{
    const auto is_zero = [](double x) { return x == 0; };
    if (!has_moved && (has_velocity || std::all_of(estimated.begin(), estimated.end(), is_zero)))
        return;
    if (has_velocity)
        last = position, estimated = declared, time = now, interval = 0;
    else if (const double since = now - time; since == 0)
        last = position;
    else if (!has_moved) {
        if (!(since <= (2 + ROUNDING) * interval))
            std::fill(estimated.begin(), estimated.end(), 0);
    } else {
        std::vector<double> change(estimated.size());
        if (turns.empty()) {
            const Twist s = error_twist(Pose(position.data()), Pose(last.data()));
            std::copy(s.omega.begin(), s.omega.end(), change.begin());
            std::copy(s.v.begin(), s.v.end(), change.begin() + 3);
        } else
            for (std::size_t j = 0; j < change.size(); j++) {
                change[j] = position[j] - last[j];
                change[j] -= turns[j] > 0 ? turns[j] * std::nearbyint(change[j] / turns[j]) : 0;
            }
        for (std::size_t j = 0; j < change.size(); j++)
            estimated[j] += std::min(1.0, alpha * since) * (change[j] / since - estimated[j]);
        last = position, time = now, interval = since;
    }
    has_moved = false;
}

// Poses and twists of obstacles when a command acts, after the delay.
void Clearance::predict_obstacles(double delay)
{
    Workspace& w = workspace_of_thread();
    for (int i = 0; i < static_cast<int>(scene.shapes.size()); i++) {
        const int obstacle = scene.shapes[i].mover;
        if (obstacle < 0 || obstacle >= scene.obstacles)
            continue;
        const Workspace::Frame frame(w);
        const Mover& mover = memo.movers[obstacle];
        Pose at(mover.position.data());
        twists[i] = twist_of(mover.velocity());
        std::vector<double> by = mover.velocity();
        for (double& x : by)
            x *= delay;
        if (delay > 0 && moves(twists[i]))
            at = motion(twists[i], delay, w) * at;
        if (by != shift[obstacle]) {
            retest(obstacle);
            shift[obstacle] = by;
        }
        place[i] = at * scene.shapes[i].shape.at;
    }
}

// (M,) joints of the arm, then of others when a command acts, and the velocities of the others.
Vec Clearance::predict_joints(Vec own, double delay, Vec* velocity) const
{
    Vec q(*own.w, all);
    *velocity = Vec(*own.w, all, 0);
    q.part(0, m).set(own);
    for (int a = 1; a < static_cast<int>(scene.arms.size()); a++) {
        const Mover& mover = memo.movers[scene.obstacles + a - 1];
        for (int j = 0; j < scene.arms[a].size(); j++) {
            const double speed = mover.velocity()[j];
            (*velocity)[first_of[a] + j] = speed, q[first_of[a] + j] = mover.position[j] + delay * speed;
        }
    }
    return q;
}

// The share of a pair's margin that this arm may use: half with another arm that brakes too, or has no declared
// velocity.
double Clearance::margin_share(int k) const
{
    if (memo.always_near[k])
        return 0;
    const int mover = scene.shapes[scene.pairs[k].of[1]].mover, arm = mover - scene.obstacles + 1;
    return arm > 0 && (scene.arms[arm].brakes || !memo.movers[mover].has_velocity) ? 0.5 : 1;
}
std::vector<double> Clearance::margin_shares() const
{
    std::vector<double> found(pairs());
    for (int k = 0; k < pairs(); k++)
        found[k] = margin_share(k);
    return found;
}

double Clearance::threshold() const { return scene.distance - std::max(CURVATURE * scene.distance, ACTIVE); }

int Clearance::nearest() const
{
    const auto least = std::min_element(memo.distances.begin(), memo.distances.end());
    return least == memo.distances.end() ? -1 : static_cast<int>(least - memo.distances.begin());
}

// Pairs keep the distance, or a smaller one that they have, less a tolerance for noise.
void Clearance::update_kept(const std::vector<double>& distances, bool first)
{
    for (int k = 0; k < pairs(); k++) {
        const double own = distances[k] - DEEP * scene.distance;
        memo.kept[k] = distances[k] < threshold() ? (first ? own : std::max(own, memo.kept[k])) : scene.distance;
    }
}

double Clearance::begin(std::optional<double> last, Vec q, const ClearanceRate& rate)
{
    first_tick = !last;
    if (first_tick && !memo.first_q.empty()) {  // given in step(limits=): each tick is the first of a loop
        first_tick = false;
        for (int j = 0; j < m; j++) {
            const double most = 2 * rate.dt * finite_or(scene.arms[0].speed[j], DEFAULT_SPEED);
            first_tick = first_tick || !(std::abs(q[j] - memo.first_q[j]) <= most);
        }
    }
    const bool near = std::any_of(memo.kept.begin(), memo.kept.end(), [this](double d) { return d < scene.distance; });
    if (first_tick || near)
        update_kept(distances(q), first_tick);
    memo.first_q = last ? std::vector<double>() : std::vector<double>(q.begin(), q.end());
    if (last)
        memo.time = std::max(memo.time, *last + rate.dt);
    for (int i = 0; i < static_cast<int>(memo.movers.size()); i++) {
        const int arm = i - scene.obstacles + 1;
        memo.movers[i].estimate(memo.time, rate.alpha, arm > 0 ? scene.arms[arm].turns : std::vector<double>());
    }
    return memo.time;
}

ClearanceRows Clearance::rows(Vec q, Vec before, const ClearanceRate& rate)
{
    Workspace& w = *q.w;
    const BrakingJoints joints = joints_of(scene, arm_of, rate, m, w);
    for (;;) {
        predict_obstacles(rate.delay);
        Vec velocity;
        const Vec there = predict_joints(q, rate.delay, &velocity);
        velocity.part(0, m).set(before);
        const ClearanceSearch search(*this, joints, there, velocity, {rate.alpha, ESCAPE_SPEED, rate.dt, rate.joint_rate},
                                     margin_shares());
        if (drop_always_near(search.least))
            continue;
        memo.distances = search.least;
        ClearanceRows found{search.C.rows_from(0, search.count), search.lower.part(0, search.count),
                            Vec(w, search.count, INFINITY), std::vector<int>(search.pair, search.pair + search.count)};
        double deficit = 0;
        for (int k = 0; k < pairs(); k++)
            deficit = std::max(deficit, memo.kept[k] - memo.distances[k]);
        bool moved = velocity.part(m, all).square() > 0;
        for (const int k : found.pair)
            moved = moved || moves(twists[scene.pairs[k].of[0]]) || moves(twists[scene.pairs[k].of[1]]);
        if (deficit > scene.distance - threshold() && !moved)
            limit_speed(found, deficit, before, rate);
        return found;
    }
}

// Adds rows that limit joint speeds while a pair has a deficit of its distance, to what the joints can brake to.
void Clearance::limit_speed(ClearanceRows& rows, double deficit, Vec before, const ClearanceRate& rate) const
{
    Workspace& w = *before.w;
    const double deep = scene.distance > 0 ? std::min(1.0, deficit / (DEEP * scene.distance)) : 1;
    for (int j = 0; j < m; j++) {
        const double speed =
            std::max(std::max(ESCAPE_LIMIT, 1 - deep) * scene.arms[0].speed[j], speed_after_braking(rate, before, j, deep));
        if (!std::isfinite(speed))
            continue;
        Mat row(w, 1, m, 0);
        row(0, j) = 1;
        rows.C = stacked(rows.C, row), rows.pair.push_back(-1);
        rows.lower = joined(rows.lower, Vec(w, 1, -speed)), rows.upper = joined(rows.upper, Vec(w, 1, speed));
    }
}

ClearanceRows Clearance::after(Vec q, Vec x, const ClearanceRate& rate)
{
    Workspace& w = *q.w;
    ClearanceRows found{Mat(w, 0, m), Vec(w, 0), Vec(w, 0), {}};
    predict_obstacles(rate.delay);
    Vec turned(w, all, 0), velocity;
    const Vec there = predict_joints(q + rate.dt * x, rate.delay, &velocity);
    for (int j = 0; j < m; j++)
        turned[j] = rate.dt * std::abs(x[j]);
    std::vector<double> may(pairs()), others(pairs(), 0);
    for (int k = 0; k < pairs(); k++) {
        const double d = memo.distances[k], mine = margin_share(k);
        if (std::isfinite(d))  // another arm may use its share of the margin
            others[k] = (1 - mine) * std::max(d - scene.distance, 0.0);
        may[k] = mine > 0 && std::isfinite(d) && d - approach_bound(k, turned) < scene.distance + others[k];
    }
    if (std::none_of(may.begin(), may.end(), [](double share) { return share > 0; }))
        return found;
    const ClearanceSearch end(*this, joints_of(scene, arm_of, rate, m, w), there, velocity,
                              {1 / rate.dt, INFINITY, 0, INFINITY}, may);
    bool kept = true;
    for (int k = 0; k < pairs(); k++)
        kept = kept && (may[k] == 0 || end.least[k] - others[k] >= std::min(memo.distances[k], threshold()));
    if (kept)
        return found;
    found.C = Mat(w, end.count, m), found.lower = Vec(w, end.count);
    int count = 0;
    for (int i = 0; i < end.count; i++) {
        const int k = end.pair[i];
        const double keeps = std::min(memo.distances[k], memo.kept[k]) - memo.kept[k] + others[k];
        if (const double lower = end.lower[i] + keeps / rate.dt; lower > 0) {
            found.C[count].set(end.C[i]);
            found.lower[count++] = lower + end.C[i].dot(x);
            found.pair.push_back(k);
        }
    }
    return {found.C.rows_from(0, count), found.lower.part(0, count), Vec(w, count, INFINITY), found.pair};
}

// Distances without rows.
std::vector<double> Clearance::distances_at(Vec q)
{
    Workspace& w = *q.w;
    const ClearanceArm& arm = scene.arms[0];
    const ClearanceRate none{arm.speed, std::vector<double>(m, INFINITY), arm.lower, arm.upper, 0, 0, INFINITY, 0};
    for (;;) {
        const Workspace::Frame frame(w);
        predict_obstacles(0);
        Vec velocity;
        const Vec there = predict_joints(q, 0, &velocity);
        velocity.part(0, m).fill(0);
        const ClearanceSearch search(*this, joints_of(scene, arm_of, none, m, w), there, velocity,
                                     {0, ESCAPE_SPEED, 0, INFINITY}, margin_shares());
        if (!drop_always_near(search.least))
            return search.least;
    }
}

// In a singular state joints may move nothing. A state beside it shows which distances they change: those that change by
// more than twice the bound, for rounding.
std::vector<double> Clearance::distances(Vec q)
{
    Vec step(*q.w, all, 0);
    for (int j = 0; j < m; j++)
        step[j] = SINGULAR_STEP * finite_or(scene.arms[0].speed[j], DEFAULT_SPEED) / std::sqrt(j + 1.0);
    std::vector<double> found = distances_at(q);
    const std::vector<double> aside = distances_at(q + step.part(0, m));
    for (int k = 0; k < pairs(); k++)
        if (std::isinf(found[k]) || aside[k] < found[k] - 2 * approach_bound(k, step))
            found[k] = aside[k];
    return found;
}

std::vector<Pose> Clearance::poses(Vec q)
{
    predict_obstacles(0);
    Vec velocity;
    const Kinematics here(scene.arms, coordinate, first_joint, predict_joints(q, 0, &velocity));
    std::vector<Pose> found;
    for (std::size_t i = 0; i < scene.shapes.size(); i++)
        found.push_back(here.motions[scene.shapes[i].body] * place[i]);
    return found;
}

// Drops pairs of bodies that are too near and provably always are, until obstacles move; whether there were any.
bool Clearance::drop_always_near(const std::vector<double>& distances)
{
    Workspace& w = workspace_of_thread();
    bool found = false;
    for (int k = 0; k < pairs(); k++) {
        if (memo.tested[k] || !(distances[k] < scene.distance))
            continue;
        memo.tested[k] = true;
        if (!is_always_near(k, w))
            continue;
        for (int i = 0; i < pairs(); i++)
            if (scene.pairs[i].bodies == scene.pairs[k].bodies)
                memo.always_near[i] = memo.tested[i] = true;
        found = true;
    }
    return found;
}

// Whether two shapes are provably nearer than the distance for all positions of the joints between: branch and bound over
// cells of joint positions, each bounded by a witness of its middle and the lever of that point about each axis.
bool Clearance::is_always_near(int k, Workspace& w) const
{
    const Workspace::Frame frame(w);
    int i = scene.pairs[k].of[0], j = scene.pairs[k].of[1];
    const int one = scene.shapes[i].body, other = scene.shapes[j].body;
    const bool by_itself = scene.shapes[j].mover >= 0;
    const int from = by_itself ? 0 : std::min(one, other), to = by_itself ? one : std::max(one, other);
    if (!by_itself && one < other)
        std::swap(i, j);  // the first is the one that the joints move
    Vec velocity;
    const Vec q = predict_joints(Vec(w, m, 0), 0, &velocity);
    const std::vector<Twist> screws = Kinematics(scene.arms, coordinate, first_joint, q).J;
    const auto turns = [](const Twist& s) { return norm(s.omega) > 0; };
    if (scene.keep_all || !std::all_of(screws.begin() + from, screws.begin() + to, turns))
        return false;
    std::vector<std::array<Vec, 2>> cells;
    Vec low(w, m, 0), high(w, m, 0);
    for (int a = from; a < to; a++) {
        const int c = coordinate[a];
        low[c] = scene.arms[0].lower[c], high[c] = scene.arms[0].upper[c];
        const double half = M_PI / norm(screws[a].omega);
        if (high[c] - low[c] > 2 * half && std::count(&coordinate[from], &coordinate[from] + to - from, c) == 1)
            low[c] = -half, high[c] = half;
        if (!std::isfinite(high[c] - low[c]))
            return false;
    }
    cells.push_back({low, high});
    const double apart = (1 - EQUAL) * scene.distance;  // equality is not nearer
    for (int cell = 0; cell < MOST_CELLS; cell++) {
        if (cells.empty())
            return true;
        const auto [lowest, highest] = cells.back();
        cells.pop_back();
        const Vec half = 0.5 * (highest - lowest);
        q.part(0, m).set(lowest + half);
        const Kinematics here(scene.arms, coordinate, first_joint, q);
        const auto at = [&](int i) {
            Shape shape = scene.shapes[i].shape;
            shape.at = here.motions[scene.shapes[i].body] * place[i];
            return shape;
        };
        const Witnesses found = scene.witnesses(i, at(i), j, at(j));
        if (found.count == 0 || found.at[0].distance > apart)
            return false;
        double farthest = INFINITY;
        int axis = 0;
        for (int f = 0; f < found.count; f++) {
            double sum = 0, most = -1;
            int largest = 0;
            for (int a = to - 1; a >= from; a--) {  // from the outer joint to the inner
                const Twist& s = here.J[a];
                const int c = coordinate[a];
                const double reach = half[c] * (norm(s.v + cross(s.omega, found.at[f].point)) + norm(s.omega) * sum);
                sum += reach;
                if (reach >= most)
                    most = reach, largest = c;
            }
            if (found.at[f].distance + sum < farthest)
                farthest = found.at[f].distance + sum, axis = largest;
        }
        if (farthest > apart) {
            const Vec upper = highest.copy(), lower = lowest.copy();
            upper[axis] = lower[axis] = q[axis];
            cells.push_back({lowest, upper}), cells.push_back({lower, highest});
        }
    }
    return false;
}

namespace {

// Writes or reads numbers in sequence.
struct Archive {
    std::vector<double>& numbers;
    bool reads;
    std::size_t& at;

    template <class T> void operator()(T& x)
    {
        if (reads)
            x = static_cast<T>(numbers.at(at++));
        else
            numbers.push_back(x);
    }
    template <class T> void operator()(std::vector<T>& values)
    {
        double size = static_cast<double>(values.size());
        (*this)(size);
        if (reads && !(size >= 0 && size <= static_cast<double>(numbers.size())))
            throw std::out_of_range("memory of a clearance");
        values.resize(static_cast<std::size_t>(size));
        for (T& x : values)
            (*this)(x);
    }
};

}  // namespace

std::vector<double> Clearance::memory() const
{
    Memory copy = memo;
    std::vector<double> numbers;
    std::size_t at = 0;
    copy.each(Archive{numbers, false, at});
    return numbers;
}

void Clearance::remember(const std::vector<double>& numbers)
{
    Memory read = memo;
    std::vector<double> copy = numbers;
    std::size_t at = 0;
    read.each(Archive{copy, true, at});
    bool same = at == copy.size();
    for (const auto of : {&Memory::kept, &Memory::distances})
        same = same && (read.*of).size() == (memo.*of).size();
    same = same && read.always_near.size() == memo.always_near.size() && read.tested.size() == memo.tested.size();
    same = same && (read.first_q.empty() || static_cast<int>(read.first_q.size()) == m);
    for (std::size_t i = 0; i < read.movers.size(); i++)
        for (const auto of : {&Mover::position, &Mover::declared, &Mover::last, &Mover::estimated})
            same = same && (read.movers[i].*of).size() == (memo.movers[i].*of).size();
    if (!same)
        throw std::out_of_range("memory of another clearance");
    memo = read;
    predict_obstacles(0);
}

}  // namespace iq
