"""A model against a measured motion: torques predicted and measured, filtered alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...basics.spatial import Array
from ...basics.text import InNotebooks, Row, aligned, short, wrapped
from ...plotting.plots import HIDDEN, figure_of, legend_beside, literal, panels, plot_columns, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOOK = (("0.7", 3.0), ("C0", 1.2), ("C3", 1.0))  # colour and width of measured, predicted and residual torques
GAP = 1.5  # times the usual step, over which no line is drawn


@dataclass(frozen=True, eq=False)
class Check(InNotebooks):
    """Torques predicted for a measured motion beside the measured ones, by `Identification.check`.

    Attributes
    ----------
    name : str
        What the motion is called.
    joint_names, units : tuple of str
        Of the joints; "N m" or "N".
    t : ndarray, shape (R,)
        Times [s].
    qd : ndarray, shape (R, n)
        Joint velocities after the filter [rad/s or m/s].
    measured, predicted : ndarray, shape (R, n)
        Torques after the filter [N m or N].
    valid : ndarray of bool, shape (R, n)
        False where a torque was not measured properly.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
    >>> q, qd, qdd = rne.trajectories.quintic([0] * 6, [1] * 6, 10.0)(t)
    >>> record = rne.identification.Record(t, q, robot.inverse_dynamics(q, qd, qdd))
    >>> check = rne.identify(robot, record, consistent=False).check(record)
    >>> bool((check.relative < 1e-3).all())
    True
    >>> print(check.report().splitlines()[0].split("  ")[0])
    motion record
    >>> len(check.plot().axes)
    12
    """

    name: str
    joint_names: tuple[str, ...]
    units: tuple[str, ...]
    t: Array
    qd: Array
    measured: Array
    predicted: Array
    valid: Array

    def __repr__(self) -> str:
        worst = 100 * np.nanmax(self.relative, initial=0)
        return wrapped(f"Check(motion {self.name!r}, {len(self.t)} samples, error at most {worst:.3g} %)")

    @property
    def rms(self) -> Array:
        """Root mean square of predicted less measured torque of each joint, NaN without any, (n,) [N m or N]."""
        rows = np.where(self.valid.any(0), self.valid.sum(0), np.nan)
        errors: Array = np.sqrt((((self.predicted - self.measured) * self.valid) ** 2).sum(0) / rows)
        return errors

    @property
    def relative(self) -> Array:
        """|predicted - measured| / |measured| of each joint, NaN without any, shape (n,)."""
        rows = np.maximum(self.valid.sum(0), 1)
        size = np.sqrt(((self.measured * self.valid) ** 2).sum(0) / rows)
        return np.asarray(self.rms / np.maximum(size, np.finfo(float).tiny))

    def report(self) -> str:
        """A table of the errors, joint by joint.

        Returns
        -------
        str
            A line for each joint.
        """
        rows = [Row(f"motion {short(self.name)}", ("rms error [N m or N]", "relative [%]"), words=True)]
        for joint, rms, relative in zip(self.joint_names, self.rms, self.relative, strict=True):
            rows.append(Row(f"  {short(joint)}", (f"{rms:.4g}", f"{100 * relative:.1f}")))
        return "\n".join(aligned(rows))

    def plot(self) -> Figure:
        """Measured and predicted torque and their difference over time, and the difference over speed, by joint.

        Returns
        -------
        matplotlib.figure.Figure
            `figure.savefig("torques.png")` writes it to a file.
        """
        grid = panels(2 * self.measured.shape[1], f"Torques of {self.name}", 2, height=1.5)
        t, measured, predicted = without_gaps(self.t, self.measured, self.predicted)
        shown = {"measured": measured, "predicted": predicted, "residual": measured - predicted}
        for j, (ax, over_speed) in enumerate(zip(grid[::2], grid[1::2], strict=True)):
            for (label, values), (color, width) in zip(shown.items(), LOOK, strict=True):
                plot_columns(ax, t, values[:, [j]], [label if j == 0 else HIDDEN], [color], linewidth=width)
            style_axes(ax, f"[{self.units[j]}]")
            ax.set_title(literal(short(self.joint_names[j])), loc="left", fontsize="small", pad=2)
            valid = self.valid[:, j]
            residual = (self.measured - self.predicted)[valid, j]
            over_speed.plot(self.qd[valid, j], residual, ".", color=LOOK[2][0], markersize=2)
            style_axes(over_speed, "")
            unit = "rad/s" if self.units[j] == "N m" else "m/s"
            over_speed.set_title(f"residual over velocity [{unit}]", loc="left", fontsize="small", pad=2)
            over_speed.set_xlabel("")
        legend_beside(grid[0])
        figure = figure_of(grid)
        figure.align_ylabels(grid[::2])
        return figure


def without_gaps(t: Array, *columns: Array) -> list[Array]:
    """Times and columns with an undefined sample in each gap, so that no line crosses it."""
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > GAP * np.median(steps)) + 1 if len(steps) else np.zeros(0, int)
    return [np.insert(t, gaps, t[gaps - 1]), *(np.insert(column, gaps, np.nan, axis=0) for column in columns)]
