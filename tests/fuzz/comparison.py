"""A case by rne and by the oracle."""

from __future__ import annotations

import warnings
from typing import Any, NamedTuple

import numpy as np

from . import oracle
from .scenes import draw

FINE, COARSE = 1e-11, 1e-9  # relative tolerances of the oracle
WELL_POSED = 1e-6  # [rad or m; rad/s or m/s]: two runs of the oracle that differ more say nothing of rne's
POSITIONS = 1e-5  # [rad or m], of 1 or the largest position: rtol 1e-9 per step, and what well-posed cases make of it
RATES = 1e-4  # of 1 or the largest rate: motions that are 1e-5 apart at events of 10 m/s^2
STOP_TIMES = 1e-6  # [s]
ENERGIES = 1e-5  # of the energy exchanged


class Outcome(NamedTuple):
    """What became of a seed, in words.

    "compared" and equal; "chaotic", where the oracle has no motion to compare with; "refused", where rne warned of what
    then differs; or "failed", which an error of rne is too where there is a motion.
    """

    kind: str
    words: str
    script: str = ""


def check(seed, *, small=False, engine="numpy"):
    """Compare the motions of one seed."""
    case = draw(seed, small=small)
    script = case.script(engine)
    exact, differs = _exact(case)
    try:
        found, warned = simulated(script)
    except Exception as error:
        words = f"{type(error).__name__}: {error}"
        return Outcome("chaotic" if exact is None else "failed", words, script)
    if exact is None:
        return Outcome("chaotic", differs)
    words = "; ".join(difference(found, exact))
    if words and warned:
        return Outcome("refused", f"warned: {warned[0]}; {words}", script)
    return Outcome("failed", words, script) if words else Outcome("compared", "")


def simulated(script):
    """The motion of a case's script, and the warnings it gave."""
    names: dict[str, Any] = {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        exec(script, names)
    return names["motion"], [str(warning.message) for warning in caught]


def _exact(case):
    """The oracle's motion, or None and why there is none."""
    try:
        fine, coarse = oracle.motion(case, FINE), oracle.motion(case, COARSE)
    except oracle.IllPosed as error:
        return None, str(error)
    if (fine.status, fine.joint, len(fine.t)) != (coarse.status, coarse.joint, len(coarse.t)):
        return None, "two ends"
    apart = max(np.abs(fine.q - coarse.q).max(), np.abs(fine.qd - coarse.qd).max(), abs(fine.end - coarse.end))
    return (fine, "") if apart <= WELL_POSED else (None, f"two runs are {apart:.1e} apart")


def difference(motion, exact):
    """All that differs between rne's motion and the oracle's, in words."""
    if motion.status != exact.status:
        return [
            f"status {motion.status} ({motion.message}), expected {exact.status} at {exact.end:.9g} s, joint {exact.joint}"
        ]
    if abs(motion.t[-1] - exact.end) > STOP_TIMES:
        return [f"ends at {motion.t[-1]:.9g} s, expected {exact.end:.9g} s ({motion.message})"]
    if len(motion.t) != len(exact.t):
        return [f"{len(motion.t)} times, expected {len(exact.t)}"]
    energies = [motion.work, *(motion.dissipated.get(name, 0 * motion.t) for name in ("viscous", "coulomb"))]
    exchanged = np.abs(exact.energies).max(axis=0).sum() + exact.kinetic.max()
    words = _apart("q", motion.q, exact.q, exact.t, POSITIONS * max(1.0, np.abs(exact.q).max()))
    words += _apart("qd", motion.qd, exact.qd, exact.t, RATES * max(1.0, np.abs(exact.qd).max()))
    if exact.z.size:
        words += _apart("z", motion.controller_state, exact.z, exact.t, POSITIONS * max(1.0, np.abs(exact.z).max()))
    for k, name in enumerate(("work", "viscous", "coulomb")):
        words += _apart(name, energies[k], exact.energies[:, k], exact.t, ENERGIES * exchanged + 1e-9)
    return words


def _apart(name, a, b, t, tolerance):
    error = np.abs(a - b).reshape(len(t), -1).max(axis=1)
    if not error.max() > tolerance:
        return []
    first, worst = int(np.argmax(error > tolerance)), int(np.argmax(error))
    return [
        f"{name} is {error[worst]:.2e} apart at {t[worst]:.4g} s (tolerance {tolerance:.1e}, exceeded from {t[first]:.4g} s)"
    ]
