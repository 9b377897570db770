// Rigid motions, and an open chain of joints: its tool pose and joint twists. Everything is in the base frame.
//
//     T(q) = exp(q_1 S_1) ... exp(q_m S_m) home,     J_i = Ad(exp(q_1 S_1) ... exp(q_i-1 S_i-1)) S_i
//
// Conventions as in geometry/se3.py and [DS] Sect. 2: poses map tool coordinates to base coordinates, twists (omega; v).
#pragma once
#include "matrix.hpp"
#include "tolerances.hpp"
#include <array>

namespace iq {

constexpr double SMALL_ANGLE = 1e-2;  // below it [rad], series are exact to rounding, and closed coefficients are not

using Vec3 = std::array<double, 3>;
using Mat3 = std::array<Vec3, 3>;  // by rows

inline double dot(const Vec3& a, const Vec3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline double norm(const Vec3& a) { return std::sqrt(dot(a, a)); }
inline Vec3 cross(const Vec3& a, const Vec3& b)
{
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline Vec3 operator+(const Vec3& a, const Vec3& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
inline Vec3 operator-(const Vec3& a, const Vec3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline Vec3 operator*(double s, const Vec3& a) { return {s * a[0], s * a[1], s * a[2]}; }

inline Vec3 operator*(const Mat3& A, const Vec3& x) { return {dot(A[0], x), dot(A[1], x), dot(A[2], x)}; }
inline Mat3 operator*(const Mat3& A, const Mat3& B)
{
    Mat3 C;
    for (int i = 0; i < 3; i++)
        C[i] = A[i][0] * B[0] + A[i][1] * B[1] + A[i][2] * B[2];
    return C;
}
inline Mat3 transposed(const Mat3& A)
{
    return {{{A[0][0], A[1][0], A[2][0]}, {A[0][1], A[1][1], A[2][1]}, {A[0][2], A[1][2], A[2][2]}}};
}

constexpr int POSE_NUMBERS = 16;  // of a (4, 4) matrix, row by row

// A rigid motion x -> R x + p.
struct Pose {
    Mat3 R{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    Vec3 p{0, 0, 0};

    Pose() = default;
    Pose(const Mat3& R, const Vec3& p) : R(R), p(p) {}
    // From and to POSE_NUMBERS.
    explicit Pose(const double* H)
    {
        for (int i = 0; i < 3; i++)
            R[i] = {H[4 * i], H[4 * i + 1], H[4 * i + 2]}, p[i] = H[4 * i + 3];
    }
    void write(double* H) const
    {
        for (int i = 0; i < 3; i++, H += 4)
            H[0] = R[i][0], H[1] = R[i][1], H[2] = R[i][2], H[3] = p[i];
        H[0] = H[1] = H[2] = 0, H[3] = 1;
    }
};
inline Pose operator*(const Pose& A, const Pose& B) { return {A.R * B.R, A.R * B.p + A.p}; }
// Where a point of the moved frame is.
inline Vec3 operator*(const Pose& T, const Vec3& point) { return T.R * point + T.p; }
inline Pose inverse(const Pose& T)
{
    const Mat3 R = transposed(T.R);
    return {R, -1 * (R * T.p)};
}
// The nearest rotation in place of one that is within 1e-5 of it, by steps of Newton.
inline Pose with_rotation(Pose T)
{
    for (int step = 0; step < 2; step++) {
        Mat3 off = T.R * transposed(T.R);
        double most = 0;
        for (int i = 0; i < 3; i++) {
            off[i][i] -= 1;
            for (const double x : off[i])
                most = std::max(most, std::abs(x));
        }
        if (!(most > TERM_ROUNDING))
            break;
        const Mat3 change = off * T.R;
        for (int i = 0; i < 3; i++)
            T.R[i] = T.R[i] - 0.5 * change[i];
    }
    return T;
}

struct Twist {
    Vec3 omega, v;  // [rad; length], of a unit of time
};

inline Vec vec(const Vec3& a, Workspace& w)
{
    Vec v(w, 3);
    std::copy(a.begin(), a.end(), v.p);
    return v;
}
inline Vec3 vec3(Vec v) { return {v[0], v[1], v[2]}; }
inline Vec vec(const Twist& s, Workspace& w) { return joined(vec(s.omega, w), vec(s.v, w)); }

// The axis of a rotation times its angle in [0, pi], by its unit quaternion (Shepperd's method). At pi exactly the axis
// is determined up to its sign: rounding chooses, and a loop keeps the turn of the tick before (control/tracking.py).
inline Vec3 rotation_vector(const Mat3& R)
{
    const double diagonal[4] = {R[0][0], R[1][1], R[2][2], R[0][0] + R[1][1] + R[2][2]};
    int largest = 3;
    for (int i = 2; i >= 0; i--)
        if (diagonal[i] > diagonal[largest])
            largest = i;
    Vec3 v;
    double w = 1 + diagonal[3];
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        const double odd = R[k][j] - R[j][k];
        v[i] = largest == 3 ? odd : largest == i ? 1 + R[i][i] - R[j][j] - R[k][k] : R[i][largest] + R[largest][i];
        if (largest == i)
            w = odd;
    }
    const double sine = norm(v), n = std::sqrt(sine * sine + w * w);
    // (w; v) and -(w; v) are the same rotation.
    return n > 0 ? std::copysign(2 * std::atan2(sine, std::abs(w)) / (sine > 0 ? sine : 1), w) * v : v;
}
// The twist whose motion in unit time is T, of an angle in [0, pi].
inline Twist log(const Pose& T)
{
    const Vec3 w = rotation_vector(T.R), wp = cross(w, T.p);
    const double theta = norm(w), square = theta * theta;
    const double c = theta < SMALL_ANGLE ? (1 + square / 60 * (1 + square / 42)) / 12
                                         : (1 - 0.5 * theta / std::tan(0.5 * theta)) / square;
    return {w, T.p - 0.5 * wp + c * cross(w, wp)};
}
// The twist that takes a tool to its target in unit time; the same whatever point of the body is the tool.
inline Twist error_twist(const Pose& target, const Pose& tool) { return log(target * inverse(tool)); }

// The rotation by a rotation vector.
inline Mat3 rotation(const Vec3& omega)
{
    const double angle = norm(omega);
    Mat3 R{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    if (angle == 0)
        return R;
    const Vec3 n = (1 / angle) * omega;
    const double half = std::sin(0.5 * angle), sine = std::sin(angle), versine = 2 * half * half;
    for (int i = 0; i < 3; i++) {  // r (1 + sin t [n]x + (1 - cos t) [n]x^2) of each row
        const Vec3 once = cross(R[i], n);
        R[i] = R[i] + sine * once + versine * cross(once, n);
    }
    return R;
}
constexpr double NEARLY_HALF_TURN = 0.8 * M_PI;  // larger rotations [rad] keep the sense of the last tick
// The factor that gives a rotation vector the sense of the last one, if it is nearly half a turn; else 1.
inline double sense_factor(const Vec3& omega, const Vec3& before)
{
    const double angle = norm(omega);
    return angle > NEARLY_HALF_TURN && dot(before, omega) < 0 ? (angle - 2 * M_PI) / angle : 1;
}

// An open chain of hinges, slides and screws. A value: copies share nothing, and none changes after it was made.
// Several joints may share a coordinate: those of a parallelogram, for instance.
class Chain {
  public:
    Pose home;  // the tool pose at q = 0

    // screws (6, k): joint twists at q = 0, base first; home: the tool pose there.
    Chain(Mat screws, const Pose& home) : home(home), joints(screws.cols), coordinates(screws.cols)
    {
        for (int i = 0; i < screws.cols; i++) {
            const Vec3 w{screws(0, i), screws(1, i), screws(2, i)}, v{screws(3, i), screws(4, i), screws(5, i)};
            const double rate = norm(w), share = rate > 0 ? 1 / rate : 1;
            joints[i] = {rate, share * w, share * v, dot(share * w, share * v), i};
        }
    }
    // The coordinate of each joint, all of 0 to the largest.
    void couple(const std::vector<int>& coordinate)
    {
        coordinates = 0;
        for (int i = 0; i < count(); i++)
            joints[i].coordinate = coordinate[i], coordinates = std::max(coordinates, coordinate[i] + 1);
    }
    // Coordinates and joints.
    int size() const { return coordinates; }
    int count() const { return static_cast<int>(joints.size()); }

    // The tool pose at q (m,).
    Pose pose(const double* q) const { return state(q, Mat()); }
    // The tool pose, and joint twists as columns of J (6, m).
    Pose state(const double* q, Mat J) const
    {
        Pose T;
        clear(J);
        for (const Joint& joint : joints)
            advance(T, joint, q, J);
        return T * home;
    }
    // The displacements exp(q_1 S_1) ... exp(q_i S_i) of the links from q = 0, for i = 0, the base, to the last joint.
    // Returns the tool pose.
    Pose motions(const double* q, Mat J, Pose* motions) const
    {
        Pose T;
        *motions = T;
        clear(J);
        for (const Joint& joint : joints) {
            advance(T, joint, q, J);
            *++motions = T;
        }
        return T * home;
    }

  private:
    struct Joint {
        double rate;  // |omega|, 0 of a slide
        Vec3 n, u;    // omega and v, of unit rate
        double pitch; // n.u
        int coordinate;
    };
    std::vector<Joint> joints;
    int coordinates;

    void clear(Mat J) const
    {
        if (J.p && coordinates < count())
            J.all().fill(0);
    }
    // T exp(q S) = T (1 + sin t U + (1 - cos t) U^2 + (t - sin t) U^3),  U = S / |omega|,  t = |omega| q;  and J_i = Ad(T) S.
    void advance(Pose& T, const Joint& joint, const double* at, Mat J) const
    {
        const int i = joint.coordinate;
        const double q = at[i], rate = joint.rate > 0 ? joint.rate : 1;
        const Vec3 axis = T.R * joint.n, drift = T.R * joint.u;
        if (J.p) {
            const Vec3 moved = drift + cross(T.p, axis);
            for (int k = 0; k < 3; k++) {
                J(k, i) = rate * axis[k] + (coordinates < count() ? J(k, i) : 0);
                J(3 + k, i) = rate * moved[k] + (coordinates < count() ? J(3 + k, i) : 0);
            }
        }
        if (joint.rate == 0) {
            T.p = T.p + q * drift;
            return;
        }
        const double angle = rate * q, half = std::sin(0.5 * angle), sine = 2 * half * std::cos(0.5 * angle);
        const double versine = 2 * half * half;
        T.p = T.p + sine * drift + versine * cross(axis, drift) + ((angle - sine) * joint.pitch) * axis;
        for (int k = 0; k < 3; k++) {  // r (1 + sin t [n]x + (1 - cos t) [n]x^2) of each row r of R
            const Vec3 across = cross(T.R[k], joint.n);
            T.R[k] = T.R[k] + sine * across + versine * cross(across, joint.n);
        }
    }
};

}  // namespace iq
