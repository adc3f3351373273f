"""Read a network from CSV with a point and its parent per row, as in SWC."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from design.errors import NetworkError
from design.network import VesselKind, VesselNetwork
from design.network_files.csv_format import open_table, table_rows
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
    _, names = open_table(path.read_text(encoding="utf-8-sig", errors="replace"))
    return set(names) >= set(POINT_COLUMNS)


def read_points_csv(path: Path, unit: LengthUnit) -> VesselNetwork:
    """Read points with the columns x, y, z, radius, parent, and id and kind where they are given.

    Fields are separated by commas, semicolons or tabs. All lengths are in the file's unit. The
    parent is the ``id`` of another row; without a column ``id`` rows are numbered from 0. A root's
    parent is -1 or empty.

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
    table, names = open_table(text)
    doubled = [name for name in dict.fromkeys(names) if name and names.count(name) > 1]
    if doubled:
        raise NetworkError(f"{path}: column {', '.join(doubled)} is doubled; keep one of each")
    line: list[int] = []
    rows: list[PointRow] = []
    for at, fields in table_rows(path, table, names):
        given = dict(zip(names, (field.strip() for field in fields), strict=True))
        try:
            x, y, z, radius = (float(given[name]) for name in POINT_COLUMNS[:4])
            number = int(given["id"]) if "id" in given else len(rows)
            parent = int(given["parent"] or -1)
            kind = _KINDS[given.get("kind") or "artery"]
        except (KeyError, ValueError) as exc:
            raise NetworkError(
                f"{path}, line {at}: {','.join(fields)!r} isn't {', '.join(names)}; "
                "id and parent are whole numbers (parent -1: a root), kind is one of "
                f"{', '.join(_KINDS)}"
            ) from exc
        if parent < -1:
            raise NetworkError(
                f"{path}, line {at}: parent {parent} isn't a row; give -1 for a root"
            )
        if parent == number:
            start = "" if "id" in names else "; rows count from 0, or give a column id"
            raise NetworkError(f"{path}, line {at}: point {number} is its own parent{start}")
        line.append(at)
        rows.append((number, kind, x, y, z, radius, parent))
    return trees_of_points(path, line, rows, np.full(4, MM_PER[unit]))
