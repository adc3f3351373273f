"""Read a vessel network from a `network.csv` file."""

from __future__ import annotations

from pathlib import Path

from design.errors import NetworkError
from design.network import VesselNetwork
from design.network_files.csv_format.chain import chain_pieces
from design.network_files.csv_format.pieces import check_pieces, parse_pieces
from design.units import MM_PER, LengthUnit


def read_network_csv(path: Path, unit: LengthUnit) -> VesselNetwork:
    """Read a network whose coordinates are in ``unit`` (radii are in mm, as their columns say).

    The pieces of one vessel are chained into a polyline, whatever their order in the file. A node
    of the file stays a node of the network where its degree isn't 2, where the vessel's number
    changes, or where the radius jumps; a vessel that has such a node within it is cut there.
    Vessels keep the order in which they first appear and nodes that of their numbers, so that a
    file of `write_network_csv` gives back the same network to the bit. Further columns are
    ignored.

    Parameters
    ----------
    path : Path
        The file, UTF-8, separated by commas, semicolons or tabs.
    unit : "um", "mm", "cm", "m" or "in"
        Unit of x0 to z1.

    Returns
    -------
    VesselNetwork
        In mm.

    Raises
    ------
    NetworkError
        Missing column, bad number, unknown kind, broken chain, pieces with a gap, vessel of zero
        length; with the file and the line.
    OSError
        When the file can't be read.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as exc:
        raise NetworkError(f"{path}: not UTF-8 text; save the network as CSV") from exc
    pieces = parse_pieces(path, text, MM_PER[unit])
    check_pieces(pieces)
    return chain_pieces(pieces)
