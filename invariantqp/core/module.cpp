// The engine for Python: the functions of invariantqp._core. Errors are ValueErrors; velocity/problem.py words them.
#define IQ_FILLS_NUMPY
#include "bound.hpp"
#include "frame_cost.hpp"
#include "measure.hpp"
#include <atomic>
#include <thread>

namespace iq {
namespace {

void check_twists(Mat J)
{
    const double square = J.all().square();
    if (square > 0 ? !(square >= SMALLEST * SMALLEST && square <= LARGEST * LARGEST) : std::any_of(J.all().begin(), J.all().end(), [](double x) { return x != 0; }))
        refuse("J has numbers that are too small or too large");
}

// Arguments that the functions have in common; None is absent.
struct Options {
    nb::object lower, upper, rows, tool_speed, exact, posture, metric, form, damping, guard;
    bool parts_of_twist = false;  // whether the third of `exact` is D (j, 6), and not E_e (j,)
    bool at_point = false;        // whether a tool speed has the point (3,), or its joint velocities (3, m)

    void set(Tick& tick, Reader& read, Workspace& w) const
    {
        const int m = tick.J.cols;
        tick.lower = lower.is_none() ? Vec(w, m, -INFINITY) : read.vector(lower, "lower", m, Numbers::any);
        tick.upper = upper.is_none() ? Vec(w, m, INFINITY) : read.vector(upper, "upper", m, Numbers::any);
        check_box(tick.lower, tick.upper);
        if (!rows.is_none()) {
            const nb::tuple given = parts(rows, "rows", 3);
            tick.C = read.matrix(given[0], "rows[0]", -1, m);
            if (tick.C.rows > MOST_ROWS)
                refuse("rows has more than 256 rows");
            tick.row_lower = read.vector(given[1], "rows[1]", tick.C.rows, Numbers::any);
            tick.row_upper = read.vector(given[2], "rows[2]", tick.C.rows, Numbers::any);
            check_box(tick.row_lower, tick.row_upper);
        }
        if (!tool_speed.is_none()) {
            const nb::tuple given = parts(tool_speed, "tool_speed", 2);
            if (tick.J.rows == 6 && at_point) {
                const Vec p = read.vector(given[0], "tool_speed[0]", 3);
                const Mat S = transposed(tick.J);
                tick.P = Mat(w, m, 3);
                for (int j = 0; j < m; j++)
                    tick.P[j].set(velocity_at(S[j], p));
                tick.P = transposed(tick.P);
            } else
                tick.P = read.matrix(given[0], "tool_speed[0]", 3, m);
            tick.speed = number(given[1], "tool_speed[1]", 0, LARGEST_NUMBER);
        }
        if (!exact.is_none()) {
            const nb::tuple given = parts(exact, "exact", 3);
            tick.E = read.matrix(given[0], "exact[0]", -1, m);
            if (tick.E.rows > MOST_EXACT)
                refuse("exact has more than 384 rows");
            tick.E_f = read.vector(given[1], "exact[1]", tick.E.rows);
            tick.E_e = given[2].is_none() || parts_of_twist ? Vec(w, tick.E.rows, 0)
                                                            : read.vector(given[2], "exact[2]", tick.E.rows);
            if (parts_of_twist && !given[2].is_none())
                tick.D = read.matrix(given[2], "exact[2]", tick.E.rows, 6);
        }
        if (!posture.is_none())
            tick.posture = read.vector(posture, "posture", m);
        if (!metric.is_none()) {
            tick.metric = read.matrix(metric, "metric", m, m);
            bool positive = true;
            cholesky(tick.metric, &positive);
            if (!positive)
                refuse("metric is not positive definite");
        }
        tick.damping = damping.is_none() ? 0 : number(damping, "damping", 0, LARGEST);
        tick.guard = guard.is_none() ? -1 : number(guard, "guard", 0, 1);
        if (!form.is_none())
            set_form(tick, read);
    }

  private:
    void set_form(Tick& tick, Reader& read) const
    {
        const nb::tuple given = parts(form, "form", 2);
        std::string kind;
        if (!nb::isinstance<nb::str>(given[0]) || tick.J.rows != 6)
            refuse("form is no kind and value for one body");
        kind = nb::str(given[0]).c_str();
        if (kind == "pitch")
            tick.form = FormKind::pitch, tick.pitch = number(given[1], "form[1]", -LARGEST_TO_SQUARE, LARGEST_TO_SQUARE);
        else if (kind == "complement") {
            tick.form = FormKind::complement, tick.form_matrix = read.matrix(given[1], "form[1]", 6, -1);
            if (tick.form_matrix.cols > 6)
                refuse("form[1] has more than 6 columns");
        } else if (kind == "definite")
            tick.form = FormKind::definite, tick.form_matrix = read.matrix(given[1], "form[1]", 6, 6);
        else
            refuse("form is of no kind that there is");
    }
};

void set_twists(Tick& tick, nb::handle J, nb::handle root, nb::handle feedforward, nb::handle error, Reader& read, Workspace& w)
{
    tick.J = read.matrix(J, "J", -1, -1);
    const int r = tick.J.rows, m = tick.J.cols;
    if (m < 1 || m > MOST_JOINTS || r < 6 || r % 6 || r > 6 * MOST_JOINTS)
        refuse("J has shape (" + std::to_string(r) + ", " + std::to_string(m)
               + "), expected (6 n, m) with at most 64 joints and bodies");
    check_twists(tick.J);
    tick.root = read.matrix(root, "root", -1, r);
    if (tick.root.rows < 1 || tick.root.rows > r)
        refuse("root has " + std::to_string(tick.root.rows) + " rows, expected 1 to " + std::to_string(r));
    tick.feedforward = read.vector(feedforward, "feedforward", r);
    tick.error = error.is_none() ? Vec(w, r, 0) : read.vector(error, "error", r);
    tick.position_lower = Vec(w, m, -INFINITY), tick.position_upper = Vec(w, m, INFINITY);
}

// The measure of single twists: a point and a length, by default the arm's own, or a root.
void set_measure(Tick& tick, Vec point, double length, Mat root)
{
    for (double x : tick.feedforward)
        if (!(std::abs(x) <= LENGTH_LIMIT))
            refuse("twist has a number above 1e12");
    for (double x : point)
        if (!(std::abs(x) <= LARGEST))
            refuse("point has a number above 1e30");
    const Mat S = transposed(tick.J);
    const Vec p = point.w ? point : own_point(S, tick.feedforward);
    const double L = length > 0 ? length : length_at(S, p, tick.feedforward);
    if (!(L >= SMALLEST && L <= LARGEST))
        refuse("length is too small or too large");
    tick.root = root.w ? root : root_at(p, L);
    if (!tick.metric.w)
        tick.metric = sliding_metric(S, p, L);
}

[[noreturn]] void no_projector()
{
    PyErr_SetString(PyExc_ArithmeticError, "form has no projector here");
    throw nb::python_error();
}

// One tick, with the memory of a loop.
nb::tuple tick_answer(nb::object J, nb::object root, nb::object feedforward, nb::object error, nb::object position_lower,
                      nb::object position_upper, nb::object velocity_limit, nb::object last_velocity,
                      double hold_time, double last_residual,
                      nb::object lower, nb::object upper, nb::object rows, nb::object tool_speed, nb::object exact,
                      nb::object posture, nb::object metric, nb::object form, nb::object damping, nb::object guard,
                      int exact_rank)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    Tick tick;
    tick.exact_rank = exact_rank;
    set_twists(tick, J, root, feedforward, error, read, w);
    const int m = tick.J.cols;
    Options{lower, upper, rows, tool_speed, exact, posture, metric, form, damping, guard}.set(tick, read, w);
    if (!position_lower.is_none())
        tick.position_lower = read.vector(position_lower, "position_lower", m, Numbers::any);
    if (!position_upper.is_none())
        tick.position_upper = read.vector(position_upper, "position_upper", m, Numbers::any);
    check_box(tick.position_lower, tick.position_upper);
    if (!velocity_limit.is_none())
        tick.velocity_limit = read.vector(velocity_limit, "velocity_limit", m);
    if (!last_velocity.is_none())
        tick.last_velocity = read.vector(last_velocity, "last_velocity", m);
    if (!(hold_time >= 0 && hold_time < LARGEST_TO_SQUARE && last_residual >= 0 && last_residual < LARGEST_TO_SQUARE))
        refuse("hold_time and last_residual are expected to be at least 0");
    tick.hold_time = hold_time, tick.last_residual = last_residual;
    const Answer answer = velocity(tick, w);
    return nb::make_tuple(array_of(answer.velocity), answer.approach_scale, answer.scale, answer.residual, answer.form_share,
                          array_or_none(answer.relaxed), answer.speed_excess, static_cast<int>(answer.failure),
                          array_or_none(answer.multipliers), answer.limits_active);
}

// One twist by itself.
nb::tuple solve(nb::object J, nb::object twist, nb::object point, nb::object length, nb::object root, nb::object lower,
                nb::object upper, nb::object rows, nb::object tool_speed, nb::object exact, nb::object posture,
                nb::object metric, nb::object form, nb::object damping, nb::object guard, nb::object found)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    Tick tick;
    tick.J = read.matrix(J, "J", 6, -1);
    const int m = tick.J.cols;
    if (m < 1 || m > MOST_JOINTS)
        refuse("J has " + std::to_string(m) + " columns, expected 1 to 64");
    check_twists(tick.J);
    tick.feedforward = read.vector(twist, "twist", 6), tick.error = Vec(w, 6, 0);
    tick.position_lower = Vec(w, m, -INFINITY), tick.position_upper = Vec(w, m, INFINITY);
    Options{lower, upper, rows, tool_speed, exact, posture, metric, form, damping, guard, true, true}.set(tick, read, w);
    set_measure(tick, point.is_none() ? Vec() : read.vector(point, "point", 3),
                length.is_none() ? 0 : number(length, "length", SMALLEST, LARGEST),
                root.is_none() ? Mat() : read.matrix(root, "root", 6, 6));
    Answer answer = velocity(tick, w);
    if (answer.failure == Failure::no_pseudoinverse)
        no_projector();
    if (!found.is_none())
        set_answer(answer, found, tick, read);
    return solution(report(tick, answer, w));
}

// Prioritised levels of stacked twists, (J, root, feedforward) each, highest first; the residual is that of the first.
nb::tuple solve_levels(nb::list levels, nb::object lower, nb::object upper, nb::object rows, nb::object tool_speed,
                       nb::object exact, nb::object metric, nb::object damping, nb::object found)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    std::vector<Tick> ticks;
    const Options options{lower,  upper,      rows,    tool_speed, exact, nb::none(),
                          metric, nb::none(), damping, nb::none(), true};
    for (nb::handle level : levels) {
        const nb::tuple given = parts(level, "level", 3);
        Tick tick;
        set_twists(tick, given[0], given[1], given[2], nb::none(), read, w);
        if (!ticks.empty() && tick.J.cols != ticks[0].J.cols)
            refuse("levels are of different arms");
        options.set(tick, read, w);
        ticks.push_back(tick);
    }
    if (ticks.empty())
        refuse("there are no levels");
    Answer answer = prioritised(ticks, w);
    if (!found.is_none())
        set_answer(answer, found, ticks[0], read);
    return solution(report(ticks[0], answer, w));
}

// Many single twists on several threads: velocity, residual, and (method, status, scale, damping, guard) of each row. A row
// that cannot be computed has status -1.
nb::tuple solve_rows(nb::object J, nb::object twist, nb::object lower, nb::object upper, nb::object points,
                     nb::object length, nb::object root, nb::object posture, nb::object metric, nb::object form,
                     nb::object damping, nb::object guard, int threads)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    nb::object owners[6];
    npy_intp of_J[3] = {-1, 6, -1};
    PyArrayObject* J_rows = Reader::checked(J, "J", 3, of_J, owners[0]);
    const npy_intp n = of_J[0], m = of_J[2];
    if (m < 1 || m > MOST_JOINTS)
        refuse("J has " + std::to_string(m) + " columns, expected 1 to 64");
    const auto rows_of = [&](nb::handle value, const char* name, npy_intp width, nb::object& keep) {
        npy_intp shape[2] = {n, width};
        return value.is_none() ? nullptr : Reader::checked(value, name, 2, shape, keep);
    };
    PyArrayObject* const s_rows = rows_of(twist, "twist", 6, owners[1]);
    PyArrayObject* const low = rows_of(lower, "lower", m, owners[2]);
    PyArrayObject* const high = rows_of(upper, "upper", m, owners[3]);
    PyArrayObject* const at = rows_of(points, "points", 3, owners[4]);
    PyArrayObject* const postures = rows_of(posture, "posture", m, owners[5]);
    if (!s_rows)
        refuse("twist is missing");
    Tick common;
    common.J = Mat(w, 6, static_cast<int>(m));
    Options{nb::none(), nb::none(), nb::none(), nb::none(), nb::none(), nb::none(), metric, form, damping, guard}.set(
        common, read, w);
    const double L = length.is_none() ? 0 : number(length, "length", SMALLEST, LARGEST);
    const Mat measure = root.is_none() ? Mat() : read.matrix(root, "root", 6, 6);
    constexpr npy_intp NUMBERS = 5, AT_A_TIME = 64;  // columns of numbers; rows that a thread takes together
    const npy_intp of_x[2] = {n, m}, of_r[2] = {n, 6}, of_number[2] = {n, NUMBERS};
    const nb::object velocities = new_array(2, of_x), residuals = new_array(2, of_r), numbers = new_array(2, of_number);
    double *const x = data_of(velocities), *const left = data_of(residuals), *const values = data_of(numbers);

    const auto row = [&](npy_intp i, Workspace& w) {
        const Workspace::Frame frame(w);
        double* const number = values + NUMBERS * i;
        try {
            const auto part = [&](PyArrayObject* a, npy_intp width, Numbers kind) {
                Vec v(w, static_cast<int>(width));
                double* to = v.p;
                Reader::copy(PyArray_BYTES(a) + i * PyArray_STRIDE(a, 0), a, 1, to);
                if (Reader::not_numbers(v.p, width, kind))
                    throw std::exception();
                return v;
            };
            Tick tick = common;
            tick.J = Mat(w, 6, static_cast<int>(m));
            double* to = tick.J.p;
            Reader::copy(PyArray_BYTES(J_rows) + i * PyArray_STRIDE(J_rows, 0), J_rows, 1, to);
            if (Reader::not_numbers(tick.J.p, 6 * m, Numbers::finite))
                throw std::exception();
            check_twists(tick.J);
            tick.feedforward = part(s_rows, 6, Numbers::finite), tick.error = Vec(w, 6, 0);
            tick.position_lower = Vec(w, tick.J.cols, -INFINITY), tick.position_upper = Vec(w, tick.J.cols, INFINITY);
            tick.lower = low ? part(low, m, Numbers::any) : tick.position_lower;
            tick.upper = high ? part(high, m, Numbers::any) : tick.position_upper;
            check_box(tick.lower, tick.upper);
            if (postures)
                tick.posture = part(postures, m, Numbers::finite);
            set_measure(tick, at ? part(at, 3, Numbers::finite) : Vec(), L, measure);
            const Answer answer = velocity(tick, w);
            if (answer.failure == Failure::no_pseudoinverse)
                throw std::exception();
            const Report found = report(tick, answer, w);
            std::copy(found.velocity.begin(), found.velocity.end(), x + i * m);
            std::copy(found.residual.begin(), found.residual.end(), left + i * 6);
            number[0] = static_cast<int>(found.method), number[1] = static_cast<int>(found.status);
            number[2] = found.scale, number[3] = found.damping, number[4] = found.guard;
        } catch (const std::exception&) {
            number[1] = -1;
        }
    };
    {
        const nb::gil_scoped_release released;
        std::atomic<npy_intp> next{0};
        const auto work = [&] {
            Workspace own;
            for (npy_intp first = next.fetch_add(AT_A_TIME); first < n; first = next.fetch_add(AT_A_TIME))
                for (npy_intp i = first; i < std::min(n, first + AT_A_TIME); i++)
                    row(i, own);
        };
        std::vector<std::thread> helpers;
        for (npy_intp k = 1; k < std::min<npy_intp>(threads, n / (4 * AT_A_TIME)); k++)
            helpers.emplace_back(work);
        work();
        for (std::thread& helper : helpers)
            helper.join();
    }
    return nb::make_tuple(velocities, residuals, numbers);
}

// The cost of a frame's error (6,) with derivative J (6, n), both in the frame, linear parts first, as Pink and mink have
// them: H (n, n) and c (n,). Joints that do not move the frame have columns of zeros. Measured by `costs` (6,) at a point of
// the frame, the arm's own where there is none, or by a root.
nb::tuple cost_of_frame(nb::object J, nb::object error, nb::object costs, nb::object point, nb::object root, nb::object gain,
                        nb::object lm_damping, nb::object form, nb::object damping, nb::object guard)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const Mat of_joints = transposed(read.matrix(J, "J", 6, -1));
    const Vec e = number(gain, "gain", 0, LARGEST) * read.vector(error, "error", 6);
    const int n = of_joints.rows;
    std::vector<int> moving;
    for (int j = 0; j < n; j++)
        if (of_joints[j].square() > 0)
            moving.push_back(j);
    const int m = static_cast<int>(moving.size());
    if (m > MOST_JOINTS)
        refuse("J has " + std::to_string(m) + " joints that move the frame, expected at most 64");
    Tick tick;
    tick.J = Mat(w, 6, m), tick.feedforward = Vec(w, 6), tick.error = Vec(w, 6, 0);
    for (int i = 0; i < 6; i++) {
        const int from = (i + 3) % 6;
        tick.feedforward[i] = e[from];
        for (int k = 0; k < m; k++)
            tick.J(i, k) = -of_joints(moving[k], from);
    }
    check_twists(tick.J);
    const npy_intp shape[2] = {n, n};
    const nb::object H = new_array(2, shape), c = new_array(1, shape);
    const Mat all(data_of(H), n, n, &w);
    const Vec pull(data_of(c), n, &w);
    all.all().fill(0), pull.fill(0);
    if (m == 0)
        return nb::make_tuple(H, c);
    const nb::none none;
    Options{none, none, none, none, none, none, none, form, damping, guard}.set(tick, read, w);
    if (!root.is_none())
        tick.root = read.matrix(root, "root", 6, 6);
    else {
        const Vec cost = read.vector(costs, "costs", 6);
        tick.root = root_at(point.is_none() ? own_point(transposed(tick.J), tick.feedforward) : read.vector(point, "point", 3), 1);
        for (int i = 0; i < 6; i++)
            tick.root[i].scale(cost[(i + 3) % 6]);
    }
    const std::optional<Cost> found = frame_cost(tick, number(lm_damping, "lm_damping", 0, LARGEST), w);
    if (!found)
        no_projector();
    for (int i = 0; i < m; i++) {
        pull[moving[i]] = found->c[i];
        for (int k = 0; k < m; k++)
            all(moving[i], moving[k]) = found->H(i, k);
    }
    for (int j = 0; j < n; j++)
        all(j, j) += found->damping;
    return nb::make_tuple(H, c);
}

}  // namespace
}  // namespace iq

NB_MODULE(_core, m)
{
    using namespace iq;
    if (_import_array() < 0)
        throw nb::python_error();
    m.doc() = "The engine: the velocity law of invariantqp/velocity/definition.py, compiled.";
    m.attr("MOST_JOINTS") = MOST_JOINTS;
    m.attr("MOST_ROWS") = MOST_ROWS;
    nb::set_leak_warnings(false);  // objects that threads or caches still hold when Python ends
    bind_loop(m);
    bind_clearance(m);
    bind_follower(m);
    bind_screws(m);
    bind_force(m);
    m.def("tick", tick_answer, "J"_a, "root"_a, "feedforward"_a, "error"_a = nb::none(), "position_lower"_a = nb::none(),
          "position_upper"_a = nb::none(), "velocity_limit"_a = nb::none(), "last_velocity"_a = nb::none(),
          "hold_time"_a = 0.0, "last_residual"_a = 0.0, "lower"_a = nb::none(), "upper"_a = nb::none(), "rows"_a = nb::none(),
          "tool_speed"_a = nb::none(), "exact"_a = nb::none(), "posture"_a = nb::none(), "metric"_a = nb::none(),
          "form"_a = nb::none(), "damping"_a = nb::none(), "guard"_a = nb::none(), "exact_rank"_a = 0,
          "One tick: velocity, approach scale, scale, residual, form share, relaxed, speed excess, failure, multipliers, whether limits are active.");
    m.def("solve", solve, "J"_a, "twist"_a, "point"_a = nb::none(), "length"_a = nb::none(), "root"_a = nb::none(),
          "lower"_a = nb::none(), "upper"_a = nb::none(), "rows"_a = nb::none(), "tool_speed"_a = nb::none(),
          "exact"_a = nb::none(), "posture"_a = nb::none(), "metric"_a = nb::none(), "form"_a = nb::none(),
          "damping"_a = nb::none(), "guard"_a = nb::none(), "found"_a = nb::none(),
          "The fields of a VelocitySolution for a twist.");
    m.def("solve_levels", solve_levels, "levels"_a, "lower"_a = nb::none(), "upper"_a = nb::none(),
          "rows"_a = nb::none(), "tool_speed"_a = nb::none(), "exact"_a = nb::none(), "metric"_a = nb::none(),
          "damping"_a = nb::none(), "found"_a = nb::none(), "The fields of a VelocitySolution for levels of twists.");
    m.def("solve_rows", solve_rows, "J"_a, "twist"_a, "lower"_a = nb::none(), "upper"_a = nb::none(),
          "points"_a = nb::none(), "length"_a = nb::none(), "root"_a = nb::none(), "posture"_a = nb::none(),
          "metric"_a = nb::none(), "form"_a = nb::none(), "damping"_a = nb::none(), "guard"_a = nb::none(),
          "threads"_a = 1, "Velocities (N, m), residuals (N, 6) and numbers (N, 5) of many twists.");
    m.def("frame_cost", cost_of_frame, "J"_a, "error"_a, "costs"_a = nb::none(), "point"_a = nb::none(),
          "root"_a = nb::none(), "gain"_a = 1.0, "lm_damping"_a = 0.0, "form"_a = nb::none(), "damping"_a = nb::none(),
          "guard"_a = nb::none(), "The cost of a frame's error: H (n, n) and c (n,) of 1/2 x'Hx + c'x.");
    bind_pose(m);
}
