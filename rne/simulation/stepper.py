"""Control interval as a function of the state, of torques or a law, and of the numbers of a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import convert_numbers, positive_number, real_numbers, whole_number
from ..basics.spatial import Array
from ..basics.text import short
from ..errors import NotFiniteError, SingularMassMatrixError
from ..integrators.frozen_steps import Function
from ..integrators.loops import LANES, NO_PIECES, compiled
from ..integrators.row_steps import RowGroup, RowSlopes, step_rows
from ..integrators.step_control import aligned
from ..integrators.tableaus import tableau
from ..kernels.kernel import FLOAT64
from ..kernels.numpy_backend import check_array
from ..robot import Robot
from .frozen_motion import FrozenScene, Own, SideBySide, flat, schedule_of
from .scene import Scene
from .scene_numbers import common_and_own
from .simulator import scene_argument

METHODS = {"rk4": "rk4", "tsit5": "Tsit5", "semi-implicit-euler": "semi-implicit-euler"}
OTHERS = ("numbers", "of_law", "limits", "table", "law_table")  # fields of `Adjoint`


class _Rows(NamedTuple):
    """Arguments of a call and its results; a single row of u or t is common to all."""

    x: Array
    u: Array
    t: Array
    out: Array
    weights: Array = np.zeros((1, 0))
    others: Array = np.zeros((1, 0))  # derivatives by all but x, if they are asked for

    def part(self, rows: Array) -> _Rows:
        """Copies of some rows."""
        return _Rows(*(array[np.minimum(rows, len(array) - 1)] for array in self))


class _Numbers:
    """Scene with other numbers, some of which differ between states, (N, ...)."""

    def __init__(self, frozen: FrozenScene, own: Own, given: Own) -> None:
        self.frozen, self.own, self.given = frozen, own, given
        self.count = max(map(len, own.values()), default=1)
        self.side = SideBySide(frozen, own, self.count, by_machine=False)
        self.pools: dict[bool, list[_Lanes]] = {False: [], True: []}  # those that no thread uses now, by `derive`
        self._columns: dict[bool, list[Array]] = {}

    def part(self, rows: Array) -> dict[str, Array]:
        """Numbers of some rows."""
        return {name: array[np.minimum(rows, self.count - 1)] for name, array in self.own.items()}

    def is_of(self, numbers: Mapping[str, ArrayLike], count: int) -> bool:
        """True if made for these numbers and this number of states."""
        equal = all(np.array_equal(self.given[name], value) for name, value in numbers.items())
        return equal and (not self.own or self.count == count)

    def columns(self, *, derive: bool) -> list[Array]:
        """Bounds of commands and coefficients of kernels, (N, k) each; (1, 0) where all have the scene's."""
        if derive not in self._columns:
            frozen, side, none = self.frozen, self.side, np.zeros((1, 0))
            kernels = [frozen.kernel, frozen.law_kernel, *([frozen.gradient, frozen.law_gradient] if derive else [])]
            found = [side.limits.reshape(-1, self.count).T if self.own and frozen.law else none]
            for kernel, numbers in zip(kernels, (side.numbers, side.law_numbers) * 2, strict=False):
                found.append(kernel.coefficients(numbers) if kernel and numbers.ndim == 2 else none)
            self._columns[derive] = found
        return self._columns[derive]


class _Lanes:
    """Rows side by side for the functions of `row_steps`, in machine code or by NumPy."""

    def __init__(self, stepper: Stepper, numbers: _Numbers, L: int, *, by_machine: bool, derive: bool) -> None:
        frozen, schedule, holds = numbers.frozen, stepper.schedule, stepper.holds
        self.numbers, self.by_machine, self.derive, self.count = numbers, by_machine, derive, L
        side = SideBySide(frozen, numbers.part(np.arange(L)), L, by_machine=by_machine)
        n, size, stages = side.n * L, side.size * L, len(schedule.tableau.B)
        widths = [1, *(a.shape[1] * by_machine for a in numbers.columns(derive=derive))]
        own = np.zeros(sum(widths) * L)
        times, limits, *coefficients = np.split(own, np.cumsum(widths[:-1]) * L)
        functions = [side.rates, side.sampled_law, *(side.gradients if derive else ())]
        for k, (f, part) in enumerate(zip(functions, coefficients, strict=True)):
            inputs = (*f.inputs[: f.piece + 1], part, *f.inputs[f.piece + 2 :]) if part.size else f.inputs
            functions[k] = f._replace(inputs=inputs, begins=times)
        rates, law, *gradients = functions
        ends = np.repeat(stepper._ranges, L, axis=1)
        self.group = RowGroup(
            rates,
            law,
            schedule._replace(positions=schedule.positions * L),
            side.holding._replace(limits=limits.reshape(2, -1)) if limits.size else side.holding,
            (np.zeros((stages, size)), np.zeros(size), np.zeros(n), np.zeros(n)),
            side.kept(*(len(schedule.lengths), stages) if derive else (0, 0)),
            np.zeros(stepper.size * L),
            side.holding.pending.reshape(-1),
            size,
            n * holds,
            rates.inputs[2][: n * frozen.is_driven],
            own,
            ends,
            frozen.dynamics.n * L,
            np.zeros(ends.shape[1]),
        )
        self.slopes: Any = self._row_slopes(side, gradients, stages) if derive else ()

    def _row_slopes(self, side: SideBySide, gradients: Sequence[Function], stages: int) -> RowSlopes:
        """Storage of derivatives: those by the state at the start take its place, all others are in one vector."""
        adjoint = side.adjoint(self.group.state[: side.size * self.count], stages)
        is_driven = self.numbers.frozen.is_driven
        of = {name: getattr(adjoint, name) for name in ("held", *OTHERS) if name != "held" or is_driven}
        others = np.zeros(sum(array.size for array in of.values()))
        parts = np.split(others, np.cumsum([array.size for array in of.values()])[:-1])
        adjoint = adjoint._replace(**{k: a.reshape(of[k].shape) for k, a in zip(of, parts, strict=True)})
        return RowSlopes(gradients[0], gradients[1], adjoint, adjoint.pending.reshape(-1), others)

    def run(self, rows: _Rows, first: int, last: int, left: Array) -> None:
        """Integrate a range of rows, and mark those that need the recursion in `left`."""
        own, count = rows.t, self.numbers.count
        if self.numbers.own and self.by_machine:
            columns = [rows.t, *self.numbers.columns(derive=self.derive)]
            own = np.hstack([np.broadcast_to(a, (count, a.shape[1])) for a in columns])
        text = compiled(step_rows) if self.by_machine else step_rows
        weights = rows.weights if self.derive else NO_PIECES
        text(self.group, self.slopes, rows.x, rows.u, own, weights, (first, last), rows.out, rows.others, left)


class Stepper:
    """Control interval of a scene in discrete time, x_next = F(x, u, numbers), for a batch of states.

    The model of rollouts, sampling-based control, learning and shooting: equal steps, no step control, no events.

    Parameters
    ----------
    scene : Scene or Robot
        What moves, without `stops`, sticking friction and `torque_rate`; a controller must be traceable.
    sample_time : float, optional
        Length of the interval; that of a sampled controller if not given [s].
    substeps : int
        Number of equal steps. One in which a command begins to act is divided there.
    method : {"rk4", "tsit5", "semi-implicit-euler"}
        The classical Runge-Kutta method of order 4, that of Tsitouras (2011) of order 5 with equal steps, or
        semi-implicit Euler with viscous friction implicit: (M + h D) qdd = net torques, D = d friction / d qd,
        then qd_next = qd + h qdd and q_next = q + h qd_next.
    position_stops : bool
        True to end each interval inelastically within the joints' ranges: positions are clipped, and velocities that
        led out of the range are 0.

    Attributes
    ----------
    size : int
        Length of the state. In this order it has q [rad or m] and qd [rad/s or m/s], of elastic joints q, motor_q, qd,
        motor_qd; the states of the law; and of a sampled law with a delay torques [N m or N]: the command that acts, if
        the delay is no whole number of sample times, and those that wait, the oldest first, one for each whole sample
        time of the delay.

    Raises
    ------
    TypeError
        If `scene` is neither a Scene nor a Robot.
    ValueError
        If an argument is out of range, `sample_time` is not that of the controller, or the next state depends on more
        than the state: `stops`, sticking friction, `torque_rate`, a controller that is called.

    Notes
    -----
    The error of a step is not controlled. "rk4" is stable for steps of up to 2.7 times the shortest time constant of
    friction, inertia over (viscous + coulomb / smoothing): for geared arms and the default `smoothing` some
    milliseconds. With longer steps joints near rest chatter: give a larger `smoothing`, or `substeps`.

    A batch by engine "numba" takes about 30 times less time than by NumPy, and no row depends on the others; the first
    call on a machine compiles for some seconds. A traced controller that is not sampled is part of dx/dt; steps do not
    end at its `breaks`, where its torques jump. A controller that is changed in place needs another stepper.

    Examples
    --------
    >>> import numpy as np, rne
    >>> scene = rne.Scene(rne.load("ur5"), friction=rne.Friction(viscous=2.0), effort_limit="urdf")
    >>> stepper = rne.Stepper(scene, sample_time=0.02, substeps=4)
    >>> x = stepper.start(np.zeros((100, 6)), np.zeros((100, 6)))
    >>> u = scene.robot.gravity_torque(x[:, :6])
    >>> np.allclose(stepper(x, u), x, atol=1e-9), stepper.into(x, u, x) is x
    (True, True)
    >>> gradient = stepper.gradient(x, u, np.eye(12)[6])  # of the velocities of joint 1
    >>> bool((gradient["u"][:, 0] > 0).all()), stepper.jacobian(x, u).shape
    (True, (100, 12, 18))
    >>> (stepper.reset(x, np.arange(100) < 50, np.ones(12))[49:51, 0] > 0.5).tolist()
    [True, False]
    >>> function = stepper.to_casadi(symbolic="MX")  # doctest: +SKIP
    >>> function = stepper.to_jax()  # doctest: +SKIP
    >>> print(stepper.source("c").splitlines()[-1])
    }
    """

    def __init__(
        self,
        scene: Scene | Robot,
        sample_time: float | None = None,
        substeps: int = 1,
        method: str = "rk4",
        position_stops: bool = False,
    ) -> None:
        if method not in METHODS:
            raise ValueError(f"`method` must be one of {list(METHODS)}, got {method!r}")
        self.scene, self.substeps = scene_argument(scene, "scene"), whole_number("substeps", substeps)
        self.sample_time, self.position_stops = _period(self.scene, sample_time), bool(position_stops)
        self.method = method
        self.own_numbers = _Numbers(self._frozen(self.scene, ()), {}, {})
        self._known: dict[tuple[str, ...], _Numbers] = {}  # those given last, by their names
        frozen, side, robot = self.own_numbers.frozen, self.own_numbers.side, self.scene.resolved.robot
        late, rest = frozen.delay
        rests = np.array([rest])
        ends = np.linspace(0, self.sample_time, self.substeps + 1)
        ends = np.unique(np.concatenate([aligned(ends, [rests]), rests]))
        samples = np.zeros(int(frozen.law is not None))
        positions = frozen.dynamics.n if method == "semi-implicit-euler" else 0
        schedule = schedule_of(tableau(METHODS[method]), ends, samples, rests[: len(samples)], np.zeros(0))
        self.schedule = schedule._replace(positions=positions)
        self._ranges = np.array([robot.lower, robot.upper]) if self.position_stops else np.zeros((2, 0))
        self.holds = rest > 0
        self.size = side.size + side.m + self.scene.n * (int(late) + self.holds)
        self._by_machine = frozen.by_machine

    def __reduce__(self) -> tuple[Any, ...]:
        return Stepper, (self.scene, self.sample_time, self.substeps, self.method, self.position_stops)

    def __repr__(self) -> str:
        law = "torques" if self.scene.controller is None else type(self.scene.controller).__name__
        return (
            f"Stepper of '{short(self.scene.resolved.robot.model.name)}' under {law}: states of {self.size}, "
            f"{self.sample_time:g} s in steps of {self.sample_time / self.substeps:g} s by {self.method}"
        )

    def _frozen(self, scene: Scene, names: tuple[str, ...]) -> FrozenScene:
        """Scene with its equations; a ValueError for those whose next state depends on more than the state."""
        damped_over = self.sample_time / self.substeps if self.method == "semi-implicit-euler" else 0.0
        found = FrozenScene(scene, names, None, scene.controller is None, damped_over)
        refused = found.refused
        if scene.torque_rate is not None:
            refused = "`torque_rate` needs the previous command: leave it out, or bound what the law gives"
        if refused:
            raise ValueError(f"the scene cannot be stepped from its state alone: {refused}")
        return found

    def start(self, q0: ArrayLike, qd0: ArrayLike) -> Array:
        """States at the start, with a law's states and commands at 0.

        Parameters
        ----------
        q0, qd0 : array_like, shape (n,) or (N, n)
            Positions and velocities; of elastic joints those of the links, or of links and motors [rad or m; rad/s or
            m/s].

        Returns
        -------
        ndarray, shape (size,) or (N, size)
            States; without the motors' positions these hold the links at rest.

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite.
        """
        q, qd = self.own_numbers.frozen.dynamics.start(self.scene.resolved.robot, q0, qd0)
        q, qd = np.broadcast_arrays(q, qd)
        return np.concatenate([q, qd, np.zeros((*q.shape[:-1], self.size - 2 * q.shape[-1]))], axis=-1)

    def reset(self, x: Array, mask: ArrayLike, x0: ArrayLike) -> Array:
        """Reset some states in place.

        Parameters
        ----------
        x : ndarray, shape (N, size)
            States, which change, float64 in C order.
        mask : array_like of bool, shape (N,)
            Those to be replaced.
        x0 : array_like, shape (size,) or (N, size)
            Their new values, such as from `start`.

        Returns
        -------
        ndarray, shape (N, size)
            `x`.

        Raises
        ------
        ValueError
            If an array has the wrong shape or type, or `x0` is not finite.
        """
        chosen = np.asarray(mask)
        if chosen.dtype != bool or chosen.shape != np.shape(x)[:-1]:
            raise ValueError(f"`mask` must be bool of shape {np.shape(x)[:-1]}, got {chosen.dtype} of {chosen.shape}")
        check_array("x", x, (*chosen.shape, self.size), FLOAT64, "writeable")
        x[chosen] = self._as_states("x0", x0, x.shape)[chosen]
        return x

    def __call__(
        self,
        x: ArrayLike,
        u: ArrayLike | None = None,
        numbers: Mapping[str, ArrayLike] | None = None,
        workers: int = 1,
        *,
        t: ArrayLike = 0.0,
    ) -> Array:
        """States at the end of the interval.

        Parameters
        ----------
        x : array_like, shape (size,) or (N, size)
            States at its begin.
        u : array_like, shape (n,) or (N, n), optional
            Torques of the drives of a scene without a controller, held over the interval, within its effort limits
            [N m or N].
        numbers : mapping of str to array_like, optional
            Numbers of the scene instead of its own, by the names of `Scene.numbers`: the same for all states, or with
            a leading axis of N.
        workers : int
            Threads that share the states, by engine "numba".
        t : float or array_like, shape (N,)
            When the interval begins, for laws that depend on time, such as those with a reference motion [s].

        Returns
        -------
        ndarray, shape of x
            States.

        Raises
        ------
        ValueError, KeyError, TypeError
            If an argument has the wrong shape or type, `u`, `t` or a number is not finite, there is no such number, or
            `t` is outside of the samples that a law follows.
        NotFiniteError, SingularMassMatrixError
            If a state is not finite or overflows, or M is singular; says which state.
        """
        states = self._states("x", x)
        given, out = self._numbers(numbers, len(states)), np.empty_like(states)
        rows = _Rows(states, self._torques(u, len(states)), self._times(given, t, len(states)), out)
        self._run(given, rows, workers)
        return out.reshape(np.shape(x))

    def into(self, x: Array, u: Array | None, out: Array, *, t: float = 0.0) -> Array:
        """Write the states at the end of the interval into an array; by engine "numba" no state is copied.

        Parameters
        ----------
        x : ndarray, shape (size,) or (N, size)
            States at its begin, float64 in C order.
        u : ndarray, shape (n,) or (N, n), or None
            Torques of the drives, likewise, without a controller [N m or N].
        out : ndarray, shape of x
            Likewise; it may be x itself.
        t : float
            When the interval begins [s].

        Returns
        -------
        ndarray, shape of x
            `out`.

        Raises
        ------
        ValueError
            If an array has the wrong shape or type, or `out` overlaps `x`.
        NotFiniteError, SingularMassMatrixError
            As for a call; `out` may then have some of the new states.
        """
        shape, n = np.shape(x), self.scene.n
        if shape not in ((self.size,), (*shape[:1], self.size)):
            raise ValueError(f"`x` must have shape ({self.size},) or (N, {self.size}), got {shape}")
        for name, array, wanted in (("x", x, shape), ("u", u, (*shape[:-1], n)), ("out", out, shape)):
            if name != "u" or u is not None:
                check_array(name, array, wanted, FLOAT64, "writeable" if name == "out" else "aligned")
        if np.may_share_memory(x, out) and x.ctypes.data != out.ctypes.data:
            raise ValueError("`out` must be `x` itself or have none of its memory")
        states = x.reshape(-1, self.size)
        commands = np.zeros((1, 0)) if u is None else u.reshape(-1, n)
        self._check_torques(u)
        rows = _Rows(states, commands, self._times(self.own_numbers, t, 1), out.reshape(-1, self.size))
        self._run(self.own_numbers, rows, 1)
        return out

    def gradient(
        self,
        x: ArrayLike,
        u: ArrayLike | None = None,
        weights: ArrayLike = 1.0,
        numbers: Mapping[str, ArrayLike] | None = None,
        workers: int = 1,
        *,
        t: ArrayLike = 0.0,
    ) -> dict[str, Array]:
        """Derivatives of weights . x_next by reverse mode (vector-Jacobian products): the adjoint of the steps.

        Parameters
        ----------
        x, u : array_like
            As for a call.
        weights : array_like, shape (size,) or that of x
            Derivatives of a cost by the states at the end, such as the gradient of the next interval.
        numbers, workers, t : optional
            As for a call.

        Returns
        -------
        dict of str to ndarray
            With respect to "x", shape of x, "u", (n,) or (N, n), where torques are given, and the names of `numbers`,
            in their shapes for each state; units of the cost over those of the name.

        Raises
        ------
        ValueError, KeyError, TypeError, NotFiniteError, SingularMassMatrixError
            As for a call; also if `weights` has the wrong shape or is not finite.

        Notes
        -----
        It takes 2.5 to 3 times as long as a call. Where torques are at a limit, or a joint at the end of its range,
        derivatives are those of that side. Sandu 2006, On the properties of Runge-Kutta discrete adjoints, equation 4.
        """
        states = self._states("x", x)
        N, given = len(states), self._numbers(numbers, len(states))
        frozen, names = given.frozen, given.frozen.names
        rows = _Rows(states, self._torques(u, N), self._times(given, t, N), np.empty_like(states))
        if len(rows.t) > 1 and any(frozen.samples_of(name) for name in names):
            raise ValueError("`t` must be one number for derivatives by the samples of a motion")
        lanes = self._lanes(given, derive=True)
        others = np.zeros((N, len(lanes.slopes.others) // lanes.count))
        given.pools[True].append(lanes)
        wanted = self._as_states("weights", weights, np.shape(x)).reshape(states.shape)
        self._run(given, rows._replace(weights=wanted.astype(np.float64, order="C"), others=others), workers)
        found, first, parts = {"x": rows.out}, frozen.commanded * frozen.is_driven, dict[str, Array]()
        if frozen.is_driven:
            found["u"] = others[:, :first]
        for name in OTHERS:
            shape = getattr(lanes.slopes.adjoint, name).shape
            last = first + prod(shape) // lanes.count
            parts[name] = flat(others[:, first:last]).reshape(*shape[:-1], shape[-1] // lanes.count * N)
            first = last
        found |= frozen.by_numbers(names, N, lanes.slopes.adjoint._replace(**parts))
        return {name: a.reshape(*np.shape(x)[:-1], *a.shape[1:]) for name, a in found.items()}

    def jacobian(
        self,
        x: ArrayLike,
        u: ArrayLike | None = None,
        numbers: Mapping[str, ArrayLike] | None = None,
        workers: int = 1,
        *,
        t: ArrayLike = 0.0,
    ) -> Array:
        """Derivatives of the states at the end by those at the begin and by torques.

        Parameters
        ----------
        x, u : array_like
            As for a call.
        numbers, workers, t : optional
            As for a call.

        Returns
        -------
        ndarray, shape (size, size + n) or (N, size, size + n)
            Rows of d x_next / d (x, u); under a controller (..., size, size).

        Raises
        ------
        ValueError, KeyError, TypeError, NotFiniteError, SingularMassMatrixError
            As for a call.

        Notes
        -----
        A row is a gradient: it takes `size` times as long as `gradient`.
        """
        states, size = self._states("x", x), self.size
        known = self.scene.numbers

        def repeated(value: Any, axes: int) -> Any:
            return value if np.ndim(value) <= axes else np.repeat(value, size, axis=0)

        own = {name: repeated(value, known[name].ndim) for name, value in _named(numbers).items()}
        each = np.repeat(states, size, axis=0), repeated(u, 1) if u is not None else None
        found = self.gradient(*each, np.tile(np.eye(size), (len(states), 1)), own, workers, t=repeated(t, 0))
        rows = np.concatenate([found[name] for name in ("x", "u") if name in found], axis=1)
        return rows.reshape(*np.shape(x)[:-1], size, rows.shape[1])

    def to_casadi(self, name: str = "step", *, symbolic: str = "SX", numbers: Sequence[str] = ()) -> Any:
        """CasADi function of the interval.

        Parameters
        ----------
        name : str
            Name of the function.
        symbolic : {"SX", "MX"}
            Scalar operations, or calls of a function of such.
        numbers : sequence of str
            Names of `Scene.numbers` that are arguments.

        Returns
        -------
        casadi.Function
            Of x, of torques u, or with a controller of t, of the `piece` of samples that it follows, and of numbers,
            whose names have _ instead of signs other than letters and digits; it gives x_next. It checks nothing.

        Raises
        ------
        ImportError, ValueError, TypeError
            If CasADi is missing or does not allow the name, or the equations are too large to be written out.
        """
        from .step_exports import interval_to_casadi

        return interval_to_casadi(self, name, symbolic, numbers)

    def to_jax(self) -> Callable[..., Any]:
        """JAX function of the interval, with its reverse-mode derivatives, for jit, grad, vjp and vmap.

        Returns
        -------
        callable
            As a call, of (x, u=None, numbers=None, t=0.0) with states (..., size), in their dtype. XLA calls this
            stepper on the host; derivatives, of first order, are by x, u and numbers.

        Raises
        ------
        ImportError
            If JAX is not installed.
        """
        from .step_exports import interval_to_jax

        return interval_to_jax(self)

    def source(self, language: str = "c", name: str = "step") -> str:
        """Source text of the interval: functions for dx/dt and for a sampled law, and the loop around them.

        Parameters
        ----------
        language : {"c"}
            C99.
        name : str
            Name of the function.

        Returns
        -------
        str
            ``void step(const double *t, const double *x, const double *u, double *x_next)``; u without a controller.
            It checks nothing, allocates nothing, and gives NaN outside the samples that a law follows.

        Raises
        ------
        ValueError
            For any other language, or a name that is none in C.
        TypeError
            If the equations are too large to be written out.
        """
        from .step_exports import interval_to_c

        if language != "c":
            raise ValueError(f"`language` must be 'c', got {language!r}")
        if not name.isidentifier() or not name.isascii():
            raise ValueError(f"`name` must be letters, digits and underscores after a letter, got {name!r}")
        return interval_to_c(self, name)

    def _states(self, name: str, x: ArrayLike) -> Array:
        """States as rows."""
        array = convert_numbers(name, x, f"(N, {self.size})")
        if array.dtype.kind != "f" or array.ndim not in (1, 2) or array.shape[-1] != self.size:
            raise ValueError(f"`{name}` must be real, of shape ({self.size},) or (N, {self.size}), got {array.shape}")
        return np.ascontiguousarray(array.reshape(-1, self.size), dtype=np.float64)

    def _as_states(self, name: str, given: ArrayLike, shape: tuple[int, ...]) -> Array:
        """Values for states of a shape: one number, of one state or of all."""
        array = real_numbers(name, given, f"(N, {self.size})")
        if array.shape not in ((), (self.size,), shape):
            raise ValueError(f"`{name}` must have shape ({self.size},) or {shape}, got {array.shape}")
        return np.broadcast_to(array, shape)

    def _check_torques(self, u: ArrayLike | None) -> None:
        n, has_law = self.scene.n, self.scene.controller is not None
        if u is None and not has_law:
            raise ValueError(f"`u` must be given, torques of shape ({n},) or (N, {n}): the scene has no controller")
        if u is not None and has_law:
            raise ValueError("`u` cannot be given for a scene that has a controller")

    def _torques(self, u: ArrayLike | None, count: int) -> Array:
        """Torques as rows, or one row for all; (1, 0) under a controller."""
        self._check_torques(u)
        n = self.scene.n
        if u is None:
            return np.zeros((1, 0))
        array = real_numbers("u", u, f"(N, {n})")
        if array.shape not in ((n,), (count, n)):
            raise ValueError(f"`u` must have shape ({n},) or ({count}, {n}), got {array.shape}")
        return np.ascontiguousarray(array.reshape(-1, n), dtype=np.float64)

    def _times(self, given: _Numbers, t: ArrayLike, count: int) -> Array:
        """Times as rows, within the samples that a law follows."""
        array = real_numbers("t", t, "(N,)")
        if array.shape not in ((), (count,)):
            raise ValueError(f"`t` must be one number or of shape ({count},), got {array.shape}")
        if array.size:
            given.side.check_within_samples(array.min(), array.max() + self.sample_time, array.max())
        return np.ascontiguousarray(array.reshape(-1, 1), dtype=np.float64)

    def _numbers(self, numbers: Mapping[str, ArrayLike] | None, count: int) -> _Numbers:
        """Numbers instead of the scene's, checked; the last ones are cached."""
        numbers = _named(numbers)
        if not numbers:
            return self.own_numbers
        names = tuple(numbers)
        if (last := self._known.get(names)) is not None and last.is_of(numbers, count):
            return last
        for name in ("delay", "torque_rate"):
            if name in numbers:
                raise ValueError(f"`numbers` cannot have {name!r}, on which the state depends: make another Stepper")
        scene, own = common_and_own(self.scene, numbers, count, "`numbers['friction.smoothing']` must be above 0")
        frozen = self._frozen(scene, names)
        if any(frozen.samples_of(name) for name in own):
            raise ValueError("`numbers` must have the samples of a motion once for all states")
        given = {name: np.array(x) for name, x in numbers.items()}
        found = self._known[names] = _Numbers(frozen, own, given)
        return found

    def _lanes(self, numbers: _Numbers, *, derive: bool) -> _Lanes:
        """Rows side by side that no other thread uses."""
        pool = numbers.pools[derive]
        try:
            return pool.pop()
        except IndexError:
            return _Lanes(self, numbers, LANES if self._by_machine else 1, by_machine=self._by_machine, derive=derive)

    def _run(self, numbers: _Numbers, rows: _Rows, workers: int) -> None:
        """Compute rows, in machine code in threads that take a range each, otherwise by NumPy."""
        count, derive = len(rows.x), rows.weights.size > 0
        left = np.zeros(count, np.int64) if self._by_machine else np.ones(count, np.int64)

        def stretch(ends: tuple[int, int]) -> None:
            lanes = self._lanes(numbers, derive=derive)
            lanes.run(rows, *ends, left)
            numbers.pools[derive].append(lanes)

        groups = -(-count // LANES)
        workers = min(whole_number("workers", workers), groups)
        if self._by_machine and workers <= 1:
            stretch((0, count))
        elif self._by_machine:
            edges = [min(LANES * (groups * k // workers), count) for k in range(workers + 1)]
            with ThreadPoolExecutor(workers) as threads:
                list(threads.map(stretch, pairwise(edges)))
        if left.any():
            self._by_numpy(numbers, rows, np.flatnonzero(left))

    def _by_numpy(self, numbers: _Numbers, rows: _Rows, some: Array) -> None:
        """Compute some rows by NumPy; errors are those of the first row that fails."""
        part, derive = rows.part(some), rows.weights.size > 0
        own = _Numbers(numbers.frozen, numbers.part(some), {})
        try:
            for name, array in (("x", part.x), ("u", part.u)):
                if not np.isfinite(array).all():
                    raise NotFiniteError(f"`{name}` is not finite")
            lanes = _Lanes(self, own, len(some), by_machine=False, derive=derive)
            lanes.run(part, 0, len(some), np.zeros(len(some), np.int64))
            if not (np.isfinite(part.out).all() and np.isfinite(part.others).all()):
                raise NotFiniteError("the result overflows")
        except (NotFiniteError, SingularMassMatrixError) as error:
            for k in some if len(some) > 1 else []:
                self._by_numpy(numbers, rows, np.array([k]))  # the first one at fault raises its error
            state = (int(some[0]),) if len(rows.x) > 1 else ()
            if isinstance(error, SingularMassMatrixError):
                raise SingularMassMatrixError(error.what, error.cause, error.joints, state) from None
            raise NotFiniteError(error.args[0], error.time, state) from None
        rows.out[some] = part.out
        if derive:
            rows.others[some] = part.others


def _named(numbers: Mapping[str, ArrayLike] | None) -> dict[str, ArrayLike]:
    """Numbers by name."""
    if not isinstance(numbers, Mapping | None):
        raise TypeError(f"`numbers` must be a mapping of names to arrays, got {type(numbers).__name__}")
    return dict(numbers or {})


def _period(scene: Scene, sample_time: float | None) -> float:
    """Length of the interval."""
    own = scene.sample_time
    if sample_time is None and own is None:
        raise ValueError("`sample_time` must be given: the scene has none")
    period = float(own) if sample_time is None else positive_number("sample_time", sample_time)  # type: ignore[arg-type]
    if own is not None and period != own:
        raise ValueError(f"`sample_time` must be that of the scene, {own:g} s, or left out, got {period:g}")
    return period
