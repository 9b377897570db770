// What other modules for Python need of a loop's.
#pragma once
#include "loop.hpp"

namespace iq {

// The functions (arm, limits, exact, law) of the user's, as `Callbacks` gives them, or None; they read into a workspace.
LoopFunctions loop_functions(nb::handle given, Reader& read, int m, Workspace& w);
// The fields of a solution; where functions were asked, also where its rows come from, and what of limits does not hold.
nb::object loop_solution(const LoopReport& found, const LoopFunctions& functions, bool asked);

}  // namespace iq
