// Pose searches for Python: the class PoseArm of invariantqp._core. Errors are ValueErrors; pose/ik.py words them.
#include "bound.hpp"
#include "pose.hpp"
#include "target_module.hpp"
#include <atomic>
#include <thread>

namespace iq {
namespace {

constexpr double ROTATION_TOLERANCE = 1e-5;  // as in geometry/arrays.py

// An arm, and the range of plausible targets and starts.
struct Arm {
    PoseArm of;
    Vec3 tip{};
    double far = INFINITY;  // largest distance of a target from the tip
    std::vector<double> plausible_lower, plausible_upper;
    bool calls_python = false;  // kinematics in Python

    // The fields of PoseArm and of this struct by name, and "kinematics", a chain or a function of q.
    explicit Arm(nb::kwargs given)
    {
        Workspace& w = workspace();
        const Workspace::Frame frame(w);
        Reader read(w);
        const int m = read.vector(given["lower"], "lower", -1, Numbers::any).n;
        if (m < 1 || m > MOST_JOINTS)
            refuse("the arm has " + std::to_string(m) + " joints, expected 1 to 64");
        const auto numbers = [&](const char* name, Numbers kind = Numbers::finite) {
            const Vec x = read.vector(given[name], name, m, kind);
            return std::vector<double>(x.begin(), x.end());
        };
        of.lower = numbers("lower", Numbers::any), of.upper = numbers("upper", Numbers::any);
        of.start_lower = numbers("start_lower"), of.start_upper = numbers("start_upper");
        of.middle = numbers("middle"), of.start_stride = numbers("start_stride"), of.full_turn = numbers("full_turn");
        of.point = vec3(read.vector(given["point"], "point", 3)), of.length = nb::cast<double>(given["length"]);
        tip = vec3(read.vector(given["tip"], "tip", 3)), far = nb::cast<double>(given["far"]);
        plausible_lower = numbers("plausible_lower", Numbers::any);
        plausible_upper = numbers("plausible_upper", Numbers::any);
        const nb::object kinematics = given["kinematics"];
        if (nb::isinstance<Chain>(kinematics)) {
            const Chain& chain = nb::cast<const Chain&>(kinematics);
            if (chain.size() != m)
                refuse("the chain has other joints than the limits");
            of.state = [chain](const double* q, Mat J) { return chain.state(q, J); };
            return;
        }
        calls_python = true;
        of.state = [state = kinematics, m](const double* q, Mat J) {
            Workspace& w = workspace();
            const Workspace::Frame frame(w);
            Reader read(w);
            const nb::tuple found(state(array_of(Vec(const_cast<double*>(q), m, &w))));
            if (nb::len(found) != 2)
                refuse("the state of the arm is no pose and joint twists");
            if (J.p)
                J.set(read.matrix(found[1], "robot.jacobian(q)", 6, m));
            return Pose(read.matrix(found[0], "robot.pose(q)", 4, 4).p);
        };
    }

    std::vector<double> start(nb::handle q0) const
    {
        Workspace& w = workspace();
        const Workspace::Frame frame(w);
        const Vec q = Reader(w).vector(q0, "q0", of.size());
        for (int i = 0; i < q.n; i++)
            if (!(plausible_lower[i] <= q[i] && q[i] <= plausible_upper[i]))
                refuse("q0 is not plausible");
        return {q.begin(), q.end()};
    }
};

void check_rigid(const double* H)
{
    const Pose T(H);
    const Mat3 S = transposed(T.R) * T.R;
    bool rigid = H[12] == 0 && H[13] == 0 && H[14] == 0 && H[15] == 1 && dot(cross(T.R[0], T.R[1]), T.R[2]) > 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            rigid = rigid && std::abs(S[i][j] - (i == j)) <= ROTATION_TOLERANCE;
    if (!rigid)
        refuse("the target is no rigid motion");
}

// A search without its target: (form, exact, tolerance, restarts, start origin, time limit, clearance); its memory is
// the workspace's.
class Options {
  public:
    PoseTask task;
    bool calls_python;

    Options(const Arm& arm, nb::tuple given, Reader& read)
        : calls_python(arm.calls_python || !given[6].is_none()), arm(arm), formed(!given[0].is_none())
    {
        const nb::object form = given[0], clearance = given[6];
        task.tolerance = nb::cast<double>(given[2]), task.restarts = nb::cast<int>(given[3]);
        task.start_origin = read.vector(given[4], "start_origin", arm.of.size()).p;
        task.time_limit = nb::cast<double>(given[5]);
        if (!(task.tolerance > 0 && task.tolerance < INFINITY && task.time_limit > 0 && task.restarts >= 0))
            refuse("tolerance, time_limit or restarts are out of range");
        task.point = arm.of.point, task.length = arm.of.length;
        for (const nb::handle one : nb::borrow<nb::tuple>(given[1]))
            task.exact.push_back(demand(one, read));
        for (auto one = task.exact.rbegin(); one != task.exact.rend(); ++one)
            if (!one->rows && one->of.kind == Demand::Kind::point)
                task.point = one->of.point;
        if (nb::isinstance<nb::tuple>(form)) {
            const nb::tuple given = nb::borrow<nb::tuple>(form);
            task.root = read.matrix(given[0], "root", 6, 6);
            task.point = vec3(read.vector(given[1], "point", 3));
        } else if (formed)
            task.length = number(form, "length", TINY, LARGEST_NUMBER);
        task.min_singular_value = std::min(1.0, task.root.w ? SVD(task.root).sigma[5] : task.length);
        if (!clearance.is_none())
            task.clearance = [clearance, m = arm.of.size()](const double* q) {
                Workspace& w = workspace();
                const Workspace::Frame frame(w);
                return nb::cast<double>(clearance(array_of(Vec(const_cast<double*>(q), m, &w))));
            };
    }

    // A pose (4, 4), a position (3,), or a Target of control/target.py.
    PoseTask towards(nb::handle target, Reader& read) const
    {
        if (!PyArray_Check(target.ptr()) && nb::hasattr(target, "fields"))
            return towards(partial_target(target.attr("fields"), read));
        const nb::object given =
            PyArray_Check(target.ptr()) ? nb::borrow(target) : nb::steal(PyArray_FROM_O(target.ptr()));
        if (!given.ptr()) {
            PyErr_Clear();
            refuse("target is no pose");
        }
        if (PyArray_NDIM(reinterpret_cast<PyArrayObject*>(given.ptr())) == 1) {
            PartialTarget at;
            at.has_point = true, at.point = vec3(read.vector(given, "target", 3));
            return towards(at);
        }
        return towards(read.matrix(given, "target", 4, 4).p);
    }
    PoseTask towards(const PartialTarget& part) const
    {
        if (!task.exact.empty() || formed)
            refuse("a partial target takes neither a form nor exact demands");
        PoseTask found = task;
        found.partial_target = part, found.min_singular_value = part.has_axis ? std::min(1.0, found.length) : 1;
        found.target.p = part.has_point ? part.point : arm.tip;
        check_near(found);
        return found;
    }
    PoseTask towards(const double* H) const
    {
        check_rigid(H);
        PoseTask found = task;
        found.target = with_rotation(Pose(H));
        check_near(found);
        return found;
    }

  private:
    const Arm& arm;
    const bool formed;

    void check_near(const PoseTask& task) const
    {
        if (norm(task.target.p - arm.tip) > arm.far)
            refuse("the target is far away");
    }
    // A demand (kind, point, direction), or a function of q that returns rows C and b.
    ExactDemand demand(nb::handle given, Reader& read)
    {
        ExactDemand found{{Demand::Kind::joints}, {}};
        const int m = arm.of.size();
        if (!nb::isinstance<nb::tuple>(given)) {
            calls_python = true;
            found.rows = [rows = nb::borrow(given), m](const double* q, Mat C, Vec b) {
                Workspace& w = workspace();
                const Workspace::Frame frame(w);
                Reader read(w);
                const nb::tuple both(rows(array_of(Vec(const_cast<double*>(q), m, &w))));
                const Mat A = read.matrix(both[0], "rows", C.p ? C.rows : -1, m);
                if (A.rows > MOST_EXACT)
                    refuse("exact has more than 384 rows");
                if (C.p)
                    C.set(A), b.set(read.vector(both[1], "rows", C.rows));
                return A.rows;
            };
            return found;
        }
        const nb::tuple parts = nb::borrow<nb::tuple>(given);
        const int kind = nb::cast<int>(parts[0]);
        if (kind < 0 || kind > 2 || nb::len(parts) != 3)
            refuse("exact has a demand of an unknown kind");
        found.of.kind = static_cast<Demand::Kind>(kind);
        if (!parts[1].is_none())
            found.of.point = vec3(read.vector(parts[1], "exact point", 3));
        if (!parts[2].is_none())
            found.of.direction = vec3(read.vector(parts[2], "exact direction", 3));
        return found;
    }
};

// q, outcome, position, orientation, error, iterations, tries, active joints, other branch, displacement.
nb::tuple as_tuple(const PoseArm& arm, const PoseResult& answer)
{
    nb::list active;
    for (int j = 0; j < arm.size(); j++)
        if (std::min(answer.q[j] - arm.lower[j], arm.upper[j] - answer.q[j]) <= 1e-12 * (1 + std::abs(answer.q[j])))
            active.append(j);
    const npy_intp m = arm.size();
    const nb::object q = new_array(1, &m);
    std::copy(answer.q.begin(), answer.q.end(), data_of(q));
    return nb::make_tuple(q, static_cast<int>(answer.outcome), answer.position, answer.orientation, answer.error,
                          answer.iterations, answer.tries, nb::tuple(active), answer.other_branch, answer.displacement);
}

PoseResult solve_one(const Arm& arm, const PoseTask& task, const double* start, bool calls_python)
{
    if (calls_python)
        return solve_pose(arm.of, task, start, workspace());
    const nb::gil_scoped_release released;
    return solve_pose(arm.of, task, start, workspace());
}

nb::tuple solve(const Arm& arm, nb::object target, nb::object q0, nb::tuple given)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const Options options(arm, given, read);
    const PoseTask task = options.towards(target, read);
    const std::vector<double> start = q0.is_none() ? std::vector<double>() : arm.start(q0);
    return as_tuple(arm.of, solve_one(arm, task, q0.is_none() ? nullptr : start.data(), options.calls_python));
}

// Many targets (n, 4, 4): from q0 (m,) or (n, m) or None on threads; along a path each from the solution before.
nb::list solve_many(const Arm& arm, nb::object targets, nb::object q0, bool along, int threads, nb::tuple given)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const Options options(arm, given, read);
    npy_intp shape[3] = {-1, 4, 4};
    const double* poses = read.read(targets, "targets", 3, shape, Numbers::finite);
    const int n = static_cast<int>(shape[0]), m = arm.of.size();
    std::vector<PoseTask> tasks;
    for (int i = 0; i < n; i++)
        tasks.push_back(options.towards(poses + POSE_NUMBERS * i));
    std::vector<std::vector<double>> starts;
    if (!q0.is_none()) {
        if (PyArray_Check(q0.ptr()) && PyArray_NDIM(reinterpret_cast<PyArrayObject*>(q0.ptr())) == 2) {
            const Mat each = read.matrix(q0, "q0", n, m);
            for (int i = 0; i < n; i++)
                starts.push_back(arm.start(array_of(each[i])));
        } else
            starts.assign(n, arm.start(q0));
    }
    std::vector<PoseResult> answers(n);
    if (along || options.calls_python || threads <= 1) {
        for (int i = 0; i < n; i++) {
            const double* start = along && i ? answers[i - 1].q.data() : starts.empty() ? nullptr : starts[i].data();
            answers[i] = solve_one(arm, tasks[i], start, options.calls_python);
        }
    } else {
        const nb::gil_scoped_release released;
        std::atomic<int> next{0};
        const auto work = [&] {
            Workspace own;
            for (int i = next++; i < n; i = next++)
                answers[i] = solve_pose(arm.of, tasks[i], starts.empty() ? nullptr : starts[i].data(), own);
        };
        std::vector<std::thread> helpers;
        for (int k = 1; k < std::min(threads, n); k++)
            helpers.emplace_back(work);
        work();
        for (std::thread& helper : helpers)
            helper.join();
    }
    nb::list found;
    for (const PoseResult& answer : answers)
        found.append(as_tuple(arm.of, answer));
    return found;
}

// Joint positions (k, m) for the first k of poses (n, 4, 4), one descent each from the solution before, until a target
// or its exact demands are not met, or are not reached in a step (n,) [s] within the velocity limits (m,).
nb::object descents(const Arm& arm, nb::object targets, nb::object q0, nb::object velocity_limit, nb::object steps,
                    nb::tuple given)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const Options options(arm, given, read);
    npy_intp shape[3] = {-1, 4, 4};
    const double* poses = read.read(targets, "targets", 3, shape, Numbers::finite);
    const int n = static_cast<int>(shape[0]), m = arm.of.size();
    const Vec speed = read.vector(velocity_limit, "velocity_limit", m, Numbers::any);
    const Vec step = read.vector(steps, "steps", n, Numbers::any);
    Mat rows(w, n, m);
    Vec before = read.vector(q0, "q0", m);
    int met = 0;
    for (bool near = true; met < n; met++) {
        rows[met].set(before);
        near = descend_to(arm.of, options.towards(poses + POSE_NUMBERS * met), rows[met].p, w);
        for (int j = 0; j < m && near; j++)
            near = std::abs(rows(met, j) - before[j]) <= speed[j] * step[met];
        if (!near)
            break;
        before = rows[met];
    }
    const npy_intp size[2] = {met, m};
    const nb::object found = new_array(2, size);
    std::copy(rows.p, rows.p + static_cast<std::size_t>(met) * m, data_of(found));
    return found;
}

nb::object wrapped(const Arm& arm, nb::object q)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    const Vec x = Reader(w).vector(q, "q", arm.of.size());
    arm.of.wrap_into_limits(x.p);
    return array_of(x);
}

}  // namespace

void bind_pose(nb::module_& m)
{
    nb::set_leak_warnings(false);  // robots that live as long as Python does keep one
    nb::class_<Arm>(m, "PoseArm", "An arm of pose searches.")
        .def(nb::init<nb::kwargs>())
        .def("solve", solve, "target"_a, "q0"_a.none(), "options"_a, "Joint positions for a pose (4, 4) or point (3,).")
        .def("solve_many", solve_many, "targets"_a, "q0"_a.none(), "along"_a, "threads"_a, "options"_a,
             "The same for poses (n, 4, 4).")
        .def("descents", descents, "targets"_a, "q0"_a, "velocity_limit"_a, "steps"_a, "options"_a,
             "Joint positions (k, m) for the first k of poses (n, 4, 4), one descent each from the solution before.")
        .def("wrapped", wrapped, "q"_a, "q (m,) shifted by whole turns into the limits.");
}

}  // namespace iq
