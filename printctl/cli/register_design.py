"""Read the design that `printctl register` compares with a scan."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv
from design.solids import Solid, read_solid
from design.units import LengthUnit
from printctl.cli.options import messages
from printctl.errors import UsageError
from printctl.run_folder.artefacts import LUMEN, NETWORK, SOLID
from printctl.run_folder.manifest import Manifest


@dataclass(frozen=True)
class DesignRead:
    """A design, and which print of it was scanned.

    Attributes
    ----------
    model : Path
        A run folder, or the design's STL.
    surface : Solid
        In mm.
    network : Path
    vessels : VesselNetwork
    printed : dict or None
        As far as a journal tells it (`print_identity`).
    """

    model: Path
    surface: Solid
    network: Path
    vessels: VesselNetwork
    printed: dict[str, Any] | None


def read_design(
    model: Path,
    network: Path | None,
    lumens: bool | None,
    unit: LengthUnit,
    printed_in: Path | None,
) -> DesignRead:
    """Read a design; ``lumens`` None takes what a run's print leaves to be scanned.

    Raises
    ------
    UsageError
        When a file isn't there, or no journal is where a print is named.
    """
    surface, path = _surface(model, network, lumens, unit)
    vessels = read_network_csv(path, unit="mm")
    return DesignRead(model, surface, path, vessels, _printed(model, printed_in))


def _surface(
    model: Path, network: Path | None, lumens: bool | None, unit: LengthUnit
) -> tuple[Solid, Path]:
    """Surface of the design in mm, and where its network is."""
    if model.is_dir():
        if lumens is None:
            lumens = Manifest.load(model).is_embedded
        surface = read_solid(model / (LUMEN if lumens else SOLID), unit="mm")
        beside = model / NETWORK
    elif model.is_file():
        surface = read_solid(model, unit=unit)
        for note in surface.notes:
            messages().print(note, style="dim", markup=False)
        beside = model.with_name(NETWORK)
    else:
        raise UsageError(f"--model {model} doesn't exist; give a run folder or an STL file")
    path = network if network is not None else beside
    if not path.is_file():
        raise UsageError(f"no network at {path}; give --network network.csv for the vessel table")
    return surface, path


def _printed(model: Path, named: Path | None) -> dict[str, Any] | None:
    """Which print was scanned, as far as a journal tells it."""
    if named is None and not model.is_dir():
        return None
    # Only prints have journals; a lone STL doesn't wait for the link's modules.
    from printctl.cli.run_folder import print_folder
    from printctl.link.print_identity import print_identity

    identity = print_identity(print_folder(named or model))
    if identity is None and named is not None:
        raise UsageError(
            f"--print {named} has no journal of a print; give the print's folder, its run's, or "
            "its G-code file"
        )
    return identity
