"""Pack all layers' outlines, and ink's overhang beyond them, as text for the G-code page."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from report.gcode.chunks import PLACE_COLUMNS
from report.gcode.colouring import Colouring
from report.gcode.part_outline import REACH_MM, DesignOutline
from report.packing import PackedColumn, pack_columns

MAX_POINTS: Final = 6_000_000
"""Of a page's outlines: about 30 MB."""
SCALE_UM: Final = 30.0
"""Where the colours end, either way."""
_SHARES: Final = (0.05, 0.5, 0.95)
_COLUMNS: Final = (*PLACE_COLUMNS[:2], PackedColumn("begins", "u1"), PackedColumn("beyond", "i2"))
_BEYOND: Final = Colouring(
    "beyond",
    "Ink beyond the design’s outline",
    "µm",
    (-SCALE_UM, SCALE_UM),
    (f"−{SCALE_UM:.0f}, wider", "0", f"{SCALE_UM:.0f}, narrower"),
    scale="diverging",
)


@dataclass(frozen=True)
class PackedOutlines:
    """Outlines of all layers.

    Attributes
    ----------
    points : list of int
        In each layer.
    data : list of str
        Of each: x and y, whether a ring begins at the point, and how far ink lies beyond the piece
        that leads to it in µm, as columns.
    beyond_um : list of list of float
        Of each layer, what 5, 50 and 95 % of the outline's pieces stay below; empty where no ink
        is near any.
    """

    points: list[int]
    data: list[str]
    beyond_um: list[list[float]]

    @property
    def view(self) -> dict[str, object]:
        """All but the packed numbers, as JSON values."""
        return {
            "points": self.points,
            "beyond": self.beyond_um,
            "columns": [asdict(one) for one in _COLUMNS],
            "scale": asdict(_BEYOND),
        }


def pack_outlines(outlines: Iterable[DesignOutline]) -> PackedOutlines | None:
    """Pack the outlines of a job's layers, lowest first; None for more than `MAX_POINTS`."""
    points: list[int] = []
    data: list[str] = []
    beyond: list[list[float]] = []
    for outline in outlines:
        count, text = _packed(outline)
        points.append(count)
        data.append(text)
        beyond.append(beyond_um(outline))
        if sum(points) > MAX_POINTS:
            return None
    return PackedOutlines(points, data, beyond)


def beyond_um(outline: DesignOutline) -> list[float]:
    """How far ink lies beyond the outline, µm: 5th, 50th and 95th percentile along it."""
    beyond = np.concatenate([np.zeros(0), *outline.beyond_mm])
    near = beyond[beyond > -REACH_MM]
    return [] if not len(near) else (1e3 * np.quantile(near, _SHARES)).round(1).tolist()


def _packed(outline: DesignOutline) -> tuple[int, str]:
    places = np.concatenate([np.zeros((0, 2)), *outline.rings])
    begins = np.zeros(len(places), np.uint8)
    begins[np.cumsum([0, *map(len, outline.rings)])[:-1]] = 1
    beyond = np.concatenate([np.zeros(0), *map(_with_first, outline.beyond_mm)])
    values = {"x": places[:, 0], "y": places[:, 1], "begins": begins, "beyond": 1e3 * beyond}
    return len(places), pack_columns(_COLUMNS, values)


def _with_first(values: FloatArray) -> FloatArray:
    """A ring's pieces lead to its points but the first."""
    return np.concatenate([[0.0], values])
