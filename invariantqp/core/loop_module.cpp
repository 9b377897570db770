// Loops for Python: the classes Loop and LoopState of invariantqp._core.
#include "bound.hpp"
#include "loop_module.hpp"
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

namespace iq {
namespace {

constexpr int MOST_LATE = 10000;             // ticks of delay, as in control/tracking.py

JointLimits limits_of(const Fields& f)
{
    JointLimits limits;
    limits.position_lower = f.numbers("position_lower"), limits.position_upper = f.numbers("position_upper");
    limits.velocity = f.numbers("velocity_limit"), limits.acceleration = f.numbers("acceleration");
    limits.dt = f.number("dt", 1e-30, 1e30), limits.rate = f.number("rate", 0, 1e30);
    for (std::size_t j = 0; j < limits.velocity.size(); j++) {
        limits.brakes = limits.brakes || limits.acceleration[j] < INFINITY;
        if (!(limits.velocity[j] >= 0 && limits.acceleration[j] > 0 && limits.position_lower[j] <= limits.position_upper[j]))
            refuse("the limits of joint " + std::to_string(j) + " contradict each other");
    }
    return limits;
}
Demand demand_of(nb::handle value, Reader& read, int m)
{
    const nb::tuple given = parts(value, "exact", 3);
    const std::string kind = nb::cast<std::string>(given[0]);
    const auto three = [&](nb::handle v) { return vec3(read.vector(v, "exact", 3)); };
    if (kind == "twist")
        return {Demand::Kind::twist};
    if (kind == "point")
        return {Demand::Kind::point, three(given[1])};
    if (kind == "axis")
        return {Demand::Kind::axis, {}, three(given[1])};
    if (kind == "plane")
        return {Demand::Kind::plane, three(given[1]), three(given[2])};
    if (kind != "joints")
        refuse("exact has a kind that there is not");
    const Vec row = read.vector(given[1], "exact", m);
    return {Demand::Kind::joints, {}, {}, {row.begin(), row.end()}, number(given[2], "exact", -1e300, 1e300)};
}
ToolSpeed tool_speed_of(nb::handle value, Reader& read)
{
    const nb::tuple given = parts(value, "tool_speed", 2);
    const Vec p = read.vector(given[1], "tool_speed[1]", 3);
    return {number(given[0], "tool_speed[0]", 0, 1e300), {p[0], p[1], p[2]}};
}

void make_loop(Loop* made, nb::dict given)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const int m = nb::cast<int>(given["joints"]);
    if (m < 1 || m > MOST_JOINTS)
        refuse("joints are " + std::to_string(m) + ", expected 1 to 64");
    const Fields f(given, read, m);
    LoopSettings set;
    set.joints = m;
    set.limits = limits_of(f);
    set.dt = set.limits.dt, set.delay = f.number("delay", 0, MOST_LATE * set.dt), set.gain = f.number("gain", 0, 1e30);
    set.slack = f.number("slack", 0, 1e30);
    set.measure.length = f.number("length", SMALLEST, LARGEST);
    const std::string measured = f.word("measured");
    using Kind = Measure::Kind;
    set.measure.kind = measured == "point" ? Kind::point : measured == "own" ? Kind::own_point : measured == "base" ? Kind::base : Kind::tool;
    if (set.measure.kind == Kind::point)
        set.measure.point = f.point("point");
    set.measure.root = f.matrix("root", 6, 6);
    if ((set.measure.kind == Kind::base || set.measure.kind == Kind::tool) && set.measure.root.empty())
        refuse("root is missing");
    set.believed_lower = f.numbers("believed_lower"), set.believed_upper = f.numbers("believed_upper");
    set.position_lower = f.numbers("range_lower"), set.position_upper = f.numbers("range_upper");
    set.turns = f.numbers("turns"), set.tip = f.point("tip"), set.far = f.number("far", 0, INFINITY);
    if (f.has("tool_speed"))
        set.tool_speed = tool_speed_of(f["tool_speed"], read);
    if (f.has("rows")) {
        const nb::tuple rows = parts(f["rows"], "rows", 3);
        const Mat C = read.matrix(rows[0], "rows[0]", -1, m);
        const Vec low = read.vector(rows[1], "rows[1]", C.rows, Numbers::any), high = read.vector(rows[2], "rows[2]", C.rows, Numbers::any);
        if (C.rows > MOST_ROWS)
            refuse("rows has more than 256 rows");
        check_box(low, high);
        set.rows = {{C.all().begin(), C.all().end()}, {low.begin(), low.end()}, {high.begin(), high.end()}};
    }
    for (nb::handle demand : nb::cast<nb::tuple>(f["exact"]))
        set.exact.push_back(demand_of(demand, read, m));
    set.exact_rank = static_cast<int>(f.number("exact_rank", 0, MOST_EXACT));
    set.posture = f.numbers("posture", m), set.pull = f.numbers("pull", m);
    set.metric = f.matrix("metric", m, m);
    if (bool positive = true; !set.metric.empty()) {
        cholesky(read.matrix(f["metric"], "metric", m, m), &positive);
        if (!positive)
            refuse("metric is not positive definite");
    }
    if (f.has("form")) {
        const nb::tuple form = parts(f["form"], "form", 2);
        const std::string kind = nb::cast<std::string>(form[0]);
        set.form = kind == "pitch" ? FormKind::pitch : kind == "complement" ? FormKind::complement : FormKind::definite;
        if (set.form == FormKind::pitch)
            set.pitch = number(form[1], "form[1]", -1e150, 1e150);
        else {
            const Mat Q = read.matrix(form[1], "form[1]", 6, set.form == FormKind::definite ? 6 : -1);
            if (Q.cols > 6)
                refuse("form[1] has more than 6 columns");
            set.form_matrix.assign(Q.all().begin(), Q.all().end());
        }
    }
    set.damping = f.number("damping", 0, LARGEST), set.guard = f.number("guard", -1, 1);
    new (made) Loop{set, std::nullopt};
    if (f.has("chain"))
        made->chain = nb::cast<const Chain&>(f["chain"]);
}

// A problem that another solver answers, by the names of definition.Tick.
nb::dict tick_fields(const Tick& tick)
{
    nb::dict d;
    d["J"] = matrix_or_none(tick.J), d["root"] = matrix_or_none(tick.root), d["measure"] = matrix_or_none(tick.measure), d["metric"] = matrix_or_none(tick.metric);
    d["ahead"] = array_of(tick.ahead), d["error"] = array_of(tick.error);
    d["lower"] = array_of(tick.lower), d["upper"] = array_of(tick.upper);
    d["position_lower"] = array_of(tick.position_lower), d["position_upper"] = array_of(tick.position_upper);
    d["rows"] = tick.C.rows ? nb::object(nb::make_tuple(matrix_or_none(tick.C), array_of(tick.row_lower), array_of(tick.row_upper))) : nb::none();
    d["tool_speed"] = tick.P.w ? nb::object(nb::make_tuple(matrix_or_none(tick.P), tick.speed)) : nb::none();
    d["exact"] = tick.E.w ? nb::object(nb::make_tuple(matrix_or_none(tick.E), array_of(tick.E_f), array_of(tick.E_e), matrix_or_none(tick.D))) : nb::none();
    d["exact_rank"] = tick.exact_rank;
    d["posture"] = array_or_none(tick.posture), d["fastest"] = array_or_none(tick.fastest);
    d["held"] = tick.held, d["before"] = array_or_none(tick.before), d["missed"] = tick.missed;
    d["formed"] = tick.form != FormKind::none, d["damping"] = tick.damping;
    return d;
}

// The user's functions, called with new arrays.
class Functions {
  public:
    LoopFunctions functions;

    // (arm, limits, exact, law), functions or None; each limit is a ClearanceInLoop, or its functions (rows, after)
    Functions(nb::handle given, Reader& read, int m, Workspace& w)
    {
        if (given.is_none())
            return;
        const nb::tuple all = parts(given, "functions", 4);
        const nb::object arm = all[0], exact = all[2], law = all[3];
        for (nb::handle limit : nb::cast<nb::tuple>(all[1]))
            functions.limits.push_back(row_limit(limit, read, m));
        if (!arm.is_none())
            functions.arm = [arm, &read, m](Vec there, Workspace&) {
                const nb::tuple found = parts(arm(array_of(there)), "the robot's state", 2);
                return ArmState{read.matrix(found[0], "the robot's Jacobian", 6, m), read_pose(found[1], "the robot's pose", read)};
            };
        if (!exact.is_none())
            functions.exact = [exact, &read, m, &w](Vec there, double gain, Vec ahead, const Pose* nearest, Tick& tick) {
                const nb::object pose = nearest ? array_of(*nearest) : nb::none();
                const nb::tuple found = parts(exact(array_of(there), gain, array_of(ahead), pose), "exact rows", 3);
                tick.E = read.matrix(found[0], "exact[0]", -1, m);
                if (tick.E.rows > MOST_EXACT)
                    refuse("exact has more than 384 rows");
                tick.E_f = read.vector(found[1], "exact[1]", tick.E.rows);
                tick.D = found[2].is_none() ? Mat(w, tick.E.rows, 6, 0) : read.matrix(found[2], "exact[2]", tick.E.rows, 6);
            };
        if (!law.is_none())
            functions.law = [law, &read, &w](const Tick& tick) {
                const nb::object found = law(tick_fields(tick));
                Answer answer;
                if (found.is_none()) {
                    answer.velocity = Vec(w, tick.J.cols, 0), answer.failure = Failure::infeasible, answer.share = 0;
                    return answer;
                }
                const nb::tuple numbers = parts(found, "the answer", 8);
                answer.velocity = read.vector(numbers[0], "the answer", tick.J.cols);
                answer.pace = number(numbers[1], "the pace", 0, 1), answer.share = number(numbers[2], "the share", 0, 1);
                answer.missed = number(numbers[3], "what is missed", 0, 1e300), answer.guarded = number(numbers[4], "guarded", 0, 1);
                answer.limited = nb::cast<bool>(numbers[5]);
                answer.relaxed = numbers[6].is_none() ? Vec() : read.vector(numbers[6], "relaxed", tick.C.rows);
                answer.faster = number(numbers[7], "faster", 0, 1e300);
                return answer;
            };
    }

  private:
    static RowLimit row_limit(nb::handle given, Reader& read, int m)
    {
        RowLimit limit;
        if (nb::try_cast(given, limit.clearance) && limit.clearance) {
            if (static_cast<int>(limit.clearance->rate.speed.size()) != m)
                refuse("a clearance is of another arm");
            return limit;
        }
        const nb::tuple both = parts(given, "a limit", 2);
        const nb::object rows = both[0], after = both[1];
        const auto told = [&read, m](nb::handle found) -> RowsOfTick {
            if (found.is_none())
                return {};
            const nb::tuple three = parts(found, "rows", 3);
            const Mat C = read.matrix(three[0], "rows[0]", -1, m);
            const Vec low = read.vector(three[1], "rows[1]", C.rows, Numbers::any), high = read.vector(three[2], "rows[2]", C.rows, Numbers::any);
            check_box(low, high);
            return {C, low, high};
        };
        limit.rows = [rows, told](Vec there, Vec before) -> std::optional<RowsOfTick> {
            const nb::object found = rows(array_of(there), array_of(before));
            if (found.ptr() == Py_False)
                return std::nullopt;
            return told(found);
        };
        if (!after.is_none())
            limit.after = [after, told](Vec there, Vec x) { return told(after(array_of(there), array_of(x))); };
        return limit;
    }
};

// Of the first clearance that is not kept: which limit it is, which pair of bodies, and their distance; or None.
nb::object too_near(const LoopFunctions& functions)
{
    for (std::size_t i = 0; i < functions.limits.size(); i++)
        if (const ClearanceInLoop* limit = functions.limits[i].clearance)
            if (const int k = limit->clearance->nearest(); k >= 0 && limit->clearance->found()[k] < limit->clearance->enough())
                return nb::make_tuple(i, k, limit->clearance->found()[k]);
    return nb::none();
}

// (k,) limit, pair and distance of rows; None where there are none.
nb::object bytes_of(const std::vector<RowOrigin>& rows)
{
    if (rows.empty())
        return nb::none();
    std::vector<double> numbers;
    for (const RowOrigin& row : rows)
        numbers.insert(numbers.end(), {static_cast<double>(row.limit), static_cast<double>(row.pair), row.distance});
    return nb::bytes(reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(double));
}

}  // namespace

LoopFunctions loop_functions(nb::handle given, Reader& read, int m, Workspace& w) { return Functions(given, read, m, w).functions; }

nb::object loop_solution(const LoopReport& found, const LoopFunctions& functions, bool asked)
{
    return asked ? nb::object(nb::make_tuple(solution(found.report), bytes_of(found.rows), too_near(functions))) : solution(found.report);
}

namespace {

nb::object tick(const Loop& loop, LoopState& state, nb::object q, nb::object target, nb::object ahead, nb::object velocity,
                bool at_base, bool stand, nb::object functions, nb::object changes, nb::object posture, nb::object exact,
                nb::object arm, nb::object measured_at, nb::object part)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const int m = loop.settings.joints;
    if (state.joints != m)
        refuse("the state is one of " + std::to_string(state.joints) + " joints");
    TickInputs in;
    Pose wanted;
    PartialTarget counts;
    ArmState seen;
    JointLimits limits;
    ToolSpeed tool_speed;
    in.q = read.vector(q, "q", m);
    if (!target.is_none())
        wanted = read_pose(target, "target", read), in.target = &wanted;
    if (!part.is_none())
        counts = partial_target(part, read), in.part = &counts;
    if (!ahead.is_none()) {
        in.ahead = read.vector(ahead, "twist", 6);
        for (const double x : in.ahead)
            if (!(std::abs(x) <= 1e12))
                refuse("twist has a number above 1e12");
    }
    if (!velocity.is_none())
        in.velocity = read.vector(velocity, "velocity", m);
    in.at_base = at_base, in.stand = stand;
    if (!changes.is_none()) {  // speed, limits or None, tool speed or None
        const nb::tuple given = parts(changes, "changes", 3);
        in.changes.speed = number(given[0], "speed", 0, 1);
        if (!given[1].is_none())
            limits = limits_of(Fields(nb::cast<nb::dict>(given[1]), read, m)), in.changes.limits = &limits;
        if (!given[2].is_none())
            tool_speed = tool_speed_of(given[2], read), in.changes.tool_speed = &tool_speed;
    }
    if (!posture.is_none())
        in.posture = read.vector(posture, "posture", m);
    if (!exact.is_none()) {
        const nb::tuple given = parts(exact, "rows", 3);
        in.E = read.matrix(given[0], "rows[0]", -1, m), in.E_f = read.vector(given[1], "rows[1]", in.E.rows);
        if (!given[2].is_none())
            in.D = read.matrix(given[2], "rows[2]", in.E.rows, 6);
    }
    if (!arm.is_none()) {
        const nb::tuple given = parts(arm, "robot_state", 2);
        seen = {read.matrix(given[0], "robot_state[0]", 6, m), read_pose(given[1], "robot_state[1]", read)};
        in.arm = &seen;
    }
    if (!measured_at.is_none())
        in.measured_at = read.vector(measured_at, "measured_at", 3);
    const Functions asked(functions, read, m, w);
    if (!loop.chain && !in.arm && !asked.functions.arm)
        refuse("the loop has no arm");
    try {
        asked.functions.begin(in.q);
        return loop_solution(loop.tick(state, in, asked.functions, w), asked.functions, !functions.is_none());
    } catch (const FarTarget&) {
        refuse("target is too far away");
    } catch (const NoProjector&) {
        PyErr_SetString(PyExc_ArithmeticError, "form has no projector here");
        throw nb::python_error();
    }
}

// (m,) each: bounds of the joint velocity, those of position limits alone, and accelerations above a joint's limit.
nb::tuple joint_bounds(nb::dict given, nb::handle q, nb::handle before)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const Vec at = read.vector(q, "q", -1);
    const JointLimits limits = limits_of(Fields(given, read, at.n));
    Vec speeds(w, at.n);
    std::copy(limits.velocity.begin(), limits.velocity.end(), speeds.begin());
    const JointBounds found = BoundsOfTick(limits, at, read.vector(before, "before", at.n), speeds).bounds();
    return nb::make_tuple(array_of(found.lower), array_of(found.upper), array_of(found.position_lower), array_of(found.position_upper),
                          array_of(found.exceeded));
}
nb::object numbers_of(const LoopState& state)
{
    const npy_intp n = static_cast<npy_intp>(state.numbers.size());
    nb::object array = new_array(1, &n);
    std::copy(state.numbers.begin(), state.numbers.end(), data_of(array));
    return array;
}

}  // namespace

void bind_loop(nb::module_& m)
{
    using State = std::tuple<int, int, double, nb::bytes>;
    nb::class_<LoopState>(m, "LoopState", "What a loop remembers between two ticks; a value.")
        .def("__init__", [](LoopState* made, int joints, double delay, double dt) {
            if (joints < 1 || joints > MOST_JOINTS || !(dt > 0) || !(delay >= 0 && delay <= MOST_LATE * dt))
                refuse("joints, delay and dt are those of no loop");
            new (made) LoopState(joints, delay, dt);
        }, "joints"_a, "delay"_a, "dt"_a)
        .def("__copy__", [](const LoopState& s) { return LoopState(s); })
        .def("__deepcopy__", [](const LoopState& s, nb::object) { return LoopState(s); }, "memo"_a)
        .def("__eq__", [](const LoopState& s, nb::object other) {
            const LoopState* o = nullptr;
            if (!nb::try_cast(other, o))
                return false;
            return o && s.joints == o->joints && s.numbers.size() == o->numbers.size()
                   && std::memcmp(s.numbers.data(), o->numbers.data(), s.numbers.size() * sizeof(double)) == 0;
        }, "other"_a)
        .def("__getstate__", [](const LoopState& s) {
            return State(s.joints, s.whole, s.part,
                         nb::bytes(reinterpret_cast<const char*>(s.numbers.data()), s.numbers.size() * sizeof(double)));
        })
        .def("__setstate__", [](LoopState& s, const State& given) {
            const auto& [joints, whole, part, bytes] = given;
            if (joints < 1 || joints > MOST_JOINTS || whole < 0 || whole > MOST_LATE || !(part >= 0 && part <= 1))
                refuse("this is no state of a loop");
            LoopState made(joints, whole, 1);
            made.part = part;
            if (bytes.size() != made.numbers.size() * sizeof(double))
                refuse("this is no state of a loop");
            std::memcpy(made.numbers.data(), bytes.c_str(), bytes.size());
            new (&s) LoopState(made);
        })
        .def_prop_ro("numbers", numbers_of, "(n,) all of it.")
        .def_prop_ro("positions", [](LoopState& s) { return array_of(Vec(s.positions(), s.joints, &workspace())); },
                     "(m,) joint positions in the tick before, NaN before the first.")
        .def_prop_ro("command", [](LoopState& s) { return array_of(Vec(s.command(0), s.joints, &workspace())); },
                     "(m,) the last command.")
        .def_prop_ro("unresponsive", [](LoopState& s) { return array_of(Vec(s.unresponsive(), s.joints, &workspace())); },
                     "(m,) above zero where a joint does not follow its commands.")
        .def("forget_positions", [](LoopState& s) { std::fill(s.positions(), s.positions() + s.joints, NAN); });
    m.def("joint_bounds", joint_bounds, "limits"_a, "q"_a, "before"_a, "Bounds of the joint velocity in a tick.");
    nb::class_<Loop>(m, "Loop", "A loop; its settings never change.")
        .def("__init__", make_loop, "settings"_a)
        .def("tick", tick, "state"_a, "q"_a, "target"_a = nb::none(), "ahead"_a = nb::none(), "velocity"_a = nb::none(),
             "at_base"_a = false, "stand"_a = false, "functions"_a = nb::none(), "changes"_a = nb::none(),
             "posture"_a = nb::none(), "exact"_a = nb::none(), "arm"_a = nb::none(), "measured_at"_a = nb::none(),
             "part"_a = nb::none(),
             "One tick: the fields of a VelocitySolution. With functions also the origins of rows as doubles, or None: which "
             "limit, which pair of bodies and their distance; and the same of a clearance that is not kept, or None.");
}

}  // namespace iq
