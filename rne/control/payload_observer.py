"""A payload from positions, velocities and torques on a controller: recursive least squares without accelerations.

Torques are linear in the inertial parameters x of the payload, and so are its impulses between samples. After the
filter of the momentum observer r = H x, with the model's residuals r and the residuals H of a payload of unit
parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import per_joint_array, positive_number, real_array
from ..basics.docstrings import describe_parameters
from ..basics.inertia import PARAMETERS, UNITS, parameters_of_pseudo_inertia
from ..basics.spatial import Array, mirrored, transpose
from ..basics.text import six_digits
from ..elementwise import minimum
from ..model.topology import end_link
from ..robot import Robot, robot_argument
from .impulses import Bodies
from .laws import STATES
from .momentum_observer import MomentumObserver
from .observer_law import Observing, States, no_torques, remembered
from .traced_law import check_law

NAMES = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
SAME = 1e-9  # tolerance of equal angles, and of distances relative to the robot's size


@describe_parameters(STATES)
@dataclass(frozen=True, eq=False)
class PayloadObserver(Observing):
    """A control law that estimates a payload, made by `payload_observer`; attributes are its arguments.

    Its `observer` is the model's; `earlier` commands are remembered, as torques act late. The states hold what was
    known after the call that returned them.

    Examples
    --------
    >>> import numpy as np, rne
    >>> arm = rne.load("irb140")
    >>> law = rne.control.payload_observer(arm, sample_time=1e-3)
    >>> motion, z = rne.trajectories.quintic([0] * 6, [1, 0.5, -0.5, 1, 1, 1], 0.3), np.zeros(law.states)
    >>> for t in np.arange(0, 0.3, 1e-3):
    ...     q, qd, _ = motion(t)
    ...     _, z = law(t, q, qd, z)
    ...     z[law.places["torques"]] = arm.with_payload(3.0).inverse_dynamics(*motion(t + 5e-4))
    >>> law.payload(z)[0].round(1).item(), law.standard_deviations(z)[0].round(1).item(), law.parameters(z).shape
    (3.0, 0.1, (10,))
    """

    link: str
    forgetting: float
    noise: Array
    prior: tuple[float, float]

    @cached_property
    def _scales(self) -> Array:
        """Standard deviations of the ten parameters before any sample."""
        mass, distance = self.prior
        return np.repeat([mass, mass * distance, mass * distance**2], [1, 3, 6])

    @cached_property
    def _parameters(self) -> Array:
        """Inertial parameters of all bodies per unit of each of a payload's in the link's frame, (10, 10 nb)."""
        model = self.robot.model
        k = model.link_index(self.link)
        body, pose = model.link_body[k], np.eye(4)
        pose[:3, :3], pose[:3, 3] = model.link_rotation[k], model.link_translation[k] - model.joint_origin[body]
        found = np.zeros((PARAMETERS, PARAMETERS * model.nb))
        own = parameters_of_pseudo_inertia(pose @ UNITS @ pose.T).reshape(PARAMETERS, PARAMETERS)
        found[:, PARAMETERS * body : PARAMETERS * (body + 1)] = own
        return found

    @cached_property
    def _combinations(self) -> tuple[list[int], Array]:
        """Places of the kept parameters, and the matrix (count, 10) of what torques depend on."""
        from ..dynamics.base_inertial_parameters import ROUNDING, independent_columns, span

        acting = self.robot.base_parameters(tolerance=SAME).matrix @ self._parameters.T
        rows = span(acting * self._scales, SAME)
        kept = independent_columns(rows)
        matrix = np.linalg.solve(rows[:, kept], rows) * self._scales[kept, None] / self._scales
        matrix[np.abs(matrix) < ROUNDING] = 0.0
        return kept, np.asarray(matrix)

    @property
    def names(self) -> tuple[str, ...]:
        """Kept parameter of each estimate, in the link's frame and about its origin."""
        return tuple(NAMES[k] for k in self._combinations[0])

    @property
    def formulas(self) -> tuple[str, ...]:
        """Formula of each estimate: the kept parameter plus multiples of those with the same effect on torques."""
        rows = [[(factor, k) for k, factor in enumerate(row) if factor] for row in self._combinations[1]]
        kept = self._combinations[0]
        return tuple(
            NAMES[own]
            + "".join(f" {'+' if x > 0 else '-'} {six_digits(abs(x))} {NAMES[k]}" for x, k in row if k != own)
            for own, row in zip(kept, rows, strict=True)
        )

    @property
    def unknown(self) -> tuple[str, ...]:
        """Parameters of the payload that no motion determines, except in sums with others."""
        return tuple(name for name in NAMES if name not in self.formulas)

    @cached_property
    def _bodies(self) -> Bodies:
        """Model, and payloads of one standard deviation of each estimate, without the rotors."""
        bare = self.robot.with_model(replace(self.robot.model, armature=np.zeros(self.robot.model.nb)))
        kept = self._combinations[0]
        units = self._scales[kept, None] * self._parameters[kept]
        return ((self.robot, None), *((bare, pi) for pi in units))

    @property
    def _own_sizes(self) -> dict[str, int]:
        count = len(self._combinations[0])
        upper = count * (count + 1) // 2
        return {"information": upper, "moments": count, "estimates": count, "variances": count}

    def _lacking(self, momentum: Array, drives: Array) -> Array:
        return np.concatenate([drives[..., None, :] - momentum[..., :1, :], momentum[..., 1:, :]], axis=-2)

    def _learned(self, old: States, filtered: Array, bounds: Array) -> States:
        """Least squares of r = H x with weights forgetting^age, and the prior, which is not forgotten."""
        r, H = filtered[..., 0, :, None], filtered[..., 1:, :]
        # values filtered with the time constant 1 / gain are independent after about two time constants
        weights = minimum(1.0, self.observer.gain * self.sample_time / 2) / self.noise**2
        count, scales = H.shape[-2], self._scales[self._combinations[0]]
        upper = np.triu_indices(count)
        now = (H * weights) @ transpose(H)
        information = self.forgetting * old["information"] + now[..., upper[0], upper[1]]
        moments = self.forgetting * old["moments"] + ((H * weights) @ r)[..., 0]
        A = 0 * now
        A[..., upper[0], upper[1]] = information
        inverse = _inverse(mirrored(A) + np.eye(count))
        variances = inverse[..., range(count), range(count)] * scales**2
        estimates = (inverse @ moments[..., None])[..., 0] * scales
        return {"information": information, "moments": moments, "estimates": estimates, "variances": variances}

    def parameters(self, z: ArrayLike) -> Array:
        """Estimates of the identifiable combinations of inertial parameters.

        Returns
        -------
        ndarray, shape (..., count)
            In the order of `names` [kg, kg m, kg m^2].
        """
        return self._read(z, "estimates")

    def standard_deviations(self, z: ArrayLike) -> Array:
        """Standard deviations of the estimates, by `noise` and the motion up to now.

        Returns
        -------
        ndarray, shape (..., count)
            In the order of `names` [kg, kg m, kg m^2]; the prior's before the first sample.
        """
        started = self._read(z, "started") > 0
        return np.where(started, np.sqrt(self._read(z, "variances")), self._scales[self._combinations[0]])

    def payload(self, z: ArrayLike) -> tuple[Array, Array]:
        """Mass and centre of mass of the payload; nan where no motion determines them.

        Returns
        -------
        mass : ndarray, shape (...)
            Beyond the model [kg].
        com : ndarray, shape (..., 3)
            In the link's frame; nan while the mass is not positive [m].
        """
        estimates, unknown = self.parameters(z), self.unknown
        m, *moments = (
            estimates[..., 0] * np.nan if k in unknown else estimates[..., self.names.index(k)] for k in NAMES[:4]
        )
        return m, np.stack(moments, axis=-1) / np.where(m > 0, m, np.nan)[..., None]


def _inverse(A: Array) -> Array:
    """Inverse of positive definite matrices, which may be traced, by sweeps (Goodnight 1979)."""
    for k in range(A.shape[-1]):
        inverse = 1.0 / A[..., k, k, None]
        scaled = A[..., k, :] * inverse
        left = A - A[..., :, k, None] * scaled[..., None, :]
        left[..., k, :] = left[..., :, k] = scaled
        left[..., k, k, None] = -inverse
        A = mirrored(left)
    return -A


def payload_observer(
    robot: Robot,
    link: str | None = None,
    *,
    law: Callable[..., Any] | None = None,
    sample_time: float,
    delay: float = 0.0,
    effort_limit: ArrayLike | None = None,
    friction: Any = None,
    gain: float = 50.0,
    forgetting: float = 0.999,
    noise: ArrayLike = 1.0,
    prior: tuple[float, float] = (10.0, 0.3),
) -> PayloadObserver:
    """A discrete control law that estimates a payload from sample to sample, by recursive least squares.

    Parameters
    ----------
    robot : Robot
        The model without the payload.
    link : str, optional
        The link that carries it, in whose frame it is estimated; the last link if not given.
    law : callable, optional
        The law whose torques are given, f(t, q, qd), or f(t, q, qd, z) with `states`. If not given, torques are zero:
        write those that act into the entries ``places["torques"]`` of z before each call.
    sample_time, delay : float
        From call to call, and from a call until its torques act [s].
    effort_limit : float or array_like, shape (n,), optional
        The drives' limits, to which the torques are clipped [N m or N].
    friction : Friction, optional
        Friction of the model.
    gain : float
        Bandwidth of the filter of torques and regressor [1/s].
    forgetting : float
        Factor of the weights from sample to sample: about 1 / (1 - forgetting) samples count; 1 for all.
    noise : float or array_like, shape (n,)
        Standard deviation of the filtered torques' errors, including the model's [N m or N].
    prior : tuple of float
        Standard deviation of the mass before any sample [kg], and the distance from the link's origin within which it
        is expected [m]. It is not forgotten: without excitation estimates return to zero, and do not drift.

    Returns
    -------
    PayloadObserver
        A law f(t, q, qd, z) -> (torques, z of the next sample), with methods that read z.

    Raises
    ------
    TypeError
        If `law` is no function of (t, q, qd).
    ValueError
        If the link is not given and ambiguous, does not exist or does not move, or a number is out of its range.

    Notes
    -----
    Ljung 1999, section 11.2, in the form of the information matrix: R = sum of forgetting^age H^T W H, and estimates
    (R + P0^-1)^-1 (sum of forgetting^age H^T W r). The regressor H has the impulses between samples by Simpson's rule,
    after the bilinear filter of `MomentumObserver`. Where torques depend on fewer than ten combinations of the
    payload's parameters, these are estimated: see `PayloadObserver.formulas`.

    Examples
    --------
    >>> import rne
    >>> law = rne.control.payload_observer(rne.load("irb140"), sample_time=1e-3)
    >>> law.names[:4], law.formulas[0], law.unknown  # some motions determine all ten parameters
    (('m', 'mcx', 'mcy', 'mcz'), 'm', ())
    """
    name = end_link(robot_argument(robot).model, axes_count=True) if link is None else link
    if robot.model.link_body[robot.model.link_index(name)] < 0:
        raise ValueError(f"`link` {name!r} does not move")
    if law is not None:
        check_law("law", law)
    share = positive_number("forgetting", forgetting)
    if share > 1:
        raise ValueError(f"`forgetting` must be at most 1, got {share}")
    mass, distance = (positive_number("prior", x) for x in real_array("prior", prior, "(2,)"))
    how = remembered(robot, sample_time, delay, effort_limit)
    errors = per_joint_array("noise", noise, robot.n, sign="positive")
    observer = MomentumObserver(robot, gain, friction)
    return PayloadObserver(observer, law or no_torques, *how, name, share, errors, (mass, distance))
