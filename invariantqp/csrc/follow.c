/* Twin of a tick of paths/driver.py in which nothing new comes.

       v = (r(t + dt) - q) / dt, or towards r where joints catch up, or towards what the law makes of a twist,
       inside the joints' limits,     command = v + the way back to q

   A tick in which a path whose shape is kept has to wait, and joints that are not where they were sent, are handed back. */

#include "paths.h"

/* _going_over, for a loop without acceleration limits and delay; the tick that answers the twist is told where it moves. */
static Outcome towards_twist(const JointLimits *limits, const Loop *loop, const double *kept, const double *twist,
                             const double *q, const double *velocity, Tick *tick, Row v)
{
    int m = limits->m;
    double share = INFINITY;
    Row x = {0.0};
    if (norm(6, twist) > 0.0) {
        if (step(loop, NULL, q, NULL, twist, velocity, kept, tick) == HAND_BACK)
            return HAND_BACK;
        memcpy(x, tick->solution.velocity, sizeof x);
    }
    for (int j = 0; j < m; j++)
        if (x[j] != velocity[j])
            share = fmin(share, towards(limits, j, velocity[j], x[j]) / (x[j] - velocity[j]));
    for (int j = 0; j < m; j++)
        v[j] = share * limits->dt >= 1.0 ? x[j] : velocity[j] + limits->dt * share * (x[j] - velocity[j]);
    return DONE;
}

/* Follower._nearest: the command nearest one that the loop of joints may not allow, in its place, where the loop does not. Which
   of its fixed rows, or TOOL_SPEED_ROW, holds it, or ALLOWED. */
#define ALLOWED (-2)
static Outcome nearest_allowed(const Loop *loop, const double *kept, const double *q, const double *before, Tick *tick,
                               Row command, int *held)
{
    int m = loop->joints;
    double twist[6], most = 0.0, size = 0.0, price = 0.0;
    const double *x = tick->solution.velocity;
    Row J[6];
    Pose tool, home;
    const Beside as_seen = {.J = (const Row *)J, .tool = &tool, .posture = command};
    pose_from(loop->home[0], &home);
    kinematics(m, loop->screws, &home, q, J, &tool);
    for (int i = 0; i < 6; i++)
        twist[i] = dot(m, J[i], command);
    if (step_beside(loop, NULL, &as_seen, q, NULL, twist, before, kept, tick) == HAND_BACK)
        return HAND_BACK;
    for (int j = 0; j < m; j++) {
        most = fmax(most, fabs(x[j] - command[j]));
        size = fmax(size, fabs(command[j]));
    }
    *held = ALLOWED;
    if (!(most > EXCESS * size) && status(&tick->solution) != DEGRADED)
        return DONE;
    *held = TOOL_SPEED_ROW;
    for (int i = 0; i < loop->limits; i++)
        if (fabs(tick->solution.multipliers[m + i]) > price) {
            price = fabs(tick->solution.multipliers[m + i]);
            *held = i;
        }
    memcpy(command, x, sizeof(Row));
    return DONE;
}

/* Follower._corrected: the command of a joint, and what it changes by; whether nothing else changes it. */
static bool commanded(const Course *course, int j, double q, double off, double v, double last, double *command, double *pace)
{
    const JointLimits *limits = &course->limits;
    double A = limits->acceleration[j], dt = limits->dt, before = *command;
    double back = copysign(homing(limits, j, off, course->gain), off);
    if (course->shape)
        *command = v + back;
    else {
        double w = before - last;
        q = between(q, limits->lower[j], limits->upper[j]);
        *command = nearest(limits, j, q, before, *pace, v + w + dt * towards(limits, j, w, back));
    }
    *pace = (*command - before) / dt;
    double room = *command > 0.0 ? limits->upper[j] - q : q - limits->lower[j];
    double most = fmin(limits->fastest[j], braking_speed(room, A, dt));
    return fabs(*command - before) <= (1.0 + EXCESS) * A * dt && fabs(*command) <= (1.0 + EXCESS) * most;
}

/* The answer of a tick as `Controller.named` takes it; None where it says no more than `quiet`. */
static PyObject *answer_of(const Loop *loop, const Tick *tick, Status quiet)
{
    PyObject *troubles = joint_troubles(loop, tick, false);
    if (troubles == NULL || (troubles == Py_None && status(&tick->solution) <= quiet))
        return troubles;
    return Py_BuildValue("(NN)", fields(loop->joints, &tick->solution), troubles);
}

/* follow(course, loop, beside, memory, twist, late, ease, time, q, sent, position, velocity, acceleration, command, pace):
   position, velocity, acceleration, command and pace after the tick, q as an array, the source's last column before and
   after, whether the joints are late, how they stop being it, a residual or None, what the loop says, or None, and which of
   its rows, or -1 its tool speed, does not allow what was wanted, or None. None where Python has to answer, or to say what is
   wrong with q. The loop is one without acceleration limits and delay, `beside` that for joint velocities, or None where
   there are neither rows nor a tool speed. Late joints look for a splice that takes `ease`, unless that is 0. */
PyObject *follow(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Course course;
    Row q, here, sent, position, velocity, acceleration, command, pace, before, wanted, v;
    Path now = {{0.0}}, then = {{0.0}};
    double twist[6], left[6 * MOST];
    bool joins = false;
    Tick tick, held_tick;
    static const char *const USE =
        "follow(course, loop, beside, memory, twist, late, ease, time, q, sent, position, velocity, acceleration, command, pace)";
    if (count != 15 || !course_of(arguments[0], &course))
        return refused(USE);
    const Loop *loop = loop_of(arguments[1]), *beside = arguments[2] == Py_None ? NULL : loop_of(arguments[2]);
    const double *kept = loop == NULL ? NULL : memory_of(arguments[3], loop);
    const JointLimits *limits = &course.limits;
    int m = limits->m, late = PyObject_IsTrue(arguments[5]), held = ALLOWED;
    bool by_twist = arguments[4] != Py_None, shape = course.shape;
    if (kept == NULL || loop->joints != m || (beside == NULL) != (arguments[2] == Py_None))
        return refused(USE);
    double ease = PyFloat_AsDouble(arguments[6]), time = PyFloat_AsDouble(arguments[7]), dt = limits->dt, after = time + dt;
    bool good = !PyErr_Occurred() && vector(arguments[8], m, q) && vector(arguments[9], m, sent) &&
                vector(arguments[10], m, position) && vector(arguments[11], m, velocity) &&
                vector(arguments[12], m, acceleration) && vector(arguments[13], m, command) && vector(arguments[14], m, pace) &&
                !(by_twist && !vector(arguments[4], 6, twist));
    PyErr_Clear(); /* Python says what is wrong */
    for (int j = 0; j < m && good; j++)
        good = fabs(sent[j] - q[j]) <= course.head[STRAY];
    if (!good)
        Py_RETURN_NONE;
    if (late && ease > 0.0) {
        double state[3 * MOST];
        for (int j = 0; j < m; j++) { /* of the motion through the ends of the last three ticks */
            state[j] = position[j];
            state[m + j] = velocity[j] + 0.5 * dt * acceleration[j];
            state[2 * m + j] = acceleration[j];
        }
        joins = splices(&course, time, state, ease, left);
        late = !joins;
    }
    if (by_twist) {
        if (towards_twist(limits, loop, kept, twist, position, velocity, &tick, v) == HAND_BACK)
            Py_RETURN_NONE;
    } else if (late) {
        source_at(&course, after, then);
        if (ease == 0.0) /* else no splice was found, and the last one is over */
            left_over(&course, after, then);
        for (int j = 0; j < m; j++)
            v[j] = velocity[j] + dt * catching_up(limits, j, position[j] + dt * velocity[j], velocity[j], then[0][j], then[1][j]);
    } else {
        source_position(&course, after, then[0]);
        if (course.columns > m)
            source_position(&course, time, now[0]);
        memset(then[1], 0, 3 * sizeof then[1]);
        if (joins)
            quintic(m, left, dt, then);
        else
            left_over(&course, after, then);
        for (int j = 0; j < m; j++)
            v[j] = (then[0][j] - position[j]) / dt;
    }
    for (int j = 0; j < m && !shape; j++) {
        double x = nearest(limits, j, position[j], velocity[j], acceleration[j], v[j]);
        late = late || (x != v[j] && !by_twist);
        v[j] = x;
    }
    for (int j = 0; j < m; j++) {
        double off = sent[j] - q[j];
        here[j] = position[j] - off;
        before[j] = command[j];
        if (!commanded(&course, j, shape ? q[j] : here[j], off, v[j], velocity[j], &command[j], &pace[j]))
            Py_RETURN_NONE;
    }
    memcpy(wanted, command, sizeof wanted);
    if (beside != NULL && nearest_allowed(beside, kept, here, before, &held_tick, command, &held) == HAND_BACK)
        Py_RETURN_NONE;
    if (shape && held != ALLOWED)
        Py_RETURN_NONE;
    late = late || (held != ALLOWED && !by_twist);
    PyObject *answer = held != ALLOWED ? answer_of(beside, &held_tick, GUARDED)
                       : by_twist && norm(6, twist) > 0.0 ? answer_of(loop, &tick, OK) : Py_NewRef(Py_None);
    for (int j = 0; j < m; j++) {
        if (held != ALLOWED) {
            v[j] += command[j] - wanted[j];
            pace[j] = 0.0; /* how hard the loop braked is nothing to go on with */
        }
        position[j] += dt * v[j];
        acceleration[j] = held != ALLOWED ? 0.0 : (v[j] - velocity[j]) / dt;
        velocity[j] = v[j];
    }
    PyObject *way = joins ? new_matrix(6, m, m, left) : Py_NewRef(Py_None);
    PyObject *which = held == ALLOWED ? Py_NewRef(Py_None) : PyLong_FromLong(held);
    return Py_BuildValue("(NNNNNNddNNNN)", new_vector(m, position), new_vector(m, velocity), new_vector(m, acceleration),
                         new_vector(m, command), new_vector(m, pace), new_vector(m, q), now[0][m], then[0][m],
                         PyBool_FromLong(late), way, answer, which);
}
