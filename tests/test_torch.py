"""Kernels as functions of PyTorch: their values and slopes are the kernels' own."""

import numpy as np
import pytest

import rne

from .quantities import QUANTITIES, arguments_of
from .random_robots import random_tree

torch = pytest.importorskip("torch", reason="PyTorch is not installed: no extra has it")
TREE = random_tree(3, seed=4)
NAMES = ["inverse_dynamics", "forward_dynamics", "mass_matrix", "kinetic_energy"]


def tensors(arrays, **options):
    return [torch.tensor(a, requires_grad=True, **options) for a in arrays]


@pytest.mark.parametrize("name", NAMES)
def test_values_and_slopes_are_those_of_kernels(name):
    """The first derivatives along random slopes, and both second ones, by autograd's own differences."""
    function = QUANTITIES[name]
    kernel = rne.compile(function, TREE)
    call, arrays = kernel.to_torch(), arguments_of(function, 3, 4, rate=1.0, acceleration=1.0)
    x = tensors(arrays)
    found = call(*x)
    np.testing.assert_array_equal(found.detach().numpy(), kernel(*arrays))
    slope = torch.tensor(np.random.default_rng(0).uniform(-1, 1, found.shape))
    slopes = torch.autograd.grad(found, x, slope)
    expected = rne.kernels.gradient(function, TREE)(*arrays, slope.numpy().reshape(4, -1))
    np.testing.assert_array_equal(torch.concatenate(slopes, -1).numpy(), expected)
    assert torch.autograd.gradcheck(call, x)
    assert torch.autograd.gradgradcheck(call, x)


def test_arrays_are_broadcast_and_shared():
    kernel = rne.compile(rne.dynamics.inverse_dynamics, TREE)
    call = kernel.to_torch()
    q, qd = np.random.default_rng(0).uniform(-1, 1, (2, 5, 2, 3))
    x = [torch.from_numpy(q).requires_grad_(), torch.from_numpy(qd[0]).requires_grad_(), torch.zeros(3)]
    found = call(*x)
    np.testing.assert_array_equal(found.detach(), kernel(q, qd[0], np.zeros(3)))
    found.sum().backward()
    assert x[1].grad.shape == (2, 3)
    each = torch.vmap(torch.func.jacrev(call), (0, None, None))(*x)
    assert each.shape == (5, 2, 3, 2, 3)
    single = call(*(a.detach().float() for a in x))
    assert single.dtype == torch.float32


def test_errors_are_those_of_kernels():
    call = rne.compile(rne.dynamics.inverse_dynamics, TREE).to_torch()
    with pytest.raises(ValueError, match="`q` must be finite, got nan"):
        call(*[torch.full((3,), torch.nan)] * 3)
    hessian = rne.kernels.hessian(rne.dynamics.potential_energy, TREE).to_torch()
    total = hessian(*tensors([np.zeros(3)]), torch.ones(1)).sum()
    with pytest.raises(TypeError, match="has no further derivative"):
        total.backward()


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_is_computed_in_single_and_returned_as_it_came(dtype):
    call, q = rne.compile(rne.dynamics.gravity_torque, TREE).to_torch(), torch.tensor([0.25, -0.5, 0.75])
    half = q.to(dtype).requires_grad_()
    found = call(half)
    assert found.dtype == dtype
    assert torch.equal(found, call(q).to(dtype))
    found.sum().backward()
    assert half.grad.dtype == dtype
    assert call(q.to(dtype).long()).dtype == torch.float64


def test_what_is_no_tensor_of_real_numbers_is_named():
    call, q = rne.compile(rne.dynamics.bias_torque, TREE).to_torch(), torch.zeros(3)
    for x, got in ((q.to(torch.complex64), "torch.complex64"), ([0.0] * 3, "list"), (None, "NoneType")):
        with pytest.raises(TypeError, match=rf"^`qd` must be a tensor of real numbers, got {got}$"):
            call(q, x)
    with pytest.raises(TypeError, match=r"^this kernel takes q, qd; got 1 arguments$"):
        call(q)
    with pytest.raises(ValueError, match=r"^`q` must have shape \(\.\.\., 3\) for robot"):
        call(torch.zeros(()), torch.zeros(()))
