// Python binding of Clearance. Errors are ValueErrors; control/clearance.py checks its arguments first.
#include "bound.hpp"
#include "clearance.hpp"
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>

namespace iq {
namespace {

constexpr int MOST_JOINTS_OF_ALL = 1024, MOST_SHAPES = 4096;
constexpr int SHAPE_NUMBERS = 17, ROW_NUMBERS = 19;  // core, radius, half sizes, rotation, position; with body and mover

int index(double x, int least, int most, const char* name)
{
    if (!(x >= least && x <= most && x == std::floor(x)))
        refuse(std::string(name) + " has a number out of range");
    return static_cast<int>(x);
}
std::vector<double> vector_of(Vec x) { return {x.begin(), x.end()}; }

Shape shape_of(Vec numbers)
{
    Pose at;
    for (int i = 0; i < 3; i++)
        at.R[i] = {numbers[5 + 3 * i], numbers[6 + 3 * i], numbers[7 + 3 * i]}, at.p[i] = numbers[14 + i];
    for (const double size : numbers.part(1, 5))
        if (!(size >= 0))
            refuse("a shape has a negative size");
    const auto core = static_cast<ShapeCore>(index(numbers[0], 0, 3, "core"));
    return {core, numbers[1], {numbers[2], numbers[3], numbers[4]}, at};
}
nb::object array_of(const Witnesses& found)
{
    const npy_intp shape[2] = {found.count, 7};
    nb::object array = new_array(2, shape);
    double* to = data_of(array);
    for (int i = 0; i < found.count; i++, to += 7) {
        to[0] = found.at[i].distance;
        std::copy(found.at[i].normal.begin(), found.at[i].normal.end(), to + 1);
        std::copy(found.at[i].point.begin(), found.at[i].point.end(), to + 4);
    }
    return array;
}
nb::object array_of(Mat A)
{
    const npy_intp shape[2] = {A.rows, A.cols};
    nb::object array = new_array(2, shape);
    std::copy(A.all().begin(), A.all().end(), data_of(array));
    return array;
}
nb::object array_of(const std::vector<double>& x)
{
    return array_of(Vec(const_cast<double*>(x.data()), static_cast<int>(x.size()), nullptr));
}
nb::object array_of(const Pose* poses, int count)
{
    const npy_intp shape[3] = {count, 4, 4};
    nb::object array = new_array(3, shape);
    for (int i = 0; i < count; i++)
        poses[i].write(data_of(array) + POSE_NUMBERS * i);
    return array;
}

// Witnesses of a mesh by a function of Python, of the indices of two shapes and their poses (1, 4, 4).
auto witnesses_by(nb::object function)
{
    return [function](int i, const Shape& a, int j, const Shape& b, Witnesses& found) {
        const nb::gil_scoped_acquire held;
        const Workspace::Frame frame(workspace());
        const Mat given =
            Reader(workspace()).matrix(function(i, j, array_of(&a.at, 1), array_of(&b.at, 1)), "witnesses", -1, 7);
        for (int k = 0; k < given.rows; k++) {
            const Vec x = given[k];
            found.add(x[0], {x[1], x[2], x[3]}, {x[4], x[5], x[6]});
        }
        found.finish(0);
    };
}

ClearanceArm arm_of(nb::handle given, Reader& read)
{
    const nb::tuple parts = nb::cast<nb::tuple>(given);
    if (parts.size() != 5)
        refuse("an arm is (screws, coordinates, limits, turns, whether it brakes)");
    const Mat screws = read.matrix(parts[0], "screws", 6, -1),
              limits = read.matrix(parts[2], "limits", 4, -1, Numbers::any);
    if (limits.cols < 1)
        refuse("an arm has no joints");
    std::vector<int> coordinates;
    for (const double x : read.vector(parts[1], "coordinates", screws.cols))
        coordinates.push_back(index(x, 0, limits.cols - 1, "coordinates"));
    return {Chain(screws, Pose()), coordinates,          vector_of(limits[0]),
            vector_of(limits[1]),  vector_of(limits[2]), vector_of(limits[3]),
            vector_of(read.vector(parts[3], "turns", limits.cols)), nb::cast<bool>(parts[4])};
}

Clearance clearance_of(double distance, nb::list arms, nb::object shapes, nb::object pairs, int obstacles, bool keep_all,
                       nb::object meshes)
{
    const Workspace::Frame frame(workspace());
    Reader read(workspace());
    ClearanceScene scene;
    scene.distance = distance, scene.obstacles = obstacles, scene.keep_all = keep_all;
    std::vector<int> first{0};
    for (nb::handle arm : arms) {
        scene.arms.push_back(arm_of(arm, read));
        first.push_back(first.back() + scene.arms.back().chain.size());
    }
    if (scene.arms.empty() || first[1] > MOST_JOINTS || first.back() > MOST_JOINTS_OF_ALL)
        refuse("an arm has at most 64 joints, and those around it 960");
    if (!(distance >= 0 && std::isfinite(distance)) || obstacles < 0 || obstacles > MOST_SHAPES)
        refuse("distance and obstacles are not negative");
    const Mat numbers = read.matrix(shapes, "shapes", -1, ROW_NUMBERS), table = read.matrix(pairs, "pairs", -1, 3);
    if (numbers.rows > MOST_SHAPES)
        refuse("there are more than 4096 shapes");
    const int others = static_cast<int>(scene.arms.size()) - 1;
    for (int i = 0; i < numbers.rows; i++) {
        const int mover = index(numbers(i, 1), -1, obstacles + others - 1, "mover"),
                  arm = std::max(mover - obstacles + 1, 0);
        int body = index(numbers(i, 0), 0, first.back(), "body");
        if (body > 0 && (mover >= 0 && arm == 0 ? true : !(body > first[arm] && body <= first[arm + 1])))
            refuse("a body is not of the arm that its shape is of");
        const Shape shape = shape_of(numbers[i].part(2, ROW_NUMBERS));
        if (shape.core == ShapeCore::mesh && meshes.is_none())
            refuse("nothing finds the distance of a mesh");
        scene.shapes.push_back({body, mover, shape});
    }
    for (int k = 0; k < table.rows; k++) {
        const int one = index(table(k, 0), 0, numbers.rows - 1, "pairs"),
                  other = index(table(k, 1), 0, numbers.rows - 1, "pairs");
        if (scene.shapes[one].mover >= 0)
            refuse("the first shape of a pair is not of the arm");
        scene.pairs.push_back({{one, other}, index(table(k, 2), 0, 1 << 24, "pairs")});
    }
    if (!meshes.is_none())
        scene.meshes = witnesses_by(meshes);
    return Clearance(scene);
}

ClearanceRate rate_of(nb::object limits, double alpha, double dt, double joint_rate, double delay)
{
    const Workspace::Frame frame(workspace());
    const Mat table = Reader(workspace()).matrix(limits, "limits", 4, -1, Numbers::any);
    if (!(alpha >= 0 && dt >= 0 && joint_rate > 0 && delay >= 0 && std::isfinite(alpha + dt + delay)))
        refuse("alpha, dt and delay are not negative, joint_rate is positive");
    for (int j = 0; j < table.cols; j++)
        if (!(table(0, j) >= 0 && table(1, j) > 0))
            refuse("limits of speed and acceleration are not negative");
    return {vector_of(table[0]),
            vector_of(table[1]),
            vector_of(table[2]),
            vector_of(table[3]),
            alpha,
            dt,
            joint_rate,
            delay};
}

int joints_of(const Clearance& c) { return c.of().arms[0].size(); }
void check(const Clearance& c, const ClearanceRate& rate)
{
    if (static_cast<int>(rate.speed.size()) != joints_of(c))
        refuse("rate is of another arm");
}

// Rows with the pair and distance of each, pair -1 for a limit of a joint's speed; None without rows.
nb::object to_python(const Clearance& c, const ClearanceRows& rows)
{
    if (rows.pair.empty())
        return nb::none();
    nb::list pairs, distances;
    for (const int k : rows.pair) {
        pairs.append(k);
        distances.append(k < 0 ? 0.0 : c.last_distances()[k]);
    }
    return nb::make_tuple(array_of(rows.C), array_of(rows.lower), array_of(rows.upper), pairs, distances);
}

nb::tuple states_of(nb::object arms, nb::object q, nb::object before, nb::object limits, double dt, double rate)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const Vec at = read.vector(q, "q", -1), of = read.vector(arms, "arms", at.n),
              x = read.vector(before, "before", at.n);
    const Mat table = read.matrix(limits, "limits", 4, at.n, Numbers::any);
    BrakingJoints joints{{}, table[0], table[1], table[2], table[3], 0};
    for (const double arm : of) {
        joints.arm.push_back(index(arm, 0, at.n - 1, "arms"));
        joints.own += arm == 0;
    }
    const BrakingStates states(joints, at, x, dt, rate);
    nb::list positions, weights, longer;
    for (const BrakingState& state : states.at)
        positions.append(array_of(state.q)), weights.append(array_of(state.weight)),
            longer.append(array_of(state.longer));
    return nb::make_tuple(positions, weights, longer, array_of(states.grows), array_of(states.y));
}

}  // namespace

void bind_clearance(nb::module_& module)
{
    nb::class_<ClearanceRate>(module, "ClearanceRate", "The rate at which bodies may approach in a loop, and the limits of its joints.")
        .def(
            "__init__",
            [](ClearanceRate* at, nb::object limits, double alpha, double dt, double joint_rate, double delay) {
                new (at) ClearanceRate(rate_of(limits, alpha, dt, joint_rate, delay));
            },
            "limits"_a, "alpha"_a, "dt"_a = 0.0, "joint_rate"_a = INFINITY, "delay"_a = 0.0)
        .def("__getstate__",
             [](const ClearanceRate& rate) {
                 const Workspace::Frame frame(workspace());
                 Mat limits(workspace(), 4, static_cast<int>(rate.speed.size()));
                 double* to = limits.p;
                 for (const auto* x : {&rate.speed, &rate.acceleration, &rate.lower, &rate.upper})
                     to = std::copy(x->begin(), x->end(), to);
                 return nb::make_tuple(array_of(limits), rate.alpha, rate.dt, rate.joint_rate, rate.delay);
             })
        .def("__setstate__",
             [](ClearanceRate& rate, const std::tuple<nb::object, double, double, double, double>& state) {
                 const auto& [limits, alpha, dt, joint_rate, delay] = state;
                 new (&rate) ClearanceRate(rate_of(limits, alpha, dt, joint_rate, delay));
             })
        .def_ro("alpha", &ClearanceRate::alpha)
        .def_ro("dt", &ClearanceRate::dt)
        .def_prop_ro("stops_at_once", &ClearanceRate::stops_at_once);
    using Given = nb::object;
    nb::class_<Clearance>(module, "Clearance", "Clearance of an arm; control/clearance.py.")
        .def(
            "__init__",
            [](Clearance* at, double distance, nb::list arms, Given shapes, Given pairs, int obstacles, bool keep_all,
               Given meshes) {
                new (at) Clearance(clearance_of(distance, arms, shapes, pairs, obstacles, keep_all, meshes));
            },
            "distance"_a, "arms"_a, "shapes"_a, "pairs"_a, "obstacles"_a = 0, "keep_all"_a = false,
            "meshes"_a = nb::none())
        .def(
            "move",
            [](Clearance& c, int obstacle, Given pose, Given twist) {
                const Workspace::Frame frame(workspace());
                Reader read(workspace());
                index(obstacle, 0, c.of().obstacles - 1, "obstacle");
                const Pose at(read.matrix(pose, "pose", 4, 4).p);
                c.move(obstacle, at, twist.is_none() ? nullptr : read.vector(twist, "twist", 6).p);
            },
            "obstacle"_a, "pose"_a, "twist"_a = nb::none())
        .def(
            "move_arm",
            [](Clearance& c, int arm, Given q, Given velocity) {
                const Workspace::Frame frame(workspace());
                Reader read(workspace());
                const int n =
                    c.of().arms[index(arm, 0, static_cast<int>(c.of().arms.size()) - 2, "arm") + 1].size();
                const Vec at = read.vector(q, "q", n);
                c.move_arm(arm, at.p, velocity.is_none() ? nullptr : read.vector(velocity, "velocity", n).p);
            },
            "arm"_a, "q"_a, "velocity"_a = nb::none())
        .def("start", &Clearance::start)
        .def(
            "rows",
            [](Clearance& c, Given q, Given before, const ClearanceRate& rate) {
                const Workspace::Frame frame(workspace());
                Reader read(workspace());
                check(c, rate);
                const Vec at = read.vector(q, "q", joints_of(c));
                const Vec x = before.is_none() ? Vec(workspace(), at.n, 0) : read.vector(before, "before", at.n);
                return to_python(c, c.rows(at, x, rate));
            },
            "q"_a, "before"_a.none(), "rate"_a)
        .def(
            "after",
            [](Clearance& c, Given q, Given velocity, const ClearanceRate& rate) {
                const Workspace::Frame frame(workspace());
                Reader read(workspace());
                check(c, rate);
                if (!(rate.dt > 0))
                    refuse("rate has no tick");
                const Vec at = read.vector(q, "q", joints_of(c));
                return to_python(c, c.after(at, read.vector(velocity, "velocity", at.n), rate));
            },
            "q"_a, "velocity"_a, "rate"_a)
        .def(
            "distances",
            [](Clearance& c, Given q) {
                const Workspace::Frame frame(workspace());
                return array_of(c.distances(Reader(workspace()).vector(q, "q", joints_of(c))));
            },
            "q"_a)
        .def(
            "poses",
            [](Clearance& c, Given q) {
                const Workspace::Frame frame(workspace());
                const std::vector<Pose> found = c.poses(Reader(workspace()).vector(q, "q", joints_of(c)));
                return array_of(found.data(), static_cast<int>(found.size()));
            },
            "q"_a)
        .def_prop_ro("last_distances", [](const Clearance& c) { return array_of(c.last_distances()); })
        .def_prop_ro("nearest",
                     [](const Clearance& c) {
                         const int k = c.nearest();
                         return nb::make_tuple(k, k < 0 ? INFINITY : c.last_distances()[k]);
                     })
        .def_prop_ro("threshold", &Clearance::threshold)
        .def("always_near",
             [](const Clearance& c) {
                 nb::list found;
                 for (int k = 0; k < c.pairs(); k++)
                     if (c.always_near(k))
                         found.append(k);
                 return found;
             })
        .def("twist",
             [](const Clearance& c, int obstacle) {
                 const Twist s = c.twist(index(obstacle, 0, c.of().obstacles - 1, "obstacle"));
                 return array_of(std::vector<double>{s.omega[0], s.omega[1], s.omega[2], s.v[0], s.v[1], s.v[2]});
             })
        .def_prop_ro("levers",
                     [](const Clearance& c) {
                         int all = 0;
                         for (const ClearanceArm& arm : c.of().arms)
                             all += arm.chain.size();
                         return array_of(Mat(const_cast<double*>(c.lever(0)), static_cast<int>(c.of().shapes.size()),
                                             all, nullptr));
                     })
        .def("memory", [](const Clearance& c) { return array_of(c.memory()); })
        .def("remember", [](Clearance& c, Given numbers) {
            const Workspace::Frame frame(workspace());
            c.remember(vector_of(Reader(workspace()).vector(numbers, "numbers", -1, Numbers::any)));
        });
    nb::class_<ClearanceInLoop>(module, "ClearanceInLoop", "A Clearance in one loop.")
        .def(
            "__init__",
            [](ClearanceInLoop* at, std::shared_ptr<Clearance> of, const ClearanceRate& rate, nb::callable on_first_tick) {
                check(*of, rate);
                new (at) ClearanceInLoop{std::move(of), rate, [on_first_tick](Vec q) { on_first_tick(array_of(q)); }, std::nullopt};
            },
            "clearance"_a, "rate"_a, "on_first_tick"_a)
        .def_rw("last", &ClearanceInLoop::last, nb::arg().none(), "Time of its last tick [s], None before the first.")
        .def(
            "begin",
            [](ClearanceInLoop& c, Given q) {
                const Workspace::Frame frame(workspace());
                c.begin(Reader(workspace()).vector(q, "q", joints_of(*c.clearance)));
            },
            "q"_a);
    module.def(
        "witnesses",
        [](Given one, Given other) {
            const Workspace::Frame frame(workspace());
            Reader read(workspace());
            const Shape a = shape_of(read.vector(one, "one", SHAPE_NUMBERS)),
                        b = shape_of(read.vector(other, "other", SHAPE_NUMBERS));
            if (a.core == ShapeCore::mesh || b.core == ShapeCore::mesh)
                refuse("a mesh has no witnesses here");
            return array_of(witnesses(a, b));
        },
        "one"_a, "other"_a, "(k, 7) distance, normal and point of each witness of two shapes (17,), by distance.");
    module.def("braking_states", states_of, "arms"_a, "q"_a, "before"_a, "limits"_a, "dt"_a, "rate"_a,
               "Positions, weights and longer of each state, grows and y.");
}

}  // namespace iq
