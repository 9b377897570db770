// Targets that leave something free, read from Python.
#pragma once
#include "bound.hpp"
#include "target.hpp"

namespace iq {

// A target that leaves something free: (point, axis, tool_point, tool_axis), axes of unit length, the first or second None.
inline PartialTarget partial_target(nb::handle value, Reader& read)
{
    const nb::tuple given = parts(value, "target", 4);
    const auto three = [&](std::size_t i) { return vec3(read.vector(given[i], "target", 3)); };
    PartialTarget found;
    found.has_point = !given[0].is_none(), found.has_axis = !given[1].is_none();
    if (!found.has_point && !found.has_axis)
        refuse("target has neither a point nor an axis");
    if (found.has_point)
        found.point = three(0);
    if (found.has_axis)
        found.axis = three(1);
    found.tool_point = three(2), found.tool_axis = three(3);
    return found;
}

}  // namespace iq
