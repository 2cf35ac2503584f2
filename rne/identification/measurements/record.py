"""Measurements of one motion: times, joint positions and torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import convert_numbers
from ...basics.spatial import Array
from ...basics.text import counted
from ...simulation.motion_files import numbered_joints
from .bandwidth import FASTEST
from .findings import RecordFinding
from .preparation import Part, prepare
from .prepared import Prepared
from .screening import Measured, screen
from .sources import UNITS, RecordSources, samples_array
from .stamps import Stamps

SWEEP = (0.5, 1.0, 2.0)  # times the chosen cut-off


class Record(RecordSources):
    """Measurements of one motion, screened for faults.

    Parameters
    ----------
    t : array_like, shape (T,)
        Times [s].
    q : array_like, shape (T, n)
        Joint positions, in `unit`.
    tau : array_like, shape (T, n)
        Joint torques [N m or N].
    qd : array_like, shape (T, n), optional
        Measured joint rates, per second of `unit`. They are compared with the positions; a fit uses the derivatives of
        the positions.
    name : str
        For messages.
    joint_names : sequence of str, optional
        For messages; "joint_1" and so on if not given.
    unit : {"rad", "m", "deg"}, or a sequence of n of them
        Unit of the positions of all joints, or of each.
    stamps : {"sampled", "regular"}
        What jitter of the times means: "sampled", that the samples were taken at these times; "regular", that they were
        taken in equal steps and the times came later.
    bridge : int
        How many samples in a row, missing or not to be believed, are interpolated; at longer gaps the record is cut.

    Attributes
    ----------
    t : ndarray, shape (T,)
        Times as given [s].
    q, tau : ndarray, shape (T, n)
        Positions and torques as given, in SI units [rad or m; N m or N].
    qd : ndarray, shape (T, n), or None
        Rates as given, in SI units [rad/s or m/s].
    findings : tuple of RecordFinding
        What is wrong with the measurements and what is done about it; empty if nothing is.
    encoder_step : ndarray, shape (n,)
        Smallest step of each position, of which all others are multiples [rad or m]; zero if there is none.
    sample_rate : float
        Samples per second, those that are missing included [Hz].

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not of numbers, or an option is none of those named.

    Notes
    -----
    Looked for: times that go back or are there twice, gaps, missing samples and jitter; values that are not finite;
    positions and torques off the curve through their neighbours by more than ten times the usual deviation; positions
    repeated in the midst of a motion; jumps of positions; torques that are constant, or saturated; rates that are not
    those of the positions; positions in degrees; joints that do not move; fewer than two samples per second, as of
    times in milliseconds. Errors are raised by `prepare`.

    Examples
    --------
    >>> import numpy as np, rne
    >>> t = np.arange(2000) / 500
    >>> q = np.sin(2 * np.pi * np.outer(t, [0.5, 1.0]))
    >>> q[700, 1] += 0.3
    >>> record = rne.identification.Record(t, q, np.cos(q), name="run 1")
    >>> print(record.findings[0])
    warning: run 1: joint_2: wild position at sample 700 (t = 1.4 s); interpolated
    """

    def __init__(
        self,
        t: ArrayLike,
        q: ArrayLike,
        tau: ArrayLike,
        qd: ArrayLike | None = None,
        *,
        name: str = "record",
        joint_names: Sequence[str] | None = None,
        unit: str | Sequence[str] = "rad",
        stamps: Stamps = "sampled",
        bridge: int = 3,
    ) -> None:
        if stamps not in ("sampled", "regular"):
            raise ValueError(f'`stamps` must be "sampled" or "regular", got {stamps!r}')
        if isinstance(bridge, bool) or not isinstance(bridge, int | np.integer) or bridge < 0:
            raise ValueError(f"`bridge` must be an integer that is not negative, got {bridge!r}")
        self.name, self._stamps, self._bridge = name, stamps, int(bridge)
        self.q = samples_array("q", q, None)
        self.t = _times(t, len(self.q))
        self.tau = samples_array("tau", tau, self.q.shape)
        self.qd = None if qd is None else samples_array("qd", qd, self.q.shape)
        n = self.q.shape[1]
        self.joint_names = numbered_joints(n) if joint_names is None else tuple(joint_names)
        if len(self.joint_names) != n:
            raise ValueError(f"`joint_names` must have {n} names, got {len(self.joint_names)}")
        factors = _factors(unit, n)
        self.q *= factors
        if self.qd is not None:
            self.qd *= factors
        for array in (self.t, self.q, self.tau, *([] if self.qd is None else [self.qd])):
            array.flags.writeable = False
        measured = Measured(self.t, self.q, self.tau, self.qd)
        self._screened = screen(name, self.joint_names, measured, self._bridge, stamps)

    def __repr__(self) -> str:
        t = self.t
        return (
            f"Record '{self.name}': {counted(len(t), 'sample')} of {counted(self.n, 'joint')}, "
            f"{t[-1] - t[0]:.4g} s, {counted(len(self.findings), 'finding')}"
        )

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    @property
    def findings(self) -> tuple[RecordFinding, ...]:
        """What is wrong with the measurements and what is done about it."""
        return self._screened.findings

    @property
    def encoder_step(self) -> Array:
        """Smallest step of each position, shape (n,) [rad or m]; zero if there is none."""
        return self._screened.encoder_step

    @property
    def sample_rate(self) -> float:
        """Samples per second, those that are missing included [Hz]."""
        return 1 / self._screened.period

    def between(self, start: float, end: float) -> Record:
        """The part of the record in an interval of time.

        Parameters
        ----------
        start, end : float
            Of the interval [s].

        Returns
        -------
        Record
            With the samples of which start <= t <= end.

        Raises
        ------
        ValueError
            If there is none.

        Examples
        --------
        >>> import numpy as np, rne
        >>> t = np.arange(2000) / 500
        >>> record = rne.identification.Record(t, np.sin(t)[:, None], np.cos(t)[:, None])
        >>> len(record.between(1.0, 2.0).t)
        501
        """
        part = (self.t >= start) & (self.t <= end)
        if not part.any():
            raise ValueError(f"there are no samples between {start:.6g} and {end:.6g} s")
        qd = None if self.qd is None else self.qd[part]
        options: dict[str, Any] = {"name": self.name, "joint_names": self.joint_names}
        return Record(
            self.t[part], self.q[part], self.tau[part], qd, stamps=self._stamps, bridge=self._bridge, **options
        )

    def prepare(self, cutoff: float | None = None, decimation: int | None = None) -> Prepared:
        """Positions, rates, accelerations and torques on an equally spaced grid, and the filter for a fit.

        Parameters
        ----------
        cutoff : float, optional
            Of the parallel filter [Hz], at most a fifth of the sample rate. If it is not given, five times the
            frequency below which 99 % of the power of the rates lies, less where the noise of the encoders disturbs the
            accelerations; never more than a fifth of the sample rate.
        decimation : int, optional
            Samples per reduced row; by default the cut-off is 0.8 times half the rate of the rows.

        Returns
        -------
        Prepared
            The arrays; `notes` says how the cut-off was chosen, what was dropped, and the findings.

        Raises
        ------
        ValueError
            If a finding is an error, there is no motion to choose a cut-off from, no segment is long enough for the
            filters, or an argument is out of its range.

        Notes
        -----
        Positions pass a filter of five times the cut-off, at most a quarter of the sample rate, before they are
        differentiated by central differences of eighth order. Both filters are Butterworth filters of fourth order that
        run forwards and backwards. What a filter takes from the accelerations it takes from the inertias, so that
        parameters depend on the cut-off: `sweep` shows by how much.

        Examples
        --------
        >>> import numpy as np, rne
        >>> t = np.arange(2000) / 500
        >>> q = np.sin(2 * np.pi * np.outer(t, [0.5, 1.0]))
        >>> prepared = rne.identification.Record(t, q, np.cos(q)).prepare()
        >>> prepared.notes[0]
        "cut-off 6.25 Hz, chosen from the spectrum of the positions: 5 times the motion's bandwidth of 1.25 Hz"
        """
        errors = [finding for finding in self.findings if finding.severity == "error"]
        if errors:
            more = f" ({len(errors) - 1} more errors in `findings`)" if len(errors) > 1 else ""
            raise ValueError(errors[0].message + more)
        clean = self._screened
        parts = [
            Part(
                part.t,
                part.on_grid(clean.t, clean.q),
                part.on_grid(clean.t, clean.tau),
                part.nearest(clean.t, clean.usable),
            )
            for part in clean.segments
        ]
        prepared = prepare(self.name, parts, self.sample_rate, cutoff, decimation)
        return replace(prepared, notes=(*prepared.notes, *(str(finding) for finding in self.findings)))

    def sweep(self, cutoffs: ArrayLike | None = None) -> tuple[Prepared, ...]:
        """The record prepared with several cut-offs, to see how far what is fitted depends on the filter.

        Parameters
        ----------
        cutoffs : array_like, shape (k,), optional
            Cut-offs [Hz]; half, once and twice the one that `prepare` chooses if not given.

        Returns
        -------
        tuple of Prepared
            One for each cut-off.

        Raises
        ------
        ValueError
            As `prepare`.

        Examples
        --------
        >>> import numpy as np, rne
        >>> t = np.arange(4000) / 500
        >>> record = rne.identification.Record(t, np.sin(t)[:, None], np.cos(t)[:, None])
        >>> [prepared.cutoff for prepared in record.sweep([5, 10, 20])]
        [5.0, 10.0, 20.0]
        """
        if cutoffs is None:
            chosen = self.prepare().cutoff
            cutoffs = [factor * chosen for factor in SWEEP if factor * chosen <= FASTEST * self.sample_rate]
        return tuple(self.prepare(float(cutoff)) for cutoff in np.asarray(cutoffs, dtype=np.float64))


def _times(t: ArrayLike, count: int) -> Array:
    array = np.array(convert_numbers("t", t, f"({count},)"), dtype=np.float64)
    if array.shape != (count,):
        raise ValueError(f"`t` must have shape ({count},), one time for each row of `q`, got {array.shape}")
    if not np.isfinite(array).all():
        k = int(np.argmin(np.isfinite(array)))
        raise ValueError(f"`t` must be finite, got {array[k]} at index ({k},)")
    return array


def _factors(unit: str | Sequence[str], n: int) -> Array:
    """Factors from the units of n joints to SI units."""
    units = [unit] * n if isinstance(unit, str) else list(unit)
    if len(units) != n or any(u not in UNITS for u in units):
        raise ValueError(f'`unit` must be "rad", "m" or "deg", or {n} of them, got {unit!r}')
    return np.array([UNITS[u] for u in units])
