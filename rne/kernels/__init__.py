"""Kernels: functions traced once for one robot and run as straight-line arithmetic.

1. trace runs the core of a function on traced numbers, whose operations build a graph (rne.graph), with derivatives
   as further operations, and makes a program of it.
2. soundness states when a result of the program is one.
3. An engine runs the program, or source prints it. The engine "numpy" is python_backend (one state as Python floats)
   and numpy_backend (blocks of states in registers); "numba" is llvm_backend (both as machine code: machine_code writes
   LLVM's instructions, object_code compiles them, python_calls lets Python call them if array_layout knows its arrays).
4. kernel checks the arguments of a call and chooses among these; compilation makes kernels, cache keeps the kernels
   of a Robot, exports converts them for other packages.
"""

from .compilation import compile, derivative, gradient, hessian, hessian_product
from .kernel import Kernel

__all__ = ["Kernel", "compile", "derivative", "gradient", "hessian", "hessian_product"]
