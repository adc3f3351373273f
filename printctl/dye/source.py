"""The lumens that dye is to run through: as designed, or as registration found them printed."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from design.network import VesselNetwork
from design.units import UL_S_PER_ML_MIN, LengthUnit
from printctl.errors import UsageError
from printctl.networks import Drive, load_source
from printctl.pipeline.artefacts import NETWORK
from printctl.pipeline.stages.registration import NUMBERS


@dataclass(frozen=True)
class Lumens:
    """A network, what of it is closed, and what runs into it.

    Attributes
    ----------
    network : VesselNetwork
    closed : tuple of int
        Vessels that registration found closed.
    flow_ml_min : float or None
        The run's own, where there is one.
    """

    network: VesselNetwork
    closed: tuple[int, ...]
    flow_ml_min: float | None


def lumens_of(model: Path, unit: LengthUnit | None, as_printed: bool) -> Lumens:
    """Read a run folder or a network's file.

    Raises
    ------
    UsageError
        When it isn't there, or there is no registration of it to take printed lumens from.
    """
    source = load_source(model, unit, Drive())
    flow = None
    if model.is_dir() and "flow_ul_s" in source.known.flow:
        first = np.isin(source.network.vessel_nodes[:, 0], source.network.inlets())
        flow = float(source.known.flow["flow_ul_s"][first].sum()) / UL_S_PER_ML_MIN
    if not as_printed:
        return Lumens(source.network, (), flow)
    path = model / NUMBERS
    if not path.is_file():
        raise UsageError(
            f"--as-printed takes lumens from {NUMBERS} of a run whose print was registered, and "
            f"there is none at {path}; register a scan first, or leave --as-printed out"
        )
    rows = json.loads(path.read_text(encoding="utf-8")).get("vessels", [])
    network, closed = printed_lumens(source.network, rows)
    return Lumens(network, closed, flow)


def printed_lumens(
    network: VesselNetwork, rows: list[dict[str, Any]]
) -> tuple[VesselNetwork, tuple[int, ...]]:
    """Radii times each vessel's measured over designed diameter, and the closed vessels.

    A vessel that wasn't measured is as far off as the others on average.

    Raises
    ------
    UsageError
        When the rows aren't of this network.
    """
    if [row.get("vessel") for row in rows] != list(range(network.vessel_count)):
        raise UsageError(f"{NUMBERS} isn't of this {NETWORK}; register the scan again")
    ratio = np.array(
        [
            row["measured_um"] / row["designed_um"] if row.get("measured_um") else np.nan
            for row in rows
        ]
    )
    if not np.isfinite(ratio).any():
        raise UsageError(f"no vessel's diameter was measured in {NUMBERS}; leave --as-printed out")
    ratio = np.where(np.isfinite(ratio), ratio, np.nanmean(ratio))
    radius = network.radius * np.repeat(ratio, np.diff(network.offset))
    closed = tuple(k for k, row in enumerate(rows) if row.get("open") is False)
    return replace(network, radius=radius), closed
