/* Twin of rows_of in control/clearance_rows.py: the rows that keep bodies apart.

       C (x - y) >= -alpha (d - d_min) - n'(v_b - v_a),     C = w'J on the joints between two bodies,  w = (p x n; n)

   `clearance` is a pure function of arrays and a scene. `apart_now` and `apart_after` are twins of rows_at and rows_after in
   control/clearance.py, for a tick of a loop. */

#include "boundary.h"
#include "distance.h"
#include <stdlib.h>

enum { BODY, KIND, RADIUS, HALF, TURN = HALF + 3, PLACE = TURN + 9, OF_SHAPE = PLACE + 3 }; /* numbers of a shape */
/* control/clearance_rows.py and clearance.py: their constants. */
#define SWEEPS 20
#define PASSED 2.0
static const double EQUAL_ROWS = 1e-9, UNMOVED = 1e-12, USUAL_SPEED = 1.0, NEARER = 0.7, DEEP = 0.05, CURVED = 0.005;
#define MOST_SHAPES 256

static void shape_at(const double *numbers, const Pose *T, Shape *s)
{
    const double *R = numbers + TURN;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            s->R[i][j] = T->R[i][0] * R[j] + T->R[i][1] * R[3 + j] + T->R[i][2] * R[6 + j];
        s->p[i] = dot(3, T->R[i], numbers + PLACE) + T->p[i];
    }
}

typedef struct {
    Row inside; /* where valid, a velocity that keeps all rows and joint limits */
    bool valid; /* the arm is no deeper inside than curvature takes it */
    bool still; /* nothing moves itself */
    int count, pair[APART_ROWS];
    double C[APART_ROWS][MOST], lower[APART_ROWS], urgency[APART_ROWS];
} Rows;

/* Keep a row among the most urgent, each pair's nearest before all others; of equal ones the one that asks for more. */
static void keep(Rows *rows, int m, const double *C, double lower, double urgency, int pair)
{
    int at = rows->count, last = 0;
    double size = norm(m, C);
    for (int i = 0; i < rows->count; i++) {
        double apart = 0.0;
        for (int k = 0; k < m; k++)
            apart = fmax(apart, fabs(rows->C[i][k] - C[k]));
        if (apart <= EQUAL_ROWS * size) {
            rows->urgency[i] = urgency = fmax(rows->urgency[i], urgency);
            if (rows->lower[i] >= lower)
                return;
            at = i;
            break;
        }
        if (rows->urgency[i] < rows->urgency[last])
            last = i;
    }
    if (at == APART_ROWS) {
        if (rows->urgency[last] >= urgency)
            return;
        at = last;
    }
    rows->count = at == rows->count ? at + 1 : rows->count;
    memcpy(rows->C[at], C, (size_t)m * sizeof(double));
    rows->lower[at] = lower;
    rows->urgency[at] = urgency;
    rows->pair[at] = pair;
}

/* Twin of States.ahead: the states in which distances are looked at, and how they change with the velocity. */
#define MOST_STATES 34
typedef struct {
    int m, count;
    const double *speed, *settings, *brakes, *before;
    Wide braked, free[2], sure[2], led[2]; /* velocity braked for a tick; how far another can be below it and above; certainly;
                                              and where it is led apart */
    Wide q[MOST_STATES], going[2]; /* how fast others go on: in the first state; in the others */
    Wide weight[MOST_STATES], longer[MOST_STATES], grows; /* how q changes with the velocity, with the ticks; those with it */
    double time[MOST_STATES];
} States;

static void own_state(int m, int all, const double *q, const double *before, States *states)
{
    states->m = m;
    states->count = 1;
    states->time[0] = 0.0;
    for (int j = 0; j < all; j++) {
        states->q[0][j] = q[j];
        states->weight[0][j] = 1.0;
        states->longer[0][j] = states->grows[j] = states->braked[j] = 0.0;
        states->sure[0][j] = states->sure[1][j] = states->led[0][j] = states->led[1][j] = INFINITY;
        states->going[0][j] = states->going[1][j] = j < m ? 0.0 : before[j];
    }
}

/* How many ticks the arm of each joint takes to stop, those joints together that do not brake by themselves; `step` is what a
   unit of acceleration takes of a velocity in a tick. */
static void stopped_in(int all, const int *starts, const double *before, const double *a, double step, const bool *range, double *N)
{
    double takes[ALL_JOINTS + 1] = {0.0}; /* of the arm that begins at a joint */
    for (int j = 0; j < all; j++) {
        double alone = a[j] > 0.0 && !range[j] ? fabs(before[j]) / (step * a[j]) : 0.0, fourth = alone * alone * (alone * alone);
        takes[starts[j + 1]] += fourth * fourth;
    }
    for (int j = 0; j < all; j++)
        N[j] = fmax(1.0, sqrt(sqrt(sqrt(takes[starts[j + 1]]))));
}

static void braked_states(int all, const int *starts, const double *q, const double *before, Wide limits[4], const double *settings,
                          States *states)
{
    double dt = settings[3], share = settings[4], ticks[ALL_JOINTS], b[ALL_JOINTS], N[ALL_JOINTS], late[ALL_JOINTS], most = 0.0;
    bool range[ALL_JOINTS] = {false}; /* a joint brakes by itself, its way ends where its range does */
    for (int j = 0; j < all; j++) {
        double fast = fabs(before[j]), room = before[j] > 0.0 ? limits[3][j] - q[j] : q[j] - limits[2][j];
        late[j] = (fast - fmin(late_braking(room, fast, dt), braking_speed(room, limits[1][j], dt, settings[5]))) / dt;
    }
    stopped_in(all, starts, before, limits[1], share * dt, range, N);
    for (int j = 0; j < all; j++)
        range[j] = limits[1][j] > 0.0 && isfinite(limits[1][j]) && late[j] > fabs(before[j]) / (N[j] * dt);
    stopped_in(all, starts, before, limits[1], share * dt, range, N);
    for (int j = 0; j < all; j++) {
        double a = limits[1][j], fast = fabs(before[j]);
        bool on = a == 0.0;
        b[j] = on ? 0.0 : !isfinite(a) ? a : range[j] ? late[j] : fast / (N[j] * dt);
        double y = fmax(fast - b[j] * dt, 0.0), left = share * a * dt * (N[j] - 1.0), part = y / left, square = part * part;
        ticks[j] = y > 0.0 ? floor(y / (b[j] * dt) + EQUAL_ROWS) : 0.0;
        states->grows[j] = ticks[j] > 0.0 && !on && !range[j] ? (before[j] < 0.0 ? -1.0 : 1.0) * (square * square * square * part) / left : 0.0;
        if (!on) {
            most = fmax(most, ticks[j]);
            states->going[1][j] = 0.0;
        }
        states->braked[j] = before[j] < 0.0 ? -y : y;
        for (int up = 0; up < 2; up++) {
            bool forth = up ? before[j] > 0.0 : before[j] < 0.0;
            states->sure[up][j] = isfinite(a) ? fmax(a * dt - b[j] * dt, 0.0) : INFINITY;
            states->led[up][j] = states->sure[up][j] + (forth ? fast - y : 0.0);
        }
    }
    double n = most;
    for (int s = 1; s < MOST_STATES; s++, n = n > 1.0 ? floor(NEARER * n) : 0.0) {
        states->time[s] = n * dt;
        for (int j = 0; j < all; j++) {
            double own = fmin(n, ticks[j]), lost = own > 0.0 ? own * b[j] * dt / fabs(states->braked[j]) : 0.0;
            states->q[s][j] = q[j] + dt * (own + (limits[1][j] == 0.0 ? 0.0 : 1.0)) * (1.0 - 0.5 * lost) * states->braked[j];
            states->weight[s][j] = (own + 1.0) * (1.0 - (range[j] ? 1.0 : 0.5) * lost);
            states->longer[s][j] = (own + 1.0) * (range[j] ? 0.0 : 0.5) * lost * states->braked[j];
        }
        states->count = s + 1;
        if (n == 0.0)
            break;
    }
}

/* How far joint limits let a velocity of the own joints be below the one braked for a tick, and above. */
static void set_free(int m, const double *q, const double *before, Wide limits[4], double dt, double rate, States *states)
{
    for (int j = 0; j < m; j++)
        for (int up = 0; up < 2; up++) {
            double sign = up ? 1.0 : -1.0, room = up ? limits[3][j] - q[j] : q[j] - limits[2][j], most = limits[0][j];
            if (dt > 0.0)
                most = fmin(fmin(most, braking_speed(room, limits[1][j], dt, rate)), sign * before[j] + limits[1][j] * dt);
            states->free[up][j] = fmax(most - sign * states->braked[j], 0.0);
            states->sure[up][j] = fmin(states->free[up][j], states->sure[up][j]);
            states->led[up][j] = fmin(states->free[up][j], states->led[up][j]);
        }
}

/* Joint twists J and the motions of the world and of all bodies at joint positions q. */
static void moved_by(int all, const Wide screws[6], const int *starts, const double *q, Wide J[6], Pose *motions)
{
    static const Pose HERE = {{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}, {0.0, 0.0, 0.0}};
    motions[0] = HERE;
    for (int j = 0; j < all; j++) {
        const Pose *before = starts[j + 1] == j ? &HERE : &motions[j];
        double w[3] = {screws[0][j], screws[1][j], screws[2][j]}, v[3] = {screws[3][j], screws[4][j], screws[5][j]};
        double omega[3], moved[3], lever[3];
        Pose step;
        turned(before, w, omega);
        turned(before, v, moved);
        cross(before->p, omega, lever);
        for (int i = 0; i < 3; i++) {
            J[i][j] = omega[i];
            J[3 + i][j] = moved[i] + lever[i];
        }
        exponential(w, v, q[j], &step);
        product(before, &step, &motions[j + 1]);
    }
}

/* Two shapes, and which joints move each of them alone. */
typedef struct Pair {
    int of[2], index, from[2], to[2];
    double share, far, leaves; /* in the first state they are at least so far apart; how fast states ahead let them come nearer */
    bool still;        /* neither moves by itself */
    bool recedes;      /* one comes, and the arm goes before it: looked at now, not where the arm would have braked */
    const double *levers[2], *twists[2];
} Pair;

/* The rows of a pair in state s, of joint twists J, kept where they are urgent; the least distance, infinite where no joint
   changes it. `wanted` is the distance that it keeps there, `fastest` how fast it comes nearer, at most. In the arm's own
   state, beside those that it would brake through, rows lead out of what is too near alone. */
static double rows_of_pair(Pair *pair, const States *states, int s, const Wide J[6], double wanted, double fastest,
                           const Places *found, Rows *rows)
{
    bool begins = s == 0 && states->count > 1, leaving = begins, last = s == states->count - 1;
    int m = states->m;
    double over = 0.0, out[3] = {0.0, 0.0, 0.0}, least = INFINITY, rate = states->settings[1];
    const double *weight = states->weight[s], *going = states->going[s > 0], *speed = states->speed;
    for (int f = 0; f < found->count; f++) {
        const Near *near = &found->at[f];
        double w[6], C[MOST] = {0.0}, reach = 0.0, weighed = 0.0, square = 0.0, largest = 0.0, braked = 0.0, sure = 0.0, longer = 0.0;
        double room = near->d - wanted, drift, coming, away = 0.0, strong = 0.0, fast = 0.0, most = 0.0;
        if (least < INFINITY && room >= 0.0 && (leaving || rate * pair->share * room - over > fastest))
            break; /* no row of a place as far as this matters */
        cross(near->x, near->n, w);
        memcpy(w + 3, near->n, 3 * sizeof(double));
        drift = dot(6, w, pair->twists[1]) - dot(6, w, pair->twists[0]);
        coming = -drift;
        for (int e = 0; e < 2; e++)
            for (int j = pair->from[e]; j < pair->to[e]; j++) {
                double total = 0.0, parts = 0.0;
                for (int r = 0; r < 6; r++) {
                    double part = w[r] * J[r][j];
                    total += e == 0 ? -part : part;
                    parts += fabs(part);
                }
                if (!(fabs(total) > UNMOVED * parts))
                    continue;
                if (j >= m) {
                    drift += total * going[j];
                    continue;
                }
                C[j] = weight[j] * total;
                longer += total * states->longer[s][j];
                if (!(coming > 0.0))
                    continue;
                away += total * states->before[j];
                fast += fabs(total) * speed[j];
                strong += fabs(total) * states->brakes[j];
            }
        for (int j = 0; j < m; j++) {
            C[j] += longer * states->grows[j];
            double size = fabs(C[j]), scaled = size * (isfinite(speed[j]) ? speed[j] : USUAL_SPEED);
            if (size > 0.0) {
                reach += size * states->free[C[j] < 0.0][j];
                most += size * states->free[C[j] > 0.0][j];
                sure += size * (leaving ? states->led : states->sure)[C[j] > 0.0][j];
                braked += C[j] * states->braked[j];
            }
            weighed += scaled;
            square += scaled * scaled;
            largest = fmax(largest, scaled);
        }
        if (!(weighed > 0.0))
            continue;
        bool first = least == INFINITY;
        double later = f == 0 ? 0.0 : 1.0, may = rate * fmin(room, pair->share * room), lower;
        may = pair->share == 1.0 || room < 0.0 ? may + drift : fmin(may, rate * room + drift); /* of what another one leaves */
        double y = s == 0 ? 0.0 : braked; /* in the state of now rows are on the velocity itself */
        bool comes = coming > 0.0 && fast > coming;
        least = fmin(least, near->d);
        if (first && begins) {
            pair->recedes = comes && away >= 0.0;
            leaving = !pair->recedes;
        }
        if (f == 0 || (out[0] == 0.0 && out[1] == 0.0 && out[2] == 0.0))
            memcpy(out, near->n, sizeof out);
        if (leaving && room >= 0.0)
            continue;
        if (first && last)
            over = fmax(may - pair->leaves, 0.0);
        else if (first && s > 0)
            pair->leaves = fmin(pair->leaves, fmax(may, 0.0) / (states->time[s] / states->settings[3] + 1.0));
        if (room >= 0.0)
            lower = y - (may - over);
        else
            lower = y + fmax(0.0, dot(3, near->n, out)) * fmin(-rate * room, states->settings[2] * square / largest) - drift;
        if (comes && room > 0.0 && states->count > 1) { /* joints take time to make way, as hard as they can */
            double slower = braking_speed(pair->share * room, states->settings[4] * strong, states->settings[3], rate) + drift;
            lower = fmax(lower, fmin(y - slower, braked + most));
        }
        if (leaving || (room < 0.0 && drift == 0.0)) /* joints certainly can */
            lower = fmin(lower, braked + sure);
        if (!(lower > braked - reach))
            continue;
        rows->still = rows->still && drift == 0.0;
        rows->valid = rows->valid && (s > 0 || room >= -DEEP * states->settings[0]);
        keep(rows, m, C, lower, (lower - braked) / weighed - later, pair->index);
    }
    return least;
}

/* _possible in control/clearance_rows.py: rows that lead back what curvature took ask for no more than is found to be possible
   beside all others; where something moves itself, as long as no more is given up than that. */
static void ask_what_is_possible(const States *joints, Rows *rows)
{
    int m = joints->m;
    const double given_up = joints->settings[1] * CURVED * joints->settings[0];
    double z[MOST] = {0.0}, asked[APART_ROWS], got[APART_ROWS], size[APART_ROWS], share = 1.0;
    bool any = false;
    for (int i = 0; i < rows->count; i++) {
        asked[i] = rows->lower[i] - dot(m, rows->C[i], joints->braked);
        any = any || asked[i] > 0.0;
    }
    memcpy(rows->inside, joints->braked, (size_t)m * sizeof(double));
    if (!any || !rows->valid)
        return;
    for (int i = 0; i < rows->count; i++)
        size[i] = dot(m, rows->C[i], rows->C[i]);
    for (int sweep = 0, short_of = 1; sweep < SWEEPS && short_of; sweep++) {
        short_of = 0;
        for (int i = 0; i < rows->count; i++) {
            const double *C = rows->C[i];
            double left = asked[i] - dot(m, C, z);
            if (!(left > 0.0))
                continue;
            short_of = 1;
            for (int j = 0; j < m; j++)
                z[j] = between(z[j] + PASSED * left / size[i] * C[j], -joints->free[0][j], joints->free[1][j]);
        }
    }
    for (int i = 0; i < rows->count; i++) {
        got[i] = dot(m, rows->C[i], z);
        if (got[i] < fmin(asked[i], 0.0))
            share = fmin(share, fmin(asked[i], 0.0) / got[i]);
    }
    for (int i = 0; i < rows->count; i++)
        rows->valid = rows->valid && (rows->still || !(asked[i] > 0.0) || asked[i] - share * got[i] <= given_up);
    if (!rows->valid)
        return;
    for (int j = 0; j < m; j++)
        rows->inside[j] += share * z[j];
    for (int i = 0; i < rows->count; i++)
        if (asked[i] > 0.0)
            rows->lower[i] += fmin(asked[i], share * got[i]) - asked[i];
}

/* Arrays of numbers (n, k), C-contiguous. */
static bool is_table(PyObject *object, npy_intp columns)
{
    PyArrayObject *array = (PyArrayObject *)object;
    return PyArray_CheckExact(object) && PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISCARRAY_RO(array) &&
           PyArray_NDIM(array) == 2 && PyArray_DIM(array, 1) == columns;
}

/* How much nearer two shapes come at most by what joints turn: levers are how far any point of a shape ever is from their
   axes. */
static double nearer(const Pair *pair, const double *turned)
{
    double most = 0.0;
    for (int e = 0; e < 2; e++)
        for (int j = pair->from[e]; j < pair->to[e]; j++)
            most += pair->levers[e][j] * turned[j];
    return most;
}

/* How fast they do where they are now, joints being so fast. */
static double swept(const Pair *pair, const Shape *shapes, const Wide J[6], const double *fast)
{
    double most = 0.0;
    for (int e = 0; e < 2; e++) {
        const Shape *s = &shapes[pair->of[e]];
        for (int j = pair->from[e]; j < pair->to[e]; j++) {
            double omega[3] = {J[0][j], J[1][j], J[2][j]}, v[3];
            cross(omega, s->p, v);
            for (int i = 0; i < 3; i++)
                v[i] += J[3 + i][j];
            most += fast[j] * (norm(3, v) + norm(3, omega) * s->ball);
        }
    }
    return most;
}

/* Places of two shapes of which one is a mesh, by a function of Python's: of their numbers and (4, 4) poses. */
static bool told_places(PyObject *tell, const Pair *pair, const Shape *a, const Shape *b, Places *found)
{
    double poses[2][4][4] = {{{0.0}}};
    for (int e = 0; e < 2; e++) {
        const Shape *s = e == 0 ? a : b;
        for (int i = 0; i < 3; i++) {
            memcpy(poses[e][i], s->R[i], 3 * sizeof(double));
            poses[e][i][3] = s->p[i];
        }
        poses[e][3][3] = 1.0;
    }
    PyObject *told = PyObject_CallFunction(tell, "iiNN", pair->of[0], pair->of[1], new_matrix(4, 4, 4, poses[0][0]),
                                           new_matrix(4, 4, 4, poses[1][0]));
    if (told == NULL)
        return false;
    bool right = is_table(told, 7);
    if (right) {
        const double *numbers = PyArray_DATA((PyArrayObject *)told);
        npy_intp count = PyArray_DIM((PyArrayObject *)told, 0);
        found->count = count < MOST_PLACES ? (int)count : MOST_PLACES;
        for (int i = 0; i < found->count; i++, numbers += 7) {
            found->at[i].d = numbers[0];
            memcpy(found->at[i].n, numbers + 1, sizeof found->at[i].n);
            memcpy(found->at[i].x, numbers + 4, sizeof found->at[i].x);
        }
    } else
        PyErr_SetString(PyExc_TypeError, "places of a mesh: (k, 7) distance, normal and point");
    Py_DECREF(told);
    return right;
}

/* What of a clearance does not change from tick to tick, and the arrays in which Python says where obstacles are, how they
   move, what share of each room may be taken, which distance each pair keeps, and which pairs are not judged yet. */
enum { SHAPES, TWISTS, PAIRS, LEVERS, UNJUDGED, HELD };
enum { SHARE = 2, KEEPS, OF_PAIR }; /* numbers of a pair, after its two shapes */
struct Scene {
    int all, m, shapes, pairs;
    bool meshes, others;
    Wide screws[6];
    int starts[ALL_JOINTS + 1];
    PyObject *held[HELD];
    const double *table[HELD];
    Shape of[MOST_SHAPES];
    Pair pair[];
};

static double share_of_pair(const Scene *scene, int k) { return scene->table[PAIRS][OF_PAIR * k + SHARE]; }
static double kept_by_pair(const Scene *scene, int k) { return scene->table[PAIRS][OF_PAIR * k + KEEPS]; }

/* rows_of in control/clearance_rows.py. A pair that is so far that no row of it matters in some state is not looked at there:
   its distance has changed by at most what joints have turned times their levers. Distances of pairs that are neither the
   nearest nor near are infinite, unless the rate is 0. `shares` are NULL for those of the scene. False with an error of a
   function of Python's. */
static bool rows_at(const Scene *scene, PyObject *tell, const double *q, const double *before, Wide limits[4], const double settings[6],
                    const double *shares, Pair *of_pairs, double *least, Rows *rows)
{
    int all = scene->all, m = scene->m, k = scene->pairs, seen_in[MOST_SHAPES];
    const double *numbers = scene->table[SHAPES];
    double smallest = INFINITY, wanted = settings[0], rate = settings[1];
    bool brakes = false, still[MOST_SHAPES];
    Shape shapes[MOST_SHAPES];
    States states;
    Places found;
    Wide J[6];
    rows->count = 0;
    rows->valid = rows->still = true;
    states.speed = limits[0];
    states.brakes = limits[1];
    states.before = before;
    states.settings = settings;
    own_state(m, all, q, before, &states);
    for (int j = 0; j < m; j++)
        brakes = brakes || isfinite(limits[1][j]);
    if (brakes)
        braked_states(all, scene->starts, q, before, limits, settings, &states);
    set_free(m, q, before, limits, settings[3], settings[5], &states);
    for (int i = 0; i < scene->shapes; i++) {
        seen_in[i] = -1;
        still[i] = norm(6, scene->table[TWISTS] + 6 * i) == 0.0;
    }
    memcpy(of_pairs, scene->pair, (size_t)k * sizeof *of_pairs);
    for (int i = 0; i < k; i++) {
        of_pairs[i].share = shares != NULL ? shares[i] : share_of_pair(scene, i);
        of_pairs[i].still = still[of_pairs[i].of[0]] && still[of_pairs[i].of[1]];
        least[i] = INFINITY;
        of_pairs[i].leaves = INFINITY;
        of_pairs[i].recedes = false;
    }
    for (int s = 0; s < states.count; s++) {
        bool moved = false, leaving = brakes && s == 0, last = s == states.count - 1;
        Pose motions[ALL_JOINTS + 1], step, motion;
        double more = 0.0;
        Wide approach, since; /* how fast joints can turn, weighed, and by then so much of the room since the first state */
        for (int j = 0; j < all; j++) {
            double free = j < m ? fmax(states.free[0][j], states.free[1][j]) : 0.0;
            approach[j] = j < m ? (s > 0 ? states.time[s] / settings[3] + 1.0 : 1.0) * free : fabs(states.going[s > 0][j]);
            more += states.grows[j] != 0.0 ? fabs(states.grows[j]) * free : 0.0;
        }
        for (int j = 0; j < all; j++) {
            approach[j] += j < m && states.longer[s][j] != 0.0 ? fabs(states.longer[s][j]) * more : 0.0;
            since[j] = approach[j] + rate * fabs(states.q[s][j] - q[j]);
        }
        for (int i = 0; i < k; i++) {
            Pair *pair = &of_pairs[i];
            double near_by = rate * pair->share;
            bool skips = pair->still && rate > 0.0;
            if (!(pair->share > 0.0) || pair->recedes || (s > 0 && skips && (!last || pair->leaves == INFINITY) && near_by * (pair->far - wanted) > nearer(pair, since)))
                continue;
            if (!moved)
                moved_by(all, scene->screws, scene->starts, states.q[s], J, motions);
            moved = true;
            for (int e = 0; e < 2; e++) {
                int of = pair->of[e];
                if (seen_in[of] == s)
                    continue;
                if (seen_in[of] < 0)
                    shapes[of] = scene->of[of];
                motion = motions[shapes[of].body];
                if (states.time[s] > 0.0 && !still[of]) {
                    exponential(pair->twists[e], pair->twists[e] + 3, states.time[s], &step);
                    product(&step, &motions[shapes[of].body], &motion);
                }
                shape_at(numbers + of * OF_SHAPE, &motion, &shapes[of]);
                seen_in[of] = s;
            }
            const Shape *a = &shapes[pair->of[0]], *b = &shapes[pair->of[1]];
            double far = at_least(a, b);
            if (s == 0)
                pair->far = far;
            /* Too far for any row, and for the least distance: where rows are asked for, a pair is not looked at closer. */
            double room = fmin(near_by * (far - wanted), last ? pair->leaves : INFINITY), fastest = INFINITY;
            bool apart = skips && far > wanted && (s > 0 || far > smallest);
            if (apart && leaving)
                continue;
            if (skips) {
                fastest = nearer(pair, approach);
                bool out_of_reach = room > fastest;
                if (room > 0.0 && !out_of_reach)
                    fastest = fmin(fastest, swept(pair, shapes, (const Wide *)J, approach));
                if (apart && (s == 0 || last ? room > fastest : out_of_reach))
                    continue;
            }
            if (a->kind != MESH && b->kind != MESH)
                near_places(a, b, &found);
            else if (!told_places(tell, pair, a, b, &found))
                return false;
            double kept = fmin(kept_by_pair(scene, i), s > 0 ? least[i] : INFINITY);
            double nearest = rows_of_pair(pair, &states, s, (const Wide *)J, kept, fastest, &found, rows);
            if (s == 0) {
                least[i] = nearest;
                pair->far = found.count > 0 ? found.at[0].d : far;
                smallest = fmin(smallest, nearest);
            }
        }
    }
    ask_what_is_possible(&states, rows);
    return true;
}

/* Room for what is found of each pair; false where there is none. */
bool apart_begun(Apart *apart)
{
    size_t count = apart->scene->pairs > 0 ? (size_t)apart->scene->pairs : 1;
    apart->pairs = malloc(count * (sizeof(Pair) + 3 * sizeof(double)));
    if (apart->pairs == NULL)
        return false;
    apart->least = (double *)(apart->pairs + count);
    apart->ends = apart->least + count;
    apart->shares = apart->ends + count;
    return true;
}

void apart_ended(Apart *apart) { free(apart->pairs); }

static void added(Apart *apart, const Rows *rows, int i, double least, Demand *demand)
{
    int at = demand->limits++;
    memcpy(demand->G[at], rows->C[i], sizeof(Row));
    demand->least[at] = least;
    demand->most[at] = INFINITY;
    apart->pair[apart->count] = rows->pair[i];
    apart->distance[apart->count++] = apart->least[rows->pair[i]];
}

/* What is not told as too near: curvature and rounding take as much. */
static double enough_of(double wanted) { return wanted - fmax(CURVED * wanted, ACTIVE_TOLERANCE); }

/* By how much the distance of a pair may fall for its other arm's share of the room. */
static double for_others(const Apart *apart, int k)
{
    const Scene *scene = apart->scene;
    return scene->others ? (1.0 - share_of_pair(scene, k)) * fmax(apart->least[k] - apart->settings[0], 0.0) : 0.0;
}

/* control/clearance.py, rows_at, for a tick of a loop in which nothing is too near, and all that is near is judged. */
Outcome apart_now(Apart *apart, const double *there, const double *before, Demand *demand)
{
    const Scene *scene = apart->scene;
    double wanted = apart->settings[0], enough = enough_of(wanted), *least = apart->least;
    const npy_bool *unjudged = (const npy_bool *)scene->table[UNJUDGED];
    Rows rows;
    memcpy(apart->q, there, (size_t)scene->m * sizeof(double));
    memcpy(apart->velocity, before, (size_t)scene->m * sizeof(double));
    if (!rows_at(scene, NULL, apart->q, apart->velocity, apart->limits, apart->settings, NULL, apart->pairs, least, &rows) ||
        demand->limits + rows.count > MOST_LIMITS)
        return HAND_BACK;
    apart->nearest = apart->count = 0;
    for (int k = 0; k < scene->pairs; k++) {
        if (least[k] < wanted && unjudged[k])
            return HAND_BACK;
        apart->nearest = least[k] < least[apart->nearest] ? k : apart->nearest;
    }
    if (scene->pairs > 0 && least[apart->nearest] < enough)
        return HAND_BACK;
    for (int i = 0; i < rows.count; i++)
        added(apart, &rows, i, rows.lower[i], demand);
    demand->hinted = rows.valid;
    memcpy(demand->hint, rows.inside, (size_t)scene->m * sizeof(double));
    return DONE;
}

/* The same, rows_after: whether a velocity ends too near, and there are rows about it. */
bool apart_after(Apart *apart, const double *there, const double *x, Demand *demand)
{
    const Scene *scene = apart->scene;
    int m = scene->m;
    double wanted = apart->settings[0], dt = apart->settings[3], enough = enough_of(wanted);
    double to_its_end[6] = {wanted, 1.0 / dt, INFINITY, 0.0, apart->settings[4], INFINITY};
    Wide turned = {0.0}, still = {0.0};
    bool any = false, all = true;
    Rows rows;
    for (int j = 0; j < m; j++) {
        if (isfinite(apart->limits[1][j]))
            return false;
        turned[j] = dt * fabs(x[j]);
        apart->q[j] = there[j] + dt * x[j];
    }
    for (int j = m; j < scene->all; j++)
        still[j] = apart->velocity[j];
    for (int k = 0; k < scene->pairs; k++) {
        double d = apart->least[k];
        bool may = share_of_pair(scene, k) > 0.0 && isfinite(d) &&
                   !(d - nearer(&scene->pair[k], turned) >= wanted + for_others(apart, k));
        apart->shares[k] = may ? 1.0 : 0.0;
        any = any || may;
    }
    if (!any || !rows_at(scene, NULL, apart->q, still, apart->limits, to_its_end, apart->shares, apart->pairs, apart->ends, &rows))
        return false;
    for (int k = 0; k < scene->pairs; k++) {
        all = all && (apart->shares[k] == 0.0 || apart->ends[k] - for_others(apart, k) >= fmin(apart->least[k], enough));
    }
    any = false;
    for (int i = 0; i < rows.count && !all && demand->limits < MOST_LIMITS; i++) {
        int k = rows.pair[i];
        double own = kept_by_pair(scene, k), kept = fmin(apart->least[k], own) - own + for_others(apart, k);
        double asked = rows.lower[i] + kept / dt;
        if (!(asked > 0.0))
            continue;
        added(apart, &rows, i, asked + dot(m, rows.C[i], x), demand);
        any = true;
    }
    return any;
}

static void let_go(PyObject *capsule)
{
    Scene *scene = PyCapsule_GetPointer(capsule, "scene");
    for (int i = 0; i < HELD; i++)
        Py_DECREF(scene->held[i]);
    free(scene);
}

static const Scene *scene_of(PyObject *object) { return PyCapsule_IsValid(object, "scene") ? PyCapsule_GetPointer(object, "scene") : NULL; }

/* scene(screws, starts, shapes, twists, pairs, levers, unjudged): what of a clearance does not change, for `clearance` and
   `step`, which read shapes, twists, shares and what is unjudged where Python writes them. None where it is too large. */
PyObject *scene(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    static const char *const USE = "scene(screws, starts of arms by body, (n, 18) shapes, (n, 6) twists, (k, 4) pairs, share and distance kept, "
                                   "(n, M) levers, (k,) which are not judged)";
    PyArrayObject *unjudged = count == 7 ? (PyArrayObject *)arguments[6] : NULL;
    if (count != 7 || !is_table(arguments[2], OF_SHAPE) || !is_table(arguments[3], 6) || !is_table(arguments[4], OF_PAIR) ||
        !PyArray_Check(arguments[0]) || PyArray_NDIM((PyArrayObject *)arguments[0]) != 2 || !PyArray_CheckExact(arguments[6]) ||
        PyArray_TYPE(unjudged) != NPY_BOOL || !PyArray_ISCARRAY_RO(unjudged) || PyArray_NDIM(unjudged) != 1)
        return refused(USE);
    npy_intp joints = PyArray_DIM((PyArrayObject *)arguments[0], 1), n = PyArray_DIM((PyArrayObject *)arguments[2], 0);
    npy_intp k = PyArray_DIM((PyArrayObject *)arguments[4], 0);
    if (PyArray_DIM((PyArrayObject *)arguments[3], 0) != n || !is_table(arguments[5], joints) ||
        PyArray_DIM((PyArrayObject *)arguments[5], 0) != n || PyArray_DIM(unjudged, 0) != k)
        return refused(USE);
    if (joints < 1 || joints > ALL_JOINTS || n > MOST_SHAPES || k > n * n)
        Py_RETURN_NONE;
    int all = (int)joints;
    double starts[ALL_JOINTS + 1];
    Scene *made = malloc(sizeof *made + (size_t)k * sizeof(Pair));
    if (made == NULL)
        return PyErr_NoMemory();
    made->all = all;
    made->m = 0;
    made->shapes = (int)n;
    made->pairs = (int)k;
    made->meshes = false;
    bool good = matrix(arguments[0], 6, all, ALL_JOINTS, made->screws[0]) && vector(arguments[1], all + 1, starts);
    for (int i = 0; i < HELD; i++)
        made->table[i] = PyArray_DATA((PyArrayObject *)arguments[2 + i]);
    for (int i = 0; good && i <= all; i++) {
        good = within(starts[i], 0, i);
        made->starts[i] = (int)starts[i];
    }
    while (good && made->m < all && starts[made->m + 1] == 0.0)
        made->m++;
    made->others = made->m < all;
    for (int i = 0; good && i < n; i++) {
        const double *numbers = made->table[SHAPES] + i * OF_SHAPE;
        good = within(numbers[BODY], 0, all) && within(numbers[KIND], ROUND, MESH);
        Shape *s = &made->of[i];
        *s = (Shape){.body = (int)numbers[BODY], .kind = (int)numbers[KIND], .radius = numbers[RADIUS]};
        memcpy(s->half, numbers + HALF, sizeof s->half);
        s->ball = norm(3, s->half) + s->radius;
        made->meshes = made->meshes || s->kind == MESH;
    }
    for (int i = 0; good && i < k; i++) {
        const double *numbers = made->table[PAIRS] + OF_PAIR * i;
        good = within(numbers[0], 0, (int)n - 1) && within(numbers[1], 0, (int)n - 1);
        Pair *pair = &made->pair[i];
        *pair = (Pair){.index = i};
        for (int e = 0; good && e < 2; e++) {
            int of = pair->of[e] = (int)numbers[e];
            pair->to[e] = made->of[of].body;
            pair->from[e] = made->starts[pair->to[e]];
            pair->levers[e] = made->table[LEVERS] + of * all;
            pair->twists[e] = made->table[TWISTS] + 6 * of;
        }
        if (pair->from[0] == pair->from[1])
            pair->from[0] = pair->from[1] = pair->to[0] < pair->to[1] ? pair->to[0] : pair->to[1];
    }
    if (!good || made->m > MOST) {
        free(made);
        return good ? Py_NewRef(Py_None) : refused(USE);
    }
    PyObject *capsule = PyCapsule_New(made, "scene", let_go);
    for (int i = 0; i < HELD; i++)
        made->held[i] = Py_NewRef(arguments[2 + i]);
    return capsule;
}

/* clearance(scene, q, before, limits, settings, shares, places): what rows_of in control/clearance_rows.py says. None where
   numbers are not finite. */
PyObject *clearance(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    const Scene *scene = count == 7 ? scene_of(arguments[0]) : NULL;
    if (scene == NULL || (scene->meshes && arguments[6] == Py_None))
        return refused("clearance(a scene, q, velocity before, (4, M) limits of speed, acceleration and position, "
                       "(distance, rate, escape, tick, share of braking), (k,) shares or None, places of meshes)");
    int all = scene->all;
    npy_intp k = scene->pairs;
    Apart apart = {.scene = scene};
    if (!apart_begun(&apart))
        return PyErr_NoMemory();
    bool shared = arguments[5] == Py_None;
    PyObject *found = NULL, *distances = NULL;
    if (!vector(arguments[1], all, apart.q) || !vector(arguments[2], all, apart.velocity) || !all_finite(all, apart.q) ||
        !all_finite(all, apart.velocity) || !matrix(arguments[3], 4, all, ALL_JOINTS, apart.limits[0]) ||
        !vector(arguments[4], 6, apart.settings) || (!shared && !vector(arguments[5], (int)k, apart.shares)))
        found = left_to_python();
    else if ((distances = PyArray_SimpleNew(1, &k, NPY_DOUBLE)) != NULL) {
        double *least = PyArray_DATA((PyArrayObject *)distances), of_pair[APART_ROWS];
        Rows rows;
        if (rows_at(scene, arguments[6], apart.q, apart.velocity, apart.limits, apart.settings, shared ? NULL : apart.shares, apart.pairs,
                    least, &rows)) {
            for (int i = 0; i < rows.count; i++)
                of_pair[i] = rows.pair[i];
            found = Py_BuildValue("(NNNN)", new_matrix(rows.count, scene->m, MOST, rows.C[0]), new_vector(rows.count, rows.lower),
                                  new_vector(rows.count, of_pair), distances);
        } else
            Py_DECREF(distances);
    }
    apart_ended(&apart);
    return found;
}

/* What a tick of a loop beside a scene is given: (4, M) limits, settings, (2, M - m) where others are and how fast, and who is
   told what was found. */
bool apart_from(PyObject *const *given, int m, Apart *apart)
{
    const Scene *scene = apart->scene = scene_of(given[0]);
    if (scene == NULL || scene->meshes || scene->m != m || !matrix(given[1], 4, scene->all, ALL_JOINTS, apart->limits[0]) ||
        !vector(given[2], 6, apart->settings))
        return false;
    apart->tell = given[4];
    int others = scene->all - m;
    Wide around[2];
    if (others > 0 && (!matrix(given[3], 2, others, ALL_JOINTS, around[0]) || !all_finite(others, around[0]) || !all_finite(others, around[1])))
        return false;
    memcpy(apart->q + m, around[0], (size_t)others * sizeof(double));
    memcpy(apart->velocity + m, around[1], (size_t)others * sizeof(double));
    return true;
}

/* What the rows of a tick are called by who is told of it: the nearest pair, its distance, and pair and distance of each row. */
PyObject *apart_told(const Apart *apart)
{
    PyObject *of_rows[4 * APART_ROWS];
    for (int i = 0; i < apart->count; i++) {
        of_rows[2 * i] = PyLong_FromLong(apart->pair[i]);
        of_rows[2 * i + 1] = PyFloat_FromDouble(apart->distance[i]);
    }
    double least = apart->scene->pairs > 0 ? apart->least[apart->nearest] : INFINITY;
    return PyObject_CallFunction(apart->tell, "idN", apart->nearest, least, named(&PyTuple_Type, 2 * apart->count, of_rows));
}
