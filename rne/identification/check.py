"""Validation of a fit on another motion: predicted and measured torques, errors, bands, a table and a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..basics.spatial import Array
from ..basics.text import InNotebooks, column, listed, short, table, wrapped
from . import thresholds

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Check(InNotebooks):
    """Predicted and measured torques of a motion, for validation of a fit by `rne.identify`.

    Attributes
    ----------
    name : str
        Name of the motion.
    joint_names, units : tuple of str
        Names of the joints, and the units of their torques, "N m" or "N".
    t : ndarray, shape (R,)
        Times [s].
    qd : ndarray, shape (R, n)
        Joint velocities after the filter [rad/s or m/s].
    measured, predicted : ndarray, shape (R, n)
        Torques after the filter [N m or N].
    valid : ndarray of bool, shape (R, n)
        False where a torque was not measured properly.
    std : ndarray, shape (R, n)
        Standard deviations of measured torques about the predicted ones, as by `predict` [N m or N].
    """

    name: str
    joint_names: tuple[str, ...]
    units: tuple[str, ...]
    t: Array
    qd: Array
    measured: Array
    predicted: Array
    valid: Array
    std: Array

    def __repr__(self) -> str:
        worst = 100 * np.nanmax(self.relative, initial=0)
        return wrapped(f"Check(motion {self.name!r}, {len(self.t)} samples, error at most {worst:.3g} %)")

    @property
    def rms(self) -> Array:
        """Root mean square of predicted minus measured torque of each joint, NaN without any, (n,) [N m or N]."""
        return np.asarray(np.sqrt(self._mean((self.predicted - self.measured) ** 2)))

    def _mean(self, x: Array, rows: Array | None = None) -> Array:
        """Means over the valid rows of each joint, or over these rows, NaN without any, shape (n,)."""
        rows = self.valid if rows is None else rows
        return np.asarray((x * rows).sum(0) / np.where(rows.any(0), rows.sum(0), np.nan))

    @property
    def relative(self) -> Array:
        """|predicted - measured| / |measured| of each joint, NaN without any, shape (n,)."""
        return np.asarray(self.rms / np.maximum(np.sqrt(self._mean(self.measured**2)), thresholds.TINY))

    @property
    def r_squared(self) -> Array:
        """Coefficient of determination of each joint, NaN without any torque, shape (n,)."""
        variance = self._mean((self.measured - self._mean(self.measured)) ** 2)
        return np.asarray(1 - self.rms**2 / np.maximum(variance, thresholds.TINY))

    @property
    def covered(self) -> Array:
        """Share of the torques of each joint within the 95 % band, NaN where none has a finite one, shape (n,)."""
        within = np.abs(self.measured - self.predicted) <= thresholds.BAND * self.std
        return self._mean(within, self.valid & np.isfinite(self.std))

    def report(self) -> str:
        """Table of the errors and of the coverage of the 95 % band, joint by joint.

        Returns
        -------
        str
            A line for each joint, and the joints that a constant torque predicts better.
        """
        columns = ("rms error [N m or N]", "relative [%]", "R^2", "within the 95 % band [%]")
        errors = column(self.rms, ".4g"), column(100 * self.relative, ".1f"), column(self.r_squared, ".4f")
        cells = *errors, column(100 * self.covered, ".0f", "-")
        lines = table(f"motion {short(self.name)}", columns, self.joint_names, *cells, indent="  ")
        if worse := [name for name, r2 in zip(self.joint_names, self.r_squared, strict=True) if r2 < 0]:
            cause = "are units, zero and order those of the fitted records?"
            lines.append(f"a constant torque predicts {listed(worse)} better: {cause}")
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Measured and predicted torque and their difference over time, and the difference over speed, by joint.

        Returns
        -------
        matplotlib.figure.Figure
            With the 95 % band of measured torques about the predicted ones, where it is finite;
            `figure.savefig("torques.png")` writes it to a file.
        """
        from ..plotting import prediction_plot

        torques = self.t, self.measured, self.predicted, self.qd
        title, bands = f"Torques of {self.name}", {"std": self.std, "valid": self.valid}
        return prediction_plot(*torques, **bands, joint_names=self.joint_names, units=self.units, title=title)
