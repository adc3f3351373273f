"""Read a network from CSV with a point and its parent per row, as in SWC."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Final

import numpy as np

from design.errors import NetworkError
from design.network import VesselKind, VesselNetwork
from design.network_files.swc import PointRow, trees_of_points
from design.units import MM_PER, LengthUnit

POINT_COLUMNS: Final = ("x", "y", "z", "radius", "parent")
_KINDS: Final = {kind.name.lower(): int(kind) for kind in VesselKind}


def has_points(path: Path) -> bool:
    """Whether the columns of a CSV file are those of points with parents.

    Raises
    ------
    OSError
        When the file can't be read.
    """
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        names = next(csv.reader([file.readline()]), [])
    return {name.strip().lower() for name in names} >= set(POINT_COLUMNS)


def read_points_csv(path: Path, unit: LengthUnit) -> VesselNetwork:
    """Read points with the columns x, y, z, radius, parent, and id and kind where they are given.

    All lengths are in the file's unit. The parent is the ``id`` of another row; without a column
    ``id`` rows are numbered from 0. A root's parent is -1 or empty.

    Raises
    ------
    NetworkError
        For a number that can't be read, and as `trees_of_points`; with the line.
    OSError
        When the file can't be read.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as exc:
        raise NetworkError(f"{path}: not UTF-8 text; save the network as CSV") from exc
    reader = csv.reader(io.StringIO(text, newline=""))
    names = [name.strip().lower() for name in next(reader)]
    line: list[int] = []
    rows: list[PointRow] = []
    for fields in reader:
        if not any(field.strip() for field in fields):
            continue
        given = dict(zip(names, (field.strip() for field in fields), strict=False))
        try:
            x, y, z, radius = (float(given[name]) for name in POINT_COLUMNS[:4])
            number = int(given["id"]) if "id" in given else len(rows)
            parent = int(given["parent"] or -1)
            kind = _KINDS[given.get("kind") or "artery"]
        except (KeyError, ValueError) as exc:
            raise NetworkError(
                f"{path}, line {reader.line_num}: {','.join(fields)!r} isn't {', '.join(names)}; "
                "id and parent are whole numbers (parent -1: a root), kind is one of "
                f"{', '.join(_KINDS)}"
            ) from exc
        if parent == number:
            start = "" if "id" in names else "; rows count from 0, or give a column id"
            raise NetworkError(
                f"{path}, line {reader.line_num}: point {number} is its own parent{start}"
            )
        line.append(reader.line_num)
        rows.append((number, kind, x, y, z, radius, parent))
    return trees_of_points(path, line, rows, np.full(4, MM_PER[unit]))
