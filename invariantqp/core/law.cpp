// The functions here have the names of definition.py's, and say only what is done another way than there.
#include "exact.hpp"
#include "forms.hpp"
#include "measure.hpp"

namespace iq {
namespace {

// Numbers of the law; definition.py says what chose them.
constexpr double KAPPA = 0.5, NU = 3e-5, NULL_WEIGHT = 5e-6, WORTH = 1e-3, EPSILON = 1e-4;

Answer failed(Failure failure, int m, Workspace& w)
{
    Answer none;
    none.velocity = Vec(w, m, 0);
    none.failure = failure;
    none.share = 0;
    return none;
}

class Law {
  public:
    Law(const Tick& tick, Workspace& w)
        : tick(tick), w(w), m(tick.J.cols), A(tick.root * tick.J), f(tick.root * tick.ahead), e(tick.root * tick.error),
          toward(e.square() > 0)
    {
        if (tick.metric.w) {
            from_x = cholesky(tick.metric);
            T = inverse(from_x);
        }
        B = T.w ? A * T : A;
        size = B.all().square();
        size = size > 0 ? size : 1;
        null = NULL_WEIGHT * size;
        if (tick.before.w)
            mu = KAPPA * tick.held * std::sqrt(size) * tick.missed, nu = NU * size;
        else
            mu = tick.form == FormKind::none ? tick.damping * tick.damping : 0;
    }

    Answer answer()
    {
        if (!demanded())
            return failed(Failure::infeasible, m, w);
        if (!objective())
            return failed(Failure::no_pseudoinverse, m, w);
        if (!paced())
            return failed(Failure::infeasible, m, w);
        found.missed = left();
        return found;
    }

  private:
    const Tick& tick;
    Workspace& w;
    const int m;
    const Mat A;     // R J
    const Vec f, e;  // R ahead, R error
    const bool toward;
    Mat T, from_x;   // x = T y, absent for the identity
    Mat B;           // A T
    double size = 1, mu = 0, nu = 0, null = 0;  // |B|^2; null: w
    Answer found;

    // Exact rows: y = origin + basis z.
    bool exact = false;
    Vec origin;
    Mat basis;

    std::optional<Room> all;
    Vec witness;  // a velocity y inside all limits, with the exact rows at their share

    Mat gram;              // a root of G: of what the twist or a form weighs
    // H = K'K and the optima y_f + p y_e without limits.
    std::optional<RQ> rq;  // of a regular B, or of its transpose; absent where some motion is none
    Mat kernel;            // beside rq: orthonormal rows, the joint velocities that move nothing
    std::optional<SVD> spectrum;
    Mat head;              // K, upper triangular; absent where it is diag(weights) V of the spectrum
    Vec weights;
    double resting = 0;  // H, but for w P, of a form on what moves nothing
    std::optional<RQ> factors;  // of K on the coordinates that exact rows leave free
    Vec y_f, y_e;

    Vec to_x(Vec y) const { return T.w ? T * y : y; }
    Vec to_y(Vec x) const { return T.w ? from_x * x : x; }

    bool allows(Vec x) const
    {
        return within(tick.lower, x, tick.upper) && (!tick.C.rows || within(tick.row_lower, tick.C * x, tick.row_upper))
               && (!tick.P.w || (tick.P * x).norm() <= tick.speed);
    }

    // All limits on y, once what contradicts the box is relaxed by the least; absent if no answer is found.
    const Room* room()
    {
        if (all)
            return &*all;
        Vec low = tick.row_lower, high = tick.row_upper;
        double speed = tick.speed;
        const int k = tick.C.rows;
        const Mat box = T.w ? T : Mat::identity(w, m), rows = k ? (T.w ? tick.C * T : tick.C) : Mat(w, 0, m);
        const Mat P = tick.P.w && T.w ? tick.P * T : tick.P;
        if (!k)
            low = high = Vec(w, 0);
        Vec inside(w, m, 0);
        if (!allows(inside)) {
            const Quadratic shortest{Mat::identity(w, m), inside};
            Room polytope{stacked(box, rows), joined(tick.lower, low), joined(tick.upper, high), {}, {}};
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
                    found.faster = least - speed, speed = least * (1 + ROOT_ROUNDING);
            }
        }
        witness = witness.w ? witness : inside;
        all = Room{stacked(box, rows), joined(tick.lower, low), joined(tick.upper, high), {}, {}, speed};
        if (P.w)
            all->P = P, all->start = Vec(w, 3, 0);
        return &*all;
    }

    // Bounds of rows, moved by the least sum of squares, in units of their lengths; then the least |y|.
    bool relax(Mat both, Vec& low, Vec& high, Vec& inside)
    {
        const int k = both.rows - m;
        Room room{Mat(w, m + k, m + k, 0), joined(tick.lower, low), joined(tick.upper, high), {}, {}};
        Mat root = Mat::identity(w, m + k);
        Vec lengths(w, k);
        for (int i = 0; i < m + k; i++) {
            room.C[i].part(0, m).set(both[i]);
            if (i < m) {
                root(i, i) = 1 / ROOT_ROUNDING;
                continue;
            }
            const double length = lengths[i - m] = both[i].norm() + TINY;
            room.C[i].scale(1 / length), room.lower[i] /= length, room.upper[i] /= length;
            room.C(i, i) = 1;
        }
        const auto slack = polytope_optimum({root, Vec(w, m + k, 0)}, room);
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

    // The velocities that meet the exact rows, and their share a. False if none is found.
    bool demanded()
    {
        exact = tick.E.rows > 0;
        if (!exact)
            return true;
        const ExactRows rows = whitened(tick, w);
        const Mat E = T.w ? rows.E * T : rows.E;
        const Vec demand = rows.f + rows.e;
        Mat across, along;  // orthonormal rows: that the exact rows leave free, that they decide
        Vec full;
        std::optional<RQ> rq;
        int rank = E.rows;
        found.unmet = rows.contrary;
        if (E.rows <= m)
            rq.emplace(E);
        if (rq && rq->regular(ROUNDING)) {
            const Mat Q = rq->basis();
            across = Q.rows_from(0, m - E.rows), along = Q.rows_from(m - E.rows, m);
            full = t(along) * solved(rq->R, demand);
        } else {
            const SVD svd(E);
            rank = svd.rank(ROUNDING);
            const Mat U = svd.U.rows_from(0, rank);
            if (const double all = demand.norm(); all > 0 && rank >= tick.exact_rank)
                found.unmet = std::max(found.unmet, (demand - t(U) * (U * demand)).norm() / all);
            rank = std::max(rank, std::min(tick.exact_rank, svd.sigma.n));
            along = svd.V.rows_from(0, rank), across = svd.V.rows_from(rank, m);
            full = svd.least(demand, rank, ROUNDING);  // a direction next to lost: a leaves next to nothing of it
        }
        basis = transposed(across);
        const double length = std::max(full.norm(), ROOT_ROUNDING), most = demand.norm();
        const double whole = (f + e).norm(), damped = KAPPA * tick.held * A.all().norm() * tick.missed / (whole + TINY);
        const double eased = 1 / (1 + damped * full.square() / (most + TINY));
        const bool all = along.rows >= std::min(m, 6);  // no part of the tool's motion is left free
        double a = tick.before.w && all && bends_away(rows, full) ? std::max(0.0, (eased - WORTH) / (1 - WORTH)) : eased;
        if (allows(to_x(a * full)))
            witness = a * full;
        else {
            const Room* room = this->room();
            if (!room)
                return false;
            const int n = across.rows;
            Mat columns(w, m, n + 1);
            for (int i = 0; i < m; i++)
                columns[i].part(0, n).set(basis[i]), columns(i, n) = full[i];
            Quadratic share{Mat(w, n + 1, n + 1, 0), Vec(w, n + 1, 0)};
            for (int i = 0; i < n; i++)
                share.T(i, i) = 1 / std::sqrt(ROUNDING / (length * length) + damped / (whole + TINY));
            share.T(n, n) = std::sqrt(eased), share.centre[n] = a;
            const auto z = minimise(share, room->on(Vec(w, m, 0), columns).with_row(0, 1));
            if (!z)
                return beside(*room, along, full);
            found.limited = z->y[n] < a * (1 - ROOT_ROUNDING);
            a = z->y[n], witness = columns * z->y;
        }
        found.share = a > 1 - 10 * ROUNDING ? 1 : std::max(a, 0.0) * (1 - ROUNDING);
        origin = found.share * full;
        return true;
    }

    // Whether joints that go on at y lose their hold on what the exact rows ask for, as an arm that stretches.
    bool bends_away(const ExactRows& rows, Vec y) const
    {
        return tick.J.rows == 6 && rows.D.w && (rows.f + rows.e).dot(rows.D * turning(tick.J, to_x(y))) < 0;
    }

    // No share of the exact rows is inside the limits: as near to one as these allow.
    bool beside(const Room& room, Mat along, Vec full)
    {
        const int k = along.rows;
        const Vec wanted = along * full;
        Mat K(w, k, m + 1);
        for (int i = 0; i < k; i++)
            K[i].part(0, m).set(along[i]), K(i, m) = -wanted[i];
        Mat H = t(K) * K, columns(w, m, m + 1, 0);
        for (int i = 0; i < m; i++)
            H(i, i) += ROUNDING, columns(i, i) = 1;
        const double size = std::max(full.square(), ROUNDING);
        H(m, m) += ROUNDING * size;
        const Mat U = cholesky(H);  // of several as near, the one with the largest share
        const Quadratic near{inverse(U), solved(U, solved(t(U), (ROUNDING * size) * unit(w, m + 1, m)))};
        const auto z = minimise(near, room.on(Vec(w, m, 0), columns).with_row(0, 1));
        if (!z)
            return false;
        origin = t(along) * (along * z->y.part(0, m));
        found.share = std::clamp(z->y[m], 0.0, 1.0), witness = z->y.part(0, m);
        found.beside = found.limited = true;
        return true;
    }

    // F_p on y, and its optima without limits. False if the form has no projector.
    bool objective()
    {
        if (tick.form != FormKind::none) {
            if (!of_form())
                return false;
        } else if (damped() || mu == 0) {
            rq.emplace(B.rows <= m ? B : transposed(B));
            if (rq->regular(ROUNDING))
                factored();
            else
                rq.reset();
        }
        if (!rq && !spectrum)
            decomposed();
        gram = gram.w ? gram : B;
        posture();
        return true;
    }
    // Whether mu and nu are so large that squaring B costs no digits.
    bool damped() const { return mu + nu > 1e-6 * size; }

    // Where no singular value of B is next to none.
    void factored()
    {
        kernel = Mat(w, std::max(0, m - B.rows), m);
        for (int i = 0; i < kernel.rows; i++) {
            kernel[i].set(unit(w, m, i));
            rq->turn_back(kernel[i]);
        }
        if (!damped()) {
            const auto least = [&](Vec b) { return B.rows <= m ? rq->least(b) : rq->least_squares(b); };
            y_f = least(found.share * f), y_e = least(found.share * e);
            return;
        }
        Mat H = t(B) * B;
        for (int i = 0; i < m; i++)
            H(i, i) += mu + nu;
        add_null(H);
        head = cholesky(H);
        y_f = solved_dense(t(B) * (found.share * f) + memory()), y_e = solved_dense(t(B) * (found.share * e));
    }
    // H += w P, P = N'N of the kernel N or, with fewer rows, P = I - S'S of the orthonormal rows S that move something.
    void add_null(Mat H) const
    {
        const int free = kernel.rows, rank = m - free;
        const bool few = free <= rank;
        for (int i = 0; i < (few ? free : rank); i++) {
            Vec row = few ? kernel[i] : unit(w, m, free + i);
            if (!few)
                rq->turn_back(row);
            for (int j = 0; j < m; j++)
                H[j].add((few ? null : -null) * row[j], row);
        }
        for (int i = 0; !few && i < m; i++)
            H(i, i) += null;
    }
    Vec solved_dense(Vec right) const { return solved(head, solved(t(head), right)); }

    // By the singular values of B, where some of them move nothing.
    double sigma(int i) const { return i < spectrum->sigma.n ? spectrum->sigma[i] : 0; }
    double still(int i) const { return iq::still(*spectrum, i); }
    void decomposed()
    {
        spectrum.emplace(B);
        weights = Vec(w, m);
        Vec u_f(w, m, 0), u_e(w, m, 0);
        const Vec b_f = spectrum->U * (found.share * f), b_e = spectrum->U * (found.share * e);
        const Vec before = spectrum->V * memory();
        for (int i = 0; i < m; i++) {
            const double square = sigma(i) * sigma(i) + mu + nu + null * still(i), moved = (1 - still(i)) * sigma(i);
            weights[i] = std::sqrt(square);
            if (i < b_f.n)
                u_f[i] = moved * b_f[i] / square, u_e[i] = moved * b_e[i] / square;
            u_f[i] += before[i] / square;
        }
        y_f = t(spectrum->V) * u_f, y_e = t(spectrum->V) * u_e;
    }

    // Of a form: H = unit G + (mu + nu) I + w P, and the optima for x_h.
    bool of_form()
    {
        spectrum.emplace(B);
        const std::optional<Formed> form = formed(tick, T.w ? tick.J * T : tick.J, B, *spectrum, f, e, w);
        if (!form)
            return false;
        found.guarded = form->guarded;
        Mat rests = spectrum->V.copy();  // the root of w P
        for (int i = 0; i < m; i++)
            rests[i].scale(std::sqrt(null * still(i)));
        const Mat root = stacked(form->root, rests);
        const double unit = size / std::max(form->root.all().square(), TINY);  // a form has another one than B'B
        gram = root.rows_from(0, form->root.rows);
        gram.all().scale(std::sqrt(unit));
        resting = mu + nu + (tick.form == FormKind::pitch ? unit * tick.damping : 0) + 1e-15 * size;
        head = upper_root(stacked(root, Mat::identity(w, m, std::sqrt(mu + nu + 1e-15 * size))));  // or rounding
        // by what they differ from x_h, which G is not solved for
        const auto optimum = [&](Vec x, Vec memory) { return x + solved_dense(memory - (mu + nu) * x - t(rests) * (rests * x)); };
        y_f = optimum(found.share * form->x_f, memory()), y_e = optimum(found.share * form->x_e, Vec(w, m, 0));
        return true;
    }
    // nu x_before
    Vec memory() const { return nu > 0 ? nu * to_y(tick.before) : Vec(w, m, 0); }

    // Adds w H^-1 P x_p at the share that the task lets it have.
    void posture()
    {
        if (!tick.posture.w)
            return;
        double follow = found.share * null;
        double most = 0;
        for (int i = 0; tick.fastest.w && i < m; i++)
            most = std::max(most, std::abs(tick.posture[i] / tick.fastest[i]));
        if (most > 0) {
            const Vec x = to_x(y_f + worth(y_e) * y_e);
            double task = 0;
            for (int i = 0; i < m; i++)
                task = std::max(task, std::abs(x[i] / tick.fastest[i]));
            const double share = std::min(1.0, task / most);
            follow *= share * share;
        }
        if (follow == 0)
            return;
        Vec pull = to_y(tick.posture);
        if (!spectrum) {
            pull = (1 / (mu + nu + null)) * (t(kernel) * (kernel * pull));
        } else {
            Vec u = spectrum->V * pull;
            for (int i = 0; i < m; i++)
                u[i] *= still(i) / (head.w ? resting + null * still(i) : weights[i] * weights[i]);
            pull = t(spectrum->V) * u;
        }
        y_f.add(follow, pull);
    }

    double worth(Vec d) const
    {
        if (!tick.before.w || !toward)
            return 1;
        return std::max(0.0, 1 - WORTH * e.square() / std::max(e.dot(B * d), TINY));
    }

    // T with T'H T = I, and K with K'K = H.
    Mat inverse_root()
    {
        if (head.w)
            return inverse(head);
        if (rq && B.rows > m)
            return transposed(inverse(rq->R));
        if (rq) {
            Mat rows(w, m, m);
            const int free = kernel.rows;
            for (int j = 0; j < m; j++)
                rows[j].set(j < free ? kernel[j] / null_root() : rq->least(unit(w, B.rows, j - free)));
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
        if (head.w)
            return head;
        if (rq && B.rows > m)
            return transposed(rq->R);
        Mat K = rq ? stacked(kernel, B) : spectrum->V.copy();
        for (int i = 0; i < (rq ? kernel.rows : m); i++)
            K[i].scale(rq ? null_root() : weights[i]);
        return K;
    }
    double null_root() const { return std::sqrt(null); }

    // y and p: the last lines of the law.
    bool paced()
    {
        if (exact)
            factors.emplace(transposed(root() * basis));  // K basis = Q [0; R']
        const Vec start = exact ? origin : Vec(w, m, 0);
        Vec y_0 = optimum(start, y_f), y_1 = optimum(start, y_f + y_e);
        const bool in_0 = within(tick.position_lower, to_x(y_0), tick.position_upper);
        const bool in_1 = within(tick.position_lower, to_x(y_1), tick.position_upper);
        if (in_0 && in_1) {
            found.velocity = to_x(y_0 + worth(y_1 - y_0) * (y_1 - y_0));
            if (allows(found.velocity))
                return true;
        }
        const Room* room = this->room();
        if (!room)
            return false;
        const Mat T_z = exact ? transposed(inverse(factors->R)) : inverse_root();
        y_0 = in_0 ? y_0 : placed(start, y_0, T_z), y_1 = in_1 ? y_1 : placed(start, y_1, T_z);
        const Vec d = worth(y_1 - y_0) * (y_1 - y_0);
        const int n = T_z.rows;
        std::optional<Optimum> u;
        if (pace(*room, y_0, y_1, d, n, u)) {
            const auto z = minimise({T_z, Vec(w, n, 0)}, room->on(y_0 + found.pace * d, basis));
            u = z ? z : u;
        }
        if (!u) {  // next to no room beside the exact rows
            found.velocity = to_x(witness), found.pace = 0, found.limited = true;
            return true;
        }
        found.limited = found.limited || u->multipliers.w;
        const Vec z = u->y.part(0, n), y = y_0 + found.pace * d + (exact ? basis * z : z);
        found.velocity = to_x(exact ? room->last_inside(witness, y) : y);
        for (int j = 0; j < m; j++)  // rounding
            found.velocity[j] = std::clamp(found.velocity[j], tick.lower[j], tick.upper[j]);
        if (u->multipliers.w)
            found.multipliers = u->multipliers.part(0, m + tick.C.rows);
        return true;
    }
    // p, with the velocity that decides it; without, d is zero and p is 1. False if none is found.
    bool pace(const Room& room, Vec y_0, Vec y_1, Vec d, int n, std::optional<Optimum>& u)
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
        wider(n, n) = 1 / std::sqrt(EPSILON);
        Vec centre(w, n + 1, 0);
        centre[n] = length + f.norm() / EPSILON;
        u = minimise({wider, centre}, room.on(y_0, columns).with_row(0, length));
        if (u)
            found.pace = std::clamp(u->y[n] / length, 0.0, 1.0);
        return u.has_value();
    }
    // argmin |K (y - free)|^2 over y = origin + basis z
    Vec optimum(Vec origin, Vec free)
    {
        return exact ? origin + basis * factors->least_squares(root() * (free - origin)) : free;
    }
    // The same inside the position limits, where they leave something.
    Vec placed(Vec origin, Vec y, Mat T_z)
    {
        const Room room{T.w ? T : Mat::identity(w, m), tick.position_lower, tick.position_upper, {}, {}};
        const auto z = polytope_optimum({T_z, exact ? t(basis) * (y - origin) : y}, exact ? room.on(origin, basis) : room);
        return !z ? y : exact ? origin + basis * z->y : z->y;
    }

    // What the answer leaves of the twist that the joints can do.
    double left()
    {
        Vec b = A * found.velocity - (f + found.pace * e);
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
    const double numbers = answer.velocity.square() + answer.missed + answer.pace + answer.share;
    return std::isfinite(numbers) ? answer : failed(Failure::no_numbers, tick.J.cols, w);
}

Answer prioritised(const std::vector<Tick>& levels, Workspace& w)
{
    Answer first = velocity(levels[0], w), answer = first;
    Mat E = levels[0].E.rows ? stacked(levels[0].E, levels[0].J) : levels[0].J;
    for (std::size_t i = 1; i < levels.size() && answer.failure == Failure::none; i++) {
        Tick tick = levels[i];
        tick.ahead = first.share * tick.ahead, tick.error = first.share * tick.error;
        tick.E = E, tick.E_f = E * answer.velocity, tick.E_e = Vec(w, E.rows, 0), tick.D = Mat();
        answer = velocity(tick, w);
        first.limited = first.limited || answer.limited;
        E = stacked(E, levels[i].J);
    }
    first.velocity = answer.velocity, first.failure = answer.failure;
    return first;
}

}  // namespace iq
