// Shared by the bindings of loops.
#pragma once
#include "bound.hpp"
#include "loop.hpp"
#include "target_module.hpp"
#include <nanobind/stl/string.h>

namespace iq {

constexpr double ROTATION_TOLERANCE = 1e-5;  // as in geometry/arrays.py

inline Pose read_pose(nb::handle value, const char* name, Reader& read)
{
    nb::object matrix = nb::borrow(value);
    if (!PyArray_Check(value.ptr())) {
        if (nb::hasattr(value, "homogeneous"))
            matrix = value.attr("homogeneous");
        else if (nb::hasattr(value, "pose"))
            matrix = value.attr("pose");
    }
    const Mat H = read.matrix(matrix, name, 4, 4);
    const Pose T(H.p);
    const Mat3 off = T.R * transposed(T.R);
    bool turns = H(3, 0) == 0 && H(3, 1) == 0 && H(3, 2) == 0 && H(3, 3) == 1 && dot(cross(T.R[0], T.R[1]), T.R[2]) > 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            turns = turns && std::abs(off[i][j] - (i == j)) <= ROTATION_TOLERANCE;
    if (!turns)
        refuse(std::string(name) + " is no rigid motion");
    return with_rotation(T);
}

inline nb::object array_of(const Pose& T)
{
    const npy_intp shape[2] = {4, 4};
    const nb::object array = new_array(2, shape);
    T.write(data_of(array));
    return array;
}

// Settings by name.
class Fields {
  public:
    Fields(nb::dict given, Reader& read, int m) : given(given), read(read), m(m) {}

    bool has(const char* name) const { return given.contains(name) && !given[name].is_none(); }
    nb::object operator[](const char* name) const
    {
        if (!given.contains(name))
            refuse(std::string(name) + " is missing");
        return nb::borrow(given[name]);
    }
    double number(const char* name, double least, double most) const { return iq::number((*this)[name], name, least, most); }
    // n numbers, infinite ones too; empty where there are none.
    std::vector<double> numbers(const char* name, int n) const
    {
        if (!has(name))
            return {};
        const Vec v = read.vector((*this)[name], name, n, Numbers::any);
        return {v.begin(), v.end()};
    }
    std::vector<double> numbers(const char* name) const { return required(name, numbers(name, m)); }
    std::vector<double> matrix(const char* name, int rows, int cols) const
    {
        if (!has(name))
            return {};
        const Vec v = read.matrix((*this)[name], name, rows, cols).all();
        return {v.begin(), v.end()};
    }
    Vec3 point(const char* name) const
    {
        return vec3(read.vector((*this)[name], name, 3));
    }
    Pose pose(const char* name) const { return read_pose((*this)[name], name, read); }
    std::string word(const char* name) const
    {
        std::string s;
        if (!nb::try_cast((*this)[name], s))
            refuse(std::string(name) + " is no word");
        return s;
    }

  private:
    nb::dict given;
    Reader& read;
    int m;

    static std::vector<double> required(const char* name, std::vector<double> found)
    {
        if (found.empty())
            refuse(std::string(name) + " is missing");
        return found;
    }
};

// The functions (arm, limits, exact, law) of the user's, as `Callbacks` gives them, or None; they read into a workspace.
LoopFunctions loop_functions(nb::handle given, Reader& read, int m, Workspace& w);
// The fields of a solution; where functions were asked, also where its rows come from, and what of limits does not hold.
nb::object loop_solution(const LoopReport& found, const LoopFunctions& functions, bool asked);

}  // namespace iq
