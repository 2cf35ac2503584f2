"""The Robot: a model with each quantity as a method."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import ArrayLike

from ..basics.text import InNotebooks, counted, short
from ..model import modify
from ..model.parameters import with_parameters
from .bias_terms import BiasTerms
from .derivatives import Derivatives
from .dynamics import Dynamics
from .inertial import Inertial
from .kinematics import Kinematics


class Robot(Dynamics, BiasTerms, Derivatives, Kinematics, Inertial, InNotebooks):
    """A robot whose quantities are methods.

    Arrays of joint values have shape (..., n): leading axes are independent states. All quantities are in SI units,
    angles in radians. The first call of a method for a single state runs the recursion; later calls and batches run its
    kernel, traced for this robot (see `compile`).

    Parameters
    ----------
    model : Model
        Its parameters, from `rne.read_urdf`, `rne.dh_chain`, `rne.model.chain` or `rne.irb140`; `rne.load` makes both.
    engine : {"numpy", "numba"}
        What runs its kernels: NumPy, or machine code by Numba, which takes about a second to compile at first use.
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
    >>> robot.inverse_dynamics([0] * 6, [0] * 6, [0] * 6).shape
    (6,)
    """

    def __reduce__(self) -> tuple[Any, ...]:
        return Robot, (self._model, self.engine)

    def with_payload(
        self,
        mass: float,
        com: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None,
        link: str | None = None,
    ) -> Robot:
        """The robot with a further rigid body fixed to one of its links.

        Parameters
        ----------
        mass : float
            Mass of the body [kg].
        com : array_like, shape (3,), optional
            Its centre of mass in the link's frame; the link's origin if not given [m].
        inertia : array_like, shape (3, 3), or None
            About its centre of mass, in the link's axes; None for a point mass [kg m^2].
        link : str, optional
            One of `link_names`. If not given, the last link of the chain, a fixed frame such as a flange behind the
            last joint included.

        Returns
        -------
        Robot
            A further robot, with kernels of its own; this one stays as it is.

        Raises
        ------
        ValueError
            If the link does not exist, is not given for a robot whose moving joints branch or mimic others or whose
            last body ends at several points, or the payload is not a possible rigid body.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> more = robot.with_payload(5.0).gravity_torque([0] * 6) - robot.gravity_torque([0] * 6)
        >>> more.round(2)[1].item()  # 5 kg at 0.445 m from joint 2
        -21.83
        """
        return Robot(modify.with_payload(self._model, mass, com, inertia, link), self.engine)

    def with_parameters(self, parameters: ArrayLike) -> Robot:
        """The robot with other masses, centres of mass and inertias.

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

    def locked(self, positions: Mapping[str, float]) -> Robot:
        """The robot with some joints fixed at a position: a smaller robot with fewer coordinates.

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
        return Robot(modify.locked(self._model, positions), self.engine)

    def mounted(self, rpy: ArrayLike) -> Robot:
        """The robot with its root link rotated in the world: on a wall, under a ceiling, on a slope.

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
            If `rpy` has not shape (3,) or is not finite.

        Examples
        --------
        >>> import math, rne
        >>> rne.load("irb140").mounted([math.pi, 0, 0]).model.gravity.tolist()  # under the ceiling
        [0.0, 0.0, 9.81]
        """
        return Robot(modify.mounted(self._model, rpy), self.engine)

    def __repr__(self) -> str:
        model = self._model
        lines = [
            f"Robot '{short(model.name)}': {counted(model.n, 'joint')}, {counted(len(model.link_names), 'link')}, "
            f"{model.mass.sum():.6g} kg moving, gravity {model.gravity.tolist()} m/s^2"
        ]
        if model.has_mimics:
            further = model.nb - model.n
            lines.append(f"  {counted(further, 'further joint')} mimic{'s' * (further == 1)} these")
        if model.damping.any() or model.friction.any():
            lines.append("  damping and friction of its <dynamics> are on record, not applied")
        return "\n".join(lines)
