"""Read or make the map (G-code lines to vessels, network) that the needle shaft check needs."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from design.toolpath import MoveKind
from kernels.arrays import FloatArray
from printctl.errors import UsageError
from sim.gcode.clearance import LineSources, WrittenNetwork

_NETWORK = ("nodes", "vessel_nodes", "offset", "points", "radius")


@dataclass(frozen=True)
class ShaftMap:
    """What an embedded job's map says besides its lines.

    Attributes
    ----------
    sources : LineSources
    network : WrittenNetwork
        In the printer's frame.
    overlap_radii : float
        Of joints.
    clearance_mm : float, mm
        That the plan keeps.
    needles_mm : (heads, 3) float64, mm
        For which it was planned: outer diameter of the shaft and of the tip, height of the cone
        between them.
    """

    sources: LineSources
    network: WrittenNetwork
    overlap_radii: float
    clearance_mm: float
    needles_mm: FloatArray


def written_arrays(
    network: VesselNetwork,
    place_mm: FloatArray,
    overlap_radii: float,
    clearance_mm: float,
    needles_mm: Sequence[tuple[float, float, float]],
    bundled: NDArray[np.bool_] | None = None,
) -> dict[str, NDArray[Any]]:
    """What the map of an embedded job is to hold, so that its file can be checked by itself.

    Parameters
    ----------
    network : VesselNetwork
        As it is written, in the part's frame.
    place_mm : (3,) float64, mm
        From there to the printer's.
    overlap_radii, clearance_mm, needles_mm
        As in `ShaftMap`.
    bundled : (v,) bool or None
        Vessels written as several strands.
    """
    return {
        **({} if bundled is None else {"bundled": bundled}),
        **{f"network_{name}": getattr(network, name) for name in _NETWORK},
        "place_mm": np.asarray(place_mm, dtype=np.float64),
        "overlap_radii": np.array(overlap_radii),
        "clearance_mm": np.array(clearance_mm),
        "needles_mm": np.asarray(needles_mm, dtype=np.float64),
    }


def read_written(path: Path) -> ShaftMap | None:
    """Read the map of an embedded job; None where it is of layers, or there is none.

    Raises
    ------
    UsageError
        When the file can't be read, or is of vessels and doesn't say which network they are of.
    """
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as arrays_file:
            data = {name: arrays_file[name] for name in arrays_file.files}
        if str(data["source_kind"]) != "vessel":
            return None
        return read_written_arrays(data)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as exc:
        raise UsageError(
            f"{path} doesn't say what the job writes ({exc}), so the needle's shaft can't be "
            "checked; write the G-code and its map anew with `printctl toolpath`"
        ) from exc


def read_written_arrays(data: Mapping[str, NDArray[Any]]) -> ShaftMap:
    """What the arrays of a map say: ``source`` and ``kind`` of each line, and `written_arrays`."""
    arrays = {name: data[f"network_{name}"] for name in _NETWORK}
    network = WrittenNetwork(**arrays, bundled=data.get("bundled"))
    writes = data["kind"] == MoveKind.WRITE
    return ShaftMap(
        LineSources(data["source"].astype(np.int64), writes),
        network.moved(data["place_mm"]),
        float(data["overlap_radii"]),
        float(data["clearance_mm"]),
        data["needles_mm"].astype(np.float64),
    )
