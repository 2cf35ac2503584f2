"""Derivatives of the recursion itself by complex step: the second path beside the traced ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..dynamics.checks import Checked
from ..model import Model
from ..spatial import Array

STEP = 1e-30  # its square vanishes beside 1, so nothing cancels and nothing is truncated


def complex_step(
    function: Checked[Any, Any, Any],
    model: Model,
    names: Sequence[str],
    arguments: Sequence[Any],
    wrt: Sequence[str],
    fixed: Mapping[str, Any],
) -> Array:
    """Derivatives of a function by the joints of some arguments, along a further last axis."""
    function(model, *arguments, **fixed)  # says what is wrong with them
    arrays = [np.asarray(a) for a in arguments]
    real = np.result_type(*arrays, np.float32)
    columns = []
    for name in wrt:
        k = list(names).index(name)
        nudged = [a[..., None, :] for a in arrays]
        nudged[k] = nudged[k] + 1j * STEP * np.eye(arrays[k].shape[-1])
        slopes = function(model, *nudged, **fixed).imag / STEP
        columns.append(np.moveaxis(slopes, nudged_axis(arrays), -1))
    return np.concatenate(columns, axis=-1).astype(real)


def nudged_axis(arrays: Sequence[Array]) -> int:
    """Where the joint that was nudged is counted in the result: after the leading axes."""
    return len(np.broadcast_shapes(*(a.shape[:-1] for a in arrays)))
