"""One verdict on a state of forward dynamics, whichever way it is computed: the same warning or the same error."""

import contextlib
import warnings

import numpy as np
import pytest

import rne
from rne.dynamics.precision import pivots_below
from rne.dynamics.quantity import MethodQuantity

from .helpers import EPS, Part, assemble, kept, states
from .stability.motions import Top

SINGULAR, NEARLY_SINGULAR = 8.0, 1000.0  # roundings of a pivot

LINE = np.array([0.6, 0.0, 0.8])


def sliders(light):
    """Two sliders along the same line, the first of them with next to no mass of its own."""
    parts = [
        Part(link="base"),
        Part(link="a", joint="first", kind="prismatic", axis=LINE, parent=0, mass=light),
        Part(link="b", joint="second", kind="prismatic", axis=LINE, parent=1, mass=1.7),
    ]
    return assemble("sliders", parts)


def nearly_singular():
    return sliders(5e-14), (np.array([0.1, 0.2]), np.array([0.3, 0.4]), np.array([1.0, 2.0]))


def fast(rate=1e6):
    """Rates of 1e6 rad/s in every joint, and the torques that leave accelerations of 1 rad/s^2 or less."""
    model = rne.irb140()
    q, _, qdd = states(6, acceleration=1.0)
    qd = np.full(6, rate)
    return model, (q, qd, rne.dynamics.inverse_dynamics(model, q, qd, qdd))


def fast_backwards():
    return fast(-1e6)


def singular():
    return sliders(0.0), (np.array([0.1, 0.2]), np.array([0.3, 0.4]), np.array([1.0, 2.0]))


LOSSES = {
    "nearly singular": (nearly_singular, "M is nearly singular"),
    "fast": (fast, "the torques and C qd + g cancel at "),
    "fast backwards": (fast_backwards, "the torques and C qd + g cancel at "),
}


def batched(arguments):
    """The state as the third of four; the others are at rest at the origin under no torque."""
    batch = [np.zeros((4, len(x))) for x in arguments]
    for rows, x in zip(batch, arguments, strict=True):
        rows[2] = x
    return batch


def called_before(model):
    """A Robot that has computed forward dynamics of one state, so that the next call is its kernel's."""
    robot = rne.Robot(model)
    with warnings.catch_warnings(), contextlib.suppress(rne.SingularMassMatrixError):
        warnings.simplefilter("ignore")
        robot.forward_dynamics(*[np.zeros(robot.n)] * 3)
    return robot


# The ways to forward dynamics: (model, arguments) -> a call, made by the user here.
def by_function(function):
    return lambda model, s: lambda: function(model, *s)


def by_kernel(function, *wrt):
    def way(model, s):
        kernel = rne.kernels.derivative(function, model, *wrt) if wrt else rne.compile(function, model)
        return lambda: kernel(*s)

    return way


def by_robot(method, make=rne.Robot, **options):
    def way(model, s):
        call = getattr(make(model), method)
        return lambda: call(*s, **options)

    return way


def under_wrenches(calls):
    """The Robot's method under a wrench without moment and force, after so many calls of it elsewhere."""

    def way(model, s):
        robot, external = rne.Robot(model), {model.link_names[-1]: np.zeros(6)}
        for _ in range(calls):
            with warnings.catch_warnings(), contextlib.suppress(rne.SingularMassMatrixError):
                warnings.simplefilter("ignore")
                robot.forward_dynamics(*[np.zeros(robot.n)] * 3, external=external)
        return lambda: robot.forward_dynamics(*s, external=external)

    return way


def by_kernel_under_wrenches(model, s):
    kernel = rne.compile(rne.dynamics.forward_dynamics, model, external=[model.link_names[-1]])
    return lambda: kernel(*s, np.zeros(6))


def by_simulation(model, s):
    robot = rne.Robot(model)
    return lambda: rne.simulate(robot, *s[:2], 0.0, torque=s[2])


BATCH = {
    "forward_dynamics": by_function(rne.dynamics.forward_dynamics),
    "articulated_forward_dynamics": by_function(rne.dynamics.articulated_forward_dynamics),
    "Robot, first call": by_robot("forward_dynamics"),
    "Robot, second call": by_robot("forward_dynamics", called_before),
    "Robot, no wrenches": by_robot("forward_dynamics", external={}),
    "Robot, wrenches": under_wrenches(0),
    "Robot, wrenches, second call": under_wrenches(1),
    "kernel, wrenches": by_kernel_under_wrenches,
    "kernel": by_kernel(rne.dynamics.forward_dynamics),
    "kernel of articulated bodies": by_kernel(rne.dynamics.articulated_forward_dynamics),
    "kernel of derivatives": by_kernel(rne.dynamics.forward_dynamics, "q"),
    "derivatives": by_robot("forward_dynamics_derivatives"),
    "linearize": by_robot("linearize"),
    "derivatives, second call": by_robot("forward_dynamics_derivatives", called_before),
}
ONE_STATE = BATCH | {"simulate": by_simulation}


def said_by(call):
    """The precision warnings of a call, each with the file that it points to."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        call()
    assert all(w.category is rne.PrecisionWarning for w in said)
    assert all(w.lineno == call.__code__.co_firstlineno for w in said)  # the user's own line, where the call stands
    return [(str(w.message), w.filename) for w in said]


@pytest.mark.parametrize("state", kept(LOSSES, ["nearly singular", "fast"]))
@pytest.mark.parametrize("way", ONE_STATE)
def test_a_state_that_keeps_few_digits_is_warned_of_alike_in_every_way(state, way):
    make, cause = LOSSES[state]
    model, arguments = make()
    expected = str(said_by(lambda: rne.dynamics.forward_dynamics(model, *arguments))[0][0])
    assert cause in expected
    assert said_by(ONE_STATE[way](model, arguments)) == [(expected, __file__)]


@pytest.mark.parametrize("state", kept(LOSSES, ["nearly singular"]))
@pytest.mark.parametrize("way", BATCH)
def test_in_a_batch_it_is_named_by_its_index(state, way):
    model, arguments = LOSSES[state][0]()
    expected = str(said_by(lambda: rne.dynamics.forward_dynamics(model, *arguments))[0][0])
    expected = expected.replace(" digits: ", " digits at state (2,): ")
    assert said_by(BATCH[way](model, batched(arguments))) == [(expected, __file__)]


@pytest.mark.parametrize("state", LOSSES)
def test_a_simulation_warns_once_and_of_nothing_better_than_its_start(state):
    model, (q, qd, tau) = LOSSES[state][0]()
    at_start = said_by(lambda: rne.dynamics.forward_dynamics(model, q, qd, tau))[0][0]
    [(text, file)] = said_by(lambda: rne.simulate(rne.Robot(model), q, qd, 1e-8, torque=tau))
    assert file == __file__
    digits = [int(words.split("about ")[1].split()[0]) for words in (text, at_start)]
    assert digits[0] <= digits[1]
    assert LOSSES[state][1] in text


@pytest.mark.parametrize("state", LOSSES)
def test_an_ensemble_warns_once_of_its_worst_motion(state):
    model, (q, qd, tau) = LOSSES[state][0]()
    scene = rne.Scene(rne.Robot(model), controller=rne.traceable(lambda t, q, qd: tau))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene.kernel  # noqa: B018  traced here
    q0, qd0 = np.stack([0 * q, q, 0 * q]), np.stack([0 * q, qd, 0 * q])
    [(text, file)] = said_by(lambda: rne.ensemble(scene, q0, qd0, 1e-9, step=1e-9))
    assert file == __file__
    assert LOSSES[state][1] in text


def test_tracing_a_law_warns_of_nothing():
    model, (_, _, tau) = nearly_singular()
    scene = rne.Scene(rne.Robot(model), controller=rne.traceable(lambda t, q, qd: tau))
    assert said_by(lambda: scene.kernel) == []


def test_a_fast_motion_is_judged_at_its_samples_and_not_at_every_evaluation(monkeypatch):
    """A top at 3e4 rad/s: the recursion, which judges, runs once for all samples, not once per evaluation."""
    runs, evaluate = [], MethodQuantity.evaluate

    def counted(self, *arguments, **named):
        runs.append(1)
        return evaluate(self, *arguments, **named)

    top = Top.of()
    rne.simulate(top.robot, [0, 0.6, 0], [0, 0, 1.0], 0.0)  # compiled here
    monkeypatch.setattr(MethodQuantity, "evaluate", counted)
    motion = rne.simulate(top.robot, [0, 0.6, 0], top.steady(3e4, 0.6), 0.01, rtol=1e-9)
    assert motion.evaluations > 100
    assert len(runs) <= 1


@pytest.mark.parametrize("way", ONE_STATE)
def test_a_singular_M_is_the_same_error_in_every_way(way):
    model, arguments = singular()
    with pytest.raises(rne.SingularMassMatrixError) as first:
        rne.dynamics.forward_dynamics(model, *arguments)
    assert first.value.joints == ("first", "second")
    with pytest.raises((rne.SingularMassMatrixError, rne.SimulationError)) as caught:
        ONE_STATE[way](model, arguments)()
    assert str(first.value) in str(caught.value)
    cause = caught.value
    if way == "simulate":
        assert isinstance(cause, rne.SimulationError)
        return
    assert (cause.joints, cause.state, str(cause)) == (first.value.joints, (), str(first.value))


@pytest.mark.parametrize("way", BATCH)
def test_a_singular_M_in_a_batch_is_named_by_its_index(way):
    """A gimbal that closes in the third of four states alone."""
    model, arguments = gimbal_closing()
    with pytest.raises(rne.SingularMassMatrixError) as first:
        rne.dynamics.forward_dynamics(model, *(x[2] for x in arguments))
    with pytest.raises(rne.SingularMassMatrixError) as caught:
        ONE_STATE[way](model, arguments)()
    assert caught.value.joints == first.value.joints == ("outer", "inner")
    assert caught.value.state == (2,)
    assert str(caught.value) == str(first.value).replace("precision:", "precision at state (2,):")


def gimbal_closing():
    """Three axes through one point, two rings without mass: at a middle angle of 0 the outer and inner axes coincide."""
    z, y = np.array([0, 0, 1.0]), np.array([0, 1.0, 0])
    parts = [
        Part(link="base"),
        Part(link="a", joint="outer", kind="revolute", parent=0, axis=z),
        Part(link="b", joint="middle", kind="revolute", parent=1, axis=y),
        Part(link="c", joint="inner", kind="revolute", parent=2, axis=z, mass=1.0, inertia=np.eye(3)),
    ]
    q = np.ones((4, 3))
    q[2, 1] = 0.0
    return assemble("gimbal", parts), (q, np.zeros((4, 3)), np.zeros((4, 3)))


@pytest.mark.parametrize(
    ("units", "grade"),
    [(1.0, 2), (7.9, 2), (8.1, 1), (999.0, 1), (1001.0, 0), (0.0, 2), (-1.0, 2), (np.nan, 2), (np.inf, 0)],
)
def test_a_pivot_is_graded_in_units_of_n_eps_of_the_diagonal(units, grade):
    """Up to 8 it is rounding error, up to 1000 digits are estimated; what is no number is singular."""
    diagonal = np.array([2.0, 5.0, 1e-9])
    pivots = diagonal.copy()
    pivots[1] = units * 3 * EPS * diagonal[1]
    below = [pivots_below(units, pivots, diagonal).astype(int) for units in (SINGULAR, NEARLY_SINGULAR)]
    assert sum(below).tolist() == [0, grade, 0]


@pytest.mark.parametrize("way", ONE_STATE)
def test_a_sound_state_is_not_spoken_of(way):
    model = rne.irb140()
    assert said_by(ONE_STATE[way](model, states(6))) == []
