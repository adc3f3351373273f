"""Read a 3MF file that holds one plain mesh, without a (slow) XML parser.

Any other content (several objects, components, transforms, attributes in another order) is left to
`design.solids.read`, which takes trimesh for it.
"""

from __future__ import annotations

import re
import zipfile
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.solids.decimal_text import Marks, read_rows
from design.solids.threemf import TRIANGLE, VERTEX

_MODEL: Final = "3D/3dmodel.model"
_OTHER: Final = (
    b"<components",
    b"transform=",
    b"<!--",
    b"<![CDATA[",
    b"requiredextensions=",
    b'type="s',  # a support, or a surface
)
"""What asks for a whole reader."""
_NUMBERS: Final = b"0123456789.+-eE \t\r\n"


def read_plain_3mf(
    path: Path,
) -> tuple[NDArray[np.float64], NDArray[np.int64], str] | None:
    """Read vertices (n, 3), faces (m, 3) and the unit's name; None where the file isn't plain.

    Raises
    ------
    OSError
        When the file can't be opened.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            model = archive.read(_MODEL)
    except (zipfile.BadZipFile, KeyError, EOFError, NotImplementedError):
        return None
    vertices_text, before, rest = _list_of(model, b"vertices")
    triangles_text, between, after = _list_of(rest, b"triangles")
    if vertices_text is None or triangles_text is None:
        return None
    around = before + between + after
    begin = re.search(rb"<model\b[^>]*>", before)
    whole = begin is not None and after.rstrip().endswith(b"</model>")
    single = around.count(b"<object ") == 1 and around.count(b"<item ") == 1
    if begin is None or not whole or not single or any(mark in around for mark in _OTHER):
        return None
    vertices = _numbers(vertices_text, VERTEX)
    faces = _numbers(triangles_text, TRIANGLE)
    if vertices is None or faces is None or not _indices(faces, len(vertices)):
        return None
    unit = re.search(rb'\bunit="(\w+)"', begin.group())
    return vertices, faces.astype(np.int64), unit.group(1).decode() if unit else "millimeter"


def _list_of(model: bytes, name: bytes) -> tuple[bytes | None, bytes, bytes]:
    """What stands within the first element ``name``, before and after it; None without one."""
    before, begins, rest = model.partition(b"<" + name + b">")
    within, ends, after = rest.partition(b"</" + name + b">")
    return (within if begins and ends else None), before, after


def _numbers(text: bytes, around: Marks) -> NDArray[np.float64] | None:
    """Three numbers of each element of a list, (n, 3); None where there is more in it."""
    read = read_rows(text, around)
    if read is not None:
        return read
    count = text.count(around[0])
    for mark in around:
        text = text.replace(mark.strip(), b" ")
    if text.translate(None, _NUMBERS):
        return None
    values = np.fromstring(text, sep=" ")
    return values.reshape(-1, 3) if len(values) == 3 * count else None


def _indices(faces: NDArray[np.float64], count: int) -> bool:
    """Whether these are whole numbers of vertices."""
    whole = faces == np.floor(faces)
    return bool(len(faces) and np.all(whole & (faces >= 0) & (faces < count)))
