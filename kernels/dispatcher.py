"""Compile a numba kernel in the form its caller needs: with or without the Python wrapper.

Numba gives each kernel two more functions that take and return Python's and C's values. They cost
a fifth of the compiling time, and a kernel that only kernels call needs neither; none here is
called by C. So a kernel is compiled for other kernels without, and once more with the wrapper where
Python calls it after all.
"""

from __future__ import annotations

from typing import Any

from numba.core.compiler_lock import global_compiler_lock
from numba.core.errors import TypingError
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature

from kernels.stored import KernelStore


class KernelDispatcher(CPUDispatcher):
    """Compiles a kernel in the form that its caller needs, and keeps it on disk.

    Attributes
    ----------
    for_kernels : bool
        Whether what is being compiled is for other kernels alone.
    """

    def __init__(self, *args: Any, **named: Any) -> None:
        super().__init__(*args, **named)
        self.for_kernels = False
        self._compiler._customize_flags = self._with_own_flags
        # Numba has no public seam for another cache; tests/kernels holds this one.
        self._cache = KernelStore(self)

    def compile(self, sig: Any) -> Any:
        """Compile for Python and return the entry point; `for_kernels` asks for the other form."""
        with global_compiler_lock:
            types = tuple(normalize_signature(sig)[0])
            known = self.overloads.get(types)
            if known is not None and not self.for_kernels and not is_called_by_python(known):
                del self.overloads[types]
            return super().compile(sig)

    def compile_for_kernels(self, types: tuple[Any, ...]) -> None:
        """Compile what other kernels take in."""
        self.get_call_template(types, {})

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Compile for a kernel that calls this with types ``args``; return numba's template."""
        with global_compiler_lock:
            before = self.for_kernels
            # Kernels that call each other in a circle find one another by names of one form.
            self.for_kernels = self._cache.keeps_kernel()
            try:
                return super().get_call_template(args, kws)
            finally:
                self.for_kernels = before

    def add_overload(self, cres: Any) -> None:
        """Take what was compiled; Python can't call what has no wrapper for it."""
        if is_called_by_python(cres):
            super().add_overload(cres)
        else:
            self.overloads[tuple(cres.signature.args)] = cres

    def get_compile_result(self, sig: Any) -> Any:
        """Refuse to be a value of a function type: that needs the wrapper for C."""
        raise TypingError(f"kernel {self.py_func.__name__} can't be a value of a function type")

    def _with_own_flags(self, flags: Any) -> Any:
        flags.no_cfunc_wrapper = True
        flags.no_cpython_wrapper = self.for_kernels
        # Else numba takes this flag from the kernel whose compiling asked for this one.
        flags.nrt = self.targetoptions.get("_nrt", True)
        return flags


def is_called_by_python(compiled: Any) -> bool:
    """Whether what numba compiled has the wrapper for Python."""
    name = compiled.fndesc.llvm_cpython_wrapper_name
    return bool(compiled.library.get_pointer_to_function(name))
