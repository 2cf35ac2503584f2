"""Control laws: their calls, and their traces as part of a scene's kernel or as kernels themselves."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import fields, is_dataclass, replace
from functools import cache, cached_property
from threading import RLock
from typing import Any, NamedTuple, Self
from weakref import WeakValueDictionary

import numpy as np

from ..basics.arrays import check_function, copy_with, read_only, whole_number
from ..basics.numbers import WithNumbers, is_input
from ..basics.piecewise import NO_TABLE, NO_TABLES, pieces_at, tables_of
from ..basics.spatial import Array
from ..dynamics.quantity import MethodQuantity, Quantity
from ..graph.graph import Graph
from ..graph.scalar import inputs, is_traced, references
from ..kernels.cache import KernelCache
from ..kernels.kernel import Kernel, with_table
from ..kernels.trace import AGREEMENT, LIMIT, TRIALS
from ..model.model import Model
from ..model.topology import where_loops_close
from ..robot import Robot, robot_argument
from .law_numbers import OnRows, law_at, law_with, models_of, motion_of, numbers_of, parts_of


def check_law(name: str, law: Any) -> None:
    """Raise an error if a law cannot be called with its arguments, has no number of states, or is discrete without."""
    has_states = hasattr(law, "states") and not isinstance(law, type)
    check_function(name, law, "(t, q, qd, z), as it has `states`" if has_states else "(t, q, qd)")
    if has_states:
        whole_number(f"{name}.states", law.states, least=0)
    marked = getattr(law, "discrete", False)
    if not isinstance(marked, bool | np.bool_):
        raise TypeError(f"`{name}.discrete` must be True or False, got {type(marked).__name__}")
    if marked and not has_states:
        raise ValueError(f"`{name}` is discrete, which is how its states change: it needs an attribute `states`")
    if is_dataclass(law) and "discrete" in getattr(law, "__dict__", {}).keys() - {part.name for part in fields(law)}:
        raise ValueError(f"`{name}.discrete` must be in the class or a field: a copy of a dataclass has nothing else")


def is_discrete(law: Any) -> bool:
    """True for a law that returns its states at the next sample instead of their rates."""
    return bool(getattr(law, "discrete", False))


def check_sample_time(law: Any, sample_time: float | None, name: str = "controller") -> None:
    """Raise a ValueError if a discrete law has another sample time than what calls it."""
    own = getattr(law, "sample_time", sample_time) if is_discrete(law) else sample_time
    if isinstance(own, float | int) and own != sample_time:
        raise ValueError(f"`sample_time` must be that of the {name}, {own:g} s, got {sample_time:g} s")


_locks: WeakValueDictionary[int, Any] = WeakValueDictionary()  # by the id of what holds a law's state
_guard = RLock()


def one_at_a_time(law: Any) -> Any:
    """Lock that keeps other threads from running a law with memory; a null context for None."""
    if law is None:
        return nullcontext()
    with _guard:
        return _locks.setdefault(id(getattr(law, "__self__", law)), RLock())


class LawInputs(NamedTuple):
    """The coordinates of a state that a law is given, from `first` to before `last` of `coordinates`."""

    first: int
    last: int
    coordinates: int


def is_ours(law: Any) -> bool:
    """True for the laws of rne.control."""
    return type(law).__module__.startswith("rne.control.")


def call_law(law: Any, t: Any, x: Array, given: LawInputs) -> tuple[Any, Any]:
    """Torques of a law in a state (q, qd, z), and rates of z, or of a discrete law the next z; None without states."""
    first, last, n = given
    q, qd = x[..., first:last].copy(), x[..., n + first : n + last].copy()  # a law may modify its arguments
    if not hasattr(law, "states"):
        return law(t, q, qd), None
    returned = law(t, q, qd, x[..., 2 * n : 2 * n + int(law.states)].copy())
    if not isinstance(returned, tuple) or len(returned) != 2 or returned[1] is None:
        got = f"a tuple of {len(returned)}" if isinstance(returned, tuple) else type(returned).__name__
        got = "(torques, None)" if got == "a tuple of 2" else got
        kind, wanted = ("discrete", "its next states") if is_discrete(law) else ("with states", "rates of its states")
        raise ValueError(f"`controller` {kind} must return (torques, {wanted}), got {got}")
    return returned


def changed(law: Any) -> None:
    """Mark laws as changed, so that they are traced anew at their next run; for changes that formulas do not show.

    Before each run a scene compares the formula of a traced law with that of its kernel, so that any change of what the
    law reads is noticed. The page on control laws lists the few changes that are not: report them by this function.

    Parameters
    ----------
    law : callable
        The law that was changed, or one that uses what was changed.

    Raises
    ------
    TypeError
        If `law` is not a function.

    Examples
    --------
    >>> import rne
    >>> damper = rne.traceable(lambda t, q, qd: -5.0 * qd)
    >>> rne.control.changed(damper)
    """
    if not callable(law):
        raise TypeError(f"`law` must be a function, got {type(law).__name__}")
    TracedLaw.changes += 1


class TracedLaw(WithNumbers):
    """A law marked by `rne.traceable`, for the kernels of a scene; laws of the same formula are equal.

    It is called with all coordinates of n joints, or with those of `given`. A motion through samples that it holds is a
    `table` of pieces; a kernel of the law takes the row for its time as the argument `piece`.
    """

    changes = 0  # number of calls of `changed`
    piece: Array | None = None  # rows (..., width) that take the place of the motion, traced or not

    def __init__(self, law: Any, n: int, given: LawInputs | None = None, named: frozenset[str] = frozenset()) -> None:
        self.law, self.n, self.states, self.discrete = law, n, int(getattr(law, "states", 0)), is_discrete(law)
        self.given, self.named = given or LawInputs(0, n, n), named
        self.size = 2 * self.given.coordinates + self.states
        self.motion = motion_of(law)
        self.table: Array = NO_TABLE if self.motion is None else self.motion[1].table
        found, formula = self._with_inputs()
        self.numbers = read_only(found)
        self.formula = self.changes, formula
        masks = tuple((k, m.tobytes()) for k, m in self.masks.items())
        self._key = self.n, self.given, self.formula, self.discrete, masks
        self._hash = hash(self._key) if formula is not None else id(law)

    def __reduce__(self) -> tuple[Any, ...]:
        return TracedLaw, (self.law, self.n, self.given, self.named)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, TracedLaw):
            return NotImplemented
        if self.formula[1] is None:
            return self.law is other.law and self._key == other._key
        return self._hash == other._hash and self._key == other._key

    def __hash__(self) -> int:
        return self._hash

    def _with_inputs(self) -> tuple[dict[str, Array], tuple[Any, ...] | None]:
        """The numbers of the law that can be traced, and its formula with them as inputs."""
        every, none = numbers_of(self.law), dict[str, Array]()
        every |= models_of(self.law, self.named)
        formula = self._formula(every)
        if formula is not None or not every:
            return every, formula
        without = self._formula(none)
        if without is None:
            return none, None
        # a law may branch on some of them, which stay constants
        taken = {name: x for name, x in every.items() if self._formula({name: x}) is not None}
        formula = self._formula(taken)
        return (none, without) if formula is None else (taken, formula)

    def at(self, numbers: Mapping[str, Any]) -> Self:
        """The law with other numbers of some names, which may be traced."""
        own = {name: x for name, x in numbers.items() if name in self.numbers}
        values = {name: x for name, x in own.items() if not is_traced(x)}
        return copy_with(self, law=law_at(self.law, own), numbers=self.numbers | values, masks=self.masks)

    @classmethod
    def known(cls, law: Any, n: int, given: LawInputs, named: frozenset[str], kernels: KernelCache) -> TracedLaw:
        """Law as a key of a scene's kernels: laws of this package that differ only in numbers share one.

        Not all that other laws read can be seen, so that their formulas are compared.
        """
        held = parts_of(law) if is_ours(law) else {"": law}
        motion, own = motion_of(law), dict[str, Any]()
        if motion is not None:
            own = {"motion": motion, "table": motion[1].table}
            held[motion[0]] = f"{motion[1].table.shape[1]} {motion[1].samples.shape[1]}"
        numbers = numbers_of(law)
        others = {name: part for name, part in held.items() if name not in numbers}
        is_known = all(part is None or isinstance(part, bool | int | str | Robot) for part in others.values())
        if not is_known or models_of(law, named):
            return cls(law, n, given, named)
        masks = {name: is_input(x, named=name in named) for name, x in numbers.items()}
        structure = [(name, x.shape, masks[name].tobytes(), x[~masks[name]].tobytes()) for name, x in numbers.items()]
        key = type(law), n, given, named, cls.changes, is_discrete(law), *structure, *others.items()
        found: TracedLaw = kernels.laws.get(key) or kernels.laws.get_or_make(key, lambda: cls(law, n, given, named))
        constant = numbers.keys() - found.numbers.keys()  # those that it branches on
        theirs = numbers_of(found.law) if constant else {}
        if not all(np.array_equal(numbers[name], theirs[name]) for name in constant):
            return cls(law, n, given, named)
        numbers = read_only({name: numbers[name] for name in found.numbers})
        return copy_with(found, law=law, numbers=numbers, **own)

    def tables(self, own: Mapping[str, Array]) -> Array:
        """Tables (1, N, width) of the law's motion, or of other motions by its name; (0, 0, 0) without one."""
        if self.motion is None:
            return NO_TABLES
        name, motion = self.motion
        return tables_of(motion, own[name]) if name in own else self.table[None]

    def on_piece(self, piece: Array | None) -> TracedLaw:
        """Law with its motion replaced by rows of its table, traced or not, (..., width)."""
        return self if piece is None or self.motion is None else copy_with(self, piece=piece)

    def _formula(self, numbers: Mapping[str, Array]) -> tuple[Any, ...] | None:
        """The operations of the torques, with numbers and the quantities of robots as inputs; None if it has none.

        The formula depends on all that a law reads, wherever it is kept; a search of its attributes would miss some.
        """
        graph, law = Graph(8 * LIMIT, outline=True), copy_with(self, numbers=numbers)
        first, last = 1 + self.size, 1 + self.size + len(law.vector)
        x = inputs(graph, (1, last + self.table.shape[1]), 0)
        try:
            with np.errstate(all="ignore"):
                returned = law.filled(x[0, first:last]).on_piece(x[:, last:])(x[:, :1], x[:, 1:first])
            found = [references(graph, part) for part in returned if part is not None]
        except Exception:  # whatever the law raises for traced numbers: the trace for a kernel reports it
            return None
        if any(kind == "constant" and args[0] != args[0] for kind, args in graph.nodes):  # of a robot without values
            return None
        return (*graph.nodes, *found[0], *found[-1])

    def __call__(self, t: Any, x: Array) -> tuple[Array, Array | None]:
        """(torques, dz/dt or the next z); times have shape (..., 1).

        The law is called with one state at a time, as laws are written for, or with a batch if it gives the same.
        """
        if x.ndim == 1:
            return self._call(np.asarray(t).item(), x, self.piece)
        if x.dtype != object and self._takes_batches:
            return self._call(t, x, self.piece)
        times = np.broadcast_to(t, (*x.shape[:-1], 1)).reshape(-1)
        pieces = [None] * len(times) if self.piece is None else self.piece.reshape(len(times), -1)
        found = [self._call(*state) for state in zip(times, x.reshape(-1, x.shape[-1]), pieces, strict=True)]
        u = np.array([torques for torques, _ in found]).reshape(*x.shape[:-1], -1)
        return u, None if found[0][1] is None else np.array([r for _, r in found]).reshape(*x.shape[:-1], -1)

    def _call(self, t: Any, x: Array, piece: Array | None = None) -> tuple[Array, Array | None]:
        """The law's torques and what it returns for z with one row per state, where a constant is repeated."""
        law = self.law
        if piece is not None and self.motion is not None:
            name, motion = self.motion
            law = law_with(law, {name: OnRows(piece, motion.samples.shape[1])})
        u, of_states = call_law(law, t, x, self.given)
        try:
            torques = np.asarray(u)
        except ValueError:
            torques = np.asarray(None)
        shape = x.shape[:-1] + (self.n,)
        if torques.shape != shape and (torques.shape != (self.n,) or (torques.dtype == object and self.n == 0)):
            raise ValueError(
                f"`controller` must return shape (..., {self.n}) for states of that shape, got {torques.shape}"
            )
        if torques.dtype == object and x.dtype != object:  # numbers in an array of objects, as a law may build
            torques = torques.astype(x.dtype)
        of_states = None if of_states is None else self._per_state(np.asarray(of_states), x)
        return torques if torques.shape == shape else torques + 0 * x[..., : self.n], of_states

    def _per_state(self, of_states: Array, x: Array) -> Array:
        """Results of the law for its own states, with one row per state of the motion."""
        shape = x.shape[:-1] + (self.states,)
        if of_states.shape not in (shape, (self.states,)):
            what = "next states" if self.discrete else "rates of its states"
            raise ValueError(f"`controller` must return {what} of shape ({self.states},), got {of_states.shape}")
        return of_states if of_states.shape == shape else of_states + 0 * x[..., : self.states]

    @cached_property
    def _takes_batches(self) -> bool:
        """True if the law gives the same for a batch of states as for each of them."""
        count = self.n + 1  # a matrix (n, n) times so many states fails
        t, X = self._trials(count)
        try:
            together = self.row(self._call(t, X))
            single = [self.row(self._call(float(s[0]), x)) for s, x in zip(t, X, strict=True)]
        except Exception:  # whatever the law raises
            return False
        if together.shape != (count, self.n + self.states) or together.dtype != np.float64:  # times in one entry
            return False
        return np.allclose(together, single, rtol=AGREEMENT, atol=AGREEMENT)

    @property
    def piece_width(self) -> dict[str, int | None]:
        """Width of the argument `piece` by its name, empty without one."""
        return {"piece": self.table.shape[1]} if len(self.table) else {}

    @cached_property
    def outputs(self) -> MethodQuantity:
        """[torques, dz/dt or the next z] as a function of time and state, to be traced."""
        widths: dict[str, int | None] = {"t": 1, "x": self.size, **self.piece_width}
        widths["numbers"] = len(self.vector)
        how: dict[str, Any] = {"moments": True, "base_parameters": True, "of_run": "numbers"}
        traced = Quantity(name="controller", core=self._core, widths=widths, **how)
        return MethodQuantity(self, traced, "the controller")

    def _core(self, model: Model, t: Array, x: Array, numbers: Any = None, piece: Array | None = None) -> Array:
        law = self.on_piece(piece)
        if numbers is None:
            return self.row(law(t, x))
        given, width = np.asarray(numbers), len(self.vector)
        rows = given.reshape(-1, width) if width else np.zeros((1, 0))
        if rows.dtype == object or (rows == rows[:1]).all():
            return self.row(law.filled(rows[0])(t, x))
        pieces = [None] * len(t) if piece is None else piece
        each = zip(rows, t, x, pieces, strict=True)
        return np.array([self.row(self.filled(v).on_piece(p)(s, y)) for v, s, y, p in each])

    @staticmethod
    def row(returned: tuple[Array, Array | None]) -> Array:
        u, of_states = returned
        return u if of_states is None else np.concatenate([u, of_states], axis=-1)

    def core_of_joints(
        self, model: Model, t: Array, q: Array, qd: Array, z: Array | None = None, piece: Array | None = None
    ) -> Array:
        """[torques, dz/dt or the next z] as a function of time, q, qd, z and the piece of its motion."""
        return self._core(model, t, np.concatenate([q, qd] if z is None else [q, qd, z], axis=-1), piece=piece)

    def why_not_traced(self, kernels: KernelCache) -> str | None:
        """Reason why the law must be called: it cannot be traced, or its trace differs from calls. None if traced.

        Each law is compared with its trace once; of this package's laws one of each formula.
        """
        if self.formula[1] is None:
            return self._why_not_traced(kernels)
        ours = is_ours(self.law) and not any(
            getattr(part, "traceable", False) and not type(part).__module__.startswith("rne.")
            for part in parts_of(self.law).values()
        )
        key = self, None if ours else id(self.law)  # which is alive as long as it is part of a key
        found = kernels.reasons.get(key)
        if found is None:
            found = kernels.reasons.get_or_make(key, lambda: self._why_not_traced(kernels) or "")
        return found or None

    def _why_not_traced(self, kernels: KernelCache) -> str | None:
        try:
            worst = self._error_of_trace(kernels)
        except Exception as error:  # whatever the law raises when it meets traced numbers
            cause = error.__cause__ if isinstance(error.__cause__, TypeError) else error  # NumPy's is about sequences
            return f"{type(cause).__name__}: {cause}".splitlines()[0]
        if worst <= AGREEMENT:
            return None
        return f"traced, it differs by {worst:.3g} from a call: it has memory, noise or a branch"

    def _error_of_trace(self, kernels: KernelCache) -> float:
        """Largest difference between traced and called torques in some states, relative where they exceed 1."""
        kernel, (t, x), model = kernels.scene_kernel(self.outputs), self._trials(TRIALS), kernels.model
        x = np.concatenate([where_loops_close(model, x[:, : self.n]), x[:, self.n :]], axis=1)
        with np.errstate(all="ignore"):
            called = self._core(model, t, x)
        if called.dtype != np.float64 or not np.isfinite(called).all():
            called, _ = self.outputs.evaluate(model, t, x, *pieces_at(self.table, t), self.vector)  # names the error
        scales, traced = np.abs(called).max(axis=1, initial=1.0), kernel(t, x, *pieces_at(self.table, t), self.vector)
        return float((np.abs(traced - called).max(axis=1, initial=0.0) / scales).max())

    def _trials(self, count: int) -> tuple[Array, Array]:
        """Times and states in which the law is compared with its trace."""
        t, x = _trials(count, self.size)
        return (self.table[0, 0] + t * (self.table[-1, 1] - self.table[0, 0]), x) if len(self.table) else (t, x)


@cache
def _trials(count: int, size: int) -> tuple[Array, Array]:
    """Random times and states in which a law is compared with its trace."""
    rng = np.random.default_rng(0)
    return rng.uniform(0, 1, (count, 1)), rng.uniform(-1, 1, (count, size))


def compiled(law: Any, robot: Robot | None = None, *, engine: str | None = None) -> Kernel:
    """A control law as a kernel of t, q and qd: machine code, which takes a microsecond, or source text.

    Parameters
    ----------
    law : callable
        One of this package's laws, or one marked by `rne.traceable`.
    robot : Robot, optional
        The law's own if not given.
    engine : {"numpy", "numba"}, optional
        The robot's engine if not given.

    Returns
    -------
    Kernel
        Of t, shape (..., 1), and q and qd, shape (..., n), and of z, shape (..., m), for a law with states. It gives
        torques, followed by the m rates of the states, or of a discrete law the m states at the next sample: shape
        (..., n + m). `Kernel.into` writes them without allocation, `Kernel.source` prints them. Without limits: clip
        the torques to what your drives bear. Where the law holds a motion through samples, the last argument is the
        motion's `piece` at t: a call finds it if it is left out; for `into` use `kernel.piece(t)`, and in C the
        function that is printed with the kernel.

    Raises
    ------
    TypeError
        If the law is not marked as traceable, cannot be traced, is too large, or no robot is known.

    Examples
    --------
    >>> import numpy as np, rne
    >>> arm = rne.load("irb140")
    >>> law = rne.control.compiled(rne.control.pd_gravity(arm, 50, 20, 0))
    >>> law(np.zeros(1), np.full(6, 0.1), np.zeros(6)).round(1)[0].item()
    -5.0
    """
    check_law("law", law)
    known = robot_argument(getattr(law, "robot", None) if robot is None else robot)
    if not getattr(law, "traceable", False):
        raise TypeError("`law` must be marked by rne.traceable")
    traced = TracedLaw(law, known.n)
    reason = traced.why_not_traced(known.kernels)
    if reason is not None:
        raise TypeError(f"`law` cannot be traced: {reason}")
    widths: dict[str, int | None] = {"t": 1, "q": known.n, "qd": known.n}
    widths |= {"z": traced.states} if traced.states else {}
    widths |= traced.piece_width
    declared = replace(traced.outputs.quantity, name="control_law", core=traced.core_of_joints, widths=widths)
    kernel = Kernel(MethodQuantity(traced, declared, "the law"), known.model, {}, engine=engine or known.engine)
    _ = kernel.traced  # raises the TypeError of a law that is too large
    return with_table(kernel, traced.table)
