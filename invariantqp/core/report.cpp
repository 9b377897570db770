#include "report.hpp"
#include "exact.hpp"

namespace iq {
namespace {

constexpr double MOST_MISSED = 0.05;        // "ok" misses at most this share of the twist,
constexpr double LEAST_DECREASE = 0.5;      // or both errors decrease at this share of the requested rate
constexpr double MOST_GROWTH = 0.01;        // an error within its tolerance may grow by this share of it in a second
constexpr double SCALE_TOLERANCE = 1e-3;    // an approach scale this close to 1 is the softness of its problem
constexpr double RELAXATION_MARGIN = 1e-4;  // rows are relaxed by less than this share more than needed
constexpr double MOST_SHORTENED = 1.01;     // a larger excess of the tool speed limit is no rounding
constexpr double LEAST_PROGRESS = 2e-4;     // a smaller share of the twist counts as no progress
constexpr double TOOL_SPEED_ROW = -1, FIRST_EXACT_ROW = -2;

class Reporter {
  public:
    Reporter(const Tick& tick, const Answer& answer, Workspace& w)
        : tick(tick), answer(answer), w(w), m(tick.J.cols), bodies(tick.J.rows / 6),
          x(clipped(shortened(answer.velocity))), A(tick.root * tick.J), b(tick.root * (tick.feedforward + tick.error)),
          done(A * x)
    {
    }

    Report report()
    {
        found.velocity = x;
        found.scale = answer.scale, found.guard = 1 - answer.form_share;
        found.residual = tick.feedforward + tick.error - tick.J * x;
        if (const Vec& multipliers = answer.multipliers; multipliers.w && multipliers.n >= m) {
            found.multipliers = multipliers.part(0, m);
            if (tick.C.rows)
                found.row_multipliers = multipliers.part(m, multipliers.n);
        }
        for (int j = 0; j < m; j++) {
            const double margin = ACTIVE_TOLERANCE * std::max(ACTIVE_TOLERANCE, std::abs(x[j]));
            if (x[j] <= tick.lower[j] + margin || x[j] >= tick.upper[j] - margin)
                found.active.push_back(j);
        }
        if (answer.failure != Failure::none) {
            found.status = Status::held, found.method = Method::hold, found.scale = 0;
            add_reason(answer.failure == Failure::no_numbers ? Code::numerical_failure : Code::no_solution);
            return found;
        }
        const bool conflicts = add_relaxed(), inconsistent = add_inconsistent();
        const double missed = missed_share();
        const bool no_progress = makes_no_progress();
        const std::vector<std::pair<double, double>> off = violated_rows();
        const bool limited = no_progress || !off.empty() || (missed > MOST_MISSED && !errors_decrease());
        const bool stuck = tick.error_tolerance == 0 ? no_progress : (no_progress || (limited && missed == INFINITY)) && is_at_rest();
        if (stuck)
            add_reason(Code::no_progress);
        const bool slowed = answer.approach_scale < 1 - SCALE_TOLERANCE && tick.error.square() > 0;
        if (tick.error_tolerance > 0 && b.norm() <= zero_twist())
            found.scale = 1;
        // by damping alone, a scale within MOST_MISSED of 1 is not reported
        const bool scaled = found.scale < (answer.limits_active ? 1 - ACTIVE_TOLERANCE : 1 - MOST_MISSED);
        if (scaled && answer.scale < 1 - ACTIVE_TOLERANCE)
            add_reason(Code::exact_rows_scaled, {}, {}, {answer.scale});
        if (!off.empty())
            add_violated(off);
        if (slowed)
            add_reason(Code::approach_scaled, {}, {}, {answer.approach_scale});
        if (answer.form_share < 1)
            add_reason(Code::guarded, {}, {}, {found.guard});
        found.status = conflicts || inconsistent ? Status::degraded
                       : scaled ? Status::scaled
                       : answer.form_share < 1 ? Status::guarded
                       : limited ? Status::limited
                                 : Status::ok;
        found.damping = missed > 0 ? tick.damping : 0;
        found.method = answer.limits_active ? Method::qp : found.damping > 0 ? Method::damped : Method::closed_form;
        if (found.status == Status::limited)
            explain(missed, stuck || !off.empty());
        add_active();
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

    void add_reason(Code code, const std::vector<int>& joints = {}, const std::vector<double>& rows = {},
             const std::vector<double>& numbers = {})
    {
        iq::add_reason(found.reasons, code, joints, rows, numbers);
    }

    Vec clipped(Vec y) const
    {
        for (int j = 0; j < m; j++)
            y[j] = std::min(std::max(y[j], tick.lower[j]), tick.upper[j]);
        return y;
    }
    // Shortened so that rows and tool speed, exceeded by rounding, hold exactly, if zero velocity is feasible. Near
    // singularities rounding exceeds the speed by more than ACTIVE_TOLERANCE.
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
                use(value / (value > 0 ? tick.row_upper[i] : tick.row_lower[i]), 1 / (1 - ACTIVE_TOLERANCE));
        }
        if (tick.P.w)
            use((tick.P * y).norm() / tick.speed, answer.speed_excess > 0 ? 1 / (1 - ACTIVE_TOLERANCE) : MOST_SHORTENED);
        return y / most;
    }

    // Adds relaxed rows, the most relaxed first, and a relaxed tool speed; whether there are any.
    bool add_relaxed()
    {
        std::vector<double> rows, by;
        if (answer.relaxed.w) {
            for (int i = 0; i < answer.relaxed.n; i++)
                if (answer.relaxed[i] > 0)
                    rows.push_back(i);
            const auto relative = [&](double i) {
                const int row = static_cast<int>(i);
                return answer.relaxed[row] / (tick.C[row].norm() + TINY);
            };
            std::stable_sort(rows.begin(), rows.end(), [&](double i, double j) {
                return relative(i) > relative(j) * (1 + ROUNDING);
            });
            for (const double i : rows)
                by.push_back(answer.relaxed[static_cast<int>(i)]);
        }
        if (!rows.empty())
            add_reason(Code::limits_conflict, conflicting_bounds(rows), rows, by);
        if (answer.speed_excess > 0)
            add_reason(Code::tool_speed_exceeded, {}, {}, {tick.speed + answer.speed_excess, tick.speed});
        return !rows.empty() || answer.speed_excess > 0;
    }
    // Joints at a bound that conflicts with the rows.
    std::vector<int> conflicting_bounds(const std::vector<double>& rows) const
    {
        std::vector<int> joints;
        for (int j = 0; j < m; j++) {
            const double distance = std::min(x[j] - tick.lower[j], tick.upper[j] - x[j]);
            if (std::any_of(rows.begin(), rows.end(), [&](double i) {
                    const int row = static_cast<int>(i);
                    const double by = std::abs(x[j]) + answer.relaxed[row] / std::abs(tick.C(row, j));
                    return tick.C(row, j) != 0 && distance <= RELAXATION_MARGIN * by;
                }))
                joints.push_back(j);
        }
        return joints;
    }
    // Adds exact rows that are linearly dependent with inconsistent demands; whether there are any.
    bool add_inconsistent()
    {
        if (answer.inconsistency <= ROUNDING || (tick.error_tolerance > 0 && b.norm() <= zero_twist()))
            return false;
        add_reason(Code::exact_rows_inconsistent, {}, {}, {answer.inconsistency});
        return true;
    }
    // Exact rows that limits violate, and by how much.
    std::vector<std::pair<double, double>> violated_rows() const
    {
        std::vector<std::pair<double, double>> found;
        if (!answer.exact_infeasible)
            return found;
        const Vec off = tick.E * x - answer.scale * (tick.E_f + tick.E_e);
        for (int i = 0; i < off.n; i++)
            if (std::abs(off[i]) > ACTIVE_TOLERANCE * tick.E[i].norm() * std::max(ACTIVE_TOLERANCE, x.norm()))
                found.emplace_back(FIRST_EXACT_ROW - i, std::abs(off[i]));
        return found;
    }
    void add_violated(const std::vector<std::pair<double, double>>& off)
    {
        std::vector<double> rows, by;
        for (const auto& [row, distance] : off)
            rows.push_back(row), by.push_back(distance);
        add_reason(Code::exact_rows_violated, {}, rows, by);
    }

    // The size of a measured twist that counts as zero.
    double zero_twist() const { return MOST_GROWTH * tick.error_tolerance; }
    // Whether the tool is at rest: each joint moves it by no more than that.
    bool is_at_rest() const
    {
        const Mat columns = transposed(A);
        double most = 0;
        for (int j = 0; j < m; j++)
            most += columns[j].norm() * std::abs(x[j]);
        return most <= zero_twist();
    }
    // Whether a twist is achieved, except for rounding.
    bool is_achieved(Vec wanted) const
    {
        const double left = (wanted - done).norm();
        return left <= ROUNDING * wanted.norm()
               || left <= A.all().norm() * std::max(PRODUCT_ROUNDING * x.norm(), ACTIVE_TOLERANCE * ACTIVE_TOLERANCE);
    }
    // Missed share of the twist or, with exact rows, of what they leave of it; infinite for a zero twist that is missed.
    double missed_share() const
    {
        if (is_achieved(b))
            return 0;
        const Vec wanted = tick.E.rows ? achievable() : b;
        if (tick.E.rows && is_achieved(wanted))
            return 0;
        const double size = wanted.norm();
        return size > zero_twist() ? (wanted - done).norm() / size : INFINITY;
    }
    // The achievable part of the twist with the exact rows at their scale, without limits and damping.
    Vec achievable() const
    {
        const ExactRows rows = whitened(tick, w);
        if (!rows.E.rows) {
            const SVD svd(A);
            return A * svd.least(b, svd.rank(ROUNDING));
        }
        const SVD svd(rows.E);
        const int rank = svd.rank(ROUNDING);
        const Vec kept = answer.scale * svd.least(rows.f + rows.e, rank), done = A * kept;
        const Mat M = A * t(svd.V.rows_from(rank, m));
        if (!M.cols)
            return done;
        const SVD rest(M);
        const bool nothing_left = rest.sigma[0] <= ROUNDING * A.all().norm();  // the exact rows determine the whole measured twist
        return nothing_left ? done : done + M * rest.least(b - done, rest.rank(ROUNDING));
    }
    bool makes_no_progress() const
    {
        const bool along_rows = tick.E.rows && answer.scale > LEAST_PROGRESS && (tick.E_f + tick.E_e).norm() > zero_twist();
        if (along_rows || b.norm() <= zero_twist())
            return false;
        return b.dot(done) < LEAST_PROGRESS * b.square() && !is_achieved(b);
    }
    // Whether the position and orientation errors of each body decrease at LEAST_DECREASE of the requested rate. One within
    // its tolerance may decrease more slowly or grow by MOST_GROWTH of it; motion across an error must not increase it over
    // the time in which it is closed.
    bool errors_decrease() const
    {
        const Vec asked = tick.root * tick.error, change = done - tick.root * tick.feedforward;
        if (tick.error_tolerance == 0 && asked.square() == 0)
            return false;
        const int size = b.n / bodies, turns = tick.separates_orientation ? tick.orientation_rows : size;
        for (int i = 0; i < b.n; i += size)
            if (!decreases(asked.part(i, i + turns), change.part(i, i + turns))
                || !decreases(asked.part(i + turns, i + size), change.part(i + turns, i + size)))
                return false;
        return true;
    }
    bool decreases(Vec error, Vec closes) const
    {
        const double rate = error.norm();
        return closes.dot(error) >= rate * std::max(LEAST_DECREASE * rate - tick.error_tolerance, -zero_twist())
               && !(tick.error_tolerance > 0 && (error - closes).norm() > rate + zero_twist());
    }
    // Whether joints can move a point in every direction, for its Jacobian (3, m).
    static bool spans_translations(Mat moving)
    {
        const Mat S = moving * t(moving);
        const double trace = S(0, 0) + S(1, 1) + S(2, 2);
        const double determinant = S(0, 0) * (S(1, 1) * S(2, 2) - S(1, 2) * S(2, 1))
                                   - S(0, 1) * (S(1, 0) * S(2, 2) - S(1, 2) * S(2, 0))
                                   + S(0, 2) * (S(1, 0) * S(2, 1) - S(1, 1) * S(2, 0));
        return determinant > ACTIVE_TOLERANCE * trace * trace * trace;
    }
    void explain(double missed, bool explained_already)
    {
        double explained = 0;
        if (bodies == 1 && m < 6 && !tick.E.rows && b.norm() > zero_twist()) {
            const double share = b.dot(achievable()) / b.square();
            if (share < 1 - MOST_MISSED) {
                add_reason(Code::few_joints, {}, {}, {static_cast<double>(m), share});
                if (m >= 3 && A.rows == 6 && spans_translations(A.rows_from(3, 6)))
                    add_reason(Code::position_only);
                explained = std::sqrt(std::max(0.0, 1 - share)) + MOST_MISSED;
            }
        }
        if (explained_already || missed < explained || answer.approach_scale < 1 - SCALE_TOLERANCE)
            return;
        if (missed == INFINITY)
            add_reason(Code::moved_by_limits);
        else
            add_reason(Code::twist_missed, {}, {}, {missed});
    }
    // Adds the active limits: joints, tool speed, then rows, the one with the largest multiplier first.
    void add_active()
    {
        std::vector<double> names;
        if (tick.P.w && (tick.P * x).norm() >= tick.speed * (1 - ACTIVE_TOLERANCE))
            names.push_back(TOOL_SPEED_ROW);
        std::vector<double> rows;
        for (int i = 0; i < tick.C.rows; i++) {
            const double length = tick.C[i].norm(), margin = ACTIVE_TOLERANCE * length * std::max(ACTIVE_TOLERANCE, x.norm());
            const double value = tick.C[i].dot(x);
            if (length > 0 && (value <= tick.row_lower[i] + margin || value >= tick.row_upper[i] - margin))
                rows.push_back(i);
        }
        if (answer.multipliers.w) {
            const auto force = [&](double i) {
                const int row = static_cast<int>(i);
                return std::abs(answer.multipliers[m + row]) * tick.C[row].norm();
            };
            std::stable_sort(rows.begin(), rows.end(), [&](double i, double j) { return force(i) > force(j); });
        }
        names.insert(names.end(), rows.begin(), rows.end());
        if (!found.active.empty() || !names.empty())
            add_reason(Code::at_limits, found.active, names);
    }
};

}  // namespace

void add_reason(std::vector<double>& to, Code code, const std::vector<int>& joints, const std::vector<double>& rows,
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
