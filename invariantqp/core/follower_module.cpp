// Joint motions and followers for Python: the classes Motion, TrackedMotion, Follower and FollowerState of invariantqp._core.
#include "bound.hpp"
#include "follower.hpp"
#include "loop_module.hpp"
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

namespace iq {
namespace {

// (lower, upper, velocity, acceleration, jerk, dt), as in paths/time_law.py.
MotionLimits motion_limits(nb::handle value, Reader& read)
{
    static const char* const NAMES[] = {"lower", "upper", "velocity", "acceleration", "jerk"};
    const nb::tuple given = parts(value, "limits", 6);
    MotionLimits limits;
    std::vector<double>* to[] = {&limits.lower, &limits.upper, &limits.velocity, &limits.acceleration, &limits.jerk};
    int m = -1;
    for (int i = 0; i < 5; i++) {
        const Vec v = read.vector(given[i], NAMES[i], m, Numbers::any);
        m = v.n;
        to[i]->assign(v.begin(), v.end());
    }
    limits.dt = number(given[5], "dt", 0, LARGEST);
    return limits;
}
// (start, first, rate, slope, final, duration), as in paths/reference.py; None is the time itself.
Clock clock_of(nb::handle value)
{
    if (value.is_none())
        return {};
    const nb::tuple given = parts(value, "clock", 6);
    const auto of = [&](int i) { return number(given[i], "clock", -LARGEST_NUMBER, LARGEST_NUMBER); };
    return {of(0), of(1), of(2), of(3), of(4), of(5)};
}
nb::tuple clock_fields(const Clock& c) { return nb::make_tuple(c.start, c.first, c.rate, c.slope, c.final, c.duration); }

void make_motion(Motion* made, nb::handle knots, nb::handle coefficients, double late_until)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const Vec times = read.vector(knots, "knots", -1);
    npy_intp shape[3] = {times.n - 1, -1, -1};
    const double* c = read.read(coefficients, "coefficients", 3, shape, Numbers::finite);
    if (times.n < 2 || shape[1] < 1 || shape[2] < 1)
        refuse("coefficients are empty");
    Motion motion;
    motion.powers = static_cast<int>(shape[1]), motion.columns = static_cast<int>(shape[2]), motion.late_until = late_until;
    motion.knots.assign(times.begin(), times.end());
    motion.coefficients.assign(c, c + shape[0] * shape[1] * shape[2]);
    new (made) Motion(std::move(motion));
}
nb::object motion_at(const Motion& motion, nb::handle times, nb::handle clock)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const Vec t = read.vector(times, "times", -1);
    const Clock by = clock_of(clock);
    const npy_intp shape[3] = {t.n, 4, motion.columns};
    nb::object array = new_array(3, shape);
    for (int i = 0; i < t.n; i++)
        motion.at(t[i], by, Mat(data_of(array) + static_cast<std::ptrdiff_t>(i) * 4 * motion.columns, 4, motion.columns, &w));
    return array;
}
// The coefficients as they lie, read-only.
nb::object coefficients_of(nb::object self)
{
    const Motion& motion = nb::cast<const Motion&>(self);
    npy_intp shape[3] = {motion.pieces(), motion.powers, motion.columns};
    PyObject* array = PyArray_SimpleNewFromData(3, shape, NPY_DOUBLE, const_cast<double*>(motion.coefficients.data()));
    if (!array)
        throw nb::python_error();
    PyArray_CLEARFLAGS(reinterpret_cast<PyArrayObject*>(array), NPY_ARRAY_WRITEABLE);
    PyArray_SetBaseObject(reinterpret_cast<PyArrayObject*>(array), self.release().ptr());
    return nb::steal(array);
}
nb::object knots_of(const Motion& motion)
{
    return array_of(Vec(const_cast<double*>(motion.knots.data()), static_cast<int>(motion.knots.size()), &workspace()));
}

// A function of limits and one or more (m,) arrays, joint by joint.
template <class F> nb::object by_joint(nb::handle limits, std::initializer_list<nb::handle> given, F of)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const MotionLimits by = motion_limits(limits, read);
    const Mat rows(w, static_cast<int>(given.size()), by.joints());
    int i = 0;
    for (nb::handle value : given)
        rows[i++].set(read.vector(value, "joints", by.joints()));
    Vec found(w, by.joints());
    for (int j = 0; j < by.joints(); j++)
        found[j] = of(by, j, rows);
    return array_of(found);
}

nb::object splice_to(std::shared_ptr<Motion> motion, nb::handle clock, nb::handle limits, double time, nb::handle state, double duration)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const MotionLimits by = motion_limits(limits, read);
    if (motion->columns < by.joints())
        refuse("the motion has fewer joints than the limits");
    return matrix_or_none(splice(*motion, clock_of(clock), by, time, read.matrix(state, "state", 3, by.joints()), duration));
}
Motion plan(nb::handle limits, nb::handle state, double now, nb::handle times, nb::handle points, double smoothing_time, int pieces)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const MotionLimits by = motion_limits(limits, read);
    const Vec t = read.vector(times, "times", -1);
    const Mat p = read.matrix(points, "points", t.n, by.joints());
    if (t.n < 1 || !(t[0] > 0) || pieces < 4 || !(smoothing_time > 0))
        refuse("there is nothing to plan");
    return smoothed_motion(by, read.matrix(state, "state", 3, by.joints()), now, t, p, smoothing_time, pieces);
}
nb::tuple turn(const Motion& motion, nb::handle clock, nb::handle limits, double time, double final)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const MotionLimits by = motion_limits(limits, read);
    if (motion.columns < by.joints())
        refuse("the motion has fewer columns than the limits");
    return clock_fields(rate_change(motion, clock_of(clock), by, time, final, w));
}

void make_tracked(TrackedMotion* made, nb::handle limits, std::shared_ptr<Motion> motion, nb::handle clock, nb::handle residual, double splice_start,
                 double splice_duration, double gain, bool keeps_shape, double pushed_beyond)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    TrackedMotion tracked;
    tracked.limits = motion_limits(limits, read);
    const int m = tracked.limits.joints();
    if (motion->columns < m || m > MOST_JOINTS)
        refuse("the motion has other joints than the limits");
    tracked.motion = motion, tracked.clock = clock_of(clock);
    const Vec left = read.matrix(residual, "residual", 6, m).all();
    tracked.residual.assign(left.begin(), left.end());
    tracked.splice_start = splice_start, tracked.splice_duration = splice_duration, tracked.gain = gain, tracked.keeps_shape = keeps_shape, tracked.pushed_beyond = pushed_beyond;
    new (made) TrackedMotion(std::move(tracked));
}

// kind ("motion", "twist" or "target"), twist or None, at_base, speed, splice_time, time, target or None
TickGoal goal_of(nb::handle value, Reader& read)
{
    const nb::tuple given = parts(value, "goal", 7);
    const std::string kind = nb::cast<std::string>(given[0]);
    TickGoal goal;
    goal.kind = kind == "twist" ? TickGoal::Kind::twist : kind == "target" ? TickGoal::Kind::target : TickGoal::Kind::motion;
    if (!given[1].is_none())
        goal.twist = read.vector(given[1], "twist", 6);
    goal.at_base = nb::cast<bool>(given[2]), goal.speed = number(given[3], "speed", 0, 1);
    goal.splice_time = number(given[4], "splice_time", 0, LARGEST), goal.time = number(given[5], "time", -LARGEST_NUMBER, LARGEST_NUMBER);
    if (goal.kind == TickGoal::Kind::target)
        goal.target = with_rotation(Pose(read.matrix(given[6], "target", 4, 4).p));
    return goal;
}
// command, place before and after, residual or None, is_limited, allowed_share, and the loop's solution or None.
nb::tuple tick_fields(const FollowerTick& tick, const LoopFunctions& functions, bool has_functions)
{
    const bool says = tick.report && (tick.is_limited || tick.report->report.status != Status::ok || !functions.limits.empty());
    return nb::make_tuple(tick.command.w ? array_of(tick.command) : nb::none(), tick.place_before, tick.place_after, matrix_or_none(tick.residual),
                          tick.is_limited, tick.allowed_share, says ? loop_solution(*tick.report, functions, has_functions) : nb::none());
}
// What is said of joints that do not do what they are commanded, as bytes of reasons; None where nothing is.
nb::object fault(const Follower& follower, FollowerState& state)
{
    const LoopSettings& set = follower.loop.settings;
    const auto found = state.joints.trouble(set.dt, set.gain, std::max(set.gain, set.limits.rate), false);
    if (found.code == Code::none)
        return nb::none();
    std::vector<double> reasons;
    add_reason(reasons, found.code, found.joints, {}, found.numbers);
    return nb::bytes(reinterpret_cast<const char*>(reasons.data()), reasons.size() * sizeof(double));
}

// A whole tick; None, and nothing is changed, where Python decides: implausible positions, joints that were pushed or do
// not respond, a path that has to wait.
nb::object step(const Follower& follower, FollowerState& kept, const TrackedMotion& tracked, nb::handle goal, nb::handle q, nb::handle functions)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    FollowerState state = kept;
    const int m = state.m;
    const Vec measured = read.vector(q, "q", m);
    const TickGoal tick_goal = goal_of(goal, read);
    const LoopFunctions called = loop_functions(functions, read, m, w);
    called.begin(measured);
    const bool was_unresponsive = state.joints.any_unresponsive();
    state.send();
    if (!follower.observe(state, measured, false) || was_unresponsive || state.joints.any_unresponsive())
        return nb::none();
    double error = 0;
    for (int j = 0; j < m; j++)
        error = std::max(error, std::abs(state.sent()[j] - measured[j]));
    if (error > tracked.pushed_beyond)
        return nb::none();
    const FollowerTick result = follower.tick(state, tracked, tick_goal, measured, called, w);
    if (!result.command.w)
        return nb::none();
    const nb::object problem = fault(follower, state);
    kept = state;
    return nb::make_tuple(tick_fields(result, called, !functions.is_none()), array_of(measured), error, problem);
}
nb::object observe(const Follower& follower, FollowerState& state, nb::handle q, bool moved)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    const Vec measured = Reader(w).vector(q, "q", state.m);
    follower.observe(state, measured, moved);
    return array_of(measured);
}
// A tick from joint positions that were observed; without a command where a path has to wait, unless it has `has_waited`.
nb::tuple drive(const Follower& follower, FollowerState& kept, const TrackedMotion& tracked, nb::handle goal, nb::handle q, nb::handle functions,
                bool has_waited)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    FollowerState state = kept;
    const int m = state.m;
    TickGoal tick_goal = goal_of(goal, read);
    tick_goal.has_waited = has_waited;
    const LoopFunctions called = loop_functions(functions, read, m, w);
    const Vec measured = read.vector(q, "q", m);
    if (!has_waited)
        called.begin(measured);
    const FollowerTick result = follower.tick(state, tracked, tick_goal, measured, called, w);
    if (result.command.w)
        kept = state;
    return tick_fields(result, called, !functions.is_none());
}
using Row = double* (FollowerState::*)();
template <Row row> nb::object get(FollowerState& s) { return array_of(Vec((s.*row)(), s.m, &workspace())); }
template <Row row> void set(FollowerState& s, nb::handle value)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    const Vec v = Reader(w).vector(value, "joints", s.m);
    std::copy(v.begin(), v.end(), (s.*row)());
}

void bind_state(nb::module_& m)
{
    using State = std::tuple<LoopState, LoopState, int, nb::bytes>;
    const auto bytes = [](const FollowerState& s) {
        return nb::bytes(reinterpret_cast<const char*>(s.numbers.data()), s.numbers.size() * sizeof(double));
    };
    nb::class_<FollowerState>(m, "FollowerState", "The state of a follower's joints between two ticks; a value.")
        .def("__init__", [](FollowerState* made, int joints, double delay, double dt) {
            if (joints < 1 || joints > MOST_JOINTS || !(dt > 0) || !(delay >= 0 && delay <= 1e4 * dt))
                refuse("joints, delay and dt are those of no loop");
            new (made) FollowerState(joints, delay, dt);
        }, "joints"_a, "delay"_a, "dt"_a)
        .def("__copy__", [](const FollowerState& s) { return FollowerState(s); })
        .def("__deepcopy__", [](const FollowerState& s, nb::object) { return FollowerState(s); }, "memo"_a)
        .def("__getstate__", [bytes](const FollowerState& s) { return State(s.joints, s.law, s.ticks, bytes(s)); })
        .def("__setstate__", [](FollowerState& s, const State& given) {
            const auto& [joints, law, ticks, numbers] = given;
            FollowerState made(joints.joints, 0, 1);
            made.joints = joints, made.law = law, made.ticks = ticks;
            made.numbers.resize(numbers.size() / sizeof(double));
            if (ticks < 1 || law.joints != joints.joints || made.numbers.size() != FollowerState(joints.joints, ticks - 1, 1).numbers.size())
                refuse("this is no state of a follower");
            std::memcpy(made.numbers.data(), numbers.c_str(), numbers.size());
            new (&s) FollowerState(made);
        })
        .def_prop_rw("position", get<&FollowerState::position>, set<&FollowerState::position>, "(m,) of the motion, when the next tick begins.")
        .def_prop_rw("velocity", get<&FollowerState::velocity>, set<&FollowerState::velocity>, "(m,) likewise.")
        .def_prop_rw("acceleration", get<&FollowerState::acceleration>, set<&FollowerState::acceleration>, "(m,) likewise.")
        .def_prop_rw("command", get<&FollowerState::command>, set<&FollowerState::command>, "(m,) joint velocity of the last tick.")
        .def_prop_rw("change", get<&FollowerState::change>, set<&FollowerState::change>, "(m,) of the command, over the tick.")
        .def_prop_rw("late", &FollowerState::late, &FollowerState::set_late, "Whether joints catch up with what they follow.")
        .def_prop_ro("sent", [](FollowerState& s) { return s.was_sent() ? get<&FollowerState::sent>(s) : nb::none(); },
                     "(m,) where the joints should be now; None before the first command.")
        .def_prop_rw("measured", [](FollowerState& s) { return array_of(Vec(s.joints.positions(), s.m, &workspace())); },
                     [](FollowerState& s, nb::handle value) {
                         Workspace& w = workspace();
                         const Workspace::Frame frame(w);
                         const Vec v = Reader(w).vector(value, "joints", s.m);
                         std::copy(v.begin(), v.end(), s.joints.positions());
                     }, "(m,) the joint positions of the last tick, NaN where they are not known.")
        .def_prop_ro("unresponsive", [](FollowerState& s) {
            nb::list found;
            for (int j = 0; j < s.m; j++)
                if (s.joints.unresponsive()[j] > 0)
                    found.append(j);
            return nb::tuple(found);
        }, "Joints that do not move although they are commanded to.")
        .def("send", &FollowerState::send, "The joints are sent to their position in this tick.")
        .def("begin", [](FollowerState& s, nb::handle at) {
            Workspace& w = workspace();
            const Workspace::Frame frame(w);
            s.begin(Reader(w).vector(at, "joints", s.m));
        }, "at"_a, "The joints are at positions (m,); earlier commands no longer count.")
        .def("commanded", [](FollowerState& s, nb::handle command) {
            Workspace& w = workspace();
            const Workspace::Frame frame(w);
            s.joints.remember(Vec(s.joints.positions(), s.m, &w).copy(), Reader(w).vector(command, "command", s.m), 0);
        }, "command"_a, "Another loop gave the command (m,) of this tick.");
}

}  // namespace

void bind_follower(nb::module_& m)
{
    using Limits = MotionLimits;
    nb::class_<Motion>(m, "Motion", "Joints as polynomials of time, piece by piece; at rest before the first and after the last.")
        .def("__init__", make_motion, "knots"_a, "coefficients"_a, "late_until"_a = -INFINITY)
        .def("at", motion_at, "times"_a, "clock"_a = nb::none(), "(k, 4, m) position, velocity, acceleration, jerk at times (k,).")
        .def("__deepcopy__", [](nb::object self, nb::object) { return self; }, "memo"_a)
        .def("__reduce__", [](nb::handle self) {
            return nb::make_tuple(self.type(), nb::make_tuple(self.attr("knots"), self.attr("coefficients"), self.attr("late_until")));
        })
        .def_prop_ro("knots", knots_of)
        .def_prop_ro("coefficients", coefficients_of)
        .def_ro("late_until", &Motion::late_until)
        .def_prop_ro("start", [](const Motion& s) { return s.knots.front(); })
        .def_prop_ro("end", [](const Motion& s) { return s.knots.back(); });
    nb::class_<TrackedMotion>(m, "TrackedMotion", "A joint motion, the splice to it, and how it is tracked.")
        .def("__init__", make_tracked, "limits"_a, "motion"_a, "clock"_a.none(), "residual"_a, "splice_start"_a, "splice_duration"_a, "gain"_a, "keeps_shape"_a,
             "pushed_beyond"_a)
        .def("__deepcopy__", [](nb::object self, nb::object) { return self; }, "memo"_a)
        .def("at", [](const TrackedMotion& tracked, double time) {
            Workspace& w = workspace();
            const Workspace::Frame frame(w);
            const Mat r(w, 4, tracked.motion->columns);
            tracked.at(time, r);
            return matrix_or_none(r);
        }, "time"_a, "(4, m) position, velocity, acceleration and jerk.");
    bind_state(m);
    nb::class_<Follower>(m, "Follower", "The ticks of a follower; its loop never changes.")
        .def(nb::init<const Loop&, double, bool>(), "loop"_a, "rise"_a, "has_other_limits"_a, nb::keep_alive<1, 2>())
        .def("observe", observe, "state"_a, "q"_a, "moved"_a)
        .def("step", step, "state"_a, "tracked"_a, "goal"_a, "q"_a, "functions"_a.none())
        .def("drive", drive, "state"_a, "tracked"_a, "goal"_a, "q"_a, "functions"_a.none(), "has_waited"_a)
        .def("fault", fault, "state"_a);
    m.def("splice", splice_to, "motion"_a, "clock"_a.none(), "limits"_a, "time"_a, "state"_a, "duration"_a);
    m.def("smoothed_motion", plan, "limits"_a, "state"_a, "now"_a, "times"_a, "points"_a, "smoothing_time"_a, "pieces"_a);
    m.def("rate_change", turn, "motion"_a, "clock"_a.none(), "limits"_a, "time"_a, "final"_a);
    m.def("clock_at", [](nb::handle clock, double time) {
        const auto now = clock_of(clock).at(time);
        return nb::make_tuple(now[0], now[1], now[2]);
    }, "clock"_a.none(), "time"_a);
    m.def("admissible_acceleration", [](nb::handle limits, nb::handle q, nb::handle v, nb::handle a, nb::handle wanted) {
        return by_joint(limits, {q, v, a, wanted}, [](const Limits& by, int j, Mat x) { return by.admissible_acceleration(j, x(0, j), x(1, j), x(2, j), x(3, j)); });
    }, "limits"_a, "q"_a, "velocity"_a, "acceleration"_a, "wanted"_a);
    m.def("acceleration_towards", [](nb::handle limits, nb::handle v, nb::handle wanted) {
        return by_joint(limits, {v, wanted}, [](const Limits& by, int j, Mat x) { return by.acceleration_towards(j, x(0, j), x(1, j)); });
    }, "limits"_a, "velocity"_a, "wanted"_a);
    m.def("peak_speed", [](nb::handle limits, nb::handle distance) {
        return by_joint(limits, {distance}, [](const Limits& by, int j, Mat x) { return by.peak_speed(j, x(0, j)); });
    }, "limits"_a, "distance"_a);
}

}  // namespace iq
