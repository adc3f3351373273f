"""Read and write networks as JSON: a list of nodes and a list of vessels."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from design.errors import NetworkError
from design.files import write_text
from design.network import VesselKind, VesselNetwork

_FORMAT = "printctl-network"
_VERSION = 1
_KINDS = {kind.name.lower(): int(kind) for kind in VesselKind}
_OF_SVZEROD = {
    "simulation_parameters": "a case of svZeroDSolver, which `printctl flow` runs",
    "calibration_parameters": "an input of svZeroDCalibrator",
}
_NAMES = {number: name for name, number in _KINDS.items()}


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
        network.vessel_nodes.tolist(), network.kind.tolist(), network.tree.tolist(), strict=True
    )
    rows = [
        json.dumps(
            {
                "nodes": ends,
                "kind": _NAMES[kind],
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
        kind, tree = _KINDS[vessel["kind"]], int(vessel["tree"])
        points = np.array(vessel["points"], dtype=np.float64)
    except (KeyError, TypeError, ValueError) as exc:
        raise NetworkError(
            f"{path}: vessel {number} needs nodes, tree, points and a kind of "
            f"{', '.join(_KINDS)} ({exc!r})"
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
