"""Read the sections and symbols of numba's object files (ELF, x86-64).

System V ABI, "Object Files": section header table, symbol table.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Final, NamedTuple

COMMON: Final = 0xFFF2
"""Section number of a variable that whoever loads the file makes room for."""

_SECTION, _SYMBOL = struct.Struct("<IIQQQQIIQQ"), struct.Struct("<IBBHQQ")
_X86_64: Final = 62
_SYMBOLS: Final = 2
_UNDEFINED, _LOCAL = 0, 0


class UnloadableError(Exception):
    """Machine code that only numba can load."""


class Section(NamedTuple):
    """Row of the section header table."""

    name: int
    kind: int
    flags: int
    address: int
    offset: int
    size: int
    link: int
    info: int
    alignment: int
    entry_size: int


def sections_of(code: bytes) -> list[Section]:
    """Return the section header table; raise `UnloadableError` for a file of another kind."""
    if code[:6] != b"\x7fELF\x02\x01" or struct.unpack_from("<H", code, 18)[0] != _X86_64:
        raise UnloadableError("no object file for x86-64")
    (start,) = struct.unpack_from("<Q", code, 0x28)
    (count,) = struct.unpack_from("<H", code, 0x3C)
    return [Section(*_SECTION.unpack_from(code, start + k * _SECTION.size)) for k in range(count)]


def symbols_of(code: bytes, sections: list[Section]) -> Iterator[tuple[str, int, int, int]]:
    """Yield name, section, value and size of each symbol."""
    (table,) = (one for one in sections if one.kind == _SYMBOLS)
    names = sections[table.link].offset
    for at in range(table.offset, table.offset + table.size, _SYMBOL.size):
        name, _, _, place, value, size = _SYMBOL.unpack_from(code, at)
        begin = names + name
        yield code[begin : code.index(b"\0", begin)].decode(), place, value, size


def defined_names(code: bytes) -> set[str]:
    """Return the names that other code can ask a file for: of functions and variables it holds.

    Raises `UnloadableError` for a file of another kind.
    """
    sections = sections_of(code)
    (table,) = (one for one in sections if one.kind == _SYMBOLS)
    names = sections[table.link].offset
    found = set()
    rows = code[table.offset : table.offset + table.size]
    for name, info, _, place, _, _ in _SYMBOL.iter_unpack(rows):
        if place != _UNDEFINED and info >> 4 != _LOCAL:
            begin = names + name
            found.add(code[begin : code.index(b"\0", begin)].decode())
    return found
