"""The other packages of the benchmarks: absent ones are named, and what is told of present ones follows the numbers."""

import itertools

import numpy as np
import pytest

import rne
from benchmarks import evaluation
from benchmarks.growth import chain
from benchmarks.peers import PEERS, Case, found, left_out, toolbox, versions


def test_a_package_that_is_absent_or_broken_is_named_with_its_reason(monkeypatch):
    monkeypatch.setattr(found, "OTHERS", {"no_such_package": "no-such-package"})
    assert left_out()["no_such_package"] == "not installed"
    assert "no_such_package" not in versions()

    def broken(name):
        raise AttributeError("module 'numpy' has no attribute 'float'")

    monkeypatch.setattr(found.importlib, "import_module", broken)
    found.module.cache_clear()
    assert left_out()["no_such_package"] == "its import fails: module 'numpy' has no attribute 'float'"
    found.module.cache_clear()


def test_only_present_packages_that_take_the_robot_are_timed(monkeypatch):
    def refuses(case):
        raise ValueError("Error: too light\nand more")

    robot = rne.load("irb140")
    case = Case(robot, "mass_matrix", robot.kernel(rne.mass_matrix), evaluation.states(robot.n, 3))
    monkeypatch.setattr(evaluation, "left_out", lambda: dict.fromkeys(set(PEERS) - {"mujoco"}, "not installed"))
    monkeypatch.setitem(PEERS, "mujoco", refuses)
    refused = {}
    assert evaluation.others(case, refused) == []
    assert refused == {"mujoco": "it refuses the robot: too light"}


def test_the_conclusion_says_who_is_faster_and_by_how_much():
    rows = {
        name: {"kernel_faster": (x, 0.9 * x, 1.1 * x), "worst_error": 1e-16, "build_s": 0.5 if x == 1 else None}
        for name, x in {"kernel, batch": 1.0, "slow, batch": 4.0, "fast, batch": 0.5}.items()
    }
    level = rows | {"fast, batch": rows["fast, batch"] | {"kernel_faster": (1.05, 1.0, 1.1)}}
    text = evaluation.conclusion(
        {"sizes": {"batch": 300}, "robots": {"arm": {"mass_matrix": rows, "inverse_dynamics": level}}}
    )
    assert "Batches are of 300 states" in text
    assert "- The kernel's batch is faster, wherever both run, than slow, batch (4.0 to 4.0 times)." in text
    assert "faster on arm mass matrix (2.00 times); level within 10% on arm inverse dynamics." in text
    assert "kernel, batch 0.50 to 0.50" in text


@pytest.mark.parametrize("model", [rne.irb140(), chain("straight", 5), chain("crooked", 7)], ids=lambda m: m.name)
def test_dh_parameters_give_the_frames_back(model):
    bodies = toolbox._poses(model)
    frames = toolbox._dh_frames(bodies, model)
    for body, frame, axis in zip(bodies, frames, model.axis, strict=True):
        np.testing.assert_allclose(frame[:3, 2], body[:3, :3] @ axis, atol=1e-14)
        np.testing.assert_allclose(np.cross(frame[:3, 2], body[:3, 3] - frame[:3, 3]), 0, atol=1e-14)
    for before, frame in itertools.pairwise(frames):
        step = np.linalg.solve(before, frame)
        alpha, a, theta, d = toolbox._parameters(step)
        rotate = {"x": np.eye(4), "z": np.eye(4)}
        rotate["x"][1:3, 1:3] = [[np.cos(alpha), -np.sin(alpha)], [np.sin(alpha), np.cos(alpha)]]
        rotate["z"][:2, :2] = [[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]]
        rotate["x"][0, 3], rotate["z"][2, 3] = a, d
        np.testing.assert_allclose(rotate["x"] @ rotate["z"], step, atol=1e-14)
