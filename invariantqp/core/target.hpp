// A target with free degrees of freedom: a point of the tool at a point, an axis of the tool along a direction, or both.
// In the base frame unless stated otherwise.
//
//     omega   the shortest rotation that takes the axis to its direction, 0 where the orientation is free
//     v_a     from the point a of the tool to where it is to be, 0 where the position is free
//
// Constrained are the angular velocity across the axis and the velocity of the point.
#pragma once
#include "chain.hpp"
#include "measure.hpp"

namespace iq {

// A unit vector across another one.
inline Vec3 across(const Vec3& axis)
{
    int least = 0;
    for (int i = 1; i < 3; i++)
        least = std::abs(axis[i]) < std::abs(axis[least]) ? i : least;
    Vec3 other{0, 0, 0};
    other[least] = 1;
    const Vec3 found = cross(axis, other);
    return (1 / norm(found)) * found;
}
// The shortest rotation from one unit vector to another, as an axis times its angle; of opposite ones about `half`, a unit
// vector across them.
inline Vec3 shortest_turn(const Vec3& here, const Vec3& there, const Vec3& half)
{
    const Vec3 turn = cross(here, there);
    const double sine = norm(turn), cosine = dot(here, there);
    return sine > TERM_ROUNDING ? (std::atan2(sine, cosine) / sine) * turn : cosine < 0 ? M_PI * half : turn;
}

struct PartialTarget {
    bool has_point = false, has_axis = false;
    Vec3 point{}, axis{};                   // where the tool's point is to be, and where its axis, a unit vector, is to point
    Vec3 tool_point{}, tool_axis{0, 0, 1};  // in the tool frame, a unit vector

    // The error twist; `before`: rotation of the last error, 0 for none.
    Twist error(const Pose& tool, const Vec3& before) const
    {
        const Vec3 omega = has_axis ? turn(tool.R * tool_axis, tool.R * across(tool_axis), before) : Vec3{0, 0, 0};
        return {omega, off(tool) - cross(omega, tool * tool_point)};
    }
    // From the tool's point to where it is to be, 0 where that is free.
    Vec3 off(const Pose& tool) const { return has_point ? point - tool * tool_point : Vec3{0, 0, 0}; }
    // The pose where a displacement as above ends.
    Pose reached(const Pose& tool, const Twist& error) const
    {
        const Mat3 R = rotation(error.omega) * tool.R;
        return {R, (has_point ? point : tool * tool_point) - R * tool_point};
    }

    // The constrained part of a twist, without motion in the free directions.
    Vec part(Vec s, const Pose& tool) const
    {
        Workspace& w = *s.w;
        const Vec a = vec(tool * tool_point, w), n = vec(tool.R * tool_axis, w), omega = s.part(0, 3);
        const Vec turns = has_axis ? omega - omega.dot(n) * n : Vec(w, 3, 0);
        const Vec moves = has_point ? velocity_at(s, a) : Vec(w, 3, 0);
        return joined(turns, moves - cross(turns, a));
    }
    int turns() const { return has_axis ? 2 : 0; }
    // (k, 6) the measure of that part, at the point with a length: first rows that measure turns.
    Mat root(const Pose& tool, double length, Workspace& w) const
    {
        Mat found(w, turns() + (has_point ? 3 : 0), 6, 0);
        if (has_axis) {
            const Vec3 n = tool.R * tool_axis, first = tool.R * across(tool_axis), second = cross(n, first);
            for (int i = 0; i < 3; i++)
                found(0, i) = length * first[i], found(1, i) = length * second[i];
        }
        if (has_point)
            found.rows_from(turns(), found.rows).set(root_at(vec(tool * tool_point, w), 1).rows_from(3, 6));
        return found;
    }
    // The same of another measure (6, 6): |root s| is the least size of a twist of the same part as s.
    Mat root_of(Mat measure, const Pose& tool) const
    {
        Workspace& w = *measure.w;
        const Vec3 a = tool * tool_point, n = tool.R * tool_axis;
        Mat free(w, (has_axis ? 1 : 3) + (has_point ? 0 : 3), 6, 0);  // rows: twists that count as nothing
        int k = 0;
        for (int i = 0; i < (has_axis ? 1 : 3); i++, k++) {
            Vec3 omega = n;
            if (!has_axis)
                omega = {0, 0, 0}, omega[i] = 1;
            free[k].set(vec(Twist{omega, cross(a, omega)}, w));
        }
        for (int i = 0; k < free.rows; i++, k++)
            free(k, 3 + i) = 1;
        const Mat across = RQ(free * t(measure)).basis().rows_from(0, 6 - free.rows);
        return across * measure;
    }

  private:
    Vec3 turn(const Vec3& here, const Vec3& half, const Vec3& before) const
    {
        Vec3 half_turn = before - dot(before, here) * here;  // for opposite directions: about the last axis
        const double size = norm(half_turn);
        half_turn = size > 0.5 * norm(before) && size > 0 ? (1 / size) * half_turn : half;
        const Vec3 found = shortest_turn(here, axis, half_turn);
        return sense_factor(found, before) * found;
    }
};

}  // namespace iq
