"""`printctl dye`: compare a dye video with a design's 0D flow, or predict the dye front."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from design.files import write_text
from design.network_files.csv_format import read_network_csv
from design.units import UL_S_PER_ML_MIN
from printctl.analysis.dye import CURVES, FRONT, PICTURE, FrontOptions, predict_front
from printctl.cli.declare import json_command
from printctl.cli.options import CameraFile, OutFolder, print_notes, print_result, print_warning
from printctl.errors import UsageError
from printctl.run_folder.artefacts import NETWORK
from printctl.settings import arg, opt
from registration.devices.lens import read_lens
from registration.dye import DyeOptions, dye_dict, measure_dye, place_rows, read_marks
from registration.files.exports import as_csv
from report.pages.dye import write_dye_html

NUMBERS, PLACES, PAGE = "dye.json", "dye.csv", "dye.html"


@json_command
def dye(
    *,
    model: Path = opt("A run folder, or its network.csv in mm.", ...),
    out: OutFolder,
    video: Path | None = arg("Film of dye run through the part (docs/dye.md).", None),
    marks: Path | None = opt("YAML: known points and their pixels."),
    flow_ml_min: float | None = opt("Into the part; else fitted.", min=1e-6),
    start_s: float | None = opt("When dye passes the inlet, film's clock; else fitted."),
    tolerance_percent: float = opt(
        "Relative to the predicted distance from the inlet.", 40.0, min=0.1
    ),
    camera: CameraFile = None,
    predict: bool = opt("No film yet: when dye will come to each vessel.", False),
    front: FrontOptions,
) -> None:
    """Arrival of dye along the vessels against the prediction, and which vessels are open.

    Exit code 1 unless the part passes. With --predict the front alone: its tip and its mean in
    each vessel, curves at places, and whether a film's frames are near enough.
    """
    if predict:
        if video is not None or marks is not None:
            raise UsageError("--predict takes no film and no marks; leave them out, or --predict")
        _tell_front(predict_front(model, out, flow_ml_min, front), out)
        return
    idle = {"as-printed": front.as_printed, "at": front.at, "unit": front.unit not in (None, "mm")}
    if name := next(filter(idle.get, idle), None):
        raise UsageError(f"--{name} is for --predict; leave it out")
    if video is None or marks is None:
        raise UsageError(
            "give a film and its --marks (docs/dye.md), or --predict to foresee the front"
        )
    path = model / NETWORK if model.is_dir() else model
    if not path.is_file():
        raise UsageError(f"no network at {path}; --model takes a run folder, or its network.csv")
    network = read_network_csv(path, unit="mm")
    options = DyeOptions(
        flow_ul_s=None if flow_ml_min is None else flow_ml_min * UL_S_PER_ML_MIN,
        start_s=start_s,
        lens=None if camera is None else read_lens(camera),
    )
    report = measure_dye(video, read_marks(marks), network, options)
    data = dye_dict(report, tolerance_percent)
    print_notes(report.notes)
    write_text(out / NUMBERS, json.dumps(data, indent=1, allow_nan=False) + "\n")
    write_text(out / PLACES, as_csv(place_rows(report)))
    write_dye_html(out / PAGE, video.name, data, report, network)
    verdict = data["verdict"]
    lines = [verdict["outcome"], *verdict["reasons"], str(out / PAGE)]
    print_result(data, lines, verdict["passed"])


def _tell_front(summary: dict[str, Any], out: Path) -> None:
    if summary["warning"]:
        print_warning(f"warning: {summary['warning']}")
    if unsure := summary["vessels_between"] + summary["vessels_dispersed"]:
        print_notes([
            f"in {unsure} vessels dye diffuses across the lumen while it runs (fourier above "
            "0.01), so that its tip comes later and its front is steeper than foreseen, between "
            "tip and mean"
        ])  # fmt: skip
    lines = [f"{key}: {value:.4g}" for key, value in summary.items() if key != "warning"]
    print_result(summary, [*lines, *(str(out / name) for name in (FRONT, CURVES, PICTURE))])
