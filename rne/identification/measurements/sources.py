"""Where records come from: CSV files, simulations, measurements at the motors."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import convert_numbers, positive_number
from ...basics.spatial import Array
from ...trajectories.csv_file import read_samples
from .motor_side import motor_side

if TYPE_CHECKING:
    from ...simulation.trajectory import Trajectory

UNITS = {"rad": 1.0, "m": 1.0, "deg": np.pi / 180}


class RecordSources:
    """Base of `Record` with the functions that make one."""

    if TYPE_CHECKING:

        def __init__(
            self, t: ArrayLike, q: ArrayLike, tau: ArrayLike, qd: ArrayLike | None = None, **options: Any
        ) -> None: ...

    @classmethod
    def from_csv(cls, path: str | os.PathLike[str], joint_names: Sequence[str], **options: Any) -> Self:
        """Measurements in a CSV file.

        Parameters
        ----------
        path : path-like
            A text file in UTF-8. Its first row names the columns: `t`, `q.<joint>`, `tau.<joint>` and, if measured,
            `qd.<joint>`, in any order; others are ignored. Empty entries and `nan`, except of times, are missing
            values, which the findings name.
        joint_names : sequence of str
            The joints in the order of the arrays, such as `robot.joint_names`.
        **options
            Options of `Record`; `name` is the file's if not given.

        Returns
        -------
        Record
            The file's samples.

        Raises
        ------
        TypeError
            If `joint_names` is no sequence of str.
        ValueError
            If a column is missing, or a row is short or holds no numbers; names the file, row and column.
        OSError
            If the file cannot be read.

        Examples
        --------
        >>> import rne
        >>> record = rne.identification.Record.from_csv("log.csv", ["shoulder", "elbow"])  # doctest: +SKIP
        """
        samples = read_samples(path, joint_names, needed=("q", "tau"), gaps=True)
        given = {"name": Path(path).name, "joint_names": joint_names} | options
        return cls(samples.t, np.asarray(samples.q), np.asarray(samples.tau), samples.qd, **given)

    @classmethod
    def from_trajectory(cls, motion: Trajectory, sample_rate: float, **options: Any) -> Self:
        """A simulated motion at equal steps, as perfect drives would report it.

        Parameters
        ----------
        motion : Trajectory
            As `rne.simulate` returns it.
        sample_rate : float
            Samples per second [Hz].
        **options
            Options of `Record`.

        Returns
        -------
        Record
            Positions, rates and torques of the drives.

        Raises
        ------
        ValueError
            If `sample_rate` is not positive, or the motion has no samples.

        Examples
        --------
        >>> import rne
        >>> motion = rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 0.5)
        >>> rne.identification.Record.from_trajectory(motion, 100).q.shape
        (51, 6)
        """
        rate = positive_number("sample_rate", sample_rate)
        t = np.arange(int((motion.t[-1] - motion.t[0]) * rate + 1e-9) + 1) / rate + motion.t[0]
        q, qd, _ = motion(t)
        names = {} if motion.model is None else {"joint_names": motion.model.joint_names}
        return cls(t, q, motion.torques(t), qd, **(names | options))

    @classmethod
    def from_motors(
        cls,
        t: ArrayLike,
        motor_q: ArrayLike,
        motor_tau: ArrayLike,
        motor_qd: ArrayLike | None = None,
        *,
        ratios: ArrayLike,
        coupling: ArrayLike | None = None,
        drive_gains: ArrayLike | None = None,
        offsets: ArrayLike | None = None,
        unit: str = "rad",
        **options: Any,
    ) -> Self:
        """Measurements at the motors.

        Parameters
        ----------
        t : array_like, shape (T,)
            Times [s].
        motor_q : array_like, shape (T, n)
            Positions of the motors, in `unit`.
        motor_tau : array_like, shape (T, n)
            Torques of the motors [N m], or what is proportional to them by `drive_gains`, such as currents [A].
        motor_qd : array_like, shape (T, n), optional
            Rates of the motors, per second of `unit`.
        ratios : array_like, shape (n,)
            Turns of each motor per turn of its joint; negative if they turn against each other.
        coupling : array_like, shape (n, n), optional
            Joints that each motor turns with, the identity if not given: motor_q = K (q - offsets) with
            K = diag(ratios) coupling. A wrist whose joint 5 turns motor 6 as well has coupling[5, 4] = 1. The rotor and
            friction of such a motor act at the sum of the rates: to fit them, give its row of `coupling` as a row of
            `shafts` to `rne.identify`.
        drive_gains : array_like, shape (n,), optional
            Torque of the motor per unit of `motor_tau` [N m/A]; one if not given.
        offsets : array_like, shape (n,), optional
            Joint positions where the motors read zero [rad]; zero if not given.
        unit : {"rad", "deg"}
            Of the motors' positions.
        **options
            Other options of `Record`.

        Returns
        -------
        Record
            Of the joints: q = K^-1 motor_q + offsets, tau = K^T (drive_gains motor_tau), so that tau . qd is the power
            of the motors.

        Raises
        ------
        ValueError
            If an array has the wrong shape, a ratio or gain is zero, or `coupling` is singular.

        Examples
        --------
        >>> import numpy as np, rne
        >>> t = np.arange(100) / 100
        >>> motor_q, motor_tau = np.outer(np.sin(t), [50.0, 80.0]), np.outer(np.cos(t), [1.0, 2.0])
        >>> record = rne.identification.Record.from_motors(t, motor_q, motor_tau, ratios=[100, -80])
        >>> record.tau[0].tolist()
        [100.0, -160.0]
        """
        if unit not in ("rad", "deg"):
            raise ValueError(f'`unit` must be "rad" or "deg" for motors, got {unit!r}')
        positions = samples_array("motor_q", motor_q, None) * UNITS[unit]
        gears = motor_side(positions.shape[1], ratios, coupling, drive_gains, offsets)
        torques = samples_array("motor_tau", motor_tau, positions.shape)
        rates = None
        if motor_qd is not None:
            rates = gears.rates(samples_array("motor_qd", motor_qd, positions.shape) * UNITS[unit])
        return cls(t, gears.positions(positions), gears.torques(torques), rates, **options)


def samples_array(name: str, value: ArrayLike, shape: tuple[int, ...] | None) -> Array:
    """A float64 copy of shape (T, n), of any finite or other real numbers."""
    wanted = "(T, n)" if shape is None else str(shape)
    array = convert_numbers(name, value, wanted)
    if array.dtype.kind == "c":
        raise ValueError(f"`{name}` must be real, got dtype {array.dtype}")
    if array.ndim != 2 or 0 in array.shape or (shape is not None and array.shape != shape):
        raise ValueError(f"`{name}` must have shape {wanted}, got {array.shape}")
    return np.array(array, dtype=np.float64)
