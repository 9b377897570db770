// Shared by all bindings: the workspace, numbers and tuples of arguments, solutions.
#pragma once
#include "arrays.hpp"
#include "report.hpp"

namespace iq {

using namespace nanobind::literals;

constexpr int MOST_JOINTS = 64, MOST_EXACT = 6 * MOST_JOINTS;

inline Workspace& workspace()
{
    thread_local Workspace w;
    return w;
}
inline double number(nb::handle value, const char* name, double least, double most)
{
    double x;
    if (!nb::try_cast<double>(value, x) || !(least <= x && x <= most))
        refuse(std::string(name) + " is no number in its range");
    return x;
}
inline nb::tuple parts(nb::handle value, const char* name, std::size_t count)
{
    if (!nb::isinstance<nb::tuple>(value) || nb::len(value) != count)
        refuse(std::string(name) + " is no tuple of " + std::to_string(count));
    return nb::borrow<nb::tuple>(value);
}
inline void check_box(Vec lower, Vec upper)
{
    for (int i = 0; i < lower.n; i++)
        if (!(lower[i] <= upper[i]) || lower[i] == INFINITY || upper[i] == -INFINITY)
            refuse("the bounds of joint " + std::to_string(i) + " cross");
}

// Sets the answer of another solver: velocity, approach scale, scale, residual, form share, whether limits are active,
// relaxed or None, speed excess.
inline void set_answer(Answer& answer, nb::handle found, const Tick& tick, Reader& read)
{
    const nb::tuple given = parts(found, "the answer", 8);
    std::size_t at = 0;
    const auto next = [&]() -> nb::object { return given[at++]; };
    answer.velocity = read.vector(next(), "the velocity", tick.J.cols);
    answer.approach_scale = number(next(), "the approach scale", 0, 1), answer.scale = number(next(), "the scale", 0, 1);
    answer.residual = number(next(), "the residual", 0, LARGEST_NUMBER);
    answer.form_share = number(next(), "the form share", 0, 1), answer.limits_active = nb::cast<bool>(next());
    const nb::object relaxed = next();
    answer.relaxed = relaxed.is_none() ? Vec() : read.vector(relaxed, "relaxed", tick.C.rows);
    answer.speed_excess = number(next(), "the speed excess", 0, LARGEST_NUMBER);
    answer.multipliers = Vec(), answer.failure = Failure::none;
}

// The fields of a VelocitySolution up to row_multipliers, method and status as numbers.
inline nb::tuple solution(const Report& found)
{
    nb::object active = nb::steal(PyTuple_New(static_cast<Py_ssize_t>(found.active.size())));
    for (std::size_t i = 0; i < found.active.size(); i++)
        PyTuple_SetItem(active.ptr(), static_cast<Py_ssize_t>(i), PyLong_FromLong(found.active[i]));
    return nb::make_tuple(
        array_of(found.velocity), static_cast<int>(found.method), static_cast<int>(found.status),
        nb::bytes(reinterpret_cast<const char*>(found.reasons.data()), found.reasons.size() * sizeof(double)), active,
        array_of(found.residual), found.scale, found.damping, found.guard, array_or_none(found.multipliers),
        array_or_none(found.row_multipliers));
}

void bind_loop(nb::module_& m);
void bind_pose(nb::module_& m);
void bind_clearance(nb::module_& m);
void bind_follower(nb::module_& m);
void bind_screws(nb::module_& m);
void bind_force(nb::module_& m);

}  // namespace iq
