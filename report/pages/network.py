"""Write an HTML page of a vessel network in its tissue, or of a tissue alone, in 3D."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from design.files import write_text
from design.network import VesselNetwork
from report.page_frame import render, scene
from report.pages.network_view import MAX_PIECES, network_view
from report.picture import Quantity
from report.scripts import ENTRY
from report.surface import ReportSurface
from report.wording import count, number


@dataclass(frozen=True)
class NetworkPage:
    """What a page of a network says and shows first.

    Attributes
    ----------
    title : str
    first : str
        Key of the quantity that colours it at first.
    notes : tuple of str
        Sentences below the view: where numbers come from, what is missing.
    most_pieces : int
        Straight pieces drawn at most; beyond it the thinnest vessels are left out, and the page
        says so.
    """

    title: str
    first: str = "radius"
    notes: tuple[str, ...] = ()
    most_pieces: int = MAX_PIECES


def write_network_html(
    path: Path,
    network: VesselNetwork,
    colourings: Sequence[Quantity],
    surfaces: Sequence[ReportSurface],
    page: NetworkPage,
) -> None:
    """Write a network as one HTML file that opens offline.

    Parameters
    ----------
    path : Path
        The file; an old one is replaced only by a whole new one.
    network : VesselNetwork
    colourings : sequence of Quantity
        What the reader can colour it by.
    surfaces : sequence of ReportSurface
        The tissue's, usually; without a scalar they are translucent. Above 400,000 triangles
        together they are simplified, which the page says.
    page : NetworkPage

    Raises
    ------
    OSError
        When the file can't be written.
    """
    shown = network_view(network, colourings, {}, page.first, page.most_pieces)
    _write(path, page, network_facts(network), scene("Network", surfaces, shown))


def write_places_html(path: Path, tissue: ReportSurface, page: NetworkPage) -> None:
    """Write a tissue's surface on which a click tells the page around it the place, mm.

    Parameters
    ----------
    path : Path
    tissue : ReportSurface
    page : NetworkPage

    Raises
    ------
    OSError
        When the file can't be written.
    """
    faces = len(tissue.surface.faces)
    view = scene("Tissue", [tissue], None) | {"pick": True}
    _write(path, page, [count(faces, "triangle")], view)


def _write(path: Path, page: NetworkPage, facts: list[str], view: dict[str, object]) -> None:
    context = {
        "title": page.title,
        "facts": facts,
        "notes": page.notes,
        "view": view,
    }
    write_text(path, render("network.html", context, ENTRY))


def network_facts(network: VesselNetwork) -> list[str]:
    """A few numbers for the top of the page."""
    low, high = (2.0 * float(r) for r in (network.radius.min(), network.radius.max()))
    return [
        count(network.vessel_count, "vessel"),
        count(len(network.pieces()[4]), "straight piece"),
        f"{number(len(network.inlets()))} in, {number(len(network.outlets()))} out",
        f"diameters {number(low, 3)} to {number(high, 3)} mm",
        f"{number(float(network.lengths().sum()), 3)} mm long",
    ]
