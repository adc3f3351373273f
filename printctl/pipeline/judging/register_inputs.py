"""Read the design that `printctl register` holds a scan against, and its datums."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv, write_network_csv
from design.solids import Solid, read_solid
from design.units import LengthUnit
from printctl.errors import UsageError
from printctl.pipeline.judging.register_files import DesignRead
from printctl.run_folder.artefacts import LUMEN, NETWORK, SOLID
from printctl.run_folder.manifest import Manifest
from registration.errors import DatumError
from registration.measuring.geometry import Datum, check_designed, read_datums

if TYPE_CHECKING:
    from design.solids.axes.lumen_axes import FoundLumens


def datums_of(text: str | None, network: VesselNetwork) -> tuple[Datum, ...]:
    """Read ``--datums`` and hold it against the design; none for the best fit.

    Raises
    ------
    UsageError
        For an empty list, a datum that isn't known, and one that the design doesn't have.
    """
    if text is None:
        return ()
    if not text.replace(",", "").strip():
        raise UsageError(
            "--datums is empty; name datum features like 'face -z, face -x, axis 3', or leave the "
            "option out for the best fit"
        )
    try:
        datums = read_datums(text.split(","))
        check_designed(datums, network)
    except DatumError as exc:
        raise UsageError(f"--datums: {exc}") from exc
    return datums


def read_design(
    model: Path,
    network: Path | None,
    lumens: bool | None,
    unit: LengthUnit,
    printed_in: Path | None,
    out: Path,
    tell: Callable[[str], None],
) -> DesignRead:
    """Read a design; ``lumens`` None takes what a run's print leaves to be scanned.

    Of an STL without a network the lumens are found in it, and their network is written to ``out``;
    ``tell`` is told so.

    Raises
    ------
    UsageError
        When a file isn't there, or no journal is where a print is named.
    """
    found = None
    surface, path = _surface(model, network, lumens, unit, tell)
    if network is None and not path.is_file() and not model.is_dir():
        path = out / NETWORK
        found = _found(surface, path, bool(lumens), tell)
        vessels = found.network
    elif not path.is_file():
        raise UsageError(f"no network at {path}; give --network network.csv for the vessel table")
    else:
        vessels = read_network_csv(path, unit="mm")
    cords = model.is_dir() and Manifest.load(model).writes_cords
    printed = _printed(model, printed_in)
    return DesignRead(
        surface, path, vessels, lumens=found, cords=cords, model=model, printed=printed
    )


def _surface(
    model: Path,
    network: Path | None,
    lumens: bool | None,
    unit: LengthUnit,
    tell: Callable[[str], None],
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
            tell(note)
        beside = model.with_name(NETWORK)
    else:
        raise UsageError(f"--model {model} doesn't exist; give a run folder or an STL file")
    return surface, network if network is not None else beside


def _found(surface: Solid, path: Path, is_lumen: bool, tell: Callable[[str], None]) -> FoundLumens:
    """Find the lumens of a model without a network, and write them to a file."""
    from design.solids.axes.lumen_axes import found_lumens, unfollowed_ways  # slow to load

    found = found_lumens(surface, is_lumen=is_lumen)
    vessels = found.network
    path.parent.mkdir(parents=True, exist_ok=True)
    write_network_csv(path, vessels)
    wide = 2e3 * vessels.mean_radius()
    tell(
        f"no network was given: {len(wide)} lumens were found in the model, {wide.min():.0f} to "
        f"{wide.max():.0f} µm wide; they are numbered as in {path}"
    )
    if not is_lumen and (left := unfollowed_ways(surface, vessels)):
        tell(
            f"note: {left} more ways lead through the model, too short or too thin to be followed; "
            "they aren't measured: give --network to have them measured"
        )
    return found


def _printed(model: Path, named: Path | None) -> dict[str, Any] | None:
    """Which print was scanned, as far as a journal tells it."""
    if named is None and not model.is_dir():
        return None
    # Only prints have journals; a lone STL doesn't wait for the link's modules.
    from printctl.machine.prints.state import print_folder
    from printctl.machine.records.folders import print_identity

    identity = print_identity(print_folder(named or model))
    if identity is None and named is not None:
        raise UsageError(
            f"--print {named} has no journal of a print; give the print's folder, its run's, or "
            "its G-code file"
        )
    return identity
