"""Kernels as functions of JAX: by machine code and in jax.numpy, equal to NumPy's kernels with their derivatives."""

import operator
import os
import subprocess
import sys

import numpy as np
import pytest

import rne

from .helpers import kept, loaded
from .quantities import QUANTITIES, arguments_of
from .random_robots import random_tree

jax = pytest.importorskip("jax", reason="JAX is not installed: pip install 'rne[jax]'")
pytest.importorskip("numba", reason="Numba is not installed, of whose engine XLA calls the machine code")
PLANAR = rne.dh_chain(
    a=[0.5, 0.4],
    alpha=[0, 0],
    d=[0, 0],
    theta=[0, 0],
    masses=[2.0, 1.0],
    centres=[[-0.2, 0, 0], [-0.3, 0.1, 0]],
    inertias=[np.eye(3) * 0.1, np.eye(3) * 0.05],
    gravity=[0, -9.81, 0],
)
TREES = {
    "small": PLANAR,
    "bushy": random_tree(4, seed=5, branching=0.8),
    "mimics": random_tree(4, seed=6, mimics=3),
}
ROBOTS = ["irb140", "ur5", "panda", "kinova", "ur10", "z1"]
MODES = ["reverse", "forward"]
ENGINES = ["numba", "numpy"]


@pytest.fixture(autouse=True)
def x64():
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", False)


def bound(function, model, arrays, dtype=float):
    """8 n eps, times cond(M) where M is inverted: of the largest entry."""
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(model, arrays[0])).max() if "forward" in function.__name__ else 1.0
    return 8 * model.n * np.finfo(dtype).eps * kappa


def agree(found, expected, tolerance):
    found, expected = np.asarray(found, float), np.asarray(expected)
    assert found.shape == expected.shape
    assert np.abs(found - expected).max(initial=0) <= tolerance * np.abs(expected).max(initial=1e-300)


def slow(function, model, samples=3, seed=0):
    return arguments_of(function, model.n, samples, seed=seed, rate=1.0, acceleration=1.0)


def loss(call):
    """A loss whose slopes by the result depend on the result."""
    return lambda *x: (call(*x) ** 2).sum() / 2


def derivatives(function, model, arrays):
    """Of the loss: all first and second ones, and the Jacobian, by NumPy's kernels."""
    value = rne.compile(function, model)(*arrays)
    weights, wrt = value.reshape(len(value), -1), tuple(function.quantity.widths)
    J = rne.kernels.derivative(function, model, *wrt)(*arrays)
    flat = J.reshape(*weights.shape, -1)
    slopes = rne.kernels.gradient(function, model)(*arrays, weights)
    bends = rne.kernels.hessian(function, model)(*arrays, weights) + np.swapaxes(flat, 1, 2) @ flat
    return value, J, slopes, bends


CASES = [("numba", "reverse"), ("numba", "forward"), ("numpy", "reverse")]


@pytest.mark.parametrize(("engine", "mode"), kept(CASES, CASES[:2]))
def test_small_tree_with_every_transformation(engine, mode):
    function, model = rne.dynamics.forward_dynamics, TREES["small"]
    arrays = slow(function, model, 6)
    value, J, slopes, bends = derivatives(function, model, arrays)
    call, tolerance = rne.compile(function, model, engine=engine).to_jax(mode), bound(function, model, arrays)
    agree(call(*arrays), value, tolerance)
    two = [a.reshape(2, 3, 2) for a in arrays]
    agree(jax.jit(jax.vmap(jax.vmap(call)))(*two).reshape(6, 2), value, tolerance)
    agree(jax.vmap(call, (0, None, 0))(arrays[0], arrays[1][0], arrays[2])[0], value[0], tolerance)
    first = jax.jit(jax.vmap(jax.vmap(jax.grad(loss(call), (0, 1, 2)))))(*two)
    agree(np.concatenate(first, -1).reshape(6, -1), slopes, tolerance)
    second = jax.jit(jax.jacrev(jax.grad(loss(call)), 1))(*(a[0] for a in arrays))
    agree(second, bends[0, :2, 2:4], tolerance)
    if mode == "forward" or engine == "numpy":
        agree(jax.jvp(call, arrays, arrays)[1], np.einsum("sek,sk->se", J, np.concatenate(arrays, -1)), tolerance)
        agree(jax.vmap(jax.jacfwd(call, 1))(*arrays), J[..., 2:4], tolerance)
        agree(jax.hessian(loss(call))(*(a[0] for a in arrays)), bends[0, :2, :2], tolerance)
    else:
        of_sums = jax.grad(lambda q: jax.grad(loss(call))(q, *arrays[1:]).sum())(arrays[0])
        agree(of_sums, bends[:, :2, :2].sum(-1), tolerance)
        with pytest.raises(TypeError, match="forward-mode"):
            jax.jvp(call, arrays, arrays)


def test_program_in_jax_numpy_with_every_transformation():
    function, model = rne.dynamics.gravity_torque, TREES["small"]
    (q,) = slow(function, model, 4)
    value, J, slopes, bends = derivatives(function, model, (q,))
    call, tolerance = rne.compile(function, model).to_jax(), bound(function, model, (q,))
    agree(jax.jit(jax.vmap(jax.vmap(call)))(q.reshape(2, 2, 2)).reshape(4, 2), value, tolerance)
    agree(jax.jvp(call, (q,), (q,))[1], (J @ q[..., None])[..., 0], tolerance)
    agree(jax.grad(loss(call))(q), slopes, tolerance)
    agree(jax.vmap(jax.hessian(loss(call)))(q), bends, tolerance)


def test_comparisons_are_those_of_numpy_at_ties_as_well():
    function = rne.traceable(lambda q: np.stack([f(q[0], q[1]) for f in (operator.lt, operator.le)]) * 3.0)
    q = np.array([[0.1, 0.2], [0.2, 0.2], [0.2, 0.1]])
    found = rne.compile(function, TREES["small"], engine="numpy").to_jax()(q)
    np.testing.assert_allclose(found, [[3, 3], [0, 3], [0, 0]], rtol=0, atol=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_states_that_a_kernel_refuses_are_nan(engine):
    """Their slopes as well; the groups of states around them are not touched, at the end of a batch neither."""
    function, model = rne.dynamics.forward_dynamics, TREES["small"]
    arrays = slow(function, model, 19)
    kernel = rne.compile(function, model, engine=engine)
    expected = kernel(*arrays)
    bad = [0, 3, 4, 18]
    arrays[0][[0, 18], 1], arrays[1][3, 0], arrays[2][4, 1] = np.nan, 1e9, np.inf
    found = np.asarray(kernel.to_jax()(*arrays))
    assert np.isnan(found[bad]).all()
    agree(np.delete(found, bad, axis=0), np.delete(expected, bad, axis=0), 1e-12)
    slopes = jax.grad(loss(kernel.to_jax()))(*arrays)
    assert np.isnan(slopes).any(1).nonzero()[0].tolist() == bad


@pytest.mark.parametrize("engine", ENGINES)
def test_numbers_of_32_and_16_bits(engine):
    function, model = rne.dynamics.inverse_dynamics, TREES["small"]
    call = rne.compile(function, model, engine=engine).to_jax()
    for dtype in (np.float32, np.float16):
        arrays = [a.astype(dtype) for a in slow(function, model)]
        expected = rne.compile(function, model)(*(a.astype(float) for a in arrays))
        assert call(*arrays).dtype == dtype
        agree(call(*arrays), expected, bound(function, model, arrays, dtype))
    jax.config.update("jax_enable_x64", False)
    arrays = [a.astype(float) for a in arrays]
    assert call(*arrays).dtype == np.float32
    agree(call(*arrays), expected, bound(function, model, arrays, np.float32))


def test_shapes_and_errors():
    kernel = rne.compile(rne.dynamics.inverse_dynamics, TREES["small"], engine="numba")
    call, x = kernel.to_jax(), np.zeros((3, 2))
    assert call(x[:0], x[:0], x[:0]).shape == (0, 2)
    assert call(np.zeros((4, 1, 2)), [0, 0], x).shape == (4, 3, 2)
    with pytest.raises(TypeError, match=r"^inverse_dynamics takes q, qd, qdd; got 1 arguments"):
        call(x)
    with pytest.raises(ValueError, match=r"^`qd` must have shape \(..., 2\) for robot 'chain', got \(3, 1\)"):
        call(x, x[:, :1], x)
    with pytest.raises(ValueError, match=r"^leading shapes must broadcast against each other"):
        call(x, x[:2], x)
    with pytest.raises(TypeError, match=r"^arguments must be real numbers, got complex128"):
        call(x, x, x + 1j)
    with pytest.raises(ValueError, match=r"^`mode` must be one of \['reverse', 'forward'\], got 'both'$"):
        kernel.to_jax("both")


def test_a_kernel_that_is_too_large_is_refused(monkeypatch):
    from rne.kernels import trace as module

    monkeypatch.setattr(module, "LIMIT", 30)
    with pytest.raises(TypeError, match="too large to be written out"):
        rne.compile(rne.dynamics.inverse_dynamics, TREES["small"], engine="numba").to_jax()


@pytest.mark.parametrize("mode", MODES)
def test_kernels_of_derivatives_and_of_parameters(mode):
    model = TREES["small"]
    q, qd, qdd = slow(rne.dynamics.inverse_dynamics, model)
    variants = rne.compile(rne.dynamics.inverse_dynamics, model, engine="numba", parameters=True)
    own = rne.Robot(model).parameters
    agree(variants.to_jax(mode)(q, qd, qdd, own), variants(q, qd, qdd, own), 1e-14)
    for order in ("gradient", "hessian", "hessian_product"):
        kernel = getattr(rne.kernels, order)(rne.dynamics.kinetic_energy, model, engine="numba")
        arrays = [q, qd, np.full((3, 1), 2.0), np.full(4, 0.5)][: len(kernel.names)]
        agree(kernel.to_jax(mode)(*arrays), kernel(*arrays), 1e-14)
    slopes = rne.kernels.derivative(rne.dynamics.mass_matrix, model, "q", engine="numba").to_jax("forward")
    bends = jax.jacfwd(slopes)(q[0])  # the slopes of slopes do not depend on their order
    np.testing.assert_allclose(bends, np.swapaxes(bends, -1, -2), atol=1e-14)


SCRIPT = """
import jax, rne
jax.config.update("jax_compilation_cache_dir", {folder!r})
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
hits = []
jax.monitoring.register_event_listener(lambda name, **_: hits.append(name) if name.endswith("cache_hits") else None)
call = rne.compile(rne.dynamics.gravity_torque, rne.irb140(), engine="numba").to_jax()
print(float(call([0.1] * 6).sum()), len(hits))
"""


@pytest.mark.long
def test_the_cache_of_jax_serves_other_processes(tmp_path):
    command = [sys.executable, "-c", SCRIPT.format(folder=str(tmp_path))]
    first, second = (
        subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ).stdout.split()
        for _ in range(2)
    )
    assert first[0] == second[0]
    assert int(second[1]) > int(first[1])


@pytest.mark.long
@pytest.mark.parametrize("name", QUANTITIES)
@pytest.mark.parametrize(("tree", "mode"), [("bushy", "reverse"), ("mimics", "forward")])
def test_every_quantity_on_trees(tree, name, mode):
    function, model = QUANTITIES[name], TREES[tree]
    if name == "articulated_forward_dynamics" and model.has_mimics:
        return
    arrays = slow(function, model)
    value, J, slopes, bends = derivatives(function, model, arrays)
    call, tolerance = rne.compile(function, model, engine="numba").to_jax(mode), bound(function, model, arrays)
    agree(call(*arrays), value, tolerance)
    places = tuple(range(len(arrays)))
    agree(np.concatenate(jax.grad(loss(call), places)(*arrays), -1), slopes, tolerance)
    jacobian = jax.vmap((jax.jacrev if mode == "reverse" else jax.jacfwd)(call, places))
    agree(np.concatenate(jacobian(*arrays), -1), J, tolerance)
    if "regressor" not in name:
        second = jax.vmap(jax.jacrev(jax.grad(loss(call), places), places))(*arrays)
        agree(np.concatenate([np.concatenate(row, -1) for row in second], -2), bends, 8 * tolerance)


@pytest.mark.long
@pytest.mark.parametrize("name", QUANTITIES)
def test_every_quantity_in_jax_numpy(name):
    function, model = QUANTITIES[name], TREES["bushy"]
    arrays = slow(function, model)
    call = rne.compile(function, model).to_jax()
    agree(call(*arrays), rne.compile(function, model)(*arrays), bound(function, model, arrays))


@pytest.mark.long
@pytest.mark.parametrize("name", QUANTITIES)
@pytest.mark.parametrize("robot", ROBOTS)
def test_every_quantity_on_robots(robot, name):
    """Values and slopes of a random sum, by machine code."""
    function, model = QUANTITIES[name], loaded(robot).model
    if name == "articulated_forward_dynamics" and model.has_mimics:
        return
    arrays = slow(function, model)
    kernel = rne.compile(function, model, engine="numba")
    if not kernel.is_unrolled:
        with pytest.raises(TypeError, match="too large"):
            kernel.to_jax()
        return
    call, tolerance = kernel.to_jax(), bound(function, model, arrays)
    value = rne.compile(function, model)(*arrays)
    agree(call(*arrays), value, tolerance)
    weights = np.random.default_rng(1).uniform(-1, 1, value.shape)
    slopes = rne.kernels.gradient(function, model)
    if slopes.is_unrolled:
        found = jax.grad(lambda *x: (weights * call(*x)).sum(), tuple(range(len(arrays))))(*arrays)
        agree(np.concatenate(found, -1), slopes(*arrays, weights.reshape(len(value), -1)), tolerance)
