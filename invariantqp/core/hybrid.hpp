// A tick of a tool in contact: motion along the freedoms of the contact, force against its constraints.
//
//     s = P (gain log(T_target T^-1) + feedforward) + Z rates,     velocity = law(J, s, limits)
//
// P projects on the freedoms and Z spans the complement (force/contact.py); the rates are the force law's (force.hpp). Twists
// (omega; v) and wrenches (m; f) are in the base frame unless the frame of the contact is named; wrenches are those that the
// tool exerts. Reference: [DS] Sect. 6.3.
#pragma once
#include "force.hpp"
#include "loop.hpp"

namespace iq {

// The projectors of a task for one kind of contact with n constraints, in the frame of the contact.
struct ContactSplit {
    int n = 0, presses = 0;
    std::vector<double> motion, force;  // (6, 6) P and P*
    std::vector<double> constraints;    // (n, 6) W'
    std::vector<double> intensities;    // (n, 6) from a wrench to its parts in the constraints
    std::vector<double> unit_parts;     // (n, 6) from a wrench to its unit parts
    std::vector<double> unit_rates;     // (n, 6) from a twist to its unit rates
    std::vector<double> twist;          // (6, n) from unit rates to the twist in Z
    std::vector<double> out;            // (6,) unit twist that leaves the contact; empty if none does
    std::vector<double> wrench;         // (6,) that the task exerts
    Vec3 origin{};                      // the place of contact
    double compliance = 0;              // [length/s per force], 0 if not declared
};

using Six = std::array<double, 6>;
inline Six six(Vec v)
{
    Six found;
    std::copy(v.begin(), v.end(), found.begin());
    return found;
}
inline Vec vec(const Six& a, Workspace& w)
{
    Vec v(w, 6);
    std::copy(a.begin(), a.end(), v.p);
    return v;
}

struct WrenchSensor {
    Pose mount;  // of its frame in the tool frame
    double mass = 0;
    Vec3 centre{}, gravity{}, origin{};  // gravity in the base frame; the moment deadband is about the origin
    Six bias{};
    bool is_reaction = true;
    double force_deadband = 0, moment_deadband = 0;

    // The wrench that the tool exerts, in the sensor's frame, which is turned by R in the base: the reading without bias and weight.
    Six load(const Six& reading, const Mat3& R) const;
    // Force and moment shortened by the deadbands.
    Six deadband(const Six& wrench) const;
};

struct HybridSettings {
    force::Settings law;
    std::optional<WrenchSensor> sensor;
    Vec3 grip{};                                         // in the tool frame
    double slide_speed = INFINITY, retreat_speed = 0;    // [length/s]
    double normal_within = 0, edge_margin = 0;           // [rad], 0: no correction; [length]
    double max_force = NAN, max_moment = NAN;            // NaN: from the desired wrench
    bool force_first = true, measured_at_contact = true;
};

// The normal of a surface, estimated from how the tool moves while it presses:
//
//     n . w = -(change of the press) / k          for every displacement w along a surface with normal n and stiffness k
//     t = argmin sum (n0 . w + t . w + change / k)^2 + STEP^2/4 |t|^2,     t . n0 = 0,     n = (n0 + t) / |n0 + t|
//
// n0 is the declared normal. A tilt across the displacements is not observable and stays as declared. The direction of the
// force is not used: friction turns it. Displacements are cut into pieces of a STEP along the surface, and the last MEMORY of
// them count, so that nothing is forgotten at rest. Reference: Yoshikawa & Sudou 1993.
struct NormalEstimate {
    Vec3 tilt{};         // t, not longer than the bound allows
    Vec3 displacement{};  // of this piece [length]
    double press = NAN;  // at its start
    Mat3 squares{};      // sum of w w'
    Vec3 rises{};        // sum of w (n0 . w + change / k)
    double bound = 0;    // that limits t [rad], else 0
};

// A value: trivially copyable, pickled as its bytes.
struct HybridState {
    force::State law;
    bool has_ticked = false;
    Pose tool;               // in the last tick
    bool was_touching = false;
    Vec3 outward{};          // the outward direction in the last tick, while it touches
    Six motion{};            // along the contact in the last tick
    NormalEstimate normal;
    bool is_beyond_edge = false;
    Vec3 edge_point{};       // where the tool left the surface,
    double lift = 0;         // and how far it moved outwards since
    double gain = 0;         // largest of the force law [length/s per force]
    double acceleration_share = 1;  // of the joints, that noise leaves to the motion
    bool fault_in_air = false;      // whether the fault was there before the first contact
};

struct HybridInputs {
    Vec q;
    Pose target;
    Vec reading;               // (6,) moment first
    Vec feedforward, velocity, posture;  // absent as in TickInputs
    Vec wrench;                // (6,) desired, in the frame of the contact; absent is the task's
    Pose contact;
    double edge = NAN;         // distance to the edge of the surface, negative beyond it; NaN where there is none
};

struct HybridTick {
    LoopReport loop;
    Mat J;
    bool is_plausible = true;  // whether the joint positions can be true; otherwise nothing below is known
    double normal_turned = 0;  // by how much the normal turned since the last tick, if by more than a right angle [rad]
    Pose contact;              // with the estimated normal
    Vec motion, force;         // (6,) twists
    Vec wrench, error, W_d;    // (6,) measured, P*(W_d - W), desired
    Vec intensities;           // (n,) parts of the measured wrench in the constraints
    force::Output law;
    double desired = 0;        // the first unit part of the desired wrench
    double gain_scale = 1;     // of the force gain, lowered for noise,
    double reported_scale = 1; // and the same if it is low enough to be reported, else 1
    double unreachable = 0;    // share of the motion that fewer than six joints turn into a press
    double motion_gain = 0;    // [1/s]
    bool has_report = false;   // whether there is more to report than the loop reports
};

class Hybrid {
  public:
    HybridSettings settings;

    // One tick; updates both states. Throws as Loop::tick does, with the states unchanged. With `normal_turned` nothing was computed.
    HybridTick tick(HybridState& state, const Loop& loop, LoopState& joints, const ContactSplit& split, const HybridInputs& in,
                    const LoopFunctions& functions, Workspace& w) const;
};

}  // namespace iq
