"""Registers for a program that runs on whole rows of numbers, and the order of instructions that needs few of them.

Any order with operands before results gives the same numbers.
"""

from __future__ import annotations

import heapq
import itertools
from collections import Counter, defaultdict
from typing import NamedTuple

from .program import Instruction, Operand, Program

MAX_INSTRUCTIONS = 1500  # of longer programs (derivatives, chains of 100 joints) the order found needs more registers


class Step(NamedTuple):
    """One instruction with the registers of its operands and results."""

    kind: str
    args: tuple[Operand | int, ...]
    out: tuple[int, ...]


class Layout(NamedTuple):
    """The use of the registers: inputs first, then outputs, then intermediate results."""

    steps: tuple[Step, ...]
    registers: int
    copies: tuple[tuple[int, Operand | int], ...]  # output rows that repeat another register or hold a constant


def allocate(program: Program) -> Layout:
    """Registers by liveness: each is free again after its last reader. Of two orders, the one that needs fewer."""
    layouts = [_layout(ordered) for ordered in (program, with_few_registers(program))]
    return min(layouts, key=lambda layout: layout.registers)


def _layout(program: Program) -> Layout:
    """Steps in order; a result may reuse the register of an operand that is read for the last time."""
    place, copies = _places(program)
    last = {arg: k for k, instruction in enumerate(program.instructions) for arg in instruction.args}
    kept = {*program.outputs, *(arg for arg in last if arg.kind == "constant")}
    registers = itertools.count(program.inputs + len(program.outputs))
    free: list[int] = []
    partners = _sine_and_cosine(program)
    steps: list[Step] = []

    def result(k: int) -> int:
        operand = Operand("result", k)
        if operand not in place:
            place[operand] = free.pop() if free else next(registers)
        return place[operand]

    for k, (kind, operands) in enumerate(program.instructions):
        args = tuple(place.get(arg, arg) for arg in operands)
        finished = [place[arg] for arg in set(operands) if arg not in kept and last[arg] == k]
        if k in partners and kind in ("sin", "cos"):
            if k < partners[k]:  # the second comes with the first
                sine, cosine = (k, partners[k]) if kind == "sin" else (partners[k], k)
                steps.append(Step("sincos", args, (result(sine), result(cosine))))
        elif kind == "where":  # written in two parts, so its result must not overlap an operand
            steps.append(Step(kind, args, (result(k),)))
        else:
            free += finished
            steps.append(Step(kind, args, (result(k),)))
            continue
        free += finished
    return Layout(tuple(steps), next(registers), copies)


def _places(program: Program) -> tuple[dict[Operand, int], tuple[tuple[int, Operand | int], ...]]:
    """The registers of inputs and outputs, and the outputs that repeat another register or are constant."""
    place = {Operand("input", k): k for k in range(program.inputs)}
    copies: list[tuple[int, Operand | int]] = []
    for row, output in enumerate(program.outputs, program.inputs):
        if output.kind == "result" and output not in place:
            place[output] = row
        else:
            copies.append((row, place.get(output, output)))
    return place, tuple(copies)


def _sine_and_cosine(program: Program) -> dict[int, int]:
    """Each sine and cosine of the same input, with the other one."""
    first: dict[tuple[str, Operand], int] = {}
    partners: dict[int, int] = {}
    for k, (kind, args) in enumerate(program.instructions):
        if kind in ("sin", "cos") and args[0].kind == "input":
            other = first.get(("cos" if kind == "sin" else "sin", args[0]))
            if other is not None:
                partners |= {other: k, k: other}
            first[kind, args[0]] = k
    return partners


def with_few_registers(program: Program) -> Program:
    """The program with its instructions in an order that keeps few results alive at a time.

    Of the instructions that can run, the one that reads the most operands for the last time is next, and among
    those the one whose operands are freshest in the cache.
    """
    if len(program.instructions) > MAX_INSTRUCTIONS:
        return program
    reads = [{_number(arg) for arg in args if arg.kind != "constant"} for _, args in program.instructions]
    readers: defaultdict[int, list[int]] = defaultdict(list)
    for k, numbers in enumerate(reads):
        for number in numbers:
            readers[number].append(k)
    unread = Counter({number: len(by) for number, by in readers.items()})
    unread.update({_number(output) for output in program.outputs if output.kind != "constant"})
    missing = [sum(number >= 0 for number in numbers) for numbers in reads]  # results that an instruction waits for
    freshest = [-1] * len(reads)  # place of the latest operand in the new order
    ready: list[tuple[int, int, int]] = []
    order: list[int] = []
    done = [False] * len(reads)

    def offer(k: int) -> None:
        """Enter instruction k; anew when one more of its operands has no other reader: `done` skips the older entry."""
        last_reads = sum([unread[number] == 1 for number in reads[k]])
        heapq.heappush(ready, (-last_reads, -freshest[k], k))

    for k, count in enumerate(missing):
        if not count:
            offer(k)
    while ready:
        _, _, k = heapq.heappop(ready)
        if done[k]:
            continue
        done[k] = True
        for reader in readers[k]:
            missing[reader] -= 1
            freshest[reader] = len(order)
        order.append(k)
        for number in reads[k]:
            unread[number] -= 1
            if unread[number] == 1:
                for reader in readers[number]:
                    if not done[reader] and not missing[reader]:
                        offer(reader)
        for reader in readers[k]:
            if not missing[reader]:
                offer(reader)
    return reordered(program, order)


def _number(operand: Operand) -> int:
    """Results by their instructions, inputs below zero."""
    return int(operand.value if operand.kind == "result" else ~int(operand.value))


def reordered(program: Program, order: list[int]) -> Program:
    """The program with its instructions in another order."""
    moved = {k: Operand("result", place) for place, k in enumerate(order)}

    def renamed(operands: tuple[Operand, ...]) -> tuple[Operand, ...]:
        return tuple([moved[int(arg.value)] if arg.kind == "result" else arg for arg in operands])

    old = [program.instructions[k] for k in order]
    instructions = tuple(Instruction(kind, renamed(args)) for kind, args in old)
    return Program(instructions, renamed(program.outputs), program.inputs)
