"""`printctl dye`: compare a dye video with a design's 0D flow, or predict the dye front."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from design.files import write_text
from design.hemodynamics.dye import DYE_DIFFUSIVITY
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv
from design.units import UL_S_PER_ML_MIN
from printctl.cli.calibrate_options import CameraFile
from printctl.cli.declare import command
from printctl.cli.dye_predict import FrontOptions, predict_front
from printctl.cli.options import (
    JsonFlag,
    UnitOption,
    folder_to_write,
    messages,
    print_json,
    print_lines,
)
from printctl.errors import UsageError
from printctl.run_folder.artefacts import NETWORK
from printctl.settings import arg, opt
from registration.devices.lens import read_lens
from registration.dye import (
    DyeOptions,
    DyeReport,
    dye_dict,
    measure_dye,
    place_rows,
    read_marks,
)
from registration.files.exports import as_csv
from registration.report.dye_page import write_dye_html

NUMBERS, PLACES, PAGE = "dye.json", "dye.csv", "dye.html"


@command
def dye(
    model: Path = opt("A run folder, or its network.csv in mm.", ...),
    out: Path = opt("Folder for the files.", ..., callback=folder_to_write),
    video: Path | None = arg("Film of dye run through the part (docs/dye.md).", None),
    marks: Path | None = opt("YAML: known points and their pixels."),
    flow_ml_min: float | None = opt("Into the part; else fitted.", min=1e-6),
    start_s: float | None = opt("When dye passes the inlet, film's clock; else fitted."),
    tolerance_percent: float = opt("Of the predicted way from the inlet.", 40.0, min=0.1),
    camera: CameraFile = None,
    predict: bool = opt("No film yet: when dye will come to each vessel.", False),
    frames_per_s: float = opt("Of the film to come (--predict).", 25.0, min=1e-3),
    as_printed: bool = opt("Lumens as registration found them (--predict).", False),
    at: list[str] | None = opt("Places of curves (--predict).", metavar="VESSEL:SHARE"),
    unit: UnitOption = None,
    diffusivity_mm2_s: float = opt("Of the dye (--predict).", DYE_DIFFUSIVITY, min=0.0),
    as_json: JsonFlag = False,
) -> None:
    """Arrival of dye along the vessels against the prediction, and which vessels are open.

    Exit code 1 unless the part passes. With --predict the front alone: its tip and its mean in
    each vessel, curves at places, and whether a film's frames are near enough.
    """
    if predict:
        if video is not None or marks is not None:
            raise UsageError("--predict takes no film and no marks; leave them out, or --predict")
        asked = FrontOptions(model, unit, out, flow_ml_min, frames_per_s, as_printed,
                         tuple(at or ()), diffusivity_mm2_s)  # fmt: skip
        predict_front(asked, as_json)
        return
    idle = {"--as-printed": as_printed, "--at": at, "--unit": unit not in (None, "mm")}
    if any(idle.values()):
        raise UsageError(f"{next(k for k in idle if idle[k])} is for --predict; leave it out")
    if video is None or marks is None:
        raise UsageError(
            "give a film and its --marks (docs/dye.md), or --predict to foresee the front"
        )
    network = _network(model)
    options = DyeOptions(
        flow_ul_s=None if flow_ml_min is None else flow_ml_min * UL_S_PER_ML_MIN,
        start_s=start_s,
        lens=None if camera is None else read_lens(camera),
    )
    report = measure_dye(video, read_marks(marks), network, options)
    _tell(report, dye_dict(report, tolerance_percent), _Film(video, network, out), as_json)


@dataclass(frozen=True)
class _Film:
    """A film, its part, and the folder of what is found."""

    video: Path
    network: VesselNetwork
    out: Path


def _tell(report: DyeReport, data: dict[str, Any], film: _Film, as_json: bool) -> None:
    """Write files and words; exit code 1 unless the part passes."""
    out = film.out
    for note in report.notes:
        messages().print(f"note: {note}", markup=False)
    write_text(out / NUMBERS, json.dumps(data, indent=1, allow_nan=False) + "\n")
    write_text(out / PLACES, as_csv(place_rows(report)))
    write_dye_html(out / PAGE, film.video.name, data, report, film.network)
    if as_json:
        print_json(data)
    else:
        print_lines(data["verdict"]["outcome"], *data["verdict"]["reasons"], str(out / PAGE))
    if not data["verdict"]["passed"]:
        raise typer.Exit(1)


def _network(model: Path) -> VesselNetwork:
    path = model / NETWORK if model.is_dir() else model
    if not path.is_file():
        raise UsageError(f"no network at {path}; --model takes a run folder, or its network.csv")
    return read_network_csv(path, unit="mm")
