#include "report.hpp"
#include "exact.hpp"

namespace iq {
namespace {

constexpr double MISSED = 0.05;            // "ok" misses at most this share of the twist,
constexpr double FALLING = 0.5;            // or both errors fall at this share of the requested rate
constexpr double GROWING = 0.01;           // share of the slack at which an error within it may grow
constexpr double PACED = 1e-3;             // a pace this near to 1 is not slowed down: what limits take of it is that soft
constexpr double RELAXED = 1e-4;           // rows are relaxed by less than this share more than they have to
constexpr double ACTIVE = 1e-6;            // a limit this close, relative to its value, is at it
constexpr double SLOWEST = 1e-6;           // joint speeds that count as this one where they are slower [rad/s]
constexpr double NEGLIGIBLE = 1e-9;        // of a twist
constexpr double MOST_SHORTENED = 1.01;    // what exceeds a limit by more did not by rounding
constexpr double ROUNDING_OF_PRODUCTS = 1e-13;
constexpr double PROGRESS = 2e-4;          // less than this share of a twist is none of it
constexpr double ENOUGH = 0.95;            // fewer than six joints that can do this share are not to blame
constexpr double SPREAD = 1e-6;            // of directions of a point: their determinant, beside the cube of their sum
constexpr double TOOL_SPEED_ROW = -1, FIRST_EXACT_ROW = -2;

class Reporter {
  public:
    Reporter(const Tick& tick, const Answer& answer, Workspace& w)
        : tick(tick), answer(answer), w(w), m(tick.J.cols), bodies(tick.J.rows / 6),
          x(clipped(shortened(answer.velocity))), A(tick.root * tick.J), b(tick.root * (tick.ahead + tick.error)),
          done(A * x)
    {
    }

    Report report()
    {
        found.velocity = x;
        found.share = answer.share, found.guard = 1 - answer.guarded;
        found.residual = tick.ahead + tick.error - tick.J * x;
        if (const Vec& pulls = answer.multipliers; pulls.w && pulls.n >= m) {
            found.multipliers = pulls.part(0, m);
            if (tick.C.rows)
                found.row_multipliers = pulls.part(m, pulls.n);
        }
        for (int j = 0; j < m; j++) {
            const double margin = ACTIVE * std::max(SLOWEST, std::abs(x[j]));
            if (x[j] <= tick.lower[j] + margin || x[j] >= tick.upper[j] - margin)
                found.active.push_back(j);
        }
        if (answer.failure != Failure::none) {
            found.status = Status::held, found.method = Method::hold, found.share = 0;
            say(answer.failure == Failure::no_numbers ? Code::no_numbers : Code::no_velocity);
            return found;
        }
        const bool contradicts = relaxed(), unkept = rows_unkept();
        const double missed = share_missed();
        const bool little = makes_no_progress();
        const std::vector<std::pair<double, double>> off = rows_moved();
        const bool limited = little || !off.empty() || (missed > MISSED && !falls());
        const bool stuck = tick.slack == 0 ? little : (little || (limited && missed == INFINITY)) && rests();
        if (stuck)
            say(Code::stuck);
        const bool slowed = answer.pace < 1 - PACED && tick.error.square() > 0;
        if (tick.slack > 0 && b.norm() <= nothing())
            found.share = 1;
        // a little less by damping alone is as good as a little that is missed
        const bool scaled = found.share < (answer.limited ? 1 - ACTIVE : 1 - MISSED);
        if (scaled && answer.share < 1 - ACTIVE)
            say(Code::rows_slowed, {}, {}, {answer.share});
        if (!off.empty())
            say_moved(off);
        if (slowed)
            say(Code::approach_slowed, {}, {}, {answer.pace});
        if (answer.guarded < 1)
            say(Code::guarded, {}, {}, {found.guard});
        found.status = contradicts || unkept ? Status::degraded
                       : scaled ? Status::scaled
                       : answer.guarded < 1 ? Status::guarded
                       : limited ? Status::limited
                                 : Status::ok;
        found.damping = missed > 0 ? tick.damping : 0;
        found.method = answer.limited || answer.share < 1 - ACTIVE ? Method::qp
                       : found.damping > 0 ? Method::damped
                                           : Method::closed_form;
        if (found.status == Status::limited)
            explain(missed, stuck || !off.empty());
        at_limits();
        return found;
    }

  private:
    const Tick& tick;
    const Answer& answer;
    Workspace& w;
    const int m, bodies;
    const Vec x;
    const Mat A;
    const Vec b, done;
    Report found;

    void say(Code code, const std::vector<int>& joints = {}, const std::vector<double>& rows = {},
             const std::vector<double>& numbers = {})
    {
        iq::say(found.reasons, code, joints, rows, numbers);
    }

    Vec clipped(Vec y) const
    {
        for (int j = 0; j < m; j++)
            y[j] = std::min(std::max(y[j], tick.lower[j]), tick.upper[j]);
        return y;
    }
    // Shortened until rows and tool speed hold exactly where rounding exceeds them, unless standing still does, too. The
    // speed is exceeded by more than ACTIVE where an arm is next to singular.
    Vec shortened(Vec y) const
    {
        double most = 1;
        const auto use = [&](double share, double least) {
            if (share < least)
                most = std::max(most, share);
        };
        for (int j = 0; j < m; j++)
            if (tick.lower[j] > 0 || tick.upper[j] < 0)
                return y.copy();
        for (int i = 0; i < tick.C.rows; i++) {
            const double value = tick.C[i].dot(y);
            if (tick.row_lower[i] > 0 || tick.row_upper[i] < 0)
                return y.copy();
            if (value > tick.row_upper[i] || value < tick.row_lower[i])
                use(value / (value > 0 ? tick.row_upper[i] : tick.row_lower[i]), 1 / (1 - ACTIVE));
        }
        if (tick.P.w)
            use((tick.P * y).norm() / tick.speed, answer.faster > 0 ? 1 / (1 - ACTIVE) : MOST_SHORTENED);
        return y / most;
    }

    // Rows and tool speed that gave way, the one by most first.
    bool relaxed()
    {
        std::vector<double> rows, by;
        if (answer.relaxed.w) {
            for (int i = 0; i < answer.relaxed.n; i++)
                if (answer.relaxed[i] > 0)
                    rows.push_back(i);
            const auto relative = [&](double i) {
                const int row = static_cast<int>(i);
                return answer.relaxed[row] / (tick.C[row].norm() + 1e-300);
            };
            std::stable_sort(rows.begin(), rows.end(), [&](double i, double j) {
                return relative(i) > relative(j) * (1 + NEGLIGIBLE);
            });
            for (const double i : rows)
                by.push_back(answer.relaxed[static_cast<int>(i)]);
        }
        if (!rows.empty())
            say(Code::rows_contradict, in_the_way(rows), rows, by);
        if (answer.faster > 0)
            say(Code::tool_faster, {}, {}, {tick.speed + answer.faster, tick.speed});
        return !rows.empty() || answer.faster > 0;
    }
    // Joints at a bound that the rows move, as near to it as the rows were relaxed.
    std::vector<int> in_the_way(const std::vector<double>& rows) const
    {
        std::vector<int> joints;
        for (int j = 0; j < m; j++) {
            const double room = std::min(x[j] - tick.lower[j], tick.upper[j] - x[j]);
            if (std::any_of(rows.begin(), rows.end(), [&](double i) {
                    const int row = static_cast<int>(i);
                    const double by = std::abs(x[j]) + answer.relaxed[row] / std::abs(tick.C(row, j));
                    return tick.C(row, j) != 0 && room <= RELAXED * by;
                }))
                joints.push_back(j);
        }
        return joints;
    }
    // Exact rows that depend on each other and demand different things.
    bool rows_unkept()
    {
        if (answer.unmet <= NEGLIGIBLE || (tick.slack > 0 && b.norm() <= nothing()))
            return false;
        say(Code::rows_unkept, {}, {}, {answer.unmet});
        return true;
    }
    // How far limits move exact rows off the share of their demand: which rows, and by how much.
    std::vector<std::pair<double, double>> rows_moved() const
    {
        std::vector<std::pair<double, double>> found;
        if (!answer.beside)
            return found;
        const Vec off = tick.E * x - answer.share * (tick.E_f + tick.E_e);
        for (int i = 0; i < off.n; i++)
            if (std::abs(off[i]) > ACTIVE * tick.E[i].norm() * std::max(SLOWEST, x.norm()))
                found.emplace_back(FIRST_EXACT_ROW - i, std::abs(off[i]));
        return found;
    }
    void say_moved(const std::vector<std::pair<double, double>>& off)
    {
        std::vector<double> rows, by;
        for (const auto& [row, distance] : off)
            rows.push_back(row), by.push_back(distance);
        say(Code::rows_moved, {}, rows, by);
    }

    // A measured twist up to which nothing is to move, as an error of a pose that may stay.
    double nothing() const { return GROWING * tick.slack; }
    // Whether joints move the tool, each by itself, by no more than that.
    bool rests() const
    {
        const Mat columns = transposed(A);
        double most = 0;
        for (int j = 0; j < m; j++)
            most += columns[j].norm() * std::abs(x[j]);
        return most <= nothing();
    }
    // Whether the twist is met but for rounding.
    bool met(Vec wanted) const
    {
        const double left = (wanted - done).norm();
        return left <= NEGLIGIBLE * wanted.norm()
               || left <= A.all().norm() * std::max(ROUNDING_OF_PRODUCTS * x.norm(), ACTIVE * SLOWEST);
    }
    // Of what exact rows leave of the twist, if there are any: 0 where it is met, infinite where nothing is to move.
    double share_missed() const
    {
        if (met(b))
            return 0;
        const Vec wanted = tick.E.rows ? possible() : b;
        if (tick.E.rows && met(wanted))
            return 0;
        const double size = wanted.norm();
        return size > nothing() ? (wanted - done).norm() / size : INFINITY;
    }
    // What joints can do of the twist, beside the exact rows at their share, without limits and damping.
    Vec possible() const
    {
        const ExactRows rows = whitened(tick, w);
        if (!rows.E.rows) {
            const SVD svd(A);
            return A * svd.least(b, svd.rank(ROUNDING));
        }
        const SVD svd(rows.E);
        const int rank = svd.rank(ROUNDING);
        const Vec kept = answer.share * svd.least(rows.f + rows.e, rank), done = A * kept;
        const Mat M = A * t(svd.V.rows_from(rank, m));
        if (!M.cols)
            return done;
        const SVD rest(M);
        const bool nothing_left = rest.sigma[0] <= ROUNDING * A.all().norm();  // exact rows are all that counts
        return nothing_left ? done : done + M * rest.least(b - done, rest.rank(ROUNDING));
    }
    bool makes_no_progress() const
    {
        const bool along_rows = tick.E.rows && answer.share > PROGRESS && (tick.E_f + tick.E_e).norm() > nothing();
        if (along_rows || b.norm() <= nothing())
            return false;
        return b.dot(done) < PROGRESS * b.square() && !met(b);
    }
    // Whether the errors of position and of orientation, of each body, fall at FALLING of the requested rate. One within
    // slack need not fall so fast, but does not grow by more than GROWING of it either; nor does any by what moves beside
    // it, were that to go on for as long as closing it takes.
    bool falls() const
    {
        const Vec asked = tick.root * tick.error, change = done - tick.root * tick.ahead;
        if (tick.slack == 0 && asked.square() == 0)
            return false;
        const int size = b.n / bodies, turns = tick.apart ? tick.turns : size;
        for (int i = 0; i < b.n; i += size)
            if (!falls(asked.part(i, i + turns), change.part(i, i + turns))
                || !falls(asked.part(i + turns, i + size), change.part(i + turns, i + size)))
                return false;
        return true;
    }
    bool falls(Vec error, Vec closes) const
    {
        const double rate = error.norm();
        return closes.dot(error) >= rate * std::max(FALLING * rate - tick.slack, -nothing())
               && !(tick.slack > 0 && (error - closes).norm() > rate + nothing());
    }
    // Whether joints move a point in every direction, by their velocities of it (3, m).
    static bool moves_every_way(Mat moving)
    {
        const Mat S = moving * t(moving);
        const double trace = S(0, 0) + S(1, 1) + S(2, 2);
        const double determinant = S(0, 0) * (S(1, 1) * S(2, 2) - S(1, 2) * S(2, 1))
                                   - S(0, 1) * (S(1, 0) * S(2, 2) - S(1, 2) * S(2, 0))
                                   + S(0, 2) * (S(1, 0) * S(2, 1) - S(1, 1) * S(2, 0));
        return determinant > SPREAD * trace * trace * trace;
    }
    void explain(double missed, bool said)
    {
        double explained = 0;
        if (bodies == 1 && m < 6 && !tick.E.rows && b.norm() > nothing()) {
            const double share = b.dot(possible()) / b.square();
            if (share < ENOUGH) {
                say(Code::few_joints, {}, {}, {static_cast<double>(m), share});
                if (m >= 3 && A.rows == 6 && moves_every_way(A.rows_from(3, 6)))
                    say(Code::position_alone);
                explained = std::sqrt(std::max(0.0, 1 - share)) + MISSED;
            }
        }
        if (said || missed < explained || answer.pace < 1 - PACED)
            return;
        if (missed == INFINITY)
            say(Code::moved);
        else
            say(Code::missed, {}, {}, {missed});
    }
    // Joints in their order, the tool's speed, then rows, the one that pulls hardest first.
    void at_limits()
    {
        std::vector<double> names;
        if (tick.P.w && (tick.P * x).norm() >= tick.speed * (1 - ACTIVE))
            names.push_back(TOOL_SPEED_ROW);
        std::vector<double> rows;
        for (int i = 0; i < tick.C.rows; i++) {
            const double length = tick.C[i].norm(), margin = ACTIVE * length * std::max(SLOWEST, x.norm());
            const double value = tick.C[i].dot(x);
            if (length > 0 && (value <= tick.row_lower[i] + margin || value >= tick.row_upper[i] - margin))
                rows.push_back(i);
        }
        if (answer.multipliers.w) {
            const auto pull = [&](double i) {
                const int row = static_cast<int>(i);
                return std::abs(answer.multipliers[m + row]) * tick.C[row].norm();
            };
            std::stable_sort(rows.begin(), rows.end(), [&](double i, double j) { return pull(i) > pull(j); });
        }
        names.insert(names.end(), rows.begin(), rows.end());
        if (!found.active.empty() || !names.empty())
            say(Code::at_limits, found.active, names);
    }
};

}  // namespace

void say(std::vector<double>& to, Code code, const std::vector<int>& joints, const std::vector<double>& rows,
         const std::vector<double>& numbers)
{
    for (const std::size_t part : {static_cast<std::size_t>(code), joints.size(), rows.size(), numbers.size()})
        to.push_back(static_cast<double>(part));
    to.insert(to.end(), joints.begin(), joints.end());
    to.insert(to.end(), rows.begin(), rows.end());
    to.insert(to.end(), numbers.begin(), numbers.end());
}
bool has(const std::vector<double>& reasons, Code code)
{
    for (std::size_t i = 0; i < reasons.size(); i += 4 + static_cast<std::size_t>(reasons[i + 1] + reasons[i + 2] + reasons[i + 3]))
        if (reasons[i] == static_cast<double>(code))
            return true;
    return false;
}

Report report(const Tick& tick, const Answer& answer, Workspace& w) { return Reporter(tick, answer, w).report(); }

}  // namespace iq
