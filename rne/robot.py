"""Robot: a model with each quantity as a method."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from . import dynamics
from . import model as models
from .basics.arrays import number_array, positive_number, real_array, whole_number
from .basics.docstrings import describe_parameters
from .basics.spatial import Array, cross, rotate_back
from .basics.text import InNotebooks, brief_array, counted, short
from .dynamics.kinematics import ORIGIN
from .dynamics.precision import Diagnosis
from .dynamics.quantity import Declared
from .dynamics.rnea import External
from .dynamics.task_space import BASE_AXES, LINK_AXES, ROWS, in_link_axes
from .model.model import Model
from .model.parameters import parameters_of, with_parameters

if TYPE_CHECKING:
    from .bounds import Bounds
    from .dynamics.base_inertial_parameters import BaseParameters
    from .dynamics.recursion_record import Recursion
    from .kernels.kernel import Kernel
    from .model.modify import LimitValues
    from .model.standard_parameters import DriveModel

# compiled by Robot.compile without arguments, with forward dynamics
COMPILED = (dynamics.inverse_dynamics, dynamics.mass_matrix, dynamics.bias_torque, dynamics.gravity_torque)

# Arguments that several methods of Robot have; they are added to the methods' docstrings, which describe others only.
ARGUMENTS = """
q : array_like, shape (..., n)
    Joint positions [rad or m].
qd : array_like, shape (..., n)
    Joint velocities [rad/s or m/s].
qdd : array_like, shape (..., n)
    Joint accelerations [rad/s^2 or m/s^2].
tau : array_like, shape (..., n)
    Joint torques [N m or N].
link : str
    One of `link_names`.
point : array_like, shape (3,)
    In the link's frame; by default its origin [m].
rows : {"xyz", "rotation"} or sequence of int, optional
    Rows of the Jacobian: the three translations, the three rotations, or by numbers 0 to 5, rotations first. All six by
    default, which arms of fewer joints do not have.
damping : float
    Added to J M^-1 J^T, in units of its diagonal: near singular poses, where no torque accelerates the point in some
    direction, Lambda then stays below 1/damping times the inertia of each single row.
axes : {"base", "link"}
    Axes of the rows: the root link's or the link's own.
external : mapping of str to array_like, shape (..., 6), optional
    Wrenches [moment; force] that act on links, by the link's name [N m, N]: at its origin, in its own axes, not those
    of the root link. `rne.wrench` makes them from forces at other points and in the root link's axes.
parameters : array_like, shape (..., 10 nb), optional
    Inertial parameters instead of the robot's own, in the order of `Robot.parameters`. They broadcast against the
    states: many variants of the robot are one batch.
"""


@describe_parameters(ARGUMENTS)
class Robot(InNotebooks):
    """A robot: its torques, accelerations, mass matrix, energies and their derivatives are methods.

    Arrays of joint values have shape (..., n): leading axes are independent states. All quantities are in SI units,
    angles in radians. The first call of a method for a single state runs the recursion; later calls and batches run its
    kernel, traced for this robot (see `compile`). A ValueError names an array that has the wrong shape or is not
    finite, or a link or option that does not exist, a NotFiniteError a result that overflows; methods list what else
    they raise.

    Parameters
    ----------
    model : Model
        Its parameters, from `rne.read_urdf`, `rne.dh_chain`, `rne.model.chain` or `rne.irb140`; `rne.load` makes both.
    engine : {"numpy", "numba"}
        The engine of its kernels: NumPy, or machine code by Numba, which takes about a second to compile at first use.
        Robots and scenes derived from it keep the engine.

    Raises
    ------
    TypeError
        If `model` is not a Model.
    ValueError
        If there is no such engine.
    ImportError
        If the engine's package is not installed.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> robot.n, robot.joint_names[0], robot.link_names[-1]
    (6, 'joint_1', 'tool0')
    >>> robot.gravity_torque([0] * 6).round(2)[[1, 2, 4]].tolist()  # what holds joints 2, 3 and 5 [N m]
    [-23.63, -23.63, -0.28]
    """

    def __init__(self, model: Model, engine: str = "numpy") -> None:
        if not isinstance(model, Model):
            raise TypeError(f"`model` must be an rne.Model, got {type(model).__name__}")
        from .kernels.cache import KernelCache  # loaded with the first robot

        self._model = model
        self.kernels = KernelCache(model, engine)

    @property
    def model(self) -> Model:
        """The robot's parameters: a frozen record of masses, centres of mass, inertias, axes and placements."""
        return self._model

    @property
    def engine(self) -> str:
        """The engine that runs its kernels: "numpy" or "numba"."""
        return self.kernels.engine

    @property
    def n(self) -> int:
        """Number of joint coordinates: moving joints, without those that mimic others."""
        return self._model.n

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints in the order of q."""
        return self._model.joint_names

    @property
    def link_names(self) -> tuple[str, ...]:
        """The links in the order of `link_poses`, the root first."""
        return self._model.link_names

    @property
    def lower(self) -> Array:
        """Lower ends of the ranges of joints and their mimics, -inf where unknown, shape (n,) [rad or m]."""
        return self._model.coordinate_limits()["lower"]

    @property
    def upper(self) -> Array:
        """Upper ends of the ranges of joints and their mimics, inf where unknown, shape (n,) [rad or m]."""
        return self._model.coordinate_limits()["upper"]

    @property
    def velocity_limit(self) -> Array:
        """Largest velocities of the joints and their mimics, inf where unknown, shape (n,) [rad/s or m/s]."""
        return self._model.coordinate_limits()["velocity_limit"]

    @property
    def effort_limit(self) -> Array:
        """Largest torques of the drives, inf where unknown, shape (n,) [N m or N]."""
        return self._model.coordinate_limits()["effort_limit"]

    @property
    def acceleration_limit(self) -> Array:
        """Largest accelerations of the joints and their mimics, inf where unknown, shape (n,) [rad/s^2 or m/s^2]."""
        return self._model.coordinate_limits()["acceleration_limit"]

    @property
    def deceleration_limit(self) -> Array:
        """Largest accelerations against the direction of motion; `acceleration_limit` where not given, shape (n,)."""
        return self._model.coordinate_limits()["deceleration_limit"]

    @property
    def jerk_limit(self) -> Array:
        """Largest jerks of the joints and their mimics, inf where unknown, shape (n,) [rad/s^3 or m/s^3]."""
        return self._model.coordinate_limits()["jerk_limit"]

    def __reduce__(self) -> tuple[Any, ...]:
        return Robot, (self._model, self.engine)

    def __copy__(self) -> Robot:
        return self  # neither model nor kernels ever change

    def __deepcopy__(self, _: Any) -> Robot:
        return self

    def with_model(self, model: Model) -> Robot:
        """Robot with a model derived from this one's; of equal models it has the same kernels."""
        if model is self._model:
            return self
        variant = object.__new__(Robot)
        variant.kernels = self.kernels.variant(model)
        variant._model = model
        return variant

    def __repr__(self) -> str:
        model = self._model
        lines = [
            f"Robot '{short(model.name)}': {counted(model.n, 'joint')}, {counted(len(model.link_names), 'link')}, "
            f"{model.mass.sum():.6g} kg moving, gravity {model.gravity.tolist()} m/s^2"
        ]
        if model.has_mimics:
            further = model.nb - model.n
            verb = "follow" if model.couplings else "mimic"
            lines.append(f"  {counted(further, 'further joint')} {verb}{'s' * (further == 1)} these")
        if model.armature.any():
            lines.append(f"  rotors: armature {brief_array(model.armature)}, part of M")
        if model.damping.any() or model.friction.any():
            lines.append("  damping and friction of its <dynamics> are on record, not applied")
        return "\n".join(lines)

    def joint_order(self, library: str) -> Array:
        """Indices that bring joint arrays into another library's order.

        Parameters
        ----------
        library : {"pinocchio"}
            Pinocchio visits the tree depth first, siblings in alphabetical order of their joints' names. Here the next
            joint is always the first one in the file whose parent link has been placed.

        Returns
        -------
        ndarray of int, shape (n,)
            `q[..., order]` is in that library's order, and `q_other[..., np.argsort(order)]` is in this one's.
            Joints that mimic others are not coordinates here, but they are in Pinocchio by default.

        Raises
        ------
        ValueError
            If `library` is another one.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").joint_order("pinocchio").tolist()
        [0, 1, 2, 3, 4, 5]
        """
        if library != "pinocchio":
            raise ValueError(f"`library` must be 'pinocchio', got {library!r}")
        from .model.topology import pinocchio_order

        return pinocchio_order(self._model)

    def compile(self, *functions: Declared) -> None:
        """Trace quantities now, instead of at the second call or the first batch.

        Parameters
        ----------
        *functions : callable
            Functions of a model and joint arrays, such as `rne.dynamics.mass_matrix`. Without any: inverse dynamics,
            M, bias and gravity torques, and forward dynamics.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> robot.compile(rne.dynamics.mass_matrix)
        >>> robot.mass_matrix([0] * 6).diagonal().round(3).tolist()  # already by the kernel
        [2.36, 5.753, 1.134, 0.112, 0.002, 0.001]
        """
        for function in functions or COMPILED:
            self.kernel(function)
        if not functions:
            self.kernels.forward_kernel()

    def kernel(self, function: Declared, *wrt: str, order: str | None = None, **fixed: Any) -> Kernel:
        """Kernel of a function traced on this robot, on first use, and kept.

        Parameters
        ----------
        function : callable
            One of this package's functions of a model, such as `rne.dynamics.mass_matrix`.
        *wrt : str
            Arguments with respect to which it is differentiated; none for the function itself.
        order : {"gradient", "hessian", "hessian_product"}, optional
            Derivatives of a weighted sum of the function's entries, with respect to all arguments if `wrt` has none;
            see `rne.kernels.gradient`.
        **fixed
            Arguments other than joint arrays, such as `link="link_6"`, or `external=["link_6"]` for its wrench, or
            `parameters=True` for the inertial parameters as a further argument.

        Returns
        -------
        Kernel
            Called with the joint arrays, it returns the function, as `rne.compile` gives it, or its exact derivatives,
            as `rne.kernels.derivative` gives them.

        Raises
        ------
        TypeError
            If the function is not one of this package's, or has no such argument.
        ValueError
            If there is no such link or order.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> derivative = robot.kernel(rne.dynamics.gravity_torque, "q")([0] * 6)
        >>> derivative[1, 1].round(2).item()  # [N m/rad]
        -135.2
        """
        if "engine" in fixed:
            raise TypeError("`engine` is the robot's: give it to rne.load or rne.Robot, or to rne.compile")
        return self.kernels.kernel(function, *wrt, order=order, **fixed)

    def inverse_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        *,
        external: External | None = None,
        parameters: ArrayLike | None = None,
    ) -> Array:
        """Joint torques for given accelerations: tau = M qdd + C qd + g.

        Recursive Newton-Euler algorithm: Høifødt 2011, (3.24)-(3.38). External wrenches reduce the torques by what they
        supply.

        Returns
        -------
        ndarray, shape (..., n)
            Torques of revolute joints, forces of prismatic ones [N m or N].

        Notes
        -----
        Torques are linear in `parameters`, so that any finite numbers will do: base parameters that were identified
        give the torques of the arm, with masses that may be negative. `with_parameters` refuses numbers that no bodies
        have.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot = rne.load("irb140")
        >>> robot.inverse_dynamics([0] * 6, [0] * 6, [0, 0, 1, 0, 0, 0]).round(3)[2].item()
        -22.499
        >>> pull = {"link_6": [0, 0, 0, 0, 0, -10.0]}  # 10 N along -z of link 6
        >>> robot.inverse_dynamics([0] * 6, [0] * 6, [0] * 6, external=pull).round(2)[1].item()  # -23.63 without
        -20.03
        >>> scales = np.random.default_rng(0).uniform(0.9, 1.1, (5000, 1))  # all masses up to 10 % off
        >>> tau = robot.inverse_dynamics([0] * 6, [0] * 6, [0] * 6, parameters=scales * robot.parameters)
        >>> tau.shape, tau[:, 1].min().round(1).item(), tau[:, 1].max().round(1).item()
        ((5000, 6), -26.0, -21.3)
        """
        return self.kernels.evaluate_quantity(
            dynamics.inverse_dynamics, q, qd, qdd, external=external, parameters=parameters
        )

    def forward_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        tau: ArrayLike,
        *,
        external: External | None = None,
        parameters: ArrayLike | None = None,
    ) -> Array:
        """Joint accelerations that the torques tau give: qdd = M^-1 (tau - C qd - g).

        By M = L^T D L, Featherstone 2008, section 6.5, or for many joints by articulated bodies, table 7.1.

        Returns
        -------
        ndarray, shape (..., n)
            Accelerations [rad/s^2 or m/s^2].

        Raises
        ------
        SingularMassMatrixError
            If M is singular to working precision, or not positive definite for these `parameters`; its `joints` are
            those whose combined motion moves no inertia.

        Warns
        -----
        PrecisionWarning
            If fewer than 3 digits are left, M nearly singular or the torques cancelled at high joint velocities.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> tau = robot.inverse_dynamics([0.1] * 6, [0] * 6, [1] * 6)
        >>> robot.forward_dynamics([0.1] * 6, [0] * 6, tau).round(9).tolist()
        [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
        """
        qdd, status = self.kernels.forward_dynamics(q, qd, tau, external, parameters)
        status.raise_or_warn(stacklevel=2)
        return qdd

    def mass_matrix(self, q: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Joint-space inertia matrix M(q): column j is the torques for a unit acceleration of joint j.

        Composite-rigid-body algorithm: Featherstone 2008, table 6.2.

        Returns
        -------
        ndarray, shape (..., n, n)
            Full and exactly symmetric, the rotors' `armature` included [kg m^2, kg m or kg].

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").mass_matrix([0] * 6)[5, 5].round(6).item()
        0.001458
        """
        return self.kernels.evaluate_quantity(dynamics.mass_matrix, q, parameters=parameters)

    def recursion(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, external: External | None = None) -> Recursion:
        """Inverse dynamics with all intermediate vectors of every link.

        Høifødt 2011, (3.24)-(3.38) and (5.33).

        Returns
        -------
        Recursion
            Angular velocities and accelerations, accelerations, forces and moments of every link, in its own axes;
            for one state, `print` shows them as a table with units and the thesis's equation numbers.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").recursion([0] * 6, [1, 0, 0, 0, 0, 0], [0] * 6).omega[0].tolist()
        [0.0, -1.0, 0.0]
        """
        record: Recursion = dynamics.recursion.evaluate(self._model, q, qd, qdd, external=external)[0]
        return record

    def diagnose(
        self, q: ArrayLike, qd: ArrayLike | None = None, tau: ArrayLike | None = None, *, dtype: DTypeLike | None = None
    ) -> Diagnosis:
        """Digits that forward dynamics keep in given states, and the motion that limits them.

        A singular M is not an error here: its condition number is infinite and its digits are 0.

        Parameters
        ----------
        qd, tau : array_like, shape (..., n), optional
            Joint velocities and torques, both or neither [rad/s or m/s; N m or N].
        dtype : real floating data type, optional
            The arithmetic to diagnose for; by default the type of `q`.

        Returns
        -------
        Diagnosis
            Condition of M scaled to unit diagonal, digits left, and the joints whose motion limits them.

        Raises
        ------
        ValueError
            If an array is not real, `dtype` is not real floating point, or only one of `qd` and `tau` is given.

        Examples
        --------
        >>> import rne
        >>> print(rne.load("irb140").diagnose([0] * 6).digits.round())
        15.0
        """
        return dynamics.diagnose(self._model, q, qd, tau, dtype=dtype)

    def bias_torque(
        self, q: ArrayLike, qd: ArrayLike, *, external: External | None = None, parameters: ArrayLike | None = None
    ) -> Array:
        """Joint torques at zero acceleration: C qd + g, less the torques that external wrenches supply.

        Inverse dynamics at qdd = 0: Høifødt 2011, appendix B.

        Returns
        -------
        ndarray, shape (..., n)
            Torques [N m or N].

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> robot.bias_torque([0] * 6, [1, 0, 0, 0, 0, 0]).round(2)[1].item()  # -23.63 of it is gravity
        -25.46
        """
        return self.kernels.evaluate_quantity(dynamics.bias_torque, q, qd, external=external, parameters=parameters)

    def gravity_torque(self, q: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Joint torques g(q) that balance gravity at rest.

        Inverse dynamics at qd = qdd = 0: Høifødt 2011, (3.1).

        Returns
        -------
        ndarray, shape (..., n)
            Torques [N m or N]; the gradient of the potential energy.

        Examples
        --------
        >>> import math, rne
        >>> rne.load("irb140").gravity_torque([0, math.pi / 2, -math.pi / 2, 0, 0, 0]).round(3)[[1, 2, 4]].tolist()
        [-158.834, -23.632, -0.284]
        """
        return self.kernels.evaluate_quantity(dynamics.gravity_torque, q, parameters=parameters)

    def coriolis_torque(self, q: ArrayLike, qd: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Centrifugal and Coriolis joint torques C(q, qd) qd.

        Inverse dynamics at qdd = 0 without gravity: Høifødt 2011, (3.1).

        Returns
        -------
        ndarray, shape (..., n)
            Torques [N m or N]; quadratic in the velocities.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, qd = rne.load("irb140"), np.array([1.0, 0, 0, 0, 0, 0])
        >>> [robot.coriolis_torque([0] * 6, k * qd).round(2)[1].item() for k in (1, 2)]  # twice as fast: four times
        [-1.83, -7.33]
        """
        return self.kernels.evaluate_quantity(dynamics.coriolis_torque, q, qd, parameters=parameters)

    def coriolis_matrix(self, q: ArrayLike, qd: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Matrix C(q, qd) of the Christoffel symbols: C qd is the Coriolis torque and dM/dt = C + C^T.

        dM/dt - 2 C is skew: Siciliano et al. 2009, (7.49).

        Returns
        -------
        ndarray, shape (..., n, n)
            Torque i per velocity j [N m s/rad, N s or N s/m].

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, q, qd = rne.load("irb140"), np.full(6, 0.3), np.full(6, 0.5)
        >>> C = robot.coriolis_matrix(q, qd)
        >>> np.allclose(C @ qd, robot.coriolis_torque(q, qd)), C[1, 1].round(3).item()
        (True, -0.419)
        """
        return self.kernels.evaluate_quantity(dynamics.coriolis_matrix, q, qd, parameters=parameters)

    def inverse_dynamics_derivatives(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> tuple[Array, Array, Array]:
        """Exact derivatives of the inverse dynamics, from the traced program.

        Returns
        -------
        dtau_dq : ndarray, shape (..., n, n)
            Row i is of torque i, column j by position j.
        dtau_dqd : ndarray, shape (..., n, n)
            With respect to the velocities.
        M : ndarray, shape (..., n, n)
            With respect to the accelerations: the mass matrix.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, q, zero = rne.load("irb140"), np.full(6, 0.3), np.zeros(6)
        >>> dtau_dq, dtau_dqd, M = robot.inverse_dynamics_derivatives(q, zero, zero)
        >>> dtau_dq[1].round(1)[1:3].tolist()  # of joint 2 with respect to q2 and q3 [N m/rad]
        [-115.8, 13.4]
        >>> bool(dtau_dqd.any()), np.allclose(M, robot.mass_matrix(q))  # at rest
        (False, True)
        """
        return self.kernels.inverse_derivatives(q, qd, qdd)

    def forward_dynamics_derivatives(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike) -> tuple[Array, Array, Array]:
        """Exact derivatives of the forward dynamics.

        From M qdd + h = tau: M dqdd = -d(M qdd + h) at constant qdd. Carpentier and Mansard 2018. Errors and warnings
        are those of `forward_dynamics`.

        Returns
        -------
        dqdd_dq : ndarray, shape (..., n, n)
            Row i is of acceleration i, column j by position j.
        dqdd_dqd : ndarray, shape (..., n, n)
            With respect to the velocities.
        dqdd_dtau : ndarray, shape (..., n, n)
            With respect to the torques: the inverse of M.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, q = rne.load("irb140"), np.full(6, 0.3)
        >>> _, _, dqdd_dtau = robot.forward_dynamics_derivatives(q, np.zeros(6), np.zeros(6))
        >>> dqdd_dtau.diagonal().round(2).tolist()  # the inverse of M [rad/s^2 per N m]
        [0.3, 0.22, 1.08, 9.12, 535.67, 694.15]
        """
        return self._forward_derivatives(q, qd, tau)

    def _forward_derivatives(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike) -> tuple[Array, Array, Array]:
        slopes, status = self.kernels.forward_derivatives(q, qd, tau)
        status.raise_or_warn(stacklevel=3)
        dqdd_dq, dqdd_dqd, dqdd_dtau = np.split(slopes, 3, axis=-1)
        return dqdd_dq, dqdd_dqd, dqdd_dtau

    def inverse_dynamics_gradient(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, weights: ArrayLike) -> Array:
        """Gradient of the weighted sum of the torques of inverse dynamics, exact, in two to three times their work.

        Parameters
        ----------
        weights : array_like, shape (..., n)
            Weight of each torque.

        Returns
        -------
        ndarray, shape (..., 3 n)
            With respect to positions, velocities and accelerations: weights^T (dtau/dq, dtau/dqd, M).

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, q, zero = rne.load("irb140"), np.full(6, 0.3), np.zeros(6)
        >>> robot.inverse_dynamics_gradient(q, zero, zero, [0, 1, 0, 0, 0, 0])[1:3].round(1).tolist()
        [-115.8, 13.4]
        """
        return self.kernel(dynamics.inverse_dynamics, order="gradient")(q, qd, qdd, weights)

    def inverse_dynamics_hessian(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, weights: ArrayLike) -> Array:
        """Second derivatives of the weighted sum of the torques of inverse dynamics.

        Parameters
        ----------
        weights : array_like, shape (..., n)
            Weight of each torque.

        Returns
        -------
        ndarray, shape (..., 3 n, 3 n)
            With respect to positions, velocities and accelerations, exactly symmetric.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, q, zero = rne.load("irb140"), np.full(6, 0.3), np.zeros(6)
        >>> H = robot.inverse_dynamics_hessian(q, zero, zero, np.ones(6))
        >>> H.shape, bool(H[12:, 12:].any())  # the torques are linear in the accelerations
        ((18, 18), False)
        """
        return self.kernel(dynamics.inverse_dynamics, order="hessian")(q, qd, qdd, weights)

    def forward_dynamics_gradient(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike, weights: ArrayLike) -> Array:
        """Gradient of the weighted sum of the accelerations of forward dynamics.

        Errors and warnings are those of `forward_dynamics`.

        Parameters
        ----------
        weights : array_like, shape (..., n)
            Weight of each acceleration.

        Returns
        -------
        ndarray, shape (..., 3 n)
            With respect to positions, velocities and torques; the last are M^-1 weights.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, q, zero = rne.load("irb140"), np.full(6, 0.3), np.zeros(6)
        >>> robot.forward_dynamics_gradient(q, zero, zero, [1, 0, 0, 0, 0, 0])[12].round(2).item()  # [rad/s^2 per N m]
        0.3
        """
        return self._forward_weighted("gradient", q, qd, tau, weights)

    def forward_dynamics_hessian(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike, weights: ArrayLike) -> Array:
        """Second derivatives of the weighted sum of the accelerations of forward dynamics.

        Errors and warnings are those of `forward_dynamics`.

        Parameters
        ----------
        weights : array_like, shape (..., n)
            Weight of each acceleration.

        Returns
        -------
        ndarray, shape (..., 3 n, 3 n)
            With respect to positions, velocities and torques, exactly symmetric.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, q, zero = rne.load("irb140"), np.full(6, 0.3), np.zeros(6)
        >>> H = robot.forward_dynamics_hessian(q, zero, zero, np.ones(6))
        >>> H.shape, bool(H[12:, 12:].any())  # accelerations are linear in the torques
        ((18, 18), False)
        """
        return self._forward_weighted("hessian", q, qd, tau, weights)

    def _forward_weighted(self, order: str, *arrays: ArrayLike) -> Array:
        result, status = self.kernel(self.kernels.forward_method, order=order).evaluate(*arrays)
        status.raise_or_warn(stacklevel=3)
        return result

    def linearize(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike) -> tuple[Array, Array]:
        """Linearisation at a state: the derivative of (q, qd) changes by A d(q, qd) + B dtau.

        Errors and warnings are those of `forward_dynamics`.

        Returns
        -------
        A : ndarray, shape (..., 2 n, 2 n)
            Rows: derivatives of velocities and accelerations; columns: with respect to positions and velocities.
        B : ndarray, shape (..., 2 n, n)
            With respect to the torques: zero, and the inverse of M.

        Examples
        --------
        About an equilibrium, accelerations do not depend on the velocities.

        >>> import numpy as np, rne
        >>> robot, q = rne.load("irb140"), np.array([0, np.pi, 0, 0, 0, 0])
        >>> A, B = robot.linearize(q, np.zeros(6), robot.gravity_torque(q))
        >>> A.shape, B.shape
        ((12, 12), (12, 6))
        >>> np.linalg.eigvals(A).imag.max().round(2).item()  # the fastest swing of the hanging arm [rad/s]
        5.44
        """
        dqdd_dq, dqdd_dqd, dqdd_dtau = self._forward_derivatives(q, qd, tau)
        zero = np.zeros_like(dqdd_dq)
        A = np.block([[zero, zero + np.eye(self.n, dtype=zero.dtype)], [dqdd_dq, dqdd_dqd]])
        return A, np.concatenate([zero, dqdd_dtau], axis=-2)

    def link_poses(self, q: ArrayLike) -> Array:
        """Pose of every link, as homogeneous matrices.

        Products of the joints' transforms: Siciliano et al. 2009, (2.50).

        Returns
        -------
        ndarray, shape (..., n_links, 4, 4)
            Takes coordinates of a link's frame to those of the root link; links in `link_names` order [1, m].

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> robot.link_poses([0] * 6)[robot.link_names.index("link_2"), :3, 3].tolist()
        [0.07, 0.0, 0.352]
        """
        return self.kernels.evaluate_quantity(dynamics.link_poses, q)

    def jacobian(self, q: ArrayLike, link: str, point: ArrayLike = ORIGIN, *, axes: str = "base") -> Array:
        """Geometric Jacobian of a point of a link, in the root's axes: angular velocity, then the point's velocity.

        Wrenches that `external` takes are in the link's axes instead: `rne.wrench` makes them. Siciliano et al. 2009,
        (3.29), with the angular rows first as in Featherstone 2008.

        Returns
        -------
        ndarray, shape (..., 6, n)
            [omega; v] = J qd [1, m]. Pinocchio and Corke's toolbox have v first.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").jacobian([0] * 6, "link_1")[:, 0].round(3).tolist()
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
        """
        self._model.link_index(link)
        J = self.kernels.evaluate_quantity(dynamics.jacobian, q, link=link, point=point_argument(point))
        if axes_argument(axes) == BASE_AXES:
            return J
        return in_link_axes(self.link_poses(q)[..., self._model.link_index(link), :3, :3], J)

    def jacobian_rate(self, q: ArrayLike, qd: ArrayLike, link: str, point: ArrayLike = ORIGIN) -> Array:
        """Time derivative of `jacobian` along the motion (q, qd).

        Featherstone 2008, section 2.10.

        Returns
        -------
        ndarray, shape (..., 6, n)
            The matrix dJ/dt in the axes of the root link [1/s, m/s]: the point's acceleration is J qdd + (dJ/dt) qd.

        Examples
        --------
        >>> import rne
        >>> robot, qd = rne.load("irb140"), [0, 1, 0, 0, 0, 0]  # joint 2 turns
        >>> robot.jacobian_rate([0] * 6, qd, "link_6")[3:, 1].round(2)[[0, 2]].tolist()  # x, z: towards the axis
        [-0.38, -0.36]
        """
        self._model.link_index(link)
        return self.kernels.evaluate_quantity(dynamics.jacobian_rate, q, qd, link=link, point=point_argument(point))

    def task_inertia(
        self,
        q: ArrayLike,
        link: str,
        point: ArrayLike = ORIGIN,
        rows: str | Sequence[int] | None = ROWS,
        damping: float = 0.0,
        axes: str = "base",
    ) -> Array:
        """Inertia of a point of a link, Lambda = (J M^-1 J^T)^-1: the force that accelerates it, per acceleration.

        Khatib 1987: with the torques J^T (Lambda a + `task_bias`) the point has the acceleration a.

        Returns
        -------
        ndarray, shape (..., m, m)
            For the m rows, exactly symmetric [kg m^2, kg m or kg].

        Raises
        ------
        SingularMassMatrixError
            If M is singular, or the pose is and there is no damping; the message lists the lost directions. A pose is
            singular where a pivot of J M^-1 J^T is at most 8 m eps of its diagonal entry.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").task_inertia([0, 0, 0, 0, 1, 0], "tool0", rows="xyz").diagonal().round(1).tolist()
        [3.2, 8.0, 7.1]
        """
        return self._task(dynamics.task_inertia, link, point, rows, damping, axes)(q)

    def task_bias(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        link: str,
        point: ArrayLike = ORIGIN,
        rows: str | Sequence[int] | None = ROWS,
        damping: float = 0.0,
        axes: str = "base",
    ) -> Array:
        """Force at a point of a link that does not accelerate: gravity, Coriolis and centrifugal forces of the task.

        Lambda (J M^-1 (C qd + g) - dJ/dt qd), Khatib 1987. Errors are those of `task_inertia`.

        Returns
        -------
        ndarray, shape (..., m)
            For the m rows [N m or N].

        Examples
        --------
        >>> import rne
        >>> robot, q = rne.load("irb140"), [0, 0, 0, 0, 1, 0]
        >>> robot.task_bias(q, [0] * 6, "tool0", rows="xyz").round(1).tolist()  # what its weight is at the tool
        [-33.7, -1.4, 57.0]
        """
        return self._task(dynamics.task_bias, link, point, rows, damping, axes)(q, qd)

    def task_inverse(
        self,
        q: ArrayLike,
        link: str,
        point: ArrayLike = ORIGIN,
        rows: str | Sequence[int] | None = ROWS,
        damping: float = 0.0,
        axes: str = "base",
    ) -> Array:
        """Dynamically consistent inverse of a point's Jacobian, M^-1 J^T Lambda.

        Khatib 1987. Torques (1 - J^T inverse^T) tau of the null space do not accelerate the point. Errors are
        those of `task_inertia`.

        Returns
        -------
        ndarray, shape (..., n, m)
            Times a velocity of the point [omega; v], the joint velocities of least kinetic energy that give it.

        Examples
        --------
        >>> import rne
        >>> robot, q = rne.load("irb140"), [0, 0, 0, 0, 1, 0]
        >>> (robot.jacobian(q, "tool0") @ robot.task_inverse(q, "tool0")).round(9).trace().item()
        6.0
        """
        return self._task(dynamics.task_inverse, link, point, rows, damping, axes)(q)

    def null_space(
        self,
        q: ArrayLike,
        link: str,
        point: ArrayLike = ORIGIN,
        rows: str | Sequence[int] | None = ROWS,
        damping: float = 0.0,
        axes: str = "base",
    ) -> Array:
        """Projector of torques on those that do not accelerate a point: 1 - J^T inverse^T of `task_inverse`.

        Errors are those of `task_inertia`.

        Returns
        -------
        ndarray, shape (..., n, n)
            Of torques (..., n) it leaves those that do not accelerate the point.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, q = rne.load("irb140"), [0, 0, 0, 0, 1, 0]
        >>> np.linalg.matrix_rank(robot.null_space(q, "tool0", rows="xyz")).item()
        3
        """
        J = self.jacobian(q, link, point, axes=axes)[..., rows_argument(rows), :]
        inverse = self.task_inverse(q, link, point, rows=rows, damping=damping, axes=axes)
        projector: Array = np.eye(self.n) - np.swapaxes(inverse @ J, -1, -2)
        return projector

    def _task(
        self, function: Declared, link: str, point: ArrayLike, rows: Any, damping: float, axes: str
    ) -> Callable[..., Array]:
        """Kernel of a quantity of the task space, for these options."""
        fixed: dict[str, Any] = {"link": link, "point": point_argument(point) or ORIGIN, "rows": rows_argument(rows)}
        fixed |= {"damping": positive_number("damping", damping, zero_allowed=True), "axes": axes_argument(axes)}
        return self.kernel(function, **fixed)

    def centre_of_mass(self, q: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Centre of mass of the moving bodies.

        Siciliano et al. 2009, section 7.1. Bodies fixed to the root link do not count.

        Returns
        -------
        ndarray, shape (..., 3)
            In the axes of the root link, from its origin [m].

        Raises
        ------
        ValueError
            If nothing that moves has a mass.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").centre_of_mass([0] * 6).round(3).tolist()
        [0.082, 0.004, 0.504]
        """
        return self.kernels.evaluate_quantity(dynamics.centre_of_mass, q, parameters=parameters)

    def centre_of_mass_jacobian(self, q: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Velocity of the centre of mass per joint velocity, the derivative of `centre_of_mass`.

        Siciliano et al. 2009, (7.16), summed over the bodies.

        Returns
        -------
        ndarray, shape (..., 3, n)
            In the axes of the root link [m or 1].

        Raises
        ------
        ValueError
            If nothing that moves has a mass.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").centre_of_mass_jacobian([0] * 6)[:, 0].round(3).tolist()  # joint 1 turns about z
        [-0.004, 0.082, 0.0]
        """
        return self.kernels.evaluate_quantity(dynamics.centre_of_mass_jacobian, q, parameters=parameters)

    def kinetic_energy(self, q: ArrayLike, qd: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Kinetic energy of the robot, drives (`armature`) included; equal to qd^T M qd / 2.

        Høifødt 2011, (6.31), by (6.30) summed over the bodies.

        Returns
        -------
        ndarray, shape (...)
            The energy [J].

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").kinetic_energy([0] * 6, [0, 0, 0, 0, 0, 2]).round(6).item()
        0.002916
        """
        return self.kernels.evaluate_quantity(dynamics.kinetic_energy, q, qd, parameters=parameters)

    def potential_energy(self, q: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Potential energy of the moving bodies in gravity, zero at the height of the root link's origin.

        Høifødt 2011, (6.32).

        Returns
        -------
        ndarray, shape (...)
            The sum of -m g.c over the bodies [J].

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").potential_energy([0] * 6).round(5).item()
        370.87686
        """
        return self.kernels.evaluate_quantity(dynamics.potential_energy, q, parameters=parameters)

    def momentum(self, q: ArrayLike, qd: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Momentum of the moving bodies about the root link's origin.

        Its derivative is the sum of the wrenches of base, gravity and environment. Featherstone 2008, (2.61).

        Returns
        -------
        ndarray, shape (..., 6)
            [angular; linear] in the axes of the root link [kg m^2/s, kg m/s].

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").momentum([0] * 6, [1, 0, 0, 0, 0, 0])[2].round(2).item()  # about z [kg m^2/s]
        2.36
        """
        return self.kernels.evaluate_quantity(dynamics.momentum, q, qd, parameters=parameters)

    @property
    def parameters(self) -> Array:
        """Inertial parameters of the moving bodies, ten each, shape (10 nb,).

        In the order of `model.moving_joints`: m [kg], m cx, m cy, m cz [kg m], Ixx, Ixy, Iyy, Ixz, Iyz, Izz [kg m^2],
        about the origin of the body's joint frame in the URDF and in its axes. The order is Pinocchio's.
        """
        return parameters_of(self._model)

    def regressor(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Regressor Y of tau = Y pi: joint torques per unit of each inertial parameter of each body.

        Høifødt 2011, (3.2); Siciliano et al. 2009, section 7.2.2.

        Returns
        -------
        ndarray, shape (..., n, 10 nb)
            Columns in the order of `parameters`. The torque of `armature` is not among them.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot = rne.load("irb140")
        >>> q, qd, qdd = np.random.default_rng(0).normal(size=(3, 100, 6))
        >>> tau = robot.regressor(q, qd, qdd) @ robot.parameters
        >>> np.allclose(tau, robot.inverse_dynamics(q, qd, qdd))
        True
        """
        return self.kernels.evaluate_quantity(dynamics.regressor, q, qd, qdd)

    def control_regressor(self, q: ArrayLike, qd: ArrayLike, qdr: ArrayLike, qddr: ArrayLike) -> Array:
        """Regressor Y of M qddr + C qdr + g = Y pi, with dM/dt - 2 C skew, for adaptive control.

        Slotine and Li 1987; body by body as in Echeandia and Wensing 2021.

        Parameters
        ----------
        qdr, qddr : array_like, shape (..., n)
            Velocities and accelerations of the reference [rad/s or m/s; rad/s^2 or m/s^2].

        Returns
        -------
        ndarray, shape (..., n, 10 nb)
            Columns in the order of `parameters`. C is the matrix of the Christoffel symbols, as `coriolis_matrix`.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot = rne.load("irb140")
        >>> q, qd, qdr, qddr = np.random.default_rng(0).normal(size=(4, 6))
        >>> torques = robot.control_regressor(q, qd, qdr, qddr) @ robot.parameters
        >>> M, C, g = robot.mass_matrix(q), robot.coriolis_matrix(q, qd), robot.gravity_torque(q)
        >>> np.allclose(torques, M @ qddr + C @ qdr + g)
        True
        """
        return self.kernels.evaluate_quantity(dynamics.control_regressor, q, qd, qdr, qddr)

    def base_parameters(self, *, drives: DriveModel | None = None, tolerance: float = 1e-9) -> BaseParameters:
        """Minimal combinations of inertial and drive parameters that determine the joint torques, by rules.

        They follow from the axes and places of the joints and the direction of gravity: Gautier and Khalil 1990.

        Parameters
        ----------
        drives : DriveModel, optional
            Rotors, friction and offsets of the drives, which torques depend on too; by default none.
        tolerance : float
            Angles [rad] and distances, divided by the longest one between two joints, that differ by less are taken as
            the same. 1e-5 suits a file that has 1.5708 instead of pi / 2: no measurement finds what only such
            roundings make observable. It must be below 0.01.

        Returns
        -------
        BaseParameters
            Their names, formulas, and the matrices to and from the standard parameters.

        Raises
        ------
        ValueError
            If an option has a wrong value or shape.

        Examples
        --------
        >>> import rne
        >>> drives = rne.DriveModel(rotor=True, friction="viscous+coulomb")
        >>> base = rne.load("irb140").base_parameters(drives=drives)
        >>> base.count, base.standard.count, base.names[-1]
        (52, 78, 'Fc_6')
        """

        def find() -> BaseParameters:
            found = dynamics.base_parameters(self._model, drives=drives, tolerance=tolerance)
            found.matrix.flags.writeable = False
            return replace(found, body_regressor=self.regressor)

        from .model.standard_parameters import drive_argument

        options = (*vars(drive_argument(drives)).values(), tolerance)
        key = repr([np.asarray(x, object).tolist() for x in options])
        base: BaseParameters = self.kernels.base_parameters.get_or_make(key, find)
        return base

    def bounds(
        self,
        positions: str | tuple[ArrayLike, ArrayLike] = "circle",
        *,
        rates: ArrayLike | None = None,
        accelerations: ArrayLike | None = None,
        payload: tuple[float, float] | None = None,
        masses: Mapping[str, tuple[float, float]] | None = None,
        tolerance: float = 0.05,
        budget: float = 90.0,
        seconds: float | None = None,
        quantities: Sequence[str] | None = None,
        link: str | None = None,
        point: ArrayLike = ORIGIN,
    ) -> Bounds:
        """Proven constants that stability theorems assume: of gravity, inertia and Coriolis at every position.

        Values that no position exceeds, by branch and bound on the trigonometric polynomials that M, C and g are, and
        the values attained. Rounding is included.

        Parameters
        ----------
        positions : {"circle", "limits"} or (lower, upper)
            Full turns, the joints' ranges, or ranges of shape (n,) [rad or m]. Sliding joints have their ranges anyway;
            ranges that are unknown or longer than a turn are full turns.
        rates, accelerations : array_like, shape (n,), optional
            Largest speeds and accelerations, for `torque` and `point_speed`; by default the joints' limits
            [rad/s or m/s; rad/s^2 or m/s^2].
        payload : tuple of float, optional
            Least and largest mass of a point at the end of the last link, every mass between included [kg].
        masses : mapping of str to tuple of float, optional
            Least and largest mass of bodies by their links, with the same centre and radii of gyration [kg].
        tolerance : float
            Gap to prove, relative to the value attained.
        budget : float
            Work for each quantity, after which the bounds proven so far are returned. It is counted, so that every
            machine proves the same; a unit is 2e9 operations, 0.4 to 1 s of one core.
        seconds : float, optional
            Time for each quantity, after which the bounds proven so far are returned as well [s]. Where it ends a proof
            `Bounds.stopped` lists it: what was proven then depends on the machine and its load.
        quantities : sequence of str, optional
            Of "gravity_torque", "gravity_stiffness", "mass_matrix", "mass_eigenvalues", "coriolis", "torque",
            "point_speed". By default all, `torque` only where rates and accelerations are known, `point_speed` only
            where a link is given.
        link : str, optional
            Link with the point of `point_speed`.
        point : array_like, shape (3,), optional
            In the link's frame; by default its origin [m].

        Returns
        -------
        Bounds
            Each with `lower`, `upper`, `attained`, `q` and `is_tight`; printed as a table.

        Raises
        ------
        ValueError
            If an argument does not fit the robot, a range is missing, or the robot has too many joints.

        Notes
        -----
        docs/explanation/bounds-proofs.md proves them. Kelly, Santibanez and Loria 2005, section 4.3, bound the same
        constants by hand.

        Examples
        --------
        >>> import rne
        >>> found = rne.load("irb140").bounds(quantities=["gravity_stiffness"]).gravity_stiffness
        >>> bool(162.8 < found.attained <= found.upper < 171)
        True
        """
        from .bounds.bounds import robot_bounds
        from .model.topology import refuse_couplings

        refuse_couplings(self.model, "bounds take")
        box = positions, rates, accelerations, payload, masses
        effort, place = (tolerance, budget, seconds), (link, point_argument(point) or ORIGIN)
        return robot_bounds(self.kernels, *box, *effort, quantities, *place)

    def with_payload(
        self, mass: float, com: ArrayLike = (0.0, 0.0, 0.0), inertia: ArrayLike | None = None, link: str | None = None
    ) -> Robot:
        """Robot with a further rigid body fixed to one of its links.

        Parameters
        ----------
        mass : float
            Mass of the body [kg].
        com : array_like, shape (3,), optional
            Its centre of mass in the link's frame; the link's origin if not given [m]. One farther away than five times
            the robot's size is logged as a warning.
        inertia : array_like, shape (3, 3), or None
            About its centre of mass, in the link's axes; None for a point mass [kg m^2].
        link : str, optional
            One of `link_names`. If not given, the last link of the chain, including fixed frames after the last joint,
            such as a flange. If several last links have one frame, it is ``tool0`` or the last of them, which is logged
            at level INFO.

        Returns
        -------
        Robot
            Another robot with its own kernels; this one stays as it is.

        Raises
        ------
        ValueError
            If the link does not exist, is not given for a robot whose moving joints branch or mimic others or whose
            last links have different origins (or, with a `com` or `inertia`, different axes), or the
            payload is not a possible rigid body.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> more = robot.with_payload(5.0).gravity_torque([0] * 6) - robot.gravity_torque([0] * 6)
        >>> more.round(2)[1].item()  # 5 kg at 0.445 m from joint 2
        -21.83
        """
        return self.with_model(models.with_payload(self._model, mass, com, inertia, link))

    def with_parameters(self, parameters: ArrayLike) -> Robot:
        """Robot with other masses, centres of mass and inertias.

        Parameters
        ----------
        parameters : array_like, shape (10 nb,)
            In the order of `parameters`.

        Returns
        -------
        Robot
            With these bodies; joints, links, limits and the base are the same.

        Raises
        ------
        ValueError
            If the shape is wrong or a number is not finite, or a body without mass has a first moment.
        ModelError
            If a body is not possible: a negative mass, or an inertia that no distribution of mass has.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> robot.with_parameters(2 * robot.parameters).model.mass[1].item()
        44.0
        """
        return Robot(with_parameters(self._model, parameters), self.engine)

    def with_limits(
        self,
        *,
        effort: LimitValues = None,
        velocity: LimitValues = None,
        acceleration: LimitValues = None,
        deceleration: LimitValues = None,
        jerk: LimitValues = None,
    ) -> Robot:
        """Robot with other limits of its joints and drives, such as the values of a data sheet.

        Parameters
        ----------
        effort, velocity, acceleration, deceleration, jerk : float, array_like of shape (n,), or mapping, optional
            One number for all joints, one for each of `joint_names`, or some by name, also of joints that follow others
            but for effort; inf for none; limits that are not given stay. Deceleration is acceleration against the
            direction of motion; an infinite limit of it stands for the limit of acceleration
            [N m or N; rad/s or m/s; rad/s^2 or m/s^2, twice; rad/s^3 or m/s^3].

        Returns
        -------
        Robot
            With these as `effort_limit`, `velocity_limit` and so on. Dynamics ignore them.

        Raises
        ------
        ValueError
            If there are not as many numbers as joints, a limit is negative or NaN, or a name is no joint's.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140").with_limits(effort=[250, 250, 150, 50, 50, 20], velocity={"joint_6": 5.0})
        >>> robot.effort_limit[5].item(), robot.velocity_limit[5].item()
        (20.0, 5.0)
        """
        rates = {"velocity": velocity, "acceleration": acceleration, "deceleration": deceleration, "jerk": jerk}
        model = models.with_limits(self._model, effort=effort, **rates)
        return self.with_model(model)

    def with_armature(self, armature: LimitValues) -> Robot:
        """Robot with other rotors: a rotor of inertia J with a gear of ratio r adds r^2 J at its joint to M.

        Parameters
        ----------
        armature : float, array_like of shape (nb,), or mapping
            Inertias r^2 J: one for all moving joints, one for each of `model.moving_joints`, those that mimic others
            included, or some by name [kg m^2, or kg of joints that slide].

        Returns
        -------
        Robot
            With these as `model.armature`: Siciliano et al. 2009, section 7.1.1, without gyroscopic torques of rotors.

        Raises
        ------
        ValueError
            If there are not as many numbers as moving joints, one is negative or not finite, or a name is no joint's.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140").with_armature({"joint_6": 100**2 * 1e-5})  # a gear of 100
        >>> robot.mass_matrix([0] * 6)[5, 5].round(3).item()  # 0.001 without
        0.101
        """
        return self.with_model(models.with_armature(self._model, armature))

    def locked(self, positions: Mapping[str, float]) -> Robot:
        """Robot with some joints fixed at a position: a smaller robot with fewer coordinates.

        Parameters
        ----------
        positions : mapping of str to float
            Position of each joint to lock, by name; joints that mimic it are locked with it [rad or m].

        Returns
        -------
        Robot
            With the remaining joints in the same order and all links.

        Raises
        ------
        TypeError
            If `positions` is no mapping.
        ValueError
            If a name is not one of `joint_names` or a position is not finite.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").locked({"joint_4": 0.0, "joint_6": 0.0}).joint_names
        ('joint_1', 'joint_2', 'joint_3', 'joint_5')
        """
        return self.with_model(models.locked(self._model, positions))

    def mounted(self, rpy: ArrayLike) -> Robot:
        """Robot with its root link rotated in the world: on a wall, under a ceiling, on a slope.

        Parameters
        ----------
        rpy : array_like, shape (3,)
            Roll, pitch and yaw of the root link [rad].

        Returns
        -------
        Robot
            The same robot with gravity in the axes of the rotated root link; poses stay relative to the root link.

        Raises
        ------
        ValueError
            If `rpy` has not shape (3,), is not finite, or has an angle above a full turn, as degrees have.

        Examples
        --------
        >>> import math, rne
        >>> rne.load("irb140").mounted([math.pi, 0, 0]).model.gravity.tolist()  # under the ceiling
        [0.0, 0.0, 9.81]
        """
        return self.with_model(models.mounted(self._model, rpy))


def point_argument(point: ArrayLike) -> tuple[float, ...] | None:
    """Point of a link; None for its origin."""
    values = tuple(real_array("point", point, "(3,)").astype(float).tolist())
    return None if values == ORIGIN else values


def rows_argument(rows: str | Sequence[int] | None) -> tuple[int, ...]:
    """Rows of a Jacobian by their numbers."""
    named = {"xyz": (3, 4, 5), "rotation": (0, 1, 2)}
    if rows is None or isinstance(rows, str):
        if rows not in (None, *named):
            raise ValueError(f"`rows` must be 'xyz', 'rotation' or numbers from 0 to 5, got {rows!r}")
        return ROWS if rows is None else named[rows]
    found = tuple(whole_number("rows", row, least=0) for row in rows)
    if not found or len(set(found)) < len(found) or max(found) > 5:
        raise ValueError(f"`rows` must be different numbers from 0 to 5, got {list(found)}")
    return found


def axes_argument(axes: str) -> str:
    """The axes of a vector of a link, or a ValueError."""
    if axes not in (BASE_AXES, LINK_AXES):
        raise ValueError(f"`axes` must be {BASE_AXES!r} or {LINK_AXES!r}, got {axes!r}")
    return axes


def wrench(
    robot: Robot,
    q: ArrayLike,
    link: str,
    force: ArrayLike | None = None,
    moment: ArrayLike | None = None,
    point: ArrayLike = ORIGIN,
    axes: str = "base",
) -> dict[str, Array]:
    """Wrench of a force at a point of a link, and a moment, for `external=`: acting on the robot, in the axes given.

    What the tool exerts on its surroundings is the negative of what acts on the robot: to press down with 50 N, give a
    force of 50 N upwards.

    Parameters
    ----------
    robot : Robot
        The robot.
    q : array_like, shape (..., n)
        Joint positions, which axes "base" need [rad or m].
    link : str
        One of `link_names`.
    force, moment : array_like, shape (..., 3), optional
        On the robot [N; N m].
    point : array_like, shape (3,)
        Where the force acts, in the link's frame; by default its origin [m].
    axes : {"base", "link"}
        Axes of force and moment: the root link's, or the link's own.

    Returns
    -------
    dict of str to ndarray, shape (..., 6)
        By the link, [moment; force] at its origin in its own axes.

    Raises
    ------
    ValueError
        If neither force nor moment is given, one of the arrays has the wrong shape or is not finite, or there is no
        such link or axes.

    Examples
    --------
    Torques that press down with 50 N.

    >>> import rne
    >>> robot, q = rne.load("irb140"), [0, 0, 0, 0, 1, 0]
    >>> up = rne.wrench(robot, q, "tool0", force=[0, 0, 50])
    >>> (robot.bias_torque(q, [0] * 6, external=up) - robot.gravity_torque(q))[1:5].round(1).tolist()
    [20.8, 20.8, 0.0, 1.8]
    """
    model, R = robot_argument(robot).model, robot.link_poses(q)[..., robot.model.link_index(link), :3, :3]
    if force is None and moment is None:
        raise ValueError("`force` or `moment` must be given")
    R = R if axes_argument(axes) == BASE_AXES else np.broadcast_to(np.eye(3), R.shape)
    f, m = (
        np.zeros(3) if x is None else number_array(name, x, "(..., 3)")
        for name, x in (("force", force), ("moment", moment))
    )
    for name, x in (("force", f), ("moment", m)):
        if x.shape[-1:] != (3,):
            raise ValueError(f"`{name}` must have shape (..., 3) for robot {model.name!r}, got {x.shape}")
    f, m = rotate_back(R, f), rotate_back(R, m)
    return {link: np.concatenate([m + cross(np.array(point_argument(point) or ORIGIN), f), f], axis=-1)}


def robot_argument(robot: Any) -> Robot:
    """Argument that must be a Robot; a TypeError for anything else."""
    if not isinstance(robot, Robot):
        raise TypeError(f"`robot` must be an rne.Robot, got {type(robot).__name__}")
    return robot
