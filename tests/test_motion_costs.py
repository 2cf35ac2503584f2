"""Costs of motions are read anew at each call, and their kernels are found again where they are the same."""

import pytest

import rne
from rne.simulation.scene_dynamics import UserFunction

from .random_robots import straight_chain

ENDS = "cost", "final"


class Distance:
    """A cost of q whose objects are equal by value, and have no hash."""

    def __init__(self, goal):
        self.goal = goal

    def __eq__(self, other):
        return isinstance(other, Distance) and self.goal == other.goal

    def __call__(self, *state):
        q = state[len(state) // 3]  # of (t, q, qd, tau) and of (q, qd)
        return ((q - self.goal) ** 2).sum()


@pytest.mark.parametrize("name", ENDS)
def test_what_a_cost_reads_may_change_between_calls(name):
    scene = rne.Scene(rne.Robot(straight_chain(2), "numpy"), friction=rne.Friction(viscous=0.3))

    def gradient(function):
        return rne.motion_gradient(scene, [0.3, -0.4], [0.5, 0.2], 0.05, **{name: function}, wrt="q0", step=0.01)

    changing = Distance(0.0)
    before = gradient(changing)
    changing.goal = 1.0
    found, expected = gradient(changing), gradient(Distance(1.0))
    assert found.value == expected.value != before.value
    assert (found.gradient["q0"] == expected.gradient["q0"]).all()


def test_costs_of_the_same_operations_are_equal():
    def cost(weight):
        return UserFunction("final", lambda q, qd: weight * (q**2).sum() + qd[0], (2, 2))

    assert cost(2.0) == cost(2.0)
    assert hash(cost(2.0)) == hash(cost(2.0))
    assert cost(2.0) != cost(3.0)
    opaque = UserFunction("final", lambda q, qd: float(q[0]), (2, 2))  # which cannot be traced
    assert opaque == opaque
    assert opaque != UserFunction("final", lambda q, qd: float(q[0]), (2, 2))


def test_friction_costs_its_gradient_five_times_its_own_operations():
    """Griewank and Walther 2008, section 3.3; a division in it casts no doubt on the terms of bodies."""
    arm = rne.load("ur5")

    def counted(scene):
        dynamics = scene.dynamics.right_hand_side
        kernels = (
            scene.kernels.scene_kernel(dynamics),
            scene.kernels.scene_kernel(dynamics, "x", "numbers", order="gradient"),
        )
        return [sum(kernel.operations.values()) for kernel in kernels]

    friction = rne.Friction(viscous=2.0, coulomb=1.0, stribeck_rise=0.5, stribeck=0.1, load=0.05, smoothing=0.1)
    alone, resisted = counted(rne.Scene(arm)), counted(rne.Scene(arm, friction=friction))
    assert resisted[1] - alone[1] <= 5 * (resisted[0] - alone[0])
