"""Delay numba's machine code generation until a compiled function's address is needed.

Numba makes a library for each kernel and for each of its own functions that a kernel uses, and
turns each into machine code at once. A kernel takes in the LLVM code of what it calls, and has it
optimised and translated again as part of itself. So the machine code of what only kernels call is
never run. Here a library waits until an address in it is asked for.

What is loaded from disk has machine code, and LLVM code that only a kernel compiled after it takes
in. Numba reads the latter each time, to list what it defines: half the time of loading. Here the
machine code's own table says that, and LLVM code waits until it is asked for.

Numba also runs its optimiser on each function alone before it runs on the whole library, which
does the same again: 0.1 of the compiling time for code that is no different in what it computes.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import llvmlite.binding as ll
import numba
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen, RuntimeLinker
from numba.core.environment import lookup_environment
from numba.core.runtime.nrt import rtsys

from kernels.object_file import UnloadableError, defined_names

_KNOWN: Final = ("0.68.",)
"""Versions of numba whose parts, which it calls private, were tried; any other works as it is."""
_ENVIRONMENT: Final = "_ZN08NumbaEnv"
"""How the names of variables begin that hold a function's environment (``numba/core/base.py``)."""


@contextmanager
def interrupt_held_back() -> Iterator[None]:
    """Let Ctrl-C count only when what is done inside is done.

    LLVM hands on machine code through a callback, and an exception in a callback is lost: the
    kernel would have no code, and the interrupt no effect.
    """
    usual = signal.getsignal(signal.SIGINT)
    if usual is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
        if came:
            signal.raise_signal(signal.SIGINT)


class WaitingLibrary(JITCodeLibrary):
    """Numba's library, without machine code until `get_pointer_to_function` finds its function."""

    _translated = False
    _code_for_linking: bytes | None = None

    @classmethod
    def _unserialize(cls, codegen: Any, state: tuple[Any, ...]) -> Any:
        name, kind, data = state
        try:
            names = defined_names(data[0]) if kind == "object" else None
        except UnloadableError:  # not Linux on x86-64
            names = None
        if names is None:
            return super()._unserialize(codegen, state)
        library = codegen.create_library(name)
        library.enable_object_caching()
        library._set_compiled_object(data[0])
        library._code_for_linking = data[1]
        library._finalize_final_module()
        codegen._engine._defined_symbols |= names
        return library

    def _get_module_for_linking(self) -> Any:
        if self._code_for_linking is not None:
            self._shared_module = ll.parse_bitcode(self._code_for_linking)
            self._code_for_linking = None
        return super()._get_module_for_linking()

    def get_pointer_to_function(self, name: str) -> int:
        """Return the address of a function, or 0 where this library has none of that name."""
        self._ensure_finalized()
        if not self._translated and self._defines(name):
            self._translate()
        return int(super().get_pointer_to_function(name))

    def serialize_using_object_code(self) -> tuple[Any, ...]:
        """Return what is kept on disk: machine code with LLVM code, or without any the latter."""
        self._ensure_finalized()
        if self._translated:
            return tuple(super().serialize_using_object_code())
        return self.name, "bitcode", self._get_module_for_linking().as_bitcode()

    def _get_compiled_object(self) -> Any:
        if not self._translated:
            self._translate()
        return super()._get_compiled_object()

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _finalize_final_module(self) -> None:
        circle = self._calls_in_circle()
        if circle:  # What numba puts in the place of a function to come must be there before.
            rtsys.library.get_pointer_to_function("nrt_unresolved_abort")
        if circle or (self._object_caching_enabled and self._compiled_object):
            self._translate()
            return
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def _translate(self) -> None:
        self._translated = True
        self._dynamic_globals.clear()
        with interrupt_held_back():
            super()._finalize_final_module()
        for one in self._final_module.global_variables:
            if one.name.startswith(_ENVIRONMENT):
                environment = lookup_environment(one.name)
                if environment is not None:
                    self._codegen.set_env(one.name, environment)

    def _defines(self, name: str) -> bool:
        try:
            return not self._final_module.get_function(name).is_declaration
        except NameError:
            return False

    def _calls_in_circle(self) -> bool:
        """Whether numba resolves a call by address, which it learns only by translating."""
        return any(
            one.name.startswith(RuntimeLinker.PREFIX) for one in self._final_module.global_variables
        )


_set_environment = JITCPUCodegen.set_env


def _set_environment_if_translated(codegen: Any, name: str, environment: Any) -> None:
    """Tell machine code its environment; a library that waits is told when it is translated."""
    if codegen._engine.is_symbol_defined(name):
        _set_environment(codegen, name, environment)


def use_waiting_libraries() -> None:
    """Have numba make such libraries in this process, where it is a version that is known to."""
    if numba.__version__.startswith(_KNOWN):
        JITCPUCodegen._library_class = WaitingLibrary
        JITCPUCodegen.set_env = _set_environment_if_translated
