"""Load stored kernels without what compiling them needs.

Before numba looks for stored code it imports all functions that it can compile, SciPy's linear
algebra among them: 0.3 CPU s and 60 MB. Stored code needs the symbols of numba's run-time library.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from functools import cache
from typing import Any

from llvmlite import binding
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.environment import Environment, lookup_environment
from numba.core.runtime import _nrt_python


class KernelCache(FunctionCache):
    """Stored code of one kernel."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        files: CompileResultCacheImpl = self._impl
        self._cache_file = _KernelFile(
            self._cache_path, files.filename_base, files.locator.get_source_stamp()
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the stored code, or None after preparing numba to compile the kernel."""
        _add_runtime_symbols()
        with self._guard_against_spurious_io_errors():
            stored = self._load_overload(sig, target_context)
            if stored is not None:
                return stored
        return super().load_overload(sig, target_context)


class _KernelFile(IndexDataCacheFile):
    def _load_data(self, name: str) -> Any:
        with open(self._data_path(name), "rb") as file:
            return _Unpickler(io.BytesIO(file.read())).load()


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        found = super().find_class(module, name)
        return _environment if name == "_rebuild_env" else found


def _environment(module: str, constants: list[Any], name: str) -> Environment:
    """Environment of a compiled function, without an import of its module.

    Only code in numba's object mode, which no kernel is, reads the module's names there.
    """
    known = lookup_environment(name)
    if known is not None:
        return known
    environment = Environment({"__name__": module})
    environment.consts[:] = constants
    environment.env_name = name
    Environment._memo[name] = environment
    return environment


@cache
def _add_runtime_symbols() -> None:
    for name, address in _nrt_python.c_helpers.items():
        binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)
