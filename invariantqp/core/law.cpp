// The law of definition.py; comments only where the computation differs from the one there.
#include "exact.hpp"
#include "forms.hpp"
#include "measure.hpp"

namespace iq {
namespace {

// The weights of the law; definition.py has the measurements that chose them.
constexpr double RESIDUAL_DAMPING = 0.5, SMOOTHING = 3e-5, NULL_WEIGHT = 5e-6, MIN_PROGRESS = 1e-3, SCALE_WEIGHT = 1e-4;

Answer failed(Failure failure, int m, Workspace& w)
{
    Answer none;
    none.velocity = Vec(w, m, 0);
    none.failure = failure;
    none.scale = 0;
    return none;
}

class Law {
  public:
    Law(const Tick& tick, Workspace& w)
        : tick(tick), w(w), m(tick.J.cols), A(tick.root * tick.J), f(tick.root * tick.feedforward), e(tick.root * tick.error),
          has_error(e.square() > 0)
    {
        if (tick.metric.w) {
            T_inverse = cholesky(tick.metric);
            T = inverse(T_inverse);
        }
        B = T.w ? A * T : A;
        size = B.all().square();
        size = size > 0 ? size : 1;
        null = NULL_WEIGHT * size;
        if (tick.last_velocity.w)
            mu = RESIDUAL_DAMPING * tick.hold_time * std::sqrt(size) * tick.last_residual, nu = SMOOTHING * size;
        else
            mu = tick.form == FormKind::none ? tick.damping * tick.damping : 0;
    }

    Answer answer()
    {
        if (!solve_exact_rows())
            return failed(Failure::infeasible, m, w);
        if (!set_objective())
            return failed(Failure::no_pseudoinverse, m, w);
        if (!scale_approach())
            return failed(Failure::infeasible, m, w);
        found.residual = remaining_error();
        return found;
    }

  private:
    const Tick& tick;
    Workspace& w;
    const int m;
    const Mat A;     // R J
    const Vec f, e;  // R feedforward, R error
    const bool has_error;
    Mat T, T_inverse;   // x = T y, absent for the identity
    Mat B;           // A T
    double size = 1, mu = 0, nu = 0, null = 0;  // |B|^2; null: w
    Answer found;

    // Exact rows: y = origin + basis z.
    bool exact = false;
    Vec origin;
    Mat basis;

    std::optional<FeasibleSet> feasible;
    Vec feasible_point;  // a y inside all limits, with the exact rows at their scale

    Mat gram;              // a root of G
    // H = K'K and the optima y_f + p y_e without limits.
    std::optional<RQ> rq;  // of a regular B, or of its transpose; absent where B is singular
    Mat null_space;        // with rq: its orthonormal basis, by rows
    std::optional<SVD> spectrum;
    Mat triangular;        // K, upper triangular; absent where K is diag(weights) V of the spectrum
    Vec weights;
    double null_damping = 0;  // of a form: H without w P in the null space
    std::optional<RQ> factors;  // of K basis
    Vec y_f, y_e;

    Vec to_x(Vec y) const { return T.w ? T * y : y; }
    Vec to_y(Vec x) const { return T.w ? T_inverse * x : x; }

    bool is_feasible(Vec x) const
    {
        return within(tick.lower, x, tick.upper) && (!tick.C.rows || within(tick.row_lower, tick.C * x, tick.row_upper))
               && (!tick.P.w || (tick.P * x).norm() <= tick.speed);
    }

    // All limits on y, those that conflict with the bounds relaxed by the least; null if no solution is found.
    const FeasibleSet* limits()
    {
        if (feasible)
            return &*feasible;
        Vec low = tick.row_lower, high = tick.row_upper;
        double speed = tick.speed;
        const int k = tick.C.rows;
        const Mat box = T.w ? T : Mat::identity(w, m), rows = k ? (T.w ? tick.C * T : tick.C) : Mat(w, 0, m);
        const Mat P = tick.P.w && T.w ? tick.P * T : tick.P;
        if (!k)
            low = high = Vec(w, 0);
        Vec inside(w, m, 0);
        if (!is_feasible(inside)) {
            const Quadratic shortest{Mat::identity(w, m), inside};
            FeasibleSet polytope{stacked(box, rows), joined(tick.lower, low), joined(tick.upper, high), {}, {}};
            if (const auto y = polytope_optimum(shortest, polytope))
                inside = y->y;
            else if (!relax(polytope.C, low, high, inside))
                return nullptr;
            if (P.w) {
                Mat H = t(P) * P;
                for (int i = 0; i < m; i++)
                    H(i, i) += ROUNDING * (P.all().square() + TINY);
                polytope.lower = joined(tick.lower, low), polytope.upper = joined(tick.upper, high);
                if (const auto y = polytope_optimum({inverse(cholesky(H)), Vec(w, m, 0)}, polytope))
                    inside = y->y;
                const double least = (P * inside).norm();
                if (least > speed)
                    found.speed_excess = least - speed, speed = least * (1 + ROOT_ROUNDING);
            }
        }
        feasible_point = feasible_point.w ? feasible_point : inside;
        feasible = FeasibleSet{stacked(box, rows), joined(tick.lower, low), joined(tick.upper, high), {}, {}, speed};
        if (P.w)
            feasible->P = P, feasible->start = Vec(w, 3, 0);
        return &*feasible;
    }

    // Relaxes rows by the least sum of squares, each in units of its norm; then minimises |y|.
    bool relax(Mat both, Vec& low, Vec& high, Vec& inside)
    {
        const int k = both.rows - m;
        FeasibleSet widened{Mat(w, m + k, m + k, 0), joined(tick.lower, low), joined(tick.upper, high), {}, {}};
        Mat root = Mat::identity(w, m + k);
        Vec lengths(w, k);
        for (int i = 0; i < m + k; i++) {
            widened.C[i].part(0, m).set(both[i]);
            if (i < m) {
                root(i, i) = 1 / ROOT_ROUNDING;
                continue;
            }
            const double length = lengths[i - m] = both[i].norm() + TINY;
            widened.C[i].scale(1 / length), widened.lower[i] /= length, widened.upper[i] /= length;
            widened.C(i, i) = 1;
        }
        const auto slack = polytope_optimum({root, Vec(w, m + k, 0)}, widened);
        if (!slack)
            return false;
        inside = slack->y.part(0, m);
        found.relaxed = Vec(w, k, 0);
        low = low.copy(), high = high.copy();
        for (int i = 0; i < k; i++) {
            const double by = lengths[i] * slack->y[m + i];
            if (std::abs(by) > ROOT_ROUNDING * (std::min(std::abs(low[i]), std::abs(high[i])) + lengths[i]))
                found.relaxed[i] = std::abs(by) * (1 + ROOT_ROUNDING);
            low[i] -= std::max(by, 0.0) * (1 + ROOT_ROUNDING), high[i] -= std::min(by, 0.0) * (1 + ROOT_ROUNDING);
        }
        return true;
    }

    // The y that satisfy the exact rows, y = origin + basis z, and their scale a. False if none is found.
    bool solve_exact_rows()
    {
        exact = tick.E.rows > 0;
        if (!exact)
            return true;
        const ExactRows rows = whitened(tick, w);
        const Mat E = T.w ? rows.E * T : rows.E;
        const Vec demand = rows.f + rows.e;
        Mat free, row_space;  // orthonormal bases of the null space and of the row space of E, by rows
        Vec full;
        std::optional<RQ> rq;
        int rank = E.rows;
        found.inconsistency = rows.inconsistency;
        if (E.rows <= m)
            rq.emplace(E);
        if (rq && rq->regular(ROUNDING)) {
            const Mat Q = rq->basis();
            free = Q.rows_from(0, m - E.rows), row_space = Q.rows_from(m - E.rows, m);
            full = t(row_space) * solved(rq->R, demand);
        } else {
            const SVD svd(E);
            rank = svd.rank(ROUNDING);
            const Mat U = svd.U.rows_from(0, rank);
            if (const double all = demand.norm(); all > 0 && rank >= tick.exact_rank)
                found.inconsistency = std::max(found.inconsistency, (demand - t(U) * (U * demand)).norm() / all);
            rank = std::max(rank, std::min(tick.exact_rank, svd.sigma.n));
            row_space = svd.V.rows_from(0, rank), free = svd.V.rows_from(rank, m);
            full = svd.least(demand, rank, ROUNDING);  // near a singularity a is small, and so is a full
        }
        basis = transposed(free);
        const double length = std::max(full.norm(), ROOT_ROUNDING), most = demand.norm();
        const double twist = (f + e).norm(), damping = RESIDUAL_DAMPING * tick.hold_time * A.all().norm() * tick.last_residual / (twist + TINY);
        const double damped_scale = 1 / (1 + damping * full.square() / (most + TINY));
        const bool whole = row_space.rows >= std::min(m, 6);  // the exact rows determine the tool's whole motion
        double a = tick.last_velocity.w && whole && is_stretching(rows, full) ? std::max(0.0, (damped_scale - MIN_PROGRESS) / (1 - MIN_PROGRESS)) : damped_scale;
        if (is_feasible(to_x(a * full)))
            feasible_point = a * full;
        else {
            const FeasibleSet* feasible = limits();
            if (!feasible)
                return false;
            const int n = free.rows;
            Mat columns(w, m, n + 1);
            for (int i = 0; i < m; i++)
                columns[i].part(0, n).set(basis[i]), columns(i, n) = full[i];
            Quadratic cost{Mat(w, n + 1, n + 1, 0), Vec(w, n + 1, 0)};
            for (int i = 0; i < n; i++)
                cost.T(i, i) = 1 / std::sqrt(ROUNDING / (length * length) + damping / (twist + TINY));
            cost.T(n, n) = std::sqrt(damped_scale), cost.centre[n] = a;
            const auto z = minimise(cost, feasible->in_coordinates(Vec(w, m, 0), columns).with_last_bounded(0, 1));
            if (!z)
                return approximate_exact_rows(*feasible, row_space, full);
            found.limits_active = z->y[n] < a * (1 - ROOT_ROUNDING);
            a = z->y[n], feasible_point = columns * z->y;
        }
        found.scale = a > 1 - SOLVED ? 1 : std::max(a, 0.0) * (1 - ROUNDING);
        origin = found.scale * full;
        return true;
    }

    // Whether the twist along the exact rows' demand decreases while the joints keep the velocity y.
    bool is_stretching(const ExactRows& rows, Vec y) const
    {
        return tick.J.rows == 6 && rows.D.w && (rows.f + rows.e).dot(rows.D * twist_change(tick.J, to_x(y))) < 0;
    }

    // The exact rows are infeasible at every scale: the nearest feasible y.
    bool approximate_exact_rows(const FeasibleSet& feasible, Mat row_space, Vec full)
    {
        const int k = row_space.rows;
        const Vec wanted = row_space * full;
        Mat K(w, k, m + 1);
        for (int i = 0; i < k; i++)
            K[i].part(0, m).set(row_space[i]), K(i, m) = -wanted[i];
        Mat H = t(K) * K, columns(w, m, m + 1, 0);
        for (int i = 0; i < m; i++)
            H(i, i) += ROUNDING, columns(i, i) = 1;
        const double size = std::max(full.square(), ROUNDING);
        H(m, m) += ROUNDING * size;
        const Mat U = cholesky(H);  // of several equally near ones, the one with the largest scale
        const Quadratic near{inverse(U), solved(U, solved(t(U), (ROUNDING * size) * unit(w, m + 1, m)))};
        const auto z = minimise(near, feasible.in_coordinates(Vec(w, m, 0), columns).with_last_bounded(0, 1));
        if (!z)
            return false;
        origin = t(row_space) * (row_space * z->y.part(0, m));
        found.scale = std::clamp(z->y[m], 0.0, 1.0), feasible_point = z->y.part(0, m);
        found.exact_infeasible = found.limits_active = true;
        return true;
    }

    // F_p on y, and its optima without limits. False if the form has no projector.
    bool set_objective()
    {
        if (tick.form != FormKind::none) {
            if (!set_form_cost())
                return false;
        } else if (is_well_damped() || mu == 0) {
            rq.emplace(B.rows <= m ? B : transposed(B));
            if (rq->regular(ROUNDING))
                factorise();
            else
                rq.reset();
        }
        if (!rq && !spectrum)
            decompose();
        gram = gram.w ? gram : B;
        add_posture();
        return true;
    }
    // Whether mu and nu are so large that squaring B costs no digits.
    bool is_well_damped() const { return mu + nu > ACTIVE_TOLERANCE * size; }

    // For a regular B.
    void factorise()
    {
        null_space = Mat(w, std::max(0, m - B.rows), m);
        for (int i = 0; i < null_space.rows; i++) {
            null_space[i].set(unit(w, m, i));
            rq->turn_back(null_space[i]);
        }
        if (!is_well_damped()) {
            const auto least = [&](Vec b) { return B.rows <= m ? rq->least(b) : rq->least_squares(b); };
            y_f = least(found.scale * f), y_e = least(found.scale * e);
            return;
        }
        Mat H = t(B) * B;
        for (int i = 0; i < m; i++)
            H(i, i) += mu + nu;
        add_null(H);
        triangular = cholesky(H);
        y_f = solved_dense(t(B) * (found.scale * f) + memory()), y_e = solved_dense(t(B) * (found.scale * e));
    }
    // H += w P, P = N'N of the null space N or, with fewer rows, P = I - S'S of the row space S.
    void add_null(Mat H) const
    {
        const int free = null_space.rows, rank = m - free;
        const bool few = free <= rank;
        for (int i = 0; i < (few ? free : rank); i++) {
            Vec row = few ? null_space[i] : unit(w, m, free + i);
            if (!few)
                rq->turn_back(row);
            for (int j = 0; j < m; j++)
                H[j].add((few ? null : -null) * row[j], row);
        }
        for (int i = 0; !few && i < m; i++)
            H(i, i) += null;
    }
    Vec solved_dense(Vec right) const { return solved(triangular, solved(t(triangular), right)); }

    // For a singular B, by its singular values.
    double sigma(int i) const { return i < spectrum->sigma.n ? spectrum->sigma[i] : 0; }
    double null_weight(int i) const { return iq::null_weight(*spectrum, i); }
    void decompose()
    {
        spectrum.emplace(B);
        weights = Vec(w, m);
        Vec u_f(w, m, 0), u_e(w, m, 0);
        const Vec b_f = spectrum->U * (found.scale * f), b_e = spectrum->U * (found.scale * e);
        const Vec before = spectrum->V * memory();
        for (int i = 0; i < m; i++) {
            const double square = sigma(i) * sigma(i) + mu + nu + null * null_weight(i), moved = (1 - null_weight(i)) * sigma(i);
            weights[i] = std::sqrt(square);
            if (i < b_f.n)
                u_f[i] = moved * b_f[i] / square, u_e[i] = moved * b_e[i] / square;
            u_f[i] += before[i] / square;
        }
        y_f = t(spectrum->V) * u_f, y_e = t(spectrum->V) * u_e;
    }

    // With a form: H = unit G + (mu + nu) I + w P, and the optima for x_h. False if it has no projector.
    bool set_form_cost()
    {
        spectrum.emplace(B);
        const std::optional<Formed> form = formed(tick, T.w ? tick.J * T : tick.J, B, *spectrum, f, e, w);
        if (!form)
            return false;
        found.form_share = form->form_share;
        Mat null_root = spectrum->V.copy();  // of w P
        for (int i = 0; i < m; i++)
            null_root[i].scale(std::sqrt(null * null_weight(i)));
        const Mat root = stacked(form->root, null_root);
        const double unit = size / std::max(form->root.all().square(), TINY);  // G of a form and B'B have different units
        gram = root.rows_from(0, form->root.rows);
        gram.all().scale(std::sqrt(unit));
        null_damping = mu + nu + (tick.form == FormKind::pitch ? unit * tick.damping : 0) + UNIT_ROUNDING * size;
        triangular = upper_root(stacked(root, Mat::identity(w, m, std::sqrt(mu + nu + UNIT_ROUNDING * size))));  // or rounding
        // as corrections of x_h: solving with G would lose digits
        const auto optimum = [&](Vec x, Vec memory) { return x + solved_dense(memory - (mu + nu) * x - t(null_root) * (null_root * x)); };
        y_f = optimum(found.scale * form->x_f, memory()), y_e = optimum(found.scale * form->x_e, Vec(w, m, 0));
        return true;
    }
    // nu x_before
    Vec memory() const { return nu > 0 ? nu * to_y(tick.last_velocity) : Vec(w, m, 0); }

    // Adds w H^-1 P x_p, limited by the speed of the task.
    void add_posture()
    {
        if (!tick.posture.w)
            return;
        double weight = found.scale * null;
        double most = 0;
        for (int i = 0; tick.velocity_limit.w && i < m; i++)
            most = std::max(most, std::abs(tick.posture[i] / tick.velocity_limit[i]));
        if (most > 0) {
            const Vec x = to_x(y_f + progress_ratio(y_e) * y_e);
            double task = 0;
            for (int i = 0; i < m; i++)
                task = std::max(task, std::abs(x[i] / tick.velocity_limit[i]));
            const double speed_ratio = std::min(1.0, task / most);
            weight *= speed_ratio * speed_ratio;
        }
        if (weight == 0)
            return;
        Vec pull = to_y(tick.posture);
        if (!spectrum) {
            pull = (1 / (mu + nu + null)) * (t(null_space) * (null_space * pull));
        } else {
            Vec u = spectrum->V * pull;
            for (int i = 0; i < m; i++)
                u[i] *= null_weight(i) / (triangular.w ? null_damping + null * null_weight(i) : weights[i] * weights[i]);
            pull = t(spectrum->V) * u;
        }
        y_f.add(weight, pull);
    }

    double progress_ratio(Vec d) const
    {
        if (!tick.last_velocity.w || !has_error)
            return 1;
        return std::max(0.0, 1 - MIN_PROGRESS * e.square() / std::max(e.dot(B * d), TINY));
    }

    // T with T'H T = I, and K with K'K = H.
    Mat inverse_root()
    {
        if (triangular.w)
            return inverse(triangular);
        if (rq && B.rows > m)
            return transposed(inverse(rq->R));
        if (rq) {
            Mat rows(w, m, m);
            const int free = null_space.rows;
            for (int j = 0; j < m; j++)
                rows[j].set(j < free ? null_space[j] / null_weight_root() : rq->least(unit(w, B.rows, j - free)));
            return transposed(rows);
        }
        Mat T = transposed(spectrum->V);
        for (int i = 0; i < m; i++)
            for (int j = 0; j < m; j++)
                T(i, j) /= weights[j];
        return T;
    }
    Mat root()
    {
        if (triangular.w)
            return triangular;
        if (rq && B.rows > m)
            return transposed(rq->R);
        Mat K = rq ? stacked(null_space, B) : spectrum->V.copy();
        for (int i = 0; i < (rq ? null_space.rows : m); i++)
            K[i].scale(rq ? null_weight_root() : weights[i]);
        return K;
    }
    double null_weight_root() const { return std::sqrt(null); }

    // The last two problems of the law: p, and x.
    bool scale_approach()
    {
        if (exact)
            factors.emplace(transposed(root() * basis));  // K basis = Q [0; R']
        const Vec start = exact ? origin : Vec(w, m, 0);
        Vec y_0 = optimum(start, y_f), y_1 = optimum(start, y_f + y_e);
        const bool in_0 = within(tick.position_lower, to_x(y_0), tick.position_upper);
        const bool in_1 = within(tick.position_lower, to_x(y_1), tick.position_upper);
        if (in_0 && in_1) {
            found.velocity = to_x(y_0 + progress_ratio(y_1 - y_0) * (y_1 - y_0));
            if (is_feasible(found.velocity))
                return true;
        }
        const FeasibleSet* feasible = limits();
        if (!feasible)
            return false;
        const Mat T_z = exact ? transposed(inverse(factors->R)) : inverse_root();
        y_0 = in_0 ? y_0 : inside_position_limits(start, y_0, T_z), y_1 = in_1 ? y_1 : inside_position_limits(start, y_1, T_z);
        const Vec d = progress_ratio(y_1 - y_0) * (y_1 - y_0);
        const int n = T_z.rows;
        std::optional<Optimum> u;
        if (find_scale(*feasible, y_0, y_1, d, n, u)) {
            const auto z = minimise({T_z, Vec(w, n, 0)}, feasible->in_coordinates(y_0 + found.approach_scale * d, basis));
            u = z ? z : u;
        }
        if (!u) {  // the exact rows leave almost nothing feasible
            found.velocity = to_x(feasible_point), found.approach_scale = 0, found.limits_active = true;
            return true;
        }
        found.limits_active = found.limits_active || u->multipliers.w;
        const Vec z = u->y.part(0, n), y = y_0 + found.approach_scale * d + (exact ? basis * z : z);
        found.velocity = to_x(exact ? feasible->last_feasible(feasible_point, y) : y);
        for (int j = 0; j < m; j++)  // rounding
            found.velocity[j] = std::clamp(found.velocity[j], tick.lower[j], tick.upper[j]);
        if (u->multipliers.w)
            found.multipliers = u->multipliers.part(0, m + tick.C.rows);
        return true;
    }
    // p and the u of its problem; where y_0 = y_1, d becomes zero and p is 1. False if no solution is found.
    bool find_scale(const FeasibleSet& feasible, Vec y_0, Vec y_1, Vec d, int n, std::optional<Optimum>& u)
    {
        const Mat K = upper_root(stacked(gram, Mat::identity(w, m, std::sqrt(mu + null))));
        const double length = (K * d).norm();
        if (length <= ROUNDING * (K * y_1).norm()) {
            d.fill(0);
            return true;
        }
        Mat columns(w, m, n + 1, 0), wider(w, n + 1, n + 1, 0);
        for (int i = 0; i < m; i++) {
            if (exact)
                columns[i].part(0, n).set(basis[i]);
            else
                columns(i, i) = 1;
            columns(i, n) = d[i] / length;
        }
        const Mat T = inverse(exact ? upper_root(K * basis) : K);
        for (int i = 0; i < n; i++)
            wider[i].part(0, n).set(T[i]);
        wider(n, n) = 1 / std::sqrt(SCALE_WEIGHT);
        Vec centre(w, n + 1, 0);
        centre[n] = length + f.norm() / SCALE_WEIGHT;
        u = minimise({wider, centre}, feasible.in_coordinates(y_0, columns).with_last_bounded(0, length));
        if (u)
            found.approach_scale = std::clamp(u->y[n] / length, 0.0, 1.0);
        return u.has_value();
    }
    // argmin |K (y - free)|^2 over y = origin + basis z
    Vec optimum(Vec origin, Vec free)
    {
        return exact ? origin + basis * factors->least_squares(root() * (free - origin)) : free;
    }
    // The same inside the position limits, if the exact rows allow it.
    Vec inside_position_limits(Vec origin, Vec y, Mat T_z)
    {
        const FeasibleSet positions{T.w ? T : Mat::identity(w, m), tick.position_lower, tick.position_upper, {}, {}};
        const auto z = polytope_optimum({T_z, exact ? t(basis) * (y - origin) : y}, exact ? positions.in_coordinates(origin, basis) : positions);
        return !z ? y : exact ? origin + basis * z->y : z->y;
    }

    // The part of the error that the joints can move.
    double remaining_error()
    {
        Vec b = A * found.velocity - (f + found.approach_scale * e);
        if (spectrum)
            return (spectrum->U.rows_from(0, spectrum->rank(ROUNDING)) * b).norm();
        if (B.rows <= m)
            return b.norm();
        rq->turn(b);
        return b.part(rq->free, b.n).norm();
    }
};

}  // namespace

Answer velocity(const Tick& tick, Workspace& w)
{
    const Answer answer = Law(tick, w).answer();
    const double numbers = answer.velocity.square() + answer.residual + answer.approach_scale + answer.scale;
    return std::isfinite(numbers) ? answer : failed(Failure::no_numbers, tick.J.cols, w);
}

Answer prioritised(const std::vector<Tick>& levels, Workspace& w)
{
    Answer first = velocity(levels[0], w), answer = first;
    Mat E = levels[0].E.rows ? stacked(levels[0].E, levels[0].J) : levels[0].J;
    for (std::size_t i = 1; i < levels.size() && answer.failure == Failure::none; i++) {
        Tick tick = levels[i];
        tick.feedforward = first.scale * tick.feedforward, tick.error = first.scale * tick.error;
        tick.E = E, tick.E_f = E * answer.velocity, tick.E_e = Vec(w, E.rows, 0), tick.D = Mat();
        answer = velocity(tick, w);
        first.limits_active = first.limits_active || answer.limits_active;
        E = stacked(E, levels[i].J);
    }
    first.velocity = answer.velocity, first.failure = answer.failure;
    return first;
}

}  // namespace iq
