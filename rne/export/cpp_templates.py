"""Texts of a C++ package; words between signs of per cent are filled in."""

CONSTANTS = """inline constexpr std::size_t joints = %JOINTS%;
using Vector = std::array<%REAL%, joints>; // a number for each joint, in the order of joint_names
using Matrix = std::array<%REAL%, joints * joints>; // row by row: entry (i, j) is at [joints * i + j]
inline constexpr std::array<const char*, joints> joint_names{{%NAMES%}};
// Limits of the robot's file, infinite where it has none.
inline constexpr Vector lower_limits{{%LOWER%}}; // %POSITIONS%
inline constexpr Vector upper_limits{{%UPPER%}}; // %POSITIONS%
inline constexpr Vector velocity_limits{{%VELOCITY%}}; // %RATES%
inline constexpr Vector effort_limits{{%EFFORT%}}; // %TORQUES%"""

PAYLOAD = """
// A rigid body on link %LINK%, in the link's frame. Nothing checks that such a body exists: its mass and the
// eigenvalues of its inertia must not be negative.
struct Payload {
    %REAL% mass = 0; // kg
    std::array<%REAL%, 3> com{}; // centre of mass, m
    %REAL% ixx = 0, ixy = 0, ixz = 0, iyy = 0, iyz = 0, izz = 0; // about the centre of mass, kg m^2
};"""
MEMBERS = ("Payload", "mass", "com[0]", "com[1]", "com[2]", "ixx", "ixy", "iyy", "ixz", "iyz", "izz")

CMAKE = """cmake_minimum_required(VERSION 3.15)
# written by rne
project(%NAME% VERSION 1.0.0 LANGUAGES CXX)
include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

add_library(%NAME% INTERFACE)
add_library(%NAME%::%NAME% ALIAS %NAME%)
target_compile_features(%NAME% INTERFACE cxx_std_17)
target_include_directories(%NAME% INTERFACE
  $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/include> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)

set(where ${CMAKE_INSTALL_DATADIR}/%NAME%)
write_basic_package_version_file(%NAME%ConfigVersion.cmake COMPATIBILITY SameMajorVersion ARCH_INDEPENDENT)
install(TARGETS %NAME% EXPORT %NAME%Targets)
install(EXPORT %NAME%Targets FILE %NAME%Config.cmake NAMESPACE %NAME%:: DESTINATION ${where}/cmake)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/%NAME%ConfigVersion.cmake DESTINATION ${where}/cmake)
install(DIRECTORY include/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(FILES package.xml DESTINATION ${where})

if(CMAKE_SOURCE_DIR STREQUAL CMAKE_CURRENT_SOURCE_DIR)
  include(CTest)
  file(GLOB programs test/*.cpp example/*.cpp)
  foreach(program ${programs})
    get_filename_component(each ${program} NAME_WE)
    add_executable(${each} ${program})
    target_link_libraries(${each} PRIVATE %NAME%::%NAME%)
    if(NOT MSVC)
      target_compile_options(${each} PRIVATE -Wall -Wextra -Wpedantic -Wconversion)
    endif()
    if(program MATCHES "/test/")
      add_test(NAME ${each} COMMAND ${each})
    endif()
  endforeach()
endif()
"""

PACKAGE = """<?xml version="1.0"?>
<!-- written by rne -->
<package format="3">
  <name>%LOWERCASE%</name>
  <version>1.0.0</version>
  <description>Dynamics of robot %ROBOT%: header-only C++17</description>
  <maintainer email="nobody@example.com">nobody</maintainer>
  <license>unspecified</license>
  <buildtool_depend>cmake</buildtool_depend>
  <export>
    <build_type>cmake</build_type>
  </export>
</package>
"""

READ_ME = """<!-- written by rne -->
# %NAME%

Dynamics of robot %ROBOT%, header-only C++17: `include/%NAME%/%NAME%.hpp`, and with Eigen's vectors
`include/%NAME%/eigen.hpp`.

    cmake -B build -DCMAKE_BUILD_TYPE=Release && cmake --build build && ctest --test-dir build
    cmake --install build --prefix /where/it/goes

In your CMakeLists.txt:

    find_package(%NAME% 1 REQUIRED)
    target_link_libraries(your_program PRIVATE %NAME%::%NAME%)

`colcon build` takes the folder as it is, a plain CMake package. Enter licence and maintainer in package.xml before you
pass it on. `test/numbers.cpp` compares the functions with numbers of the recursion in Python. Do not compile with
-ffast-math: a singular mass matrix could not be detected.
"""

EIGEN = """// written by rne
// The functions of %NAME%.hpp with vectors and matrices of Eigen.
#pragma once
#include <Eigen/Core>
#include <%NAME%/%NAME%.hpp>

namespace %NAME% {
namespace eigen {

template <int rows, int columns = 1>
using Array = Eigen::Matrix<%REAL%, rows, columns, columns == 1 ? Eigen::ColMajor : Eigen::RowMajor>;
template <int rows>
using Given = Eigen::Ref<const Array<rows>>;
using Vector = Array<%JOINTS%>;
using Matrix = Array<%JOINTS%, %JOINTS%>;

template <int rows>
std::array<%REAL%, static_cast<std::size_t>(rows)> to_array(const Given<rows>& x) noexcept
{
    std::array<%REAL%, static_cast<std::size_t>(rows)> found{};
    Eigen::Map<Array<rows>>(found.data()) = x;
    return found;
}

template <int rows, int columns, std::size_t count>
Array<rows, columns> to_eigen(const std::array<%REAL%, count>& x) noexcept
{
    return Eigen::Map<const Array<rows, columns>>(x.data());
}

%FUNCTIONS%
} // namespace eigen
} // namespace %NAME%
"""

NUMBERS = """// written by rne
// Compares %NAME%.hpp with numbers of the recursion in Python: a row of arguments and results for each state.
#include <%NAME%/%NAME%.hpp>
#include <cmath>
#include <cstdio>

namespace {

int failed = 0;

template <std::size_t count>
std::array<%REAL%, count> take(const double* row)
{
    std::array<%REAL%, count> found{};
    for (std::size_t k = 0; k < count; k++)
        found[k] = static_cast<%REAL%>(row[k]);
    return found;
}

template <std::size_t count>
void compare(const char* name, const std::array<%REAL%, count>& found, const double* expected, double tolerance)
{
    double largest = 0, error = 0;
    bool good = true;
    for (std::size_t k = 0; k < count; k++)
        largest = std::fmax(largest, std::fabs(expected[k]));
    for (std::size_t k = 0; k < count; k++) {
        const double own = std::fabs(static_cast<double>(found[k]) - expected[k]);
        good = good && own <= tolerance * largest;
        error = std::fmax(error, own);
    }
    failed += !good;
    std::printf("%s: largest error %.1e of %.3g%s\\n", name, error, largest, good ? "" : ", too large");
}

template <std::size_t count>
void compare(const char* name, const std::optional<std::array<%REAL%, count>>& found, const double* row, double most)
{
    compare(name, found.value_or(std::array<%REAL%, count>{}), row, most);
}

[[maybe_unused]] void compare(const char* name, %REAL% found, const double* row, double tolerance)
{
    compare(name, std::array<%REAL%, 1>{{found}}, row, tolerance);
}
%TAKE_PAYLOAD%
%ROWS%

} // namespace

int main()
{
%CALLS%
    return failed > 0;
}
"""

TAKE_PAYLOAD = """
%NAME%::Payload take_payload(const double* row)
{
    const std::array<%REAL%, 10> x = take<10>(row);
    return {x[0], {{x[1], x[2], x[3]}}, x[4], x[5], x[7], x[6], x[8], x[9]};
}
"""

EXAMPLE = """// written by rne
// Gravity compensation at 1 kHz, with limits: the arm stays where it is, and can be led by hand.
// Replace `Arm`, which is simulated here, by the driver of your robot.
#include <%NAME%/%NAME%.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <thread>

namespace {

using %NAME%::Vector;
constexpr %REAL% period = %REAL%(0.001); // s
constexpr %REAL% speed = %REAL%(0.5); // part of the velocity limits at which the program stops
%EXAMPLE_NUMBERS%
class Arm {
public:
    Vector q{{%START%}}, qd{};

    bool write(const Vector& torque) // one period under these torques
    {
        const auto qdd = %NAME%::forward_dynamics(%FORWARD%);
        for (std::size_t k = 0; qdd && k < %NAME%::joints; k++) {
            qd[k] += period * (*qdd)[k];
            q[k] += period * qd[k];
        }
        return qdd.has_value();
    }
};

} // namespace

int main(int count, char** words)
{
    const double duration = count > 1 ? std::atof(words[1]) : 0.2; // s
    Arm arm;
    int late = 0;
    auto next = std::chrono::steady_clock::now();
    for (long k = 0; k < std::lround(duration / static_cast<double>(period)); k++) {
        for (std::size_t i = 0; i < %NAME%::joints; i++) {
            if (!(std::fabs(arm.qd[i]) <= speed * %NAME%::velocity_limits[i])) {
                std::printf("joint %s is too fast: stopped\\n", %NAME%::joint_names[i]);
                return 1;
            }
        }
        Vector torque = %NAME%::gravity_torque(%GRAVITY%);
        for (std::size_t i = 0; i < %NAME%::joints; i++)
            torque[i] = std::clamp(torque[i], -%NAME%::effort_limits[i], %NAME%::effort_limits[i]);
        if (!arm.write(torque)) {
            std::puts("no acceleration: the mass matrix is singular");
            return 1;
        }
        next += std::chrono::milliseconds(1);
        late += std::chrono::steady_clock::now() > next;
        std::this_thread::sleep_until(next);
    }
    std::printf("%d periods were late\\n", late);
    return 0;
}
"""
