"""The quantities of `rne.dynamics` as they are declared there, for the tests that hold for every quantity.

Kernels, number types and derivatives are tested for each of them: a new quantity needs no entry.
"""

import inspect

import rne

from .helpers import states

ELSEWHERE = ("christoffel_symbols", "lagrange_inverse_dynamics", "lagrange_forward_dynamics")  # tests/test_lagrange.py


def is_tested(name, thing):
    """True for functions of joint arrays alone that return an array."""
    declared = getattr(thing, "quantity", None)
    if declared is None or not declared.returns_array or "jacobian" in name or name in ELSEWHERE:
        return False
    return "link" not in inspect.signature(thing.core).parameters  # tests/test_task_space.py


QUANTITIES = {name: getattr(rne.dynamics, name) for name in rne.dynamics.__all__}
QUANTITIES = {name: function for name, function in QUANTITIES.items() if is_tested(name, function)}


def arguments_of(function, n, samples=None, **options):
    """Random joint arrays for a quantity, by the names of its arguments; options as for `states`."""
    q, qd, qdd = states(n, samples, **options)
    arrays = {"q": q, "qd": qd, "qdd": qdd, "tau": qdd, "qdr": qd[..., ::-1], "qddr": qdd}
    return [arrays[name] for name in function.quantity.widths]
