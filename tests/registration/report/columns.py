"""Reader of packed columns, the slow way: what the page's script does."""

import base64
import struct
import zlib

import numpy as np


def unpacked(text, n, columns):
    """Columns of `n` rows by name; `columns` are of `registration.report.packing.PackedColumn`."""
    data, at, found = zlib.decompress(base64.b64decode(text)), 0, {}
    for column in columns:
        size = int(column.kind[1])
        planes = data[at : at + size * n]
        at += size * n
        code = {"u1": "B", "u2": "<H", "i2": "<h", "i4": "<i", "f4": "<f"}[column.kind]
        rows = [bytes(planes[k * n + i] for k in range(size)) for i in range(n)]
        values = np.array([struct.unpack(code, row)[0] for row in rows])
        if column.summed:
            values = np.cumsum(values)
        none = values == column.none
        found[column.name] = (
            np.where(none, np.nan, values * column.step)
            if none.any()
            else (values if column.step == 1 else values * column.step)
        )
    assert at == len(data)
    return found
