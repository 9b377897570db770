#include "pose.hpp"
#include "feasible_set.hpp"

namespace iq {
namespace {

using Clock = std::chrono::steady_clock;

// Newton's method goes on to this factor of the tolerance, so that the choice of the tool frame does not decide which
// step is the last.
constexpr double GOAL_FACTOR = 1e-3;
// Damping at the start of a try [1 / rad^2], its factors after steps that succeed and fail, and its least value.
constexpr double INITIAL_DAMPING = 0.1, DAMPING_DECREASE = 0.5, DAMPING_INCREASE = 4, MIN_DAMPING = 1e-3;
// Damping at which a try ends: rounding is all that is left.
constexpr double MAX_DAMPING = 1e8;
// Shares of the trace of A'A and of C'C that keep AA', A'A and CC' definite, far below the damping.
constexpr double GRAM_REGULARISATION = 1e-13, HESSIAN_REGULARISATION = 1e-8, ROW_REGULARISATION = 1e-9;
// Relative size below which rows are linearly dependent.
constexpr double RANK_TOLERANCE = 1e-10;
// Steps that must halve the error of a try, and steps without progress after which a refinement has converged.
constexpr int STALL_WINDOW = 6, REFINE_WINDOW = 3;
// Most steps of a try and of a refinement.
constexpr int MAX_STEPS = 100, MAX_REFINE_STEPS = 1000;
// Relative decrease of the merit that is none.
constexpr double MERIT_TOLERANCE = 1e-12;
// Joint displacement for finite differences of the gradient.
constexpr double FINITE_DIFFERENCE = 1e-7;
// Bound of multipliers, in |A| |r| / |C|, since those of infeasible rows diverge; factor of the penalty over them.
constexpr double MAX_MULTIPLIER = 10, PENALTY_MARGIN = 2;
// Relative difference that is rounding: of a joint from a step's bound, of two merits.
constexpr double RELATIVE_ROUNDING = 1e-9;
// Shares of the time limit for tries, without and with exact demands; the rest is for the refinement of the closest.
constexpr double SEARCH_SHARE = 0.8, EXACT_SHARE = 0.6;
constexpr int REFINED_TRIES = 4;
// Without a start: number of solutions of exact demands that end the search, and of tries at the whole pose before.
constexpr int EXACT_SOLUTIONS = 3, WHOLE_POSE_TRIES = 2;
// Distance within which a target is near the start [rad, lengths of the arm]; the first restarts are then around the
// start, within a radius [rad] that doubles every second time.
constexpr double NEARBY = 2, LOCAL_RADIUS = 0.2;
constexpr int LOCAL_RESTARTS = 12;
// Most repeats of a refinement, and the factor by which each must lower the merit.
constexpr int MAX_REPEATS = 8;
constexpr double MIN_REPEAT_GAIN = 0.999;
// Distance beyond a limit [rad] from which a joint is moved to it, if that keeps the target met.
constexpr double LIMIT_SLACK = 1e-3;
// Block exchanges without progress before joints are exchanged one at a time.
constexpr int BLOCK_PIVOTS = 3;

double half_square(Vec r) { return 0.5 * r.square(); }

// A A' + size I
Mat gram(Mat A, double size)
{
    Mat S(*A.w, A.rows, A.rows);
    for (int i = 0; i < A.rows; i++) {
        for (int j = 0; j < i; j++)
            S(i, j) = S(j, i) = A[i].dot(A[j]);
        S(i, i) = A[i].square() + size;
    }
    return S;
}

// A'A
Mat normal(Mat A)
{
    Mat H(*A.w, A.cols, A.cols, 0);
    for (int k = 0; k < A.rows; k++)
        for (int i = 0; i < A.cols; i++)
            H[i].part(i, A.cols).add(A(k, i), A[k].part(i, A.cols));
    for (int i = 0; i < A.cols; i++)
        for (int j = 0; j < i; j++)
            H(i, j) = H(j, i);
    return H;
}

void clip(Vec x, Vec lower, Vec upper)
{
    for (int i = 0; i < x.n; i++)
        x[i] = std::min(std::max(x[i], lower[i]), upper[i]);
}

// argmin 1/2 x'Hx - g'x over lower <= x <= upper, by block principal pivoting (Judice and Pires 1992): joints outside
// become active, joints whose multiplier has the wrong sign become free. Absent if H is not definite.
Vec box_minimum(Mat H, Vec g, Vec lower, Vec upper, Vec guess)
{
    const int m = g.n;
    Workspace& w = *g.w;
    const Vec x(w, m);
    std::array<int, 64> side{}, wrong{}, free;
    for (int j = 0; guess.w && j < m; j++)
        side[j] = guess[j] > upper[j] ? 1 : guess[j] < lower[j] ? -1 : 0;
    int fewest = m + 1, patience = BLOCK_PIVOTS;
    for (int count = 0; count < 50 + 10 * m; count++) {
        const Workspace::Frame frame(w);
        int n = 0;
        for (int j = 0; j < m; j++)
            if (side[j])
                x[j] = side[j] > 0 ? upper[j] : lower[j];
            else
                x[free[n++] = j] = 0;
        Mat F(w, n, n);
        Vec left(w, n);
        for (int i = 0; i < n; i++) {
            const Vec row = H[free[i]], to = F[i];
            left[i] = g[free[i]] - row.dot(x);
            for (int j = i; j < n; j++)
                to[j] = row[free[j]];
        }
        bool positive = true;
        const Mat U = cholesky(F, &positive);
        if (!positive)
            return Vec();
        const Vec y = solved(U, solved(t(U), left));
        for (int i = 0; i < n; i++)
            x[free[i]] = y[i];
        int outside = 0, last = 0;
        for (int j = 0; j < m; j++) {
            if (!side[j]) {
                const double margin = MERIT_TOLERANCE * (1 + std::abs(x[j]));
                wrong[j] = x[j] > upper[j] + margin ? 1 : x[j] < lower[j] - margin ? -1 : 0;
            } else
                wrong[j] = side[j] * (H[j].dot(x) - g[j]) > MERIT_TOLERANCE * std::abs(g[j]);
            if (wrong[j])
                outside++, last = j;
        }
        if (!outside) {
            clip(x, lower, upper);
            return x;
        }
        // All exchanges at once; without progress one at a time, which terminates.
        patience = outside < fewest ? BLOCK_PIVOTS : patience - 1;
        fewest = std::min(fewest, outside);
        for (int j = patience < 0 ? last : 0; j < m; j++)
            if (wrong[j])
                side[j] = side[j] ? 0 : wrong[j];
    }
    return Vec();
}

// argmin 1/2 x'Hx - g'x over lower <= N x <= upper; absent if none is found.
Vec minimum(Mat H, Vec g, Vec lower, Vec upper, Mat N)
{
    bool positive = true;
    const Mat U = cholesky(H, &positive);
    if (!positive)
        return Vec();
    const Vec x = solved(U, solved(t(U), g));
    if (within(lower, N * x, upper))
        return x;
    const auto found = polytope_optimum({inverse(U), x}, {N, lower, upper, {}, {}});
    return found ? found->y : Vec();
}

// The derivative K of log(exp(omega) exp(-t)) = omega - K t + ...
Mat3 log_derivative(const Vec3& omega)
{
    const double theta = norm(omega), square = theta * theta;
    const double c = theta < SMALL_ANGLE ? (1 + square / 60) / 12 : (1 - 0.5 * theta / std::tan(0.5 * theta)) / square;
    Mat3 K{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    const Mat3 W{{{0, -omega[2], omega[1]}, {omega[2], 0, -omega[0]}, {-omega[1], omega[0], 0}}};
    const Mat3 WW = W * W;
    for (int i = 0; i < 3; i++)
        K[i] = K[i] + 0.5 * W[i] + c * WW[i];
    return K;
}

// What a descent minimises: the pose error and the exact demands, or one of them.
enum class Objective { all, pose, demands };

// The errors at q (m,), to first order: a step x changes r to r - A x, and b to b - C x; exact_error is |b|.
struct Linearisation {
    Vec q, r, b;
    Mat A, C;
    double f = 0, exact_error = 0;

    Linearisation(Workspace& w, int m, int n, int k) : q(w, m), r(w, n), b(w, k), A(w, n, m), C(w, k, m) {}
    double distance() const { return std::sqrt(2 * f) + exact_error; }
    double merit(double penalty) const { return f + penalty * exact_error; }
};

// The end of a descent.
struct Try {
    std::vector<double> q;
    double f = 0, exact_error = 0, merit = 0;
    int steps = 0;
    bool met = false, converged = false;
    int number = 0;  // of its start: 0 is the given one, or the middle of the range
};

struct DescentOptions {
    bool may_turn_over = true;   // a hinge may leave its limits, and is shifted back by whole turns
    bool is_refinement = false;  // converges to the last digit, also if the target cannot be met
    int window = STALL_WINDOW;
    Objective objective = Objective::all;
    int max_steps = MAX_STEPS;
};

class Search {
  public:
    Search(const PoseArm& arm, const PoseTask& task, Workspace& w)
        : arm(arm), task(task), w(w), m(arm.size()), goal(GOAL_FACTOR * task.tolerance * task.min_singular_value),
          begun(task.time_limit < INFINITY ? Clock::now() : Clock::time_point()), exact_tolerance(task.tolerance)
    {
        for (const ExactDemand& one : task.exact)
            if (one.of.kind == Demand::Kind::axis)  // radians are scaled by the arm's length
                exact_tolerance = task.tolerance * std::min(1.0, arm.length);
    }

    PoseResult solve(const double* given)
    {
        const bool exact = !task.exact.empty();
        const double* const first = given ? given : arm.middle.data();
        std::vector<double> start(first, first + m), next;
        if (given)
            arm.wrap_into_limits(start.data());
        deadline = (exact ? EXACT_SHARE : SEARCH_SHARE) * task.time_limit;
        const bool is_nearby = given && is_near_target(start.data());
        // A redundant arm, or any near its target, may pass a limit without turning a joint by 2 pi: first try that.
        const bool keeps_branch = given && (m > task.size() || exact || is_nearby);
        std::vector<Try> tried;
        int exact_count = 0, steps = 0;
        for (int k = 0; k <= task.restarts && (k == 0 || !is_timed_out()); k++) {
            next = start;
            if (k > 0)
                sample_start(k, next.data());
            const bool near = is_nearby && k <= LOCAL_RESTARTS;
            if (near && k > 0)
                sample_near(start.data(), LOCAL_RADIUS * std::exp2((k - 1) / 2.), next.data());
            const bool may_turn_over = !(keeps_branch && (k == 0 || near));
            tried.push_back(exact ? try_exact(next, !given && k < WHOLE_POSE_TRIES, may_turn_over)
                                  : descend(next.data(), {may_turn_over}));
            tried.back().number = k;
            steps += tried.back().steps;
            if (tried.back().met && is_allowed(tried.back()))
                break;
            exact_count += exact && !misses_exact(tried.back()) && is_allowed(tried.back());
            if (exact_count >= (given ? 1 : EXACT_SOLUTIONS))
                break;
        }
        const bool over = is_timed_out();
        const int tries = static_cast<int>(tried.size());
        if (std::any_of(tried.begin(), tried.end(), [](const Try& one) { return one.met; }))
            return result(widest_clearance(tried), start, steps, tries, over);
        // Refine the closest, which may meet the target then. If none does, the solution for a given start is the one
        // downhill from it, unless only others meet the exact demands.
        const bool downhill = given && !exact_count;
        std::vector<Try> refined;
        if (downhill)
            refined.push_back(refined_try(tried[0]));
        for (const Try& one : closest(tried, exact_count ? (given ? 1 : EXACT_SOLUTIONS) : REFINED_TRIES))
            if (!(downhill && one.number == 0))
                refined.push_back(refined_try(one));
        bool found = !downhill;
        for (const Try& one : refined) {
            steps += one.steps;
            found = found || one.met || (exact && !misses_exact(one));
        }
        return result(found ? nearest(refined) : refined[0], start, steps, tries, over);
    }

    bool descend_to(double* q)
    {
        const bool exact = !task.exact.empty();
        Try found = descend(q, {m <= 6 && !exact, false, exact ? REFINE_WINDOW : STALL_WINDOW});
        arm.wrap_near(found.q.data(), q, 0);
        std::copy(found.q.begin(), found.q.end(), q);
        return found.met || (exact && found.exact_error <= goal);
    }

  private:
    const PoseArm& arm;
    const PoseTask& task;
    Workspace& w;
    const int m;
    const double goal;
    const Clock::time_point begun;
    double exact_tolerance, deadline = INFINITY;

    bool is_timed_out() const
    {
        return deadline < INFINITY && std::chrono::duration<double>(Clock::now() - begun).count() > deadline;
    }
    bool is_allowed(const Try& one) const { return !task.clearance || task.clearance(one.q.data()) == INFINITY; }
    bool misses_exact(const Try& one) const { return one.exact_error > exact_tolerance; }
    // Whether a is better: exact demands first, then the merit.
    bool is_better(const Try& a, const Try& b) const
    {
        if (misses_exact(a) != misses_exact(b))
            return misses_exact(b);
        return misses_exact(a) && a.exact_error != b.exact_error ? a.exact_error < b.exact_error : a.merit < b.merit;
    }
    // The first of those that met the target with the largest clearance.
    const Try& widest_clearance(const std::vector<Try>& tried) const
    {
        const Try* best = nullptr;
        double most = -INFINITY;
        for (const Try& one : tried) {
            if (!one.met)
                continue;
            const double clearance = task.clearance ? task.clearance(one.q.data()) : INFINITY;
            if (!best || clearance > most)
                best = &one, most = clearance;
        }
        return *best;
    }
    // The best tries, of those that met exact demands with clearance, if any did.
    std::vector<Try> closest(const std::vector<Try>& tried, int most) const
    {
        std::vector<Try> found = tried, allowed;
        std::stable_sort(found.begin(), found.end(), [&](const Try& a, const Try& b) { return is_better(a, b); });
        for (const Try& one : found)
            if (!task.exact.empty() && !misses_exact(one) && is_allowed(one))
                allowed.push_back(one);
        if (!allowed.empty())
            found = allowed;
        found.resize(std::min<std::size_t>(found.size(), most));
        return found;
    }
    // The best, and of equal ones the first tried, so that rounding does not choose between mirror images.
    const Try& nearest(const std::vector<Try>& refined) const
    {
        const Try* least = &refined[0];
        for (const Try& one : refined)
            if (is_better(one, *least))
                least = &one;
        const Try* best = least;
        for (const Try& one : refined)
            if (misses_exact(one) == misses_exact(*least) && one.merit <= (1 + RELATIVE_ROUNDING) * least->merit
                && one.number < best->number)
                best = &one;
        return *best;
    }

    void sample_start(int k, double* q) const
    {
        for (int j = 0; j < m; j++) {
            const double share = std::fmod(task.start_origin[j] + k * arm.start_stride[j], 1.0);
            q[j] = arm.start_lower[j] + share * (arm.start_upper[j] - arm.start_lower[j]);
        }
    }

    // Maps q from the joint range to the neighbourhood of a start, joints within a radius [rad].
    void sample_near(const double* start, double radius, double* q) const
    {
        for (int j = 0; j < m; j++) {
            const double range = std::max(arm.start_upper[j] - arm.start_lower[j], TINY);
            const double share = 2 * (q[j] - arm.start_lower[j]) / range - 1;
            q[j] = start[j] + share * radius * (arm.full_turn[j] > 0 ? arm.full_turn[j] / (2 * M_PI) : arm.length);
        }
        arm.wrap_into_limits(q);
    }

    // A try with exact demands: the whole pose first, if `whole`; then the demands alone, then all from there.
    Try try_exact(const std::vector<double>& start, bool whole, bool may_turn_over)
    {
        Try one{start};
        if (whole) {
            one = descend(start.data(), {may_turn_over, false, STALL_WINDOW, Objective::pose});
            if (one.met)
                return one;
        }
        one = after(one, descend(one.q.data(), {may_turn_over, false, STALL_WINDOW, Objective::demands}));
        if (!one.met) {
            one.exact_error = std::sqrt(2 * one.f);
            return one;
        }
        one = after(one, descend(one.q.data(), {may_turn_over}));
        return one.met || one.exact_error <= goal ? one : projected_to_exact(one);
    }
    static Try after(const Try& before, Try one)
    {
        one.steps += before.steps;
        one.number = before.number;
        return one;
    }
    // A descent from a try to the exact demands alone.
    Try projected_to_exact(const Try& one)
    {
        const Try back = descend(one.q.data(), {true, false, STALL_WINDOW, Objective::demands});
        if (!back.met)
            return one;
        Try there = after(back, descend(back.q.data(), {true, false, STALL_WINDOW, Objective::all, 0}));
        there.steps += one.steps;
        there.converged = one.converged, there.number = one.number;
        return there;
    }

    // A try, converged to the last digits; repeated with exact demands, since each has a penalty of its own.
    Try refined_try(const Try& tried)
    {
        deadline = task.time_limit;
        Try one = tried;
        one.steps = 0;
        if (!task.exact.empty() && !misses_exact(tried) && tried.converged)
            return one;
        one = after(one, descend(one.q.data(), {true, true, REFINE_WINDOW}));
        for (int k = 0; k < MAX_REPEATS && !task.exact.empty() && !one.met; k++) {
            const Try again = after(one, descend(one.q.data(), {true, true, REFINE_WINDOW}));
            const bool gained = misses_exact(again) != misses_exact(one) ? misses_exact(one)
                                                                         : again.merit < MIN_REPEAT_GAIN * one.merit;
            const int steps = again.steps;
            if (gained)
                one = again;
            one.steps = steps;
            if (one.met || !gained)
                break;
        }
        if (!task.exact.empty() && !one.met && one.exact_error > goal)
            one = projected_to_exact(one);
        if (misses_exact(one) && !misses_exact(tried)) {  // beside a singularity of the demands
            const int steps = one.steps;
            one = tried;
            one.steps = steps, one.converged = true;
        }
        return one;
    }

    PoseResult result(const Try& best, const std::vector<double>& start, int steps, int tries, bool over)
    {
        PoseResult found;
        found.q = best.q;
        arm.wrap_near(found.q.data(), start.data(), best.met ? LIMIT_SLACK : 0);
        set_pose_errors(found);
        if (best.met && !is_reached(found)) {
            found.q = best.q;
            arm.wrap_near(found.q.data(), start.data(), 0);
            set_pose_errors(found);
        }
        const bool reached = is_reached(found);
        const bool exact = !task.exact.empty(), exactly = exact && !misses_exact(best);
        found.outcome = reached && (exactly || !exact) ? PoseOutcome::reached
                        : exactly && best.converged    ? PoseOutcome::exact_reached
                        : over || exactly              ? PoseOutcome::timed_out
                                                       : PoseOutcome::out_of_reach;
        found.error = std::sqrt(2 * best.f);
        found.iterations = steps, found.tries = tries, found.other_branch = best.number > 0;
        for (int j = 0; j < m; j++) {
            const double displacement = std::abs(found.q[j] - start[j]);
            found.displacement = std::max(found.displacement, displacement);
            if (arm.can_turn_over(j) && displacement > (0.5 + LIMIT_SLACK) * arm.full_turn[j])
                found.other_branch = true;
        }
        return found;
    }

    // Whether the target is within NEARBY of a start.
    bool is_near_target(const double* start) const
    {
        const auto [off, angle] = pose_errors(arm.state(start, Mat()), task.point);
        return std::hypot(off / arm.length, angle) <= NEARBY;
    }
    void set_pose_errors(PoseResult& found) const
    {
        std::tie(found.position, found.orientation) = pose_errors(arm.state(found.q.data(), Mat()), Vec3{});
    }
    // Distance of a point of the tool from its target, and the angle; 0 for free components.
    std::pair<double, double> pose_errors(const Pose& tool, const Vec3& point) const
    {
        if (!task.partial_target)
            return {norm(task.target * point - tool * point),
                    norm(rotation_vector(task.target.R * transposed(tool.R)))};
        const Twist error = task.partial_target->error(tool, {});
        return {norm(task.partial_target->off(tool)), norm(error.omega)};
    }
    bool is_reached(const PoseResult& found) const
    {
        return found.position <= task.tolerance && found.orientation <= task.tolerance;
    }

    int exact_rows(const double* q) const
    {
        int k = 0;
        for (const ExactDemand& one : task.exact)
            k += one.rows ? one.rows(q, Mat(), Vec()) : one.of.rows();
        return k;
    }

    // Computes the errors and their derivatives at state.q.
    void linearise(Linearisation& state, Objective objective) const
    {
        const Workspace::Frame frame(w);
        Mat J = !task.partial_target && !task.root.w && objective != Objective::demands ? state.A : Mat(w, 6, m);
        const Pose tool = arm.state(state.q.p, J);
        if (objective == Objective::demands) {
            set_rows(state.A, state.r, state.q.p, tool, J);
            state.f = half_square(state.r);
            return;
        }
        if (state.C.rows)
            set_rows(state.C, state.b, state.q.p, tool, J);
        if (task.partial_target) {
            const Mat root = task.partial_target->root(tool, task.length, w);
            state.A.set(root * J);
            state.r.set(root * vec(task.partial_target->error(tool, {}), w));
        } else
            set_whole_pose(state, tool, J);
        state.f = half_square(state.r);
        state.exact_error = state.b.norm();
    }
    // A and r of the whole pose; J is replaced by the point's.
    void set_whole_pose(Linearisation& state, const Pose& tool, Mat J) const
    {
        const Vec3 here = tool * task.point, off = task.target * task.point - here;
        for (int j = 0; j < m; j++) {
            const Vec3 omega{J(0, j), J(1, j), J(2, j)}, moved = cross(omega, here);
            for (int i = 0; i < 3; i++)
                J(3 + i, j) += moved[i];
        }
        const Vec3 omega = rotation_vector(task.target.R * transposed(tool.R));
        if (!task.root.w) {
            J.rows_from(0, 3).all().scale(task.length);
            for (int i = 0; i < 3; i++)
                state.r[i] = task.length * omega[i], state.r[3 + i] = off[i];
            return;
        }
        const Mat3 K = log_derivative(omega);
        Vec error(w, 6);
        for (int i = 0; i < 3; i++)
            error[i] = omega[i], error[3 + i] = off[i];
        for (int j = 0; j < m; j++) {
            const Vec3 turned = K * Vec3{J(0, j), J(1, j), J(2, j)};
            for (int i = 0; i < 3; i++)
                J(i, j) = turned[i];
        }
        state.A.set(task.root * J);
        state.r.set(task.root * error);
    }

    // Rows C of the exact demands and their errors b; those of an axis are scaled by the arm's length.
    void set_rows(Mat C, Vec b, const double* q, const Pose& tool, Mat J) const
    {
        int k = 0;
        for (const ExactDemand& one : task.exact) {
            const int count = one.rows ? one.rows(q, Mat(), Vec()) : one.of.rows();
            const Mat to = C.rows_from(k, k + count);
            const Vec missed = b.part(k, k + count);
            k += count;
            if (one.rows) {
                one.rows(q, to, missed);
                continue;
            }
            DemandRows rows(w, count, m);
            rows.add(one.of, J, tool, task.target, 1, Twist{}, Twist{}, 0);
            to.set(rows.E), missed.set(rows.E_e);
            if (one.of.kind == Demand::Kind::axis)
                to.all().scale(arm.length), missed.scale(arm.length);
        }
    }

    // A'r, the negative gradient of f.
    Vec descent_direction(const Linearisation& state) const { return t(state.A) * state.r; }

    // Hessian of f by finite differences, with the absolute values of its eigenvalues; or of f + y'b on the rows of B.
    Mat curvature(const Linearisation& state, Mat B = Mat(), Vec y = Vec()) const
    {
        Linearisation displaced(w, m, state.r.n, state.b.n);
        const auto direction = [&](const Linearisation& at) {
            return y.w ? descent_direction(at) - t(at.C) * y : descent_direction(at);
        };
        const Vec here = direction(state);
        Mat H(w, m, m);
        for (int i = 0; i < m; i++) {
            const double h = state.q[i] + FINITE_DIFFERENCE > arm.upper[i] ? -FINITE_DIFFERENCE : FINITE_DIFFERENCE;
            displaced.q.set(state.q);
            displaced.q[i] += h;
            linearise(displaced, Objective::all);
            H[i].set((here - direction(displaced)) / h);
        }
        if (B.w)
            H = B * (H * t(B));
        for (int i = 0; i < H.rows; i++)
            for (int j = 0; j <= i; j++)
                H(i, j) = H(j, i) = 0.5 * (H(i, j) + H(j, i));
        const SymmetricEigen of(H);
        const Mat M = of.V.copy();
        for (int i = 0; i < M.rows; i++)
            M[i].scale(std::abs(of.values[i]));
        return t(of.V) * M;
    }

    // argmin 1/2 |r - A x|^2 + 1/2 mu |x|^2 inside the box; H is the Hessian in place of A'A, if it has memory.
    Vec step(const Linearisation& state, Mat H, double mu, Vec lower, Vec upper) const
    {
        const Mat A = state.A;
        const double size = A.all().square();
        const Vec g = descent_direction(state);
        Vec guess(w, m);
        bool held = false;  // whether a limit is active
        for (int j = 0; j < m; j++) {
            guess[j] = g[j] > 0 && upper[j] <= 0 ? INFINITY : g[j] < 0 && lower[j] >= 0 ? -INFINITY : 0;
            held = held || guess[j] != 0;
        }
        if (!H.w && !held && m >= A.rows) {
            bool positive = true;
            const Mat U = cholesky(gram(A, mu + GRAM_REGULARISATION * size), &positive);
            const Vec x = t(A) * solved(U, solved(t(U), state.r));
            if (positive && within(lower, x, upper))
                return x;
            guess = x;
        }
        if (!H.w)
            H = normal(A);
        for (int i = 0; i < m; i++)
            H(i, i) += std::max(mu, HESSIAN_REGULARISATION * size);
        const Vec x = box_minimum(H, g, lower, upper, guess);
        if (x.w)
            return x;
        g.scale(1 / size);
        clip(g, lower, upper);
        return g;
    }

    // The step that meets the exact demands first, and the norm of their multipliers:
    //     x_1 = argmin 1/2 |b - C x|^2 + 1/2 lambda |b|^2 |x|^2
    //     x   = argmin 1/2 |r - A x|^2 + 1/2 mu |x|^2  over  C x = C x_1,  x = x_1 + B'z       both inside the box
    struct ExactStep {
        Vec x;
        double multiplier;
        Mat U;  // U'U = C C'
    };
    ExactStep exact_step(const Linearisation& state, double damping, bool is_refinement, Vec lower, Vec upper) const
    {
        const Mat A = state.A, C = state.C;
        const Vec b = state.b;
        const double size = A.all().square(), square = C.all().square();
        const double weight = std::max({damping * b.square(), ROW_REGULARISATION * square, TINY});
        const Mat U = cholesky(gram(C, weight));
        Vec x = t(C) * solved(U, solved(t(U), b));
        if (!within(lower, x, upper)) {
            Mat H = normal(C);
            for (int i = 0; i < m; i++)
                H(i, i) += weight;
            const Vec g = t(C) * b;
            x = box_minimum(H, g, lower, upper, x);
            if (!x.w)
                x = g / (square + weight);
            clip(x, lower, upper);
        }
        const Mat B = null_space(C);
        if (B.rows) {
            const Mat AB = A * t(B);
            Mat H = is_refinement ? curvature(state, B, multipliers(state, Vec(w, m, 0), lower, upper)) : normal(AB);
            for (int i = 0; i < H.rows; i++)
                H(i, i) += std::max(2 * damping * state.f, HESSIAN_REGULARISATION * size);
            const Vec z = minimum(H, t(AB) * (state.r - A * x), lower - x, upper - x, transposed(B));
            if (z.w)
                x.add(1, t(B) * z);
            clip(x, lower, upper);
        }
        const double most = MAX_MULTIPLIER * std::sqrt(2 * size * state.f / (square + TINY));
        const double multiplier = multipliers(state, x, lower, upper).norm();
        return {x, multiplier < most ? multiplier : most, U};
    }
    // An orthonormal basis, as rows, of the x with C x = 0.
    static Mat null_space(Mat C)
    {
        if (C.rows <= C.cols) {
            const RQ rq(C);
            if (rq.regular(RANK_TOLERANCE)) {
                Mat B(*C.w, rq.free, C.cols, 0);
                for (int i = 0; i < B.rows; i++) {
                    B(i, i) = 1;
                    rq.turn_back(B[i]);
                }
                return B;
            }
        }
        const SVD svd(C);
        return svd.V.rows_from(svd.rank(RANK_TOLERANCE), C.cols);
    }
    // Multipliers y of the exact rows: C'y is the gradient after a step, for joints at no bound.
    Vec multipliers(const Linearisation& state, Vec x, Vec lower, Vec upper) const
    {
        const Vec left = t(state.A) * (state.r - state.A * x);
        const Mat free = state.C.copy();
        for (int j = 0; j < m; j++) {
            const double margin = RELATIVE_ROUNDING * (1 + std::abs(x[j]));
            if (x[j] > lower[j] + margin && x[j] < upper[j] - margin)
                continue;
            left[j] = 0;
            for (int i = 0; i < free.rows; i++)
                free(i, j) = 0;
        }
        const double square = free.all().square();
        if (square == 0)
            return Vec(w, free.rows, 0);
        const Mat U = cholesky(gram(free, GRAM_REGULARISATION * square));
        return solved(U, solved(t(U), free * left));
    }

    // Bounds of a step: the position limits, or half a turn for a hinge that may turn over.
    void step_bounds(const Linearisation& state, bool may_turn_over, Vec lower, Vec upper) const
    {
        for (int j = 0; j < m; j++) {
            const bool open = may_turn_over && arm.can_turn_over(j);
            lower[j] = open ? -0.5 * arm.full_turn[j] : arm.lower[j] - state.q[j];
            upper[j] = open ? 0.5 * arm.full_turn[j] : arm.upper[j] - state.q[j];
        }
    }

    // Decrease of the merit by a step, to first order.
    double predicted_decrease(const Linearisation& state, Vec x, double penalty) const
    {
        return descent_direction(state).dot(x) + penalty * (state.exact_error - (state.b - state.C * x).norm());
    }

    // Descent of the merit from a start inside the limits, until the goal is met or the merit has converged or stalled.
    Try descend(const double* start, const DescentOptions& options)
    {
        const Workspace::Frame frame(w);
        const int rows = task.exact.empty() || options.objective == Objective::pose ? 0 : exact_rows(start);
        const int n = options.objective == Objective::demands ? rows : task.size();
        const int k = options.objective == Objective::demands ? 0 : rows;
        Linearisation state(w, m, n, k), trial(w, m, n, k);
        std::copy(start, start + m, state.q.p);
        linearise(state, options.objective);
        Vec lower(w, m), upper(w, m), past(w, STALL_WINDOW + 1);
        double damping = INITIAL_DAMPING, penalty = 0;
        const int max_steps = options.is_refinement ? MAX_REFINE_STEPS : options.max_steps;
        const double least = options.is_refinement ? 0 : MIN_DAMPING;
        int steps = 0;
        bool met = false, converged = false;
        for (;; steps++) {
            const double merit = state.merit(penalty);
            const double earlier = steps > options.window ? past[(steps - options.window) % past.n] : INFINITY;
            past[steps % past.n] = merit;
            met = state.distance() <= goal;
            if (met || !(merit < INFINITY) || is_timed_out())
                break;
            converged = steps == max_steps || damping > MAX_DAMPING || earlier - merit <= MERIT_TOLERANCE * merit;
            if (converged || (!options.is_refinement && merit > 0.5 * earlier))
                break;
            const Workspace::Frame of_step(w);
            step_bounds(state, options.may_turn_over, lower, upper);
            Mat U;
            Vec x;
            if (k) {
                const ExactStep exact = exact_step(state, damping, options.is_refinement, lower, upper);
                x = exact.x, U = exact.U;
                penalty = std::max(penalty, PENALTY_MARGIN * exact.multiplier);
                if (predicted_decrease(state, x, penalty) <= MERIT_TOLERANCE * merit) {
                    converged = true;
                    break;
                }
            } else
                x = step(state, options.is_refinement ? curvature(state) : Mat(), 2 * damping * state.f, lower, upper);
            trial.q.set(state.q + x);
            arm.wrap_into_limits(trial.q.p);
            linearise(trial, options.objective);
            if (k && options.is_refinement && trial.exact_error > goal) {  // second-order correction of the exact rows
                trial.q.add(1, t(state.C) * solved(U, solved(t(U), trial.b)));
                arm.wrap_into_limits(trial.q.p);
                linearise(trial, options.objective);
            }
            if (trial.merit(penalty) < state.merit(penalty)) {
                std::swap(state, trial);
                damping = std::max(DAMPING_DECREASE * damping, least);
            } else
                damping *= DAMPING_INCREASE;
        }
        const double merit = state.merit(penalty);
        return {{state.q.begin(), state.q.end()}, state.f, state.exact_error, merit, steps, met, converged};
    }
};

}  // namespace

void PoseArm::wrap_into_limits(double* q) const
{
    for (int j = 0; j < size(); j++) {
        if (can_turn_over(j))
            q[j] += full_turn[j] * (std::max(std::ceil((lower[j] - q[j]) / full_turn[j]), 0.0)
                                    - std::max(std::ceil((q[j] - upper[j]) / full_turn[j]), 0.0));
        q[j] = std::min(std::max(q[j], lower[j]), upper[j]);
    }
}

void PoseArm::wrap_near(double* q, const double* start, double slack) const
{
    wrap_into_limits(q);
    for (int j = 0; j < size(); j++) {
        if (!can_turn_over(j))
            continue;
        const double least = std::ceil((lower[j] - slack - q[j]) / full_turn[j]);
        const double most = std::floor((upper[j] + slack - q[j]) / full_turn[j]);
        q[j] += full_turn[j] * std::min(std::max(std::nearbyint((start[j] - q[j]) / full_turn[j]), least), most);
        q[j] = std::min(std::max(q[j], lower[j]), upper[j]);
    }
}

PoseResult solve_pose(const PoseArm& arm, const PoseTask& task, const double* start, Workspace& w)
{
    const Workspace::Frame frame(w);
    return Search(arm, task, w).solve(start);
}

bool descend_to(const PoseArm& arm, const PoseTask& task, double* q, Workspace& w)
{
    const Workspace::Frame frame(w);
    return Search(arm, task, w).descend_to(q);
}

}  // namespace iq
