// What other modules for Python need of a loop's.
#pragma once
#include "loop.hpp"

namespace iq {

// The functions (arm, rows, after, exact, law) of the user's, each a function or None; they read into a workspace.
LoopFunctions loop_functions(nb::handle given, Reader& read, int m, Workspace& w);

}  // namespace iq
