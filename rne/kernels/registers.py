"""Registers for a program that runs on whole rows of numbers, and the order of instructions that needs few of them.

Any order with operands before results gives the same numbers.
"""

from __future__ import annotations

import heapq
from collections import Counter, defaultdict
from typing import Any, NamedTuple

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
    layouts = [_Allocator(ordered).layout() for ordered in (program, with_few_registers(program))]
    return min(layouts, key=lambda layout: layout.registers)


class _Allocator:
    def __init__(self, program: Program) -> None:
        self.program = program
        self.free: list[int] = []
        self.registers = program.inputs + len(program.outputs)
        self.place: dict[int, int] = {}
        self.paired: set[int] = set()
        self.last = self._last_readers()
        self.copies: list[tuple[int, Operand | int]] = []
        self._place_outputs()

    def _last_readers(self) -> dict[Operand, int]:
        last: dict[Operand, int] = {}
        for k, instruction in enumerate(self.program.instructions):
            for arg in instruction.args:
                if arg.kind != "constant":
                    last[arg] = k
        return last

    def _place_outputs(self) -> None:
        """An output is computed in its own register; repeated and constant ones are copied there."""
        for k, output in enumerate(self.program.outputs):
            row = self.program.inputs + k
            if output.kind == "result" and output.value not in self.place:
                self.place[int(output.value)] = row
            else:
                source = self.place[int(output.value)] if output.kind == "result" else output
                self.copies.append((row, int(output.value) if output.kind == "input" else source))
        self.fixed = {Operand("result", k) for k in self.place} | set(self.program.outputs)

    def _take(self) -> int:
        if self.free:
            return self.free.pop()
        self.registers += 1
        return self.registers - 1

    def _where(self, arg: Operand) -> Operand | int:
        if arg.kind == "constant":
            return arg
        return int(arg.value) if arg.kind == "input" else self.place[int(arg.value)]

    def _result(self, k: int) -> int:
        if k not in self.place:
            self.place[k] = self._take()
        return self.place[k]

    def _release(self, k: int, instruction: Instruction) -> None:
        for arg in set(instruction.args):
            if arg.kind != "constant" and self.last[arg] == k and arg not in self.fixed:
                self.free.append(int(arg.value) if arg.kind == "input" else self.place[int(arg.value)])

    def layout(self) -> Layout:
        """Steps in order; a result may reuse the register of an operand that is read for the last time."""
        partners = self._sine_and_cosine()
        steps = []
        for k, instruction in enumerate(self.program.instructions):
            if k in self.paired:
                self._release(k, instruction)
                continue
            args = tuple(self._where(arg) for arg in instruction.args)
            if k in partners:
                steps.append(self._pair(k, partners[k], args))
                self._release(k, instruction)
                continue
            if instruction.kind == "where":  # written in two parts, so its result must not overlap an operand
                steps.append(Step("where", args, (self._result(k),)))
                self._release(k, instruction)
                continue
            self._release(k, instruction)
            steps.append(Step(instruction.kind, args, (self._result(k),)))
        return Layout(tuple(steps), self.registers, tuple(self.copies))

    def _pair(self, k: int, partner: int, args: tuple[Operand | int, ...]) -> Step:
        self.paired.add(partner)
        sine, cosine = (k, partner) if self.program.instructions[k].kind == "sin" else (partner, k)
        return Step("sincos", args, (self._result(sine), self._result(cosine)))

    def _sine_and_cosine(self) -> dict[int, int]:
        """The first of each sine and cosine of the same angle, with the other one."""
        first: dict[tuple[str, Any], int] = {}
        partners = {}
        for k, instruction in enumerate(self.program.instructions):
            if instruction.kind in ("sin", "cos") and instruction.args[0].kind == "input":
                other = first.get(("cos" if instruction.kind == "sin" else "sin", instruction.args[0]))
                if other is not None:
                    partners[other] = k
                first[(instruction.kind, instruction.args[0])] = k
        return partners


def with_few_registers(program: Program) -> Program:
    """The program with its instructions in an order that keeps few results alive at a time.

    Of the instructions that can run, the one that reads the most operands for the last time is next, and among
    those the one whose operands are freshest in the cache.
    """
    instructions = program.instructions
    if len(instructions) > MAX_INSTRUCTIONS:
        return program
    readers, missing = _readers(program)
    unread = Counter(arg for instruction in instructions for arg in set(instruction.args))
    unread.update(set(program.outputs))
    freshest = [-1] * len(instructions)  # place of the latest operand in the new order
    ready: list[tuple[int, int, int]] = []
    order: list[int] = []
    done = [False] * len(instructions)

    def offer(k: int) -> None:
        """Enter instruction k; anew when one more of its operands has no other reader: `done` skips the older entry."""
        last_reads = sum(arg.kind != "constant" and unread[arg] == 1 for arg in set(instructions[k].args))
        heapq.heappush(ready, (-last_reads, -freshest[k], k))

    for k, count in enumerate(missing):
        if not count:
            offer(k)
    while ready:
        _, _, k = heapq.heappop(ready)
        if done[k]:
            continue
        done[k] = True
        for reader in readers[Operand("result", k)]:
            missing[reader] -= 1
            freshest[reader] = len(order)
        order.append(k)
        for arg in set(instructions[k].args):
            unread[arg] -= 1
            if unread[arg] == 1 and arg.kind != "constant":
                for reader in readers[arg]:
                    if not done[reader] and not missing[reader]:
                        offer(reader)
        for reader in readers[Operand("result", k)]:
            if not missing[reader]:
                offer(reader)
    return reordered(program, order)


def _readers(program: Program) -> tuple[dict[Operand, list[int]], list[int]]:
    """The readers of each operand, and the number of results that each instruction waits for."""
    readers: defaultdict[Operand, list[int]] = defaultdict(list)
    missing = [0] * len(program.instructions)
    for k, instruction in enumerate(program.instructions):
        for arg in set(instruction.args):
            readers[arg].append(k)
            missing[k] += arg.kind == "result"
    return readers, missing


def reordered(program: Program, order: list[int]) -> Program:
    """The same program with its instructions in another order."""
    new = {k: position for position, k in enumerate(order)}

    def renamed(arg: Operand) -> Operand:
        return Operand("result", new[int(arg.value)]) if arg.kind == "result" else arg

    instructions = tuple(
        Instruction(program.instructions[k].kind, tuple(renamed(arg) for arg in program.instructions[k].args))
        for k in order
    )
    return Program(instructions, tuple(renamed(output) for output in program.outputs), program.inputs)
