import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: threads cost more than matrices of six joints give

import gc
from collections.abc import Mapping

import pytest

import rne

from .helpers import KD, KP, Oracle, data_robots, kept, loaded
from .random_robots import random_tree, straight_chain


class Trees(Mapping):
    """Random trees by name, each built when first asked for: importing the tests needs no robot."""

    def __init__(self, **shapes):
        self.shapes, self.built = shapes, {}

    def __getitem__(self, name):
        if name not in self.built:
            self.built[name] = random_tree(**self.shapes[name])
        return self.built[name]

    def __iter__(self):
        return iter(self.shapes)

    def __len__(self):
        return len(self.shapes)


TREES = Trees(
    single={"n": 1, "seed": 1},
    serial={"n": 6, "seed": 2, "prismatic": 0, "branching": 0},
    sliders={"n": 5, "seed": 3, "prismatic": 1},
    mixed={"n": 4, "seed": 5, "branching": 0.4},
    bushy={"n": 9, "seed": 5, "branching": 0.8},
    mimics={"n": 3, "seed": 3, "branching": 0.4, "mimics": 2},
    coupled={"n": 5, "seed": 3, "branching": 0.4, "coupled": True},
)


def pytest_addoption(parser):
    parser.addoption("--engine", default="numpy", help="what runs kernels where a test does not say: numpy or numba")


def pytest_configure(config):
    """Make another engine the default of every function that has this argument."""
    gc.disable()  # until all tests are collected: what imports make stays
    engine = config.getoption("--engine")
    if engine == "numpy":
        return
    kernels = rne.kernels
    makers = kernels.derivative, kernels.gradient, kernels.hessian, kernels.hessian_product
    for function in (rne.load, rne.compile, *makers):
        function.__kwdefaults__["engine"] = engine
    rne.Robot.__init__.__defaults__ = (engine,)
    assert {rne.load("irb140").engine, rne.Robot(rne.irb140()).engine} == {engine}


COLLECTED = pytest.StashKey[set]()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Keep the names of all tests found, those of the long run included."""
    config.stash[COLLECTED] = {item.nodeid for item in items}


def pytest_collection_finish():
    """What is imported stays: collections of garbage need not visit it again and again."""
    gc.freeze()
    gc.enable()
    gc.set_threshold(200_000, 20, 100)


@pytest.fixture(scope="session", autouse=True)
def object_code_of_this_run(tmp_path_factory):
    """Processes of one run share what they compile, in the folder RNE_CACHE if it is set, otherwise in one of their own."""
    base = tmp_path_factory.getbasetemp()
    run = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    os.environ.setdefault("RNE_CACHE", str(run / "object_code"))


@pytest.fixture(params=kept(TREES, ["single", "sliders", "mixed", "mimics", "coupled"]), scope="session")
def tree(request):
    """A random tree: joints of all types, branches, tools on fixed joints, any direction of gravity; large ones are long."""
    return TREES[request.param]


@pytest.fixture(scope="session")
def irb140():
    return loaded("irb140")


@pytest.fixture
def irb140_once(irb140, monkeypatch):
    """`rne.load` gives the built-in robot of all tests, which keeps the kernels that are traced."""
    load = rne.load

    def loaded_once(robot, **given):
        is_plain = robot == "irb140" and all(value is None for value in given.values())
        return irb140 if is_plain else load(robot, **given)

    monkeypatch.setattr(rne, "load", loaded_once)


@pytest.fixture(scope="session")
def gains_of_thesis(irb140):
    """Of the closed loops of the thesis, sampled too slowly; the search takes a second."""
    return rne.check_gains(irb140, KP, KD, 1.35e-4)


@pytest.fixture(scope="session")
def irb140_oracle(irb140):
    return Oracle(irb140.model, rne.to_urdf(irb140.model))


@pytest.fixture(scope="session")
def two():
    """Two links in a line."""
    return rne.Robot(straight_chain(2))


@pytest.fixture(scope="session")
def ur5():
    return loaded("ur_description/ur5_robot")


@pytest.fixture(scope="session")
def ur5_oracle(ur5):
    return Oracle(ur5.model, data_robots()["ur_description/ur5_robot"].read_text())
