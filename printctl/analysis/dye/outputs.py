"""Write a predicted dye front: arrival times by vessel, concentration curves and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.files import write_bytes
from design.geometry.polyline import arc_lengths
from design.hemodynamics.dye import CarryingFlow, DyeFront, check_frames, dye_curves, front_table
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from printctl.analysis.flow.tables import write_columns
from registration.report.figures import network_figure

FRONT, CURVES, PICTURE = "dye_front.csv", "dye_curves.csv", "dye_front.svg"

_MOST_CURVES: Final = 50
_ROWS: Final = 256
_SPAN: Final = 3.0
"""Curves run to so many mean ages of the latest place."""


@dataclass(frozen=True)
class VesselPlace:
    """A place on a vessel: which, and the share of its length from its first node."""

    vessel: int
    share: float


def write_front(
    folder: Path,
    network: VesselNetwork,
    carried: CarryingFlow,
    front: DyeFront,
    places: Sequence[VesselPlace],
    interval_s: float,
) -> dict[str, Any]:
    """Write `FRONT`, `CURVES` and `PICTURE`; return the main numbers.

    Parameters
    ----------
    places : sequence of VesselPlace
        Of the curves; where none is given, the ends of the vessels, or of those that end at an
        outlet where there are many.
    interval_s : float, s
        Between frames of a film to come.

    Raises
    ------
    OSError
        When a file can't be written.
    """
    write_columns(folder / FRONT, front_table(network, front))
    _write_curves(folder / CURVES, network, carried, front, places or ends(network, front))
    label = "first dye leaves each vessel / s"
    write_bytes(folder / PICTURE, network_figure(network, front.tip_leaves_s, label))
    frames, regime = check_frames(front, interval_s), front.regime()
    return {
        "flow_ml_min": front.flow_ul_s * 0.06,
        "tip_leaves_last_s": float(np.nanmax(front.tip_leaves_s)),
        "mean_leaves_last_s": float(np.nanmax(front.mean_leaves_s)),
        "peclet_median": float(np.nanmedian(front.peclet)),
        "fourier_max": float(np.nanmax(front.fourier)),
        **{f"vessels_{word}": int((regime == word).sum())
           for word in ("carried", "between", "dispersed", "still")},
        "frames_per_s": 1.0 / interval_s,
        "frames_per_s_needed": frames.needed_per_s,
        "vessels_too_quick": len(frames.quick),
        "warning": frames.warning,
    }  # fmt: skip


def ends(network: VesselNetwork, front: DyeFront) -> list[VesselPlace]:
    """Where dye leaves vessels: all of them, or those at the network's ends, at most fifty."""
    known = np.isfinite(front.mean_leaves_s)
    if known.sum() > _MOST_CURVES:
        known &= (network.degree()[network.vessel_nodes] == 1).any(axis=1)
    return [VesselPlace(int(vessel), 1.0) for vessel in np.flatnonzero(known)[:_MOST_CURVES]]


def _write_curves(
    path: Path,
    network: VesselNetwork,
    carried: CarryingFlow,
    front: DyeFront,
    places: Sequence[VesselPlace],
) -> None:
    """``time_s``, and the section's mean of each place after a step of 1 at the inlets."""
    vessel = np.array([place.vessel for place in places], dtype=np.int64)
    back = carried.solution.flow[vessel] < 0.0
    share = volume_share(network, places)
    # A vessel's end is where its flow leaves it, whichever way it was designed.
    whole = np.array([place.share == 1.0 for place in places])
    along = np.where(whole, 1.0, np.where(back, 1.0 - share, share))
    until = _SPAN * float(np.nanmax(front.mean_leaves_s[vessel])) * front.flow_ul_s
    times, curves = dye_curves(network, carried, vessel, along, until)
    kept = slice(None, None, max(1, len(times) // _ROWS))
    columns: dict[str, FloatArray] = {"time_s": times[kept] / front.flow_ul_s}
    for place, curve in zip(places, curves, strict=True):
        columns[f"vessel_{place.vessel}_at_{place.share:g}"] = curve[kept]
    write_columns(path, columns)


def volume_share(network: VesselNetwork, places: Sequence[VesselPlace]) -> FloatArray:
    """Share of each place's vessel's volume before it, from its first node, (n,)."""
    shares = []
    for place in places:
        points, radius = network.polyline(place.vessel)
        arc = arc_lengths(points)
        fine = np.unique(np.concatenate([arc, np.linspace(0.0, arc[-1], 257)]))
        area = np.interp(fine, arc, radius) ** 2
        volume = np.concatenate([[0.0], np.cumsum((area[1:] + area[:-1]) / 2 * np.diff(fine))])
        shares.append(np.interp(place.share * arc[-1], fine, volume) / volume[-1])
    return np.array(shares)
