"""Read or write a network file in the format that its suffix names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from design.errors import NetworkError
from design.network import VesselNetwork
from design.network_files.csv_format import (
    has_points,
    read_network_csv,
    read_points_csv,
    write_network_csv,
)
from design.network_files.json_format import (
    read_network_json,
    read_network_npz,
    write_network_json,
    write_network_npz,
)
from design.network_files.merge import NetworkWithNotes, merge_shared, side_by_side
from design.network_files.near_ends import join_near_ends
from design.network_files.swc import read_network_swc, read_swc_header, write_network_swc
from design.network_files.vtp import read_vtp_lines, write_network_vtp
from design.network_files.xcavate import read_network_xcavate
from design.units import MM_PER, LengthUnit

UNIT_NEEDED: Final = (".csv", ".vtp")
"""Suffixes of the formats that don't say their unit."""

UNIT_DEFAULT: Final[dict[str, LengthUnit]] = {".swc": "um", ".txt": "cm"}
"""Formats in a unit that files don't keep to: the user may name another."""

UNIT_FIXED: Final[dict[str, LengthUnit]] = {".json": "mm", ".npz": "mm"}
"""Formats that say their unit, or are always in it."""

READ: Final = (*UNIT_NEEDED, *UNIT_DEFAULT, *UNIT_FIXED)
"""Suffixes of the formats that are read."""

_THIN_MM, _LONG_MM = 0.02, 1000.0
"""Radius below which no vessel is printed: half of a 34G needle's bore (51 µm) is 26 µm, and light
from projectors and lasers in gels doesn't reach 40 µm channels over a part's size. Extent above
which nothing is printed: beds of the largest bioprinters are some 0.3 m."""

WRITERS: Final[dict[str, Callable[[Path, VesselNetwork], None]]] = {
    ".csv": write_network_csv,
    ".vtp": lambda path, network: write_network_vtp(path, network, {}),
    ".swc": write_network_swc,
    ".json": write_network_json,
    ".npz": write_network_npz,
}
"""By suffix, of the formats that are one file."""


XCAVATE_LONGEST_MM: Final = 150.0
"""Twice the longest of the six networks published with X-CAVATE, 73 mm; one in mm that is read in
cm, as they are, is ten times too long."""


def read_network(path: Path, unit: LengthUnit | None = None) -> VesselNetwork:
    """Read a network, in mm, as `read_with_notes`."""
    return read_with_notes(path, unit).network


def read_with_notes(
    path: Path, unit: LengthUnit | None = None, ends: Path | None = None
) -> NetworkWithNotes:
    """Read a network, in mm, and merge vessels that run along each other.

    Formats that number the nodes where vessels meet (.json, .npz, .csv of vessels) say it so:
    there only vessels with the same points are merged.

    Parameters
    ----------
    path : Path
        Ends in .csv, .vtp, .swc, .json, .npz or .txt (X-CAVATE's).
    unit : {"um", "mm", "cm", "m", "in"}, optional
        Of the coordinates: needed for .csv and .vtp, which don't say it; never guessed. SWC is in
        µm, or as its comments say, and X-CAVATE's text in cm, unless another unit is given here.
    ends : Path, optional
        Inlets and outlets that come with X-CAVATE's file.

    Raises
    ------
    NetworkError
        For an unknown suffix, a unit that is missing or isn't the format's, a bad file, or an SWC
        or X-CAVATE file of improbable size whose unit isn't given.
    OSError
        When the file can't be read.
    """
    suffix = path.suffix.lower()
    if suffix not in READ:
        raise NetworkError(f"{path}: {suffix or 'no suffix'} can't be read; {', '.join(READ)} can")
    if suffix in UNIT_NEEDED and unit is None:
        raise NetworkError(
            f"{path} doesn't say the unit of its coordinates; give unit, one of {', '.join(MM_PER)}"
        )
    if suffix in UNIT_FIXED and unit not in (None, UNIT_FIXED[suffix]):
        raise NetworkError(
            f"{path} is in {UNIT_FIXED[suffix]}, as its format says, not {unit}; leave unit out"
        )
    if suffix == ".vtp":
        network, whole = read_vtp_lines(path, unit or "mm")
        notes = _size(network)
        if whole:
            return NetworkWithNotes(network, notes)
    else:
        network, notes = _read(path, unit, ends)
    numbered = suffix in (".json", ".npz") or (suffix == ".csv" and not has_points(path))
    merged = merge_shared(path, network, by_place=suffix == ".vtp", identical=numbered)
    network, joined = join_near_ends(merged.network)
    return NetworkWithNotes(network, (*notes, *merged.notes, *joined, *side_by_side(network)))


def _read(path: Path, unit: LengthUnit | None, ends: Path | None) -> NetworkWithNotes:
    """The network as the file has it, and notes on its unit and size."""
    match path.suffix.lower():
        case ".swc":
            return _swc(path, unit)
        case ".txt":
            return _xcavate(path, unit, ends)
        case ".json":
            network = read_network_json(path)
        case ".npz":
            network = read_network_npz(path)
        case _:
            read = read_points_csv if has_points(path) else read_network_csv
            network = read(path, unit or "mm")
    return NetworkWithNotes(network, _size(network))


def _swc(path: Path, unit: LengthUnit | None) -> NetworkWithNotes:
    header = read_swc_header(path)
    network = read_network_swc(path, unit)
    notes = _size(network)
    if unit is None and header.unit is None:
        _check_assumed(path, notes, "SWC is in µm", "um")
    if header.unit is not None:
        taken = f"read in {unit or header.unit}" + (", as asked" if unit else "")
        notes = (f"The file's comments say that it is in {header.unit}; {taken}.", *notes)
    if header.scale != (1.0, 1.0, 1.0):
        x, y, z = header.scale
        note = (
            f"SCALE in the file: x, y and z are multiplied by {x:g}, {y:g} and {z:g}, radii by "
            f"{header.radius_scale:g}."
        )
        notes = (note, *notes)
    return NetworkWithNotes(network, notes)


def _xcavate(path: Path, unit: LengthUnit | None, ends: Path | None) -> NetworkWithNotes:
    network, _, notes = read_network_xcavate(path, ends, unit=unit or UNIT_DEFAULT[".txt"])
    size = _size(network)
    if unit is None:
        usual = _size(network, XCAVATE_LONGEST_MM, "X-CAVATE's networks are shorter than")
        _check_assumed(path, usual, "X-CAVATE's files are in cm", "cm")
    return NetworkWithNotes(network, (*notes, *size))


def _check_assumed(path: Path, size: tuple[str, ...], assumed: str, usual: LengthUnit) -> None:
    """Raise `NetworkError` where the unit that a format has by default makes sizes improbable."""
    if size:
        raise NetworkError(
            f"{path}: {size[0]} {assumed}, and so it was taken; give unit (--unit), one of "
            f"{', '.join(MM_PER)}: {usual} to take it so all the same"
        )


def _size(
    network: VesselNetwork, longest_mm: float = _LONG_MM, limited: str = ""
) -> tuple[str, ...]:
    """A sentence on sizes that nothing prints; none for others."""
    widest = float(network.radius.max())
    extent = float(np.ptp(network.points, axis=0).max())
    if widest >= _THIN_MM and extent <= longest_mm:
        return ()
    limit = (
        f"no vessel thinner than {_THIN_MM:g} mm in radius is printed"
        if widest < _THIN_MM
        else f"{limited or 'nothing is printed longer than'} {longest_mm:g} mm"
    )
    return (
        f"The network is {extent:.3g} mm long, its widest radius {widest:.3g} mm: {limit}. Is its "
        "unit right?",
    )


def write_network(path: Path, network: VesselNetwork) -> None:
    """Write a network, in mm (.swc: µm).

    Parameters
    ----------
    path : Path
        Ends in .csv, .vtp, .swc, .json or .npz.
    network : VesselNetwork

    Raises
    ------
    NetworkError
        For an unknown suffix, or when the format can't hold the network.
    OSError
        When it can't be written; nothing half-written is left behind.
    """
    if path.suffix.lower() not in WRITERS:
        raise NetworkError(
            f"{path}: {path.suffix or 'no suffix'} can't be written; {', '.join(WRITERS)} can"
        )
    WRITERS[path.suffix.lower()](path, network)
