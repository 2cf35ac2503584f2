"""Errors of a user's own functions leave a simulation as they are, or as the cause of its error; nothing hides them."""

from functools import partial

import numpy as np
import pytest

import rne
from rne.__main__ import main

from .random_robots import straight_chain

PENDULUM = rne.Robot(straight_chain(1))
REST = [0.1], [0.0]


class Mine(Exception):
    pass


ERRORS = [ZeroDivisionError("mine"), FloatingPointError("mine"), rne.NotFiniteError("mine"), Mine("mine"), KeyError(3)]


def failing(error, begin=0.03):
    """A law that raises an error from some time on."""

    def law(t, q, qd):
        if t >= begin:
            raise error
        return -q - qd

    return law


def causes(error):
    """An error and what caused it."""
    return [] if error is None else [error, *causes(error.__cause__)]


def raised(error, run):
    """The error that leaves a run; that of the user is it or its cause, and knows the line that raised it."""
    error.__traceback__ = None
    with pytest.raises(Exception) as caught:  # noqa: PT011, of any kind
        run()
    assert any(one is error for one in causes(caught.value))
    lines = [frame.name for frame in pytest.ExceptionInfo.from_exception(error).traceback]
    assert "law" in lines or "told" in lines
    return caught.value


RUNS = {
    "torque": lambda law: rne.simulate(PENDULUM, *REST, 0.1, torque=law),
    "implicit": lambda law: rne.simulate(PENDULUM, *REST, 0.1, torque=law, method="LSODA"),
    "sampled": lambda law: rne.simulate(rne.Scene(PENDULUM, controller=law, sample_time=0.01), *REST, 0.1),
    "dry": lambda law: rne.simulate(
        rne.Scene(PENDULUM, friction=rne.Friction(coulomb=0.1, smoothing=0), controller=law), *REST, 0.1
    ),
    "ensemble": lambda law: rne.ensemble(rne.Scene(PENDULUM, controller=law), REST[:1], REST[1:], 0.1),
}


@pytest.mark.parametrize("run", RUNS)
def test_an_error_of_a_law_is_the_cause(run):
    for error in ERRORS:
        found = raised(error, lambda error=error: RUNS[run](failing(error)))
        assert (found is error) == (not isinstance(error, ArithmeticError | rne.NotFiniteError))


@pytest.mark.parametrize("name", ["torque", "controller"])
def test_the_text_names_the_law_and_the_time_of_its_call(name):
    law = failing(ERRORS[0], 0.0)
    scene, given = (PENDULUM, {"torque": law}) if name == "torque" else (rne.Scene(PENDULUM, controller=law), {})
    text = rf"^simulation stopped at t = 0 s of 0.1 s: `{name}` raised ZeroDivisionError at t = 0 s: mine$"
    with pytest.raises(rne.SimulationError, match=text):
        rne.simulate(scene, *REST, 0.1, method="RK45", **given)


@pytest.mark.parametrize("many", [False, True])
def test_an_error_of_progress_leaves_as_it_is(many):
    for error in ERRORS:

        def told(*_, error=error):
            raise error

        starts = (REST[:1], REST[1:]) if many else REST
        run = partial(rne.ensemble if many else rne.simulate, PENDULUM, *starts, 0.1, progress=told)
        assert raised(error, run) is error


def test_an_error_of_a_law_that_is_run_once_more_is_the_cause():
    begin = [np.inf]
    motion = rne.simulate(PENDULUM, *REST, 0.1, torque=lambda t, q, qd: failing(ERRORS[0], begin[0])(t, q, qd))
    begin[0] = 0.0
    assert isinstance(raised(ERRORS[0], motion.trusted_horizon), rne.NotFiniteError)


def test_breaks_that_raise_an_attribute_error_are_not_taken_for_none():
    class Law:
        @property
        def breaks(self):
            return self.not_there

        def __call__(self, t, q, qd):
            return -q

    with pytest.raises(AttributeError, match="not_there"):
        rne.simulate(rne.Scene(PENDULUM, controller=Law()), *REST, 0.1)


@pytest.mark.parametrize("engine", ["numpy", pytest.param("numba", marks=pytest.mark.long)])
@pytest.mark.parametrize("traceable", [True, False])
def test_states_of_a_law_are_integrated_without_joints(engine, traceable):
    """z1' = 1 and z2' = z1 - z2; sampled by Euler's rule."""
    if engine == "numba":
        pytest.importorskip("numba")

    class Clock:
        states, calls = 2, 0

        def __call__(self, t, q, qd, z):
            self.calls += 1
            return np.zeros(0), np.stack([1 + 0 * z[0], z[0] - z[1]])

    law = Clock()
    law.traceable = traceable
    root = rne.Robot(straight_chain(1), engine).locked({"joint0": 0.3})
    motion = rne.simulate(rne.Scene(root, controller=law), [], [], 1.0, t_eval=[0.5, 1.0])
    t = motion.t
    np.testing.assert_allclose(motion.controller_state, np.stack([t, t - 1 + np.exp(-t)], axis=1), atol=1e-6)
    law.calls = 0
    scene = rne.Scene(root, controller=law, sample_time=0.1)
    motion = rne.simulate(scene, [], [], 1.0, t_eval=[0.0, 0.35, 1.0])
    k = np.array([0, 3, 10])
    expected = np.stack([0.1 * k, 0.1 * k - 1 + 0.9**k], axis=1)
    np.testing.assert_allclose(motion.controller_state, expected, atol=1e-12)  # rounding
    assert rne.simulate(scene, [], [], 0.0).controller_state.tolist() == [[0, 0]]


def test_the_column_of_a_locked_joint_is_reported(tmp_path, capsys):
    file = tmp_path / "motion.csv"
    file.write_text("t," + ",".join(f"q.joint_{k}" for k in range(1, 7)) + "\n0,0,0,0,0,0,0.1\n0.1,0,0,0,0,0,0.4\n")
    line = "warning: column 'q.joint_6', from 0.1 to 0.4, is not used: --locked holds the joint at 0.2\n"
    assert main(["torques", "irb140", str(file), "--locked", "joint_6=0.2", "--out", str(tmp_path / "out.csv")]) == 0
    assert line in capsys.readouterr().err


@pytest.mark.parametrize("sample_time", [None, 0.25])
def test_dry_friction_has_nothing_to_hold_without_joints(sample_time):
    class Clock:
        states = 1

        def __call__(self, t, q, qd, z):
            return np.zeros(0), np.ones(1)

    friction = rne.Friction(coulomb=1.0, smoothing=0)
    scene = rne.Scene(PENDULUM, locked={"joint0": 0.3}, friction=friction, controller=Clock(), sample_time=sample_time)
    assert rne.simulate(scene, [], [], 1.0).controller_state[-1] == pytest.approx([1.0])
