"""Many starts at once are the single motions, on any executor, to the tolerance or the order of the method."""

import re
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest

import rne
from rne.elementwise import less
from rne.integrators import lanes, rows, step_control, tableaus
from rne.kernels import Kernel
from rne.simulation import ensembles

from .helpers import address_by_numpy, kept, loaded, states
from .random_robots import straight_chain


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


@pytest.mark.parametrize(("step", "total"), [(0.01, 400), (None, 40)])
def test_progress_is_told(chain, starts, step, total):
    """In steps, or in motions where each has its own."""
    told = []
    rne.ensemble(chain, *starts, 0.1, step=step, progress=lambda *counts: told.append(counts))
    assert told[-1] == (total, total)
    assert [done for done, _ in told] == sorted(done for done, _ in told)


def test_progress_counts_motions_that_have_reached_the_end(chain):
    """Not those that have reached a break of the torques: behind it these diverge."""

    @rne.traceable
    class Push:
        breaks = (0.05,)

        def __call__(self, t, q, qd):
            return rne.elementwise.where(rne.elementwise.less(t, 0.05), 0 * q, 1e3 * qd**3)

    scene, told = rne.Scene(chain, controller=Push()), []
    with pytest.raises(rne.NotFiniteError, match=r"^start 0 at t = "):
        rne.ensemble(scene, np.zeros((2, 2)), np.ones((2, 2)), 0.5, progress=lambda *counts: told.append(counts))
    assert told == []


def test_a_process_pool_gives_the_same(chain, starts):
    here = rne.ensemble(chain, *starts, 0.1, step=0.01)
    with ProcessPoolExecutor(2) as pool:
        there = rne.ensemble(chain, *starts, 0.1, step=0.01, executor=pool)
    assert np.abs(here.q - there.q).max() <= 1e-13


def test_few_motions_make_two_shares_in_numpy(chain, starts):
    """Side by side, 20 cost about as much as 40."""

    class Counting(ThreadPoolExecutor):
        count = 0

        def submit(self, *arguments):
            self.count += 1
            return super().submit(*arguments)

    with Counting(2) as pool:
        rne.ensemble(chain, *starts, 0.01, step=0.01, executor=pool)
    assert pool.count == 2


def test_a_client_is_taken_for_its_executor(chain, starts):
    """Its own futures are not those of concurrent.futures."""
    here = rne.ensemble(chain, *starts, 0.1)
    with ThreadPoolExecutor(1) as pool:
        client = SimpleNamespace(get_executor=lambda: pool, submit=None)
        there = rne.ensemble(chain, *starts, 0.1, executor=client)
    assert np.array_equal(here.q, there.q)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_a_dask_cluster_gives_the_same(chain, starts):
    """A client is taken as it is, and its executor is one like any other."""
    from distributed import Client, LocalCluster

    here = rne.ensemble(chain, *starts, 0.1, step=0.01)
    pages = dict.fromkeys(["dashboard_address", "worker_dashboard_address"], "127.0.0.1:0")  # not on the network
    with (
        LocalCluster(n_workers=1, threads_per_worker=1, processes=False, **pages) as cluster,
        Client(cluster) as client,
    ):
        there = [rne.ensemble(chain, *starts, 0.1, step=0.01, executor=e) for e in (client, client.get_executor())]
    assert max(np.abs(here.q - runs.q).max() for runs in there) <= 1e-13


@pytest.fixture(scope="module", params=kept(["chain", "irb140"], ["chain"]))
def smooth(request):
    """All that motions side by side may have: a law of time and state, friction, limits of the torques."""
    robot = request.getfixturevalue(request.param)

    @rne.traceable
    def law(t, q, qd):
        return 40 * rne.elementwise.tanh(20 * t) - 60 * q - 20 * qd

    friction = rne.Friction(viscous=1.0, coulomb=2.0)
    return rne.Scene(robot, controller=law, friction=friction, armature=1.0, effort_limit=30.0)


@pytest.fixture(scope="module")
def many(smooth):
    q, qd, _ = states(smooth.n, 9, rate=1.0)
    return q, qd


TIMES = [0.02, 0.05, 0.051, 0.2, 0.25]
ROUGHLY = {"method": "RK45", "rtol": 1e-2, "atol": 1e-2}


@pytest.fixture(scope="module")
def alone(smooth, many):
    """Three of them by themselves, at the tightest tolerance."""
    exact = {"rtol": 1e-12, "atol": 1e-13, "t_eval": TIMES}
    return [rne.simulate(smooth, many[0][k], many[1][k], 0.25, **exact) for k in range(3)]


def worst(runs, alone, name):
    """Largest difference of a quantity from motions by themselves."""
    return max(np.abs(getattr(runs, name)[:, k] - getattr(one, name)).max() for k, one in enumerate(alone))


@pytest.mark.parametrize(("method", "rtol"), kept([("DOP853", 1e-9), ("RK45", 1e-7)], [("DOP853", 1e-7)]))
def test_errors_are_of_the_size_of_the_tolerance(smooth, many, alone, method, rtol):
    """Some hundred tolerances: errors of steps add up, and friction is stiff where it changes its sign."""
    runs = rne.ensemble(smooth, *many, 0.25, rtol=rtol, atol=rtol / 1e3, t_eval=TIMES, method=method)
    assert runs.t.tolist() == TIMES
    assert (runs.method, runs.step) == (method, None)
    assert worst(runs, alone, "q") <= 300 * rtol
    assert worst(runs, alone, "qd") <= 3000 * rtol
    assert worst(runs, alone, "tau") <= 3e5 * rtol  # gains of 60 and 20
    for column, name in enumerate(runs.ledger):
        for k, one in enumerate(alone):
            expected = one.work if name == "drives" else one.dissipated[name]
            assert np.abs(runs.energies[:, k, column] - expected).max() <= 1e5 * rtol


@pytest.mark.parametrize(
    ("robot", "end"), [pytest.param("irb140", 0.3, marks=pytest.mark.long), ("chain", 0.1)], ids=["irb140", "chain"]
)
def test_smoothed_friction_is_resolved(robot, end, request):
    """Friction changes its sign within fixed steps: of 0.25 to 1 ms they are wrong by 5e-3 rad alike, two links' of
    0.5 to 1 ms by 2e-4 rad or more.
    """
    robot = request.getfixturevalue(robot)
    scene, q = rne.Scene(robot, friction=rne.Friction(viscous=1, coulomb=2)), states(robot.n, 2)[0]
    exact = np.array([rne.simulate(scene, one, 0 * one, end, rtol=1e-8, atol=1e-10).q[-1] for one in q])
    assert np.abs(rne.ensemble(scene, q, 0 * q, end).q[-1] - exact).max() <= 1e-4


@pytest.mark.parametrize("method", kept(["DOP853", "RK45"], ["DOP853"]))
def test_no_motion_changes_the_bits_of_another(smooth, many, method):
    """Not by its presence, nor by its place, nor by the chunk."""
    how, end = {"t_eval": TIMES[:3], "method": method}, 0.1
    runs, order = rne.ensemble(smooth, *many, end, **how), np.random.default_rng(0).permutation(9)[:5]
    some = rne.ensemble(smooth, *(x[order] for x in many), end, **how)
    with ThreadPoolExecutor(2) as pool:
        shared = rne.ensemble(smooth, *many, end, **how, executor=pool)
    for name in ("q", "qd", "tau", "energies"):
        assert np.array_equal(getattr(some, name), getattr(runs, name)[:, order]), name
        assert np.array_equal(getattr(shared, name), getattr(runs, name)), name


def test_a_state_that_must_be_examined_changes_no_other(chain, starts):
    """Beyond some velocities the recursion examines each state."""
    q, qd = (x[:6].copy() for x in starts)
    calm = rne.ensemble(chain, q, qd, 1e-9)
    qd[2] = 3e8, -2e8
    runs, rest = rne.ensemble(chain, q, qd, 1e-9), [0, 1, 3, 4, 5]
    assert np.array_equal(runs.q[:, rest], calm.q[:, rest])
    fast = rne.simulate(chain, q[2], qd[2], 1e-9, rtol=1e-9)
    np.testing.assert_allclose(runs.q[-1, 2], fast.q[-1], rtol=1e-8)


def test_soundness_is_told_state_by_state(chain):
    program, x = rne.Scene(chain).kernel.blocks, np.full((5, 4), 0.1)
    x[1, 2], x[3, 0] = 1e9, np.nan
    found = np.zeros((5, 4))
    assert program.sound([np.zeros((5, 1)), x], found).tolist() == [True, False, True, False, True]
    assert np.array_equal(found[[0, 2, 4]], np.tile(found[0], (3, 1)))


def test_torques_that_jump_end_a_step(chain, starts):
    @rne.traceable
    class Push:
        breaks = (0.0503, 0.12)

        def __call__(self, t, q, qd):
            return rne.elementwise.where(rne.elementwise.less(t, 0.0503), 4.0, -3.0) + 0 * q

    scene, (q, qd) = rne.Scene(chain, controller=Push()), (x[:3] for x in starts)
    times = [0.05, 0.0503, 0.1, 0.2]
    runs = rne.ensemble(scene, q, qd, 0.2, t_eval=times, rtol=1e-10)
    assert (
        runs.evaluations <= 1500
    )  # of 936; on the other side of a jump the error estimate would cut the step again and again
    for k in range(3):
        one = rne.simulate(scene, q[k], qd[k], 0.2, t_eval=times, rtol=1e-12, atol=1e-13)
        assert np.abs(runs.q[:, k] - one.q).max() <= 1e-9


def test_times_are_the_start_and_the_end_unless_they_are_asked_for(chain, starts):
    assert rne.ensemble(chain, *starts, 0.1).t.tolist() == [0.0, 0.1]
    runs = rne.ensemble(chain, *starts, 0.1, keep=5)
    asked = rne.ensemble(chain, *starts, 0.1, t_eval=np.linspace(0, 0.1, 5))
    assert np.array_equal(runs.q, asked.q)
    assert np.array_equal(runs.q[0], starts[0])
    assert not runs.status.any()
    assert (runs.end == 0.1).all()
    uneven = rne.ensemble(chain, *starts, 0.1, t_eval=[0.013, 0.1], step=1e-3)
    finer = rne.ensemble(chain, *starts, 0.1, t_eval=[0.013, 0.1], rtol=1e-10)
    assert np.abs(uneven.q - finer.q).max() <= 1e-9  # RK4 with its error of h^4


def test_stiff_motions_are_run_as_alone(chain, monkeypatch):
    """Friction whose decay holds an explicit method to a million steps: after a few it is left to rne.simulate."""
    monkeypatch.setattr(rows, "LOOK", 100)
    scene, q = rne.Scene(chain, friction=rne.Friction(viscous=5000.0)), np.array([[0.1, 0.2], [0.3, -0.2]])
    runs = rne.ensemble(scene, q, 0 * q, 0.25)
    one = rne.simulate(scene, q[1], [0, 0], 0.25)
    assert runs.method == one.method
    assert np.array_equal(runs.q[-1, 1], one.q[-1])
    assert runs.evaluations < 50_000
    assert runs.energies[-1, 1, 0] == one.dissipated["viscous"][-1]


class TestSequentialRun:
    """Scenes with events, samples and called laws: as rne.simulate runs them."""

    def test_of_stops(self, chain):
        model = replace(chain.model, lower=np.array([-0.1, -3.0]), upper=np.array([3.0, 3.0]))
        scene, q = rne.Scene(rne.Robot(model), stops=True), np.array([[0.5, 0.2], [0.0, 0.0]])
        runs = rne.ensemble(scene, q, 0 * q, 3.0, keep=31)
        one = rne.simulate(scene, q[0], [0, 0], 3.0, t_eval=runs.t)
        assert runs.status.tolist() == [one.status, 0 if runs.end[1] == 3.0 else 1]
        assert runs.status[0] == 1
        assert runs.end[0] == one.t[-1] < 3.0
        later = runs.t > one.t[-1]
        assert np.array_equal(runs.q[~later, 0], one.q[: (~later).sum()])
        assert (runs.q[later, 0] == one.q[-1]).all()
        assert "stopped" in repr(runs)

    def test_of_dry_friction_with_parameters(self, chain):
        scene = rne.Scene(chain, friction=rne.Friction(coulomb=3.0, smoothing=0.0))
        q, pi = np.array([[0.5, 0.2], [0.1, -0.4]]), np.array([chain.parameters, 2 * chain.parameters])
        runs = rne.ensemble(scene, q, 0 * q, 0.5, parameters=pi)
        heavier = replace(scene, robot=chain.with_parameters(pi[1]))
        one = rne.simulate(heavier, q[1], [0, 0], 0.5)
        np.testing.assert_allclose(runs.q[-1, 1], one.q[-1], atol=1e-9)
        np.testing.assert_allclose(runs.energies[-1, 1], [one.dissipated["coulomb"][-1]], atol=1e-7)

    @pytest.mark.parametrize("sample_time", [None, 0.01])
    def test_of_called_and_sampled_laws(self, chain, sample_time):
        scene = rne.Scene(chain, controller=lambda t, q, qd: -3 * q - qd, sample_time=sample_time)
        q, told = np.array([[0.5, 0.2], [0.1, -0.4]]), []
        runs = rne.ensemble(scene, q, 0 * q, 0.1, progress=lambda *counts: told.append(counts))
        one = rne.simulate(scene, q[1], [0, 0], 0.1)
        for name in ("q", "qd", "tau"):
            assert np.array_equal(getattr(runs, name)[-1, 1], getattr(one, name)[-1])
        assert runs.energies[-1, 1, 0] == one.work[-1]
        assert told == [(1, 2), (2, 2)]

    def test_a_failure_is_named(self, chain):
        scene = rne.Scene(chain, controller=lambda t, q, qd: q * np.nan if q[0] > 1 else q)
        with pytest.raises(
            rne.SimulationError, match=r"^start 1: simulation stopped at t = 0 s of 0.1 s: torque of"
        ) as e:
            rne.ensemble(scene, [[0.5, 0], [1.5, 0]], np.zeros((2, 2)), 0.1)
        assert e.value.time == 0.0
        assert e.value.trajectory.q.shape[1] == 2

    def test_a_wrong_law_is_named_with_its_start(self, chain):
        scene = rne.Scene(chain, controller=lambda t, q, qd: q[:1] if q[0] > 1 else q)
        with pytest.raises(ValueError, match=r"^start 1: `controller` must return"):
            rne.ensemble(scene, [[0.5, 0], [1.5, 0]], np.zeros((2, 2)), 0.1)


def rates_of(scene):
    """The kernel of the motion alone, without its energies, and the numbers of the scene."""
    dynamics = replace(scene.dynamics, has_energies=False)
    return scene.kernels.scene_kernel(dynamics.right_hand_side), dynamics.vector


class TestLanes:
    """The loop for machine code, its text run by Python, beside NumPy's rows."""

    @pytest.fixture
    def plain(self, monkeypatch):
        monkeypatch.setattr(Kernel, "address", address_by_numpy)
        monkeypatch.setattr(lanes, "compiled", lambda text: text)

    @pytest.mark.parametrize("count", [3, lanes.LANES + 3])
    @pytest.mark.parametrize("method", ["DOP853", "RK45", "rk4", "semi-implicit-euler"])
    def test_are_the_rows(self, plain, chain, starts, count, method):
        law = rne.traceable(lambda t, q, qd: rne.elementwise.tanh(10 * t) + 0 * q)
        (kernel, numbers), fixed = rates_of(rne.Scene(chain, controller=law)), method in ("rk4", "semi-implicit-euler")
        times, grid = np.array([0.05, 0.07, 0.2]), np.linspace(0, 0.2, 21 if fixed else 0)
        t_eval, positions = grid[[5, 7, 20]] if fixed else times, 2 * (method == "semi-implicit-euler")
        options = {"t_eval": t_eval, "grid": grid, "positions": positions}
        how = (
            step_control.Interval(tableaus.tableau(method), 0.0, 0.2, -np.inf, np.inf, 1e-4, 1e-7, 4, **options),
            kernel,
        )
        x = np.concatenate(starts, axis=1)[:count]
        X, expected = np.full((2, 3, count, 4), np.nan)
        told = []
        found = lanes.run_lanes(*how, numbers, x, X, told.append)
        assert found.is_done
        assert sum(told) == count * max(1, len(grid) - 1)
        by_rows = rows.run_rows(*how, numbers, np.arange(count), x, expected, lambda done: None)
        assert not found.code.any()
        np.testing.assert_allclose(X, expected, rtol=1e-9, atol=1e-9)  # rounding moves the estimates of errors
        assert 0.9 * by_rows.evaluations <= found.evaluations <= 1.1 * by_rows.evaluations

    def test_motions_to_be_examined_are_left(self, plain, chain, starts):
        (kernel, numbers), x = rates_of(rne.Scene(chain)), np.concatenate(starts, axis=1)[:12]
        interval = step_control.Interval(
            tableaus.tableau("RK45"), 0.0, 1e-9, -np.inf, np.inf, 1e-3, 1e-6, 4, t_eval=np.array([1e-9])
        )
        x[[0, 7], 2:] = 3e8, -2e8
        x[11, 1] = np.inf
        X, told = np.full((1, 12, 4), np.nan), []
        code = lanes.run_lanes(interval, kernel, numbers, x, X, told.append).code
        assert sum(told) == 9
        left = np.flatnonzero(code)
        assert left.tolist() == [0, 7, 11]
        rest = np.delete(np.arange(12), left)
        np.testing.assert_allclose(X[0, rest], x[rest], atol=1e-7)

    def test_states_to_be_examined_are_finished_by_rows(self, plain, chain, starts):
        q, qd = (x[:3].copy() for x in starts)
        qd[1] = 3e8, -2e8
        runs, expected = (rne.ensemble(rne.Robot(chain.model, e), q, qd, 1e-9) for e in ("numba", "numpy"))
        np.testing.assert_allclose(runs.q, expected.q, rtol=1e-9)  # rounding, as above
        assert runs.evaluations <= 1.1 * expected.evaluations

    @pytest.mark.parametrize(("viscous", "code"), [(0.1, 0), (5000.0, 2)])
    def test_stiff_motions_alone_are_left(self, plain, chain, starts, monkeypatch, viscous, code):
        monkeypatch.setattr(lanes, "LOOK", 10)  # steps, whatever the pace
        monkeypatch.setattr(lanes, "SLOW", 0)
        x, X = np.concatenate(starts, axis=1)[:3], np.full((1, 3, 4), np.nan)
        t_eval = np.array([min(0.2, 5 / viscous)])
        interval = step_control.Interval(
            tableaus.tableau("RK45"), 0.0, t_eval[0], -np.inf, np.inf, 1e-6, 1e-9, 4, t_eval=t_eval, watched=1
        )
        kernel, numbers = rates_of(rne.Scene(chain, friction=rne.Friction(viscous=viscous)))
        found = lanes.run_lanes(interval, kernel, numbers, x, X, lambda count: None)
        assert found.code.tolist() == [code] * 3

    @pytest.mark.parametrize("method", ["RK45", "rk4"])
    def test_calls_of_few_evaluations_give_the_same_bits(self, plain, chain, starts, monkeypatch, method):
        """And each returns after no more than that, so that Ctrl-C is heard."""
        q, qd = (x[: lanes.LANES + 3] for x in starts)
        how = {"t_eval": [0.02, 0.05], "method": method, "step": 0.005 if method == "rk4" else None}
        robot = rne.Robot(chain.model, "numba")
        at_once = rne.ensemble(robot, q, qd, 0.05, **how)
        monkeypatch.setattr(lanes, "OPERATIONS", 1)
        counted, between = [0], []
        evaluate = lanes.evaluate

        def counts(*arguments):
            counted[0] += 1
            return evaluate(*arguments)

        run_all = lanes.run_all
        monkeypatch.setattr(lanes, "evaluate", counts)

        def one_call(*arguments):
            counted[0] = 0
            found = run_all(*arguments)
            between.append(counted[0])
            return found

        monkeypatch.setattr(lanes, "run_all", one_call)
        again = rne.ensemble(robot, q, qd, 0.05, **how)
        assert np.array_equal(again.q, at_once.q)
        assert again.evaluations == at_once.evaluations
        assert len(between) > 4
        assert max(between) <= 8  # a step of 7 stages

    def test_ctrl_c_leaves_what_was_finished(self, plain, chain, starts, monkeypatch):
        monkeypatch.setattr(lanes, "OPERATIONS", 1)
        check_interrupt(rne.Robot(chain.model, "numba"), starts)


def check_interrupt(scene, starts, after=12, **how):
    """Finished motions are those of an ensemble that was not interrupted; the others are NaN behind their ends."""
    whole, calls = rne.ensemble(scene, *starts, 0.1, t_eval=[0, 0.05, 0.1], **how), [0]

    def interrupt(done, total):
        calls[0] = done
        if done >= after:
            raise KeyboardInterrupt

    with pytest.raises(rne.SimulationInterrupted) as error:
        rne.ensemble(scene, *starts, 0.1, t_eval=[0, 0.05, 0.1], progress=interrupt, **how)
    runs = error.value.trajectory
    assert runs.q.shape == whole.q.shape
    finished = runs.status == 0
    assert str(error.value) == f"ensemble interrupted: {finished.sum()} of 40 motions finished"
    assert (runs.status[~finished] == -1).all()
    assert error.value.time == runs.end.min()
    assert f"{(~finished).sum()} motions interrupted" in repr(runs)
    later = runs.t[:, None] > runs.end
    for name in ("q", "qd", "tau", "energies"):
        values, expected = getattr(runs, name), getattr(whole, name)
        assert np.array_equal(values[:, finished], expected[:, finished])
        assert np.isnan(values[later]).all()
        known = ~np.isnan(values)
        assert np.array_equal(values[known], expected[known])
    if finished.any():
        assert np.isfinite(runs.quantiles(0.5)).all()
    else:
        with pytest.raises(ValueError, match=r"^there are no motions to take quantiles of$"):
            runs.quantiles(0.5)
    return runs


class TestInterrupt:
    def test_of_motions_side_by_side(self, chain, starts):
        runs = check_interrupt(chain, starts, method="RK45")
        assert 0 < (runs.status == 0).sum() < 40

    def test_of_equal_steps_keeps_what_was_reported(self, chain, starts):
        runs = check_interrupt(chain, starts, after=40 * 7, step=0.01)
        assert set(runs.end) == {0.05}

    def test_of_float32_stays_float32(self, chain, starts):
        few = [x.astype(np.float32) for x in starts]
        assert rne.ensemble(chain, *few, 0.1, step=0.01).q.dtype == np.float32
        assert check_interrupt(chain, few, after=40 * 7, step=0.01).q.dtype == np.float32

    def test_of_motions_one_after_another(self, chain, starts):
        scene = rne.Scene(chain, controller=lambda t, q, qd: -qd)
        runs = check_interrupt(scene, starts, after=2)
        assert (runs.status == 0).sum() == 2

    def test_within_one_of_them(self, chain, starts):
        """What the motion so far reported is kept."""
        count = [0]

        def law(t, q, qd):
            count[0] += 1
            if t > 0.09 and count[0] > 1000:
                raise KeyboardInterrupt
            return -qd

        with pytest.raises(rne.SimulationInterrupted) as error:
            rne.ensemble(rne.Scene(chain, controller=law), *starts, 0.1, t_eval=[0, 0.05, 0.1], rtol=1e-9)
        runs = error.value.trajectory
        (last,) = np.flatnonzero(runs.end == 0.05)
        assert runs.status.tolist() == [0] * last + [-1] * (40 - last)
        assert np.isfinite(runs.q[:2, last]).all()
        assert np.isnan(runs.q[2, last]).all()

    def test_of_threads_stops_those_that_run(self, chain, starts, monkeypatch):
        monkeypatch.setattr(ensembles, "CHUNK", 5)
        with ThreadPoolExecutor(2) as executor:
            runs = check_interrupt(chain, starts, after=5, executor=executor)
        assert (runs.status == 0).sum() >= 5

    def test_a_thread_ends_at_its_next_report_after_it_is_told_to_stop(self):
        stop, reported = Event(), []

        def run(chunk, advance):
            for k in range(3):
                advance(1)
                reported.append(k)
                stop.set()

        with pytest.raises(KeyboardInterrupt):
            ensembles.run_elsewhere(SimpleNamespace(run=run), None, stop)
        assert reported == [0]


@pytest.mark.parametrize("engine", ["numpy", "numba"])
@pytest.mark.parametrize("how", [{}, {"step": 0.01}, {"step": 0.01, "method": "semi-implicit-euler"}])
def test_a_robot_without_joints(engine, how):
    robot = rne.Robot(rne.dh_chain(a=[], alpha=[], d=[], theta=[]), engine)
    runs = rne.ensemble(robot, np.zeros((3, 0)), np.zeros((3, 0)), 0.1, **how)
    assert runs.q.shape == (2, 3, 0)
    assert runs.end.tolist() == [0.1] * 3


def test_a_first_step_that_is_no_number_is_named():
    """At 1e150 rad/s the squares of accelerations over the tolerance overflow; M is not singular."""
    fast = np.full((1, 6), 1e150)
    with pytest.raises(
        rne.NotFiniteError, match=r"^start 0 at t = 0 s: the step needed is less than the spacing between numbers$"
    ):
        rne.ensemble(loaded("irb140"), 0 * fast, fast, 0.1)


@pytest.mark.parametrize("engine", ["numpy", "lanes"])
def test_a_motion_without_end_is_given_up(chain, engine, monkeypatch):
    """Of 1e20 rad/s steps would be 1e-21 s long."""
    how = step_control.Interval(tableaus.tableau("RK45"), 0.0, 1.0, -np.inf, np.inf, 1e-3, 1e-6, 4, t_eval=np.ones(1))
    x, X = np.array([[0, 0, 1.0, 1.0], [0, 0, 1e20, 0]]), np.full((1, 2, 4), np.nan)
    kernel = SimpleNamespace(operations={}, is_unrolled=True, engine="numpy", coefficients=lambda numbers: numbers)
    kernel.traced = SimpleNamespace(widths=(1, 4, 0))
    turning = lambda t, x: np.stack([x[:, 2], x[:, 3], -x[:, 2] * np.sin(x[:, 0]) * x[:, 2], 0 * x[:, 3]], axis=1)  # noqa: E731

    def sound(given, out):
        out[:] = turning(*given[:2])
        return np.ones(len(out), dtype=bool)

    if engine == "numpy":
        kernel.blocks = SimpleNamespace(sound=sound)
        with pytest.raises(
            rne.NotFiniteError,
            match=r"^start 1 at t = \d\.\d+e-\d+ s: 100 steps came no further, and the motion would take more than 1e\+10$",
        ):
            rows.run_rows(how, kernel, np.zeros(0), np.arange(2), x, X, lambda count: None)
        return
    monkeypatch.setattr(lanes, "compiled", lambda text: text)

    def function(t, x, numbers, out):
        return sound([t.reshape(1, -1).T, x.reshape(4, -1).T], out.reshape(4, -1).T).all()

    kernel.address = lambda lanes, common: function
    code = lanes.run_lanes(how, kernel, np.zeros(0), x, X, lambda count: None).code
    assert code.tolist() == [0, 1]  # the second needs the recursion


@pytest.mark.long
class TestMachineCode:
    """Motions in the lanes of vector registers."""

    @pytest.fixture
    def compiled(self, smooth):
        pytest.importorskip("numba", reason="Numba is not installed")
        return replace(smooth, robot=rne.Robot(smooth.robot.model, "numba"))

    @pytest.mark.parametrize("method", ["DOP853", "RK45"])
    def test_errors_are_of_the_size_of_the_tolerance(self, compiled, many, alone, method):
        test_errors_are_of_the_size_of_the_tolerance(compiled, many, alone, method, 1e-7)

    @pytest.mark.parametrize("method", ["DOP853", "RK45"])
    def test_no_motion_changes_the_bits_of_another(self, compiled, many, method):
        test_no_motion_changes_the_bits_of_another(compiled, many, method)

    def test_with_parameters(self, compiled, many):
        pi = compiled.resolved.robot.parameters * np.linspace(1, 2, 9)[:, None]
        plain = replace(compiled, robot=rne.Robot(compiled.robot.model))
        runs, expected = (rne.ensemble(scene, *many, 0.1, parameters=pi, rtol=1e-9) for scene in (compiled, plain))
        np.testing.assert_allclose(runs.q, expected.q, atol=1e-7)

    def test_states_to_be_examined_are_finished_by_rows(self, chain, starts):
        test_a_state_that_must_be_examined_changes_no_other(rne.Robot(chain.model, "numba"), starts)
        test_a_motion_that_diverges_is_named(rne.Robot(chain.model, "numba"), {})

    def test_stiff_motions_are_run_as_alone(self, chain, monkeypatch):
        test_stiff_motions_are_run_as_alone(rne.Robot(chain.model, "numba"), monkeypatch)

    def test_torques_that_jump_end_a_step(self, chain, starts):
        test_torques_that_jump_end_a_step(rne.Robot(chain.model, "numba"), starts)


@pytest.mark.parametrize("options", kept([{}, ROUGHLY], [ROUGHLY]))
def test_a_motion_that_diverges_is_named(chain, options):
    """Torques of the rates' cube: rates reach infinity in finite time."""
    scene, starts = rne.Scene(chain, controller=rne.traceable(lambda t, q, qd: 1e3 * qd**3)), np.zeros((5, 2))
    rates = starts.copy()
    rates[3, 0] = 1.0
    with pytest.raises(rne.NotFiniteError, match=r"^start 3 at t = \S+ s: the (step needed|right-hand side)"):
        rne.ensemble(scene, starts, rates, 0.1, **options)


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
            "`method` must be 'auto' or one of ['rk4', 'semi-implicit-euler'], got 'euler'",
        ),
        ({"keep": 1}, "`keep` must be a whole number of at least 2, got 1"),
        (
            {"keep": 3, "t_eval": [0.1]},
            "`keep` and `t_eval` are two ways to give the times to report: give one of them",
        ),
        ({"step": None, "rtol": 0}, "`rtol` must be positive, got 0.0"),
        (
            {"parameters": np.ones(20), "numbers": {"parameters": np.ones(20)}},
            "`parameters` and `numbers['parameters']` are the same: give one of them",
        ),
        (
            {"step": None, "method": "rk4"},
            "`method` must be 'auto' or one of ['RK45', 'RK23', 'DOP853', 'Tsit5', 'Radau', 'BDF', 'LSODA', 'Rodas5P'], got "
            "'rk4'; equal steps need `step`",
        ),
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


@pytest.mark.parametrize("parts", [{"stops": True}, {"friction": rne.Friction(coulomb=1.0, smoothing=0)}])
def test_fixed_steps_refuse_events(chain, parts):
    text = "^`step` is not for scenes with `stops` or sticking friction: leave it out$"
    with pytest.raises(ValueError, match=text):
        rne.ensemble(rne.Scene(chain, **parts), [[0, 0]], [[0, 0]], 0.1, step=0.01)


def test_fixed_steps_refuse_called_laws(chain):
    scene = rne.Scene(chain, controller=lambda t, q, qd: -qd)
    with pytest.raises(
        ValueError,
        match=r"^the controller of an ensemble with `step` must be traceable \(mark it with rne.traceable\)$",
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


def test_an_executor_is_no_name():
    message = r"`executor` must be a concurrent\.futures\.Executor or a distributed\.Client, got str"
    with pytest.raises(TypeError, match=message):
        rne.ensemble(rne.load("irb140"), np.zeros((2, 6)), np.zeros((2, 6)), 0.01, executor="dask")


@pytest.mark.parametrize("kind", ["side by side", "float32", "stops", "called"])
def test_torques_at_a_break_are_those_after_it(kind):
    """As those of a single motion, in every way in which an ensemble runs."""

    class Stairs:
        traceable, breaks = kind != "called", (0.0, 0.1, 0.2)

        def __call__(self, t, q, qd):
            return 1.0 + less(0.0, t) + less(0.1, t) + less(0.2, t) + 0 * q

    robot, times = rne.Robot(straight_chain(1)), [0.0, 0.05, 0.1, 0.2]
    scene = rne.Scene(robot, controller=Stairs(), stops=kind == "stops")
    dtype = np.float32 if kind == "float32" else np.float64
    start = np.zeros((2, 1), dtype)
    how = {"step": 0.01} if kind == "float32" else {}
    found = rne.ensemble(scene, start, start, 0.2, t_eval=times, **how).tau[:, :, 0]
    alone = rne.simulate(scene, [0.0], [0.0], 0.2, t_eval=times).tau[:, 0]
    assert alone.tolist() == [2, 2, 3, 4]
    assert (found == alone[:, None]).all()
