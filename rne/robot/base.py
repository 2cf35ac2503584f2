"""What every robot has: its model, its names, its kernels."""

from __future__ import annotations

from typing import Any

from ..basics.spatial import Array
from ..dynamics.crba import mass_matrix
from ..dynamics.quantity import Declared
from ..dynamics.rnea import bias_torque, gravity_torque, inverse_dynamics
from ..kernels.cache import KernelCache
from ..kernels.kernel import Kernel
from ..model.model import Model
from ..model.topology import pinocchio_order

COMPILED = (inverse_dynamics, mass_matrix, bias_torque, gravity_torque)  # by `compile` without arguments


class RobotBase:
    """A model with the kernels of its quantities."""

    def __init__(self, model: Model, engine: str = "numpy") -> None:
        if not isinstance(model, Model):
            raise TypeError(f"`model` must be an rne.Model, got {type(model).__name__}")
        self._model = model
        self.kernels = KernelCache(model, engine)
        self.cache: dict[str, Any] = {}  # compiled by simulations of the robot, for the next run

    @property
    def model(self) -> Model:
        """The robot's parameters: a frozen record of masses, centres of mass, inertias, axes and placements."""
        return self._model

    @property
    def engine(self) -> str:
        """What runs its kernels: "numpy" or "numba"."""
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
        """Lower ends of the joints' ranges, -inf where unknown, shape (n,) [rad or m]."""
        return self._of_coordinates(self._model.lower)

    @property
    def upper(self) -> Array:
        """Upper ends of the joints' ranges, inf where unknown, shape (n,) [rad or m]."""
        return self._of_coordinates(self._model.upper)

    @property
    def velocity_limit(self) -> Array:
        """Largest rates of the joints, inf where unknown, shape (n,) [rad/s or m/s]."""
        return self._of_coordinates(self._model.velocity_limit)

    @property
    def effort_limit(self) -> Array:
        """Largest torques of the drives, inf where unknown, shape (n,) [N m or N]."""
        return self._of_coordinates(self._model.effort_limit)

    def _of_coordinates(self, limits: Array) -> Array:
        """Those of the joints in `joint_names`; a model also has those of joints that mimic others."""
        return limits[list(self._model.independent_joints)]

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
            Joints that mimic others are not coordinates here, but they are in Pinocchio unless it is told otherwise.

        Raises
        ------
        ValueError
            For any other library.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").joint_order("pinocchio").tolist()
        [0, 1, 2, 3, 4, 5]
        """
        if library != "pinocchio":
            raise ValueError(f"`library` must be 'pinocchio', got {library!r}")
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
        >>> robot.mass_matrix([0] * 6).shape  # already by the kernel
        (6, 6)
        """
        for function in functions or COMPILED:
            self.kernel(function)
        if not functions:
            self.kernels.forward_kernel()

    def kernel(self, function: Declared, *wrt: str, **fixed: Any) -> Kernel:
        """The function traced on this robot, on first use, and kept.

        Parameters
        ----------
        function : callable
            One of this package's functions of a model, such as `rne.dynamics.mass_matrix`.
        *wrt : str
            Arguments to differentiate by; none for the function itself.
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
            If the function is not one of this package's, or an argument is not one of its.
        ValueError
            If there is no such link.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> robot.kernel(rne.dynamics.gravity_torque, "q")([0] * 6).shape  # its derivative by q
        (6, 6)
        """
        return self.kernels.kernel(function, *wrt, **fixed)
