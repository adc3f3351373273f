"""Straight vessels, and recipes of a block about a given network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv


def vessels(
    *lines: ArrayLike, radius: ArrayLike = 0.2, kind: ArrayLike = 0, tree: ArrayLike = 0
) -> VesselNetwork:
    """Vessels between pairs of ends, mm; radius, kind and tree are of all or of each."""
    count = len(lines)
    each = np.broadcast_to(np.asarray(radius, float), count)
    kinds, trees = (np.broadcast_to(np.asarray(one, np.int64), count) for one in (kind, tree))
    ends = np.arange(2 * count).reshape(-1, 2)
    return VesselNetwork.from_segments(
        np.array(lines, float).reshape(-1, 3), ends, each.copy(), kinds.copy(), trees.copy()
    )


def network_recipe(
    folder: Path, network: VesselNetwork, size_mm: Sequence[float], **parts: Any
) -> dict[str, Any]:
    """Recipe of a block about a network, which is written beside it; ``parts`` are added to it."""
    write_network_csv(folder / "given.csv", network)
    vasculature = {"network": "given.csv", "unit": "mm", **parts.pop("vasculature", {})}
    return {
        "schema": 1,
        "name": "given",
        "tissue": {"shape": "block", "size_mm": list(size_mm)},
        "vasculature": vasculature,
        **parts,
    }
