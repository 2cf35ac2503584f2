"""When a Robot traces: at the second call for one state, at the first batch, or when asked to."""

import numpy as np
import pytest

import rne
from rne.kernels import kernel as kernel_module

from .helpers import EPS, loaded, relative, states
from .random_robots import straight_chain

# Methods of a Robot, with the number of joint arrays that they take and of programs that they trace.
METHODS = {
    "inverse_dynamics": (3, 1),
    "mass_matrix": (1, 1),
    "forward_dynamics": (3, 1),
    "bias_torque": (2, 1),
    "gravity_torque": (1, 1),
    "coriolis_torque": (2, 1),
    "coriolis_matrix": (2, 1),
    "kinetic_energy": (2, 1),
    "potential_energy": (1, 1),
    "momentum": (2, 1),
    "link_poses": (1, 1),
    "inverse_dynamics_derivatives": (3, 2),  # by q and qd, and M
    "forward_dynamics_derivatives": (3, 1),
}


@pytest.fixture
def traced(monkeypatch):
    """The names of the quantities that are traced from now on."""
    names, trace = [], kernel_module.trace

    def listing(quantity, *arguments, **options):
        names.append(quantity.name)
        return trace(quantity, *arguments, **options)

    monkeypatch.setattr(kernel_module, "trace", listing)
    return names


def flat(result):
    """One state's result as a row, several arrays one after the other."""
    parts = result if isinstance(result, tuple) else (result,)
    return np.concatenate([np.ravel(part) for part in parts])[None]


@pytest.mark.parametrize("method", METHODS)
def test_one_state_is_traced_at_the_second_call_and_gives_the_same(traced, method):
    robot, (count, programs) = rne.Robot(straight_chain(3)), METHODS[method]
    arguments, call = states(3)[:count], getattr(robot, method)
    first = call(*arguments)
    assert traced == []
    second = call(*arguments)
    assert len(traced) == programs
    third = call(*arguments)
    assert len(traced) == programs
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(robot.model, arguments[0])) if "forward" in method else 1.0
    assert relative(flat(second), flat(first)) <= 4e-15 * 6 * kappa
    assert np.array_equal(flat(third), flat(second))


@pytest.mark.parametrize("method", METHODS)
def test_a_batch_is_traced_at_the_first_call(traced, method):
    robot, (count, programs) = rne.Robot(straight_chain(3)), METHODS[method]
    arguments = states(3, 3)[:count]
    batch = getattr(robot, method)(*arguments)
    assert len(traced) == programs
    one = getattr(robot, method)(*(x[1] for x in arguments))
    assert len(traced) == programs
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(robot.model, arguments[0])).max() if "forward" in method else 1.0
    row = tuple(part[1] for part in batch) if isinstance(batch, tuple) else batch[1]
    assert relative(flat(one), flat(row)) <= 4e-15 * 6 * kappa


def test_links_are_traced_each_by_itself(traced):
    robot, q = rne.load("irb140"), np.zeros(6)
    for link in ("link_3", "link_6"):
        robot.jacobian(q, link)
        assert traced == []
    robot.jacobian(q, "link_3")
    assert traced == ["jacobian"]
    robot.jacobian_rate(q, q, "link_3")
    assert traced == ["jacobian"]
    robot.jacobian_rate(q, q, "link_3")
    assert traced == ["jacobian", "jacobian_rate"]


def test_compile_traces_at_once_and_only_once(traced):
    robot = rne.load("irb140")
    robot.compile()
    expected = ["inverse_dynamics", "mass_matrix", "bias_torque", "gravity_torque", "forward_dynamics"]
    assert traced == expected
    q, qd, qdd = states(6)
    robot.inverse_dynamics(q, qd, qdd)
    robot.forward_dynamics(q, qd, qdd)
    robot.compile()
    assert traced == expected
    robot.compile(rne.dynamics.kinetic_energy)
    assert traced == [*expected, "kinetic_energy"]


def test_recursion_and_kernel_refuse_a_state_in_the_same_words():
    robot = rne.load("irb140")
    for _ in range(3):
        with pytest.raises(ValueError, match=r"^`q` must be finite, got nan at index \(2,\)$"):
            robot.mass_matrix([0, 0, np.nan, 0, 0, 0])


def test_coriolis_matrix_of_43_joints_is_had_without_tracing(traced):
    robot = rne.Robot(loaded("g1_description/g1_29dof_with_hand_rev_1_0").model)
    assert robot.n == 43
    q, qd, _ = states(43)
    C = robot.coriolis_matrix(q, qd)
    assert traced == []
    torque = rne.dynamics.coriolis_torque(robot.model, q, qd)
    assert np.abs(C @ qd - torque).max() <= 1e3 * EPS * np.abs(C).max() * np.abs(qd).max()


def test_each_robot_has_kernels_of_its_own(traced):
    q = np.zeros((2, 6))
    for _ in range(2):
        rne.load("irb140").mass_matrix(q)
    assert traced == ["mass_matrix"] * 2


@pytest.mark.parametrize("call", ["robot", "kernel"])
def test_an_unsound_state_runs_its_kernel_once_before_the_recursion(call):
    robot, runs = rne.load("irb140"), []
    kernel = robot.kernel(rne.dynamics.inverse_dynamics)
    program = kernel.state_function
    vars(kernel)["state_function"] = lambda *state: runs.append(1) or program(*state)
    q, qd, qdd = states(6)
    qd[0] = 1e200
    with pytest.raises(rne.NotFiniteError, match="overflows"):
        (robot.inverse_dynamics if call == "robot" else kernel)(q, qd, qdd)
    assert len(runs) == 1


SMOOTH, STICKING = rne.Friction(viscous=1.0, coulomb=0.5), rne.Friction(viscous=1.0, coulomb=0.5, smoothing=0)


@pytest.mark.parametrize(
    "parts", [{}, {"friction": SMOOTH}, {"friction": STICKING}], ids=["free", "smooth", "sticking"]
)
def test_neither_the_choice_of_a_method_nor_the_report_of_a_motion_traces(traced, parts):
    """The kernel of what runs is all that a scene traces, and a second run with its report traces nothing."""
    robot = rne.Robot(straight_chain(3))
    for _ in range(2):
        motion = rne.simulate(rne.Scene(robot, **parts), [0.1] * 3, [0] * 3, 0.05, method="auto")
        assert motion.method == "DOP853"
        assert "largest energy error" in repr(motion)
        assert len(traced) == 1


def test_energies_of_many_states_are_traced_and_the_same(traced):
    """By the recursion at first, by kernels from where it would have taken longer."""
    robot = rne.Robot(straight_chain(3))
    times = np.linspace(0, 0.05, 500)
    few, again, more = (rne.simulate(robot, [0.1] * 3, [0] * 3, 0.05, t_eval=times).energy for _ in range(3))
    assert traced == ["right_hand_side", "potential_energy", "kinetic_energy"]
    np.testing.assert_array_equal(again, few)
    np.testing.assert_allclose(more, few, rtol=4e-15 * 6)
