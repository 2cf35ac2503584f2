"""Error in float64 against 50 digits, and the condition that the robot's own numbers set.

The structured condition is how much a small relative change of every number of the robot and of the state is
amplified in the result, and at least 1. It is found by perturbing in 50-digit arithmetic. No method that rounds its
arguments can promise less than eps times it. Angles change relative to at most pi: turns that are complete do not
count. The entries of a rotation or an axis change each by itself.
"""

from __future__ import annotations

import warnings
from dataclasses import fields
from functools import partial
from typing import NamedTuple

import mpmath
import numpy as np

import rne

ARRAYS = frozenset(f.name for f in fields(rne.Model) if f.type == "Array")
in_mpmath = np.vectorize(mpmath.mpf, otypes=[object])  # the same numbers
DIGITS = 50
CHANGE = mpmath.mpf(10) ** -25  # relative, of every number
PERTURBATIONS = 3
EPS = float(np.finfo(float).eps)
WRONG = 3e-2  # a relative error that must not be returned without a warning


class Measured(NamedTuple):
    """One quantity of one case, its worst state: error and condition relative to the largest entry."""

    error: float
    condition: float
    refused: bool = False
    warned: bool = False

    @property
    def ratio(self):
        """Error in units of eps times the structured condition; infinite for a refusal where digits could be had."""
        if self.refused:
            return 0.0 if EPS * self.condition >= 1 else np.inf
        return self.error / (EPS * self.condition)


def changed(array, signs):
    """Every number times 1 + CHANGE or 1 - CHANGE, or as it is without signs; symmetric where it is symmetric."""
    exact = in_mpmath(np.asarray(array, dtype=float))
    if signs is None:
        return exact
    sign = signs.choice([-1, 1], size=exact.shape)
    if exact.ndim == 3 and np.array_equal(array, np.swapaxes(array, -1, -2)):
        sign = np.triu(sign) + np.swapaxes(np.triu(sign, 1), -1, -2)
    return exact * (1 + CHANGE * sign.astype(object))


def exactly(core, model, arguments, signs=None):
    """The recursion on 50 digits, of the doubles themselves or of perturbed ones."""
    rebuild, (values,) = model.__reduce__()  # as pickle does, without checks
    for name in sorted(ARRAYS & values.keys()):
        if values[name] is not None and np.isfinite(values[name]).all():
            values[name] = changed(values[name], signs)
    q, *others = arguments
    positions = changed(q, None)
    if signs is not None:
        sign = signs.choice([-1, 1], size=q.shape).astype(object)
        positions = positions + CHANGE * sign * np.where(model.is_revolute, np.minimum(np.abs(q), np.pi), np.abs(q))
    return core(rebuild(values), positions, *(changed(x, signs) for x in others))


def size(result):
    """The largest entry of each state."""
    return np.abs(result).reshape(len(result), -1).max(axis=1)


class Reference(NamedTuple):
    """What is exact for some states of a robot, and what perturbing does to it; states along the first axis."""

    value: np.ndarray
    condition: np.ndarray


def reference(core, model, arguments, perturbations=PERTURBATIONS):
    """Exact value and structured condition of each state."""
    rng = np.random.default_rng(1)
    with mpmath.workdps(DIGITS):
        value = exactly(core, model, arguments)
        condition = np.ones(len(value))
        for _ in range(perturbations):
            moved = exactly(core, model, arguments, rng) - value
            condition = np.maximum(condition, (relative_size(moved, value) / CHANGE).astype(float))
    return Reference(value, condition)


def relative_size(difference, value):
    """Relative to the largest entry; of M in units of its diagonal, so that no joint is lost beside another."""
    if value.ndim == 2:
        return size(difference) / np.where(size(value) == 0, 1, size(value))
    root = np.frompyfunc(mpmath.sqrt, 1, 1)(np.diagonal(value, axis1=-2, axis2=-1))
    return size(difference / root[..., :, None] / root[..., None, :])


def compared(got, exact):
    """The worst state of one answer."""
    with mpmath.workdps(DIGITS):
        error = relative_size(in_mpmath(got) - exact.value, exact.value).astype(float)
    k = int(np.argmax(error / exact.condition))
    return Measured(float(error[k]), float(exact.condition[k]))


def forward_core(model, q, qd, tau):
    return rne.dynamics.forward_dynamics.core(model, q, qd, tau)[0]


QUANTITIES = {
    "inverse dynamics": rne.dynamics.inverse_dynamics.core,
    "mass matrix": rne.dynamics.mass_matrix.core,
    "forward dynamics": forward_core,
}
METHODS = {
    "inverse dynamics": {"": rne.dynamics.inverse_dynamics, ", compiled": "inverse_dynamics"},
    "mass matrix": {"": rne.dynamics.mass_matrix, ", compiled": "mass_matrix"},
    "forward dynamics": {
        " by M": rne.dynamics.forward_dynamics,
        " by articulated bodies": rne.dynamics.articulated_forward_dynamics,
        ", compiled": "forward_dynamics",
    },
}
COMPILED_UP_TO = 20  # joints


def measure(case, quantities=tuple(QUANTITIES), perturbations=PERTURBATIONS, exact_model=None, others=None):
    """Every method of each quantity: {quantity and method: Measured}; `others` are further ones, as in METHODS.

    Against the case's own doubles, or against another Model of mpmath numbers; the condition is the case's.
    """
    robot, found = rne.Robot(case.model), {}
    for quantity in quantities:
        arguments = [case.q] if quantity == "mass matrix" else [case.q, case.qd, case.qdd]
        if quantity == "forward dynamics":
            arguments[2] = torques(case)
        exact = reference(QUANTITIES[quantity], case.model, arguments, perturbations)
        if exact_model is not None:
            with mpmath.workdps(DIGITS):
                exact = exact._replace(value=QUANTITIES[quantity](exact_model, *(changed(x, None) for x in arguments)))
        for method, function in (METHODS[quantity] | (others or {}).get(quantity, {})).items():
            if isinstance(function, str):
                if case.model.n > COMPILED_UP_TO:
                    continue
                robot.kernel(getattr(rne.dynamics, function))  # which runs from the first state on
            found[quantity + method] = answered(robot, function, arguments, exact)
    return found


def torques(case):
    """Torques of the size that the state's own motion takes."""
    return rne.dynamics.inverse_dynamics(case.model, case.q, case.qd, case.qdd)


def answered(robot, function, arguments, exact):
    """One method's worst state; refused if an error says that M is singular there."""
    call = getattr(robot, function) if isinstance(function, str) else partial(function, robot.model)
    rows = []
    for k in range(len(exact.value)):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", rne.PrecisionWarning)
            try:
                got = call(*(x[k] for x in arguments))
            except rne.SingularMassMatrixError:
                rows.append(Measured(0.0, float(exact.condition[k]), refused=True))
                continue
        one = compared(got[None], Reference(exact.value[k : k + 1], exact.condition[k : k + 1]))
        rows.append(one._replace(warned=bool(said)))
    silent = [row for row in rows if row.error > WRONG and not row.warned]
    return max(silent or rows, key=lambda row: row.ratio)
