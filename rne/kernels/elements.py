"""Names of single entries of a quantity, as in the thesis's appendix C: m23 of M, c3 of C q', g2 of g, tau4."""

from __future__ import annotations

import re
from collections.abc import Sequence

LETTERS = {
    "mass_matrix": "m",
    "coriolis_torque": "c",
    "gravity_torque": "g",
    "bias_torque": "h",
    "inverse_dynamics": "tau",
    "forward_dynamics": "qdd",
}


def quantity_of_element(element: str) -> str:
    """The quantity that an entry belongs to, by the letters of its name; ValueError if there is none."""
    letters = re.sub(r"[0-9_]*$", "", element)
    for quantity, known in LETTERS.items():
        if letters == known:
            return quantity
    raise ValueError(f"`element` must start with one of {list(LETTERS.values())}, got {element!r}")


def entry_of_element(element: str, quantity: str, shape: Sequence[int]) -> tuple[int, ...]:
    """The place of an entry in a result of some shape, from 0.

    Parameters
    ----------
    element : str
        Letters of the quantity and the joints' numbers from 1, such as "m23", "c3" or, beyond nine joints, "m2_13".
    quantity : str
    shape : sequence of int
        Of the quantity's result: (n,) or (n, n).

    Raises
    ------
    ValueError
        If the quantity's entries have no names, or there is no such entry.

    Examples
    --------
    >>> from rne.kernels.elements import entry_of_element
    >>> entry_of_element("m23", "mass_matrix", (6, 6))
    (1, 2)
    """
    if quantity not in LETTERS:
        raise ValueError(f"`element` is for {', '.join(LETTERS)}; entries of {quantity} have no names")
    letters = LETTERS[quantity]
    one, two = r"([1-9][0-9]*)", r"([1-9])([1-9])|([1-9][0-9]*)_([1-9][0-9]*)"
    match = re.fullmatch(f"{letters}(?:{one if len(shape) == 1 else two})", str(element))
    entry = tuple(int(number) - 1 for number in match.groups() if number) if match else ()
    if not entry or any(k >= size for k, size in zip(entry, shape, strict=True)):
        between = "_" if max(shape) > 9 else ""
        first, last = (letters + between.join(str(number(size)) for size in shape) for number in (lambda _: 1, int))
        raise ValueError(f"`element` of {quantity} must be one of {first} ... {last}, got {element!r}")
    return entry
