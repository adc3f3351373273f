"""Store of compiled kernels on disk, a file for each kernel, signature and processor."""

from __future__ import annotations

import hashlib
import itertools
import os
import pickle
import secrets
import tempfile
import warnings
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

import numba.cpython.hashing  # noqa: F401 - adds symbols of kernels that hash
from numba.core import types
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaWarning
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from kernels.key import Memo, UnkeepableError, kernel_key, signature_text

_MEMO: Memo = {}
_DIGEST_BYTES: Final = 32
_SIGNATURE: Final = 3
"""Place of the signature in what numba's `CompileResult` is kept as."""

# Numba numbers the functions that a process compiles from 1 and puts the number into their
# symbols. Files of two processes would hold different functions under one symbol, and the second
# to be loaded would run the first one's code. So each process counts from a place of its own.
FunctionIdentity._unique_ids = itertools.count(secrets.randbits(60))


def cache_dir() -> Path:
    """Return the folder of compiled kernels, below the user's cache.

    ``PRINTCTL_CACHE`` moves it (the Makefile puts it into the virtual environment).
    """
    base = os.environ.get("PRINTCTL_CACHE")
    root = Path(base) if base else Path.home() / ".cache" / "printctl"
    return _absolute(root) / "kernels"


@cache
def _absolute(root: Path) -> Path:
    """Where ``root`` was when it was first asked for: a process may change its folder."""
    return root.absolute()


def kernel_of(file: Path) -> str:
    """Return module and name of the kernel that a file of the store holds."""
    return file.name.rpartition("-")[0]


def signature_in(file: Path) -> Sequence[types.Type] | None:
    """Return the argument types of the kernel that a file of the store holds; None if damaged."""
    payload = _read_whole(file)
    return None if payload is None else payload[_SIGNATURE].args


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
        """Return the compiled kernel for argument types ``sig``, or None.

        Numba's own cache lists all that can be compiled first, 0.1 CPU s of each process. Machine
        code needs the symbols alone, of the runtime and of hashing. What is compiled after all
        lists the rest.
        """
        rtsys.initialize(target_context)
        path = self._path(sig, target_context.codegen())
        payload = None if path is None else _read_whole(path)
        return None if payload is None else CompileResult._rebuild(target_context, *payload)

    def save_overload(self, sig: Any, data: CompileResult) -> None:
        """Keep the compiled kernel ``data`` for argument types ``sig``."""
        if data.library.has_dynamic_globals or any(not one.can_cache for one in data.lifted):
            name = self._kernel.py_func.__qualname__
            warnings.warn(f"kernel {name} can't be kept on disk", NumbaWarning, stacklevel=2)
            return
        path = self._path(sig, data.codegen)
        if path is not None:
            with suppress(OSError):
                _write_whole(path, dumps(data._reduce()))

    def _path(self, sig: Sequence[types.Type], codegen: Any) -> Path | None:
        """File for argument types ``sig``; None where such a kernel isn't kept."""
        function = self._kernel.py_func
        try:
            key, types_text = kernel_key(self._kernel, _MEMO), signature_text(sig, _MEMO)
        except UnkeepableError:
            return None
        parts = [key, types_text, repr(codegen.magic_tuple())]
        name = f"{function.__module__}.{function.__name__}"
        digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]
        return cache_dir() / f"{name}-{digest}.nbc"


def _checksum(path: Path, content: bytes) -> bytes:
    """Digest of a file's name and content: a file under another's name is damaged, too."""
    return hashlib.sha256(path.name.encode() + b"\0" + content).digest()


def _read_whole(path: Path) -> tuple[Any, ...] | None:
    """Read a file that `_write_whole` wrote; None where it is missing or damaged."""
    try:
        data = path.read_bytes()
        content = data[_DIGEST_BYTES:]
        if data[:_DIGEST_BYTES] != _checksum(path, content):
            return None
        payload: tuple[Any, ...] = pickle.loads(content)
    except (OSError, pickle.UnpicklingError, EOFError, AttributeError, ImportError, ValueError):
        return None
    return payload


def _write_whole(path: Path, content: bytes) -> None:
    """Write a file so that readers see all of it or none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, scratch = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(_checksum(path, content) + content)
        os.chmod(scratch, 0o644)  # a cache that one user made may serve others
        os.replace(scratch, path)
    except OSError:
        with suppress(OSError):
            os.unlink(scratch)
        raise
