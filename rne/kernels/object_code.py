"""Compilation of LLVM instructions to object code for this processor, and its loading."""

from __future__ import annotations

import functools
import hashlib
import itertools
import logging
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import llvmlite
import numpy as np
from llvmlite import binding

from ..basics import disk_cache

LOGGER = logging.getLogger("rne")
LOCK = threading.RLock()  # for one compilation at a time
RECENT: dict[str, bytes] = {}  # object code by name, the last used at the end
MOST_RECENT = 64
NAMES = itertools.count()  # of libraries, which LLVM wants to be unique


@functools.cache
def host() -> tuple[str, str]:
    """Name and features of the processor."""
    return binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()


@functools.cache
def versions() -> str:
    """Versions of packages and of files of this folder, on which object code depends in addition to the program."""
    files = b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.rglob("*.py")))
    others = f"llvmlite {llvmlite.__version__} LLVM {binding.llvm_version_info} numpy {np.__version__} {sys.version}"
    return f"{hashlib.sha256(files).hexdigest()} {others} {sys.platform}"


versions()  # of the files as they were imported: they may be edited while a process runs
REGISTER_BITS = 512 if "+avx512f" in host()[1].split(",") else 256


@functools.cache
def _target_machine() -> Any:
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    name, features = host()
    target = binding.Target.from_triple(binding.get_process_triple())
    return target.create_target_machine(name, features, opt=3, reloc="pic", codemodel="small")


@functools.cache
def _linker() -> Any:
    _target_machine()
    return binding.create_lljit_compiler(use_jit_link=sys.platform != "win32")  # there it is not available


def compiled(text: str, *, loops: bool = False) -> bytes:
    """Object code of a module of LLVM instructions; `loops` asks for all that LLVM can do for loops.

    Straight-line code needs little else than sums of addresses. Each run of LLVM's full list of passes keeps 0.2 MB.
    """
    with LOCK:
        machine = _target_machine()
        module = binding.parse_assembly(text)
        module.triple, module.data_layout = machine.triple, str(machine.target_data)
        options = binding.create_pipeline_tuning_options(speed_level=3)
        builder = binding.create_pass_builder(machine, options)
        passes = builder.getModulePassManager() if loops else binding.create_new_module_pass_manager()
        if not loops:
            passes.add_sroa_pass()
            passes.add_instruction_combine_pass()
            passes.add_simplify_cfg_pass()
        passes.run(module, builder)
        code: bytes = machine.emit_object(module)
    return code


class Library:
    """Object code in memory; its functions, found by name at an `address`, may be called as long as it lives."""

    seconds = 0.0  # that it took to make

    def __init__(self, code: bytes, functions: Sequence[str]) -> None:
        builder = binding.JITLibraryBuilder().add_object_img(code).add_current_process()
        for function in functions:
            builder.export_symbol(function)
        with LOCK:
            self._tracker = builder.link(_linker(), f"rne{next(NAMES)}")
        self.address: dict[str, int] = {function: self._tracker[function] for function in functions}


def library(functions: Sequence[str], description: Sequence[str], text: Callable[[], str], *, loops: bool) -> Library:
    """Library of a description, from memory, from the disk, or compiled and kept in both."""
    name = disk_cache.key(versions(), *host(), *description)
    mark = f"rne_{name}"  # a symbol that only code of this description has
    made, code = None, RECENT.pop(name, None) or disk_cache.read(name) or b""
    if code:
        try:
            made = Library(code, [*functions, mark])
        except RuntimeError as error:
            LOGGER.info("object code of %s is compiled anew: %s", name, error)
    if made is None:
        code = compiled(f"{text()}\n@{mark} = constant i8 0\n", loops=loops)
        disk_cache.write(name, code)
        made = Library(code, functions)
    RECENT[name] = code
    for old in list(RECENT)[: len(RECENT) - MOST_RECENT]:
        RECENT.pop(old, None)
    return made
