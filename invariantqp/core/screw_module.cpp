// Bindings of chains and screw systems: the class Chain and functions of invariantqp._core, None if ill conditioned.
#include "bound.hpp"
#include "chain.hpp"
#include "screw_systems.hpp"

namespace iq {
namespace {

nb::object array_of(Mat A)
{
    const npy_intp shape[2] = {A.rows, A.cols};
    nb::object array = new_array(2, shape);
    std::copy(A.all().begin(), A.all().end(), data_of(array));
    return array;
}

// coordinates (k,) of joints that share them, or None.
void make_chain(Chain* self, nb::handle screws, nb::handle home, nb::handle coordinates)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    Chain chain(read.matrix(screws, "screws", 6, -1), Pose(read.matrix(home, "home", 4, 4).p));
    if (!coordinates.is_none()) {
        const Vec of = read.vector(coordinates, "coordinates", chain.count());
        std::vector<int> each;
        for (const double x : of) {
            if (!(x >= 0 && x < chain.count()))
                refuse("coordinates has a number that is no joint's");
            each.push_back(static_cast<int>(x));
        }
        chain.couple(each);
    }
    new (self) Chain(chain);
}
// Joint twists (6, m) and tool pose (4, 4), and the error twist (6,) to a target, None without one.
nb::tuple state(const Chain& chain, nb::handle q, nb::handle target)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const Mat J(w, 6, chain.size()), T(w, 4, 4);
    const Pose tool = chain.state(read.vector(q, "q", chain.size()).p, J);
    tool.write(T.p);
    if (target.is_none())
        return nb::make_tuple(array_of(J), array_of(T), nb::none());
    const Twist error = error_twist(Pose(read.matrix(target, "target", 4, 4).p), tool);
    Vec e(w, 6);
    std::copy(error.omega.begin(), error.omega.end(), e.begin()), std::copy(error.v.begin(), error.v.end(), e.begin() + 3);
    return nb::make_tuple(array_of(J), array_of(T), iq::array_of(e));
}

// (k + 1, 4, 4) motions of the base and of each link, from their poses at q = 0.
nb::object motions(const Chain& chain, nb::handle q)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    std::vector<Pose> poses(static_cast<std::size_t>(chain.count()) + 1);
    chain.motions(read.vector(q, "q", chain.size()).p, Mat(), poses.data());
    const npy_intp shape[3] = {chain.count() + 1, 4, 4};
    nb::object array = new_array(3, shape);
    for (std::size_t i = 0; i < poses.size(); i++)
        poses[i].write(data_of(array) + POSE_NUMBERS * i);
    return array;
}

// Twists or wrenches (6, m): finite numbers whose products neither vanish nor overflow.
Mat columns_of(nb::handle value, const char* name, Reader& read)
{
    const Mat A = read.matrix(value, name, 6, -1);
    for (const double x : A.all())
        if (x != 0 && !(std::abs(x) >= SMALLEST && std::abs(x) <= LARGEST))
            refuse(std::string(name) + " has numbers that are too small or too large");
    return A;
}
nb::object pseudoinverse_of(nb::handle J, double h)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    const Mat twists = columns_of(J, "J", read);
    if (twists.cols < 1 || twists.cols > MOST_JOINTS)
        return nb::none();
    const std::optional<Mat> inverse = pseudoinverse(twists, h);
    return inverse ? array_of(*inverse) : nb::none();
}
// The fields of DualProjectors in order. Given are twists or wrenches, and one of pitch, complement and metric.
nb::object projectors_of(nb::handle twists, nb::handle wrenches, nb::handle pitch, nb::handle complement, nb::handle metric)
{
    Workspace& w = workspace();
    const Workspace::Frame frame(w);
    Reader read(w);
    using Kind = ComplementRule::Kind;
    ComplementRule rule{Kind::pitch, 0, {}};
    if (!pitch.is_none())
        rule.pitch = number(pitch, "h", -LARGEST, LARGEST);
    else if (!complement.is_none())
        rule = {Kind::columns, 0, columns_of(complement, "complement", read)};
    else {
        rule.kind = Kind::metric;
        const nb::object given = nb::borrow(metric);
        if (PyArray_Check(given.ptr()) && PyArray_NDIM(reinterpret_cast<PyArrayObject*>(given.ptr())) == 1) {
            const Vec diagonal = read.vector(given, "metric", 6);
            rule.matrix = Mat(w, 6, 6, 0);
            for (int i = 0; i < 6; i++)
                rule.matrix(i, i) = diagonal[i];
        } else
            rule.matrix = read.matrix(given, "metric", 6, 6);
    }
    const bool dual = twists.is_none();
    const Mat columns = columns_of(dual ? wrenches : twists, dual ? "wrenches" : "S", read);
    if (columns.cols > MOST_JOINTS || (dual && columns.cols == 0))
        return nb::none();
    const std::optional<Projectors> split = projectors(columns, dual, rule);
    if (!split)
        return nb::none();
    return nb::make_tuple(array_of(split->motion), array_of(split->force), array_of(split->freedoms), array_of(split->complement),
                          array_of(split->constraints), split->norm, split->unit);
}

}  // namespace

void bind_screws(nb::module_& m)
{
    nb::class_<Chain>(m, "Chain", "An open chain of hinges, slides and screws.")
        .def("__init__", make_chain, "screws"_a, "home"_a, "coordinates"_a = nb::none())
        .def("motions", motions, "q"_a, "(k + 1, 4, 4) motions of the base and of each link from q = 0.")
        .def("state", state, "q"_a, "target"_a.none(), "Joint twists (6, m), tool pose (4, 4), error twist (6,) or None.");
    m.def("pseudoinverse", pseudoinverse_of, "J"_a, "h"_a, "J^{+h} (m, 6), None if it is not well conditioned.");
    m.def("projectors", projectors_of, "S"_a.none(), "wrenches"_a.none(), "h"_a.none(), "complement"_a.none(), "metric"_a.none(),
          "The fields of DualProjectors, None if they are not well conditioned.");
}

}  // namespace iq
