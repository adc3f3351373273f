"""Read and write networks as JSON: a list of nodes and a list of vessels."""

from __future__ import annotations

import json
import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from design.errors import NetworkError
from design.files import atomic_replacement, write_text
from design.network import VesselNetwork
from design.network_files.pieces import KINDS

_FORMAT = "printctl-network"
_VERSION = 1
_OF_SVZEROD = {
    "simulation_parameters": "a case of svZeroDSolver; run it by its package, pysvzerod",
    "calibration_parameters": "an input of svZeroDCalibrator",
}


def write_network_json(path: Path, network: VesselNetwork) -> None:
    """Write ``network`` in mm, every number by the shortest text that reads back to the same bits.

    ``{"format": "printctl-network", "version": 1, "unit": "mm", "nodes": [[x, y, z], ...],
    "vessels": [{"nodes": [first, last], "kind": "artery", "tree": 0,
    "points": [[x, y, z, radius], ...]}, ...]}``, a node or vessel a line.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    points = np.column_stack([network.points, network.radius]).tolist()
    offset = network.offset.tolist()
    vessels = zip(
        network.vessel_nodes.tolist(),
        network.kind_names().tolist(),
        network.tree.tolist(),
        strict=True,
    )
    rows = [
        json.dumps(
            {
                "nodes": ends,
                "kind": kind,
                "tree": tree,
                "points": points[offset[i] : offset[i + 1]],
            }
        )
        for i, (ends, kind, tree) in enumerate(vessels)
    ]
    head = f'"format": "{_FORMAT}", "version": {_VERSION}, "unit": "mm"'
    nodes = ",\n".join(json.dumps(node) for node in network.nodes.tolist())
    body = ",\n".join(rows)
    write_text(path, f'{{{head},\n"nodes": [\n{nodes}\n],\n"vessels": [\n{body}\n]}}\n')


def read_network_json(path: Path) -> VesselNetwork:
    """Read what `write_network_json` writes, the same to the bit.

    Raises
    ------
    NetworkError
        When it isn't such a file, names an unknown kind or node, or holds impossible numbers.
    OSError
        When the file can't be read.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"))
    except (UnicodeDecodeError, json.JSONDecodeError) as exc:
        raise NetworkError(f"{path}: not JSON ({exc}); mend the file") from exc
    head = [data.get(k) for k in ("format", "version", "unit")] if isinstance(data, dict) else []
    if head != [_FORMAT, _VERSION, "mm"]:
        other = next((_OF_SVZEROD[key] for key in _OF_SVZEROD if head and key in data), None)
        if other is not None:
            raise NetworkError(f"{path} is {other}, not a network")
        raise NetworkError(
            f"{path}: format, version and unit must be {_FORMAT}, {_VERSION} and mm; they are "
            f"{head}"
        )
    try:
        nodes = np.array(data["nodes"], dtype=np.float64)
        vessels = list(data["vessels"])
    except (KeyError, TypeError, ValueError) as exc:
        raise NetworkError(f"{path}: nodes or vessels missing or no lists ({exc})") from exc
    parts = [_vessel(path, i, vessel, nodes) for i, vessel in enumerate(vessels)]
    if not parts:
        raise NetworkError(f"{path}: no vessels; give at least one")
    points = np.concatenate([part[3] for part in parts])
    try:
        return VesselNetwork(
            nodes=nodes,
            vessel_nodes=np.array([part[0] for part in parts], dtype=np.int64),
            kind=np.array([part[1] for part in parts], dtype=np.int64),
            tree=np.array([part[2] for part in parts], dtype=np.int64),
            offset=np.r_[0, np.cumsum([len(part[3]) for part in parts])].astype(np.int64),
            points=np.ascontiguousarray(points[:, :3]),
            radius=points[:, 3].copy(),
        )
    except NetworkError as exc:
        raise NetworkError(f"{path}: {exc}") from exc


def _vessel(path: Path, number: int, vessel: Any, nodes: Any) -> tuple[list[int], int, int, Any]:
    try:
        ends = [int(node) for node in vessel["nodes"]]
        kind, tree = KINDS[vessel["kind"]], int(vessel["tree"])
        points = np.array(vessel["points"], dtype=np.float64)
    except (KeyError, TypeError, ValueError) as exc:
        raise NetworkError(
            f"{path}: vessel {number} needs nodes, tree, points and a kind of "
            f"{', '.join(KINDS)} ({exc!r})"
        ) from exc
    if nodes.ndim != 2 or nodes.shape[1] != 3 or len(ends) != 2:
        raise NetworkError(f"{path}: vessel {number} or the nodes are of wrong length; mend them")
    if min(ends) < 0 or max(ends) >= len(nodes):
        raise NetworkError(f"{path}: vessel {number} joins nodes {ends} of {len(nodes)}; mend it")
    if points.ndim != 2 or points.shape[1] != 4 or len(points) < 2:
        raise NetworkError(
            f"{path}: vessel {number} needs two or more points of x, y, z and radius"
        )
    return ends, kind, tree, points


_NPZ_FORMAT = "printctl-network-1-mm"
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
        np.savez(draft, format=np.array(_NPZ_FORMAT), **arrays)


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
    if str(arrays.pop("format")) != _NPZ_FORMAT:
        raise NetworkError(f"{path}: its format isn't {_NPZ_FORMAT}; write it with this version")
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
