"""Intervals as functions of CasADi and JAX and in C: what the stepper computes, with its derivatives."""

import ctypes
import re
from dataclasses import replace

import numpy as np
import pytest

import rne

from .compiled_sources import c_library
from .helpers import kept
from .random_robots import straight_chain
from .test_stepper import CASES, FRICTION, LIMIT, REFERENCE, ROUNDING, chain, drawn, sampled

METHODS = ("rk4", "tsit5", "semi-implicit-euler")
T = 0.31  # s, of laws that follow a reference


def limited():
    """Joints that range over +-0.5 rad."""
    model = replace(straight_chain(2), lower=[-0.5] * 2, upper=[0.5] * 2)
    return rne.Scene(rne.Robot(model, "numpy"), friction=FRICTION)


SCENES = {
    "torques": lambda: (chain(effort_limit=LIMIT), ["friction.viscous", "effort_limit"]),
    "stops": lambda: (limited(), []),
    "delay": lambda: (sampled(law="pid", delay=0.023), ["controller.ki", "effort_limit"]),
    "samples": lambda: (sampled(law="reference", delay=0.004), ["controller.kp"]),
    "continuous": lambda: (sampled(law="reference", sample_time=None, effort_limit=None), []),
    "elastic": lambda: (CASES["elastic"]()[0], ["elastic.stiffness"]),
    "bodies": lambda: (CASES["bodies"]()[0], ["payload", "springs[0].stiffness"]),
}
EVERY = [(name, method) for name in SCENES for method in METHODS]


def made(name, method):
    """A stepper, the names of numbers to be arguments, and the arguments of its function."""
    scene, names = SCENES[name]()
    stepper = rne.Stepper(scene, scene.sample_time or 0.01, 2, method, position_stops=name == "stops")
    x, u, W = drawn(stepper)
    return stepper, names, x, u, W


@pytest.mark.parametrize(("name", "method"), kept(EVERY, [("stops", "semi-implicit-euler"), ("samples", "tsit5")]))
def test_c_computes_the_interval(name, method, tmp_path):
    stepper, _, x, u, _ = made(name, method)
    function = c_library([stepper.source("c", "arm_step")], tmp_path).arm_step
    expected = stepper(x, u, t=T)
    for k, end in enumerate(expected):
        out, given = np.empty(stepper.size), [np.array([T]), x[k].copy(), *([] if u is None else [u[k].copy()])]
        function(*(a.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for a in (*given, out)))
        np.testing.assert_allclose(out, end, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(
    ("name", "method"),
    kept(EVERY, [("delay", "rk4"), ("stops", "semi-implicit-euler"), ("torques", "semi-implicit-euler")]),
)
def test_casadi_computes_the_interval_and_its_derivatives(name, method):
    ca = pytest.importorskip("casadi", reason="CasADi is not installed")
    stepper, names, x, u, W = made(name, method)
    numbers = {key: stepper.scene.numbers[key] * (1.0 if key == "payload" else 0.9) for key in names}
    expected, slopes = stepper(x, u, numbers, t=T), stepper.gradient(x, u, W, numbers, t=T)
    law = stepper.own_numbers.frozen.law or stepper.own_numbers.frozen.dynamics.law
    for symbolic in ("SX", "MX"):
        function = stepper.to_casadi(symbolic=symbolic, numbers=names)
        given = {"x": x, "u": u, "t": np.full((3, 1), T)}
        if "piece" in function.name_in():
            given["piece"] = np.tile(law.table[np.searchsorted(law.table[:, 0], T, side="right") - 1], (3, 1))
        given |= {re.sub(r"\W+", "_", key).strip("_"): np.tile(a.reshape(-1), (3, 1)) for key, a in numbers.items()}
        arguments = [given[key].T for key in function.name_in()]
        np.testing.assert_allclose(np.array(function(*arguments)).T, expected, rtol=0, atol=ROUNDING)
        symbols = [ca.MX.sym(key, len(a)) for key, a in zip(function.name_in(), arguments, strict=True)]
        weights = ca.MX.sym("weights", stepper.size)
        cost = ca.dot(weights, function(*symbols))
        for key, slope in slopes.items():
            by = symbols[function.name_in().index(re.sub(r"\W+", "_", key).strip("_"))]
            found = np.array(ca.Function("slope", [*symbols, weights], [ca.gradient(cost, by)])(*arguments, W.T)).T
            scale = max(1.0, abs(slope).max())
            np.testing.assert_allclose(found, slope.reshape(3, -1), rtol=0, atol=ROUNDING * scale)


@pytest.mark.long
@pytest.mark.parametrize("name", ["torques", "delay", "samples"])
def test_jax_computes_the_interval_and_its_derivatives(name):
    jax = pytest.importorskip("jax", reason="JAX is not installed")
    jax.config.update("jax_enable_x64", True)
    stepper, names, x, u, W = made(name, "rk4")
    numbers = {key: jax.numpy.array(stepper.scene.numbers[key]) * 0.9 for key in names}
    if name == "samples":
        numbers["controller.reference"] = jax.numpy.array(REFERENCE.samples)
    step, plain = stepper.to_jax(), {key: np.array(a) for key, a in numbers.items()}
    expected, slopes = stepper(x, u, plain, t=T), stepper.gradient(x, u, W, plain, t=T)
    found = jax.jit(lambda x, u, numbers: step(x, u, numbers, T))(x, u, numbers)
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)
    by = (0, 2) if u is None else (0, 1, 2)
    gradient = jax.grad(lambda x, u, numbers: (W * step(x, u, numbers, T)).sum(), by)(x, u, numbers)
    for key, slope in zip(["x", "u"][: len(by) - 1], gradient, strict=False):
        np.testing.assert_allclose(slope, slopes[key], rtol=0, atol=ROUNDING * max(1, abs(slopes[key]).max()))
    for key, slope in gradient[-1].items():  # of all states, which share the numbers
        total = slopes[key].sum(axis=0)
        np.testing.assert_allclose(slope, total, rtol=0, atol=ROUNDING * max(1, abs(total).max()))
    over = (0, None if u is None else 0)
    each = jax.vmap(lambda x, u: step(x, u, numbers, T), in_axes=over)(x, u)
    np.testing.assert_allclose(each, expected, rtol=0, atol=ROUNDING)
    assert step(x.astype(np.float32), None if u is None else u.astype(np.float32), t=T).dtype == np.float32


REFUSED = {
    "`language` must be 'c', got 'rust'": lambda stepper: stepper.source("rust"),
    "`name` must be letters, digits and underscores after a letter, got '2 step'": lambda s: s.source(name="2 step"),
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_cannot_be_written_is_refused(text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        REFUSED[text](rne.Stepper(chain(), 0.01))


def test_an_unknown_number_of_a_casadi_function_is_named():
    with pytest.raises(ValueError, match=r"^`numbers`: the scene has the numbers .*; got 'friction.viscos'"):
        rne.Stepper(chain(), 0.01).to_casadi(numbers=["friction.viscos"])


def test_c_gives_nan_outside_the_samples_of_a_reference(tmp_path):
    stepper = rne.Stepper(sampled(law="reference"))
    out = np.zeros(4)
    given = np.array([1.5]), np.zeros(4), out
    function = c_library([stepper.source()], tmp_path).step
    function(*(a.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for a in given))
    assert np.isnan(out).all()
