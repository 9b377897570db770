#include "pose.hpp"
#include "room.hpp"

static double env(const char*n,double d){const char*v=getenv(n);return v?atof(v):d;}
namespace iq {
namespace {
double CAP=env("CAP",INFINITY), NEARBY=env("NEARBY",2), AROUND=env("AROUND",12), RADIUS=env("RADIUS",.2);

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
// The last digits are begun again at most so often, while that brings the merit below this share of itself.
constexpr int AGAIN = 8;
constexpr double GAIN = 0.999;
// A joint this far beyond a limit [rad] is put at it, where the target is met there too.
constexpr double AT_LIMIT = 1e-3;
constexpr double PI = 3.14159265358979323846;
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

void clip(Vec x, Vec lower, Vec upper)
{
    for (int i = 0; i < x.n; i++)
        x[i] = std::min(std::max(x[i], lower[i]), upper[i]);
}

// argmin 1/2 x'Hx - g'x over lower <= x <= upper, or lower <= N x <= upper; absent where it is not found.
Vec minimum(Mat H, Vec g, Vec lower, Vec upper, Mat N = Mat())
{
    bool positive = true;
    const Mat U = cholesky(H, &positive);
    if (!positive)
        return Vec();
    const Vec x = solved(U, solved(t(U), g));
    if (within(lower, N.w ? N * x : x, upper))
        return x;
    const auto found = polytope_optimum({inverse(U), x}, {N.w ? N : Mat::identity(*H.w, H.rows), lower, upper, {}, {}});
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
};

struct How {
    bool turning = true;   // whether a hinge may leave its limits, and is shifted back by whole turns
    bool patient = false;  // whether it goes on to the last digit where the target cannot be met
    int window = STALLED;
};

class Search {
  public:
    Search(const PoseArm& arm, const PoseTask& task, Workspace& w)
        : arm(arm), task(task), w(w), m(arm.size()), goal(GOAL_SHARE * task.tolerance * task.least),
          begun(task.time_limit < INFINITY ? Clock::now() : Clock::time_point())
    {
    }

    PoseAnswer solve(const double* given)
    {
        const bool exact = !task.exact.empty();
        std::vector<double> start(given ? given : arm.middle.data(), (given ? given : arm.middle.data()) + m);
        if (given)
            arm.inside(start.data());
        deadline = (exact ? EXACT_SHARE : SEARCH_SHARE) * task.time_limit;
        const bool beside = given && is_beside(start.data());
        // An arm with joints to spare can follow a path past a limit without turning a joint by 2 pi: try that first. So
        // can any to a target nearby.
        const bool spare = m > 6 || exact || beside;
        std::vector<Try> tried{descend(start.data(), {!given || !spare})}, refined;
        const bool downhill = given && exact && !tried[0].met;
        if (downhill) {
            refined.push_back(finished(tried[0].q));
            if (refined[0].unmet <= task.tolerance && refined[0].at_rest)
                return answer(refined[0], start, tried[0].steps + refined[0].steps, 1, false, false);
        }
        std::vector<double> next(m);
        for (int k = 0; k < task.restarts && !is_good(tried.back()) && !late(); k++) {
            start_at(k, next.data());
            const bool near = beside && k < AROUND;
            if (near)
                around(start.data(), RADIUS * std::exp2(k / 2.), next.data());
            tried.push_back(descend(next.data(), {!near || !spare}));
        }
        const bool over = late(), met = std::any_of(tried.begin(), tried.end(), [](const Try& one) { return one.met; });
        if (!met) {
            // From a given start, the closest pose is the one downhill from there.
            std::vector<Try*> closest;
            for (Try& one : tried)
                closest.push_back(&one);
            if (!given || downhill) {
                std::stable_sort(closest.begin(), closest.end(), [&](Try* a, Try* b) { return before(*a, *b); });
                closest.resize(std::min<std::size_t>(closest.size(), CLOSEST));
            } else
                closest.resize(1);
            for (const Try* one : closest)
                refined.push_back(finished(one->q));
        }
        int steps = 0;
        for (const auto* list : {&tried, &refined})
            for (const Try& one : *list)
                steps += one.steps;
        const Try& best = met ? roomiest(tried) : nearest(refined, downhill);
        const bool restarted = met ? &best != &tried[0] : given && &best != &refined[0];
        return answer(best, start, steps, static_cast<int>(tried.size()), over, restarted);
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
    double deadline = INFINITY;

    bool late() const
    {
        return deadline < INFINITY && std::chrono::duration<double>(Clock::now() - begun).count() > deadline;
    }
    bool is_good(const Try& one) const { return one.met && (!task.room || task.room(one.q.data()) == INFINITY); }
    bool unmet(const Try& one) const { return one.unmet > task.tolerance; }
    // Exact demands come before all else; a penalty is that of its own try.
    bool before(const Try& a, const Try& b) const
    {
        return unmet(a) != unmet(b) ? unmet(b) : a.merit < b.merit;
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
    // The first that is as near as the nearest: rounding does not choose between mirror images. Of several from a start
    // and not to what is exact, only one that met that is nearer.
    const Try& nearest(const std::vector<Try>& refined, bool downhill) const
    {
        const Try* least = &refined[0];
        const auto counts = [&](const Try& one) { return !downhill || &one == &refined[0] || !unmet(one); };
        for (const Try& one : refined)
            if (counts(one) && before(one, *least))
                least = &one;
        for (const Try& one : refined)
            if (counts(one) && unmet(one) == unmet(*least) && one.merit <= (1 + NEGLIGIBLE) * least->merit)
                return one;
        return *least;
    }

    void start_at(int k, double* q) const
    {
        for (int j = 0; j < m; j++) {
            const double share = std::fmod(task.origin[j] + (k + 1.0) * arm.stride[j], 1.0);
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

    // The last digits from q; with exact demands several times: a penalty from far away is in their way.
    Try finished(const std::vector<double>& q)
    {
        deadline = task.time_limit;
        Try one = descend(q.data(), {true, true, FINISHED});
        for (int k = 0; k < AGAIN && !task.exact.empty() && !one.met; k++) {
            Try again = descend(one.q.data(), {true, true, FINISHED});
            const bool gained = unmet(again) != unmet(one) ? unmet(one) : again.merit < GAIN * one.merit;
            const int steps = one.steps + again.steps;
            if (gained)
                one = again;
            one.steps = steps;
            if (one.met || !gained)
                break;
        }
        return one;
    }

    PoseAnswer answer(const Try& best, const std::vector<double>& start, int steps, int tries, bool over, bool restarted)
    {
        PoseAnswer found;
        found.q = best.q;
        arm.near(found.q.data(), start.data(), AT_LIMIT);
        find_misses(found);
        if (best.met && !reaches(found)) {
            found.q = best.q;
            arm.near(found.q.data(), start.data(), 0);
            find_misses(found);
        }
        const bool reached = reaches(found);
        const bool exact = !task.exact.empty(), exactly = exact && best.unmet <= task.tolerance;
        found.outcome = reached && (exactly || !exact) ? PoseOutcome::reached
                        : exactly && best.at_rest      ? PoseOutcome::closest
                        : over || exactly              ? PoseOutcome::late
                                                       : PoseOutcome::out_of_reach;
        found.error = std::sqrt(2 * best.f);
        found.iterations = steps, found.tries = tries, found.restarted = restarted;
        for (int j = 0; j < m; j++)
            found.displacement = std::max(found.displacement, std::abs(found.q[j] - start[j]));
        return found;
    }

    // Whether a target is near, in the arm's own measure.
    bool is_beside(const double* start) const
    {
        const Pose tool = arm.state(start, Mat());
        const double off = norm(task.target * task.point - tool * task.point) / arm.length;
        return std::hypot(off, task.oriented ? norm(rotation_vector(task.target.R * transposed(tool.R))) : 0) <= NEARBY;
    }
    void find_misses(PoseAnswer& found) const
    {
        const Pose tool = arm.state(found.q.data(), Mat());
        found.position = norm(task.target.p - tool.p);
        found.orientation = task.oriented ? norm(rotation_vector(task.target.R * transposed(tool.R))) : 0;
    }
    bool reaches(const PoseAnswer& found) const
    {
        return found.position <= task.tolerance && found.orientation <= task.tolerance;
    }

    int exact_rows(const double* q) const
    {
        int k = 0;
        for (const ExactDemand& one : task.exact)
            k += one.kind == ExactDemand::Kind::point  ? 3
                 : one.kind == ExactDemand::Kind::axis ? 2
                 : one.rows                            ? one.rows(q, Mat(), Vec())
                                                       : 1;
        return k;
    }

    // state.q is set; the rest is found.
    void linearise(State& state) const
    {
        const Workspace::Frame frame(w);
        Mat J = task.oriented && !task.root.w ? state.A : Mat(w, 6, m);
        const Pose tool = arm.state(state.q.p, J);
        if (state.C.rows)
            set_rows(state, tool, J);
        const Vec3 here = tool * task.point, off = task.target * task.point - here;
        for (int j = 0; j < m; j++) {
            const Vec3 omega{J(0, j), J(1, j), J(2, j)}, moved = cross(omega, here);
            for (int i = 0; i < 3; i++)
                J(3 + i, j) += moved[i];
        }
        if (!task.oriented) {
            state.A.set(J.rows_from(3, 6));
            std::copy(off.begin(), off.end(), state.r.p);
        } else {
            const Vec3 omega = rotation_vector(task.target.R * transposed(tool.R));
            if (task.root.w)
                measure(state, J, omega, off);
            else {
                J.rows_from(0, 3).all().scale(task.length);
                for (int i = 0; i < 3; i++)
                    state.r[i] = task.length * omega[i], state.r[3 + i] = off[i];
            }
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

    void set_rows(State& state, const Pose& tool, Mat J) const
    {
        int k = 0;
        for (const ExactDemand& one : task.exact)
            switch (one.kind) {
            case ExactDemand::Kind::point: {
                const Vec3 here = tool * one.point, off = task.target * one.point - here;
                for (int i = 0; i < 3; i++, k++)
                    row_along(state, k, J, unit(i), here, off[i]);
                break;
            }
            case ExactDemand::Kind::plane: {
                const Vec3 here = tool * one.point, off = task.target * one.point - here;
                row_along(state, k++, J, one.direction, here, dot(one.direction, off));
                break;
            }
            case ExactDemand::Kind::axis: {
                const Vec3 here = tool.R * one.direction, there = task.target.R * one.direction;
                const auto across = two_across(here);
                const Vec3 turn = turn_between(here, there, across[0]);
                for (const Vec3& along : across) {
                    for (int j = 0; j < m; j++)
                        state.C(k, j) = along[0] * J(0, j) + along[1] * J(1, j) + along[2] * J(2, j);
                    state.b[k++] = dot(along, turn);
                }
                break;
            }
            case ExactDemand::Kind::other: {
                const int count = one.rows(state.q.p, Mat(), Vec());
                one.rows(state.q.p, state.C.rows_from(k, k + count), state.b.part(k, k + count));
                k += count;
            }
            }
    }
    static Vec3 unit(int i)
    {
        Vec3 e{};
        e[i] = 1;
        return e;
    }
    // The velocity of a point along a direction.
    void row_along(State& state, int k, Mat J, const Vec3& direction, const Vec3& point, double off) const
    {
        const Vec3 moment = cross(point, direction);
        for (int j = 0; j < m; j++)
            state.C(k, j) = moment[0] * J(0, j) + moment[1] * J(1, j) + moment[2] * J(2, j) + direction[0] * J(3, j)
                            + direction[1] * J(4, j) + direction[2] * J(5, j);
        state.b[k] = off;
    }
    // Two unit vectors across another.
    static std::array<Vec3, 2> two_across(const Vec3& z)
    {
        int least = 0;
        for (int i = 1; i < 3; i++)
            least = std::abs(z[i]) < std::abs(z[least]) ? i : least;
        const Vec3 x = cross(z, unit(least)), first = (1 / norm(x)) * x;
        return {first, cross(z, first)};
    }
    // The rotation vector that takes one direction to another, across both; of opposite ones half a turn about `else_by`.
    static Vec3 turn_between(const Vec3& here, const Vec3& there, const Vec3& else_by)
    {
        const Vec3 turn = cross(here, there);
        const double sine = norm(turn), cosine = dot(here, there);
        if (sine > 1e-12)
            return (std::atan2(sine, cosine) / sine) * turn;
        return cosine < 0 ? PI * else_by : turn;
    }

    // -grad f, A'r
    Vec slope(const State& state) const { return t(state.A) * state.r; }

    // The second derivative of f by differences of its gradient, with the absolute values of its eigenvalues.
    Mat curvature(const State& state) const
    {
        State beside(w, m, state.r.n, state.b.n);
        const Vec here = slope(state);
        Mat H(w, m, m), M(w, m, m);
        for (int i = 0; i < m; i++) {
            const double h = state.q[i] + DIFFERENCE > arm.upper[i] ? -DIFFERENCE : DIFFERENCE;
            beside.q.set(state.q);
            beside.q[i] += h;
            linearise(beside);
            H[i].set((here - slope(beside)) / h);
        }
        for (int i = 0; i < m; i++)
            for (int j = 0; j <= i; j++)
                H(i, j) = H(j, i) = 0.5 * (H(i, j) + H(j, i));
        const SymmetricEigen of(H);
        for (int i = 0; i < m; i++) {
            M[i].set(of.V[i]);
            M[i].scale(std::abs(of.values[i]));
        }
        return t(of.V) * M;
    }

    // argmin 1/2 |r - A x|^2 + 1/2 mu |x|^2 inside the box; H is the second derivative in place of A'A.
    Vec step(const State& state, Mat H, double mu, Vec lower, Vec upper) const
    {
        const Mat A = state.A;
        const double size = A.all().square();
        if (!H.w && m >= A.rows) {
            bool positive = true;
            const Mat U = cholesky(gram(A, mu + FLOOR * size), &positive);
            const Vec x = t(A) * solved(U, solved(t(U), state.r));
            if (positive && within(lower, x, upper))
                return x;
        }
        if (!H.w)
            H = t(A) * A;
        for (int i = 0; i < m; i++)
            H(i, i) += std::max(mu, QP_FLOOR * size);
        const Vec g = slope(state), x = minimum(H, g, lower, upper);
        if (x.w) {
            clip(x, lower, upper);
            return x;
        }
        g.scale(1 / size);
        clip(g, lower, upper);
        return g;
    }

    // The step that meets exact demands first, and the multiplier of their rows:
    //     x_1 = argmin 1/2 |b - C x|^2 + 1/2 lambda |b|^2 |x|^2
    //     x   = argmin 1/2 |r - A x|^2 + 1/2 mu |x|^2  over  C x = C x_1,  x = x_1 + B'z       both inside the box
    Vec exact_step(const State& state, double damping, Vec lower, Vec upper, double& price) const
    {
        const Mat A = state.A, C = state.C;
        const Vec b = state.b;
        const double size = A.all().square(), square = C.all().square();
        const double weight = std::max({damping * b.square(), ROW_FLOOR * square, TINY});
        const Mat U = cholesky(gram(C, weight));
        Vec x = t(C) * solved(U, solved(t(U), b));
        if (!within(lower, x, upper)) {
            Mat H = t(C) * C;
            for (int i = 0; i < m; i++)
                H(i, i) += weight;
            const Vec g = t(C) * b;
            x = minimum(H, g, lower, upper);
            if (!x.w)
                x = g / (square + weight);
            clip(x, lower, upper);
        }
        const Mat B = null_space(C);
        if (B.rows) {
            const Mat AB = A * t(B);
            Mat H = t(AB) * AB;
            for (int i = 0; i < H.rows; i++)
                H(i, i) += std::max(2 * damping * state.f, QP_FLOOR * size);
            const Vec z = minimum(H, t(AB) * (state.r - A * x), lower - x, upper - x, transposed(B));
            if (z.w)
                x.add(1, t(B) * z);
            clip(x, lower, upper);
        }
        price = std::min(multiplier(state, x, lower, upper), DEAREST * std::sqrt(2 * size * state.f / (square + TINY)));
        return x;
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
    // |y|: C'y is what a step leaves of the slope where no bound holds a joint.
    double multiplier(const State& state, Vec x, Vec lower, Vec upper) const
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
            return 0;
        const Mat U = cholesky(gram(free, FLOOR * square));
        const double y = solved(U, solved(t(U), free * left)).norm();
        return y < INFINITY ? y : 0;
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

    // Steps from a start inside the limits until the goal is met or no step gains anything; none makes the merit worse.
    Try descend(const double* start, const How& how)
    {
        const Workspace::Frame frame(w);
        const int n = task.oriented ? 6 : 3, k = task.exact.empty() ? 0 : exact_rows(start);
        State state(w, m, n, k), seen(w, m, n, k);
        std::copy(start, start + m, state.q.p);
        linearise(state);
        Vec lower(w, m), upper(w, m), past(w, STALLED + 1);
        double damping = DAMPING, penalty = 0;
        const int longest = how.patient ? PATIENCE : LONGEST;
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
            double price = 0;
            const Vec x = k ? exact_step(state, damping, lower, upper, price)
                            : step(state, how.patient ? curvature(state) : Mat(), 2 * damping * state.f, lower, upper);
            penalty = std::max(penalty, PENALTY_MARGIN * price);
            seen.q.set(state.q + x);
            arm.inside(seen.q.p);
            linearise(seen);
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
