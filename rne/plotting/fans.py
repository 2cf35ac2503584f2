"""How the motions of an Ensemble spread over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_array
from ..simulation.ensembles import Ensemble
from .figures import blank_figure, check_axes, dress, figure_of, literal
from .plots import QUANTITIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH, HEIGHT = 3.2, 2.1  # of a panel [inch]
PALE, DARK = 0.18, 0.5  # opacity of the outermost and of the innermost band


def fan(
    ensemble: Ensemble,
    joints: Sequence[str] | None = None,
    probabilities: ArrayLike = (0.05, 0.25, 0.5, 0.75, 0.95),
    of: str = "q",
    *,
    axes: Any = None,
) -> Any:
    """Bands between quantiles of an ensemble over time, one panel for each joint.

    Parameters
    ----------
    ensemble : Ensemble
        With enough stored times: `keep` of `rne.ensemble`.
    joints : sequence of str, optional
        Names of the joints to show; by default all.
    probabilities : array_like, shape (P,)
        Of the quantiles, rising, from 0 to 1. Each one and its opposite number bound a band: the first and the last,
        the second and the last but one, and so on; of an odd number the one in the middle is a line.
    of : {"q", "qd", "tau"}
        Positions, rates or torques.
    axes : matplotlib axes or sequence of them, optional
        Where to draw, one for each joint; by default a new figure.

    Returns
    -------
    matplotlib.figure.Figure
        One panel for each joint; `figure.savefig("fan.png")` writes it to a file.

    Raises
    ------
    TypeError
        If `ensemble` is no Ensemble, or `axes` are no axes.
    ValueError
        If a joint is unknown, the probabilities are not rising numbers from 0 to 1, or there are no motions.
    ImportError
        If matplotlib is not installed.

    Notes
    -----
    Quantiles are known at the stored times only, and joined by straight lines. They are quantiles of each joint alone:
    no single motion need follow any of them.

    Examples
    --------
    >>> import numpy as np, rne
    >>> starts = np.random.default_rng(0).uniform(-0.1, 0.1, (50, 6))
    >>> swings = rne.ensemble(rne.load("irb140"), starts, 0 * starts, 0.2, step=2e-3, keep=11)
    >>> [ax.get_ylabel() for ax in rne.plotting.fan(swings, ["joint_2", "joint_3"]).axes]
    ['position [rad]', 'position [rad]']
    """
    if not isinstance(ensemble, Ensemble):
        raise TypeError(f"`ensemble` must be an rne.Ensemble, got {type(ensemble).__name__}")
    names = ensemble.model.joint_names
    chosen = _chosen(names, joints)
    levels = real_array("probabilities", probabilities, "(P,)")
    if levels.ndim != 1 or not len(levels) or (np.diff(levels) <= 0).any():
        raise ValueError(
            f"`probabilities` must be rising numbers from 0 to 1, got {np.asarray(probabilities).tolist()}"
        )
    values = ensemble.quantiles(levels, of)
    labels = [names[k] for k in chosen]
    where = _grid(len(chosen)) if axes is None else check_axes(axes, labels)
    for ax, k in zip(where, chosen, strict=True):
        _bands(ax, ensemble.t, values[..., k], levels)
        sliding = not ensemble.model.is_revolute[ensemble.model.independent_joints[k]]
        name, unit = QUANTITIES[of][sliding]
        dress(ax, f"{name} [{unit}]")
        ax.set_title(literal(names[k]), fontsize="medium")
    figure = figure_of(where)
    if axes is None:
        _finish(figure, where, literal(f"{ensemble.q.shape[1]} motions of {ensemble.model.name}"))
    return figure


def _chosen(names: Sequence[str], joints: Sequence[str] | None) -> list[int]:
    if joints is None:
        joints = names
    elif isinstance(joints, str):
        raise TypeError("`joints` must be a sequence of str, got str")
    for joint in joints:
        if joint not in names:
            raise ValueError(f"`joints` must be from {list(names)}, got {joint!r}")
    if not len(joints):
        raise ValueError("`joints` must name at least one joint, got none")
    return [list(names).index(joint) for joint in joints]


def _bands(ax: Axes, t: Any, values: Any, levels: Any) -> None:
    """The bands of one joint, the outermost first; values of shape (P, S)."""
    pairs = len(levels) // 2
    for k, shade in enumerate(np.linspace(PALE, DARK, pairs)):
        low, high = levels[k], levels[-1 - k]
        label = f"{100 * low:.4g} to {100 * high:.4g} %"
        ax.fill_between(t, values[k], values[-1 - k], color="C0", alpha=shade, linewidth=0, label=label)
    if len(levels) % 2:
        ax.plot(t, values[pairs], color="C0", linewidth=1.4, label=f"{100 * levels[pairs]:.4g} %")


def _grid(count: int) -> list[Axes]:
    """Panels of a new figure, up to three in a row, which share the time axis."""
    columns = min(count, 3)
    rows = -(-count // columns)
    figure = blank_figure(max(WIDTH * columns, 4.2), HEIGHT * rows + 0.7)
    return [figure.add_subplot(rows, columns, k + 1) for k in range(count)]


def _finish(figure: Any, axes: Sequence[Axes], title: str) -> None:
    figure.suptitle(title)
    for ax in axes[-3:]:
        ax.set_xlabel("time [s]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4), frameon=False)
