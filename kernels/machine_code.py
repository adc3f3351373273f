"""Load numba's object files into memory and run the machine code without numba.

A kernel on disk is an object file as LLVM writes for code that is used in memory (ELF, x86-64,
large code model): nearly all that is left to fill in are absolute addresses of 64 bits. To load
LLVM for that takes 70 MB and 0.1 CPU s, and numba around it 30 MB and 0.3 CPU s.

What the code calls is Python itself, the C library, and helpers of numba in three extension
modules, which are loaded without the package around them. The entry is numba's own wrapper of the
kernel, which takes Python's arguments and gives back Python's values. Kernels whose code needs
more than that (threads, hashes of text) are refused, and numba loads them.

ELF: System V ABI, AMD64 supplement, "Relocation"; numba's symbols: ``numba/core/base.py``,
``numba/core/runtime/nrt.py`` and ``numba/core/callwrapper.py`` (read, not copied).
"""

from __future__ import annotations

import builtins
import ctypes
import mmap
import pickle
import struct
import sys
from collections.abc import Callable
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, Final

from kernels.object_file import COMMON, Section, UnloadableError, sections_of, symbols_of

Run = Callable[[tuple[Any, ...]], Any]
"""A kernel: takes the tuple of its arguments."""

_MOVE = "<QQq"
_ADDENDS, _EMPTY, _UNWINDING = 4, 8, 0x70000001
_WRITTEN, _HELD = 1, 2
_OWNERS: Final = {"numba": ("_helperlib", "_dynfunc"), "NRT": ("core.runtime._nrt_python",)}
"""Modules of numba by what their helpers' symbols begin with."""
_ABSOLUTE_64, _RELATIVE_32, _CALL_32, _RELATIVE_64 = 1, 2, 4, 24

_KEPT: list[Any] = []
"""What must live as long as the process: code, and objects that it points to."""


def load(code: bytes, entry: str, constants: dict[str, list[Any]]) -> Run:
    """Put an object file into memory and return its kernel.

    Parameters
    ----------
    code : bytes
        Object file.
    entry : str
        Symbol of the wrapper that takes and returns Python's values.
    constants : dict
        Of numba's environments, by their symbols.

    Raises
    ------
    UnloadableError
        Where the file is of another kind, or needs a symbol that isn't known.
    """
    sections = sections_of(code)
    symbols = list(symbols_of(code, sections))
    spaces = [_Space(), _Space()]
    places: dict[int, tuple[_Space, int]] = {}
    for number, one in enumerate(sections):
        if one.flags & _HELD and one.kind != _UNWINDING:
            space = spaces[one.flags & _WRITTEN]
            places[number] = space, space.reserve(one.size, one.alignment)
    shared = [
        (name, spaces[1].reserve(size, value)) if place == COMMON else None
        for name, place, value, size in symbols
    ]
    for space in spaces:
        space.map()
    for number, (space, start) in places.items():
        one = sections[number]
        if one.kind != _EMPTY:
            space.write(start, code[one.offset : one.offset + one.size])
    addresses: list[int | str] = [
        spaces[1].base + common[1]
        if common
        else places[place][0].base + places[place][1] + value
        if place in places
        else name
        for (name, place, value, _), common in zip(symbols, shared, strict=True)
    ]
    for one in sections:
        if one.kind == _ADDENDS and one.info in places:
            _fill_in(code, one, *places[one.info], addresses)
    for common in filter(None, shared):
        spaces[1].write(common[1], struct.pack("<Q", _environment(constants.get(common[0]))))
    spaces[0].make_runnable()
    _KEPT.extend(spaces)
    entries = [at for at, (name, *_) in zip(addresses, symbols, strict=True) if name == entry]
    if len(entries) != 1 or isinstance(entries[0], str):
        raise UnloadableError(f"no entry {entry}")
    take = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)(
        entries[0]
    )
    return lambda args: take(None, args, None)


class _Space:
    """Memory for sections of one kind: first reserved, then mapped, then written."""

    def __init__(self) -> None:
        self._size = 0
        self.base = 0

    def reserve(self, size: int, alignment: int) -> int:
        """Return where ``size`` bytes begin."""
        start = -(-self._size // max(alignment, 1)) * max(alignment, 1)
        self._size = start + size
        return start

    def map(self) -> None:
        """Map what is reserved; its address is known from now on."""
        self._memory = mmap.mmap(-1, self._size + 1)
        self.base = ctypes.addressof(ctypes.c_char.from_buffer(self._memory))

    def write(self, start: int, data: bytes) -> None:
        """Write bytes at an offset."""
        self._memory[start : start + len(data)] = data

    def make_runnable(self) -> None:
        """Forbid writing and allow running."""
        protect = ctypes.CDLL(None).mprotect
        protect.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
        if protect(self.base, len(self._memory), mmap.PROT_READ | mmap.PROT_EXEC):
            raise UnloadableError("this system lets no memory be run")


def _fill_in(
    code: bytes, section: Section, space: _Space, start: int, addresses: list[int | str]
) -> None:
    """Write the addresses that a section's code refers to."""
    rows = code[section.offset : section.offset + section.size]
    for offset, info, addend in struct.iter_unpack(_MOVE, rows):
        symbol = addresses[info >> 32]
        target = (address_of(symbol) if isinstance(symbol, str) else symbol) + addend
        at, kind = start + offset, info & 0xFFFFFFFF
        apart = target - space.base - at
        if kind == _ABSOLUTE_64:
            space.write(at, struct.pack("<Q", target))
        elif kind == _RELATIVE_64:
            space.write(at, struct.pack("<q", apart))
        elif kind in (_RELATIVE_32, _CALL_32) and -(1 << 31) <= apart < 1 << 31:
            space.write(at, struct.pack("<i", apart))
        else:
            raise UnloadableError(f"relocation of type {kind}")


@cache
def address_of(symbol: str) -> int:
    """Return the address that a symbol of numba's code stands for.

    Raises `UnloadableError` where it isn't known without numba.
    """
    owner, _, name = symbol.partition("_")
    if symbol == "numba_unpickle":
        return int(ctypes.cast(_UNPICKLE, ctypes.c_void_p).value or 0)
    if owner == "PyExc":
        return id(getattr(builtins, name))
    if symbol == "_Py_NoneStruct":
        return id(None)
    for helpers in map(_helpers, _OWNERS.get(owner, ())):
        if name in helpers.c_helpers:
            return int(helpers.c_helpers[name])
    try:
        address = ctypes.cast(getattr(ctypes.CDLL(None), symbol), ctypes.c_void_p).value
    except AttributeError as exc:
        raise UnloadableError(f"symbol {symbol}") from exc
    return int(address or 0)


@cache
def _helpers(name: str) -> Any:
    """One of numba's extension modules, without numba."""
    package = find_spec("numba")
    if package is None or package.origin is None:
        raise UnloadableError("numba isn't there")
    base = Path(package.origin).parent.joinpath(*name.split("."))
    whole = f"numba.{name}"
    if whole in sys.modules:
        return sys.modules[whole]
    for suffix in EXTENSION_SUFFIXES:
        path = base.with_name(base.name + suffix)
        spec = spec_from_file_location(whole, path) if path.is_file() else None
        if spec is not None and spec.loader is not None:
            module: Any = module_from_spec(spec)
            spec.loader.exec_module(module)
            sys.modules.pop(whole, None)  # numba, if it comes later, brings its own order
            if name.endswith("_nrt_python"):
                module.memsys_use_cpython_allocator()
            return module
    raise UnloadableError(f"{whole} isn't there")


def _environment(constants: list[Any] | None) -> int:
    """Address of an environment of numba with these constants; 0 without any."""
    if constants is None:
        return 0
    made = _helpers("_dynfunc").Environment({})
    made.consts.extend(constants)
    _KEPT.append(made)
    return id(made)


_UNPICKLED: dict[int, Any] = {}


def _unpickle(address: int, size: int, _digest: int) -> Any:
    """What a constant of the code holds as a pickle, once read."""
    if address not in _UNPICKLED:
        _UNPICKLED[address] = pickle.loads(ctypes.string_at(address, size))
    return _UNPICKLED[address]


_UNPICKLE: Final = ctypes.PYFUNCTYPE(
    ctypes.py_object, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p
)(_unpickle)
