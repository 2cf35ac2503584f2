"""The order of a program's instructions: any order with operands before results gives the same numbers."""

from __future__ import annotations

import heapq
from collections import Counter, defaultdict

from .program import Instruction, Operand, Program

MAX_INSTRUCTIONS = 1500  # of longer programs (derivatives, chains of 100 joints) the order found needs more registers


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
