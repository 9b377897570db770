// The force law and the tick of a tool in contact, for Python: force_gains, ContactSplit, Hybrid, HybridState.
#include "hybrid.hpp"
#include "loop_module.hpp"
#include <nanobind/stl/tuple.h>
#include <type_traits>

namespace iq {
namespace {

using force::State;
static_assert(std::is_trivially_copyable_v<HybridState>, "a state is copied and pickled as its bytes");

std::tuple<double, double, double> gains_of(double k, double b, double late)
{
    const force::Gains law = force::gains(k, b, late);
    return {law.g, law.tau, law.Ti};
}

force::Settings law_of(const Fields& f)
{
    const auto get = [&](const char* name) { return nb::cast<double>(f[name]); };
    force::Settings s{};
    s.dt = get("dt"), s.noise = get("noise"), s.delay = get("delay"), s.filter_share = get("filter_share"), s.filter_time = get("filter_time");
    s.size = get("size"), s.slope = get("slope"), s.yields = get("yields"), s.stiffness = get("stiffness");
    s.lost_below = get("lost_below"), s.lost_after = get("lost_after"), s.approach_speed = get("approach_speed");
    s.approach_distance = get("approach_distance"), s.approach_time = get("approach_time"), s.retreat_distance = get("retreat_distance");
    s.drift = get("drift"), s.on_loss = static_cast<force::OnLoss>(static_cast<int>(get("on_loss")));
    s.tares = nb::cast<bool>(f["tares"]), s.fault_retreats = nb::cast<bool>(f["fault_retreats"]);
    return s;
}
WrenchSensor sensor_of(nb::dict given, Reader& read)
{
    const Fields f(given, read, 6);
    WrenchSensor s;
    s.mount = f.pose("mount"), s.mass = f.number("mass", 0, LARGEST_NUMBER);
    s.centre = f.point("centre"), s.gravity = f.point("gravity"), s.origin = f.point("origin");
    const std::vector<double> bias = f.numbers("bias");
    std::copy(bias.begin(), bias.end(), s.bias.begin());
    s.is_reaction = f.word("reads") == "reaction";
    s.force_deadband = f.number("force_deadband", 0, LARGEST_NUMBER), s.moment_deadband = f.number("moment_deadband", 0, LARGEST_NUMBER);
    return s;
}
nb::object sensor_load(nb::dict sensor, nb::handle reading, nb::handle tool)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const WrenchSensor s = sensor_of(sensor, read);
    return array_of(vec(s.load(six(read.vector(reading, "reading", 6)), read_pose(tool, "tool", read).R * s.mount.R), w));
}
nb::object sensor_deadband(nb::dict sensor, nb::handle wrench)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    return array_of(vec(sensor_of(sensor, read).deadband(six(read.vector(wrench, "wrench", 6))), w));
}
void make_hybrid(Hybrid* made, nb::dict given)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const Fields f(given, read, 6);
    HybridSettings set;
    set.law = law_of(f);
    if (f.has("sensor"))
        set.sensor = sensor_of(nb::cast<nb::dict>(f["sensor"]), read);
    set.grip = f.point("grip"), set.slide_speed = f.number("slide_speed", 0, INFINITY), set.retreat_speed = f.number("retreat_speed", 0, LARGEST_NUMBER);
    set.edge_margin = f.number("edge_margin", 0, LARGEST_NUMBER);
    if (f.has("normal_within"))
        set.normal_within = f.number("normal_within", 0, M_PI / 4);
    if (f.has("max_force"))
        set.max_force = f.number("max_force", 0, INFINITY);
    if (f.has("max_moment"))
        set.max_moment = f.number("max_moment", 0, INFINITY);
    set.force_first = nb::cast<bool>(f["force_first"]), set.measured_at_contact = nb::cast<bool>(f["measured_at_contact"]);
    new (made) Hybrid{set};
}
void make_split(ContactSplit* made, nb::dict given)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const Fields f(given, read, 6);
    ContactSplit s;
    s.n = static_cast<int>(f.number("n", 0, 6)), s.presses = static_cast<int>(f.number("presses", 0, s.n));
    s.motion = f.matrix("motion", 6, 6), s.force = f.matrix("force", 6, 6), s.constraints = f.matrix("constraints", s.n, 6);
    s.intensities = f.matrix("intensities", s.n, 6), s.unit_parts = f.matrix("unit_parts", s.n, 6);
    s.unit_rates = f.matrix("unit_rates", s.n, 6), s.twist = f.matrix("twist", 6, s.n);
    s.out = f.numbers("out", 6), s.wrench = f.numbers("wrench"), s.origin = f.point("origin");
    s.compliance = f.number("compliance", 0, LARGEST_NUMBER);
    new (made) ContactSplit(s);
}

Vec3 direction(nb::handle value, const char* name, Reader& read)
{
    const Vec v = read.vector(value, name, 3);
    const double most = std::max({std::abs(v[0]), std::abs(v[1]), std::abs(v[2])});
    if (most == 0)
        refuse(std::string(name) + " is zero");
    const Vec3 scaled = vec3(v / most);  // no square overflows or vanishes
    return (1 / norm(scaled)) * scaled;
}
// (4, 4) a contact's own frame: z against the outward normal, x along the projection of a tangent on the surface.
nb::object frame_of(nb::handle point, nb::handle normal, nb::handle tangent)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const Vec p = read.vector(point, "point", 3);
    const Vec3 z = -1 * direction(normal, "normal", read);
    Vec3 along{};
    if (tangent.is_none()) {
        const auto smaller = [](double a, double b) { return std::abs(a) < std::abs(b); };
        along[std::min_element(z.begin(), z.end(), smaller) - z.begin()] = 1;
    } else
        along = direction(tangent, "tangent", read);
    const Vec3 rest = along - dot(z, along) * z;
    if (norm(rest) < 1e-6)
        refuse("tangent is parallel to the normal");
    const Vec3 x = (1 / norm(rest)) * rest, y = cross(z, x);
    const Mat T(w, 4, 4);
    Pose({{{x[0], y[0], z[0]}, {x[1], y[1], z[1]}, {x[2], y[2], z[2]}}}, {p[0], p[1], p[2]}).write(T.p);
    return matrix_or_none(T);
}

// The report beside the loop's; None if there is none.
nb::object report_of(const HybridTick& tick)
{
    if (!tick.has_report)
        return nb::none();
    const force::Output& law = tick.law;
    return nb::make_tuple(static_cast<int>(law.action), static_cast<int>(law.fault), law.lost, law.warnings, law.delay, tick.desired,
                          tick.reported_scale, tick.unreachable, tick.motion_gain);
}
Vec optional(nb::handle value, const char* name, int n, Reader& read) { return value.is_none() ? Vec() : read.vector(value, name, n); }

// The loop's solution, joint twists, and the rest, None if joint positions cannot be true; or the angle of a normal that turned [rad].
nb::object tick_of(const Hybrid& hybrid, HybridState& state, const Loop& loop, LoopState& joints, const ContactSplit& split, nb::handle contact,
                   double edge, nb::handle q, nb::handle target, nb::handle reading, bool force_first, nb::handle feedforward, nb::handle velocity,
                   nb::handle wrench, nb::handle posture, nb::handle functions)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const int m = loop.settings.joints;
    HybridInputs in;
    in.q = read.vector(q, "q", m), in.reading = read.vector(reading, "wrench", 6);
    if (force_first)
        std::rotate(in.reading.begin(), in.reading.begin() + 3, in.reading.end());
    in.velocity = optional(velocity, "velocity", m, read), in.target = read_pose(target, "target", read);
    in.feedforward = optional(feedforward, "feedforward", 6, read), in.wrench = optional(wrench, "wanted", 6, read);
    in.posture = optional(posture, "posture", m, read), in.contact = Pose(read.matrix(contact, "contact", 4, 4).p), in.edge = edge;
    const LoopFunctions calls = loop_functions(functions, read, m, w);
    try {
        calls.begin(in.q);
        const HybridTick tick = hybrid.tick(state, loop, joints, split, in, calls, w);
        if (tick.normal_turned > 0)
            return nb::float_(tick.normal_turned);
        const nb::object found = loop_solution(tick.loop, calls, !functions.is_none()), J = matrix_or_none(tick.J);
        if (!tick.is_plausible)
            return nb::make_tuple(found, J, nb::none(), nb::none(), nb::none());
        const Mat pose(w, 4, 4);
        tick.contact.write(pose.p);
        return nb::make_tuple(found, J, nb::make_tuple(array_of(tick.motion), array_of(tick.force), array_of(tick.wrench), array_of(tick.error),
                              array_of(tick.intensities), array_of(tick.W_d)),
                              hybrid.settings.normal_within > 0 ? matrix_or_none(pose) : nb::none(), report_of(tick));
    } catch (const FarTarget&) {
        refuse("target is too far away");
    } catch (const NoProjector&) {
        PyErr_SetString(PyExc_ArithmeticError, "form has no projector here");
        throw nb::python_error();
    }
}

}  // namespace

void bind_force(nb::module_& m)
{
    m.def("force_gains", gains_of, "k"_a, "b"_a, "late"_a, "g, tau, Ti of the force law.");
    m.def("sensor_load", sensor_load, "sensor"_a, "reading"_a, "tool"_a, "(6,) the wrench that the tool exerts, in the sensor's frame.");
    m.def("sensor_deadband", sensor_deadband, "sensor"_a, "wrench"_a, "(6,) a wrench in the sensor's frame after the deadbands.");
    m.def("contact_frame", frame_of, "point"_a.none(), "normal"_a.none(), "tangent"_a.none(),
          "(4, 4) z against the outward normal, x along the projection of a tangent on the surface.");
    const auto get = [](auto part, auto field) { return [=](const State& s) { return s.*part.*field; }; };
    nb::class_<State>(m, "ForceState", "What the force law and its monitor remember between two ticks.")
        .def_prop_ro("tare_age", get(&State::tare, &force::Tare::age), "Time since the bias was measured [s].")
        .def_prop_ro("noise", get(&State::noise, &force::NoiseEstimate::sigma), "Measured standard deviation of a force component, 0 if not above the declared one [force].")
        .def_prop_ro("lag", get(&State::arm, &force::LagEstimate::lag), "Measured lag of the joints, NaN before it is known [s].")
        .def_ro("time_at_rest", &State::time_at_rest, "Time since the last motion along the contact [s].")
        .def_prop_ro("gain_scale", get(&State::oscillation, &force::OscillationMonitor::gain_scale), "Of the force gain, below 1 after an oscillation.")
        .def_prop_ro("mean", get(&State::oscillation, &force::OscillationMonitor::mean), "Of the press, or of the missing load as a share of an overload.")
        .def_prop_ro("time_off", get(&State::oscillation, &force::OscillationMonitor::time_off), "Time since the mean was within the tolerance [s].")
        .def_prop_ro("desired", get(&State::oscillation, &force::OscillationMonitor::desired), "Desired press of the last tick [force].")
        .def_prop_ro("airborne", [](const State& s) {
            double most = 0;
            for (int i = 0; i < s.presses; i++)
                most = std::max(most, s.parts[i].contact.airborne);
            return most;
        }, "Time since contact was certain [s].")
        .def_prop_ro("touching", &State::touching, "Whether every press is felt.")
        .def_prop_ro("unexplained_force", [](const State& s) { return s.parts[0].check.unexplained_force; }, "Force that the displacement should have changed.")
        .def_prop_ro("numbers", [](const State& s) { return nb::make_tuple(s.stop.numbers[0], s.stop.numbers[1], s.stop.numbers[2], s.stop.numbers[3]); },
                     "Of the fault's message.")
        .def("stiffness", [](const State& s, int i) { return s.parts[std::clamp(i, 0, 5)].estimate.known(); }, "i"_a = 0)
        .def("bounds", [](const State& s, int i) {
            const force::StiffnessEstimate& e = s.parts[std::clamp(i, 0, 5)].estimate;
            return nb::make_tuple(e.bound, e.damping(), static_cast<double>(e.best), e.lower());
        }, "i"_a = 0, "Upper bounds of stiffness and damping, index of the displacement that explains the force, lower bound of stiffness.");
    nb::class_<HybridState>(m, "HybridState", "What a tool in contact remembers between two ticks; a value.")
        .def(nb::init<>())
        .def("__copy__", [](const HybridState& s) { return HybridState(s); })
        .def("__deepcopy__", [](const HybridState& s, nb::object) { return HybridState(s); }, "memo"_a)
        .def("__getstate__", [](const HybridState& s) { return nb::make_tuple(nb::bytes(reinterpret_cast<const char*>(&s), sizeof s)); })
        .def("__setstate__", [](HybridState& s, const std::tuple<nb::bytes>& given) {
            if (std::get<0>(given).size() != sizeof s)
                refuse("this is no state of a tool in contact");
            new (&s) HybridState();
            std::memcpy(static_cast<void*>(&s), std::get<0>(given).c_str(), sizeof s);
        })
        .def_ro("law", &HybridState::law)
        .def_ro("acceleration_share", &HybridState::acceleration_share, "Of the joints, that noise of the force leaves to the motion.")
        .def_ro("gain", &HybridState::gain, "Largest of the force law [length/s per force].")
        .def_ro("fault_in_air", &HybridState::fault_in_air, "Whether the fault was there before the first contact.")
        .def_prop_ro("normal_bound", [](const HybridState& s) { return s.normal.bound; }, "That limits the estimated normal [rad], else 0.");
    nb::class_<ContactSplit>(m, "ContactSplit", "The split of a kind of contact.").def("__init__", make_split, "fields"_a);
    nb::class_<Hybrid>(m, "Hybrid", "The tick of a tool in contact; its settings never change.")
        .def("__init__", make_hybrid, "settings"_a)
        .def("tick", tick_of, "state"_a, "loop"_a, "joints"_a, "split"_a, "contact"_a, "edge"_a, "q"_a.none(), "target"_a.none(), "reading"_a.none(), "force_first"_a,
             "feedforward"_a.none(), "velocity"_a.none(), "wrench"_a.none(), "posture"_a.none(), "functions"_a.none());
}

}  // namespace iq
