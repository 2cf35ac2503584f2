"""The order of a program's instructions: any order with operands before results gives the same numbers."""

from __future__ import annotations

from collections import Counter

from .program import Instruction, Operand, Program

MAX_INSTRUCTIONS = 1500  # for which the search is worth its cost, which grows with their square


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
    ready = [k for k, count in enumerate(missing) if not count]
    age: dict[int, int] = {}
    order: list[int] = []

    def worth(k: int) -> tuple[int, int, int]:
        args = set(instructions[k].args)
        last_reads = sum(arg.kind != "constant" and unread[arg] == 1 for arg in args)
        freshest = max((age[int(arg.value)] for arg in args if arg.kind == "result"), default=-1)
        return last_reads, freshest, -k

    while ready:
        k = max(ready, key=worth)
        ready.remove(k)
        age[k] = len(order)
        order.append(k)
        unread.subtract(set(instructions[k].args))
        for reader in readers[k]:
            missing[reader] -= 1
            if not missing[reader]:
                ready.append(reader)
    return reordered(program, order)


def _readers(program: Program) -> tuple[list[list[int]], list[int]]:
    """The readers of each result, and the number of results that each instruction waits for."""
    readers: list[list[int]] = [[] for _ in program.instructions]
    missing = [0] * len(program.instructions)
    for k, instruction in enumerate(program.instructions):
        for arg in set(instruction.args):
            if arg.kind == "result":
                readers[int(arg.value)].append(k)
                missing[k] += 1
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
