"""Measurements of one motion: times, joint positions and torques."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import convert_numbers
from .grid import Segment, sample_period, split
from .preparation import Part, prepare
from .prepared import Prepared


class Record:
    """Measurements of one motion.

    Parameters
    ----------
    t : array_like, shape (T,)
        Times [s].
    q, tau : array_like, shape (T, n)
        Joint positions and torques [rad or m; N m or N].
    qd : array_like, shape (T, n), optional
        Joint rates [rad/s or m/s].
    name : str
        For messages and plots.
    bridge : int
        Missing samples in a row, up to which a gap is interpolated; at longer ones the record is cut.

    Raises
    ------
    ValueError
        If an array has the wrong shape.

    Examples
    --------
    >>> import numpy as np, rne
    >>> t = np.arange(2000) / 500
    >>> q = np.sin(2 * np.pi * np.outer(t, [0.5, 1.0]))
    >>> rne.identification.Record(t, q, np.cos(q)).prepare(cutoff=10).cutoff
    10.0
    """

    def __init__(
        self,
        t: ArrayLike,
        q: ArrayLike,
        tau: ArrayLike,
        qd: ArrayLike | None = None,
        *,
        name: str = "record",
        bridge: int = 3,
    ) -> None:
        self.name, self.bridge = name, bridge
        self.t = np.array(convert_numbers("t", t, "(T,)"), dtype=np.float64)
        self.q = np.array(convert_numbers("q", q, "(T, n)"), dtype=np.float64)
        self.tau = np.array(convert_numbers("tau", tau, "(T, n)"), dtype=np.float64)
        self.qd = None if qd is None else np.array(convert_numbers("qd", qd, "(T, n)"), dtype=np.float64)
        self.findings: tuple[object, ...] = ()
        self.period = sample_period(self.t, bridge)
        self.segments: tuple[Segment, ...] = tuple(split(self.t, np.ones(len(self.t), bool), self.period, bridge))

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    def prepare(self, cutoff: float | None = None, decimation: int | None = None) -> Prepared:
        """Positions, rates, accelerations and torques on an equally spaced grid, and the filter for a fit.

        Parameters
        ----------
        cutoff : float, optional
            Of the parallel filter [Hz]; chosen from the spectrum of the positions if not given.
        decimation : int, optional
            Samples per reduced row; by default the cut-off is 0.8 times half the rate of the rows.

        Returns
        -------
        Prepared
            The arrays; `notes` says how the cut-off was chosen.

        Raises
        ------
        ValueError
            If the record has errors, or is too short for the filter.

        Examples
        --------
        >>> import numpy as np, rne
        >>> t = np.arange(2000) / 500
        >>> record = rne.identification.Record(t, np.sin(t)[:, None], np.cos(t)[:, None])
        >>> record.prepare(cutoff=5.0).decimation
        40
        """
        usable = np.ones(self.q.shape, dtype=bool)
        parts = [
            Part(part.t, part.on_grid(self.t, self.q), part.on_grid(self.t, self.tau), usable[: len(part.t)])
            for part in self.segments
        ]
        return prepare(self.name, parts, 1 / self.period, cutoff, decimation)
