"""The CMake package in C++: what its texts say, that compilers take it without a warning, that its numbers are right."""

import importlib.util
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rne
from rne.__main__ import main

from .helpers import ROOT, gimbal

WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror")
ARMS = ("irb140", "ur3_robot", "ur5", "ur10", "panda", "z1", "xarm7", "kinova", "talos_left_arm", "so101")
PARTS = {  # scenes with every kind of number, and the names of those that are arguments
    "hand": lambda: rne.Scene(rne.load("panda").locked({"panda_finger_joint1": 0.0}), gravity=[1.0, 2.0, -9.0]),
    "samples": lambda: rne.Scene(
        rne.load("irb140"),
        controller=rne.control.computed_torque(
            rne.load("irb140"), 50.0, 20.0, rne.trajectories.sampled([0.0, 0.7, 1.5], [[0.0] * 6, [0.3] * 6, [0.1] * 6])
        ),
        friction=rne.Friction(coulomb=2.0, viscous=1.0, viscous_back=1.5, smoothing=0.0),
        springs=[rne.Spring.at_joint("joint_2", 100.0, 0.1, damping=2.0)],
        payload=rne.Payload(0.0, [0.1, 0.0, 0.2]),
    ),
    "scene": lambda: rne.Scene(
        rne.load("irb140"),
        friction=rne.Friction(viscous=2.0, coulomb=1.0, smoothing=0.05),
        controller=rne.control.pid(rne.load("irb140"), 60.0, 20.0, 5.0, np.full(6, 0.2)),
    ),
}
# Relative to the largest entry: of the arms' torques and M. Twice as much where M is solved with or springs cancel.
TORQUES = {"float64": 1e-13, "float32": 1e-6}
ZIG, HAS_ZIG = (sys.executable, "-m", "ziglang"), importlib.util.find_spec("ziglang") is not None
WITH_CPP = pytest.mark.skipif(shutil.which("g++") is None, reason="there is no g++ here")
WITH_CMAKE = pytest.mark.skipif(None in map(shutil.which, ("cmake", "g++")), reason="there is no CMake or no g++ here")


def run(*words, cwd):
    """What a command prints; its errors, if it fails, are those of the test."""
    done = subprocess.run(words, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout


def errors(said):
    """The largest relative errors that the package's own test prints, by function."""
    found = {}
    for name, error, size in re.findall(r"^(\w+): largest error (\S+) of ([\d.e+-]+)", said, re.MULTILINE):
        found[name] = max(found.get(name, 0.0), float(error) / max(float(size), 1e-300))
    return found


@pytest.fixture(scope="module")
def lever(tmp_path_factory):
    """The folder and the header of a package, with payload and gravity as arguments."""
    folder = tmp_path_factory.mktemp("lever")
    rne.export.cmake(gimbal_with_limits(), folder, payload="c", numbers=["gravity"])
    return folder, (folder / "include" / "gimbal" / "gimbal.hpp").read_text()


def gimbal_with_limits():
    limits = {"effort_limit": [7.0, np.inf, 9.0], "upper": [1.5, 2.5, np.inf], "lower": [-1.5, 0.5, -np.inf]}
    return rne.Robot(replace(gimbal(), **{name: np.array(x) for name, x in limits.items()}))


def test_the_header_says_joints_units_limits_and_what_a_thread_may_do(lever):
    _, header = lever
    for text in (
        'joint_names{{"outer", "middle", "inner"}};',
        "effort_limits{{7.0, std::numeric_limits<double>::infinity(), 9.0}}; // N m",
        "lower_limits{{-1.5, 0.5, -std::numeric_limits<double>::infinity()}}; // rad",
        "// Units - q rad, qd rad/s, tau N m",
        "// gravity [m/s^2] is an argument",
        "any number of threads may call them",
        "std::optional<std::array<double, 3>> forward_dynamics(const std::array<double, 3>& q,",
    ):
        assert text in header, text
    assert "// A rigid body on link c, in the link's frame." in header
    assert header.index("struct Payload {") < header.index("const Payload& payload")
    functions = [line for line in header.splitlines() if line.startswith("[[nodiscard]]")]
    assert [line.endswith(" noexcept") for line in functions] == [True] * 5
    assert ["const Payload& payload" in line for line in functions] == [True] * 5
    assert [re.search(r"(\w+)\(", line)[1] for line in functions if "& gravity" in line] == [
        "inverse_dynamics",
        "gravity_torque",
        "forward_dynamics",
    ]


@pytest.mark.parametrize(("law", "rest"), [("pd", ""), ("pid", "; then rates of the states z, or z of a discrete law")])
def test_a_law_says_that_its_torques_have_no_limits(law, rest, tmp_path):
    """Those of the scene are not in its text, but above it."""
    robot = rne.load("irb140")
    gains = {"pd": (60.0, 20.0), "pid": (60.0, 20.0, 5.0)}[law]
    scene = rne.Scene(robot, controller=getattr(rne.control, law)(robot, *gains, np.full(6, 0.2)), effort_limit=1.0)
    rne.export.cmake(scene, tmp_path, namespace="arm", quantities=["controller"])
    comment = (tmp_path / "include/arm/arm.hpp").read_text().replace("\n//   ", " ")
    assert f"// Result - torques without the limits and delays of a scene, so clip them{rest}" in comment


def test_the_example_starts_in_the_middle_of_the_ranges(lever):
    """Joints without one start at zero."""
    text = (lever[0] / "example" / "gravity_compensation.cpp").read_text()
    assert "Vector q{{0.0, 1.5, 0.0}}, qd{};" in text


def test_the_example_starts_at_zero_where_a_range_has_one_end(tmp_path):
    robot = rne.Robot(replace(gimbal(), lower=np.array([0.5, -np.inf, -1.0]), upper=np.array([np.inf, 0.5, 2.0])))
    rne.export.cmake(robot, tmp_path, quantities=["gravity_torque", "forward_dynamics"])
    text = (tmp_path / "example" / "gravity_compensation.cpp").read_text()
    assert "Vector q{{0.0, 0.0, 0.5}}, qd{};" in text


def test_functions_of_eigen_convert_arguments_and_results(lever):
    text = (lever[0] / "include" / "gimbal" / "eigen.hpp").read_text()
    for said in (
        "return to_eigen<3, 1>(gimbal::gravity_torque(to_array<3>(q), payload, to_array<3>(gravity)));",
        "return to_eigen<3, 3>(gimbal::mass_matrix(to_array<3>(q), payload));",
        "return to_eigen<3, 1>(*found);",
    ):
        assert said in text, said


def test_no_name_of_a_file_leaves_its_literal_or_its_comment(tmp_path):
    """Joints are named in literals, by numbers of what is not plain; robot and links in comments, without such signs."""
    known, names = gimbal(), ("*/ int main(){} /*", 'a"; int x = 1; //', "b\\\nc??/%NAME%")
    rename = dict(zip(known.moving_joints, names, strict=True))
    model = replace(
        known, name=names[0], moving_joints=names, link_joints=tuple(rename.get(j, j) for j in known.link_joints)
    )
    rne.export.cmake(rne.Robot(model), tmp_path, namespace="gimbal", quantities=["gravity_torque"])
    plain = tmp_path / "plain"
    rne.export.cmake(rne.Robot(known), plain, namespace="gimbal", quantities=["gravity_torque"])
    for file in (file.relative_to(plain) for file in plain.rglob("*.*pp")):
        code = [without_names(folder / file) for folder in (tmp_path, plain)]
        assert code[0] == code[1], file
    header = (tmp_path / "include" / "gimbal" / "gimbal.hpp").read_text(encoding="ascii")
    assert r'"a\042\073 int x \075 1\073 \057\057"' in header


def without_names(file):
    """The lines of a file in C++ but for comments and the names of joints."""
    lines = file.read_text(encoding="ascii").splitlines()
    return [line for line in lines if not line.startswith("//") and "joint_names{{" not in line]


def test_files_of_others_are_kept_by_function_and_by_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    command = ["export", "double_pendulum", "arm", "--quantities", "gravity_torque"]
    assert main(command) == main(command) == 0  # the second time in place of the first
    own = Path("arm", "test", "numbers.cpp")
    own.write_text("int mine;\n")
    assert capsys.readouterr().err == ""
    assert main(command) == 2
    assert capsys.readouterr().err == (
        "error: FOLDER: 'arm/test/numbers.cpp' was not written by rne; name another folder, or give --force to replace it\n"
    )
    with pytest.raises(FileExistsError, match=r"^'arm/test/numbers.cpp' was not written by rne; name another folder"):
        rne.export.cmake(rne.load("double_pendulum"), "arm", quantities=["gravity_torque"])
    assert own.read_text() == "int mine;\n"
    assert main([*command, "--force"]) == 0
    assert "gravity_torque_rows" in own.read_text()


REFUSED = {
    r"`payload` must be one of \['base', 'a', 'b', 'c'\], got 'd'": {"payload": "d"},
    r"`namespace` must be a name of letters, digits and _ that no language has, got 'class'": {"namespace": "class"},
    r"`quantities`: 'no' is no function of joint arrays in rne.dynamics": {"quantities": ["no"]},
    r"`numbers`: the scene has the numbers .*; got 'mass'": {"numbers": ["mass"]},
    r"`dtype` of language 'c\+\+' must be one of \['float64', 'float32'\], got 'int'": {"dtype": "int"},
    r"`std` is for an Identification, got Robot": {"std": True},
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_cannot_be_written_is_refused(text, tmp_path):
    with pytest.raises(ValueError, match=f"^{text}"):
        rne.export.cmake(gimbal_with_limits(), tmp_path, **REFUSED[text])
    assert not [*tmp_path.iterdir()]


OTHERS_REFUSED = {  # of other robots and scenes
    "`given` must be a Robot, a Scene or an Identification, got Model": (lambda robot: robot.model, {}),
    "`payload`: the scene has one already; numbers=['payload'] makes it an argument": (
        lambda robot: rne.Scene(robot, payload=rne.Payload(1.0, link="c")),
        {"payload": "c"},
    ),
    "robot 'gimbal' has no joint that moves": (lambda robot: robot.locked(dict.fromkeys(robot.joint_names, 0.6)), {}),
    "`numbers`: 'controller.reference' are samples of a motion, which are constants of the text": (
        lambda robot: rne.Scene(
            robot,
            controller=rne.control.pd(
                robot, 5.0, 2.0, rne.trajectories.sampled([0.0, 0.5, 1.0], np.arange(9.0).reshape(3, 3) / 9)
            ),
        ),
        {"numbers": ["controller.reference"]},
    ),
    "`numbers` must have 'parameters', which contain the payload, or 'payload', not both": (
        lambda robot: rne.Scene(robot, payload=rne.Payload(1.0, link="c")),
        {"numbers": ["parameters", "payload"]},
    ),
    "'controller' needs a scene with a law that can be traced": (rne.Scene, {"quantities": ["controller"]}),
    "'friction_torque' needs a scene with friction that depends only on velocities": (
        rne.Scene,
        {"quantities": ["friction_torque"]},
    ),
}


@pytest.mark.parametrize("text", OTHERS_REFUSED)
def test_scenes_that_cannot_be_written_are_refused(text, tmp_path):
    make, how = OTHERS_REFUSED[text]
    with pytest.raises((TypeError, ValueError), match=f"^{re.escape(text)}$"):
        rne.export.cmake(make(gimbal_with_limits()), tmp_path, **how)
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["arm", "--payload-at", "hand"], "`payload` must be one of ['base_link', 'link1', 'link2'], got 'hand'"),
        (["arm.fmu", "--payload-at", "hand"], "`link` must be one of ['base_link', 'link1', 'link2'], got 'hand'"),
    ],
)
def test_what_the_command_cannot_write_is_said_in_one_line(words, text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["export", "double_pendulum", *words]) == 2
    assert capsys.readouterr().err == f"error: {text}\n"
    assert not [*tmp_path.iterdir()]


def test_forward_dynamics_of_a_singular_mass_matrix_is_refused_and_other_quantities_are_not(tmp_path):
    """A point mass on the last axis: with a rotor, or without forward dynamics, the package is written."""
    arm = {"a": [0.5, 0.0], "alpha": [np.pi / 2, 0.0], "d": [0.0, 0.2], "theta": [0.0, 0.0], "masses": [1.0, 0.2]}
    robot = rne.Robot(rne.dh_chain(**arm, centres=[[0.0] * 3] * 2, inertias=[[0.1] * 3, [0.0] * 3]))
    text = (
        "^`quantities`: no forward dynamics, since M is singular: a motion of 'joint_2' moves no inertia; give rotors"
    )
    for payload in (None, "link_2"):
        with pytest.raises(ValueError, match=text):
            rne.export.cmake(robot, tmp_path, payload=payload)
    assert not [*tmp_path.iterdir()]
    rne.export.cmake(robot, tmp_path / "a", payload="link_2", quantities=["inverse_dynamics", "gravity_torque"])
    rne.export.cmake(robot.with_armature([0.0, 1e-4]), tmp_path / "b", payload="link_2")
    for folder in ("a", "b"):
        assert "inf)" not in next((tmp_path / folder).rglob("numbers.cpp")).read_text()


def test_a_closed_linkage_that_moves_little_to_one_side_is_written(tmp_path):
    """The states at which M is examined are within the range outside of which its joints cannot follow."""
    right, lengths = np.pi / 2, {"a": [0.8, 0.3, 0.3], "alpha": [0.0] * 3, "d": [0.0] * 3}
    bodies = {"masses": [1.0] * 3, "centres": [[0.05] * 3] * 3, "inertias": [[0.01] * 3] * 3}
    for turn in (right, -right):
        arm = rne.Robot(rne.dh_chain(**lengths, theta=[turn, -turn, -turn], **bodies))
        pivot = arm.link_poses([0.0] * 3)[arm.model.link_index("tool0"), :3, 3]
        bar = rne.model.four_bar(arm, "joint_1", (("tool0", [0, 0, 0]), ("base_link", pivot.tolist())))
        assert max(-bar.model.lower[0], bar.model.upper[0]) > 1 > 0.4 > min(-bar.model.lower[0], bar.model.upper[0])
        rne.export.cmake(bar, tmp_path / f"{turn:.0f}", quantities=["forward_dynamics"])


@WITH_CPP
@pytest.mark.long
@pytest.mark.parametrize("name", [*ARMS, *PARTS])
def test_numbers_of_the_recursion_on_ten_arms(name, tmp_path):
    """In both precisions, by C++17 and C++20, with no warning."""
    given, how = rne.load(name) if name in ARMS else PARTS[name](), {}
    if name == "scene":
        how = {"payload": "tool0", "numbers": ["friction.viscous", "controller.kp", "controller.reference", "gravity"]}
    elif name == "samples":
        how = {"numbers": ["springs[0].stiffness", "friction.coulomb", "payload.mass"]}
    elif name in PARTS:
        how = {"payload": "panda_link8", "numbers": ["gravity", "armature"]}
    for dtype, standard in (("float64", "c++17"), ("float32", "c++20")):
        folder = tmp_path / dtype
        rne.export.cmake(given, folder, namespace="arm", dtype=dtype, **how)
        run("g++", f"-std={standard}", *WARNINGS, "-O1", "-Iinclude", "test/numbers.cpp", "-o", "numbers", cwd=folder)
        found = errors(run("./numbers", cwd=folder))
        assert len(found) >= 5
        for function, error in found.items():
            is_plain = name in ARMS and function != "forward_dynamics"
            assert error <= TORQUES[dtype] * (1 if is_plain else 2), (dtype, function)


@pytest.mark.long
@pytest.mark.skipif(not HAS_ZIG, reason="ziglang is not installed, which is a clang")
def test_clang_takes_it_without_a_warning(lever):
    """Compiled, not linked: ziglang would first compile the standard library, which takes minutes."""
    words = *ZIG, "c++", *WARNINGS, "-Iinclude", "-c", "test/numbers.cpp"
    for standard in ("c++17", "c++20"):
        run(*words, f"-std={standard}", "-o", "numbers.o", cwd=lever[0])


@pytest.mark.long
@pytest.mark.skipif(not HAS_ZIG, reason="ziglang is not installed, which compiles for other processors")
@pytest.mark.skipif(shutil.which("qemu-aarch64") is None, reason="qemu-user is not installed, which emulates aarch64")
@pytest.mark.parametrize("name", ["irb140", "panda", "scene"])
def test_numbers_of_the_recursion_on_aarch64(name, tmp_path):
    """On an emulated processor, whose compilers fuse multiplications and additions by default, as others do not."""
    given, how = (PARTS[name](), {"payload": "tool0"}) if name in PARTS else (rne.load(name), {})
    for dtype, tolerance in TORQUES.items():
        folder, target = tmp_path / dtype, ("-target", "aarch64-linux-musl")
        rne.export.cmake(given, folder, namespace="arm", dtype=dtype, **how)
        words = *ZIG, "c++", *target, "-std=c++17", *WARNINGS, "-O2", "-fno-exceptions", "-Iinclude"
        run(*words, "-c", "test/numbers.cpp", "-o", "numbers.o", cwd=folder)
        run(*ZIG, "cc", *target, "-static", "numbers.o", "-o", "numbers", cwd=folder)  # of the C library alone
        found = errors(run("qemu-aarch64", "./numbers", cwd=folder))
        assert len(found) >= 5
        assert max(found.values()) <= 2 * tolerance, (dtype, found)


COLCON = """import sys
from colcon_core.command import main
sys.exit(main(argv=sys.argv[1:]))
"""
OF_USER = {
    "package.xml": """<package format="3">
  <name>user</name>
  <version>1.0.0</version>
  <description>Program that calls the functions of an arm</description>
  <maintainer email="nobody@example.com">nobody</maintainer>
  <license>unspecified</license>
  <depend>two_links</depend>
  <export><build_type>cmake</build_type></export>
</package>
""",
    "CMakeLists.txt": """cmake_minimum_required(VERSION 3.15)
project(user LANGUAGES CXX)
find_package(Two_links 1 REQUIRED)
add_executable(user main.cpp)
target_link_libraries(user PRIVATE Two_links::Two_links)
install(TARGETS user DESTINATION bin)
""",
    "main.cpp": """#include <Two_links/Two_links.hpp>
int main() { return static_cast<int>(Two_links::joints); }
""",
}


@WITH_CMAKE
@pytest.mark.long
@pytest.mark.skipif(
    None in map(importlib.util.find_spec, ("colcon_core", "colcon_cmake", "colcon_ros")),
    reason="colcon is not installed",
)
def test_colcon_builds_and_tests_it_before_a_package_that_depends_on_it(tmp_path):
    """Its package.xml has a name in lower case, as ROS wants it; CMake has the namespace's."""
    source = tmp_path / "src"
    rne.export.cmake(rne.load("double_pendulum"), source / "arm", namespace="Two_links")
    (source / "user").mkdir()
    for name, text in OF_USER.items():
        (source / "user" / name).write_text(text)
    colcon = sys.executable, "-c", COLCON
    assert run(*colcon, "list", "--names-only", cwd=tmp_path).split() == ["two_links", "user"]
    run(*colcon, "build", cwd=tmp_path)
    run(*colcon, "test", cwd=tmp_path)
    assert "1 test, 0 errors, 0 failures" in run(*colcon, "test-result", "--all", cwd=tmp_path)
    program = tmp_path / "install" / "user" / "bin" / "user"
    assert subprocess.run([program], check=False).returncode == 2  # joints


CONSUMER = """cmake_minimum_required(VERSION 3.15)
project(consumer LANGUAGES CXX)
find_package(gimbal 1.0 REQUIRED)
add_executable(consumer main.cpp)
target_link_libraries(consumer PRIVATE gimbal::gimbal pthread)
target_link_options(consumer PRIVATE -Wl,--wrap=malloc)
"""
# Eight threads get the same numbers, bit by bit, none of them asks for memory, and a singular M gives no numbers.
MAIN = """#include <gimbal/gimbal.hpp>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <thread>
#include <vector>

thread_local long asked = 0;
extern "C" void* __real_malloc(std::size_t);
extern "C" void* __wrap_malloc(std::size_t size) { asked++; return __real_malloc(size); }
void* operator new(std::size_t size) { asked++; return __real_malloc(size); }

int main()
{
    const gimbal::Payload payload{1.5, {{0.1, 0.0, 0.2}}, 0.01, 0.0, 0.0, 0.02, 0.0, 0.03};
    const std::array<double, 3> gravity{{0.0, 0.0, -9.81}};
    const auto sum = [&](long& own) {
        double total = 0;
        const long before = asked;
        for (int k = 0; k < 20000; k++) {
            const gimbal::Vector q{{0.001 * k, 1.0, 0.3}}, qd{{1.0, 0.002 * k, -1.0}}, qdd{{0.5, 0.6, 0.7}};
            for (const double x : gimbal::inverse_dynamics(q, qd, qdd, payload, gravity))
                total += x;
            for (const double x : gimbal::mass_matrix(q, payload))
                total += x;
            total += gimbal::forward_dynamics(q, qd, qdd, payload, gravity).value()[0];
        }
        own = asked - before;
        return total;
    };
    std::vector<double> totals(8);
    std::vector<long> counts(8);
    std::vector<std::thread> threads;
    for (std::size_t k = 0; k < 8; k++)
        threads.emplace_back([&, k] { totals[k] = sum(counts[k]); });
    for (auto& thread : threads)
        thread.join();
    for (std::size_t k = 0; k < 8; k++)
        if (totals[k] != totals[0] || counts[k] != 0)
            return 1;
    delete new int;
    std::free(std::malloc(1));
    if (asked < 2) // of these two and the vectors: the count does count
        return 2;
    const gimbal::Vector zero{};
    if (gimbal::forward_dynamics(zero, zero, zero, payload, gravity).has_value())
        return 3;
    std::printf("%s has %zu joints\\n", gimbal::joint_names[0], gimbal::joints);
    return 0;
}
"""


@WITH_CMAKE
@pytest.mark.long
def test_a_consumer_finds_the_installed_package(lever, tmp_path):
    build, prefix, own = tmp_path / "build", tmp_path / "prefix", tmp_path / "consumer"
    run("cmake", "-S", str(lever[0]), "-B", str(build), "-DCMAKE_BUILD_TYPE=Release", cwd=tmp_path)
    run("cmake", "--build", str(build), cwd=tmp_path)
    assert "100% tests passed, 0 tests failed out of 1" in run("ctest", "--test-dir", str(build), cwd=tmp_path)
    assert run(str(build / "gravity_compensation"), "0.1", cwd=tmp_path).endswith(" periods were late\n")
    run("cmake", "--install", str(build), "--prefix", str(prefix), cwd=tmp_path)
    assert {str(file.relative_to(prefix)) for file in prefix.rglob("*") if file.is_file()} == {
        "include/gimbal/gimbal.hpp",
        "include/gimbal/eigen.hpp",
        "share/gimbal/package.xml",
        "share/gimbal/cmake/gimbalConfig.cmake",
        "share/gimbal/cmake/gimbalConfigVersion.cmake",
    }
    own.mkdir()
    (own / "CMakeLists.txt").write_text(CONSUMER)
    (own / "main.cpp").write_text(MAIN)
    options = f"-DCMAKE_PREFIX_PATH={prefix}", "-DCMAKE_BUILD_TYPE=Release"
    run("cmake", "-S", str(own), "-B", str(own / "build"), *options, cwd=tmp_path)
    run("cmake", "--build", str(own / "build"), cwd=tmp_path)
    assert run(str(own / "build" / "consumer"), cwd=tmp_path) == "outer has 3 joints\n"
    (own / "CMakeLists.txt").write_text(CONSUMER.replace("gimbal 1.0", "gimbal 2.0"))
    refused = subprocess.run(["cmake", "-S", own, "-B", own / "other", *options], capture_output=True, check=False)
    assert refused.returncode != 0


def eigen():
    """The folder of Eigen's headers, or None."""
    casadi = importlib.util.find_spec("casadi")
    places = [Path("/usr/include/eigen3")]
    places += [Path(casadi.origin).parent / "include" / "eigen3"] if casadi else []
    return next((place for place in places if (place / "Eigen" / "Core").exists()), None)


WITH_EIGEN = pytest.mark.skipif(eigen() is None, reason="Eigen is not here")
BY_EIGEN = """#include <gimbal/eigen.hpp>

int main()
{
    const gimbal::eigen::Vector q(0.1, 1.0, 0.3), qd(1.0, -2.0, 0.5), qdd(0.5, 0.6, 0.7), gravity(0.0, 0.0, -9.81);
    const gimbal::Payload payload{1.5, {{0.1, 0.0, 0.2}}, 0.01, 0.0, 0.0, 0.02, 0.0, 0.03};
    namespace by = gimbal::eigen;
    const gimbal::eigen::Vector tau = by::inverse_dynamics(q, qd, qdd, payload, gravity);
    const gimbal::eigen::Vector sum = by::mass_matrix(q, payload) * qdd + by::coriolis_torque(q, qd, payload)
        + by::gravity_torque(q, payload, gravity);
    const auto found = by::forward_dynamics(q, qd, tau, payload, gravity);
    return !((tau - sum).norm() < 1e-12 && found && (*found - qdd).norm() < 1e-12);
}
"""


@WITH_CPP
@WITH_EIGEN
@pytest.mark.long
def test_the_functions_of_eigen_are_the_same(lever):
    (lever[0] / "main.cpp").write_text(BY_EIGEN)
    words = "-std=c++17", *WARNINGS, "-Iinclude", f"-isystem{eigen()}"
    run("g++", *words, "main.cpp", "-o", "by_eigen", cwd=lever[0])
    run("./by_eigen", cwd=lever[0])


STUB = """#pragma once
#include <Eigen/Core>
#include <memory>
#include <string>
namespace rclcpp::node_interfaces { struct NodeParametersInterface { using ConstSharedPtr = std::shared_ptr<const int>; }; }
namespace inverse_dynamics_solver {
struct InverseDynamicsSolver {
    using Parameters = rclcpp::node_interfaces::NodeParametersInterface::ConstSharedPtr;
    using Vector = Eigen::VectorXd;
    virtual ~InverseDynamicsSolver() = default;
    virtual void initialize(Parameters, const std::string&, const std::string&) = 0;
    virtual Eigen::MatrixXd getInertiaMatrix(const Vector&) const = 0;
    virtual Vector getCoriolisVector(const Vector&, const Vector&) const = 0;
    virtual Vector getGravityVector(const Vector&) const = 0;
    virtual Vector getFrictionVector(const Vector&) const = 0;
};
}
"""


@WITH_CPP
@WITH_EIGEN
@pytest.mark.long
def test_the_adapter_of_the_page_compiles_against_the_methods_it_overrides(tmp_path):
    """Not against ROS, which is not here: the class that it is derived from is declared here."""
    rne.export.cmake(rne.load("ur10"), tmp_path)
    page = (ROOT / "docs" / "ros2-control.md").read_text(encoding="utf-8")
    (adapter,) = re.findall(r"^```cpp\n(#include <inverse_dynamics_solver.*?)^```", page, re.DOTALL | re.MULTILINE)
    for name, text in (("inverse_dynamics_solver/inverse_dynamics_solver", STUB), ("pluginlib/class_list_macros", "")):
        file = tmp_path / "include" / f"{name}.hpp"
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
    (tmp_path / "solver.cpp").write_text(
        "#define PLUGINLIB_EXPORT_CLASS(a, b) template class std::unique_ptr<a>;\n" + adapter
    )
    run(
        "g++",
        "-std=c++17",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-Iinclude",
        f"-isystem{eigen()}",
        "-c",
        "solver.cpp",
        cwd=tmp_path,
    )


@WITH_CPP
@pytest.mark.long
def test_an_identified_model_with_its_friction_and_deviations(tmp_path):
    """Prediction, by C++, is that of the identification; inverse dynamics have the same torques."""
    arm = rne.load("irb140").locked({"joint_4": 0, "joint_5": 0, "joint_6": 0})
    t = np.arange(0, 12, 0.01)
    w, rng = 2 * np.pi * np.array([0.3, 0.4, 0.5]), np.random.default_rng(0)
    q, qd, qdd = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
    tau = arm.inverse_dynamics(q, qd, qdd) + 5 * qd + 2 * np.tanh(qd / 0.02) + 0.1 * rng.normal(size=q.shape)
    drives = rne.DriveModel(friction="viscous+coulomb")
    found = rne.identify(arm, rne.identification.Record(t, q, tau), drives=drives)
    rne.export.cmake(found, tmp_path, namespace="arm", std=True)
    text = (tmp_path / "test" / "numbers.cpp").read_text()
    table = re.search(r"prediction_rows\[\]\[\d+\] = \{(.*?)\};", text, re.DOTALL)[1]
    rows = np.array([[float(x) for x in row.split(",")] for row in re.findall(r"\{(.*?)\}", table)])
    torque, deviation = found.predict(*rows[:, :9].reshape(-1, 3, 3).swapaxes(0, 1), std=True)
    np.testing.assert_allclose(rows[:, 9:12], torque, rtol=0, atol=1e-12 * abs(torque).max())
    np.testing.assert_allclose(rows[:, 12:], deviation, rtol=1e-9)
    run("g++", "-std=c++17", *WARNINGS, "-Iinclude", "test/numbers.cpp", "-o", "numbers", cwd=tmp_path)
    assert {"prediction", "friction_torque"} <= errors(run("./numbers", cwd=tmp_path)).keys()
