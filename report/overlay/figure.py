"""Draw one layer as PNG: the scan under the G-code lines, and the gaps and blobs found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from registration.overlay.cut import ScanCut
from registration.overlay.measure import LayerNumbers, LayerStatus
from registration.overlay.raster import LayerLines, PixelPatch, Raster
from report.drawing import styled, to_png
from report.gcode.bands import band_outlines
from report.svg import INK, MUTED
from report.wording import number

WALL: Final = "#f0a030"
INFILL: Final = "#3fa7e0"
TRAVEL: Final = "#ffffff"
GAP: Final = "#e5007d"
BLOB: Final = "#ffe14d"
UNSEEN: Final = "#b9c3cf"
GEL: Final = "#8d959c"
NO_GEL: Final = "#ffffff"
LUMEN: Final = "#cfe6f5"
_WIDTH_IN: Final = 9.2
_DPI: Final = 120
_BAND_ALPHA: Final = 0.20
_HATCH: Final = "////"


@dataclass(frozen=True)
class PictureOf:
    """What is drawn of one layer.

    Attributes
    ----------
    numbers : LayerNumbers
    status : LayerStatus
    cut : ScanCut
    lumen : (ny, nx) bool
        Where the design is free.
    raster : Raster
    grey : (float, float)
        Scan values drawn black and white.
    scale : str
        "dB" or "linear".
    count : int
        Layers of the job.
    """

    numbers: LayerNumbers
    status: LayerStatus
    cut: ScanCut
    lumen: NDArray[np.bool_]
    raster: Raster
    grey: tuple[float, float]
    scale: str
    count: int


def draw_overlay(what: PictureOf) -> bytes:
    """Draw a layer from above, y upwards, in mm of the part; a PNG of at most 256 colours."""
    with styled():
        return to_png(_figure(what), _DPI, palette=True)


def _figure(what: PictureOf) -> Figure:
    left, right, bottom, top = what.raster.extent_mm
    shape = (top - bottom) / (right - left)
    beside = shape > 0.75
    panel = _WIDTH_IN * (0.47 if beside else 0.93) * float(np.clip(shape, 0.15, 1.8))
    height = 1.25 + (panel + 0.3 if beside else 2 * panel + 0.75)
    figure = Figure(figsize=(_WIDTH_IN, height), dpi=_DPI, layout="constrained")
    figure.set_facecolor("white")
    grid = (1, 2) if beside else (2, 1)
    axes: Sequence[Axes] = figure.subplots(*grid, sharex=True, sharey=True).ravel().tolist()
    _scan_panel(axes[0], what)
    _found_panel(axes[1], what)
    for one in axes:
        one.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    axes[0].set_ylabel("y / mm")
    axes[1].set_xlabel("x / mm")
    if beside:
        axes[0].set_xlabel("x / mm")
    else:
        axes[1].set_ylabel("y / mm")
    figure.suptitle(_title(what), fontsize=10.5, x=0.01, ha="left", color=INK)
    figure.legend(
        handles=_handles(), loc="outside lower left", ncols=5, fontsize=8.0, labelcolor=INK
    )
    return figure


def _title(what: PictureOf) -> str:
    layer, status = what.numbers.layer, what.status
    parts = [
        f"Layer {layer.number} of {what.count}",
        f"cut at z = {layer.middle_mm:.3f} mm",
        f"{status} to line {layer.line[-1]}" if status == LayerStatus.UNDER_WAY else str(status),
    ]
    if status.judged:
        parts.append(_amount(what.numbers.gaps, "gap"))
        parts.append(_amount(what.numbers.blobs, "blob"))
    return "  ·  ".join(parts)


def _amount(spots: Sequence[PixelPatch], noun: str) -> str:
    if not spots:
        return f"no {noun}"
    area = number(sum(spot.area_mm2 for spot in spots), 2)
    return f"{len(spots)} {noun}{'s' if len(spots) > 1 else ''}, {area} mm²"


def _scan_panel(axes: Axes, what: PictureOf) -> None:
    """The scan, lines to scale over it, and rings about what is wrong."""
    _head(axes, f"Scan ({what.scale}) and the layer's lines")
    shown = np.ma.masked_invalid(what.cut.grey)
    low, high = what.grey
    _image(axes, what, shown, cmap="gray", vmin=low, vmax=high)
    _veil(axes, what)
    _lines(axes, what.numbers.layer)
    _rings(axes, what)


def _found_panel(axes: Axes, what: PictureOf) -> None:
    """Gel or not, lumens, gaps and blobs."""
    _head(axes, "Gel by the segmentation, held against the lines")
    cut, numbers = what.cut, what.numbers
    colours = np.array([to_rgba(c) for c in (NO_GEL, GEL, LUMEN, GAP, BLOB)])
    kind = np.where(cut.gel, 1, np.where(what.lumen, 2, 0))
    if what.status.judged:
        for code, spots in ((3, numbers.gaps), (4, numbers.blobs)):
            for spot in spots:
                kind[spot.box][spot.mask] = code
    picture = colours[kind]
    picture[~cut.seen] = to_rgba(NO_GEL)
    _image(axes, what, picture)
    _veil(axes, what)
    _rings(axes, what)


def _head(axes: Axes, text: str) -> None:
    axes.set_title(text, fontsize=8.8, loc="left", color=MUTED)


def _image(axes: Axes, what: PictureOf, picture: Any, **more: Any) -> None:
    extent = what.raster.extent_mm
    axes.imshow(picture, extent=extent, origin="lower", interpolation="nearest", **more)


def _veil(axes: Axes, what: PictureOf) -> None:
    """Hatch what isn't seen: beyond the field of view without any ground, unlit over the scan."""
    hidden = ~what.cut.seen
    if not hidden.any():
        return
    veil = np.zeros((*hidden.shape, 4))
    veil[~what.cut.in_view] = to_rgba(UNSEEN)
    veil[hidden & what.cut.in_view] = to_rgba(UNSEEN, 0.55)
    _image(axes, what, veil)
    x, y = what.raster.x_mm, what.raster.y_mm
    # A colour alone could be taken for a grey value.
    hatched = axes.contourf(x, y, hidden.astype(float), [0.5, 1.5], colors="none", hatches=[_HATCH])
    hatched.set(edgecolor="#7d8894", linewidth=0.0)


def _lines(axes: Axes, layer: LayerLines) -> None:
    run = np.cumsum(~layer.joined, dtype=np.int64)
    outlines, of = band_outlines(
        layer.start, layer.end, layer.width_mm, run, layer.closed.astype(np.int64)
    )
    pair = np.array([to_rgba(INFILL, _BAND_ALPHA), to_rgba(WALL, _BAND_ALPHA)])
    rims = np.array([to_rgba(INFILL, 0.55), to_rgba(WALL, 0.8)])
    bands = PathCollection(outlines, facecolors=pair[of], edgecolors=rims[of], linewidths=0.35)
    axes.add_collection(bands, autolim=False)
    travels = LineCollection(
        list(layer.travel), colors=TRAVEL, alpha=0.4, linewidths=0.5, linestyles=[(0, (2, 2))]
    )
    axes.add_collection(travels, autolim=False)


def _rings(axes: Axes, what: PictureOf) -> None:
    """Outline each gap and blob, and mark the largest of each."""
    if not what.status.judged:
        return
    x, y = what.raster.x_mm, what.raster.y_mm
    for spots, colour in ((what.numbers.gaps, GAP), (what.numbers.blobs, BLOB)):
        if not spots:
            continue
        where = np.zeros(what.raster.shape)
        for spot in spots:
            where[spot.box][spot.mask] = 1.0
        axes.contour(x, y, where, [0.5], colors=colour, linewidths=1.0)
        axes.plot(*spots[0].at_mm, "o", ms=11, mfc="none", mec="white", mew=2.6)
        axes.plot(*spots[0].at_mm, "o", ms=11, mfc="none", mec=colour, mew=1.4)


def _handles() -> list[Artist]:
    def patch(colour: str, label: str, **more: Any) -> Artist:
        return Patch(facecolor=colour, edgecolor=MUTED, linewidth=0.5, label=label, **more)

    return [
        patch(WALL, "wall (closed line)"),
        patch(INFILL, "infill (open line)"),
        Line2D([], [], color=MUTED, linewidth=0.8, linestyle=(0, (2, 2)), label="travel (white)"),
        patch(UNSEEN, "not seen", hatch=_HATCH),
        patch(GEL, "gel"),
        patch(LUMEN, "lumen, free"),
        patch(NO_GEL, "no gel"),
        patch(GAP, "gap: written, no gel"),
        patch(BLOB, "blob: free, but gel"),
        Line2D([], [], color=INK, marker="o", mfc="none", ls="", ms=7, label="largest of its kind"),
    ]
