"""Export of a kernel as a function of PyTorch, on the memory of its tensors."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import reduce
from typing import Any

from .rules import BACKWARDS, Rules


def to_torch(kernel: Any) -> Callable[..., Any]:
    """PyTorch function of a kernel; see `Kernel.to_torch`."""
    if importlib.util.find_spec("torch") is None:
        raise ImportError("`to_torch` needs PyTorch, which is not installed: see pytorch.org for its installation")
    import torch

    run = differentiable(kernel, Rules(kernel, torch, differentiable))

    def function(*tensors: Any) -> Any:
        if len(tensors) != len(kernel.names):
            raise TypeError(f"this kernel takes {', '.join(kernel.names)}; got {len(tensors)} arguments")
        for name, x in zip(kernel.names, tensors, strict=True):
            if not isinstance(x, torch.Tensor) or x.is_complex():  # its gradients would need another convention
                got = x.dtype if isinstance(x, torch.Tensor) else type(x).__name__
                raise TypeError(f"`{name}` must be a tensor of real numbers, got {got}")
        leading = torch.broadcast_shapes(*(x.shape[:-1] for x in tensors))
        dtype = reduce(torch.promote_types, (x.dtype for x in tensors))
        number = torch.promote_types(dtype, torch.float32) if dtype.is_floating_point else dtype
        found = run(*(x.to(number).expand(leading + x.shape[-1:]) for x in tensors))
        return found.to(dtype) if dtype.is_floating_point else found

    return function


def differentiable(kernel: Any, rules: Rules) -> Callable[..., Any]:
    """Kernel as a function of CPU tensors of one leading shape, with its derivatives by the rules."""
    import torch

    class Differentiable(torch.autograd.Function):  # type: ignore[misc]
        generate_vmap_rule = False

        @staticmethod
        def forward(*tensors: Any) -> Any:
            return torch.as_tensor(kernel(*(x.detach().numpy() for x in tensors)))

        @staticmethod
        def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
            ctx.save_for_backward(*inputs)

        @staticmethod
        def backward(ctx: Any, slope: Any) -> Any:
            if not rules.apply(kernel, BACKWARDS):
                raise TypeError(f"{kernel!r} has no further derivative")
            return rules.backwards(kernel, ctx.saved_tensors, slope)

        @staticmethod
        def vmap(info: Any, axes: Any, *tensors: Any) -> Any:
            pairs = zip(tensors, axes, strict=True)
            moved = [x.expand(info.batch_size, *x.shape) if k is None else x.movedim(k, 0) for x, k in pairs]
            return Differentiable.apply(*moved), 0

    apply: Callable[..., Any] = Differentiable.apply
    return apply
