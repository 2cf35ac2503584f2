"""Laws with memory in several threads: motions are those of one thread, whatever holds the memory."""

import copy
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest

import rne
from rne.simulation import ensembles

from .helpers import kept
from .random_robots import straight_chain

PENDULUM = rne.Robot(straight_chain(1))
STARTS = np.array([[0.3], [-0.4], [0.9]])
PERIOD = 2e-3


@pytest.fixture(autouse=True)
def frequent_switches():
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


class Held:
    """Velocities are differences of positions; the last one is kept where `memory` says."""

    def __init__(self):
        self.memory = self

    def __call__(self, t, q, qd):
        if t == 0:
            self.memory.last = q
        time.sleep(0)  # others may run
        velocity, self.memory.last = (q - self.memory.last) / PERIOD, q
        return -20 * q - 3 * velocity


class OfClass(Held):
    """The memory is the class's."""

    def __init__(self):
        self.memory = type(self)


class Locked(Held):
    """A law that cannot be copied."""

    def __init__(self):
        super().__init__()
        self.lock = threading.Lock()


def closure():
    law = OfClass()
    return lambda t, q, qd: law(t, q, qd)


LAWS = {"object": Held, "class": OfClass, "not copied": Locked, "closure": closure, "method": lambda: Held().__call__}


def motions(law, executor=None):
    scene = rne.Scene(PENDULUM, controller=law, sample_time=PERIOD)
    return rne.ensemble(scene, STARTS, 0 * STARTS, 0.02, executor=executor)


@pytest.mark.parametrize("kind", kept([*LAWS], ["object", "class", "not copied"]))
def test_an_ensemble_in_threads_is_that_of_one_thread(kind):
    with ThreadPoolExecutor(3) as pool:
        together = motions(LAWS[kind](), pool)
    assert np.array_equal(together.q, motions(LAWS[kind]()).q)


def test_so_is_one_whose_plan_other_threads_unpickle():
    """As threads of a cluster's worker do."""
    scene = rne.Scene(PENDULUM, controller=OfClass(), sample_time=PERIOD)
    with ThreadPoolExecutor(3) as pool:
        client = SimpleNamespace(submit=pool.submit)  # is no pool of threads that could be seen
        together = rne.ensemble(scene, STARTS, 0 * STARTS, 0.02, executor=client)
    assert np.array_equal(together.q, motions(OfClass()).q)
    ensembles._unpickled.cache_clear()


def test_motions_do_not_hand_on_the_memory_of_a_law():
    class Late:
        """Torques of the call before, also of the last motion's if it is not forgotten."""

        before = np.zeros(1)

        def __call__(self, t, q, qd):
            given, self.before = self.before, -20 * q - 3 * qd
            return given

    law = Late()
    together = motions(law)
    for k, start in enumerate(STARTS):
        alone = rne.simulate(rne.Scene(PENDULUM, controller=Late(), sample_time=PERIOD), start, [0.0], 0.02)
        assert np.array_equal(together.q[-1, k], alone.q[-1])
    assert law.before is Late.before


def test_two_threads_may_simulate_with_one_law():
    law = Held()

    def end(start):
        return rne.simulate(rne.Scene(PENDULUM, controller=law, sample_time=PERIOD), start, [0.0], 0.02).q[-1]

    with ThreadPoolExecutor(3) as pool:
        together = list(pool.map(end, STARTS))
    assert np.array_equal(together, [end(start) for start in STARTS])


def test_motions_without_a_called_law_do_not_wait():
    """Two that wait for each other end."""
    meet = threading.Barrier(2, timeout=60)
    scene = rne.Scene(PENDULUM, controller=rne.traceable(lambda t, q, qd: -q))

    def run(_):
        return rne.simulate(scene, [0.1], [0.0], 0.01, progress=lambda t, end: meet.wait() if t == end else None).status

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(run, range(2))) == [0, 0]


def test_copies_of_laws_share_robots_and_kernels():
    """Which never change, and are not traced anew for each motion."""
    kernel = PENDULUM.kernel(rne.dynamics.gravity_torque)
    law = {"robot": PENDULUM, "kernel": kernel, "memory": []}
    own = copy.deepcopy(law)
    assert own["robot"] is PENDULUM
    assert own["kernel"] is kernel
    assert own["memory"] is not law["memory"]
