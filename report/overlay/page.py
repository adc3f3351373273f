"""Write the HTML page of a scan overlaid on the G-code: layer slider, pictures and numbers."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from markupsafe import Markup

from design.files import write_text
from registration.overlay import OverlayLayer, OverlaySpot
from report.page_frame import render
from report.wording import MISSING, fixed, number

_STATIC: Final = Path(__file__).parent / "static"
_ENTRY: Final = 'import "overlay/main";'
MOST_BYTES: Final = 60_000_000
"""Of pictures in one page; of more, layers without a finding are left out."""


@dataclass(frozen=True)
class OverlayPage:
    """What the page says besides its layers.

    Attributes
    ----------
    title : str
    facts : tuple of str
        A line of short facts under the title.
    verdict : tuple of str
        What was found, the first as heading.
    good : bool or None
        Whether nothing was found; None where there was nothing to judge.
    notes : tuple of str
        Sentences: the pose in force, what the numbers rest on.
    """

    title: str
    facts: tuple[str, ...]
    verdict: tuple[str, ...]
    good: bool | None
    notes: tuple[str, ...]


def write_overlay_html(
    path: Path,
    page: OverlayPage,
    layers: Sequence[OverlayLayer],
    pictures: Mapping[int, bytes],
) -> None:
    """Write the page; it holds all it shows.

    Parameters
    ----------
    path : Path
        The file; an old one is replaced only by a whole new one.
    page : OverlayPage
    layers : sequence of dict
        Of `registration.overlay.overlay_dict`, the lowest first.
    pictures : mapping of int to bytes
        PNG of each layer, by its number.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    kept = _chosen(layers, pictures)
    context = {
        "page": page,
        "pictures": [_picture(one, pictures[one["layer"]]) for one in kept],
        "first": _first(kept),
        "rows": [_row(one, one in kept) for one in layers],
        "left_out": len(layers) - len(kept),
    }
    write_text(path, render("overlay.html", context, _ENTRY, [_STATIC / "overlay.css"]))


def _chosen(layers: Sequence[OverlayLayer], pictures: Mapping[int, bytes]) -> list[OverlayLayer]:
    """Layers whose pictures go into the page: those with a finding first, then evenly spread."""
    room, kept = MOST_BYTES, set()
    spread = sorted(range(len(layers)), key=lambda k: (not _finding(layers[k]), _reversed_bits(k)))
    for k in spread:
        size = len(pictures[layers[k]["layer"]])
        if size <= room:
            room -= size
            kept.add(k)
    return [layers[k] for k in sorted(kept)]


def _reversed_bits(k: int) -> int:
    """Order in which the first few of many lie evenly among all (van der Corput)."""
    return int(f"{k:020b}"[::-1], 2)


def _finding(layer: OverlayLayer) -> bool:
    return bool(layer["gap_count"] or layer["blob_count"])


def _first(kept: Sequence[OverlayLayer]) -> int:
    """Place of the layer shown first: the one with most wrong, else the middle one."""
    worst = max(range(len(kept)), key=lambda k: _wrong(kept[k]), default=0)
    return worst if kept and _wrong(kept[worst]) > 0 else (len(kept) - 1) // 2


def _wrong(layer: OverlayLayer) -> float:
    return float((layer["gap_mm2"] or 0.0) + (layer["blob_mm2"] or 0.0))


@dataclass(frozen=True)
class _Picture:
    """Of a layer, as the page's template shows it."""

    layer: int
    status: str
    source: Markup
    said: list[str]


@dataclass(frozen=True)
class _Cell:
    """Of the page's table: what it is sorted by, what it says, whether it is marked."""

    order: float | str
    text: str
    mark: str = ""


@dataclass(frozen=True)
class _Row:
    """Of the page's table; `shown` where the layer has a picture."""

    layer: int
    shown: bool
    cells: list[_Cell]


def _picture(layer: OverlayLayer, png: bytes) -> _Picture:
    data = base64.b64encode(png).decode("ascii")
    source = Markup("data:image/png;base64," + data)
    return _Picture(layer["layer"], layer["status"], source, _said(layer))


def _said(layer: OverlayLayer) -> list[str]:
    """Sentences on a layer's largest gap and blob."""
    said = []
    for spots, what in ((layer["gaps"], "gap"), (layer["blobs"], "blob of gel in a lumen")):
        if not spots:
            continue
        one = spots[0]
        text = (
            f"Largest {what}: {number(one['area_mm2'], 2)} mm², {number(one['width_um'], 2)} µm "
            f"wide, at x {fixed(one['at_mm'][0], 2)}, y {fixed(one['at_mm'][1], 2)}, "
            f"z {fixed(one['at_mm'][2], 2)} mm."
        )
        said.append(text + (f" {_lines(one)}" if "lines" in one else ""))
    return said


def _lines(gap: OverlaySpot) -> str:
    named, count = gap["lines"], gap["line_count"]
    if count == 1:
        return f"Line {named[0]} of the G-code should have filled it."
    if count > len(named):
        return (
            f"{number(count)} lines of the G-code should have filled it, {gap['first_line']} "
            f"to {gap['last_line']}."
        )
    return f"Lines {', '.join(map(str, named))} of the G-code should have filled it."


def _row(layer: OverlayLayer, shown: bool) -> _Row:
    shares = layer["seen_share"], layer["gel_in_written_share"], layer["gel_in_free_share"]
    mark = "bad" if layer["status"] == "missing" else ""
    cells = [
        _Cell(layer["cut_mm"], fixed(layer["cut_mm"], 3)),
        _Cell(layer["status"], layer["status"], mark),
        *map(_percent, shares),
        _amount(layer["gap_count"], layer["gap_mm2"]),
        _amount(layer["blob_count"], layer["blob_mm2"]),
        _Cell(layer["first_line"], f"{layer['first_line']}\u2013{layer['last_line']}"),
    ]
    return _Row(layer["layer"], shown, cells)


def _percent(share: float | None) -> _Cell:
    return _Cell("", MISSING) if share is None else _Cell(share, fixed(100 * share, 1))


def _amount(count: int | None, area: float | None) -> _Cell:
    """Count and area together; nothing for none."""
    if count is None or area is None:
        return _Cell("", MISSING)
    return _Cell(area, f"{count}, {number(area, 2)} mm²" if count else "none", "bad" * bool(count))
