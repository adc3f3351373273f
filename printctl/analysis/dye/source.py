"""Load a network's lumens for a dye prediction: as designed, or as measured on a print."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from design.network import VesselNetwork
from design.units import UL_S_PER_ML_MIN, LengthUnit
from printctl.analysis.flow.as_printed import printed_lumens, read_print
from printctl.analysis.networks import Drive, load_source
from registration.measuring.gauging import with_printed_lengths


@dataclass(frozen=True)
class DyeLumens:
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


def lumens_of(model: Path, unit: LengthUnit | None, as_printed: bool) -> DyeLumens:
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
        return DyeLumens(source.network, (), flow)
    rows, scale = read_print(model)
    printed = printed_lumens(source.network, rows)
    closed = tuple(np.flatnonzero(printed.closed).tolist())
    return DyeLumens(with_printed_lengths(printed.network, scale), closed, flow)
