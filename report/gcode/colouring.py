"""Choose colour scales for a job's lines: width, kind, speed, order, height or vessel."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import cycle
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from registration.gcode_job import GcodeJob
from report.picture.colours import TREE_COLOURS
from report.picture.quantity import ScaleKind

_KNOWN: Final = {
    "external perimeter": "#d55e00", "outer wall": "#d55e00", "wall-outer": "#d55e00",
    "outer perimeter": "#d55e00", "perimeter": "#e69f00", "inner wall": "#e69f00",
    "wall-inner": "#e69f00", "inner perimeter": "#e69f00", "overhang perimeter": "#cc79a7",
    "solid infill": "#0072b2", "internal solid infill": "#0072b2", "skin": "#0072b2",
    "internal infill": "#56b4e9", "sparse infill": "#56b4e9", "fill": "#56b4e9",
    "gap fill": "#009e73", "gap infill": "#009e73",
}  # fmt: skip
_LEAST_SPAN: Final = 0.1
"""Of the middle value: narrower limits would show the rounding of the file as differences."""
_CONSTANT_SPAN: Final = 1e-3
"""Of the greatest value: what rounding of the file alone makes of a constant."""


@dataclass(frozen=True)
class Colouring:
    """One way to colour.

    Attributes
    ----------
    key : str
        A `GcodeColour`, or of a prediction (`report.play`) also ``off`` and ``head``.
    name, unit : str
    limits : tuple of 2 floats
        Where the scale ends; values beyond take the colour of its end. Of the places of `labels`
        where there are some; of the share of the layer for the order.
    extremes : tuple of 2 floats, optional
        Least and greatest value, where they lie beyond `limits`.
    labels, colours : tuple of str
        Of "names"; of other scales the labels are the ticks' texts.
    scale : {"linear", "diverging", "names"}
    """

    key: str
    name: str
    unit: str = ""
    limits: tuple[float, float] = (0.0, 1.0)
    labels: tuple[str, ...] = ()
    colours: tuple[str, ...] = ()
    scale: ScaleKind = "linear"
    extremes: tuple[float, float] | None = None


PLAIN: Final = Colouring(
    "line", "One colour", labels=("written line",), colours=("#ccd6de",), scale="names"
)
"""Pale, for lines under the design's outline."""


def colourings(job: GcodeJob) -> list[Colouring]:
    """Those that say something of this job."""
    writes, chosen = job.writes, []
    if not np.isnan(job.width_mm[writes]).all():
        chosen.append(width_colouring("Line width", job.width_mm[writes], job.way_mm[writes]))
    named = np.unique(job.kind[writes])
    if (named >= 0).any():
        chosen.append(Colouring("kind", "Kind of line", "", (0.0, 1.0), *_kinds(job), "names"))
    chosen.append(
        Colouring("speed", "Speed, as fed", "mm/s", usual_span(job.speed_mm_s[writes], None))
    )
    chosen.append(Colouring("order", "Order of writing", labels=("first", "last")))
    z = job.end[writes, 2]
    if job.layers.passes:
        chosen.insert(0, Colouring("height", "Height z", "mm", (float(z.min()), float(z.max()))))
    if job.vessel is not None:
        chosen.append(Colouring("vessel", "Vessel", "", (0.0, 1.0), (), TREE_COLOURS, "names"))
    return chosen


def width_colouring(name: str, width_mm: FloatArray, way_mm: FloatArray) -> Colouring:
    """Widths (n,), mm, of written ways (n,), mm, on the scale of the usual ones."""
    known = width_mm[~np.isnan(width_mm)]
    limits = usual_span(width_mm, way_mm)
    constant = limits[0] == limits[1]
    extremes = limits if constant else (float(known.min()), float(known.max()))
    return Colouring("width", name, "mm", limits, extremes=extremes)


def usual_span(values: FloatArray, weights: FloatArray | None) -> tuple[float, float]:
    """Return the span of all but the outermost hundredths of the written way.

    It is never one of mere rounding: equal limits for a constant, else at least `_LEAST_SPAN`.

    Parameters
    ----------
    values : (n,) float64
    weights : (n,) float64 or None
        Way of each; without it the span is that of all values.
    """
    least, greatest = float(np.nanmin(values)), float(np.nanmax(values))
    if greatest - least <= _CONSTANT_SPAN * abs(greatest):
        constant = float(np.nanmedian(values))
        return constant, constant
    order = np.argsort(values)
    weight = np.ones(len(values)) if weights is None else weights[order]
    share = np.cumsum(weight) / weight.sum()
    at = np.minimum(np.searchsorted(share, (0.01, 0.5, 0.99)), len(order) - 1)
    low, middle, high = (float(value) for value in values[order[at]])
    if weights is None:
        low, high = least, greatest
    half = _LEAST_SPAN * middle / 2
    return min(low, middle - half), max(high, middle + half)


def _kinds(job: GcodeJob) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names, and a colour for each: the usual one, else one that is still free, while there is."""
    known = [_KNOWN.get(name.lower()) for name in job.kinds]
    free = [colour for colour in TREE_COLOURS if colour not in known] or list(TREE_COLOURS)
    spare = cycle(free)
    return job.kinds, tuple(colour or next(spare) for colour in known)
