"""Reader of packed columns, the slow way: what the page's script does."""

import base64
import struct
import zlib

import numpy as np

from report.packing import PackedColumn

CODES = {"u1": "B", "u2": "<H", "i2": "<h", "i4": "<i", "f4": "<f"}


def unpacked(text, n, columns):
    """Columns of `n` rows by name; `columns` are of `report.packing.PackedColumn`."""
    data, at, found = zlib.decompress(base64.b64decode(text)), 0, {}
    for column in columns:
        size = int(column.kind[1])
        planes = data[at : at + size * n]
        at += size * n
        rows = [bytes(planes[k * n + i] for k in range(size)) for i in range(n)]
        values = [struct.unpack(CODES[column.kind], row)[0] for row in rows]
        if column.summed:
            values = wrapped_sums(values, column.kind)
        plain = (column.step, column.low, column.none) == (1.0, 0.0, None)
        found[column.name] = np.array(
            values
            if plain
            else [np.nan if v == column.none else column.low + column.step * v for v in values]
        )
    assert at == len(data)
    return found


def wrapped_sums(differences, kind):
    bits = 8 * int(kind[1])
    least = -(2 ** (bits - 1)) if kind[0] == "i" else 0
    values, value = [], 0
    for difference in differences:
        value = (value + difference - least) % 2**bits + least
        values.append(value)
    return values


def unpacked_table(table):
    """Columns of a packed table by name."""
    columns = [PackedColumn(**one) for one in table["columns"]]
    return unpacked(table["data"], table["rows"], columns)
