"""Read a point cloud, with normals if given, from a PLY or text file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from design.errors import TissueError
from kernels.arrays import FloatArray

POINT_SUFFIXES: Final = (".ply", ".xyz", ".txt", ".csv")

_NORMAL = ("nx", "ny", "nz")


def read_points(path: Path) -> tuple[FloatArray, FloatArray | None]:
    """Points (n, 3) and, where the file has them, normals (n, 3).

    Text holds one point a line: x y z, or x y z nx ny nz, parted by blanks, commas or semicolons;
    a first line of names and lines that begin with # are passed over.

    Raises
    ------
    TissueError
        When the file can't be read, or has another number of columns.
    """
    if path.suffix.lower() == ".ply":
        return _read_ply(path)
    rows = _rows(path)
    widths = {len(row) for row in rows}
    if widths not in ({3}, {6}):
        raise TissueError(
            f"{path}: lines have {' or '.join(map(str, sorted(widths)))} columns; give x y z, or "
            "x y z nx ny nz"
        )
    table = np.array(rows, dtype=np.float64)
    return table[:, :3], table[:, 3:] if table.shape[1] == 6 else None


def _rows(path: Path) -> list[list[float]]:
    rows: list[list[float]] = []
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    for number, line in enumerate(lines):
        words = line.replace(",", " ").replace(";", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            rows.append([float(word) for word in words])
        except ValueError as error:
            if rows:
                raise TissueError(
                    f"{path}, line {number + 1}: {line[:60]!r} isn't numbers; mend the file"
                ) from error
    if not rows:
        raise TissueError(f"{path}: holds no points")
    return rows


def _read_ply(path: Path) -> tuple[FloatArray, FloatArray | None]:
    from trimesh.exchange.ply import load_ply  # heavy, and few who name a tissue read one

    # trimesh's readers raise whatever their parsers do.
    try:
        with path.open("rb") as file:
            loaded = load_ply(file)
    except Exception as error:
        raise TissueError(f"{path}: can't be read as points ({error})") from error
    data: Any = loaded.get("metadata", {}).get("_ply_raw", {}).get("vertex", {}).get("data")
    normals = None
    # A dict of columns from text, a structured array from binary files.
    fields = () if data is None else data if isinstance(data, dict) else data.dtype.names or ()
    if set(_NORMAL) <= set(fields):
        columns = [np.asarray(data[name], dtype=np.float64).ravel() for name in _NORMAL]
        normals = np.column_stack(columns)
    points = np.asarray(loaded.get("vertices", np.empty((0, 3))), dtype=np.float64)
    return points.reshape(-1, 3), normals
