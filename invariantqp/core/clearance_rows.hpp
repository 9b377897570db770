// The rows of a clearance in the states that an arm passes while it brakes; control/clearance.py explains the law.
#pragma once
#include "clearance.hpp"

namespace iq {

constexpr double DEFAULT_SPEED = 1;  // of joints without a velocity limit [rad/s, length/s]
constexpr double DEEP = 0.05;  // share of the distance above what curvature takes in a tick: an arm began inside
// Share of the distance that curvature may take in a tick before it is solved again; the same that recovery may give
// up near something that moves.
constexpr double CURVATURE = 0.005;
constexpr double CANCELLATION = 1e-12;  // a sum below this share of its terms is rounding
constexpr double EQUAL = 1e-9;  // of equal rows as a share of their length, and of equal distances
// Reflections over violated rows, which end inside all of them (Motzkin and Schoenberg 1954).
constexpr int SWEEPS = 20;
constexpr double REFLECTION = 2;

inline double finite_or(double x, double other) { return std::isfinite(x) ? x : other; }

inline bool moves(const Twist& s) { return dot(s.omega, s.omega) > 0 || dot(s.v, s.v) > 0; }

// The displacement by a twist in a time.
inline Pose motion(const Twist& s, double time, Workspace& w)
{
    Mat screw(w, 6, 1);
    for (int i = 0; i < 3; i++)
        screw(i, 0) = s.omega[i], screw(3 + i, 0) = s.v[i];
    return Chain(screw, Pose()).pose(&time);
}

struct Kinematics {
    std::vector<Pose> motions;  // (K + 1,) of the base and all bodies
    std::vector<Twist> J;       // (K,) joint twists

    // At q (M,), with the coordinate (K,) of each joint and the first joint (arms,) of each arm.
    Kinematics(const std::vector<ClearanceArm>& arms, const std::vector<int>& coordinate, const std::vector<int>& first,
               Vec q)
        : motions(coordinate.size() + 1), J(coordinate.size())
    {
        const Vec turned(*q.w, static_cast<int>(J.size()));
        for (int j = 0; j < turned.n; j++)
            turned[j] = q[coordinate[j]];
        // Each arm writes its base over the last body of the arm before it.
        for (int a = static_cast<int>(arms.size()) - 1; a >= 0; a--) {
            const Mat twists(*q.w, 6, arms[a].chain.size());
            arms[a].chain.motions(turned.p + first[a], twists, &motions[first[a]]);
            for (int j = 0; j < twists.cols; j++)
                J[first[a] + j] = {{twists(0, j), twists(1, j), twists(2, j)},
                                   {twists(3, j), twists(4, j), twists(5, j)}};
        }
    }
};

// The largest C z for z between -low and high.
inline double most_of(Vec C, Vec low, Vec high)
{
    double sum = 0;
    for (int j = 0; j < C.n; j++)
        sum += C[j] > 0 ? C[j] * high[j] : C[j] < 0 ? -C[j] * low[j] : 0;
    return sum;
}

// The rows of all pairs in each state that an arm passes while it brakes to rest.
class ClearanceSearch {
  public:
    struct Settings {
        double alpha, escape, dt, joint_rate;
    };
    std::vector<double> least;  // (k,) distances
    Mat C;                      // rows C x >= lower
    Vec lower, urgency;
    int pair[MOST_CLEARANCE_ROWS], count = 0;

    // For joints at q (M,) after a velocity (M,); a pair may use `shares` (k,) of its margin, 0 if it is not checked.
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
        least.assign(k, INFINITY), checks.resize(k), shapes.resize(n), placed_in.assign(n, -1);
        C = Mat(w, MOST_CLEARANCE_ROWS, m), lower = Vec(w, MOST_CLEARANCE_ROWS), urgency = Vec(w, MOST_CLEARANCE_ROWS);
        for (int i = 0; i < k; i++) {
            const auto& [first, second] = scene.pairs[i].of;
            checks[i].share = shares[i];
            checks[i].at_rest = !moves(of.twists[first]) && !moves(of.twists[second]);
        }
        for (int s = 0; s < static_cast<int>(states.at.size()); s++)
            check(s);
        limit_recovery();
    }

  private:
    struct Check {
        double share, bound = 0;        // of the margin; lower bound of the distance in the first state
        double approach = INFINITY;     // speed of approach that braking states allow
        bool at_rest, recedes = false;  // neither shape moves by itself; the arm moves away from one that approaches
    };
    const Clearance& of;
    const ClearanceScene& scene;
    const BrakingJoints& joints;
    const Vec before;
    const Settings settings;
    const BrakingStates states;
    Workspace& w;
    const int m, all;
    bool shallow = true, at_rest = true;  // no penetration but by curvature; nothing moves by itself
    double smallest = INFINITY;
    std::vector<Check> checks;
    std::vector<Shape> shapes;
    std::vector<int> placed_in;      // the state of each shape's pose
    std::optional<Kinematics> here;  // of the state
    Vec speeds;                      // (M,) largest joint speeds, weighted by the state's sensitivity

    // Upper bound of a pair's speed of approach in this state.
    double approach_speed(int k) const
    {
        double most = 0;
        for (int e = 0; e < 2; e++) {
            const Shape& shape = shapes[scene.pairs[k].of[e]];
            for (int j = of.between[k].from[e]; j < of.between[k].to[e]; j++) {
                const Twist& s = here->J[j];
                most += speeds[of.coordinate[j]] * (norm(s.v + cross(s.omega, shape.at.p)) + norm(s.omega) * shape.ball);
            }
        }
        return most;
    }
    const Shape& placed(int i, int s)
    {
        if (placed_in[i] != s) {
            const Pose& moved = here->motions[scene.shapes[i].body];
            const double time = states.at[s].time;
            shapes[i] = scene.shapes[i].shape;
            shapes[i].at =
                (time > 0 && moves(of.twists[i]) ? motion(of.twists[i], time, w) * moved : moved) * of.place[i];
            placed_in[i] = s;
        }
        return shapes[i];
    }
    void set_speeds(const BrakingState& state, bool now)
    {
        speeds = Vec(w, all);
        double more = 0;
        for (int j = 0; j < all; j++) {
            const double free = j < m ? std::max(states.free[0][j], states.free[1][j]) : 0;
            speeds[j] = j < m ? (now ? 1 : state.time / settings.dt + 1) * free : std::abs(state.going[j]);
            more += states.grows[j] != 0 ? std::abs(states.grows[j]) * free : 0;
        }
        for (int j = 0; j < m; j++)
            speeds[j] += state.longer[j] != 0 ? std::abs(state.longer[j]) * more : 0;
    }

    // The pairs in a state. A pair too far for any row to matter is skipped: its distance has changed by at most the
    // joint displacements times their levers.
    void check(int s)
    {
        const BrakingState& state = states.at[s];
        const bool last = s + 1 == static_cast<int>(states.at.size()), only_escape = s == 0 && !last;
        set_speeds(state, s == 0);
        Vec since = speeds.copy();
        for (int j = 0; j < all; j++)
            since[j] += settings.alpha * std::abs(state.q[j] - states.at[0].q[j]);
        here.reset();
        for (int k = 0; k < of.pairs(); k++) {
            Check& pair_check = checks[k];
            const bool may_skip = pair_check.at_rest && settings.alpha > 0;
            const double rate = settings.alpha * pair_check.share;
            if (!(pair_check.share > 0) || pair_check.recedes)
                continue;
            if (s > 0 && may_skip && (!last || pair_check.approach == INFINITY)
                && rate * (pair_check.bound - scene.distance) > of.approach_bound(k, since))
                continue;
            if (!here)
                here.emplace(scene.arms, of.coordinate, of.first_joint, state.q);
            const auto& [i, j] = scene.pairs[k].of;
            const Shape &a = placed(i, s), &b = placed(j, s);
            const double bound = distance_bound(a, b),
                         allowed = std::min(rate * (bound - scene.distance), last ? pair_check.approach : INFINITY);
            if (s == 0)
                pair_check.bound = bound;
            double fastest = INFINITY;
            const bool apart = may_skip && bound > scene.distance && (s > 0 || bound > smallest);
            if (apart && only_escape)
                continue;
            if (may_skip) {
                fastest = of.approach_bound(k, speeds);
                const bool out_of_reach = allowed > fastest;
                if (allowed > 0 && !out_of_reach)
                    fastest = std::min(fastest, approach_speed(k));
                if (apart && (s == 0 || last ? allowed > fastest : out_of_reach))
                    continue;
            }
            const Witnesses found = scene.witnesses(i, a, j, b);
            const double nearest = add_rows(s, k, found, std::min(of.memo.kept[k], s > 0 ? least[k] : INFINITY), fastest);
            if (s == 0) {
                least[k] = nearest, pair_check.bound = found.count > 0 ? found.at[0].distance : bound;
                smallest = std::min(smallest, nearest);
            }
        }
    }

    // Adds the rows of a pair in a state, which keeps a distance there and approaches at `fastest` at most. Returns the
    // least distance, inf if no joint changes it. With braking states, the present state has only rows of escape.
    double add_rows(int s, int k, const Witnesses& found, double kept, double fastest)
    {
        Check& pair_check = checks[k];
        const BrakingState& state = states.at[s];
        const bool present = s == 0 && states.at.size() > 1, last = s + 1 == static_cast<int>(states.at.size());
        const double alpha = settings.alpha;
        const Vec speed = joints.speed.part(0, m), brakes = joints.acceleration.part(0, m);
        bool only_escape = present;
        double excess = 0, nearest = INFINITY;  // speed of approach above what braking states allow
        Vec3 out{0, 0, 0};
        for (int f = 0; f < found.count; f++) {
            const Witness& at = found.at[f];
            const double margin = at.distance - kept;
            if (nearest < INFINITY && margin >= 0 && (only_escape || alpha * pair_check.share * margin - excess > fastest))
                break;  // witnesses at this distance or farther need no row
            const Workspace::Frame frame(w);
            const Vec row = gradient(k, at);  // of the distance
            const Vec own = row.part(0, m);
            if (std::all_of(own.begin(), own.end(), [](double x) { return x == 0; }))
                continue;
            const auto& [i, j] = scene.pairs[k].of;
            const double incoming = along(at, of.twists[i]) - along(at, of.twists[j]);  // speed of the obstacle
            const double drift = row.part(m, all).dot(state.going.part(m, all)) - incoming;
            const double longer = own.dot(state.longer.part(0, m));
            Vec C(w, m);
            for (int j = 0; j < m; j++)
                C[j] = state.weight[j] * own[j] + longer * states.grows[j];
            double weighed = 0, square = 0, largest = 0;
            for (int j = 0; j < m; j++) {
                const double scaled = std::abs(C[j]) * finite_or(speed[j], DEFAULT_SPEED);
                weighed += scaled, square += scaled * scaled, largest = std::max(largest, scaled);
            }
            if (!(weighed > 0))
                continue;
            const double braked = C.dot(states.y.part(0, m)), strong = most_of(own, brakes, brakes);
            const bool first = nearest == INFINITY, evades = incoming > 0 && most_of(own, speed, speed) > incoming;
            nearest = std::min(nearest, at.distance);
            if (first && present)
                pair_check.recedes = evades && own.dot(before.part(0, m)) >= 0, only_escape = !pair_check.recedes;
            if (f == 0 || dot(out, out) == 0)
                out = at.normal;
            if (only_escape && margin >= 0)
                continue;
            double allowed = alpha * std::min(margin, pair_check.share * margin);  // speed of approach
            allowed = pair_check.share == 1 || margin < 0 ? allowed + drift : std::min(allowed, alpha * margin + drift);
            if (first && last)
                excess = std::max(allowed - pair_check.approach, 0.0);
            else if (first && s > 0)
                pair_check.approach =
                    std::min(pair_check.approach, std::max(allowed, 0.0) / (state.time / settings.dt + 1));
            const double y = s == 0 ? 0 : braked;  // rows of the present state are on the velocity itself
            double low = margin >= 0 ? y - (allowed - excess)
                                   : y
                                         + std::max(0.0, dot(at.normal, out))
                                               * std::min(-alpha * margin, settings.escape * square / largest)
                                         - drift;
            if (evades && margin > 0 && states.at.size() > 1) {  // joints need time to evade at full acceleration
                const double slower = braking_speed(pair_check.share * margin, BRAKING * strong, settings.dt, alpha) + drift;
                low = std::max(low, std::min(y - slower, braked + most_of(C, states.free[0], states.free[1])));
            }
            if (only_escape || (margin < 0 && drift == 0)) {  // no more than joints certainly can
                const Vec* certain = only_escape ? states.led : states.sure;
                low = std::min(low, braked + most_of(C, certain[0], certain[1]));
            }
            if (!(low > braked - most_of(C, states.free[1], states.free[0])))
                continue;  // satisfied by every velocity
            at_rest = at_rest && drift == 0;
            shallow = shallow && (s > 0 || margin >= -DEEP * scene.distance);
            insert(C, low, (low - braked) / weighed - (f == 0 ? 0 : 1), k);
        }
        return nearest;
    }
    static double along(const Witness& at, const Twist& s)
    {
        return dot(cross(at.point, at.normal), s.omega) + dot(at.normal, s.v);
    }
    // (M,) of the distance at a witness.
    Vec gradient(int k, const Witness& at) const
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
            row[c] = std::abs(row[c]) > CANCELLATION * parts[c] ? row[c] : 0;
        return row;
    }

    // Insert a row among the most urgent, each pair's nearest witness first; of equal rows the stricter one.
    void insert(Vec row, double low, double urgent, int of_pair)
    {
        int at = count, last = 0;
        const double size = row.norm();
        for (int i = 0; i < count; i++) {
            double apart = 0;
            for (int j = 0; j < m; j++)
                apart = std::max(apart, std::abs(C(i, j) - row[j]));
            if (apart <= EQUAL * size) {
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

    // Recovery rows, C z >= wanted > 0 for z about the velocity braked for a tick, lead back what curvature took of the
    // distance. They are lowered to what one velocity achieves that keeps all other rows, unless that gives up more
    // than curvature takes near something that moves by itself.
    void limit_recovery()
    {
        const Vec y = states.y.part(0, m), low = lower.part(0, count), wanted = low - C.rows_from(0, count) * y,
                  z(w, m, 0);
        if (!shallow || std::none_of(wanted.begin(), wanted.end(), [](double a) { return a > 0; }))
            return;
        bool missed = true;
        for (int sweep = 0; sweep < SWEEPS && missed; sweep++) {
            missed = false;
            for (int i = 0; i < count; i++) {
                const double left = wanted[i] - C[i].dot(z);
                missed = missed || left > 0;
                for (int j = 0; left > 0 && j < m; j++)
                    z[j] =
                        clamped(z[j] + REFLECTION * left / C[i].square() * C(i, j), -states.free[0][j], states.free[1][j]);
            }
        }
        const Vec achieved = C.rows_from(0, count) * z;
        double share = 1, given_up = 0;
        for (int i = 0; i < count; i++)
            if (const double least = std::min(wanted[i], 0.0); achieved[i] < least)
                share = std::min(share, least / achieved[i]);
        for (int i = 0; i < count; i++)
            given_up = std::max(given_up, wanted[i] > 0 ? wanted[i] - share * achieved[i] : 0);
        if (!at_rest && given_up > settings.alpha * CURVATURE * scene.distance)
            return;
        for (int i = 0; i < count; i++)
            if (wanted[i] > 0)
                low[i] += std::min(wanted[i], share * achieved[i]) - wanted[i];
    }
};

}  // namespace iq
