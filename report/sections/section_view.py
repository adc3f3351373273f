"""Pack pictures and numbers of measured vessel sections for the report page's section viewer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from report.packing import PackedColumn, pack_table
from report.sections.facts import records
from report.views import Views
from report.views.stack import PIXELS

LEVELS: Final = 16
"""Shades in the page: half of what all 256 would take, and below what speckle lets an eye see."""
_KEYS: Final = ("along_mm", "diameter_um", "interval_95_um", "designed_along_um", "lower_um",
                "upper_um", "offset_along_um", "ovality_along", "decision_along")  # fmt: skip
_WALL: Final = tuple(PackedColumn(axis, "i2", none=32_767) for axis in "xy")


def section_view(registration: Mapping[str, Any], views: Views | None) -> dict[str, object] | None:
    """Pack the pictures and numbers of all sections; None where there are none.

    Returns
    -------
    dict
        ``vessels``: numbers along each; ``vessel``, ``index``: which section each picture is of;
        ``grey``: levels, `PIXELS` squared each; ``wall_um``: x and y, NaN where no wall was met.
    """
    if views is None or not len(views.sections.vessel):
        return None
    stack = views.sections
    grey = stack.grey // (256 // LEVELS)
    wall = 1e3 * stack.wall.reshape(-1, 2)
    return {
        "vessels": {
            str(row["vessel"]): {key: row.get(key) for key in _KEYS}
            for row in _with_sections(registration)
        },
        "pixels": PIXELS,
        "levels": LEVELS,
        "vessel": stack.vessel.tolist(),
        "index": stack.index.tolist(),
        "half_um": np.round(1e3 * stack.half, 1).tolist(),
        "grey": pack_table([PackedColumn("level", "u1")], {"level": grey.ravel()}),
        "rays": stack.wall.shape[1],
        "wall_um": pack_table(_WALL, {axis: wall[:, k] for k, axis in enumerate("xy")}),
        "total": stack.total,
        "raw": views.raw,
    }


def _with_sections(registration: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    return [row for row in records(registration, "vessels") if row.get("along_mm")]
