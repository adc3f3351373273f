"""Read or write a network file in the format that its suffix names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from design.errors import NetworkError
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv, write_network_csv
from design.network_files.json_format import read_network_json, write_network_json
from design.network_files.npz import read_network_npz, write_network_npz
from design.network_files.swc import read_network_swc, write_network_swc
from design.network_files.vtp import write_network_vtp
from design.network_files.vtp_read import read_network_vtp
from design.network_files.xcavate import read_network_xcavate
from design.units import MM_PER, LengthUnit

ASKED: Final[dict[str, Callable[[Path, LengthUnit], VesselNetwork]]] = {
    ".csv": read_network_csv,
    ".vtp": read_network_vtp,
}
"""Formats that don't say their unit."""

SAID: Final[dict[str, tuple[LengthUnit, Callable[[Path], VesselNetwork]]]] = {
    ".swc": ("um", read_network_swc),
    ".json": ("mm", read_network_json),
    ".npz": ("mm", read_network_npz),
    ".txt": ("cm", lambda path: read_network_xcavate(path).network),
}
"""Formats that say it, or are always in it."""

READ: Final = (*ASKED, *SAID)
"""Suffixes of the formats that are read."""

WRITERS: Final[dict[str, Callable[[Path, VesselNetwork], None]]] = {
    ".csv": write_network_csv,
    ".vtp": lambda path, network: write_network_vtp(path, network, {}),
    ".swc": write_network_swc,
    ".json": write_network_json,
    ".npz": write_network_npz,
}
"""Of the formats that are one file."""


def read_network(path: Path, unit: LengthUnit | None = None) -> VesselNetwork:
    """Read a network, in mm.

    Parameters
    ----------
    path : Path
        Ends in .csv, .vtp, .swc, .json, .npz or .txt (X-CAVATE's).
    unit : {"um", "mm", "cm", "m", "in"}, optional
        Of the coordinates: needed for .csv and .vtp, which don't say it; never guessed.

    Raises
    ------
    NetworkError
        For an unknown suffix, a unit that is missing or isn't the format's, or a bad file.
    OSError
        When the file can't be read.
    """
    suffix = path.suffix.lower()
    if suffix in ASKED:
        if unit is None:
            raise NetworkError(
                f"{path} doesn't say the unit of its coordinates; give unit, one of "
                f"{', '.join(MM_PER)}"
            )
        return ASKED[suffix](path, unit)
    if suffix not in SAID:
        raise NetworkError(f"{path}: {suffix or 'no suffix'} can't be read; {', '.join(READ)} can")
    own, read = SAID[suffix]
    if unit not in (None, own):
        raise NetworkError(f"{path} is in {own}, as its format says, not {unit}; leave unit out")
    return read(path)


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
