"""Derivatives of the recursion itself by complex step: the second path beside the traced ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..dynamics.quantity import Declared, PrecisionStatus
from ..model.model import Model

STEP = 1e-30  # its square vanishes beside 1, so nothing cancels and nothing is truncated


def complex_step(
    function: Declared, model: Model, arguments: Sequence[Any], wrt: Sequence[str], fixed: Mapping[str, Any]
) -> tuple[Array, PrecisionStatus]:
    """Derivatives of a function by the entries of some arguments, along a further last axis."""
    _, status = function.evaluate(model, *arguments, **fixed)  # names what is wrong with them
    names, arrays = list(function.quantity.widths), [np.asarray(a) for a in arguments]
    real = np.result_type(*arrays, np.float32)
    leading = len(np.broadcast_shapes(*(a.shape[:-1] for a in arrays)))
    columns = []
    for name in wrt:
        k = names.index(name)
        perturbed = [a[..., None, :] for a in arrays]
        perturbed[k] = perturbed[k] + 1j * STEP * np.eye(arrays[k].shape[-1])
        slopes = function.evaluate(model, *perturbed, **fixed)[0].imag / STEP
        columns.append(np.moveaxis(slopes, leading, -1))
    return np.concatenate(columns, axis=-1).astype(real), status
