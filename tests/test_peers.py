"""The registry of peers: packages that are absent or broken are named with their reason, and one file adds a peer."""

import itertools

import numpy as np
import pytest

import rne
from benchmarks import evaluation
from benchmarks.growth import chain
from benchmarks.peers import PEERS, Case, Point, left_out, peer, registry, toolbox, versions


@pytest.fixture
def only_one(monkeypatch):
    """A function that registers one peer in an otherwise empty registry."""

    def register(points=lambda case: [], modules=("no_such_package",), **options):
        monkeypatch.setattr(registry, "PEERS", {})
        monkeypatch.setattr(evaluation, "PEERS", registry.PEERS)
        return peer("example", requirement="no-such-package[extra]>=1.0", modules=modules, **options)(points)

    registry.import_failure.cache_clear()
    yield register
    registry.import_failure.cache_clear()


def test_every_file_of_the_folder_registers_its_peers():
    assert {"Pinocchio", "MuJoCo", "CasADi VM", "CasADi in C", "roboticstoolbox", "adam", "adam in C"} <= set(PEERS)


def test_a_package_that_is_absent_or_broken_is_named_with_its_reason(monkeypatch, only_one):
    only_one()
    assert left_out() == {"example": "not installed"}
    assert versions() == {}

    def broken(name):
        raise AttributeError("module 'numpy' has no attribute 'float'")

    registry.import_failure.cache_clear()
    monkeypatch.setattr(registry.importlib, "import_module", broken)
    assert left_out() == {"example": "its import fails: module 'numpy' has no attribute 'float'"}


def test_a_peer_that_needs_a_compiler_is_left_out_without_one(monkeypatch, only_one):
    only_one(modules=("numpy",), compiles=True)
    monkeypatch.setattr(registry.shutil, "which", lambda name: None)
    assert left_out() == {"example": "there is no C compiler `cc`"}


def test_the_decorator_returns_the_function_and_keeps_the_requirement(only_one):
    def points(case):
        return []

    assert only_one(points) is points
    assert registry.PEERS["example"].distribution == "no-such-package"


def test_a_peer_is_timed_or_its_reason_recorded(only_one):
    robot = rne.load("irb140")
    case = Case(robot, "mass_matrix", robot.kernel(rne.dynamics.mass_matrix), evaluation.states(robot.n, 3))
    refused = {}
    only_one(modules=("numpy",))(case)
    assert evaluation.theirs(case, refused) == []
    point = Point("example, batch", lambda: None, 3, lambda few: np.zeros((few, 6, 6)))
    only_one(lambda case: [point], modules=("numpy",))
    assert evaluation.theirs(case, refused) == [point]
    assert refused == {}

    def refuses(case):
        raise ValueError("too light")

    only_one(refuses, modules=("numpy",))
    assert evaluation.theirs(case, refused) == []
    assert refused == {"example": "too light"}


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
