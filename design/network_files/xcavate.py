"""Read vessels from X-CAVATE's text (points in cm), and join them to a network."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final, NoReturn

import numpy as np

from design.errors import NetworkError
from design.network import VesselKind, VesselNetwork
from design.network_files.join import REACH, Line, Snap, join_lines
from design.network_files.merge import merge_shared
from design.units import MM_PER
from kernels.arrays import FloatArray, IntArray

_MM: Final = MM_PER["cm"]
_HEAD: Final = re.compile(r"vessel:\s*(\d+)\s*,\s*number of points:\s*(\d+)\s*$", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class XcavateNetwork:
    """A network of such a file, and how its vessels were joined.

    Attributes
    ----------
    network : VesselNetwork
    snaps : tuple of Snap
        Every end that was put on the axis of another vessel; vessels by the file's numbers.
    notes : tuple of str
        Sentences for the user.
    """

    network: VesselNetwork
    snaps: tuple[Snap, ...]
    notes: tuple[str, ...]


def read_network_xcavate(
    path: Path, ends: Path | None = None, kind: VesselKind = VesselKind.ARTERY
) -> XcavateNetwork:
    """Read vessels and join them.

    A vessel is a line ``Vessel: 0, Number of Points: 100`` and a line ``x, y, z, radius`` for
    each point, all in cm; a fifth number, where there is one, is 0 in a vein and another in an
    artery. Vessels begin and end within the vessel that they leave or join, not on its axis:
    `join_lines` puts them there, once lines through one lumen are merged. Designed flow runs along
    each vessel as it is given.

    Parameters
    ----------
    path : Path
    ends : Path, optional
        The file of inlets and outlets: the word ``inlet`` or ``outlet`` on a line of its own, then
        a line ``x, y, z`` (cm) for each. A vessel that ends at an inlet or begins at an outlet is
        turned round.
    kind : VesselKind
        Of points without a fifth number.

    Raises
    ------
    NetworkError
        For a line that can't be read, another number of points than announced, a radius not above
        0, a vessel without length, or an inlet where no vessel ends; with the line.
    OSError
        When a file can't be read.
    """
    lines = _lines(path, kind)
    if ends is not None:
        lines = _turned(lines, ends)
    merged, notes = _merged(path, lines)
    joined = join_lines(path, merged)
    # Merged vessels meet at nodes already.
    snaps = tuple(snap for snap in joined.snaps if not notes or snap.moved_mm > 0.0)
    return XcavateNetwork(joined.network, snaps, (*notes, _note(snaps, joined.free)))


def _merged(path: Path, lines: list[Line]) -> tuple[list[Line], tuple[str, ...]]:
    """Lines without what runs along others, and notes on it."""
    kinds = [np.diff(line.kind[:-1], prepend=line.kind[0]) != 0 for line in lines]
    parts = [
        (line, a, b)
        for line, cut in zip(lines, kinds, strict=True)
        for a, b in pairwise([0, *np.flatnonzero(cut).tolist(), len(line.points) - 1])
    ]
    network = VesselNetwork(
        nodes=np.concatenate([line.points[[a, b]] for line, a, b in parts]),
        vessel_nodes=np.arange(2 * len(parts)).reshape(-1, 2),
        kind=np.array([line.kind[a] for line, a, _ in parts]),
        tree=np.zeros(len(parts), dtype=np.int64),
        offset=np.cumsum([0, *(b - a + 1 for _, a, b in parts)]),
        points=np.concatenate([line.points[a : b + 1] for line, a, b in parts]),
        radius=np.concatenate([line.radius[a : b + 1] for line, a, b in parts]),
    )
    merged, notes = merge_shared(path, network)
    if not notes:
        return lines, ()
    origin = {
        tuple(point): (line.vessel, number)
        for line in reversed(lines)
        for point, number in zip(line.points.tolist(), line.number.tolist(), strict=True)
    }
    left = []
    for k in range(merged.vessel_count):
        points, radius = merged.polyline(k)
        places = [origin[place] for place in map(tuple, points.tolist()) if place in origin]
        vessel, number = places[0] if places else (lines[0].vessel, int(lines[0].number[0]))
        kind = np.full(len(points), merged.kind[k])
        left.append(Line(vessel, np.full(len(points), number), points, radius, kind))
    return left, notes


def _note(snaps: tuple[Snap, ...], free: int) -> str:
    loose = f"free ends (inlets, outlets or loose): {free}"
    if not snaps:
        return f"No vessel begins or ends within another; {loose}."
    far = max(snaps, key=lambda snap: snap.moved_mm)
    return (
        f"Ends of vessels put on the axis of the vessel within which they lie: {len(snaps)}, by "
        f"{np.mean([snap.moved_mm for snap in snaps]):.3f} mm on average and "
        f"{far.moved_mm:.3f} mm at most ({far.end} of the file's vessel {far.vessel}, on vessel "
        f"{far.onto}); {loose}."
    )


def _fail(path: Path, number: int, text: str) -> NoReturn:
    raise NetworkError(f"{path}, line {number}: {text}")


def _text(path: Path) -> Iterator[tuple[int, str]]:
    """Lines that hold something, and their numbers."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as exc:
        raise NetworkError(f"{path}: not UTF-8 text; save the network as text") from exc
    for number, row in enumerate(text.splitlines(), start=1):
        if row.strip():
            yield number, row.strip()


def _lines(path: Path, kind: VesselKind) -> list[Line]:
    heads: list[tuple[int, int, int]] = []
    rows: list[list[tuple[int, list[float]]]] = []
    columns = 0
    for number, row in _text(path):
        if match := _HEAD.match(row):
            heads.append((number, int(match[1]), int(match[2])))
            rows.append([])
            continue
        if not heads:
            _fail(path, number, f"{row[:60]!r} stands before any 'Vessel: 0, Number of Points: n'")
        values = _numbers(path, number, row)
        columns = columns or len(values)
        if len(values) != columns or columns not in (4, 5):
            _fail(
                path,
                number,
                f"{len(values)} numbers; each point needs x, y, z, radius, and in all or none a "
                "fifth for artery or vein",
            )
        if values[3] <= 0:
            _fail(path, number, f"radius {values[3]:g} cm isn't above 0; mend the line")
        rows[-1].append((number, values))
    if not heads:
        raise NetworkError(
            f"{path}: no line 'Vessel: 0, Number of Points: n'; this isn't X-CAVATE's network"
        )
    return [_line(path, head, own, kind) for head, own in zip(heads, rows, strict=True)]


def _numbers(path: Path, number: int, row: str) -> list[float]:
    try:
        values = [float(word) for word in row.split(",")]
    except ValueError:
        _fail(path, number, f"{row[:60]!r} isn't numbers between commas; mend the line")
    if not np.isfinite(values).all():
        _fail(path, number, f"{row[:60]!r}: a number is NaN or infinite; mend the line")
    return values


def _line(
    path: Path,
    head: tuple[int, int, int],
    rows: list[tuple[int, list[float]]],
    kind: VesselKind,
) -> Line:
    number, vessel, announced = head
    if len(rows) != announced:
        _fail(
            path, number, f"vessel {vessel} announces {announced} points and has {len(rows)}; mend"
        )
    table = np.array([values for _, values in rows]).reshape(len(rows), -1 if rows else 4)
    moves = np.ones(len(rows), dtype=bool)
    moves[1:] = np.any(np.diff(table[:, :3], axis=0) != 0.0, axis=1)
    if moves.sum() < 2:
        _fail(path, number, f"vessel {vessel} has fewer than two points apart; remove or mend it")
    table = table[moves]
    kinds: IntArray = np.full(len(table), int(kind), dtype=np.int64)
    if table.shape[1] == 5:
        kinds = np.where(table[:, 4] == 0, int(VesselKind.VEIN), int(VesselKind.ARTERY))
    return Line(
        vessel=vessel,
        number=np.array([n for n, _ in rows], dtype=np.int64)[moves],
        points=table[:, :3] * _MM,
        radius=table[:, 3] * _MM,
        kind=kinds.astype(np.int64),
    )


def _turned(lines: list[Line], ends: Path) -> list[Line]:
    """The same lines, those turned round that end at an inlet or begin at an outlet."""
    turned = list(lines)
    tips = np.array([line.points[[0, -1]] for line in lines])
    reach = REACH * np.array([line.radius[[0, -1]] for line in lines])
    for number, word, place in _ends(ends):
        gap = np.linalg.norm(tips - place, axis=2)
        which, side = np.unravel_index(int(np.argmin(gap)), gap.shape)
        if gap[which, side] > reach[which, side]:
            _fail(
                ends,
                number,
                f"the nearest end of a vessel to this {word} is {gap[which, side]:.3g} mm away "
                f"(vessel {lines[which].vessel}); at most its radius plus 5 % is allowed",
            )
        if (word == "inlet") == bool(side):
            turned[which] = lines[which].reversed()
    return turned


def _ends(path: Path) -> Iterator[tuple[int, str, FloatArray]]:
    word = ""
    for number, row in _text(path):
        if row.lower() in ("inlet", "outlet"):
            word = row.lower()
            continue
        values = _numbers(path, number, row)
        if not word or len(values) != 3:
            _fail(path, number, f"{row[:60]!r} isn't 'inlet', 'outlet' or x, y, z below one")
        yield number, word, np.array(values) * _MM
