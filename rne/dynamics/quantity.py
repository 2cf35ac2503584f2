"""Declaration of a public quantity: check the arguments, run the core, check the result.

A core is the recursion itself. It takes finite arrays of one dtype and one leading shape, and never branches on a
value. `function.core` is that recursion, which can be read, tested and traced separately.

Arguments named q, qd, qdd, qdr, qddr and tau are joint arrays, checked and traced; a quantity may also have those in
OPTIONS, such as `external` (wrenches by link) and `link`. For a kernel the wrenches become arrays too, see
`rne.kernels.trace`. `evaluate` also takes `parameters`, inertial parameters instead of the model's.
"""

from __future__ import annotations

import functools
import inspect
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Concatenate, NamedTuple, ParamSpec, Protocol, TypeVar, cast

import numpy as np

from ..basics.arrays import is_finite, number_array
from ..basics.inertia import PARAMETERS
from ..basics.spatial import Array
from ..errors import NotFiniteError, PrecisionWarning, SingularMassMatrixError
from ..model.model import Model, joint_array, model_argument
from ..model.parameters import at_parameters
from ..model.topology import check_closure

BatchIndex = tuple[int, ...]  # of a state in a batch; empty for a single state
Solved = tuple[Array, Array, Array]  # result, pivots of M, and diagonal of M


class PrecisionLoss(NamedTuple):
    """State of a call with the fewest decimal digits left, and the reason."""

    digits: float
    state: BatchIndex
    cause: str
    what: str = "forward dynamics keep"

    def __str__(self) -> str:
        where = f" at state {self.state}" if self.state else ""
        return f"{self.what} about {self.digits:.0f} digits{where}: {self.cause}; see Robot.diagnose"


class PrecisionStatus(NamedTuple):
    """Error or warning that belongs to a result; neither for a result that keeps its digits.

    `raise_or_warn` raises or warns. It is called once, by the function that the user called.
    """

    error: SingularMassMatrixError | None = None
    loss: PrecisionLoss | None = None

    def raise_or_warn(self, stacklevel: int) -> None:
        """Raise the error or warn of the loss; `stacklevel` counts frames up from the caller of this method."""
        if self.error is not None:
            raise self.error
        if self.loss is not None:
            warnings.warn(str(self.loss), PrecisionWarning, stacklevel=stacklevel + 1)

    def with_state(self, place: Callable[[BatchIndex], BatchIndex]) -> PrecisionStatus:
        """Status of the state at another index, such as its place in the batch that a block is part of."""
        error = self.error
        if error is not None:
            error = SingularMassMatrixError(error.what, error.cause, error.joints, place(error.state))
        loss = None if self.loss is None else self.loss._replace(state=place(self.loss.state))
        return PrecisionStatus(error, loss)

    def worse(self, other: PrecisionStatus) -> PrecisionStatus:
        """Worse of two statuses: an error before a loss, fewer digits before more."""

        def rank(status: PrecisionStatus) -> tuple[bool, float]:
            return status.error is None, float("inf") if status.loss is None else status.loss.digits

        return min(self, other, key=rank)


OK = PrecisionStatus()

P = ParamSpec("P")
R = TypeVar("R")
T_co = TypeVar("T_co", covariant=True)

# (model, arguments, result, pivots, diagonal of M) -> PrecisionStatus
Check = Callable[[Model, Mapping[str, Any], Array, Array, Array], PrecisionStatus]

JOINT_ARGUMENTS = ("q", "qd", "qdd", "qdr", "qddr", "tau")
OPTIONS = ("external", "link", "point", "rows", "damping", "axes")


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """Declaration of a function of a model: its arguments, what its core returns, what tracing may assume.

    core(model, *arrays, **options) gives the result, or (result, pivots of M, diagonal of M) if there is a `check`,
    which turns the pivots into a PrecisionStatus. `moments`: the result depends on the inertial parameters only through
    `model.moments`, so that they may be inputs of a kernel (`rne.kernels.trace`). `base_parameters`: only through the
    base parameters, so that masses may be redistributed between bodies (``rne/model/parameters.py``). `analytic`:
    complex steps give its derivatives, on robots without couplings.
    """

    name: str
    core: Callable[..., Any]
    widths: Mapping[str, int | None]  # of the arrays it takes, in order; None for one entry per coordinate
    moments: bool
    base_parameters: bool
    check: Check | None = None
    velocities: tuple[str, slice] | None = None  # entries that are joint velocities, whose squares may cancel
    returns_array: bool = True  # False for a record, which is not traced
    wrenches: Mapping[str, str] = field(default_factory=dict)  # arrays of a kernel that are wrenches, with their links
    analytic: bool = False
    of_run: str | None = None  # argument that is constant over a run: what depends only on it is computed once

    def require_moments(self) -> None:
        """Raise a TypeError if inertial parameters cannot be an input."""
        if not self.moments:
            raise TypeError(f"rne.dynamics.{self.name} takes no inertial parameters as an input")


class Declared(Protocol):
    """Function or object with a Quantity, which can be evaluated with numbers."""

    @property
    def quantity(self) -> Quantity: ...

    def evaluate(self, model: Model, *args: Any, **kwargs: Any) -> tuple[Any, PrecisionStatus]: ...


@dataclass(frozen=True)
class MethodQuantity:
    """Method of an object as a Quantity; equal to that of an equal object, so that caches of kernels find it."""

    owner: Any
    quantity: Quantity = field(compare=False)
    title: str = field(compare=False)  # for errors
    name: str = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.quantity.name)

    def evaluate(
        self, model: Model, *arguments: Any, parameters: Array | None = None, **named: Any
    ) -> tuple[Array, PrecisionStatus]:
        """Value of the function by the recursion, with its PrecisionStatus; NotFiniteError where it overflows."""
        named |= dict(zip(self.quantity.widths, arguments, strict=False))
        given = {name: np.asarray(named[name]) for name in self.quantity.widths if named.get(name) is not None}
        leading = np.broadcast_shapes(*(a.shape[:-1] for a in given.values()))  # a complex step changes one of them
        dtype, status = np.result_type(*given.values()), OK
        given = {k: np.broadcast_to(a.astype(dtype, copy=False), leading + a.shape[-1:]) for k, a in given.items()}
        model = model_for(model, dtype, list(given.values()))
        if model.couplings and (state := given.get("q", given.get("x"))) is not None:
            check_closure(model, state[..., : model.n])
        model = model if parameters is None else at_parameters(model, np.asarray(parameters))
        with np.errstate(all="ignore"):
            result = self.quantity.core(model, **given)
            if self.quantity.check is not None:
                result, *pivots = result
                status = self.quantity.check(model, given, result, *pivots)
        if status.error is None:
            check_result(self.title, result, leading)
        return np.asarray(result), status


class QuantityFunction(Declared, Protocol[P, T_co]):
    """Public function of a model, with its declaration and the bare recursion it wraps."""

    __name__: str
    core: Callable[..., Any]

    def __call__(self, model: Model, *args: P.args, **kwargs: P.kwargs) -> T_co: ...


def quantity(
    *, moments: bool = False, base_parameters: bool = False, returns_array: bool = True, per_mass: bool = False
) -> Callable[[Callable[Concatenate[Model, P], R]], QuantityFunction[P, R]]:
    """Declare a core as a public function whose result is checked for overflow only.

    `base_parameters` includes `moments`. A result `per_mass` is divided by the mass of all moving bodies.
    """

    def decorate(core: Callable[Concatenate[Model, P], R]) -> QuantityFunction[P, R]:
        moved = {"moments": moments or base_parameters, "base_parameters": base_parameters, "per_mass": per_mass}
        return cast("QuantityFunction[P, R]", _declare(core, None, returns_array=returns_array, **moved))

    return decorate


def checked_quantity(
    check: Check, *, moments: bool = True
) -> Callable[[Callable[Concatenate[Model, P], Solved]], QuantityFunction[P, Array]]:
    """Declare a core that returns (result, pivots of M, diagonal of M) as a public function of the result.

    `check` turns pivots and arguments into a PrecisionStatus. Such results depend on base parameters only.
    """

    def decorate(core: Callable[Concatenate[Model, P], Solved]) -> QuantityFunction[P, Array]:
        return cast("QuantityFunction[P, Array]", _declare(core, check, moments=moments, base_parameters=True))

    return decorate


def _declare(core: Callable[..., Any], check: Check | None, *, per_mass: bool = False, **properties: Any) -> Any:
    """Public function of a core, with its Quantity of these properties."""
    signature = inspect.signature(core)
    name = core.__name__
    unknown = signature.parameters.keys() - {"model", *JOINT_ARGUMENTS, *OPTIONS}
    if unknown:
        raise TypeError(f"{name}: arguments must be named {[*JOINT_ARGUMENTS, *OPTIONS]}, got {sorted(unknown)}")

    def evaluate(model: Model, *args: Any, parameters: Any = None, **kwargs: Any) -> tuple[Any, PrecisionStatus]:
        given = signature.bind(model_argument(model), *args, **kwargs).arguments
        del given["model"]
        if parameters is not None:
            public.quantity.require_moments()
            given["parameters"] = parameters
        checked_model, given = check_arguments(model, given)
        if parameters is not None:
            checked_model = at_parameters(checked_model, given.pop("parameters"))
        with np.errstate(all="ignore"):  # the checks below report errors
            result, status = core(checked_model, **given), OK
            if check is not None:
                result, pivots, diagonal = result
                status = check(checked_model, given, result, pivots, diagonal)
        if status.error is None:
            if per_mass:
                check_mass(name, checked_model, given["q"].shape[:-1])
            check_result(name, result, given["q"].shape[:-1])
        return result, status

    @functools.wraps(core)
    def function(model: Model, *args: Any, **kwargs: Any) -> Any:
        result, status = evaluate(model, *args, **kwargs)
        status.raise_or_warn(stacklevel=2)
        return result

    public = cast("Any", function)
    public.core = core
    public.evaluate = evaluate
    public.quantity = Quantity(
        name=name,
        core=core,
        widths={key: None for key in signature.parameters if key in JOINT_ARGUMENTS},
        check=check,
        velocities=("qd", slice(None)) if check is not None and "qd" in signature.parameters else None,
        analytic=core.__module__.startswith(__name__.split(".")[0] + "."),
        **properties,
    )
    return public


def check_arguments(model: Model, given: Mapping[str, Any]) -> tuple[Model, dict[str, Any]]:
    """Finite arrays of one dtype and one leading shape, and the model in that dtype."""
    arrays = {name: joint_array(name, given[name], model) for name in JOINT_ARGUMENTS if name in given}
    if "parameters" in given:
        arrays["parameters"] = joint_array("parameters", given["parameters"], model, PARAMETERS * model.nb)
    external = given.get("external")
    wrenches = {} if external is None else check_external(model, external)
    every = [*arrays.values(), *wrenches.values()]
    dtype = np.result_type(*every)
    leading = common_leading_shape(arrays, wrenches)

    def conform(array: Array) -> Array:
        return np.broadcast_to(array.astype(dtype, copy=False), leading + array.shape[-1:])

    checked_arguments = dict(given) | {name: conform(array) for name, array in arrays.items()}
    if external is not None:
        checked_arguments["external"] = {link: conform(wrench) for link, wrench in wrenches.items()}
    if model.couplings and "q" in arrays:
        check_closure(model, checked_arguments["q"])
    return model_for(model, dtype, every), checked_arguments


def check_external(model: Model, external: Any) -> dict[str, Array]:
    """Check wrenches by link name: shape (..., 6), [moment; force]."""
    if not isinstance(external, Mapping):
        raise ValueError(f"`external` must be a mapping of link name to wrench, got {type(external).__name__}")
    wrenches = {}
    for link, value in external.items():
        if link not in model.link_names:
            raise ValueError(f"`external` must name links of {list(model.link_names)}, got {link!r}")
        name = f"external[{link!r}]"
        wrench = number_array(name, value, "(..., 6)")
        if wrench.ndim == 0 or wrench.shape[-1] != 6:
            raise ValueError(f"`{name}` must have shape (..., 6), [moment; force], got {wrench.shape}")
        wrenches[link] = wrench
    return wrenches


def common_dtype(arrays: Sequence[Array]) -> np.dtype[Any]:
    """Dtype for computations with the arrays, in the machine's byte order."""
    first = arrays[0].dtype
    return first if first.isnative and all(a.dtype is first for a in arrays) else np.result_type(*arrays)


def common_leading_shape(*groups: Mapping[str, Array]) -> tuple[int, ...]:
    """Leading (batch) shape that all arrays broadcast to."""
    named = [item for group in groups for item in group.items()]  # a link may be called q
    leading = [array.shape[:-1] for _, array in named]
    if leading.count(leading[0]) == len(leading):
        return leading[0]
    try:
        return np.broadcast_shapes(*leading)
    except ValueError:
        shapes = ", ".join(f"`{name}` {array.shape}" for name, array in named)
        raise ValueError(f"leading shapes must broadcast against each other, got {shapes}") from None


def model_for(model: Model, dtype: np.dtype[Any], arrays: Sequence[Array]) -> Model:
    """Model in the dtype of the arguments, so that the arithmetic stays in it."""
    if dtype.kind == "O":
        numbers = (x for array in arrays for x in array.flat if hasattr(x, "context"))
        example = next(numbers, None)
        return model if example is None else model.astype(object, example.context.mpf)
    real = np.zeros((), dtype=dtype).real.dtype
    return model if real == model.mass.dtype else model.astype(real)


def check_mass(name: str, model: Model, leading: tuple[int, ...]) -> None:
    """Raise a NotFiniteError for states in which all moving bodies are massless."""
    total = sum((model.body_moments(i)[0] for i in range(model.nb)), np.zeros(1))
    massless = np.broadcast_to((total == 0).all(-1), leading)
    if massless.any():
        state = tuple(np.argwhere(massless)[0].tolist())
        raise NotFiniteError(f"{name}: nothing that moves has a mass", state=state)


def check_result(name: str, result: Any, leading: tuple[int, ...]) -> None:
    """Raise a NotFiniteError for a result with infinity or NaN, which finite arguments give only by overflow."""
    for part in vars(result.known).values() if hasattr(result, "known") else [result]:
        if isinstance(part, np.ndarray) and not is_finite(part).all():
            state = tuple(np.argwhere(~is_finite(part))[0, : len(leading)].tolist())
            text = f"{name} overflows {part.dtype} for these arguments; the result is not finite"
            raise NotFiniteError(text, state=state)
