"""`printctl view NETWORK`: write a network in its tissue as an HTML page or a PNG picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from design.files import write_bytes
from design.geometry.surface import Surface
from design.network import VesselNetwork
from design.solids import read_solid
from design.units import LengthUnit
from printctl.analysis.networks import Drive, Source, load_source
from printctl.cli.options import messages
from printctl.errors import UsageError
from printctl.run_folder.artefacts import SURFACE
from registration.report import NetworkPage, ReportSurface, write_network_html
from registration.report.picture import (
    PictureOptions,
    Quantity,
    View,
    draw_picture,
    quantities,
)

_NEEDS = {
    "deviation": "it takes a run folder with a registered scan",
    "order": "vessels with loops have no orders",
}


@dataclass(frozen=True)
class NetworkViewOptions:
    """What the user asks of a network."""

    colour: str | None
    seen_from: View
    width: int
    palette: bool
    unit: LengthUnit | None
    tissue: Path | None
    tissue_unit: LengthUnit | None
    drive: Drive
    most_pieces: int


def view_network(
    source: Path, page: Path | None, png: Path | None, settings: NetworkViewOptions
) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Write the page and the picture that are asked for.

    Returns
    -------
    written : dict of kind to Path
    notes : tuple of str
        For the user.

    Raises
    ------
    UsageError
        When the network can't be shown, or not as asked.
    """
    loaded = load_source(source, settings.unit, settings.drive)
    surface = _tissue(settings.tissue, settings.tissue_unit, loaded)
    known = quantities(loaded.network, loaded.known)
    chosen = _chosen(known, settings.colour or _telling(loaded.network), source)
    written: dict[str, Path] = {}
    if png is not None:
        messages().print("drawing ...")
        options = PictureOptions(settings.seen_from, settings.width, settings.palette)
        flow = loaded.known.flow.get("flow_ml_min")
        write_bytes(png, draw_picture(loaded.network, chosen, surface, options, flow))
        written["picture"] = png
    if page is not None:
        content = NetworkPage(loaded.name, chosen.key, loaded.notes, settings.most_pieces)
        write_network_html(page, loaded.network, known, _shown(surface), content)
        written["page"] = page
    return written, loaded.notes


def _telling(network: VesselNetwork) -> str:
    """What a network is coloured by unless the user says: its kinds, where it has several."""
    return "kind" if len(np.unique(network.kind)) > 1 else "radius"


def _chosen(known: list[Quantity], colour: str, source: Path) -> Quantity:
    """The quantity that the user named."""
    for quantity in known:
        if quantity.key == colour:
            return quantity
    there = ", ".join(quantity.key for quantity in known)
    why = f" ({_NEEDS[colour]})" if colour in _NEEDS else ""
    raise UsageError(f"--colour {colour}: nothing is known of it in {source}{why}; known: {there}")


def _tissue(path: Path | None, unit: LengthUnit | None, loaded: Source) -> Surface | None:
    if path is None:
        return loaded.surface
    if path.is_dir():
        path, unit = path / SURFACE, "mm"
    if not path.is_file():
        raise UsageError(f"--tissue {path} isn't there; give a mesh or a run folder")
    if unit is None:
        raise UsageError(f"--tissue {path} doesn't say its unit; give --tissue-unit")
    solid = read_solid(path, unit=unit)
    for note in solid.notes:
        messages().print(note, style="dim", markup=False)
    return solid


def _shown(surface: Surface | None) -> list[ReportSurface]:
    return [ReportSurface("Tissue", surface)] if surface else []
