"""Stage 9: segment the lumens, align the scan with the design, gauge vessel by vessel."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from design.files import write_text
from design.solids import Solid, write_ply
from printctl.pipeline.context import LUMEN, NETWORK, SOLID, RunContext
from printctl.pipeline.manifest import digest_file
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.scan import SCAN, TRUTH, load_scan
from printctl.pipeline.truth import pose_error
from printctl.progress import Report
from printctl.recipe.making import FileScan, Fresh, SimulatedScan
from registration import RegistrationReport, register_scan, report_dict

NUMBERS, DEVIATION = "registration.json", "deviation.ply"

SIGN = "positive where the lumen, or the outside, reaches beyond the design: too little gel"


def depends(context: RunContext) -> Any:
    """How it was made decides what is compared; the user's scan where it names one."""
    part = context.scan_part
    if not isinstance(part, FileScan):
        return context.recipe.toolpath.method
    path = context.recipe_folder / part.file
    return [part.model_dump(mode="json"), digest_file(path), context.recipe.toolpath.method]


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Register; then, for a simulated scan, hold the pose against the truth."""
    fresh = isinstance(context.recipe.toolpath, Fresh)
    model = context.solid if fresh else context.lumen
    found = register_scan(load_scan(context), model, context.network)
    report(0.9, "writing")
    summary = {**report_dict(found), "sign_convention": SIGN}
    write_text(context.folder / NUMBERS, json.dumps(summary, indent=1, allow_nan=False) + "\n")
    write_deviation(context.folder / DEVIATION, found)
    if isinstance(context.scan_part, SimulatedScan):
        summary["truth_check"] = check_truth(context, found, model)
    return summary, [NUMBERS, DEVIATION]


def write_deviation(path: Path, found: RegistrationReport) -> None:
    """The scanned surface after the scaled fit, in the part's frame, with its signed deviation."""
    again = found.scaled_scan_to_part @ np.linalg.inv(found.transform_scan_to_part)
    vertices = found.vertices @ again[:3, :3].T + again[:3, 3]
    surface = Solid(vertices.astype(np.float32).astype(np.float64), found.faces)
    write_ply(path, surface, scalar=found.scaled_deviation_um, scalar_name="deviation_um")


def load_deviation(
    path: Path,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64]]:
    """Read back what `write_deviation` wrote: vertices, faces, deviation in µm."""
    mesh = trimesh.load_mesh(path, process=False)
    values = mesh.metadata["_ply_raw"]["vertex"]["data"]["deviation_um"]
    return (
        np.asarray(mesh.vertices, dtype=np.float64),
        np.asarray(mesh.faces, dtype=np.int32),
        np.asarray(values, dtype=np.float64).reshape(-1),
    )


def check_truth(context: RunContext, found: RegistrationReport, model: Solid) -> dict[str, Any]:
    """The recovered transform against the simulated scanner's, which registration never saw."""
    truth = json.loads((context.folder / TRUTH).read_text(encoding="utf-8"))
    return pose_error(
        found.scaled_scan_to_part,
        np.array(truth["printer_to_scan"]),
        context.place_mm,
        model.bounds,
    )


def reads(context: RunContext) -> tuple[str, ...]:
    """The design, and the simulated scan where there is one."""
    scan = (SCAN, TRUTH) if isinstance(context.scan_part, SimulatedScan) else ()
    return (NETWORK, LUMEN, SOLID, *scan)


STAGE = Stage("registration", depends, reads, ("kernels", "registration", "design"), work)
