"""Functions as graphs of operations: traced, differentiated, written as straight-line programs; knows no robot.

1. graph has the operations, equal ones once and zeros folded away; scalar is the traced number that builds it.
2. differentiation adds derivatives as further operations.
3. program puts those that some outputs need in order, and runs them on any kind of numbers.
"""
