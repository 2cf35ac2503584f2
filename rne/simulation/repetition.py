"""Error of a simulation by repetition: the same scene with tighter tolerances, for motions that switch.

The variational equation knows nothing of a torque that jumps where the state crosses a surface, of a joint that sticks,
or of a held torque that was computed from a wrong state: there an error changes the instants and sides of switching.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..basics.spatial import Array
from .run import Run, Task

FINER = 100.0  # times smaller tolerances
FINEST = 2.3e-14  # relative tolerance that SciPy's solvers take
MARGIN = 1.25  # the repetition has an error too


def repeated_error(repeat: Callable[[Task], Run], n: int, task: Task, run: Run) -> tuple[Array, Array]:
    """The reported times and the largest difference of a position until then from a run with finer tolerances.

    Where the tolerances are at rounding already, they are coarser, and the difference is an upper bound.

    Parameters
    ----------
    repeat : callable
        Runs a task of the same scene.
    n : int
        Number of positions.
    task : Task
    run : Run
        The result of the task.
    """
    factor = 1 / FINER if task.rtol / FINER >= FINEST else FINER
    other = task._replace(
        rtol=task.rtol * factor, atol=task.atol * factor, t_eval=run.t, method=run.method, is_auto=False
    )
    again = repeat(other)
    count = min(len(run.t), len(again.t))  # a stop may have come earlier
    difference = np.abs(run.x[:count, :n] - again.x[:count, :n]).max(axis=1, initial=0.0)
    return run.t[:count], MARGIN * np.maximum.accumulate(difference)
