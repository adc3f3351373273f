"""Read and write networks as NumPy `.npz`, exact to the last bit."""

from __future__ import annotations

import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np

from design.errors import NetworkError
from design.files import atomic_replacement
from design.network import VesselNetwork

_FORMAT = "printctl-network-1-mm"
_ARRAYS = tuple(field.name for field in fields(VesselNetwork))
_WHOLE = ("vessel_nodes", "kind", "tree", "offset")


def write_network_npz(path: Path, network: VesselNetwork) -> None:
    """Write the arrays of ``network`` under their names, in mm, and ``format``.

    Parameters
    ----------
    path : Path
        Ends in ``.npz``.
    network : VesselNetwork

    Raises
    ------
    NetworkError
        When the name doesn't end in ``.npz``.
    OSError
        When the file can't be written.
    """
    if path.suffix != ".npz":
        raise NetworkError(f"{path}: a network in this format ends in .npz; rename it")
    arrays = {name: getattr(network, name) for name in _ARRAYS}
    with atomic_replacement(path) as draft:
        np.savez(draft, format=np.array(_FORMAT), **arrays)


def read_network_npz(path: Path) -> VesselNetwork:
    """Read what `write_network_npz` wrote, the same to the bit.

    Raises
    ------
    NetworkError
        When the file isn't such a network, or holds impossible numbers.
    OSError
        When the file can't be read.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {name: data[name] for name in ("format", *_ARRAYS)}
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as exc:
        raise NetworkError(f"{path}: not a network in .npz ({exc}); write it again") from exc
    if str(arrays.pop("format")) != _FORMAT:
        raise NetworkError(f"{path}: its format isn't {_FORMAT}; write it with this version")
    for name, values in arrays.items():
        wanted = np.int64 if name in _WHOLE else np.float64
        if values.dtype != wanted:
            raise NetworkError(f"{path}: {name} is {values.dtype}, not {np.dtype(wanted)}")
    try:
        network = VesselNetwork(**arrays)
        check_references(network)
    except (NetworkError, IndexError) as exc:
        raise NetworkError(f"{path}: {exc}") from exc
    return network


def check_references(network: VesselNetwork) -> None:
    """Raise `NetworkError` when a vessel names a node that isn't there, or has no two points."""
    ends = network.vessel_nodes
    if ends.ndim != 2 or ends.shape[1:] != (2,) or network.points.shape[1:] != (3,):
        raise NetworkError("arrays of vessels or points have the wrong shape; write them again")
    if network.nodes.shape[1:] != (3,) or ends.min() < 0 or ends.max() >= len(network.nodes):
        raise NetworkError(
            f"a vessel joins node {ends.max()}, but there are {len(network.nodes)} of three "
            "coordinates; mend vessel_nodes"
        )
    if network.offset[0] != 0 or np.diff(network.offset).min() < 2:
        raise NetworkError("a vessel has fewer than two points; mend offset")
