"""Kernels that run cached machine code without loading numba, and compile by numba if none is.

A command that calls a dozen kernels spends 110 MB and 0.5 CPU s on numba and LLVM. It may ask
(`without_numba`) for kernels that take their machine code from a file (`kernels.machine_code`) and
load numba only where there is none yet, or for arguments of a kind that isn't known here.

The file's name holds what the code depends on: the kernel with all that it takes in
(`kernels.key`), the arguments' types, versions, and the processor.
"""

from __future__ import annotations

import os
import pickle
import sys
from contextlib import suppress
from functools import cache, cached_property
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from kernels.files import read_whole, write_whole
from kernels.folder import cache_dir
from kernels.key import Memo, UnkeepableError, class_text, content_parts, digest
from kernels.machine_code import Run, load
from kernels.object_file import UnloadableError

_MEMO: Memo = {}
_ASKED: set[str] = set()

_FLAGS: Final = {"nogil": True, "error_model": "numpy", "nopython": True, "boundscheck": None}
"""Of `kernels.with_numba`, as numba keeps them."""


def without_numba() -> None:
    """Make kernels of modules that are imported from now on run without numba, where they can."""
    _ASKED.add("bare")


def bare_wanted() -> bool:
    """Whether single-threaded kernels are made as `BareKernel` in this process.

    Not where a user's settings of numba count, or on another processor or system.
    """
    return (
        "bare" in _ASKED
        and sys.platform == "linux"
        and sys.implementation.name == "cpython"
        and os.uname().machine == "x86_64"
        and not any(name.startswith("NUMBA_") for name in os.environ)
        and not Path(".numba_config.yaml").exists()
    )


class BareKernel:
    """A kernel that loads its machine code when it is called, and numba only if there is none.

    Parameters
    ----------
    function : callable
    flags : dict
        Of the compiler, beside the usual ones.
    """

    def __init__(self, function: Any, flags: dict[str, bool]) -> None:
        self.py_func = function
        self.targetoptions = _FLAGS | flags
        self._more = flags
        self.__doc__ = function.__doc__
        self.__name__ = function.__name__
        self._runs: dict[tuple[Any, ...], Run] = {}
        self._defaults = function.__defaults__ or ()
        self._most = function.__code__.co_argcount

    def __call__(self, *args: Any) -> Any:
        """Run the kernel."""
        left_out = self._most - len(args)
        if 0 < left_out <= len(self._defaults):
            args = (*args, *self._defaults[-left_out:])
        try:
            kind = tuple([_kind(one) for one in args])
        except TypeError:
            return self.dispatcher(*args)
        run = self._runs.get(kind)
        if run is None:
            run = self._runs[kind] = self._found(kind, args)
        return run(args)

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's own kernel."""
        return import_module("kernels.with_numba").compiled(self.py_func, **self._more)

    @property
    def _numba_type_(self) -> Any:
        """What numba takes for the type of this, where another kernel calls it."""
        return self.dispatcher._numba_type_

    def _found(self, kind: tuple[Any, ...], args: tuple[Any, ...]) -> Run:
        path = self._path(kind)
        kept = None if path is None else read_whole(path)
        if kept is not None:
            with suppress(UnloadableError):
                return load(*kept)
        kernel = self.dispatcher
        types = tuple(kernel.typeof_pyval(one) for one in args)
        kernel.compile(types)
        if path is not None and kept is None:
            _keep(path, kernel._cache.kept(types, kernel.targetctx))
        return lambda args: kernel(*args)

    def _path(self, kind: tuple[Any, ...]) -> Path | None:
        """File for arguments of a kind; None where such a kernel isn't kept."""
        function = self.py_func
        kernel: Any = self
        try:
            parts = content_parts(kernel, _MEMO)
        except UnkeepableError:
            return None
        name = digest([_machine(), *parts, *map(_kind_text, kind)])
        return cache_dir() / f"{function.__module__}.{function.__name__}-{name}.nbo"


def _kind(value: Any) -> Any:
    """Numba's type of an argument, as far as this knows it; raise `TypeError` beyond."""
    own = type(value)
    if own is np.ndarray:
        flags = value.flags
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        return value.dtype, value.ndim, layout, flags.writeable, flags.aligned
    if own is int:
        if not -(1 << 63) <= value < 1 << 63:
            raise TypeError(value)
        return own
    if own in (float, bool, bytes, type(None)) or isinstance(value, np.generic):
        return own
    if isinstance(value, tuple):
        return own, *[_kind(one) for one in value]
    raise TypeError(own)


def _kind_text(kind: Any) -> str:
    if isinstance(kind, tuple):
        return f"({', '.join(map(_kind_text, kind))})"
    if isinstance(kind, np.dtype):
        return f"{kind.descr!r} {kind.itemsize} {kind.isalignedstruct}"
    if isinstance(kind, type) and issubclass(kind, tuple):
        return class_text(kind)
    return str(kind)


@cache
def _machine() -> str:
    """What machine code depends on beside the kernel: versions, and the processor."""
    versions = [version(one) for one in ("numba", "llvmlite", "numpy")]
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        first = file.read(1 << 14).partition("\n\n")[0]
    keys = ("vendor_id", "cpu family", "model", "stepping", "flags")
    processor = [line for line in first.splitlines() if line.startswith(keys)]
    return "\n".join([sys.version, *versions, *processor])


def _keep(path: Path, payload: tuple[Any, ...] | None) -> None:
    """Keep the machine code of a kernel that numba keeps; not where it takes objects of numba."""
    if payload is None:
        return
    (_, kind, made), described, own, _, _, lifted, _, to_begin, others = payload
    constants = {one.env_name: list(one.consts) for one in (own, *others)}
    if kind != "object" or lifted or to_begin or b"numba" in pickle.dumps(list(constants.values())):
        return
    content = (made[0], described.llvm_cpython_wrapper_name, constants)
    with suppress(OSError):
        write_whole(path, pickle.dumps(content))
