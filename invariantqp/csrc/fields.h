/* What Python hands the core, by name: one line a field, from which come the struct here, the parser (fields.c), and the
   stub that type checkers read (stub.py).

       NUMBER(name, default, meaning)             a float
       COUNT(name, default, meaning)              an int
       FLAG(name, default, meaning)               True or False
       WORD(name, words, default, meaning)        one of some words; the number in C is its place among them
       LENGTH(name, most, meaning)                a length that arrays tell by their shapes
       VECTOR(name, n, default, meaning)          (n,) float64
       MATRIX(name, rows, columns, default, meaning)
       MAYBE_VECTOR(name, n, given, meaning)      likewise, or None; `given` says which, and it is zero then
       MAYBE_MATRIX(name, rows, columns, given, meaning)
       OBJECT(name, type, meaning)                an object of another of these tables
       OBJECTS(name, type, length, meaning)       a tuple of them

   NEEDED is no default. In a matrix without a default that is not given, no row is read. */

#ifndef FIELDS_H
#define FIELDS_H

#include <stdbool.h>
#include <stddef.h>

/* More joints than this are Python's. */
#define MOST 16
/* More rows that limit joint velocities than this are Python's. */
#define MOST_LIMITS 32
/* More exact rows than this are Python's. */
#define MOST_ROWS 8

/* (rows, MOST) row by row; only the first n columns are used. */
typedef double Row[MOST];

typedef enum { LEAST_SQUARES, PITCH, COMPLEMENT, BROUGHT } FormKind;
#define FORM_WORDS "least squares", "pitch", "complement", "brought"
/* control/demands.py: a point or a direction of the tool, the direction of a plane's normal, or a row on the joints */
typedef enum { POINT, AXIS, PLANE, JOINTS } Kind;
#define KIND_WORDS "point", "axis", "plane", "joints"
typedef enum { AT_A_POINT, BY_THE_BASE, BY_THE_TOOL } Carrier;
#define CARRIER_WORDS "nothing", "base", "tool"
/* force/contact.py: what a task does about a contact that is lost */
typedef enum { APPROACHES, HOLDS, RETREATS, CONTINUES } OnLoss;
#define LOSS_WORDS "approach", "hold", "retreat", "continue"

/* law.py: the part of the law that does not change from tick to tick. x = T y with T'MT = I for a joint metric M. */
#define LAW_FIELDS \
    LENGTH(joints, MOST, "joints, where a metric tells them") \
    LENGTH(twists, 6, "twists of a complement") \
    NUMBER(threshold, 0.0, "of damping: the share of the largest singular value below which it begins") \
    NUMBER(ceiling, 0.0, "of damping: the share of the largest singular value that it ends at") \
    NUMBER(fixed, 0.0, "damping everywhere [length]") \
    NUMBER(speed, 0.0, "the joint speed from which one direction is damped by itself; 0 is none") \
    NUMBER(dt, 0.0, "how long a velocity is held [s]") \
    WORD(form, FORM_WORDS, LEAST_SQUARES, "what is attempted of a twist beyond the joints") \
    NUMBER(pitch, 0.0, "of a pitch form [length/rad]") \
    NUMBER(fraction, -1.0, "of the descent guard; -1 is none") \
    MATRIX(Z, twists, 6, NOTHING, "twists along which a complement projects") \
    MAYBE_MATRIX(T, joints, joints, has_metric, "from y to joint velocities") \
    MATRIX(inverse, joints, joints, NOTHING, "of T")

/* control/demands.py: one exact demand of a loop. */
#define WANTED_FIELDS \
    LENGTH(joints, MOST, "joints") \
    WORD(kind, KIND_WORDS, NEEDED, "what is met") \
    VECTOR(point, 3, DEFAULT(0.0), "of the tool [length]") \
    VECTOR(direction, 3, DEFAULT(0.0), "an axis of the tool, or the normal of a plane") \
    VECTOR(row, joints, DEFAULT(0.0), "on the joint velocity") \
    NUMBER(speed, 0.0, "that the row asks for")

/* control/controller.py: what does not change from tick to tick of a loop. */
#define LOOP_FIELDS \
    LENGTH(joints, MOST, "joints") \
    LENGTH(wanted, MOST_ROWS, "exact demands") \
    LENGTH(limits, MOST_LIMITS, "fixed rows that limit the joint velocity") \
    OBJECT(law, Law, "of its ticks") \
    MATRIX(screws, 6, joints, NEEDED, "joint twists at q = 0") \
    MATRIX(home, 4, 4, NEEDED, "tool pose at q = 0") \
    NUMBER(dt, NEEDED, "tick [s]") \
    NUMBER(gain, NEEDED, "of the error [1/s]") \
    NUMBER(rate, NEEDED, "at which position limits are approached [1/s]") \
    NUMBER(delay, 0.0, "until a command shows, beyond one tick [s]") \
    VECTOR(point, 3, DEFAULT(0.0), "of the tool, where the error is measured [length]") \
    NUMBER(length, 1.0, "what a radian counts as there [length]") \
    WORD(carried, CARRIER_WORDS, AT_A_POINT, "a metric instead of a point, fixed to the base or the tool") \
    MATRIX(root, 6, 6, NOTHING, "of that metric") \
    NUMBER(slack, 0.0, "of a chase: a measured twist that counts as nothing") \
    MAYBE_VECTOR(posture, joints, has_posture, "joint positions to be near where joints are free") \
    VECTOR(pull, joints, DEFAULT(0.0), "gains of the posture [1/s]") \
    VECTOR(change, joints, DEFAULT(INFINITY), "by how much it may change joint velocities in a tick") \
    VECTOR(position_lower, joints, NEEDED, "[rad, length]") \
    VECTOR(position_upper, joints, NEEDED, "[rad, length]") \
    VECTOR(turns, joints, DEFAULT(0.0), "a whole turn of continuous joints, 0 of others") \
    VECTOR(beyond, joints, NEEDED, "how far outside it a joint's position is believed") \
    VECTOR(tip, 3, DEFAULT(0.0), "where the tool is in the middle of the joint range [length]") \
    NUMBER(far, INFINITY, "how far away from there a target is believed [length]") \
    VECTOR(fastest, joints, NEEDED, "joint speeds [rad/s, length/s]") \
    MAYBE_VECTOR(acceleration, joints, has_braking, "limits of acceleration") \
    VECTOR(brakes, joints, DEFAULT(INFINITY), "accelerations at which joints stop, whoever limits them") \
    NUMBER(rise, 0.0, "in which they are had [s]") \
    VECTOR(fast, 3, DEFAULT(0.0), "of the tool, a point whose speed is limited [length]") \
    NUMBER(speed_limit, 0.0, "of that point [length/s]; 0 is none") \
    OBJECTS(exact, Wanted, wanted, "what is met exactly") \
    COUNT(row_rank, -1, "how many exact rows the arm can keep in its best state; -1 is all") \
    MATRIX(G, limits, joints, NOTHING, "rows of limits, least <= G x <= most") \
    VECTOR(least, limits, NOTHING, "-inf where there is none") \
    VECTOR(most, limits, NOTHING, "inf where there is none") \
    TUPLE(joint_names, NOTHING, "of its joints, which its answers have") \
    TUPLE(row_names, NOTHING, "of those rows, likewise")

/* control/limits.py: what of a loop is other in this tick than it was made with. */
#define NOW_FIELDS \
    LENGTH(joints, MOST, "joints") \
    LENGTH(limits, MOST_LIMITS, "rows of limits") \
    MATRIX(G, limits, joints, NOTHING, "rows of limits in place of the loop's, least <= G x <= most") \
    VECTOR(least, limits, NOTHING, "-inf where there is none") \
    VECTOR(most, limits, NOTHING, "inf where there is none") \
    TUPLE(row_names, NOTHING, "of these") \
    NUMBER(speed, 1.0, "share of the motion's speed, above 0") \
    FLAG(at_base, false, "whether a twist is a screw in base coordinates, and not the tool point's") \
    MAYBE_VECTOR(velocity_limit, joints, has_velocity_limit, "joint speeds, where they are lower than the loop's") \
    NUMBER(tool_speed, INFINITY, "of the limited point [length/s], likewise") \
    MAYBE_MATRIX(brought, 6, 6, has_brought, "the matrix of a form that is brought, on measured twists") \
    MAYBE_VECTOR(posture, joints, has_posture, "joint velocity wanted where the twist leaves joints free")

/* law.py: the input of a tick, a Demand (core.h); `chase_ahead` is `chase.ahead` there. */
#define TICK_FIELDS \
    LENGTH(m, MOST, "joints") \
    LENGTH(rows, MOST_ROWS, "exact rows") \
    LENGTH(limits, MOST_LIMITS, "rows of limits") \
    MATRIX(J, 6, m, NEEDED, "joint twists") \
    VECTOR(s, 6, NEEDED, "wanted twist") \
    MAYBE_MATRIX(root, 6, 6, has_root, "of the measure; None is by point and length, and sizes are checked") \
    MAYBE_VECTOR(point, 3, has_point, "where twists are measured; None is the arm's own point") \
    NUMBER(length, 0.0, "what a radian counts as there; 0 is the arm's reach") \
    VECTOR(lower, m, NEEDED, "bounds of the joint velocity") \
    VECTOR(upper, m, NEEDED, "likewise") \
    MAYBE_VECTOR(posture, m, has_posture, "joint velocity wanted where the twist leaves joints free") \
    MAYBE_VECTOR(fastest, m, paced, "joint speeds, for a posture that rests while the task rests") \
    MAYBE_VECTOR(before, m, has_before, "joint velocities of the tick before, from which it sets in by and by") \
    VECTOR(change, m, DEFAULT(INFINITY), "by how much it may change them in a tick") \
    MATRIX(C, rows, m, NOTHING, "exact rows, C x = e") \
    VECTOR(e, rows, NOTHING, "their demands") \
    MAYBE_MATRIX(D, rows, 6, of_twist, "C = D J, where D is not zero") \
    COUNT(row_rank, -1, "how many exact rows the arm can keep in its best state; -1 is all") \
    NUMBER(held, 0.0, "how much longer than the law's dt the velocity is held [s]") \
    MATRIX(G, limits, m, NOTHING, "rows of limits, least <= G x <= most") \
    VECTOR(least, limits, NOTHING, "-inf where there is none") \
    VECTOR(most, limits, NOTHING, "inf where there is none") \
    NUMBER(cone.limit, 0.0, "speed of a point, |cone_start + cone_J x| <= cone_limit; 0 is none") \
    VECTOR(cone.start, 3, DEFAULT(0.0), "likewise") \
    MATRIX(cone.J, 3, m, NOTHING, "likewise") \
    MAYBE_VECTOR(chase.ahead, 6, chased, "what of s closes no error; None is a twist by itself") \
    VECTOR(chase.rows_ahead, rows, NOTHING, "what the exact rows demand for chase_ahead") \
    VECTOR(chase.lower, m, NOTHING, "bounds of the joint velocity by position limits alone") \
    VECTOR(chase.upper, m, NOTHING, "likewise") \
    NUMBER(chase.slack, 0.0, "a measured twist that counts as nothing") \
    FLAG(chase.apart, false, "whether the measure tells position and angle apart") \
    MAYBE_MATRIX(brought, 6, 6, has_brought, "the matrix of a form that is brought, on measured twists")

/* The structs. A length that is a field has room for as many as it may be. */
#define ROOM_3 3
#define ROOM_4 4
#define ROOM_6 6
#define ROOM_n 6
#define ROOM_joints MOST
#define ROOM_m MOST
#define ROOM_wanted MOST_ROWS
#define ROOM_rows MOST_ROWS
#define ROOM_limits MOST_LIMITS
#define ROOM_twists 6

#define NUMBER(name, ...) double name;
#define COUNT(name, ...) int name;
#define FLAG(name, ...) bool name;
#define WORD(name, ...) int name;
#define LENGTH(name, ...) int name;
#define VECTOR(name, n, ...) double name[ROOM_##n];
#define MATRIX(name, rows, columns, ...) double name[ROOM_##rows][ROOM_##columns];
#define MAYBE_VECTOR(name, n, given, ...) bool given; double name[ROOM_##n];
#define MAYBE_MATRIX(name, rows, columns, given, ...) bool given; double name[ROOM_##rows][ROOM_##columns];
#define TUPLE(name, ...) void *name;
#define OBJECT(name, type, ...) type name;
#define OBJECTS(name, type, length, ...) type name[ROOM_##length];
typedef struct { LAW_FIELDS } Law;
typedef struct { WANTED_FIELDS } Wanted;
typedef struct { LOOP_FIELDS } Loop;
typedef struct { NOW_FIELDS } Now;
#undef TUPLE
#undef NUMBER
#undef COUNT
#undef FLAG
#undef WORD
#undef LENGTH
#undef VECTOR
#undef MATRIX
#undef MAYBE_VECTOR
#undef MAYBE_MATRIX
#undef OBJECT
#undef OBJECTS

#endif
