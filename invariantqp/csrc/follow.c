/* Twin of a tick of paths/driver.py in which nothing new comes.

       v = (r(t + dt) - q) / dt, or towards r where joints catch up, or towards what the law makes of a twist,
       inside the joints' limits,     command = v + the way back to q, or the nearest that the loop allows

   A tick in which a path whose shape is kept has to wait, and joints that are not where they were sent, or that do not move
   although they are commanded to, are handed back. */

#include "paths.h"

/* A loop for which commands are found; where Python has rows of each tick, who is asked for them, and their names, or NULL. */
typedef struct Asked {
    PyObject *who, *names;
} Asked;
typedef struct {
    const Loop *loop;
    Asked asked;
} Bounds;

/* A tick: what is followed and kept, before and after it; the source's last column then, a place; who has something to say, or
   NULL. From the course on, what is long, and written before it is read: what is followed; the loops; the residual that late
   joints go over by, if they do; the tick of whom says something. */
typedef struct {
    bool by_twist, at_base, late, joins, held;
    double twist[6], override, ease, time, off, from, to;
    Row q, sent, seen, shown, position, velocity, acceleration, command, pace;
    double states[MOST_JOINT_STATES];
    const double *kept;
    const Bounds *says;
    Course course;
    Bounds law, joints; /* without acceleration limits and delay; for joint velocities, its loop NULL where nothing binds them */
    double left[6 * MOST];
    Tick tick;
} Follow;

/* The rows of a tick at q after a velocity x, or all of them where x is its answer and does not keep them to the tick's end.
   HAND_BACK with an error of a function of Python's, where Python has to answer, or where x is kept. */
Outcome rows_asked(Asked *asked, bool after, int m, const double *q, const double *x, Demand *demand)
{
    PyObject *found = PyErr_Occurred() ? NULL : PyObject_CallFunction(asked->who, "ONN", after ? Py_True : Py_False, new_vector(m, q), new_vector(m, x));
    if (found == NULL)
        return HAND_BACK;
    if (found == Py_None && !after) {
        Py_DECREF(found);
        return DONE;
    }
    PyArrayObject *C = PyTuple_CheckExact(found) && PyTuple_Size(found) == 4 ? (PyArrayObject *)PyTuple_GetItem(found, 0) : NULL;
    int rows = C != NULL && PyArray_Check(C) && PyArray_NDIM(C) == 2 && PyArray_DIM(C, 0) <= MOST_LIMITS ? (int)PyArray_DIM(C, 0) : 0;
    bool good = rows > 0 && matrix((PyObject *)C, rows, m, MOST, demand->G[0]) && vector(PyTuple_GetItem(found, 1), rows, demand->least) &&
                vector(PyTuple_GetItem(found, 2), rows, demand->most);
    if (good) {
        Py_XDECREF(asked->names);
        asked->names = Py_NewRef(PyTuple_GetItem(found, 3));
        demand->limits = rows;
    }
    PyErr_Clear();
    Py_DECREF(found);
    return good ? DONE : HAND_BACK;
}

/* Follower._wanted: the joint velocity that is wanted in this tick, by a twist: _going_over. */
static Outcome towards_twist(Follow *f, Row v)
{
    const JointLimits *limits = &f->course.limits;
    const Beside beside = {.at_base = f->at_base, .asked = f->law.asked.who == NULL ? NULL : &f->law.asked};
    const Now now = {.speed = f->override, .tool_speed = INFINITY};
    int m = limits->m;
    double share = INFINITY;
    Row x = {0.0};
    if (norm(6, f->twist) > 0.0) {
        if (step_beside(f->law.loop, f->override < 1.0 ? &now : NULL, &beside, f->position, NULL, f->twist, f->velocity, f->kept, &f->tick) == HAND_BACK)
            return HAND_BACK;
        memcpy(x, f->tick.solution.velocity, sizeof x);
        f->says = &f->law;
    }
    for (int j = 0; j < m; j++)
        if (x[j] != f->velocity[j])
            share = fmin(share, towards(limits, j, f->velocity[j], x[j]) / (x[j] - f->velocity[j]));
    for (int j = 0; j < m; j++)
        v[j] = share * limits->dt >= 1.0 ? x[j] : f->velocity[j] + limits->dt * share * (x[j] - f->velocity[j]);
    return DONE;
}

/* Follower._wanted, by what is followed. */
static void towards_source(Follow *f, Row v)
{
    const JointLimits *limits = &f->course.limits;
    int m = limits->m;
    double dt = limits->dt, after = f->time + dt, state[3 * MOST];
    Path now = {{0.0}}, then = {{0.0}};
    if (f->late && f->ease > 0.0) {
        for (int j = 0; j < m; j++) { /* of the motion through the ends of the last three ticks */
            state[j] = f->position[j];
            state[m + j] = f->velocity[j] + 0.5 * dt * f->acceleration[j];
            state[2 * m + j] = f->acceleration[j];
        }
        f->joins = splices(&f->course, f->time, state, f->ease, f->left);
        f->late = !f->joins;
    }
    if (f->late) {
        source_at(&f->course, after, then);
        if (f->ease == 0.0) /* else no splice was found, and the last one is over */
            left_over(&f->course, after, then);
    } else {
        source_position(&f->course, after, then[0]);
        if (f->course.columns > m)
            source_position(&f->course, f->time, now[0]);
        if (f->joins)
            quintic(m, f->left, dt, then);
        else
            left_over(&f->course, after, then);
    }
    f->from = now[0][m];
    f->to = then[0][m];
    for (int j = 0; j < m; j++) {
        double q = f->position[j], speed = f->velocity[j], there = then[0][j];
        v[j] = f->late ? speed + dt * catching_up(limits, j, q + dt * speed, speed, there, then[1][j]) : (there - q) / dt;
    }
}

/* Follower._corrected: the command of a joint; whether nothing else changes it. */
static bool corrected(const Follow *f, int j, double here, double off, double v, double *command)
{
    const JointLimits *limits = &f->course.limits;
    double A = limits->acceleration[j], dt = limits->dt, before = f->command[j];
    double back = copysign(homing(limits, j, off, f->course.gain), off);
    if (f->course.shape) {
        *command = v + back;
        here = f->q[j];
    } else {
        double w = before - f->velocity[j];
        here = between(here, limits->lower[j], limits->upper[j]);
        *command = nearest(limits, j, here, before, f->pace[j], v + w + dt * towards(limits, j, w, back));
    }
    double room = *command > 0.0 ? limits->upper[j] - here : here - limits->lower[j];
    double most = fmin(limits->fastest[j], braking_speed(room, A, dt, f->law.loop->rate));
    return fabs(*command - before) <= (1.0 + EXCESS) * A * dt && fabs(*command) <= (1.0 + EXCESS) * most;
}

/* Follower._nearest: whether the loop allows a command, and the nearest that it does. */
static Outcome nearest_allowed(Follow *f, const double *here, Row command)
{
    const Loop *loop = f->joints.loop;
    int m = loop->joints;
    double twist[6], most = 0.0, size = 0.0;
    Row J[6];
    Pose tool, home;
    Tick tick;
    const Beside beside = {.J = (const Row *)J, .tool = &tool, .posture = command, .at_base = true, .asked = f->joints.asked.who == NULL ? NULL : &f->joints.asked};
    pose_from(loop->home[0], &home);
    kinematics(m, loop->screws, &home, here, J, &tool);
    for (int i = 0; i < 6; i++)
        twist[i] = dot(m, J[i], command);
    if (step_beside(loop, NULL, &beside, here, NULL, twist, f->command, f->kept, &tick) == HAND_BACK)
        return HAND_BACK;
    for (int j = 0; j < m; j++) {
        most = fmax(most, fabs(tick.solution.velocity[j] - command[j]));
        size = fmax(size, fabs(command[j]));
    }
    f->held = most > EXCESS * size || status(&tick.solution) == DEGRADED;
    if (f->held) {
        f->tick = tick;
        f->says = &f->joints;
        memcpy(command, tick.solution.velocity, sizeof(Row));
    }
    return DONE;
}

/* Follower._moved */
static Outcome moved(Follow *f)
{
    const JointLimits *limits = &f->course.limits;
    int m = limits->m;
    bool shape = f->course.shape;
    double dt = limits->dt;
    Row here, wanted, command, v;
    if (!f->by_twist)
        towards_source(f, v);
    else if (towards_twist(f, v) == HAND_BACK)
        return HAND_BACK;
    for (int j = 0; j < m; j++) {
        double x = shape ? v[j] : nearest(limits, j, f->position[j], f->velocity[j], f->acceleration[j], v[j]), off = f->sent[j] - f->q[j];
        f->late = f->late || (dt * fabs(x - v[j]) > IN_PLACE && !f->by_twist);
        v[j] = x;
        here[j] = f->position[j] - off;
        if (!corrected(f, j, here[j], off, v[j], &wanted[j]))
            return HAND_BACK;
    }
    memcpy(command, wanted, sizeof command);
    if (f->joints.loop != NULL && nearest_allowed(f, here, command) == HAND_BACK)
        return HAND_BACK;
    if (f->held && shape)
        return HAND_BACK;
    f->late = f->late || (f->held && !f->by_twist);
    for (int j = 0; j < m; j++) {
        v[j] += command[j] - wanted[j]; /* how hard the loop braked is nothing to go on with */
        f->pace[j] = f->held ? 0.0 : (command[j] - f->command[j]) / dt;
        f->acceleration[j] = f->held ? 0.0 : (v[j] - f->velocity[j]) / dt;
        f->position[j] += dt * v[j];
        f->velocity[j] = v[j];
        f->command[j] = command[j];
    }
    return DONE;
}

/* The loop of an argument, None for none, or a tuple of it and who is asked for rows; whether it is one. */
static bool bounds_of(PyObject *object, int m, Bounds *bounds)
{
    bool asked = PyTuple_CheckExact(object) && PyTuple_Size(object) == 2;
    *bounds = (Bounds){.loop = object == Py_None ? NULL : loop_of(asked ? PyTuple_GetItem(object, 0) : object),
                       .asked.who = asked ? PyTuple_GetItem(object, 1) : NULL};
    return object == Py_None || (bounds->loop != NULL && bounds->loop->joints == m);
}

/* What the loop says of the tick as `Controller.said` takes it; None where that is no more than is told anyway. */
static PyObject *said(const Follow *f)
{
    if (f->says == NULL)
        Py_RETURN_NONE;
    const Loop *loop = f->says->loop;
    PyObject *found[2] = {NULL, joint_troubles(loop, &f->tick)};
    if (!f->held && found[1] == Py_None && status(&f->tick.solution) == OK)
        return found[1];
    found[0] = fields(loop->joints, &f->tick.solution, loop, Py_XNewRef(f->says->asked.names));
    return named(&PyTuple_Type, 2, found);
}

/* control/memory.py: with what joints did since the tick before; false where one does not move although it is commanded to,
   or did not in the tick before. */
static bool moves(Follow *f, PyObject *states)
{
    const Loop *loop = f->law.loop;
    int m = loop->joints;
    Row commanded, moved;
    if (states == Py_None)
        return true;
    if (!vector(states, states_of(m), f->states))
        return false;
    bool stood = any_unresponsive(f->states, m);
    for (int j = 0; j < m; j++) {
        commanded[j] = loop->dt * f->shown[j];
        moved[j] = f->q[j] - f->seen[j];
    }
    update_states(loop, commanded, moved, f->states);
    return !stood && !any_unresponsive(f->states, m);
}

/* follow(course, law, joints, memory, twist, at_base, override, late, ease, time, gain, q, sent, seen, shown, states, position,
   velocity, acceleration, command, pace): the states of the joints, position, velocity, acceleration, command and pace after the
   tick, the command once more, q by whole turns of continuous joints near where it was seen before, the source's last column
   before and after, whether the joints are late, how they stop being it, a residual or None, what the loop says, or None, whether
   it does not allow what was wanted, how far a joint is from where it was sent at most, and what is wrong with the joints, or
   None. None where Python has to answer, or to say what is wrong with q. `law` is the loop without acceleration limits and delay,
   `joints` that for joint velocities, or None where nothing but joint limits binds them; each a Loop, or a tuple of it and of who
   is asked for rows. `at_base` is whether the twist is a screw in base coordinates, and not the tool point's. Late
   joints look for a splice that takes `ease`, unless that is 0. `gain` is the largest of the loop [1/s]. `seen` is q in the tick
   before, `shown` the command that q shows now, `states` are None where they are those of this tick. */
PyObject *follow(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    static const char *const USE = "follow(course, law, joints, memory, twist, at_base, override, late, ease, time, gain, q, sent, seen, shown, "
                                   "states, position, velocity, acceleration, command, pace)";
    Follow f;
    memset(&f, 0, offsetof(Follow, course));
    if (count != 21 || !course_of(arguments[0], &f.course))
        return refused(USE);
    int m = f.course.limits.m;
    if (!bounds_of(arguments[1], m, &f.law) || f.law.loop == NULL || !bounds_of(arguments[2], m, &f.joints) ||
        (f.kept = memory_of(arguments[3], f.law.loop)) == NULL)
        return refused(USE);
    f.by_twist = arguments[4] != Py_None;
    f.at_base = PyObject_IsTrue(arguments[5]);
    f.override = PyFloat_AsDouble(arguments[6]);
    f.late = PyObject_IsTrue(arguments[7]);
    f.ease = PyFloat_AsDouble(arguments[8]);
    f.time = PyFloat_AsDouble(arguments[9]);
    double gain = PyFloat_AsDouble(arguments[10]);
    bool good = !PyErr_Occurred() && vector(arguments[11], m, f.q) && vector(arguments[12], m, f.sent) &&
                vector(arguments[13], m, f.seen) && vector(arguments[14], m, f.shown) &&
                vector(arguments[16], m, f.position) && vector(arguments[17], m, f.velocity) &&
                vector(arguments[18], m, f.acceleration) && vector(arguments[19], m, f.command) &&
                vector(arguments[20], m, f.pace) && !(f.by_twist && !vector(arguments[4], 6, f.twist));
    PyErr_Clear(); /* Python says what is wrong */
    for (int j = 0; j < m && good; j++) {
        f.q[j] = f.seen[j] + displacement(f.law.loop, j, f.seen[j], f.q[j]);
        double off = fabs(f.sent[j] - f.q[j]);
        good = off <= f.course.head[STRAY];
        f.off = fmax(f.off, off);
    }
    bool anew = arguments[15] != Py_None;
    if (!good || !moves(&f, arguments[15]))
        Py_RETURN_NONE;
    Outcome outcome = moved(&f);
    outcome = PyErr_Occurred() ? HAND_BACK : outcome;
    PyObject *says = outcome == DONE ? said(&f) : NULL;
    Py_XDECREF(f.law.asked.names);
    Py_XDECREF(f.joints.asked.names);
    if (outcome == HAND_BACK)
        return PyErr_Occurred() ? NULL : Py_NewRef(Py_None);
    PyObject *way = f.joins ? new_matrix(6, m, m, f.left) : Py_NewRef(Py_None);
    PyObject *states = anew ? new_vector(states_of(m), f.states) : Py_NewRef(Py_None);
    PyObject *trouble = anew ? state_troubles(m, f.law.loop->dt, gain, f.states) : Py_NewRef(Py_None);
    return Py_BuildValue("(NNNNNNNNddNNNNdN)", states, new_vector(m, f.position), new_vector(m, f.velocity), new_vector(m, f.acceleration),
                         new_vector(m, f.command), new_vector(m, f.pace), new_vector(m, f.command), new_vector(m, f.q),
                         f.from, f.to, PyBool_FromLong(f.late), way, says, PyBool_FromLong(f.held), f.off, trouble);
}
