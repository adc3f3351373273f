"""Store of compiled kernels on disk, a file for each kernel, signature and processor."""

from __future__ import annotations

import hashlib
import itertools
import secrets
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba.cpython.hashing  # noqa: F401 - adds symbols of kernels that hash
from numba.core import types
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.errors import NumbaWarning
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from kernels.files import read_whole, write_whole
from kernels.folder import ALL, FOR_KERNELS, cache_dir
from kernels.key import Memo, UnkeepableError, kernel_key, signature_text
from kernels.under_way import waited_for

_MEMO: Memo = {}

# Numba numbers the functions that a process compiles from 1 and puts the number into their
# symbols. Files of two processes would hold different functions under one symbol, and the second
# to be loaded would run the first one's code. So each process counts from a place of its own.
FunctionIdentity._unique_ids = itertools.count(secrets.randbits(60))


class KernelStore(NullCache):
    """Numba's cache interface over files named by content; has no index that could be torn.

    A file that is missing, damaged or unreadable is a kernel to compile. A folder that can't be
    written costs time at the next start and nothing else; ``printctl doctor`` tells it.
    """

    def __init__(self, kernel: Any) -> None:  # `kernels.dispatcher` imports this
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
        payload = self._of_either_form(sig, target_context)
        if payload is None and waited_for(self._name(), sig):
            payload = self._of_either_form(sig, target_context)
        return None if payload is None else CompileResult._rebuild(target_context, *payload)

    def _of_either_form(self, sig: Any, target_context: Any) -> tuple[Any, ...] | None:
        payload = self.kept(sig, target_context)
        if payload is None and self._kernel.for_kernels:
            payload = self.kept(sig, target_context, for_kernels=True)
        return payload

    def _name(self) -> str:
        function = self._kernel.py_func
        return f"{function.__module__}:{function.__name__}"

    def kept(
        self, sig: Sequence[types.Type], target_context: Any, for_kernels: bool = False
    ) -> tuple[Any, ...] | None:
        """Return what a file holds of the kernel for argument types ``sig``; None without one."""
        path = self._path(sig, target_context.codegen(), for_kernels)
        return None if path is None else read_whole(path)

    def save_overload(self, sig: Any, data: CompileResult) -> None:
        """Keep the compiled kernel ``data`` for argument types ``sig``."""
        if data.library.has_dynamic_globals or any(not one.can_cache for one in data.lifted):
            name = self._kernel.py_func.__qualname__
            warnings.warn(f"kernel {name} can't be kept on disk", NumbaWarning, stacklevel=2)
            return
        path = self._path(sig, data.codegen, self._kernel.for_kernels)
        if path is not None and self._is_as_first_seen():
            with suppress(OSError):
                write_whole(path, dumps(data._reduce()))

    def _is_as_first_seen(self) -> bool:
        """Whether the values that the kernel takes in are still those that its key was made of.

        Numba freezes globals when it compiles: of two signatures with a change between them (a
        test's monkeypatch) the second holds a value that no source has.
        """
        return kernel_key(self._kernel, {}) == kernel_key(self._kernel, _MEMO)

    def keeps_kernel(self) -> bool:
        """Whether the kernel can be kept at all."""
        try:
            kernel_key(self._kernel, _MEMO)
        except UnkeepableError:
            return False
        return True

    def _path(self, sig: Sequence[types.Type], codegen: Any, for_kernels: bool) -> Path | None:
        """File for argument types ``sig``; None where such a kernel isn't kept."""
        try:
            key, types_text = kernel_key(self._kernel, _MEMO), signature_text(sig, _MEMO)
        except UnkeepableError:
            return None
        parts = [key, types_text, repr(codegen.magic_tuple())]
        name = self._name().replace(":", ".")
        digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]
        return cache_dir() / f"{name}-{digest}{FOR_KERNELS if for_kernels else ALL}"
