r"""
From a log to a C++ package
===========================

A controller in C++ that runs at 1 kHz needs the torques of the real arm, with its
friction, not those of the data sheet. This tutorial identifies the arm from a log,
writes the identified model as a C++17 package, builds and tests it with CMake, and
calls it from another program. The log is simulated, so we know the truth.

Needs: ``pip install '.[plot,robots,identify]'``; CMake and a C++ compiler, without which
the last steps are left out.
"""

import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import rne

# %%
# The log
# -------
# A UR5 carries a camera that is not in its URDF. It follows sines for 20 s; torques
# have a noise of 0.3 N m.

robot = rne.load("ur5")
arm = robot.with_payload(0.9, com=[0.0, 0.05, 0.06], link="tool0")
rng = np.random.default_rng(0)


def measured(frequencies, duration, noise):
    """Times, positions and torques of a motion of sines, with friction and noise."""
    t = np.arange(0, duration, 0.004)
    w = 2 * np.pi * np.array(frequencies)
    size = np.array([0.9, 0.6, 0.8, 0.9, 0.9, 1.0])
    q = size * np.sin(np.outer(t, w)) - [0, 1.2, 0, 0, 0, 0]
    qd, qdd = size * w * np.cos(np.outer(t, w)), -size * w**2 * np.sin(np.outer(t, w))
    tau = arm.inverse_dynamics(q, qd, qdd) + 4 * qd + 3 * np.tanh(qd / 0.01)
    return t, q, qd, qdd, tau + noise * rng.standard_normal(tau.shape)


t, q, *_, tau = measured([0.2, 0.25, 0.3, 0.35, 0.4, 0.45], 20.0, 0.3)
drives = rne.DriveModel(friction="viscous+coulomb")
found = rne.identify(robot, rne.identification.Record(t, q, tau), drives=drives)
print(found.report().split("\n\n")[0])

# %%
# The package
# -----------
# Inverse and forward dynamics include the identified friction. ``std=True`` adds a
# function for the standard deviation of a torque, ``payload`` makes a tool an argument.

folder = tempfile.TemporaryDirectory()
package = Path(folder.name, "arm")
files = rne.export.cmake(found, package, namespace="arm", payload="tool0", std=True)
header = (package / "include" / "arm" / "arm.hpp").read_text()
heads = [line for line in header.splitlines() if line.startswith("[[nodiscard]]")]
for line in heads:
    print(line.removeprefix("[[nodiscard]] inline ").split("(")[0])

# %%
# Built and tested
# ----------------
# ``ctest`` compares each function with numbers of the recursion.


def run(*words):
    """A command's output; an error if it fails."""
    found = subprocess.run(words, capture_output=True, text=True, check=True)
    return found.stdout


has_compiler = shutil.which("cmake") and (shutil.which("c++") or shutil.which("g++"))
build, prefix = Path(folder.name, "build"), Path(folder.name, "installed")
if has_compiler:
    run("cmake", "-S", package, "-B", build, "-DCMAKE_BUILD_TYPE=Release")
    run("cmake", "--build", build)
    print(run("ctest", "--test-dir", build).splitlines()[-3])
    run("cmake", "--install", build, "--prefix", prefix)

# %%
# In another program
# ------------------
# The program reads positions, velocities and accelerations, and writes torques and their
# standard deviations.

own = Path(folder.name, "own")
own.mkdir()
(own / "CMakeLists.txt").write_text("""cmake_minimum_required(VERSION 3.15)
project(own LANGUAGES CXX)
find_package(arm 1 REQUIRED)
add_executable(own main.cpp)
target_link_libraries(own PRIVATE arm::arm)
""")
(own / "main.cpp").write_text("""#include <arm/arm.hpp>
#include <cstdio>

int main()
{
    arm::Vector x[3];
    while (true) {
        for (auto& vector : x)
            for (double& entry : vector)
                if (std::scanf("%lf", &entry) != 1)
                    return 0;
        for (const double entry : arm::prediction(x[0], x[1], x[2]))
            std::printf("%.17g ", entry);
        std::puts("");
    }
}
""")

# %%
# For a motion that was not fitted, the torques of Python and of C++ are compared with
# the true ones. Bands are those of torques that have passed the filter of the fit, so
# that they contain no noise.

t, q, qd, qdd, tau = measured([0.31, 0.22, 0.41, 0.27, 0.36, 0.29], 5.0, 0.0)
torque, deviation = found.predict(q, qd, qdd, std=True)
if has_compiler:
    options = f"-DCMAKE_PREFIX_PATH={prefix}", "-DCMAKE_BUILD_TYPE=Release"
    run("cmake", "-S", own, "-B", own / "build", *options)
    run("cmake", "--build", own / "build")
    text = "\n".join(
        " ".join(map(repr, row)) for row in np.hstack([q, qd, qdd]).tolist()
    )
    said = subprocess.run(
        own / "build" / "own", input=text, capture_output=True, text=True
    )
    by_cpp = np.array(said.stdout.split(), float).reshape(len(t), 2, 6)
    print(f"C++ and Python differ by {abs(by_cpp[:, 0] - torque).max():.0e} N m")
    assert np.allclose(by_cpp[:, 0], torque, rtol=0, atol=1e-10)
    assert np.allclose(by_cpp[:, 1], deviation, rtol=1e-8)
    torque, deviation = by_cpp[:, 0], by_cpp[:, 1]
within = abs(tau - torque) <= 1.96 * deviation
print(f"{100 * within.mean():.0f} % of the true torques are within the 95 % band")
assert within.mean() > 0.9

figure = Figure(figsize=(6.4, 3.2), layout="constrained")
ax = figure.subplots()
ax.plot(t, tau[:, 2], "k.", markersize=1, label="true")
band = 1.96 * deviation[:, 2]
bounds = torque[:, 2] - band, torque[:, 2] + band
ax.fill_between(t, *bounds, alpha=0.4, color="C0", label="95 % band")
ax.plot(t, torque[:, 2], "C0", label="predicted")
ax.set(xlabel="time [s]", ylabel="torque of the elbow [N m]")
ax.legend()

# %%
# :doc:`/ros2-control` describes how to use the package in a controller.

folder.cleanup()
figure
