"""Verdicts on the thesis's claims: each compares figures of a run with a criterion, and says what was found."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

DEPARTED_WITHIN = 1.0  # [s] to a deviation of 1 rad, where a torque does not hold
AT_REST = 1e-6  # [rad], of a pose that is held
COLLAPSE = (3.0, 5.0)  # [s] to a deviation of 0.1 rad, for "about 4 s"
COLLAPSED_WITHIN = 2.0  # [s] from there to 1 rad
CONSTANT = 1e-4  # relative spread of an energy that is constant "but for small variations"
DOMINATES = 10.0  # times larger than the rest
SETTLING = (2.25, 3.75)  # [s], for "about 3 s"
ROUNDING = 4 * 2.0**-52  # relative to V at the start
RATE_OF_V = 1e-9  # relative to the powers of which dV/dt is the sum
CALM = 10.0  # [rad/s], rate at the end of a stable loop
RUNAWAY = 1e4  # [rad/s], far from the largest rate of a stable loop, 17, and from the least of an unstable one, 1.1e5
GROWTH = 0.01  # relative difference of two growth rates
SAME_TORQUE = 1e-13  # relative to the largest torque
ALIKE = 1e-3  # [rad], of motions that are the same
DENSE = 0.02  # relative difference of densities that are "1500 kg/m^3"
ONE_MILLIMETRE = 1e-3  # [m]
INSIGNIFICANT = 0.1  # relative change of a settling time that makes "no real difference"
APART = 0.05  # [rad], of motions that are not the same
EXPLAINED = 0.03  # relative difference of a settling time from its explanation
OVERSHOOT = 0.15  # relative difference of a peak from its estimate
SETTLED = 0.01  # [rad], every joint
DIVERGING = 500.0  # [rad/s], some sixty times the largest rate of the undisturbed runs
RISE = 5e-5  # [J], beyond the errors of the solver; V starts at more than 700 J
# Of the band: from starts 1e-9 rad apart the level takes 0.57 to 0.92 of it by DOP853 at 1e-12, 0.78 to 0.97 by RK45,
# and 0.005 to 0.19 by a symplectic method.
ACCUMULATED = 0.5
PRINTED = 1e-9  # [kg m^2], far below the last printed digit


class Verdict(NamedTuple):
    """Verdict on a claim by a criterion, and the figures found."""

    holds: bool
    criterion: str
    found: str

    def __str__(self) -> str:
        return f"{'Confirmed' if self.holds else 'Not confirmed'}. Criterion: {self.criterion}. Found: {self.found}."


def seconds(times: Sequence[float], digits: int = 3) -> str:
    """Times in a row, "never" for infinity."""
    return ", ".join("never" if np.isinf(t) else f"{t:.{digits}f} s" for t in times)


def not_held(times: Sequence[float]) -> Verdict:
    """6.3-1 and 6.3-2: the constant torque does not hold the arm; times to a deviation of 1 rad [s]."""
    return Verdict(
        max(times) <= DEPARTED_WITHIN, f"1 rad from the start within {DEPARTED_WITHIN:g} s", f"after {seconds(times)}"
    )


def held(distance: float, duration: float) -> Verdict:
    """A pose that is kept: largest distance from it [rad] in `duration` [s]."""
    return Verdict(
        distance <= AT_REST, f"within {AT_REST:g} rad for {duration:g} s", f"{distance:.1e} rad at the farthest"
    )


def collapses(tenth: float, one: float) -> Verdict:
    """6.3-4: about 4 s near the start, then collapse; times to 0.1 and to 1 rad [s]."""
    low, high = COLLAPSE
    return Verdict(
        bool(low <= tenth <= high and one - tenth <= COLLAPSED_WITHIN),
        f"0.1 rad after {low:g} to {high:g} s, and 1 rad at most {COLLAPSED_WITHIN:g} s later",
        f"after {seconds([tenth, one])}",
    )


def energy_is_constant(spread: float, energy: float) -> Verdict:
    """6.4.5: spread of the energy over a free swing, and the energy [J]."""
    relative = spread / abs(energy)
    return Verdict(
        relative <= CONSTANT, f"spread at most {CONSTANT:g} of the energy", f"{spread:.1e} J, {relative:.1e} of it"
    )


def swings_part(time: float, duration: float) -> Verdict:
    """6.4-2: an entirely different motion; time to a difference of 1 rad [s]."""
    return Verdict(time <= duration, f"1 rad apart within {duration:g} s", f"after {seconds([time], 2)}")


def height_of_wrist(printed: float, correct: float) -> str:
    """6.4.5 lays the variations to the solver: spreads of the energy with the height of (6.38) and without [J]."""
    ratio = printed / correct
    if ratio < DOMINATES:
        return (
            f"The height of the wrist by (6.38) changes the energy {plain(ratio)} times as much as the solver's errors "
            f"do, less than {DOMINATES:g} times: it is no better explanation of the variations of 6.4.5 than the "
            "solver."
        )
    return (
        f"(6.38) omits q4 in the height of the wrist. With it the energy varies {plain(ratio)} times as much as by the "
        "solver's errors. An inference, since the thesis does not say how its energies were computed: if they were "
        "computed with (6.38), most of the variations of 6.4.5 are not due to the solver."
    )


def settles(times: Sequence[float]) -> Verdict:
    """6.5: convergence in about 3 s; settling times [s]."""
    low, high = SETTLING
    return Verdict(
        bool(low <= min(times) and max(times) <= high),
        f"every joint within 0.01 rad for good after {low:g} to {high:g} s",
        f"after {seconds(times)}",
    )


def lyapunov_falls(increase: float, deviation: float) -> Verdict:
    """(6.50), (6.55): largest relative increase of V between samples, largest relative deviation of dV/dt."""
    return Verdict(
        increase <= ROUNDING and deviation <= RATE_OF_V,
        f"V never rises from one sample to the next by more than {ROUNDING:.0e} of its first value, and dV/dt from the "
        f"simulated accelerations is that of (6.55) to {RATE_OF_V:g} of the powers it is the sum of",
        f"increase {increase:.0e}, deviation {deviation:.0e}",
    )


def no_difference(times: Sequence[Sequence[float]], ideal: Sequence[float]) -> Verdict:
    """6.5.3: settling times of each run with each addition, and without any [s]."""
    changes = np.array([[t / without - 1 for t in run] for run, without in zip(times, ideal, strict=True)])
    settled = np.isfinite(changes)
    late = f"at most {max(0, changes[settled].max()):.0%} later; " if settled.any() else ""
    return Verdict(
        bool((np.abs(changes) <= INSIGNIFICANT).all()),
        f"each run settles within {INSIGNIFICANT:.0%} of its time without",
        f"{late}{np.sum(~settled)} of {settled.size} runs do not settle",
    )


def plain(value: float) -> str:
    """Two significant digits without an exponent."""
    return f"{float(f'{value:.2g}'):.10g}"


def viscous(found: float, predicted: float, without: float) -> str:
    """6.5.3: slowest settling with viscous friction, that of the wrist alone, slowest without friction [s]."""
    text = (
        f"the wrist alone needs {predicted:.2f} s, the slowest run {found:.2f} s, and {without:.2f} s without friction"
    )
    if abs(found / predicted - 1) <= EXPLAINED:
        return f"{text}: the wrist decides (criterion: within {EXPLAINED:.0%})."
    return f"{text}: the wrist alone does not explain it (criterion: within {EXPLAINED:.0%})."


def coulomb(error: float, bound: float) -> str:
    """6.5.3: largest error left by Coulomb friction, and that at which Kp overcomes it [rad]."""
    left = f"{error:.2g} rad is left after the run"
    if error > bound:
        return f"{left}, more than these {bound:g} rad: friction alone does not explain it."
    if error > SETTLED:
        return f"{left}: the loop does not settle within {SETTLED:g} rad."
    return f"{left}: the loop settles all the same."


def saturation(settling: float, saturated: float, joint: int, gravity: float, limit: float) -> str:
    """6.5.3: run 6.5-2 with limited torque: settling and time at the limit [s], gravity's and largest torque [N m]."""
    where = f"With {limit:g} N m joint_{joint} is at its limit for {saturated:.2f} s"
    if gravity <= limit:
        return f"{where}, but gravity asks for no more than that."
    if np.isfinite(settling):
        return f"{where}; its speed carries it over, and the arm settles after {settling:.3f} s."
    return f"{where}, and the arm does not arrive."


def overshoot(rate: float, predicted: float, ideal: float) -> str:
    """6.5.3: largest rate with a limit to the rate of torques, that predicted, and that without a limit [rad/s]."""
    text = f"The wrist reaches {rate:.0f} rad/s instead of {ideal:.1f}; predicted {predicted:.0f}"
    if abs(rate / predicted - 1) <= OVERSHOOT:
        return f"{text}, which explains it (criterion: within {OVERSHOOT:.0%})."
    return f"{text}, which does not explain it (criterion: within {OVERSHOOT:.0%})."


def lagging(rates: Sequence[float], increases: Sequence[float], duration: float) -> str:
    """6.5.3: runs with a stricter limit to the rate of torques: largest rates [rad/s] and increases of V [J]."""
    found = f"{min(rates):.0f} to {max(rates):.0f} rad/s after {duration:g} s"
    if min(rates) > DIVERGING and min(increases) > RISE:
        return f"all runs diverge ({found}), and V rises: the torque lags behind the wrist, and the loop feeds it."
    return f"not all runs diverge ({found})."


def stiffness(explicit: Sequence[int], stiff: Sequence[int], open_loop: int, observed: float) -> str:
    """The share of stiffness in the observed ratio of computing times: evaluations of the solvers in 5 s and 10 s."""
    against = [e / s for e, s in zip(explicit, stiff, strict=True)]
    factors = sorted(e / open_loop for e in explicit)
    text = (
        f"RK45 takes {min(against):.0f} to {max(against):.0f} times the evaluations of LSODA, and {factors[0]:.0f} to "
        f"{factors[-1]:.0f} times those of the open loop 7.1-2, {open_loop}."
    )
    if factors[-1] >= observed / 2:
        return f"{text} That is more than half of the {observed:.0f} of Table 7.1."
    return (
        f"{text} That is the share of stiffness in the {observed:.0f} of Table 7.1; a factor of "
        f"{observed / factors[-1]:.1f} stays unexplained. As the open loop ran twice as long, both ratios are twice as "
        f"large per simulated second: {2 * factors[0]:.0f} to {2 * factors[-1]:.0f} of {2 * observed:.0f}."
    )


def sampling(calm: Sequence[float], wild: Sequence[float], limit: float) -> Verdict:
    """Rates at the end just below the limit of the sample time, largest rates just above it [rad/s]."""
    return Verdict(
        max(calm) <= CALM and min(wild) >= RUNAWAY,
        f"below {limit:.4g} s the rates end below {CALM:g} rad/s, above it they pass {RUNAWAY:g} rad/s",
        f"{max(calm):.2g} rad/s at most, {min(wild):.2g} rad/s at least",
    )


def grows(measured: float, predicted: float) -> Verdict:
    """7.1-2: rate at which a small deviation grows, and that of the linearised equations [1/s]."""
    return Verdict(
        predicted > 0 and abs(measured / predicted - 1) <= GROWTH,
        f"a deviation of 1e-6 rad grows at the positive rate of the linearised equations, to {GROWTH:.0%}",
        f"{measured:.3f} 1/s, linearised {predicted:.3f} 1/s",
    )


def alike(difference: float) -> str:
    """7.1-2 by both formulations, "similar but not identical": largest difference of a joint [rad]."""
    found = f"7.1-2 by both formulations: the joints differ by at most {difference:.0e} rad (criterion {ALIKE:g} rad)."
    if difference > ALIKE:
        return f"{found} Similar but not identical, as the thesis says: what tips the arm over is the solver's error."
    return (
        f"{found} Here the two motions are the same, other than in the thesis. An inference: the arm is tipped over "
        "by the rounding of sin π at its start, which both formulations share here, and which other code rounds "
        "otherwise."
    )


def other_motions(same_numbers: Sequence[float], same_motion: Sequence[float]) -> Verdict:
    """7.2.2: transients differ because q3 is counted otherwise; largest differences of both comparisons [rad]."""
    return Verdict(
        min(same_numbers) > APART and max(same_motion) <= ALIKE,
        f"with the same numbers some joint is more than {APART:g} rad apart in every run, in the same motion none is "
        f"by {ALIKE:g} rad",
        f"{', '.join(f'{x:.3f}' for x in same_numbers)} rad, and at most {max(same_motion):.0e} rad",
    )


def density(densities: Sequence[float], stated: float) -> Verdict:
    """Table 4.1: densities of the cylinders and the stated one [kg/m^3]."""
    worst = max(abs(d / stated - 1) for d in densities)
    return Verdict(
        worst <= DENSE, f"within {DENSE:.0%} of the stated {stated:g} kg/m³", f"{worst:.1%} off at the farthest"
    )


def reach(length: float, stated: float) -> Verdict:
    """Appendix A: reach of the arm and that of the data sheet [m]."""
    return Verdict(
        abs(length - stated) <= ONE_MILLIMETRE,
        f"within {ONE_MILLIMETRE * 1e3:g} mm of the data sheet's {stated:.3f} m",
        f"{length:.3f} m",
    )


def formulations(ratio: float, claimed: float, difference: float) -> str:
    """Table 7.1: ratio of times of Euler-Lagrange to Newton-Euler, relative difference of their torques."""
    same = "the same torques" if difference <= SAME_TORQUE else "DIFFERENT torques"
    text = (
        f"With zeros removed and repeated terms shared in both, Euler-Lagrange takes {ratio:.1f} times as long as "
        f"Newton-Euler, and both give {same} ({difference:.0e} of the largest; criterion {SAME_TORQUE:g})."
    )
    if ratio >= claimed / 2:
        return f"{text} That is at least half of the thesis's {claimed:.0f}: confirmed."
    return (
        f"{text} That is less than half of the thesis's {claimed:.0f}: the order is confirmed, the size is not. That "
        "the rest is due to how the thesis's code was expanded is an inference; its code is not at hand."
        if ratio > 1
        else f"{text} Not confirmed: Euler-Lagrange is not the slower one."
    )


def same_coefficients(difference: float, count: int) -> Verdict:
    """Appendix C: largest difference of the printed coefficients from ours [kg m^2]."""
    return Verdict(
        difference <= PRINTED, f"each of {count} coefficients to {PRINTED:g} kg m²", f"{difference:.0e} kg m² at most"
    )


def accumulates(band: float, wander: float) -> bool:
    """True if what an energy error leaves behind for good is more of its band than what comes and goes [J]."""
    return wander > ACCUMULATED * band


def long_run(name: str, band: float, wander: float, energy: float) -> str:
    """The energy error of a method over a long run: its band, the range of its level, and the energy [J]."""
    kind = "accumulates" if accumulates(band, wander) else "comes and goes"
    return (
        f"{name}: {energy_is_constant(band, energy)} The error {kind}: its level wanders through {wander:.1e} J, "
        f"{wander / band:.0%} of its band."
    )
