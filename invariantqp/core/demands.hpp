// Exact demands on the tool: parts D of its twist, and their values
//
//     twist    omega; v = gain log(T_d T^-1) + twist_d                whole, so that limits scale it
//     point    v + omega x p = gain (p_d - p) + v_d(p_d)              a point of the tool
//     axis     omega without its part about the axis a                a direction of the tool
//     plane    n.(v + omega x p) = gain n.(p_d - p) + n.v_d(p_d)      a point and the normal of its plane
//     joints   A x = b as it is
#pragma once
#include "target.hpp"

namespace iq {

struct Demand {
    // The first three by the numbers that pose/ik.py gives them.
    enum class Kind { point, axis, plane, joints, twist } kind;
    Vec3 point{}, direction{};  // in the tool frame, a plane's normal in the base frame
    std::vector<double> row;    // (m,) of `joints`
    double speed = 0;           // likewise

    int rows() const { return kind == Kind::twist ? 6 : kind == Kind::point ? 3 : kind == Kind::axis ? 2 : 1; }
};

// Rows E x = E_f + E_e: the feedforward, and the gain times the error.
struct DemandRows {
    Mat E, D;
    Vec E_f, E_e;
    int count = 0;

    DemandRows(Workspace& w, int rows, int m) : E(w, rows, m, 0), D(w, rows, 6, 0), E_f(w, rows, 0), E_e(w, rows, 0) {}

    // error: error twist; feedforward: twist of the target, in the base frame; also: share of the feedforward that is added
    // to the part of the gain, for the delay.
    void add(const Demand& demand, Mat J, const Pose& tool, const Pose& target, double gain, const Twist& error,
             const Twist& feedforward, double also)
    {
        const int first = count;
        if (demand.kind == Demand::Kind::twist) {
            for (int i = 0; i < 3; i++) {
                D(first + i, i) = D(first + 3 + i, 3 + i) = 1;
                E_f[first + i] = feedforward.omega[i], E_e[first + i] = gain * error.omega[i] + also * feedforward.omega[i];
                E_f[first + 3 + i] = feedforward.v[i], E_e[first + 3 + i] = gain * error.v[i] + also * feedforward.v[i];
            }
            count += 6;
            E.rows_from(first, count).set(J);
            return;
        }
        if (demand.kind == Demand::Kind::joints) {
            std::copy(demand.row.begin(), demand.row.end(), E[count].p);
            E_f[count++] = demand.speed;
            return;
        }
        if (demand.kind == Demand::Kind::axis)
            axis(tool.R * demand.direction, target.R * demand.direction, gain, feedforward.omega, also);
        else {
            const Vec3 here = tool * demand.point, there = target * demand.point, moves = feedforward.v + cross(feedforward.omega, there);
            if (demand.kind == Demand::Kind::plane)
                along(demand.direction, here, gain * (there - here), moves, also);
            else
                for (int i = 0; i < 3; i++) {
                    Vec3 e{0, 0, 0};
                    e[i] = 1;
                    along(e, here, gain * (there - here), moves, also);
                }
        }
        E.rows_from(first, count).set(D.rows_from(first, count) * J);
    }

  private:
    // The velocity of a point of the tool along a direction.
    void along(const Vec3& n, const Vec3& here, const Vec3& approach, const Vec3& moves, double also)
    {
        const Vec3 turn = cross(here, n);  // n.(v + omega x p) = n.v + (p x n).omega
        for (int i = 0; i < 3; i++)
            D(count, i) = turn[i], D(count, 3 + i) = n[i];
        E_f[count] = dot(n, moves), E_e[count++] = dot(n, approach) + also * dot(n, moves);
    }
    // The angular velocity across an axis, along two directions across it.
    void axis(const Vec3& here, const Vec3& there, double gain, const Vec3& moves, double also)
    {
        const Vec3 first = across(here), second = cross(here, first), whole = shortest_turn(here, there, first);
        for (const Vec3& d : {first, second}) {
            for (int i = 0; i < 3; i++)
                D(count, i) = d[i];
            E_f[count] = dot(d, moves), E_e[count++] = gain * dot(d, whole) + also * dot(d, moves);
        }
    }
};

}  // namespace iq
