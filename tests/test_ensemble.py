"""Many starts at once are the single motions, on any executor, to the order of the method."""

import re
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import nullcontext

import numpy as np
import pytest

import rne
from benchmarks.random_robots import straight_chain

from .helpers import states


@pytest.fixture(scope="module")
def starts():
    q, qd, _ = states(2, 40, rate=1.0)
    return q, qd


@pytest.fixture(scope="module")
def chain():
    return rne.Robot(straight_chain(2))


@pytest.fixture(scope="module")
def exact(chain, starts):
    """Positions after 0.2 s."""
    return np.array(
        [rne.simulate(chain, q, qd, 0.2, rtol=1e-12, atol=1e-13).q[-1] for q, qd in zip(*starts, strict=True)]
    )


@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("semi-implicit-euler", 1)])
def test_each_method_has_its_order(chain, starts, exact, method, order):
    errors = [
        np.abs(rne.ensemble(chain, *starts, 0.2, step=h, method=method).q[-1] - exact).max() for h in (0.01, 0.005)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.35)


def test_rk4_has_its_order_under_a_law_that_changes_with_time(chain, starts):
    """Each stage is evaluated at its own time."""
    law = rne.traceable(lambda t, q, qd: rne.elementwise.tanh(10 * t) + 0 * q)
    scene, (q, qd) = rne.Scene(chain, controller=law), (x[:5] for x in starts)
    exact = np.array([rne.simulate(scene, *s, 0.2, rtol=1e-12, atol=1e-13).q[-1] for s in zip(q, qd, strict=True)])
    errors = [np.abs(rne.ensemble(scene, q, qd, 0.2, step=h).q[-1] - exact).max() for h in (0.004, 0.002)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.35)


def test_times_and_energies_are_those_of_single_motions(irb140):
    law = rne.control.pd_gravity(irb140, [50] * 6, [20] * 6, [0] * 6)
    scene = rne.Scene(irb140, controller=law, friction=rne.Friction(viscous=1.0), armature=[1.0] * 6)
    q = states(6, 5)[0] * 0.1
    runs = rne.ensemble(scene, q, 0 * q, 0.1, step=1e-3, keep=3)
    assert runs.t.tolist() == [0.0, 0.05, 0.1]
    assert runs.ledger == ("drives", "viscous")
    alone = rne.simulate(scene, q[2], [0] * 6, 0.1, rtol=1e-10, atol=1e-12)
    assert np.abs(runs.q[-1, 2] - alone.q[-1]).max() <= 1e-8
    assert runs.energies[-1, 2] == pytest.approx([alone.work[-1], alone.dissipated["viscous"][-1]], abs=1e-6)
    assert runs.evaluations == 4 * 100 * 5


def test_progress_is_told(chain, starts):
    told = []
    rne.ensemble(chain, *starts, 0.1, step=0.01, progress=lambda done, total: told.append((done, total)))
    assert told[-1] == (400, 400)
    assert [done for done, _ in told] == sorted(done for done, _ in told)


def test_a_process_pool_gives_the_same(chain, starts):
    here = rne.ensemble(chain, *starts, 0.1, step=0.01)
    with ProcessPoolExecutor(2) as pool:
        there = rne.ensemble(chain, *starts, 0.1, step=0.01, executor=pool)
    assert np.abs(here.q - there.q).max() <= 1e-13


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_a_dask_cluster_gives_the_same(chain, starts):
    """A local cluster's executor is one like any other."""
    from distributed import Client, LocalCluster

    here = rne.ensemble(chain, *starts, 0.1, step=0.01)
    pages = dict.fromkeys(["dashboard_address", "worker_dashboard_address"], "127.0.0.1:0")  # not on the network
    with (
        LocalCluster(n_workers=1, threads_per_worker=1, processes=False, **pages) as cluster,
        Client(cluster) as client,
    ):
        there = rne.ensemble(chain, *starts, 0.1, step=0.01, executor=client.get_executor())
    assert np.abs(here.q - there.q).max() <= 1e-13


def test_no_starts_give_no_motions(chain):
    empty = np.zeros((0, 2))
    assert rne.ensemble(chain, empty, empty, 0.1, step=0.01).q.shape == (2, 0, 2)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"q0": [0, 0]}, "`q0` and `qd0` must have the same shape (N, 2), got (2,) and (1, 2)"),
        ({"step": 0}, "`step` must be positive, got 0.0"),
        (
            {"method": "euler"},
            "`method` must be one of ['rk4', 'semi-implicit-euler'], got 'euler'",
        ),
        ({"keep": 1}, "`keep` must be a whole number, at least 2, got 1"),
    ],
)
def test_wrong_arguments_are_named(chain, changes, text):
    arguments = {"q0": [[0, 0]], "qd0": [[0, 0]], "step": 0.01, **changes}
    with pytest.raises(ValueError, match=rf"^{re.escape(text)}$"):
        rne.ensemble(chain, duration=0.1, **arguments)


@pytest.mark.parametrize("parallel", [False, True])
def test_a_start_that_diverges_is_named_with_its_time(chain, parallel):
    scene = rne.Scene(chain, controller=rne.traceable(lambda t, q, qd: 1e3 * qd**3))
    starts = np.zeros((20, 2))
    rates = starts.copy()
    rates[13, 0] = 1.0
    text = r"^start 13 at t = 0\.0\d+ s: the right-hand side overflows"
    pool = ThreadPoolExecutor(2) if parallel else nullcontext()
    with pool as executor, pytest.raises(rne.NotFiniteError, match=text):
        rne.ensemble(scene, starts, rates, 0.5, step=1e-2, executor=executor)


def test_steps_too_long_for_friction_are_doubted(irb140):
    """Friction of 5 N m s/rad stops the light last joint in much less than a step; a thousandth of it does not."""
    start = np.full((1, 6), 0.1)
    text = (
        "start 0 at t = 0.015 s: the right-hand side overflows float64 for these arguments; the result is not finite; "
        "steps of 0.002 s may be too long for the fastest decay: try shorter ones"
    )
    scene = rne.Scene(irb140, friction=rne.Friction(viscous=5.0))
    with pytest.raises(rne.NotFiniteError, match=f"^{re.escape(text)}$"):
        rne.ensemble(scene, start, 0 * start, 0.1, step=2e-3)
    weak = rne.Scene(irb140, friction=rne.Friction(viscous=5e-3))
    assert abs(rne.ensemble(weak, start, 0 * start, 0.1, step=2e-3).q).max() < 1


def test_called_laws_are_refused(chain):
    scene = rne.Scene(chain, controller=lambda t, q, qd: -qd)
    with pytest.raises(
        ValueError, match=r"^the controller of an ensemble must be traceable \(mark it with rne.traceable\)$"
    ):
        rne.ensemble(scene, [[0, 0]], [[0, 0]], 0.1, step=0.01)


def test_a_law_that_other_processes_cannot_receive_is_named(chain):
    scene = rne.Scene(chain, controller=rne.traceable(lambda t, q, qd: -q))
    with ProcessPoolExecutor(1) as executor, pytest.raises(ValueError, match="cannot be sent") as error:
        rne.ensemble(scene, np.zeros((4, 2)), np.zeros((4, 2)), 0.01, step=1e-3, executor=executor)
    told = str(error.value)
    assert told.startswith("the controller cannot be sent to the processes of `executor`: ")
    assert told.endswith(
        "; define it by `def` or `class` at the top level of a module, not inside a function and not by `lambda`"
    )
