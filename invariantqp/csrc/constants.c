/* The constants of the twins, for the test that compares them with Python's. */

#include "core.h"

#define ONE(file, name) {file "." #name, name}

const Constant CONSTANTS[] = {
    ONE("velocity.regular", ACCURATE_SHARE),
    ONE("velocity.objective", NULL_RATIO),
    ONE("velocity.objective", NULL_WEIGHT),
    ONE("velocity.calm", CALM),
    ONE("velocity.calm", DEVIATION_SHARE),
    ONE("velocity.calm", QUIET_SHARE),
    ONE("velocity.qp.quadratic", FEASIBLE),
    ONE("velocity.qp.polytope", ROW_TOLERANCE),
    ONE("velocity.qp.active", DEPENDENT),
    ONE("velocity.qp.primal", PARALLEL),
    ONE("velocity.qp.primal", STEPS),
    ONE("velocity.qp.polytope", ACTIVE_TOLERANCE),
    ONE("velocity.report", MET_TOLERANCE),
    ONE("velocity.report", PRODUCT_ROUNDING),
    ONE("velocity.report", LOSS_TOLERANCE),
    ONE("velocity.report", PROGRESS_SHARE),
    ONE("velocity.report", WHOLE_SPEED),
    ONE("velocity.share", REGULARISATION),
    ONE("velocity.share", EXACT_CALM),
    ONE("velocity.share", WHOLE),
    ONE("velocity.share", INTERIOR),
    ONE("velocity.law", ROW_ROUNDING),
    ONE("velocity.qp.slow", NEWTON_STEPS),
    ONE("velocity.limits.cone", CONE_TOLERANCE),
    ONE("velocity.limits.cone", FIXED_TOLERANCE),
    ONE("velocity.limits.cone", MOST_SHARE),
    ONE("control.convergence", MEMORY),
    ONE("control.approach", HALF_TURN),
    {NULL, 0.0},
};
