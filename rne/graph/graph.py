"""Expression graph: common subexpressions once, zeros and ones folded away, signs in the references.

A reference is a signed node: 2 * node + 1 denotes its negative. Signs move outwards through products, sums and odd
functions, so that x - y and y - x are one node and no operation is spent on them. Folding changes a result in its last
digits at most: nothing is rewritten that could cancel or divide by zero where the original would not. Where a product
of constants and inputs overflows, the recursion computes the state.

Inputs are finite, and products and sums of them are taken to be. Then 0 x is 0, but not for an x that may be infinite
or NaN otherwise: a root, an exponential, a quotient whose divisor may be 0, or a constant that is not finite. Pivots of
M are not 0, and results of couplings are finite, since both are checked; but which divisors are pivots is known only
after tracing. So a first graph folds all zeros and notes the assumptions; if one does not hold, a second graph is made,
which knows the pivots.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

LEAVES = {"input", "constant"}
ODD = {"sin", "tanh", "sign"}
EVEN = {"cos", "abs"}
MAY_FAIL = {"sqrt", "exp"}  # kinds that may have no finite value
LARGEST_EXPONENT = math.log(sys.float_info.max)
UNARY: dict[str, Callable[[float], float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "sqrt": math.sqrt,
    "abs": abs,
    "tanh": math.tanh,
    "exp": lambda x: math.inf if x >= LARGEST_EXPONENT else math.exp(x),
    "sign": lambda x: 1.0 if x > 0 else -1.0 if x < 0 else x + 0.0,
}
# As NumPy's, where Python's own lose a NaN.
BINARY: dict[str, Callable[[float, float], float]] = {
    "minimum": lambda a, b: a if a <= b or a != a else b,
    "maximum": lambda a, b: a if a >= b or a != a else b,
}
COMPARISONS: dict[str, Callable[[float, float], bool]] = {"less": lambda a, b: a < b, "less_equal": lambda a, b: a <= b}


def _ordinary(x: float) -> bool:
    """True for a product of constants that did not overflow or lose digits to underflow."""
    return 1e-200 < abs(x) < 1e200


class Node(NamedTuple):
    """Operation: its kind and its operands (references, an input's index, or a constant's value)."""

    kind: str
    args: tuple[Any, ...]


class LinearSystem(NamedTuple):
    """Solution x of r(x) = 0 with the symmetric derivative M: functions y -> M^-1 y, y -> M y, and r."""

    x: Any
    solve: Callable[[Any], Any]
    product: Callable[[Any], Any]
    residual: Callable[[Any], Any]


class TooLarge(Exception):
    """Raised for more operations than can sensibly be written out."""


class Graph:
    """Operations in the order in which they were first needed; TooLarge is raised for more than `limit`.

    `by_pivots`, from `divisions_by_pivots` of a first graph of the same operations, is True for each division
    by a pivot of M. In an outline the quantities of robots are inputs: it is made to be compared with another one.
    """

    def __init__(self, limit: int = 10**9, by_pivots: Iterable[bool] | None = None, *, outline: bool = False) -> None:
        self.is_outline = outline
        self.nodes: list[Node] = []
        self.systems: list[LinearSystem] = []  # that were solved
        self.checked: dict[int, None] = {}  # nodes whose values kernels check to be finite
        self.limit = limit
        self._by_pivots = None if by_pivots is None else iter(by_pivots)
        self._divisors: list[int] = []  # of each division, the node
        self._pivots: set[int] = set()  # nodes
        self._finite: set[int] = set()  # nodes that were taken to be finite,
        self._not_zero: set[int] = set()  # and not to be 0
        self._doubtful: list[bool] = []  # of each node so far, whether it may be infinite or NaN
        self._index: dict[tuple[Any, ...], int] = {}
        self._values: dict[int, float] = {}  # of constants, by their references of either sign
        self._references: dict[float, int] = {}  # of constants, by their values
        # of nodes that are a constant times another, by their references
        self._factors: dict[int, tuple[float, int]] = {}

    def node(self, kind: str, *args: Any) -> int:
        """Reference of an operation; equal operations share one."""
        key = (kind, *args)
        index = self._index.get(key)
        if index is None:
            index = len(self.nodes)
            if index >= self.limit:
                raise TooLarge(f"more than {self.limit} operations")
            self.nodes.append(Node(kind, args))
            self._index[key] = index
        return 2 * index

    def note_solution(self, *system: Any) -> None:
        """Record the parts of a LinearSystem that was solved, for derivatives."""
        self.systems.append(LinearSystem(*system))

    def note_finite(self, ref: int) -> None:
        """Record a reference that kernels check to be finite, so that it may be assumed to be."""
        self.checked[ref >> 1] = None
        if ref >> 1 < len(self._doubtful):
            self._doubtful[ref >> 1] = False

    def arguments(self, index: int) -> list[int]:
        """Nodes of an operation's operands."""
        node = self.nodes[index]
        return [] if node.kind in LEAVES else [ref >> 1 for ref in node.args]

    def needed(self, outputs: Iterable[int], arguments: Callable[[int], Iterable[int]] | None = None) -> list[int]:
        """Operations that outputs depend on, each after its operands and close before its first use.

        `arguments` gives the operands of a node, by default all of them.
        """
        arguments = arguments or self.arguments
        done: set[int] = set()
        order = []
        for output in outputs:
            stack = [output >> 1]
            while stack:
                k = stack.pop()
                if k < 0:  # its operands are in place
                    order.append(~k)
                elif k not in done:
                    done.add(k)
                    if operands := list(arguments(k)):
                        stack.append(~k)
                        stack += operands[::-1]
        return order

    def divisions_by_pivots(self, pivots: Iterable[int]) -> list[bool] | None:
        """True for each division by one of the pivots (references); None if all that was folded is sound."""
        if self._by_pivots is not None:
            return None
        self._pivots = {ref >> 1 for ref in pivots}
        if self._not_zero <= self._pivots and not any(map(self.is_doubtful, self._finite)):
            return None
        return [divisor in self._pivots for divisor in self._divisors]

    def is_doubtful(self, index: int) -> bool:
        """True if a node may be infinite or NaN although inputs are finite."""
        found = self._doubtful
        for k in range(len(found), len(self.nodes)):
            kind, args = self.nodes[k]
            if k in self.checked:
                found.append(False)
            elif kind in LEAVES:
                found.append(kind == "constant" and not math.isfinite(args[0]))
            elif kind == "divide" and args[1] >> 1 not in self._pivots and not self.value(args[1]):
                found.append(True)
            else:
                found.append(kind in MAY_FAIL or (kind not in COMPARISONS and any(found[ref >> 1] for ref in args)))
        return found[index]

    def _takes_as_finite(self, ref: int) -> bool:
        """True if this may be taken to be finite."""
        if self._by_pivots is not None:
            return not self.is_doubtful(ref >> 1)
        self._finite.add(ref >> 1)
        return True

    def input(self, k: int) -> int:
        """Reference of the k-th input."""
        return self.node("input", k)

    def constant(self, value: float) -> int:
        """Reference of a number: a node of its size, and the sign in the reference."""
        ref = self._references.get(value)
        if ref is None:
            size = abs(value)
            ref = self.node("constant", size)
            self._values[ref], self._values[ref ^ 1] = size, -size
            self._references[value] = ref = ref ^ int(value < 0)
        return ref

    def value(self, ref: int) -> float | None:
        """Value of a constant reference, or None if it depends on inputs."""
        return self._values.get(ref)

    def negate(self, a: int) -> int:
        """Reference of -a; zero has no sign."""
        return a if self.value(a) == 0 else a ^ 1

    def add(self, a: int, b: int) -> int:
        """Reference of a + b."""
        x, y = self._values.get(a), self._values.get(b)
        if x is not None and y is not None:
            return self.constant(x + y)
        if x == 0:
            return b
        if y == 0:
            return a
        (p, m), (q, k) = self._term(a), self._term(b)
        if m == k and (p * q > 0 or self._takes_as_finite(m)):
            return self.multiply(self.constant(p + q), m)
        if abs(p) == abs(q) != 1:  # one product instead of two
            return self.multiply(self.constant(p), self.add(m, k if p == q else k ^ 1))
        doubled = self._doubled(a, b)
        if doubled is not None:
            return self.multiply(self.constant(2.0), doubled)
        return self._sum(a, b)

    def _sum(self, a: int, b: int) -> int:
        if a > b:
            a, b = b, a
        return self.node("subtract" if (a ^ b) & 1 else "add", a & ~1, b & ~1) ^ (a & 1)

    def repeated(self, index: int, args: Sequence[int]) -> int:
        """Operation of a node on other operands, without simplification."""
        kind, a, b = self.nodes[index].kind, args[0], args[-1]
        if kind in ("add", "subtract"):
            return self._sum(a, b ^ int(kind == "subtract"))
        if kind in ("multiply", "divide"):
            ordered = sorted((a & ~1, b & ~1)) if kind == "multiply" else (a & ~1, b & ~1)
            return self.node(kind, *ordered) ^ ((a ^ b) & 1)
        return self.node(kind, *args)

    def _doubled(self, a: int, b: int) -> int | None:
        """Reference y where a + b = (x + y) - (x - y), in any order."""
        first, second = self.nodes[a >> 1], self.nodes[b >> 1]
        if {first.kind, second.kind} != {"add", "subtract"} or set(first.args) != set(second.args):
            return None
        for k in (0, 1):  # a + b is twice the summand that has the same sign in both
            x = first.args[k]
            if self._sign_in(a, x) == self._sign_in(b, x):
                cancels = first.args[1 - k]
                return int(x) ^ self._sign_in(a, x) if self._takes_as_finite(cancels) else None
        return None

    def _sign_in(self, ref: int, x: int) -> int:
        """1 if x is subtracted in the sum or difference `ref`."""
        node = self.nodes[ref >> 1]
        return (ref & 1) ^ int(node.kind == "subtract" and node.args[1] == x)

    def _term(self, ref: int) -> tuple[float, int]:
        """Reference as constant times node."""
        factor, node = self._factors.get(ref & ~1, (1.0, ref & ~1))
        return (-factor if ref & 1 else factor), node

    def multiply(self, a: int, b: int) -> int:
        """Reference of a b."""
        x, y = self._values.get(a), self._values.get(b)
        if x is not None and y is not None:
            return self.constant(x * y)
        if y is not None:
            a, b, x = b, a, y
        if x == 0:
            return a & ~1 if self._takes_as_finite(b) else self.node("multiply", a & ~1, b & ~1)
        if x == 1 or x == -1:
            return b if x == 1 else b ^ 1
        sign, a, b = (a ^ b) & 1, a & ~1, b & ~1
        factor, m = self._factors.get(b, (1.0, b))
        if x is not None:
            x = abs(x)
            if m != b and _ordinary(x * factor):
                return self.multiply(self.constant(x * factor), m) ^ sign
            ref = self.node("multiply", a, b)
            self._factors[ref] = x, b
            return ref ^ sign
        p, k = self._factors.get(a, (1.0, a))
        if (k != a or m != b) and _ordinary(p * factor):  # constants move outwards, where they combine with others
            return self.multiply(self.constant(p * factor), self.multiply(k, m)) ^ sign
        return self.node("multiply", *sorted((a, b))) ^ sign

    def divide(self, a: int, b: int) -> int:
        """Reference of a / b; by a power of two as a product, which is exact."""
        x, y = self.value(a), self.value(b)
        self._divisors.append(b >> 1)
        if self._by_pivots is not None and next(self._by_pivots, False):
            self._pivots.add(b >> 1)
        if y is not None and y != 0 and math.frexp(y)[0] in (0.5, -0.5) and math.isfinite(1 / y):
            return self.multiply(a, self.constant(1 / y))
        if x is not None and y is not None:
            return self.constant(x / y if y else math.nan if x == 0 or x != x else math.copysign(math.inf, x))
        if x == 0 and (self._by_pivots is None or b >> 1 in self._pivots):
            self._not_zero.add(b >> 1)
            return a
        return self.node("divide", a & ~1, b & ~1) ^ ((a ^ b) & 1)

    def unary(self, kind: str, a: int) -> int:
        """Reference of an elementary function."""
        x = self.value(a)
        if x is not None:
            try:
                return self.constant(UNARY[kind](x))
            except ValueError:  # it has no value there
                return self.constant(math.nan)
        if kind in ODD:
            return self.node(kind, a & ~1) ^ (a & 1)
        return self.node(kind, a & ~1 if kind in EVEN else self.plain(a))

    def binary(self, kind: str, a: int, b: int) -> int:
        """Reference of minimum, maximum or a comparison (1 where it holds, 0 where not)."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.constant(float((BINARY | COMPARISONS)[kind](x, y)))
        if (found := self._beside_infinity(kind, a, b)) is not None:
            return found
        if kind in COMPARISONS:
            return self.node(kind, self.plain(a), self.plain(b))
        if a & b & 1:
            return self.binary("maximum" if kind == "minimum" else "minimum", a ^ 1, b ^ 1) ^ 1
        return self.node(kind, *sorted((self.plain(a), self.plain(b))))

    def _beside_infinity(self, kind: str, a: int, b: int) -> int | None:
        """Result of `binary` for an infinite operand: a bound that never acts, or one that always does."""
        for bound, other in ((a, b), (b, a)):
            if math.isinf(self._values.get(bound, 0.0)):
                at_zero = (BINARY | COMPARISONS)[kind](self._values.get(a, 0.0), self._values.get(b, 0.0))
                if kind in BINARY and at_zero == 0:  # even of what is infinite or NaN
                    return other
                return self.constant(float(at_zero)) if self._takes_as_finite(other) else None
        return None

    def arctan2(self, y: int, x: int) -> int:
        """Angle of the vector (x, y)."""
        a, b = self.value(y), self.value(x)
        if a is not None and b is not None:
            return self.constant(math.atan2(a, b))
        return self.node("arctan2", self.plain(y & ~1), self.plain(x)) ^ (y & 1)

    def where(self, condition: int, a: int, b: int) -> int:
        """Reference of a where the condition is not 0, b elsewhere."""
        x = self.value(condition)
        if x is not None:
            return a if x else b
        if a == b:
            return a
        if a & b & 1:
            return self.where(condition, a ^ 1, b ^ 1) ^ 1
        return self.node("where", condition, self.plain(a), self.plain(b))

    def plain(self, a: int) -> int:
        """Reference without a sign: negatives of other than constants become an operation."""
        if not a & 1:
            return a
        x = self.value(a)
        if x is None:
            return self.node("negative", a & ~1)
        ref = self.node("constant", x)
        self._values[ref], self._values[ref ^ 1] = x, -x
        return ref
