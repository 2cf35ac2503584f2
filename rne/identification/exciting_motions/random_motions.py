"""Random Fourier series within limits: starts of an optimiser, and what its result is compared with."""

from __future__ import annotations

import numpy as np

from ...basics.spatial import Array
from .series_limits import FINE, ROUNDING, SeriesLimits

SHRINK = 0.85  # of a random motion whose torques are too large
POSES = 2000  # random ones, if the middle of the ranges cannot be held
HELD = 0.9  # share of the efforts at rest that leaves some for motion


def random_series(within: SeriesLimits, count: int, rng: np.random.Generator) -> Array:
    """Random series x that touch some limit of each joint, less where torques are limited, shape (count, size).

    Raises
    ------
    ValueError
        If no pose can be held within the torque limits.
    """
    n = within.robot.n
    anchor = rest_pose(within, rng)
    x = rng.normal(size=(count, n, within.size // n))
    A = np.concatenate(list(within.linear(FINE * within.basis.harmonics).values()), axis=1)
    x = (x / (1 + ROUNDING) / np.abs(np.einsum("jti,cji->cjt", A, x)).max(-1)[..., None]).reshape(count, -1)
    too_large = within.torque_use(x).max(-1) > 1
    while too_large.any():
        x[too_large] = anchor + SHRINK * (x[too_large] - anchor)
        too_large = within.torque_use(x).max(-1) > 1
    return np.asarray(x)


def rest_pose(within: SeriesLimits, rng: np.random.Generator) -> Array:
    """The series that rests in mid-range, or in a random pose if the drives cannot hold that one."""
    robot, limits = within.robot, within.limits
    poses = limits.centre + limits.half_range * rng.uniform(-0.9, 0.9, (POSES, robot.n))
    poses[0] = limits.centre
    use = within.torque_shares((poses, np.zeros_like(poses), np.zeros_like(poses)))
    k = 0 if use[0].max() <= HELD else int(use.max(-1).argmin())
    if use[k].max() > HELD:
        j = int(use[k].argmax())
        raise ValueError(
            f"`limits`: no pose is held with {HELD:.0%} of the efforts; the best of {POSES} takes {use[k, j]:.1e} "
            f"times effort_limit of joint {robot.joint_names[j]!r}"
        )
    coefficients = np.zeros((robot.n, within.free.shape[0]))
    coefficients[:, 0] = (poses[k] - limits.centre) / limits.velocity_limit
    anchor: Array = (coefficients @ within.free).ravel()
    return anchor
