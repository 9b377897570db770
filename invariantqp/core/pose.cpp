#include "pose.hpp"
#include "feasible_set.hpp"

namespace iq {
namespace {

using Clock = std::chrono::steady_clock;

// Newton goes on to this share of the tolerance, so that a tool frame far from the last link meets it too, and the tool
// frame does not decide which step is the last.
constexpr double GOAL_SHARE = 1e-3;
// lambda at the start of a try [1 / rad^2], its factors after a step that reduced the error and after one that did not,
// and its least value.
constexpr double DAMPING = 0.1, EASED = 0.5, STIFFENED = 4, LEAST = 1e-3;
// A try ends where even steps with this much damping do not make the error smaller: rounding is all that is left.
constexpr double STIFFEST = 1e8;
// Shares of the trace of A'A and of C'C that keep AA', A'A and CC' definite, far below any damping that acts.
constexpr double FLOOR = 1e-13, QP_FLOOR = 1e-8, ROW_FLOOR = 1e-9;
// Rows that leave less than this share of the largest depend on each other.
constexpr double DEPENDENT = 1e-10;
// A try is given up where this many steps have not halved the error; it is at rest where this many have gained nothing.
constexpr int STALLED = 6, FINISHED = 3;
// The most steps in a try, and in one for the last digits; an error that falls more slowly counts as at rest.
constexpr int LONGEST = 100, PATIENCE = 1000;
// Of the merit: what no step gains.
constexpr double AT_REST = 1e-12;
// Joint displacement for differences of the gradient: they keep seven digits, and Newton needs one.
constexpr double DIFFERENCE = 1e-7;
// Multipliers are bounded by this many |A| |r| / |C|: those of rows that limits forbid have no meaning. The penalty is
// kept above them by a factor.
constexpr double DEAREST = 10, PENALTY_MARGIN = 2;
// A joint within this much of a step's bound is held by it, relative to 1 + |x|.
constexpr double AT_BOUND = 1e-9;
// Shares of the time that are spent on tries, without and with exact demands; the rest is for the last digits of the
// closest few.
constexpr double SEARCH_SHARE = 0.8, EXACT_SHARE = 0.6;
constexpr int CLOSEST = 4;
// With exact demands and no start, tries end when so many have met them; the first so many try the whole pose before.
constexpr int ENOUGH = 3, WHOLE = 2;
// A target is beside a start where it is this near [rad, lengths of the arm]. So many restarts are then around it, within
// a radius [rad] that doubles in two.
constexpr double NEARBY = 2, RADIUS = 0.2;
constexpr int AROUND = 12;
// The last digits are begun again at most so often, while that brings the merit below this share of itself.
constexpr int AGAIN = 8;
constexpr double GAIN = 0.999;
// A joint this far beyond a limit [rad] is put at it, where the target is met there too.
constexpr double AT_LIMIT = 1e-3;
constexpr double PI = 3.14159265358979323846;
// Exchanges of several joints at once that do not help before one at a time is tried.
constexpr int PATIENT_PIVOTS = 3;
// Relative to an error: what rounding makes of two that are equal.
constexpr double NEGLIGIBLE = 1e-9;

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

// argmin 1/2 x'Hx - g'x over lower <= x <= upper, by block principal pivoting (Judice and Pires 1992): joints that are
// outside go to their bound, those that the slope pulls back from one are free again. `x` is a guess, if it has memory.
// Absent where H is not definite.
Vec box_minimum(Mat H, Vec g, Vec lower, Vec upper, Vec guess)
{
    const int m = g.n;
    Workspace& w = *g.w;
    const Vec x(w, m);
    std::array<int, 64> side{}, wrong{}, free;
    for (int j = 0; guess.w && j < m; j++)
        side[j] = guess[j] > upper[j] ? 1 : guess[j] < lower[j] ? -1 : 0;
    int fewest = m + 1, patience = PATIENT_PIVOTS;
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
                const double margin = AT_REST * (1 + std::abs(x[j]));
                wrong[j] = x[j] > upper[j] + margin ? 1 : x[j] < lower[j] - margin ? -1 : 0;
            } else
                wrong[j] = side[j] * (H[j].dot(x) - g[j]) > AT_REST * std::abs(g[j]);
            if (wrong[j])
                outside++, last = j;
        }
        if (!outside) {
            clip(x, lower, upper);
            return x;
        }
        // All that are wrong change sides; where that does not help any more, one, which ends for certain.
        patience = outside < fewest ? PATIENT_PIVOTS : patience - 1;
        fewest = std::min(fewest, outside);
        for (int j = patience < 0 ? last : 0; j < m; j++)
            if (wrong[j])
                side[j] = side[j] ? 0 : wrong[j];
    }
    return Vec();
}

// argmin 1/2 x'Hx - g'x over lower <= N x <= upper; absent where it is not found.
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

// The error at q (m,), to first order: a step x changes r to r - A x, and b to b - C x.
struct State {
    Vec q, r, b;
    Mat A, C;
    double f = 0, unmet = 0;

    State(Workspace& w, int m, int n, int k) : q(w, m), r(w, n), b(w, k), A(w, n, m), C(w, k, m) {}
    double distance() const { return std::sqrt(2 * f) + unmet; }
    double merit(double penalty) const { return f + penalty * unmet; }
};

struct Try {
    std::vector<double> q;
    double f = 0, unmet = 0, merit = 0;
    int steps = 0;
    bool met = false, at_rest = false;
    int number = 0;  // of its start: the first is the one that was given, or the middle of the range
};

struct How {
    bool turning = true;   // whether a hinge may leave its limits, and is shifted back by whole turns
    bool patient = false;  // whether it goes on to the last digit where the target cannot be met
    int window = STALLED;
    enum class Of { all, pose, demands } of = Of::all;  // what counts: of exact demands and the pose
    int longest = LONGEST;  // steps, at most
};

class Search {
  public:
    Search(const PoseArm& arm, const PoseTask& task, Workspace& w)
        : arm(arm), task(task), w(w), m(arm.size()), goal(GOAL_SHARE * task.tolerance * task.least),
          begun(task.time_limit < INFINITY ? Clock::now() : Clock::time_point()), exact_tolerance(task.tolerance)
    {
        for (const ExactDemand& one : task.exact)
            if (one.of.kind == Demand::Kind::axis)  // whose radians count as the arm's length, as do all in f
                exact_tolerance = task.tolerance * std::min(1.0, arm.length);
    }

    PoseAnswer solve(const double* given)
    {
        const bool exact = !task.exact.empty();
        const double* const first = given ? given : arm.middle.data();
        std::vector<double> start(first, first + m), next;
        if (given)
            arm.inside(start.data());
        deadline = (exact ? EXACT_SHARE : SEARCH_SHARE) * task.time_limit;
        const bool beside = given && is_beside(start.data());
        // An arm with joints to spare can follow a path past a limit without turning a joint by 2 pi: try that first. So
        // can any to a target nearby.
        const bool spare = given && (m > task.size() || exact || beside);
        std::vector<Try> tried;
        int landed = 0, steps = 0;
        for (int k = 0; k <= task.restarts && (k == 0 || !late()); k++) {
            next = start;
            if (k > 0)
                start_at(k, next.data());
            const bool near = beside && k <= AROUND;
            if (near && k > 0)
                around(start.data(), RADIUS * std::exp2((k - 1) / 2.), next.data());
            const bool turning = !(spare && (k == 0 || near));
            tried.push_back(exact ? demanded(next, !given && k < WHOLE, turning) : descend(next.data(), {turning}));
            tried.back().number = k;
            steps += tried.back().steps;
            if (is_good(tried.back()))
                break;
            landed += exact && !unmet(tried.back()) && is_allowed(tried.back());
            if (landed >= (given ? 1 : ENOUGH))
                break;
        }
        const bool over = late();
        const int tries = static_cast<int>(tried.size());
        if (std::any_of(tried.begin(), tried.end(), [](const Try& one) { return one.met; }))
            return answer(roomiest(tried), start, steps, tries, over);
        // The last digits of the closest, which may turn out to meet the target. Else, from a given start, the closest
        // pose is the one downhill from there, unless exact demands are met elsewhere alone.
        const bool downhill = given && !landed;
        std::vector<Try> refined;
        if (downhill)
            refined.push_back(finished(tried[0]));
        for (const Try& one : closest(tried, landed ? (given ? 1 : ENOUGH) : CLOSEST))
            if (!(downhill && one.number == 0))
                refined.push_back(finished(one));
        bool found = !downhill;
        for (const Try& one : refined) {
            steps += one.steps;
            found = found || one.met || (exact && !unmet(one));
        }
        return answer(found ? nearest(refined) : refined[0], start, steps, tries, over);
    }

    bool descend_to(double* q)
    {
        const bool exact = !task.exact.empty();
        Try found = descend(q, {m <= 6 && !exact, false, exact ? FINISHED : STALLED});
        arm.near(found.q.data(), q, 0);
        std::copy(found.q.begin(), found.q.end(), q);
        return found.met || (exact && found.unmet <= goal);
    }

  private:
    const PoseArm& arm;
    const PoseTask& task;
    Workspace& w;
    const int m;
    const double goal;
    const Clock::time_point begun;
    double exact_tolerance, deadline = INFINITY;

    bool late() const
    {
        return deadline < INFINITY && std::chrono::duration<double>(Clock::now() - begun).count() > deadline;
    }
    bool is_allowed(const Try& one) const { return !task.room || task.room(one.q.data()) == INFINITY; }
    bool is_good(const Try& one) const { return one.met && is_allowed(one); }
    bool unmet(const Try& one) const { return one.unmet > exact_tolerance; }
    // Exact demands come before all else; a penalty is that of its own try.
    bool before(const Try& a, const Try& b) const
    {
        if (unmet(a) != unmet(b))
            return unmet(b);
        return unmet(a) && a.unmet != b.unmet ? a.unmet < b.unmet : a.merit < b.merit;
    }
    // Of those that met the target the last, or the one with most room.
    const Try& roomiest(const std::vector<Try>& tried) const
    {
        const Try* best = nullptr;
        double most = -INFINITY;
        for (const Try& one : tried) {
            if (!one.met)
                continue;
            const double room = task.room ? task.room(one.q.data()) : INFINITY;
            if (!best || room > most)
                best = &one, most = room;
        }
        return *best;
    }
    // The tries that are closest, or of those that met exact demands where it is allowed.
    std::vector<Try> closest(const std::vector<Try>& tried, int most) const
    {
        std::vector<Try> found = tried, allowed;
        std::stable_sort(found.begin(), found.end(), [&](const Try& a, const Try& b) { return before(a, b); });
        for (const Try& one : found)
            if (!task.exact.empty() && !unmet(one) && is_allowed(one))
                allowed.push_back(one);
        if (!allowed.empty())
            found = allowed;
        found.resize(std::min<std::size_t>(found.size(), most));
        return found;
    }
    // The first that is as near as the nearest: rounding does not choose between mirror images.
    const Try& nearest(const std::vector<Try>& refined) const
    {
        const Try* least = &refined[0];
        for (const Try& one : refined)
            if (before(one, *least))
                least = &one;
        const Try* best = least;
        for (const Try& one : refined)
            if (unmet(one) == unmet(*least) && one.merit <= (1 + NEGLIGIBLE) * least->merit && one.number < best->number)
                best = &one;
        return *best;
    }

    void start_at(int k, double* q) const
    {
        for (int j = 0; j < m; j++) {
            const double share = std::fmod(task.origin[j] + k * arm.stride[j], 1.0);
            q[j] = arm.low[j] + share * (arm.high[j] - arm.low[j]);
        }
    }

    // From a state spread over the range to one that lies around a start in the same way, joints within a radius [rad].
    void around(const double* start, double radius, double* q) const
    {
        for (int j = 0; j < m; j++) {
            const double share = 2 * (q[j] - arm.low[j]) / std::max(arm.high[j] - arm.low[j], TINY) - 1;
            q[j] = start[j] + share * radius * (arm.turn[j] > 0 ? arm.turn[j] / (2 * PI) : arm.length);
        }
        arm.inside(q);
    }

    // A try at exact demands: at the whole pose first, if that is asked for; then at the demands alone, and from there
    // at the rest, downhill.
    Try demanded(const std::vector<double>& start, bool whole, bool turning)
    {
        Try one{start};
        if (whole) {
            one = descend(start.data(), {turning, false, STALLED, How::Of::pose});
            if (one.met)
                return one;
        }
        one = after(one, descend(one.q.data(), {turning, false, STALLED, How::Of::demands}));
        if (!one.met) {
            one.unmet = std::sqrt(2 * one.f);
            return one;
        }
        one = after(one, descend(one.q.data(), {turning}));
        return one.met || one.unmet <= goal ? one : retracted(one);
    }
    static Try after(const Try& before, Try one)
    {
        one.steps += before.steps;
        one.number = before.number;
        return one;
    }
    // From near what is exact to there.
    Try retracted(const Try& one)
    {
        const Try back = descend(one.q.data(), {true, false, STALLED, How::Of::demands});
        if (!back.met)
            return one;
        Try there = after(back, descend(back.q.data(), {true, false, STALLED, How::Of::all, 0}));
        there.steps += one.steps;
        there.at_rest = one.at_rest, there.number = one.number;
        return there;
    }

    // The last digits; with exact demands several times: a penalty from far away is in their way.
    Try finished(const Try& tried)
    {
        deadline = task.time_limit;
        Try one = tried;
        one.steps = 0;
        if (!task.exact.empty() && !unmet(tried) && tried.at_rest)
            return one;
        one = after(one, descend(one.q.data(), {true, true, FINISHED}));
        for (int k = 0; k < AGAIN && !task.exact.empty() && !one.met; k++) {
            const Try again = after(one, descend(one.q.data(), {true, true, FINISHED}));
            const bool gained = unmet(again) != unmet(one) ? unmet(one) : again.merit < GAIN * one.merit;
            const int steps = again.steps;
            if (gained)
                one = again;
            one.steps = steps;
            if (one.met || !gained)
                break;
        }
        if (!task.exact.empty() && !one.met && one.unmet > goal)
            one = retracted(one);
        if (unmet(one) && !unmet(tried)) {  // beside a singularity of the demands
            const int steps = one.steps;
            one = tried;
            one.steps = steps, one.at_rest = true;
        }
        return one;
    }

    PoseAnswer answer(const Try& best, const std::vector<double>& start, int steps, int tries, bool over)
    {
        PoseAnswer found;
        found.q = best.q;
        arm.near(found.q.data(), start.data(), best.met ? AT_LIMIT : 0);
        find_misses(found);
        if (best.met && !reaches(found)) {
            found.q = best.q;
            arm.near(found.q.data(), start.data(), 0);
            find_misses(found);
        }
        const bool reached = reaches(found);
        const bool exact = !task.exact.empty(), exactly = exact && !unmet(best);
        found.outcome = reached && (exactly || !exact) ? PoseOutcome::reached
                        : exactly && best.at_rest      ? PoseOutcome::closest
                        : over || exactly              ? PoseOutcome::late
                                                       : PoseOutcome::out_of_reach;
        found.error = std::sqrt(2 * best.f);
        found.iterations = steps, found.tries = tries, found.other_branch = best.number > 0;
        for (int j = 0; j < m; j++) {
            const double displacement = std::abs(found.q[j] - start[j]);
            found.displacement = std::max(found.displacement, displacement);
            if (arm.turns_over(j) && displacement > (0.5 + AT_LIMIT) * arm.turn[j])
                found.other_branch = true;
        }
        return found;
    }

    // Whether a target is near, in the arm's own measure.
    bool is_beside(const double* start) const
    {
        const auto [off, angle] = misses(arm.state(start, Mat()), task.point);
        return std::hypot(off / arm.length, angle) <= NEARBY;
    }
    void find_misses(PoseAnswer& found) const
    {
        std::tie(found.position, found.orientation) = misses(arm.state(found.q.data(), Mat()), Vec3{});
    }
    // How far a point of the tool is from where it should be, and the angle; 0 of what is free.
    std::pair<double, double> misses(const Pose& tool, const Vec3& point) const
    {
        if (!task.part)
            return {norm(task.target * point - tool * point), norm(rotation_vector(task.target.R * transposed(tool.R)))};
        const Twist error = task.part->error(tool, {});
        return {norm(task.part->off(tool)), norm(error.omega)};
    }
    bool reaches(const PoseAnswer& found) const
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

    // state.q is set; the rest is found.
    void linearise(State& state, How::Of of) const
    {
        const Workspace::Frame frame(w);
        Mat J = !task.part && !task.root.w && of != How::Of::demands ? state.A : Mat(w, 6, m);
        const Pose tool = arm.state(state.q.p, J);
        if (of == How::Of::demands) {
            set_rows(state.A, state.r, state.q.p, tool, J);
            state.f = half_square(state.r);
            return;
        }
        if (state.C.rows)
            set_rows(state.C, state.b, state.q.p, tool, J);
        if (task.part) {
            state.A.set(task.part->root(tool, task.length, w) * J);
            state.r.set(task.part->root(tool, task.length, w) * vec(task.part->error(tool, {}), w));
            state.f = half_square(state.r);
            state.unmet = state.b.norm();
            return;
        }
        const Vec3 here = tool * task.point, off = task.target * task.point - here;
        for (int j = 0; j < m; j++) {
            const Vec3 omega{J(0, j), J(1, j), J(2, j)}, moved = cross(omega, here);
            for (int i = 0; i < 3; i++)
                J(3 + i, j) += moved[i];
        }
        const Vec3 omega = rotation_vector(task.target.R * transposed(tool.R));
        if (task.root.w)
            measure(state, J, omega, off);
        else {
            J.rows_from(0, 3).all().scale(task.length);
            for (int i = 0; i < 3; i++)
                state.r[i] = task.length * omega[i], state.r[3 + i] = off[i];
        }
        state.f = half_square(state.r);
        state.unmet = state.b.norm();
    }
    void measure(State& state, Mat J, const Vec3& omega, const Vec3& off) const
    {
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

    // Rows C of the exact demands and what they miss, b. An axis counts as the arm's own length.
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

    // -grad f, A'r
    Vec slope(const State& state) const { return t(state.A) * state.r; }

    // The second derivative by differences of the gradient, with the absolute values of its eigenvalues: of f; or of
    // f + y'b along the rows of B.
    Mat curvature(const State& state, Mat B = Mat(), Vec y = Vec()) const
    {
        State beside(w, m, state.r.n, state.b.n);
        const auto slope_of = [&](const State& at) { return y.w ? slope(at) - t(at.C) * y : slope(at); };
        const Vec here = slope_of(state);
        Mat H(w, m, m);
        for (int i = 0; i < m; i++) {
            const double h = state.q[i] + DIFFERENCE > arm.upper[i] ? -DIFFERENCE : DIFFERENCE;
            beside.q.set(state.q);
            beside.q[i] += h;
            linearise(beside, How::Of::all);
            H[i].set((here - slope_of(beside)) / h);
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

    // argmin 1/2 |r - A x|^2 + 1/2 mu |x|^2 inside the box; H is the second derivative in place of A'A.
    Vec step(const State& state, Mat H, double mu, Vec lower, Vec upper) const
    {
        const Mat A = state.A;
        const double size = A.all().square();
        const Vec g = slope(state);
        Vec guess(w, m);
        bool held = false;  // whether the slope pushes a joint against its limit
        for (int j = 0; j < m; j++) {
            guess[j] = g[j] > 0 && upper[j] <= 0 ? INFINITY : g[j] < 0 && lower[j] >= 0 ? -INFINITY : 0;
            held = held || guess[j] != 0;
        }
        if (!H.w && !held && m >= A.rows) {
            bool positive = true;
            const Mat U = cholesky(gram(A, mu + FLOOR * size), &positive);
            const Vec x = t(A) * solved(U, solved(t(U), state.r));
            if (positive && within(lower, x, upper))
                return x;
            guess = x;
        }
        if (!H.w)
            H = normal(A);
        for (int i = 0; i < m; i++)
            H(i, i) += std::max(mu, QP_FLOOR * size);
        const Vec x = box_minimum(H, g, lower, upper, guess);
        if (x.w)
            return x;
        g.scale(1 / size);
        clip(g, lower, upper);
        return g;
    }

    // The step that meets exact demands first, and the multiplier of their rows:
    //     x_1 = argmin 1/2 |b - C x|^2 + 1/2 lambda |b|^2 |x|^2
    //     x   = argmin 1/2 |r - A x|^2 + 1/2 mu |x|^2  over  C x = C x_1,  x = x_1 + B'z       both inside the box
    struct ExactStep {
        Vec x;
        double price;
        Mat U;  // U'U = C C'
    };
    ExactStep exact_step(const State& state, double damping, bool patient, Vec lower, Vec upper) const
    {
        const Mat A = state.A, C = state.C;
        const Vec b = state.b;
        const double size = A.all().square(), square = C.all().square();
        const double weight = std::max({damping * b.square(), ROW_FLOOR * square, TINY});
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
            Mat H = patient ? curvature(state, B, multipliers(state, Vec(w, m, 0), lower, upper)) : normal(AB);
            for (int i = 0; i < H.rows; i++)
                H(i, i) += std::max(2 * damping * state.f, QP_FLOOR * size);
            const Vec z = minimum(H, t(AB) * (state.r - A * x), lower - x, upper - x, transposed(B));
            if (z.w)
                x.add(1, t(B) * z);
            clip(x, lower, upper);
        }
        const double most = DEAREST * std::sqrt(2 * size * state.f / (square + TINY));
        const double price = multipliers(state, x, lower, upper).norm();
        return {x, price < most ? price : most, U};
    }
    // An orthonormal basis, as rows, of the x with C x = 0.
    static Mat null_space(Mat C)
    {
        if (C.rows <= C.cols) {
            const RQ rq(C);
            if (rq.regular(DEPENDENT)) {
                Mat B(*C.w, rq.free, C.cols, 0);
                for (int i = 0; i < B.rows; i++) {
                    B(i, i) = 1;
                    rq.turn_back(B[i]);
                }
                return B;
            }
        }
        const SVD svd(C);
        return svd.V.rows_from(svd.rank(DEPENDENT), C.cols);
    }
    // y: C'y is what a step leaves of the slope where no bound holds a joint.
    Vec multipliers(const State& state, Vec x, Vec lower, Vec upper) const
    {
        const Vec left = t(state.A) * (state.r - state.A * x);
        const Mat free = state.C.copy();
        for (int j = 0; j < m; j++) {
            const double margin = AT_BOUND * (1 + std::abs(x[j]));
            if (x[j] > lower[j] + margin && x[j] < upper[j] - margin)
                continue;
            left[j] = 0;
            for (int i = 0; i < free.rows; i++)
                free(i, j) = 0;
        }
        const double square = free.all().square();
        if (square == 0)
            return Vec(w, free.rows, 0);
        const Mat U = cholesky(gram(free, FLOOR * square));
        return solved(U, solved(t(U), free * left));
    }

    // The least and the largest step; with `turning`, half a turn for a hinge that can turn over.
    void room_of(const State& state, bool turning, Vec lower, Vec upper) const
    {
        for (int j = 0; j < m; j++) {
            const bool open = turning && arm.turns_over(j);
            lower[j] = open ? -0.5 * arm.turn[j] : arm.lower[j] - state.q[j];
            upper[j] = open ? 0.5 * arm.turn[j] : arm.upper[j] - state.q[j];
        }
    }

    // By how much a step reduces the merit, to first order.
    double foreseen(const State& state, Vec x, double penalty) const
    {
        return slope(state).dot(x) + penalty * (state.unmet - (state.b - state.C * x).norm());
    }

    // Steps from a start inside the limits until the goal is met or no step gains anything; none makes the merit worse.
    Try descend(const double* start, const How& how)
    {
        const Workspace::Frame frame(w);
        const int rows = task.exact.empty() || how.of == How::Of::pose ? 0 : exact_rows(start);
        const int n = how.of == How::Of::demands ? rows : task.size();
        const int k = how.of == How::Of::demands ? 0 : rows;
        State state(w, m, n, k), seen(w, m, n, k);
        std::copy(start, start + m, state.q.p);
        linearise(state, how.of);
        Vec lower(w, m), upper(w, m), past(w, STALLED + 1);
        double damping = DAMPING, penalty = 0;
        const int longest = how.patient ? PATIENCE : how.longest;
        const double least = how.patient ? 0 : LEAST;
        int steps = 0;
        bool met = false, at_rest = false;
        for (;; steps++) {
            const double merit = state.merit(penalty);
            const double earlier = steps > how.window ? past[(steps - how.window) % past.n] : INFINITY;
            past[steps % past.n] = merit;
            met = state.distance() <= goal;
            if (met || !(merit < INFINITY) || late())
                break;
            at_rest = steps == longest || damping > STIFFEST || earlier - merit <= AT_REST * merit;
            if (at_rest || (!how.patient && merit > 0.5 * earlier))
                break;
            const Workspace::Frame of_step(w);
            room_of(state, how.turning, lower, upper);
            Mat U;
            Vec x;
            if (k) {
                const ExactStep exact = exact_step(state, damping, how.patient, lower, upper);
                x = exact.x, U = exact.U;
                penalty = std::max(penalty, PENALTY_MARGIN * exact.price);
                if (foreseen(state, x, penalty) <= AT_REST * merit) {
                    at_rest = true;
                    break;
                }
            } else
                x = step(state, how.patient ? curvature(state) : Mat(), 2 * damping * state.f, lower, upper);
            seen.q.set(state.q + x);
            arm.inside(seen.q.p);
            linearise(seen, how.of);
            if (k && how.patient && seen.unmet > goal) {  // what the rows bend by would be in the way of the last digits
                seen.q.add(1, t(state.C) * solved(U, solved(t(U), seen.b)));
                arm.inside(seen.q.p);
                linearise(seen, how.of);
            }
            if (seen.merit(penalty) < state.merit(penalty)) {
                std::swap(state, seen);
                damping = std::max(EASED * damping, least);
            } else
                damping *= STIFFENED;
        }
        return {{state.q.begin(), state.q.end()}, state.f, state.unmet, state.merit(penalty), steps, met, at_rest};
    }
};

}  // namespace

void PoseArm::inside(double* q) const
{
    for (int j = 0; j < size(); j++) {
        if (turns_over(j))
            q[j] += turn[j] * (std::max(std::ceil((lower[j] - q[j]) / turn[j]), 0.0)
                               - std::max(std::ceil((q[j] - upper[j]) / turn[j]), 0.0));
        q[j] = std::min(std::max(q[j], lower[j]), upper[j]);
    }
}

void PoseArm::near(double* q, const double* start, double slack) const
{
    inside(q);
    for (int j = 0; j < size(); j++) {
        if (!turns_over(j))
            continue;
        const double least = std::ceil((lower[j] - slack - q[j]) / turn[j]);
        const double most = std::floor((upper[j] + slack - q[j]) / turn[j]);
        q[j] += turn[j] * std::min(std::max(std::nearbyint((start[j] - q[j]) / turn[j]), least), most);
        q[j] = std::min(std::max(q[j], lower[j]), upper[j]);
    }
}

PoseAnswer solve_pose(const PoseArm& arm, const PoseTask& task, const double* start, Workspace& w)
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
