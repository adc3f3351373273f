"""Parse `network.csv` text into checked arrays of vessel pieces with their line numbers.

Columns: ``vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree``. Pieces that
meet share a node number; designed flow runs from node0 to node1. Radii are in mm always, as their
columns say; the coordinates' columns name no unit, so a reader must be told it.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from design.errors import NetworkError
from design.network import VesselKind
from kernels.arrays import FloatArray, IntArray

_HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree"
COLUMNS = tuple(_HEADER.split(","))

GAP_MM = 1e-6
"""Pieces that share a node number must meet within this distance, mm."""

_KIND_NUMBER = {kind.name.lower(): int(kind) for kind in VesselKind}


@dataclass(frozen=True)
class Pieces:
    """Straight pieces; piece ``i`` stands in line ``line[i]`` of ``path``.

    Attributes
    ----------
    line, vessel, kind, tree : (n,) int64
        As in the file.
    nodes : (n, 2) int64
        The file's node numbers.
    points : (n, 2, 3) float64, mm
        Both ends.
    radius : (n, 2) float64, mm
        At both ends.
    """

    path: Path
    line: IntArray
    vessel: IntArray
    nodes: IntArray
    points: FloatArray
    radius: FloatArray
    kind: IntArray
    tree: IntArray

    def __len__(self) -> int:
        return len(self.line)

    def fail(self, row: int, text: str) -> NoReturn:
        """Raise `NetworkError` about ``row`` with its file, line and vessel."""
        raise NetworkError(f"{self.path}, line {self.line[row]}, vessel {self.vessel[row]}: {text}")


def parse_pieces(path: Path, text: str, mm_per_unit: float) -> Pieces:
    """Turn the text of a `network.csv` into arrays.

    Raises
    ------
    NetworkError
        Column missing or doubled, row of wrong length, unreadable number, unknown kind.
    """
    lines, fields = _fields(path, text)

    def column(name: str, convert: Callable[[str], float]) -> list[float]:
        try:
            return [convert(field) for field in fields[name]]
        except (ValueError, KeyError):
            _blame(path, lines, name, fields[name], convert)

    def columns(names: str, convert: Callable[[str], float]) -> FloatArray:
        return np.array([column(name, convert) for name in names.split()]).T

    return Pieces(
        path=path,
        line=np.array(lines, dtype=np.int64),
        vessel=columns("vessel", int).ravel().astype(np.int64),
        nodes=columns("node0 node1", int).astype(np.int64),
        points=columns("x0 y0 z0 x1 y1 z1", float).reshape(-1, 2, 3) * mm_per_unit,
        radius=columns("radius0_mm radius1_mm", float),
        kind=columns("kind", lambda name: _KIND_NUMBER[name.strip()]).ravel().astype(np.int64),
        tree=columns("tree", int).ravel().astype(np.int64),
    )


def open_table(text: str) -> tuple[Table, list[str]]:
    """Rows below the header, and its column names in lower case.

    Fields are separated by the comma, semicolon or tab that the header has most of. Comments (#)
    and a spreadsheet's ``sep=;`` before the header are passed over.
    """
    stream = io.StringIO(text, newline=None)
    skipped, header = 0, ""
    for header in stream:
        if header.strip() and not header.lstrip().lower().startswith(("#", "sep=")):
            break
        skipped += 1
    separator = max(",;\t", key=header.count)
    names = [name.strip().lower() for name in next(csv.reader([header], delimiter=separator), [])]
    return Table(csv.reader(stream, delimiter=separator), skipped + 1), names


class Table(NamedTuple):
    """Reader of rows, and how many lines stand before them."""

    reader: Iterator[list[str]]
    before: int


def table_rows(path: Path, table: Table, header: Sequence[str]) -> Iterator[tuple[int, list[str]]]:
    """Line number and fields of each row that isn't empty or a comment.

    Raises
    ------
    NetworkError
        For a row of another length than the header.
    """
    for number, row in enumerate(table.reader, start=table.before + 1):
        if not row or row[0].lstrip().startswith("#") or not "".join(row).strip():
            continue
        if len(row) != len(header):
            raise NetworkError(
                f"{path}, line {number}: {len(row)} fields where the header has {len(header)}; "
                "give as many as there are columns"
            )
        yield number, row


def _fields(path: Path, text: str) -> tuple[list[int], dict[str, tuple[str, ...]]]:
    """Line number of each row, and the columns' text by name."""
    reader, header = open_table(text)
    wrong = [name for name in COLUMNS if header.count(name) != 1]
    if wrong:
        raise NetworkError(
            f"{path}, line {reader.before}: column {', '.join(wrong)} missing or doubled; "
            f"the header must name {_HEADER}, or for points with their parents "
            "x,y,z,radius,parent"
        )
    lines: list[int] = []
    rows: list[list[str]] = []
    for line, row in table_rows(path, reader, header):
        lines.append(line)
        rows.append(row)
    if not rows:
        raise NetworkError(f"{path}: no pieces below the header; give at least one vessel")
    return lines, dict(zip(header, zip(*rows, strict=True), strict=True))


def _blame(
    path: Path,
    lines: Sequence[int],
    name: str,
    fields: Sequence[str],
    convert: Callable[[str], float],
) -> NoReturn:
    """Find the field that ``convert`` refused, and say what was wanted."""
    wanted = f"one of {', '.join(_KIND_NUMBER)}" if name == "kind" else "a number"
    if name in ("vessel", "node0", "node1", "tree"):
        wanted = "a whole number"
    for line, field in zip(lines, fields, strict=True):
        try:
            convert(field)
        except (ValueError, KeyError) as exc:
            raise NetworkError(f"{path}, line {line}: {name} is {field!r}; give {wanted}") from exc
    raise NetworkError(f"{path}: column {name} can't be read; give {wanted}")


def check_pieces(pieces: Pieces) -> None:
    """Raise `NetworkError` for NaN, a radius not above 0, or a piece that joins itself."""
    finite = np.isfinite(pieces.points).all(axis=(1, 2)) & np.isfinite(pieces.radius).all(axis=1)
    if not finite.all():
        pieces.fail(int(np.argmin(finite)), "a number is NaN or infinite; mend the row")
    thin = pieces.radius.min(axis=1) <= 0
    if thin.any():
        row = int(np.argmax(thin))
        pieces.fail(row, f"radius {pieces.radius[row].min():g} mm isn't above 0; mend the row")
    circular = pieces.nodes[:, 0] == pieces.nodes[:, 1]
    if circular.any():
        row = int(np.argmax(circular))
        pieces.fail(row, f"the piece joins node {pieces.nodes[row, 0]} to itself; mend the row")
