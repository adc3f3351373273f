"""`printctl dye --predict`: predict a dye front's arrival times in a network, without a video."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from design.hemodynamics.dye import dye_front
from design.network import VesselNetwork
from design.units import UL_S_PER_ML_MIN, LengthUnit
from printctl.analysis.dye import CURVES, FRONT, PICTURE, VesselPlace, lumens_of, write_front
from printctl.cli.options import messages, print_json, print_lines
from printctl.errors import UsageError
from registration.dye.flow import carrying_flow, solve_without_closed

_USUAL_ML_MIN = 0.25


@dataclass(frozen=True)
class FrontOptions:
    """What is asked of a front."""

    model: Path
    unit: LengthUnit | None
    out: Path
    flow_ml_min: float | None
    frames_per_s: float
    as_printed: bool
    at: tuple[str, ...]
    diffusivity_mm2_s: float


def predict_front(asked: FrontOptions, as_json: bool) -> None:
    """Foresee, write and say it.

    Raises
    ------
    UsageError
        For a place off the network, or where closed vessels leave no way through.
    FlowError
        When the network has no flow from inlet to outlet.
    """
    lumens = lumens_of(asked.model, asked.unit, asked.as_printed)
    network = lumens.network
    places = tuple(_place(text, network) for text in asked.at)
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
    rate = asked.flow_ml_min or lumens.flow_ml_min or _USUAL_ML_MIN
    front = dye_front(network, flow, rate * UL_S_PER_ML_MIN, asked.diffusivity_mm2_s)
    asked.out.mkdir(parents=True, exist_ok=True)
    summary = write_front(asked.out, network, flow, front, places, 1.0 / asked.frames_per_s)
    if summary["warning"]:
        messages().print(f"warning: {summary['warning']}", style="yellow", markup=False)
    if summary["vessels_between"] + summary["vessels_dispersed"]:
        messages().print(
            f"note: in {summary['vessels_between'] + summary['vessels_dispersed']} vessels dye "
            "diffuses across the lumen while it runs (fourier above 0.01), so that its tip comes "
            "later and its front is steeper than foreseen, between tip and mean",
            markup=False,
        )
    if as_json:
        print_json(summary)
        return
    lines = [f"{key}: {value:.4g}" for key, value in summary.items() if key != "warning"]
    print_lines(*lines, *(str(asked.out / name) for name in (FRONT, CURVES, PICTURE)))


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
