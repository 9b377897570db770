// The links of an arm keep a distance from each other and from obstacles; control/clearance.py explains the law.
//
//     C x >= -alpha (d - d_min) - n'v_obstacle        C = w'J on the joints between two bodies,  w = (p x n; n)
//
// In a loop, each tick calls begin, rows and, with the velocity found, after.
#pragma once
#include "braking_states.hpp"
#include "distance.hpp"
#include <functional>
#include <memory>
#include <optional>

namespace iq {

constexpr int MOST_CLEARANCE_ROWS = 16;  // of a tick: more than an arm has joints, several times over

// An arm, or one around it. (m,) of its coordinates, units SI; acceleration inf where a joint stops at once.
struct ClearanceArm {
    Chain chain;                                            // its k joints, each as if it had its own coordinate
    std::vector<int> coordinates;                           // (k,) the coordinate of each
    std::vector<double> speed, acceleration, lower, upper;  // limits; acceleration 0 of an arm that goes on as it goes
    std::vector<double> turns;                              // whole turns of continuous joints, 0 of others
    bool brakes = false;                                    // whether this other arm makes way too

    int size() const { return static_cast<int>(speed.size()); }
};
struct ClearanceShape {
    int body;     // the joint that moves it, counted from 1 over all arms; 0 is the base
    int mover;    // -1 of the arm; which obstacle it is; or, counted on from these, of which other arm
    Shape shape;  // where it is at q = 0; of an obstacle, in the frame that `move` moves
};
struct ClearancePair {
    int of[2];   // two shapes, the first of the arm
    int bodies;  // which pair of bodies they belong to
};
// What of a clearance never changes.
struct ClearanceScene {
    double distance;                 // d_min
    std::vector<ClearanceArm> arms;  // the arm itself is the first
    std::vector<ClearanceShape> shapes;
    std::vector<ClearancePair> pairs;
    int obstacles = 0;    // how many are moved by `move`
    bool chosen = false;  // whether somebody chose the pairs: none is left out then
    // Places of shapes i and j of which one is a mesh.
    std::function<void(int i, const Shape&, int j, const Shape&, Places&)> meshes;
};

// How an arm may come nearer in a loop; (m,) limits of its joints.
struct ClearanceRate {
    std::vector<double> speed, acceleration, lower, upper;
    double alpha, dt, joint_rate, delay;  // [1/s]; a tick [s]; of position limits [1/s]; dead time [s]

    bool stops_at_once() const
    {
        return std::all_of(acceleration.begin(), acceleration.end(), [](double a) { return std::isinf(a); });
    }
};

// lower <= C x <= upper; `pair` says which pair each row is of, -1 of one that slows a joint while bodies are too near.
struct ClearanceRows {
    Mat C;
    Vec lower, upper;
    std::vector<int> pair;
};

class Clearance {
  public:
    explicit Clearance(ClearanceScene);

    // Where an obstacle's frame is, or another arm, from now on; its twist (6,) or velocity, nullptr where its last two
    // places say that.
    void move(int obstacle, const Pose& place, const double* twist);
    void move_arm(int arm, const double* q, const double* velocity);
    // Before the first tick, what was moved is where it has always been.
    void start();

    // A tick of a loop begins at q (m,); the last one began at a time [s], none before the first. When this one begins
    // [s].
    double begin(std::optional<double> last, Vec q, const ClearanceRate& rate);
    // The rows at q (m,) when the command acts, after a velocity `before` (m,).
    ClearanceRows rows(Vec q, Vec before, const ClearanceRate& rate);
    // Rows about the velocity x of a tick from there on that ends too near; none where it does not.
    ClearanceRows after(Vec q, Vec x, const ClearanceRate& rate);
    // (k,) of the pairs, of what some joint moves; infinite where none does, or where the pair is always near.
    std::vector<double> distances(Vec q);
    // Where all shapes are.
    std::vector<Pose> placed(Vec q);

    // Of the last call of `rows`: distances of pairs, infinite of those neither nearest nor near; and the nearest pair.
    const std::vector<double>& found() const { return now.distances; }
    int nearest() const;
    // Whether the last `begin` was the first of a loop.
    bool begun() const { return begins; }
    // Bodies below this distance are too near: curvature and rounding may take as much of it.
    double enough() const;
    // Whether a pair is nearer than the distance wherever the joints between its shapes are; it does not count then.
    bool always_near(int pair) const { return now.off[pair]; }
    int pairs() const { return static_cast<int>(scene.pairs.size()); }
    const ClearanceScene& of() const { return scene; }
    // (K,) how far any point of a shape moves at most for a unit of each joint's coordinate.
    const double* lever(int shape) const { return &levers[static_cast<std::size_t>(shape) * coordinate.size()]; }
    Twist twist(int obstacle) const;

    // What is remembered from tick to tick, as numbers, to copy and to store.
    std::vector<double> memory() const;
    void remember(const std::vector<double>& numbers);

  private:
    // What moves by itself: an obstacle's frame, 16 numbers of a pose and a twist; or an arm's joints.
    struct Mover {
        std::vector<double> place, speed;    // where it is, and how fast where that is declared
        bool declared = true, fresh = true;  // whether it was moved since the last tick
        std::vector<double> last, found;     // where it was in the last tick, and how fast by then
        double at = -INFINITY, between = 0;  // when that was, and how long after the place before

        const std::vector<double>& velocity() const { return declared ? speed : found; }
        void observe(double time, double alpha, const std::vector<double>& turns);
        template <class F> void each(F f)
        {
            f(place), f(speed), f(declared), f(fresh), f(last), f(found), f(at), f(between);
        }
    };
    struct Memory {
        double time = 0;                             // of all loops whose limit this is [s], by the ticks
        std::vector<double> kept, distances, began;  // (k,) what each pair keeps; what was found; q of a first tick
        std::vector<char> off, judged;               // (k,) whether a pair is always near; whether that was looked at
        std::vector<Mover> movers;                   // obstacles, then other arms

        template <class F> void each(F f)
        {
            f(time), f(kept), f(distances), f(began), f(off), f(judged);
            for (Mover& mover : movers)
                mover.each(f);
        }
    };
    struct Between {
        int from[2], to[2];  // the joints that move each shape of a pair alone
    };
    ClearanceScene scene;
    int m, all = 0;                     // coordinates of the arm, of all arms
    std::vector<int> arm_of, first_of;  // (M,) which arm a coordinate is of; (arms,) its first coordinate
    std::vector<int> coordinate, first_joint;  // (K,) of the joints of all arms; (arms,) its first joint
    std::vector<Between> between;       // (k,)
    std::vector<double> levers;         // (n, K)
    Memory now;
    bool begins = false;
    std::vector<Pose> place;                 // (n,) of shapes at q = 0, obstacles where they are when a command acts
    std::vector<Twist> twists;               // (n,) of shapes by themselves
    std::vector<std::vector<double>> shift;  // of obstacles, by how much they will have moved by then

    friend class ClearanceSearch;
    void set_levers(int shape, const std::vector<Twist>& screws);
    void renew(int mover);
    void place_all(double delay);
    double share(int pair) const;
    std::vector<double> shares() const;
    double nearer(int pair, Vec turned) const;
    Vec around(Vec own, double delay, Vec* velocity) const;
    std::vector<double> distances_at(Vec q);
    void keep(const std::vector<double>& distances, bool first);
    void hold_back(ClearanceRows& rows, double lacks, Vec before, const ClearanceRate& rate) const;
    bool judge(const std::vector<double>& distances);
    bool shows_always_near(int pair, Workspace& w) const;
};

// A clearance in one loop, at the rate of that loop.
struct ClearanceInLoop {
    std::shared_ptr<Clearance> clearance;
    ClearanceRate rate;
    std::function<void(Vec q)> begun;  // called with q (m,) in the first tick of a loop
    std::optional<double> last;        // when its last tick began [s]

    void begin(Vec q)
    {
        const double time = clearance->begin(last, q, rate);
        if (clearance->begun())
            begun(q);
        last = time;
    }
    ClearanceRows rows(Vec q, Vec before) { return clearance->rows(q, before, rate); }
    // None for joints with acceleration limits: they stay so near the last velocity that rows about that one are enough.
    ClearanceRows after(Vec q, Vec x) { return rate.stops_at_once() ? clearance->after(q, x, rate) : ClearanceRows(); }
};

}  // namespace iq
