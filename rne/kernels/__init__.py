"""From a recursion to a kernel: a function traced once on one robot, run as straight-line arithmetic.

cache (which quantities of a Robot are traced) -> kernel (the call and its checks; wrenches: external ones as arrays)
-> trace (the core run on scalar's traced numbers, which build a graph; differentiation) -> program (the graph in order)
-> an engine or source (printed
languages). The engine "numpy" is python_backend (one state as Python floats) and numpy_backend (blocks of states, with
registers, schedule, sine_cosine); "numba" is numba_backend (both, compiled, with machine_code and machine_sine).
"""

from .kernel import Kernel, compile, derivative

__all__ = ["Kernel", "compile", "derivative"]
