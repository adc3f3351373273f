"""Data type of all that the HTML and PDF pages of `printctl register` show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from numpy import float64
    from numpy.typing import NDArray

    from design.network import VesselNetwork
    from registration.json_ready import Record
    from report.views import Views


@dataclass(frozen=True, eq=False)
class PageParts:
    """All that the pages of a registration show.

    Attributes
    ----------
    data : dict
        As ``registration.json`` holds it.
    surfaces : list of dict
        Of the 3D view, packed (`report.packing.pack_surfaces`).
    network : VesselNetwork
    orders : (v,) float64
        Strahler's of the vessels: found by kernels, which the pages' process doesn't load.
    views : Views
    drawn : dict of str to bytes
        Figures that are drawn already.
    origin : dict or None
        What a page that is printed to PDF says of the files; None for a page alone.
    observed : Path or None
        Folder of the print, with the looks at it; None where there are none.
    """

    data: Record
    surfaces: list[dict[str, object]]
    network: VesselNetwork
    orders: NDArray[float64]
    views: Views
    drawn: dict[str, bytes]
    origin: Record | None
    observed: Path | None = None
