"""The error or warning about a result of forward dynamics: carried with the result, raised or issued once."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import NamedTuple

from ..errors import PrecisionWarning, SingularMassMatrixError

BatchIndex = tuple[int, ...]  # of a state in a batch; empty for a single state


class PrecisionLoss(NamedTuple):
    """The state of a call with the fewest decimal digits left, and why."""

    digits: float
    state: BatchIndex
    cause: str

    def __str__(self) -> str:
        where = f" at state {self.state}" if self.state else ""
        return f"forward dynamics keep about {self.digits:.0f} digits{where}: {self.cause}; see Robot.diagnose"


class Verdict(NamedTuple):
    """The error or the warning that belongs to a result; neither for a sound one.

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

    def with_state(self, place: Callable[[BatchIndex], BatchIndex]) -> Verdict:
        """The same verdict with the state's index replaced, such as by that in the batch that a block is part of."""
        error = None if self.error is None else self.error.at(place(self.error.state))
        loss = None if self.loss is None else self.loss._replace(state=place(self.loss.state))
        return Verdict(error, loss)

    def worse(self, other: Verdict) -> Verdict:
        """The worse of two verdicts: an error before a loss, fewer digits before more."""
        if self.error is not None or other.error is not None:
            return self if self.error is not None else other
        if self.loss is None or other.loss is None:
            return self if other.loss is None else other
        return min(self, other, key=lambda verdict: verdict.loss)  # type: ignore[arg-type, return-value]


SOUND = Verdict()
