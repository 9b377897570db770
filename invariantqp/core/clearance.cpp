// The rows of a tick that keep bodies apart, and what is remembered between ticks; control/clearance.py explains the
// law.
#include "clearance.hpp"
#include <stdexcept>

namespace iq {

namespace {

// What came nearer than the distance is led out at the first share of the joints' velocity limits, and no joint is
// faster than the second: an arm into which an obstacle is put comes out in a second or three, without a kick.
constexpr double ESCAPE = 0.06, CALM = 0.09;
constexpr double USUAL_SPEED =
    1;  // of joints without a velocity limit, where pairs are ranked and led apart [rad/s, length/s]
constexpr double DEEP = 0.05;  // less of the distance curvature takes in a tick; deeper, an arm began inside
// Ways that turn within a tick take this share of the distance at most: an answer that takes more is made again. Beside
// what moves itself, rows that cannot all be kept ask for less where no more is given up by it than that.
constexpr double CURVED = 0.005;
constexpr double ACTIVE = 1e-6;    // by which a distance may be short of one, as velocity/solution.py has it for limits
constexpr double UNMOVED = 1e-12;  // a sum below this share of its terms is rounding
constexpr double EQUAL_ROWS = 1e-9;  // rows whose entries differ by this share of their length are one
// So often rows that ask for more than braking on are tried one after the other; one that is missed is passed by as
// much: that ends inside of all of them, where projections only come nearer (Motzkin and Schoenberg 1954).
constexpr int SWEEPS = 20;
constexpr double PASSED = 2;
// Where a joint moves nothing in this very state, a state is looked at that is so many seconds at full speed away [s].
constexpr double ASIDE = 1e-7;
constexpr double HALF_TURN = 3.141592653589793;
constexpr int STATES = 2000;  // whether a pair is always near is looked at in so many states, at most

double finite_or(double x, double other) { return std::isfinite(x) ? x : other; }

Twist twist_of(const std::vector<double>& s) { return {{s[0], s[1], s[2]}, {s[3], s[4], s[5]}}; }
bool moves(const Twist& s) { return dot(s.omega, s.omega) > 0 || dot(s.v, s.v) > 0; }

// Where a twist leads in some time.
Pose motion(const Twist& s, double time, Workspace& w)
{
    Mat screw(w, 6, 1);
    for (int i = 0; i < 3; i++)
        screw(i, 0) = s.omega[i], screw(3 + i, 0) = s.v[i];
    return Chain(screw, Pose()).pose(&time);
}

struct Kinematics {
    std::vector<Pose> motions;  // (K + 1,) of the base and all bodies
    std::vector<Twist> J;       // (K,) joint twists

    // At coordinates q (M,); the coordinate (K,) of each joint, and the first joint (arms,) of each arm.
    Kinematics(const std::vector<ClearanceArm>& arms, const std::vector<int>& coordinate, const std::vector<int>& first,
               Vec q)
        : motions(coordinate.size() + 1), J(coordinate.size())
    {
        const Vec turned(*q.w, static_cast<int>(J.size()));
        for (int j = 0; j < turned.n; j++)
            turned[j] = q[coordinate[j]];
        for (int a = static_cast<int>(arms.size()) - 1; a >= 0;
             a--) {  // each writes its base over the last body before it
            const Mat twists(*q.w, 6, arms[a].chain.size());
            arms[a].chain.motions(turned.p + first[a], twists, &motions[first[a]]);
            for (int j = 0; j < twists.cols; j++)
                J[first[a] + j] = {{twists(0, j), twists(1, j), twists(2, j)},
                                   {twists(3, j), twists(4, j), twists(5, j)}};
        }
    }
};

Places places_of(const ClearanceScene& scene, int i, const Shape& a, int j, const Shape& b)
{
    if (a.core != ShapeCore::mesh && b.core != ShapeCore::mesh)
        return places(a, b);
    Places found;
    scene.meshes(i, a, j, b, found);
    return found;
}

// The largest C z of a z between -low and high.
double most_of(Vec C, Vec low, Vec high)
{
    double sum = 0;
    for (int j = 0; j < C.n; j++)
        sum += C[j] > 0 ? C[j] * high[j] : C[j] < 0 ? -C[j] * low[j] : 0;
    return sum;
}

// What is left of a joint's velocity after a tick of braking, all joints together, at a share of what rows brake by.
double left_after_a_tick(const ClearanceRate& rate, Vec before, int joint, double share)
{
    double sum = 0;
    for (int j = 0; j < before.n; j++) {
        const double alone = before[j] / (BRAKING * rate.dt * rate.acceleration[j]), square = alone * alone;
        sum += std::isfinite(rate.acceleration[j]) ? square * square * (square * square) : 0;
    }
    const double ticks = std::max(1.0, std::pow(sum, 0.125));
    return std::isfinite(rate.acceleration[joint]) ? std::abs(before[joint]) * (1 - share / ticks) : 0;
}

}  // namespace

// One look at all pairs, in each of the states that an arm with brakes passes as it comes to rest.
class ClearanceSearch {
  public:
    struct Settings {
        double alpha, escape, dt, joint_rate;
    };
    std::vector<double> least;  // (k,) distances
    Mat C;                      // rows C x >= lower
    Vec lower, urgency;
    int pair[MOST_CLEARANCE_ROWS], count = 0;

    // Of joints at q (M,) after a velocity (M,); a pair may take `shares` (k,) of its room, 0 where it is not looked
    // at.
    ClearanceSearch(const Clearance& of, const BrakingJoints& joints, Vec q, Vec before, const Settings& settings,
                    const std::vector<double>& shares)
        : of(of),
          scene(of.scene),
          joints(joints),
          before(before),
          settings(settings),
          states(joints, q, before, settings.dt, settings.joint_rate),
          w(*q.w),
          m(joints.own),
          all(q.n)
    {
        const int k = of.pairs(), n = static_cast<int>(scene.shapes.size());
        least.assign(k, INFINITY), looks.resize(k), shapes.resize(n), seen.assign(n, -1);
        C = Mat(w, MOST_CLEARANCE_ROWS, m), lower = Vec(w, MOST_CLEARANCE_ROWS), urgency = Vec(w, MOST_CLEARANCE_ROWS);
        for (int i = 0; i < k; i++) {
            const auto& [first, second] = scene.pairs[i].of;
            looks[i].share = shares[i];
            looks[i].still = !moves(of.twists[first]) && !moves(of.twists[second]);
        }
        for (int s = 0; s < static_cast<int>(states.at.size()); s++)
            look(s);
        ask_what_is_possible();
    }

  private:
    struct Look {
        double share, far = 0;        // of the room; in the first state they are at least so far apart
        double leaves = INFINITY;     // how fast states ahead let them come nearer
        bool still, recedes = false;  // neither moves by itself; one comes, and the arm goes before it
    };
    const Clearance& of;
    const ClearanceScene& scene;
    const BrakingJoints& joints;
    const Vec before;
    const Settings settings;
    const BrakingStates states;
    Workspace& w;
    const int m, all;
    bool valid = true, still = true;  // it is no deeper inside than curvature takes it; nothing moves itself
    double smallest = INFINITY;
    std::vector<Look> looks;
    std::vector<Shape> shapes;
    std::vector<int> seen;           // in which state each shape was placed
    std::optional<Kinematics> here;  // of the state
    Vec approach;                    // (M,) how fast joints can turn, weighed

    // How fast a pair comes nearer where it is now, at most.
    double swept(int k) const
    {
        double most = 0;
        for (int e = 0; e < 2; e++) {
            const Shape& shape = shapes[scene.pairs[k].of[e]];
            for (int j = of.between[k].from[e]; j < of.between[k].to[e]; j++) {
                const Twist& s = here->J[j];
                most += approach[of.coordinate[j]] * (norm(s.v + cross(s.omega, shape.at.p)) + norm(s.omega) * shape.ball);
            }
        }
        return most;
    }
    const Shape& placed(int i, int s)
    {
        if (seen[i] != s) {
            const Pose& moved = here->motions[scene.shapes[i].body];
            const double time = states.at[s].time;
            shapes[i] = scene.shapes[i].shape;
            shapes[i].at =
                (time > 0 && moves(of.twists[i]) ? motion(of.twists[i], time, w) * moved : moved) * of.place[i];
            seen[i] = s;
        }
        return shapes[i];
    }
    void set_approach(const BrakingState& state, bool now)
    {
        approach = Vec(w, all);
        double more = 0;
        for (int j = 0; j < all; j++) {
            const double free = j < m ? std::max(states.free[0][j], states.free[1][j]) : 0;
            approach[j] = j < m ? (now ? 1 : state.time / settings.dt + 1) * free : std::abs(state.going[j]);
            more += states.grows[j] != 0 ? std::abs(states.grows[j]) * free : 0;
        }
        for (int j = 0; j < m; j++)
            approach[j] += state.longer[j] != 0 ? std::abs(state.longer[j]) * more : 0;
    }

    // A pair that is so far that no row of it matters in a state is not looked at there: its distance has changed by
    // at most what joints have turned times their levers.
    void look(int s)
    {
        const BrakingState& state = states.at[s];
        const bool last = s + 1 == static_cast<int>(states.at.size()), leaving = s == 0 && !last;
        set_approach(state, s == 0);
        Vec since = approach.copy();
        for (int j = 0; j < all; j++)
            since[j] += settings.alpha * std::abs(state.q[j] - states.at[0].q[j]);
        here.reset();
        for (int k = 0; k < of.pairs(); k++) {
            Look& look = looks[k];
            const bool skips = look.still && settings.alpha > 0;
            const double rate = settings.alpha * look.share;
            if (!(look.share > 0) || look.recedes)
                continue;
            if (s > 0 && skips && (!last || look.leaves == INFINITY)
                && rate * (look.far - scene.distance) > of.nearer(k, since))
                continue;
            if (!here)
                here.emplace(scene.arms, of.coordinate, of.first_joint, state.q);
            const auto& [i, j] = scene.pairs[k].of;
            const Shape &a = placed(i, s), &b = placed(j, s);
            const double far = at_least(a, b),
                         room = std::min(rate * (far - scene.distance), last ? look.leaves : INFINITY);
            if (s == 0)
                look.far = far;
            double fastest = INFINITY;
            const bool apart = skips && far > scene.distance && (s > 0 || far > smallest);
            if (apart && leaving)
                continue;
            if (skips) {
                fastest = of.nearer(k, approach);
                const bool out_of_reach = room > fastest;
                if (room > 0 && !out_of_reach)
                    fastest = std::min(fastest, swept(k));
                if (apart && (s == 0 || last ? room > fastest : out_of_reach))
                    continue;
            }
            const Places found = places_of(scene, i, a, j, b);
            const double nearest = ask(s, k, found, std::min(of.now.kept[k], s > 0 ? least[k] : INFINITY), fastest);
            if (s == 0) {
                least[k] = nearest, look.far = found.count > 0 ? found.at[0].distance : far;
                smallest = std::min(smallest, nearest);
            }
        }
    }

    // The rows of a pair in a state, kept where they are urgent; the least distance, infinite where no joint changes
    // it. `wanted` is the distance that it keeps there, `fastest` how fast it comes nearer, at most. In the arm's own
    // state, beside those that it would brake through, rows lead out of what is too near alone.
    double ask(int s, int k, const Places& found, double wanted, double fastest)
    {
        Look& look = looks[k];
        const BrakingState& state = states.at[s];
        const bool begins = s == 0 && states.at.size() > 1, last = s + 1 == static_cast<int>(states.at.size());
        const double alpha = settings.alpha;
        const Vec speed = joints.speed.part(0, m), brakes = joints.acceleration.part(0, m);
        bool leaving = begins;
        double over = 0,
               nearest = INFINITY;  // by how much it could come nearer faster than states ahead leave room for
        Vec3 out{0, 0, 0};
        for (int f = 0; f < found.count; f++) {
            const Place& at = found.at[f];
            const double room = at.distance - wanted;
            if (nearest < INFINITY && room >= 0 && (leaving || alpha * look.share * room - over > fastest))
                break;  // no row of a place as far as this matters
            const Workspace::Frame frame(w);
            const Vec row = slope(k, at);  // how fast the distance grows with joint velocities
            const Vec own = row.part(0, m);
            if (std::all_of(own.begin(), own.end(), [](double x) { return x == 0; }))
                continue;
            const auto& [i, j] = scene.pairs[k].of;
            const double coming = along(at, of.twists[i]) - along(at, of.twists[j]);
            const double drift = row.part(m, all).dot(state.going.part(m, all)) - coming;
            const double longer = own.dot(state.longer.part(0, m));
            Vec C(w, m);
            for (int j = 0; j < m; j++)
                C[j] = state.weight[j] * own[j] + longer * states.grows[j];
            double weighed = 0, square = 0, largest = 0;
            for (int j = 0; j < m; j++) {
                const double scaled = std::abs(C[j]) * finite_or(speed[j], USUAL_SPEED);
                weighed += scaled, square += scaled * scaled, largest = std::max(largest, scaled);
            }
            if (!(weighed > 0))
                continue;
            const double braked = C.dot(states.y.part(0, m)), strong = most_of(own, brakes, brakes);
            const bool first = nearest == INFINITY, comes = coming > 0 && most_of(own, speed, speed) > coming;
            nearest = std::min(nearest, at.distance);
            if (first && begins)
                look.recedes = comes && own.dot(before.part(0, m)) >= 0, leaving = !look.recedes;
            if (f == 0 || dot(out, out) == 0)
                out = at.normal;
            if (leaving && room >= 0)
                continue;
            double may =
                alpha * std::min(room, look.share * room);  // come nearer so fast; of what another one leaves, too
            may = look.share == 1 || room < 0 ? may + drift : std::min(may, alpha * room + drift);
            if (first && last)
                over = std::max(may - look.leaves, 0.0);
            else if (first && s > 0)
                look.leaves = std::min(look.leaves, std::max(may, 0.0) / (state.time / settings.dt + 1));
            const double y = s == 0 ? 0 : braked;  // in the state of now rows are on the velocity itself
            double low = room >= 0 ? y - (may - over)
                                   : y
                                         + std::max(0.0, dot(at.normal, out))
                                               * std::min(-alpha * room, settings.escape * square / largest)
                                         - drift;
            if (comes && room > 0 && states.at.size() > 1) {  // joints take time to make way, as hard as they can
                const double slower = braking_speed(look.share * room, BRAKING * strong, settings.dt, alpha) + drift;
                low = std::max(low, std::min(y - slower, braked + most_of(C, states.free[0], states.free[1])));
            }
            if (leaving || (room < 0 && drift == 0)) {  // joints certainly can
                const Vec* certain = leaving ? states.led : states.sure;
                low = std::min(low, braked + most_of(C, certain[0], certain[1]));
            }
            if (!(low > braked - most_of(C, states.free[1], states.free[0])))
                continue;  // every velocity keeps it
            still = still && drift == 0;
            valid = valid && (s > 0 || room >= -DEEP * scene.distance);
            keep(C, low, (low - braked) / weighed - (f == 0 ? 0 : 1), k);
        }
        return nearest;
    }
    static double along(const Place& at, const Twist& s)
    {
        return dot(cross(at.point, at.normal), s.omega) + dot(at.normal, s.v);
    }
    Vec slope(int k, const Place& at) const
    {
        Vec row(w, all, 0), parts(w, all, 0);
        const Vec3 lever = cross(at.point, at.normal);
        for (int e = 0; e < 2; e++)
            for (int j = of.between[k].from[e]; j < of.between[k].to[e]; j++) {
                const Twist& s = here->J[j];
                const int c = of.coordinate[j];
                double sum = 0;
                for (int r = 0; r < 3; r++) {
                    const double turn = lever[r] * s.omega[r], slide = at.normal[r] * s.v[r];
                    sum += turn + slide, parts[c] += std::abs(turn) + std::abs(slide);
                }
                row[c] += e == 0 ? -sum : sum;
            }
        for (int c = 0; c < all; c++)
            row[c] = std::abs(row[c]) > UNMOVED * parts[c] ? row[c] : 0;
        return row;
    }

    // Keep a row among the most urgent, each pair's nearest before all others; of equal ones the one that asks for
    // more.
    void keep(Vec row, double low, double urgent, int of_pair)
    {
        int at = count, last = 0;
        const double size = row.norm();
        for (int i = 0; i < count; i++) {
            double apart = 0;
            for (int j = 0; j < m; j++)
                apart = std::max(apart, std::abs(C(i, j) - row[j]));
            if (apart <= EQUAL_ROWS * size) {
                urgency[i] = urgent = std::max(urgency[i], urgent);
                if (lower[i] >= low)
                    return;
                at = i;
                break;
            }
            if (urgency[i] < urgency[last])
                last = i;
        }
        if (at == MOST_CLEARANCE_ROWS) {
            if (urgency[last] >= urgent)
                return;
            at = last;
        }
        count = std::max(count, at + 1);
        C[at].set(row), lower[at] = low, urgency[at] = urgent, pair[at] = of_pair;
    }

    // Rows C z >= asked, z being inside joint limits about the velocity braked for a tick. Those that ask for
    // something lead back what curvature took of the distance: for as much as is found to be possible beside all
    // others, by one velocity that keeps them all; z = 0 keeps what asks for nothing. They ask for as much as before
    // where one would give up more than what curvature takes, beside something that moves by itself.
    void ask_what_is_possible()
    {
        const Vec y = states.y.part(0, m), low = lower.part(0, count), asked = low - C.rows_from(0, count) * y,
                  z(w, m, 0);
        if (!valid || std::none_of(asked.begin(), asked.end(), [](double a) { return a > 0; }))
            return;
        bool missed = true;
        for (int sweep = 0; sweep < SWEEPS && missed; sweep++) {
            missed = false;
            for (int i = 0; i < count; i++) {
                const double left = asked[i] - C[i].dot(z);
                missed = missed || left > 0;
                for (int j = 0; left > 0 && j < m; j++)
                    z[j] =
                        clamped(z[j] + PASSED * left / C[i].square() * C(i, j), -states.free[0][j], states.free[1][j]);
            }
        }
        const Vec got = C.rows_from(0, count) * z;
        double share = 1, given_up = 0;
        for (int i = 0; i < count; i++)
            if (const double at_least = std::min(asked[i], 0.0); got[i] < at_least)
                share = std::min(share, at_least / got[i]);
        for (int i = 0; i < count; i++)
            given_up = std::max(given_up, asked[i] > 0 ? asked[i] - share * got[i] : 0);
        if (!still && given_up > settings.alpha * CURVED * scene.distance)
            return;
        for (int i = 0; i < count; i++)
            if (asked[i] > 0)
                low[i] += std::min(asked[i], share * got[i]) - asked[i];
    }
};

namespace {

// What a search needs of joints: those of the arm by its limits in a loop, others by their own.
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

Workspace& memory_of_ticks()
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
    Workspace& w = memory_of_ticks();
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
        if (alone.from[0] == alone.from[1])  // what both have is left out
            alone.from[0] = alone.from[1] = std::min(alone.to[0], alone.to[1]);
        between.push_back(alone);
    }
    now.kept.assign(k, scene.distance), now.distances.assign(k, INFINITY), now.off.assign(k, 0),
        now.judged.assign(k, 0);
    now.movers.resize(scene.obstacles + scene.arms.size() - 1), shift.resize(scene.obstacles);
    for (std::size_t i = 0; i < now.movers.size(); i++) {
        Mover& mover = now.movers[i];
        const int arm = static_cast<int>(i) - scene.obstacles + 1;
        mover.speed.assign(arm > 0 ? scene.arms[arm].size() : 6, 0);
        mover.place.assign(arm > 0 ? mover.speed.size() : 16, 0);
        if (arm <= 0)
            Pose().write(mover.place.data());
        mover.last = mover.place, mover.found = mover.speed;
    }
}

void Clearance::start()
{
    for (Mover& mover : now.movers)
        mover.last = mover.place, mover.found = mover.speed, mover.fresh = false;
    place_all(0);
    judge(std::vector<double>(pairs(), -INFINITY));
}

// From the middle of a shape to a point of the axis before it, from there to one of the next, and so on: turning about
// these axes changes none of these distances, and sliding changes them by how far a joint slides.
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
        if (along > UNMOVED * lever) {
            const int c = arm.coordinates[j - first];
            const double low = arm.lower[c], high = arm.upper[c];
            reach += along * (high - low + std::max(std::abs(low), std::abs(high)));
        }
    }
}

// How much nearer a pair comes at most by what coordinates (M,) turn.
double Clearance::nearer(int k, Vec turned) const
{
    double most = 0;
    for (int e = 0; e < 2; e++)
        for (int j = between[k].from[e]; j < between[k].to[e]; j++)
            most += lever(scene.pairs[k].of[e])[j] * turned[coordinate[j]];
    return most;
}

void Clearance::move(int obstacle, const Pose& to, const double* twist)
{
    Mover& mover = now.movers[obstacle];
    to.write(mover.place.data());
    mover.declared = twist != nullptr, mover.fresh = true;
    if (twist)
        mover.speed.assign(twist, twist + 6);
    renew(obstacle);
}

void Clearance::move_arm(int arm, const double* q, const double* velocity)
{
    Mover& mover = now.movers[scene.obstacles + arm];
    const std::size_t n = mover.speed.size();
    mover.place.assign(q, q + n);
    mover.declared = velocity != nullptr, mover.fresh = true;
    if (velocity)
        mover.speed.assign(velocity, velocity + n);
    renew(scene.obstacles + arm);
}

Twist Clearance::twist(int obstacle) const { return twist_of(now.movers[obstacle].velocity()); }

// Pairs with what was moved count again, until they are judged.
void Clearance::renew(int mover)
{
    for (int k = 0; k < pairs(); k++)
        if (scene.shapes[scene.pairs[k].of[1]].mover == mover)
            now.off[k] = now.judged[k] = false;
}

// In a tick at some time: as its last two places say. Of a new speed it takes what rows at a rate alpha take of the
// room meanwhile, so that noise in places does no more by it than by the room; it is held for twice the time between
// the places.
void Clearance::Mover::observe(double time, double alpha, const std::vector<double>& turns)
{
    const auto rest = [](double x) { return x == 0; };
    if (!fresh && (declared || std::all_of(found.begin(), found.end(), rest)))
        return;
    if (declared)
        last = place, found = speed, at = time, between = 0;
    else if (const double since = time - at; since == 0)
        last = place;
    else if (!fresh) {
        if (!(since <= (2 + ROUNDING) * between))
            std::fill(found.begin(), found.end(), 0);
    } else {
        std::vector<double> way(found.size());
        if (turns.empty()) {
            const Twist s = error_twist(Pose(place.data()), Pose(last.data()));
            std::copy(s.omega.begin(), s.omega.end(), way.begin()), std::copy(s.v.begin(), s.v.end(), way.begin() + 3);
        } else
            for (std::size_t j = 0; j < way.size(); j++) {
                way[j] = place[j] - last[j];
                way[j] -= turns[j] > 0 ? turns[j] * std::nearbyint(way[j] / turns[j]) : 0;
            }
        for (std::size_t j = 0; j < way.size(); j++)
            found[j] += std::min(1.0, alpha * since) * (way[j] / since - found[j]);
        last = place, at = time, between = since;
    }
    fresh = false;
}

// Places and twists of obstacles when a command of now acts.
void Clearance::place_all(double delay)
{
    Workspace& w = memory_of_ticks();
    for (int i = 0; i < static_cast<int>(scene.shapes.size()); i++) {
        const int obstacle = scene.shapes[i].mover;
        if (obstacle < 0 || obstacle >= scene.obstacles)
            continue;
        const Workspace::Frame frame(w);
        const Mover& mover = now.movers[obstacle];
        Pose at(mover.place.data());
        twists[i] = twist_of(mover.velocity());
        std::vector<double> by = mover.velocity();
        for (double& x : by)
            x *= delay;
        if (delay > 0 && moves(twists[i]))
            at = motion(twists[i], delay, w) * at;
        if (by != shift[obstacle]) {
            renew(obstacle);
            shift[obstacle] = by;
        }
        place[i] = at * scene.shapes[i].shape.at;
    }
}

// (M,) joints of the arm, then of others when a command of now acts; and how fast those are.
Vec Clearance::around(Vec own, double delay, Vec* velocity) const
{
    Vec q(*own.w, all);
    *velocity = Vec(*own.w, all, 0);
    q.part(0, m).set(own);
    for (int a = 1; a < static_cast<int>(scene.arms.size()); a++) {
        const Mover& mover = now.movers[scene.obstacles + a - 1];
        for (int j = 0; j < scene.arms[a].size(); j++) {
            const double speed = mover.velocity()[j];
            (*velocity)[first_of[a] + j] = speed, q[first_of[a] + j] = mover.place[j] + delay * speed;
        }
    }
    return q;
}

// Of the room of a pair, what this arm may take: half of it where another one makes way too, because it is said to or
// its velocity is not known.
double Clearance::share(int k) const
{
    if (now.off[k])
        return 0;
    const int mover = scene.shapes[scene.pairs[k].of[1]].mover, arm = mover - scene.obstacles + 1;
    return arm > 0 && (scene.arms[arm].brakes || !now.movers[mover].declared) ? 0.5 : 1;
}
std::vector<double> Clearance::shares() const
{
    std::vector<double> found(pairs());
    for (int k = 0; k < pairs(); k++)
        found[k] = share(k);
    return found;
}

double Clearance::enough() const { return scene.distance - std::max(CURVED * scene.distance, ACTIVE); }

int Clearance::nearest() const
{
    const auto least = std::min_element(now.distances.begin(), now.distances.end());
    return least == now.distances.end() ? -1 : static_cast<int>(least - now.distances.begin());
}

// Pairs keep the distance, or where they are nearer what they have, less what noise may take of it.
void Clearance::keep(const std::vector<double>& distances, bool first)
{
    for (int k = 0; k < pairs(); k++) {
        const double own = distances[k] - DEEP * scene.distance;
        now.kept[k] = distances[k] < enough() ? (first ? own : std::max(own, now.kept[k])) : scene.distance;
    }
}

double Clearance::begin(std::optional<double> last, Vec q, const ClearanceRate& rate)
{
    bool first = !last;
    if (first
        && !now.began.empty()) {  // it goes on from a tick whose limit this was alone: each is the first of a loop
        first = false;
        for (int j = 0; j < m; j++)
            first = first
                    || !(std::abs(q[j] - now.began[j]) <= 2 * rate.dt * finite_or(scene.arms[0].speed[j], USUAL_SPEED));
    }
    const bool near = std::any_of(now.kept.begin(), now.kept.end(), [this](double d) { return d < scene.distance; });
    if (first || near)
        keep(distances(q), first);
    begins = first;
    now.began = last ? std::vector<double>() : std::vector<double>(q.begin(), q.end());
    if (last)
        now.time = std::max(now.time, *last + rate.dt);
    for (int i = 0; i < static_cast<int>(now.movers.size()); i++)
        now.movers[i].observe(now.time, rate.alpha,
                              i < scene.obstacles ? std::vector<double>() : scene.arms[i - scene.obstacles + 1].turns);
    return now.time;
}

ClearanceRows Clearance::rows(Vec q, Vec before, const ClearanceRate& rate)
{
    Workspace& w = *q.w;
    const BrakingJoints joints = joints_of(scene, arm_of, rate, m, w);
    for (;;) {
        place_all(rate.delay);
        Vec velocity;
        const Vec there = around(q, rate.delay, &velocity);
        velocity.part(0, m).set(before);
        const ClearanceSearch search(*this, joints, there, velocity, {rate.alpha, ESCAPE, rate.dt, rate.joint_rate},
                                     shares());
        if (judge(search.least))
            continue;
        now.distances = search.least;
        ClearanceRows found{search.C.rows_from(0, search.count), search.lower.part(0, search.count),
                            Vec(w, search.count, INFINITY), std::vector<int>(search.pair, search.pair + search.count)};
        double lacks = 0;
        for (int k = 0; k < pairs(); k++)
            lacks = std::max(lacks, now.kept[k] - now.distances[k]);
        bool moved = velocity.part(m, all).square() > 0;
        for (const int k : found.pair)
            moved = moved || moves(twists[scene.pairs[k].of[0]]) || moves(twists[scene.pairs[k].of[1]]);
        if (lacks > scene.distance - enough() && !moved)
            hold_back(found, lacks, before, rate);
        return found;
    }
}

// Rows that let joints leave slowly what they are too near to, a pair lacking so much of its distance, but no slower
// than they can brake.
void Clearance::hold_back(ClearanceRows& rows, double lacks, Vec before, const ClearanceRate& rate) const
{
    Workspace& w = *before.w;
    const double deep = scene.distance > 0 ? std::min(1.0, lacks / (DEEP * scene.distance)) : 1;
    for (int j = 0; j < m; j++) {
        const double speed =
            std::max(std::max(CALM, 1 - deep) * scene.arms[0].speed[j], left_after_a_tick(rate, before, j, deep));
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
    place_all(rate.delay);
    Vec turned(w, all, 0), velocity;
    const Vec there = around(q + rate.dt * x, rate.delay, &velocity);
    for (int j = 0; j < m; j++)
        turned[j] = rate.dt * std::abs(x[j]);
    std::vector<double> may(pairs()), others(pairs(), 0);
    for (int k = 0; k < pairs(); k++) {
        const double d = now.distances[k], mine = share(k);
        if (std::isfinite(d))  // another one may take its share of the room
            others[k] = (1 - mine) * std::max(d - scene.distance, 0.0);
        may[k] = mine > 0 && std::isfinite(d) && d - nearer(k, turned) < scene.distance + others[k];
    }
    if (std::none_of(may.begin(), may.end(), [](double share) { return share > 0; }))
        return found;
    const ClearanceSearch end(*this, joints_of(scene, arm_of, rate, m, w), there, velocity,
                              {1 / rate.dt, INFINITY, 0, INFINITY}, may);
    bool kept = true;
    for (int k = 0; k < pairs(); k++)
        kept = kept && (may[k] == 0 || end.least[k] - others[k] >= std::min(now.distances[k], enough()));
    if (kept)
        return found;
    found.C = Mat(w, end.count, m), found.lower = Vec(w, end.count);
    int count = 0;
    for (int i = 0; i < end.count; i++) {
        const int k = end.pair[i];
        const double keeps = std::min(now.distances[k], now.kept[k]) - now.kept[k] + others[k];
        if (const double asked = end.lower[i] + keeps / rate.dt; asked > 0) {
            found.C[count].set(end.C[i]);
            found.lower[count++] = asked + end.C[i].dot(x);
            found.pair.push_back(k);
        }
    }
    return {found.C.rows_from(0, count), found.lower.part(0, count), Vec(w, count, INFINITY), found.pair};
}

// Distances, and no rows that matter.
std::vector<double> Clearance::distances_at(Vec q)
{
    Workspace& w = *q.w;
    const ClearanceArm& arm = scene.arms[0];
    const ClearanceRate none{arm.speed, std::vector<double>(m, INFINITY), arm.lower, arm.upper, 0, 0, INFINITY, 0};
    for (;;) {
        const Workspace::Frame frame(w);
        place_all(0);
        Vec velocity;
        const Vec there = around(q, 0, &velocity);
        velocity.part(0, m).fill(0);
        const ClearanceSearch search(*this, joints_of(scene, arm_of, none, m, w), there, velocity,
                                     {0, ESCAPE, 0, INFINITY}, shares());
        if (!judge(search.least))
            return search.least;
    }
}

// In a singular state joints may move nothing for an instant. A state beside it shows what they do move: a distance
// that changes by more than they have turned, twice that for rounding.
std::vector<double> Clearance::distances(Vec q)
{
    Vec step(*q.w, all, 0);
    for (int j = 0; j < m; j++)
        step[j] = ASIDE * finite_or(scene.arms[0].speed[j], USUAL_SPEED) / std::sqrt(j + 1.0);
    std::vector<double> found = distances_at(q);
    const std::vector<double> aside = distances_at(q + step.part(0, m));
    for (int k = 0; k < pairs(); k++)
        if (std::isinf(found[k]) || aside[k] < found[k] - 2 * nearer(k, step))
            found[k] = aside[k];
    return found;
}

std::vector<Pose> Clearance::placed(Vec q)
{
    place_all(0);
    Vec velocity;
    const Kinematics here(scene.arms, coordinate, first_joint, around(q, 0, &velocity));
    std::vector<Pose> found;
    for (std::size_t i = 0; i < scene.shapes.size(); i++)
        found.push_back(here.motions[scene.shapes[i].body] * place[i]);
    return found;
}

// Whether some pairs that are too near are always so, where obstacles are now; they do not count until those move.
bool Clearance::judge(const std::vector<double>& distances)
{
    Workspace& w = memory_of_ticks();
    bool found = false;
    for (int k = 0; k < pairs(); k++) {
        if (now.judged[k] || !(distances[k] < scene.distance))
            continue;
        now.judged[k] = true;
        if (!shows_always_near(k, w))
            continue;
        for (int i = 0; i < pairs(); i++)
            if (scene.pairs[i].bodies == scene.pairs[k].bodies)
                now.off[i] = now.judged[i] = true;
        found = true;
    }
    return found;
}

// Whether two shapes are nearer than the distance wherever the joints between them are: in other states they are at
// most as far apart as a place of theirs is, and a joint moves that by how far it is from its axis. So some states
// show it.
bool Clearance::shows_always_near(int k, Workspace& w) const
{
    const Workspace::Frame frame(w);
    int i = scene.pairs[k].of[0], j = scene.pairs[k].of[1];
    const int one = scene.shapes[i].body, other = scene.shapes[j].body;
    const bool by_itself = scene.shapes[j].mover >= 0;
    const int from = by_itself ? 0 : std::min(one, other), to = by_itself ? one : std::max(one, other);
    if (!by_itself && one < other)
        std::swap(i, j);  // the first is the one that the joints move
    Vec velocity;
    const Vec q = around(Vec(w, m, 0), 0, &velocity);
    const std::vector<Twist> screws = Kinematics(scene.arms, coordinate, first_joint, q).J;
    const auto turns = [](const Twist& s) { return norm(s.omega) > 0; };
    if (scene.chosen || !std::all_of(screws.begin() + from, screws.begin() + to, turns))
        return false;  // asked for; a slide goes as far as it goes
    std::vector<std::array<Vec, 2>> cells;
    Vec low(w, m, 0), high(w, m, 0);
    for (int a = from; a < to; a++) {
        const int c = coordinate[a];
        low[c] = scene.arms[0].lower[c], high[c] = scene.arms[0].upper[c];
        const double half = HALF_TURN / norm(screws[a].omega);
        if (high[c] - low[c] > 2 * half && std::count(&coordinate[from], &coordinate[from] + to - from, c) == 1)
            low[c] = -half, high[c] = half;
        if (!std::isfinite(high[c] - low[c]))
            return false;
    }
    cells.push_back({low, high});
    const double apart = (1 - 1e-9) * scene.distance;  // at the distance, but for rounding, is not nearer
    for (int state = 0; state < STATES; state++) {
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
        const Places found = places_of(scene, i, at(i), j, at(j));
        if (found.count == 0 || found.at[0].distance > apart)
            return false;
        double farthest = INFINITY;
        int axis = 0;
        for (int f = 0; f < found.count; f++) {
            double sum = 0, most = -1;
            int largest = 0;
            for (int a = to - 1; a >= from; a--) {  // the inner joint moves it from where the outer joint has
                const Twist& s = here.J[a];
                const int c = coordinate[a];
                const double way = half[c] * (norm(s.v + cross(s.omega, found.at[f].point)) + norm(s.omega) * sum);
                sum += way;
                if (way >= most)
                    most = way, largest = c;
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

// Numbers that are written or read one after the other.
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
    Memory copy = now;
    std::vector<double> numbers;
    std::size_t at = 0;
    copy.each(Archive{numbers, false, at});
    return numbers;
}

void Clearance::remember(const std::vector<double>& numbers)
{
    Memory read = now;
    std::vector<double> copy = numbers;
    std::size_t at = 0;
    read.each(Archive{copy, true, at});
    bool same = at == copy.size();
    for (const auto of : {&Memory::kept, &Memory::distances})
        same = same && (read.*of).size() == (now.*of).size();
    same = same && read.off.size() == now.off.size() && read.judged.size() == now.judged.size();
    same = same && (read.began.empty() || static_cast<int>(read.began.size()) == m);
    for (std::size_t i = 0; i < read.movers.size(); i++)
        for (const auto of : {&Mover::place, &Mover::speed, &Mover::last, &Mover::found})
            same = same && (read.movers[i].*of).size() == (now.movers[i].*of).size();
    if (!same)
        throw std::out_of_range("memory of another clearance");
    now = read;
    place_all(0);
}

}  // namespace iq
