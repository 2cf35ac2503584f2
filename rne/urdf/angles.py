"""Angles in a file that are rounded multiples of 15 degrees: detection, rounding, and the operations saved."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from decimal import Decimal
from fractions import Fraction
from functools import lru_cache

import numpy as np

from ..basics.arrays import FULL_TURN
from ..basics.text import counted
from ..dynamics import inverse_dynamics, mass_matrix
from ..model.model import Model
from .document import Element, attribute_numbers, describe
from .findings import FindingsReport, some

STEP = Fraction("3.14159265358979323846264338327950288419716939937510") / 12  # rad: 15 degrees
FEWEST_DECIMALS = 3  # 1.57 may be any angle, 1.571 hardly
STATES = 64  # number of states in which torques are compared
LARGEST = 48  # most bodies: kernels of M of longer chains are not written out


@lru_cache(1024)
def multiple_of_step(number: str) -> tuple[int, int]:
    """Integer k of the multiple k pi/12 that a decimal number is rounded or truncated from, and its decimals.

    k is 0 for all other numbers, for those with fewer than three decimals, and beyond a full turn.
    """
    value, step = float(number), float(STEP)
    k = round(value / step) if abs(value) <= FULL_TURN else 0
    if k == 0 or abs(value - k * step) > 10.0**-FEWEST_DECIMALS:  # nearly all others, without exact arithmetic
        return 0, 0
    written = Decimal(number)  # exactly, in the context of any thread
    decimals = -int(written.as_tuple().exponent)
    missing = (abs(k) * STEP - abs(Fraction(written))) * Fraction(10) ** decimals  # in units of the last decimal
    return (k, decimals) if decimals >= FEWEST_DECIMALS and Fraction(-1, 2) <= missing < 1 else (0, 0)


def name_of(k: int) -> str:
    """Text of the multiple k of 15 degrees in terms of pi, such as "-3 pi/4"."""
    part = Fraction(abs(k), 12)
    factor, divisor = ("" if x == 1 else str(x) for x in (part.numerator, part.denominator))
    return f"{'-' * (k < 0)}{factor}{' ' * bool(factor)}pi{'/' * bool(divisor)}{divisor}"


def read_angles(
    elements: Iterable[tuple[str, Element]], attribute: str, report: FindingsReport, *, rounded: bool
) -> None:
    """Note angles [rad] of elements, given with their owners, that are multiples of 15 degrees to the decimals written.

    Angles equal to the multiple in double precision are not noted. With `rounded` the elements get the multiples, and
    the report a warning for each.
    """
    message, cure = f"angles of {attribute!r} are rounded to multiples of 15 degrees", "write 17 digits"
    for owner, element in elements:
        numbers = element.get(attribute, "").split() if attribute_numbers(element, attribute) else []
        for place, number in enumerate(numbers):
            k, decimals = multiple_of_step(number)
            exact = float(k * STEP)
            if k == 0 or exact == float(number):
                continue
            report.angles.append((k, decimals))
            if rounded:
                numbers[place] = repr(exact)
                element.set(attribute, " ".join(numbers))
                report.warning(element, owner, message, cure, detail=f"{number} to {name_of(k)}")


def origins(root: Element) -> Iterator[tuple[str, Element]]:
    """Elements <origin> of each joint and <inertial> of a <robot>, with the joint or link as text."""
    for kind, path in (("link", "inertial/origin"), ("joint", "origin")):
        for element in root.iterfind(kind):
            origin = element.find(path)
            if origin is not None:
                yield describe(element), origin


def report_savings(written: Model, rounded: Model, report: FindingsReport) -> None:
    """Warn if kernels of M or inverse dynamics have another number of operations with angles rounded.

    Kernels too large to be written out, which run the recursion, have no such number.
    """
    from ..kernels import compile  # loaded for files with such angles

    counts = []
    for name, function in (("M", mass_matrix), ("inverse dynamics", inverse_dynamics)):
        now, then = (sum(compile(function, model).operations.values()) for model in (written, rounded))
        counts += [f"{name} takes {then} operations for {now}"] * (now > 0 and then != now)
    states = np.random.default_rng(0).uniform(-np.pi, np.pi, (3, STATES, written.n))
    with np.errstate(all="ignore"):
        tau, other = (inverse_dynamics.core(model, *states) for model in (written, rounded))
        change = np.abs(other - tau).max(initial=0) / np.abs(tau).max(initial=0)
    if counts and np.isfinite(change):
        multiples, decimals = ({abs(x) for x in column} for column in zip(*report.angles, strict=True))
        angles = f"{counted(len(report.angles), 'angle')} {'are' if report.angles[1:] else 'is'}"
        digits = "-".join(str(x) for x in sorted({min(decimals), max(decimals)}))
        message = f"{angles} {some(map(name_of, sorted(multiples)))} to {digits} decimals"
        part = f"{change:.1g}".replace("e-0", "e-")
        cure = f"with round_angles=True {', '.join(counts)}, torques change by {part} of the largest"
        report.warning(None, "robot", message, cure)
