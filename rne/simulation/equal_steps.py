"""Equal steps of many states by the batch kernel, in chunks that other processes or threads can take."""

from __future__ import annotations

import itertools
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..dynamics.quantity import OK, PrecisionStatus
from ..errors import NotFiniteError, SingularMassMatrixError
from ..kernels.kernel import Kernel
from .equations_of_motion import RightHandSide

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

CHUNK = 8192  # initial states stepped together, so that their states stay in the cache
Progress = Callable[[int, int], Any]


class Chunk(NamedTuple):
    """Initial states, their inertial parameters (of no columns where all have the robot's), and the first's number."""

    x: Array
    parameters: Array
    first: int = 0

    def part(self, begin: int, end: int) -> Chunk:
        """Some of them."""
        return Chunk(self.x[begin:end], self.parameters[begin:end], self.first + begin)


@dataclass(frozen=True, eq=False)
class Plan:
    """The steps that are taken with each chunk of initial states."""

    rhs: RightHandSide
    method: str
    h: float
    steps: int
    spans: int
    with_parameters: bool

    @property
    def kernel(self) -> Kernel:
        """dx/dt, of the chunk's inertial parameters where it has some."""
        return self.rhs.kernel_at_parameters if self.with_parameters else self.rhs.kernel

    def run(self, chunk: Chunk, tick: Progress | None = None) -> tuple[Array, PrecisionStatus]:
        """States at the stored times, shape (spans + 1, N, size), and the worst loss of precision."""
        if self.kernel.engine == "numba" and self.kernel.is_unrolled:
            return self._run_compiled(chunk, tick)
        stepper, x = STEPPERS[self.method], chunk.x
        work = _Work(self, chunk)
        kept = [x.copy()]
        for k in range(self.steps):
            stepper(work, k * self.h, self.h)
            if (k + 1) % (self.steps // self.spans) == 0:
                kept.append(work.x.copy())
            if tick is not None:
                tick(len(x), 0)
        return np.array(kept), work.verdict

    def _run_compiled(self, chunk: Chunk, tick: Progress | None) -> tuple[Array, PrecisionStatus]:
        """The same by compiled loops over blocks of initial states."""
        from .compiled_steps import BLOCK, compiled_steps

        x = chunk.x
        steps = compiled_steps(self.kernel, self.method, x.dtype)
        kept, verdict, length = np.empty((self.spans + 1, *x.shape), x.dtype), OK, self.steps // self.spans
        kept[0] = x
        for begin in range(0, len(x), BLOCK):
            work = _Work(self, chunk.part(begin, begin + BLOCK))
            for span in range(self.spans):
                k, last = span * length, (span + 1) * length
                while k < last:
                    k = steps(work.x, work.t, work.p, work.k, work.sum, work.stage, self.h, k, last)
                    if k < last:  # a step with a state to be examined
                        STEPPERS[self.method](work, k * self.h, self.h)
                        k += 1
                kept[span + 1, begin : begin + BLOCK] = work.x
                if tick is not None:
                    tick(len(work.x) * length, 0)
            verdict = verdict.worse(work.verdict)
        return kept, verdict


class _Work:
    """Arrays of one chunk, reused in every step."""

    def __init__(self, plan: Plan, chunk: Chunk) -> None:
        self.first = chunk.first
        self.h = plan.h  # step [s], for messages
        self.kernel, self.n = plan.kernel, plan.rhs.robot.n
        self.x, self.p = np.array(chunk.x), chunk.parameters
        self.further = (self.p,) if plan.with_parameters else ()
        self.t = np.zeros((len(self.x), 1), self.x.dtype)
        self.k, self.sum, self.stage = (np.empty_like(self.x) for _ in range(3))
        self.verdict = OK

    def slope(self, t: float, x: Array) -> Array:
        self.t.fill(t)
        try:
            rates, verdict = self.kernel.evaluate(self.t, x, *self.further, out=self.k)
        except NotFiniteError as error:
            raise self._located(error, t, x) from None
        if verdict is not OK:
            if verdict.error is not None:
                (start,) = verdict.error.state
                raise SingularMassMatrixError(
                    f"start {self.first + start} at t = {t:.6g} s: {verdict.error.what}",
                    verdict.error.cause,
                    verdict.error.joints,
                )
            self.verdict = self.verdict.worse(verdict)
        return rates

    def _located(self, error: NotFiniteError, t: float, x: Array) -> NotFiniteError:
        """The error with the first start at fault, the time, and what may help."""
        cure = f"; steps of {self.h:g} s may be too long for the fastest decay: try shorter ones"
        for k in range(len(x)):
            try:
                rates, verdict = self.kernel.evaluate(self.t[k], x[k], *(p[k] for p in self.further))
            except NotFiniteError as found:
                return NotFiniteError(f"start {self.first + k} at t = {t:.6g} s: {found}{cure}", t)
            if verdict.error is None and not np.isfinite(rates).all():
                break
        return NotFiniteError(f"start {self.first + k} at t = {t:.6g} s: {error}{cure}", t)


def _rk4(work: _Work, t: float, h: float) -> None:
    """The classical Runge-Kutta method of order 4."""
    x, total, stage = work.x, work.sum, work.stage
    np.copyto(stage, x)
    for time, weight, ahead in ((t, 1, 0.5), (t + h / 2, 2, 0.5), (t + h / 2, 2, 1.0), (t + h, 1, 0.0)):
        k = work.slope(time, stage)
        if weight == 1 and ahead == 0.5:
            np.copyto(total, k)
        else:
            np.multiply(k, weight, out=stage)
            np.add(total, stage, out=total)
        if ahead:
            np.multiply(k, ahead * h, out=stage)
            np.add(stage, x, out=stage)
    np.multiply(total, h / 6, out=total)
    np.add(x, total, out=x)


def _semi_implicit(work: _Work, t: float, h: float) -> None:
    """Semi-implicit Euler: rates first, then positions with the new rates."""
    k = work.slope(t, work.x)
    n = work.n
    work.x[:, n:] += h * k[:, n:]
    work.x[:, :n] += h * work.x[:, n : 2 * n]


# Semi-implicit Euler, of order 1, is what most real-time engines step with; on damped stiff loops it is stable up to
# 2/lambda at one evaluation per step, where RK4 takes four for 2.8/lambda.
STEPPERS = {"rk4": _rk4, "semi-implicit-euler": _semi_implicit}


def run_all(
    plan: Plan, starts: Chunk, progress: Progress | None, executor: Executor | None
) -> list[tuple[Array, PrecisionStatus]]:
    """The results of `plan.run` for chunks of the initial states, in their order."""
    size = len(starts.x)
    edges = [*range(0, size, CHUNK), size]
    if executor is not None and size:
        parts = max(len(edges) - 1, min(size, 8))
        edges = [size * k // parts for k in range(parts + 1)]
    chunks = [starts.part(begin, end) for begin, end in itertools.pairwise(edges)]
    total, done = size * plan.steps, 0

    def tick(count: int, _: int) -> None:
        nonlocal done
        done += count
        if progress is not None:
            progress(done, total)

    if executor is None:
        return [plan.run(chunk, tick if progress else None) for chunk in chunks]
    from concurrent.futures import ThreadPoolExecutor, wait

    in_threads = isinstance(executor, ThreadPoolExecutor)
    if in_threads:
        _ = plan.kernel  # traced before several threads ask for it at once
    run = plan.run if in_threads else partial(run_pickled, _pickled(plan))
    futures: list[Future[tuple[Array, PrecisionStatus]]] = [executor.submit(run, chunk) for chunk in chunks]
    for future, chunk in zip(futures, chunks, strict=True):
        wait([future])
        tick(len(chunk.x) * plan.steps, 0)
    return [future.result() for future in futures]


def _pickled(plan: Plan) -> bytes:
    """The plan for other processes; a ValueError where its controller cannot be sent to them."""
    try:
        return pickle.dumps(plan)
    except (AttributeError, TypeError, pickle.PicklingError) as error:
        raise ValueError(
            f"the controller cannot be sent to the processes of `executor`: {error}; define it by `def` or `class` at "
            "the top level of a module, not inside a function and not by `lambda`"
        ) from None


@lru_cache(maxsize=4)
def _plan(pickled: bytes) -> Plan:
    """The plan of a process, which traces and compiles its kernel once for all chunks."""
    plan: Plan = pickle.loads(pickled)
    return plan


def run_pickled(pickled: bytes, chunk: Chunk) -> tuple[Array, PrecisionStatus]:
    """Plan.run in another process."""
    return _plan(pickled).run(chunk)
