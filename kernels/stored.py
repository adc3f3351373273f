"""Store of compiled kernels on disk, a file for each kernel, signature and processor."""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba.core import types
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaWarning
from numba.core.serialize import dumps

from kernels.key import Memo, kernel_key, signature_text

_MEMO: Memo = {}


def cache_dir() -> Path:
    """Return the folder of compiled kernels, below the user's cache.

    ``PRINTCTL_CACHE`` moves it (the Makefile puts it into the virtual environment).
    """
    base = os.environ.get("PRINTCTL_CACHE")
    root = Path(base) if base else Path.home() / ".cache" / "printctl"
    return root / "kernels"


class KernelStore(NullCache):
    """Numba's cache interface over files named by content; has no index that could be torn.

    A file that is missing, damaged or unreadable is a kernel to compile. A folder that can't be
    written costs time at the next start and nothing else; ``printctl doctor`` tells it.
    """

    def __init__(self, kernel: Dispatcher) -> None:
        self._kernel = kernel

    @property
    def cache_path(self) -> str:
        """Folder of the files."""
        return str(cache_dir())

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """Return the compiled kernel for argument types ``sig``, or None."""
        target_context.refresh()
        path = self._path(sig, target_context.codegen())
        try:
            payload = pickle.loads(path.read_bytes())
        except (OSError, pickle.UnpicklingError, EOFError, AttributeError, ImportError, ValueError):
            return None
        return CompileResult._rebuild(target_context, *payload)

    def save_overload(self, sig: Any, data: CompileResult) -> None:
        """Keep the compiled kernel ``data`` for argument types ``sig``."""
        if data.library.has_dynamic_globals or any(not one.can_cache for one in data.lifted):
            name = self._kernel.py_func.__qualname__
            warnings.warn(f"kernel {name} can't be kept on disk", NumbaWarning, stacklevel=2)
            return
        with suppress(OSError):
            _write_whole(self._path(sig, data.codegen), dumps(data._reduce()))

    def _path(self, sig: Sequence[types.Type], codegen: Any) -> Path:
        function = self._kernel.py_func
        parts = [
            kernel_key(self._kernel, _MEMO),
            signature_text(sig, _MEMO),
            repr(codegen.magic_tuple()),
        ]
        name = f"{function.__module__}.{function.__name__}"
        key = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]
        return cache_dir() / f"{name}-{key}.nbc"


def _write_whole(path: Path, content: bytes) -> None:
    """Write a file so that readers see all of it or none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, scratch = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.replace(scratch, path)
    except OSError:
        with suppress(OSError):
            os.unlink(scratch)
        raise
