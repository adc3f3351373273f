"""Load lumens for a dye front prediction; write arrival times, concentration curves, a picture.

Goes in: a network or a run. Comes out: arrival of dye, as files.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.files import write_bytes
from design.geometry.polyline import arc_lengths
from design.hemodynamics.dye import (
    DYE_DIFFUSIVITY,
    CarryingFlow,
    DyeFront,
    check_frames,
    dye_curves,
    dye_front,
    front_table,
)
from design.network import VesselNetwork
from design.units import UL_S_PER_ML_MIN, LengthUnit
from kernels.arrays import FloatArray
from printctl.analysis.flow.printed.as_printed import printed_lumens, read_print
from printctl.analysis.flow.tables import write_columns
from printctl.analysis.networks import Drive, load_source
from printctl.errors import UsageError
from printctl.settings import opt, settings
from registration.dye.flow import carrying_flow, solve_without_closed
from registration.measuring.gauging import with_printed_lengths
from report.figures.deviation import network_figure

_USUAL_ML_MIN: Final = 0.25


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


@settings
class FrontOptions:
    """What is asked of a dye front that is predicted."""

    frames_per_s: float = opt("Frame rate of the predicted video (--predict).", 25.0, min=1e-3)
    as_printed: bool = opt("Lumens as registration found them (--predict).", False)
    at: list[str] | None = opt("Places of curves (--predict).", metavar="VESSEL:SHARE")
    unit: LengthUnit | None = opt(
        "Length unit of the file, if it isn't specified there (.csv, .vtp, .stl, .swc, .txt)."
    )
    diffusivity_mm2_s: float = opt(
        "Diffusion coefficient of the dye (--predict).", DYE_DIFFUSIVITY, min=0.0
    )


def predict_front(
    model: Path, out: Path, flow_ml_min: float | None, requested: FrontOptions
) -> dict[str, Any]:
    """Predict the front of dye that runs into a network; write it, and return its figures.

    Parameters
    ----------
    model : Path
        A run folder or a network's file.
    out : Path
        Folder for the files, made where it isn't.
    flow_ml_min : float or None, mL/min
        Into the part; the run's own or 0.25 where not given.

    Raises
    ------
    UsageError
        For a place off the network, or where closed vessels leave no way through.
    FlowError
        When the network has no flow from inlet to outlet.
    """
    lumens = lumens_of(model, requested.unit, requested.as_printed)
    network = lumens.network
    places = tuple(_place(text, network) for text in requested.at or ())
    flow = (
        solve_without_closed(network, None, lumens.closed)
        if lumens.closed
        else carrying_flow(network, None)
    )
    if flow is None:
        raise UsageError(
            f"the printed vessels that are closed ({', '.join(map(str, lumens.closed))}) leave no "
            "way from inlet to outlet, so no dye runs"
        )
    rate = flow_ml_min or lumens.flow_ml_min or _USUAL_ML_MIN
    front = dye_front(network, flow, rate * UL_S_PER_ML_MIN, requested.diffusivity_mm2_s)
    out.mkdir(parents=True, exist_ok=True)
    return write_front(out, network, flow, front, places, 1.0 / requested.frames_per_s)


def _place(text: str, network: VesselNetwork) -> VesselPlace:
    vessel, _, share = text.partition(":")
    try:
        place = VesselPlace(int(vessel), float(share or 1.0))
    except ValueError:
        place = VesselPlace(-1, np.nan)
    if not (0 <= place.vessel < network.vessel_count and 0.0 <= place.share <= 1.0):
        raise UsageError(
            f"--at {text} isn't a place; give VESSEL:SHARE with a vessel from 0 to "
            f"{network.vessel_count - 1} and a share of its length from 0 to 1, as in 5:0.5"
        )
    return place
