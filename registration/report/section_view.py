"""Pack pictures and numbers of measured vessel sections for the report page's section viewer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from registration.report.packing import pack
from registration.report.sections import records
from registration.report.views import Views
from registration.report.views.stack import PIXELS, SectionStack

LEVELS: Final = 16
"""Shades in the page: half of what all 256 would take, and below what speckle lets an eye see."""
_KEYS: Final = ("along_mm", "diameter_um", "interval_95_um", "designed_along_um", "lower_um",
                "upper_um", "offset_along_um", "ovality_along", "decision_along")  # fmt: skip


def section_view(registration: Mapping[str, Any], views: Views | None) -> dict[str, Any] | None:
    """Pack the pictures and numbers of all sections; None where there are none.

    Returns
    -------
    dict
        ``vessels``: numbers along each; ``vessel``, ``index``: which section each picture is of;
        ``grey``: uint8 levels, `PIXELS` squared each; ``wall_um``: int16 pairs, -32768 for none.
    """
    if views is None or not len(views.sections.vessel):
        return None
    stack = views.sections
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
        "grey": pack(np.asarray(stack.grey // (256 // LEVELS), dtype=np.uint8)),
        "rays": stack.wall.shape[1],
        "wall_um": pack(_whole_um(stack)),
        "total": stack.total,
        "raw": views.raw,
    }


def _with_sections(registration: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    return [row for row in records(registration, "vessels") if row.get("along_mm")]


def _whole_um(stack: SectionStack) -> NDArray[np.int16]:
    whole = np.nan_to_num(np.rint(1e3 * stack.wall), nan=-32768)
    return np.asarray(np.clip(whole, -32768, 32767), dtype=np.int16)
