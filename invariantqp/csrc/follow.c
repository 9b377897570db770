/* Twin of a tick of paths/driver.py in which nothing new comes.

       v = (r(t + dt) - q) / dt, or towards r where joints catch up, or towards what the law makes of a twist,
       inside the joints' limits,     command = v + the way back to q

   A tick in which a path whose shape is kept has to wait, and joints that are not where they were sent, are handed back. */

#include "paths.h"

/* towards_twist, for a loop without acceleration limits and delay. */
static Outcome towards_twist(const JointLimits *limits, const Loop *loop, const double *kept, const double *twist,
                             const double *q, const double *velocity, Row v)
{
    int m = limits->m;
    double share = INFINITY;
    bool moves = false;
    Row x = {0.0};
    for (int i = 0; i < 6; i++)
        moves = moves || twist[i] != 0.0;
    if (moves) {
        Tick tick;
        if (step(loop, NULL, q, NULL, twist, velocity, kept, &tick) == HAND_BACK)
            return HAND_BACK;
        memcpy(x, tick.solution.velocity, sizeof x);
    }
    for (int j = 0; j < m; j++)
        if (x[j] != velocity[j])
            share = fmin(share, towards(limits, j, velocity[j], x[j]) / (x[j] - velocity[j]));
    for (int j = 0; j < m; j++)
        v[j] = share * limits->dt >= 1.0 ? x[j] : velocity[j] + limits->dt * share * (x[j] - velocity[j]);
    return DONE;
}

/* Follower._share: of joint velocities, what the loop's tool speed and fixed rows allow, and which it is: the number of a
   row, -1 for the tool's speed, -2 for none. */
static double allowed_share(const Loop *loop, const double *q, const double *v, int *which)
{
    double share = 1.0;
    int m = loop->joints;
    *which = -2;
    if (loop->speed_limit > 0.0) {
        Demand demand = {.m = m};
        Pose tool, home;
        pose_from(loop->home[0], &home);
        kinematics(m, loop->screws, &home, q, demand.J, &tool);
        limited_point(loop, &tool, &demand);
        double speed = tool_speed(&demand.cone, m, v);
        if (speed > loop->speed_limit) {
            share = loop->speed_limit / speed;
            *which = -1;
        }
    }
    for (int i = 0; i < loop->limits; i++) {
        double value = dot(m, loop->G[i], v), most = (value > 0.0 ? loop->most[i] : loop->least[i]) / value;
        if (isfinite(most) && fmax(most, 0.0) < share) {
            share = fmax(most, 0.0);
            *which = i;
        }
    }
    return share;
}

/* Follower._corrected: the command of a joint; whether it is one that nothing changes, where a shape is kept. */
static bool commanded(const Course *course, int j, double q, double off, double v, double before, double *command)
{
    const JointLimits *limits = &course->limits;
    double A = limits->acceleration[j], V = limits->fastest[j], dt = limits->dt;
    if (course->shape) {
        *command = v + copysign(homing(limits, j, off, course->gain), off);
        double room = *command > 0.0 ? limits->upper[j] - q : q - limits->lower[j];
        return fabs(*command - before) <= A * dt && fabs(*command) <= V && fabs(*command) <= braking_speed(room, A, dt);
    }
    double lower = between((limits->lower[j] - q) / dt, -V, V), upper = between((limits->upper[j] - q) / dt, -V, V);
    *command = between(v + course->gain * off, lower, upper);
    return true;
}

/* follow(course, loop, memory, twist, late, ease, time, q, sent, position, velocity, acceleration, command before):
   position, velocity, acceleration and command after the tick, q as an array, the source's last column before and after,
   whether the joints are late, how they stop being it, a residual or None, and what made all
   slower; or None where Python has to answer, or to say what is wrong with q. The loop is one without acceleration limits
   and delay. Late joints look for a splice that takes `ease`, unless that is 0. */
PyObject *follow(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    (void)module;
    Course course;
    Row q, sent, position, velocity, acceleration, command, v, allowed;
    Path now = {{0.0}}, then = {{0.0}};
    double twist[6], left[6 * MOST];
    bool joins = false;
    static const char *const USE =
        "follow(course, loop, memory, twist, late, ease, time, q, sent, position, velocity, acceleration, command)";
    if (count != 13 || !course_of(arguments[0], &course))
        return refused(USE);
    const Loop *loop = loop_of(arguments[1]);
    const double *kept = loop == NULL ? NULL : memory_of(arguments[2], loop);
    const JointLimits *limits = &course.limits;
    int m = limits->m, late = PyObject_IsTrue(arguments[4]);
    bool by_twist = arguments[3] != Py_None, shape = course.shape;
    if (kept == NULL || loop->joints != m)
        return refused(USE);
    double ease = PyFloat_AsDouble(arguments[5]), time = PyFloat_AsDouble(arguments[6]), dt = limits->dt, after = time + dt;
    bool good = !PyErr_Occurred() && vector(arguments[7], m, q) && vector(arguments[8], m, sent) &&
                vector(arguments[9], m, position) && vector(arguments[10], m, velocity) &&
                vector(arguments[11], m, acceleration) && vector(arguments[12], m, command) &&
                !(by_twist && !vector(arguments[3], 6, twist));
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
        if (towards_twist(limits, loop, kept, twist, position, velocity, v) == HAND_BACK)
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
    bool changed = false;
    for (int j = 0; j < m && !shape; j++) {
        double a = (v[j] - velocity[j]) / dt;
        allowed[j] = within_limits(limits, j, position[j], velocity[j], acceleration[j], a);
        changed = changed || !(fabs(allowed[j] - a) <= ROUNDING * limits->jerk[j] * dt);
    }
    for (int j = 0; j < m && changed; j++)
        v[j] = velocity[j] + dt * allowed[j];
    late = late || (changed && !by_twist);
    int which;
    double share = allowed_share(loop, position, v, &which);
    if (share < 1.0 && shape)
        Py_RETURN_NONE;
    late = late || (share < 1.0 && !by_twist);
    for (int j = 0; j < m; j++) {
        v[j] *= share;
        if (!commanded(&course, j, q[j], sent[j] - q[j], v[j], command[j], &command[j]))
            Py_RETURN_NONE;
        position[j] += dt * v[j];
        acceleration[j] = (v[j] - velocity[j]) / dt;
        velocity[j] = v[j];
    }
    PyObject *way = joins ? new_matrix(6, m, m, left) : Py_NewRef(Py_None);
    return Py_BuildValue("(NNNNNddNNi)", new_vector(m, position), new_vector(m, velocity), new_vector(m, acceleration),
                         new_vector(m, command), new_vector(m, q), now[0][m], then[0][m], PyBool_FromLong(late), way, which);
}
