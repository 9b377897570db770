// Clearance of an arm's links from each other and from obstacles; control/clearance.py explains the law.
//
//     C x >= -alpha (d - d_min) - n'v_obstacle        C = w'J on the joints between two bodies,  w = (p x n; n)
//
// In a loop, each tick calls begin, rows and, with the solution, after.
#pragma once
#include "braking_states.hpp"
#include "distance.hpp"
#include <functional>
#include <memory>
#include <optional>

namespace iq {

constexpr int MOST_CLEARANCE_ROWS = 16;  // per tick; more than twice the joints of usual arms

// An arm: the arm itself or another one. (m,) by coordinate, SI units.
struct ClearanceArm {
    Chain chain;                                            // its k joints, as if each had its own coordinate
    std::vector<int> coordinates;                           // (k,) the coordinate of each joint
    std::vector<double> speed, acceleration, lower, upper;  // limits; acceleration inf: stops at once, 0: keeps its velocity
    std::vector<double> turns;                              // period of continuous joints, 0 of others
    bool brakes = false;                                    // whether this other arm avoids the arm itself

    int size() const { return static_cast<int>(speed.size()); }
};
struct ClearanceShape {
    int body;     // the joint that moves it, counted from 1 over all arms; 0 for the base
    int mover;    // -1 for a link of the arm; the obstacle's index; obstacles + index for a link of another arm
    Shape shape;  // pose at q = 0; of an obstacle, in the frame that `move` moves
};
struct ClearancePair {
    int of[2];   // two shapes, the first of the arm
    int bodies;  // index of their pair of bodies
};
// The constant data of a clearance.
struct ClearanceScene {
    double distance;                 // d_min
    std::vector<ClearanceArm> arms;  // the arm itself first
    std::vector<ClearanceShape> shapes;
    std::vector<ClearancePair> pairs;
    int obstacles = 0;      // number of obstacles moved by `move`
    bool keep_all = false;  // whether pairs that are always near are kept
    // Witnesses of shapes i and j, one of which is a mesh.
    std::function<void(int i, const Shape&, int j, const Shape&, Witnesses&)> meshes;

    Witnesses witnesses(int i, const Shape& a, int j, const Shape& b) const
    {
        if (a.core != ShapeCore::mesh && b.core != ShapeCore::mesh)
            return iq::witnesses(a, b);
        Witnesses found;
        meshes(i, a, j, b, found);
        return found;
    }
};

// The rate at which bodies may approach in a loop, and (m,) limits of the joints there.
struct ClearanceRate {
    std::vector<double> speed, acceleration, lower, upper;
    double alpha, dt, joint_rate, delay;  // [1/s]; tick [s]; rate of position limits [1/s]; dead time [s]

    bool stops_at_once() const
    {
        return std::all_of(acceleration.begin(), acceleration.end(), [](double a) { return std::isinf(a); });
    }
};

// lower <= C x <= upper, and the pair of each row; -1 for a row that limits a joint's speed while bodies are too near.
struct ClearanceRows {
    Mat C;
    Vec lower, upper;
    std::vector<int> pair;
};

class Clearance {
  public:
    explicit Clearance(ClearanceScene);

    // Set the pose of an obstacle's frame or the joints of another arm, with a twist (6,) or velocity; nullptr: these are
    // estimated from the last two poses.
    void move(int obstacle, const Pose& pose, const double* twist);
    void move_arm(int arm, const double* q, const double* velocity);
    // Before the first tick: whatever was moved has been at rest.
    void start();

    // Begin a tick at q (m,); `last` is the time of the loop's last tick [s], none in its first. The time of this tick.
    double begin(std::optional<double> last, Vec q, const ClearanceRate& rate);
    // The rows at q (m,) when the command acts, after a velocity `before` (m,).
    ClearanceRows rows(Vec q, Vec before, const ClearanceRate& rate);
    // Rows about the velocity x of a tick from q if it ends too near, else none.
    ClearanceRows after(Vec q, Vec x, const ClearanceRate& rate);
    // (k,) distances of the pairs; inf if no joint moves them, or if the pair is always near.
    std::vector<double> distances(Vec q);
    // (n,) poses of the shapes.
    std::vector<Pose> poses(Vec q);

    // Of the last call of `rows`: (k,) distances, inf of pairs neither nearest nor near; and the nearest pair.
    const std::vector<double>& last_distances() const { return memo.distances; }
    int nearest() const;
    // Whether the last `begin` was the first of a loop.
    bool is_first_tick() const { return first_tick; }
    // The distance below which bodies are reported too near, after curvature and rounding.
    double threshold() const;
    // Whether a pair is nearer than the distance for all positions of the joints between; it is not checked then.
    bool always_near(int pair) const { return memo.always_near[pair]; }
    int pairs() const { return static_cast<int>(scene.pairs.size()); }
    const ClearanceScene& of() const { return scene; }
    // (K,) largest speed of any point of a shape for unit speed of each joint.
    const double* lever(int shape) const { return &levers[static_cast<std::size_t>(shape) * coordinate.size()]; }
    Twist twist(int obstacle) const;

    // The state between ticks as numbers, to copy and to store.
    std::vector<double> memory() const;
    void remember(const std::vector<double>& numbers);

  private:
    // An obstacle's frame, 16 numbers of a pose and a twist, or the joints of another arm.
    struct Mover {
        std::vector<double> position, declared;     // as given to `move`
        bool has_velocity = true, has_moved = true;  // since the last tick
        std::vector<double> last, estimated;        // position in the last tick, and velocity estimate
        double time = -INFINITY, interval = 0;      // of the estimate; between its two positions [s]

        const std::vector<double>& velocity() const { return has_velocity ? declared : estimated; }
        void estimate(double now, double alpha, const std::vector<double>& turns);
        template <class F> void each(F f)
        {
            f(position), f(declared), f(has_velocity), f(has_moved), f(last), f(estimated), f(time), f(interval);
        }
    };
    struct Memory {
        double time = 0;                         // of all loops with this clearance [s], counted in ticks
        std::vector<double> kept, distances;     // (k,) distance that each pair keeps; distance in the last tick
        std::vector<double> first_q;             // (m,) of the last first tick
        std::vector<char> always_near, tested;   // (k,) whether a pair is always near; whether that was tested
        std::vector<Mover> movers;               // obstacles, then other arms

        template <class F> void each(F f)
        {
            f(time), f(kept), f(distances), f(first_q), f(always_near), f(tested);
            for (Mover& mover : movers)
                mover.each(f);
        }
    };
    struct Between {
        int from[2], to[2];  // joints that move only one shape of a pair
    };
    ClearanceScene scene;
    int m, all = 0;                            // coordinates of the arm, of all arms
    std::vector<int> arm_of, first_of;         // (M,) the arm of a coordinate; (arms,) its first coordinate
    std::vector<int> coordinate, first_joint;  // (K,) of the joints of all arms; (arms,) its first joint
    std::vector<Between> between;              // (k,)
    std::vector<double> levers;                // (n, K)
    Memory memo;
    bool first_tick = false;
    std::vector<Pose> place;                 // (n,) of shapes at q = 0, of obstacles when a command acts
    std::vector<Twist> twists;               // (n,) of shapes by themselves
    std::vector<std::vector<double>> shift;  // displacement of obstacles until then

    friend class ClearanceSearch;
    void set_levers(int shape, const std::vector<Twist>& screws);
    void retest(int mover);
    void predict_obstacles(double delay);
    double margin_share(int pair) const;
    std::vector<double> margin_shares() const;
    double approach_bound(int pair, Vec turned) const;
    Vec predict_joints(Vec own, double delay, Vec* velocity) const;
    std::vector<double> distances_at(Vec q);
    void update_kept(const std::vector<double>& distances, bool first);
    void limit_speed(ClearanceRows& rows, double deficit, Vec before, const ClearanceRate& rate) const;
    bool drop_always_near(const std::vector<double>& distances);
    bool is_always_near(int pair, Workspace& w) const;
};

// A clearance in one loop, at the rate of that loop.
struct ClearanceInLoop {
    std::shared_ptr<Clearance> clearance;
    ClearanceRate rate;
    std::function<void(Vec q)> on_first_tick;
    std::optional<double> last;  // time of its last tick [s]

    void begin(Vec q)
    {
        const double time = clearance->begin(last, q, rate);
        if (clearance->is_first_tick())
            on_first_tick(q);
        last = time;
    }
    ClearanceRows rows(Vec q, Vec before) { return clearance->rows(q, before, rate); }
    // None for joints with acceleration limits: rows about the last velocity are enough for them.
    ClearanceRows after(Vec q, Vec x) { return rate.stops_at_once() ? clearance->after(q, x, rate) : ClearanceRows(); }
};

}  // namespace iq
