// The force law and a press in a loop, for Python: force_gains, force_margins, ForceState and Press.
#include "bound.hpp"
#include "force.hpp"
#include <cstring>
#include <nanobind/stl/tuple.h>
#include <type_traits>

namespace iq {
namespace {

using force::State;
static_assert(std::is_trivially_copyable_v<State>, "a state is copied and pickled as its bytes");

std::tuple<double, double, double> gains_of(double k, double b, double late)
{
    const force::Gains law = force::gains(k, b, late);
    return {law.g, law.tau, law.Ti};
}
std::tuple<double, double, double> margins_of(double g, double tau, double Ti, double k, double b, double late)
{
    const force::Margins found = force::margins({g, tau, Ti}, k, b, late);
    return {found.gain, found.phase, found.sensitivity};
}

// Numbers of an argument, which may be fewer than there is room for.
template <std::size_t N> std::array<double, N> numbers(nb::handle value, const char* name, int count, Reader& read)
{
    std::array<double, N> found{};
    if (count > static_cast<int>(N))
        refuse(std::string(name) + " has too many numbers");
    const Vec v = read.vector(value, name, count, Numbers::any);
    std::copy(v.begin(), v.end(), found.begin());
    return found;
}

force::Settings settings_of(nb::dict given)
{
    const auto get = [&](const char* name) { return nb::cast<double>(given[name]); };
    force::Settings s{};
    s.dt = get("dt"), s.noise = get("noise"), s.delay = get("delay"), s.filter_share = get("filter_share"), s.filter_time = get("filter_time");
    s.size = get("size"), s.slope = get("slope"), s.yields = get("yields"), s.stiffness = get("stiffness");
    s.lost_below = get("lost_below"), s.lost_after = get("lost_after"), s.approach_speed = get("approach_speed");
    s.approach_distance = get("approach_distance"), s.approach_time = get("approach_time"), s.retreat_distance = get("retreat_distance");
    s.drift = get("drift"), s.on_loss = static_cast<force::Loss>(static_cast<int>(get("on_loss")));
    s.tares = nb::cast<bool>(given["tares"]), s.fault_retreats = nb::cast<bool>(given["fault_retreats"]);
    return s;
}

nb::tuple read_load(const force::Settings& s, State& state, nb::object load)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    std::array<double, 6> raw, smooth;
    force::read(state, s, numbers<6>(load, "load", 6, read), raw, smooth);
    return nb::make_tuple(array_of(Vec(raw.data(), 6, &w)), array_of(Vec(smooth.data(), 6, &w)));
}

nb::tuple tick_of(const force::Settings& s, State& state, int n, int presses, nb::object wanted, nb::object parts, nb::object press_wanted,
                  nb::object press, nb::object done, nb::object reading, nb::object load, nb::object along, nb::object felt, nb::object most,
                  double together, double missing, double noise_share, double came, double across, double compliance, bool beyond, bool yields, double along_given, double along_done)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    if (n < 0 || n > force::MOST || presses < 0 || presses > n)
        refuse("n and presses are those of no contact");
    force::Inputs in{n, presses};
    in.wanted = numbers<6>(wanted, "wanted", n, read), in.force = numbers<6>(parts, "force", n, read);
    in.press_wanted = numbers<6>(press_wanted, "press_wanted", presses, read), in.press = numbers<6>(press, "press", presses, read);
    in.done = numbers<6>(done, "done", n, read), in.reading = numbers<6>(reading, "reading", 6, read);
    in.load = numbers<6>(load, "load", 6, read), in.along = numbers<6>(along, "along", 6, read);
    in.felt = numbers<2>(felt, "felt", 2, read), in.most = numbers<2>(most, "most", 2, read);
    in.together = together, in.missing = missing, in.noise_share = noise_share, in.came = came, in.across = across, in.compliance = compliance;
    in.beyond = beyond, in.yields = yields, in.along_given = along_given, in.along_done = along_done;
    force::Output out = force::tick(state, s, in);
    return nb::make_tuple(array_of(Vec(out.rates.data(), n, &w)), static_cast<int>(out.action), static_cast<int>(out.reason), out.lost,
                          out.acts, out.doubts, out.late, out.gain);
}

void commanded_of(const force::Settings& s, State& state, nb::object given, double outwards, bool free, bool beyond)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    force::commanded(state, s, numbers<6>(given, "given", state.n < 0 ? 0 : state.n, read), outwards, free, beyond);
}

}  // namespace

void bind_force(nb::module_& m)
{
    m.def("force_gains", gains_of, "k"_a, "b"_a, "late"_a, "g, tau, Ti of the force law.");
    m.def("force_margins", margins_of, "g"_a, "tau"_a, "Ti"_a, "k"_a, "b"_a, "late"_a,
          "Gain margin, phase margin [rad], largest sensitivity.");
    nb::class_<State>(m, "ForceState", "What a press remembers between two ticks; a value.")
        .def(nb::init<>())
        .def("__copy__", [](const State& s) { return State(s); })
        .def("__deepcopy__", [](const State& s, nb::object) { return State(s); }, "memo"_a)
        .def("__getstate__", [](const State& s) { return nb::make_tuple(nb::bytes(reinterpret_cast<const char*>(&s), sizeof(State))); })
        .def("__setstate__", [](State& s, const std::tuple<nb::bytes>& given) {
            if (std::get<0>(given).size() != sizeof(State))
                refuse("this is no state of a press");
            new (&s) State();
            std::memcpy(static_cast<void*>(&s), std::get<0>(given).c_str(), sizeof(State));
        })
        .def_ro("tared", &State::tared, "Whether the bias was read in the air.")
        .def_ro("in_contact", &State::in_contact, "Whether the tool was in contact at the start.")
        .def_ro("age", &State::age, "Time since the bias was read [s].")
        .def_ro("noise", &State::noise, "Of a force component, where more than declared, else 0 [force].")
        .def_ro("lag", &State::lag, "Of the arm, NaN before it is measured [s].")
        .def_ro("along", &State::along, "Speed along the contact, the highest of the last time [length/s].")
        .def_ro("still", &State::still, "For how long it has not been moved along the contact [s].")
        .def_ro("eased", &State::eased, "Share of the gain, less than 1 after swings.")
        .def_ro("mean", &State::mean, "Of the press, or of what is missing as a share of an overload.")
        .def_ro("missed", &State::missed, "For how long the force has been off [s].")
        .def_ro("wanted", &State::wanted, "Press that was wanted last [force].")
        .def_ro("left", &State::left, "Way of a retreat until now [length].")
        .def_ro("away", &State::away, "Way of a retreat [length].")
        .def_ro("waited", &State::waited, "For how long contact has been looked for [s].")
        .def_prop_ro("airborne", [](const State& s) {
            double most = 0;
            for (int i = 0; i < s.presses; i++)
                most = std::max(most, s.parts[i].touch.airborne);
            return most;
        }, "For how long contact has not been certain [s].")
        .def_prop_ro("touching", [](const State& s) {
            bool all = s.n >= 0;
            for (int i = 0; i < s.presses; i++)
                all = all && s.parts[i].touch.touching;
            return all && s.presses >= 0;
        }, "Whether every press is felt.")
        .def_prop_ro("silent", [](const State& s) {
            bool any = false;
            for (int i = 0; i < s.presses; i++)
                any = any || s.parts[i].check.silent;
            return any;
        }, "Whether a force does not answer the motion: the tool then stops sliding, and is unloaded.")
        .def_prop_ro("unexplained", [](const State& s) { return s.parts[0].check.unexplained; }, "Force that the way should have changed.")
        .def_prop_ro("numbers", [](const State& s) { return nb::make_tuple(s.numbers[0], s.numbers[1], s.numbers[2], s.numbers[3]); },
                     "Of what was found.")
        .def("stiffness", [](const State& s, int i) { return s.parts[std::clamp(i, 0, 5)].response.known(); }, "i"_a = 0)
        .def("bounds", [](const State& s, int i) {
            const force::Response& r = s.parts[std::clamp(i, 0, 5)].response;
            return nb::make_tuple(r.bound, r.damping(), static_cast<double>(r.best), r.least());
        }, "i"_a = 0, "Upper bounds of stiffness and damping, which way explains the force, a lower bound of stiffness.");
    nb::class_<force::Settings>(m, "Press", "A press in a loop; its settings never change.")
        .def("__init__", [](force::Settings* made, nb::dict given) { new (made) force::Settings(settings_of(given)); }, "settings"_a)
        .def("read", read_load, "state"_a, "load"_a)
        .def("tick", tick_of, "state"_a, "n"_a, "presses"_a, "wanted"_a, "force"_a, "press_wanted"_a, "press"_a, "done"_a, "reading"_a,
             "load"_a, "along"_a, "felt"_a, "most"_a, "together"_a = 0.0, "missing"_a = 0.0, "noise_share"_a = 1.0, "came"_a = 0.0,
             "across"_a = 0.0, "compliance"_a = 0.0, "beyond"_a = false, "yields"_a = true, "along_given"_a = 0.0,
             "along_done"_a = 0.0)
        .def("commanded", commanded_of, "state"_a, "given"_a, "outwards"_a, "free"_a, "beyond"_a = false)
        .def("lateness", [](const force::Settings& s, const State& state) { return force::lateness(state, s); }, "state"_a);
}

}  // namespace iq
