"""Read and write networks in every known format, chosen by the file's suffix."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Final

from design.network import VesselNetwork
from design.network_files.by_suffix import (
    ASKED,
    READ,
    SAID,
    WRITERS,
    read_with_notes,
)
from design.network_files.merge import NetworkWithNotes
from design.network_files.simvascular import write_simvascular_paths
from design.units import MM_PER, LengthUnit
from printctl.errors import UsageError

__all__ = [
    "LOSSES",
    "READ",
    "NetworkWithNotes",
    "check_target",
    "read_noted",
    "write_network",
]

LOSSES: Final = {
    ".swc": "SWC keeps no numbers of trees and nodes; it is in µm",
    ".vtp": "VTP keeps no numbers of nodes; vessels that meet share a place",
    "": "SimVascular's paths keep no radii and no kinds; they are in cm",
}
"""What a format can't hold, by suffix."""


def read_noted(path: Path, unit: LengthUnit | None, ends: Path | None = None) -> NetworkWithNotes:
    """Read a network, in mm, and say what the user should know of it.

    Parameters
    ----------
    path : Path
        Ends in .csv, .vtp, .swc, .json, .npz or .txt (X-CAVATE's).
    unit : LengthUnit or None
        Of the coordinates, where the format doesn't say it; where it does, None or the same.
    ends : Path, optional
        The file of inlets and outlets that may come with X-CAVATE's.

    Raises
    ------
    UsageError
        Unknown suffix, no such file, unit missing or another than the format's.
    NetworkError, OSError
        As the format's reader.
    """
    suffix = path.suffix.lower()
    if suffix not in READ:
        known = ", ".join(READ)
        raise UsageError(f"{path}: {suffix or 'no suffix'} isn't a network's; {known} are read")
    if ends is not None and suffix != ".txt":
        raise UsageError(f"a file of inlets and outlets goes with X-CAVATE's .txt, not {path}")
    for file in (path, ends):
        if file is not None and not file.is_file():
            raise UsageError(f"{file} isn't there, or no file; check the path")
    if suffix in ASKED and unit is None:
        raise UsageError(
            f"{path} doesn't say the unit of its coordinates; give --unit, one of "
            f"{', '.join(MM_PER)}"
        )
    if suffix in SAID and unit not in (None, SAID[suffix]):
        raise UsageError(
            f"{path} is in {SAID[suffix]}, as its format says, not {unit}; drop --unit"
        )
    return read_with_notes(path, unit, ends)


def check_target(path: Path) -> None:
    """Raise `UsageError` when `write_network` couldn't write a file or folder of this name."""
    suffix = path.suffix.lower()
    if suffix and suffix not in WRITERS:
        raise UsageError(
            f"{path}: {suffix} can't be written; {', '.join(WRITERS)} can, and a name without "
            "suffix is a folder of SimVascular paths"
        )
    if suffix and path.is_dir():
        raise UsageError(f"{path} is a folder; give the name of a file")
    if not suffix and path.exists():
        raise UsageError(f"{path} exists; paths for SimVascular go into a new folder")


def write_network(path: Path, network: VesselNetwork) -> None:
    """Write a network; a name without suffix becomes a folder of SimVascular paths.

    Raises
    ------
    UsageError
        As `check_target`.
    NetworkError
        When the format can't hold the network.
    OSError
        When it can't be written; nothing half-written is left behind.
    """
    check_target(path)
    suffix = path.suffix.lower()
    if suffix:
        WRITERS[suffix](path, network)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent))
    try:
        write_simvascular_paths(draft, network)
        # A folder for one's own eyes becomes one as any other.
        draft.chmod(0o755)
        draft.rename(path)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
